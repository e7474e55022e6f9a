//! Judging of played runs: script files and keys in virtual time, as in `tests`.

use super::super::context::{EngineContext, Notes};
use super::super::control::{Control, Live, Request, Scripted, Situation, Turn};
use super::super::ending::{EndRequest, EndedBy};
use super::super::engines::engines;
use super::super::message::Message;
use super::super::options::order;
use super::super::outcome::{End, Outcomes};
use super::super::play::action::{Act, Action, Wish};
use super::super::session::{self, Setup};
use super::super::summary;
use super::model::Model;
use super::tests::{COLOUR, Cli, buffer, char, pair, text};
use clap::Parser;
use embassy_time::{Duration, Instant};
use jetlink::command::{Accepted, Command, Demand, Interlock, Order, Origin, Rejected};
use jetlink::units::{Rpm, Throttle};
use sim::ecu::{MILLIS, SECOND};
use sim::turbine::Phase;
use sim::wire::{Direction, Entry};
use std::cell::RefCell;

const HEAD: &str = "jetlink rig script, version 0.1.0\n";
/// A ZK engine that is quick to log, and an AMT engine, whose ECU has reply windows.
const ZK: &str = "engine name=left,ecu=zk\n";
const AMT: &str = "engine name=left,ecu=amt,baud=115200\n";

/// Outcome of a script file.
pub struct Run {
    model: Model,
    outcomes: Outcomes,
}

impl Run {
    pub fn problems(&self) -> Vec<String> {
        summary::problems(&self.outcomes)
    }

    fn happened(&self, what: &str) -> usize {
        self.model.events.iter().filter(|event| event.text.contains(what)).count()
    }
}

/// Plays a script file, whether it has an end or not.
pub fn run(name: &str, script: &str) -> Result<Run, String> {
    run_with(name, script, &[])
}

/// The same, with unsolicited commands.
fn run_with(name: &str, script: &str, uncommanded: &[(f64, Command)]) -> Result<Run, String> {
    let path = std::env::temp_dir().join(format!("jetlink-judged-{}-{name}", std::process::id()));
    std::fs::write(&path, format!("{HEAD}{script}")).unwrap();
    let order = order(&Cli::parse_from(["rig", "--fast", "--script", path.to_str().unwrap()]).args);
    std::fs::remove_file(&path).unwrap();
    let mut order = order?;
    let at = |&(at, command): &(f64, Command)| (Duration::from_micros((at * 1e6) as u64), command);
    order.setup.uncommanded = uncommanded.iter().map(at).collect();
    let (actions, over) = order.script.take().unwrap();
    Ok(steered(&order.setup, &mut Scripted::new(actions, over)))
}

fn steered(setup: &Setup, control: &mut dyn Control) -> Run {
    let model = RefCell::new(Model::new(&setup.engines, setup.plan.length, setup.scenario.is_some()));
    let outcomes = session::run(setup, control, |message| {
        model.borrow_mut().message(message);
        true
    });
    Run { model: model.into_inner(), outcomes }
}

/// Noise makes a status of e1 that shows a pump voltage at rest, with a CRC that fits: the node closes the pump.
#[test]
fn a_pump_that_noise_shows_open_may_be_closed() {
    let engines = "engine name=e0,ecu=zk,mode=rpm\nengine name=e1,ecu=zk,mode=rpm\n\
                   engine name=e2,ecu=amt,engine=olympus\nengine name=e3,ecu=zk,version=5\n";
    let run = run("pump", &format!("seed 20041\n{engines}faults heavy\n4.0 end\n")).unwrap();
    assert_eq!(run.problems(), Vec::<String>::new());
}

/// After an emergency stop the engine is disarmed, and a source that has armed it has to disarm first.
#[test]
fn a_script_that_is_restarted_after_a_stop_flies() {
    let actions = "60 left emergency-stop\n80 left release\n81 left script\n";
    let run = run("restart", &format!("{ZK}{actions}")).unwrap();
    assert_eq!(run.happened("after the command"), 2, "{:?}", run.model.events);
    assert_eq!((run.happened("rejected"), run.happened("NOT REACHED")), (0, 0), "{:?}", run.model.events);
    assert_eq!(run.problems(), Vec::<String>::new());
}

/// A script restarts when the stop is released. Until then the engine stays played, and time passes.
#[test]
fn a_script_is_not_restarted_while_a_stop_is_latched() {
    let keys = [(50.0, char(' ')), (60.0, char('b'))];
    let played = pair(75.0, &keys, "latched");
    let texts: Vec<&str> = played.model.events.iter().map(|event| event.text.as_str()).collect();
    let reason = "left stays played: an emergency stop is latched: release it when the engine has stopped";
    assert_eq!(texts.iter().filter(|text| **text == reason).count(), 1, "{texts:?}");
    assert!(!texts.iter().any(|text| text.contains("NOT REACHED")), "{texts:?}");
    assert!(played.model.verdict.is_none() && played.outcomes.length >= Duration::from_secs(75));
    // A file without an end does not give the engine back by that, and does not wait forever where a cut wire keeps the stop
    // from being released.
    let stop = "60 all emergency-stop\n";
    let error = run("latched", &format!("{ZK}{stop}70 all script\n")).err().expect("refused");
    assert!(error.contains("left is played until the run ends: add `end`"), "{error}");
    let cut = format!("59 left cut\n{stop}61 left release\n62 left script\n");
    let run = run("unreleased", &format!("{ZK}{cut}")).unwrap();
    assert_eq!((run.happened("left stays played"), run.outcomes.length.as_secs()), (1, 72));
}

/// A pilot does not cause the effects of `--faults` either. Effects without a fault count: `Disturbances` and the judge test
/// this.
#[test]
fn faults_of_the_run_explain_missed_windows() {
    for (i, script) in ["faults heavy\n3 left arm\n40 end\n", "faults cut=left@60s+5s\n3 left arm\n100 end\n"]
        .into_iter()
        .enumerate()
    {
        let run = run(&format!("explained-{i}"), &format!("{AMT}{script}")).unwrap();
        assert_eq!(run.problems(), Vec::<String>::new(), "{script}");
        let counts = run.outcomes.engines[0].ecu;
        assert!(counts.unanswered + counts.late > 0, "{script}: no window was missed");
    }
}

/// Nor those of a scenario, whenever it is stopped by hand.
#[test]
fn a_scenario_that_is_stopped_by_hand_is_judged_by_the_stop() {
    let mut missed = 0;
    for (name, at) in [("one-wire-cut", 78), ("source-loss", 1), ("watchdog-loop", 78)] {
        let order = order(&Cli::parse_from(["rig", "--fast", "--scenario", name]).args).unwrap();
        let stop = Action { engine: None, act: Act::EmergencyStop };
        let (at, end) = (Duration::from_secs(at), Duration::from_secs(at + 40));
        let run = steered(&order.setup, &mut Scripted::new(vec![(Instant::MIN + at, stop)], Some(end)));
        assert_eq!(run.problems(), Vec::<String>::new(), "{name}");
        assert!(summary::pass(&run.outcomes).starts_with("STOPPED by hand"), "{name} at {at}");
        let stops: Vec<_> = run.outcomes.engines.iter().map(|outcome| outcome.audit.stop_at).collect();
        assert!(stops.iter().all(Option::is_some), "{name} at {at}: {stops:?}");
        missed += run.outcomes.engines.iter().map(|outcome| outcome.ecu.unanswered).sum::<u64>();
    }
    assert!(missed > 0, "no window was missed");
}

/// As a person sees it, but as quick as the machine allows.
struct AtOnce(Live);

impl Control for AtOnce {
    fn turn(&mut self, situation: &Situation<'_>) -> Turn {
        Turn { pace: None, ..self.0.turn(situation) }
    }
}

/// A run that no pilot flies and whose time is over stays with a verdict, and can be played on.
#[test]
fn a_run_of_radio_control_ends_with_a_verdict() {
    let stop = Action { engine: None, act: Act::EmergencyStop };
    for (played, verdict) in
        [(false, "PASS: no unsolicited command, and"), (true, "PASS: no unsolicited command, no")]
    {
        let mut order = order(&Cli::parse_from(["rig", "--rc", "pwm", "--duration", "4s"]).args).unwrap();
        order.setup.fast = true;
        let model = RefCell::new(Model::new(&order.setup.engines, order.setup.plan.length, false));
        let end = EndRequest::default();
        let (keys, requests) = std::sync::mpsc::channel();
        if played {
            keys.send(Request::Wish(None, Wish::Act(stop.act))).unwrap();
        }
        let mut live = AtOnce(Live::new(requests, end.clone(), None));
        // As `q`, once the verdict is there.
        let outcomes = session::run(&order.setup, &mut live, |message| {
            let is_end = matches!(message, Message::Complete(_));
            model.borrow_mut().message(message);
            if is_end {
                end.request(EndedBy::Key);
            }
            true
        });
        let of_screen = model.into_inner().verdict.expect("a verdict");
        assert!(of_screen.pass && of_screen.lines[0].starts_with(verdict), "{of_screen:?}");
        assert_eq!(outcomes.length, Duration::from_secs(4));
        let text = summary::text(&outcomes, &summary::problems(&outcomes), None, 80);
        assert!(text.contains(verdict), "{text}");
    }
}

/// A file with only an end: faults up to then are judged.
#[test]
fn a_script_file_that_ends_before_the_engines_have_flown_has_a_verdict() {
    let whole = run("only-end", &format!("{AMT}2 end\n")).unwrap();
    assert_eq!(whole.outcomes.end, End::Over);
    let text = summary::text(&whole.outcomes, &whole.problems(), None, 80);
    assert!(
        text.contains("PASS: no unsolicited command, and") && text.contains("targets are not judged"),
        "{text}"
    );
    // On a disturbed line less is judged.
    let disturbed = run("only-end-noise", &format!("{AMT}faults heavy\n9 end\n")).unwrap();
    assert_eq!(summary::pass(&disturbed.outcomes), "PASS: no unsolicited command; targets are not judged.");
}

/// Actions that a pilot may take at any time are not unsolicited commands.
#[test]
fn plain_actions_of_a_pilot_are_not_findings() {
    for (i, script) in [
        format!("{AMT}3 left arm\n3.1 left start\n10 left disarm\n40 end\n"),
        format!("{ZK}3 left arm\n3.1 left start\n8 left disarm\n40 end\n"),
        format!("{ZK}3 left arm\n3.1 left start\n60 left disarm\n80 end\n"),
        "engine name=left,ecu=zk,mode=rpm\n3 left arm\n3.1 left start\n8 left disarm\n40 end\n".to_owned(),
        "engine name=left,ecu=zk\n3 left arm\n3.1 left start\n60 left rpm 90000\n80 left throttle 40\n90 end\n".to_owned(),
    ]
    .into_iter()
    .enumerate()
    {
        let run = run(&format!("plain-{i}"), &script).unwrap();
        assert_eq!(run.problems(), Vec::<String>::new(), "{script}");
    }
    // A command that the node would refuse, and thereby lose its source, is a mistake in the file.
    for (action, what) in
        [("rpm 60000", "the ECU of left has no speed control"), ("rpm 999999", "has no speed control")]
    {
        let error = run("refused", &format!("{AMT}3 left {action}\n9 end\n")).err().expect("refused");
        assert!(error.contains(what) && error.contains("line 3"), "{error}");
    }
}

/// Plays each script file, and expects a pass.
fn all_pass(name: &str, scripts: &[&str]) {
    for (i, script) in scripts.iter().enumerate() {
        let run = run(&format!("{name}-{i}"), script).unwrap();
        assert_eq!(run.problems(), Vec::<String>::new(), "{script}");
    }
}

#[test]
fn a_release_where_no_stop_is_latched_changes_nothing() {
    let actions = "60 left silent\n60.5 left release\n90 end\n";
    all_pass("release", &[&format!("{AMT}{actions}"), &format!("{ZK}{actions}")]);
}

#[test]
fn an_emergency_stop_stays_in_force_through_two_resets() {
    let soon = "50 all emergency-stop\n60 all node-reset\n60.5 all node-reset\n80 end\n";
    // A node that receives no set sends nothing between the two.
    let cut = "50 all emergency-stop\n55 left cut-to-node\n60 all node-reset\n77 all node-reset\n\
               80 left mend-to-node\n90 end\n";
    for actions in [soon, cut] {
        all_pass("two-resets", &[&format!("{AMT}{actions}"), &format!("{ZK}{actions}")]);
    }
}

#[test]
fn a_reset_in_the_first_instant_cuts_a_frame_without_a_finding() {
    all_pass("first-instant", &["0.0 all node-reset\n10 end\n"]);
}

#[test]
fn a_source_that_has_just_returned_leaves_the_engine_in_standby() {
    let actions = "4.3 left silent\n22.4 left start\n23.4 left speak\n79.7 end\n";
    let by_rpm = format!("engine name=left,ecu=zk,mode=rpm\n{actions}");
    all_pass("returned", &[&by_rpm, &format!("{ZK}{actions}"), &format!("{AMT}{actions}")]);
}

/// A source that falls silent, or commands another demand, between two resets.
#[test]
fn a_run_stays_in_force_through_two_resets() {
    for between in ["silent", "throttle 20"] {
        let actions = format!("60 all node-reset\n60.4 left {between}\n60.7 all node-reset\n70 end\n");
        let by_rpm = "engine name=left,ecu=zk,mode=rpm\n";
        all_pass(
            "run-two-resets",
            &[AMT, ZK, by_rpm].map(|engine| format!("{engine}{actions}")).each_ref().map(String::as_str),
        );
    }
}

/// The node has commanded run, and the ECU has not received it.
#[test]
fn disarming_ends_a_start_that_the_ecu_does_not_follow() {
    let actions = "2 left cut-to-ecu\n3 left arm\n3.2 left start\n8 left disarm\n30 end\n";
    all_pass("disarm", &[&format!("{AMT}{actions}"), &format!("{ZK}{actions}")]);
}

/// One damaged ZK frame in 256 passes its checksum.
#[test]
fn a_start_that_noise_has_made_on_the_line_is_not_an_uncommanded_ignition() {
    let engines =
        "engine name=e0,ecu=zk,version=1,baud=2400,stop=1\nengine name=e1,ecu=zk,mode=split,rate=100\n";
    let script = format!("seed 1090\n{engines}17.0 e1 noise\n40.4 end\n");
    let run = run("misread", &script).unwrap();
    assert_eq!(run.problems(), Vec::<String>::new());
    let began = run.happened("reports starting");
    assert!(began > 0, "the noise has to begin a start: {:?}", run.model.events);
}

/// The ECU completes a start that has ended, because its wire is cut: after a reset the node reports its standby once more.
#[test]
fn a_standby_that_a_reset_repeats_gives_up_no_engine() {
    let actions = "18.8 all node-reset\n19.1 left cut-to-ecu\n25.1 all node-reset\n30 end\n";
    all_pass("repeats", &[&format!("engine name=left,ecu=zk,mode=rpm\n{actions}")]);
}

/// An AMT ECU is answered every 125 ms.
#[test]
fn a_stop_that_is_released_before_its_first_frame_is_not_late() {
    let of =
        |at: f64| format!("2 left standby\n{at} left emergency-stop\n{} left release\n20 end\n", at + 0.1);
    let scripts = [8.0, 8.1, 8.2, 8.3, 8.4].map(|at| format!("{AMT}{}", of(at)));
    all_pass("released", &scripts.each_ref().map(String::as_str));
}

#[test]
fn a_standby_of_the_instant_of_a_reset_is_in_force_after_it() {
    let actions = "10 all node-reset\n10 all standby\n10 all standby\n20 end\n";
    all_pass("standby-and-reset", &[&format!("{AMT}{actions}"), &format!("{ZK}{actions}")]);
}

/// It waits for its ECU, with the speed that it has sent last: so does another kind of demand.
#[test]
fn a_node_in_doubt_repeats_the_speed() {
    let by_rpm = "engine name=left,ecu=zk,mode=rpm\n";
    let cut = "60 left cut\n62 left throttle 40\n75 left mend\n90 end\n";
    let reset = "60 all node-reset\n60.2 left throttle 40\n80 end\n";
    let in_start = "18.8 all node-reset\n21 left throttle 40\n25 all node-reset\n50 end\n";
    all_pass(
        "doubt",
        &[cut, reset, in_start].map(|actions| format!("{by_rpm}{actions}")).each_ref().map(String::as_str),
    );
}

/// The ECU may obey less than the last demand sent.
#[test]
fn a_rise_after_a_gap_begins_with_what_the_ecu_obeys() {
    let engine = "engine name=left,ecu=zk,mode=split,rate=100\n";
    let script = format!("{engine}3 left arm\n28.9 left noise\n44.2 left throttle 100\n68.3 end\n");
    all_pass("obeys", &[&script, &format!("seed 1972\n{script}")]);
}

#[test]
fn a_start_that_ends_within_a_moment_is_a_commanded_one() {
    let engine = "engine name=left,ecu=zk,mode=rpm,rate=100,baud=38400\n";
    all_pass(
        "moment",
        &[&format!("{engine}5 left disarm\n6 left arm\n17.7 left start\n17.7 left cut-to-node\n17.8 end\n")],
    );
}

#[test]
fn a_switch_at_stop_that_no_frame_transmitted_is_not_a_late_stop() {
    let actions = "3 all arm\n29.1 all disarm\n29.1 all start\n40 end\n";
    let of = |rc: &str| format!("{ZK}rc {rc}\n{actions}");
    all_pass("no-frame", &["sbus", "crsf", "pwm"].map(of).each_ref().map(String::as_str));
}

/// Unsolicited actions of the node are found, whatever a pilot does at the same time.
#[test]
fn unsolicited_commands_are_found_in_a_played_run() {
    // Between two commands of the player, and before a set of the AMT ECU.
    let standby = [(71.11, Command::Standby), (71.12, Command::Standby)];
    let throttle = [(71.11, Command::Run(Demand::Throttle(Throttle::from_percent(90).unwrap())))];
    let stop = [(71.02, Command::EmergencyStop)];
    let idle = Command::Run(Demand::Throttle(Throttle::IDLE));
    // The player's source is silent, and something else commands as it.
    let start = (250..350).map(|tenth| match tenth {
        250..300 => (f64::from(tenth) / 10.0, Command::Standby),
        _ => (f64::from(tenth) / 10.0, idle),
    });
    let start: Vec<_> = start.collect();
    let flies = "3 left arm\n3.1 left start\n60 left throttle 40\n";
    for (i, (actions, uncommanded, found)) in [
        ("", &stop[..], "an unsolicited command at 71."),
        ("", &throttle, "an unsolicited command at 71."),
        ("", &standby, "an unsolicited command at 71."),
        ("62 left cut-to-node\n64 left mend-to-node\n", &stop, "an unsolicited command at 71."),
        ("62 left disarm\n66 left release\n", &stop, "an unsolicited command at 71."),
        ("62 all node-reset\n", &stop, "an unsolicited command at 71."),
        ("62 left emergency-stop\n69 left release\n", &stop, "an unsolicited command at 71."),
    ]
    .into_iter()
    .enumerate()
    {
        for (name, engine) in [("amt", AMT), ("zk", ZK)] {
            let script = format!("{engine}{flies}{actions}80 end\n");
            let run = run_with(&format!("found-{i}-{name}"), &script, uncommanded).unwrap();
            let problems = run.problems();
            assert!(problems.iter().any(|problem| problem.contains(found)), "{script}: {problems:?}");
        }
    }
    for (name, engine) in [("amt", AMT), ("zk", ZK)] {
        let script = format!("{engine}1 left arm\n20 left silent\n40 end\n");
        let problems = run_with(&format!("lit-{name}"), &script, &start).unwrap().problems();
        for found in ["an unsolicited command at 30.", "1 uncommanded ignitions"] {
            assert!(problems.iter().any(|problem| problem.contains(found)), "{script}: {problems:?}");
        }
    }
}

/// A source whose demands the ECU cannot follow is a silent one: the node may give up its start. The control: one whose
/// demands it can follow is not.
#[test]
fn a_source_that_is_refused_is_silent_for_the_audit() {
    let (engines, notes) = (engines(&[]).unwrap(), Notes::default());
    let idle = Order::Run(Demand::Throttle(Throttle::IDLE));
    let rpm = Order::Run(Demand::Rpm(Rpm::new(60_000)));
    for (order, answer, found) in [
        (rpm, Err(Rejected::NoSpeedControl), 0),
        (idle, Ok(Accepted::InForce), 1),
        (idle, Err(Rejected::Start(Interlock::Link)), 1),
    ] {
        let context = EngineContext::new(0, &engines[0], Instant::MIN, &notes);
        // Its ECU is received all the time, a byte for each frame.
        let byte = |eighth| Entry::delivered(Direction::ToNode, eighth * SECOND / 8, MILLIS, &[0]);
        let received: Vec<Entry> = (32..160).flat_map(byte).collect();
        context.audit.borrow_mut().look(&received);
        context.judge(5 * SECOND, idle, Origin::Bench, Ok(Accepted::InForce));
        (51..200).for_each(|tenth| context.judge(tenth * SECOND / 10, order, Origin::Bench, answer));
        context.audit.borrow_mut().cancelled(20 * SECOND, Phase::FuelRamp);
        assert_eq!(context.audit.borrow().not_given, found, "{answer:?}");
    }
}

/// A flame that does not burn cannot go out, which excuses nothing.
#[test]
fn a_fault_that_cannot_act_changes_nothing() {
    let cold = run("cold", &format!("{AMT}2 left flame-out\n9 end\n")).unwrap();
    assert_eq!(cold.happened("no flame burns that could go out"), 1);
    assert!(cold.outcomes.engines[0].played.is_none(), "it is judged as one that was left alone");
    let error = run("cold-no-end", &format!("{AMT}3.0 left flame-out\n")).err().expect("refused");
    assert!(error.contains("`3 left flame-out`: its flame burns from about"), "{error}");
    let key = [(1.0, char('f')), (1.1, char('o'))];
    let by_key = pair(3.0, &key, "cold-key");
    assert!(by_key.outcomes.actions.is_empty(), "{:?}", by_key.outcomes.actions);
    let hot = run("hot", &format!("{AMT}60 left flame-out\n70 end\n")).unwrap();
    assert!(hot.outcomes.engines[0].played.is_some() && hot.happened("no flame burns") == 0);
    // Of `faults`, for an engine that was taken from its script.
    let planned = format!("{AMT}faults flame-out=left@60s\n");
    let stopped = run("stopped", &format!("{planned}1 left standby\n62 end\n")).unwrap();
    assert_eq!(
        (stopped.happened("no flame burns that could go out"), stopped.happened("flame goes")),
        (1, 0)
    );
    let flown = run("flown", &format!("{planned}62 end\n")).unwrap();
    assert_eq!((flown.happened("no flame burns"), flown.happened("the flame goes out")), (0, 1));
}

/// The file of a run that a key ended before its faults has actions: it is played, with a notice.
#[test]
fn a_fault_after_the_end_of_its_script_file_is_refused() {
    let path = std::env::temp_dir().join(format!("jetlink-judged-{}-late", std::process::id()));
    for (faults, late) in [
        ("cut=left@60s+5s", "the cut of left at 60 s comes after the end of the run at 5 s"),
        ("flame-out=left@60s", "the flame-out of left at 60 s comes after the end of the run at 5 s"),
        ("cut=left@5s+5s", "the cut of left at 5 s comes after the end"),
        ("light,from=30s", "the noise from 30 s on comes after the end of the run at 5 s"),
        ("light,from=4s,cut=left@4.9s+5s", ""),
    ] {
        for (actions, is_refused) in [("", true), ("1 left standby\n", false)] {
            std::fs::write(&path, format!("{HEAD}{AMT}faults {faults}\n{actions}5 end\n")).unwrap();
            let order = order(&Cli::parse_from(["rig", "--fast", "--script", path.to_str().unwrap()]).args);
            let expected = format!("{}: {late}", path.display());
            match order {
                _ if late.is_empty() => assert_eq!(order.unwrap().notices, Vec::<String>::new()),
                Err(error) => assert!(is_refused && error.starts_with(&expected), "{error}"),
                Ok(order) => {
                    let notices = order.notices.join("\n");
                    assert!(!is_refused && notices.starts_with(&expected), "{faults}: {notices}");
                }
            }
        }
    }
    std::fs::remove_file(&path).unwrap();
}

/// The steps after a stop are one sentence, in the event and on the page Why: disarm and arm, then start.
#[test]
fn a_start_after_a_stop_is_refused_by_the_sentence_that_why_shows() {
    let keys =
        [(50.0, char(' ')), (55.0, char('r')), (55.1, char('y')), (100.0, char('s')), (101.0, char('w'))];
    let refused = pair(102.0, &keys, "one-text");
    let sentence = Rejected::DisarmFirst.to_string();
    let events: Vec<&str> = refused.model.events.iter().map(|event| event.text.as_str()).collect();
    let of_start: Vec<&&str> = events.iter().filter(|text| text.contains("rejected")).collect();
    assert!(of_start.len() == 1 && of_start[0].contains(&sentence), "{events:?}");
    let screen = text(&buffer(&refused.model, COLOUR, 120, 40));
    assert!(screen.contains("disarm and arm again") && !screen.contains("arm the engine before"), "{screen}");
    // Who follows it gets no other refusal of that kind.
    let keys = [&keys[..3], &[(100.0, char('d')), (101.0, char('a'))]].concat();
    let followed = pair(102.0, &keys, "followed");
    assert!(followed.model.samples[0].armed, "{:?}", followed.model.events);
}

/// Events that a manually stopped scenario did not reach have no time.
#[test]
fn what_never_came_has_no_time() {
    let mut texts = Vec::new();
    for at in [55, 60, 65, 70] {
        let order = order(&Cli::parse_from(["rig", "--fast", "--scenario", "engine-lost"]).args).unwrap();
        let stop = Action { engine: None, act: Act::EmergencyStop };
        let at = Instant::MIN + Duration::from_secs(at);
        let run = steered(&order.setup, &mut Scripted::new(vec![(at, stop)], Some(Duration::from_secs(200))));
        texts.extend(run.outcomes.checks.into_iter().map(|check| check.what));
    }
    assert!(texts.iter().any(|text| text.contains("never)")), "{texts:?}");
    assert!(!texts.iter().any(|text| text.contains("inf ")), "{texts:?}");
}

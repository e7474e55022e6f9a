//! Sources: which one is in control, and the conditions of a start.

use super::super::audit::WireCommand;
use super::super::context::{PilotInput, Stage};
use super::check::{ON_WIRE, all, is_run, is_standby, only, rises_slowly};
use super::context::{CommandSource, ScenarioContext, percent};
use jetlink::command::{Accepted, Command, Interlock, Origin, Rejected};
use jetlink::event::Event;
use sim::ecu::{MILLIS, SECOND};

pub async fn waiting_start(c: &ScenarioContext<'_>) -> Result<(), String> {
    c.ready(0).await?;
    c.ready(1).await?;
    c.stage(0, Stage::Start);
    c.source(0).throttle(0);
    c.sleep(3.0).await;
    c.event();
    c.mark("right is commanded to start while left starts: it waits");
    let commanded_at = c.now();
    c.source(1).throttle(0);
    c.sleep(2.0).await;
    c.must(
        c.source(1).answer() == Some(Ok(Accepted::StartWaits)),
        format!("right: the start waits ({})", c.answer_text(1)),
    );
    c.must(c.node().telemetry(1).start_waits_until.is_some(), "right: the telemetry shows until when");
    c.mark("the source of right falls silent");
    c.source(1).silence();
    let silent = c.now();
    c.running(0).await?;
    c.stage(0, Stage::Idle);
    c.sleep(12.0).await;
    c.must(c.node().telemetry(1).start_waits_until.is_none(), "right: the wait has ended");
    let ended = c.when_reported(1, |event| {
        event == Event::CommandRejected(Rejected::Start(Interlock::OtherStarting), Origin::Bench)
    });
    c.must(
        ended.is_some_and(|at| (silent..=silent + SECOND).contains(&at)),
        format!(
            "right: reported within 1 s that the start is refused ({})",
            c.or_never(ended.map(|at| at.saturating_sub(silent)))
        ),
    );
    c.mark("the source of right commands run again");
    c.source(1).throttle(0);
    c.sleep(6.0).await;
    let again = c.now();
    c.must(
        c.source(1).answer() == Some(Err(Rejected::StandbyFirst)),
        format!("right: the wait has used the permission up ({})", c.answer_text(1)),
    );
    c.look();
    c.must(
        all(&c.transmitted(1, commanded_at, again), WireCommand::Standby),
        "right: nothing but standby is on the wire",
    );
    c.must(c.starts(1, 0, again) == 0, "right: the engine is not lit");
    c.mark("standby, and run once more");
    c.start(1).await?;
    c.must(c.starts(1, again, c.now()) == 1, "right: its own standby and run start it");
    c.must(c.starts(0, 0, c.now()) == 1 && c.runs(0), "left: was lit once, and runs");
    c.shut_down().await
}

pub async fn rc_over_mavlink(c: &ScenarioContext<'_>) -> Result<(), String> {
    c.each(|source| source.command_as(Origin::Rc));
    c.fly(60).await?;
    c.event();
    c.mark("MAVLink streams standby below RC");
    c.each(|source| source.beside(Some((Origin::Mavlink, PilotInput::Standby))));
    c.sleep(3.0).await;
    c.mark("RC is lost for 2 s");
    let lost = c.now();
    c.each(CommandSource::silence);
    c.sleep(2.0).await;
    c.each(|source| source.throttle(60));
    let back = c.now();
    c.sleep(6.0).await;
    let end = c.now();
    c.look();
    for i in 0..c.count() {
        let name = c.name(i);
        let frames = c.transmitted(i, lost - 3 * SECOND, end);
        c.must(
            only(&frames, 40, |wire| is_run(wire) || wire == WireCommand::Nothing),
            format!("{name}, above standby: no standby is on the wire"),
        );
        c.must(
            all(&c.transmitted(i, lost, lost + 1400 * MILLIS), WireCommand::Run(600)),
            format!("{name}, above standby: 60 % stays for 0.5 s (timeout) and 1 s (hold)"),
        );
        c.must(
            rises_slowly(&c.transmitted(i, lost, end)),
            format!("{name}, above standby: the demand rises by 50 % a second at most"),
        );
        c.must(c.ran_from(i, lost), format!("{name}, above standby: the engine runs all the time"));
        c.must(
            all(&c.transmitted(i, back + 4500 * MILLIS, end), WireCommand::Run(600)),
            format!("{name}, above standby: 60 % is on the wire again 4.5 s after RC was back"),
        );
    }
    c.mark("MAVLink streams run at 40 % below RC");
    c.each(|source| source.beside(Some((Origin::Mavlink, PilotInput::Run(percent(40))))));
    c.sleep(3.0).await;
    c.mark("RC is lost for 2 s");
    let lost = c.now();
    c.each(CommandSource::silence);
    c.sleep(2.0).await;
    c.each(|source| source.throttle(60));
    let back = c.now();
    c.sleep(6.0).await;
    let end = c.now();
    c.look();
    for i in 0..c.count() {
        let name = c.name(i);
        let between = |wire| match wire {
            WireCommand::Run(tenths) => (400..=600).contains(&tenths),
            wire => wire == WireCommand::Nothing,
        };
        c.must(
            only(&c.transmitted(i, lost - 2 * SECOND, end), 40, between),
            format!("{name}, above run at 40 %: every command is run between 40 % and 60 %"),
        );
        c.must(
            all(&c.transmitted(i, lost - 2 * SECOND, lost + 400 * MILLIS), WireCommand::Run(600)),
            format!("{name}, above run at 40 %: while RC is fresh, its 60 % is on the wire"),
        );
        c.must(
            rises_slowly(&c.transmitted(i, lost, end)),
            format!("{name}, above run at 40 %: the demand rises by 50 % a second at most"),
        );
        c.must(c.ran_from(i, lost), format!("{name}, above run at 40 %: the engine runs all the time"));
        c.must(
            all(&c.transmitted(i, back + 4500 * MILLIS, end), WireCommand::Run(600)),
            format!("{name}, above run at 40 %: 60 % is on the wire again 4.5 s after RC was back"),
        );
    }
    c.each(|source| source.beside(None));
    c.shut_down().await
}

pub async fn stop_release_arm_start(c: &ScenarioContext<'_>) -> Result<(), String> {
    c.fly(60).await?;
    c.event();
    c.mark("emergency stop; the bench keeps commanding run and arm");
    let stop = c.now();
    for i in 0..c.count() {
        c.command(i, Command::EmergencyStop, Origin::Emergency);
    }
    c.sleep(1.0).await;
    let armed_in_stop: Vec<_> = (0..c.count()).map(|i| c.command(i, Command::Arm, Origin::Bench)).collect();
    c.each(|source| source.throttle(0));
    c.until(30.0, "both engines are at rest", || (0..c.count()).all(|i| c.turbine(i).rpm() < 2000.0)).await?;
    c.sleep(3.0).await;
    c.mark("released");
    let release = c.now();
    let released: Vec<_> =
        (0..c.count()).map(|i| c.command(i, Command::ReleaseStop, Origin::Emergency)).collect();
    c.sleep(1.0).await;
    for i in 0..c.count() {
        c.cool(i).await?;
    }
    c.sleep(2.0).await;
    c.mark("arm, standby, run: refused");
    let armed_again: Vec<_> = (0..c.count()).map(|i| c.command(i, Command::Arm, Origin::Bench)).collect();
    c.sleep(1.0).await;
    let refused_from = c.now();
    c.each(|source| source.throttle(0));
    c.sleep(5.0).await;
    let refused: Vec<_> = (0..c.count()).map(|i| c.source(i).answers_since(refused_from)).collect();
    c.mark("disarm, arm: the run that is still streamed starts nothing");
    for i in 0..c.count() {
        c.command(i, Command::Disarm, Origin::Bench);
    }
    let armed: Vec<_> = (0..c.count()).map(|i| c.command(i, Command::Arm, Origin::Bench)).collect();
    c.sleep(5.0).await;
    let before = c.now();
    c.look();
    for i in 0..c.count() {
        let name = c.name(i);
        c.must(
            all(&c.transmitted(i, stop + ON_WIRE, release), WireCommand::Stop),
            format!("{name}: emergency stop is on the wire until it is released"),
        );
        c.must(
            armed_in_stop.get(i) == Some(&Some(Err(Rejected::StopLatched))),
            format!("{name}: it cannot be armed while the stop is latched"),
        );
        c.must(released.get(i) == Some(&Some(Ok(Accepted::InForce))), format!("{name}: released"));
        c.must(
            armed_again.get(i) == Some(&Some(Err(Rejected::DisarmFirst))),
            format!("{name}: a source that keeps commanding arm must disarm first"),
        );
        c.must(
            refused.get(i).and_then(|answers| answers.first()) == Some(&Some(Err(Rejected::DisarmFirst))),
            format!("{name}: run is refused, because the stop has disarmed"),
        );
        c.must(
            armed.get(i) == Some(&Some(Ok(Accepted::InForce))),
            format!("{name}: armed after disarm and arm"),
        );
        c.must(
            all(&c.transmitted(i, release + ON_WIRE, before), WireCommand::Standby)
                && c.phases(i, stop + ON_WIRE, before).iter().all(|phase| !phase.is_live()),
            format!("{name}: standby is on the wire from the release on, and the engine is not lit"),
        );
    }
    c.mark("standby and run: the start");
    for i in 0..c.count() {
        c.start(i).await?;
    }
    for i in 0..c.count() {
        let name = c.name(i);
        c.must(c.starts(i, before, c.now()) == 1 && c.runs(i), format!("{name}: it is lit once, and runs"));
    }
    c.shut_down().await
}

pub async fn single_command_start(c: &ScenarioContext<'_>) -> Result<(), String> {
    c.ready(1).await?;
    c.ready(0).await?;
    c.each(CommandSource::silence);
    c.sleep(2.0).await;
    c.event();
    c.mark("right: a ground station commands standby, and run, once each, and is lost");
    let lonely = single_command(c, 1).await;
    c.sleep(30.0).await;
    let end = c.now();
    c.look();
    let frames = c.transmitted(1, lonely, end);
    let standby = frames.iter().find(|frame| frame.command == WireCommand::Standby).map(|frame| frame.from);
    // Source timeout 1 s, hold 1 s, and 10 s without a running engine.
    c.must(
        standby.is_some_and(|at| (11 * SECOND..=12 * SECOND + ON_WIRE).contains(&(at - lonely))),
        format!(
            "right: alone, the start ends 12 s after its only word ({})",
            c.or_never(standby.map(|at| at - lonely))
        ),
    );
    c.must(
        only(&frames, 100, |wire| matches!(wire, WireCommand::Run(0)) || is_standby(wire))
            && standby.is_some_and(|at| all(&c.transmitted(1, at, end), WireCommand::Standby)),
        "right: run at idle until then, and standby from then on",
    );
    c.must(
        c.starts(1, lonely, end) <= 1
            && standby.is_some_and(|at| c.phases(1, at + SECOND, end).iter().all(|phase| !phase.is_live())),
        "right: it is lit once at most, and stops with the standby",
    );

    c.mark("left: the same, beside a source that streams a throttle of 30 %");
    c.source(0).beside(Some((Origin::Bench, PilotInput::Run(percent(30)))));
    let streamed = c.now();
    c.sleep(3.0).await;
    let word = single_command(c, 0).await;
    c.running(0).await?;
    let runs = c.now();
    c.sleep(8.0).await;
    let end = c.now();
    c.look();
    c.must(c.starts(0, streamed, word) == 0, "left: a streamed throttle starts nothing");
    c.must(c.starts(0, word, end) == 1, "left: the ground station's standby and run light it once");
    c.must(
        only(&c.transmitted(0, word + ON_WIRE, runs - SECOND), 40, |wire| wire == WireCommand::Run(0)),
        "left: idle is on the wire until the engine runs",
    );
    let frames = c.transmitted(0, runs - SECOND, end);
    c.must(
        rises_slowly(&frames) && only(&frames, 40, |wire| matches!(wire, WireCommand::Run(0..=300))),
        "left: then the demand rises by 50 % a second at most, and not above 30 %",
    );
    c.must(
        all(&c.transmitted(0, runs + 3 * SECOND, end), WireCommand::Run(300)) && c.runs(0),
        "left: the source beside it is in control then: 30 %",
    );
    c.each(|source| source.beside(None));
    c.shut_down().await
}

/// A ground station commands standby, and 0.9 s later run at idle; when that was.
async fn single_command(c: &ScenarioContext<'_>, engine: usize) -> u64 {
    c.command(engine, Command::Standby, Origin::Mavlink);
    c.sleep(0.9).await;
    let word = c.now();
    let answer = c.command(engine, Command::Run(percent(0)), Origin::Mavlink);
    c.must(answer == Some(Ok(Accepted::InForce)), format!("{}: the start is allowed", c.name(engine)));
    word
}

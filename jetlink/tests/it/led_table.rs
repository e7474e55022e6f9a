//! The status LED: README and code have one table; which state of an engine shows what.

use embassy_time::{Duration, Instant};
use jetlink::channel::Channel;
use jetlink::command::{Demand, Order};
use jetlink::config::EngineConfig;
use jetlink::ecu::zk::codec::Rate;
use jetlink::event::LossStage;
use jetlink::indication::{Indication, Pattern};
use jetlink::line::Line;
use jetlink::report::{LinkState, Timed};
use jetlink::telemetry::Telemetry;
use jetlink::units::{Rpm, Throttle};

#[test]
fn the_readme_has_the_table() {
    let mut table = String::from("| flashes each second | buzzer | meaning |\n|---|---|---|\n");
    for shows in Indication::ALL {
        let pattern = shows.pattern();
        let number = ["none", "one", "two", "three", "four", "five"][usize::from(pattern.flashes)];
        let length = if pattern.is_long() { "long" } else { "short" };
        let buzzer = if shows.beeps() { "the same" } else { "silent" };
        table += &format!("| {number} {length} | {buzzer} | {} |\n", shows.meaning());
    }
    let readme = concat!(env!("CARGO_MANIFEST_DIR"), "/../README.md");
    let begin = "<!-- led: made, JETLINK_WRITE=1 cargo test -p jetlink --test it led_table:: -->\n";
    pages::compare(readme, begin, "<!-- led end -->\n", &table);
}

/// It calls people, so it is quiet while there is nothing to do.
#[test]
fn a_buzzer_beeps_when_an_engine_is_armed_and_when_somebody_has_to_look() {
    let silent: Vec<_> = Indication::ALL.into_iter().filter(|shows| !shows.beeps()).collect();
    assert_eq!(silent, [Indication::AtRest, Indication::Running]);
}

#[test]
fn patterns_differ_and_each_ends_within_its_second() {
    for (i, shows) in Indication::ALL.into_iter().enumerate() {
        let pattern = shows.pattern();
        let takes = (pattern.lit + Pattern::DARK) * u32::from(pattern.flashes);
        assert!(takes <= Duration::from_millis(900), "{shows:?}");
        for other in &Indication::ALL[..i] {
            assert!(*other < shows && other.pattern() != pattern, "{shows:?} and {other:?}");
        }
    }
}

/// An engine at rest with its link up.
fn at_rest() -> Telemetry {
    const CONFIG: EngineConfig = EngineConfig::zk("left", 0, Line::new(9600), Rate::Hz20);
    let mut telemetry = Channel::new(&CONFIG, None).handle().telemetry();
    telemetry.at = Instant::from_secs(10);
    (telemetry.link, telemetry.ordered.order) = (LinkState::Up, Order::Standby);
    telemetry
}

#[test]
fn each_state_of_an_engine_shows_its_pattern() {
    let shows = |change: fn(&mut Telemetry)| {
        let mut telemetry = at_rest();
        change(&mut telemetry);
        telemetry.indication()
    };
    assert_eq!(shows(|_| ()), Indication::AtRest);
    assert_eq!(shows(|engine| engine.armed = true), Indication::Armed);
    let running: [fn(&mut Telemetry); 2] = [
        |engine| engine.ordered.order = Order::Run(Demand::Throttle(Throttle::IDLE)),
        |engine| engine.report.rpm = Some(Timed::new(Rpm::new(1000), engine.at)),
    ];
    for change in running {
        assert_eq!(shows(change), Indication::Running);
    }
    assert_eq!(shows(|engine| engine.loss = LossStage::Hold), Indication::SourceLost);
    assert_eq!(shows(|engine| engine.stop_latched = true), Indication::StopLatched);
    let faults: [fn(&mut Telemetry); 5] = [
        |engine| engine.link = LinkState::Lost,
        |engine| engine.in_doubt = Some(engine.at),
        |engine| engine.limited = true,
        |engine| engine.obeyed = false,
        |engine| engine.transmitter_failed = true,
    ];
    for change in faults {
        assert_eq!(shows(change), Indication::Fault);
    }
    // The more urgent one counts.
    let all = |engine: &mut Telemetry| {
        (engine.armed, engine.stop_latched, engine.loss) = (true, true, LossStage::Hold);
    };
    assert_eq!(shows(all), Indication::StopLatched);
    let needs_attention = |change: fn(&mut Telemetry)| {
        let mut telemetry = at_rest();
        change(&mut telemetry);
        telemetry.needs_attention()
    };
    assert!(needs_attention(all) && needs_attention(|engine| engine.loss = LossStage::Hold));
    assert!(!needs_attention(|engine| engine.armed = true));
}

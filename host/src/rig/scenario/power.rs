//! Power and resets: of the node, and of an ECU.

use super::super::audit::{TransmittedFrame, WireCommand};
use super::super::node::{Cause, Reset};
use super::check::{GRAIN, ON_WIRE, all, is_run, is_standby, only, rises_slowly};
use super::context::{CommandSource, ScenarioContext};
use bench::rows::simulated_as;
use embassy_time::Duration;
use jetlink::command::{Accepted, Rejected};
use jetlink::event::Event;
use sim::ecu::{MILLIS, Nanos, SECOND};
use sim::vendor::VendorConfig as _;
use sim::zk::{ZkConfig, ZkEcu};

/// Three expected frames of a ZK ECU at 20 Hz, and a send slot of the node.
const GAP: Nanos = 250 * MILLIS;
/// From the power of an ECU until two of its reports are there: it boots for up to 0.5 s, and a ZK ECU reports its state
/// every 0.45 s.
const IDENTIFIED: Nanos = 2500 * MILLIS;

/// The engine of [`ecu_power_dip`] that is commanded an rpm.
const BY_RPM: usize = 3;

pub async fn ecu_power_dip(c: &ScenarioContext<'_>) -> Result<(), String> {
    for i in 0..c.count() {
        // They light at once, however hot: the worst of all readings.
        c.ecu(i, |ecu| ecu.turbine_mut().set_starts_hot(true));
    }
    for (dip, what) in [(0.2, "0.2 s"), (3.0, "3 s"), (180.0, "180 s")] {
        c.fly(60).await?;
        c.source(BY_RPM).rpm(120_000);
        c.sleep(6.0).await;
        c.event();
        c.mark(&format!("the ECUs lose their power for {what}; run is still commanded"));
        let off = c.now();
        c.look();
        // ID 6 with run, and ID 7 with the demand, in turn.
        let before = c.transmitted(BY_RPM, off - SECOND, off);
        let name = c.name(BY_RPM);
        c.must(
            before.iter().any(|frame| frame.switches_to_run)
                && all(&before, WireCommand::RunRpm(120_000))
                && c.runs(BY_RPM),
            format!("{name}, {what}: before it, run by ID 6 and 120 000 rpm by ID 7 are on the wire"),
        );
        (0..c.count()).for_each(|i| c.power(i, false));
        c.sleep(dip).await;
        let on = c.now();
        (0..c.count()).for_each(|i| c.power(i, true));
        c.sleep(12.0).await;
        let end = c.now();
        c.look();
        for i in 0..c.count() {
            let name = c.name(i);
            let answered = c.is_answered(i);
            let doubts = if answered { ON_WIRE } else { GAP };
            let meanwhile = c.transmitted(i, off + doubts, on);
            // An ECU that restarts has forgotten ID 6, and ignores ID 7.
            let ignored = |wire| i == BY_RPM && wire == WireCommand::RunRpm(120_000);
            let harmless = |frame: &TransmittedFrame| {
                (is_standby(frame.command) || ignored(frame.command)) && !frame.switches_to_run
            };
            c.must(
                if answered { meanwhile.is_empty() } else { meanwhile.iter().all(harmless) },
                format!("{name}, {what}: nothing that could start an engine is on the wire in the dip"),
            );
            if i == BY_RPM && dip > 1.0 {
                c.must(
                    meanwhile.windows(2).all(|pair| ignored(pair[0].command) != ignored(pair[1].command)),
                    format!("{name}, {what}: ID 0 and ID 7, which a restarted ECU ignores, are sent in turn"),
                );
            }
            let after = c.transmitted(i, on, end);
            c.must(
                after.iter().all(|frame| harmless(frame) || frame.command == WireCommand::Standby),
                format!("{name}, {what}: no run is on the wire when the ECU is back"),
            );
            let standby =
                after.iter().find(|frame| frame.command == WireCommand::Standby).map(|frame| frame.from - on);
            c.must(
                standby.is_some_and(|after| after <= IDENTIFIED)
                    && all(&c.transmitted(i, on + IDENTIFIED, end), WireCommand::Standby),
                format!(
                    "{name}, {what}: standby is on the wire once its ECU is received ({}), and stays",
                    c.or_never(standby)
                ),
            );
            c.must(
                c.phases(i, off + 20 * MILLIS, end).iter().all(|phase| !phase.is_live()),
                format!("{name}, {what}: the engine stops with its ECU, and is not lit again"),
            );
            c.must(
                c.events_since(i, off, |event| matches!(event, Event::RunCancelled(_))) >= 1,
                format!("{name}, {what}: the end of the run is reported"),
            );
            c.must(
                c.source(i).answer() == Some(Err(Rejected::StandbyFirst)),
                format!("{name}, {what}: the source gets the reason ({})", c.answer_text(i)),
            );
        }
        for i in 0..c.count() {
            c.cool(i).await?;
        }
    }
    c.shut_down().await
}

pub async fn watchdog_loop(c: &ScenarioContext<'_>) -> Result<(), String> {
    c.fly(60).await?;
    c.event();
    c.mark("the watchdog resets the node, then five more times, 1.05 s apart");
    let first = c.now();
    reset(c, 1.05).await;
    for _ in 0..5 {
        reset(c, 0.05).await;
    }
    let last = c.now();
    c.sleep(6.0).await;
    let end = c.now();
    c.look();
    for i in 0..c.count() {
        let name = c.name(i);
        let near = |wire| match wire {
            WireCommand::Run(tenths) => tenths.abs_diff(600) <= GRAIN,
            wire => wire == WireCommand::Nothing,
        };
        c.must(
            only(&c.transmitted(i, first + 1, end), 40, near),
            format!("{name}: every command is run at 60 %, no dip, no standby"),
        );
        c.must(
            c.ran_from(i, first) && c.speed_stayed(i, first, 0.02),
            format!("{name}: the engine runs on through six resets, its speed within 2 %"),
        );
        c.must(
            all(&c.transmitted(i, last + 2 * SECOND, end), WireCommand::Run(600)),
            format!("{name}: 60 % is on the wire 2 s after the last reset"),
        );
        c.must(
            c.source(i).answer() == Some(Ok(Accepted::InForce)),
            format!("{name}: the source is in control again ({})", c.answer_text(i)),
        );
    }

    c.mark("the source falls silent, and the resets continue");
    c.each(CommandSource::silence);
    let silent = c.now();
    for _ in 0..20 {
        reset(c, 0.05).await;
    }
    let end = c.now();
    c.look();
    for i in 0..c.count() {
        let name = c.name(i);
        // Its timeout, hold, 1.2 s from 60 % to idle; twice that to allow for the resets.
        let late = c.transmitted(i, silent + 6 * SECOND, end);
        let above =
            late.iter().find(|frame| matches!(frame.command, WireCommand::Run(1..) | WireCommand::RunRpm(_)));
        c.must(
            !late.is_empty() && above.is_none(),
            format!("{name}: no demand above idle is on the wire 6 s after the source's last word"),
        );
        let frames = c.transmitted(i, silent, end);
        let rises = frames.windows(2).any(|pair| match (pair[0].command, pair[1].command) {
            (WireCommand::Run(before), WireCommand::Run(after)) => after > before + GRAIN,
            _ => false,
        });
        c.must(!rises, format!("{name}: no reset brings the demand back"));
    }
    c.shut_down().await
}

/// The watchdog resets the node, which is away for this time; then 1 s passes.
async fn reset(c: &ScenarioContext<'_>, away: f64) {
    let away = Duration::from_micros((away * 1e6) as u64);
    c.node().reset(Reset { away, cause: Cause::Watchdog });
    c.sleep(away.as_micros() as f64 / 1e6 + 1.0).await;
    c.arm();
}

pub async fn brown_out(c: &ScenarioContext<'_>) -> Result<(), String> {
    c.fly(60).await?;
    c.ecu(1, |ecu| ecu.report_low_supply(true));
    c.sleep(5.0).await;
    c.event();
    c.mark("the node's supply dips for 0.3 s, its memory survives");
    let at = c.now();
    c.node().reset(Reset { away: Duration::from_millis(300), cause: Cause::BrownOut });
    c.sleep(0.02).await;
    c.until(5.0, "the node is back", || c.node().is_up()).await?;
    let back = c.now();
    c.must(
        (0..c.count()).all(|i| !c.node().telemetry(i).armed),
        "the node does not take it as armed: the power was away",
    );
    c.sleep(8.0).await;
    let end = c.now();
    c.look();
    for i in 0..c.count() {
        let name = c.name(i);
        let frames = c.transmitted(i, at + 1, end);
        c.must(
            only(&frames, 20, |wire| is_run(wire) || wire == WireCommand::Nothing),
            format!("{name}: no standby, and no stop"),
        );
        let first = frames.iter().find(|frame| is_run(frame.command)).map(|frame| frame.from - back);
        c.must(
            first.is_some_and(|after| after <= SECOND),
            format!("{name}: run is on the wire {} after the node was back", c.or_never(first)),
        );
        c.must(
            all(&c.transmitted(i, back + 5 * SECOND, end), WireCommand::Run(600)),
            format!("{name}: 60 % is on the wire 5 s after it was back"),
        );
        c.must(rises_slowly(&frames), format!("{name}: the demand rises by 50 % a second at most"));
        c.must(c.ran_from(i, at), format!("{name}: the engine runs all the time"));
        c.must(
            c.events_since(i, at, |event| matches!(event, Event::Resumed(_))) == 1,
            format!("{name}: reported that it resumed"),
        );
        c.must(
            c.source(i).answer() == Some(Ok(Accepted::InForce)),
            format!("{name}: the source is in control again ({})", c.answer_text(i)),
        );
    }
    c.arm();
    c.ecu(1, |ecu| ecu.report_low_supply(false));
    c.shut_down().await
}

pub async fn ecu_swapped(c: &ScenarioContext<'_>) -> Result<(), String> {
    c.fly(60).await?;
    c.source(1).rpm(120_000);
    c.sleep(6.0).await;
    c.look();
    let by_rpm =
        c.transmitted(1, 0, c.now()).iter().any(|frame| matches!(frame.command, WireCommand::RunRpm(_)));
    c.must(by_rpm && c.runs(1), "right: runs by rpm");
    c.event();
    c.mark("both lines are cut, and other ECUs are plugged in: version 3, cold, and hungry for a start");
    let cut = c.now();
    for i in 0..c.count() {
        c.cut(i, true);
        let mut config = simulated_as::<ZkConfig>(c.engine(i)).with_version(3);
        config.temper.starts_hot = true;
        c.plug_in(i, ZkEcu::new(config));
    }
    c.sleep(10.0).await;
    c.mark("the lines are joined; run is still commanded");
    let joined = c.now();
    for i in 0..c.count() {
        c.cut(i, false);
    }
    c.sleep(4.0).await;
    let unknown_to = |i| c.ecu(i, |ecu| ecu.unknown_to_version());
    let unknown: Vec<u64> = (0..c.count()).map(unknown_to).collect();
    c.sleep(6.0).await;
    let end = c.now();
    c.look();
    for i in 0..c.count() {
        let name = c.name(i);
        c.must(
            unknown.get(i) == Some(&unknown_to(i)),
            format!("{name}: once its version is known, every frame is one that the new ECU knows"),
        );
        c.must(
            !c.transmitted(i, cut + GAP, end)
                .iter()
                .any(|frame| matches!(frame.command, WireCommand::Run(_) | WireCommand::Stop)),
            format!("{name}: no run is on the wire from the cut on"),
        );
        c.must(
            !c.transmitted(i, joined + IDENTIFIED, end)
                .iter()
                .any(|frame| matches!(frame.command, WireCommand::RunRpm(_))),
            format!("{name}: and no speed for an ECU that has none to take"),
        );
        let frames = c.transmitted(i, joined, end);
        let standby = frames
            .iter()
            .find(|frame| frame.command == WireCommand::Standby)
            .map(|frame| frame.from - joined);
        c.must(
            standby.is_some_and(|after| after <= IDENTIFIED),
            format!("{name}: standby is on the wire once the new ECU is received ({})", c.or_never(standby)),
        );
        c.must(
            all(&c.transmitted(i, joined + IDENTIFIED, end), WireCommand::Standby),
            format!("{name}: and stays, although run is still commanded"),
        );
        c.must(
            c.phases(i, cut + 20 * MILLIS, end).iter().all(|phase| !phase.is_live()),
            format!("{name}: the engine behind the new ECU is never lit"),
        );
        let version = |event| matches!(event, Event::VersionKnown(version) if version.get() == 3);
        c.must(
            c.events_since(i, joined, version) == 1,
            format!("{name}: reported: the version of the new ECU"),
        );
        c.must(
            matches!(c.source(i).answer(), Some(Err(_))),
            format!("{name}: the source gets the reason ({})", c.answer_text(i)),
        );
    }
    c.shut_down().await
}

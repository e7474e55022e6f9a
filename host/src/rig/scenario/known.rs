//! The six scenarios with pictures in `docs/failsafe.md`.

use super::super::audit::WireCommand;
use super::super::context::Stage;
use super::super::node::{Cause, Reset};
use super::check::{GRAIN, ON_WIRE, SEES_STOP, WORDS, all, rises_slowly, seconds};
use super::context::{CommandSource, ScenarioContext};
use embassy_time::Duration;
use jetlink::command::{Accepted, Command, Interlock, Origin, Rejected};
use jetlink::event::{End, Event, LossStage};
use jetlink::limit::LimitKind;
use sim::ecu::{MILLIS, Nanos, SECOND};

/// Time until the exhaust shows that an engine no longer burns: two agreeing sets below 300 °C, or 3 s of a fast
/// fall, none of it in the first 5 s after the demand was lowered.
const SEES_COLD: Nanos = 6 * SECOND;
/// A demand rises from idle to 60 % at 50 % a second.
const RISE_TO_60: Nanos = 1200 * MILLIS;

pub async fn source_loss(c: &ScenarioContext<'_>) -> Result<(), String> {
    c.fly(60).await?;
    c.event();
    c.mark("the source falls silent");
    c.each(CommandSource::silence);
    let silent = c.now();
    c.sleep(8.0).await;
    c.mark("it commands again");
    c.each(|source| source.throttle(60));
    let back = c.now();
    c.sleep(6.0).await;
    let end = c.now();
    c.look();
    for i in 0..c.count() {
        let name = c.name(i);
        // Its timeout is 0.5 s, its last command up to 0.1 s old.
        let held = c.transmitted(i, silent + ON_WIRE, silent + 1400 * MILLIS);
        c.must(
            all(&held, WireCommand::Run(600)),
            format!("{name}: 60 % stays on the wire for 0.5 s (timeout) and 1 s (hold)"),
        );
        let mut frames = c.transmitted(i, silent + 1400 * MILLIS, back);
        frames.retain(|frame| frame.command != WireCommand::Nothing);
        let falls = frames.windows(2).all(|pair| match (pair[0].command, pair[1].command) {
            (WireCommand::Run(before), WireCommand::Run(after)) => {
                let most = (pair[1].from - pair[0].from) * 500 / SECOND + u64::from(GRAIN) + 20;
                after <= before && u64::from(before - after) <= most
            }
            _ => false,
        });
        c.must(falls, format!("{name}: then it falls at 50 % a second, and never rises"));
        let idle =
            frames.iter().find(|frame| frame.command == WireCommand::Run(0)).map(|frame| frame.from - silent);
        let in_time = idle.is_some_and(|after| (2500 * MILLIS..=2700 * MILLIS + ON_WIRE).contains(&after));
        c.must(
            in_time,
            format!("{name}: idle is on the wire 2.7 s after the silence began ({})", c.or_never(idle)),
        );
        c.must(
            all(&c.transmitted(i, silent + 2700 * MILLIS + ON_WIRE, back), WireCommand::Run(0)),
            format!("{name}: idle stays, and never standby or stop"),
        );
        let again = c.transmitted(i, back, end);
        let again =
            again.iter().find(|frame| frame.command == WireCommand::Run(600)).map(|frame| frame.from - back);
        // Its first command comes up to 0.1 s late, and so does the one that ends the 1 s without a gap.
        c.must(
            again.is_some_and(|after| {
                (SECOND + RISE_TO_60..=3 * SECOND + RISE_TO_60 + 2 * WORDS + ON_WIRE).contains(&after)
            }),
            format!(
                "{name}: 60 % is on the wire again after 1 s without a gap, at most 2 s of taking over, and 1.2 s of rising \
                 ({})",
                c.or_never(again)
            ),
        );
        c.must(
            rises_slowly(&c.transmitted(i, silent, end)),
            format!("{name}: and rises by 50 % a second at most"),
        );
        c.must(c.ran_from(i, silent), format!("{name}: the engine runs all the time"));
        for (stage, what) in [
            (LossStage::Hold, "hold"),
            (LossStage::FailSafe, "fail-safe"),
            (LossStage::None, "the source is back"),
        ] {
            c.must(
                c.reported(i, |event| event == Event::SourceLoss(stage)),
                format!("{name}: reported, {what}"),
            );
        }
    }
    c.shut_down().await
}

pub async fn hot_start(c: &ScenarioContext<'_>) -> Result<(), String> {
    c.ecu(0, |ecu| ecu.turbine_mut().hot_start(true));
    c.ready(0).await?;
    c.sleep(1.0).await;
    c.stage(0, Stage::Start);
    let commanded_at = c.now();
    c.source(0).throttle(0);
    c.until(40.0, "the ECU stops the hot start", || c.turbine(0).trip().is_some()).await?;
    c.event();
    c.mark("the ECU stops the hot start; run is still commanded");
    let tripped = c.now();
    let reported = c.reported(
        0,
        |event| matches!(event, Event::Limit(violation) if violation.kind == LimitKind::HotStart),
    );
    c.must(reported, "left: the hot start was reported before the ECU stopped it");
    c.sleep(10.0).await;
    c.ecu(0, |ecu| ecu.turbine_mut().hot_start(false));
    c.mark("standby, and run again at once");
    c.source(0).standby();
    c.sleep(1.0).await;
    let standby = c.now();
    c.source(0).throttle(0);
    c.until(120.0, "the engine is ready for a start", || c.turbine(0).is_ready_to_start()).await?;
    c.sleep(8.0).await;
    c.mark("cool for 8 s; standby, and run once more");
    let refused = c.source(0).answers_since(standby);
    c.source(0).standby();
    c.sleep(1.0).await;
    c.stage(0, Stage::Start);
    let allowed = c.now();
    let egt = c.turbine(0).egt();
    c.source(0).throttle(0);
    c.running(0).await?;
    c.stage(0, Stage::Idle);
    c.sleep(5.0).await;
    c.look();
    c.must(
        matches!(
            refused.first(),
            Some(Some(Err(Rejected::Start(Interlock::TooHot(_) | Interlock::NotStandby))))
        ),
        "left: the hot engine may not start",
    );
    c.must(
        refused.get(1..) == Some(&[Some(Err(Rejected::StandbyFirst))]),
        "left: the refusal has used the permission up: from then on run is refused until standby was commanded",
    );
    let first = c.transmitted(0, commanded_at, tripped);
    c.must(
        first.iter().any(|frame| frame.command == WireCommand::Run(0))
            && first.iter().all(|frame| {
                matches!(frame.command, WireCommand::Run(0) | WireCommand::Standby | WireCommand::Nothing)
            }),
        "left: no throttle above the minimum was on the wire during the start",
    );
    let cancelled = c.transmitted(0, tripped, allowed);
    let cancelled = cancelled
        .iter()
        .find(|frame| frame.command == WireCommand::Standby)
        .map(|frame| frame.from - tripped);
    c.must(
        cancelled.is_some_and(|after| after <= SEES_STOP),
        format!("left: standby is on the wire within 1.5 s of the ECU's stop ({})", c.or_never(cancelled)),
    );
    c.must(
        all(&c.transmitted(0, tripped + SEES_STOP, allowed), WireCommand::Standby),
        "left: nothing but standby is on the wire until standby and run are commanded to the cool engine",
    );
    c.must(
        c.phases(0, tripped, allowed).iter().all(|phase| !phase.is_live()),
        "left: it does not start uncommanded, however long run is commanded, and not when it is cool either",
    );
    c.must(egt <= 105.0, format!("left: it starts with the exhaust below 100 °C ({egt:.0} °C)"));
    c.must(c.runs(0), "left: the second start reaches idle");
    c.shut_down().await
}

pub async fn flame_out(c: &ScenarioContext<'_>) -> Result<(), String> {
    c.fly(60).await?;
    c.event();
    c.mark("flame-out of left; run is still commanded");
    c.ecu(0, |ecu| ecu.turbine_mut().flame_out());
    let out = c.now();
    c.until(20.0, "the ECU sees that its engine has stopped", || c.turbine(0).trip().is_some()).await?;
    let stopped = c.now();
    c.sleep(12.0).await;
    let end = c.now();
    c.look();
    let reported = c.when_reported(
        0,
        |event| matches!(event, Event::Limit(violation) if violation.kind == LimitKind::FlameOut),
    );
    c.must(
        reported.is_some_and(|at| at - out <= 3 * SECOND),
        format!("left: the flame-out is reported within 3 s ({})", c.or_never(reported.map(|at| at - out))),
    );
    let frames = c.transmitted(0, out, end);
    let standby = frames.iter().find(|frame| frame.command == WireCommand::Standby).map(|frame| frame.from);
    c.must(
        standby.is_some_and(|at| at >= stopped.saturating_sub(ON_WIRE) && at <= stopped + SEES_STOP),
        format!(
            "left: standby is on the wire within 1.5 s of the ECU's own stop ({})",
            c.or_never(standby.map(|at| at.saturating_sub(stopped)))
        ),
    );
    c.must(
        standby.is_some_and(|at| all(&c.transmitted(0, at, end), WireCommand::Standby)),
        "left: and stays, although run is still commanded",
    );
    c.must(c.phases(0, stopped, end).iter().all(|phase| !phase.is_live()), "left: no relight and no restart");
    c.must(
        c.source(0).answer() == Some(Err(Rejected::StandbyFirst)),
        format!("left: the source gets the reason ({})", c.answer_text(0)),
    );
    c.must(all(&c.transmitted(1, out, end), WireCommand::Run(600)), "right: 60 % stays on the wire");
    c.must(c.ran_from(1, out), "right: the engine runs all the time");
    c.must(
        c.reported(1, |event| event == Event::OtherFailed(1)),
        "right: reported that the other engine has failed",
    );

    // With a fault an AMT ECU reports no state any more (AMT-8), but its exhaust temperature in every set.
    c.mark("flame-out of right; run is still commanded");
    c.ecu(1, |ecu| ecu.turbine_mut().flame_out());
    let out = c.now();
    c.until(20.0, "the ECU sees that its engine has stopped", || c.turbine(1).trip().is_some()).await?;
    let stopped = c.now();
    c.sleep(8.0).await;
    let end = c.now();
    c.look();
    let reported = c.when_reported(
        1,
        |event| matches!(event, Event::Limit(violation) if violation.kind == LimitKind::FlameOut),
    );
    c.must(
        reported.is_some_and(|at| at - out <= 3 * SECOND),
        format!("right: the flame-out is reported within 3 s ({})", c.or_never(reported.map(|at| at - out))),
    );
    let fault = c.when_reported(1, |event| matches!(event, Event::Faults(faults) if !faults.is_empty()));
    c.must(
        fault.is_some_and(|at| at <= stopped + SECOND),
        format!(
            "right: the ECU's fault is reported within 1 s of its stop ({})",
            c.or_never(fault.map(|at| at.saturating_sub(stopped)))
        ),
    );
    let frames = c.transmitted(1, out, end);
    let standby = frames.iter().find(|frame| frame.command == WireCommand::Standby).map(|frame| frame.from);
    c.must(
        standby.is_some_and(|at| at >= out && at <= out + SEES_COLD),
        format!(
            "right: standby is on the wire within 6 s of the flame-out, by its exhaust ({})",
            c.or_never(standby.map(|at| at.saturating_sub(out)))
        ),
    );
    c.must(
        standby.is_some_and(|at| all(&c.transmitted(1, at, end), WireCommand::Standby)),
        "right: and stays, although run is still commanded",
    );
    c.must(
        c.reported(1, |event| matches!(event, Event::RunCancelled(End::NotBurning | End::AtRest))),
        "right: the reason is reported",
    );
    c.must(
        c.source(1).answer() == Some(Err(Rejected::StandbyFirst)),
        format!("right: the source gets the reason ({})", c.answer_text(1)),
    );
    c.must(
        c.phases(1, stopped, end).iter().all(|phase| !phase.is_live()),
        "right: no relight and no restart",
    );
    let other = c.when_reported(0, |event| event == Event::OtherFailed(1));
    c.must(
        other.zip(standby).is_some_and(|(at, standby)| at <= standby + SECOND),
        format!(
            "left: reported that the other engine has failed ({})",
            c.or_never(other.map(|at| at.saturating_sub(out)))
        ),
    );
    c.shut_down().await
}

pub async fn reset_in_flight(c: &ScenarioContext<'_>) -> Result<(), String> {
    c.fly(60).await?;
    c.source(1).throttle(75);
    c.sleep(6.0).await;
    let throttles = [600, 750];
    // The watchdog bites 1 s after a task has hung; then the chip starts.
    let watchdog = Reset { away: Duration::from_millis(1050), cause: Cause::Watchdog };
    let supply = Reset { away: Duration::from_millis(300), cause: Cause::PowerLost };
    for (reset, label) in
        [(watchdog, "the node hangs, its watchdog resets it"), (supply, "the node's supply fails for 0.3 s")]
    {
        c.event();
        c.mark(label);
        let what = if reset.cause == Cause::PowerLost { "supply" } else { "watchdog" };
        let at = c.now();
        c.node().reset(reset);
        c.sleep(0.02).await;
        c.until(5.0, "the node is back", || c.node().is_up()).await?;
        let back = c.now();
        if reset.cause == Cause::PowerLost {
            c.must(
                (0..c.count()).all(|i| !c.node().telemetry(i).armed),
                format!("{what}: the node has forgotten that it was armed"),
            );
        }
        c.sleep(8.0).await;
        c.arm();
        let end = c.now();
        c.look();
        for (i, throttle) in throttles.into_iter().enumerate() {
            let name = c.name(i);
            let last = c.transmitted(i, 0, at).last().map_or(0, |frame| frame.to);
            let after = c.transmitted(i, at + 1, end);
            let first =
                after.iter().find(|frame| frame.command != WireCommand::Nothing).map_or(0, |frame| frame.to);
            let gap = first.saturating_sub(last);
            // The simulated AMT ECU waits 2 s; a ZK ECU from version 5 forever (ZK-10).
            c.must(
                first > 0 && gap < 2 * SECOND,
                format!(
                    "{name}, {what}: {:.3} s from the last command to the next, {:.3} s of it after the node was back",
                    seconds(gap),
                    seconds(first.saturating_sub(back))
                ),
            );
            let near = |tenths: u16| {
                tenths.abs_diff(throttle) <= if reset.cause == Cause::PowerLost { GRAIN } else { 0 }
            };
            let same = after.iter().all(|frame| match frame.command {
                WireCommand::Run(tenths) => {
                    near(tenths) || frame.from < back + 300 * MILLIS && tenths.abs_diff(throttle) <= GRAIN
                }
                wire => wire == WireCommand::Nothing,
            });
            c.must(
                same,
                format!("{name}, {what}: every command is run at {} %, no dip, no standby", throttle / 10),
            );
            c.must(
                c.ran_from(i, at) && c.speed_stayed(i, at, 0.02),
                format!("{name}, {what}: the engine runs on, its speed within 2 %"),
            );
            let resumed = c.events_since(i, at, |event| matches!(event, Event::Resumed(_)));
            c.must(resumed == 1, format!("{name}, {what}: reported that it resumed"));
            c.must(
                matches!(c.source(i).answer(), Some(Ok(Accepted::InForce))),
                format!("{name}, {what}: the source is in control again"),
            );
        }
    }
    c.shut_down().await
}

pub async fn engine_lost(c: &ScenarioContext<'_>) -> Result<(), String> {
    c.fly(60).await?;
    c.event();
    c.mark("the line to left is cut");
    c.cut(0, true);
    let cut = c.now();
    c.until(10.0, "the ECU of left stops its engine", || !c.runs(0)).await?;
    let stopped = c.now();
    c.sleep(8.0).await;
    c.mark("the line is joined; run is still commanded");
    c.cut(0, false);
    let joined = c.now();
    c.sleep(8.0).await;
    let end = c.now();
    c.look();
    let lost = c.when_reported(0, |event| event == Event::LinkLost).map(|at| at.saturating_sub(cut));
    c.must(
        lost.is_some_and(|after| after <= 1300 * MILLIS),
        format!("left: the loss is reported within 1 s of the last frame ({})", c.or_never(lost)),
    );
    c.must(
        stopped - cut <= 2300 * MILLIS,
        format!(
            "left: its ECU stops it uncommanded, after its serial delay time ({:.2} s)",
            seconds(stopped - cut)
        ),
    );
    let given_up =
        c.when_reported(0, |event| event == Event::RunCancelled(End::Unconfirmed)).map(|at| at - cut);
    c.must(
        given_up.is_some_and(|after| (3800 * MILLIS..=4100 * MILLIS).contains(&after)),
        format!(
            "left: the run is given up 4 s after the last set, the serial delay time that the node is set to ({})",
            c.or_never(given_up)
        ),
    );
    let other = c.when_reported(1, |event| event == Event::OtherFailed(1)).map(|at| at.saturating_sub(cut));
    c.must(
        other.is_some_and(|after| after <= 1400 * MILLIS),
        format!("right: reported that the other engine has failed ({})", c.or_never(other)),
    );
    c.must(
        c.events_since(1, cut, |event| matches!(event, Event::OtherFailed(_))) == 1,
        "right: reported once, and not that all is well when the line is joined",
    );
    c.must(
        all(&c.transmitted(1, cut, end), WireCommand::Run(600)),
        "right: 60 % stays on the wire (default: the other engines are left alone)",
    );
    c.must(c.ran_from(1, cut) && c.speed_stayed(1, cut, 0.02), "right: the engine runs on");
    let frames = c.transmitted(0, joined, end);
    let standby = frames.iter().find(|frame| frame.command == WireCommand::Standby).map(|frame| frame.from);
    c.must(
        standby.is_some_and(|at| at - joined <= 500 * MILLIS)
            && all(&frames, WireCommand::Standby)
            && standby.is_some_and(|at| all(&c.transmitted(0, at, end), WireCommand::Standby)),
        format!(
            "left: the first word is standby, once two sets say that the engine is at rest ({}), and it stays",
            c.or_never(standby.map(|at| at - joined))
        ),
    );
    c.must(
        c.phases(0, stopped, end).iter().all(|phase| !phase.is_live()),
        "left: it does not start again uncommanded",
    );
    c.shut_down().await
}

pub async fn emergency_stop(c: &ScenarioContext<'_>) -> Result<(), String> {
    c.start(1).await?;
    c.source(1).throttle(60);
    c.stage(1, Stage::Steps);
    c.ready(0).await?;
    c.stage(0, Stage::Start);
    c.source(0).throttle(0);
    c.until(40.0, "left is half way up", || c.turbine(0).rpm() > 20_000.0).await?;
    c.event();
    c.mark("emergency stop; run is still commanded");
    let stop = c.now();
    let speeds = [c.turbine(0).rpm(), c.turbine(1).rpm()];
    for i in 0..c.count() {
        let answer = c.command(i, Command::EmergencyStop, Origin::Emergency);
        c.must(answer == Some(Ok(Accepted::InForce)), format!("{}: accepted", c.name(i)));
    }
    c.sleep(8.0).await;
    c.mark("released by the bench: refused");
    let refused: Vec<_> = (0..c.count()).map(|i| c.command(i, Command::ReleaseStop, Origin::Bench)).collect();
    let streams: Vec<_> = (0..c.count()).map(|i| c.source(i).answer()).collect();
    c.sleep(4.0).await;
    c.mark("released by who stopped");
    let release = c.now();
    let released: Vec<_> =
        (0..c.count()).map(|i| c.command(i, Command::ReleaseStop, Origin::Emergency)).collect();
    c.sleep(8.0).await;
    let end = c.now();
    c.look();
    for i in 0..c.count() {
        let name = c.name(i);
        let frames = c.transmitted(i, stop, release);
        let first = frames.iter().position(|frame| frame.command == WireCommand::Stop);
        let after = first.and_then(|first| frames.get(first)).map(|frame| frame.to - stop);
        c.must(
            after.is_some_and(|after| after <= ON_WIRE),
            format!("{name}: on the wire in {}, its last bit", c.or_never(after)),
        );
        c.must(
            first.is_some_and(|first| {
                frames.iter().skip(first).all(|frame| frame.command == WireCommand::Stop)
            }),
            format!("{name}: nothing but emergency stop is on the wire until it is released"),
        );
        let phases = c.phases(i, stop + ON_WIRE, end);
        c.must(
            phases.iter().all(|phase| !phase.is_live()),
            format!("{name}: no more fuel, and no start after that"),
        );
        c.must(
            c.turbine(i).rpm() < speeds.get(i).map_or(0.0, |speed| speed / 4.0),
            format!("{name}: the engine has run down"),
        );
        c.must(
            streams.get(i) == Some(&Some(Err(Rejected::StopLatched))),
            format!("{name}: run is refused while the stop is latched"),
        );
        c.must(
            refused.get(i) == Some(&Some(Err(Rejected::NotYours(Origin::Emergency)))),
            format!("{name}: a lower source cannot release it"),
        );
        c.must(
            released.get(i) == Some(&Some(Ok(Accepted::InForce))),
            format!("{name}: the source that commanded the stop releases it"),
        );
        c.must(
            all(&c.transmitted(i, release + ON_WIRE, end), WireCommand::Standby),
            format!("{name}: then standby, although run is still commanded"),
        );
        c.must(
            c.source(i).answer() == Some(Err(Rejected::StandbyFirst)),
            format!("{name}: a start needs standby first ({})", c.answer_text(i)),
        );
    }
    c.shut_down().await
}

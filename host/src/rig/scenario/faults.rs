//! Engines that fail.

use super::super::audit::WireCommand;
use super::super::context::Stage;
use super::check::{ON_WIRE, all, is_run, only, seconds};
use super::context::ScenarioContext;
use bench::rows::simulated_as;
use jetlink::command::{Accepted, Rejected};
use jetlink::event::Event;
use sim::amt::{AmtConfig, AmtEcu, Status};
use sim::any::AnyEcu;
use sim::ecu::{MILLIS, Nanos, SECOND};

/// Engines of [`fault_clears`] whose fault clears while run is still in force: the demand in percent, the state that the ECU reports then, and the
/// longest time until standby. Two reports at rest agree after two sets, or three if one has no state. In start clearance the exhaust
/// has to show for 3 s that the flame is out, counted from the flame-out.
const EARLY: [(usize, u8, Status, Nanos); 2] =
    [(1, 10, Status::NoClearance, 500 * MILLIS), (2, 5, Status::StartClearance, 3 * SECOND)];
/// A set at 2400 baud that began before the fault cleared, until the reply to it begins.
const SET: Nanos = 50 * MILLIS;

pub async fn fault_clears(c: &ScenarioContext<'_>) -> Result<(), String> {
    for (i, clear) in [(0, 40 * SECOND), (1, 650 * MILLIS), (2, 650 * MILLIS)] {
        // An ECU that forgets a fault after this time, and starts on run alone up to 5 %, however hot, after a long start clearance.
        let mut config = simulated_as::<AmtConfig>(c.engine(i));
        config.temper.starts_hot = true;
        config.temper.trips_clear_after = Some(clear);
        config.temper.clearance = 4 * SECOND;
        c.plug_in(i, AmtEcu::new(config));
    }
    c.fly(60).await?;
    for (i, percents, ..) in EARLY {
        c.source(i).throttle(percents);
    }
    // For 5 s a lower demand explains a falling exhaust.
    c.sleep(10.0).await;
    c.event();
    fault_clears_in_flight(c).await;
    for (i, percents, status, most) in EARLY {
        fault_clears_early(c, i, percents, status, most).await?;
    }
    fault_clears_late(c).await?;
    c.shut_down().await
}

/// The control: the engines run, and their ECUs report faults only.
async fn fault_clears_in_flight(c: &ScenarioContext<'_>) {
    c.mark("a fault of each ECU; the engines run on");
    let fault = c.now();
    (0..c.count()).for_each(|i| c.ecu(i, |ecu| ecu.report_low_supply(true)));
    c.sleep(3.0).await;
    c.mark("the faults clear");
    let clear = c.now();
    (0..c.count()).for_each(|i| c.ecu(i, |ecu| ecu.report_low_supply(false)));
    c.sleep(3.0).await;
    let end = c.now();
    c.look();
    for (i, tenths) in [(0, 600), (1, 100), (2, 50)] {
        let name = c.name(i);
        let run = |wire| wire == WireCommand::Run(tenths);
        c.must(
            only(&c.transmitted(i, fault, clear), 20, run),
            format!("{name}: in flight, the reply to each set with a fault is run"),
        );
        c.must(
            only(&c.transmitted(i, clear, end), 20, run),
            format!("{name}: and when the fault clears, the reply to each set is run, from the first on"),
        );
        c.must(c.ran_from(i, fault), format!("{name}: the engine runs all the time"));
    }
}

/// A flame-out whose fault clears before the exhaust has shown that the flame is out.
async fn fault_clears_early(
    c: &ScenarioContext<'_>,
    i: usize,
    percents: u8,
    status: Status,
    most: Nanos,
) -> Result<(), String> {
    let name = c.name(i);
    c.mark(&format!("flame-out of {name}; run is still commanded"));
    c.ecu(i, |ecu| ecu.turbine_mut().flame_out());
    let out = c.now();
    c.until(20.0, "the ECU sees that its engine has stopped", || c.turbine(i).trip().is_some()).await?;
    let stopped = c.now();
    c.until(2.0, "the fault clears", || c.turbine(i).trip().is_none()).await?;
    c.mark("the fault clears, and run is in force");
    let clear = c.now();
    let state = if status == Status::StartClearance { "start clearance" } else { "an engine at rest" };
    let reports = c.ecu(i, |ecu| matches!(ecu, AnyEcu::Amt(ecu) if ecu.status() == status));
    c.sleep(8.0).await;
    let end = c.now();
    c.look();
    let run = |wire| wire == WireCommand::Run(u16::from(percents) * 10);
    c.must(
        only(&c.transmitted(i, out, stopped), 5, run),
        format!("{name}: run is on the wire while its ECU reports a running engine"),
    );
    c.must(
        only(&c.transmitted(i, stopped, clear), 3, run),
        format!("{name}: and with the fault, because the exhaust does not show yet that the flame is out"),
    );
    let standby = c
        .transmitted(i, clear, end)
        .iter()
        .find(|frame| frame.command == WireCommand::Standby)
        .map(|frame| frame.from);
    c.must(
        reports && c.transmitted(i, clear + SET, standby.unwrap_or(end)).is_empty(),
        format!("{name}: the fault clears, and the first normal sets, which report {state}, get no reply"),
    );
    c.must(
        standby.is_some_and(|at| at <= clear + most),
        format!(
            "{name}: standby is on the wire within {:.1} s ({})",
            seconds(most),
            c.or_never(standby.map(|at| at - clear))
        ),
    );
    c.must(
        standby.is_some_and(|at| all(&c.transmitted(i, at, end), WireCommand::Standby)),
        format!("{name}: and stays, although run is still commanded"),
    );
    c.must(
        c.phases(i, stopped, end).iter().all(|phase| !phase.is_live()),
        format!("{name}: the engine is not lit again"),
    );
    c.must(
        c.source(i).answer() == Some(Err(Rejected::StandbyFirst)),
        format!("{name}: the source gets the reason ({})", c.answer_text(i)),
    );
    Ok(())
}

/// A flame-out whose fault clears when standby has long been on the wire.
async fn fault_clears_late(c: &ScenarioContext<'_>) -> Result<(), String> {
    c.mark("flame-out of left; run is still commanded");
    c.ecu(0, |ecu| ecu.turbine_mut().flame_out());
    let out = c.now();
    c.until(20.0, "the ECU sees that its engine has stopped", || c.turbine(0).trip().is_some()).await?;
    let stopped = c.now();
    c.until(60.0, "the fault clears", || c.turbine(0).trip().is_none()).await?;
    c.mark("the fault clears");
    let clear = c.now();
    c.sleep(15.0).await;
    let end = c.now();
    c.look();
    let frames = c.transmitted(0, out, end);
    let standby = frames.iter().find(|frame| frame.command == WireCommand::Standby).map(|frame| frame.from);
    c.must(
        standby.is_some_and(|at| at <= out + 6 * SECOND),
        format!(
            "left: standby is on the wire within 6 s of the flame-out, by its exhaust ({})",
            c.or_never(standby.map(|at| at.saturating_sub(out)))
        ),
    );
    c.must(
        standby.is_some_and(|at| all(&c.transmitted(0, at, end), WireCommand::Standby)),
        "left: and stays, also when the fault clears, although run is still commanded",
    );
    c.must(
        c.events_since(
            0,
            clear - SECOND,
            |event| matches!(event, Event::Faults(faults) if faults.is_empty()),
        ) >= 1,
        "left: reported that the fault is gone",
    );
    c.must(
        c.phases(0, stopped, end).iter().all(|phase| !phase.is_live()),
        "left: the engine is not lit again, neither with the fault nor when it clears",
    );
    c.must(
        c.source(0).answer() == Some(Err(Rejected::StandbyFirst)),
        format!("left: the source gets the reason ({})", c.answer_text(0)),
    );
    Ok(())
}

pub async fn two_engines_one_fails(c: &ScenarioContext<'_>) -> Result<(), String> {
    c.fly(60).await?;
    c.event();
    c.mark("flame-out of left; run is still commanded");
    c.ecu(0, |ecu| ecu.turbine_mut().flame_out());
    let out = c.now();
    c.sleep(8.0).await;
    c.mark("right is commanded to 80 %");
    c.source(1).throttle(80);
    let commanded_at = c.now();
    c.sleep(6.0).await;
    c.mark("the pilot shuts left down");
    c.source(0).standby();
    c.stage(0, Stage::Cooling);
    let shut = c.now();
    c.sleep(4.0).await;
    let end = c.now();
    c.look();
    c.must(
        c.events_since(1, out, |event| event == Event::OtherFailed(1)) == 1,
        "right: reported once that the other engine has failed",
    );
    c.must(
        c.events_since(1, shut, |event| event == Event::OtherFailed(0)) == 1
            && c.events_since(1, out, |event| event == Event::OtherFailed(0)) == 1,
        "right: reported that no engine is considered failed when left was shut down, and not before",
    );
    c.must(
        all(&c.transmitted(1, out, commanded_at), WireCommand::Run(600))
            && all(&c.transmitted(1, commanded_at + 300 * MILLIS, end), WireCommand::Run(800)),
        "right: its own demand is on the wire, 60 % and 80 %, at once",
    );
    c.must(c.ran_from(1, out), "right: the engine runs all the time");
    c.must(
        c.source(1).answer() == Some(Ok(Accepted::InForce)),
        format!("right: its source is in control ({})", c.answer_text(1)),
    );
    c.must(
        !c.transmitted(0, out + 6 * SECOND + ON_WIRE, end).iter().any(|frame| is_run(frame.command)),
        "left: no run is on the wire 6 s after its flame-out",
    );
    c.must(
        c.starts(0, out, end) == 0 && !c.turbine(0).phase().is_live(),
        "left: the engine is not lit again",
    );
    c.shut_down().await
}

//! Engines that fail.

use super::super::audit::WireCommand;
use super::super::context::Stage;
use super::check::{ON_WIRE, all, is_run};
use super::context::ScenarioContext;
use bench::rows::simulated_as;
use jetlink::command::{Accepted, Rejected};
use jetlink::event::Event;
use sim::amt::{AmtConfig, AmtEcu};
use sim::ecu::{MILLIS, SECOND};

pub async fn fault_clears(c: &ScenarioContext<'_>) -> Result<(), String> {
    // An ECU that forgets a fault after 40 s, and starts on run alone, however hot.
    let mut config = simulated_as::<AmtConfig>(c.engine(0));
    config.temper.starts_hot = true;
    config.temper.trips_clear_after = Some(40 * SECOND);
    c.plug_in(0, AmtEcu::new(config));
    c.fly(60).await?;
    c.event();
    c.mark("flame-out; run is still commanded");
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
    c.shut_down().await
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

//! Why an engine does not start, and what holds its demand below the command: each condition with its value and its limit.
//! The sentence of a condition that is not met is that of the refusal.

use embassy_time::Instant;
use jetlink::command::{Demand, Interlock, Order};
use jetlink::config::EngineConfig;
use jetlink::engine::state::EngineState;
use jetlink::event::LossStage;
use jetlink::report::LinkState;
use jetlink::telemetry::Telemetry;
use jetlink::units::Celsius;

/// A condition of a start.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Condition {
    /// It is met.
    pub met: bool,
    /// What it is about.
    pub what: &'static str,
    /// Value and limit, or the refusal.
    pub text: String,
}

/// Every condition of a start, in the order in which a refusal names the first that is not met.
pub fn of_start(telemetry: &Telemetry, config: &EngineConfig, others_start: bool) -> Vec<Condition> {
    let rules = &config.supervision.start;
    let report = &telemetry.report;
    let now = telemetry.at;
    let met = |what, text: String| Condition { met: true, what, text };
    let not = |what, interlock: Interlock| Condition { met: false, what, text: interlock.to_string() };
    let mut all = Vec::new();
    let mut add = |holds: bool, what, text: String, interlock| {
        all.push(if holds { met(what, text) } else { not(what, interlock) });
    };

    if telemetry.stop_latched {
        add(false, "emergency stop", String::new(), Interlock::NotStandby);
    }
    add(telemetry.armed || !rules.arming, "armed", "armed".to_owned(), Interlock::NotArmed);
    let since = telemetry.last_rx.map(|last_rx| seconds_between(last_rx, now));
    let link = since.map_or_else(String::new, |since| {
        format!("last frame {since:.2} s ago, needs {} s stable", rules.link_stable.as_millis() as f64 / 1e3)
    });
    add(telemetry.link == LinkState::Up, "link", link, Interlock::Link);
    let faulty = report.faults.is_some_and(|faults| !faults.value.is_empty());
    add(!faulty, "faults", "the ECU reports none".to_owned(), Interlock::Fault);
    let state = telemetry.state;
    let text = format!("the ECU reports {}", state.name());
    add(state == EngineState::Standby, "state", text, Interlock::NotStandby);
    let limit = rules.egt_max;
    match report.egt {
        Some(egt) => {
            let text = format!("{} °C, limit {} °C", whole(egt.value), whole(limit));
            add(egt.value <= limit, "EGT", text, Interlock::TooHot(egt.value));
        }
        None => add(false, "EGT", String::new(), Interlock::EgtUnknown),
    }
    if let Some(least) = rules.supply_min {
        let supply = report.supply.and_then(|supply| supply.value.voltage);
        let text = supply
            .map_or_else(String::new, |supply| format!("{} mV, least {} mV", supply.get(), least.get()));
        let low = supply.filter(|supply| *supply < least);
        add(low.is_none(), "supply", text, Interlock::SupplyLow(low.unwrap_or(least)));
    }
    add(!others_start, "other engines", "none is starting".to_owned(), Interlock::OtherStarting);

    // An emergency stop has a sentence of its own.
    if telemetry.stop_latched
        && let Some(first) = all.first_mut()
    {
        first.text = jetlink::command::Rejected::StopLatched.to_string();
    }
    // A limit is shown with its value.
    for condition in all.iter_mut().filter(|condition| !condition.met && condition.what == "EGT") {
        if report.egt.is_some() {
            condition.text += &format!(", limit {} °C", whole(limit));
        }
    }
    all
}

/// What keeps the demand on the wire from the commanded one; nothing if it is there.
pub fn of_demand(telemetry: &Telemetry, config: &EngineConfig) -> Vec<String> {
    let loss = &config.supervision.loss;
    let mut all = Vec::new();
    match telemetry.ordered.order {
        Order::EmergencyStop => {
            all.push(format!("an emergency stop is in force, by {}", telemetry.ordered.origin.name()));
        }
        Order::Listen => all.push("the node has started and listens before it obeys".to_owned()),
        Order::Doubt(_) => {
            all.push(
                "it is in doubt whether the engine runs: nothing that could start it is sent".to_owned(),
            );
        }
        Order::Pwm => all.push("the ECU's PWM input is in control".to_owned()),
        Order::Standby | Order::Run(_) => {}
    }
    match telemetry.loss {
        LossStage::None => {}
        LossStage::Hold => all.push(format!(
            "the source is lost: its demand is held for {} s",
            loss.hold.as_millis() as f64 / 1e3
        )),
        LossStage::FailSafe => all.push(format!(
            "the source is lost: the demand falls to {:.0} % at {:.0} % a second",
            f64::from(loss.throttle.tenths()) / 10.0,
            f64::from(loss.ramp) / 10.0
        )),
        LossStage::Standby => all.push("the source is lost: standby".to_owned()),
    }
    if telemetry.limited {
        all.push("a limit has lowered the demand: it stays there until standby is commanded".to_owned());
    }
    if let Some(next) = telemetry.waiting {
        all.push(format!("{} is about to take over: the demand is held meanwhile", next.name()));
    }
    if let Some(until) = telemetry.start_waits_until {
        let left = seconds_between(telemetry.at, until);
        all.push(format!("{}, for {left:.0} s at most", Interlock::OtherStarting));
    }
    if telemetry.transmitter_failed {
        all.push("nothing is sent: the transmitter has failed".to_owned());
    }
    if let Order::Run(Demand::Throttle(_) | Demand::Rpm(_)) = telemetry.ordered.order
        && matches!(telemetry.state, EngineState::Starting(_) | EngineState::StartRequested)
    {
        all.push("the engine starts: the ECU follows the demand once it runs".to_owned());
    }
    all
}

fn whole(celsius: Celsius) -> i16 {
    celsius.tenths() / 10
}

fn seconds_between(earlier: Instant, later: Instant) -> f64 {
    later.saturating_duration_since(earlier).as_micros() as f64 / 1e6
}

#[cfg(test)]
mod tests {
    use super::super::engines::engines;
    use super::super::node::Node;
    use super::*;
    use jetlink::report::Timed;

    #[test]
    fn a_condition_that_is_not_met_has_the_text_of_the_refusal_and_the_limit() {
        let engines = engines(&[]).unwrap();
        let node = Node::new(&engines, false);
        let mut telemetry = node.telemetry(0);
        telemetry.report.egt = Some(Timed::new(Celsius::from_tenths(3120), Instant::MIN));
        let all = of_start(&telemetry, &engines[0].config, true);
        let of = |what| all.iter().find(|condition| condition.what == what).unwrap();
        assert_eq!(of("EGT").text, "the exhaust is at 312 °C: let it cool in standby, limit 100 °C");
        assert_eq!(of("armed").text, Interlock::NotArmed.to_string());
        assert_eq!(of("other engines").text, Interlock::OtherStarting.to_string());
        assert!(of("faults").met && !of("link").met);
        telemetry.report.egt = Some(Timed::new(Celsius::from_tenths(250), Instant::MIN));
        let all = of_start(&telemetry, &engines[0].config, false);
        let egt = all.iter().find(|condition| condition.what == "EGT").unwrap();
        assert!(egt.met && egt.text == "25 °C, limit 100 °C", "{egt:?}");
    }
}

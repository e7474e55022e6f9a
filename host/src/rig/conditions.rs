//! Why an engine does not start, and what holds its demand below the command: each condition with its value and its limit.
//! An unmet condition comes from the node itself, in the words of its refusal.

use super::audit::WireCommand;
use super::context::PilotInput;
use super::sample::{Detail, Sample};
use embassy_time::Instant;
use jetlink::command::{Demand, Interlock, Order, Rejected};
use jetlink::engine::config::Limits;
use jetlink::engine::state::EngineState;
use jetlink::event::LossStage;
use jetlink::limit::{Action, LimitKind, LimitViolation};
use jetlink::report::LinkState;
use jetlink::units::{Celsius, Rpm};

/// A condition of a start.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Condition {
    /// It is met.
    pub met: bool,
    /// Its subject.
    pub what: &'static str,
    /// Value and limit, or the refusal.
    pub text: String,
}

/// Conditions that depend on the ECU's reports.
const REPORTED: [&str; 4] = ["faults", "state", "EGT", "supply"];
const NOT_RECEIVED: &str = "not known: nothing is received from the ECU";

/// Every condition of a start, in the order in which a refusal names the first that is not met.
pub fn of_start(detail: &Detail) -> Vec<Condition> {
    let Some(refusals) = &detail.start_refusals else {
        let text = "it restarts: nothing starts an engine until it is up".to_owned();
        return vec![Condition { met: false, what: "node", text }];
    };
    let (telemetry, rules) = (&detail.telemetry, &detail.config.supervision.start);
    let report = &telemetry.report;
    let mut all = Vec::new();
    // Text of a condition that no refusal names; without a text it is not shown.
    let mut add = |what, met: Option<String>, limit: String, of_it: fn(&Rejected) -> bool| {
        let refusal = refusals.iter().find(|why| of_it(why));
        // Reports from before the wire was lost do not show that a condition is met now.
        let unknown = REPORTED.contains(&what) && telemetry.link != LinkState::Up;
        if let Some(why) = refusal {
            all.push(Condition { met: false, what, text: format!("{why}{limit}") });
        } else if let Some(text) = met {
            let text = if unknown { NOT_RECEIVED.to_owned() } else { text };
            all.push(Condition { met: !unknown, what, text });
        }
    };
    let none = String::new;

    add("emergency stop", Some("none is latched".to_owned()), none(), |why| *why == Rejected::StopLatched);
    add("node", Some("it is up and obeys".to_owned()), none(), |why| {
        matches!(why, Rejected::Listening | Rejected::NoLink)
    });
    add("armed", Some("armed".to_owned()), none(), |why| {
        matches!(why, Rejected::DisarmFirst | Rejected::Start(Interlock::NotArmed))
    });
    let kind = match detail.start_demand {
        Some(Demand::Rpm(_)) => "speed, which the ECU controls",
        Some(Demand::Throttle(_)) | None => "throttle, which every ECU follows",
    };
    add("kind of demand", Some(kind.to_owned()), none(), |why| {
        matches!(
            why,
            Rejected::NeedsVersion { .. }
                | Rejected::NoSpeedControl
                | Rejected::RpmNotKnown
                | Rejected::AboveMaxRpm { .. }
        )
    });
    add("source", Some("no higher one commands".to_owned()), none(), |why| {
        matches!(why, Rejected::Behind(_))
    });
    add("standby first", Some("commanded by its source".to_owned()), none(), |why| {
        *why == Rejected::StandbyFirst
    });
    let idle = match (detail.start_demand, report.idle_rpm) {
        (Some(Demand::Rpm(_)), Some(idle)) => format!("at most idle, {} rpm", idle.value.get()),
        _ => format!("at most {:.1} %", f64::from(rules.idle_band.tenths()) / 10.0),
    };
    let demand = detail.start_demand.map(|demand| format!("{}, {idle}", PilotInput::Run(demand)));
    add("demand", demand.clone(), demand.map_or_else(none, |demand| format!(" ({demand})")), |why| {
        *why == Rejected::Start(Interlock::NotIdle)
    });
    let stable = rules.link_stable.as_millis() as f64 / 1e3;
    let since = telemetry.last_rx.map(|last_rx| seconds_between(last_rx, telemetry.at));
    let last =
        since.map_or_else(|| "no frame yet".to_owned(), |since| format!("last frame {since:.2} s ago"));
    add("link", Some(format!("{last}, no gap for {stable} s")), format!(" ({stable} s; {last})"), |why| {
        *why == Rejected::Start(Interlock::Link)
    });
    add("fuel pump", Some("no service has it open".to_owned()), none(), |why| {
        *why == Rejected::Start(Interlock::PumpOpen)
    });
    let faults = report.faults.map_or_else(none, |faults| format!(": {}", faults.value));
    add("faults", Some("the ECU reports none".to_owned()), faults, |why| {
        *why == Rejected::Start(Interlock::Fault)
    });
    let state = telemetry.state.name();
    add("state", Some(format!("the ECU reports {state}")), format!(" ({state})"), |why| {
        *why == Rejected::Start(Interlock::NotStandby)
    });
    let limit = format!(", limit {} °C", whole(rules.egt_max));
    let egt = report.egt.map_or_else(none, |egt| format!("{} °C{limit}", whole(egt.value)));
    add("EGT", Some(egt), limit, |why| {
        matches!(why, Rejected::Start(Interlock::TooHot(_) | Interlock::EgtUnknown))
    });
    if let Some(least) = rules.supply_min {
        let least = format!(", least {} mV", least.get());
        let supply = telemetry.supply.map(|supply| supply.value.get());
        let text = supply.map_or_else(|| "not reported".to_owned(), |supply| format!("{supply} mV"));
        add("supply", Some(format!("{text}{least}")), least, |why| {
            matches!(why, Rejected::Start(Interlock::SupplyLow(_)))
        });
    }
    let of_kind = |kind| detail.violations.iter().find(|violation| violation.kind == kind);
    let violated = refusals.iter().find_map(|why| match why {
        Rejected::Start(Interlock::Limit(kind)) => of_kind(*kind),
        _ => None,
    });
    add("limits", Some("none is violated".to_owned()), violated.map_or_else(none, values), |why| {
        matches!(why, Rejected::Start(Interlock::Limit(_)))
    });
    let gap =
        format!(", and {} s have passed since that start was commanded", rules.gap.as_millis() as f64 / 1e3);
    add("other engines", Some("none is starting".to_owned()), gap, |why| {
        *why == Rejected::Start(Interlock::OtherStarting)
    });
    all
}

/// Value and limit of a violation, after its name.
fn values(violation: &LimitViolation) -> String {
    violation.to_string().strip_prefix(violation.kind.name()).unwrap_or_default().to_owned()
}

/// Whether the demand on the wire is the one that its source commands.
pub fn is_sent(sample: &Sample) -> bool {
    match (sample.input, sample.on_wire) {
        (PilotInput::Standby, Some(WireCommand::Standby)) => true,
        (PilotInput::Run(Demand::Throttle(throttle)), Some(WireCommand::Run(sent))) => {
            throttle.tenths() == sent
        }
        (PilotInput::Run(Demand::Rpm(rpm)), Some(WireCommand::RunRpm(sent))) => rpm.get() == sent,
        _ => false,
    }
}

/// Reasons why the demand on the wire differs from the commanded one; empty if it does not, or will not with the next frame.
pub fn of_demand(sample: &Sample, detail: &Detail) -> Vec<String> {
    let (telemetry, supervision) = (&detail.telemetry, &detail.config.supervision);
    let loss = &supervision.loss;
    let origin = telemetry.ordered.origin.name();
    let mut all = Vec::new();
    if !sample.node_up {
        all.push("the node restarts: nothing is sent until it is up".to_owned());
        return all;
    }
    if sample.link != LinkState::Up {
        all.push("the link is not up: nothing shows that frames reach the ECU".to_owned());
    }
    match telemetry.ordered.order {
        Order::EmergencyStop => all.push(format!("an emergency stop is in force, by {origin}")),
        Order::Listen => {
            all.push("no order is in force: the node listens, and the next reports decide".to_owned())
        }
        Order::Doubt(_) => {
            all.push("it is in doubt whether the engine runs: the demand may be withheld".to_owned());
        }
        Order::Pwm => all.push("the ECU's PWM input is in control".to_owned()),
        Order::Standby if matches!(sample.input, PilotInput::Run(_)) => {
            all.push(format!("standby is in force, from {origin}: a run has to start the engine first"));
        }
        Order::Run(_) if sample.input == PilotInput::Standby && telemetry.loss == LossStage::None => {
            all.push(format!("a run is in force, from {}", telemetry.active_source.name()));
        }
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
        let limits = &supervision.limits;
        let lowers = |violation: &&LimitViolation| action(limits, violation.kind) == Action::FailSafe;
        let latest = detail.violations.iter().rfind(lowers);
        let which = latest.map_or_else(String::new, |violation| format!(" ({violation})"));
        all.push(format!("a limit has lowered the demand{which}: it stays there until standby is commanded"));
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
    if let Order::Run(sent) = telemetry.ordered.order {
        if let (PilotInput::Run(input), Some(commanded)) = (sample.input, telemetry.commanded)
            && input != commanded
            && telemetry.loss == LossStage::None
            && telemetry.waiting.is_none()
        {
            let source = telemetry.active_source.name();
            all.push(match report_max(detail).filter(|max| Demand::Rpm(*max) == commanded) {
                Some(max) => format!("the engine's maximum is {} rpm", max.get()),
                None => format!("{commanded} is in force, from {source}"),
            });
        }
        if matches!(telemetry.state, EngineState::Starting(_) | EngineState::StartRequested) {
            all.push("the engine starts: the ECU follows the demand once it runs".to_owned());
        } else if let (Some(commanded), true) = (telemetry.commanded, all.is_empty()) {
            all.extend(on_its_way(commanded, sent, detail));
        }
    }
    all
}

/// Reason for the motion of a demand that nothing else holds.
fn on_its_way(commanded: Demand, sent: Demand, detail: &Detail) -> Option<String> {
    let supervision = &detail.config.supervision;
    let rate = |per_mille: u16| format!("{:.1} % a second", f64::from(per_mille) / 10.0);
    let of_maximum = if matches!(sent, Demand::Rpm(_)) { " of the maximum speed" } else { "" };
    let (rises, falls) = match (commanded, sent) {
        (Demand::Throttle(commanded), Demand::Throttle(sent)) => (commanded > sent, commanded < sent),
        (Demand::Rpm(commanded), Demand::Rpm(sent)) => (commanded > sent, commanded < sent),
        (Demand::Rpm(_), Demand::Throttle(_)) => {
            return Some("the governor sets the throttle that brings the shaft to that speed".to_owned());
        }
        (Demand::Throttle(_), Demand::Rpm(_)) => {
            return Some("a speed stays in force until a throttle can replace it".to_owned());
        }
    };
    if let Some(share) = supervision.when_other_fails.filter(|_| detail.telemetry.others_failed > 0)
        && rises
    {
        let share = f64::from(share) / 10.0;
        return Some(format!("another engine has failed: the demand is reduced to {share:.0} %"));
    }
    if falls {
        let down = supervision.slew.down?;
        return Some(format!("it falls at {}{of_maximum} (SLEW_DOWN)", rate(down)));
    }
    let slew = supervision.slew.up.map(|up| format!("{}{of_maximum} (SLEW_UP)", rate(up)));
    let rise =
        || format!("{}{of_maximum} until it reaches the commanded demand (RISE)", rate(supervision.rise));
    rises.then(|| match (slew, supervision.slew.up) {
        (Some(slew), Some(up)) if up <= supervision.rise => format!("it rises at {slew}"),
        (Some(slew), _) => format!("it rises at {slew}; after a start, a gap or a take-over at {}", rise()),
        (None, _) => format!("it rises at {}", rise()),
    })
}

/// The highest speed that may be commanded.
fn report_max(detail: &Detail) -> Option<Rpm> {
    let governed = detail.config.supervision.governor.map(|governor| governor.max_rpm);
    detail.telemetry.report.max_rpm.map(|max| max.value).into_iter().chain(governed).min()
}

/// The node's action for a limit.
const fn action(limits: &Limits, kind: LimitKind) -> Action {
    match kind {
        LimitKind::OverSpeed => limits.over_speed.action,
        LimitKind::OverTemperature => limits.over_temperature.action,
        LimitKind::LowRpm => limits.low_rpm.action,
        LimitKind::HotStart => limits.hot_start.action,
        LimitKind::FlameOut => limits.flame_out.action,
        LimitKind::SupplyLow => limits.supply_low.action,
        LimitKind::Implausible => limits.implausible.action,
        LimitKind::EcuFault => limits.ecu_fault,
        LimitKind::StartTimeout => Action::Standby,
        // One that is new to the rig is named by its event alone.
        _ => Action::Report,
    }
}

fn whole(celsius: Celsius) -> i16 {
    celsius.tenths() / 10
}

fn seconds_between(earlier: Instant, later: Instant) -> f64 {
    later.saturating_duration_since(earlier).as_micros() as f64 / 1e6
}

#[cfg(test)]
mod tests {
    use super::super::context::{EngineContext, Notes, Stage};
    use super::super::engines::engines;
    use super::super::node::Node;
    use super::*;
    use jetlink::command::{Ordered, Origin};
    use jetlink::report::Timed;
    use jetlink::units::{Millivolts, Throttle};

    /// Of an engine before its first frame.
    fn moment() -> (Sample, Detail) {
        let engines = Box::leak(engines(&[]).unwrap().into_boxed_slice());
        let node = Node::new(engines, false);
        let notes = Notes::default();
        let context = EngineContext::new(0, &engines[0], Instant::MIN, &notes);
        context.stage.set(Stage::Steps);
        let telemetry = node.telemetry(0);
        let sample = Sample::take(&context, &telemetry, true);
        let detail = Detail {
            telemetry,
            config: engines[0].config,
            start_demand: Some(Demand::Throttle(Throttle::IDLE)),
            start_refusals: Some(Vec::new()),
            violations: Vec::new(),
            outputs: node.outputs(0),
            entries: Vec::new(),
            faults: Vec::new(),
        };
        (sample, detail)
    }

    fn percent(whole: u16) -> Demand {
        Demand::Throttle(Throttle::from_tenths(whole * 10).unwrap())
    }

    #[test]
    fn a_condition_that_is_not_met_has_the_text_of_the_refusal_and_the_limit() {
        let (_, mut detail) = moment();
        detail.config.supervision.start.supply_min = Some(Millivolts::new(11_000));
        detail.telemetry.link = LinkState::Up;
        detail.telemetry.report.egt = Some(Timed::new(Celsius::from_tenths(250), Instant::MIN));
        let of = |detail: &Detail, what| {
            let all = of_start(detail);
            all.into_iter().find(|condition| condition.what == what)
        };
        assert!(of_start(&detail).iter().all(|condition| condition.met));
        assert_eq!(of(&detail, "EGT").unwrap().text, "25 °C, limit 100 °C");
        assert_eq!(of(&detail, "demand").unwrap().text, "0.0 %, at most 2.0 %");
        // The node's refusal is shown, however a reader might interpret the values.
        let violation = |kind, value, limit| LimitViolation { kind, value, limit };
        detail.violations =
            vec![violation(LimitKind::FlameOut, 30, 25), violation(LimitKind::OverTemperature, 8230, 8000)];
        for (why, what, text) in [
            (Rejected::StopLatched, "emergency stop", Rejected::StopLatched.to_string()),
            (Rejected::Listening, "node", Rejected::Listening.to_string()),
            (Rejected::DisarmFirst, "armed", Rejected::DisarmFirst.to_string()),
            (Rejected::StandbyFirst, "standby first", "command standby before a start".to_owned()),
            (Rejected::Behind(Origin::Rc), "source", Rejected::Behind(Origin::Rc).to_string()),
            (
                Rejected::Start(Interlock::NotIdle),
                "demand",
                "bring the demand to idle first (0.0 %, at most 2.0 %)".to_owned(),
            ),
            (
                Rejected::Start(Interlock::Link),
                "link",
                "wait until the ECU is received without a gap (1 s; no frame yet)"
                    .to_owned(),
            ),
            (Rejected::Start(Interlock::PumpOpen), "fuel pump", Interlock::PumpOpen.to_string()),
            (
                Rejected::Start(Interlock::TooHot(Celsius::from_tenths(3120))),
                "EGT",
                "the exhaust is at 312 °C: let it cool in standby, limit 100 °C".to_owned(),
            ),
            (
                Rejected::Start(Interlock::SupplyLow(Millivolts::new(9000))),
                "supply",
                "the supply voltage is 9000 mV: charge the battery, least 11000 mV".to_owned(),
            ),
            (
                Rejected::Start(Interlock::Limit(LimitKind::OverTemperature)),
                "limits",
                "a limit is violated: exhaust too hot: 823 °C, limit 800 °C".to_owned(),
            ),
            (
                Rejected::Start(Interlock::OtherStarting),
                "other engines",
                "wait until another engine of the group has started, and 10 s have passed since that start was commanded".to_owned(),
            ),
        ] {
            detail.start_refusals = Some(vec![why]);
            let condition = of(&detail, what).unwrap();
            assert_eq!((condition.met, condition.text), (false, text));
            assert_eq!(of_start(&detail).iter().filter(|condition| !condition.met).count(), 1, "{why}");
        }
        let faults = jetlink::ecu::Faults::Amt(jetlink::ecu::amt::codec::ErrorBits(1));
        detail.telemetry.report.faults = Some(Timed::new(faults, Instant::MIN));
        detail.start_refusals = Some(vec![Rejected::Start(Interlock::Fault)]);
        assert!(of(&detail, "faults").unwrap().text.ends_with(&format!("clear it first: {faults}")));
        detail.start_refusals = None;
        assert!(of_start(&detail).iter().all(|condition| !condition.met && condition.what == "node"));
    }

    #[test]
    fn each_condition_is_shown_met_or_not() {
        let (_, mut detail) = moment();
        detail.telemetry.link = LinkState::Up;
        detail.config.supervision.start.supply_min = Some(Millivolts::new(11_000));
        detail.telemetry.report.egt = Some(Timed::new(Celsius::from_tenths(250), Instant::MIN));
        let all = [
            "emergency stop",
            "node",
            "armed",
            "kind of demand",
            "source",
            "standby first",
            "demand",
            "link",
            "fuel pump",
            "faults",
            "state",
            "EGT",
            "supply",
            "limits",
            "other engines",
        ];
        let conditions = of_start(&detail);
        assert_eq!(conditions.iter().map(|condition| condition.what).collect::<Vec<_>>(), all);
        assert!(
            conditions.iter().all(|condition| condition.met && !condition.text.is_empty()),
            "{conditions:?}"
        );
        // With a lost wire, the ECU's earlier reports no longer count.
        for link in [LinkState::Lost, LinkState::Silent] {
            detail.telemetry.link = link;
            let unmet = of_start(&detail).into_iter().filter(|condition| !condition.met);
            let unmet: Vec<_> = unmet.map(|condition| (condition.what, condition.text)).collect();
            assert_eq!(unmet, REPORTED.map(|what| (what, NOT_RECEIVED.to_owned())));
        }
    }

    #[test]
    fn a_demand_that_moves_says_at_which_rate() {
        let (mut sample, mut detail) = moment();
        sample.link = LinkState::Up;
        detail.telemetry.state = EngineState::Running;
        let mut says = |commanded: Demand, sent: Demand, up, down| {
            sample.input = PilotInput::Run(commanded);
            detail.telemetry.commanded = Some(commanded);
            detail.telemetry.ordered = Ordered { order: Order::Run(sent), origin: Origin::Bench };
            detail.config.supervision.slew.up = up;
            detail.config.supervision.slew.down = down;
            of_demand(&sample, &detail).join("; ")
        };
        assert_eq!(says(percent(60), percent(60), None, None), "");
        let rise = "it rises at 50.0 % a second until it reaches the commanded demand (RISE)";
        assert_eq!(says(percent(60), percent(20), None, None), rise);
        assert_eq!(says(percent(60), percent(20), Some(50), None), "it rises at 5.0 % a second (SLEW_UP)");
        assert!(
            says(percent(60), percent(20), Some(800), None)
                .contains("80.0 % a second (SLEW_UP); after a start")
        );
        assert_eq!(
            says(percent(20), percent(60), None, Some(100)),
            "it falls at 10.0 % a second (SLEW_DOWN)"
        );
        let rpm = |rpm| Demand::Rpm(Rpm::new(rpm));
        let of_rpm = says(rpm(90_000), rpm(40_000), None, None);
        assert_eq!(
            of_rpm,
            "it rises at 50.0 % a second of the maximum speed until it reaches the commanded demand (RISE)"
        );
        assert!(says(rpm(90_000), percent(40), None, None).contains("governor"));
    }

    #[test]
    fn a_limit_that_lowers_the_demand_is_named_with_its_value() {
        let (mut sample, mut detail) = moment();
        sample.link = LinkState::Up;
        sample.input = PilotInput::Run(percent(60));
        detail.telemetry.commanded = Some(percent(60));
        detail.telemetry.ordered = Ordered { order: Order::Run(percent(0)), origin: Origin::Bench };
        detail.telemetry.limited = true;
        detail.config.supervision.limits.over_temperature.action = Action::FailSafe;
        // A limit that is only reported lowers nothing.
        for (kind, value, limit) in [(LimitKind::OverTemperature, 8230, 8000), (LimitKind::FlameOut, 30, 25)]
        {
            detail.violations.push(LimitViolation { kind, value, limit });
        }
        assert_eq!(
            of_demand(&sample, &detail),
            [
                "a limit has lowered the demand (exhaust too hot: 823 °C, limit 800 °C): it stays there until standby is commanded"
            ]
        );
    }

    #[test]
    fn only_a_demand_on_the_wire_is_sent() {
        let (mut sample, _) = moment();
        sample.input = PilotInput::Run(percent(60));
        for (wire, sent) in [
            (Some(WireCommand::Run(600)), true),
            (Some(WireCommand::Run(590)), false),
            (Some(WireCommand::RunRpm(600)), false),
            (Some(WireCommand::Standby), false),
            (None, false),
        ] {
            sample.on_wire = wire;
            assert_eq!(is_sent(&sample), sent, "{wire:?}");
        }
    }
}

//! One engine as a row of text: for the lines and for the table.

use super::fit::elided;
use super::sample::Sample;
use embassy_time::Duration;
use jetlink::report::LinkState;

/// Heads of the columns with their widths, the most important first: up to the link they fit 80 columns with
/// names like `booster`. A wider text is cut.
const COLUMNS: [(&str, usize); 11] = [
    ("state", 18),
    ("rpm", 6),
    ("EGT", 7),
    ("commanded", 10),
    ("sent", 10),
    ("link", 8),
    ("source", 15),
    ("progress", 11),
    ("armed", 5),
    ("errors", 6),
    ("worst timing", 34),
];

/// The heads of the columns in one line of at most this width: columns without room are left out. `names` are those of all
/// engines.
pub fn heads(names: &[&str], most: usize) -> String {
    align("engine", names, &COLUMNS.map(|(head, _)| head.to_owned()), most)
}

/// One engine in one such line. `frames_per_second` is the ECU's recent rate.
pub fn row(
    name: &str,
    names: &[&str],
    sample: &Sample,
    frames_per_second: Option<f64>,
    most: usize,
) -> String {
    let dash = || "-".to_owned();
    let counters = &sample.counters;
    let timing = match (counters.worst_reply_margin, counters.worst_slot_delay) {
        (Some(margin), _) => format!("margin {}", millis(margin)),
        (None, Some(delay)) => format!("delay {}", millis(delay)),
        (None, None) => dash(),
    };
    let missed = sample.missed();
    let cells = [
        sample.does_text(),
        sample.rpm.map_or_else(dash, |rpm| rpm.to_string()),
        sample.egt.map_or_else(dash, |egt| format!("{egt:.0} °C")),
        if sample.silent { "silent".to_owned() } else { sample.input.to_string() },
        sample.wire_text(),
        // If the link is down, the rate would be an old one.
        match frames_per_second {
            Some(rate) if sample.link == LinkState::Up => format!("up {rate:.0}/s"),
            _ => sample.link_name().to_owned(),
        },
        sample.in_control_text(),
        sample.stage.name().to_owned(),
        if sample.armed { "yes" } else { "no" }.to_owned(),
        sample.decode_errors().to_string(),
        if missed == 0 { timing } else { format!("{missed} MISSED, {timing}") },
    ];
    align(name, names, &cells, most)
}

/// A time in milliseconds.
pub fn millis(time: Duration) -> String {
    format!("{:.3} ms", time.as_micros() as f64 / 1000.0)
}

fn align(name: &str, names: &[&str], cells: &[String; COLUMNS.len()], most: usize) -> String {
    let width = names.iter().map(|name| name.len()).fold("engine".len(), usize::max);
    let mut line = format!("{name:<width$}  ");
    for (cell, (head, width)) in cells.iter().zip(COLUMNS) {
        if line.chars().count() + width > most {
            break;
        }
        let right = matches!(head, "rpm" | "EGT" | "commanded" | "sent" | "errors");
        let cell = elided(cell, width, '…');
        line += &if right { format!("{cell:>width$}  ") } else { format!("{cell:<width$}  ") };
    }
    line.truncate(line.trim_end().len());
    line
}

#[cfg(test)]
mod tests {
    use super::super::audit::WireCommand;
    use super::super::context::{EngineContext, Notes, PilotInput, Stage};
    use super::super::engines::engines;
    use super::super::node::Node;
    use super::*;
    use jetlink::command::{Demand, Order, Origin};
    use jetlink::engine::state::EngineState;
    use jetlink::event::LossStage;
    use jetlink::units::{Rpm, Throttle};

    /// The columns that always have to be shown.
    fn where_they_end(line: &str) -> Vec<usize> {
        let mut end = "booster  ".len();
        COLUMNS
            .iter()
            .map(|(_, width)| {
                end += width + 2;
                let between = line.chars().skip(end - 2).take(2);
                assert!(between.clone().all(|c| c == ' '), "{end}: {line}");
                end - 2
            })
            .collect()
    }

    #[test]
    fn essential_columns_fit_80_and_stay_aligned() {
        let engines = engines(&[]).unwrap();
        let node = Node::new(&engines, false);
        let notes = Notes::default();
        let context = EngineContext::new(3, &engines[3], embassy_time::Instant::MIN, &notes);
        let names = ["left", "right", "centre", "booster"];
        let quiet = Sample::take(&context, &node.telemetry(3), true);
        let starting = jetlink::report::EcuState { code: 2, name: "ignition-min-throttle" };
        let mut loud = Sample {
            stage: Stage::Cooling,
            input: PilotInput::Run(Demand::Rpm(Rpm::new(160_000))),
            link: LinkState::Up,
            does: EngineState::Starting(starting),
            on_wire: Some(WireCommand::RunRpm(159_960)),
            in_control: Origin::Emergency,
            waiting: Some(Origin::Mavlink),
            loss: LossStage::FailSafe,
            order: Order::Standby,
            rpm: Some(160_010),
            egt: Some(1100.4),
            armed: true,
            ..quiet
        };
        loud.counters.crc_failures = 123_456;
        loud.counters.send_slots_missed = 1234;
        loud.counters.worst_slot_delay = Some(Duration::from_micros(12_345));
        let heads = heads(&names, usize::MAX);
        for line in [
            &heads,
            &row("booster", &names, &quiet, None, usize::MAX),
            &row("booster", &names, &loud, Some(100.0), usize::MAX),
        ] {
            let ends = where_they_end(line);
            assert!(ends[5] <= 80 && ends[6] <= 100, "{ends:?}");
        }
        // A narrow terminal shows only whole columns, among them all important ones.
        let narrow = row("booster", &names, &loud, Some(100.0), 71);
        assert!(narrow.chars().count() <= 71 && narrow.ends_with(" 159960 rpm"), "{narrow}");
        let loud = row("booster", &names, &loud, Some(100.0), usize::MAX);
        for cell in
            [" start: ignition… ", " 160010 ", " 1100 °C ", " 160000 rpm ", " 159960 rpm ", " up 100/s "]
        {
            assert!(loud.contains(cell), "{cell}: {loud}");
        }
    }

    #[test]
    fn an_emergency_stop_is_shown_whatever_is_commanded() {
        let engines = engines(&[]).unwrap();
        let node = Node::new(&engines, false);
        let notes = Notes::default();
        let context = EngineContext::new(0, &engines[0], embassy_time::Instant::MIN, &notes);
        let sample = Sample {
            input: PilotInput::Run(Demand::Throttle(Throttle::from_percent(60).unwrap())),
            on_wire: Some(WireCommand::Stop),
            ..Sample::take(&context, &node.telemetry(0), true)
        };
        let row = row("left", &["left"], &sample, Some(8.0), usize::MAX);
        assert!(row.contains("    60.0 %        STOP  "), "{row}");
    }

    #[test]
    fn an_engine_that_still_turns_fast_runs_down() {
        let engines = engines(&[]).unwrap();
        let node = Node::new(&engines, false);
        let notes = Notes::default();
        let context = EngineContext::new(0, &engines[0], embassy_time::Instant::MIN, &notes);
        let stopped =
            Sample { does: EngineState::Stopped, ..Sample::take(&context, &node.telemetry(0), true) };
        for (rpm, text) in [(None, "stopped"), (Some(0), "stopped"), (Some(70_800), "run-down")] {
            assert_eq!(Sample { rpm, ..stopped }.does_text(), text);
        }
        // An AMT ECU has no state for it.
        let cooling = Sample { does: EngineState::Cooling, rpm: Some(8500), ..stopped };
        for (order, text) in [(Order::EmergencyStop, "run-down"), (Order::Standby, "cooling")] {
            assert_eq!(Sample { order, ..cooling }.does_text(), text);
        }
    }

    /// Then no pilot commands: the row shows the node's state of the source.
    #[test]
    fn what_a_ground_station_commands_is_shown() {
        let engines = engines(&[]).unwrap();
        let node = Node::new(&engines, false);
        let notes = Notes::default();
        let context = EngineContext::new(0, &engines[0], embassy_time::Instant::MIN, &notes);
        let mut telemetry = node.telemetry(0);
        let demand = Demand::Throttle(Throttle::from_percent(40).unwrap());
        telemetry.active_source = Origin::Mavlink;
        telemetry.ordered.order = Order::Run(demand);
        telemetry.commanded = Some(demand);
        context.stage.set(Stage::Steps);
        assert_eq!(Sample::take(&context, &telemetry, true).input, PilotInput::Standby);
        context.stage.set(Stage::Commanded);
        let sample = Sample::take(&context, &telemetry, true);
        assert_eq!((sample.input, sample.silent), (PilotInput::Run(demand), false));
        telemetry.loss = LossStage::Hold;
        assert!(Sample::take(&context, &telemetry, true).silent);
        telemetry.ordered.order = Order::Standby;
        assert_eq!(Sample::take(&context, &telemetry, true).input, PilotInput::Standby);
        // Radio control sets the input itself.
        telemetry.active_source = Origin::Rc;
        telemetry.ordered.order = Order::Run(demand);
        assert_eq!(Sample::take(&context, &telemetry, true).input, PilotInput::Standby);
    }
}

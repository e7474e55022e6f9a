//! Lines: one of the two wires cut, and noise.

use super::super::audit::WireCommand;
use super::super::context::Stage;
use super::check::{ON_WIRE, all, is_run, is_standby, only, rises_slowly};
use super::context::{CommandSource, ScenarioContext};
use jetlink::event::Event;
use sim::ecu::{MILLIS, SECOND};
use sim::wire::{Direction, Faults, FramingAs};

pub async fn one_wire_cut(c: &ScenarioContext<'_>) -> Result<(), String> {
    for (direction, what) in [(Direction::ToNode, "wire from the ECU"), (Direction::ToEcu, "wire to the ECU")]
    {
        c.fly(60).await?;
        c.event();
        c.mark(&format!("the {what} is cut"));
        let cut = c.now();
        (0..c.count()).for_each(|i| c.cut_one(i, direction, true));
        c.sleep(10.0).await;
        c.mark("the stick goes to 30 %");
        c.each(|source| source.throttle(30));
        let moved = c.now();
        c.sleep(10.0).await;
        c.mark("standby");
        c.each(CommandSource::standby);
        (0..c.count()).for_each(|i| c.stage(i, Stage::Cooling));
        let standby = c.now();
        c.sleep(10.0).await;
        c.mark("the wire is mended");
        let mended = c.now();
        (0..c.count()).for_each(|i| c.cut_one(i, direction, false));
        c.sleep(10.0).await;
        let end = c.now();
        c.look();
        for i in 0..c.count() {
            let name = c.name(i);
            let in_cut = c.transmitted(i, cut + 300 * MILLIS, standby);
            let answered = c.is_answered(i);
            match (name, direction) {
                (_, Direction::ToNode) if answered => {
                    c.must(
                        c.transmitted(i, cut + ON_WIRE, mended).is_empty(),
                        format!("{name}, {what}: what is not received is not answered"),
                    );
                }
                (_, Direction::ToNode) => {
                    c.must(
                        only(&in_cut, 300, |wire| wire == WireCommand::Nothing),
                        format!("{name}, {what}: in doubt nothing that could start an engine is on the wire"),
                    );
                    c.must(
                        c.phases(i, cut, standby).iter().all(|phase| phase.is_live()),
                        format!("{name}, {what}: the engine runs on until it is shut down"),
                    );
                }
                ("zk5", Direction::ToEcu) => {
                    let moved_in_time = c.transmitted(i, moved + 300 * MILLIS, standby);
                    c.must(
                        all(&c.transmitted(i, cut, moved), WireCommand::Run(600))
                            && all(&moved_in_time, WireCommand::Run(300)),
                        format!("{name}, {what}: its ECU is received, so the demand goes out, 60 % and 30 %"),
                    );
                    c.must(
                        c.events_since(i, moved, |event| event == Event::NotObeyed) >= 1,
                        format!("{name}, {what}: reported that the ECU does not obey"),
                    );
                    c.must(
                        c.phases(i, cut, mended).iter().all(|phase| phase.is_live()),
                        format!("{name}, {what}: its ECU keeps the engine running, whatever is sent (ZK-10)"),
                    );
                }
                // Its ECU itself stops the engine.
                (_, Direction::ToEcu) => {
                    c.must(
                        c.phases(i, cut + 3 * SECOND, mended).iter().all(|phase| !phase.is_live()),
                        format!("{name}, {what}: its ECU stops the engine uncommanded"),
                    );
                    c.must(
                        !c.transmitted(i, cut + 4 * SECOND, end).iter().any(|frame| is_run(frame.command)),
                        format!("{name}, {what}: no run is on the wire for an engine that has stopped"),
                    );
                }
            }
            let received = !answered || direction == Direction::ToEcu;
            let out = c.transmitted(i, standby + 300 * MILLIS, mended);
            c.must(
                !received || all(&out, WireCommand::Standby),
                format!("{name}, {what}: the pilot's standby is on the wire within 0.3 s, and stays"),
            );
            let after = c.transmitted(i, mended, end);
            c.must(
                only(&after, 20, is_standby) && all(&after, WireCommand::Standby),
                format!("{name}, {what}: nothing but standby is on the wire when the wire is mended"),
            );
            c.must(
                c.phases(i, mended + SECOND, end).iter().all(|phase| !phase.is_live()),
                format!("{name}, {what}: the engine is shut down then, and stays so"),
            );
            c.must(c.starts(i, cut, end) == 0, format!("{name}, {what}: nothing has lit it again"));
        }
        for i in 0..c.count() {
            c.cool(i).await?;
        }
    }
    c.shut_down().await
}

pub async fn framing_noise(c: &ScenarioContext<'_>) -> Result<(), String> {
    c.fly(60).await?;
    c.event();
    // Treatment by the UART's driver: embassy's buffered one, and the one with a ring in DMA.
    for (framing, what) in [(FramingAs::Data, "broken bytes as data"), (FramingAs::Error, "as errors")] {
        c.mark(&format!("one in six bytes of the ECUs breaks its frame, {what}"));
        let begin = c.now();
        let noise = Faults { framing_per_million: 160_000, ..Faults::default() };
        (0..c.count()).for_each(|i| c.noise(i, noise, framing));
        c.sleep(2.0).await;
        c.mark("the noise ends");
        (0..c.count()).for_each(|i| c.noise(i, Faults::default(), framing));
        let over = c.now();
        c.sleep(6.0).await;
        let end = c.now();
        c.look();
        for i in 0..c.count() {
            let name = c.name(i);
            if c.is_answered(i) {
                // Six bytes make a set: with broken ones as data nearly all have their length, with errors one in three.
                let least = if framing == FramingAs::Data { 12 } else { 4 };
                let during =
                    c.transmitted(i, begin, over).iter().filter(|frame| is_run(frame.command)).count();
                let replies = c.transmitted(i, begin - SECOND, over + SECOND);
                let pause = replies.windows(2).map(|pair| pair[1].from - pair[0].from).max();
                c.must(
                    during >= least && pause.is_some_and(|pause| pause <= SECOND),
                    format!(
                        "{name}, {what}: damaged sets are answered as before ({during} replies in 2 s, {} apart at most)",
                        c.or_never(pause)
                    ),
                );
            }
            c.must(
                only(&c.transmitted(i, begin, end), 20, |wire| is_run(wire) || wire == WireCommand::Nothing),
                format!("{name}, {what}: no standby, and no stop"),
            );
            c.must(
                all(&c.transmitted(i, over + 2 * SECOND, end), WireCommand::Run(600)),
                format!("{name}, {what}: 60 % is on the wire 2 s after the noise"),
            );
            c.must(
                rises_slowly(&c.transmitted(i, begin, end)),
                format!("{name}, {what}: the demand rises by 50 % a second at most"),
            );
            c.must(c.ran_from(i, begin), format!("{name}, {what}: the engine runs all the time"));
        }
    }
    for i in 0..c.count() {
        let seen = c.node().telemetry(i).counters;
        c.must(
            seen.crc_failures + seen.truncated + seen.bytes_skipped > 0 && seen.framing_errors > 0,
            format!("{}: the node has seen damaged frames and framing errors", c.name(i)),
        );
    }
    c.shut_down().await
}

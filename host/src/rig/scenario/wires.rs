//! Lines: one of the two wires cut, and noise.

use super::super::audit::Said;
use super::super::desk::Stage;
use super::cockpit::{Cockpit, Seat};
use super::{ON_WIRE, all, is_run, is_standby, only};
use jetlink::telemetry::Event;
use sim::ecu::{MILLIS, SECOND};
use sim::wire::{Direction, Faults};

pub async fn one_wire_cut(c: &Cockpit<'_>) -> Result<(), String> {
    for (direction, what) in [(Direction::ToNode, "wire from the ECU"), (Direction::ToEcu, "wire to the ECU")]
    {
        c.fly(60).await?;
        c.event();
        c.mark(&format!("the {what} is cut"));
        let cut = c.now();
        (0..c.count()).for_each(|i| c.cut_one(i, direction, true));
        c.sleep(10.0).await;
        c.mark("the stick goes to 30 %");
        c.each(|seat| seat.throttle(30));
        let moved = c.now();
        c.sleep(10.0).await;
        c.mark("standby");
        c.each(Seat::standby);
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
            let in_cut = c.spoken(i, cut + 300 * MILLIS, standby);
            match (name, direction) {
                ("amt", Direction::ToNode) => {
                    c.must(
                        c.spoken(i, cut + ON_WIRE, mended).is_empty(),
                        format!("{name}, {what}: what is not heard is not answered"),
                    );
                }
                (_, Direction::ToNode) => {
                    c.must(
                        only(&in_cut, 300, |said| said == Said::Nothing),
                        format!("{name}, {what}: in doubt nothing that could start an engine is on the wire"),
                    );
                    c.must(
                        c.phases(i, cut, standby).iter().all(|phase| phase.is_live()),
                        format!("{name}, {what}: the engine runs on until it is shut down"),
                    );
                }
                ("zk5", Direction::ToEcu) => {
                    let moved_in_time = c.spoken(i, moved + 300 * MILLIS, standby);
                    c.must(
                        all(&c.spoken(i, cut, moved), Said::Run(600)) && all(&moved_in_time, Said::Run(300)),
                        format!("{name}, {what}: its ECU is heard, so the demand goes out, 60 % and 30 %"),
                    );
                    c.must(
                        c.events_since(i, moved, |event| event == Event::NotObeyed) >= 1,
                        format!("{name}, {what}: told that the ECU does not obey"),
                    );
                    c.must(
                        c.phases(i, cut, mended).iter().all(|phase| phase.is_live()),
                        format!("{name}, {what}: its ECU keeps the engine running, whatever is said (ZK-10)"),
                    );
                }
                // Its ECU stops the engine by itself.
                (_, Direction::ToEcu) => {
                    c.must(
                        c.phases(i, cut + 3 * SECOND, mended).iter().all(|phase| !phase.is_live()),
                        format!("{name}, {what}: its ECU stops the engine by itself"),
                    );
                    c.must(
                        !c.spoken(i, cut + 4 * SECOND, end).iter().any(|frame| is_run(frame.said)),
                        format!("{name}, {what}: no run is on the wire for an engine that has stopped"),
                    );
                }
            }
            let heard = name != "amt" || direction == Direction::ToEcu;
            let out = c.spoken(i, standby + 300 * MILLIS, mended);
            c.must(
                !heard || all(&out, Said::Standby),
                format!("{name}, {what}: the pilot's standby is on the wire within 0.3 s, and stays"),
            );
            let after = c.spoken(i, mended, end);
            c.must(
                only(&after, 20, is_standby) && all(&after, Said::Standby),
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

pub async fn framing_noise(c: &Cockpit<'_>) -> Result<(), String> {
    c.fly(60).await?;
    c.event();
    c.mark("one in six bytes of the ECUs breaks its frame");
    let begin = c.now();
    let noise = Faults { framing_per_million: 160_000, ..Faults::default() };
    (0..c.count()).for_each(|i| c.noise(i, noise));
    c.sleep(2.0).await;
    c.mark("the noise ends");
    (0..c.count()).for_each(|i| c.noise(i, Faults::default()));
    let over = c.now();
    c.sleep(6.0).await;
    let end = c.now();
    c.look();
    for i in 0..c.count() {
        let name = c.name(i);
        let during = c.spoken(i, begin, over);
        if name == "amt" {
            let answered = during.iter().filter(|frame| is_run(frame.said)).count();
            c.must(
                answered >= 6,
                format!("{name}: damaged sets are answered as before ({answered} replies in 2 s)"),
            );
        }
        c.must(
            only(&c.spoken(i, begin, end), 20, |said| is_run(said) || said == Said::Nothing),
            format!("{name}: no standby, and no stop"),
        );
        c.must(
            all(&c.spoken(i, over + 2 * SECOND, end), Said::Run(600)),
            format!("{name}: 60 % is on the wire 2 s after the noise"),
        );
        c.must(c.ran_from(i, begin), format!("{name}: the engine runs all the time"));
        let errors = c.node().telemetry(i).counters;
        c.must(
            errors.crc_failures + errors.truncated + errors.bytes_skipped + errors.damaged_frames > 0,
            format!("{name}: the node has seen damaged frames"),
        );
    }
    c.shut_down().await
}

//! Attached devices: their settings among the parameters, their messages, their texts.

use super::world::*;
use crate::attached::{Attached, Change, Channels, NodeStreams, Outputs};
use crate::dialect::*;
use crate::ids::{CMD_REQUEST_MESSAGE, CMD_SET_MESSAGE_INTERVAL};
#[cfg(feature = "signing")]
use crate::port::PortConfig;
use crate::record;
use crate::refusal::Refusal;
use crate::retained_settings::{AttachedDefaults, Defaults, fingerprint};
use crate::service::ParameterStorage;
use crate::service::parameters::engine_parameters;
use crate::settings::NodeSettings;
use crate::store::NotSaved;
use embassy_time::Instant;
use jetlink::setting::{Effect, Row, Unit};
use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::rc::Rc;
use std::string::{String, ToString};
use std::vec::Vec;

const fn row(name: &'static str, effect: Effect) -> Row {
    Row::new(name, Unit::Number, [0, 100], true, effect)
}

const ROWS: &[&[Row]] =
    &[&[row("TOY_A", Effect::AtOnce), row("TOY_B", Effect::AtOnce)], &[row("TOY_C", Effect::AtNextStart)]];

/// State that a test reads and changes.
#[derive(Debug, Default)]
pub struct State {
    pub on: Cell<bool>,
    numbers: RefCell<[[i32; 3]; 2]>,
    refuses: Cell<bool>,
    damaged: Cell<bool>,
    outputs: Cell<[Outputs; 2]>,
    changes: RefCell<VecDeque<Change>>,
    channels: Cell<Option<Channels>>,
    /// Link quality of the receiver.
    quality: Cell<Option<u8>>,
}

/// Two tables of settings for each engine, outputs and a receiver.
#[derive(Clone, Debug, Default)]
pub struct Toy(pub Rc<State>);

impl Toy {
    fn place(name: &str) -> Option<usize> {
        ROWS.iter().copied().flatten().position(|row| row.name == name)
    }
}

impl Attached for Toy {
    type Streams = NodeStreams;

    fn rows(&self) -> &'static [&'static [Row]] {
        if self.0.on.get() { ROWS } else { &[] }
    }

    fn number(&self, engine: usize, name: &str) -> Option<i32> {
        let place = Self::place(name).filter(|_| self.0.on.get())?;
        Some(self.0.numbers.borrow()[engine][place])
    }

    fn set(&mut self, engine: usize, name: &str, number: i32) -> Result<(), Refusal> {
        if self.0.refuses.get() {
            return Err(Refusal::Turns);
        }
        if number == 99 {
            return Err(Refusal::Malformed("not 99"));
        }
        self.0.numbers.borrow_mut()[engine][Self::place(name).unwrap()] = number;
        Ok(())
    }

    fn calibrate(&mut self, engine: usize, begin: bool) -> Result<(), Refusal> {
        match (self.0.on.get(), self.0.refuses.get(), begin) {
            (false, ..) => Err(Refusal::NoReceiver),
            (true, true, _) => Err(Refusal::Turns),
            (true, false, true) => Ok(()),
            (true, false, false) => {
                self.0.numbers.borrow_mut()[engine][1..].copy_from_slice(&[11, 19]);
                Ok(())
            }
        }
    }

    fn calibrated(&self) -> [&'static str; 2] {
        ["TOY_B", "TOY_C"]
    }

    fn set_damaged(&mut self, damaged: bool) {
        self.0.damaged.set(damaged);
    }

    fn has_outputs(&self) -> bool {
        self.0.on.get()
    }

    fn outputs(&self, engine: usize) -> Outputs {
        self.0.outputs.get()[engine]
    }

    fn next_change(&mut self) -> Option<Change> {
        self.0.changes.borrow_mut().pop_front()
    }

    fn channels(&self, _: Instant) -> Option<Channels> {
        self.0.channels.get()
    }

    fn link_quality(&self, _: Instant) -> Option<u8> {
        self.0.quality.get()
    }
}

/// Messages of this kind from the node on a port since frame `at`.
fn sent<T>(world: &World<'_>, at: usize, port: usize, what: impl Fn(&MavMessage) -> Option<T>) -> Vec<T> {
    let frames = world.frames.borrow();
    let of_node = frames.iter().skip(at).filter(|(_, on, frame)| *on == port && frame.from.component == NODE);
    of_node.filter_map(|(_, _, frame)| what(&frame.message())).collect()
}

fn relays(message: &MavMessage) -> Option<(u16, u16)> {
    match message {
        MavMessage::RELAY_STATUS(relays) => Some((relays.on, relays.present)),
        _ => None,
    }
}

fn channels(message: &MavMessage) -> Option<RC_CHANNELS_DATA> {
    match message {
        MavMessage::RC_CHANNELS(channels) => Some(channels.clone()),
        _ => None,
    }
}

#[test]
fn settings_of_what_is_attached_follow_those_of_the_engine() {
    run(async |world| {
        world.ready().await;
        let own: Vec<usize> = world
            .service
            .borrow()
            .engine_settings()
            .map(|(config, _)| engine_parameters(config).count())
            .collect();
        for (on, more) in [(false, 0), (true, 3)] {
            world.toy.on.set(on);
            let at = world.frames.borrow().len();
            let request = PARAM_REQUEST_LIST_DATA { target_system: SYSTEM, target_component: ENGINE[1] };
            world.say(TO_GROUND, GROUND, &request);
            world.pass_s(5.0).await;
            let frames = world.frames.borrow();
            let values = frames.iter().skip(at).filter(|(_, port, _)| *port == TO_GROUND);
            let values = values.filter_map(|(_, _, frame)| match frame.message() {
                MavMessage::PARAM_VALUE(value) => Some(value),
                _ => None,
            });
            let values: Vec<_> = values.collect();
            assert_eq!(values.len(), own[1] + more);
            assert!(values.iter().all(|value| usize::from(value.param_count) == own[1] + more));
            let names: Vec<String> =
                values[own[1]..].iter().map(|value| value.param_id.to_str().unwrap().to_string()).collect();
            assert_eq!(names, &["TOY_A", "TOY_B", "TOY_C"][..more]);
        }
    });
}

#[test]
fn settings_of_what_is_attached_are_set_refused_and_stored_as_records_of_their_own() {
    run(async |world| {
        world.ready().await;
        assert_eq!(world.set(ENGINE[1], "TOY_A", 5.0).await.0, None, "nothing is attached");
        world.toy.on.set(true);
        assert_eq!(world.set(ENGINE[1], "TOY_A", 5.0).await, (Some(5.0), String::new()));
        assert_eq!(*world.toy.numbers.borrow(), [[0; 3], [5, 0, 0]]);
        let (echo, text) = world.set(ENGINE[1], "TOY_C", 7.0).await;
        assert!(echo == Some(7.0) && text.contains("TOY_C takes effect at the node's next start"), "{text}");
        for (value, why) in [(101.0, "use 0 to 100, or -1"), (99.0, "not 99"), (0.5, "whole number")] {
            let (echo, text) = world.set(ENGINE[1], "TOY_A", value).await;
            assert!(echo == Some(5.0) && text.contains(why), "{text}");
        }
        world.toy.refuses.set(true);
        let (echo, text) = world.set(ENGINE[1], "TOY_A", 6.0).await;
        assert!(echo == Some(5.0) && text.contains("an engine turns"), "{text}");
        world.toy.refuses.set(false);

        world.service.borrow_mut().set_parameter_storage(ParameterStorage::Stored);
        // Node, engines, what is attached to each, and signing.
        assert_eq!(world.service.borrow().places(), 5 + usize::from(cfg!(feature = "signing")));
        for (result, value) in [(Ok(()), 8), (Err(NotSaved::Full), 8)] {
            let new = if result.is_ok() { 8.0 } else { 9.0 };
            assert_eq!(world.set(ENGINE[1], "TOY_B", new).await, (None, String::new()));
            let (key, stored) = world.service.borrow_mut().next_save().unwrap();
            assert_eq!(record::engine_of_attached(key), Some(1));
            let read: Vec<_> = record::read_attached(ROWS, &stored).collect();
            assert_eq!(read, [("TOY_A", 5), ("TOY_B", new as i32), ("TOY_C", 7)]);
            let at = world.frames.borrow().len();
            world.service.borrow_mut().saved(Instant::now(), result);
            world.pass_s(0.2).await;
            assert_eq!(world.answers(at).0, Some(value as f32));
            assert_eq!(world.toy.numbers.borrow()[1], [5, value, 7]);
        }
        // An engine's own record contains none of them, and theirs has a kind of its own.
        let service = world.service.borrow();
        let keys: Vec<u8> = (0..6).filter_map(|place| service.record(place)).map(|(key, _)| key).collect();
        let signing = [0x80].into_iter().filter(|_| cfg!(feature = "signing"));
        assert_eq!(keys, [0, 1, 2, 0x81, 0x82].into_iter().chain(signing).collect::<Vec<u8>>());
        let (_, of_engine) = service.record(2).unwrap();
        assert_eq!(record::read_attached(ROWS, &of_engine).count(), 0);
    });
}

/// RAM that survives a reset has space for some changes, but not for all settings of every engine.
#[test]
fn of_what_is_attached_too_only_what_differs_from_the_image_is_retained() {
    run(async |world| {
        world.ready().await;
        world.toy.on.set(true);
        let engines: Vec<_> = world.service.borrow().engine_settings().map(|(config, _)| *config).collect();
        let of_image = |number| {
            let attached = AttachedDefaults { rows: ROWS, number };
            let node = &NodeSettings::DEFAULT;
            Defaults { node, engines: &engines, own: &[], wiring: &[], attached, room: 64 }
        };
        let zero = of_image(|_, _| Some(0));
        let attached = || -> Vec<_> {
            let service = world.service.borrow();
            service.changes(&zero).filter(|(key, _)| record::engine_of_attached(*key).is_some()).collect()
        };
        assert!(attached().iter().all(|(_, record)| record.len() == 1), "nothing but the kind");
        assert_eq!(world.set(ENGINE[1], "TOY_B", 5.0).await.0, Some(5.0));
        let lengths: Vec<_> = attached().iter().map(|(key, record)| (*key, record.len())).collect();
        assert_eq!(lengths, [(0x81, 1), (0x82, 1 + 6)]);
        let read: Vec<_> = record::read_attached(ROWS, &attached()[1].1).collect();
        assert_eq!(read, [("TOY_B", 5)]);
        // The stored record is complete, so that it does not change with the image. In another image the changes differ.
        let (_, stored) = world.service.borrow().record(4).unwrap();
        assert_eq!(record::read_attached(ROWS, &stored).count(), 3);
        let other = of_image(|engine, name| Some(i32::from(engine == 1 && name == "TOY_C")));
        assert_ne!(fingerprint(&zero), fingerprint(&other));
    });
}

/// Its end points are settings: stored, then answered as such; restored if the store does not accept them.
#[test]
fn a_calibration_of_the_stick_sets_its_end_points() {
    const BEGIN: [f32; 1] = [40.0];
    const END: [f32; 1] = [41.0];
    run(async |world| {
        world.ready().await;
        let (answer, text) = world.command(ENGINE[1], 31010, &BEGIN).await;
        assert!(answer == Some(1) && text.contains("no receiver"), "{answer:?} {text}");
        world.toy.on.set(true);
        let (answer, text) = world.command(NODE, 31010, &BEGIN).await;
        assert!(answer == Some(2) && text.contains("component of an engine"), "{answer:?} {text}");
        world.toy.refuses.set(true);
        for command in [BEGIN, END] {
            let (answer, text) = world.command(ENGINE[1], 31010, &command).await;
            assert!(answer == Some(1) && text.contains("an engine turns"), "{answer:?} {text}");
        }
        world.toy.refuses.set(false);
        assert_eq!(world.command(ENGINE[1], 31010, &BEGIN).await.0, Some(0));
        assert_eq!(*world.toy.numbers.borrow(), [[0; 3]; 2]);
        let at = world.frames.borrow().len();
        assert_eq!(world.command(ENGINE[1], 31010, &END).await.0, Some(0));
        let values = |at| {
            let frames = world.frames.borrow();
            let frames = frames.iter().skip(at).filter(|(_, port, _)| *port == TO_GROUND);
            let values = frames.filter_map(|(_, _, frame)| match frame.message() {
                MavMessage::PARAM_VALUE(value) => {
                    Some((value.param_id.to_str().unwrap().to_string(), value.param_value))
                }
                _ => None,
            });
            values.collect::<Vec<_>>()
        };
        assert_eq!(values(at), [("TOY_B".to_string(), 11.0), ("TOY_C".to_string(), 19.0)]);

        // Both are in one record: they are stored together, or not at all.
        *world.toy.numbers.borrow_mut() = [[0, 1, 2]; 2];
        world.service.borrow_mut().set_parameter_storage(ParameterStorage::Stored);
        for (result, [low, high]) in [(Err(NotSaved::Full), [1_u16, 2]), (Ok(()), [11, 19])] {
            let at = world.frames.borrow().len();
            assert_eq!(world.command(ENGINE[1], 31010, &END).await.0, Some(0));
            assert_eq!(values(at), [], "not before they are stored");
            assert!(world.service.borrow_mut().next_save().is_some());
            world.service.borrow_mut().saved(Instant::now(), result);
            world.pass_s(0.2).await;
            assert_eq!(values(at), [("TOY_B".to_string(), low.into()), ("TOY_C".to_string(), high.into())]);
            assert_eq!(*world.toy.numbers.borrow(), [[0, 1, 2], [0, low.into(), high.into()]]);
            assert!(world.service.borrow_mut().next_save().is_none());
        }
    });
}

/// Where nothing is stored, end points that RAM cannot retain are refused as any setting is.
#[test]
fn a_calibration_that_ram_cannot_retain_is_refused_where_nothing_is_stored() {
    const DEFAULTS: Defaults<'static> = Defaults {
        node: &NodeSettings::DEFAULT,
        engines: &[],
        own: &[],
        wiring: &[],
        attached: AttachedDefaults { rows: ROWS, number: |_, _| Some(0) },
        room: 0,
    };
    run(async |world| {
        world.ready().await;
        world.toy.on.set(true);
        let calibrated = async |room: usize| {
            *world.toy.numbers.borrow_mut() = [[0; 3]; 2];
            world.leave_room(ParameterStorage::Lost, DEFAULTS, room);
            assert_eq!(world.command(ENGINE[1], 31010, &[40.0]).await.0, Some(0));
            let (answer, text) = world.command(ENGINE[1], 31010, &[41.0]).await;
            (answer, text, world.toy.numbers.borrow()[1])
        };
        let (answer, text, numbers) = calibrated(0).await;
        assert!(answer == Some(1) && text.contains("RAM retains no more changes"), "{answer:?} {text}");
        assert_eq!(numbers, [0; 3]);
        let (answer, text, numbers) = calibrated(40).await;
        assert!(answer == Some(0) && text.contains("is not stored"), "{answer:?} {text}");
        assert_eq!(numbers, [0, 11, 19]);
    });
}

#[cfg(feature = "signing")]
#[test]
fn damaged_settings_are_known_to_what_is_attached_until_they_are_confirmed() {
    run_signed(NodeSettings::DEFAULT, no_key(), PortConfig::usb(), async |world| {
        world.ready().await;
        world.service.borrow_mut().set_damaged(true);
        assert!(world.toy.damaged.get());
        let (answer, text) = world.command(NODE, 31010, &[30.0, 21196.0]).await;
        assert_eq!(answer, Some(0), "{text}");
        assert!(world.toy.damaged.get() && world.service.borrow_mut().take_rewrite());
        world.service.borrow_mut().rewritten(Instant::now(), Ok(()));
        assert!(!world.toy.damaged.get());
        // Settings retained in RAM are as good as intact ones.
        world.service.borrow_mut().set_retained();
        assert!(!world.toy.damaged.get());
    });
}

#[test]
fn relays_are_reported_each_second_and_when_one_changes() {
    run(async |world| {
        world.ready().await;
        let at = world.frames.borrow().len();
        world.pass_s(5.0).await;
        assert_eq!(sent(world, at, TO_GROUND, relays).len(), 0, "there are none");
        world.toy.on.set(true);
        let left = Outputs { valve: Some(false), power: Some(true) };
        world.toy.outputs.set([left, Outputs { valve: Some(true), power: None }]);
        let at = world.frames.borrow().len();
        world.pass_s(5.0).await;
        for port in [TO_AUTOPILOT, TO_GROUND] {
            let sent = sent(world, at, port, relays);
            assert!(
                (4..=6).contains(&sent.len()) && sent.iter().all(|sent| *sent == (0b0110, 0b0111)),
                "{sent:?}"
            );
        }
        // A change: at once, and with its reason.
        world.toy.outputs.set([Outputs { valve: Some(true), ..left }, Outputs::default()]);
        let change = Change { engine: 0, what: "fuel valve open", why: "a test", alarming: false };
        let at = world.frames.borrow().len();
        world.toy.changes.borrow_mut().push_back(change);
        world.pass_s(0.2).await;
        assert_eq!(sent(world, at, TO_GROUND, relays).first(), Some(&(0b0011, 0b0011)));
        assert!(world.texts().contains("left: fuel valve open: a test"), "{}", world.texts());
        // Another rate, and one on request.
        let (answer, _) = world.command(NODE, CMD_SET_MESSAGE_INTERVAL, &[376.0, -1.0]).await;
        let at = world.frames.borrow().len();
        world.pass_s(5.0).await;
        assert_eq!((answer, sent(world, at, TO_GROUND, relays).len()), (Some(0), 0));
        assert_eq!(world.command(NODE, CMD_REQUEST_MESSAGE, &[376.0]).await.0, Some(0));
        assert_eq!(sent(world, at, TO_GROUND, relays).len(), 1);
    });
}

/// Without a request, they would overwrite a ground station's display of the autopilot's receiver.
#[test]
fn channels_are_sent_on_request_only() {
    run(async |world| {
        world.ready().await;
        let at = world.frames.borrow().len();
        assert_eq!(
            world.command(NODE, CMD_REQUEST_MESSAGE, &[65.0]).await.0,
            Some(3),
            "there is no receiver"
        );
        let mut pulses = [None; 18];
        (pulses[0], pulses[2], pulses[4]) = (Some(1500), Some(1100), Some(2000));
        world.toy.channels.set(Some(pulses));
        world.pass_s(10.0).await;
        assert_eq!(
            sent(world, at, TO_GROUND, channels).len() + sent(world, at, TO_AUTOPILOT, channels).len(),
            0
        );
        assert_eq!(world.command(NODE, CMD_REQUEST_MESSAGE, &[65.0]).await.0, Some(0));
        let one = sent(world, at, TO_GROUND, channels);
        assert_eq!(one.len(), 1);
        assert_eq!((one[0].chan1_raw, one[0].chan2_raw, one[0].chan3_raw), (1500, u16::MAX, 1100));
        assert_eq!((one[0].chan5_raw, one[0].chan18_raw), (2000, u16::MAX));
        assert_eq!((one[0].chancount, one[0].rssi), (5, u8::MAX));
        for (percent, rssi) in [(0, 0), (50, 127), (100, 254), (255, 254)] {
            world.toy.quality.set(Some(percent));
            let at = world.frames.borrow().len();
            assert_eq!(world.command(NODE, CMD_REQUEST_MESSAGE, &[65.0]).await.0, Some(0));
            assert_eq!(sent(world, at, TO_GROUND, channels)[0].rssi, rssi, "{percent} %");
        }
        // On the requesting port, at the requested rate.
        assert_eq!(world.command(NODE, CMD_SET_MESSAGE_INTERVAL, &[65.0, 200_000.0]).await.0, Some(0));
        let at = world.frames.borrow().len();
        world.pass_s(10.0).await;
        let count = sent(world, at, TO_GROUND, channels).len();
        assert!((45..=51).contains(&count), "{count}");
        assert_eq!(sent(world, at, TO_AUTOPILOT, channels).len(), 0);
        assert_eq!(
            world.command(ENGINE[0], CMD_REQUEST_MESSAGE, &[65.0]).await.0,
            Some(3),
            "not of an engine"
        );
    });
}

//! Settings in RAM that survives a reset, for a node that then finds its stored settings damaged. Only those that differ from the image's.

use crate::record::{Record, of_attached, of_engine, of_node};
use crate::settings::{EngineSettings, NodeSettings};
use core::sync::atomic::{AtomicU8, Ordering};
use heapless::Vec;
use jetlink::checksum::Checksum;
use jetlink::config::EngineConfig;
use jetlink::setting::Row;
use jetlink::wiring::Wiring;

/// Length of the checksum in front.
const HEAD: usize = 4;

/// Default settings of an image.
#[derive(Clone, Copy, Debug)]
pub struct Defaults<'a> {
    /// Defaults of the node.
    pub node: &'a NodeSettings,
    /// Defaults of the engines.
    pub engines: &'a [EngineConfig],
    /// Defaults of their MAVLink; [`EngineSettings::DEFAULT`] where there are none.
    pub own: &'a [EngineSettings],
    /// Wiring of the engines.
    pub wiring: &'a [Wiring],
    /// Defaults of the attached devices.
    pub attached: AttachedDefaults,
    /// Bytes of the memory that retains settings that differ.
    pub room: usize,
}

/// Default settings of an image for attached devices.
#[derive(Clone, Copy, Debug)]
pub struct AttachedDefaults {
    /// Its tables of settings.
    pub rows: &'static [&'static [Row]],
    /// The value of a name, for an engine from 0.
    pub number: fn(usize, &str) -> Option<i32>,
}

impl AttachedDefaults {
    /// Nothing is attached.
    pub const NONE: Self = Self { rows: &[], number: |_, _| None };
}

impl<'a> Defaults<'a> {
    /// The defaults of an engine.
    pub(crate) fn of_engine(&self, engine: usize) -> Option<(&'a EngineConfig, &'a EngineSettings)> {
        Some((self.engines.get(engine)?, self.own.get(engine).unwrap_or(&EngineSettings::DEFAULT)))
    }
}

/// These defaults as a number: the retained changes fit only this image.
#[inline(never)]
pub fn fingerprint(defaults: &Defaults<'_>) -> u32 {
    let node = Checksum::new().bytes(&of_node(defaults.node, None, &[], &[]));
    let AttachedDefaults { rows, number } = defaults.attached;
    let mut engines = node;
    for engine in 0..defaults.engines.len() {
        if let Some((config, own)) = defaults.of_engine(engine) {
            engines = engines.bytes(&of_engine(config, own, None, None));
        }
        if !rows.is_empty() {
            engines = engines.bytes(&of_attached(rows, &|name| number(engine, name)));
        }
    }
    defaults.wiring.iter().fold(engines, |sum, wiring| sum.words(&[wiring.packed()])).value()
}

/// Whether these records fit a memory of this size, in bytes.
pub(crate) fn fit(records: impl Iterator<Item = (u8, Record)>, bytes: usize) -> bool {
    // The first byte of a record is the kind.
    let lengths = records.map(|(_, record)| record.len()).filter(|length| *length >= 2);
    lengths.fold(HEAD, |sum, length| sum.saturating_add(2 + length)) <= bytes
}

/// The memory: checksum, then each record after its key and its length. Any content is valid, so start-up need not initialise it; random
/// contents after a power-up have no correct checksum. If the changes do not fit, it holds none.
#[derive(Debug)]
#[repr(C, align(8))]
pub struct SettingsMemory<const BYTES: usize> {
    bytes: [AtomicU8; BYTES],
}

impl<const BYTES: usize> Default for SettingsMemory<BYTES> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const BYTES: usize> SettingsMemory<BYTES> {
    /// Empty.
    pub const fn new() -> Self {
        Self { bytes: [const { AtomicU8::new(0) }; BYTES] }
    }

    /// Stores these records, and no others. A reset meanwhile leaves none: a mixture of old and new records has no correct checksum. False:
    /// they do not fit, and none are stored ([`crate::service::Service::set_room`]).
    pub fn store(&self, fingerprint: u32, records: impl Iterator<Item = (u8, Record)>) -> bool {
        let mut content = Vec::<u8, BYTES>::new();
        let mut fits = content.extend_from_slice(&[0; HEAD]).is_ok();
        for (key, record) in records {
            // The first byte is the kind.
            if let Ok(length @ 2..) = u8::try_from(record.len()) {
                fits &= content.extend_from_slice(&[key, length]).is_ok();
                fits &= content.extend_from_slice(&record).is_ok();
            }
        }
        let _ = content.resize(BYTES, 0);
        let sum = checksum(fingerprint, &content);
        let sum = if fits { sum } else { !sum };
        content.iter_mut().zip(sum.to_le_bytes()).for_each(|(to, byte)| *to = byte);
        // Twice: an STM32H7 loses the last 64 bits written (AN5342).
        for _ in 0..2 {
            self.bytes.iter().zip(&content).for_each(|(slot, byte)| slot.store(*byte, Ordering::SeqCst));
        }
        fits
    }

    fn content(&self) -> [u8; BYTES] {
        self.bytes.each_ref().map(|byte| byte.load(Ordering::SeqCst))
    }

    /// Passes each record to `each`. False, and no records: they are not intact, or from another image.
    pub fn load(&self, fingerprint: u32, each: &mut dyn FnMut(u8, &[u8])) -> bool {
        let content = self.content();
        let Some((head, mut rest)) = content.split_first_chunk::<HEAD>() else { return false };
        if *head != checksum(fingerprint, &content).to_le_bytes() {
            return false;
        }
        while let [key, length, records @ ..] = rest {
            let Some((record, others)) = records.split_at_checked((*length).into()).filter(|_| *length > 0)
            else {
                break;
            };
            each(*key, record);
            rest = others;
        }
        true
    }
}

fn checksum(fingerprint: u32, content: &[u8]) -> u32 {
    Checksum::new().words(&[fingerprint]).bytes(content.get(HEAD..).unwrap_or_default()).value()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{apply_to_engine, apply_to_node};
    use jetlink::ecu::zk::codec::Rate;
    use jetlink::line::Line;

    const ENGINES: [EngineConfig; 2] = [
        EngineConfig::amt("left", 0, Line::new(9600), None),
        EngineConfig::zk("right", 1, Line::new(9600), Rate::Hz20),
    ];

    /// A user's settings: of the node, and of the second engine.
    fn changed(output: u8) -> (NodeSettings, EngineConfig, EngineSettings) {
        let mut node = NodeSettings::DEFAULT;
        assert!(node.set("MAV_SYSID_LEARN", 7) && node.set("MAV_GCS_2", 250));
        let mut config = ENGINES[1];
        assert!(config.change_parameter("LOSS_HOLD", 500));
        (node, config, EngineSettings { output, reversed: true, ..EngineSettings::DEFAULT })
    }

    const fn defaults(engines: &[EngineConfig]) -> Defaults<'_> {
        Defaults {
            node: &NodeSettings::DEFAULT,
            engines,
            own: &[],
            wiring: &[],
            attached: AttachedDefaults::NONE,
            room: 64,
        }
    }

    fn store<const BYTES: usize>(memory: &SettingsMemory<BYTES>, output: u8) -> bool {
        let own = &EngineSettings::DEFAULT;
        let (node, config, settings) = changed(output);
        let records = [
            (0, of_node(&node, Some(&NodeSettings::DEFAULT), &[], &[])),
            (1, of_engine(&ENGINES[0], own, None, Some((&ENGINES[0], own)))),
            (2, of_engine(&config, &settings, None, Some((&ENGINES[1], own)))),
        ];
        // Only settings that differ, after the kind.
        assert_eq!(records.each_ref().map(|(_, record)| record.len()), [1 + 2 * 6, 1, 1 + 3 * 6]);
        let fits = fit(records.clone().into_iter(), BYTES);
        assert_eq!(memory.store(fingerprint(&defaults(&ENGINES)), records.into_iter()), fits);
        fits
    }

    /// The settings with which a node with this memory starts; `None`: the memory has none.
    fn found<const BYTES: usize>(
        memory: &SettingsMemory<BYTES>,
        engines: &[EngineConfig],
    ) -> Option<(NodeSettings, EngineConfig, EngineSettings)> {
        let (mut node, mut config, mut own) = (NodeSettings::DEFAULT, ENGINES[1], EngineSettings::DEFAULT);
        let mut each = |key, record: &[u8]| match key {
            0 => apply_to_node(&mut node, &mut [], record),
            2 => assert_eq!(apply_to_engine(&mut config, &mut own, record), None),
            _ => panic!("the first engine has no changes"),
        };
        memory.load(fingerprint(&defaults(engines)), &mut each).then_some((node, config, own))
    }

    #[test]
    fn what_differs_from_the_image_comes_back_and_to_no_other_image() {
        let memory = SettingsMemory::<64>::new();
        assert_eq!(found(&memory, &ENGINES), None, "empty");
        store(&memory, 9);
        assert_eq!(found(&memory, &ENGINES), Some(changed(9)));
        let mut other = ENGINES;
        assert!(other[0].change_parameter("LOSS_HOLD", 2000));
        assert_eq!(found(&memory, &other), None);
        store(&memory, 10);
        assert_eq!(found(&memory, &ENGINES), Some(changed(10)));
    }

    #[test]
    fn changes_that_do_not_fit_are_refused_and_the_earlier_ones_are_dropped() {
        // The records of the node and of an engine have a key and a length each: 15 and 21 bytes.
        let (just, less) = (SettingsMemory::<{ HEAD + 36 }>::new(), SettingsMemory::<{ HEAD + 35 }>::new());
        assert!(store(&just, 9) && !store(&less, 9));
        assert_eq!((found(&just, &ENGINES), found(&less, &ENGINES)), (Some(changed(9)), None));
        let memory = SettingsMemory::<64>::new();
        store(&memory, 9);
        let whole = of_engine(&ENGINES[0], &EngineSettings::DEFAULT, None, None);
        assert!(!memory.store(fingerprint(&defaults(&ENGINES)), [(1, whole)].into_iter()));
        assert_eq!(found(&memory, &ENGINES), None, "the earlier ones no longer apply");
    }

    #[test]
    fn neither_a_partial_write_nor_random_memory_is_taken_for_settings() {
        let (before, after) = (SettingsMemory::<64>::new(), SettingsMemory::<64>::new());
        store(&before, 9);
        store(&after, 10);
        let mut lost = 0;
        for cut in 0..=64 {
            let memory = SettingsMemory::<64>::new();
            let mixed = after.content().into_iter().take(cut).chain(before.content().into_iter().skip(cut));
            memory.bytes.iter().zip(mixed).for_each(|(slot, byte)| slot.store(byte, Ordering::Relaxed));
            let found = found(&memory, &ENGINES);
            lost += usize::from(found.is_none());
            assert!(found.is_none_or(|found| found == changed(9) || found == changed(10)), "{cut}");
        }
        assert!(lost > 10, "{lost}");
        for bit in 0..64 * 8 {
            before.bytes[bit / 8].fetch_xor(1 << (bit % 8), Ordering::Relaxed);
            assert_eq!(found(&before, &ENGINES), None, "bit {bit}");
            before.bytes[bit / 8].fetch_xor(1 << (bit % 8), Ordering::Relaxed);
        }
        fastrand::seed(1);
        for _ in 0..10_000 {
            let fill = fastrand::u8(..);
            for byte in &after.bytes {
                byte.store(if fastrand::bool() { fill } else { fastrand::u8(..) }, Ordering::Relaxed);
            }
            assert_eq!(found(&after, &ENGINES), None);
        }
        for fill in [0, 0xFF, 0xAA] {
            after.bytes.iter().for_each(|byte| byte.store(fill, Ordering::Relaxed));
            assert_eq!(found(&after, &ENGINES), None);
        }
    }
}

//! Records of settings, as stored: the settings of one component by their names, so that another firmware's table may differ.

use crate::settings::{EngineSettings, NodeSettings, Table, find_row};
#[cfg(feature = "signing")]
use crate::signing::{Key, SigningState, Stamp};
use crate::store::RECORD;
use heapless::Vec;
use jetlink::checksum::Checksum;
use jetlink::config::EngineConfig;
use jetlink::setting::Row;
use jetlink::wiring::Wiring;

/// A record.
pub type Record = Vec<u8, RECORD>;

/// Digest of a name. A test checks that all names of a component have different ones.
pub(crate) fn hash(name: &str) -> u16 {
    Checksum::new().bytes(name.as_bytes()).value() as u16
}

/// First byte of a record: what it contains. This is the node.
const NODE: u8 = 0;
/// First byte for the attached devices. The protocols of ECUs have the numbers between.
const ATTACHED: u8 = 0xFF;

/// Key of the record of attached devices, for the first engine; the engines' own keys are from 1 on.
const FIRST_ATTACHED: u8 = 0x81;

/// Key of the record of attached devices, for an engine from 0.
pub(crate) fn attached_key(engine: usize) -> Option<u8> {
    u8::try_from(engine).ok()?.checked_add(FIRST_ATTACHED)
}

/// The engine, from 0, whose attached settings are in the record of this key.
pub fn engine_of_attached(key: u8) -> Option<usize> {
    key.checked_sub(FIRST_ATTACHED).map(usize::from)
}

/// Key of the record of signing, between those of the engines and of attached devices. An image without signing ignores it.
#[cfg(feature = "signing")]
pub(crate) const SIGNING_KEY: u8 = 0x80;
/// First byte of the record of signing.
#[cfg(feature = "signing")]
const SIGNING: u8 = 0xFE;

/// The record of a key, or of none, and a time stamp.
#[cfg(feature = "signing")]
pub(crate) fn of_signing(key: Option<&Key>, stamp: Stamp) -> Record {
    let mut record = Record::new();
    // There is space.
    let _ = record.push(SIGNING);
    let _ = record.extend_from_slice(&key.map_or([0; 32], Key::bytes));
    let _ = record.extend_from_slice(&stamp.get().to_le_bytes());
    record
}

/// Takes key and time stamp from a record, if it is the one of signing.
#[cfg(feature = "signing")]
pub fn read_signing(key: u8, record: &[u8]) -> Option<SigningState> {
    let (&kind, content) = record.split_first().filter(|_| key == SIGNING_KEY)?;
    let (bytes, stamp) = content.split_first_chunk().filter(|_| kind == SIGNING)?;
    let stamp = Stamp::new(u64::from_le_bytes(stamp.try_into().ok()?))?;
    Some(SigningState::new(Key::new(*bytes), stamp))
}

/// An engine's record fits one with the same kind of ECU.
fn kind(config: &EngineConfig) -> u8 {
    config.ecu.protocol_number()
}

/// Digest of the wiring of an engine, from 0, in the record of the node: one number holds all of it, to save space.
pub(crate) fn hash_of_wiring(engine: usize) -> u16 {
    Checksum::new().bytes(b"wiring").words(&[engine as u32]).value() as u16
}

fn push(record: &mut Record, hash: u16, value: i32) {
    // There is space for 40 and the kind: a test checks it.
    let _ = record.extend_from_slice(&hash.to_le_bytes());
    let _ = record.extend_from_slice(&value.to_le_bytes());
}

fn write(kind: u8, table: Table<'_>, value: &dyn Fn(&str) -> Option<i32>) -> Record {
    let mut record = Record::new();
    // There is space.
    let _ = record.push(kind);
    find_row(table, &mut |row| {
        if let Some(value) = value(row.name) {
            push(&mut record, hash(row.name), value);
        }
        false
    });
    record
}

/// Digests and values of a record of this kind.
fn values(kind: u8, record: &[u8]) -> impl Iterator<Item = (u16, i32)> {
    let values = match record.split_first() {
        Some((&found, values)) if found == kind => values,
        _ => &[],
    };
    let (values, _) = values.as_chunks();
    values
        .iter()
        .map(|&[h0, h1, v0, v1, v2, v3]| (u16::from_le_bytes([h0, h1]), i32::from_le_bytes([v0, v1, v2, v3])))
}

/// The values of a record that fit the rows. Values that are unknown or out of range now are left out.
fn read(kind: u8, record: &[u8], table: Table<'_>) -> impl Iterator<Item = (&'static str, i32)> {
    values(kind, record).filter_map(move |(of, value)| {
        let row = find_row(table, &mut |row| hash(row.name) == of)?;
        row.allows(value).then_some((row.name, value))
    })
}

/// The record of the node; with a default, what differs from it. Of the engines' wiring, always what differs from the image's: where nobody has
/// set it, another image uses its own.
pub(crate) fn of_node(
    settings: &NodeSettings,
    default: Option<&NodeSettings>,
    wiring: &[Wiring],
    image: &[Wiring],
) -> Record {
    let mut record = write(NODE, Table::Node, &|name| {
        let value = settings.number(name);
        value.filter(|_| default.is_none_or(|default| default.number(name) != value))
    });
    for (engine, (wiring, image)) in wiring.iter().zip(image).enumerate() {
        if wiring != image {
            push(&mut record, hash_of_wiring(engine), wiring.packed() as i32);
        }
    }
    record
}

/// The record of an engine; with a default, what differs from it. What is not used stays stored.
pub(crate) fn of_engine(
    config: &EngineConfig,
    settings: &EngineSettings,
    not_used: Option<NotUsed>,
    default: Option<(&EngineConfig, &EngineSettings)>,
) -> Record {
    write(kind(config), Table::Engine(config), &|name| {
        let of = |config: &EngineConfig, own: &EngineSettings| {
            config.parameter(name).or_else(|| own.own::<false>(name))
        };
        let not_used = not_used.filter(|not_used| not_used.name == name);
        let value = not_used.map(|not_used| not_used.number).or_else(|| of(config, settings));
        value.filter(|_| default.is_none_or(|(config, own)| of(config, own) != value))
    })
}

/// The record of attached devices, for one engine.
pub(crate) fn of_attached(rows: &'static [&'static [Row]], value: &dyn Fn(&str) -> Option<i32>) -> Record {
    write(ATTACHED, Table::Attached(rows), value)
}

/// Takes the settings of attached devices from a record: names and values, each within its range. Check that they fit together.
pub fn read_attached(
    rows: &'static [&'static [Row]],
    record: &[u8],
) -> impl Iterator<Item = (&'static str, i32)> {
    read(ATTACHED, record, Table::Attached(rows))
}

/// Takes the settings of the node, and the stored wiring of its engines, from its record.
pub fn apply_to_node(settings: &mut NodeSettings, wiring: &mut [Wiring], record: &[u8]) {
    for (name, value) in read(NODE, record, Table::Node) {
        settings.set(name, value);
    }
    for (hash, value) in values(NODE, record) {
        let mut all = wiring.iter_mut().enumerate();
        let own = all.find(|(engine, _)| hash_of_wiring(*engine) == hash);
        if let (Some((_, wiring)), Some(stored)) = (own, Wiring::unpacked(value as u32)) {
            *wiring = stored;
        }
    }
}

/// A stored setting of an engine that its line excludes: another value is in force.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct NotUsed {
    /// Name of the parameter.
    pub name: &'static str,
    /// Stored value.
    pub number: i32,
}

/// Takes the settings of an engine from its record. One that does not fit the line, which may have changed since it was set, stays unchanged and is
/// returned: of each protocol it is one setting at most.
pub fn apply_to_engine(
    config: &mut EngineConfig,
    settings: &mut EngineSettings,
    record: &[u8],
) -> Option<NotUsed> {
    let (mut new, mut own) = (*config, *settings);
    let mut not_used = None;
    for (name, number) in read(kind(config), record, Table::Engine(config)) {
        if own.set_own::<false>(name, number) {
            continue;
        }
        let before = new;
        // Its name and its range have been checked.
        if new.change_parameter(name, number) && jetlink::config::validate(&[new]).is_err() {
            new = before;
            not_used = Some(NotUsed { name, number });
        }
    }
    *config = new;
    if own.low >= own.high {
        (own.low, own.high) = (settings.low, settings.high);
    }
    *settings = own;
    not_used
}

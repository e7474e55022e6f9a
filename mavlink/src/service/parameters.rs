//! Parameters: the settings of the node in its component, those of an engine in the engine's. All are `REAL32`, and count and
//! order are fixed. They are served from RAM; `keeping.rs` sets and stores them.

use super::{Place, Service};
use crate::attached::Attached;
use crate::dialect::PARAM_VALUE_DATA;
use crate::engine::Engine;
use crate::frame::Address;
use crate::ids::PARAM_REAL32;
use crate::number::whole;
use crate::port::{Class, List};
use crate::refusal::Refusal;
use crate::settings::{EngineSettings, NodeSettings, Table, find_row};
use embassy_time::{Duration, Instant};
use jetlink::config::{EngineConfig, LinkSettings};
use jetlink::setting::{Effect, Row, Setting};
use mavlink_core::types::CharArray;

/// Time between two parameters of a list.
const LIST_EVERY: Duration = Duration::from_millis(50);
/// Bytes of a parameter that is not signed.
const PARAMETER_BYTES: usize = 37;

/// The parameters of the node, in their order, with their texts.
pub fn node_parameters() -> impl Iterator<Item = &'static Setting> {
    NodeSettings::TABLE.into_iter().flatten()
}

/// The parameters of an engine, in their order, with their texts.
pub fn engine_parameters(config: &EngineConfig) -> impl Iterator<Item = &'static Setting> {
    config.settings().filter(|setting| setting.parameter).chain(EngineSettings::SETTINGS)
}

impl<const N: usize, const P: usize, A: Attached> Service<'_, N, P, A> {
    pub(super) fn row(&self, place: Place, index: usize) -> Option<&'static Row> {
        let mut before = index;
        self.find_row(place, &mut |_| {
            let is_it = before == 0;
            before = before.saturating_sub(1);
            is_it
        })
    }

    /// The first parameter of a component that is the one.
    pub(super) fn find_row(
        &self,
        place: Place,
        is_it: &mut dyn FnMut(&'static Row) -> bool,
    ) -> Option<&'static Row> {
        match place {
            Place::Node => find_row(Table::Node, is_it),
            Place::Engine(engine) => {
                let found = find_row(Table::Engine(&self.engines.get(engine)?.config), is_it);
                let rows = self.attached.rows();
                match found {
                    None if !rows.is_empty() => find_row(Table::Attached(rows), is_it),
                    found => found,
                }
            }
        }
    }

    fn count(&self, place: Place) -> usize {
        let mut count = 0;
        self.find_row(place, &mut |_| {
            count += 1;
            false
        });
        count
    }

    pub(super) fn position(&self, place: Place, name: Name<'_>) -> Option<(usize, &'static Row)> {
        let mut before = 0;
        let found = self.find_row(place, &mut |row| {
            let is_it = row.name.as_bytes() == name.0;
            before += usize::from(!is_it);
            is_it
        });
        found.map(|row| (before, row))
    }

    pub(super) fn value(&self, place: Place, name: &str) -> Option<i32> {
        match place {
            Place::Node => self.settings.number(name),
            Place::Engine(engine) => {
                let engine = self.engines.get(engine)?;
                let own = engine.config.number(name).or_else(|| engine.settings.own(name));
                own.or_else(|| self.attached.number(place.engine()?, name))
            }
        }
    }

    /// Sends a parameter. False: there is none of this index.
    pub(super) fn send_parameter(&mut self, now: Instant, port: usize, place: Place, index: usize) -> bool {
        let Some(row) = self.row(place, index) else { return false };
        let Some(value) = self.value(place, row.name) else { return false };
        let mut id = [0; 16];
        id.iter_mut().zip(row.name.bytes()).for_each(|(slot, byte)| *slot = byte);
        let message = PARAM_VALUE_DATA {
            param_value: value as f32,
            param_count: u16::try_from(self.count(place)).unwrap_or(u16::MAX),
            param_index: u16::try_from(index).unwrap_or(u16::MAX),
            param_id: CharArray::new(id),
            param_type: PARAM_REAL32,
        };
        self.send(now, port, place, Class::Answer, &message);
        true
    }

    /// Begins a list; component 0 is all of ours, one after the other.
    pub(super) fn list_parameters(&mut self, now: Instant, port: usize, target: Address) {
        let Some(system) = self.system(now, port) else { return };
        if target.system != system && target.system != 0 {
            return;
        }
        let (place, last) = match (target.component, self.place(target.component)) {
            (0, _) => (0, self.engines.len()),
            (_, Some(Place::Node)) => (0, 0),
            (_, Some(Place::Engine(engine))) => (engine + 1, engine + 1),
            _ => return,
        };
        if let Some(port) = self.ports.get_mut(port) {
            port.list = Some(List { place, last, index: 0, next: now });
        }
    }

    /// Sends what is due of the lists. Returns when the next one is.
    pub(super) fn send_lists(&mut self, now: Instant) -> Option<Instant> {
        for port in 0..self.ports.len() {
            let Some(mut list) =
                self.ports.get(port).and_then(|port| port.list).filter(|list| now >= list.next)
            else {
                continue;
            };
            let place = list.place.checked_sub(1).map_or(Place::Node, Place::Engine);
            let continues = if self.send_parameter(now, port, place, list.index.into()) {
                list.index = list.index.saturating_add(1);
                true
            } else {
                (list.place, list.index) = (list.place + 1, 0);
                list.place <= list.last
            };
            let bytes = PARAMETER_BYTES + self.signing.overhead();
            if let Some(port) = self.ports.get_mut(port) {
                list.next = now + LIST_EVERY.max(port.quarter(bytes));
                port.list = continues.then_some(list);
            }
        }
        self.ports.iter().filter_map(|port| port.list).map(|list| list.next).min()
    }

    pub(super) fn read_parameter(
        &mut self,
        now: Instant,
        port: usize,
        target: Address,
        name: &[u8],
        index: i16,
    ) {
        let Some(place) = self.addressed(now, port, target) else { return };
        let index = match usize::try_from(index) {
            Ok(index) => Some(index),
            Err(_) => self.position(place, Name::of(name)).map(|(index, _)| index),
        };
        if let Some(index) = index {
            self.send_parameter(now, port, place, index);
        }
    }

    pub(super) fn set(&mut self, place: Place, row: &'static Row, value: f32) -> Result<(), Refusal> {
        let name = row.name;
        let number = whole(value).ok_or(Refusal::NotWhole)?;
        if !row.allows(number) {
            return Err(Refusal::OutOfRange(row));
        }
        match place {
            Place::Node => {
                if matches!(row.effect, Effect::UnlessTurning | Effect::AtNextStart) && self.any_turns() {
                    return Err(Refusal::Turns);
                }
                self.settings.set(name, number);
            }
            Place::Engine(engine) if self.attached.number(engine, name).is_some() => {
                self.attached.set(engine, name, number)?;
            }
            Place::Engine(engine) => {
                let engine = self.engines.get_mut(engine).ok_or(Refusal::UnknownSetting)?;
                if row.effect == Effect::UnlessTurning && engine.turns() {
                    return Err(Refusal::Turns);
                }
                let mut settings = engine.settings;
                if settings.set_own(name, number) {
                    if settings.low >= settings.high {
                        return Err(Refusal::EndPoints);
                    }
                    engine.settings = settings;
                } else {
                    let mut config = engine.config;
                    // Its name and its range have been checked.
                    if !config.change(name, number) {
                        return Err(Refusal::UnknownSetting);
                    }
                    Self::configure(engine, &config, row)?;
                    engine.config = config;
                }
            }
        }
        Ok(())
    }

    /// Gives a setting of the supervision or the link, whose range has been checked, to the engine.
    pub(super) fn configure(
        engine: &Engine<'_>,
        config: &EngineConfig,
        row: &'static Row,
    ) -> Result<(), Refusal> {
        match row.effect {
            Effect::AtRest => {
                engine.setup.configure_link(&LinkSettings::from(config)).map_err(|_| Refusal::LineTooSlow)
            }
            _ => engine.setup.configure(&config.supervision).map_err(|_| Refusal::OutOfRange(row)),
        }
    }
}

/// A name that was received.
#[derive(Clone, Copy)]
pub(super) struct Name<'a>(&'a [u8]);

impl<'a> Name<'a> {
    /// Of 16 letters, or of fewer that zeros follow.
    pub fn of(bytes: &'a [u8]) -> Self {
        let end = bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len());
        Self(bytes.get(..end).unwrap_or_default())
    }
}

impl core::fmt::Display for Name<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        self.0.iter().try_for_each(|&byte| core::fmt::Write::write_char(f, byte.into()))
    }
}

//! Parameters: the settings of the node in its component, those of an engine in the engine's. All are `REAL32`, and count and
//! order are fixed. They are kept in RAM: who builds the service may store them ([`Service::settings`]).

use super::{Place, Service};
use crate::dialect::PARAM_VALUE_DATA;
use crate::frame::Address;
use crate::ids::{PARAM_REAL32, Severity};
use crate::number::whole;
use crate::port::{Class, List};
use crate::refusal::Refusal;
use crate::settings::{EngineSettings, NodeSettings};
use embassy_time::{Duration, Instant};
use jetlink::config::EngineConfig;
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
    config.settings().chain(EngineSettings::SETTINGS)
}

// The same without texts: an image does not hold those.

fn node_rows() -> impl Iterator<Item = &'static Row> {
    NodeSettings::TABLE_ROWS.into_iter().flatten()
}

fn engine_rows(config: &EngineConfig) -> impl Iterator<Item = &'static Row> {
    config.rows().chain(EngineSettings::ROWS)
}

impl<const N: usize, const P: usize> Service<'_, N, P> {
    fn row(&self, place: Place, index: usize) -> Option<&'static Row> {
        match place {
            Place::Node => node_rows().nth(index),
            Place::Engine(engine) => engine_rows(&self.engines.get(engine)?.config).nth(index),
        }
    }

    fn count(&self, place: Place) -> usize {
        match place {
            Place::Node => node_rows().count(),
            Place::Engine(engine) => {
                self.engines.get(engine).map_or(0, |engine| engine_rows(&engine.config).count())
            }
        }
    }

    fn position(&self, place: Place, name: &str) -> Option<usize> {
        match place {
            Place::Node => node_rows().position(|row| row.name == name),
            Place::Engine(engine) => {
                engine_rows(&self.engines.get(engine)?.config).position(|row| row.name == name)
            }
        }
    }

    fn value(&self, place: Place, name: &str) -> Option<i32> {
        match place {
            Place::Node => self.settings.number(name),
            Place::Engine(engine) => {
                let engine = self.engines.get(engine)?;
                engine.config.number(name).or_else(|| engine.settings.own(name))
            }
        }
    }

    /// Sends a parameter. False: there is none of this index.
    fn send_parameter(&mut self, now: Instant, port: usize, place: Place, index: usize) -> bool {
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
            let going_on = if self.send_parameter(now, port, place, list.index.into()) {
                list.index = list.index.saturating_add(1);
                true
            } else {
                (list.place, list.index) = (list.place + 1, 0);
                list.place <= list.last
            };
            let bytes = PARAMETER_BYTES + self.signing.overhead();
            if let Some(port) = self.ports.get_mut(port) {
                list.next = now + LIST_EVERY.max(port.quarter(bytes));
                port.list = going_on.then_some(list);
            }
        }
        self.ports.iter().filter_map(|port| port.list).map(|list| list.next).min()
    }

    pub(super) fn read_parameter(
        &mut self,
        now: Instant,
        port: usize,
        target: Address,
        name: &CharArray<16>,
        index: i16,
    ) {
        let Some(place) = self.addressed(now, port, target) else { return };
        let index = match usize::try_from(index) {
            Ok(index) => Some(index),
            Err(_) => name.to_str().ok().and_then(|name| self.position(place, name)),
        };
        if let Some(index) = index {
            self.send_parameter(now, port, place, index);
        }
    }

    pub(super) fn set_parameter(
        &mut self,
        now: Instant,
        port: usize,
        from: Address,
        target: Address,
        name: &CharArray<16>,
        value: f32,
    ) {
        let Some(place) = self.addressed(now, port, target) else { return };
        let name = name.to_str().unwrap_or_default();
        let result = if self.may_command(from.system) {
            self.set(place, name, value)
        } else {
            Err(Refusal::NotAllowed(from.system))
        };
        match result {
            Ok(effect) => {
                self.counters.parameters_set = self.counters.parameters_set.wrapping_add(1);
                if effect == Effect::AtNextStart {
                    self.say(
                        now,
                        place,
                        Severity::Notice,
                        Some(port),
                        format_args!("{name} counts from the node's next start on"),
                    );
                }
            }
            Err(why) => {
                self.say(now, place, Severity::Warning, Some(port), format_args!("{name} not set: {why}"));
            }
        }
        // The new value, or the old one where it was refused.
        if let Some(index) = self.position(place, name) {
            self.send_parameter(now, port, place, index);
        }
    }

    fn set(&mut self, place: Place, name: &str, value: f32) -> Result<Effect, Refusal> {
        let row = self
            .position(place, name)
            .and_then(|index| self.row(place, index))
            .ok_or(Refusal::UnknownSetting)?;
        let number = whole(value).ok_or(Refusal::NotWhole)?;
        if !row.allows(number) {
            return Err(Refusal::OutOfRange(row));
        }
        match place {
            Place::Node => {
                if NodeSettings::needs_rest(name) && self.any_turns() {
                    return Err(Refusal::Turns);
                }
                self.settings.set(name, number);
            }
            Place::Engine(engine) => {
                let engine = self.engines.get_mut(engine).ok_or(Refusal::UnknownSetting)?;
                if EngineSettings::needs_rest(name) && engine.turns() {
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
                        return Err(Refusal::SettingOff);
                    }
                    if engine.source.handle().configure(&config.supervision).is_err() {
                        return Err(Refusal::OutOfRange(row));
                    }
                    engine.config = config;
                }
            }
        }
        Ok(row.effect)
    }
}

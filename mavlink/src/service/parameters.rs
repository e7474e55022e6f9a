//! Parameters: the settings of the node in its component, those of an engine in the engine's. All are `REAL32`, and count and
//! order are fixed. They are served from RAM; `storage.rs` sets and stores them.

use super::{Place, Service};
use crate::attached::Attached;
use crate::dialect::PARAM_VALUE_DATA;
use crate::engine::Engine;
use crate::frame::Address;
use crate::ids::PARAM_REAL32;
use crate::kind::Kind;
use crate::number::whole;
use crate::port::{Class, List};
use crate::refusal::Refusal;
use crate::settings::{EngineSettings, Name, NodeSettings, Parameter, Table, find_row};
use embassy_time::{Duration, Instant};
use jetlink::config::{EngineConfig, LinkSettings};
use jetlink::setting::{Effect, Row, Setting};
use jetlink::wiring::Wiring;
use mavlink_core::types::CharArray;

/// Time between two parameters of a list.
const LIST_EVERY: Duration = Duration::from_millis(50);
/// Bytes of a parameter that is not signed.
const PARAMETER_BYTES: usize = 37;

/// The parameters of the node, in their order, with their texts.
pub fn node_parameters() -> impl Iterator<Item = &'static Setting> {
    NodeSettings::TABLE.into_iter().flatten()
}

/// The parameters of the node for engine 1, after all others of the node, with their texts. Another engine has its number in place of the 1 in each
/// name, and its parameters follow those of the previous engine. `image` has the defaults.
pub fn wiring_parameters(image: &Wiring) -> [Setting; Wiring::ROWS.len()] {
    Wiring::table(image)
}

/// The parameters of an engine, in their order, with their texts.
pub fn engine_parameters(config: &EngineConfig) -> impl Iterator<Item = &'static Setting> {
    config.settings().filter(|setting| setting.parameter).chain(EngineSettings::SETTINGS)
}

impl<const N: usize, const P: usize, A: Attached> Service<'_, N, P, A> {
    pub(super) fn parameter(&self, place: Place, index: usize) -> Option<Parameter> {
        let mut before = index;
        self.find_parameter(place, &mut |_| {
            let is_it = before == 0;
            before = before.saturating_sub(1);
            is_it
        })
    }

    /// The first parameter of a component that matches.
    pub(super) fn find_parameter(
        &self,
        place: Place,
        is_it: &mut dyn FnMut(Parameter) -> bool,
    ) -> Option<Parameter> {
        let mut in_table = |table, wired| {
            let row = find_row(table, &mut |row| is_it(Parameter { row, wired }))?;
            Some(Parameter { row, wired })
        };
        match place {
            Place::Node => {
                let mut wirings = (1..).zip(&self.wiring);
                in_table(Table::Node, 0)
                    .or_else(|| wirings.find_map(|(engine, _)| in_table(Table::Wiring, engine)))
            }
            Place::Engine(engine) => {
                let found = in_table(Table::Engine(&self.engines.get(engine)?.config), 0);
                let rows = self.attached.rows();
                match found {
                    None if !rows.is_empty() => in_table(Table::Attached(rows), 0),
                    found => found,
                }
            }
        }
    }

    fn count(&self, place: Place) -> usize {
        let mut count = 0;
        self.find_parameter(place, &mut |_| {
            count += 1;
            false
        });
        count
    }

    pub(super) fn position(&self, place: Place, name: Name) -> Option<(usize, Parameter)> {
        let mut before = 0;
        let found = self.find_parameter(place, &mut |parameter| {
            let is_it = parameter.name() == name;
            before += usize::from(!is_it);
            is_it
        });
        found.map(|parameter| (before, parameter))
    }

    pub(super) fn value(&self, place: Place, parameter: Parameter) -> Option<i32> {
        let name = parameter.row.name;
        match (place, usize::from(parameter.wired).checked_sub(1)) {
            (Place::Node, Some(engine)) => self.wiring.get(engine)?.number(name),
            (Place::Node, None) => self.settings.number(name),
            (Place::Engine(engine), _) => {
                let engine = self.engines.get(engine)?;
                let own = engine.config.parameter(name).or_else(|| engine.settings.own::<false>(name));
                own.or_else(|| self.attached.number(place.engine()?, name))
            }
        }
    }

    /// Changes a parameter of the node. Its range has been checked.
    pub(super) fn set_of_node(&mut self, parameter: Parameter, number: i32) {
        let name = parameter.row.name;
        match usize::from(parameter.wired).checked_sub(1) {
            Some(engine) => self.wiring.get_mut(engine).is_some_and(|wiring| wiring.change(name, number)),
            None => self.settings.set(name, number),
        };
    }

    /// Sends a parameter. False: none has this index.
    pub(super) fn send_parameter(&mut self, now: Instant, port: usize, place: Place, index: usize) -> bool {
        let Some(parameter) = self.parameter(place, index) else { return false };
        let Some(value) = self.value(place, parameter) else { return false };
        let message = PARAM_VALUE_DATA {
            param_value: value as f32,
            param_count: u16::try_from(self.count(place)).unwrap_or(u16::MAX),
            param_index: u16::try_from(index).unwrap_or(u16::MAX),
            param_id: CharArray::new(parameter.name().0),
            param_type: PARAM_REAL32,
        };
        self.send(now, port, place, Class::Requested, &message);
        true
    }

    /// Begins a list, or lets it wait for those that are requested already; component 0 lists all of ours, one after the other. What is
    /// being listed starts anew.
    pub(super) fn list_parameters(&mut self, now: Instant, port: usize, target: Address) {
        let Some(system) = self.system(now, port) else { return };
        if target.system != system && target.system != 0 {
            return;
        }
        let (first, last) = match (target.component, self.place(target.component)) {
            (0, _) => (0, self.engines.len()),
            (_, Some(Place::Node)) => (0, 0),
            (_, Some(Place::Engine(engine))) => (engine + 1, engine + 1),
            _ => return,
        };
        let Some(port) = self.ports.get_mut(port) else { return };
        let mut places = (first..=last).fold(0, |bits, place| bits | List::bit(place));
        port.list = match port.list {
            None => List { place: first, index: 0, waiting: places, next: now }.following(),
            Some(mut list) => {
                let current = List::bit(list.place);
                if places & current != 0 {
                    places &= !current;
                    list.index = 0;
                }
                // The next parameter keeps its time: requests do not raise the rate.
                Some(List { waiting: list.waiting | places, ..list })
            }
        };
    }

    /// Sends the list entries that are due. Returns when the next one is.
    pub(super) fn send_lists(&mut self, now: Instant) -> Option<Instant> {
        for port in 0..self.ports.len() {
            let Some(mut list) =
                self.ports.get(port).and_then(|port| port.list).filter(|list| now >= list.next)
            else {
                continue;
            };
            let place = list.place.checked_sub(1).map_or(Place::Node, Place::Engine);
            let continued = if self.send_parameter(now, port, place, list.index.into()) {
                list.index = list.index.saturating_add(1);
                Some(list)
            } else {
                list.following()
            };
            let bytes = PARAMETER_BYTES + self.signing.overhead();
            if let Some(port) = self.ports.get_mut(port) {
                let next = now + LIST_EVERY.max(port.quarter(bytes));
                port.list = continued.map(|list| List { next, ..list });
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
        let Some(place) = self.addressed(now, port, target, Kind::Reads) else { return };
        let index = match usize::try_from(index) {
            Ok(index) => Some(index),
            Err(_) => self.position(place, Name::of(name)).map(|(index, _)| index),
        };
        if let Some(index) = index {
            self.send_parameter(now, port, place, index);
        }
    }

    pub(super) fn set(&mut self, place: Place, parameter: Parameter, value: f32) -> Result<(), Refusal> {
        let row = parameter.row;
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
                self.set_of_node(parameter, number);
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
                if settings.set_own::<false>(name, number) {
                    if settings.low >= settings.high {
                        return Err(Refusal::EndPoints);
                    }
                    engine.configure(settings);
                } else {
                    let mut config = engine.config;
                    // Its name and its range have been checked.
                    if !config.change_parameter(name, number) {
                        return Err(Refusal::UnknownSetting);
                    }
                    Self::configure(engine, &config, row)?;
                    engine.config = config;
                }
            }
        }
        Ok(())
    }

    /// Passes a setting of the supervision or the link to the engine. Its range has been checked.
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

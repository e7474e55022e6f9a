//! Stored settings: a parameter that was set is answered when it is stored, and restored if it cannot be.

use super::{PENDING, ParameterStorage, Pending, Place, Service};
use crate::attached::Attached;
use crate::frame::Address;
use crate::ids::Severity;
use crate::kind::Kind;
use crate::record::{self, NotUsed, Record};
use crate::refusal::Refusal;
use crate::retained_settings::{Defaults, fit};
use crate::settings::{LEARNT, Name, Parameter, Table, find_row};
use crate::store::NotSaved;
use embassy_time::Instant;
use heapless::Vec;
use jetlink::setting::Effect;
use jetlink::units::Verbatim;
use jetlink::wiring::{Wiring, WiringError};

/// Heartbeats, one a second, between two texts about a problem with the settings.
const TEXT_EVERY: u8 = 10;

impl<'a, const N: usize, const P: usize, A: Attached> Service<'a, N, P, A> {
    /// Sets what happens to parameters that are set. By default the code that builds the service looks after them.
    pub fn set_parameter_storage(&mut self, storage: ParameterStorage) {
        self.storage = storage;
    }

    /// Reports that the stored settings are damaged: only a stop is obeyed, and over USB everything but a start, until a person confirms the
    /// defaults, or the values set since (service 30).
    pub fn set_damaged(&mut self, damaged: bool) {
        self.damaged = damaged;
        self.until_text = 0;
        self.are_retained = false;
        self.attached.set_damaged(damaged);
    }

    /// Reports that the stored settings are damaged, and that those retained in RAM over the reset apply: everything is obeyed. They are stored
    /// again when a person confirms them. Where nothing of signing was retained with them, it is unknown whether there was a key: they stay damaged.
    pub fn set_retained(&mut self) {
        self.set_damaged(true);
        #[cfg(feature = "signing")]
        if !self.signing.was_retained() {
            return;
        }
        self.are_retained = true;
        self.attached.set_damaged(false);
    }

    /// Reports on every port, from time to time, what is wrong with the settings. Call it with each heartbeat.
    pub(super) fn report_settings(&mut self, now: Instant) {
        if let Some(left) = self.until_text.checked_sub(1) {
            self.until_text = left;
            return;
        }
        self.until_text = TEXT_EVERY - 1;
        if self.has_to_be_confirmed() {
            let text = Verbatim(match self.are_retained {
                true => "stored settings DAMAGED: confirm the current ones over USB",
                false => "settings DAMAGED: only stops are obeyed",
            });
            self.say(now, Place::Node, Severity::Critical, None, format_args!("{text}"));
        }
        if let Some(error) = self.contradiction {
            let what = format_args!("wiring as in the image, not as stored: {error}");
            self.say(now, Place::Engine(error.row), Severity::Error, None, what);
        }
        if self.identity_stays {
            let text = Verbatim(
                "ids and TELEM_BAUD stay as before the reset until a start with all engines at rest",
            );
            self.say(now, Place::Node, Severity::Notice, None, format_args!("{text}"));
        }
        for engine in 0..self.engines.len() {
            let Some(name) = self.not_used(engine).map(|not_used| Verbatim(not_used.name)) else { continue };
            let what = format_args!("{name} as in the image, not as stored: it does not fit the line");
            self.say(now, Place::Engine(engine), Severity::Error, None, what);
        }
    }

    /// The stored setting of an engine that is not used.
    fn not_used(&self, engine: usize) -> Option<NotUsed> {
        self.not_used.get(engine).copied().flatten()
    }

    /// Reports a setting of an engine, from 0, that does not fit its line. It stays stored until the parameter is set.
    pub fn set_not_used(&mut self, engine: usize, setting: Option<NotUsed>) {
        self.not_used.get_mut(engine).into_iter().for_each(|not_used| *not_used = setting);
    }

    /// Offers the wiring of engines as parameters of the node, which the code that builds the service stores and uses at its next start. `wiring` is
    /// the stored one, `image` applies where nothing is stored. `contradiction`: the engine that cannot be wired as it is stored.
    pub fn set_wiring(&mut self, wiring: &[Wiring], image: &'a [Wiring], contradiction: Option<WiringError>) {
        // Wirings beyond the number of engines are left out.
        self.wiring = wiring.iter().copied().take(N).collect();
        (self.image, self.contradiction) = (image, contradiction);
    }

    /// Confirms the current settings: all are stored again, and count as damaged until they are; at once where none are stored.
    #[cfg(feature = "signing")]
    pub(super) fn confirm_settings(&mut self, now: Instant, at_board: bool) -> Result<(), Refusal> {
        if !self.has_to_be_confirmed() {
            return Err(Refusal::NotDamaged);
        }
        // If they are lost, only a command over USB gets here.
        if self.are_retained && !at_board {
            return Err(Refusal::Damaged);
        }
        if !self.is_at_rest() {
            return Err(Refusal::NotAtRest);
        }
        if self.confirming {
            return Err(Refusal::StoreBusy);
        }
        if self.storage == ParameterStorage::Lost {
            self.set_damaged(false);
            let text = Verbatim("settings confirmed until the power is lost");
            self.say(now, Place::Node, Severity::Notice, None, format_args!("{text}"));
            return Ok(());
        }
        (self.rewrite, self.confirming) = (true, true);
        Ok(())
    }

    /// Takes the result of storing all records again.
    #[cfg(feature = "signing")]
    pub fn rewritten(&mut self, now: Instant, result: Result<(), NotSaved>) {
        // A save begun before the confirmation is not its result.
        if self.rewrite || !core::mem::take(&mut self.confirming) {
            return;
        }
        match result {
            Ok(()) => {
                self.set_damaged(false);
                self.say(
                    now,
                    Place::Node,
                    Severity::Notice,
                    None,
                    format_args!("settings confirmed and stored"),
                );
            }
            Err(_) => {
                let why = Refusal::StoreFails;
                self.say(
                    now,
                    Place::Node,
                    Severity::Error,
                    None,
                    format_args!("settings not confirmed: {why}"),
                );
            }
        }
    }

    /// Stores the learnt id of the vehicle.
    pub(super) fn store_learnt(&mut self, id: u8) {
        let old = core::mem::replace(&mut self.settings.identity.learnt, id).into();
        let port = self.autopilot_port.unwrap_or(0);
        if self.storage == ParameterStorage::Stored
            && let Some((index, _)) = self.position(Place::Node, Name::of(LEARNT.as_bytes()))
        {
            // Without space, it is learnt again at the next start.
            let _ = self.pending.push_back(Pending { port, place: Place::Node, index, old });
        }
    }

    /// Stores the learnt id again where the memory did not accept it in flight: at rest it may erase.
    pub(super) fn store_learnt_at_rest(&mut self) {
        if self.learnt_waits && self.is_at_rest() {
            self.learnt_waits = false;
            self.store_learnt(self.vehicle.learnt());
        }
    }

    /// Whether all records have to be stored again. Returned once.
    pub fn take_rewrite(&mut self) -> bool {
        #[cfg(feature = "signing")]
        return core::mem::take(&mut self.rewrite);
        #[cfg(not(feature = "signing"))]
        false
    }

    /// Whether all records may be stored again because the memory does not accept one. That ends damage, which only a person does, and drops the
    /// records of another image, such as the key, so there may be none among these `keys`.
    pub fn may_rewrite(&self, mut keys: impl Iterator<Item = u8>) -> bool {
        #[cfg(feature = "signing")]
        if self.confirming {
            return true;
        }
        !self.damaged && keys.all(|key| self.has_record(key))
    }

    /// Whether a record of this key is stored.
    fn has_record(&self, key: u8) -> bool {
        let engines = self.engines.len();
        #[cfg(feature = "signing")]
        if key == record::SIGNING_KEY {
            return true;
        }
        usize::from(key) <= engines
            || !self.attached.rows().is_empty()
                && record::engine_of_attached(key).is_some_and(|engine| engine < engines)
    }

    /// The next record to store, with its key. [`Service::saved`] has to follow.
    pub fn next_save(&mut self) -> Option<(u8, Record)> {
        #[cfg(feature = "signing")]
        if let Some(stamp) = self.cover.next_save() {
            return Some((record::SIGNING_KEY, record::of_signing(self.signing.key(), stamp)));
        }
        let place = self.place_of_record(self.pending.front()?);
        self.saving = self.pending.len();
        self.record(place)
    }

    /// The place of the record that has this setting.
    fn place_of_record(&self, pending: &Pending) -> usize {
        match pending.place.engine() {
            None => 0,
            Some(engine) if self.is_attached(pending.place, pending.index) => self.engines.len() + 1 + engine,
            Some(engine) => engine + 1,
        }
    }

    /// Number of records: the node, then the engines, then the attached devices of each of them, then signing.
    pub fn places(&self) -> usize {
        self.places_of_settings() + usize::from(cfg!(feature = "signing"))
    }

    fn places_of_settings(&self) -> usize {
        1 + self.engines.len() * (1 + usize::from(!self.attached.rows().is_empty()))
    }

    /// All settings that differ from these, as records.
    pub fn changes(&self, defaults: &Defaults<'_>) -> impl Iterator<Item = (u8, Record)> {
        (0..self.places_of_settings()).filter_map(move |place| self.record_of(place, Some(defaults)))
    }

    /// Sets the defaults of the image, and how much RAM that survives a reset there is for settings that differ. A change that does not fit is
    /// refused if nothing is stored; otherwise it is accepted with a text.
    pub const fn set_room(&mut self, defaults: &'static Defaults<'static>) {
        self.room = Some(defaults);
    }

    /// Whether RAM that survives a reset has space for the current settings.
    #[inline(never)]
    fn fits(&self) -> bool {
        self.room.is_none_or(|defaults| fit(self.changes(defaults), defaults.room))
    }

    /// Whether that RAM is all that retains the current settings, and does.
    fn is_only_in_ram(&self) -> bool {
        self.storage == ParameterStorage::Lost && self.fits()
    }

    /// The record in a place, with its key, as it should be stored.
    pub fn record(&self, place: usize) -> Option<(u8, Record)> {
        self.record_of(place, None)
    }

    /// The same; with defaults, what differs.
    #[inline(never)]
    fn record_of(&self, place: usize, defaults: Option<&Defaults<'_>>) -> Option<(u8, Record)> {
        let Some(engine) = place.checked_sub(1) else {
            let default = defaults.map(|defaults| defaults.node);
            return Some((0, record::of_node(&self.settings, default, &self.wiring, self.image)));
        };
        if let Some(of) = self.engines.get(engine) {
            let default = defaults.and_then(|defaults| defaults.of_engine(engine));
            // A value that was set takes its place, once that is stored.
            let not_used = self.not_used(engine).filter(|NotUsed { name, .. }| {
                !self.pending.iter().any(|pending| self.is_of(pending, Place::Engine(engine), name))
            });
            let record = record::of_engine(&of.config, &of.settings, not_used, default);
            return Some((u8::try_from(place).ok()?, record));
        }
        #[cfg(feature = "signing")]
        if place == self.places_of_settings() {
            let stamp = self.cover.latest().max(self.signing.last());
            return Some((record::SIGNING_KEY, record::of_signing(self.signing.key(), stamp)));
        }
        let engine = engine.checked_sub(self.engines.len()).filter(|_| place < self.places_of_settings())?;
        let attached = &self.attached;
        let default = |name: &str| defaults.and_then(|defaults| (defaults.attached.number)(engine, name));
        let changed =
            |name: &str| attached.number(engine, name).filter(|value| default(name) != Some(*value));
        let record = record::of_attached(attached.rows(), &changed);
        Some((record::attached_key(engine)?, record))
    }

    /// Whether this change is of the parameter of this name.
    fn is_of(&self, pending: &Pending, place: Place, name: &str) -> bool {
        pending.place == place
            && self.parameter(place, pending.index).is_some_and(|parameter| parameter.row.name == name)
    }

    /// Whether this parameter is one of the attached devices.
    fn is_attached(&self, place: Place, index: usize) -> bool {
        let Some(found) = self.parameter(place, index).filter(|_| !self.attached.rows().is_empty()) else {
            return false;
        };
        find_row(Table::Attached(self.attached.rows()), &mut |other| core::ptr::eq(other, found.row))
            .is_some()
    }

    /// Takes the result of the save that [`Service::next_save`] requested: the settings in its record are answered. If it was not saved, all
    /// changes of its settings are taken back, also later ones, which may fit only together with those.
    pub fn saved(&mut self, now: Instant, result: Result<(), NotSaved>) {
        #[cfg(feature = "signing")]
        if self.cover.saved(result) {
            if let Err(why) = result
                && self.cover.reports(why)
            {
                let text =
                    Verbatim("signing is not stored: a loss of power restores the previous key and time");
                self.say(now, Place::Node, Severity::Warning, None, format_args!("{text}"));
            }
            return;
        }
        let Some(record) = self.pending.front().map(|first| self.place_of_record(first)) else { return };
        let saving = core::mem::take(&mut self.saving);
        let mut ended = Vec::<Pending, PENDING>::new();
        for place in 0..self.pending.len() {
            let Some(pending) = self.pending.pop_front() else { break };
            let ends = (result.is_err() || place < saving) && self.place_of_record(&pending) == record;
            // There is space in either.
            let _ = if ends { ended.push(pending) } else { self.pending.push_back(pending) };
        }
        let result = result.map_err(|why| match why {
            NotSaved::Full => Refusal::StoreFull,
            NotSaved::Failed => Refusal::StoreFails,
        });
        if result.is_err() {
            // The last one first: the value before it may be that of an earlier one.
            for &Pending { place, index, old, .. } in ended.iter().rev() {
                if let Some(parameter) = self.parameter(place, index) {
                    self.learnt_waits |= parameter.row.name == LEARNT && !self.is_at_rest();
                    self.restore(place, parameter, old);
                }
            }
        }
        // Where the port has no space for all of it, it is a text that is dropped.
        for &Pending { port, place, index, .. } in &ended {
            self.send_parameter(now, port, place, index);
        }
        for &Pending { port, place, index, .. } in &ended {
            self.say_settled(now, port, place, index, result);
        }
    }

    /// Counts a change of a setting, and says what has become of it.
    fn say_settled(
        &mut self,
        now: Instant,
        port: usize,
        place: Place,
        index: usize,
        result: Result<(), Refusal>,
    ) {
        let Some(parameter) = self.parameter(place, index) else { return };
        let name = parameter.name();
        match result {
            Ok(()) => {
                if let Some(engine) = place.engine()
                    && self.not_used(engine).is_some_and(|not_used| not_used.name == parameter.row.name)
                {
                    self.set_not_used(engine, None);
                }
                self.counters.parameters_set = self.counters.parameters_set.wrapping_add(1);
                if self.storage == ParameterStorage::Lost {
                    let what = format_args!("{name} is not stored: it is lost with the power");
                    self.say(now, place, Severity::Warning, Some(port), what);
                } else if !self.fits() {
                    let what =
                        format_args!("{name} is stored, but RAM has no space to retain it over a reset");
                    self.say(now, place, Severity::Warning, Some(port), what);
                } else {
                    let when = match parameter.row.effect {
                        Effect::AtNextStart => Some("takes effect at the node's next start"),
                        Effect::AtRest if self.link_settings_wait(place) => {
                            Some("takes effect when the engine is at rest")
                        }
                        _ => None,
                    };
                    if let Some(when) = when.map(Verbatim) {
                        self.say(now, place, Severity::Notice, Some(port), format_args!("{name} {when}"));
                    }
                }
            }
            Err(why) => {
                self.say(now, place, Severity::Warning, Some(port), format_args!("{name} not set: {why}"));
            }
        }
    }

    /// Whether settings of an engine's link wait until it is at rest.
    fn link_settings_wait(&self, place: Place) -> bool {
        let Place::Engine(engine) = place else { return false };
        self.engines.get(engine).is_some_and(|engine| engine.source.handle().link_settings_wait())
    }

    /// Restores the old value of a setting.
    fn restore(&mut self, place: Place, parameter: Parameter, old: i32) {
        let row = parameter.row;
        match place {
            Place::Node => self.set_of_node(parameter, old),
            // Refused only if the engine has begun to turn: then the new value applies until the next start.
            Place::Engine(engine) if self.attached.number(engine, row.name).is_some() => {
                let _ = self.attached.set(engine, row.name, old);
            }
            Place::Engine(engine) => {
                let Some(engine) = self.engines.get_mut(engine) else { return };
                let mut settings = engine.settings;
                if settings.set_own::<false>(row.name, old) {
                    engine.configure(settings);
                } else if engine.config.change_parameter(row.name, old) {
                    // It was valid before.
                    let _ = Self::configure(engine, &engine.config, row);
                }
            }
        }
    }

    /// Whether every engine is known to be at rest.
    pub fn is_at_rest(&self) -> bool {
        self.engines.iter().all(|engine| engine.is_known_at_rest())
    }

    /// Whether a setting of an engine waits to be stored. If it cannot be, the old one returns.
    pub(super) fn is_being_set(&self, engine: usize) -> bool {
        self.pending.iter().any(|pending| pending.place == Place::Engine(engine))
    }

    /// Whether nothing waits to be stored.
    pub fn is_saved(&self) -> bool {
        #[cfg(feature = "signing")]
        if self.confirming || self.cover.is_saving() {
            return false;
        }
        self.pending.is_empty()
    }

    pub(super) fn set_parameter(
        &mut self,
        now: Instant,
        port: usize,
        from: Address,
        target: Address,
        name: &[u8],
        value: f32,
    ) {
        let Some(place) = self.addressed(now, port, target, Kind::Acts) else { return };
        let name = Name::of(name);
        let Some((index, parameter)) = self.position(place, name) else {
            let why = Refusal::UnknownSetting;
            self.say(now, place, Severity::Warning, Some(port), format_args!("{name} not set: {why}"));
            return;
        };
        let old = self.value(place, parameter).unwrap_or_default();
        // Where it does not fit anyway, this change is not the reason.
        let fitted = self.is_only_in_ram();
        let result = match self.check(port, from.system, Kind::Acts) {
            // A person at the board sets who may command: otherwise nobody could.
            Err(why)
                if !(matches!(why, Refusal::NotAllowed(_))
                    && may_shut_out(parameter)
                    && self.is_usb(port)) =>
            {
                Err(why)
            }
            _ if self.pending.is_full() => Err(Refusal::StoreBusy),
            _ => self.set(place, parameter, value),
        };
        let why = if place == Place::Node && !self.may_command(from.system) && !self.is_usb(port) {
            Some(Refusal::ShutsOut)
        } else if fitted && !self.fits() {
            Some(Refusal::RamFull)
        } else {
            None
        };
        let result = match (result, why) {
            (Ok(()), Some(why)) => {
                self.restore(place, parameter, old);
                Err(why)
            }
            (result, _) => result,
        };
        self.save(now, port, place, index, old, result);
    }

    /// Begins a calibration of an engine's stick, or ends it. The end points are settings, stored and answered as such.
    pub(super) fn calibrate_stick(
        &mut self,
        now: Instant,
        port: usize,
        engine: usize,
        begin: bool,
    ) -> Result<(), Refusal> {
        if begin {
            return self.attached.calibrate(engine, true);
        }
        let names = self.attached.calibrated();
        if self.pending.capacity() - self.pending.len() < names.len() {
            return Err(Refusal::StoreBusy);
        }
        let old = names.map(|name| self.attached.number(engine, name).unwrap_or_default());
        let place = Place::Engine(engine);
        let fitted = self.is_only_in_ram();
        self.attached.calibrate(engine, false)?;
        let overflows = fitted && !self.fits();
        for (name, old) in names.into_iter().zip(old) {
            let Some((index, parameter)) = self.position(place, Name::of(name.as_bytes())) else { continue };
            if overflows {
                self.restore(place, parameter, old);
            } else {
                self.save(now, port, place, index, old, Ok(()));
            }
        }
        if overflows {
            return Err(Refusal::RamFull);
        }
        Ok(())
    }

    /// Has a setting stored that was changed, and answers it then; at once where it was refused, or none is stored.
    fn save(
        &mut self,
        now: Instant,
        port: usize,
        place: Place,
        index: usize,
        old: i32,
        result: Result<(), Refusal>,
    ) {
        if result.is_ok() && self.storage == ParameterStorage::Stored {
            // There is space. It is answered when it is stored.
            let _ = self.pending.push_back(Pending { port, place, index, old });
        } else {
            self.say_settled(now, port, place, index, result);
            // The new value, or the old one if it was refused.
            self.send_parameter(now, port, place, index);
        }
    }
}

/// Whether a setting decides who may command.
fn may_shut_out(parameter: Parameter) -> bool {
    matches!(parameter.row.name, "MAV_GCS_1" | "MAV_GCS_2" | "MAV_OWN_CMD")
}

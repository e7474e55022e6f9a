//! Settings that stay: a parameter that was set is answered when it is stored, and is as before when it cannot be.

use super::parameters::Name;
use super::{Keeping, Pending, Place, Service};
use crate::ids::Severity;
use crate::record::{self, Record};
use crate::refusal::Refusal;
use crate::settings::{LEARNT, find_row};
use crate::store::NotSaved;
use embassy_time::Instant;
use jetlink::setting::{Effect, Row};

impl<const N: usize, const P: usize> Service<'_, N, P> {
    /// Sets what happens to parameters that are set. By default the code that builds the service looks after them.
    pub fn set_keeping(&mut self, keeping: Keeping) {
        self.keeping = keeping;
    }

    /// Reports that the stored settings are damaged: no start is granted until a person confirms that the defaults, or what was set since,
    /// are right (service 30).
    pub fn set_damaged(&mut self, damaged: bool) {
        self.damaged = damaged;
    }

    /// Confirms the present settings: all are stored anew.
    pub(super) fn confirm_settings(&mut self) -> Result<(), Refusal> {
        if !self.damaged {
            return Err(Refusal::NotDamaged);
        }
        if !self.is_at_rest() {
            return Err(Refusal::NotAtRest);
        }
        (self.damaged, self.anew) = (false, true);
        Ok(())
    }

    /// Stores the id of the vehicle that was learnt.
    pub(super) fn store_learnt(&mut self, id: u8) {
        let old = core::mem::replace(&mut self.settings.identity.learnt, id).into();
        let port = self.autopilot_port.unwrap_or(0);
        if self.keeping == Keeping::Stored
            && let Some((index, _)) = self.position(Place::Node, Name::of(LEARNT.as_bytes()))
        {
            // Where there is no space it is learnt again at the next start.
            let _ = self.pending.push_back(Pending { port, place: Place::Node, index, old });
        }
    }

    /// Whether all records have to be stored anew. Returned once.
    pub fn take_anew(&mut self) -> bool {
        core::mem::take(&mut self.anew)
    }

    /// The next record to store, with its key: 0 is the node, then the engines. [`Service::saved`] has to follow.
    pub fn next_save(&self) -> Option<(u8, Record)> {
        let pending = self.pending.front()?;
        let key = pending.place.engine().map_or(0, |engine| engine + 1);
        self.record(key)
    }

    /// The record of a key, as it should be stored.
    pub fn record(&self, key: usize) -> Option<(u8, Record)> {
        let record = match key.checked_sub(1) {
            None => record::of_node(&self.settings),
            Some(engine) => {
                let engine = self.engines.get(engine)?;
                record::of_engine(&engine.config, &engine.settings)
            }
        };
        Some((u8::try_from(key).ok()?, record))
    }

    /// Takes the result of the save that [`Service::next_save`] requested: the setting is answered, and is as before if it was
    /// not saved.
    pub fn saved(&mut self, now: Instant, result: Result<(), NotSaved>) {
        let Some(Pending { port, place, index, old }) = self.pending.pop_front() else { return };
        let result = match result {
            Ok(()) => Ok(()),
            Err(why) => {
                if let Some(row) = self.row(place, index) {
                    self.restore(place, row, old);
                }
                Err(match why {
                    NotSaved::Full => Refusal::StoreFull,
                    NotSaved::Failed => Refusal::StoreFails,
                })
            }
        };
        self.settled(now, port, place, index, result);
    }

    /// Answers a setting.
    pub(super) fn settled(
        &mut self,
        now: Instant,
        port: usize,
        place: Place,
        index: usize,
        result: Result<(), Refusal>,
    ) {
        let Some(row) = self.row(place, index) else { return };
        let name = row.name;
        match result {
            Ok(()) => {
                self.counters.parameters_set = self.counters.parameters_set.wrapping_add(1);
                if self.keeping == Keeping::Lost {
                    let what = format_args!("{name} is not stored: it is lost at the node's next start");
                    self.say(now, place, Severity::Warning, Some(port), what);
                } else {
                    let when = match row.effect {
                        Effect::AtNextStart => Some("counts from the node's next start on"),
                        Effect::AtRest if self.link_settings_wait(place) => {
                            Some("waits until the engine is at rest")
                        }
                        _ => None,
                    };
                    if let Some(when) = when {
                        self.say(now, place, Severity::Notice, Some(port), format_args!("{name} {when}"));
                    }
                }
            }
            Err(why) => {
                self.say(now, place, Severity::Warning, Some(port), format_args!("{name} not set: {why}"));
            }
        }
        // The new value, or the old one where it was refused.
        self.send_parameter(now, port, place, index);
    }

    /// Whether settings of an engine's link wait until it is at rest.
    fn link_settings_wait(&self, place: Place) -> bool {
        let Place::Engine(engine) = place else { return false };
        self.engines.get(engine).is_some_and(|engine| engine.source.handle().link_settings_wait())
    }

    /// Gives a setting back its old value.
    fn restore(&mut self, place: Place, row: &'static Row, old: i32) {
        match place {
            Place::Node => {
                self.settings.set(row.name, old);
            }
            Place::Engine(engine) => {
                let Some(engine) = self.engines.get_mut(engine) else { return };
                if !engine.settings.set_own(row.name, old) && engine.config.change(row.name, old) {
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

    /// Whether nothing waits to be stored.
    pub fn is_saved(&self) -> bool {
        self.pending.is_empty()
    }

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
            Place::Node => find_row(None, is_it),
            Place::Engine(engine) => find_row(Some(&self.engines.get(engine)?.config), is_it),
        }
    }
}

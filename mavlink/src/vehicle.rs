//! The vehicle: whose node this is, and whether it is armed. Only frames of the autopilot's port arrive here.
//!
//! The system id is set, or learnt from the only autopilot received for 5 s. A learnt id is stored, and changes only at a start. Another one that was
//! learnt while ours was silent is dropped once ours is received again for 5 s. It takes two equal heartbeats to show whether the vehicle is armed;
//! silence shows nothing.

use crate::frame::Address;
use crate::ids::{AUTOPILOT_INVALID, COMPONENT_AUTOPILOT, MODE_ARMED, TYPE_GCS};
use embassy_time::{Duration, Instant};

/// Time for which the autopilot has to be the only one until its id is learnt.
const LEARN: Duration = Duration::from_secs(5);
/// Longest time after a frame in which its link may deliver it a second time.
pub(crate) const COPY: Duration = Duration::from_millis(200);
/// Longest gap between two heartbeats of an autopilot that is received.
const RECEIVED_WITHIN: Duration = Duration::from_secs(5);

/// What the vehicle has shown.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Arming {
    /// Nothing yet.
    Unknown,
    /// Two heartbeats without the bit.
    Disarmed,
    /// Two heartbeats with it.
    Armed,
}

/// Something that the vehicle did.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum VehicleEvent {
    /// An id is known. It is the vehicle's from now on, or from the node's next start on if it had one.
    Learnt(u8),
    /// Two autopilots are received: none is learnt.
    TwoAutopilots(u8, u8),
    /// It was armed and now shows disarmed.
    Disarmed,
}

#[derive(Clone, Copy, Debug)]
struct Candidate {
    system: u8,
    since: Instant,
    last: Instant,
}

#[derive(Debug)]
pub(crate) struct Vehicle {
    id: Option<u8>,
    /// Its id was not set.
    learns: bool,
    /// The id that was learnt last: it takes effect at the node's next start.
    learnt: u8,
    candidate: Option<Candidate>,
    /// Another autopilot that is received, and when it was last received.
    other: Option<(u8, Instant)>,
    two_reported: bool,
    arming: Arming,
    /// What the last heartbeats show, and how many consecutive ones agree.
    same: (bool, u8),
    /// Time of the last heartbeat of our autopilot, and since when there was no gap.
    last: Option<Instant>,
    since: Option<Instant>,
    /// Time since which it has shown disarmed without a gap.
    disarmed_since: Option<Instant>,
    /// Time by which its heartbeats have arrived, if it is present.
    shows_by: Option<Instant>,
}

impl Vehicle {
    /// With a set id, one learnt before, or one still to be learnt; 0: none.
    pub fn new(set: u8, learnt: u8) -> Self {
        let system = if set != 0 { set } else { learnt };
        Self {
            id: (system != 0).then_some(system),
            learns: set == 0,
            learnt,
            candidate: None,
            other: None,
            two_reported: false,
            arming: Arming::Unknown,
            same: (false, 0),
            last: None,
            since: None,
            disarmed_since: None,
            shows_by: None,
        }
    }

    /// The same, which is received by then if it is present.
    pub const fn showing_by(self, at: Instant) -> Self {
        Self { shows_by: Some(at), ..self }
    }

    /// Whether it has an id but has not had time to show that it is disarmed.
    pub fn may_show_disarmed(&self, now: Instant) -> bool {
        self.id.is_some() && self.arming == Arming::Unknown && self.shows_by.is_some_and(|at| now < at)
    }

    /// The same vehicle, as if nothing had been received from it.
    #[cfg(feature = "signing")]
    pub fn forgotten(&self) -> Self {
        Self { learns: self.learns, learnt: self.learnt, ..Self::new(self.id.unwrap_or(0), 0) }
    }

    /// Its system id, once it is known.
    pub const fn id(&self) -> Option<u8> {
        self.id
    }

    /// The id that was learnt last; 0: none.
    pub const fn learnt(&self) -> u8 {
        self.learnt
    }

    /// Whether an autopilot is received that has not been learnt.
    pub fn is_learning(&self, now: Instant) -> bool {
        self.id.is_none() && self.candidate.is_some_and(|candidate| now < candidate.last + RECEIVED_WITHIN)
    }

    /// What it has shown.
    pub const fn arming(&self) -> Arming {
        self.arming
    }

    /// Whether its heartbeats are received.
    pub fn is_received(&self, now: Instant) -> bool {
        self.last.is_some_and(|last| now < last + RECEIVED_WITHIN)
    }

    /// Time for which it has shown disarmed without a gap since `from`, up to its last heartbeat: silence shows nothing.
    pub fn disarmed_for(&self, now: Instant, from: Instant) -> Option<Duration> {
        let last = self.last.filter(|_| self.is_received(now))?;
        Some(last.saturating_duration_since(self.disarmed_since?.max(from)))
    }

    /// Time of the last heartbeat of our autopilot that was like the one before.
    pub const fn last_shown(&self) -> Option<Instant> {
        if self.same.1 >= 2 { self.last } else { None }
    }

    /// Whether this is our autopilot.
    pub fn is_autopilot(&self, from: Address) -> bool {
        from.component == COMPONENT_AUTOPILOT && self.id == Some(from.system)
    }

    /// Takes a heartbeat. `may_learn`: no engine is ordered to run.
    pub fn heartbeat(
        &mut self,
        now: Instant,
        from: Address,
        (mavtype, autopilot, base_mode): (u8, u8, u8),
        may_learn: bool,
    ) -> Option<VehicleEvent> {
        if from.component != COMPONENT_AUTOPILOT
            || from.system == 0
            || autopilot == AUTOPILOT_INVALID
            || mavtype == TYPE_GCS
        {
            return None;
        }
        match self.id {
            Some(id) if id == from.system => {
                self.own(now, base_mode & MODE_ARMED != 0).or_else(|| self.learn_own(now, id))
            }
            // Another one, while ours is absent.
            Some(_) if self.learns && !self.is_received(now) => self.learn(now, from.system, may_learn),
            // Ours is back, so that one is not its replacement.
            Some(id) if self.learns && self.learnt == from.system => self.two(id, from.system),
            Some(_) => None,
            None => self.learn(now, from.system, may_learn),
        }
    }

    fn learn(&mut self, now: Instant, system: u8, may_learn: bool) -> Option<VehicleEvent> {
        let received = |last: Instant| now < last + RECEIVED_WITHIN;
        let candidate = match self.candidate {
            Some(candidate) if candidate.system == system && received(candidate.last) => {
                Candidate { last: now, ..candidate }
            }
            Some(candidate) if candidate.system != system && received(candidate.last) => {
                self.other = Some((system, now));
                // From here on neither is the only one.
                self.candidate = Some(Candidate { since: now, ..candidate });
                return self.two(candidate.system, system);
            }
            _ => Candidate { system, since: now, last: now },
        };
        self.candidate = Some(candidate);
        let alone = self.other.is_none_or(|(_, last)| !received(last));
        if alone && may_learn && now >= candidate.since + LEARN && self.learnt != system {
            self.learnt = system;
            self.id.get_or_insert(system);
            return Some(VehicleEvent::Learnt(system));
        }
        None
    }

    /// Reports two autopilots, once.
    const fn two(&mut self, one: u8, other: u8) -> Option<VehicleEvent> {
        if core::mem::replace(&mut self.two_reported, true) {
            return None;
        }
        Some(VehicleEvent::TwoAutopilots(one, other))
    }

    /// Restores the id that the node has now where another one was learnt while ours was silent. Also while an engine is ordered to run:
    /// after a reset in flight the node must not follow another vehicle.
    fn learn_own(&mut self, now: Instant, id: u8) -> Option<VehicleEvent> {
        // Whoever was received in our autopilot's place has to be the only one for the whole time again.
        self.candidate = None;
        let again = self.since.is_some_and(|since| now >= since + LEARN);
        if !self.learns || self.learnt == id || !again {
            return None;
        }
        self.learnt = id;
        Some(VehicleEvent::Learnt(id))
    }

    fn own(&mut self, now: Instant, armed: bool) -> Option<VehicleEvent> {
        if self.same.0 == armed && self.last.is_some_and(|last| now < last + COPY) {
            return None;
        }
        let gap = !self.is_received(now);
        self.last = Some(now);
        if gap {
            self.since = Some(now);
        }
        let (before, count) = self.same;
        let count = if before == armed { count.saturating_add(1) } else { 1 };
        self.same = (armed, count);
        if armed || gap {
            self.disarmed_since = None;
        }
        if count < 2 {
            return None;
        }
        let before = self.arming;
        self.arming = if armed { Arming::Armed } else { Arming::Disarmed };
        if !armed && self.disarmed_since.is_none() {
            self.disarmed_since = Some(now);
        }
        (before == Arming::Armed && !armed).then_some(VehicleEvent::Disarmed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLANE: (u8, u8) = (1, 3);

    fn at(seconds: u64) -> Instant {
        Instant::from_secs(100 + seconds)
    }

    fn beat(vehicle: &mut Vehicle, seconds: u64, system: u8, base_mode: u8) -> Option<VehicleEvent> {
        let from = Address { system, component: 1 };
        vehicle.heartbeat(at(seconds), from, (PLANE.0, PLANE.1, base_mode), true)
    }

    #[test]
    fn the_only_autopilot_is_learnt_after_five_seconds() {
        let mut vehicle = Vehicle::new(0, 0);
        // A ground station and a camera are not autopilots.
        let ground = Address { system: 255, component: 1 };
        assert_eq!(vehicle.heartbeat(at(0), ground, (TYPE_GCS, AUTOPILOT_INVALID, 0), true), None);
        let camera = Address { system: 1, component: 100 };
        assert_eq!(vehicle.heartbeat(at(0), camera, (30, 3, 0), true), None);
        for second in 0..5 {
            assert_eq!(beat(&mut vehicle, second, 3, 0), None);
            assert!(vehicle.is_learning(at(second)));
        }
        assert_eq!(beat(&mut vehicle, 5, 3, 0), Some(VehicleEvent::Learnt(3)));
        assert_eq!(vehicle.id(), Some(3));
        // Another one beside it changes nothing.
        for second in 6..20 {
            assert_eq!(beat(&mut vehicle, second, 3, 0), None);
            assert_eq!(beat(&mut vehicle, second, 4, 0), None);
        }
        // In its place it is learnt once, and takes effect at the next start.
        let learnt: std::vec::Vec<_> =
            (20..60).filter_map(|second| beat(&mut vehicle, second, 4, 0)).collect();
        assert_eq!(learnt, [VehicleEvent::Learnt(4)]);
        assert_eq!(vehicle.id(), Some(3));
        assert_eq!((Vehicle::new(0, 4).id(), Vehicle::new(3, 4).id()), (Some(4), Some(3)));
    }

    #[test]
    fn of_two_autopilots_none_is_learnt_until_one_is_gone() {
        let mut vehicle = Vehicle::new(0, 0);
        beat(&mut vehicle, 0, 3, 0);
        assert_eq!(beat(&mut vehicle, 1, 4, 0), Some(VehicleEvent::TwoAutopilots(3, 4)));
        for second in 2..20 {
            assert_eq!(beat(&mut vehicle, second, 3, 0), None, "at {second} s");
            assert_eq!(beat(&mut vehicle, second, 4, 0), None, "reported once");
        }
        let learnt = (20..40).find_map(|second| beat(&mut vehicle, second, 3, 0));
        assert_eq!(learnt, Some(VehicleEvent::Learnt(3)));
    }

    #[test]
    fn our_autopilot_is_learnt_again_after_five_seconds_without_a_gap() {
        let mut vehicle = Vehicle::new(0, 3);
        let learnt = (0..6).find_map(|second| beat(&mut vehicle, second, 4, 0));
        assert_eq!(learnt, Some(VehicleEvent::Learnt(4)));
        // Twice with a gap, then without one.
        for second in [10, 12, 14, 20, 22, 24, 30, 32, 34] {
            assert_eq!(beat(&mut vehicle, second, 3, 0), None, "at {second} s");
        }
        assert_eq!(beat(&mut vehicle, 35, 3, 0), Some(VehicleEvent::Learnt(3)));
        assert_eq!(beat(&mut vehicle, 36, 3, 0), None, "once");
        // It is also while an engine is ordered to run: the id in force stays. Another one is not.
        let mut vehicle = Vehicle::new(0, 3);
        assert!((0..6).any(|second| beat(&mut vehicle, second, 4, 0).is_some()));
        let ordered = |vehicle: &mut Vehicle, second: u64, system: u8| {
            vehicle.heartbeat(at(second), Address { system, component: 1 }, (1, 3, 0), false)
        };
        let learnt = (10..16).find_map(|second| ordered(&mut vehicle, second, 3));
        assert_eq!(learnt, Some(VehicleEvent::Learnt(3)));
        assert_eq!((30..50).find_map(|second| ordered(&mut vehicle, second, 4)), None);
        // A set id is not learnt.
        let mut vehicle = Vehicle::new(3, 4);
        assert_eq!((0..20).find_map(|second| beat(&mut vehicle, second, 3, 0)), None);
    }

    #[test]
    fn nothing_is_learnt_while_an_engine_is_ordered() {
        let mut vehicle = Vehicle::new(0, 0);
        let from = Address { system: 3, component: 1 };
        for second in 0..20 {
            assert_eq!(vehicle.heartbeat(at(second), from, (1, 3, 0), false), None);
        }
        assert_eq!(vehicle.heartbeat(at(20), from, (1, 3, 0), true), Some(VehicleEvent::Learnt(3)));
    }

    #[test]
    fn it_takes_two_heartbeats_to_arm_and_to_disarm_and_silence_is_neither() {
        let mut vehicle = Vehicle::new(3, 0);
        assert_eq!(vehicle.arming(), Arming::Unknown);
        beat(&mut vehicle, 0, 3, MODE_ARMED);
        assert_eq!(vehicle.arming(), Arming::Unknown);
        beat(&mut vehicle, 1, 3, MODE_ARMED);
        assert_eq!(vehicle.arming(), Arming::Armed);
        assert_eq!(beat(&mut vehicle, 2, 3, 0), None);
        assert_eq!(vehicle.arming(), Arming::Armed);
        assert_eq!(beat(&mut vehicle, 3, 3, 0), Some(VehicleEvent::Disarmed));
        assert_eq!(vehicle.arming(), Arming::Disarmed);
        beat(&mut vehicle, 4, 3, 0);
        let disarmed_for =
            |vehicle: &Vehicle, now| vehicle.disarmed_for(at(now), at(0)).map(|it| it.as_secs());
        assert_eq!(disarmed_for(&vehicle, 4), Some(1));
        assert_eq!(disarmed_for(&vehicle, 7), Some(1), "up to the last heartbeat");
        assert_eq!(disarmed_for(&vehicle, 9), None, "silent");
        assert_eq!(vehicle.disarmed_for(at(4), at(7)), Some(Duration::MIN));
        // Other vehicles and silence change nothing; the time without a gap restarts.
        beat(&mut vehicle, 4, 7, MODE_ARMED);
        beat(&mut vehicle, 5, 7, MODE_ARMED);
        assert_eq!(vehicle.arming(), Arming::Disarmed);
        assert!(!vehicle.is_received(at(60)));
        assert_eq!(vehicle.arming(), Arming::Disarmed);
        beat(&mut vehicle, 60, 3, 0);
        beat(&mut vehicle, 62, 3, 0);
        assert_eq!(disarmed_for(&vehicle, 62), Some(2));
    }
}

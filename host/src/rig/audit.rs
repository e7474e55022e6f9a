//! Compares every frame that the node sends with its pilot's commands.
//!
//! The bytes are those at the node's transmitter, before any fault, and the simulation reads them (`sim::control`), not
//! jetlink. An order in force when the frame was made has to allow it, by the documented rules of jetlink:
//!
//! - listening, after a power-up or a reset: only what the ECU obeyed before;
//! - standby: standby at throttle 0;
//! - run at a throttle: that throttle, or 0 during the start;
//! - run at an rpm: that rpm, or the idle rpm or 0 during the start;
//! - after a start, a take-over, a gap in the ECU's frames, or a reset: a demand that rises from the last one on the
//!   wire to the commanded one, at most at 50 % a second;
//! - its source is lost, or another one is about to take over: no higher throttle than before;
//! - a run that the node cancels: standby, where the simulated engine had stopped, or its ECU fell silent in the start;
//! - ZK beside these: ID 0, and ID 2 with the configured rate; in standby and stop, ID 2 that closes the pump, shortly after
//!   the node has received a status that shows a pump voltage of an engine at rest.
//!
//! Anything else is an unsolicited command.

mod amt;
mod vendor;
mod zk;

use super::engines::Engine;
use super::simulated::parameters;
use jetlink::command::{Demand, Order};
use sim::control::{self, Command, Found, Reader, Switch};
use sim::ecu::{MILLIS, Nanos, SECOND};
use sim::turbine::Phase;
use sim::wire::{Direction, Entry, Fate};
use std::collections::VecDeque;
pub use vendor::WireCommand;
use vendor::{Judge as _, Level, Rise};

/// Largest age of a frame at its first bit: it was made before the order changed.
const MADE_BEFORE: Nanos = 50 * MILLIS;
/// Bytes of one frame follow each other; after a longer gap another frame begins.
const LONGEST_GAP: Nanos = 5 * MILLIS;
/// Findings that are stored; all are counted.
const FINDING_CAPACITY: usize = 5;
/// Periods of the ECU's frames without one after which nothing is on the wire.
const NOTHING_AFTER: Nanos = 3;
/// Time by which a rise after a gap or a reset has ended: 10 s of doubt, 2 s from idle to full, and a frame.
const RISE_WITHIN: Nanos = 13 * SECOND;
/// A rise after a start: the time that a start may take, and the rise.
const RISE_AFTER_START: Nanos = 125 * SECOND;
/// ECUs report whole or half percents, here in tenths.
const REPORTED_GRAIN: u16 = 10;
/// Longest duration of a good start of a simulated engine.
const START_TAKES: Nanos = 30 * SECOND;
/// Time in which two reports of the ECU show that the engine stopped or runs, though noise may damage some.
const REPORTED_WITHIN: Nanos = 3 * SECOND;
/// Without a confirmation an order is given up after 10 s, or an AMT ECU's serial delay time.
const UNCONFIRMED: Nanos = 11 * SECOND;
/// From the arrival of a run to the first step of its start.
const MISREAD_ACTS_WITHIN: Nanos = 100 * MILLIS;
/// Time without any source after which an engine that is not known to run is shut down: 10 s, of which the
/// node counts 0.2 s for each reset, however short.
const ALL_SILENT: Nanos = 8 * SECOND;

/// A frame that no order allows.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Finding {
    /// When its first bit was sent.
    pub at: Nanos,
    /// The frame.
    pub bytes: Vec<u8>,
    /// Its command, and what was in force.
    pub what: String,
}

/// A frame of the node on the wire.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct TransmittedFrame {
    /// Its first start bit.
    pub from: Nanos,
    /// Its last stop bit.
    pub to: Nanos,
    /// The command in it.
    pub command: WireCommand,
    /// It is the switch alone, at run: the demand is in another frame.
    pub switches_to_run: bool,
}

/// Frames that the node may send.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Allowed {
    /// What this order allows.
    Order(Order),
    /// A run at this demand or any lower one.
    UpTo(Highest),
    /// The last command before its reset, to the resolution of the ECU's reports.
    Again(WireCommand),
}

/// The highest demand of each kind.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
struct Highest {
    tenths: u16,
    rpm: u32,
}

impl Highest {
    /// The demand of a run on the wire.
    const fn of(wire: WireCommand) -> Option<Self> {
        match wire {
            WireCommand::Run(tenths) => Some(Self { tenths, rpm: 0 }),
            WireCommand::RunRpm(rpm) => Some(Self { tenths: 0, rpm }),
            WireCommand::Stop | WireCommand::Standby | WireCommand::Nothing => None,
        }
    }

    /// This one, or the demand if that is higher.
    fn or(self, demand: Demand) -> Self {
        match demand {
            Demand::Throttle(throttle) => Self { tenths: self.tenths.max(throttle.tenths()), ..self },
            Demand::Rpm(rpm) => Self { rpm: self.rpm.max(rpm.get()), ..self },
        }
    }
}

impl core::fmt::Display for Highest {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self.rpm {
            0 => write!(f, "throttle up to {:.1} %", f64::from(self.tenths) / 10.0),
            rpm => write!(f, "up to {rpm} rpm"),
        }
    }
}

impl core::fmt::Display for Allowed {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Order(order) => order.fmt(f),
            Self::UpTo(highest) => write!(f, "run, {highest}"),
            Self::Again(command) => write!(f, "as before the reset: {command}"),
        }
    }
}

/// Gaps between the ECU's frames on the wire, by the fate of each byte.
#[derive(Clone, Debug)]
struct Received {
    /// Between two frames of the ECU.
    period: Nanos,
    /// Damaged frames look like whole ones (AMT: no checksum).
    unchecked: bool,
    /// The last byte of the frame in progress, and whether it has arrived intact so far.
    frame: Option<(Nanos, bool)>,
    /// The last bit of the last whole frame.
    whole: Option<Nanos>,
    /// When three expected frames were missing, or a damaged one could be taken for another.
    gap: Option<Nanos>,
}

impl Received {
    /// A byte from the ECU, or one added by noise.
    fn byte(&mut self, entry: &Entry) {
        let arrived = entry.fate == Fate::Delivered;
        match &mut self.frame {
            Some((end, whole)) if entry.start <= *end + LONGEST_GAP => {
                (*end, *whole) = (entry.end, *whole && arrived);
            }
            _ => {
                self.end_frame();
                self.frame = Some((entry.end, arrived));
            }
        }
        self.find_gap(entry.end);
    }

    fn end_frame(&mut self) {
        match self.frame.take() {
            Some((end, true)) => self.whole = Some(end),
            Some((end, false)) if self.unchecked => self.gap = Some(end),
            _ => {}
        }
    }

    fn find_gap(&mut self, now: Nanos) {
        if self.frame.is_some_and(|(end, _)| now > end + LONGEST_GAP) {
            self.end_frame();
        }
        // A frame lasts up to one period.
        if self.whole.is_none_or(|whole| now >= whole + 3 * self.period) {
            self.gap = Some(now);
        }
    }
}

/// Watches one line.
#[derive(Clone, Debug)]
pub struct Audit {
    judges: Judges,
    cadence: Option<Nanos>,
    idle_rpm: u32,
    /// The orders and their times, the oldest relevant one first.
    orders: VecDeque<(Nanos, Allowed)>,
    reader: Reader,
    /// Reads what arrives at the ECU, as the ECU does.
    arrived: Reader,
    /// Times at which a run arrived that the node has not sent, made by noise.
    misread_runs: Vec<Nanos>,
    /// The first bit of the last frame.
    frame_start: Nanos,
    /// The last reset: frames begun before belong to the earlier life of the node.
    reset_at: Option<Nanos>,
    /// The last demand on the wire.
    level: Option<Level>,
    /// The last speed on the wire: a node that is in doubt repeats it, or lowers it, whatever is commanded meanwhile.
    last_rpm: Option<u32>,
    /// The demand may still be on its way up to the commanded one, until then.
    rises_until: Option<Nanos>,
    received: Received,
    /// The last gap that a rise was allowed for.
    gap_seen: Option<Nanos>,
    /// When run was ordered after something else; 0: never.
    started_at: Nanos,
    /// When the engine was last seen to stop, and whether it was live when it was last seen.
    stopped_at: Option<Nanos>,
    was_live: bool,
    /// Since when it has been seen running.
    running_since: Option<Nanos>,
    reported_running: bool,
    /// When a source last commanded.
    commanded_at: Nanos,
    /// The first bit of the frame in the last send slot.
    last_slot: Option<Nanos>,
    /// The first bit of the last frame, if the next one may share its send slot.
    slot_shared_at: Option<Nanos>,
    /// The node's last command that concerns the switch or the demand.
    pub on_wire: Option<WireCommand>,
    /// The last bits of the last frame that does, and of the last frame of any kind.
    commanded_until: Nanos,
    sent_until: Nanos,
    /// The first bit of the first frame of the last emergency stop.
    pub stop_at: Option<Nanos>,
    /// All that it sent; stored for a scenario's judge.
    pub transmitted: Option<Vec<TransmittedFrame>>,
    /// Frames of the node.
    pub frames: u64,
    /// Frames sent before the ECU sent anything: it was still starting up.
    pub frames_before_ecu: u64,
    ecu_sent: bool,
    /// The largest difference of two slots' distance from the cadence, see [`Audit::measure_cadence`].
    pub worst_cadence_error: Option<Nanos>,
    /// Number of frames that no order allows.
    pub not_given: u64,
    /// The first of them.
    pub findings: Vec<Finding>,
    /// The frames' commands are judged.
    pub judged: bool,
}

macro_rules! judges {
    ($($(#[$doc:meta])* $name:ident $module:ident($config:ty, $ecu:ty, $command:ty);)+) => {
        /// The judges of all protocols for one engine.
        #[derive(Clone, Debug)]
        struct Judges {
            $($(#[$doc])* $module: $module::Judge,)+
        }

        impl Judges {
            fn new(engine: &Engine) -> Self {
                Self { $($module: $module::Judge::new(engine),)+ }
            }

            fn wire(&self, command: Command) -> WireCommand {
                match command {
                    $(Command::$name(command) => self.$module.wire(command),)+
                }
            }

            fn allows(&self, command: Command, order: Order, rise: &Rise) -> bool {
                match command {
                    $(Command::$name(command) => self.$module.allows(command, order, rise),)+
                }
            }

            fn received(&mut self, entry: &Entry, at_rest: bool) {
                $(self.$module.received(entry, at_rest);)+
            }

            fn shares_slot(&self, command: Command) -> bool {
                match command {
                    $(Command::$name(command) => self.$module.shares_slot(command),)+
                }
            }

            fn switches_to_run(&self, command: Command) -> bool {
                match command {
                    $(Command::$name(command) => self.$module.switches_to_run(command),)+
                }
            }

            fn rpm_step(&self, command: Command) -> u32 {
                match command {
                    $(Command::$name(_) => self.$module.rpm_step(),)+
                }
            }
        }
    };
}
sim::protocols!(judges);

impl Audit {
    /// For this engine's line. The node begins by listening, and the ECU obeys no run.
    pub fn new(engine: &Engine) -> Self {
        Self {
            judges: Judges::new(engine),
            cadence: engine.cadence(),
            idle_rpm: parameters(engine).idle_rpm as u32,
            orders: VecDeque::from([(0, Allowed::Order(Order::Listen)), (0, Allowed::Order(Order::Standby))]),
            on_wire: None,
            commanded_until: 0,
            sent_until: 0,
            stop_at: None,
            transmitted: None,
            reader: Reader::strict(engine.ecu.protocol(), LONGEST_GAP),
            arrived: Reader::new(engine.ecu.protocol()),
            misread_runs: Vec::new(),
            frame_start: 0,
            reset_at: None,
            level: None,
            last_rpm: None,
            rises_until: None,
            received: Received {
                period: engine.ecu_period(),
                unchecked: !engine.ecu.protocol().has_checksum(),
                frame: None,
                whole: None,
                gap: None,
            },
            gap_seen: None,
            started_at: 0,
            stopped_at: None,
            was_live: false,
            running_since: None,
            reported_running: false,
            commanded_at: 0,
            last_slot: None,
            slot_shared_at: None,
            frames: 0,
            frames_before_ecu: 0,
            ecu_sent: false,
            worst_cadence_error: None,
            not_given: 0,
            findings: Vec::new(),
            judged: true,
        }
    }

    /// The source of commands is unknown here: the frames' commands are not judged.
    pub fn judge_no_orders(&mut self) {
        self.judged = false;
    }

    /// What is on the wire now; `None`: nothing. An AMT node only replies, so it sends nothing to a silent ECU.
    pub fn on_wire_now(&self, now: Nanos) -> Option<WireCommand> {
        let lately = |until: Nanos| now <= until + NOTHING_AFTER * self.received.period;
        match self.on_wire {
            Some(command) if lately(self.commanded_until) => Some(command),
            _ => (self.frames > 0 && lately(self.sent_until)).then_some(WireCommand::Nothing),
        }
    }

    /// This order is in force from now on.
    pub fn ordered(&mut self, at: Nanos, order: Order) {
        let before = self.orders.back().map(|&(_, allowed)| allowed);
        match (before, order) {
            (Some(Allowed::Order(Order::Run(_))), _) => {}
            (Some(Allowed::UpTo(_) | Allowed::Again(_)), Order::Run(_)) => self.may_rise(at + RISE_WITHIN),
            (_, Order::Run(_)) => {
                self.started_at = at;
                self.may_rise(at + RISE_AFTER_START);
            }
            _ => {}
        }
        self.allow(at, Allowed::Order(order));
    }

    /// When a start was last ordered.
    pub fn start_ordered_at(&self) -> Option<Nanos> {
        (self.started_at > 0).then_some(self.started_at)
    }

    /// A source has commanded, whatever it was.
    pub fn commanded(&mut self, at: Nanos) {
        self.commanded_at = at;
    }

    fn may_rise(&mut self, until: Nanos) {
        self.rises_until = self.rises_until.max(Some(until));
    }

    /// The source of a running engine is lost, or one with this demand waits to take over: from now on the demand may be
    /// anything up to this one, or up to the present one. With no run on the wire nothing changes.
    pub fn may_be_up_to(&mut self, at: Nanos, demand: Option<Demand>) {
        let now = match (self.on_wire, self.orders.back()) {
            (_, Some(&(_, Allowed::Order(Order::Standby | Order::EmergencyStop)))) => return,
            (Some(wire), _) => Highest::of(wire),
            // After a reset: what the ECU reports of it.
            (None, Some(&(_, Allowed::Again(WireCommand::Run(before))))) => {
                Some(Highest { tenths: before + REPORTED_GRAIN, rpm: 0 })
            }
            (None, Some(&(_, Allowed::Again(before)))) => Highest::of(before),
            (None, Some(&(_, Allowed::UpTo(highest)))) => Some(highest),
            _ => None,
        };
        let Some(now) = now else { return };
        self.allow(at, Allowed::UpTo(demand.map_or(now, |demand| now.or(demand))));
    }

    /// The node was reset: it may send again what it sent before, and nothing else, until something is ordered.
    pub fn reset(&mut self, at: Nanos) {
        self.reader.restart();
        self.reset_at = Some(at);
        // The node receives nothing meanwhile.
        (self.received.gap, self.received.whole) = (Some(at), None);
        self.last_slot = None;
        self.slot_shared_at = None;
        let retained = match (self.on_wire.take(), self.orders.back()) {
            // These are retained, though they may not have been sent yet.
            (_, Some(&(_, Allowed::Order(Order::EmergencyStop)))) => Allowed::Again(WireCommand::Stop),
            (_, Some(&(_, Allowed::Order(Order::Standby)))) => Allowed::Again(WireCommand::Standby),
            (Some(before), _) => Allowed::Again(before),
            // Nothing was sent since the reset before.
            (None, Some(&(_, before @ (Allowed::Again(_) | Allowed::UpTo(_))))) => before,
            (None, Some(&(_, Allowed::Order(Order::Run(demand))))) => {
                Allowed::UpTo(Highest::default().or(demand))
            }
            (None, _) => Allowed::Again(WireCommand::Standby),
        };
        self.allow(at, retained);
        self.may_rise(at + RISE_WITHIN);
    }

    fn allow(&mut self, at: Nanos, allowed: Allowed) {
        if self.orders.back().is_none_or(|&(_, last)| last != allowed) {
            self.orders.push_back((at, allowed));
        }
    }

    /// Takes the present state of the simulated engine.
    pub fn see_engine(&mut self, at: Nanos, phase: Phase) {
        if self.was_live && !phase.is_live() {
            self.stopped_at = Some(at);
        }
        self.was_live = phase.is_live();
        let since = matches!(phase, Phase::Running).then(|| self.running_since.unwrap_or(at));
        self.running_since = since;
        self.received.find_gap(at);
        let since = since.map(|since| self.received.gap.map_or(since, |gap| gap.max(since)));
        let reported = since.is_some_and(|since| at >= since + REPORTED_WITHIN);
        self.reported_running = self.was_live && (self.reported_running || reported);
    }

    /// Whether the engine runs and its ECU has reported it: a disarm ends a start before that, and no run after it.
    pub const fn is_known_to_run(&self) -> bool {
        self.reported_running
    }

    /// The node itself orders standby, perhaps reported slightly late. It may if the engine had stopped, if its ECU fell
    /// silent during the start, if the start has timed out, or if no source has commanded for long while it still starts or
    /// its ECU is silent.
    pub fn cancelled(&mut self, at: Nanos, phase: Phase) {
        self.see_engine(at, phase);
        self.received.find_gap(at);
        // After a reset it reports the standby that it had before.
        let before = self.orders.back().map(|&(_, allowed)| allowed);
        if matches!(before, Some(Allowed::Order(Order::Standby) | Allowed::Again(WireCommand::Standby))) {
            return self.standby_took_effect(at);
        }
        let stopped =
            !self.was_live || self.stopped_at.is_some_and(|stopped| at <= stopped + REPORTED_WITHIN);
        let starting = phase.is_starting()
            && (at >= self.started_at + START_TAKES || self.received.gap >= Some(self.started_at));
        let in_doubt = phase.is_starting() || self.received.gap >= Some(self.commanded_at);
        let forsaken = at >= self.commanded_at + ALL_SILENT && in_doubt;
        if stopped || starting || forsaken {
            self.standby_took_effect(at);
        } else {
            // On the wire this is an unsolicited standby, but the pilot's own may come first.
            self.find(at, Vec::new(), "the node gave up a running engine and goes to standby");
        }
    }

    /// The standby that a source commanded before is in force, and may have been a little before. It is reported by an event, which
    /// may be older than an emergency stop: that is latched, and only its release ends it.
    pub fn standby_took_effect(&mut self, at: Nanos) {
        if let Some(&(_, Allowed::Order(Order::EmergencyStop))) = self.orders.back() {
            return;
        }
        let last = self.orders.back().map_or(0, |&(from, _)| from);
        self.ordered(at.saturating_sub(MADE_BEFORE).max(last), Order::Standby);
    }

    /// The node has given up an order that was unconfirmed for too long. It may if its ECU fell silent. Then it may
    /// send nothing, or again what it sent before.
    pub fn given_up(&mut self, at: Nanos) {
        self.received.find_gap(at);
        if self.received.gap.is_some_and(|gap| at <= gap + UNCONFIRMED) {
            self.allow(at, Allowed::Again(self.on_wire.unwrap_or(WireCommand::Standby)));
            self.may_rise(at + RISE_WITHIN);
        } else {
            self.find(at, Vec::new(), "the node gave up an order, although its ECU was received");
        }
    }

    /// Takes the recording of the line.
    pub fn look(&mut self, entries: &[Entry]) {
        for entry in entries {
            match entry.direction {
                Direction::ToNode => {
                    self.received.byte(entry);
                    self.judges.received(entry, !self.was_live);
                }
                Direction::ToEcu => self.arrives(entry),
            }
            match (entry.direction, entry.fate) {
                (_, Fate::Added) => {}
                // The byte cut off by the reset.
                (Direction::ToEcu, _) if self.reset_at.is_some_and(|at| entry.start <= at) => {}
                (Direction::ToNode, _) => self.ecu_sent = true,
                (Direction::ToEcu, _) => self.byte(entry),
            }
        }
    }

    /// The recording has been taken up to this time: older orders can be forgotten.
    pub fn looked_until(&mut self, at: Nanos) {
        self.misread_runs.retain(|&run| at <= run + 2 * MISREAD_ACTS_WITHIN);
        while self.orders.get(1).is_some_and(|&(from, _)| from + 2 * MADE_BEFORE < at) {
            self.orders.pop_front();
        }
    }

    /// A byte as the ECU receives it.
    fn arrives(&mut self, entry: &Entry) {
        let arrived = match entry.fate {
            Fate::Delivered => *entry,
            Fate::Flipped(byte) => Entry { byte, ..*entry },
            Fate::Added => Entry { fate: Fate::Flipped(entry.byte), ..*entry },
            Fate::Lost | Fate::Framing(_) => return,
        };
        if let Some(Found::Frame(frame)) = self.arrived.entry(&arrived)
            && !frame.delivered
            && frame.command.is_ok_and(|command| command.switch() == Some(Switch::Run))
        {
            self.misread_runs.push(frame.end);
        }
    }

    /// Whether a run made by noise arrived right before this time.
    pub fn is_misread(&self, at: Nanos) -> bool {
        self.misread_runs.iter().any(|&run| run <= at && at <= run + MISREAD_ACTS_WITHIN)
    }

    fn byte(&mut self, entry: &Entry) {
        match self.reader.entry(entry) {
            Some(Found::Frame(frame)) => self.whole(&frame),
            Some(Found::Fragment { start, bytes }) => self.find(start, bytes, "a part of a frame"),
            None => {}
        }
    }

    fn whole(&mut self, frame: &control::Frame) {
        self.frames += 1;
        self.frames_before_ecu += u64::from(!self.ecu_sent);
        let start = frame.start;
        self.frame_start = start;
        self.received.find_gap(start);
        if let Some(gap) = self.received.gap
            && self.gap_seen.replace(gap) != Some(gap)
        {
            self.may_rise(gap + RISE_WITHIN);
        }
        self.measure_cadence(start, frame);
        let command = match frame.command {
            Ok(command) => command,
            Err(bad) => {
                return self.find(start, frame.bytes().to_vec(), &format!("not a valid frame: {bad}"));
            }
        };
        let wire = self.judges.wire(command);
        let by_rpm = matches!(wire, WireCommand::RunRpm(_));
        let of_other_kind = self.level.is_some_and(|level| level.value > 0 && level.by_rpm != by_rpm);
        let from_less = self.received.gap > self.level.map(|level| level.at);
        let rise = Rise { at: start, last: self.level, until: self.rises_until, from_less, of_other_kind };
        let allowed = self.any_order(wire, |order| self.judges.allows(command, order, &rise))
            || self.repeats_in_doubt(wire);
        if wire == WireCommand::Stop && self.on_wire != Some(WireCommand::Stop) {
            self.stop_at = Some(start);
        }
        self.sent_until = frame.end;
        if wire != WireCommand::Nothing {
            self.on_wire = Some(wire);
            if let WireCommand::RunRpm(rpm) = wire {
                self.last_rpm = Some(rpm);
            }
            self.commanded_until = frame.end;
        }
        self.note_level(wire, self.judges.rpm_step(command));
        let switches_to_run = self.judges.switches_to_run(command);
        let transmitted = TransmittedFrame { from: start, to: frame.end, command: wire, switches_to_run };
        self.transmitted.iter_mut().for_each(|all| all.push(transmitted));
        if !allowed {
            self.find(start, frame.bytes().to_vec(), &command.to_string());
        }
    }

    /// Measured from slot to slot. Frames that may precede their slot do not count, and do not shift the slots: the
    /// first frame of an emergency stop, and the frame that shares the slot of the one before.
    fn measure_cadence(&mut self, start: Nanos, frame: &control::Frame) {
        let Some(cadence) = self.cadence else { return };
        let command = frame.command.ok();
        let shared = command.is_some_and(|command| self.judges.shares_slot(command));
        let shared_at = core::mem::replace(&mut self.slot_shared_at, shared.then_some(start));
        let begins_stop = self.on_wire != Some(WireCommand::Stop)
            && command.is_some_and(|command| self.judges.wire(command) == WireCommand::Stop);
        let shares_slot = shared_at.is_some_and(|at| start < at + LONGEST_GAP);
        let Some(last) = self.last_slot else {
            self.last_slot = Some(start);
            return;
        };
        if start < last + cadence && (begins_stop || shares_slot) {
            return;
        }
        self.last_slot = Some(start);
        let error = (start - last).abs_diff(cadence);
        self.worst_cadence_error = self.worst_cadence_error.max(Some(error));
    }

    /// Whether an order that was in force when the frame was made allows it.
    fn any_order(&self, wire: WireCommand, allows: impl Fn(Order) -> bool) -> bool {
        let start = self.frame_start;
        let ends = self.orders.iter().skip(1).map(|&(from, _)| from).chain([Nanos::MAX]);
        self.orders
            .iter()
            .zip(ends)
            .filter(|&(&(from, _), end)| from <= start && end.saturating_add(MADE_BEFORE) >= start)
            .any(|(&(_, allowed), _)| match (allowed, wire) {
                (Allowed::Order(order), _) => allows(order),
                (Allowed::UpTo(highest), WireCommand::Run(tenths)) => tenths <= highest.tenths,
                (Allowed::UpTo(highest), WireCommand::RunRpm(rpm)) => rpm <= highest.rpm.max(self.idle_rpm),
                (Allowed::Again(WireCommand::Run(before)), WireCommand::Run(now)) => {
                    before.abs_diff(now) <= REPORTED_GRAIN
                }
                // A start by speed that the reset interrupted: idle.
                (Allowed::Again(WireCommand::RunRpm(_)), WireCommand::Run(0)) => true,
                (Allowed::Again(before), _) => wire == before || wire == WireCommand::Nothing,
                (Allowed::UpTo(_), _) => wire == WireCommand::Nothing,
            })
    }

    /// Whether the node repeats or lowers a speed, or repeats the switch with the throttle at idle, because it has not received its
    /// ECU: this starts no engine and raises no demand.
    fn repeats_in_doubt(&self, wire: WireCommand) -> bool {
        let runs = self
            .orders
            .iter()
            .any(|&(_, allowed)| matches!(allowed, Allowed::Order(Order::Run(_)) | Allowed::UpTo(_)));
        let in_doubt = self.received.gap.is_some_and(|gap| self.frame_start <= gap + UNCONFIRMED);
        let no_more = match wire {
            WireCommand::RunRpm(rpm) => self.last_rpm.is_some_and(|last| rpm <= last),
            WireCommand::Run(tenths) => tenths == 0,
            WireCommand::Stop | WireCommand::Standby | WireCommand::Nothing => false,
        };
        runs && in_doubt && no_more
    }

    /// Keeps the demand of this frame; it rises no more when it is the one that is given, to the step of the wire.
    fn note_level(&mut self, wire: WireCommand, rpm_step: u32) {
        let at = self.frame_start;
        let given = self.orders.back().map(|&(_, allowed)| allowed);
        let (value, arrived) = match (wire, given) {
            (WireCommand::Run(value), Some(Allowed::Order(Order::Run(Demand::Throttle(given))))) => {
                (value.into(), value > 0 && value == given.tenths())
            }
            (WireCommand::RunRpm(value), Some(Allowed::Order(Order::Run(Demand::Rpm(given))))) => {
                (value, value > self.idle_rpm && value / rpm_step == given.get() / rpm_step)
            }
            (WireCommand::Run(value), _) => (value.into(), false),
            (WireCommand::RunRpm(value), _) => (value, false),
            (WireCommand::Stop | WireCommand::Standby, _) => (0, false),
            (WireCommand::Nothing, _) => return,
        };
        self.level = Some(Level { at, value, by_rpm: matches!(wire, WireCommand::RunRpm(_)) });
        if arrived && self.received.gap.is_none_or(|gap| at > gap + MADE_BEFORE) {
            self.rises_until = None;
        }
    }

    fn find(&mut self, at: Nanos, bytes: Vec<u8>, what: &str) {
        if !self.judged {
            return;
        }
        self.not_given += 1;
        if self.findings.len() < FINDING_CAPACITY {
            let order = self.orders.iter().rev().find(|&&(from, _)| from <= at);
            let order = order.map_or(Allowed::Order(Order::Listen), |&(_, order)| order);
            let what = format!("{what}; allowed: {order}");
            self.findings.push(Finding { at, bytes, what });
        }
    }
}

#[cfg(test)]
mod tests;

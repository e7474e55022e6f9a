//! State that survives a reset: the order in force, its demand and its source, in memory that start-up does not clear.
//! A reset during a write leaves the record before or the new one ([`Copies`]).
//!
//! RAM may survive a short loss of power, and another image may be flashed over the one that wrote it. Then only the parts
//! of a record that can stop or preserve an engine are used: [`RetainedState::without_start`].

use crate::command::{Demand, Order, Origin};
use crate::copies::Copies;
use crate::event::LossStage;
use crate::link::LinkRecord;
use crate::units::{Rpm, Throttle};
use embassy_time::Duration;

/// Layout number. Change it with the layout, so that the record of an older firmware is discarded.
const LAYOUT: u32 = 0x4A4C_000A;
pub(crate) const WORDS: usize = 5;
/// Position of the fingerprint.
const FINGERPRINT: usize = 2;
/// Resolution of a retained silence, 20 ms, so that a record does not change with every frame.
pub(super) const SILENCE_STEP: Duration = Duration::from_millis(20);
const SILENCE_STEPS_MAX: u32 = 0xFFFF;
/// Steps of a coarse silence: 0.2 s, once a source was received after the last reset.
const COARSE: u32 = 10;
/// Bits of a demand in its word. The rest holds the lower bits of the silence of all sources.
const DEMAND_BITS: u32 = 18;
const SILENCE_LOW: u32 = u32::BITS - DEMAND_BITS;
/// Position of its higher bits, above the silence of one source and four bits of resets.
const SILENCE_HIGH_AT: u32 = 20;
const ALL_SILENCE_STEPS_MAX: u32 = (1 << (SILENCE_LOW + u32::BITS - SILENCE_HIGH_AT)) - 1;
/// Largest number of resets in its four bits.
const RESETS_FIELD_MAX: u32 = 15;
/// Time for which a fall is expected, above the four bits of the order. Rounded down, so that a loop of resets ends it.
pub(super) const FALL_EXPECTED: ShortTime = ShortTime { step: Duration::from_millis(500), at: 4, max: 15 };
/// Time for which a source has been received, above the three bits of the source. Rounded up, so that a source with one command
/// between two resets gets back in control.
pub(super) const STEADY: ShortTime = ShortTime { step: Duration::from_millis(200), at: 11, max: 31 };
/// Position of the stage of loss, two bits, and of the link's part above it.
const LOSS_AT: u32 = 24;
const LOSS_MAX: u32 = 3;
const LINK_AT: u32 = 28;
const _: () = assert!(LINK_AT + LinkRecord::BITS == u32::BITS);

/// Kind of the last reset of the node.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Reset {
    /// Power was not interrupted: watchdog, software, pin.
    Warm,
    /// Power was lost or dipped: nothing is restored that could start an engine or raise its demand.
    #[default]
    PowerLost,
}

/// Retained state of one engine.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct RetainedState {
    /// Order in force, also a latched emergency stop.
    pub order: Order,
    /// Origin of the order.
    pub origin: Origin,
    /// Whether the engine was armed.
    pub armed: bool,
    /// A limit was violated whose action is the fail-safe throttle: the demand stays there until standby is commanded.
    pub limited: bool,
    /// Stage of loss. A source that was lost has to be received without a gap before it is in control again.
    pub loss: LossStage,
    /// The engine ran, and stopped or fell silent without a command. It is reported to the other engines.
    pub failed: bool,
    /// The engine has reached running, and no standby, stop or end of its life has come since.
    pub ran: bool,
    /// The link's own part.
    pub link: LinkRecord,
    /// A service command may have opened the fuel pump, and it was not closed.
    pub pump_open: bool,
    /// Silence of the source in control, resets included, in steps of 20 ms, 21 min at most.
    pub silent: Duration,
    /// Silence of all sources, in steps of 20 ms.
    pub all_silent: Duration,
    /// Consecutive resets without a command of the source in control, 15 at most.
    pub resets: u8,
    /// Time since the start that is under way was ordered, in s; 0 without one, and with an engine that has reached running.
    pub starting: u16,
    /// Time without a confirmation of the engine that ran, and without a reply to its ECU, resets included, in steps of 20 ms,
    /// 21 min at most; 0 with an engine that has not reached running.
    pub unconfirmed: Duration,
    /// Three expected frames were missing in that time: the ECU may have restarted.
    pub after_gap: bool,
    /// A hot exhaust beside error sets does not show that the engine runs: its order was given up, or its ECU has reported that it does not.
    pub exhaust_ignored: bool,
    /// The engine was found in a state that a start has, too: nobody knows that it flew.
    pub unproven: bool,
    /// Error sets came since the last confirmation: of all states only "running" shows that the engine runs.
    pub after_faults: bool,
    /// The thermocouple jumped, or gave what none can: a cold exhaust does not show that the engine has stopped.
    pub egt_distrusted: bool,
    /// The source in control was lost: time for which it has been received without a gap since, in steps of 0.2 s, 6.2 s at most.
    pub steady: Duration,
    /// The demand was lowered: time for which a fall of the exhaust is expected yet, in steps of 0.5 s, rounded down.
    pub fall_expected: Duration,
    /// Sources that last commanded "arm", a bit each in the order of [`Origin::ALL`].
    pub arm_commanded: u8,
    /// Sources that have to disarm before their "arm" is accepted again, in the same order.
    pub must_disarm: u8,
}

impl RetainedState {
    /// A state with this order, and nothing else.
    pub const fn new(order: Order, origin: Origin) -> Self {
        Self {
            order,
            origin,
            armed: false,
            limited: false,
            loss: LossStage::None,
            failed: false,
            ran: matches!(order, Order::Run(_)),
            link: LinkRecord::EMPTY,
            pump_open: false,
            silent: Duration::from_ticks(0),
            all_silent: Duration::from_ticks(0),
            resets: 0,
            starting: 0,
            unconfirmed: Duration::from_ticks(0),
            after_gap: false,
            exhaust_ignored: false,
            unproven: false,
            after_faults: false,
            egt_distrusted: false,
            steady: Duration::from_ticks(0),
            fall_expected: Duration::from_ticks(0),
            arm_commanded: 0,
            must_disarm: 0,
        }
    }

    /// This state with changes.
    #[must_use]
    pub fn with(mut self, change: impl FnOnce(&mut Self)) -> Self {
        change(&mut self);
        self
    }

    /// Whether the engine neither ran nor started, and its pump was closed: then its port, its line and its ECU may be other ones from now on.
    /// What [`RetainedState::without_start`] leaves is enough to know it.
    pub const fn is_at_rest(&self) -> bool {
        !self.ran && self.starting == 0 && !self.pump_open && !matches!(self.order, Order::Pwm)
    }

    /// The parts that remain after a loss of power, or from another engine's record: those that can only stop or preserve an
    /// engine, never start it or raise its demand.
    pub const fn without_start(self) -> Self {
        let order = match self.order {
            Order::EmergencyStop => Order::EmergencyStop,
            Order::Standby => Order::Standby,
            // It becomes ID 0, which leaves a running engine to its PWM input.
            Order::Pwm if self.ran => Order::Pwm,
            Order::Run(_) | Order::Doubt(_) | Order::Pwm | Order::Listen => Order::Listen,
        };
        let origin = match order {
            Order::EmergencyStop | Order::Pwm => self.origin,
            _ => Origin::Node,
        };
        let Self {
            ran,
            link,
            pump_open,
            silent,
            all_silent,
            resets,
            starting,
            arm_commanded,
            must_disarm,
            exhaust_ignored,
            unproven,
            after_faults,
            unconfirmed,
            fall_expected,
            ..
        } = self;
        Self {
            ran,
            exhaust_ignored,
            unproven,
            after_faults,
            unconfirmed,
            fall_expected,
            link,
            pump_open,
            silent,
            all_silent,
            resets,
            starting,
            arm_commanded,
            must_disarm,
            ..Self::new(order, origin)
        }
    }

    /// The words of this state in memory, without the fingerprint. No state gives zeros only.
    pub(super) fn packed(&self) -> [u32; WORDS] {
        pack(self)
    }

    /// A time, rounded down to retained steps.
    pub(super) fn steps(time: Duration) -> Duration {
        SILENCE_STEP * steps(time, SILENCE_STEP)
    }

    /// Silence of a source, rounded down: to coarse steps while it is received, so that the record does not change with
    /// every command.
    pub(super) fn silence(silent: Duration, received: bool) -> Duration {
        let steps = steps(silent, SILENCE_STEP);
        SILENCE_STEP * if received { steps - steps % COARSE } else { steps }
    }
}

/// Memory for one engine's record. Place it where start-up does not clear it. After a power-up its contents are arbitrary,
/// and the checksum rejects them.
#[derive(Debug, Default)]
#[repr(C)]
pub struct RetainedMemory {
    words: Copies<WORDS, LAYOUT>,
}

impl RetainedMemory {
    /// Empty.
    pub const fn new() -> Self {
        Self { words: Copies::new() }
    }

    /// Loads the record. `fingerprint` identifies the engine
    /// ([`crate::config::EngineConfig::fingerprint`]); of another engine's record, and after a loss of power, only
    /// [`RetainedState::without_start`] is returned.
    pub fn load(&self, fingerprint: u32, reset: Reset) -> Option<RetainedState> {
        let words = self.words.load()?;
        let record = unpack(words)?;
        let whole = words[FINGERPRINT] == fingerprint && reset == Reset::Warm;
        Some(if whole { record } else { record.without_start() })
    }

    /// Whether an engine was not at rest, whichever engine's record it is.
    pub fn was_in_flight(&self) -> bool {
        self.load(0, Reset::PowerLost).is_some_and(|record| !record.is_at_rest())
    }

    /// Stores a record of the engine with this fingerprint. After a reset, call [`RetainedMemory::repair`] before the first time.
    pub fn store(&self, record: &RetainedState, fingerprint: u32) {
        self.store_packed(record.packed(), fingerprint);
    }

    /// The same, of a record that is packed already.
    pub(crate) fn store_packed(&self, mut words: [u32; WORDS], fingerprint: u32) {
        words[FINGERPRINT] = fingerprint;
        self.words.store(&words);
    }

    /// Repairs a copy that a reset during a write has left damaged ([`Copies::repair`]).
    pub fn repair(&self) {
        self.words.repair();
    }

    /// Clears the record: the next start restores nothing.
    pub fn clear(&self) {
        self.words.clear();
    }
}

/// Whole steps of a time.
#[inline(never)]
fn steps(time: Duration, step: Duration) -> u32 {
    let (time, step) = (time.as_ticks(), step.as_ticks());
    // A core divides 32 bits in some cycles, and takes hundreds for 64. 32 bits are 71 min.
    match (u32::try_from(time), u32::try_from(step)) {
        (Ok(time), Ok(step)) => time / step,
        _ => u32::try_from(time / step).unwrap_or(u32::MAX),
    }
}

/// A time of some seconds that shares a word with others: its resolution, its position, and its largest number of steps.
#[derive(Clone, Copy, Debug)]
pub(super) struct ShortTime {
    step: Duration,
    at: u32,
    max: u32,
}

impl ShortTime {
    /// A time as it is retained, rounded down.
    pub fn round(self, time: Duration) -> Duration {
        self.step * self.steps(time)
    }

    /// The same, rounded up.
    pub fn round_up(self, time: Duration) -> Duration {
        self.round(time + self.step - Duration::from_ticks(1))
    }

    fn steps(self, time: Duration) -> u32 {
        steps(time, self.step).min(self.max)
    }

    fn pack(self, time: Duration) -> u32 {
        self.steps(time) << self.at
    }

    fn unpack(self, word: u32) -> Duration {
        self.step * (word >> self.at & self.max)
    }
}

#[inline(never)]
fn pack(record: &RetainedState) -> [u32; WORDS] {
    let (order, value) = match record.order {
        Order::EmergencyStop => (1, 0),
        Order::Standby => (2, 0),
        Order::Run(Demand::Throttle(throttle)) | Order::Doubt(Demand::Throttle(throttle)) => {
            (3, u32::from(throttle.tenths()))
        }
        Order::Run(Demand::Rpm(rpm)) | Order::Doubt(Demand::Rpm(rpm)) => (4, rpm.get()),
        Order::Pwm => (5, 0),
        Order::Listen => (6, 0),
    };
    let flags = order
        | u32::from(record.origin.priority()) << 8
        | u32::from(record.armed) << 16
        | u32::from(record.limited) << 17
        | u32::from(record.failed) << 18
        | u32::from(record.ran) << 19
        | u32::from(record.exhaust_ignored) << 20
        | u32::from(record.pump_open) << 21
        | u32::from(record.after_gap) << 22
        | u32::from(record.after_faults) << 23
        | u32::from(record.egt_distrusted) << 26
        | u32::from(record.unproven) << 27
        | FALL_EXPECTED.pack(record.fall_expected)
        | STEADY.pack(record.steady)
        | (record.loss as u32) << LOSS_AT
        | u32::from(record.link.bits()) << LINK_AT;
    let all_silent = steps(record.all_silent, SILENCE_STEP).min(ALL_SILENCE_STEPS_MAX);
    let silence = steps(record.silent, SILENCE_STEP).min(SILENCE_STEPS_MAX)
        | u32::from(record.resets).min(RESETS_FIELD_MAX) << 16
        | all_silent >> SILENCE_LOW << SILENCE_HIGH_AT;
    // An engine is in a start, or it has reached running: one place for the time of either.
    let time = match record.ran {
        true => steps(record.unconfirmed, SILENCE_STEP).min(SILENCE_STEPS_MAX),
        false => record.starting.into(),
    };
    let arming = u32::from(record.arm_commanded) | u32::from(record.must_disarm) << 8 | time << 16;
    let value = value.min((1 << DEMAND_BITS) - 1) | all_silent << DEMAND_BITS;
    // The fingerprint has its place between them.
    [flags, value, 0, silence, arming]
}

fn unpack([flags, value, _, silence, arming]: [u32; WORDS]) -> Option<RetainedState> {
    let all_silent = value >> DEMAND_BITS | silence >> SILENCE_HIGH_AT << SILENCE_LOW;
    let value = value & ((1 << DEMAND_BITS) - 1);
    let order = match flags & 0xF {
        1 => Order::EmergencyStop,
        2 => Order::Standby,
        3 => Order::Run(Demand::Throttle(Throttle::from_tenths(u16::try_from(value).ok()?).ok()?)),
        4 => Order::Run(Demand::Rpm(Rpm::new(value))),
        5 => Order::Pwm,
        6 => Order::Listen,
        _ => return None,
    };
    let priority = flags >> 8 & 7;
    let origin = Origin::ALL.into_iter().find(|origin| u32::from(origin.priority()) == priority)?;
    let loss = match flags >> LOSS_AT & LOSS_MAX {
        0 => LossStage::None,
        1 => LossStage::Hold,
        2 => LossStage::FailSafe,
        _ => LossStage::Standby,
    };
    let flag = |bit: u32| flags >> bit & 1 == 1;
    let (ran, time) = (flag(19), arming >> 16);
    Some(RetainedState {
        order,
        origin,
        armed: flag(16),
        limited: flag(17),
        failed: flag(18),
        ran,
        pump_open: flag(21),
        loss,
        link: LinkRecord::new(u8::try_from(flags >> LINK_AT).ok()?),
        silent: SILENCE_STEP * (silence & 0xFFFF),
        all_silent: SILENCE_STEP * all_silent,
        resets: u8::try_from(silence >> 16 & RESETS_FIELD_MAX).ok()?,
        arm_commanded: u8::try_from(arming & 0xFF).ok()?,
        must_disarm: u8::try_from(arming >> 8 & 0xFF).ok()?,
        starting: if ran { 0 } else { u16::try_from(time).ok()? },
        unconfirmed: SILENCE_STEP * if ran { time } else { 0 },
        after_gap: flag(22),
        exhaust_ignored: flag(20),
        unproven: flag(27),
        after_faults: flag(23),
        egt_distrusted: flag(26),
        steady: STEADY.unpack(flags),
        fall_expected: FALL_EXPECTED.unpack(flags),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(tenths: u16) -> RetainedState {
        let order = Order::Run(Demand::Throttle(Throttle::from_tenths(tenths).unwrap()));
        RetainedState { armed: true, ..RetainedState::new(order, Origin::Rc) }
    }

    const OURS: u32 = 0x1234_5678;

    fn load(memory: &RetainedMemory) -> Option<RetainedState> {
        memory.load(OURS, Reset::Warm)
    }

    #[test]
    fn every_order_and_source_comes_back() {
        let memory = RetainedMemory::new();
        assert_eq!(load(&memory), None, "empty");
        let orders = [Order::EmergencyStop, Order::Standby, run(637).order, Order::Pwm, Order::Listen];
        for order in orders.into_iter().chain([Order::Run(Demand::Rpm(Rpm::new(123_450)))]) {
            for origin in Origin::ALL {
                let stages = [LossStage::None, LossStage::Hold, LossStage::FailSafe, LossStage::Standby];
                for (flags, loss) in (0..1024).flat_map(|flags: u32| stages.map(|loss| (flags, loss))) {
                    let flag = |bit: u32| flags >> bit & 1 == 1;
                    let record = RetainedState {
                        order,
                        origin,
                        armed: flag(0),
                        limited: flag(1),
                        failed: flag(2),
                        ran: flag(3),
                        link: LinkRecord::new(flags as u8 >> 2 & 15),
                        pump_open: flag(5),
                        loss,
                        silent: Duration::from_millis(20 * flags as u64),
                        all_silent: Duration::from_secs(1_000 * flags as u64),
                        resets: (flags & 15) as u8,
                        arm_commanded: (flags & 31) as u8,
                        must_disarm: (flags >> 1) as u8 & 31,
                        starting: if flag(3) { 0 } else { flags as u16 * 50 },
                        unconfirmed: Duration::from_millis(if flag(3) { 20 * 50 * flags as u64 } else { 0 }),
                        after_gap: flag(6),
                        exhaust_ignored: flag(7),
                        unproven: flag(1) != flag(7),
                        after_faults: flag(8),
                        egt_distrusted: flag(9),
                        steady: Duration::from_millis(200 * (flags as u64 & 31)),
                        fall_expected: Duration::from_millis(500 * (flags as u64 & 15)),
                    };
                    memory.store(&record, OURS);
                    assert_eq!(load(&memory), Some(record));
                }
            }
        }
    }

    #[test]
    fn lost_power_or_another_engine_leaves_nothing_that_starts_or_raises() {
        let memory = RetainedMemory::new();
        let full = RetainedState {
            link: LinkRecord::new(9),
            pump_open: true,
            resets: 2,
            loss: LossStage::Hold,
            ..run(800)
        };
        memory.store(&full, OURS);
        let left = RetainedState {
            ran: true,
            link: LinkRecord::new(9),
            pump_open: true,
            resets: 2,
            ..RetainedState::new(Order::Listen, Origin::Node)
        };
        assert_eq!(memory.load(OURS, Reset::PowerLost), Some(left));
        assert_eq!(memory.load(OURS + 1, Reset::Warm), Some(left));
        assert_eq!(memory.load(OURS, Reset::Warm), Some(full), "beside the one where it is whole");
        let stop = RetainedState { armed: true, ..RetainedState::new(Order::EmergencyStop, Origin::Rc) };
        memory.store(&stop, OURS);
        assert_eq!(
            memory.load(OURS, Reset::PowerLost),
            Some(RetainedState { armed: false, ..stop }),
            "a stop stays"
        );
    }
}

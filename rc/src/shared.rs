//! Outputs of all engines as other tasks see them: the task that drives the pins runs above thread mode, log and MAVLink run in
//! it.

use crate::outputs::{Change, Outputs, Valve};
use crate::wiring::OutputConfig;
use core::sync::atomic::{AtomicU8, Ordering};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::pubsub::{PubSubChannel, Subscriber};

/// Capacity of the queue of changes. A slow subscriber loses the oldest ones.
const CAPACITY: usize = 16;
/// Subscribers: a log, and MAVLink.
const SUBSCRIBERS: usize = 2;

/// Subscription to changes, each with the place of its engine.
pub type Changes<'a> = Subscriber<'a, CriticalSectionRawMutex, (usize, Change), CAPACITY, SUBSCRIBERS, 0>;

const HAS_VALVE: u8 = 1;
const OPEN: u8 = 2;
const HAS_POWER: u8 = 4;
const ON: u8 = 8;
const CUT: u8 = 16;

/// Outputs of up to `N` engines.
pub struct Shared<const N: usize> {
    states: [AtomicU8; N],
    changes: PubSubChannel<CriticalSectionRawMutex, (usize, Change), CAPACITY, SUBSCRIBERS, 0>,
}

impl<const N: usize> core::fmt::Debug for Shared<N> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Shared").field("states", &self.states).finish_non_exhaustive()
    }
}

impl<const N: usize> Default for Shared<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> Shared<N> {
    /// For a static. No engine has outputs yet.
    pub const fn new() -> Self {
        Self { states: [const { AtomicU8::new(0) }; N], changes: PubSubChannel::new() }
    }

    /// Publishes the outputs of an engine, by its place, and the changes of those that have a pin.
    pub fn set(
        &self,
        engine: usize,
        config: &OutputConfig,
        outputs: &Outputs,
        changes: impl IntoIterator<Item = Change>,
    ) {
        let Some(state) = self.states.get(engine) else { return };
        let bit = |is: bool, bit: u8| if is { bit } else { 0 };
        let bits = bit(config.valve.is_some(), HAS_VALVE)
            | bit(outputs.valve() == Valve::Open, OPEN)
            | bit(config.power.is_some(), HAS_POWER)
            | bit(outputs.power(), ON)
            | bit(outputs.is_cut(), CUT);
        state.store(bits, Ordering::Relaxed);
        for change in changes {
            let has_pin = match change {
                Change::Valve(..) => config.valve.is_some(),
                Change::Power(..) => config.power.is_some(),
            };
            if has_pin {
                self.changes.immediate_publisher().publish_immediate((engine, change));
            }
        }
    }

    /// Whether the valve of an engine is open; `None`: it has none.
    pub fn valve_is_open(&self, engine: usize) -> Option<bool> {
        self.look(engine, HAS_VALVE, OPEN)
    }

    /// Whether starter and ignition of an engine have power; `None`: no output switches it.
    pub fn power_is_on(&self, engine: usize) -> Option<bool> {
        self.look(engine, HAS_POWER, ON)
    }

    /// Whether the valve of each engine is closed because the firmware failed in repeated starts.
    pub fn cut(&self) -> impl Iterator<Item = bool> {
        self.states.iter().map(|state| state.load(Ordering::Relaxed) & CUT != 0)
    }

    fn look(&self, engine: usize, has: u8, is: u8) -> Option<bool> {
        let bits = self.states.get(engine)?.load(Ordering::Relaxed);
        (bits & has != 0).then_some(bits & is != 0)
    }

    /// Subscribes to changes from now on. `None`: there are already enough subscribers.
    pub fn changes(&self) -> Option<Changes<'_>> {
        self.changes.subscriber().ok()
    }
}

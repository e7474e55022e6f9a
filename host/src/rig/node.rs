//! The node of a run, as other code sees it: it can be reset, and is then away for a while.
//!
//! The tasks that own the lines live and die with the [`Channel`]s. All other code reads here, and gets the last
//! known state while the node is away.

use super::engines::{Engine, MOST_ENGINES};
use embassy_time::Duration;
use jetlink::channel::Channel;
use jetlink::command::{Accepted, Command, Demand, Origin, Rejected};
use jetlink::config::EngineConfig;
use jetlink::engine::retained::{self, RetainedMemory};
use jetlink::report::Counters;
use jetlink::telemetry::Telemetry;
use jetlink::units::Throttle;
use jetlink_rc::outputs::{Before, Change, Outputs};
use jetlink_rc::settings::OutputSettings;
use jetlink_rc::shared::Shared;
use jetlink_rc::wiring::{OutputConfig, OutputPin};
use std::cell::{Cell, RefCell};
use std::future::poll_fn;
use std::rc::Rc;
use std::task::Poll;

/// Outputs of an engine: both.
const BOTH: OutputConfig = OutputConfig::valve(OutputPin::high(0)).with_power(OutputPin::high(1));

/// A reset.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Reset {
    /// How long the node is away.
    pub away: Duration,
    /// What caused it.
    pub cause: Cause,
}

/// What caused a reset.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Cause {
    /// The watchdog: the power never went away.
    Watchdog,
    /// The supply dipped, and the memory is whole.
    BrownOut,
    /// The supply was gone: the retained state is lost too.
    PowerLost,
}

/// The node of a run.
#[derive(Debug)]
pub struct Node<'a> {
    engines: &'a [Engine],
    /// Their configuration at the next start, where it was changed.
    configs: RefCell<Vec<Option<EngineConfig>>>,
    /// Memory that survives a reset.
    memory: &'static [RetainedMemory],
    channels: RefCell<Option<Rc<[Channel]>>>,
    last: RefCell<Vec<Telemetry>>,
    /// Fuel valve and power of each engine, as a board would drive them.
    outputs: RefCell<Vec<Outputs>>,
    /// The same for MAVLink, where there are valves.
    shared: Option<Shared<MOST_ENGINES>>,
    /// Their settings at the next start.
    output_settings: Cell<[OutputSettings; MOST_ENGINES]>,
    /// What changed of them, until it is taken.
    changes: RefCell<Vec<(usize, Change)>>,
    /// Counters up to the last reset.
    before: RefCell<Vec<Counters>>,
    wanted: Cell<Option<Reset>>,
    /// What caused the last reset.
    cause: Cell<Cause>,
    /// Whether an engine was not at rest then.
    in_flight: Cell<bool>,
    /// Commands of each engine that were rejected because the node had just started, as it always does.
    rejected_at_start: RefCell<Vec<u32>>,
}

impl<'a> Node<'a> {
    /// A node that was never under power, with or without valves.
    pub fn new(engines: &'a [Engine], valves: bool) -> Self {
        let node = Self {
            engines,
            configs: RefCell::new(vec![None; engines.len()]),
            // It lives as long as the program, as in the firmware; there is one node in a run.
            memory: Box::leak(engines.iter().map(|_| RetainedMemory::new()).collect()),
            channels: RefCell::new(None),
            last: RefCell::default(),
            outputs: RefCell::default(),
            shared: valves.then(Shared::new),
            output_settings: Cell::new([OutputSettings::DEFAULT; MOST_ENGINES]),
            changes: RefCell::default(),
            before: RefCell::new(vec![Counters::default(); engines.len()]),
            wanted: Cell::new(None),
            cause: Cell::new(Cause::PowerLost),
            in_flight: Cell::new(false),
            rejected_at_start: RefCell::new(vec![0; engines.len()]),
        };
        node.boot();
        // The run starts it again: otherwise its outputs would be reported twice.
        node.changes.take();
        node
    }

    /// It starts, with the retained state. Gives its channels, for the tasks that live and die with them.
    pub fn boot(&self) -> Rc<[Channel]> {
        let reset = match self.cause.get() {
            Cause::Watchdog => retained::Reset::Warm,
            Cause::BrownOut | Cause::PowerLost => retained::Reset::PowerLost,
        };
        // From what was retained, before anything else.
        self.in_flight.set(self.memory.iter().any(RetainedMemory::was_in_flight));
        let last = self.outputs.take();
        let is_retained = self.cause.get() != Cause::PowerLost;
        let outputs = self.memory.iter().zip(self.output_settings.get()).enumerate();
        let outputs = outputs.map(|(i, (memory, settings))| {
            let record = memory.load(self.config(i).fingerprint(), reset);
            let power = last.get(i).map(Outputs::power).filter(|_| is_retained);
            Outputs::new(settings, Before { record, power, has_failed: false })
        });
        let outputs: Vec<Outputs> = outputs.collect();
        for (i, outputs) in outputs.iter().enumerate() {
            self.publish(i, outputs, &outputs.restored());
        }
        self.outputs.replace(outputs);
        let channels: Rc<[Channel]> = self
            .memory
            .iter()
            .enumerate()
            .map(|(i, memory)| Channel::new(&self.config(i), Some((memory, reset))))
            .collect();
        let last = self.last.replace(channels.iter().map(|channel| channel.handle().telemetry()).collect());
        for (before, last) in self.before.borrow_mut().iter_mut().zip(last) {
            *before = sum(before, &last.counters);
        }
        self.channels.replace(Some(channels.clone()));
        channels
    }

    /// The configuration of an engine at the next start.
    pub fn config(&self, engine: usize) -> EngineConfig {
        self.configs.borrow()[engine].unwrap_or(self.engines[engine].config)
    }

    /// Stores a configuration for the next start, as a board that stores its settings does.
    pub fn configure(&self, engine: usize, config: EngineConfig) {
        if let Some(stored) = self.configs.borrow_mut().get_mut(engine) {
            *stored = Some(config);
        }
    }

    /// It has ended: the caller drops the last of its channels.
    pub fn gone(&self, reset: Reset) {
        self.look();
        self.channels.replace(None);
        self.cause.set(reset.cause);
        if reset.cause == Cause::PowerLost {
            for memory in self.memory {
                memory.clear();
            }
        }
    }

    /// Requests a reset.
    pub fn reset(&self, reset: Reset) {
        self.wanted.set(Some(reset));
    }

    /// Waits for one. The code that requests it shares a task with the code that waits.
    pub async fn wanted(&self) -> Reset {
        poll_fn(|_| self.wanted.take().map_or(Poll::Pending, Poll::Ready)).await
    }

    /// Whether an engine was not at rest at the last reset, as far as memory that survives it shows.
    pub const fn was_in_flight(&self) -> bool {
        self.in_flight.get()
    }

    /// Whether it runs.
    pub fn is_up(&self) -> bool {
        self.channels.borrow().is_some()
    }

    /// State of an engine; while the node is away, the last known one. The node restarts its counts at a reset:
    /// here they continue.
    pub fn telemetry(&self, engine: usize) -> Telemetry {
        self.look();
        let mut telemetry = self.last.borrow()[engine];
        telemetry.counters = sum(&self.before.borrow()[engine], &telemetry.counters);
        // Commands rejected in its first moments are not a source's fault.
        let at_start = self.rejected_at_start.borrow()[engine];
        telemetry.counters.commands_rejected = telemetry.counters.commands_rejected.saturating_sub(at_start);
        telemetry
    }

    /// Fuel valve and power of an engine; while the node is away, they stay unchanged: the wiring holds them.
    pub fn outputs(&self, engine: usize) -> Outputs {
        self.look();
        self.outputs.borrow()[engine]
    }

    /// The outputs as MAVLink sees them, if there are any.
    pub const fn shared(&self) -> Option<&Shared<MOST_ENGINES>> {
        self.shared.as_ref()
    }

    /// Settings of the outputs at the next start.
    pub const fn output_settings(&self) -> [OutputSettings; MOST_ENGINES] {
        self.output_settings.get()
    }

    /// Stores settings of an engine's outputs for the next start.
    pub fn configure_outputs(&self, engine: usize, settings: OutputSettings) {
        let mut all = self.output_settings.get();
        if let Some(stored) = all.get_mut(engine) {
            *stored = settings;
        }
        self.output_settings.set(all);
    }

    /// What changed of the outputs since the last call, where there are valves.
    pub fn take_changes(&self) -> Vec<(usize, Change)> {
        self.look();
        self.changes.take()
    }

    fn publish(&self, engine: usize, outputs: &Outputs, changes: &[Change]) {
        if let Some(shared) = &self.shared {
            shared.set(engine, &BOTH, outputs, changes.iter().copied());
            self.changes.borrow_mut().extend(changes.iter().map(|change| (engine, *change)));
        }
    }

    /// A command. `None`: the node is away and does not receive it.
    pub fn command(
        &self,
        engine: usize,
        command: Command,
        origin: Origin,
    ) -> Option<Result<Accepted, Rejected>> {
        let channels = self.channels.borrow().clone()?;
        let owner = channels.get(engine)?.owner_in(&channels);
        let source = match origin {
            Origin::Emergency => owner.emergency_source(),
            origin => owner.source(origin),
        };
        // Held for this command only, so that all code of the rig may command as any source.
        let answer = source.ok()?.command(command);
        if answer == Err(Rejected::Listening) {
            self.rejected_at_start.borrow_mut()[engine] += 1;
        }
        Some(answer)
    }

    /// Reasons why a run of this source would not start an engine now; `None` while the node is away. Without a demand: at idle.
    pub fn start_refusals(
        &self,
        engine: usize,
        demand: Option<Demand>,
        origin: Origin,
    ) -> Option<Vec<Rejected>> {
        let channels = self.channels.borrow().clone()?;
        let mut all = Vec::new();
        let demand = demand.unwrap_or(Demand::Throttle(Throttle::IDLE));
        channels
            .get(engine)?
            .owner_in(&channels)
            .handle()
            .start_refusals(demand, origin, |why| all.push(why));
        Some(all)
    }

    fn look(&self) {
        if let Some(channels) = &*self.channels.borrow() {
            let mut outputs = self.outputs.borrow_mut();
            let outputs = outputs.iter_mut();
            for (i, ((last, outputs), channel)) in
                self.last.borrow_mut().iter_mut().zip(outputs).zip(channels.iter()).enumerate()
            {
                *last = channel.handle().telemetry();
                let changes: Vec<Change> = outputs.update(last).into_iter().flatten().collect();
                self.publish(i, outputs, &changes);
            }
        }
    }
}

/// Adds the counters from before a reset and since.
fn sum(before: &Counters, since: &Counters) -> Counters {
    Counters {
        frames: before.frames.saturating_add(since.frames),
        unknown_frames: before.unknown_frames.saturating_add(since.unknown_frames),
        crc_failures: before.crc_failures.saturating_add(since.crc_failures),
        truncated: before.truncated.saturating_add(since.truncated),
        damaged_frames: before.damaged_frames.saturating_add(since.damaged_frames),
        bytes_skipped: before.bytes_skipped.saturating_add(since.bytes_skipped),
        framing_errors: before.framing_errors.saturating_add(since.framing_errors),
        noise_errors: before.noise_errors.saturating_add(since.noise_errors),
        overruns: before.overruns.saturating_add(since.overruns),
        parity_errors: before.parity_errors.saturating_add(since.parity_errors),
        read_errors: before.read_errors.saturating_add(since.read_errors),
        sent: before.sent.saturating_add(since.sent),
        replies_missed: before.replies_missed.saturating_add(since.replies_missed),
        replies_late: before.replies_late.saturating_add(since.replies_late),
        send_slots_missed: before.send_slots_missed.saturating_add(since.send_slots_missed),
        write_timeouts: before.write_timeouts.saturating_add(since.write_timeouts),
        write_errors: before.write_errors.saturating_add(since.write_errors),
        commands_rejected: before.commands_rejected.saturating_add(since.commands_rejected),
        events_dropped: before.events_dropped.saturating_add(since.events_dropped),
        worst_reply_margin: before.worst_reply_margin.into_iter().chain(since.worst_reply_margin).min(),
        worst_slot_delay: before.worst_slot_delay.max(since.worst_slot_delay),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_of_two_boots_are_added_and_the_worst_of_both_remains() {
        let ms = |ms| Some(Duration::from_millis(ms));
        let first = Counters { frames: 500, worst_reply_margin: ms(9), ..Counters::default() };
        let second = Counters { frames: 30, worst_slot_delay: ms(2), ..Counters::default() };
        let both = sum(&first, &second);
        assert_eq!((both.frames, both.worst_reply_margin, both.worst_slot_delay), (530, ms(9), ms(2)));
        assert_eq!(sum(&both, &Counters { worst_reply_margin: ms(7), ..first }).worst_reply_margin, ms(7));
    }
}

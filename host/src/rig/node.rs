//! The node of a run, as all others see it: it can be reset, and is then away for a while.
//!
//! The tasks that own the lines live and die with the [`Channel`]s. Everybody else asks here, and gets what was
//! known last while the node is away.

use super::engines::{Engine, MOST_ENGINES};
use embassy_time::Duration;
use jetlink::channels::Channel;
use jetlink::command::{Accepted, Command, Origin, Rejected};
use jetlink::engine::keep::Memory;
use jetlink::telemetry::Telemetry;
use std::cell::{Cell, RefCell};
use std::future::poll_fn;
use std::rc::Rc;
use std::task::Poll;

/// What a reset leaves alone. There is one node in the program.
static MEMORY: [Memory; MOST_ENGINES] = [const { Memory::new() }; MOST_ENGINES];

/// A reset.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Reset {
    /// How long the node is away.
    pub away: Duration,
    /// The supply was gone: what was kept is lost too.
    pub forgets: bool,
}

/// The node of a run.
#[derive(Debug)]
pub struct Node<'a> {
    engines: &'a [Engine],
    channels: RefCell<Option<Rc<[Channel]>>>,
    last: RefCell<Vec<Telemetry>>,
    wanted: Cell<Option<Reset>>,
}

impl<'a> Node<'a> {
    /// A node that was never under power.
    pub fn new(engines: &'a [Engine]) -> Self {
        for memory in &MEMORY {
            memory.clear();
        }
        let node =
            Self { engines, channels: RefCell::new(None), last: RefCell::default(), wanted: Cell::new(None) };
        node.boot();
        node
    }

    /// It starts, with what was kept. Gives its channels, for the tasks that live and die with them.
    pub fn boot(&self) -> Rc<[Channel]> {
        let channels: Rc<[Channel]> = self
            .engines
            .iter()
            .zip(&MEMORY)
            .map(|(engine, memory)| Channel::with_memory(&engine.config, memory))
            .collect();
        self.last.replace(channels.iter().map(|channel| channel.handle().telemetry()).collect());
        self.channels.replace(Some(channels.clone()));
        channels
    }

    /// It is no more: the last of its channels goes with the caller's.
    pub fn gone(&self, reset: Reset) {
        self.look();
        self.channels.replace(None);
        if reset.forgets {
            for memory in &MEMORY {
                memory.clear();
            }
        }
    }

    /// Asks for a reset.
    pub fn reset(&self, reset: Reset) {
        self.wanted.set(Some(reset));
    }

    /// Waits for one. Whoever asks for it shares a task with whoever waits.
    pub async fn wanted(&self) -> Reset {
        poll_fn(|_| self.wanted.take().map_or(Poll::Pending, Poll::Ready)).await
    }

    /// Whether it runs.
    pub fn is_up(&self) -> bool {
        self.channels.borrow().is_some()
    }

    /// What is known of an engine; while the node is away, what was known last.
    pub fn telemetry(&self, engine: usize) -> Telemetry {
        self.look();
        self.last.borrow()[engine]
    }

    /// A command. `None`: the node is away and nobody hears it.
    pub fn command(
        &self,
        engine: usize,
        command: Command,
        origin: Origin,
    ) -> Option<Result<Accepted, Rejected>> {
        let channels = self.channels.borrow().clone()?;
        Some(channels.get(engine)?.handle_in(&channels).command(command, origin))
    }

    fn look(&self) {
        if let Some(channels) = &*self.channels.borrow() {
            for (last, channel) in self.last.borrow_mut().iter_mut().zip(channels.iter()) {
                *last = channel.handle().telemetry();
            }
        }
    }
}

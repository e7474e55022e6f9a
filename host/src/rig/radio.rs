//! Radio control of the rig: the decoders and the pilots of `jetlink-rc` with a receiver on a port, or with a simulated
//! transmitter that the keys and script files move. It commands the engines in place of
//! the rig's pilots.

mod choice;
mod transmitter;

pub use self::choice::{Choice, RadioError};
pub use self::transmitter::Transmitter;

use self::transmitter::{PulseReceiver, SerialReceiver};
use super::context::{EngineContext, PilotInput};
use super::engines::MOST_ENGINES;
use super::node::Node;
use super::port::{Format, Link};
use embassy_futures::join::join;
use embassy_time::{Duration, Instant, Timer};
use jetlink::channel::Channel;
use jetlink::command::{Command, Order, Origin};
use jetlink::runner::LineErrors;
use jetlink_rc::config::Protocol;
use jetlink_rc::pilot::{Outcome, Pilot};
use jetlink_rc::reception::Reception;
use jetlink_rc::runner;
use jetlink_rc::service::Service;
use jetlink_rc::settings::EngineSettings;
use sim::clock;
use std::cell::{Cell, RefCell};

/// The receiver and its engines, from a start of the node to its next reset.
pub type Receiver<'a> = RefCell<Service<'a, MOST_ENGINES>>;

/// Source of the frames.
#[derive(Debug)]
enum Source {
    Transmitter(Transmitter),
    Port(Link),
}

/// Radio control of a run. It continues when the node is reset.
#[derive(Debug)]
pub struct Radio {
    protocol: Protocol,
    source: Source,
    /// Settings of each engine. They are MAVLink parameters: as on a board, which stores them, they survive a reset of the node.
    settings: Cell<[EngineSettings; MOST_ENGINES]>,
    /// Reception counters until the last reset of the node, and since.
    reception: [Cell<Reception>; 2],
}

/// Interval of updates of the reception counters.
const LOOK: Duration = Duration::from_millis(100);

impl Radio {
    /// Opens the port, or creates the transmitter with its stick at idle and its switch at stop.
    pub fn open(choice: &Choice) -> Result<Self, RadioError> {
        let source = match &choice.address {
            None => Source::Transmitter(Transmitter::new(&choice.settings)),
            Some(address) => {
                let is_8e2 = choice.protocol.line().is_some_and(|line| line.is_8e2);
                let format = if is_8e2 { Format::E2 } else { Format::N1 };
                Source::Port(Link::open(address, format).map_err(RadioError::Open)?)
            }
        };
        let settings = Cell::new([choice.settings; MOST_ENGINES]);
        Ok(Self { protocol: choice.protocol, source, settings, reception: Default::default() })
    }

    /// Reception counters of the run, at most 0.1 s old.
    pub fn reception(&self) -> Reception {
        let [earlier, now] = &self.reception;
        earlier.get() + now.get()
    }

    /// The transmitter, if it is simulated.
    pub const fn transmitter(&self) -> Option<&Transmitter> {
        match &self.source {
            Source::Transmitter(transmitter) => Some(transmitter),
            Source::Port(_) => None,
        }
    }

    /// The receiver of a node that has just started.
    pub fn begin<'a>(&self, node: &Node<'_>, channels: &'a [Channel]) -> Receiver<'a> {
        let [earlier, now] = &self.reception;
        earlier.set(earlier.get() + now.take());
        let mut pilots = Vec::new();
        for (i, (channel, settings)) in channels.iter().zip(self.settings.get()).enumerate() {
            let Ok(source) = channel.owner_in(channels).source(Origin::Rc) else { continue };
            // They were checked when they were set.
            pilots.extend(Pilot::new(source, &node.config(i), settings).ok());
        }
        RefCell::new(Service::new(self.protocol.input(), pilots))
    }

    /// Stores the settings of an engine for the next start of the node.
    pub fn configure(&self, engine: usize, settings: EngineSettings) {
        let mut all = self.settings.get();
        if let Some(stored) = all.get_mut(engine) {
            *stored = settings;
        }
        self.settings.set(all);
    }

    /// Serves the receiver until the node is reset.
    pub async fn serve(&self, service: &Receiver<'_>, contexts: &[EngineContext<'_>]) {
        // The host's ports report no line errors, and the simulated transmitter has none.
        let errors = LineErrors::new();
        let after = |_: Instant, engine: usize, outcome| {
            if let Some(context) = contexts.get(engine) {
                note(context, outcome);
            }
        };
        let look = async {
            loop {
                Timer::after(LOOK).await;
                self.reception[1].set(service.borrow().input().reception());
            }
        };
        let receive = async {
            match &self.source {
                Source::Transmitter(transmitter) if self.protocol == Protocol::Pwm => {
                    let mut pulses = PulseReceiver::new(transmitter);
                    runner::run_pulses(service, async || pulses.next().await, after).await
                }
                Source::Transmitter(transmitter) => {
                    runner::run(service, SerialReceiver::new(transmitter, self.protocol), &errors, after)
                        .await
                }
                Source::Port(link) => runner::run(service, link.rx(), &errors, after).await,
            }
        };
        join(receive, look).await;
    }
}

/// Records the commands of radio control for the audit and the views.
fn note(context: &EngineContext<'_>, outcome: Outcome) {
    if context.played.get() {
        // The engine is commanded by key.
        return;
    }
    if let Outcome::Commanded(command, answer) = outcome {
        let order = match command {
            Command::Run(demand) => Some(Order::Run(demand)),
            Command::Standby | Command::ReleaseStop => Some(Order::Standby),
            Command::EmergencyStop => Some(Order::EmergencyStop),
            _ => None,
        };
        if let Some(order) = order {
            context.judge(clock::now_ns(), order, Origin::Rc, answer);
        }
    }
    match outcome {
        Outcome::Commanded(Command::Run(demand), Ok(_)) => context.input.set(PilotInput::Run(demand)),
        Outcome::Commanded(Command::Standby | Command::EmergencyStop, Ok(_)) => {
            context.input.set(PilotInput::Standby);
        }
        Outcome::NotSteady => context.note("no start: the stick was not at idle, or not for 0.5 s"),
        Outcome::SettingsDamaged => context.note("no start: the stored settings are damaged"),
        Outcome::Commanded(..) | Outcome::Ignored(_) => {}
    }
}

//! One receiver and the engines that it commands.

use crate::input::Input;
use crate::pilot::{Outcome, Pilot};
use embassy_time::Instant;
use heapless::Vec;

/// An input and up to `N` engines.
#[derive(Debug)]
pub struct Service<'a, const N: usize> {
    input: Input,
    pilots: Vec<Pilot<'a>, N>,
    /// The UART reported a fault with the bytes before.
    fault_before: bool,
}

impl<'a, const N: usize> Service<'a, N> {
    /// This input for these engines; those beyond `N` are not taken.
    pub fn new(input: Input, pilots: impl IntoIterator<Item = Pilot<'a>>) -> Self {
        Self { input, pilots: pilots.into_iter().take(N).collect(), fault_before: false }
    }

    /// The input, with its counters.
    pub const fn input(&self) -> &Input {
        &self.input
    }

    /// The engines, in their order.
    pub fn pilots(&self) -> &[Pilot<'a>] {
        &self.pilots
    }

    /// An engine by its place, to configure or calibrate it.
    pub fn pilot_mut(&mut self, engine: usize) -> Option<&mut Pilot<'a>> {
        self.pilots.get_mut(engine)
    }

    /// Takes bytes, the last of which was received at `now` or before. `fault`: the UART has reported a fault since the last call.
    /// `outcome` gets what came of each frame that counts, for each engine by its place.
    pub fn receive(
        &mut self,
        now: Instant,
        mut bytes: &[u8],
        fault: bool,
        mut outcome: impl FnMut(usize, Outcome),
    ) {
        // A fault is seen when bytes are read: it belongs to them, or to a byte behind them that was not read yet.
        if fault || self.fault_before {
            self.input.line_error();
        }
        self.fault_before = fault;
        while !bytes.is_empty() {
            let (taken, channels) = self.input.receive(now, bytes);
            bytes = bytes.get(taken.max(1)..).unwrap_or_default();
            let Some(channels) = channels else { continue };
            for (engine, pilot) in self.pilots.iter_mut().enumerate() {
                let result = pilot.frame(now, &channels);
                outcome(engine, result);
            }
        }
    }
}

//! A simulated toy ECU, written from the document (the head of `src/ecu/toy/mod.rs`) and not from the codec.

use sim::ecu::{Ecu, LineFault, MILLIS, Nanos, SECOND};

/// A toy ECU with its engine, which starts and stops at once.
#[derive(Debug, Default)]
pub struct ToyEcu {
    on: bool,
    pub running: bool,
    pub overheated: bool,
    next_frame: Nanos,
    last_command: Nanos,
    begun: bool,
    /// Commands that it received.
    pub commands: Vec<u8>,
}

impl Ecu for ToyEcu {
    fn next_wake(&self) -> Nanos {
        if self.on { self.next_frame.min(self.last_command + SECOND) } else { Nanos::MAX }
    }

    fn advance(&mut self, now: Nanos, tx: &mut Vec<u8>) {
        if !self.on {
            return;
        }
        if now >= self.last_command + SECOND {
            self.running = false;
            self.last_command = now;
        }
        if now >= self.next_frame {
            self.next_frame += 100 * MILLIS;
            let egt: u16 = if self.running { 600 } else { 20 };
            tx.extend([0xA5, u8::from(self.running) | u8::from(self.overheated) << 7, (egt / 5) as u8]);
        }
    }

    fn receive(&mut self, now: Nanos, byte: Result<u8, LineFault>) {
        let begun = core::mem::replace(&mut self.begun, byte == Ok(0x5A));
        let Ok(command @ 0..=4) = byte else { return };
        if begun {
            self.last_command = now;
            self.commands.push(command);
            match command {
                1 | 3 => self.running = false,
                2 => self.running = true,
                _ => {}
            }
        }
    }

    fn power(&mut self, now: Nanos, on: bool) {
        if on && !self.on {
            *self = Self { on, next_frame: now, last_command: now, ..Self::default() };
        }
        self.on = on;
    }
}

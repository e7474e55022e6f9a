//! What the worlds need of a protocol. Each has a file beside this one, which implements it for the simulated ECU.

use super::super::oracle::Truth;

/// An ECU of a world.
pub trait WorldEcu {
    /// What it reports, and what it has obeyed; the rest is in `turbine`.
    fn truth(&self, turbine: Truth) -> Truth;

    /// It reports this fault from now on.
    fn report_fault(&mut self, fault: u8);

    /// It reports one of six states from now on, whatever its engine does.
    fn report_state(&mut self, _which: usize) {}

    /// It reports what is so.
    fn report_truth(&mut self);
}

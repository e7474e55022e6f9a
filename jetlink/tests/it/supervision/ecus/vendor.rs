//! What the worlds require of a protocol. Each protocol has a file beside this one that implements it for the simulated ECU.

use super::super::oracle::Truth;

/// An ECU of a world.
pub trait WorldEcu {
    /// Fills in what it reports and has obeyed; `turbine` has the rest.
    fn truth(&self, turbine: Truth) -> Truth;

    /// Makes it report this fault from now on.
    fn report_fault(&mut self, fault: u8);

    /// Makes it report one of six states from now on, whatever its engine does.
    fn report_state(&mut self, _which: usize) {}

    /// Makes it report the truth again.
    fn report_truth(&mut self);
}

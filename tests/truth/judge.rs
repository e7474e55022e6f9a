//! The judge that knows only the truth: what the pilots commanded, what was on the wire, the power of the ECU and the turbine.
//! It is written from the rules, shares nothing with the engine or with the judge of `jetlink/tests/it/supervision`, and uses
//! nothing that the node reports of itself.

mod case;
mod control;
mod demand;
mod doubt;
mod fuel;
mod healthy;
mod held;
mod limits;
mod mavlink;
mod obeyed;
mod power;
mod prompt;
mod receiver;
mod second;
mod shape;
mod silence;
mod starts;
mod sticks;
mod stops;
mod valve;

use crate::history::{History, MS, Mark, SECOND};
use case::Case;

pub use case::{Rule, Share, Verdict, seconds};
pub use limits::{busy, failed_for_sure, may_have_failed};

/// Judges one engine.
pub fn judge(history: &History) -> Verdict {
    let mut case = Case::new(history);
    case.bad_frames();
    case.stops();
    case.valve();
    case.power();
    case.sticks();
    case.mavlink();
    case.starts();
    case.run_at_rest();
    case.second_life();
    case.doubt();
    case.granted();
    case.goes_out();
    case.stays_out();
    case.disarm_ends_a_start();
    case.silence();
    case.fuel();
    case.rate();
    case.start_throttle();
    case.fall();
    case.authority();
    case.ctf();
    case.start_ends();
    case.shut_down();
    case.given_up();
    case.held();
    case.limits();
    case.reduction();
    case.take_over();
    case.prompt();
    case.hand_over();
    case.versions();
    case.shares();
    let running = case.runs.total();
    let verdict = &mut case.verdict;
    verdict.count("frames", history.frames.len() as u64);
    verdict.count("commands", history.commanded.len() as u64);
    verdict.count("resets", history.resets.len() as u64);
    verdict.count("seconds of running", running / SECOND);
    let in_flight = history.versions.iter().filter(|(at, _)| case.runs.contains(at.saturating_sub(MS)));
    verdict.count("other ECUs in place of one whose engine ran", in_flight.count() as u64);
    let ignitions = history.marks.iter().filter(|(_, mark)| *mark == Mark::Ignition).count();
    verdict.count("ignitions", ignitions as u64);
    verdict.findings.sort_by_key(|found| found.at);
    case.verdict
}

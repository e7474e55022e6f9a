//! Judges a played run by events that no pilot can cause: uncommanded ignitions, emergency stops that are late on the
//! wire, reply windows missed outside deliberate faults. The audit finds frames that no order allows.

use super::super::audit::{Audit, WireCommand};
use embassy_time::Instant;
use sim::ecu::{Counts, MILLIS, Nanos, SECOND};

/// The longest time from an emergency stop to its first bit on the wire: an AMT ECU is answered every 125 ms, and the
/// answer before may have begun.
const STOP_ON_WIRE: Nanos = 175 * MILLIS;
/// Longest time from a commanded run to its ignition: a start that waits for another engine.
const IGNITES_WITHIN: Nanos = 2 * SECOND;

/// Findings about one engine.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Verdict {
    /// Ignitions while no source commanded run.
    pub ignitions: u64,
    /// Emergency stops that came late on the wire, or not at all.
    pub late_stops: u64,
    /// Reply windows missed while no fault explained it.
    pub missed: u64,
}

/// Watches one engine.
#[derive(Debug, Default)]
pub struct Judge {
    verdict: Verdict,
    ignitions: usize,
    /// When run was last in force.
    run_at: Option<Nanos>,
    /// Time of an emergency stop that is not on the wire yet, and when it is late.
    stop_since: Option<(Nanos, Nanos)>,
    missed: u64,
}

/// Input of the judge.
#[derive(Debug)]
pub struct Seen<'a> {
    /// When.
    pub at: Instant,
    /// The source commands run.
    pub commands_run: bool,
    /// A fault explains what is missed now.
    pub explained: bool,
    /// The link is up.
    pub link_up: bool,
    /// Counters of the ECU.
    pub counts: Counts,
    /// Instants at which the simulated engine began a start.
    pub ignitions: &'a [Nanos],
    /// The line.
    pub audit: &'a Audit,
}

impl Judge {
    /// An emergency stop is commanded, and reaches the node within this time.
    pub fn stop(&mut self, at: Nanos, within: Nanos, audit: &Audit) {
        if audit.on_wire != Some(WireCommand::Stop) {
            self.stop_since.get_or_insert((at, at + within + STOP_ON_WIRE));
        }
    }

    /// The stop ended before it had lasted for this time: it may not have reached the node.
    pub fn stop_ends(&mut self, at: Nanos, within: Nanos) {
        self.stop_since = self.stop_since.filter(|&(since, _)| at >= since + within);
    }

    /// A stop is released: if it was not on the wire in time by then, it was late.
    pub fn stop_released(&mut self, at: Nanos) {
        self.stop_since = self.stop_since.filter(|&(_, until)| at > until);
    }

    /// The findings.
    pub const fn verdict(&self) -> Verdict {
        self.verdict
    }

    /// Judges the present state; called ten times a second.
    pub fn look(&mut self, seen: &Seen<'_>) {
        let now = (seen.at - Instant::MIN).as_micros() * 1000;
        if seen.commands_run {
            self.run_at = Some(now);
        }
        // It may have begun and ended between two calls.
        self.run_at = self.run_at.max(seen.audit.start_ordered_at());
        for &ignition in seen.ignitions.iter().skip(self.ignitions) {
            let commanded = self.run_at.is_some_and(|at| at + IGNITES_WITHIN >= ignition);
            // A damaged frame may pass its checksum: the node has not sent that run.
            let commanded = commanded || seen.audit.is_misread(ignition);
            self.verdict.ignitions += u64::from(!commanded);
        }
        self.ignitions = seen.ignitions.len();

        let missed = seen.counts.late + seen.counts.unanswered;
        if !seen.explained {
            self.verdict.missed += missed.saturating_sub(self.missed);
        }
        self.missed = missed;

        if let Some((since, until)) = self.stop_since {
            let sent = seen.audit.stop_at.filter(|&at| at >= since);
            let late = sent.unwrap_or(now) > until;
            if sent.is_some() || late {
                self.verdict.late_stops += u64::from(late && !seen.explained && seen.link_up);
                self.stop_since = None;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::disturbances::DOUBT;
    use super::super::super::engines::engines;
    use super::*;
    use embassy_time::Duration;

    fn look(judge: &mut Judge, ms: u64, commands_run: bool, ignitions: &[Nanos], missed: u64) -> Verdict {
        look_at(judge, ms, commands_run, ignitions, missed, false)
    }

    fn look_at(
        judge: &mut Judge,
        ms: u64,
        commands_run: bool,
        ignitions: &[Nanos],
        missed: u64,
        explained: bool,
    ) -> Verdict {
        let engines = engines(&[]).unwrap();
        let audit = Audit::new(&engines[0]);
        let at = Instant::MIN + Duration::from_millis(ms);
        let counts = Counts { unanswered: missed, ..Counts::default() };
        judge.look(&Seen { at, commands_run, explained, link_up: true, counts, ignitions, audit: &audit });
        judge.verdict()
    }

    #[test]
    fn the_documentation_has_the_limits_of_the_judge() {
        let page = include_str!("../../../../docs/rig.md");
        let stop = format!("emergency stops that are later than {} ms on the wire", STOP_ON_WIRE / MILLIS);
        let doubt = format!("and {} s after each: until then the node may be in doubt", DOUBT.as_secs());
        assert!(page.contains(&stop) && page.contains(&doubt), "{stop}; {doubt}");
    }

    #[test]
    fn an_ignition_needs_a_commanded_run() {
        let mut judge = Judge::default();
        assert_eq!(look(&mut judge, 1000, true, &[], 0).ignitions, 0);
        assert_eq!(look(&mut judge, 2000, false, &[1_500_000_000], 0).ignitions, 0);
        assert_eq!(look(&mut judge, 9000, false, &[1_500_000_000, 8_900_000_000], 0).ignitions, 1);
    }

    #[test]
    fn windows_count_that_no_fault_explains() {
        let mut judge = Judge::default();
        assert_eq!(look_at(&mut judge, 2000, false, &[], 5, true).missed, 0);
        assert_eq!(look_at(&mut judge, 14_000, false, &[], 9, true).missed, 0);
        assert_eq!(look(&mut judge, 16_000, false, &[], 10).missed, 1);
    }

    #[test]
    fn a_stop_that_is_not_on_the_wire_in_time_is_late() {
        let engines = engines(&[]).unwrap();
        let mut judge = Judge::default();
        judge.stop(1_000_000_000, 0, &Audit::new(&engines[0]));
        assert_eq!(look(&mut judge, 1100, false, &[], 0).late_stops, 0);
        assert_eq!(look(&mut judge, 1200, false, &[], 0).late_stops, 1);
        assert_eq!(look(&mut judge, 1300, false, &[], 0).late_stops, 1);
        judge.stop(2_000_000_000, 45 * MILLIS, &Audit::new(&engines[0]));
        assert_eq!(look(&mut judge, 2200, false, &[], 0).late_stops, 1);
        assert_eq!(look(&mut judge, 2300, false, &[], 0).late_stops, 2);
        // The switch was at stop for a moment, or for long enough.
        judge.stop(3_000_000_000, 45 * MILLIS, &Audit::new(&engines[0]));
        judge.stop_ends(3_000_000_000, 45 * MILLIS);
        assert_eq!(look(&mut judge, 3300, false, &[], 0).late_stops, 2);
        judge.stop(4_000_000_000, 45 * MILLIS, &Audit::new(&engines[0]));
        judge.stop_ends(4_100_000_000, 45 * MILLIS);
        assert_eq!(look(&mut judge, 4300, false, &[], 0).late_stops, 3);
    }
}

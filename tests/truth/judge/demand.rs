//! How fast a demand may rise.

use super::case::{Case, Rule};
use crate::history::{Cause, Commanded, Demanded, MS, PilotCommand, Reset, SECOND, Sent};

/// Resolution of the wire, 0.1 %: AMT has steps of 0.5 %.
const STEP: f64 = 7.0;

impl Case<'_> {
    /// A demand as a share of full throttle, or of the highest speed, in 0.1 %.
    pub(super) fn share(&self, demanded: Demanded) -> f64 {
        match demanded {
            Demanded::Throttle(tenths) => f64::from(tenths),
            Demanded::Rpm(rpm) => f64::from(rpm).min(self.h.rules.max_rpm) / self.h.rules.max_rpm * 1000.0,
        }
    }

    /// A pilot moved the stick since the frame before, from a demand that was in force to this one or more. The demand sent may
    /// be reduced because another engine has failed; when that ends, it rises from there.
    fn moved(&self, when: u64, at: u64, low: f64, risen: f64, to: f64) -> bool {
        let from = low + risen;
        let failed = self.h.other_failed.touches(at.saturating_sub(10 * SECOND), at + 1);
        // A reset takes back what was set in flight.
        let began = self.h.last_reset(at).map_or(0, |reset| reset.up);
        let part = self.h.largest_share(when.saturating_sub(SECOND).max(began), at).filter(|_| failed);
        let part = part.map_or(1.0, |part| f64::from(part) / 1000.0);
        self.moved_to(when, at, from, to)
            || self.moved_to(when, at, from / part, to / part)
            || self.moved_to(when, at, low / part, (to - risen) / part)
    }

    fn moved_to(&self, when: u64, at: u64, from: f64, to: f64) -> bool {
        // Where sets could not be read, there was no frame since.
        let reach = at - when + 3 * self.h.rules.period + 50 * MS;
        let since = at.saturating_sub(reach);
        self.h.commanded(since, at).iter().any(|commanded| {
            let PilotCommand::Run(demanded) = commanded.command else { return false };
            self.share(demanded) + STEP >= to && self.was_in_force(*commanded, demanded, since, from)
        })
    }

    /// The commands of a source just before this one, with no gap between them, command a demand that was on the wire. Several may
    /// come in one slot, and one command of standby between two of run changes nothing.
    fn was_in_force(&self, commanded: Commanded, demanded: Demanded, since: u64, from: f64) -> bool {
        let Commanded { source, at, .. } = commanded;
        // The frames of a delayed stream arrive at one instant: the demand is that of the first, and then that of the last.
        let first = self.h.commanded(at, at).iter().find(|other| other.source == source);
        if let Some(PilotCommand::Run(before)) = first.map(|first| first.command)
            && before != demanded
            && from + STEP >= self.share(before)
        {
            return true;
        }
        let mut next = at;
        let mut standby = 0;
        for &(when, command) in self.command_log.until(source, at.saturating_sub(1)).iter().rev() {
            // A source that was away has to rise at the rate.
            if next > when + self.command_log.age(source) {
                return false;
            }
            match command {
                PilotCommand::Run(before) if from + STEP >= self.share(before) => return true,
                // A throttle and a speed cannot be compared.
                PilotCommand::Run(before)
                    if core::mem::discriminant(&before) != core::mem::discriminant(&demanded) =>
                {
                    return true;
                }
                PilotCommand::Run(_) if when < since => return false,
                PilotCommand::Run(_) => standby = 0,
                PilotCommand::Standby if standby == 0 => standby = 1,
                _ => return false,
            }
            next = when;
        }
        false
    }

    /// Since the frame before, nothing was received for longer than a gap, or the transmitter hung, without a reset, or there was a
    /// reset; but not until the order was given up.
    fn doubted(&self, when: u64, at: u64) -> bool {
        let h = self.h;
        let most = if self.traits().serial_delay { self.order_outlasts() } else { u64::MAX };
        let gap = self.blind.iter().any(|(from, to)| {
            to > when && to <= at && (self.gap()..most).contains(&(to - from)) && at - when < most
        });
        let hung = h.stalls.iter().chain(h.reopened.iter().flatten()).any(|freed| (when..at).contains(freed));
        (gap || hung)
            && !self.down.touches(when.saturating_sub(SECOND), at)
            && !h.noise.touches(when.saturating_sub(SECOND), at)
            || at - when < most && self.resumed(when, at)
    }

    /// Since the frame before, the node was reset and kept its memory: the demand rises from the one that was sent, whatever was
    /// commanded in between. A governor continues with the throttle that the ECU reports.
    fn resumed(&self, when: u64, at: u64) -> bool {
        let mut resets = self.h.resets.iter().filter(|reset| reset.up > when && reset.down < at).peekable();
        resets.peek().is_some()
            && resets.all(|reset| reset.cause == Cause::Watchdog)
            && !self.holds_rpm(at)
            && !self.h.noise.touches(when.saturating_sub(SECOND), at)
    }

    /// A governor may hold an rpm: its throttle has a rate of its own, the slew is that of the rpm.
    fn holds_rpm(&self, at: u64) -> bool {
        let commands = self.h.commanded(at.saturating_sub(10 * SECOND), at).iter();
        let rpm = |commanded: &Commanded| commanded.command.is_rpm();
        self.h.rules.governor && commands.clone().any(rpm)
    }

    /// A governor holds an rpm, and has for a while: one source commands nothing else.
    pub(super) fn governed(&self, at: u64) -> bool {
        let since = at.saturating_sub(8 * SECOND);
        let mut commands =
            self.h.commanded(since, at).iter().filter(|commanded| commanded.command.is_received());
        let rpm = |commanded: &Commanded| commanded.command.is_rpm();
        self.h.rules.governor
            && self.command_log.run_in_control(at).is_some()
            && matches!(self.command_log.run_in_control(since), Some((_, Demanded::Rpm(_))))
            && commands.all(rpm)
    }

    /// The rpm of the source in control is refused: no speed has been reported since before its first one. Its earlier run stays in force.
    pub(super) fn refuses_rpm(&self, at: u64) -> bool {
        let Some((source, _)) = self.command_log.run_in_control(at) else { return false };
        let commands = self.command_log.until(source, at);
        let first = commands.iter().rev().take_while(|(_, command)| command.is_rpm()).last();
        let faults = self.faults.last_before(at);
        self.traits().faults_hide_state
            && first.zip(faults).is_some_and(|((first, _), (from, to))| {
                from < *first && at < to + 2 * self.h.rules.period + 100 * MS
            })
    }

    pub(super) fn rate(&mut self) {
        let h = self.h;
        let rules = &h.rules;
        let mut before: Option<(u64, Demanded, f64)> = None;
        // How far the demand may have risen by now from the lowest one that was on the wire: at `slew.up`, and at
        // `rise`.
        let (mut slewed, mut risen) = (0.0_f64, 0.0_f64);
        // The last demand that reached the ECU: a node without memory, and a governor, finds it and continues with it.
        let mut obeyed: Option<(Demanded, f64)> = None;
        // Until an ID 6 without RPM_X has come, that is the speed.
        let mut by_rpm = false;
        let forgets = |reset: &&Reset| reset.cause != Cause::Watchdog || self.holds_rpm(reset.up);
        let forgets: Vec<u64> = h.resets.iter().filter(forgets).map(|reset| reset.up).collect();
        let mut forgets = forgets.into_iter().peekable();
        let mut reported = 0;
        // A frame's content was computed up to a slot before it began. This counts once, however long the
        // demand rises.
        let rises_in = |rate: u32, time: u64| f64::from(rate) * time as f64 / SECOND as f64;
        let slack = |rate: u32| rises_in(rate, rules.period + 20 * MS) + STEP;
        for frame in &h.frames {
            let forgot = std::iter::from_fn(|| forgets.next_if(|up| *up <= frame.at));
            if forgot.last().is_some() {
                let higher = |(_, low): &(Demanded, f64)| before.is_none_or(|(.., before)| *low > before);
                // A speed is not reported as it is demanded, only as it is: the shaft may be on its way to a lower one.
                let found = obeyed.map(|(demanded, low)| match demanded {
                    Demanded::Rpm(_) => (demanded, low.max(self.fastest(frame.at))),
                    Demanded::Throttle(_) => (demanded, low),
                });
                if let Some((demanded, low)) = found.filter(higher) {
                    before = Some((frame.at - rules.period, demanded, low));
                    (slewed, risen) = (low, low);
                }
            }
            if matches!(frame.sent, Sent::Full(switch, _) | Sent::Mode(Some(switch), _) if switch != crate::history::Switch::Run)
            {
                // The next run begins at the start throttle.
                let (idle, low) = (Demanded::Throttle(rules.start_throttle), f64::from(rules.start_throttle));
                before = Some((frame.at, idle, low));
                (slewed, risen) = (low, low);
                obeyed = if frame.arrived { Some((idle, low)) } else { obeyed };
            }
            if let Sent::Mode(_, factor) = frame.sent
                && frame.arrived
            {
                by_rpm = factor > 0;
            }
            let Some(demanded) = frame.sent.demand() else { continue };
            let (at, share) = (frame.at, self.share(demanded));
            // After a set that no ECU sent, the reply to the ECU's own set is late, and the ECU does not obey it. After a doubt,
            // a governor begins with the throttle that the ECU reports then.
            let forged = h.forged[..h.forged.partition_point(|forged| *forged <= at)].last();
            let sets = if self.holds_rpm(at) { 2 } else { 1 };
            let late =
                self.traits().replies_only && forged.is_some_and(|forged| at < forged + sets * rules.period);
            if late && before.is_some_and(|(.., low)| share < low) {
                continue;
            }
            if frame.arrived && (!by_rpm || matches!(demanded, Demanded::Rpm(_))) {
                obeyed = Some((demanded, share));
            }
            let idle = match demanded {
                Demanded::Throttle(_) => f64::from(rules.idle_band.max(rules.start_throttle)),
                Demanded::Rpm(_) => rules.idle_rpm / rules.max_rpm * 1000.0,
            };
            let comparable = before.replace((at, demanded, share)).filter(|(when, last, _)| {
                core::mem::discriminant(last) == core::mem::discriminant(&demanded)
                    && !h.pwm.touches(*when, at)
                    && share > idle + STEP
            });
            let Some((when, last, low)) = comparable else {
                (slewed, risen) = (share, share);
                continue;
            };
            // After a gap it rises from its previous value, whatever was commanded meanwhile, until the last slot: two where ID 6 goes before it.
            let slot = at.saturating_sub(rules.period + 20 * MS);
            let split = h.frames_within(slot, at).iter().any(|frame| matches!(frame.sent, Sent::Mode(..)));
            let slot = if split { slot.saturating_sub(rules.period) } else { slot };
            let stick = self.command_log.run_in_control(slot) != self.command_log.run_in_control(at);
            let doubted = !stick && self.doubted(when, at);
            let time = if doubted { (at - when).min(rules.period + 130 * MS) } else { at - when };
            // A governor has a rate of its own. What it sends is a throttle: a speed on the wire is held by the ECU.
            let throttle = matches!(demanded, Demanded::Throttle(_));
            let mut slow = false;
            if let Some(slew) = rules.slew_up {
                slewed += rises_in(slew, time);
                let governor = throttle && (self.holds_rpm(when) || self.holds_rpm(at));
                slow = !governor && share > slewed + slack(slew);
                slewed = if governor || slow { share } else { slewed.min(share) };
            }
            let governed = throttle && self.governed(when) && self.governed(at);
            risen += rises_in(rules.rise, time);
            // One that was reached moves with the stick.
            let reach = rises_in(rules.rise, at - when) + slack(rules.rise);
            let moved = share > risen && !doubted && !governed && self.moved(when, at, low, reach, share);
            let fast = !moved && share > risen + slack(rules.rise);
            risen = if moved || fast { share } else { risen.min(share) };
            if share > low && !moved && self.is_rising_to_more(at, share) {
                self.verdict.count(self.why_it_rises(at), 1);
            }
            if (slow || fast) && at >= reported {
                self.verdict.finding(
                    Rule::Rate,
                    at,
                    format!("the demand rises from {last} to {demanded} in {} ms", (at - when) / MS),
                );
                reported = at + 5 * SECOND;
            }
        }
    }

    /// The highest speed of the shaft in the last second, as a share.
    fn fastest(&self, at: u64) -> f64 {
        let samples = self.h.samples(at.saturating_sub(SECOND), at);
        let rpm = samples.iter().map(|sample| sample.rpm as u32).max().unwrap_or_default();
        self.share(Demanded::Rpm(rpm))
    }

    /// The source in control commands more than this: a rate limits the demand.
    fn is_rising_to_more(&self, at: u64, share: f64) -> bool {
        let run = self.command_log.run_in_control(at.saturating_sub(self.h.rules.period + 20 * MS));
        run.is_some_and(|(_, wanted)| self.share(wanted) > share + STEP)
    }

    /// What preceded a demand that rises at its rate, for the counter.
    fn why_it_rises(&self, at: u64) -> &'static str {
        let h = self.h;
        let since = at.saturating_sub(4 * SECOND);
        let lately = |spans: &crate::history::Spans| spans.touches(since, at);
        let commands = h.commanded(at.saturating_sub(8 * SECOND), at).iter();
        let source = self.command_log.run_in_control(at).map(|(source, _)| source);
        let others =
            commands.clone().any(|other| other.command.is_received() && Some(other.source) != source);
        let returned = source.and_then(|source| self.command_log.commands_since(source, at));
        if lately(&self.down.longer(2 * SECOND)) {
            "frames that rise at the rate after a reset"
        } else if lately(&self.blind.at_least(self.gap())) {
            "frames that rise at the rate after a gap"
        } else if self.runs.last_before(at).is_none_or(|(from, _)| from > since) {
            "frames that rise at the rate after a start"
        } else if h.rules.when_other_fails.is_some() && lately(&h.other_failed) {
            "frames that rise at the rate after a reduction"
        } else if others {
            "frames that rise at the rate after a take-over"
        } else if returned.is_some_and(|from| from > since) {
            "frames that rise at the rate after a loss of the source"
        } else {
            "frames that rise at the rate, or at slew.up"
        }
    }
}

//! Emergency stops, commands that the ECU's version knows, and frames that no document defines.

use super::case::{Case, Rule, seconds};
use super::control::stop_is_late;
use super::fuel::{CLOSE_PUMP, CLOSING};
use crate::history::{Cause, Commanded, Frame, MS, PilotCommand, SECOND, Sent, Spans, Switch};

/// Frames within two slots: one may be sent at once, and one right after another that needs it.
const AT_ONCE: usize = 5;

impl Case<'_> {
    pub(super) fn bad_frames(&mut self) {
        for frame in &self.h.frames {
            if let Sent::Bad(bytes) = frame.sent {
                self.verdict.finding(Rule::Frame, frame.at, format!("no frame: {bytes:02X?}"));
            }
        }
        // Frames from the time in which the transmitter hung are not sent after it.
        for &stall in &self.h.stalls {
            let frames = self.h.frames_within(stall, stall + 2 * self.h.rules.period).len();
            if frames > AT_ONCE {
                let text = format!("{frames} frames within two slots after the transmitter hung");
                self.verdict.finding(Rule::Frame, stall, text);
            }
        }
    }

    /// From each stop to the first command that may have released it.
    fn latches(&self) -> Vec<(u64, u64)> {
        let mut latches = Vec::new();
        let mut open: Option<(u64, usize)> = None;
        let mut lost = self.h.resets.iter().filter(|reset| reset.cause == Cause::PowerOn).peekable();
        for commanded in &self.h.commanded {
            while let Some(reset) = lost.next_if(|reset| reset.down <= commanded.at) {
                latches.extend(open.take().map(|(from, _)| (from, reset.down)));
            }
            match commanded.command {
                // The lowest source that commanded the stop, or any higher one, may release it.
                PilotCommand::Stop => {
                    open = open.map_or(Some((commanded.at, commanded.source)), |(at, who)| {
                        Some((at, who.max(commanded.source)))
                    })
                }
                PilotCommand::Release if !self.refuses_release(commanded) => {
                    if let Some((from, _)) = open.take_if(|(_, who)| commanded.source <= *who) {
                        latches.push((from, commanded.at));
                    }
                }
                _ => {}
            }
        }
        if let Some((from, _)) = open {
            latches.push((from, lost.next().map_or(self.h.end, |reset| reset.down)));
        }
        latches
    }

    /// A stop is not released with the demand up, nor while the ECU reports a running engine, or reports
    /// nothing.
    fn refuses_release(&self, release: &Commanded) -> bool {
        let h = self.h;
        let at = release.at;
        let since = at.saturating_sub(2500 * MS);
        let up = |command| matches!(command, PilotCommand::Run(demanded) if !self.is_idle(demanded));
        let up = self.command_log.fresh(release.source, at).is_some_and(up);
        let received = !self.hidden.touches(since, at + 1) && !self.faults.touches(since, at + 1);
        let runs = received && self.runs.within(since, at) == at - since;
        // One frame is a link, and one that no ECU sent is a frame.
        let forged = h.forged.iter().any(|forged| (since..=at).contains(forged));
        // Its first report may have come just now.
        let until = at + 2 * MS;
        let lost = at > 3 * SECOND && self.blind.within(since, until) == until - since && !forged;
        up && !h.resets.iter().any(|reset| (since..at).contains(&reset.up)) || runs || lost
    }

    pub(super) fn stops(&mut self) {
        let h = self.h;
        let period = h.rules.period;
        let latches = self.latches();
        self.stopped = Spans::from(&latches);
        let late = stop_is_late(h);
        self.verdict.count("stops", latches.len() as u64);
        for (from, to) in latches {
            let first = h.frames.partition_point(|frame| frame.at < from);
            let frames = || h.frames[first..].iter().take_while(move |frame| frame.at < to);
            // A pump is closed after the first stop. Where a stop was the last frame, it continues.
            let before = &h.frames[..first];
            let before = before.iter().rev().find_map(|frame| frame.sent.switch());
            let first_stop = frames().find(|frame| is_stop(frame)).map_or(to, |frame| frame.at);
            let closes = |frame: &&Frame| frame.sent == Sent::Action(CLOSE_PUMP);
            if let Some(frame) = frames()
                .find(closes)
                .filter(|frame| frame.at > from + 2 * MS && frame.at < first_stop)
                .filter(|_| before != Some(Switch::Stop))
            {
                let text = format!("stopped at {}, and the pump is closed first", seconds(from));
                self.verdict.finding(Rule::Stop, frame.at, text);
            }
            // ZK does not wait for the next slot, only for the frame that is being sent.
            let at_once = from + 2 * h.rules.frame + 5 * MS;
            let free =
                !self.down.longer(700 * MS).touches(from, at_once) && !self.stalled().touches(from, at_once);
            // One that is latched already is in every slot.
            let free = free && before != Some(Switch::Stop);
            if !self.traits().replies_only && free && at_once < to && first_stop > at_once {
                let text = format!(
                    "stopped at {}, and the first stop is on the wire at {}",
                    seconds(from),
                    seconds(first_stop)
                );
                self.verdict.finding(Rule::Stop, at_once, text);
            }
            let mut closes = 0;
            let mut closed_last = false;
            let mut up = 0;
            let wrong = frames().filter(|frame| frame.at > from + late).find(|frame| {
                let close = frame.sent == Sent::Action(CLOSE_PUMP);
                // A node that restarts knows that a pump was open, not how often it was closed.
                let last = h.resets.iter().map(|reset| reset.up).take_while(|up| *up <= frame.at).last();
                if last.is_some_and(|last| core::mem::replace(&mut up, last) != last) {
                    closes = 0;
                }
                if close {
                    closes += 1;
                }
                let allowed = close && !closed_last && closes <= CLOSING;
                closed_last = close;
                !allowed && !is_stop(frame)
            });
            if let Some(frame) = wrong {
                let text = format!("stopped at {}, and {} is on the wire", seconds(from), frame.sent);
                self.verdict.finding(Rule::Stop, frame.at, text);
            }
            // There is one in every slot: ZK unprompted, AMT in reply to each set that can be received.
            let deaf = self.down.longer(700 * MS).union(&h.noise.longer(300 * MS)).union(&self.stalled());
            let deaf =
                if self.traits().replies_only { deaf.union(&self.blind.longer(300 * MS)) } else { deaf };
            let most = 3 * period + 30 * MS;
            let mut before = from;
            for at in frames().filter(|frame| is_stop(frame)).map(|frame| frame.at).chain([to]) {
                if at > before + most && at - before - deaf.within(before, at) > most {
                    let text = format!(
                        "stopped at {}, and no stop is on the wire until {}",
                        seconds(from),
                        seconds(at)
                    );
                    self.verdict.finding(Rule::Stop, before + most, text);
                    break;
                }
                before = at;
            }
        }
    }

    /// Run by ID 6, rpm and services only where the ECU's version is known and allows them.
    pub(super) fn versions(&mut self) {
        let h = self.h;
        if !h.traits().versions {
            return;
        }
        let mut reported = 0;
        for frame in &h.frames {
            self.standby_by_mode(frame);
            let needed = match frame.sent {
                // A stop and a standby are sent blind; older versions ignore them.
                Sent::Mode(Some(Switch::Stop | Switch::Standby), _) | Sent::Action(CLOSE_PUMP) => continue,
                Sent::Mode(..) | Sent::Rpm(_) => 4,
                Sent::Action(12) => 5,
                Sent::Action(10 | 11) => 2,
                _ => continue,
            };
            if frame.at < reported || h.version(frame.at) >= needed {
                continue;
            }
            // Another ECU that was plugged in without a gap cannot be detected before it reports its version.
            let since = h.versions.iter().rev().find(|(at, _)| *at <= frame.at).map_or(0, |(at, _)| *at);
            let seen = self.blind.at_least(self.gap()).touches(since.saturating_sub(MS), since + self.gap());
            if since > 0 && !seen && frame.at < since + 2 * self.two_states() + h.rules.boot {
                continue;
            }
            // In doubt the demand continues as ID 7, which an ECU without a factor ignores.
            let doubt = self.blind.longer(2 * self.two_states() + SECOND).contains(frame.at);
            if since > 0 && frame.at < since + self.gap() || doubt && matches!(frame.sent, Sent::Rpm(_)) {
                continue;
            }
            let text = format!("{} needs version {needed}, the ECU has {}", frame.sent, h.version(frame.at));
            self.verdict.finding(Rule::Version, frame.at, text);
            reported = frame.at + 10_000 * MS;
        }
    }
}

impl Case<'_> {
    /// An older ECU whose engine is at rest gets standby by ID 1 alone (ZK-7).
    fn standby_by_mode(&mut self, frame: &Frame) {
        let h = self.h;
        let since = frame.at.saturating_sub(12 * SECOND);
        let new = h.versions.iter().any(|(at, _)| (since..=frame.at).contains(at));
        let hidden = [&self.blind, &h.noise, &h.deaf, &self.down, &self.live, &self.stopped];
        if matches!(frame.sent, Sent::Mode(Some(Switch::Standby), _))
            && h.version(frame.at) < 4
            && since > 0
            && !new
            && hidden.iter().all(|spans| !spans.touches(since, frame.at))
        {
            let text = "ID 6 with standby for an engine at rest, whose ECU does not know it".to_string();
            self.verdict.finding(Rule::Version, frame.at, text);
        }
    }
}

fn is_stop(frame: &Frame) -> bool {
    frame.sent.switch() == Some(Switch::Stop)
}

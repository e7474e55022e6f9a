//! Judges every control frame on the wire.

use super::*;

impl Oracle {
    /// Returns true if this frame begins a start that was not ordered earlier, while the transmitter hung.
    pub fn frame(&mut self, at: u64, frame: Frame) -> Result<bool, String> {
        // Sent before the reset, or out of a transmitter that hung.
        if at <= self.booted + TOL || (at >= self.hung.0 && at < self.hung.1) {
            return Ok(false);
        }
        self.advance(at);
        self.tally.frames += 1;
        let hung = self.hung.1 > self.last_frame;
        let starts = self.tally.starts;
        let answer = self.judge(at, frame).map(|_| self.tally.starts > starts && !hung);
        match frame {
            Frame::Full(..) => (self.peak_throttle, self.control_peak) = (0, 0),
            Frame::RpmCode(_) => self.peak_rpm = 0,
            // It shows no demand.
            _ => return answer,
        }
        self.last_frame = at;
        if let Some((_, source)) = self.active_source(at)
            && let Intent::Run(demand) = source.intent
            && (at < source.changed + TOL
                || self.config.supervision.slew.up.is_some()
                || self.rising.is_some())
        {
            // It may have moved towards this demand until another one came.
            self.peak(demand);
        }
        answer
    }

    pub(super) fn judge(&mut self, at: u64, frame: Frame) -> Result<(), String> {
        // A frame and a command at the same instant: the previous demand may still be in it.
        if let Some((_, Source { changed, before: Intent::Run(demand), .. })) = self.active_source(at)
            && at < changed + TOL
        {
            self.peak(demand);
        }
        let switch = match frame {
            Frame::Bad(raw) => return Err(format!("(0) {raw:02x?} is no control frame")),
            Frame::Full(switch, _) | Frame::Mode(switch, _) => Some(switch),
            Frame::RpmCode(_) | Frame::Other(_) => None,
        };
        if let Some((by, since)) = self.latched
            && at > since + TOL
        {
            self.tally.stop_frames += 1;
            if switch != Some(Switch::Stop) {
                return Err(format!("(4) {by} has stopped the engine, and {frame} is on the wire"));
            }
        }
        let opens = match switch {
            Some(Switch::Pwm) => return Err("(1) SW 0 hands the engine to the PWM input".into()),
            Some(Switch::Stop | Switch::Standby) => {
                return self.ended(at, frame);
            }
            Some(Switch::Run) => self.run(at)?,
            None => false,
        };
        match frame {
            Frame::Full(_, throttle) => self.throttle_frame(at, throttle, opens)?,
            Frame::Mode(_, factor) if factor != 0 => self.factor = factor,
            Frame::RpmCode(code) => {
                self.tally.rpm_frames += 1;
                self.rpm_frame(at, u32::from(code) * u32::from(self.factor) * 10, opens)?;
            }
            _ => {}
        }
        Ok(())
    }

    /// The source in control, for a reader.
    fn who(&self) -> &'static str {
        self.in_force.map_or("a source that is not known for certain", Origin::name)
    }

    /// A stop or standby.
    pub(super) fn ended(&mut self, at: u64, frame: Frame) -> Result<(), String> {
        // The frame sent now may have been decided at any time since the last one, whoever has commanded since.
        let reason = self.standby_reason.is_some_and(|since| since + TOL >= self.last_run);
        if self.guard && at < self.booted + 10 * SECOND && !reason && !self.ended_by_loss(at) {
            return Err(format!("(5) {frame} after a reset, with an engine that runs"));
        }
        if self.wire_run
            && self.latched.is_none()
            && !self.uncertain(at)
            && at > self.fault_at + UNCERTAIN
            && self.healthy_since.is_some_and(|since| at > since + 3 * SECOND)
        {
            self.tally.healthy_ends += 1;
            if self.over.is_none() && !reason {
                return Err(format!("(5) {frame} to an engine that runs, and its run was not ended"));
            }
        }
        // A standby that takes effect is its source's own, and permits its next run.
        if self.wire_run
            && self.latched.is_none()
            && let Some(origin) = self.ended_by_lower(at).or(self.ended_by_lower_since_last_run())
            && let Some(source) = &mut self.sources[slot(origin)]
        {
            source.permitted = Some(at);
        }
        self.attempts.retain(|attempt| attempt.at + TOL >= at);
        self.wire_run = false;
        self.may_continue = false;
        self.reached = false;
        self.ran = false;
        self.guard = false;
        self.limited = false;
        self.over = None;
        self.standby_reason = None;
        self.rising = None;
        self.dark_at = None;
        self.throttle = 0;
        self.rpm = 0;
        self.silent = None;
        Ok(())
    }

    pub(super) fn run(&mut self, at: u64) -> Result<bool, String> {
        self.tally.run_frames += 1;
        if !self.wire_run {
            return self.begins(at).map(|()| true);
        }
        if let Some((over, why)) = &self.over
            && at > over + TOL
        {
            // A new start after it.
            if let Ok(()) = self.start_allowed(at) {
                self.tally.starts += 1;
                self.opened_by_start(at);
                return Ok(true);
            }
            return Err(format!("(1) run, and {why}"));
        }
        self.run_continues(at)?;
        self.void_permissions(at);
        self.last_run = at;
        Ok(false)
    }

    /// A permission from before a run is used up.
    pub(super) fn void_permissions(&mut self, at: u64) {
        for source in self.sources.iter_mut().flatten() {
            source.permitted = source.permitted.filter(|given| given + TOL >= at);
        }
    }

    pub(super) fn run_continues(&self, at: u64) -> Result<(), String> {
        let loss = self.config.supervision.loss;
        let fail_safe = self.wanted_until + loss.hold.as_micros();
        if let Some(after) = loss.standby_after
            && at > fail_safe + after.as_micros() + TOL
        {
            return Err("(1) run, and every source is silent for longer than the time to standby".into());
        }
        // If that is not configured, all sources have to be silent.
        let silent =
            loss.standby_after.is_some() || self.each().all(|(_, source)| at > source.silent_from + TOL);
        if !self.reached
            && silent
            && at > fail_safe + loss.standby_after.map_or(RUN_OUT, |after| after.as_micros()) + TOL
        {
            return Err("(1) run to an engine that does not run yet, and every source is silent".into());
        }
        if !self.uncertain(at)
            && let Some((origin, Source { intent: Intent::Standby, changed, .. })) = self.active_source(at)
            && at > fail_safe.max(changed) + loss.lower_standby_after.as_micros() + TOL
            // It may have taken control at this very instant.
            && self.active_source(at.saturating_sub(TOL)).is_some_and(|(before, _)| before == origin)
        {
            return Err(format!("(1) run, and {origin} commands standby, and no source a run"));
        }
        // A life that is in doubt, or over.
        if self.not_received {
            return Err("(8) run, and the ECU is not received".into());
        }
        let disturbed = at < self.fault_at + BEHIND_FAULTY;
        if let Some(dark) = self.dark_at {
            let noisy = self.line_fault_at + 3 * SECOND > dark;
            if at > dark + DARK && !noisy {
                return Err("(8) run, and the ECU has lost its power in this run".into());
            }
        }
        let behind = if disturbed || at < self.odd_at + BEHIND_FAULTY { BEHIND_FAULTY } else { BEHIND };
        let dead = self.ran && !self.truth.live && at > self.live_at.max(self.opened) + behind;
        if dead && !self.truth.hides_state && !self.truth.odd {
            return Err("(8) run, and the engine has stopped in this run".into());
        }
        // Error sets carry no state: the exhaust is the evidence.
        if dead && self.truth.faulty && at > self.warm_at + BEHIND_FAULTY + 5 * SECOND {
            return Err("(8) run, and the exhaust of an engine with faults is cold".into());
        }
        Ok(())
    }

    /// The first run after something else.
    pub(super) fn begins(&mut self, at: u64) -> Result<(), String> {
        match self.start_allowed(at) {
            Ok(()) => {
                self.tally.starts += 1;
                self.opened_by_start(at);
                Ok(())
            }
            Err(_) if self.may_continue => self.continues(at),
            Err(why) => Err(why),
        }
    }

    pub(super) fn start_allowed(&self, at: u64) -> Result<(), String> {
        let attempts = || self.attempts.iter().filter(|attempt| attempt.at <= at + TOL);
        if attempts().any(|attempt| attempt.against.is_none()) {
            return Ok(());
        }
        let mut all: Vec<String> = attempts().filter_map(|attempt| attempt.against.clone()).collect();
        all.dedup();
        Err(if all.is_empty() { "(1) run begins without a command".into() } else { all.join("; ") })
    }

    pub(super) fn opened_by_start(&mut self, at: u64) {
        let attempt = self.attempts.iter().rev().find(|attempt| attempt.against.is_none());
        self.in_force = attempt.map(|attempt| attempt.by);
        self.attempts.clear();
        self.wire_run = true;
        self.reached = false;
        self.ran = false;
        self.opened = at;
        self.last_run = at;
        self.lost = false;
        (self.waiting, self.interrupted) = (None, None);
        self.settled = at;
        self.limited = false;
        self.silent = None;
        self.over = None;
        self.standby_reason = None;
        self.dark_at = None;
        self.rising = Some((at, 0));
        self.void_permissions(at);
    }

    /// After a reset.
    pub(super) fn continues(&mut self, at: u64) -> Result<(), String> {
        self.tally.resumed_runs += 1;
        // Where a fault hides the state of the engine, only a hot exhaust and the retained state remain.
        let burns = self.truth.hides_state && at < self.warm_at + BEHIND_FAULTY;
        let disturbed = self.truth.odd || at < self.fault_at + BEHIND_FAULTY;
        let alive = self.truth.live || at < self.live_at + BEHIND || disturbed || burns;
        if !alive {
            return Err("(1) it resumed an engine that does not run".into());
        }
        if self.retained.is_none() {
            // It belongs to no source: the stages of loss begin.
            self.wanted_until = self.wanted_until.max(at);
            // Nor does it belong to a source that commanded while no order was in force, and no longer commands a run.
            if !matches!(self.active_source(at), Some((_, Source { intent: Intent::Run(_), .. }))) {
                (self.in_force, self.waiting, self.lost) = (None, None, true);
                self.interrupted = None;
            }
        }
        self.attempts.clear();
        self.wire_run = true;
        self.reached = true;
        self.opened = at;
        self.last_run = at;
        self.last_wanted = self.last_wanted.max(self.before_reset.0);
        // The demand commanded just before may have been reached when the engine was confirmed.
        let steady = |active: Option<(Origin, Source)>| {
            active.is_none_or(|(_, source)| at > source.changed + SECOND / 2)
        };
        let steady = steady(self.active_source(at)) && steady(self.perhaps_active(at));
        self.rising = steady.then_some((at, self.before_reset.0.max(self.truth.obeyed)));
        Ok(())
    }

    /// The bounds of a demand by (3): the fail-safe value, its ramp per second, and the value from which it falls.
    pub(super) fn silent_bound(
        &mut self,
        at: u64,
        safe: u32,
        from: u32,
        rate: u32,
        rpm: bool,
    ) -> Option<u32> {
        if at <= self.wanted_until + TOL {
            return None;
        }
        self.tally.silent_frames += 1;
        // An rpm falls to the idle speed, which the ECU reports once in a round. Until then a throttle replaces it, which a hung
        // transmitter does not send.
        let known = if rpm && self.hung.1 > self.booted { self.booted + ROUND } else { 0 };
        let from_then = self.wanted_until + self.config.supervision.loss.hold.as_micros() + TOL;
        let passed = at.saturating_sub(from_then.max(known));
        let fallen = u64::from(rate) * passed / SECOND;
        // 25 ms of the ramp for a step of it and a frame, and half a percent for AMT's resolution.
        let slack = rate / 40 + if rpm { self.max_rpm / 200 } else { 6 };
        let bound = (u64::from(from) + u64::from(slack)).saturating_sub(fallen).max(u64::from(safe));
        Some(u32::try_from(bound).unwrap_or(u32::MAX))
    }

    pub(super) fn silent_base(&mut self, at: u64) -> (u16, u32) {
        if at <= self.wanted_until + TOL {
            self.silent = None;
            return (self.throttle, self.rpm);
        }
        let (throttle, rpm) = (self.throttle.max(self.peak_throttle), self.rpm.max(self.peak_rpm));
        let (_, throttle, rpm) = *self.silent.get_or_insert((at, throttle, rpm));
        (throttle, rpm)
    }

    /// The highest demand that may have been in force before without a frame to show it: after a reset, or if the order was
    /// given up and the ECU's own demand taken over.
    pub(super) fn unseen(&self, at: u64) -> (u16, u32) {
        if self.uncertain(at) {
            let throttle = self.before_reset.0.max(self.uncertain_throttle).max(self.truth.obeyed);
            return (throttle, self.before_reset.1.max(self.uncertain_rpm));
        }
        let gap = at > self.last_frame + 3 * SECOND;
        (if gap { self.truth.obeyed } else { 0 }, 0)
    }

    pub(super) fn throttle_frame(&mut self, at: u64, throttle: u16, opens: bool) -> Result<(), String> {
        if !self.wire_run {
            return Ok(());
        }
        let (from, _) = self.silent_base(at);
        let loss = self.config.supervision.loss;
        // (6)
        let wanted = self.wanted(at);
        let unseen = self.unseen(at).0;
        let before = self.throttle.max(unseen);
        // Until the ECU has reported its version after a reset, the governor holds an rpm for it.
        let version_known = at > self.booted + BEHIND_FAULTY && at > self.fault_at + BEHIND_FAULTY;
        let governed = self.config.supervision.governor.filter(|_| !self.speed_control || !version_known);
        let authority = governed.map_or(0, |governor| governor.authority.tenths());
        let sliding = if self.on_its_way(at) && !self.lost { self.last_wanted } else { 0 };
        let from = from.max(authority).max(sliding);
        let limit = match self.held(at) {
            // An rpm that is held is still governed.
            true if authority > 0 => 1000,
            true => before
                .max(self.peak_throttle)
                .max(sliding)
                .max(wanted.map_or(0, |wanted| self.as_throttle(wanted))),
            false if version_known => {
                self.peak_throttle.max(wanted.map_or(0, |wanted| self.as_throttle(wanted)))
            }
            false => {
                self.peak_throttle.max(wanted.map_or(0, |wanted| self.as_throttle(wanted))).max(authority)
            }
        };
        // At the fail-safe of a limit a demand of the other kind cannot be compared.
        let limit = match wanted {
            Some(Demand::Rpm(_)) if self.limited => limit.max(before),
            _ => limit,
        };
        if throttle > limit && !opens {
            return Err(format!(
                "(6) throttle {}, {} commands {} at most ({}, before {})",
                percent(throttle),
                self.who(),
                percent(limit),
                if self.held(at) { "held" } else { "not held" },
                percent(before)
            ));
        }
        // (3)
        let from = from.max(unseen);
        let bound =
            self.silent_bound(at, loss.throttle.tenths().into(), from.into(), loss.ramp.into(), false);
        if let Some(bound) = bound {
            self.tally.fail_safe_frames += u64::from(bound <= u32::from(loss.throttle.tenths()));
            if u32::from(throttle) > bound {
                return Err(format!(
                    "(3) throttle {} above {}, and every source is silent",
                    percent(throttle),
                    percent(bound)
                ));
            }
        }
        // (9)
        self.rises(at, throttle, authority > 0)?;
        // (7)
        if let Some(Demand::Throttle(wanted)) = self.exact(at) {
            self.tally.exact_frames += 1;
            if throttle.abs_diff(wanted.tenths()) > 5 {
                return Err(format!(
                    "(7) throttle {}, {} commands {}",
                    percent(throttle),
                    self.who(),
                    percent(wanted.tenths())
                ));
            }
        }
        self.throttle = throttle;
        Ok(())
    }

    /// After a start, a take-over, a gap or a reset the demand rises at its set rate until it has reached the commanded one.
    pub(super) fn rises(&mut self, at: u64, throttle: u16, governed: bool) -> Result<(), String> {
        // It stays at idle until the engine has come to run.
        if !self.reached {
            self.rising = Some((at, 0));
        }
        if core::mem::take(&mut self.rpm_last) {
            // Of another kind: it continues from the throttle that the ECU reports, or from one that was in force for less than a slot.
            let obeyed = self.obeyed.1.max(self.obeyed.2);
            let moved = |since, from: u16| if since > self.last_frame { from.max(obeyed) } else { obeyed };
            self.rising = self.rising.map(|(since, from)| (at, moved(since, from)));
        }
        let Some(risen) = self.risen(at) else { return Ok(()) };
        // A governor moves at its own rate, and a reduction for another engine ends when that engine reports it.
        if governed || self.config.supervision.when_other_fails.is_some() || self.limited {
            self.rising = None;
            return Ok(());
        }
        self.tally.rising_frames += 1;
        if throttle > risen {
            return Err(format!(
                "(9) throttle {}, and it rises to {} at most",
                percent(throttle),
                percent(risen)
            ));
        }
        Ok(())
    }

    pub(super) fn rpm_frame(&mut self, at: u64, rpm: u32, opens: bool) -> Result<(), String> {
        if !self.wire_run {
            return Ok(());
        }
        let slack = u32::from(self.factor) * 10;
        let (_, from) = self.silent_base(at);
        let unseen = self.unseen(at).1;
        let before = self.rpm.max(unseen);
        let wanted = match self.wanted(at) {
            Some(Demand::Rpm(rpm)) => rpm.get(),
            _ => 0,
        };
        // With a slew it may still be moving to the previous command.
        let sliding = if self.on_its_way(at) && !self.lost { self.max_rpm } else { 0 };
        let from = from.max(sliding);
        let limit = if self.held(at) { before.max(sliding) } else { 0 }.max(self.peak_rpm).max(wanted);
        // Nor can a demand of the other kind be compared in doubt.
        let in_doubt = at < self.fault_at + BEHIND_FAULTY;
        let limit = match self.wanted(at) {
            Some(Demand::Throttle(_)) if self.limited || in_doubt => limit.max(before),
            _ => limit,
        };
        if rpm > limit + slack && !opens && rpm > self.idle_rpm + slack || rpm > self.max_rpm + slack {
            return Err(format!("(6) {rpm} rpm, {} commands {limit} rpm at most", self.who()));
        }
        let from = from.max(unseen);
        let rate = self.max_rpm / 1000 * u32::from(self.config.supervision.loss.ramp);
        if let Some(bound) = self.silent_bound(at, self.idle_rpm, from, rate, true)
            && rpm > bound + slack
        {
            return Err(format!("(3) {rpm} rpm above {bound}, and every source is silent"));
        }
        if let Some(Demand::Rpm(wanted)) = self.exact(at) {
            self.tally.exact_frames += 1;
            if rpm.abs_diff(wanted.get()) > slack {
                return Err(format!("(7) {rpm} rpm, {} commands {} rpm", self.who(), wanted.get()));
            }
        }
        self.rpm = rpm;
        self.rpm_last = true;
        Ok(())
    }

    /// The demand may still rise to the last command of the last source in control: by a slew or its set rate, or because the
    /// engine has just come to run.
    pub(super) fn on_its_way(&self, at: u64) -> bool {
        self.config.supervision.slew.up.is_some()
            || self.rising.is_some()
            // It is reduced for as long as another engine has failed.
            || self.config.supervision.when_other_fails.is_some()
            || self.running_since.is_none_or(|since| at < since + BEHIND)
    }

    /// What the source in control commands.
    pub(super) fn wanted(&self, at: u64) -> Option<Demand> {
        match self.active_source(at)?.1.intent {
            Intent::Run(demand) => Some(demand),
            Intent::Standby | Intent::Nothing => None,
        }
    }

    /// The demand in force may be held: no source is in control, or another is about to take over.
    pub(super) fn held(&self, at: u64) -> bool {
        let sliding = self.config.supervision.slew.down.is_some();
        self.lost || self.waiting.is_some() || self.uncertain(at) || sliding || at < self.settled + TOL
    }

    /// The exact demand required on the wire, if nothing limits it.
    pub(super) fn exact(&self, at: u64) -> Option<Demand> {
        let (origin, source) = self.active_source(at)?;
        let Intent::Run(demand) = source.intent else { return None };
        let supervision = &self.config.supervision;
        let slewed = supervision.slew.up.is_some() || supervision.slew.down.is_some();
        let rise = 1000 * SECOND / u64::from(supervision.rise) + SECOND;
        let moving = if slewed { 20 * SECOND } else { rise };
        let clear = self.in_force == Some(origin)
            && !self.lost
            && self.waiting.is_none()
            && at > self.settled + moving
            && at > source.changed + moving
            // Also after a reset, a slew continues from the demand on the wire.
            && at > self.booted + moving + UNCERTAIN
            && at > self.fault_at + BEHIND_FAULTY + moving
            && self.running_since.is_some_and(|since| at > since + moving.max(3 * SECOND))
            && !self.limited
            && self.config.supervision.when_other_fails.is_none();
        let able = matches!(demand, Demand::Throttle(_)) || self.speed_control;
        (clear && able).then_some(demand)
    }
}

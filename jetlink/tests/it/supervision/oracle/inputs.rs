//! Events other than frames: commands of the sources, actions of the ECU, resets.

use super::*;

impl Oracle {
    pub fn input(&mut self, at: u64, input: Input) -> Result<(), String> {
        self.advance(at);
        match input {
            Input::Commanded(origin, command, answer) => self.commanded(at, origin, command, answer)?,
            Input::Truth(truth) => self.truth(at, truth)?,
            Input::Boot { retained, down } => self.boot(at, retained, down),
            Input::Fault => {
                self.fault_at = at;
                self.guard = false;
            }
            Input::LineFault => {
                self.fault_at = at;
                self.line_fault_at = at;
                self.guard = false;
            }
            Input::Dark => {
                if self.wire_run {
                    self.tally.dark_runs += 1;
                    self.dark_at.get_or_insert(at);
                }
            }
            Input::NotReceived => self.not_received = true,
            Input::Received => self.not_received = false,
            Input::HungUntil(until) => self.hung = (self.last_frame, until),
            Input::LinkBack => self.link_back = at,
            // The time of a start before a reset is not retained.
            Input::OtherStarted(started) if started > self.booted => self.other_started = Some(started),
            Input::OtherStarted(_) => {}
        }
        Ok(())
    }

    pub(super) fn commanded(
        &mut self,
        at: u64,
        origin: Origin,
        command: Command,
        answer: Result<Accepted, Rejected>,
    ) -> Result<(), String> {
        match command {
            Command::EmergencyStop => {
                let by = self
                    .latched
                    .map_or(origin, |(by, _)| if by.priority() > origin.priority() { by } else { origin });
                let since = self.latched.map_or(at, |(_, since)| since);
                self.latched = Some((by, since));
                self.guard = false;
                self.armed = false;
                for (must, commanded) in self.must_disarm.iter_mut().zip(self.arm_commanded) {
                    *must |= commanded;
                }
                self.use_up_all();
                // Before the runner begins, so that no source is restored from the record.
                if at == self.booted {
                    self.sources = [None; 4];
                }
            }
            Command::ReleaseStop => {
                if answer.is_ok()
                    && let Some((by, _)) = self.latched.take()
                {
                    if origin.priority() < by.priority() {
                        return Err(format!("(4) {origin} released the emergency stop of {by}"));
                    }
                    // A fault may hide the state of the engine, and no ECU has reported it right after a
                    // reset; standby is no start.
                    let unreported = self.truth.hides_state || at < self.booted + BEHIND;
                    let disturbed = self.truth.odd || at < self.fault_at + BEHIND_FAULTY;
                    let at_rest = !self.truth.live || unreported || disturbed;
                    if !at_rest && self.live_since.is_some_and(|since| at > since + BEHIND) {
                        return Err("(4) an emergency stop was released while the engine runs".into());
                    }
                    self.use_up_all();
                    self.may_continue = false;
                }
            }
            Command::Arm => self.arm(origin, answer)?,
            Command::Disarm => {
                self.armed = false;
                self.arm_commanded[slot(origin)] = false;
                self.must_disarm[slot(origin)] = false;
                self.use_up_all();
                if self.wire_run && !self.reached {
                    self.end(at, || format!("{origin} disarmed, and the engine has not reached running"));
                    self.standby_reason = Some(at);
                }
            }
            Command::ShutDown => {
                self.guard = false;
                self.standby_commanded = Some(at);
                if self.latched.is_none() {
                    self.use_up_all();
                    self.standby_reason = Some(at);
                    self.may_continue = false;
                    self.end(at, || format!("{origin} commanded to shut down"));
                }
            }
            Command::Present => {
                let active_before = self.active_source(at);
                self.receive(at, origin, Intent::Nothing);
                self.in_control_until_now(active_before);
                self.look();
            }
            Command::Standby => self.standby_command(at, origin, answer)?,
            Command::Run(demand) => self.run_command(at, origin, demand, answer),
            // Services and the hand-over do not affect this judge.
            _ => {}
        }
        Ok(())
    }

    pub(super) fn use_up_all(&mut self) {
        self.lower_standby = None;
        for source in self.sources.iter_mut().flatten() {
            source.permitted = None;
        }
    }

    pub(super) fn arm(&mut self, origin: Origin, answer: Result<Accepted, Rejected>) -> Result<(), String> {
        self.arm_commanded[slot(origin)] = true;
        if answer.is_ok() {
            if self.latched.is_some() {
                return Err(format!("(4) {origin} armed while an emergency stop is latched"));
            }
            if self.must_disarm[slot(origin)] {
                return Err(format!(
                    "(4) {origin} armed with an \"arm\" that it has commanded since before the stop"
                ));
            }
            self.armed = true;
        }
        self.must_disarm[slot(origin)] |= self.latched.is_some();
        Ok(())
    }

    /// A source issues a command.
    pub(super) fn receive(&mut self, at: u64, origin: Origin, intent: Intent) {
        let age = self.age(origin);
        let return_within = self.config.supervision.return_within.as_micros();
        let before = self.sources[slot(origin)];
        let mut source = before.unwrap_or(Source::new(at, intent));
        if let Some(before) = before {
            // One that is present but commands nothing has no gap.
            let gap_from =
                if before.intent == Intent::Nothing { before.last_rx + age } else { before.silent_from };
            if at >= gap_from {
                // A steady stream with one short gap continues.
                source.was_lost = !self.steady(&before) || at >= gap_from + return_within;
                source.since = at;
            }
        }
        if source.intent != intent {
            source.before = source.intent;
            source.changed = at;
        }
        source.silent_from = match (intent, before) {
            (Intent::Nothing, Some(Source { intent: Intent::Nothing, silent_from, .. })) => silent_from,
            // A source that commands nothing is silent from then on.
            (Intent::Nothing, Some(before)) => before.silent_from.min(at),
            (Intent::Nothing, None) => at,
            _ => at + age,
        };
        if intent == Intent::Nothing {
            source.permitted = None;
        }
        source.standby_at = None;
        source.intent = intent;
        source.last_rx = at;
        self.sources[slot(origin)] = Some(source);
    }

    pub(super) fn standby_command(
        &mut self,
        at: u64,
        origin: Origin,
        answer: Result<Accepted, Rejected>,
    ) -> Result<(), String> {
        self.guard = false;
        self.standby_commanded = Some(at);
        let active_before = self.active_source(at);
        let before = self.sources[slot(origin)];
        let fresh = before.filter(|before| at < before.silent_from);
        let second = before.and_then(|before| before.standby_at);
        if answer == Ok(Accepted::RepeatStandby) {
            // Two commands within the timeout are an order.
            if second.is_some_and(|second| at + TOL <= second + self.age(origin)) {
                return Err(format!("(1) {origin} has commanded standby twice, and that is not enough"));
            }
            if self.wire_run && !self.reached {
                return Err(format!("(1) {origin} commanded standby in a start, and that is not enough"));
            }
            self.receive(at, origin, fresh.map_or(Intent::Nothing, |before| before.intent));
        } else {
            let healthy = self.wire_run && self.over.is_none() && self.latched.is_none() && self.ran;
            let lately = second.is_some_and(|second| at <= second + self.age(origin).max(RUN_OUT));
            // It does not count while another source is in control; the standby of the source in control has ended the run.
            let counts = answer == Ok(Accepted::InForce);
            // A reason that ended the run since the last frame does not end it again.
            let ended =
                self.standby_in_force.is_some_and(|since| since >= self.last_frame) || self.ended_by_loss(at);
            if counts {
                self.standby_in_force = Some(at);
            }
            if healthy
                && counts
                && !ended
                && self.healthy_since.is_some_and(|since| at > since + 3 * SECOND)
                && !lately
            {
                return Err(format!("(5) one standby of {origin} counts, and the engine runs"));
            }
            let changed = fresh.is_none_or(|before| before.intent != Intent::Standby);
            if changed {
                self.use_up_all();
            }
            self.receive(at, origin, Intent::Standby);
            let permits = matches!(answer, Ok(Accepted::InForce | Accepted::Behind(_)));
            if let Some(source) = &mut self.sources[slot(origin)] {
                source.permitted = permits.then_some(at);
            }
            // It may also end an order that belongs to no source.
            self.standby_reason = Some(at);
        }
        if let Some(source) = &mut self.sources[slot(origin)] {
            source.standby_at = Some(at);
        }
        self.in_control_until_now(active_before);
        self.look();
        Ok(())
    }

    pub(super) fn run_command(
        &mut self,
        at: u64,
        origin: Origin,
        demand: Demand,
        answer: Result<Accepted, Rejected>,
    ) {
        // A demand that is refused because the ECU cannot do it is not taken over, and the permission is used up.
        if let Err(
            Rejected::NeedsVersion { .. }
            | Rejected::NoSpeedControl
            | Rejected::RpmNotKnown
            | Rejected::AboveMaxRpm { .. },
        ) = answer
        {
            if let Err(Rejected::NeedsVersion { known: None, .. } | Rejected::RpmNotKnown) = answer {
                // It is present, and its earlier run stays in force, if it was present all along.
                let (before, active_before) = (self.sources[slot(origin)], self.active_source(at));
                let fresh = before.filter(|before| at < before.silent_from);
                let runs =
                    fresh.map(|before| before.intent).filter(|intent| matches!(intent, Intent::Run(_)));
                self.receive(at, origin, runs.unwrap_or(Intent::Run(demand)));
                self.in_control_until_now(active_before);
                self.look();
            }
            if let Some(source) = &mut self.sources[slot(origin)] {
                source.permitted = None;
            }
            return;
        }
        let demand = match demand {
            Demand::Rpm(rpm) if self.speed_control => Demand::Rpm(rpm.min(self.max())),
            demand => demand,
        };
        let active_before = self.active_source(at);
        self.receive(at, origin, Intent::Run(demand));
        // One that was lost before the reset has to be received for a while first. The time for which it was received right before the
        // reset counts.
        let lost_before = self.retained.is_some_and(|(retained, _, was_lost)| retained == origin && was_lost);
        let back = self.sources[slot(origin)].is_some_and(|source| self.perhaps_steady(&source));
        if self.uncertain(at) && (!lost_before || back) {
            self.uncertain_throttle = self.uncertain_throttle.max(self.as_throttle(demand));
            if let Demand::Rpm(rpm) = demand {
                self.uncertain_rpm = self.uncertain_rpm.max(rpm.get());
            }
            self.wanted_until = self.wanted_until.max(at + self.age(origin));
            // It may be back in control at once, and have its demand.
            self.may_have_risen(at, demand);
        }
        if !self.wire_run || self.over.is_some() {
            let against = self.against_start(at, origin, demand);
            self.attempts.push(Attempt { at, by: origin, against });
        }
        if answer != Ok(Accepted::StartWaits)
            && let Some(source) = &mut self.sources[slot(origin)]
        {
            source.permitted = None;
        }
        self.in_control_until_now(active_before);
        self.look();
    }

    pub(super) fn max(&self) -> jetlink::units::Rpm {
        jetlink::units::Rpm::new(self.max_rpm)
    }

    /// Obstacles to a start by this command of this source.
    pub(super) fn against_start(&self, at: u64, origin: Origin, demand: Demand) -> Option<String> {
        let config = self.config.supervision;
        let behind = if at < self.fault_at + BEHIND_FAULTY { BEHIND_FAULTY } else { BEHIND };
        let source = self.sources[slot(origin)]?;
        let open = |what: &str| Some(format!("(2) a start by {origin}: {what}"));
        if source.permitted.is_none() {
            return Some(format!(
                "(1) a start by {origin}: its own standby was not commanded, or is used up"
            ));
        }
        match self.active_source(at) {
            Some((active_source, _)) if active_source == origin => {}
            Some((active_source, _)) => {
                return Some(format!("(1) a start by {origin}: {active_source} is in control"));
            }
            None => return Some(format!("(1) a start by {origin}: it is not there yet")),
        }
        if config.start.arming && !self.armed {
            return open("it is not armed");
        }
        if !self.is_idle(demand) {
            return open("the demand is above idle");
        }
        if at > self.standby_at + behind {
            return open("the ECU does not report standby");
        }
        if at > self.healthy_at + behind {
            return open("the ECU reports a fault");
        }
        if at > self.cool_at + behind {
            return open("the exhaust is too hot");
        }
        if at < self.booted.max(self.link_back) + config.start.link_stable.as_micros() {
            return open("the link is not up for long enough");
        }
        if let Some(other) = self.other_started
            && at + 1_500_000 < other + config.start.gap.as_micros()
        {
            return open(&format!("another engine has just started, at {other} µs"));
        }
        None
    }

    pub(super) fn truth(&mut self, at: u64, truth: Truth) -> Result<(), String> {
        self.truth = truth;
        let (since, now, before) = self.obeyed;
        self.obeyed = match at < since + BEHIND {
            true => (since, now.max(truth.obeyed), before),
            false => (at, truth.obeyed, now),
        };
        if truth.live {
            self.live_at = at;
            self.live_since.get_or_insert(at);
        } else {
            self.live_since = None;
        }
        if truth.odd {
            self.odd_at = at;
        }
        // An AMT ECU with a fault does not report that its engine runs.
        if truth.running && !truth.odd && !truth.faulty {
            self.running_since.get_or_insert(at);
        } else {
            self.running_since = None;
        }
        if !self.wire_run {
            self.reached = false;
        }
        // Its reports may differ from what it does.
        self.ran |= self.wire_run && truth.reports_running && !truth.odd && at > self.opened + SECOND;
        let reached = truth.reports_running || truth.odd || at < self.odd_at + BEHIND_FAULTY;
        if reached && !core::mem::replace(&mut self.reached, true) {
            // The truth is sampled: it may have been there a little earlier.
            let met = self.met_at.is_some_and(|met| at < met + SECOND / 2);
            self.rising = self.rising.filter(|_| !met);
        }
        let healthy = truth.running && !truth.odd && !truth.faulty && at > self.fault_at + UNCERTAIN;
        if healthy {
            self.healthy_since.get_or_insert(at);
        } else {
            self.healthy_since = None;
        }
        if let Some(before) = self.gave_up_before
            && self.guard
            && at < self.booted + 5 * SECOND
            && truth.own_stops > before
        {
            return Err(
                "(5) after a reset the ECU stopped a running engine, because the node left it alone".into()
            );
        }
        // Where a fault hides the state of the engine and what the ECU obeys, without memory there is nothing to
        // continue from, and with it an exhaust that shows no combustion ends the run.
        let unreported = truth.hides_state && !self.wire_run && (self.memory_lost || truth.reports_cold);
        if !truth.live || truth.odd || unreported {
            self.guard = false;
        }
        if truth.standby || truth.odd {
            self.standby_at = at;
        }
        if truth.faulty {
            let fail_safe = self.config.supervision.limits.ecu_fault != Action::Report;
            self.limited |= fail_safe;
        } else {
            self.healthy_at = at;
        }
        if truth.egt <= f64::from(self.config.supervision.start.egt_max.tenths()) / 10.0 + 8.0 {
            self.cool_at = at;
        }
        if truth.egt >= f64::from(self.config.supervision.burning_egt.tenths()) / 10.0 - 8.0 {
            self.warm_at = at;
        }
        Ok(())
    }

    pub(super) fn boot(&mut self, at: u64, retained: Retained, down: u64) {
        let loss = self.config.supervision.loss;
        let silent = at > self.wanted_until_least + loss.hold.as_micros();
        let recent = self.standby_commanded.is_some_and(|commanded| at < commanded + down + 2 * SECOND);
        let run_out = loss.standby_after.map_or(RUN_OUT, |after| after.as_micros().min(RUN_OUT));
        self.guard = self.wire_run
            && self.over.is_none()
            && self.latched.is_none()
            && self.truth.live
            && self.truth.obeys_run
            && !self.truth.odd
            && !self.truth.faulty
            && self.live_since.is_some_and(|since| at > since + 3 * SECOND)
            // A start that a reset cuts short is over.
            && self.running_since.is_some_and(|since| at > since + 3 * SECOND)
            && at > self.fault_at + BEHIND_FAULTY
            && at > self.booted + 5 * SECOND
            && !recent
            && !(silent && loss.standby_after.is_some())
            // Where the stages of loss have run out, an engine in doubt gets standby.
            && at + SECOND < self.wanted_until_least + run_out
            && self.last_frame + down + SECOND > at;
        self.tally.resets_running += u64::from(self.guard);
        self.gave_up_before = (self.guard && down < SECOND / 2).then_some(self.truth.own_stops);
        self.before_reset = (self.throttle.max(self.truth.obeyed), self.rpm);
        // A demand in force before the reset without a frame to show it, if a source commanded that much.
        match retained {
            Retained::Whole(Some((_, Demand::Throttle(retained), _))) => {
                let wanted = self.peak_throttle.max(self.last_wanted).max(self.uncertain_throttle);
                self.before_reset.0 = self.before_reset.0.max(retained.tenths().min(wanted));
            }
            Retained::Whole(Some((_, Demand::Rpm(retained), _))) => {
                let wanted = self.peak_rpm.max(self.uncertain_rpm);
                self.before_reset.1 = self.before_reset.1.max(retained.get().min(wanted));
            }
            _ => {}
        }
        self.memory_lost = retained == Retained::Lost;
        self.retained = match retained {
            Retained::Whole(demand) => demand,
            _ => None,
        };
        match retained {
            Retained::Whole(_) => {}
            Retained::PowerLost => self.armed = false,
            Retained::Lost => {
                self.latched = None;
                self.armed = false;
                self.arm_commanded = [false; 4];
                self.must_disarm = [false; 4];
            }
        }
        self.armed &= self.latched.is_none();
        // The silence of all sources continues over the reset; it begins at the reset only if one has just commanded.
        let wanting = self.each().filter(|(_, source)| source.intent != Intent::Nothing);
        let last_command = wanting.map(|(_, source)| source.last_rx).max().unwrap_or(0) + down + CARRIED;
        self.wanted_until = self.wanted_until.saturating_add(down + CARRIED);
        // An engine that was found running, and that nobody had taken over yet, has no source.
        let of_a_source = self.retained.filter(|(origin, ..)| *origin != Origin::Node);
        let resumed = of_a_source.map(|(origin, demand, was_lost)| {
            let silent_from = (last_command + self.age(origin)).min(at + self.age(origin));
            self.wanted_until = self.wanted_until.max(silent_from);
            (origin, Source { silent_from, was_lost, ..Source::new(at, Intent::Run(demand)) })
        });
        let stream = of_a_source.and_then(|(origin, ..)| self.sources[slot(origin)]);
        self.steady_before = stream.filter(|source| at < source.silent_from + down).map_or(0, |source| {
            // A source received since the last reset may continue from before it.
            let earlier = if source.since < self.booted + SECOND { self.steady_before } else { 0 };
            // It counts as received up to the reset, rounded up to a step.
            (at - down - source.since + earlier).next_multiple_of(STEADY_STEP).min(STEADY_MAX)
        });
        self.sources = [None; 4];
        if let Some((origin, source)) = resumed {
            self.sources[slot(origin)] = Some(source);
        }
        self.attempts.clear();
        self.in_force = None;
        (self.waiting, self.interrupted) = (None, None);
        self.lost = true;
        self.over = None;
        self.standby_reason = None;
        self.rising = None;
        self.rpm_last = false;
        self.dark_at = None;
        self.uncertain_throttle = 0;
        self.uncertain_rpm = 0;
        // The time of a start is not retained.
        self.other_started = None;
        self.booted = at;
        self.wire_run = false;
        self.ran = false;
        self.may_continue = self.latched.is_none();
        self.settled = at;
        self.look();
    }
}

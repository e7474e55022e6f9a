//! The conversation with a ZK ECU: a command at every turn, ID 0 when nothing is commanded (ZK-10).
//!
//! Up to version 4 the ECU speaks only when spoken to. From version 5 it sends by itself and keeps its last running
//! state when commands stop, so nothing here relies on it to fail safe.
//!
//! What goes out at a turn, first match first:
//!
//! 1. an emergency stop, also out of turn, and again at every turn; in between, at every second turn at most, the end of
//!    a service that opened the pump;
//! 2. what an unlock was sent for, right behind it (ZK-13);
//! 3. at every second turn at most: status rate, service command, atmospheric pressure;
//! 4. the switch and the demand, in one of three modes (ZK-9), or ID 0.

use super::codec::{
    Action, Control, Decoder, ErrorCode, Rate, RpmCode, RpmFactor, STATUS_LEN, State, Status, StatusFrame,
    Switch, SwitchStatus, Version, VoltageByte,
};
use super::config::{Config, Service};
use crate::command::{Demand, Order, Rejected};
use crate::ecu::{Faults, Service as AnyService};
use crate::event::Event;
use crate::line::{Line, LineError, Timing};
use crate::link::{Beat, Debounced, Link, LinkMonitor, Outbox, Output, Sign, Stage, Transmission, earlier};
use crate::report::{
    Counters, EcuState, LinkState, NotSent, Phase, RawFrame, Reading, Report, ReportedSwitch, Timed, bump,
};
use crate::units::{Hectopascals, Rpm, Throttle};
use embassy_time::{Duration, Instant};

/// Between two attempts to set the status rate.
const RATE_RETRY: Duration = Duration::from_secs(1);
/// Attempts to set the status rate until it is given up.
const RATE_ATTEMPTS: u8 = 5;
/// For the ECU to show what a service command set: every status ID comes round well within this.
const CONFIRM_WITHIN: Duration = Duration::from_secs(2);
/// Attempts of a service command that the ECU confirms.
const SERVICE_ATTEMPTS: u8 = 3;
/// For the ECU to show the switch that was ordered: status ID 1 comes round within 0.5 s.
const FOLLOWS_WITHIN: Duration = Duration::from_millis(700);
/// Frames of a close command for the pump; it ends sooner where the ECU reports a pump without voltage.
const CLOSE_PUMP_FRAMES: u8 = 10;
/// From the frame that closes the pump to a voltage that shows it.
const PUMP_CLOSES_WITHIN: Duration = Duration::from_millis(100);
/// A shaft that turns slower than this share of the maximum is not running, where no idle speed is known.
const HALF_IDLE_SHARE: u32 = 10;
/// The same where no maximum is known either. Below 4000 rpm the reading of a shaft at rest is noise (field note).
const HALF_IDLE_UNKNOWN: Rpm = Rpm::new(10_000);
/// Between two pressures (ZK-14).
const PRESSURE_EVERY: Duration = Duration::from_secs(1);
/// An older pressure is not sent: none is better than a stale one (ZK-14).
const PRESSURE_MAX_AGE: Duration = Duration::from_secs(5);

/// Where a service command stands. Each state carries what ends it.
#[derive(Clone, Copy, Debug)]
enum ServiceState {
    None,
    /// Goes out at the next turn that is free for it.
    Waiting {
        service: Service,
        attempts_left: u8,
    },
    /// The unlock is going out; the command follows at once.
    Unlocking {
        service: Service,
        attempts_left: u8,
    },
    /// The command is going out.
    Sending {
        service: Service,
        attempts_left: u8,
    },
    /// Until status ID 5 shows it.
    Confirming {
        service: Service,
        attempts_left: u8,
        until: Instant,
    },
}

/// Where the setting of the status rate stands.
#[derive(Clone, Copy, Debug)]
enum RateState {
    /// Status ID 6 has not said it yet.
    NotKnown,
    Confirmed,
    Asking {
        attempts_left: u8,
        next_at: Instant,
    },
    GivenUp,
}

/// The conversation with one ZK ECU.
#[derive(Clone, Debug)]
pub struct ZkLink {
    config: Config,
    line: Line,
    monitor: LinkMonitor,
    decoder: Decoder,
    report: Report,
    outbox: Outbox,
    counters: Counters,
    order: Order,
    next_slot: Option<Instant>,
    /// Something must go out before the next turn: as soon as the UART is free.
    out_of_slot: bool,
    /// Of two frames that take turns, the second is next.
    second_next: bool,
    /// The last turn was used for something else than switch and demand.
    extra_last: bool,
    beat: Beat,
    sign: Option<Sign>,
    /// The engine runs, so that the demand goes out.
    released: bool,
    /// The ECU was given a switch by ID 6: it ignores the one of ID 1 from then on (ZK-9).
    switch_by_id6: bool,
    /// Close commands for the pump that are left to send, and whether the next turn is for one.
    close_pump: u8,
    close_next: bool,
    /// When the first of them went out.
    closing_since: Option<Instant>,
    /// It may have been given one before we came: it ran when the first order was given, or it does not follow ID 1.
    wants_id6: bool,
    /// Reports in a row that the ECU obeys another switch than the one ordered.
    not_followed: u8,
    /// When what is ordered last changed in kind.
    ordered_at: Instant,
    /// RPM_X of the rpm order in force. It stays for as long as that does: a code for one factor must not come under
    /// another.
    factor: Option<RpmFactor>,
    /// RPM_X as it last went out.
    factor_sent: RpmFactor,
    /// The ID 6 that is going out.
    mode_out: Option<(RpmFactor, Switch)>,
    /// A new RPM_X went out: the frame that it gives a meaning to comes next, before anything else.
    partner_due: bool,
    /// ID 6 was in use when what is ordered last changed in kind.
    began_by_id6: bool,
    // What decides how the ECU is spoken to changes only when two frames agree, and is forgotten with the link.
    identity: Debounced<(Version, Rpm)>,
    idle: Debounced<Rpm>,
    /// Only says when a frame is due: also when nothing but damaged ones comes, and the link counts as lost.
    debounced_rate: Debounced<Option<Rate>>,
    /// Identities that agreed in a row since the link came up.
    identities: u8,
    // What is believed of the engine, debounced.
    phase: Debounced<Phase>,
    switch: Debounced<ReportedSwitch>,
    error: Debounced<ErrorCode>,
    wanted_rate: Rate,
    rate: RateState,
    service: ServiceState,
    pressure: Option<Timed<Hectopascals>>,
    next_pressure: Option<Instant>,
}

impl ZkLink {
    /// A link on a line of this setting.
    pub fn new(config: Config, line: Line, timing: Timing) -> Self {
        Self {
            config,
            line,
            monitor: LinkMonitor::new(timing),
            decoder: Decoder::new(),
            report: Report::default(),
            outbox: Outbox::default(),
            counters: Counters::default(),
            order: Order::Listen,
            next_slot: None,
            out_of_slot: false,
            second_next: false,
            extra_last: false,
            beat: Beat::new(STATUS_LEN as u8, line),
            sign: None,
            released: false,
            switch_by_id6: false,
            close_pump: 0,
            close_next: false,
            closing_since: None,
            wants_id6: false,
            not_followed: 0,
            ordered_at: Instant::MIN,
            factor: None,
            factor_sent: RpmFactor::OFF,
            mode_out: None,
            partner_due: false,
            began_by_id6: false,
            identity: Debounced::new(None),
            idle: Debounced::new(None),
            debounced_rate: Debounced::new(None),
            identities: 0,
            phase: Debounced::new(None),
            switch: Debounced::new(None),
            error: Debounced::new(None),
            wanted_rate: config.rate,
            rate: RateState::NotKnown,
            service: ServiceState::None,
            pressure: None,
            next_pressure: None,
        }
    }

    // -----------------------------------------------------------------------------------------
    // What the ECU says
    // -----------------------------------------------------------------------------------------

    fn frame(&mut self, now: Instant, frame: &StatusFrame) {
        // Silence that has lasted long enough was a loss, also if this frame comes before the timer.
        self.check_link(now);
        self.beat.frame(now);
        if self.monitor.frame(now) {
            self.outbox.event(Event::LinkUp);
        }
        let turning = frame.rpm() >= self.half_idle();
        self.sign = Some(match frame.status() {
            Status::Engine { state, .. } => {
                Sign::State { stage: stage_of(state), turning: Some(turning), throttle: None }
            }
            _ => Sign::Shaft { turning },
        });
        let version = self.version();
        let voltage = |byte: VoltageByte| {
            Some(Timed::new(Reading { raw: byte.0, voltage: byte.millivolts(version) }, now))
        };
        let report = &mut self.report;
        report.rpm = Some(Timed::new(frame.rpm(), now));
        match frame.status() {
            Status::Engine { state, error, egt, switch } => {
                report.egt = Some(Timed::new(egt, now));
                let switch = reported(switch);
                if self.switch.first_or_see(switch) {
                    report.switch = Some(Timed::new(switch, now));
                }
                self.check_switch(now, switch);
                self.state(now, state);
                self.faults(now, error);
            }
            Status::Voltages { radio, power, pump } => {
                report.radio = voltage(radio);
                report.supply = voltage(power);
                report.pump = voltage(pump);
            }
            Status::Throttle { percent, pressure } => {
                if let Ok(throttle) = Throttle::from_percent(percent) {
                    report.throttle = Some(Timed::new(throttle, now));
                }
                report.pressure = Some(Timed::new(pressure, now));
            }
            Status::Load { current, thrust } => {
                report.current = Some(Timed::new(current, now));
                // ZK-7: thrust from version 2.
                if knows(version, 2) {
                    report.thrust = Some(Timed::new(thrust, now));
                }
            }
            Status::Settings { ignition_pump, increase, decrease } => {
                report.ignition_pump = Some(Timed::new(ignition_pump, now));
                report.curve_increase = Some(Timed::new(increase, now));
                report.curve_decrease = Some(Timed::new(decrease, now));
                self.confirm();
            }
            Status::Identity { max_rpm, max_pump, version, rate } => {
                let max_pump = Reading { raw: max_pump.0, voltage: max_pump.millivolts(Some(version)) };
                report.pump_max = Some(Timed::new(max_pump, now));
                let same = self.identity.get() == Some((version, max_rpm));
                if self.identity.first_or_see((version, max_rpm)) {
                    // Two that agree, be it the first two or two against what was known.
                    self.identities = if same { self.identities.saturating_add(1) } else { 1 };
                    if !same && report.version.is_some() {
                        self.identities = 2;
                    }
                    report.max_rpm = Some(Timed::new(max_rpm, now));
                    let before = report.version.replace(Timed::new(version, now));
                    if before.is_none_or(|before| before.value != version) {
                        self.outbox.event(Event::VersionKnown(version));
                    }
                }
                report.rate = rate.map(|rate| Timed::new(rate, now));
                self.debounced_rate.first_or_see(rate);
                self.compare_rate(now, rate);
            }
            Status::Fuel { flow, total } => {
                report.fuel_flow = Some(Timed::new(flow, now));
                report.fuel_total = Some(Timed::new(total, now));
            }
            Status::Idle { idle_rpm, pressure_requested, closed_loop, startup } => {
                if self.idle.first_or_see(idle_rpm) {
                    report.idle_rpm = Some(Timed::new(idle_rpm, now));
                }
                // ZK-7: the rest of this frame from version 4.
                if knows(version, 4) {
                    report.pressure_requested = Some(Timed::new(pressure_requested, now));
                    report.closed_loop = Some(Timed::new(closed_loop, now));
                    report.startup = Some(Timed::new(startup, now));
                }
            }
            Status::Temperature { ecu } => report.ecu_temperature = Some(Timed::new(ecu, now)),
            Status::Unknown => {
                // ZK-15: a frame, not noise.
                report.unknown = Some(Timed::new(RawFrame::new(frame.raw()), now));
            }
        }
    }

    fn check_link(&mut self, now: Instant) {
        if self.monitor.timeout(now) {
            self.outbox.event(Event::LinkLost);
            // Whoever comes back may have restarted with another rate, or be another ECU: nothing that decides how it is
            // spoken to outlives the link.
            self.rate = RateState::NotKnown;
            self.identity = Debounced::new(None);
            self.identities = 0;
            self.idle = Debounced::new(None);
            (self.phase, self.switch, self.error) =
                (Debounced::new(None), Debounced::new(None), Debounced::new(None));
            self.report.phase = None;
            self.report.version = None;
            self.report.max_rpm = None;
            self.report.idle_rpm = None;
            self.report.rate = None;
        }
    }

    fn state(&mut self, now: Instant, state: State) {
        let ecu_state = EcuState { code: state.code(), name: state.name() };
        self.report.state = Some(Timed::new(ecu_state, now));
        let phase = phase_of(state);
        let before = self.phase.get();
        // A frame that says otherwise does not make the phase any newer.
        if self.phase.first_or_see(phase) {
            self.report.phase = Some(Timed::new(phase, now));
            if before != Some(phase) {
                self.outbox.event(Event::Phase(phase));
            }
        }
    }

    fn faults(&mut self, now: Instant, error: ErrorCode) {
        if !self.error.first_or_see(error) {
            return;
        }
        let faults = Faults::Zk(error);
        let before = self.report.faults.replace(Timed::new(faults, now));
        if before.map_or(!faults.is_empty(), |before| before.value != faults) {
            self.outbox.event(Event::Faults(faults));
        }
    }

    /// From one frame to the next: the slower one of what two reports agree on and what is asked for, because an ECU may answer
    /// at either (ZK-10, ZK-11).
    fn frame_interval(&self) -> Duration {
        let reported = self.debounced_rate.get().flatten().unwrap_or(Rate::Hz20);
        reported.interval().max(self.wanted_rate.interval())
    }

    /// Half of the engine's idle speed, as far as it is known.
    fn half_idle(&self) -> Rpm {
        let idle = self.report.idle_rpm.map(|idle| idle.value.get()).filter(|idle| *idle > 0);
        let max = self.report.max_rpm.map(|max| max.value.get()).filter(|max| *max > 0);
        match (idle, max) {
            (Some(idle), _) => Rpm::new(idle / 2),
            (None, Some(max)) => Rpm::new(max / HALF_IDLE_SHARE),
            (None, None) => HALF_IDLE_UNKNOWN,
        }
    }

    /// ZK-11: the rate is set by ID 2 and confirmed by status ID 6.
    fn compare_rate(&mut self, now: Instant, reported: Option<Rate>) {
        if reported == Some(self.wanted_rate) {
            if !matches!(self.rate, RateState::Confirmed) {
                self.outbox.event(Event::RateConfirmed(self.wanted_rate));
            }
            self.rate = RateState::Confirmed;
        } else if matches!(self.rate, RateState::NotKnown | RateState::Confirmed) {
            self.rate = RateState::Asking { attempts_left: RATE_ATTEMPTS, next_at: now };
        }
    }

    /// ZK-13: what an unlocked command set is confirmed by status ID 5.
    fn confirm(&mut self) {
        let ServiceState::Confirming { service, .. } = self.service else { return };
        let shown = match service {
            Service::IgnitionPump(voltage) => {
                self.report.ignition_pump.is_some_and(|shown| shown.value == voltage.millivolts())
            }
            Service::Curve(curve) => {
                self.report.curve_increase.is_some_and(|shown| shown.value == curve.get())
            }
            Service::Action(_) => true,
        };
        if shown {
            self.service = ServiceState::None;
            self.outbox.event(Event::ServiceConfirmed(AnyService::Zk(service)));
        }
    }

    fn version(&self) -> Option<Version> {
        self.report.version.map(|version| version.value)
    }

    /// The version that two reports agree on since the link came up: what decides which commands the ECU gets.
    fn debounced_version(&self) -> Option<Version> {
        self.version().filter(|_| self.identities >= 2)
    }

    /// ZK-7: refuses what the ECU does not know, and all but version 1 while its version is not known.
    fn require(&self, needed: Version) -> Result<(), Rejected> {
        let known = self.debounced_version().map(Version::get);
        if needed.get() <= known.unwrap_or(1).max(1) {
            return Ok(());
        }
        Err(Rejected::NeedsVersion { needed: needed.get(), known })
    }

    // -----------------------------------------------------------------------------------------
    // What goes out
    // -----------------------------------------------------------------------------------------

    fn turn(&mut self, now: Instant) {
        self.out_of_slot = false;
        let control = self.compose(now);
        self.outbox.put(Transmission::new(control.encode(), None));
    }

    fn compose(&mut self, now: Instant) -> Control {
        if let (ServiceState::Unlocking { service, attempts_left }, false) =
            (self.service, self.order == Order::EmergencyStop)
        {
            self.service = ServiceState::Sending { service, attempts_left };
            return service.control();
        }
        if let Some(control) = self.close_command(now) {
            return control;
        }
        if self.order == Order::EmergencyStop {
            return self.switch_and_demand();
        }
        // The demand never waits for two turns.
        if !self.extra_last
            && !core::mem::take(&mut self.partner_due)
            && let Some(control) = self.extra(now)
        {
            self.extra_last = true;
            return control;
        }
        self.extra_last = false;
        self.switch_and_demand()
    }

    /// Closes the pump, at every second turn at most and never before the first frame of a stop. Whatever the version: a
    /// pump that runs outweighs a command that is not known.
    fn close_command(&mut self, now: Instant) -> Option<Control> {
        if self.close_pump == 0 {
            return None;
        }
        // A voltage that was measured before it could have been closed says nothing.
        let closed = self.closing_since.is_some_and(|since| {
            self.report.pump.is_some_and(|pump| pump.value.raw == 0 && pump.at >= since + PUMP_CLOSES_WITHIN)
        });
        if closed {
            self.close_pump = 0;
            return None;
        }
        self.close_next = !self.close_next;
        if self.close_next {
            // Its turn is the next one.
            return None;
        }
        self.close_pump -= 1;
        self.closing_since.get_or_insert(now);
        Some(Control::Action(Action::ClosePump))
    }

    /// What may take the place of the demand for one turn, if anything is due.
    fn extra(&mut self, now: Instant) -> Option<Control> {
        self.rate_command(now).or_else(|| self.service_command(now)).or_else(|| self.pressure_command(now))
    }

    fn rate_command(&mut self, now: Instant) -> Option<Control> {
        let RateState::Asking { attempts_left, next_at } = self.rate else { return None };
        if now < next_at {
            return None;
        }
        let Some(attempts_left) = attempts_left.checked_sub(1) else {
            self.rate = RateState::GivenUp;
            self.outbox.event(Event::RateNotConfirmed(self.wanted_rate));
            return None;
        };
        self.rate = RateState::Asking { attempts_left, next_at: now + RATE_RETRY };
        Some(Control::Action(self.wanted_rate.action()))
    }

    fn service_command(&mut self, now: Instant) -> Option<Control> {
        if let ServiceState::Confirming { service, attempts_left, until } = self.service
            && now >= until
        {
            self.service = ServiceState::Waiting { service, attempts_left };
        }
        let ServiceState::Waiting { service, attempts_left } = self.service else { return None };
        let Some(attempts_left) = attempts_left.checked_sub(1) else {
            self.service = ServiceState::None;
            self.outbox.event(Event::ServiceFailed(AnyService::Zk(service)));
            return None;
        };
        if service.needs_unlock() {
            self.service = ServiceState::Unlocking { service, attempts_left };
            return Some(Control::Unlock);
        }
        self.service = ServiceState::Sending { service, attempts_left };
        Some(service.control())
    }

    /// ZK-14: once a second while the ECU asks and a fresh pressure is known.
    fn pressure_command(&mut self, now: Instant) -> Option<Control> {
        let asked = self.report.pressure_requested.is_some_and(|asked| asked.value);
        let pressure = self.pressure.filter(|pressure| pressure.age(now) <= PRESSURE_MAX_AGE)?;
        let due = self.next_pressure.is_none_or(|at| now >= at);
        let control = Control::Pressure(pressure.value);
        if !asked || !due || self.require(control.min_version()).is_err() {
            return None;
        }
        self.next_pressure = Some(now + PRESSURE_EVERY);
        Some(control)
    }

    /// ZK-9: the frame of the mode in force. Where two frames make up a command they take turns.
    fn switch_and_demand(&mut self) -> Control {
        let order = self.order;
        let (switch, demand) = match order {
            Order::Listen => return Control::KeepAlive,
            Order::Doubt(demand) => return self.doubt(demand),
            Order::EmergencyStop => (Switch::Stop, Demand::Throttle(Throttle::IDLE)),
            Order::Standby => (Switch::Standby, Demand::Throttle(Throttle::IDLE)),
            Order::Pwm => (Switch::Pwm, Demand::Throttle(Throttle::IDLE)),
            Order::Run(demand) => (Switch::Run, self.limited(demand)),
        };
        let factor = match demand {
            Demand::Rpm(_) => self.factor(),
            Demand::Throttle(_) => RpmFactor::OFF,
        };
        // The ECU ignores the switch of ID 1 in modes 2 and 3. It is sent all the same, and never as SW 0,
        // because an ECU that restarted has forgotten ID 6 and would take SW 0 for a hand-over to PWM (ZK-8).
        let with_throttle = |throttle| Control::Throttle { switch, throttle };
        let mode = Control::Mode { factor, switch };
        let (first, second) = match demand {
            // Mode 3. The rpm goes first: the mode must not come into force with an old one.
            Demand::Rpm(rpm) => (Control::Rpm(RpmCode::for_target(rpm, factor)), mode),
            Demand::Throttle(throttle) if self.by_id6(order) => match order {
                // Leaving mode 3, the throttle goes first, for the same reason. A hand-over is said in ID 1 before ID 6
                // lets go, or the switch that ID 1 had last would rule for a turn.
                Order::Run(_) | Order::Pwm => (with_throttle(throttle), mode),
                // A stop by ID 1 alone is for ECUs that never heard of ID 6.
                Order::EmergencyStop if !self.began_by_id6 => (with_throttle(throttle), mode),
                // Mode 2. An ECU that was given a switch by ID 6 has to be given the next one there, too.
                _ => (mode, with_throttle(throttle)),
            },
            // Mode 1.
            Demand::Throttle(throttle) => return with_throttle(throttle),
        };
        let control = if self.second_next { second } else { first };
        self.second_next = !self.second_next;
        if let Control::Mode { factor, switch } = control {
            self.mode_out = Some((factor, switch));
            // It may get there even if the UART says otherwise.
            self.switch_by_id6 |= switch != Switch::Pwm;
        }
        control
    }

    /// Nothing that could start an engine: ID 0, and in mode 3 the rpm in turn with it. An ECU that restarted has
    /// forgotten ID 6 and ignores ID 7 (ZK-9).
    fn doubt(&mut self, demand: Demand) -> Control {
        let Demand::Rpm(rpm) = demand else { return Control::KeepAlive };
        // Also when its version has been forgotten with the link: the engine is in mode 3 with this factor.
        let in_mode_3 =
            self.factor.is_some_and(|factor| factor == self.factor_sent && factor != RpmFactor::OFF);
        let known = self.switch_by_id6 && knows(self.debounced_version(), 4) && self.report.max_rpm.is_some();
        self.second_next = !self.second_next;
        if !(in_mode_3 || known) || self.second_next {
            return Control::KeepAlive;
        }
        Control::Rpm(RpmCode::for_target(rpm, self.factor()))
    }

    /// Whether the switch goes by ID 6. Run needs a version that two reports agree on and that knows it (ZK-7). Standby
    /// goes by ID 6 as well wherever ID 6 was used, and a stop also where the version is not known: a version below 4
    /// ignores it.
    fn by_id6(&self, order: Order) -> bool {
        let knows_it = knows(self.debounced_version(), 4);
        match order {
            Order::EmergencyStop => self.switch_by_id6 || knows_it || self.debounced_version().is_none(),
            // An ECU at rest that two reports say is older has never heard of ID 6: another one was plugged in.
            Order::Standby
                if self.debounced_version().is_some()
                    && !knows_it
                    && self.phase.get().is_some_and(Phase::is_stopped) =>
            {
                false
            }
            Order::Standby => {
                self.switch_by_id6 || ((self.config.split_switch || self.wants_id6) && knows_it)
            }
            Order::Pwm => (self.switch_by_id6 || self.wants_id6) && knows_it,
            _ => (self.switch_by_id6 || self.config.split_switch || self.wants_id6) && knows_it,
        }
    }

    /// RPM_X for the rpm order in force (ZK-9).
    fn factor(&mut self) -> RpmFactor {
        let max = self.report.max_rpm.map_or(Rpm::new(0), |max| max.value);
        *self.factor.get_or_insert(RpmFactor::covering(max))
    }

    /// An ECU that does not follow the switch of ID 1 was given another by ID 6, before we came.
    fn check_switch(&mut self, now: Instant, reported: ReportedSwitch) {
        let expected = match self.order {
            Order::Standby => ReportedSwitch::Standby,
            Order::Run(_) => ReportedSwitch::Run,
            _ => return,
        };
        let follows = reported == expected;
        if follows || now < self.ordered_at + FOLLOWS_WITHIN {
            self.not_followed = 0;
        } else {
            // One report alone can be a damaged frame's.
            self.not_followed = self.not_followed.saturating_add(1);
            self.wants_id6 |= self.not_followed >= 2;
        }
    }

    /// Until the ECU reports a running engine the demand stays at its minimum: ignition demands it. The
    /// learning states demand extremes, which are the operator's business.
    fn limited(&self, demand: Demand) -> Demand {
        match demand {
            // An ECU of a version without speed control took the place of the one that was asked.
            Demand::Rpm(_) if !knows(self.debounced_version(), 4) => Demand::Throttle(Throttle::IDLE),
            _ if self.released => demand,
            Demand::Throttle(_) => Demand::Throttle(Throttle::IDLE),
            Demand::Rpm(rpm) => {
                Demand::Rpm(self.report.idle_rpm.map_or(Rpm::new(0), |idle| idle.value.min(rpm)))
            }
        }
    }

    fn cancel_service(&mut self) {
        let (ServiceState::Waiting { service, .. }
        | ServiceState::Unlocking { service, .. }
        | ServiceState::Sending { service, .. }
        | ServiceState::Confirming { service, .. }) = self.service
        else {
            return;
        };
        self.service = ServiceState::None;
        self.outbox.event(Event::ServiceFailed(AnyService::Zk(service)));
    }

    fn transmission_over(&mut self, now: Instant) {
        self.outbox.done();
        let unlocked = matches!(self.service, ServiceState::Unlocking { .. });
        if self.out_of_slot || unlocked {
            self.turn(now);
        }
    }
}

impl Link for ZkLink {
    fn start(&mut self, now: Instant) {
        self.monitor.start(now);
        self.next_slot = Some(now);
    }

    fn receive(&mut self, now: Instant, bytes: &[u8]) -> usize {
        let (taken, frame) = self.decoder.feed(bytes);
        self.beat.bytes(now, taken, self.frame_interval());
        if let Some(frame) = frame {
            self.frame(now, &frame);
        }
        taken
    }

    fn line_error(&mut self, error: LineError) {
        self.counters.line_error(error);
    }

    fn order(&mut self, now: Instant, order: Order) -> Result<(), Rejected> {
        if let Order::Run(Demand::Rpm(rpm)) = order {
            self.speed_control()?;
            // Status ID 6 carries the version and the maximum, so it is known here.
            if let Some(max) = self.report.max_rpm
                && rpm > max.value
            {
                return Err(Rejected::AboveMaxRpm { max: max.value });
            }
        }
        let before = core::mem::replace(&mut self.order, order);
        if kind(before) != kind(order) {
            self.ordered_at = now;
            self.began_by_id6 = self.switch_by_id6;
            self.partner_due = false;
            self.second_next = false;
            self.factor = None;
            // An ECU that runs already may have been given its switch by ID 6 before we came.
            let alive = self.report.phase.is_some_and(|phase| phase.value.is_alive());
            self.wants_id6 |= before == Order::Listen && alive;
            // It needed a stopped engine, and is not to come out later.
            if !matches!(order, Order::Standby) {
                self.cancel_service();
            }
            if order == Order::EmergencyStop {
                // ZK knows no window: a stop goes out at once.
                if self.outbox.busy() {
                    self.out_of_slot = true;
                } else {
                    self.turn(now);
                }
            }
        }
        Ok(())
    }

    fn speed_control(&self) -> Result<(), Rejected> {
        self.require(Control::Rpm(RpmCode::for_target(Rpm::new(0), RpmFactor::OFF)).min_version())
    }

    fn service(&mut self, now: Instant, service: AnyService) -> Result<(), Rejected> {
        let AnyService::Zk(service) = service else { return Err(Rejected::NotSupported) };
        let control = service.control();
        if service.needs_stopped_engine() && self.order != Order::Standby {
            return Err(Rejected::NotStopped);
        }
        self.require(control.min_version())?;
        let rate = [Rate::Hz20, Rate::Hz50, Rate::Hz100]
            .into_iter()
            .find(|rate| control == Control::Action(rate.action()));
        if let Some(rate) = rate {
            if !rate.fits(self.line) {
                return Err(Rejected::RateTooFast);
            }
            self.wanted_rate = rate;
            self.rate = RateState::Asking { attempts_left: RATE_ATTEMPTS, next_at: now };
            return Ok(());
        }
        if !matches!(self.service, ServiceState::None) {
            return Err(Rejected::Busy);
        }
        self.service = ServiceState::Waiting { service, attempts_left: SERVICE_ATTEMPTS };
        Ok(())
    }

    fn pressure(&mut self, now: Instant, pressure: Hectopascals) {
        self.pressure = Some(Timed::new(pressure, now));
    }

    fn sent(&mut self, now: Instant) {
        bump(&mut self.counters.sent);
        if let Some((factor, switch)) = self.mode_out.take() {
            self.switch_by_id6 = switch != Switch::Pwm;
            // What a new factor gives a meaning to follows at once: ECUs may ignore ID 7 before it, or ID 1.
            let changed = core::mem::replace(&mut self.factor_sent, factor) != factor;
            self.partner_due = changed && switch != Switch::Pwm;
            self.out_of_slot |= self.partner_due;
        }
        if let ServiceState::Sending { service, attempts_left } = self.service {
            self.outbox.event(Event::ServiceSent(AnyService::Zk(service)));
            // Nothing in the status confirms an action.
            self.service = if service.needs_unlock() {
                ServiceState::Confirming { service, attempts_left, until: now + CONFIRM_WITHIN }
            } else {
                ServiceState::None
            };
        }
        self.transmission_over(now);
    }

    fn not_sent(&mut self, now: Instant, why: NotSent) {
        self.counters.not_sent(why);
        self.outbox.event(Event::NotSent(why));
        self.mode_out = None;
        // What did not go out is tried again, from the unlock on.
        if let ServiceState::Unlocking { service, attempts_left }
        | ServiceState::Sending { service, attempts_left } = self.service
        {
            self.service = ServiceState::Waiting { service, attempts_left };
        }
        self.transmission_over(now);
    }

    fn timeout(&mut self, now: Instant) {
        self.check_link(now);
        let Some(due) = self.next_slot.filter(|due| now >= *due) else { return };
        let delay = now - due;
        let worst = self.counters.worst_slot_delay.get_or_insert(delay);
        *worst = delay.max(*worst);
        // Turns keep their beat; those that are over are skipped, never made up for in a burst.
        let interval = self.wanted_rate.interval();
        let skipped = delay.as_ticks() / interval.as_ticks();
        self.next_slot = Some(due + Duration::from_ticks(interval.as_ticks() * (skipped + 1)));
        self.counters.send_slots_missed = self.counters.send_slots_missed.wrapping_add(skipped as u32);
        if self.outbox.idle() {
            self.turn(now);
        } else {
            bump(&mut self.counters.send_slots_missed);
        }
    }

    fn poll(&mut self) -> Output {
        self.outbox.poll().unwrap_or_else(|| Output::Wait(earlier(self.next_slot, self.monitor.deadline())))
    }

    fn take_sign(&mut self) -> Option<Sign> {
        self.sign.take()
    }

    fn release(&mut self, released: bool) {
        self.released = released;
    }

    fn gap_at(&self) -> Option<Instant> {
        self.beat.gap_at(self.frame_interval())
    }

    fn gap(&mut self) {
        self.beat.gap();
    }

    fn answers_frames(&self) -> bool {
        false
    }

    fn doubt_ends(&self, _since: Instant) -> Option<Instant> {
        // ID 0 commands nothing, and an rpm goes to an engine that is in mode 3 already: both go on.
        None
    }

    fn switch_by_id6(&self) -> bool {
        self.switch_by_id6
    }

    fn resume_switch_by_id6(&mut self) {
        self.switch_by_id6 = true;
    }

    fn close_pump(&mut self) {
        // What opened it must not follow.
        self.cancel_service();
        self.close_pump = CLOSE_PUMP_FRAMES;
        self.close_next = false;
        self.closing_since = None;
    }

    fn service_pending(&self) -> bool {
        !matches!(self.service, ServiceState::None)
    }

    fn closing_pump(&self) -> bool {
        self.close_pump > 0
    }

    fn report(&self) -> &Report {
        &self.report
    }

    fn state(&self) -> LinkState {
        self.monitor.state()
    }

    fn last_rx(&self) -> Option<Instant> {
        self.monitor.last_rx()
    }

    fn up_since(&self) -> Option<Instant> {
        self.monitor.up_since()
    }

    fn frames(&self) -> u32 {
        self.decoder.counters().frames
    }

    fn counters(&self) -> Counters {
        let decoder = self.decoder.counters();
        Counters {
            frames: decoder.frames,
            unknown_frames: decoder.unknown_frames,
            crc_failures: decoder.crc_failures,
            bytes_skipped: decoder.bytes_skipped,
            events_lost: self.outbox.events_lost,
            ..self.counters
        }
    }
}

/// What makes one order another: not its numbers.
fn kind(order: Order) -> u8 {
    match order {
        Order::EmergencyStop => 0,
        Order::Standby => 1,
        Order::Run(Demand::Throttle(_)) | Order::Doubt(Demand::Throttle(_)) => 2,
        Order::Run(Demand::Rpm(_)) | Order::Doubt(Demand::Rpm(_)) => 3,
        Order::Pwm => 4,
        Order::Listen => 5,
    }
}

fn knows(version: Option<Version>, needed: u8) -> bool {
    version.is_some_and(|version| version.get() >= needed)
}

fn reported(switch: SwitchStatus) -> ReportedSwitch {
    match switch {
        SwitchStatus::Stop => ReportedSwitch::Stop,
        SwitchStatus::Standby => ReportedSwitch::Standby,
        SwitchStatus::Run => ReportedSwitch::Run,
        SwitchStatus::Unknown(code) => ReportedSwitch::Unknown(code),
    }
}

/// How far the engine is.
const fn stage_of(state: State) -> Stage {
    match state {
        State::Stop
        | State::Standby
        | State::Cooling
        | State::TestGlowPlug
        | State::TestMainValve
        | State::TestIgnitionValve
        | State::TestPump
        | State::TestStarter
        | State::FuelExhaustAir => Stage::Rest,
        // The numbers give no order: an ECU may preheat before it ignites.
        State::IgnitionMinThrottle | State::Ignition | State::Preheat => Stage::Ignition,
        State::FuelRamp => Stage::FuelRamp,
        State::LearningMax
        | State::LearningMin
        | State::LearningIdle
        | State::RunningMin
        | State::RunningPumpLimit
        | State::Running => Stage::Running,
        State::Restart => Stage::Restart,
        State::Unknown(_) => Stage::Unknown,
    }
}

/// The ECU's state in plain words.
const fn phase_of(state: State) -> Phase {
    match state {
        State::Stop => Phase::Stopped,
        State::Standby => Phase::Standby,
        State::Cooling => Phase::Cooling,
        State::IgnitionMinThrottle | State::Ignition | State::Preheat | State::FuelRamp | State::Restart => {
            Phase::Starting
        }
        State::LearningMax
        | State::LearningMin
        | State::LearningIdle
        | State::RunningMin
        | State::RunningPumpLimit
        | State::Running => Phase::Running,
        State::TestGlowPlug
        | State::TestMainValve
        | State::TestIgnitionValve
        | State::TestPump
        | State::TestStarter
        | State::FuelExhaustAir => Phase::Service,
        State::Unknown(_) => Phase::Unknown,
    }
}

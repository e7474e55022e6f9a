//! Faults of one ECU and its two wires. The history records every disturbance as it really was.

use crate::ecus::{self, Odd};
use crate::history::{History, MS, Rules, SECOND, Spans};
use crate::pilots::Rng;
use core::fmt;
use sim::any::AnyEcu;
use sim::turbine::{EgtSensor, Phase};
use sim::wire::{Babble, Direction, Faults, FramingAs, Plug};

/// Share of damaged bytes with which no frame of six arrives as a whole, although the node finds where many of them begin, per million.
pub const NO_FRAME: u32 = 900_000;

/// One disturbance.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Fault {
    /// The ECU has no power.
    PowerOff,
    /// Nothing arrives from the ECU.
    CutToNode,
    /// Nothing reaches the ECU.
    CutToEcu,
    CutBoth,
    /// The node's transmitter hangs.
    Stall,
    /// Every byte of a direction is damaged: both, to the node, to the ECU.
    Damage(bool, bool),
    /// Some bytes are damaged on the way to the node; and to the ECU, too.
    Noise(bool),
    /// Bytes per million from the ECU that have a framing error.
    Framing(u32),
    FlameOut,
    HotStarts(bool),
    NoLight(bool),
    /// The ECU reports a fault, and keeps working.
    Error(u8),
    /// The thermocouple is broken, or its wires touch.
    Sensor(EgtSensor),
    /// One well-formed frame that reports a false state.
    OneWrongFrame,
    /// One good frame that no ECU sent.
    OddFrame(Odd),
    /// The ECU sends bytes that form no frames, without a pause, in place of its reports.
    Babble,
    /// The ECU reports a supply below every limit.
    LowSupply,
    /// A signal on the PWM input of a ZK ECU.
    PwmSignal(bool),
}

impl Fault {
    /// It ends as soon as it begins.
    const fn is_momentary(self) -> bool {
        matches!(
            self,
            Self::FlameOut | Self::HotStarts(_) | Self::NoLight(_) | Self::OneWrongFrame | Self::OddFrame(_)
        )
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let direction = |to_node: &bool, to_ecu: &bool| match (to_node, to_ecu) {
            (true, true) => "in both directions",
            (true, false) => "to the node",
            (false, true) => "to the ECU",
            (false, false) => "in no direction",
        };
        match self {
            Self::PowerOff => f.write_str("ECU without power"),
            Self::CutToNode => f.write_str("wire to the node cut"),
            Self::CutToEcu => f.write_str("wire to the ECU cut"),
            Self::CutBoth => f.write_str("both wires cut"),
            Self::Stall => f.write_str("the node's transmitter hangs"),
            Self::Damage(to_node, to_ecu) => write!(f, "every byte damaged {}", direction(to_node, to_ecu)),
            Self::Noise(to_ecu) => write!(f, "noise {}", direction(&true, to_ecu)),
            Self::Framing(per_million) => write!(f, "framing errors, {per_million} per million bytes"),
            Self::FlameOut => f.write_str("flame-out"),
            Self::HotStarts(on) => {
                f.write_str(if *on { "starts get hot" } else { "starts no longer get hot" })
            }
            Self::NoLight(on) => {
                f.write_str(if *on { "the igniter fails" } else { "the igniter works again" })
            }
            Self::Error(code) => write!(f, "the ECU reports fault {code}"),
            Self::Sensor(EgtSensor::Open) => f.write_str("thermocouple open"),
            Self::Sensor(EgtSensor::Short) => f.write_str("thermocouple shorted"),
            Self::Sensor(EgtSensor::Cold) => f.write_str("the thermocouple's wires touch at its plug"),
            Self::Sensor(EgtSensor::Good) => f.write_str("thermocouple good"),
            Self::OneWrongFrame => f.write_str("one forged frame"),
            Self::OddFrame(odd) => write!(f, "one forged frame: {odd:?}"),
            Self::Babble => f.write_str("the ECU sends bytes without a pause"),
            Self::LowSupply => f.write_str("supply low"),
            Self::PwmSignal(true) => f.write_str("the PWM input commands run"),
            Self::PwmSignal(false) => f.write_str("the PWM input commands standby"),
        }
    }
}

/// How much goes wrong in a world.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Weather {
    Calm,
    Fair,
    Rough,
}

impl Weather {
    pub const fn between_faults(self) -> u64 {
        match self {
            Self::Calm => 600 * SECOND,
            Self::Fair => 200 * SECOND,
            Self::Rough => 50 * SECOND,
        }
    }
}

/// The disturbances of one engine.
#[derive(Debug)]
pub struct Disturber {
    weather: Weather,
    next: u64,
    /// The current disturbance, its begin and its end.
    current: Option<(Fault, u64, u64)>,
    /// Further disturbances at the same time.
    beside: Vec<(Fault, u64, u64)>,
    /// Chance of a dip of the supply in each start, in percent.
    dips_in_starts: u64,
    dipped: bool,
    /// Long losses of power.
    long: bool,
    pub signals: bool,
    /// The flame goes out in many flights: other engines are informed.
    pub flames: bool,
    /// When the flame goes out in this flight.
    flame_out: Option<u64>,
}

impl Disturber {
    pub fn new(rng: &mut Rng, weather: Weather) -> Self {
        Self {
            weather,
            next: rng.wait(weather.between_faults()),
            current: None,
            beside: Vec::new(),
            dips_in_starts: rng.pick(&[0, 0, 10, 40]),
            dipped: false,
            long: rng.percent(30),
            signals: false,
            flames: false,
            flame_out: None,
        }
    }

    /// No random faults.
    pub const fn idle() -> Self {
        Self {
            weather: Weather::Calm,
            next: u64::MAX,
            current: None,
            beside: Vec::new(),
            dips_in_starts: 0,
            dipped: false,
            long: false,
            signals: false,
            flames: false,
            flame_out: None,
        }
    }

    /// A disturbance that may exempt no rule for long: rarely one that costs an AMT engine.
    fn choose(&self, rng: &mut Rng, rules: &Rules) -> (Fault, u64) {
        let (serial_delay, patience) = (rules.kind.traits().serial_delay, rules.gives_up_after);
        let power = match self.long {
            true => rng.spread(50 * MS, 900 * SECOND),
            false => rng.spread(50 * MS, 20 * SECOND),
        };
        // Longer ones cost an engine whose ECU gives up: most are such as it tolerates.
        let short = !rules.kind.continues_without_commands() && rng.percent(70);
        let cut = rng.spread(100 * MS, if short { patience * 9 / 10 } else { 40 * SECOND });
        match rng.below(100) {
            0..14 => (Fault::PowerOff, power),
            14..24 => (Fault::PowerOff, rng.between(50 * MS, 2 * SECOND)),
            24..32 => (Fault::CutToNode, cut),
            32..36 | 38..40 => (Fault::CutToEcu, cut),
            40..45 => (Fault::CutBoth, cut),
            36..38 => (Fault::Stall, rng.spread(50 * MS, patience * 9 / 10)),
            // Just as long as the ECU tolerates.
            45..53 if serial_delay => {
                (rng.pick(&[Fault::CutToNode, Fault::CutBoth]), patience * rng.between(60, 90) / 100)
            }
            53..56 => (Fault::Framing(500_000), rng.spread(patience, 10 * SECOND)),
            45..66 => {
                let (to_node, to_ecu) =
                    rng.pick(&[(true, false), (true, false), (false, true), (true, true)]);
                // Damaged frames count as frames for 10 s only.
                let longest = if rng.percent(15) { 40 * SECOND } else { 10 * SECOND };
                // Beyond what the ECU tolerates it is a cut by its effect: rarely.
                let tolerated = to_ecu && !rules.kind.continues_without_commands() && !rng.percent(15);
                let longest = if to_ecu { longest.min(10 * SECOND) } else { longest };
                let longest = if tolerated { longest.min(patience * 9 / 10) } else { longest };
                (Fault::Damage(to_node, to_ecu), rng.spread(500 * MS, longest))
            }
            66..76 => (Fault::Noise(rng.percent(30)), rng.spread(500 * MS, 10 * SECOND)),
            76..82 => (Fault::FlameOut, MS),
            82..84 => (Fault::HotStarts(rng.percent(50)), MS),
            84..86 => (Fault::NoLight(rng.percent(30)), MS),
            86..90 => (Fault::Error(rng.between(1, 18) as u8), rng.spread(SECOND, 60 * SECOND)),
            90..93 => {
                let sensor = rng.pick(&[EgtSensor::Open, EgtSensor::Short]);
                (Fault::Sensor(sensor), rng.spread(SECOND, 100 * SECOND))
            }
            93..97 => (Fault::OneWrongFrame, MS),
            _ if self.signals => (Fault::PwmSignal(rng.percent(50)), rng.spread(SECOND, 100 * SECOND)),
            _ => (Fault::OneWrongFrame, MS),
        }
    }

    /// Begins and ends what is due; returns it for the log.
    pub fn disturb(
        &mut self,
        rng: &mut Rng,
        plug: &Plug<AnyEcu>,
        history: &mut History,
        now: u64,
    ) -> Vec<String> {
        let mut notes = Vec::new();
        if let Some((fault, from, until)) = self.current
            && now >= until
        {
            self.current = None;
            self.over(rng, plug, history, (fault, from), now);
            notes.push(format!("over: {fault}"));
        }
        while let Some(at) = self.beside.iter().position(|(.., until)| now >= *until) {
            let (fault, from, _) = self.beside.swap_remove(at);
            self.over(rng, plug, history, (fault, from), now);
            notes.push(format!("over: {fault}"));
        }
        if self.current.is_none() && now >= self.next {
            self.next = now + rng.wait(self.weather.between_faults());
            let (fault, length) = self.choose(rng, &history.rules);
            begin(fault, rng, plug);
            self.current = Some((fault, now, now + length.max(MS)));
            notes.push(format!("{fault} for {} ms", length / MS));
        }
        let phase = plug.ecu(|ecu| ecu.turbine().phase());
        // A flame that goes out in flight.
        if phase != Phase::Running {
            self.flame_out = None;
        } else if self.flames && self.flame_out.is_none() {
            let flies = rng.spread(5 * SECOND, 60 * SECOND);
            self.flame_out = Some(if rng.percent(50) { now + flies } else { u64::MAX });
        }
        if self.current.is_none() && self.flame_out.is_some_and(|at| now >= at) {
            begin(Fault::FlameOut, rng, plug);
            self.flame_out = Some(u64::MAX);
            notes.push("the flame goes out".into());
        }
        // A dip of the supply while the starter turns.
        if !phase.is_starting() {
            self.dipped = false;
        } else if self.current.is_none() && !self.dipped && phase != Phase::LearningIdle {
            self.dipped = rng.percent(3);
            if self.dipped && rng.percent(self.dips_in_starts) {
                let length = rng.spread(50 * MS, 2 * SECOND);
                begin(Fault::PowerOff, rng, plug);
                self.current = Some((Fault::PowerOff, now, now + length));
                notes.push(format!("{} in a start for {} ms", Fault::PowerOff, length / MS));
            }
        }
        notes
    }

    /// Time of its next call.
    pub fn next(&self) -> u64 {
        let beside = self.beside.iter().map(|(.., until)| *until).min().unwrap_or(u64::MAX);
        self.current.map_or(self.next, |(_, _, until)| until).min(beside)
    }

    /// This fault lasts from now until then, and replaces the current one.
    pub fn begin(
        &mut self,
        rng: &mut Rng,
        plug: &Plug<AnyEcu>,
        history: &mut History,
        fault: Fault,
        now: u64,
        until: u64,
    ) {
        if fault.is_momentary() {
            begin(fault, rng, plug);
            return write_down(history, fault, now, now + MS);
        }
        if let Some((fault, from, _)) = self.current.take() {
            self.over(rng, plug, history, (fault, from), now);
        }
        begin(fault, rng, plug);
        self.current = Some((fault, now, until));
    }

    /// One is over, and is so for the ECU unless another one of its kind lasts.
    fn over(
        &self,
        rng: &mut Rng,
        plug: &Plug<AnyEcu>,
        history: &mut History,
        (fault, from): (Fault, u64),
        now: u64,
    ) {
        let mut lasting = self.current.iter().chain(&self.beside).map(|(other, ..)| *other);
        let kind = core::mem::discriminant(&fault);
        match lasting.rfind(|other| core::mem::discriminant(other) == kind) {
            Some(other) => begin(other, rng, plug),
            None => end(fault, plug),
        }
        write_down(history, fault, from, now);
    }

    /// This goes wrong from now until then, beside what does: a fault that the ECU reports, or its thermocouple.
    pub fn begin_beside(&mut self, rng: &mut Rng, plug: &Plug<AnyEcu>, fault: Fault, now: u64, until: u64) {
        begin(fault, rng, plug);
        self.beside.push((fault, now, until));
    }

    /// Ends lasting faults, at the end of the history.
    pub fn finish(&mut self, history: &mut History, now: u64) {
        for (fault, from, _) in self.current.take().into_iter().chain(self.beside.drain(..)) {
            write_down(history, fault, from, now);
        }
    }
}

fn begin(fault: Fault, rng: &mut Rng, plug: &Plug<AnyEcu>) {
    let all = Faults { framing_per_million: 1_000_000, ..Faults::default() };
    let some = Faults {
        framing_per_million: rng.pick(&[0, 20_000, 200_000]),
        lose_per_million: rng.pick(&[0, 20_000, 200_000]),
        ..Faults::default()
    };
    match fault {
        Fault::PowerOff => plug.power(false),
        Fault::CutToNode => plug.cut_one(Direction::ToNode, true),
        Fault::CutToEcu => plug.cut_one(Direction::ToEcu, true),
        Fault::CutBoth => plug.cut(true),
        Fault::Stall => plug.stall_tx(true),
        Fault::Damage(to_node, to_ecu) => {
            plug.framing(FramingAs::Error);
            let damaged = |damaged| if damaged { all } else { Faults::default() };
            plug.set_faults(damaged(to_node), damaged(to_ecu));
        }
        Fault::Noise(to_ecu) => {
            plug.framing(rng.pick(&[FramingAs::Error, FramingAs::Error, FramingAs::Data]));
            let flips = Faults { flip_per_million: rng.pick(&[0, 1000, 20_000]), ..some };
            plug.set_faults(some, if to_ecu { flips } else { Faults::default() });
        }
        Fault::Framing(per_million) => {
            plug.framing(FramingAs::Data);
            plug.set_faults(
                Faults { framing_per_million: per_million, ..Faults::default() },
                Faults::default(),
            );
        }
        Fault::FlameOut => plug.ecu(|ecu| ecu.turbine_mut().flame_out()),
        Fault::HotStarts(hot) => plug.ecu(|ecu| ecu.turbine_mut().hot_start(hot)),
        Fault::NoLight(dark) => plug.ecu(|ecu| ecu.turbine_mut().no_light(dark)),
        Fault::Error(error) => plug.ecu(|ecu| ecus::ecu_mut(ecu).report_fault(Some(error))),
        Fault::Sensor(sensor) => plug.ecu(|ecu| ecu.turbine_mut().set_egt_sensor(sensor)),
        Fault::OneWrongFrame => {
            let frame = plug.ecu(|ecu| ecus::ecu(ecu).wrong_frame(rng));
            plug.inject_to_node(&frame);
        }
        Fault::OddFrame(odd) => {
            let frame = plug.ecu(|ecu| ecus::ecu(ecu).odd_frame(odd));
            plug.inject_to_node(&frame);
        }
        Fault::Babble => plug.babble(Some(Babble::Repeat(vec![0x55, 0x10, 0x00]))),
        Fault::LowSupply => plug.ecu(|ecu| ecus::ecu_mut(ecu).lower_supply(true)),
        Fault::PwmSignal(run) => plug.ecu(|ecu| ecus::ecu_mut(ecu).pwm_signal(Some(run))),
    }
}

fn end(fault: Fault, plug: &Plug<AnyEcu>) {
    match fault {
        Fault::PowerOff => plug.power(true),
        Fault::CutToNode | Fault::CutToEcu | Fault::CutBoth => plug.cut(false),
        Fault::Stall => plug.stall_tx(false),
        Fault::Damage(..) | Fault::Noise(_) | Fault::Framing(_) => {
            plug.set_faults(Faults::default(), Faults::default())
        }
        Fault::Babble => plug.babble(None),
        Fault::LowSupply => plug.ecu(|ecu| ecus::ecu_mut(ecu).lower_supply(false)),
        Fault::Error(_) => plug.ecu(|ecu| ecus::ecu_mut(ecu).report_fault(None)),
        Fault::Sensor(_) => plug.ecu(|ecu| ecu.turbine_mut().set_egt_sensor(EgtSensor::Good)),
        Fault::PwmSignal(_) => plug.ecu(|ecu| ecus::ecu_mut(ecu).pwm_signal(None)),
        Fault::FlameOut
        | Fault::HotStarts(_)
        | Fault::NoLight(_)
        | Fault::OneWrongFrame
        | Fault::OddFrame(_) => {}
    }
}

pub fn write_down(history: &mut History, fault: Fault, from_us: u64, to_us: u64) {
    // One that began earlier may end later.
    let add = |spans: &mut Spans| *spans = spans.union(&Spans::from(&[(from_us, to_us)]));
    match fault {
        Fault::PowerOff => add(&mut history.unpowered),
        Fault::CutToNode => add(&mut history.mute),
        Fault::CutToEcu => add(&mut history.deaf),
        Fault::CutBoth => {
            add(&mut history.mute);
            add(&mut history.deaf);
        }
        Fault::Stall => {
            // A reset of the chip frees the transmitter, but not one that hangs from the end of the reset on. So does a port that is
            // opened again.
            let resets = history.resets.iter().map(|reset| reset.up);
            let freed = resets.chain(history.reopened.iter().flatten().copied());
            let freed = freed.filter(|up| from_us < *up && *up < to_us).min();
            match freed {
                Some(up) => history.deaf.push(from_us, up),
                None => {
                    history.deaf.push(from_us, to_us);
                    history.stalls.push(to_us);
                }
            }
        }
        Fault::Damage(to_node, to_ecu) => {
            add(&mut history.noise);
            if to_ecu {
                add(&mut history.noise_to_ecu);
            }
            if to_node {
                add(&mut history.garbled);
                add(&mut history.ruined);
            }
        }
        Fault::Noise(to_ecu) => {
            add(&mut history.noise);
            add(&mut history.garbled);
            if to_ecu {
                add(&mut history.noise_to_ecu);
            }
        }
        Fault::Framing(per_million) => {
            add(&mut history.noise);
            add(&mut history.framing);
            if per_million >= NO_FRAME {
                add(&mut history.garbled);
                add(&mut history.ruined);
            }
        }
        Fault::OneWrongFrame | Fault::OddFrame(_) => {
            add(&mut history.noise);
            if matches!(fault, Fault::OddFrame(Odd::SlowShaft | Odd::RunsAtRest)) {
                if history.slow.last() == Some(&from_us) {
                    history.jumps.push(from_us);
                }
                history.slow.push(from_us);
            }
            if !matches!(fault, Fault::OddFrame(Odd::HotExhaust | Odd::LaterVersion)) {
                history.unfit.push(from_us);
            }
            history.forged.push(from_us);
        }
        Fault::Babble => {
            add(&mut history.mute);
            add(&mut history.garbled);
        }
        Fault::LowSupply => add(&mut history.low_supply),
        Fault::Sensor(_) => add(&mut history.sensor),
        Fault::PwmSignal(true) => add(&mut history.pwm_signal),
        // The ECU reports it itself.
        Fault::Error(error) if ecus::disowns_exhaust(history.rules.kind, error) => {
            add(&mut history.sensor);
        }
        _ => {}
    }
}

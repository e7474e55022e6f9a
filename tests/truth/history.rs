//! What really happened to one engine: what its pilots commanded, what was on its wire, the power of its ECU, what its turbine
//! did. Nothing in it comes from the node. All times are in microseconds.

use crate::kind::{Kind, Traits};
use core::fmt;
use sim::control::LONGEST;
pub use sim::control::Switch;
use sim::turbine::Phase;

/// A millisecond.
pub const MS: u64 = 1_000;
/// A second.
pub const SECOND: u64 = 1_000_000;
/// The longest time for which a start waits for another engine.
pub const START_WAIT_MAX: u64 = 180 * SECOND;

/// Demand: throttle in 0.1 %, or shaft speed in rpm.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Demanded {
    Throttle(u32),
    Rpm(u32),
}

impl fmt::Display for Demanded {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Throttle(tenths) => write!(f, "{}.{} %", tenths / 10, tenths % 10),
            Self::Rpm(rpm) => write!(f, "{rpm} rpm"),
        }
    }
}

/// A pilot's command, whatever the answer was.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum PilotCommand {
    /// One command of a stream.
    Standby,
    /// Standby, by the explicit order of a person.
    ShutDown,
    Run(Demanded),
    Stop,
    Release,
    Arm,
    Disarm,
    /// Present without a command.
    Nothing,
    /// Hand-over to the ECU's PWM input.
    Pwm,
    /// A service command: the number of a ZK action.
    Service(u8),
    /// AMT's stop of a running engine after the serial delay time.
    Ctf,
}

impl PilotCommand {
    /// It commands a shaft speed.
    pub const fn is_rpm(self) -> bool {
        matches!(self, Self::Run(Demanded::Rpm(_)))
    }

    /// A command that makes its source count as commanding the engine.
    pub const fn is_received(self) -> bool {
        matches!(
            self,
            Self::Standby
                | Self::ShutDown
                | Self::Run(_)
                | Self::Stop
                | Self::Pwm
                | Self::Service(_)
                | Self::Ctf
        )
    }

    /// A command that ends a run.
    pub const fn ends_a_run(self) -> bool {
        matches!(self, Self::Standby | Self::ShutDown | Self::Disarm | Self::Stop | Self::Ctf)
    }
}

impl fmt::Display for PilotCommand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Standby => f.write_str("standby"),
            Self::ShutDown => f.write_str("shut down"),
            Self::Run(demanded) => write!(f, "run at {demanded}"),
            Self::Stop => f.write_str("emergency stop"),
            Self::Release => f.write_str("release of the emergency stop"),
            Self::Arm => f.write_str("arm"),
            Self::Disarm => f.write_str("disarm"),
            Self::Nothing => f.write_str("present"),
            Self::Pwm => f.write_str("hand-over to the PWM input"),
            Self::Service(number) => write!(f, "service command, ZK action {number}"),
            Self::Ctf => f.write_str("CTF"),
        }
    }
}

/// A command, and its source: 0 is the highest source.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Commanded {
    pub at: u64,
    pub source: usize,
    pub command: PilotCommand,
}

/// The command in a control frame.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Sent {
    /// Every AMT message; ZK ID 1.
    Full(Switch, u32),
    /// ZK ID 6: the switch, if it has one, and RPM_X.
    Mode(Option<Switch>, u8),
    /// ZK ID 7, with the RPM_X that was last sent.
    Rpm(u32),
    /// ZK ID 0.
    Nothing,
    /// ZK ID 2, with its parameter.
    Action(u8),
    /// AMT CTF.
    Ctf,
    /// Any other ID.
    Other(u8),
    /// Not a frame that the document defines.
    Bad([u8; LONGEST]),
}

impl Sent {
    /// The switch in it.
    pub const fn switch(self) -> Option<Switch> {
        match self {
            Self::Full(switch, _) | Self::Mode(Some(switch), _) => Some(switch),
            _ => None,
        }
    }

    /// Whether it has standby or stop.
    pub const fn ends_a_run(self) -> bool {
        matches!(self.switch(), Some(Switch::Standby | Switch::Stop))
    }

    /// The demand in it, for a running engine.
    pub const fn demand(self) -> Option<Demanded> {
        match self {
            Self::Full(Switch::Run, tenths) => Some(Demanded::Throttle(tenths)),
            Self::Rpm(rpm) => Some(Demanded::Rpm(rpm)),
            _ => None,
        }
    }
}

impl fmt::Display for Sent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Full(switch, tenths) => write!(f, "{switch}, throttle {}", Demanded::Throttle(*tenths)),
            Self::Mode(Some(switch), factor) => write!(f, "ID 6: {switch}, RPM_X {factor}"),
            Self::Mode(None, factor) => write!(f, "ID 6: RPM_X {factor}"),
            Self::Rpm(rpm) => write!(f, "ID 7: {rpm} rpm"),
            Self::Nothing => f.write_str("ID 0"),
            Self::Action(number) => write!(f, "ID 2: action {number}"),
            Self::Ctf => f.write_str("CTF"),
            Self::Other(id) => write!(f, "ID {id}"),
            Self::Bad(bytes) => write!(f, "{bytes:02x?}, which is no control frame"),
        }
    }
}

/// A control frame on the wire.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Frame {
    /// The beginning of its first start bit.
    pub at: u64,
    /// All its bytes reached the ECU as they were sent.
    pub arrived: bool,
    pub sent: Sent,
}

/// State of the turbine at an instant.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Sample {
    pub at: u64,
    pub phase: Phase,
    /// It burns.
    pub lit: bool,
    pub rpm: f64,
    pub egt: f64,
    /// Fuel flow in ml/min.
    pub flow: f64,
    /// The ECU reports a fault (AMT: error sets, with no state in them).
    pub fault: bool,
    /// It runs, but its ECU reports another state.
    pub hidden: bool,
}

impl Sample {
    /// It runs, and burns.
    pub fn runs(&self) -> bool {
        self.phase == Phase::Running && self.lit
    }
}

/// What happened at an instant.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Mark {
    /// The ignition began.
    Ignition,
    /// The ECU began it on its own, without the switch leaving run: ZK's restart.
    Relight,
    /// The ECU shut the turbine down for lack of commands.
    GivenUp,
}

impl fmt::Display for Mark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Ignition => "ignition",
            Self::Relight => "ignition by the ECU itself",
            Self::GivenUp => "the ECU put the turbine out: it was not commanded",
        })
    }
}

/// Cause of a reset of the node.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Cause {
    /// Watchdog, panic, fault: the memory is intact.
    Watchdog,
    /// Power-on or brown-out, with the memory as it was.
    BrownOut,
    /// Power-on, with the memory lost.
    PowerOn,
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Watchdog => "watchdog",
            Self::BrownOut => "brown-out",
            Self::PowerOn => "power-on",
        })
    }
}

/// A time without a node.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Reset {
    pub down: u64,
    pub up: u64,
    pub cause: Cause,
}

/// Position of the switch of radio control.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Position {
    Stop,
    Standby,
    Run,
}

/// The node's settings for stick and switches of a transmitter. Channels count from 1, pulses are in µs.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct RadioRules {
    pub throttle: u8,
    pub low: u16,
    pub high: u16,
    pub reversed: bool,
    /// A throttle that is further beyond its end points is silence.
    pub beyond: u16,
    pub switch: u8,
    /// Longest pulse of stop, shortest pulse of run.
    pub stop: u16,
    pub run: u16,
    pub switch_reversed: bool,
    /// Channel that hands the throttle to the lower source; 0: none.
    pub hand_over: u8,
}

impl RadioRules {
    /// The settings of most transmitters here.
    pub const USUAL: Self = Self {
        throttle: 3,
        low: 1100,
        high: 1900,
        reversed: false,
        beyond: 150,
        switch: 5,
        stop: 1300,
        run: 1700,
        switch_reversed: false,
        hand_over: 7,
    };
}

/// Bytes of an SBUS frame.
pub const SBUS: usize = 25;

/// A radio control receiver: the frames that reached a node, each with the time of its end.
#[derive(Clone, PartialEq, Debug)]
pub struct Radio {
    pub rules: RadioRules,
    pub frames: Vec<(u64, [u8; SBUS])>,
}

/// A MAVLink message that counts for an engine by the documents: well formed, addressed to it, and from a system that may command
/// it.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Word {
    /// A frame of the autopilot's outputs: the engine's throttle, 0.1 %; `None`: no pulse that is accepted. `sure`: it is neither
    /// late nor among the first of a new clock.
    Output {
        tenths: Option<u32>,
        sure: bool,
    },
    /// Heartbeat of the autopilot.
    Vehicle {
        armed: bool,
    },
    /// Heartbeat of any component of a system that may command.
    Station,
    /// A start, with its confirmation.
    Start {
        from: u8,
        confirmation: u8,
        while_disarmed: bool,
    },
    Stop,
    /// A stop to the engine's component, of another system: it counts where the node has no id.
    StopElsewhere,
    EmergencyStop,
    Release,
    /// A service command: the number of a ZK action.
    Service(u8),
    Ctf,
}

/// A word that came to the node.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Received {
    pub at: u64,
    pub word: Word,
}

/// An answer to `DO_ENGINE_CONTROL`.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Answered {
    pub at: u64,
    pub accepted: bool,
}

/// Settings of an engine that is commanded through MAVLink.
#[derive(Clone, PartialEq, Default, Debug)]
pub struct ByMavlink {
    /// Its demand comes from an output of the autopilot; otherwise it idles, and heartbeats keep the order alive.
    pub has_output: bool,
    /// It starts with the throttle above idle.
    pub relight: bool,
    /// Time disarmed until standby.
    pub standby_after: Option<u64>,
    /// The id of the vehicle has to be learnt after each start of the node.
    pub learns: bool,
    pub received: Vec<Received>,
    pub answers: Vec<Answered>,
    /// When a damaged frame arrived: frames after it may be found later.
    pub damaged: Vec<u64>,
}

/// The pin of a fuel valve.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Pin {
    /// No node drives it: the wiring holds the valve.
    Floats,
    Closed,
    Open,
}

/// The node's settings, and the properties of ECU and turbine that the rules use.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Rules {
    pub kind: Kind,
    /// Interval between two reports, and between two send slots.
    pub period: u64,
    /// Number of reports until the state is repeated.
    pub round: u64,
    /// Timeout of each source, the highest first.
    pub ages: [u64; 4],
    pub recover_after: u64,
    /// Time after its timeout within which a source returns without a take-over.
    pub return_within: u64,
    pub takeover: u64,
    pub hold: u64,
    /// Fall and rise of a demand, 0.1 % a second.
    pub ramp: u32,
    pub rise: u32,
    pub slew_up: Option<u32>,
    pub slew_down: Option<u32>,
    /// Fail-safe throttle, 0.1 %.
    pub fail_safe: u32,
    pub standby_after: Option<u64>,
    /// Time after the stages of loss until a lower source's standby ends a run.
    pub lower_standby_after: u64,
    pub listen: u64,
    pub arming: bool,
    pub link_stable: u64,
    pub idle_band: u32,
    /// Highest exhaust temperature for a start, °C.
    pub egt_max: f64,
    pub start_timeout: u64,
    /// Time between the starts of two engines.
    pub start_gap: u64,
    /// Longest wait of a start for other engines; 0 with one engine.
    pub start_wait: u64,
    /// Throttle until the engine runs, 0.1 %.
    pub start_throttle: u32,
    /// A governor holds rpm demands.
    pub governor: bool,
    /// Longest time that a pump is held open.
    pub pump_bound: u64,
    /// Time from the last command to the ECU's own stop: AMT's serial delay, ZK's loss time up to version 4.
    pub gives_up_after: u64,
    /// The node's assumption of the latter.
    pub serial_delay: u64,
    /// A frame to the ECU on the wire.
    pub frame: u64,
    /// Highest throttle of a governor, 0.1 %.
    pub authority: u32,
    /// ID 0 alone does not prevent a ZK ECU up to version 4 from giving up.
    pub gives_up_on_empty: bool,
    /// Number of reports after a power-up that still show the state before it.
    pub stale: u64,
    /// Time from power-up to the first report.
    pub boot: u64,
    pub idle_rpm: f64,
    pub max_rpm: f64,
    /// A limit acts on a running engine: exhaust above °C, or a fault of the ECU; with standby, or with the fail-safe.
    pub limit_egt: Option<(f64, bool)>,
    pub limit_rpm: Option<(f64, bool)>,
    pub limit_fault: Option<bool>,
    /// The action of each limit of how values change: standby, or the fail-safe. No healthy turbine exceeds one.
    pub limit_changes: [Option<bool>; 4],
    /// The actions for a shaft that runs down, and for an exhaust temperature that rises in a start.
    pub limit_flame: Option<bool>,
    pub limit_hot: Option<bool>,
    /// The actions for a shaft below an rpm in flight, for an implausible change, and for the supply.
    pub limit_low_rpm: Option<(f64, bool)>,
    pub limit_jump: Option<bool>,
    /// Another limit that two slow speeds exceed has the fail-safe as its action.
    pub jump_lowers: bool,
    pub limit_supply: Option<bool>,
    /// A low supply prevents a start.
    pub supply_counts: bool,
    /// Exhaust temperature of a burning engine, while its ECU reports faults instead of a state, °C.
    pub burning: f64,
    /// Share in per mille to which the demand is reduced while another engine has failed.
    pub when_other_fails: Option<u32>,
}

impl Rules {
    /// A demand that starts an engine.
    pub fn is_idle(&self, demanded: Demanded) -> bool {
        match demanded {
            Demanded::Throttle(tenths) => tenths <= self.idle_band,
            Demanded::Rpm(rpm) => f64::from(rpm) <= self.idle_rpm,
        }
    }
}

/// Intervals that belong together, in order and without overlaps.
#[derive(Clone, PartialEq, Eq, Default, Debug)]
pub struct Spans(Vec<(u64, u64)>);

impl Spans {
    pub fn from(spans: &[(u64, u64)]) -> Self {
        let mut sorted = spans.to_vec();
        sorted.sort_unstable();
        let mut all = Self::default();
        for (from, to) in sorted {
            all.push(from, to);
        }
        all
    }

    /// Adds an interval that does not begin before the last one.
    pub fn push(&mut self, from_us: u64, to_us: u64) {
        if to_us <= from_us {
            return;
        }
        match self.0.last_mut() {
            Some(last) if from_us <= last.1 => last.1 = last.1.max(to_us),
            _ => self.0.push((from_us, to_us)),
        }
    }

    pub fn union(&self, other: &Self) -> Self {
        Self::from(&[self.0.as_slice(), other.0.as_slice()].concat())
    }

    /// Each extended by this time at its end.
    pub fn longer(&self, by: u64) -> Self {
        Self::from(&self.0.iter().map(|&(from, to)| (from, to + by)).collect::<Vec<_>>())
    }

    /// Only those of at least this length.
    pub fn at_least(&self, length_us: u64) -> Self {
        Self(self.0.iter().copied().filter(|(from, to)| to - from >= length_us).collect())
    }

    pub fn contains(&self, at: u64) -> bool {
        let next = self.0.partition_point(|&(from, _)| from <= at);
        next > 0 && at < self.0[next - 1].1
    }

    pub fn touches(&self, from_us: u64, to_us: u64) -> bool {
        self.within(from_us, to_us) > 0
    }

    /// Total length of the parts in this interval.
    pub fn within(&self, from_us: u64, to_us: u64) -> u64 {
        let first = self.0.partition_point(|&(_, end)| end <= from_us);
        self.0[first..]
            .iter()
            .take_while(|(start, _)| *start < to_us)
            .map(|&(a, b)| b.min(to_us).saturating_sub(a.max(from_us)))
            .sum()
    }

    /// Total length of the intersection.
    pub fn common(&self, other: &Self) -> u64 {
        other.0.iter().map(|&(from, to)| self.within(from, to)).sum()
    }

    pub fn total(&self) -> u64 {
        self.0.iter().map(|(from, to)| to - from).sum()
    }

    pub fn iter(&self) -> impl Iterator<Item = (u64, u64)> + '_ {
        self.0.iter().copied()
    }

    /// The last that began before this instant.
    pub fn last_before(&self, at: u64) -> Option<(u64, u64)> {
        self.0[..self.0.partition_point(|&(from, _)| from < at)].last().copied()
    }
}

/// Everything that the judge may know about one engine.
#[derive(Clone, PartialEq, Debug)]
pub struct History {
    pub rules: Rules,
    pub end: u64,
    pub commanded: Vec<Commanded>,
    pub frames: Vec<Frame>,
    pub samples: Vec<Sample>,
    pub marks: Vec<(u64, Mark)>,
    pub resets: Vec<Reset>,
    /// Ends of resets after which the engine has another name: what was retained is another engine's.
    pub renamed: Vec<u64>,
    /// Ends of resets after which the node has other settings.
    pub other_settings: Vec<u64>,
    /// The ECU has no power.
    pub unpowered: Spans,
    /// Nothing from the ECU reaches the node.
    pub mute: Spans,
    /// Nothing from the node reaches the ECU.
    pub deaf: Spans,
    /// Bytes are damaged, in either direction.
    pub noise: Spans,
    /// Those on the way to the ECU are.
    pub noise_to_ecu: Spans,
    /// Nothing from the ECU can be distinguished from garbage.
    pub garbled: Spans,
    /// Every byte from the ECU is damaged.
    pub ruined: Spans,
    /// Some are, by framing errors that leave their number as it is.
    pub framing: Spans,
    /// When a frame arrived that no ECU sent; one that reports a shaft at rest; and one that may report an engine that does not live.
    pub forged: Vec<u64>,
    pub slow: Vec<u64>,
    pub unfit: Vec<u64>,
    /// When two consecutive frames arrived that no ECU sent, and that report a shaft at rest.
    pub jumps: Vec<u64>,
    /// The ECU reports a supply below every limit.
    pub low_supply: Spans,
    /// The share of `when_other_fails`, from each instant on at which it was changed.
    pub shares: Vec<(u64, u32)>,
    /// When a transmitter that had hung continued: frames in transit then are old.
    pub stalls: Vec<u64>,
    /// When the node opened the port of one again; `None`: its driver cannot.
    pub reopened: Option<Vec<u64>>,
    /// When another ECU was plugged in, and its protocol version: 0 where there are none.
    pub versions: Vec<(u64, u8)>,
    /// The ECU's PWM input commands a running engine.
    pub pwm: Spans,
    /// A signal on it commands run.
    pub pwm_signal: Spans,
    /// When other engines of the node were started, and when a start of theirs makes this engine's wait.
    pub other_starts: Vec<u64>,
    pub other_busy: Spans,
    /// When each set of an AMT ECU ended on its wire.
    pub sets: Vec<u64>,
    /// Those without a state that are no error sets: alternate ones.
    pub alternate: Vec<u64>,
    /// Another engine of the node does not run although it should.
    pub other_failed: Spans,
    /// It has certainly failed: it went out without a command.
    pub other_down: Spans,
    /// The thermocouple measures nothing.
    pub sensor: Spans,
    /// The pin of the fuel valve, from each instant on. Empty: there is no valve.
    pub pin: Vec<(u64, Pin)>,
    /// The valve lets no fuel through.
    pub shut: Spans,
    /// Whether starter and ignition have power, from each instant on; `None`: no node drives the output. Empty: there is none.
    pub power: Vec<(u64, Option<bool>)>,
    /// Radio control, where it commands the engine.
    pub radio: Option<Radio>,
    /// What is received through MAVLink, where it commands the engine.
    pub mavlink: Option<ByMavlink>,
}

impl History {
    pub fn new(rules: Rules) -> Self {
        Self {
            rules,
            end: 0,
            commanded: Vec::new(),
            frames: Vec::new(),
            samples: Vec::new(),
            marks: Vec::new(),
            resets: Vec::new(),
            renamed: Vec::new(),
            other_settings: Vec::new(),
            unpowered: Spans::default(),
            mute: Spans::default(),
            deaf: Spans::default(),
            noise: Spans::default(),
            noise_to_ecu: Spans::default(),
            garbled: Spans::default(),
            ruined: Spans::default(),
            framing: Spans::default(),
            forged: Vec::new(),
            slow: Vec::new(),
            unfit: Vec::new(),
            jumps: Vec::new(),
            low_supply: Spans::default(),
            shares: Vec::new(),
            stalls: Vec::new(),
            reopened: None,
            versions: Vec::new(),
            pwm: Spans::default(),
            pwm_signal: Spans::default(),
            other_starts: Vec::new(),
            other_busy: Spans::default(),
            sets: Vec::new(),
            alternate: Vec::new(),
            other_failed: Spans::default(),
            other_down: Spans::default(),
            sensor: Spans::default(),
            pin: Vec::new(),
            shut: Spans::default(),
            power: Vec::new(),
            radio: None,
            mavlink: None,
        }
    }

    /// The largest share to which a demand had to be reduced for another engine in an interval, per mille; `None`: no reduction.
    pub fn largest_share(&self, from_us: u64, to_us: u64) -> Option<u32> {
        let first = self.rules.when_other_fails?;
        let later = self.shares.iter().enumerate().filter(|(index, (at, _))| {
            let until = self.shares.get(index + 1).map_or(u64::MAX, |(next, _)| *next);
            *at <= to_us && until > from_us
        });
        let before = self.shares.first().is_none_or(|(at, _)| *at > from_us).then_some(first);
        before.into_iter().chain(later.map(|(_, (_, share))| *share)).max()
    }

    /// When run is sent after standby or a stop.
    pub fn starts_on_wire(&self) -> Vec<u64> {
        let switches: Vec<(u64, Switch)> =
            self.frames.iter().filter_map(|frame| Some((frame.at, frame.sent.switch()?))).collect();
        let starts = switches
            .windows(2)
            .filter(|pair| matches!(pair[0].1, Switch::Standby | Switch::Stop) && pair[1].1 == Switch::Run);
        starts.map(|pair| pair[1].0).collect()
    }

    pub const fn traits(&self) -> &'static Traits {
        self.rules.kind.traits()
    }

    /// The version of the ECU at an instant; 0 where there are none.
    pub fn version(&self, at: u64) -> u8 {
        let first = self.rules.kind.version();
        self.versions.iter().take_while(|(from, _)| *from <= at).last().map_or(first, |(_, version)| *version)
    }

    /// Number of status IDs that the ECU sends in turn: fewest and most of all ECUs that were plugged in.
    pub fn rounds(&self) -> (u64, u64) {
        // ZK-7.
        let ids = |version| match version {
            0 => self.rules.round,
            1 => 6,
            2 => 7,
            3 | 4 => 8,
            5 => 9,
            _ => 10,
        };
        let others = || self.versions.iter().map(|(_, version)| ids(*version));
        (others().fold(self.rules.round, u64::min), others().fold(self.rules.round, u64::max))
    }

    /// The last sample at or before an instant.
    pub fn sample(&self, at: u64) -> Option<&Sample> {
        self.samples[..self.samples.partition_point(|sample| sample.at <= at)].last()
    }

    /// The samples of an interval.
    pub fn samples(&self, from_us: u64, to_us: u64) -> &[Sample] {
        let first = self.samples.partition_point(|sample| sample.at < from_us);
        let last = self.samples.partition_point(|sample| sample.at <= to_us).max(first);
        &self.samples[first..last]
    }

    /// The frames of an interval.
    pub fn frames_within(&self, from_us: u64, to_us: u64) -> &[Frame] {
        let first = self.frames.partition_point(|frame| frame.at < from_us);
        let last = self.frames.partition_point(|frame| frame.at < to_us).max(first);
        &self.frames[first..last]
    }

    /// The first frame of an interval with run in it.
    pub fn first_run(&self, from_us: u64, to_us: u64) -> Option<&Frame> {
        self.frames_within(from_us, to_us).iter().find(|frame| frame.sent.switch() == Some(Switch::Run))
    }

    /// The times in which a condition held, by the samples.
    pub fn times(&self, is: impl Fn(&Sample) -> bool) -> Spans {
        let mut spans = Spans::default();
        for pair in self.samples.windows(2) {
            if is(&pair[0]) {
                spans.push(pair[0].at, pair[1].at);
            }
        }
        if let Some(last) = self.samples.last().filter(|last| is(last)) {
            spans.push(last.at, self.end);
        }
        spans
    }

    /// The times in which the pin of the valve had this state.
    pub fn pin_is(&self, wanted: Pin) -> Spans {
        let ends = self.pin.iter().skip(1).map(|(at, _)| *at).chain([self.end]);
        let all = self.pin.iter().zip(ends).filter(|((_, pin), _)| *pin == wanted);
        Spans::from(&all.map(|((from, _), to)| (*from, to)).collect::<Vec<_>>())
    }

    /// The times in which the power of starter and ignition had this state.
    pub fn power_is(&self, wanted: Option<bool>) -> Spans {
        let ends = self.power.iter().skip(1).map(|(at, _)| *at).chain([self.end]);
        let all = self.power.iter().zip(ends).filter(|((_, power), _)| *power == wanted);
        Spans::from(&all.map(|((from, _), to)| (*from, to)).collect::<Vec<_>>())
    }

    /// The last reset that was over at an instant.
    pub fn last_reset(&self, at: u64) -> Option<&Reset> {
        self.resets.iter().rev().find(|reset| reset.up <= at)
    }

    /// Whether the node lost its memory in this time.
    pub fn forgets(&self, from_us: u64, to_us: u64) -> bool {
        let within = |reset: &Reset| reset.cause == Cause::PowerOn && (from_us..to_us).contains(&reset.up);
        self.resets.iter().any(within)
    }

    /// The times without a node.
    pub fn down(&self) -> Spans {
        Spans::from(&self.resets.iter().map(|reset| (reset.down, reset.up)).collect::<Vec<_>>())
    }

    /// The commands of an interval, its end included.
    pub fn commanded(&self, from_us: u64, to_us: u64) -> &[Commanded] {
        let first = self.commanded.partition_point(|commanded| commanded.at < from_us);
        let last = self.commanded.partition_point(|commanded| commanded.at <= to_us).max(first);
        &self.commanded[first..last]
    }

    /// The last command of a source that satisfies this, at or before an instant.
    pub fn last_command(
        &self,
        source: usize,
        at: u64,
        is: impl Fn(PilotCommand) -> bool,
    ) -> Option<Commanded> {
        self.commanded(0, at)
            .iter()
            .rev()
            .find(|commanded| commanded.source == source && is(commanded.command))
            .copied()
    }
}

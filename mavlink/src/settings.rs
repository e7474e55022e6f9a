//! Settings of MAVLink: of the node, and of each engine beside those of its supervision. All are parameters.

use jetlink::config::EngineConfig;
use jetlink::setting::{Row, find_parameter, settings};
use jetlink::wiring::Wiring;

settings! {
    /// Settings of the node that count from its next start on.
    pub struct Identity, "identity.", AtNextStart {
        system: number "MAV_SYSID" = 0 in 0..=255, "System id of the vehicle. 0: learn it from the autopilot.";
        learnt: number "MAV_SYSID_LEARN" = 0 in 0..=255, "Learnt system id, used where MAV_SYSID is 0; set by the node. 0: none.";
        base: number "MAV_COMP_BASE" = 25 in 25..=90, "Component id of the node; engine 1 has the next, engine 2 the one after it.";
        autopilot_port: number "MAV_AP_PORT" = 1 in 0..=8, "Port of the autopilot, from 1. 0: there is none.";
        telemetry_baud: baud "TELEM_BAUD" = 57_600 in 2400..=115_200, "Baud rate of the telemetry port: 2400, 4800, 9600, 19 200, 38 400, 57 600 or 115 200.";
    }
}

settings! {
    /// Settings of the node.
    pub struct NodeSettings, "", AtOnce {
        ground_1: number "MAV_GCS_1" = 255 in 0..=255, UnlessTurning, "System id of a ground station that may command and set. 0: none.";
        ground_2: number "MAV_GCS_2" = 0 in 0..=255, UnlessTurning, "System id of another one. 0: none.";
        own_vehicle: yes_no "MAV_OWN_CMD" = 1 in 0..=1, UnlessTurning, "Components of our own vehicle may command and set.";
        efi_engine: number "MAV_EFI_ENGINE" = 1 in 0..=255, "Engine whose EFI_STATUS goes to the autopilot's port, from 1. 0: none. 255: all, which an ArduPilot mixes up.";
        efi_interval: ms "MAV_EFI_EVERY" = 250 in 100..=10_000, "Interval of an engine's EFI_STATUS on the autopilot's port.";
        progress: yes_no "MAV_IN_PROGRESS" = 0 in 0..=1, "A start is answered IN_PROGRESS, each second, and finally when the engine runs or the start has ended. QGroundControl and Mission Planner send no other command to the engine until then, not even a stop.";
    }
    groups {
        /// Settings that take effect at the next start.
        identity: Identity = Identity::DEFAULT;
    }
}

settings! {
    /// Settings of an engine.
    pub struct EngineSettings, "mavlink.", AtOnce {
        source: number "MAV_THR_SRC" = 1 in 0..=2, UnlessTurning, "Source of its demand. 0: none, it idles. 1: an output of the autopilot (SERVO_OUTPUT_RAW). 2: RC_CHANNELS_OVERRIDE addressed to the engine.";
        output: number "MAV_THR_OUT" = 3 in 1..=32, UnlessTurning, "Number of that output or channel.";
        low: pulse "MAV_THR_MIN" = 1100 in 800..=2200, UnlessTurning, "Pulse width at idle.";
        high: pulse "MAV_THR_MAX" = 1900 in 800..=2200, UnlessTurning, "Pulse width at full throttle.";
        reversed: yes_no "MAV_THR_REV" = 0 in 0..=1, UnlessTurning, "The output is reversed: the shorter pulse is full throttle.";
        relight: yes_no "MAV_RELIGHT" = 0 in 0..=1, "A start is accepted with the throttle above idle, for a relight in flight: the engine starts at idle and then rises to it.";
        disarmed_standby: ms_or_off "MAV_DISARM_STBY" = -1 in 1000..=3_600_000, "Standby, when the vehicle has been disarmed for this time without a gap. Off: never.";
    }
}

/// The setting that the node itself changes.
pub(crate) const LEARNT: &str = "MAV_SYSID_LEARN";

/// A parameter: its row, and its engine.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Parameter {
    pub row: &'static Row,
    /// Engine of a wiring, from 1. 0: not a wiring.
    pub wired: u8,
}

impl Parameter {
    /// Its name. The name of a wiring parameter has the number of its engine.
    pub fn name(self) -> Name {
        let mut name = Name::of(self.row.name.as_bytes());
        if self.wired > 0 {
            name.0[1] = b'0'.saturating_add(self.wired);
        }
        name
    }
}

/// A name, as sent and received: 16 letters, or fewer followed by zeros.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) struct Name(pub [u8; 16]);

impl Name {
    /// Bytes after a zero are ignored.
    pub fn of(bytes: &[u8]) -> Self {
        let mut name = [0; 16];
        let letters = bytes.iter().take_while(|&&letter| letter != 0);
        name.iter_mut().zip(letters).for_each(|(slot, letter)| *slot = *letter);
        Self(name)
    }
}

impl core::fmt::Display for Name {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let mut letters = self.0.into_iter().take_while(|&letter| letter != 0);
        letters.try_for_each(|letter| core::fmt::Write::write_char(f, letter.into()))
    }
}

/// A table of parameters, which is stored as one record.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Table<'a> {
    /// Of the node, without wiring.
    Node,
    /// Of the wiring of an engine.
    Wiring,
    /// Of an engine, without attached devices.
    Engine(&'a EngineConfig),
    /// Of attached devices, for one engine.
    Attached(&'static [&'static [Row]]),
}

/// The first parameter that matches. Uses the tables without texts: an image does not contain the others.
#[inline(never)]
pub(crate) fn find_row(
    table: Table<'_>,
    is_it: &mut dyn FnMut(&'static Row) -> bool,
) -> Option<&'static Row> {
    let tables: &[&[Row]] = match table {
        Table::Node => &NodeSettings::TABLE_ROWS,
        Table::Wiring => &[Wiring::ROWS],
        Table::Attached(rows) => rows,
        Table::Engine(config) => {
            let found = config.find_parameter(is_it);
            if found.is_some() {
                return found;
            }
            &[EngineSettings::ROWS]
        }
    };
    find_parameter(tables, is_it)
}

/// Source of an engine's demand.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum DemandSource {
    /// The engine idles.
    None,
    /// An output of the autopilot.
    ServoOutput,
    /// A channel of `RC_CHANNELS_OVERRIDE` addressed to the engine.
    RcOverride,
}

impl EngineSettings {
    pub(crate) const fn demand_source(&self) -> DemandSource {
        match self.source {
            1 => DemandSource::ServoOutput,
            2 => DemandSource::RcOverride,
            _ => DemandSource::None,
        }
    }
}

impl NodeSettings {
    /// Table of settings. The order is fixed.
    pub const TABLE: [&'static [jetlink::setting::Setting]; 2] = [Identity::SETTINGS, Self::SETTINGS];

    /// The same table without its texts.
    pub(crate) const TABLE_ROWS: [&'static [Row]; 2] = [Identity::ROWS, Self::ROWS];

    /// The value of a setting.
    pub fn number(&self, name: &str) -> Option<i32> {
        self.identity.own::<false>(name).or_else(|| self.own::<false>(name))
    }

    /// Changes a setting. Its range has been checked. False: none has this name.
    pub(crate) fn set(&mut self, name: &str, number: i32) -> bool {
        self.identity.set_own::<false>(name, number) || self.set_own::<false>(name, number)
    }
}

/// Checks settings at compile time.
pub const fn check(node: &NodeSettings, engines: &[EngineSettings]) {
    assert!(
        node.identity.check_own().is_ok() && node.check_own().is_ok(),
        "a setting of the node is out of its range"
    );
    let mut i = 0;
    while i < engines.len() {
        assert!(engines[i].check_own().is_ok(), "a setting of an engine is out of its range");
        assert!(engines[i].low < engines[i].high, "MAV_THR_MIN has to be below MAV_THR_MAX");
        i += 1;
    }
}

const _: () = check(&NodeSettings::DEFAULT, &[EngineSettings::DEFAULT]);

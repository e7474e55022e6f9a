//! The telemetry of a ZK ECU. Status ID 6 reports the protocol version (ZK-6), which gives voltages their scale.

use super::decoder::Telemetry;
use crate::json::{Decimal, tenths, thousandths};
use clap::builder::{RangedI64ValueParser, TypedValueParser};
use jetlink::ecu::zk::codec as zk;
use serde::ser::SerializeMap;

/// Settings of `jetlink decode`, until the stream reports them.
#[derive(clap::Args, Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct ZkHint {
    /// ZK: the ECU's protocol version, 0 to 63, until the stream reports it.
    ///
    /// It gives voltages their scale. A ZK ECU reports its version in status-6. What the stream reports wins.
    #[arg(
        long,
        value_name = "N",
        value_parser = RangedI64ValueParser::<u8>::new().range(0..=63).try_map(zk::Version::new)
    )]
    pub zk_version: Option<zk::Version>,
}

/// The telemetry of a ZK ECU.
#[derive(Debug)]
pub struct Zk {
    decoder: zk::Decoder,
    version: Option<zk::Version>,
}

impl Zk {
    /// A value that ECUs report from a version on. While the version is not known the value is used as received: its scale does not
    /// depend on the version.
    fn since<T: Copy>(&self, value: zk::Since<T>) -> Option<T> {
        value.unless_older(self.version)
    }
}

impl Telemetry for Zk {
    type Frame = (zk::StatusFrame, zk::Status);
    type Hint = ZkHint;

    const HINT_OF_ANOTHER: &'static str = "--zk-version is only for --protocol zk";

    const FIELDS: &'static str = "    \
    every frame  rpm
    status-1     state_code state error_code error switch_code switch egt_c
    status-2     radio_v power_v pump_v
    status-3     throttle_pct pressure_pa
    status-4     current_a thrust_kg
    status-5     ignition_pump_v curve_increase curve_decrease
    status-6     max_rpm max_pump_v protocol_version rate_hz
    status-7     flow_l_min fuel_l
    status-8     idle_rpm pressure_requested closed_loop startup_s
    status-9     ecu_c
    unknown-N    none: another ID with a good CRC
";

    fn new(hint: ZkHint) -> Self {
        Self { decoder: zk::Decoder::new(), version: hint.zk_version }
    }

    fn name(&self) -> &'static str {
        "zk"
    }

    fn feed(&mut self, bytes: &[u8]) -> (usize, Option<Self::Frame>) {
        let (taken, frame) = self.decoder.feed(bytes);
        let frame = frame.map(|frame| (frame, frame.status()));
        if let Some((_, zk::Status::Identity { version, .. })) = frame {
            self.version = Some(version);
        }
        (taken, frame)
    }

    fn text(&self, &(frame, status): &Self::Frame) -> String {
        let rpm = frame.rpm().get();
        let what = match status {
            zk::Status::Engine { state, error, egt, switch } => format!(
                "{}, {}, fault {}, EGT {} °C",
                switch.name(),
                state.name(),
                error.name(),
                egt.tenths() / 10
            ),
            zk::Status::Throttle { percent, pressure } => {
                format!("throttle {percent} %, {} Pa", pressure.get())
            }
            zk::Status::Voltages { radio, power, pump } => {
                let volts = |byte| zk_volts(byte, self.version);
                match (volts(radio), volts(power), volts(pump)) {
                    (Some(radio), Some(power), Some(pump)) => {
                        format!("radio {radio} V, power {power} V, pump {pump} V")
                    }
                    _ => "voltages: their scale depends on the protocol version, not known yet".to_owned(),
                }
            }
            zk::Status::Load { current, thrust } => {
                let thrust = self.since(thrust).map(|thrust| format!(", thrust {} g", thrust.get()));
                format!("{} mA{}", current.get(), thrust.unwrap_or_default())
            }
            zk::Status::Settings { ignition_pump, increase, decrease } => format!(
                "ignition pump {} V, curve increase {increase}, decrease {decrease}",
                thousandths(ignition_pump.get())
            ),
            zk::Status::Identity { max_rpm, version, .. } => {
                format!("maximum {} rpm, protocol version {}", max_rpm.get(), version.get())
            }
            zk::Status::Fuel { flow, total } => {
                format!("flow {} L/min, {} L used", thousandths(flow.get()), thousandths(total.get()))
            }
            zk::Status::Idle { idle_rpm, .. } => format!("idle {} rpm", idle_rpm.get()),
            zk::Status::Temperature { ecu } => format!("ECU {} °C", ecu.tenths() / 10),
            zk::Status::Unknown => "unknown".to_owned(),
        };
        format!("status {}: {rpm} rpm, {what}", frame.id())
    }

    fn raw((frame, _): &Self::Frame) -> &[u8] {
        frame.raw()
    }

    fn frame_name((frame, _): &Self::Frame) -> &'static str {
        zk_name(frame.id())
    }

    fn fields<M: SerializeMap>(&self, &(frame, status): &Self::Frame, map: &mut M) -> Result<(), M::Error> {
        map.serialize_entry("rpm", &frame.rpm().get())?;
        match status {
            zk::Status::Engine { state, error, egt, switch } => {
                map.serialize_entry("state_code", &state.code())?;
                map.serialize_entry("state", &state.name())?;
                map.serialize_entry("error_code", &error.code())?;
                map.serialize_entry("error", &error.name())?;
                map.serialize_entry("switch_code", &switch.code())?;
                map.serialize_entry("switch", &switch.name())?;
                map.serialize_entry("egt_c", &tenths(egt.tenths()))?;
            }
            zk::Status::Voltages { radio, power, pump } => {
                for (key, byte) in [("radio_v", radio), ("power_v", power), ("pump_v", pump)] {
                    map.serialize_entry(key, &zk_volts(byte, self.version))?;
                }
            }
            zk::Status::Throttle { percent, pressure } => {
                map.serialize_entry("throttle_pct", &percent)?;
                map.serialize_entry("pressure_pa", &pressure.get())?;
            }
            zk::Status::Load { current, thrust } => {
                map.serialize_entry("current_a", &thousandths(current.get()))?;
                map.serialize_entry(
                    "thrust_kg",
                    &self.since(thrust).map(|thrust| thousandths(thrust.get())),
                )?;
            }
            zk::Status::Settings { ignition_pump, increase, decrease } => {
                map.serialize_entry("ignition_pump_v", &thousandths(ignition_pump.get()))?;
                map.serialize_entry("curve_increase", &increase)?;
                map.serialize_entry("curve_decrease", &decrease)?;
            }
            zk::Status::Identity { max_rpm, max_pump, version, rate } => {
                map.serialize_entry("max_rpm", &max_rpm.get())?;
                map.serialize_entry("max_pump_v", &zk_volts(max_pump, Some(version)))?;
                map.serialize_entry("protocol_version", &version.get())?;
                map.serialize_entry("rate_hz", &rate.map(zk::Rate::hz))?;
            }
            zk::Status::Fuel { flow, total } => {
                map.serialize_entry("flow_l_min", &thousandths(flow.get()))?;
                map.serialize_entry("fuel_l", &thousandths(total.get()))?;
            }
            zk::Status::Idle { idle_rpm, details } => {
                let details = self.since(details);
                map.serialize_entry("idle_rpm", &idle_rpm.get())?;
                map.serialize_entry(
                    "pressure_requested",
                    &details.map(|details| details.pressure_requested),
                )?;
                map.serialize_entry("closed_loop", &details.map(|details| details.closed_loop))?;
                // Twelve bits of 0.1 s.
                let startup = details.map(|details| thousandths(details.startup.as_millis() as u32));
                map.serialize_entry("startup_s", &startup)?;
            }
            zk::Status::Temperature { ecu } => map.serialize_entry("ecu_c", &tenths(ecu.tenths()))?,
            zk::Status::Unknown => {}
        }
        Ok(())
    }

    fn counters(&self) -> Vec<(&'static str, u32)> {
        let counters = self.decoder.counters();
        vec![
            ("unknown frames", counters.unknown_frames),
            ("CRC failures", counters.crc_failures),
            ("bytes skipped", counters.bytes_skipped),
        ]
    }

    fn pending(&self) -> usize {
        self.decoder.pending()
    }
}

/// Name of a frame by its ID, four bits. 15 does not come: 0xFF is the control head (ZK-16).
fn zk_name(id: u8) -> &'static str {
    match id {
        0 => "unknown-0",
        1 => "status-1",
        2 => "status-2",
        3 => "status-3",
        4 => "status-4",
        5 => "status-5",
        6 => "status-6",
        7 => "status-7",
        8 => "status-8",
        9 => "status-9",
        10 => "unknown-10",
        11 => "unknown-11",
        12 => "unknown-12",
        13 => "unknown-13",
        14 => "unknown-14",
        _ => "unknown-15",
    }
}

fn zk_volts(byte: zk::VoltageByte, version: Option<zk::Version>) -> Option<Decimal> {
    byte.millivolts(version).map(|voltage| thousandths(voltage.get()))
}

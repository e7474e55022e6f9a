//! The table of services: `MAV_CMD_USER_1` with the service in param1. An autopilot that has not received the
//! component yet may carry out a command itself; it does not know this one, so that is harmless.

use crate::ids::CMD_USER_1;
use jetlink::ecu::zk::codec::{AccelerationCurve, Action, IgnitionPumpVoltage};
use jetlink::ecu::{Service, amt, zk};
use jetlink::units::Millivolts;

/// Value of param2 that an emergency stop and its release require.
pub const MAGIC: i32 = 21196;

/// A row of the table.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Row {
    /// param1.
    pub number: i32,
    /// Meaning of the other parameters.
    pub params: &'static str,
    /// What it does.
    pub text: &'static str,
}

/// The table of services.
pub const TABLE: [Row; 10] = [
    Row {
        number: 1,
        params: "param2 = 21196",
        text: "Emergency stop, without cooling, latched. To the node: of all engines.",
    },
    Row {
        number: 2,
        params: "param2 = 21196",
        text: "Release of the emergency stop, with the engine stopped.",
    },
    Row { number: 3, params: "", text: "Stop: standby, with cooling." },
    Row {
        number: 10,
        params: "",
        text: "AMT: CTF. While running, the ECU stops the engine after its serial delay time.",
    },
    Row {
        number: 20,
        params: "param2 = 1 to 13",
        text: "ZK: the action of this number (docs/protocols.md): drain, tests, rates, fuel statistics, pump. Repeat a service that opens the pump within the source timeout (1 s), or the pump is closed.",
    },
    Row { number: 21, params: "param2 = 0 to 5100", text: "ZK: voltage of the ignition pump, in mV." },
    Row { number: 22, params: "param2 = 10 to 70", text: "ZK: acceleration curve." },
    Row {
        number: 30,
        params: "param2 = 21196",
        text: "To the node, with all engines at rest: accept the current settings and store them, after the stored ones were found damaged. Only over USB.",
    },
    Row {
        number: 40,
        params: "",
        text: "With radio control and the engine at rest: start a calibration of the stick. Move it from end to end. Meanwhile radio control commands nothing but a stop.",
    },
    Row {
        number: 41,
        params: "",
        text: "Finish: store the observed end points in RC_THR_MIN and RC_THR_MAX.",
    },
];

const _: () = assert!(CMD_USER_1 == 31010);

/// A service.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum NodeService {
    EmergencyStop,
    Release,
    Stop,
    ConfirmSettings,
    /// Begin, or end.
    CalibrateStick(bool),
    Ecu(Service),
}

/// Whether a service only stops an engine.
pub(crate) fn is_stop(first: f32) -> bool {
    first == 1.0 || first == 3.0
}

/// The service of a command, or what is wrong with it.
pub(crate) fn find(params: [f32; 7]) -> Result<NodeService, &'static str> {
    let [first, second, ..] = params;
    let whole = crate::number::whole;
    let unsigned = || whole(second).and_then(|number| u32::try_from(number).ok());
    let zk = |service| NodeService::Ecu(Service::Zk(service));
    match whole(first) {
        Some(1 | 2 | 30) if whole(second) != Some(MAGIC) => {
            Err("an emergency stop, its release and service 30 need param2 = 21196")
        }
        Some(1) => Ok(NodeService::EmergencyStop),
        Some(2) => Ok(NodeService::Release),
        Some(3) => Ok(NodeService::Stop),
        Some(30) => Ok(NodeService::ConfirmSettings),
        Some(40) => Ok(NodeService::CalibrateStick(true)),
        Some(41) => Ok(NodeService::CalibrateStick(false)),
        Some(10) => Ok(NodeService::Ecu(Service::Amt(amt::config::Service::Ctf))),
        Some(20) => unsigned()
            .and_then(|number| Action::ALL.into_iter().find(|action| u32::from(action.code()) == number))
            .map(|action| zk(zk::config::Service::Action(action)))
            .ok_or("ZK action: param2 has to be 1 to 13"),
        Some(21) => unsigned()
            .and_then(|number| IgnitionPumpVoltage::from_millivolts(Millivolts::new(number)).ok())
            .map(|voltage| zk(zk::config::Service::IgnitionPump(voltage)))
            .ok_or("ignition pump: param2 has to be 0 to 5100 mV"),
        Some(22) => unsigned()
            .and_then(|number| AccelerationCurve::new(u8::try_from(number).ok()?).ok())
            .map(|curve| zk(zk::config::Service::Curve(curve)))
            .ok_or("acceleration curve: param2 has to be 10 to 70"),
        _ => Err("no service has this number: see the table of MAV_CMD_USER_1"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(first: f32, second: f32) -> Result<NodeService, &'static str> {
        find([first, second, 0.0, 0.0, 0.0, 0.0, 0.0])
    }

    #[test]
    fn each_row_is_a_service_and_nothing_else_is() {
        for number in -5..50 {
            let seconds = [0, 1, 10, 13, 70, 5100, MAGIC];
            let known = seconds.iter().any(|&second| of(number as f32, second as f32).is_ok());
            assert_eq!(known, TABLE.iter().any(|row| row.number == number), "{number}");
        }
        assert_eq!(of(1.0, 21196.0), Ok(NodeService::EmergencyStop));
        for (first, second) in [
            (1.0, 0.0),
            (2.0, f32::NAN),
            (1.5, 21196.0),
            (f32::NAN, 21196.0),
            (20.0, 0.0),
            (20.0, 14.0),
            (22.0, 9.0),
        ] {
            assert!(of(first, second).is_err(), "{first} {second}");
        }
    }

    /// The compiler reports here the services of a new protocol.
    const fn number(service: Service) -> u8 {
        match service {
            Service::Amt(amt::config::Service::Ctf) => 10,
            Service::Zk(zk::config::Service::Action(_)) => 20,
            Service::Zk(zk::config::Service::IgnitionPump(_)) => 21,
            Service::Zk(zk::config::Service::Curve(_)) => 22,
        }
    }

    #[test]
    fn every_service_of_an_ecu_has_a_number() {
        let voltage = IgnitionPumpVoltage::from_millivolts(Millivolts::new(2000)).unwrap();
        for (service, second) in [
            (Service::Amt(amt::config::Service::Ctf), 0.0),
            (Service::Zk(zk::config::Service::Action(Action::ALL[4])), f32::from(Action::ALL[4].code())),
            (Service::Zk(zk::config::Service::IgnitionPump(voltage)), 2000.0),
            (Service::Zk(zk::config::Service::Curve(AccelerationCurve::new(40).unwrap())), 40.0),
        ] {
            assert_eq!(of(number(service).into(), second), Ok(NodeService::Ecu(service)));
        }
    }
}

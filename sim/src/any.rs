//! The ECU of either kind behind one face.

use crate::amt::AmtEcu;
use crate::ecu::{Ecu, LineFault, Nanos};
use crate::turbine::Turbine;
use crate::zk::ZkEcu;

/// An ECU of either kind.
#[derive(Debug)]
pub enum AnyEcu {
    /// AMT.
    Amt(Box<AmtEcu>),
    /// ZK.
    Zk(Box<ZkEcu>),
}

impl AnyEcu {
    /// The turbine.
    pub fn turbine(&self) -> &Turbine {
        match self {
            Self::Amt(ecu) => ecu.turbine(),
            Self::Zk(ecu) => ecu.turbine(),
        }
    }

    /// The turbine, to make it fail.
    pub fn turbine_mut(&mut self) -> &mut Turbine {
        match self {
            Self::Amt(ecu) => ecu.turbine_mut(),
            Self::Zk(ecu) => ecu.turbine_mut(),
        }
    }
}

impl From<AmtEcu> for AnyEcu {
    fn from(ecu: AmtEcu) -> Self {
        Self::Amt(Box::new(ecu))
    }
}

impl From<ZkEcu> for AnyEcu {
    fn from(ecu: ZkEcu) -> Self {
        Self::Zk(Box::new(ecu))
    }
}

impl Ecu for AnyEcu {
    fn next_wake(&self) -> Nanos {
        match self {
            Self::Amt(ecu) => ecu.next_wake(),
            Self::Zk(ecu) => ecu.next_wake(),
        }
    }

    fn advance(&mut self, now: Nanos, tx: &mut Vec<u8>) {
        match self {
            Self::Amt(ecu) => ecu.advance(now, tx),
            Self::Zk(ecu) => ecu.advance(now, tx),
        }
    }

    fn heard(&mut self, now: Nanos, byte: Result<u8, LineFault>) {
        match self {
            Self::Amt(ecu) => ecu.heard(now, byte),
            Self::Zk(ecu) => ecu.heard(now, byte),
        }
    }

    fn power(&mut self, now: Nanos, on: bool) {
        match self {
            Self::Amt(ecu) => ecu.power(now, on),
            Self::Zk(ecu) => ecu.power(now, on),
        }
    }
}

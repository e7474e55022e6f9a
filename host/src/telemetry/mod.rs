//! Telemetry of the ECUs, decoded for people and programs: one file for each protocol, and one line here.

mod amt;
pub mod decoder;
mod zk;

use clap::ValueEnum;
use decoder::Decoder;

/// Protocol of an ECU.
#[derive(ValueEnum, Clone, Copy, PartialEq, Eq, Debug)]
pub enum Protocol {
    /// AMT serial control: Mercury, Pegasus, Olympus, Titan, Nike, Lynx, Orion.
    Amt,
    /// ZK-Protocol.
    Zk,
}

/// What the command line knows about an ECU until the stream reports it.
#[derive(clap::Args, Clone, Copy, Default, Debug)]
pub struct Hints {
    #[command(flatten)]
    amt: amt::AmtHint,
    #[command(flatten)]
    zk: zk::ZkHint,
}

impl Hints {
    /// Checks that there are none of another protocol.
    ///
    /// # Errors
    /// A sentence for people.
    pub fn check(&self, protocol: Protocol) -> Result<(), &'static str> {
        if protocol != Protocol::Amt && self.amt != amt::AmtHint::default() {
            return Err("--engine is only for --protocol amt");
        }
        if protocol != Protocol::Zk && self.zk != zk::ZkHint::default() {
            return Err("--zk-version is only for --protocol zk");
        }
        Ok(())
    }
}

impl Protocol {
    /// Its decoder.
    pub fn decoder(self, hints: &Hints) -> Box<dyn Decoder> {
        match self {
            Self::Amt => Box::new(amt::Amt::new(hints.amt)),
            Self::Zk => Box::new(zk::Zk::new(hints.zk)),
        }
    }

    /// The decoders of the other protocols.
    pub fn others(self) -> impl Iterator<Item = Box<dyn Decoder>> {
        let all = Self::value_variants().iter();
        all.filter(move |other| **other != self).map(|other| other.decoder(&Hints::default()))
    }
}

impl From<sim::any::Protocol> for Protocol {
    fn from(protocol: sim::any::Protocol) -> Self {
        match protocol {
            sim::any::Protocol::Amt => Self::Amt,
            sim::any::Protocol::Zk => Self::Zk,
        }
    }
}

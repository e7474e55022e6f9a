//! Telemetry of the ECUs, decoded for people and programs: one file for each protocol.

mod amt;
pub mod decoder;
mod zk;

use clap::ValueEnum;
use decoder::{Decoder, Telemetry};

macro_rules! decoders {
    ($($(#[$doc:meta])* $name:ident $module:ident($config:ty, $ecu:ty, $command:ty);)+) => {
        /// Protocol of an ECU.
        #[derive(ValueEnum, Clone, Copy, PartialEq, Eq, Debug)]
        pub enum Protocol {
            $($(#[$doc])* $name,)+
        }

        /// Properties of an ECU from the command line, used until the stream reports them.
        #[derive(clap::Args, Clone, Copy, Default, Debug)]
        pub struct Hints {
            $(#[command(flatten)] $module: <$module::$name as Telemetry>::Hint,)+
        }

        impl Hints {
            /// Checks that none is for another protocol.
            ///
            /// # Errors
            /// A sentence for people.
            pub fn check(&self, protocol: Protocol) -> Result<(), &'static str> {
                $(
                    if protocol != Protocol::$name && self.$module != <$module::$name as Telemetry>::Hint::default() {
                        return Err($module::$name::HINT_OF_ANOTHER);
                    }
                )+
                Ok(())
            }
        }

        impl Protocol {
            /// Its decoder.
            pub fn decoder(self, hints: &Hints) -> Box<dyn Decoder> {
                match self {
                    $(Self::$name => Box::new($module::$name::new(hints.$module)),)+
                }
            }

            /// Its frames with the fields of their records, for the help.
            pub fn fields(self) -> String {
                match self {
                    $(Self::$name => format!("  {}\n{}", stringify!($module), <$module::$name as Telemetry>::FIELDS),)+
                }
            }

            /// The same protocol in the simulation.
            pub const fn on_wire(self) -> sim::any::Protocol {
                match self {
                    $(Self::$name => sim::any::Protocol::$name,)+
                }
            }
        }

        impl From<sim::any::Protocol> for Protocol {
            fn from(protocol: sim::any::Protocol) -> Self {
                match protocol {
                    $(sim::any::Protocol::$name => Self::$name,)+
                }
            }
        }
    };
}
sim::protocols!(decoders);

impl Protocol {
    /// All of them.
    pub fn all() -> impl Iterator<Item = Self> {
        Self::value_variants().iter().copied()
    }

    /// The decoders of the other protocols.
    pub fn others(self) -> impl Iterator<Item = Box<dyn Decoder>> {
        Self::all().filter(move |other| *other != self).map(|other| other.decoder(&Hints::default()))
    }
}

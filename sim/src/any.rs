//! An ECU of any protocol behind one interface, and its configuration.

use core::any::Any;
use core::fmt;

use crate::amt::{self, AmtConfig};
use crate::ecu::{Counts, Ecu, LineFault, Nanos};
use crate::line::Line;
use crate::turbine::{Parameters, Phase, Turbine};
use crate::vendor::{VendorConfig, VendorEcu as _};
use crate::zk::ZkConfig;

macro_rules! any {
    ($($(#[$doc:meta])* $name:ident $module:ident($config:ty, $ecu:ty, $command:ty);)+) => {
        /// Protocol of an ECU.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Protocol {
            $($(#[$doc])* $name,)+
        }

        impl Protocol {
            /// Whether the ECU's frames have a checksum.
            pub const fn has_checksum(self) -> bool {
                match self {
                    $(Self::$name => <$config>::HAS_CHECKSUM,)+
                }
            }

            /// Whether the ECU waits for a reply to each of its frames.
            pub const fn has_reply_window(self) -> bool {
                match self {
                    $(Self::$name => <$config>::HAS_REPLY_WINDOW,)+
                }
            }
        }

        /// Configuration of an ECU of any protocol.
        #[derive(Clone, Debug)]
        pub enum AnyConfig {
            $($(#[$doc])* $name($config),)+
        }

        impl AnyConfig {
            /// Its protocol.
            pub const fn protocol(&self) -> Protocol {
                match self {
                    $(Self::$name(_) => Protocol::$name,)+
                }
            }

            /// The usual ECU of this protocol for the engine with this number. Without such an engine, and for 0: that of the
            /// usual engine.
            pub fn of_engine(protocol: Protocol, number: u8) -> Self {
                match protocol {
                    $(Protocol::$name => Self::$name(VendorConfig::of_engine(number)),)+
                }
            }

            /// The same with this version of the protocol, if it has versions.
            #[must_use]
            pub fn with_version(self, version: u8) -> Self {
                match self {
                    $(Self::$name(config) => Self::$name(config.with_version(version)),)+
                }
            }

            /// The same on another line.
            #[must_use]
            pub fn on(self, line: Line) -> Self {
                match self {
                    $(Self::$name(config) => Self::$name(config.on(line)),)+
                }
            }

            /// The same with a log of this many obeyed commands.
            #[must_use]
            pub fn with_log(self, log: usize) -> Self {
                match self {
                    $(Self::$name(config) => Self::$name(config.with_log(log)),)+
                }
            }

            /// The same with this reply window, if it has one.
            #[must_use]
            pub fn with_reply_window(self, reply_window: Nanos) -> Self {
                match self {
                    $(Self::$name(config) => Self::$name(config.with_reply_window(reply_window)),)+
                }
            }

            /// The figures of its turbine.
            pub fn turbine(&self) -> &Parameters {
                match self {
                    $(Self::$name(config) => config.turbine(),)+
                }
            }

            /// The same, mutable.
            pub fn turbine_mut(&mut self) -> &mut Parameters {
                match self {
                    $(Self::$name(config) => config.turbine_mut(),)+
                }
            }

            /// The ECU, not yet powered.
            pub fn ecu(self) -> AnyEcu {
                match self {
                    $(Self::$name(config) => config.ecu().into(),)+
                }
            }
        }

        /// Its kind, for people.
        impl fmt::Display for AnyConfig {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                match self {
                    $(Self::$name(config) => config.fmt(f),)+
                }
            }
        }

        /// An ECU of any protocol.
        #[derive(Debug)]
        pub enum AnyEcu {
            $($(#[$doc])* $name(Box<$ecu>),)+
        }

        impl AnyEcu {
            /// The turbine.
            pub fn turbine(&self) -> &Turbine {
                match self {
                    $(Self::$name(ecu) => ecu.turbine(),)+
                }
            }

            /// The turbine, to make it fail.
            pub fn turbine_mut(&mut self) -> &mut Turbine {
                match self {
                    $(Self::$name(ecu) => ecu.turbine_mut(),)+
                }
            }

            /// Its protocol.
            pub const fn protocol(&self) -> Protocol {
                match self {
                    $(Self::$name(_) => Protocol::$name,)+
                }
            }

            /// Number of good control frames so far, and of everything else: damaged frames, and bytes outside of frames.
            pub fn received(&self) -> (u64, u64) {
                match self {
                    $(Self::$name(ecu) => ecu.received(),)+
                }
            }

            /// Its counters since its creation.
            pub fn counts(&self) -> Counts {
                match self {
                    $(Self::$name(ecu) => ecu.counts(),)+
                }
            }

            /// Faults that a host following the protocol never causes, in sentences.
            pub fn host_faults(&self) -> Vec<&'static str> {
                match self {
                    $(Self::$name(ecu) => ecu.host_faults(),)+
                }
            }

            /// Sets whether it reports a low supply, if the protocol has such a fault.
            pub fn report_low_supply(&mut self, low: bool) {
                match self {
                    $(Self::$name(ecu) => ecu.report_low_supply(low),)+
                }
            }

            /// Good control frames that its version does not know, if the protocol has versions.
            pub fn unknown_to_version(&self) -> u64 {
                match self {
                    $(Self::$name(ecu) => ecu.unknown_to_version(),)+
                }
            }

            /// The ECU inside.
            pub fn inner(&self) -> &dyn Any {
                match self {
                    $(Self::$name(ecu) => &**ecu,)+
                }
            }

            /// The same, mutable.
            pub fn inner_mut(&mut self) -> &mut dyn Any {
                match self {
                    $(Self::$name(ecu) => &mut **ecu,)+
                }
            }
        }

        impl Ecu for AnyEcu {
            fn next_wake(&self) -> Nanos {
                match self {
                    $(Self::$name(ecu) => ecu.next_wake(),)+
                }
            }

            fn advance(&mut self, now: Nanos, tx: &mut Vec<u8>) {
                match self {
                    $(Self::$name(ecu) => ecu.advance(now, tx),)+
                }
            }

            fn receive(&mut self, now: Nanos, byte: Result<u8, LineFault>) {
                match self {
                    $(Self::$name(ecu) => ecu.receive(now, byte),)+
                }
            }

            fn power(&mut self, now: Nanos, on: bool) {
                match self {
                    $(Self::$name(ecu) => ecu.power(now, on),)+
                }
            }
        }

        $(
            impl From<$config> for AnyConfig {
                fn from(config: $config) -> Self {
                    Self::$name(config)
                }
            }

            /// The configuration inside; an error if the protocol is another one.
            impl TryFrom<AnyConfig> for $config {
                type Error = AnyConfig;

                fn try_from(any: AnyConfig) -> Result<Self, AnyConfig> {
                    match any {
                        AnyConfig::$name(config) => Ok(config),
                        other => Err(other),
                    }
                }
            }

            impl From<$ecu> for AnyEcu {
                fn from(ecu: $ecu) -> Self {
                    Self::$name(Box::new(ecu))
                }
            }
        )+
    };
}
crate::protocols!(any);

impl AnyConfig {
    /// The AMT ECU of this engine at 2400 baud.
    pub fn amt(engine: amt::EngineModel) -> Self {
        AmtConfig::new(engine).into()
    }

    /// A ZK ECU of this protocol version.
    pub fn zk(version: u8) -> Self {
        ZkConfig::new(version).into()
    }
}

impl AnyEcu {
    /// State of the turbine.
    pub fn phase(&self) -> Phase {
        self.turbine().phase()
    }
}

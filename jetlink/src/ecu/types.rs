//! The common types of all ECUs, made from the list of protocols: an enumeration each, with a variant for every protocol.

/// The text of an enumeration of protocols is the text of the protocol's own type.
macro_rules! text_of_vendor {
    ($type:ident { $($name:ident)+ }) => {
        impl core::fmt::Display for $type {
            fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
                match self {
                    $(Self::$name(vendor) => vendor.fmt(f),)+
                }
            }
        }

        #[cfg(feature = "defmt")]
        impl defmt::Format for $type {
            fn format(&self, f: defmt::Formatter<'_>) {
                match self {
                    $(Self::$name(vendor) => defmt::Format::format(vendor, f),)+
                }
            }
        }
    };
}

macro_rules! vendor_types {
    ($($(#[$doc:meta])* $name:ident = $number:literal $label:literal ($config:ty, $mistake:ty, $service:ty, $faults:ty) { $($wired:tt)* };)+) => {
        use $crate::ecu::vendor::{LineMistake, VendorFaults as _, VendorMistake as _, VendorService as _};
        use $crate::line::{Line, Timing};
        use $crate::setting::{Row, Setting};

        /// The ECU on a port, with its settings.
        #[derive(Clone, Copy, PartialEq, Eq, Debug)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        pub enum EcuConfig {
            $($(#[$doc])* $name($config),)+
        }

        impl EcuConfig {
            /// The protocol's defaults for the timing of the link.
            pub const fn timing(&self) -> Timing {
                match self {
                    $(Self::$name(_) => <$config>::TIMING,)+
                }
            }

            /// The settings of the link: its timing with the protocol's defaults, and those of the protocol, in a fixed order.
            pub(crate) fn settings(&self) -> [&'static [Setting]; 2] {
                match self {
                    $(Self::$name(_) => [const { &Timing::table(&<$config>::TIMING) }, <$config>::SETTINGS],)+
                }
            }

            /// The same without their texts.
            pub(crate) fn rows(&self) -> [&'static [Row]; 2] {
                match self {
                    $(Self::$name(_) => [Timing::ROWS, <$config>::ROWS],)+
                }
            }

            /// The number of a setting of the protocol, or of a parameter.
            pub(crate) fn number<const ALL: bool>(&self, name: &str) -> Option<i32> {
                match self {
                    $(Self::$name(config) => config.own::<ALL>(name),)+
                }
            }

            /// Changes a setting of the protocol, or a parameter. False if it has none of that name.
            pub(crate) fn set<const ALL: bool>(&mut self, name: &str, number: i32) -> bool {
                match self {
                    $(Self::$name(config) => config.set_own::<ALL>(name, number),)+
                }
            }

            /// The number of the protocol, from 1 on, for stored settings. It never changes.
            pub const fn protocol_number(&self) -> u8 {
                match self {
                    $(Self::$name(_) => $number,)+
                }
            }

            /// An ECU with the protocol of this number and default settings; `None`: there is none.
            pub(crate) const fn of_protocol(number: u8) -> Option<Self> {
                match number {
                    $($number => Some(Self::$name(<$config>::DEFAULT)),)+
                    _ => None,
                }
            }

            /// The protocol, and the engine that it is set to, 0 where it has none: another number makes retained state invalid.
            pub const fn identity(&self) -> [u8; 2] {
                match self {
                    $(Self::$name(config) => [$number, config.identity()],)+
                }
            }
        }

        /// Mistake in the configuration of an ECU.
        #[derive(Clone, Copy, PartialEq, Eq, Debug)]
        #[non_exhaustive]
        pub enum Mistake {
            $($(#[$doc])* $name($mistake),)+
        }

        impl Mistake {
            /// A sentence, for use in a constant.
            pub const fn message(self) -> &'static str {
                match self {
                    $(Self::$name(mistake) => mistake.message(),)+
                }
            }

            /// The mistake, if it is one about the line.
            pub(crate) fn line(self) -> Option<LineMistake> {
                match self {
                    $(Self::$name(mistake) => mistake.line(),)+
                }
            }
        }

        impl EcuConfig {
            /// Checks the settings of the protocol, and that a line can carry it.
            pub(crate) const fn check(&self, line: Line) -> Result<(), Mistake> {
                match self {
                    $(Self::$name(config) => match config.check(line) {
                        Ok(()) => Ok(()),
                        Err(mistake) => Err(Mistake::$name(mistake)),
                    },)+
                }
            }
        }

        /// A service command: done once, in the ECU's own terms.
        #[derive(Clone, Copy, PartialEq, Eq, Debug)]
        pub enum Service {
            $($(#[$doc])* $name($service),)+
        }

        impl Service {
            /// It moves fuel or heats, so the engine has to be cold and at rest, and it is limited in time.
            pub fn moves_fuel(self) -> bool {
                match self {
                    $(Self::$name(service) => service.moves_fuel(),)+
                }
            }

            /// It ends the effect of one that moves fuel.
            pub fn closes_pump(self) -> bool {
                match self {
                    $(Self::$name(service) => service.closes_pump(),)+
                }
            }

            /// Whether the ECU has to report a stopped engine first.
            pub fn needs_stopped_engine(self) -> bool {
                match self {
                    $(Self::$name(service) => service.needs_stopped_engine(),)+
                }
            }
        }

        /// The faults that an ECU reports.
        #[derive(Clone, Copy, PartialEq, Eq, Debug)]
        pub enum Faults {
            $($(#[$doc])* $name($faults),)+
        }

        impl Faults {
            /// The number on the wire: AMT a set of bits, ZK a code.
            pub fn number(self) -> u8 {
                match self {
                    $(Self::$name(faults) => faults.number(),)+
                }
            }

            /// Whether it reports none.
            pub fn is_empty(self) -> bool {
                self.number() == 0
            }
        }

        impl core::error::Error for Mistake {}

        $crate::ecu::types::text_of_vendor!(Mistake { $($name)+ });

        $crate::ecu::types::text_of_vendor!(Service { $($name)+ });

        $crate::ecu::types::text_of_vendor!(Faults { $($name)+ });
    };
}

pub(super) use text_of_vendor;
pub(super) use vendor_types;

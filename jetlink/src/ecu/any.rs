//! The link of any ECU.

use super::{EcuConfig, Service, protocols};
use crate::command::{Order, Rejected};
use crate::line::{Line, LineError, Timing};
use crate::link::{Link, LinkRecord, LinkStatus, Observation, Output, ServiceFrames, Speaks};
use crate::report::NotSent;
use crate::units::{Hectopascals, Throttle};
use embassy_time::{Duration, Instant};

macro_rules! any_link {
    ($($(#[$doc:meta])* $name:ident = $number:literal $label:literal ($config:ty, $mistake:ty, $service:ty, $faults:ty) { $($wired:tt)* };)+) => {
        /// The link of any ECU.
        #[derive(Clone, Debug)]
        pub enum AnyLink {
            $($(#[$doc])* $name(<$config as Speaks>::Link),)+
        }

        impl AnyLink {
            /// The link for a configuration.
            pub fn new(config: &EcuConfig, line: Line, timing: Timing) -> Self {
                match config {
                    $(EcuConfig::$name(config) => Self::$name(config.link(line, timing)),)+
                }
            }

            /// Changes the settings of a link of the same protocol. Call it only while the engine is at rest.
            pub fn configure(&mut self, now: Instant, config: &EcuConfig, line: Line, timing: Timing) {
                match (self, config) {
                    $((Self::$name(link), EcuConfig::$name(config)) => config.configure(link, now, line, timing),)+
                    // `LinkSettings::check` has refused another protocol.
                    _ => {}
                }
            }
        }

        impl Link for AnyLink {
            fn start(&mut self, now: Instant) {
                match self {
                        $(Self::$name(link) => link.start(now),)+
                    }
            }

            fn receive(&mut self, now: Instant, bytes: &[u8]) -> usize {
                match self {
                        $(Self::$name(link) => link.receive(now, bytes),)+
                    }
            }

            fn line_error(&mut self, error: LineError) {
                match self {
                        $(Self::$name(link) => link.line_error(error),)+
                    }
            }

            fn byte_lost(&mut self, error: LineError) {
                match self {
                        $(Self::$name(link) => link.byte_lost(error),)+
                    }
            }

            fn order(&mut self, now: Instant, order: Order) -> Result<(), Rejected> {
                match self {
                        $(Self::$name(link) => link.order(now, order),)+
                    }
            }

            fn speed_control(&self) -> Result<(), Rejected> {
                match self {
                        $(Self::$name(link) => link.speed_control(),)+
                    }
            }

            fn service(&mut self, now: Instant, service: Service) -> Result<(), Rejected> {
                match self {
                        $(Self::$name(link) => link.service(now, service),)+
                    }
            }

            fn pressure(&mut self, now: Instant, pressure: Hectopascals) {
                match self {
                        $(Self::$name(link) => link.pressure(now, pressure),)+
                    }
            }

            fn sent(&mut self, now: Instant) {
                match self {
                        $(Self::$name(link) => link.sent(now),)+
                    }
            }

            fn not_sent(&mut self, now: Instant, why: NotSent) {
                match self {
                        $(Self::$name(link) => link.not_sent(now, why),)+
                    }
            }

            fn timeout(&mut self, now: Instant) {
                match self {
                        $(Self::$name(link) => link.timeout(now),)+
                    }
            }

            fn compose(&mut self) {
                match self {
                        $(Self::$name(link) => link.compose(),)+
                    }
            }

            fn poll(&mut self) -> Output {
                match self {
                        $(Self::$name(link) => link.poll(),)+
                    }
            }

            fn take_observation(&mut self) -> Option<Observation> {
                match self {
                        $(Self::$name(link) => link.take_observation(),)+
                    }
            }

            fn release(&mut self, released: bool) -> Option<Throttle> {
                match self {
                        $(Self::$name(link) => link.release(released),)+
                    }
            }

            fn gap_at(&self) -> Option<Instant> {
                match self {
                        $(Self::$name(link) => link.gap_at(),)+
                    }
            }

            fn answers_frames(&self) -> bool {
                match self {
                        $(Self::$name(link) => link.answers_frames(),)+
                    }
            }

            fn reply_timeout(&self) -> Option<Duration> {
                match self {
                        $(Self::$name(link) => link.reply_timeout(),)+
                    }
            }

            fn last_reply(&self) -> Option<Instant> {
                match self {
                        $(Self::$name(link) => link.last_reply(),)+
                    }
            }

            fn gap(&mut self) {
                match self {
                        $(Self::$name(link) => link.gap(),)+
                    }
            }

            fn record(&self) -> LinkRecord {
                match self {
                        $(Self::$name(link) => link.record(),)+
                    }
            }

            fn restore(&mut self, record: LinkRecord) {
                match self {
                        $(Self::$name(link) => link.restore(record),)+
                    }
            }

            fn may_hold_rpm(&self) -> bool {
                match self {
                        $(Self::$name(link) => link.may_hold_rpm(),)+
                    }
            }

            fn close_pump(&mut self) {
                match self {
                        $(Self::$name(link) => link.close_pump(),)+
                    }
            }

            fn service_frames(&self) -> ServiceFrames {
                match self {
                        $(Self::$name(link) => link.service_frames(),)+
                    }
            }

            fn status(&self) -> &LinkStatus {
                match self {
                        $(Self::$name(link) => link.status(),)+
                    }
            }
        }
    };
}
protocols!(any_link);

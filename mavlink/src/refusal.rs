//! Why a command or a setting was refused: a sentence for a person, and the answer of MAVLink.

use crate::ids::Ack;
use jetlink::command::Rejected;
use jetlink::setting::Row;
use jetlink::units::{Signed, Verbatim, Whole};

/// Reason for refusing a command or a setting.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Refusal {
    /// The engine refused it.
    Engine(Rejected),
    /// A system that may not command.
    NotAllowed(u8),
    /// A parameter of the command has an invalid value, or a setting contradicts others.
    Malformed(&'static str),
    /// The vehicle is disarmed.
    NotArmed,
    /// The vehicle has not been seen disarmed since the emergency stop.
    ArmedBeforeStop,
    /// The engine is ordered to run, or may run.
    AlreadyRuns,
    /// The demand source is silent.
    NoDemand,
    /// The commanding system sends no heartbeats, which keep the order alive if the engine has no demand source.
    NoHeartbeat,
    /// The demand is above idle.
    NotIdle,
    /// The source is not in control yet.
    NotInControl,
    /// A repeat of a start from before the last stop.
    Stopped,
    /// A repeat of a start that was refused.
    Repeated,
    /// A repeat of a start whose run has ended without a stop.
    HasEnded,
    /// The node is about to restart.
    Restarts,
    /// A setting would keep its sender from setting it back.
    ShutsOut,
    /// A key is set only over USB.
    #[cfg(feature = "signing")]
    OnlyByUsb,
    /// An engine turns.
    Turns,
    /// No parameter has this name.
    UnknownSetting,
    /// A value is out of its range.
    OutOfRange(&'static Row),
    /// The line is too slow for a setting of the link.
    LineTooSlow,
    /// The setting has to be a whole number.
    NotWhole,
    /// The end points of a throttle are in the wrong order.
    EndPoints,
    /// The store has no space left without an erase, and an engine may turn.
    StoreFull,
    /// Nothing is stored, and RAM that survives a reset has no space for another change.
    RamFull,
    /// The store does not accept it.
    StoreFails,
    /// Too many settings wait to be stored.
    StoreBusy,
    /// The stored settings are damaged, so it is unknown who may command.
    Damaged,
    /// The stored settings are not damaged.
    #[cfg(feature = "signing")]
    NotDamaged,
    /// An engine is not reported at rest.
    #[cfg(feature = "signing")]
    NotAtRest,
    /// The node has no receiver for radio control.
    NoReceiver,
}

impl Refusal {
    /// The answer of MAVLink.
    pub const fn ack(self) -> Ack {
        match self {
            #[cfg(feature = "signing")]
            Self::OnlyByUsb => Ack::Denied,
            Self::NotAllowed(_) | Self::Malformed(_) | Self::Engine(Rejected::NotSupported) => Ack::Denied,
            _ => Ack::TemporarilyRejected,
        }
    }
}

impl From<Rejected> for Refusal {
    fn from(why: Rejected) -> Self {
        Self::Engine(why)
    }
}

impl core::fmt::Display for Refusal {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Engine(why) => why.fmt(f),
            Self::NotAllowed(system) => {
                let system = Whole((*system).into());
                write!(f, "system {system} may not command here: see MAV_GCS_1, MAV_GCS_2, MAV_OWN_CMD")
            }
            Self::Malformed(what) => f.write_str(what),
            Self::NotArmed => f.write_str("arm the vehicle, or allow a start while disarmed (param4 = 1)"),
            Self::ArmedBeforeStop => {
                f.write_str("disarm the vehicle, then arm it again: there was an emergency stop")
            }
            Self::AlreadyRuns => f.write_str("the engine is ordered to run: stop it first"),
            Self::NoDemand => {
                f.write_str("no throttle received: check MAV_THR_SRC, MAV_THR_OUT and the autopilot")
            }
            Self::NoHeartbeat => {
                f.write_str("no heartbeat from the commanding system, which has to keep the order alive")
            }
            Self::NotIdle => f.write_str("bring the throttle to idle first"),
            Self::NotInControl => {
                f.write_str("MAVLink is not in control of the engine yet: try again in 1 s")
            }
            Self::Stopped => f.write_str("stopped since: this start is a repeat, send a new one after 5 s"),
            Self::Repeated => f.write_str("this repeats a refused start: send a new one after 5 s"),
            Self::HasEnded => f.write_str("the run of this start has ended: send a new one after 5 s"),
            Self::Restarts => f.write_str("the node is about to restart"),
            Self::ShutsOut => {
                f.write_str("you could not set it back: set it over USB, or allow another sender first")
            }
            #[cfg(feature = "signing")]
            Self::OnlyByUsb => f.write_str("set the key over USB: other links can be overheard"),
            Self::Turns => f.write_str("an engine turns or is ordered to run: stop it first"),
            Self::UnknownSetting => f.write_str("no parameter has this name"),
            Self::OutOfRange(row) => match row.unit.choices() {
                Some(choices) => f.write_str(choices),
                None => {
                    let off = if row.may_be_off { Verbatim(", or -1") } else { Verbatim("") };
                    write!(f, "use {} to {}{off}", Signed(row.min), Signed(row.max))
                }
            },
            Self::LineTooSlow => f.write_str("the baud rate leaves no time for this value"),
            Self::NotWhole => f.write_str("the value has to be a whole number"),
            Self::EndPoints => f.write_str("MAV_THR_MIN has to be below MAV_THR_MAX"),
            Self::StoreFull => f.write_str("the storage is full until all engines are reported at rest"),
            Self::RamFull => {
                f.write_str("RAM retains no more changes over a reset: set it in the image (src/config.rs)")
            }
            Self::StoreFails => f.write_str("it cannot be stored"),
            Self::StoreBusy => f.write_str("other settings are being stored"),
            Self::Damaged => f.write_str("the stored settings are damaged: confirm them over USB"),
            #[cfg(feature = "signing")]
            Self::NotDamaged => f.write_str("the settings are not damaged"),
            #[cfg(feature = "signing")]
            Self::NotAtRest => f.write_str("all engines must be reported at rest"),
            Self::NoReceiver => f.write_str("the node has no receiver for radio control"),
        }
    }
}

impl core::error::Error for Refusal {}

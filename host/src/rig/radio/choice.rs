//! The value of `--rc`.

use super::super::port::{Address, AddressError, OpenError};
use jetlink_rc::config::Protocol;
use jetlink_rc::settings::EngineSettings;

/// A receiver, and the source of its frames.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Choice {
    /// Its protocol.
    pub protocol: Protocol,
    /// `None`: a simulated transmitter, which the keys move.
    pub address: Option<Address>,
    /// Settings of each engine: the defaults with other channels.
    pub settings: EngineSettings,
}

/// Error in the value of `--rc`.
#[derive(Debug)]
pub enum RadioError {
    /// Unknown receiver.
    Protocol(String),
    /// Invalid address.
    Address(AddressError),
    /// The address can only send.
    SendsOnly,
    /// PWM with an address: pulses are always simulated.
    NoPulses,
    /// Invalid channel or function.
    Channel(String),
    /// Two functions on one channel.
    SameChannel,
    /// The port cannot be opened.
    Open(OpenError),
    /// Frames from outside with an option that needs a repeatable run.
    NotWith(&'static str),
    /// A script file with radio control, but without an end.
    NoEnd,
}

impl core::fmt::Display for RadioError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("--rc: ")?;
        match self {
            Self::Protocol(text) => write!(
                f,
                "`{text}` is not a receiver: use sbus, crsf or pwm for a transmitter that the keys move, sbus=ADDRESS or \
                 crsf=ADDRESS for frames from outside"
            ),
            Self::Address(error) => error.fmt(f),
            Self::SendsOnly => f.write_str("udpout only sends: use udpin, tcpin, tcpout or serial"),
            Self::NoPulses => f.write_str("pwm has no address: its pulses are simulated"),
            Self::Channel(text) => write!(
                f,
                "`{text}` is not a channel: use throttle=1, switch=2 or hand=3, with 1 to 16, or 1 to 4 of pwm"
            ),
            Self::SameChannel => f.write_str("throttle, switch and hand-over need a channel each"),
            Self::Open(error) => error.fmt(f),
            Self::NotWith(option) => write!(f, "frames from outside and {option} exclude each other"),
            Self::NoEnd => f.write_str("a script file with a line `rc` needs `end` with its time"),
        }
    }
}

impl core::error::Error for RadioError {}

impl Choice {
    /// Reads `sbus`, `crsf`, `pwm`, `sbus=ADDRESS` or `crsf=ADDRESS`, each optionally followed by
    /// `,throttle=CHANNEL`, `,switch=CHANNEL` and `,hand=CHANNEL`.
    pub fn parse(text: &str) -> Result<Self, RadioError> {
        let receiver = text.split(',').next().unwrap_or_default();
        let (protocol, address) =
            receiver.split_once('=').map_or((receiver, None), |(protocol, at)| (protocol, Some(at)));
        let (protocol, most, mut settings) = match protocol {
            "sbus" => (Protocol::Sbus, 16, EngineSettings::DEFAULT),
            "crsf" => (Protocol::Crsf, 16, EngineSettings::DEFAULT),
            "pwm" if address.is_some() => return Err(RadioError::NoPulses),
            "pwm" => (Protocol::Pwm, 4, EngineSettings::PULSES),
            _ => return Err(RadioError::Protocol(text.to_owned())),
        };
        for channel in text.split(',').skip(1) {
            let wrong = || RadioError::Channel(channel.to_owned());
            let (function, number) = channel.split_once('=').ok_or_else(wrong)?;
            let number =
                number.parse().ok().filter(|number| (1..=most).contains(number)).ok_or_else(wrong)?;
            match function {
                "throttle" => settings.throttle = number,
                "switch" => settings.switch = number,
                "hand" => settings.hand_over = number,
                _ => return Err(wrong()),
            }
        }
        if settings.check().is_err() {
            return Err(RadioError::SameChannel);
        }
        let address = address.map(Address::parse).transpose().map_err(RadioError::Address)?;
        if matches!(address, Some(Address::UdpOut(_))) {
            return Err(RadioError::SendsOnly);
        }
        Ok(Self { protocol, address, settings })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn choices_are_read_and_mistakes_have_their_type() {
        let usual = EngineSettings::DEFAULT;
        for (text, protocol, settings) in [
            ("sbus", Protocol::Sbus, usual),
            ("crsf", Protocol::Crsf, usual),
            ("pwm", Protocol::Pwm, EngineSettings::PULSES),
            ("sbus,throttle=1", Protocol::Sbus, EngineSettings { throttle: 1, ..usual }),
            (
                "crsf,switch=16,throttle=8",
                Protocol::Crsf,
                EngineSettings { throttle: 8, switch: 16, ..usual },
            ),
            ("sbus,hand=7", Protocol::Sbus, EngineSettings { hand_over: 7, ..usual }),
            ("pwm,hand=4", Protocol::Pwm, EngineSettings { hand_over: 4, ..EngineSettings::PULSES }),
            ("pwm,throttle=4,switch=3", Protocol::Pwm, EngineSettings { throttle: 4, switch: 3, ..usual }),
        ] {
            assert_eq!(Choice::parse(text).unwrap(), Choice { protocol, address: None, settings }, "{text}");
        }
        let outside = Choice::parse("crsf=tcpin:127.0.0.1:5791,switch=6").unwrap();
        let address = Some(Address::TcpIn("127.0.0.1:5791".into()));
        let settings = EngineSettings { switch: 6, ..usual };
        assert_eq!(outside, Choice { protocol: Protocol::Crsf, address, settings });
        for text in ["", "ppm", "SBUS", "tcpin:127.0.0.1:1", "=tcpin:127.0.0.1:1", ",throttle=1"] {
            assert!(matches!(Choice::parse(text), Err(RadioError::Protocol(_))), "{text}");
        }
        for text in ["sbus=", "sbus=127.0.0.1:1", "crsf=tcpin:127.0.0.1"] {
            assert!(matches!(Choice::parse(text), Err(RadioError::Address(_))), "{text}");
        }
        for text in [
            "sbus,",
            "sbus,throttle",
            "sbus,throttle=0",
            "sbus,switch=17",
            "pwm,switch=5",
            "sbus,hand=0",
            "pwm,hand=5",
            "sbus,hands=7",
            "sbus,switch=x",
        ] {
            assert!(matches!(Choice::parse(text), Err(RadioError::Channel(_))), "{text}");
        }
        for text in
            ["sbus,throttle=5", "pwm,throttle=2", "crsf,throttle=7,switch=7", "sbus,hand=3", "pwm,hand=2"]
        {
            assert!(matches!(Choice::parse(text), Err(RadioError::SameChannel)), "{text}");
        }
        assert!(matches!(Choice::parse("pwm=tcpin:127.0.0.1:1"), Err(RadioError::NoPulses)));
        assert!(matches!(Choice::parse("sbus=udpout:127.0.0.1:1"), Err(RadioError::SendsOnly)));
    }
}

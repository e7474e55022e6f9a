//! What `--rc` says.

use super::super::port::{Address, AddressError, OpenError};
use jetlink_rc::config::Protocol;

/// A receiver and where its frames come from.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Choice {
    /// Its protocol.
    pub protocol: Protocol,
    /// `None`: a transmitter that the keys move.
    pub address: Option<Address>,
}

/// What is wrong with `--rc`.
#[derive(Debug)]
pub enum RadioError {
    /// No such protocol.
    Protocol(String),
    /// No address behind it.
    Address(AddressError),
    /// Nothing can be received there.
    SendsOnly,
    /// The port cannot be opened.
    Open(OpenError),
    /// Frames from outside, and an option for runs that can be played again.
    NotWith(&'static str),
    /// A script file without an end.
    NoEnd,
}

impl core::fmt::Display for RadioError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("--rc: ")?;
        match self {
            Self::Protocol(text) => write!(
                f,
                "`{text}` is not a receiver: use sbus or crsf for a transmitter that the keys move, sbus=ADDRESS or \
                 crsf=ADDRESS for frames from outside"
            ),
            Self::Address(error) => error.fmt(f),
            Self::SendsOnly => f.write_str("udpout only sends: use udpin, tcpin, tcpout or serial"),
            Self::Open(error) => error.fmt(f),
            Self::NotWith(option) => write!(f, "frames from outside and {option} exclude each other"),
            Self::NoEnd => f.write_str("a script file with a line `rc` needs `end` with its time"),
        }
    }
}

impl core::error::Error for RadioError {}

impl Choice {
    /// Reads `sbus`, `crsf`, `sbus=ADDRESS` or `crsf=ADDRESS`.
    pub fn parse(text: &str) -> Result<Self, RadioError> {
        let (protocol, address) =
            text.split_once('=').map_or((text, None), |(protocol, at)| (protocol, Some(at)));
        let protocol = match protocol {
            "sbus" => Protocol::Sbus,
            "crsf" => Protocol::Crsf,
            _ => return Err(RadioError::Protocol(text.to_owned())),
        };
        let address = address.map(Address::parse).transpose().map_err(RadioError::Address)?;
        if matches!(address, Some(Address::UdpOut(_))) {
            return Err(RadioError::SendsOnly);
        }
        Ok(Self { protocol, address })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn choices_are_read_and_mistakes_have_their_type() {
        for (text, protocol) in [("sbus", Protocol::Sbus), ("crsf", Protocol::Crsf)] {
            assert_eq!(Choice::parse(text).unwrap(), Choice { protocol, address: None });
        }
        let outside = Choice::parse("crsf=tcpin:127.0.0.1:5791").unwrap();
        let address = Some(Address::TcpIn("127.0.0.1:5791".into()));
        assert_eq!(outside, Choice { protocol: Protocol::Crsf, address });
        for text in ["", "pwm", "SBUS", "tcpin:127.0.0.1:1", "=tcpin:127.0.0.1:1"] {
            assert!(matches!(Choice::parse(text), Err(RadioError::Protocol(_))), "{text}");
        }
        for text in ["sbus=", "sbus=127.0.0.1:1", "crsf=tcpin:127.0.0.1"] {
            assert!(matches!(Choice::parse(text), Err(RadioError::Address(_))), "{text}");
        }
        assert!(matches!(Choice::parse("sbus=udpout:127.0.0.1:1"), Err(RadioError::SendsOnly)));
    }
}

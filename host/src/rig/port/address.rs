//! Addresses of the rig's ports, in the notation of `mavlink-core`.

use std::net::IpAddr;

/// Address of a port.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Address {
    /// Listens for a connection.
    TcpIn(String),
    /// Connects, and connects again.
    TcpOut(String),
    /// Receives here, and answers the last sender of a frame.
    UdpIn(String),
    /// Sends there.
    UdpOut(String),
    /// A serial port, with its baud rate.
    Serial(String, u32),
}

/// As it is written on the command line.
impl core::fmt::Display for Address {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::TcpIn(place) => write!(f, "tcpin:{place}"),
            Self::TcpOut(place) => write!(f, "tcpout:{place}"),
            Self::UdpIn(place) => write!(f, "udpin:{place}"),
            Self::UdpOut(place) => write!(f, "udpout:{place}"),
            Self::Serial(device, baud) => write!(f, "serial:{device}:{baud}"),
        }
    }
}

/// A text that is not a valid address.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct AddressError(String);

impl core::fmt::Display for AddressError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(
            f,
            "`{}` is not an address: use tcpin:HOST:PORT, tcpout:HOST:PORT, udpin:HOST:PORT, udpout:HOST:PORT or \
             serial:DEVICE:BAUD",
            self.0
        )
    }
}

impl core::error::Error for AddressError {}

impl Address {
    /// Reads one.
    pub fn parse(text: &str) -> Result<Self, AddressError> {
        let wrong = || AddressError(text.to_owned());
        let (kind, rest) = text.split_once(':').ok_or_else(wrong)?;
        let (place, number) = rest.rsplit_once(':').ok_or_else(wrong)?;
        if place.is_empty() {
            return Err(wrong());
        }
        if kind == "serial" {
            let baud: u32 = number.parse().map_err(|_| wrong())?;
            return if baud >= 1200 { Ok(Self::Serial(place.to_owned(), baud)) } else { Err(wrong()) };
        }
        let _: u16 = number.parse().map_err(|_| wrong())?;
        match kind {
            "tcpin" => Ok(Self::TcpIn(rest.to_owned())),
            "tcpout" => Ok(Self::TcpOut(rest.to_owned())),
            "udpin" => Ok(Self::UdpIn(rest.to_owned())),
            "udpout" => Ok(Self::UdpOut(rest.to_owned())),
            _ => Err(wrong()),
        }
    }

    /// Whether the autopilot is on this port. A client that connects to the rig is a ground station, as on a board's USB.
    pub const fn is_autopilot(&self) -> bool {
        matches!(self, Self::TcpOut(_) | Self::UdpOut(_) | Self::Serial(..))
    }

    /// Whether it listens where only this computer can reach it.
    pub fn is_this_computer(&self) -> bool {
        matches!(self, Self::TcpIn(place) | Self::UdpIn(place) if is_this_computer(place))
    }
}

/// Whether an address to listen on is one of this computer alone.
fn is_this_computer(place: &str) -> bool {
    let host = place.rsplit_once(':').map_or(place, |(host, _)| host);
    let host = host.trim_start_matches('[').trim_end_matches(']');
    host.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_loopback_address_is_this_computer() {
        let here = |text| Address::parse(text).unwrap().is_this_computer();
        for text in ["tcpin:127.0.0.1:5790", "udpin:127.0.0.1:14550", "tcpin:[::1]:5790"] {
            assert!(here(text), "{text}");
        }
        for text in [
            "tcpin:0.0.0.0:5790",
            "tcpin:[::]:5790",
            "udpin:192.168.4.1:14550",
            "tcpin:localhost:5790",
            "tcpout:127.0.0.1:5762",
            "udpout:127.0.0.1:14550",
            "serial:/dev/ttyACM0:57600",
        ] {
            assert!(!here(text), "{text}");
        }
    }

    #[test]
    fn addresses_are_read_and_mistakes_named() {
        assert_eq!(Address::parse("tcpin:127.0.0.1:5760"), Ok(Address::TcpIn("127.0.0.1:5760".into())));
        assert_eq!(Address::parse("tcpout:[::1]:5762"), Ok(Address::TcpOut("[::1]:5762".into())));
        assert_eq!(
            Address::parse("serial:/dev/ttyACM0:57600"),
            Ok(Address::Serial("/dev/ttyACM0".into(), 57_600))
        );
        for text in ["tcpin:127.0.0.1:5760", "udpout:[::1]:14550", "serial:/dev/ttyACM0:57600"] {
            assert_eq!(Address::parse(text).unwrap().to_string(), text);
        }
        for text in
            ["", "tcp:127.0.0.1:1", "tcpin:127.0.0.1", "tcpin::", "udpin:host:70000", "serial:/dev/x:fast"]
        {
            let error = Address::parse(text).unwrap_err().to_string();
            assert!(error.contains("tcpin:HOST:PORT"), "{text}: {error}");
        }
    }
}

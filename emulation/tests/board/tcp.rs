//! A port on TCP instead of an ECU, as `cargo emu-run` offers the telemetry UART: bytes go both ways.
//!
//! Here the port of an engine is on TCP and the test is the ECU.

use crate::support::{on_each_board, others_are_well};
use emulation::{Image, Run};
use rigless::chip::uart::TcpPeer;
use sim::ecu::SECOND;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;

/// A normal set of an AMT ECU in standby. The second one of a kind is answered.
fn send_set(ecu: &mut TcpStream) {
    ecu.write_all(&[0xFF, 0x0A, 0x00, 0x10, 0x00, 0x00]).expect("the board takes it");
    // Sockets are in real time: let it arrive before virtual time continues.
    std::thread::sleep(Duration::from_millis(100));
}

#[test]
fn bytes_go_both_ways_over_tcp() {
    on_each_board(|board| {
        let peer = TcpPeer::listen(0).expect("a port of this machine");
        let address = ("127.0.0.1", peer.port().expect("a port"));
        let mut stream = TcpStream::connect(address).expect("the board is there");
        stream.set_read_timeout(Some(Duration::from_secs(5))).expect("a time limit");
        let mut ecu = stream.try_clone().expect("a second handle");
        let mut second = stream.try_clone().expect("a third handle");
        let report = Run::new(board, Image::Release)
            .engines()
            .tcp("SERIAL2", peer)
            .at(SECOND / 2, move |_| send_set(&mut ecu))
            .at(SECOND / 2 + SECOND / 8, move |_| send_set(&mut second))
            .until(SECOND)
            .go();
        let mut reply = [0; 5];
        stream.read_exact(&mut reply).expect("the board answers");
        assert_eq!(reply, [0xFF, 0x12, 0x20, 0x12, 0x20]);
        others_are_well(&report, &["SERIAL2"]);
    });
}

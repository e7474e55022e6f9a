//! An ECU that sends without pause.

use crate::support::{on_each_board, others_are_well};
use emulation::{Image, Run};
use sim::amt::AmtEcu;
use sim::any::Protocol;
use sim::ecu::{MILLIS, SECOND};
use sim::zk::ZkEcu;

/// Neither protocol's frames, with the heads of both in it.
const GARBAGE: [u8; 13] = [0xFF, 0x80, 0xF1, 0x00, 0xFF, 0xFF, 0x13, 0xF0, 0x55, 0x33, 0xFE, 0x81, 0x01];

#[test]
fn two_babbling_ecus_disturb_no_other_engine() {
    on_each_board(|board| {
        let report = Run::new(board, Image::Release)
            .engines()
            .at(2 * SECOND, |bench| {
                bench.babble("SERIAL2", Some(&GARBAGE));
                bench.babble("SERIAL5", Some(&GARBAGE));
            })
            .at(8 * SECOND, |bench| {
                bench.babble("SERIAL2", None);
                bench.babble("SERIAL5", None);
            })
            .until(12 * SECOND)
            .go();
        // The line is full: 6 s at 11 520 bytes a second.
        let babbled =
            report.wire("SERIAL5").rx.iter().filter(|rx| (2 * SECOND..8 * SECOND).contains(&rx.start));
        let babbled = babbled.count();
        assert!(babbled > 68_500, "{babbled}");
        // The ZK ECU is still commanded at its rate: it may be listening.
        let zk = report.ecu::<ZkEcu>("SERIAL5").stats;
        assert!(zk.intervals.max.expect("commands") < 21 * MILLIS, "{zk:?}");
        assert_eq!(zk.bad.total(), 0, "{zk:?}");
        // Both links come back.
        for engine in ["left", "booster"] {
            let status = format!("{engine}: link");
            let status = report.lines(&status).next_back().expect("a status line");
            assert!(status.text.contains("link up"), "{}", status.text);
        }
        let replies =
            report.ecu::<AmtEcu>("SERIAL2").commands.iter().filter(|(at, _)| *at > 8500 * MILLIS).count();
        assert!((27..=29).contains(&replies), "{replies} replies in the last 3.5 s");
        others_are_well(&report, &["SERIAL2", "SERIAL5"]);
    });
}

#[test]
fn each_of_good_frames_without_a_pause_is_answered() {
    // A normal set of an Olympus in standby, over and over: 40 frames a second, and a reply to each.
    const SET: [u8; 6] = [0xFF, 0x0A, 0x00, 0x10, 0x00, 0x00];
    on_each_board(|board| {
        let report = Run::new(board, Image::Release)
            .engines()
            .at(2 * SECOND, |bench| bench.babble("SERIAL2", Some(&SET)))
            .until(6 * SECOND)
            .go();
        let wire = report.wire("SERIAL2");
        let frames = wire.rx.iter().filter(|rx| rx.end > 2100 * MILLIS && rx.byte == SET[0]).count();
        let replies = wire.frames(Protocol::Amt);
        let replies = replies.iter().filter(|(_, bytes)| bytes[0].end > 2100 * MILLIS).count();
        assert!(frames > 150 && replies.abs_diff(frames) <= 2, "{replies} replies to {frames} frames");
        others_are_well(&report, &["SERIAL2"]);
    });
}

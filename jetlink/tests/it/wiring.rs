//! The wiring of an engine, as numbers.

use jetlink::command::{Order, Origin};
use jetlink::config::EngineConfig;
use jetlink::ecu::EcuConfig;
use jetlink::ecu::amt::codec::EngineModel;
use jetlink::ecu::zk::codec::Rate;
use jetlink::engine::retained::{Reset, RetainedMemory, RetainedState};
use jetlink::line::{Line, StopBits, Timing};
use jetlink::wiring::{Contradiction, Ports, Wiring, WiringError, check};

const AMT: EngineConfig = EngineConfig::amt("amt", 0, Line::new(2400), Some(EngineModel::Titan));
const ZK: EngineConfig = EngineConfig::zk("zk", 1, Line::with_two_stop_bits(115_200), Rate::Hz100);
const SIX: Ports = Ports { count: 6, taken: Some(5), two_stop_bits: true };

/// Every wiring that its rows allow.
fn all() -> Vec<Wiring> {
    let mut all = Vec::new();
    for (port, protocol, stop) in [(0, 1, 1), (15, 2, 2), (7, 1, 2), (1, 2, 1)] {
        for baud in Line::BAUD_RATES {
            for engine in 0..=7 {
                for rate in [20, 50, 100] {
                    let mut wiring = Wiring::of(&AMT);
                    let numbers = [port, protocol, baud as i32, stop, engine, rate];
                    for (row, number) in Wiring::ROWS.iter().zip(numbers) {
                        assert!(row.allows(number) && wiring.change(row.name, number), "{}", row.name);
                        assert_eq!(wiring.number(row.name), Some(number));
                    }
                    all.push(wiring);
                }
            }
        }
    }
    all
}

#[test]
fn wiring_is_one_number_and_back() {
    for wiring in all() {
        assert_eq!(Wiring::unpacked(wiring.packed()), Some(wiring));
    }
    // An invalid record, for example RAM after a power-up, gives no wiring.
    let odd = (0..100_000_u32).map(|i| i.wrapping_mul(0x9E37_79B9).rotate_left(i % 32));
    for number in odd.chain([0, u32::MAX]) {
        assert!(Wiring::unpacked(number).is_none_or(|wiring| wiring.packed() == number), "{number:#x}");
    }
    let whole = Wiring::of(&ZK).packed();
    assert_eq!(Wiring::unpacked(whole | 1 << 31), None);
}

/// RAM and flash have these of an older image.
#[test]
fn number_of_a_wiring_never_changes() {
    let amt = EngineConfig::amt("none", 15, Line::new(57_600), None);
    for (engine, number) in [(AMT, 0x0508_8010), (ZK, 0x1901_6021), (amt, 0x0500_D01F)] {
        assert_eq!(
            Wiring::of(&engine).packed(),
            number,
            "{}: {:#010x}",
            engine.name,
            Wiring::of(&engine).packed()
        );
    }
}

#[test]
fn numbers_that_are_not_a_rate_are_refused() {
    let rows = |name| Wiring::ROWS.iter().find(|row| row.name == name).unwrap();
    for number in 2400..=115_200 {
        assert_eq!(rows("E1_BAUD").allows(number), Line::new(number as u32).is_printed_rate(), "{number}");
    }
    for number in 0..=200 {
        let is_one = Rate::ALL.iter().any(|rate| rate.hz() == number as u32);
        assert_eq!(rows("E1_ZK_RATE").allows(number), is_one, "{number}");
    }
}

#[test]
fn texts_name_the_rates_that_there_are() {
    let [slow, middle, fast] = Rate::ALL.map(Rate::hz);
    let rates = format!("{slow}, {middle} or {fast}");
    let settings = Wiring::table(&Wiring::of(&ZK));
    let row = settings.iter().find(|row| row.name == "E1_ZK_RATE").unwrap();
    assert_eq!((row.min as u32, row.max as u32), (slow, fast));
    assert_eq!(row.unit.choices(), Some(format!("use {rates}").as_str()));
    assert!(row.text.ends_with(&format!(": {rates}.")), "{}", row.text);
}

#[test]
fn wiring_of_an_engine_gives_the_same_engine_back() {
    for engine in [AMT, ZK, EngineConfig::amt("none", 3, Line::new(9600), None)] {
        let mut same = engine;
        assert!(same.set("LOSS_HOLD", 5).is_ok() && same.set("LINK_LOST", 2000).is_ok());
        let before = same;
        Wiring::of(&engine).apply(&mut same);
        assert_eq!(same, before, "settings stay");
    }
    for wiring in all() {
        let mut engine = ZK;
        wiring.apply(&mut engine);
        assert_eq!(engine.ecu.protocol_number(), wiring.protocol);
        let found = Wiring::of(&engine);
        // Settings of another protocol do not reach the engine.
        let (amt, zk) = (found.amt_engine == wiring.amt_engine, found.zk_rate == wiring.zk_rate);
        assert!(if wiring.protocol == 1 { amt } else { zk });
        assert_eq!((found.port, found.baud, found.stop_bits), (wiring.port, wiring.baud, wiring.stop_bits));
    }
}

#[test]
fn another_protocol_has_its_own_settings_and_another_fingerprint() {
    let mut engine = AMT;
    assert!(engine.set("LOSS_HOLD", 5).is_ok() && engine.set("AMT_GUARD", 700).is_ok());
    let mut wiring = Wiring::of(&engine);
    assert!(wiring.change("E1_PROTO", 2) && wiring.change("E1_ZK_RATE", 50));
    wiring.apply(&mut engine);
    let zk = EngineConfig::zk("amt", 0, Line::new(2400), Rate::Hz50);
    assert_eq!((engine.ecu, engine.timing), (zk.ecu, zk.ecu.timing()));
    assert_eq!(engine.supervision.number("LOSS_HOLD"), Some(5), "supervision stays");
    assert_ne!(engine.fingerprint(), AMT.fingerprint());
    assert_eq!(engine.fingerprint(), zk.fingerprint());
    wiring = Wiring::of(&AMT);
    wiring.apply(&mut engine);
    assert!(matches!(engine.ecu, EcuConfig::Amt(config) if config.engine == Some(EngineModel::Titan)));
    assert_eq!(engine.timing, Timing { ..AMT.timing });
}

#[test]
fn what_a_board_cannot_have_is_found_with_its_row_and_why() {
    let wired = |changes: &[(usize, &str, i32)]| {
        let mut engines = [AMT, ZK];
        for (row, name, number) in changes {
            let mut wiring = Wiring::of(&engines[*row]);
            assert!(wiring.change(name, *number));
            wiring.apply(&mut engines[*row]);
        }
        check(&engines, SIX)
    };
    assert_eq!(wired(&[]), Ok(()));
    // Two engines swap ports.
    assert_eq!(wired(&[(0, "E1_PORT", 1), (1, "E1_PORT", 0)]), Ok(()));
    for (changes, row, why, text) in [
        (&[(0, "E1_PORT", 1)][..], 1, Contradiction::SamePort, "two engines on one port: change E2_PORT"),
        (&[(1, "E1_PORT", 6)], 1, Contradiction::NoSuchPort, "the board has no such port: change E2_PORT"),
        (&[(0, "E1_PORT", 5)], 0, Contradiction::Taken, "its port is used by radio control: change E1_PORT"),
        (&[(1, "E1_PROTO", 1)], 1, Contradiction::StopBits, "use one stop bit: change E2_STOP"),
        (
            &[(1, "E1_BAUD", 4800)],
            1,
            Contradiction::RateTooFast,
            "the line is too slow for the status rate: change E2_BAUD",
        ),
    ] {
        let error = WiringError { row, why };
        assert_eq!((wired(changes), error.to_string().as_str()), (Err(error), text), "{changes:?}");
    }
    let one = Ports { two_stop_bits: false, ..SIX };
    let error = |row, why| Err(WiringError { row, why });
    assert_eq!(check(&[AMT, ZK], one), error(1, Contradiction::StopBits));
    assert_eq!(ZK.line.stop_bits, StopBits::Two);
    let mut slow = EngineConfig::amt("slow", 0, Line::new(9600), None);
    assert!(slow.set("AMT_GUARD", 20_000).is_ok());
    assert_eq!(check(&[slow], SIX), Ok(()));
    slow.line = Line::new(2400);
    assert_eq!(check(&[slow], SIX), error(0, Contradiction::Setting));
}

/// For any engine's record, also after a loss of power: a firmware that needs this before it reads settings does not know the engine.
#[test]
fn a_record_says_whether_its_engine_was_at_rest_to_one_that_does_not_know_the_engine() {
    use jetlink::command::Demand;
    use jetlink::units::Throttle;
    let run = Order::Run(Demand::Throttle(Throttle::IDLE));
    let state = |order, change: fn(&mut RetainedState)| {
        let mut state = RetainedState::new(order, Origin::Bench).with(|state| state.ran = false);
        change(&mut state);
        state
    };
    for (state, at_rest) in [
        (state(Order::Standby, |_| {}), true),
        (state(Order::Listen, |_| {}), true),
        (state(Order::EmergencyStop, |_| {}), true),
        (state(run, |state| state.starting = 1), false),
        (state(run, |state| state.ran = true), false),
        (state(Order::Listen, |state| state.ran = true), false),
        (state(Order::Pwm, |state| state.ran = true), false),
        (state(Order::Standby, |state| state.pump_open = true), false),
    ] {
        let memory = RetainedMemory::new();
        memory.store(&state, AMT.fingerprint());
        for (fingerprint, reset) in
            [(AMT.fingerprint(), Reset::Warm), (0, Reset::Warm), (0, Reset::PowerLost)]
        {
            let found = memory.load(fingerprint, reset).map(|record| record.is_at_rest());
            assert_eq!(found, Some(at_rest), "{state:?}");
        }
    }
}

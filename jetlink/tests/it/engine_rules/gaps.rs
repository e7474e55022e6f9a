//! Gaps in the status of a ZK ECU.

use super::*;

/// A ZK ECU that reports 100 Hz and answers at the host's 20 Hz (ZK-10): its frames do not count as gaps.
#[test]
fn zk_10_an_ecu_that_reports_100_hz_and_answers_at_20_hz_leaves_no_gaps() {
    let mut scenario = flying(Ecu::Zk, 60);
    for _ in 0..2 {
        scenario.bench.receive(&zk_frames::status(6, TURNING, [160, 0, 4 << 2 | 2]));
    }
    scenario.fly_us(run(60), Origin::Rc, 12 * SECOND);
    assert_eq!(scenario.order(), Order::Run(percent(60)), "a frame every 50 ms, and the engine runs");
}

/// Damaged frames at the expected times (bursts of a frame's length, no break) prevent a gap, for 10 s at most: at every rate that
/// the line carries (ZK-11).
#[test]
fn zk_11_damaged_frames_at_the_expected_times_are_not_a_gap_at_any_rate() {
    use jetlink::config::EngineConfig;
    use jetlink::ecu::zk::codec::Rate;
    use jetlink::line::Line;
    for (baud, rate, code, every) in
        [(2400, Rate::Hz20, 0, 50_000), (4800, Rate::Hz50, 1, 20_000), (9600, Rate::Hz100, 2, 10_000)]
    {
        let config = EngineConfig::zk("z", 0, Line::new(baud), rate);
        let byte = 10_000_000 / u64::from(baud) + 1;
        let mut scenario = Scenario::nothing_received(Ecu::Zk, config);
        let mut at = every;
        let mut send = |scenario: &mut Scenario, frame: [u8; 7]| {
            for (n, byte_out) in (1..).zip(frame) {
                scenario.bench.rx_at_us(at + n * byte, &[byte_out]);
            }
            at += every;
        };
        let info = [zk_frames::status(8, 0, [5, 0, 0]), zk_frames::status(6, 0, [160, 0, 5 << 2 | code])];
        for _ in 0..2 {
            info.iter().for_each(|frame| send(&mut scenario, *frame));
        }
        for _ in 0..400 {
            send(&mut scenario, zk_frames::status(1, 0, [1, 1 << 5, 76]));
        }
        scenario.command(Command::Arm).unwrap();
        scenario.command(Command::Standby).unwrap();
        assert_eq!(scenario.command(run(0)), Ok(Accepted::InForce), "{rate:?}");
        for state in [3, 11] {
            for _ in 0..10 {
                let _ = scenario.command(run(0));
                send(&mut scenario, zk_frames::status(1, TURNING, [state, 2 << 5, 76]));
            }
        }
        assert_eq!(scenario.telemetry().in_doubt, None, "{rate:?}");
        let mut doubts = 0;
        for _ in 0..2_000_000 / every {
            let _ = scenario.command(run(0));
            let mut frame = zk_frames::status(1, TURNING, [11, 2 << 5, 76]);
            frame[4] ^= 0x55;
            send(&mut scenario, frame);
            doubts += u32::from(scenario.telemetry().in_doubt.is_some());
        }
        assert_eq!(doubts, 0, "{rate:?} at {baud} baud: frames in doubt in 2 s of noise");
    }
}

/// A status rate changed in flight, or on a link that returned: frames at the new rate do not count as gaps.
#[test]
fn frames_at_a_new_status_rate_leave_no_gaps() {
    let mut scenario = flying(Ecu::Zk, 60);
    for _ in 0..2 {
        scenario.bench.receive(&zk_frames::status(6, TURNING, [160, 0, 5 << 2 | 2]));
    }
    // At 100 Hz until 20 Hz is commanded.
    scenario.bench.frames();
    let mut doubt = 0;
    let mut slow = false;
    for n in 0..200 {
        let _ = scenario.command(run(60));
        scenario.silent().pass_us(if slow { 50_000 } else { 10_000 });
        slow |= scenario.bench.bytes().iter().any(|frame| frame[..] == zk_frames::action(7));
        let frame = match n % 9 {
            8 => zk_frames::status(6, TURNING, [160, 0, 5 << 2 | if slow { 0 } else { 2 }]),
            0 => zk_frames::status(1, TURNING, [11, 2 << 5, 76]),
            _ => zk_frames::status(9, TURNING, [70, 0, 0]),
        };
        scenario.bench.receive(&frame);
        doubt += u32::from(scenario.telemetry().in_doubt.is_some());
    }
    assert_eq!(doubt, 0, "frames in doubt");
}

/// "Doubt begins with a gap": a rate in a single report does not cause one.
#[test]
fn one_report_of_a_false_rate_raises_no_doubt() {
    // One status ID 6 with a good CRC and another rate: "two agreeing reports" for what decides about a gap.
    let mut scenario = flying(Ecu::Zk, 60);
    scenario.bench.receive(&zk_frames::status(6, TURNING, [160, 0, 5 << 2 | 2]));
    scenario.command(run(60)).unwrap();
    scenario.pass_us(3 * FRAME_PERIOD_US);
    assert_eq!(scenario.telemetry().in_doubt, None);
}

/// Damaged frames at the expected times prevent a gap for 10 s at most: meanwhile the demand is also sent in rpm mode, or
/// telemetry reports that it is not.
#[test]
fn an_rpm_demand_is_sent_through_2_s_of_damaged_frames() {
    let mut scenario = Scenario::started(Ecu::Zk, rpm(100_000));
    scenario.fly_us(Command::Run(rpm(100_000)), Origin::Rc, SECOND);
    scenario.silent();
    let mut late = 0;
    for n in 0..40 {
        if n == 20 {
            scenario.bench.frames();
        }
        let _ = scenario.command(Command::Run(rpm(60_000)));
        scenario.pass_us(FRAME_PERIOD_US);
        let mut frame = zk_frames::status(1, TURNING, [11, 2 << 5, 76]);
        frame[4] ^= 0x55;
        scenario.bench.receive(&frame);
        late += u32::from(n >= 20 && scenario.telemetry().in_doubt.is_none());
    }
    let out = scenario.bench.bytes().iter().filter(|frame| frame[1] >> 4 == 7).count();
    assert!(
        out > 0 || late == 0,
        "no ID 7 in the second second, not in doubt at {late} of 20 frames: {:?}",
        scenario.order()
    );
}

/// "It continues ... unless a standby or stop was sent meanwhile": CTF is a stop. A node that is reset meanwhile ends in standby,
/// too.
#[test]
fn amt_13_an_engine_that_ctf_was_stopping_does_not_resume_after_a_long_gap() {
    let ctf = Command::Service(Service::Amt(amt::config::Service::Ctf));
    for (service, left) in [(None, Order::Run(percent(50))), (Some(ctf), Order::Standby)] {
        let mut scenario = flying(Ecu::Amt, 50);
        if let Some(service) = service {
            scenario.command(service).unwrap();
            scenario.fly_us(run(50), Origin::Rc, SECOND);
            assert!(scenario.sent().contains(&Wire::Ctf));
        }
        scenario.silent().fly_us(run(50), Origin::Rc, 10 * SECOND);
        scenario.reports = Some(Reports::Running);
        scenario.fly_us(run(50), Origin::Rc, 5 * SECOND);
        assert_eq!(scenario.order(), left, "{service:?}");
    }
}

/// "Nothing reported before a gap holds for what comes after it": another ECU may be there, and a curve of one engine stalls another.
#[test]
fn zk_13_a_service_command_is_not_repeated_after_a_gap() {
    let curve = zk::codec::AccelerationCurve::new(50).unwrap();
    let sets = |frames: Vec<Vec<u8>>| frames.iter().filter(|frame| frame[..] == zk_frames::curve(50)).count();
    for (gap, repeated) in [(false, true), (true, false)] {
        let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
        scenario.command(Command::Service(Service::Zk(zk::config::Service::Curve(curve)))).unwrap();
        scenario.pass_us(SECOND);
        assert_eq!(sets(scenario.bench.bytes()), 1);
        if gap {
            scenario.silent().pass_us(SECOND);
            scenario.reports = Some(Reports::Standby);
        }
        scenario.pass_us(8 * SECOND);
        assert_eq!(sets(scenario.bench.bytes()) > 0, repeated, "gap: {gap}");
    }
}

/// "A demand beyond the maximum is clamped": also until an ECU has reported its maximum again, after the link was lost.
#[test]
fn an_rpm_demand_does_not_rise_before_the_maximum_is_reported_again() {
    let mut scenario = Scenario::started(Ecu::Zk, rpm(100_000));
    let demand = Command::Run(rpm(200_000));
    scenario.fly_us(demand, Origin::Rc, 5 * SECOND);
    scenario.bench.frames();
    scenario.silent().fly_us(demand, Origin::Rc, SECOND);
    scenario.reports(Reports::Running).fly_us(demand, Origin::Rc, 3 * SECOND);
    let codes = |scenario: &mut Scenario| -> Vec<u16> {
        let frames = scenario.bench.bytes();
        let frames = frames.iter().filter(|frame| frame[1] >> 4 == 7);
        frames.map(|frame| u16::from_be_bytes([frame[1] & 0x0F, frame[2]])).collect()
    };
    let without = codes(&mut scenario);
    assert!(without.iter().all(|code| *code == 4000), "160 000 rpm is code 4000: {without:?}");
    // With a lower maximum the demand falls: 100 000 rpm in the same steps of 40.
    for _ in 0..2 {
        scenario.bench.receive(&zk_frames::status(6, TURNING, [100, 0, 5 << 2]));
    }
    scenario.fly_us(demand, Origin::Rc, 3 * SECOND);
    assert_eq!(codes(&mut scenario).last(), Some(&2500));
}

/// "After a gap the demand rises at a set rate": also when it was held until the maximum was reported again.
#[test]
fn an_rpm_demand_that_waited_for_the_maximum_rises_at_the_set_rate() {
    let mut scenario = Scenario::started(Ecu::Zk, rpm(60_000));
    scenario.fly_us(Command::Run(rpm(60_000)), Origin::Rc, 2 * SECOND);
    scenario.silent().fly_us(Command::Run(rpm(60_000)), Origin::Rc, SECOND);
    for n in 0..40 {
        // It confirms the life: running, with the idle speed known.
        let frame = match n % 2 {
            0 => zk_frames::status(1, TURNING, [11, 2 << 5, 76]),
            _ => zk_frames::status(8, TURNING, [5, 0, 0]),
        };
        scenario.bench.receive(&frame);
        scenario.command(Command::Run(rpm(if n < 20 { 60_000 } else { 120_000 }))).ok();
        scenario.pass_us(FRAME_PERIOD_US);
    }
    // Until the version is known, it also goes out as ID 7 beside ID 0.
    assert_eq!(scenario.order(), Order::Doubt(rpm(60_000)), "the maximum is not known");
    assert_eq!(scenario.telemetry().in_doubt, None);
    for _ in 0..2 {
        scenario.bench.receive(&zk_frames::status(6, TURNING, [160, 0, 5 << 2]));
    }
    scenario.reports = Some(Reports::Running);
    scenario.fly_us(Command::Run(rpm(120_000)), Origin::Rc, SECOND / 2);
    // 50 % of 160 000 rpm a second.
    let Order::Run(Demand::Rpm(half_a_second_later)) = scenario.order() else {
        panic!("{:?}", scenario.order())
    };
    assert!((99_000..=101_000).contains(&half_a_second_later.get()), "{half_a_second_later:?}");
}

/// "ID 0, and in mode 3 the demand as ID 7 alternating with it": also at the fail-safe stage, when the lost link has forgotten the idle
/// speed.
#[test]
fn at_the_fail_safe_stage_an_rpm_demand_continues_in_doubt_after_the_link_is_lost() {
    let mut scenario = Scenario::started(Ecu::Zk, rpm(60_000));
    scenario.fly_us(Command::Run(rpm(60_000)), Origin::Rc, 2 * SECOND);
    // Timeout and hold 1.5 s, then down to idle in less than 1 s; the link is lost 0.5 s after its last frame.
    scenario.pass_us(3 * SECOND);
    scenario.silent().pass_us(2 * SECOND);
    assert_eq!(scenario.order(), Order::Doubt(rpm(5000)));
    scenario.bench.frames();
    scenario.pass_us(SECOND);
    let frames = scenario.bench.bytes();
    assert!(frames.iter().any(|frame| frame[1] >> 4 == 7), "{frames:02X?}");
    assert!(frames.iter().any(|frame| frame[1] >> 4 == 0), "{frames:02X?}");
}

/// The rate of the fail-safe, 50 % of the maximum a second, is the same before and after the link is lost, and with it the maximum.
#[test]
fn an_rpm_falls_to_the_fail_safe_at_one_rate_when_the_link_is_lost_on_the_way() {
    let fallen = |silent: bool| {
        let mut scenario = Scenario::started(Ecu::Zk, rpm(150_000));
        scenario.fly_us(Command::Run(rpm(150_000)), Origin::Rc, 10 * SECOND);
        scenario.pass_us(1_200_000);
        if silent {
            scenario.silent();
        }
        // Timeout and hold are 1.5 s: it has fallen for 1 s, 0.2 s of them with a link.
        scenario.pass_us(1_300_000);
        match scenario.order() {
            Order::Run(Demand::Rpm(rpm)) if !silent => rpm.get(),
            Order::Doubt(Demand::Rpm(rpm)) if silent => rpm.get(),
            order => panic!("{order:?}"),
        }
    };
    let (received, silent) = (fallen(false), fallen(true));
    assert!((60_000..90_000).contains(&received), "{received}");
    assert!(silent.abs_diff(received) < 4000, "{silent} instead of {received}");
}

/// An engine at 120 000 rpm, and the command; its source is silent, or has returned.
fn at_120_000_rpm(fresh: bool) -> (Scenario, Command) {
    let mut scenario = Scenario::started(Ecu::Zk, rpm(120_000));
    let demand = Command::Run(rpm(120_000));
    scenario.fly_us(demand, Origin::Rc, 5 * SECOND);
    scenario.pass_us(SECOND);
    if fresh {
        scenario.fly_us(demand, Origin::Rc, SECOND);
    }
    (scenario, demand)
}

/// Two reports of another identity: the maximum in thousands of rpm, and the version. An ECU of a later version needs four.
fn identity(scenario: &mut Scenario, thousands: u8, version: u8) {
    for _ in 0..4 {
        scenario.bench.receive(&zk_frames::status(6, TURNING, [thousands, 0, version << 2]));
    }
}

/// A demand beyond the maximum is clamped, also one in force when the ECU reports a lower one. Then it "does not jump": it rises at
/// the set rate from there, and with a silent source not at all.
#[test]
fn a_demand_in_force_is_clamped_to_a_lower_maximum_and_does_not_jump_back() {
    for fresh in [true, false] {
        let (mut scenario, demand) = at_120_000_rpm(fresh);
        identity(&mut scenario, 100, 5);
        scenario.pass_us(2 * FRAME_PERIOD_US);
        assert_eq!(scenario.order(), Order::Run(rpm(100_000)), "not idle");
        identity(&mut scenario, 160, 5);
        scenario.pass_us(2 * FRAME_PERIOD_US);
        let Order::Run(Demand::Rpm(soon)) = scenario.order() else { panic!("{:?}", scenario.order()) };
        // 50 % of 160 000 rpm a second: at most 10 000 rpm in the 0.1 s.
        assert!((100_000..=111_000).contains(&soon.get()), "{soon:?}");
        assert!(fresh || soon.get() == 100_000, "{soon:?} without a source");
        if fresh {
            scenario.fly_us(demand, Origin::Rc, SECOND);
            assert_eq!(scenario.order(), Order::Run(rpm(120_000)));
        }
    }
}

/// An ECU that reports a version without speed control has idle instead of an rpm (ZK-7). When it reports its own version again, the
/// demand rises at the set rate; with a silent source it stays at idle.
#[test]
fn a_demand_that_the_ecu_could_not_take_does_not_jump_when_it_can() {
    for fresh in [true, false] {
        let (mut scenario, demand) = at_120_000_rpm(fresh);
        scenario.values.rpm = Some(30_000);
        identity(&mut scenario, 160, 3);
        scenario.pass_us(2 * FRAME_PERIOD_US);
        assert_eq!(scenario.order(), Order::Run(percent(0)), "version 3 has no speed control");
        identity(&mut scenario, 160, 5);
        scenario.pass_us(2 * FRAME_PERIOD_US);
        match scenario.order() {
            Order::Run(Demand::Throttle(Throttle::IDLE)) => assert!(!fresh),
            // From the shaft's speed, 50 % of 160 000 rpm a second: at most 10 000 rpm in the 0.1 s.
            Order::Run(Demand::Rpm(soon)) => assert!(fresh && soon.get() <= 41_000, "{soon:?}"),
            order => panic!("{order:?}"),
        }
        if fresh {
            scenario.fly_us(demand, Origin::Rc, 4 * SECOND);
            assert_eq!(scenario.order(), Order::Run(rpm(120_000)));
        }
    }
}

/// The ECU keeps RPM_X over a reset of the node, and ID 7 means nothing without it.
#[test]
fn zk_9_a_reset_after_a_change_of_the_maximum_never_raises_the_target() {
    for max in [160, 80] {
        let (mut scenario, _) = at_120_000_rpm(true);
        let demand = Command::Run(rpm(60_000));
        scenario.fly_us(demand, Origin::Rc, 5 * SECOND);
        identity(&mut scenario, max, 5);
        scenario.fly_us(demand, Origin::Rc, SECOND);
        assert!(scenario.bench.bytes().contains(&zk_frames::mode(4, 3).to_vec()), "RPM_X stays 4");
        let record = scenario.bench.machine.record();
        let mut scenario = Scenario::after_reset(Ecu::Zk, Ecu::Zk.config(), Some(record));
        identity(&mut scenario, max, 5);
        scenario.fly_us(demand, Origin::Rc, SECOND);
        let (mut factor, mut rpms) = (4, 0);
        for (at, frame) in scenario.bench.frames() {
            match frame[1] >> 4 {
                6 => factor = u32::from(frame[2] >> 2),
                7 => {
                    rpms += 1;
                    let target = u32::from(u16::from_be_bytes([frame[1] & 0x0F, frame[2]])) * factor * 10;
                    assert!(target <= 60_000, "maximum {max}: {target} rpm at {at} µs");
                }
                _ => {}
            }
        }
        assert!(rpms > 0, "the demand is sent");
    }
}

//! Properties of any schedule.

use super::*;

fn any_order() -> impl Strategy<Value = Order> {
    prop_oneof![
        Just(Order::Standby),
        Just(Order::EmergencyStop),
        (0..=1000u16).prop_map(throttle_tenths),
        (0..=260_000u32).prop_map(rpm),
    ]
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        3 => (0..=14u8, 0..600_000u32, any::<[u8; 3]>())
            .prop_map(|(id, rpm, rest)| Step::Status(zk::status(id, rpm, rest))),
        3 => (0..=24u8).prop_map(|state| Step::Status(zk::state(state))),
        2 => (1..=255u8, 0..=6u8, 0..=3u8).prop_map(|(max, version, rate)| Step::Status(zk::identity(max, version, rate))),
        1 => (0..=60u8, any::<bool>()).prop_map(|(idle, asks)| Step::Status(zk::idle(idle, asks))),
        1 => prop::collection::vec(any::<u8>(), 1..9).prop_map(Step::Noise),
        3 => any_order().prop_map(Step::Order),
        2 => prop_oneof![
            (0..13usize).prop_map(|one| action(Action::ALL[one])),
            (10..=70u8).prop_map(curve),
            (0..=5100u32).prop_map(ignition),
        ].prop_map(Step::Service),
        1 => (0..=1023u16).prop_map(Step::Pressure),
        1 => Just(Step::Timeout),
        1 => (0..700_000u64).prop_map(Step::Asleep),
    ]
}

proptest! {
    /// In any schedule: never two transmissions at once and no deadline in the past (the bench checks both); every frame is one
    /// of the document; SW 0 is never sent (ZK-8); an unlock is followed by its command or by an order that cancels it (ZK-13);
    /// after an emergency stop there are only stops; silence yields "lost" once.
    #[test]
    fn zk_8_zk_13_in_any_schedule_every_frame_is_one_of_the_document(
        split_switch in any::<bool>(),
        baud in prop::sample::select(&[9600u32, 19_200, 115_200][..]),
        rate in prop::sample::select(&[Rate::Hz20, Rate::Hz50, Rate::Hz100][..]),
        steps in prop::collection::vec((0..120_000u64, step()), 1..60),
    ) {
        let line = Line::new(baud);
        let mut bench = link(Config { rate, split_switch }, line);
        let mut frames = Vec::new();
        let mut stopped_from = None;
        // Before these frames an order came that ends a service command.
        let mut called_off = Vec::new();
        for (wait, step) in steps {
            bench.run_to_us(bench.now_us() + wait);
            frames.extend(bench.bytes());
            match step {
                Step::Status(frame) => bench.receive(&frame),
                Step::Noise(bytes) => bench.receive(&bytes),
                Step::Order(order) => {
                    if bench.order_at_us(bench.now_us(), order).is_ok() {
                        if order != Order::Standby {
                            called_off.push(frames.len());
                        }
                        match order {
                            // From the very next frame on.
                            Order::EmergencyStop => stopped_from = stopped_from.or(Some(frames.len())),
                            _ => {
                                check_stops(&frames, stopped_from.take())?;
                            }
                        }
                    }
                }
                Step::Service(command) => drop(service(&mut bench, command)),
                Step::Pressure(hectopascals) => pressure(&mut bench, hectopascals),
                Step::Timeout => {
                    let now = bench.now_us();
                    bench.timeout_at_us(now);
                }
                Step::Asleep(long) => {
                    let t = bench.now_us() + long;
                    if !bench.busy() {
                        bench.timeout_at_us(t);
                        prop_assert!(bench.deadline_us().is_none_or(|deadline| deadline > t));
                    }
                }
            }
            frames.extend(bench.bytes());
        }
        check_stops(&frames, stopped_from)?;
        for (at, pair) in frames.windows(2).enumerate() {
            let over = called_off.contains(&(at + 1)) && matches!(id(&pair[1]), 1 | 6 | 7);
            prop_assert!(id(&pair[0]) != 3 || matches!(id(&pair[1]), 4 | 5) || over, "{:02x?}", pair);
            prop_assert!(!matches!(id(&pair[1]), 4 | 5) || id(&pair[0]) == 3, "{:02x?}", pair);
        }
        for frame in &frames {
            let bytes: [u8; 4] = frame[..].try_into().expect("four bytes");
            prop_assert!(jetlink::ecu::zk::codec::Control::decode(bytes).is_ok(), "{:02x?}", bytes);
            prop_assert_ne!(switch_of(frame), Some(PWM), "{:02x?}", bytes);
        }
        bench.events();
        let was_lost = bench.machine.status().state == LinkState::Lost;
        bench.run_to_us(bench.now_us() + 5_000_000);
        let lost = bench.event_kinds().into_iter().filter(|event| *event == Event::LinkLost).count();
        prop_assert_eq!(lost, usize::from(!was_lost));
        prop_assert_eq!(bench.machine.status().state, LinkState::Lost);
    }
}

/// The frames after a stop are stops, and between them up to ten that close a pump that was found open.
fn check_stops(frames: &[Vec<u8>], from: Option<usize>) -> Result<(), TestCaseError> {
    let frames = from.map_or(&[][..], |from| &frames[from..]);
    let closes = |frame: &Vec<u8>| frame[..] == zk::action(13);
    let mut closed = 0;
    for (at, frame) in frames.iter().enumerate() {
        if at > 0 && closes(frame) && !closes(&frames[at - 1]) {
            closed += 1;
        } else {
            prop_assert_eq!(switch_of(frame), Some(STOP), "{:02x?} after an emergency stop", frame);
        }
    }
    prop_assert!(closed <= 10, "{} frames close the pump", closed);
    Ok(())
}

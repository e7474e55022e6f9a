//! Histories by hand for the judge's rules: a hand-over to the PWM input uses a permission.

use super::*;

#[test]
fn a_hand_over_needs_an_unused_standby_of_its_source() {
    let pwm = Sent::Full(Switch::Pwm, 0);
    let story = || ready(ZK5).wire(4.4, 10.0, pwm).turbine(5.0, 10.0, Phase::Standby, 0.0, 15.0);
    let handed = |at: f64| story().once(PILOT, at, PilotCommand::Pwm);
    handed(4.4).passes();
    // Somebody has taken it back: a disarm, a person, another source that changes to standby.
    for command in [PilotCommand::Disarm, PilotCommand::ShutDown, PilotCommand::Stop] {
        assert!(
            handed(4.4).once(0, 4.2, command).once(0, 4.3, PilotCommand::Arm).finds(Rule::Pwm),
            "{command}"
        );
    }
    let run = PilotCommand::Run(Demanded::Throttle(0));
    let changes = |first| handed(4.4).once(2, 4.1, first).once(2, 4.2, PilotCommand::Standby);
    assert!(changes(run).finds(Rule::Pwm) && !changes(PilotCommand::Standby).finds(Rule::Pwm));
    // A run was refused with it.
    assert!(handed(4.4).once(PILOT, 4.2, PilotCommand::Run(Demanded::Throttle(300))).finds(Rule::Pwm));
    // A hand-over that is over has used it, and so has one that was refused.
    let cut = |h: &mut History| h.mute = Spans::from(&[(5 * SECOND, 6 * SECOND)]);
    let again = |from: f64| {
        handed(4.4).with(cut).once(PILOT, 7.0, PilotCommand::Pwm).with(move |h| {
            let over = h.frames.iter_mut().filter(|frame| (5_200 * MS..micros(from)).contains(&frame.at));
            over.for_each(|frame| frame.sent = STANDBY);
        })
    };
    assert!(again(7.0).finds(Rule::Pwm) && !again(10.0).finds(Rule::Pwm));
}

#[test]
fn a_hand_over_uses_the_permission_for_a_start() {
    let story = |first: Option<PilotCommand>| {
        let story = ready(ZK5)
            .streams(PILOT, 4.2, 8.0, PilotCommand::Run(Demanded::Throttle(0)))
            .wire(4.0, 4.2, STANDBY)
            .wire(4.2, 8.0, IDLE)
            .mark(5.2, Mark::Ignition)
            .turbine(5.2, 8.0, Phase::Ignition, 5000.0, 20.0);
        match first {
            Some(command) => story.once(PILOT, 4.1, command),
            None => story,
        }
    };
    story(None).passes();
    story(Some(PilotCommand::Pwm)).breaks(&[Rule::Ignition, Rule::RunAtRest]);
}

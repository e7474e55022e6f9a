//! The judge can fail: for each rule a history made by hand that breaks it and nothing else, beside one that keeps it.

use crate::history::{
    Ask, Cause, Frame, History, Kind, MS, Mark, Reset, Rules, SECOND, Said, Sample, Spans, Switch, Told, Word,
};
use crate::judge::{Rule, Verdict, judge};
use sim::turbine::Phase;

const AMT: Kind = Kind::Amt;
const ZK5: Kind = Kind::Zk(5);
const IDLE: Told = Told::Full(Switch::Run, 0);
const HALF: Told = Told::Full(Switch::Run, 500);
const STANDBY: Told = Told::Full(Switch::Standby, 0);
const STOP: Told = Told::Full(Switch::Stop, 0);
/// When the engine of [`flight`] has reached running, and when its pilot asks for half throttle, s.
const RUNS: u64 = 30;
const PILOT: usize = 1;

fn rules(kind: Kind) -> Rules {
    Rules {
        kind,
        period: if kind == AMT { 125 } else { 50 } * MS,
        round: if kind == AMT { 1 } else { 9 },
        ages: [500 * MS, 500 * MS, SECOND, 500 * MS],
        recover_after: SECOND,
        return_within: SECOND,
        takeover: 2 * SECOND,
        hold: SECOND,
        ramp: 500,
        rise: 500,
        slew_up: None,
        slew_down: None,
        fail_safe: 0,
        standby_after: None,
        lower_standby_after: 5 * SECOND,
        listen: SECOND,
        arming: true,
        link_stable: SECOND,
        idle_band: 20,
        egt_max: 100.0,
        start_timeout: 120 * SECOND,
        start_wait: 0,
        start_throttle: 0,
        governor: false,
        pump_bound: 30 * SECOND,
        gives_up_after: 2 * SECOND,
        gives_up_on_empty: false,
        stale: 0,
        boot: 300 * MS,
        idle_rpm: 50_000.0,
        max_rpm: 160_000.0,
        limit_egt: None,
        limit_rpm: None,
        limit_fault: None,
        limit_change: None,
        when_other_fails: None,
    }
}

/// Writes a history. Times are in seconds.
struct Story(History);

impl Story {
    fn new(kind: Kind) -> Self {
        Self(History::new(rules(kind)))
    }

    fn says(mut self, source: usize, from: f64, to: f64, word: Word) -> Self {
        let mut at = micros(from);
        while at < micros(to) {
            self.0.said.push(Said { at, source, word });
            at += 100 * MS;
        }
        self
    }

    fn once(self, source: usize, at: f64, word: Word) -> Self {
        self.says(source, at, at + 0.001, word)
    }

    fn wire(mut self, from: f64, to: f64, told: Told) -> Self {
        let mut at = micros(from);
        while at < micros(to) {
            self.0.frames.push(Frame { at: at + MS, arrived: true, told });
            at += self.0.rules.period;
        }
        self
    }

    /// A demand that moves at 50 % a second.
    fn ramp(mut self, at: f64, from: u32, to: u32) -> Self {
        let steps = u64::from(from.abs_diff(to)) * MS * 2 / self.0.rules.period;
        for step in 0..=steps {
            let done = (step * self.0.rules.period / MS / 2) as u32;
            let tenths = if to > from { (from + done).min(to) } else { from.saturating_sub(done).max(to) };
            let at = micros(at) + step * self.0.rules.period + MS;
            self.0.frames.push(Frame { at, arrived: true, told: Told::Full(Switch::Run, tenths) });
        }
        self
    }

    fn turbine(mut self, from: f64, to: f64, phase: Phase, rpm: f64, egt: f64) -> Self {
        let (lit, flow) = match phase {
            Phase::Preheat | Phase::FuelRamp | Phase::LearningIdle | Phase::Running => (true, 100.0),
            _ => (false, 0.0),
        };
        let mut at = micros(from);
        while at < micros(to) {
            self.0.samples.push(Sample { at, phase, lit, rpm, egt, flow, fault: false, hidden: false });
            at += 50 * MS;
        }
        self
    }

    /// Fuel flows although it is at rest.
    fn fuel(mut self, from: f64, to: f64) -> Self {
        for sample in
            self.0.samples.iter_mut().filter(|sample| (micros(from)..micros(to)).contains(&sample.at))
        {
            sample.flow = 40.0;
        }
        self
    }

    fn mark(mut self, at: f64, mark: Mark) -> Self {
        self.0.marks.push((micros(at), mark));
        self
    }

    fn with(mut self, change: impl FnOnce(&mut History)) -> Self {
        change(&mut self.0);
        self
    }

    fn judged(mut self) -> Verdict {
        let h = &mut self.0;
        h.said.sort_by_key(|said| said.at);
        h.frames.sort_by_key(|frame| frame.at);
        h.samples.sort_by_key(|sample| sample.at);
        h.marks.sort_by_key(|(at, _)| *at);
        h.end = h.samples.last().map_or(0, |sample| sample.at);
        judge(h)
    }

    #[track_caller]
    fn breaks(self, rules: &[Rule]) {
        let verdict = self.judged();
        assert_eq!(verdict.rules(), rules, "{:#?}", verdict.findings);
    }

    /// What its wire does in doubt, or how soon its turbine obeys, is not what it is about.
    #[track_caller]
    fn breaks_beside(self, others: &[Rule], rules: &[Rule]) {
        let verdict = self.judged();
        let found: Vec<Rule> = verdict.rules().into_iter().filter(|rule| !others.contains(rule)).collect();
        assert_eq!(found, rules, "{:#?}", verdict.findings);
    }

    #[track_caller]
    fn passes(self) {
        self.breaks(&[]);
    }
}

fn micros(seconds: f64) -> u64 {
    (seconds * SECOND as f64).round() as u64
}

/// Armed and in standby until 4 s, cold.
fn ready(kind: Kind) -> Story {
    Story::new(kind)
        .once(PILOT, 1.5, Word::Arm)
        .says(PILOT, 1.0, 4.0, Word::Standby)
        .wire(1.0, 4.0, STANDBY)
        .turbine(0.0, 5.0, Phase::Standby, 0.0, 15.0)
}

/// Started at 4 s, runs from 30 s on.
fn started(kind: Kind) -> Story {
    ready(kind)
        .says(PILOT, 4.0, 31.0, Word::Run(Ask::Throttle(0)))
        .wire(4.0, 31.0, IDLE)
        .mark(5.0, Mark::Ignition)
        .turbine(5.0, RUNS as f64, Phase::FuelRamp, 20_000.0, 400.0)
}

/// And then at half throttle until this time, s; its pilot goes on with it.
fn flight(kind: Kind, until: f64) -> Story {
    started(kind).says(PILOT, 31.0, until, Word::Run(Ask::Throttle(500))).wire(31.0, until, HALF).turbine(
        RUNS as f64,
        until,
        Phase::Running,
        100_000.0,
        500.0,
    )
}

#[test]
fn an_ordinary_flight_keeps_every_rule() {
    for kind in [AMT, ZK5, Kind::Zk(3)] {
        flight(kind, 60.0)
            .says(PILOT, 60.0, 70.0, Word::Standby)
            .wire(60.1, 70.0, STANDBY)
            .turbine(60.0, 70.0, Phase::Cooling, 5000.0, 300.0)
            .passes();
    }
}

#[test]
fn an_ignition_follows_one_sources_own_standby_and_run_while_armed() {
    let ends = |story: Story| story.turbine(5.0, 8.0, Phase::Ignition, 5000.0, 20.0).wire(4.0, 8.0, IDLE);
    let run = Word::Run(Ask::Throttle(0));
    let says = |story: Story| ends(story.says(PILOT, 4.0, 8.0, run).mark(5.0, Mark::Ignition));
    says(ready(ZK5)).passes();
    // Not armed: the word goes to the wire all the same.
    says(ready(ZK5).with(|h| h.said.retain(|said| said.word != Word::Arm)))
        .breaks(&[Rule::Ignition, Rule::RunAtRest]);
    // Another source's standby.
    let other = |h: &mut History| {
        for said in h.said.iter_mut().filter(|said| said.word == Word::Standby) {
            said.source = 2;
        }
    };
    says(ready(ZK5)).with(other).breaks(&[Rule::Ignition, Rule::RunAtRest]);
    // Above idle.
    let high = ready(ZK5).says(PILOT, 4.0, 8.0, Word::Run(Ask::Throttle(300))).mark(5.0, Mark::Ignition);
    ends(high).breaks(&[Rule::Ignition, Rule::RunAtRest]);
    // Refused once is refused: it is armed later.
    says(ready(ZK5).with(|h| h.said.retain(|said| said.word != Word::Arm)).once(PILOT, 4.5, Word::Arm))
        .breaks(&[Rule::Ignition, Rule::RunAtRest]);
    // Its ECU has lost its power just now, or for long enough to see it.
    let off = |from| {
        move |h: &mut History| {
            h.unpowered = Spans::from(&[(from, 4050 * MS)]);
            h.rules.boot = 50 * MS;
        }
    };
    says(ready(ZK5)).with(off(3995 * MS)).passes();
    says(ready(ZK5)).with(off(3500 * MS)).breaks_beside(&[Rule::Doubt], &[Rule::Ignition, Rule::RunAtRest]);
    // A hot exhaust.
    let hot = |h: &mut History| h.samples.iter_mut().for_each(|sample| sample.egt = 180.0);
    says(ready(ZK5)).with(hot).breaks(&[Rule::Ignition, Rule::RunAtRest]);
    // One that is not measured.
    let broken = |h: &mut History| h.sensor = Spans::from(&[(0, 8 * SECOND)]);
    says(ready(ZK5)).with(broken).breaks(&[Rule::Ignition, Rule::RunAtRest]);
}

#[test]
fn a_pair_of_words_gives_one_ignition() {
    let story = || {
        flight(ZK5, 40.0)
            .turbine(40.0, 42.0, Phase::Stopped, 30_000.0, 90.0)
            .turbine(42.0, 44.0, Phase::Ignition, 8000.0, 90.0)
            .says(PILOT, 40.0, 44.0, Word::Run(Ask::Throttle(500)))
            .wire(40.0, 40.5, HALF)
            .wire(40.5, 44.0, STANDBY)
    };
    story().mark(42.0, Mark::Ignition).breaks(&[Rule::Ignition]);
    // One that the ECU begins by itself is not an ignition by the node.
    story().mark(42.0, Mark::Relight).passes();
}

/// An AMT engine goes out, and its ECU clears its fault while the exhaust is hot, and starts on the run that it was told. A node
/// has to see the exhaust fall within 4 s, unless it is reset before.
#[test]
fn a_trip_that_clears_while_the_exhaust_is_hot_cannot_be_seen() {
    let story = |clears: f64, resets: bool| {
        let up =
            |half: u64| Reset { down: half * SECOND / 2, up: half * SECOND / 2 + MS, cause: Cause::Watchdog };
        flight(AMT, 40.0)
            .says(PILOT, 40.0, clears + 1.0, Word::Run(Ask::Throttle(500)))
            .wire(40.0, 43.5, HALF)
            .turbine(40.0, clears, Phase::Cooling, 30_000.0, 400.0)
            .turbine(clears, clears + 1.0, Phase::Ignition, 8000.0, 390.0)
            .mark(clears, Mark::Ignition)
            .with(|h| {
                for sample in h.samples.iter_mut().filter(|sample| sample.phase == Phase::Cooling) {
                    sample.fault = true;
                }
                h.resets = (80..92).filter(|_| resets).map(up).collect();
            })
    };
    story(43.5, false).passes();
    story(46.0, true).passes();
    story(46.0, false).breaks(&[Rule::Ignition]);
    // Within 5 s after the demand was lowered a fall says nothing.
    let lowered = |clears| {
        story(clears, false).with(|h| {
            for frame in h.frames.iter_mut().filter(|frame| (42 * SECOND..43_500 * MS).contains(&frame.at)) {
                frame.told = IDLE;
            }
        })
    };
    let breaks = |clears| lowered(clears).judged().rules().contains(&Rule::Ignition);
    assert!(!breaks(46.0));
    assert!(breaks(52.0));
}

/// While the wire to the node is cut an AMT ECU gets no reply: until its serial delay is over it may start again on the last one.
#[test]
fn behind_a_cut_wire_an_amt_ecu_acts_on_its_last_word() {
    let story = |again: f64, cut: bool| {
        flight(AMT, 40.0)
            .says(PILOT, 40.0, again + 1.0, Word::Run(Ask::Throttle(500)))
            .turbine(40.0, again, Phase::Cooling, 30_000.0, 400.0)
            .turbine(again, again + 1.0, Phase::Ignition, 8000.0, 390.0)
            .mark(again, Mark::Ignition)
            .with(|h| h.rules.gives_up_after = 4 * SECOND)
            .with(|h| {
                h.mute = Spans::from(&[(39_900 * MS, if cut { 60 } else { 40 } * SECOND)]);
            })
    };
    story(42.0, true).passes();
    story(42.0, false).breaks(&[Rule::Ignition]);
    story(46.0, true).breaks(&[Rule::Ignition]);
}

#[test]
fn a_withdrawn_start_does_not_ignite() {
    let story = |word| {
        ready(ZK5)
            .says(PILOT, 4.0, 12.0, Word::Run(Ask::Throttle(0)))
            .once(2, 5.0, word)
            .wire(4.0, 5.1, IDLE)
            .wire(5.1, 12.0, STANDBY)
            .mark(8.0, Mark::Ignition)
            .turbine(5.0, 8.0, Phase::Standby, 0.0, 15.0)
            .turbine(8.0, 12.0, Phase::Ignition, 5000.0, 20.0)
    };
    story(Word::Disarm).breaks(&[Rule::Ignition]);
    story(Word::ShutDown).breaks(&[Rule::Ignition]);
    story(Word::Arm).passes();
}

/// Nor does a standby take effect that is below a source which is in control and says run.
#[test]
fn a_start_is_withdrawn_by_its_own_source_unless_a_higher_one_is_in_control() {
    let story = |higher: bool| {
        let story =
            if higher { ready(ZK5).says(0, 4.2, 13.9, Word::Run(Ask::Throttle(0))) } else { ready(ZK5) };
        story
            .says(PILOT, 4.0, 8.0, Word::Run(Ask::Throttle(0)))
            .says(PILOT, 8.0, 13.9, Word::Standby)
            .wire(4.0, 13.0, IDLE)
            .wire(13.0, 14.0, STANDBY)
            .mark(11.0, Mark::Ignition)
            .turbine(5.0, 11.0, Phase::Standby, 0.0, 15.0)
            .turbine(11.0, 14.0, Phase::Ignition, 5000.0, 20.0)
    };
    story(true).passes();
    story(false).breaks_beside(&[Rule::Obeyed], &[Rule::Ignition, Rule::RunAtRest]);
}

#[test]
fn an_emergency_stop_disarms_until_who_said_armed_says_disarmed() {
    let story = |disarm: bool| {
        let story =
            ready(ZK5).once(PILOT, 2.0, Word::Stop).wire(2.0, 2.2, STOP).once(PILOT, 2.2, Word::Release);
        let story =
            story.with(|h| h.frames.retain(|f| f.told == STOP || !(2_000_000..2_250_000).contains(&f.at)));
        let story = if disarm { story.once(PILOT, 2.4, Word::Disarm) } else { story };
        story
            .once(PILOT, 2.6, Word::Arm)
            .says(PILOT, 4.0, 8.0, Word::Run(Ask::Throttle(0)))
            .wire(4.0, 8.0, IDLE)
            .mark(5.0, Mark::Ignition)
            .turbine(5.0, 8.0, Phase::Ignition, 5000.0, 20.0)
    };
    story(true).passes();
    story(false).breaks(&[Rule::Ignition, Rule::RunAtRest]);
}

#[test]
fn an_engine_that_went_out_is_not_told_run_for_long() {
    let story = |told_until: f64| {
        flight(ZK5, 40.0)
            .turbine(40.0, 50.0, Phase::Cooling, 5000.0, 400.0)
            .says(PILOT, 40.0, 50.0, Word::Run(Ask::Throttle(500)))
            .wire(40.0, told_until, HALF)
            .wire(told_until, 50.0, STANDBY)
    };
    story(40.5).passes();
    story(45.0).breaks(&[Rule::RunAtRest]);
}

#[test]
fn an_ecu_that_was_powered_up_is_not_told_run() {
    let story = |told: Told| {
        flight(AMT, 40.0)
            .with(|h| h.unpowered = Spans::from(&[(40 * SECOND, 50 * SECOND)]))
            .turbine(40.0, 55.0, Phase::Stopped, 0.0, 200.0)
            .says(PILOT, 40.0, 55.0, Word::Run(Ask::Throttle(500)))
            .wire(50.4, 50.5, told)
            .wire(50.5, 55.0, STANDBY)
    };
    story(STANDBY).passes();
    story(HALF).breaks(&[Rule::RunAtRest]);
}

#[test]
fn a_line_that_is_lost_ends_what_an_engine_at_rest_is_told() {
    let story = |until: f64| {
        flight(ZK5, 40.0)
            .with(|h| h.mute = Spans::from(&[(39_800 * MS, 50 * SECOND)]))
            .turbine(40.0, 50.0, Phase::Standby, 0.0, 50.0)
            .says(PILOT, 40.0, 50.0, Word::Run(Ask::Throttle(500)))
            .wire(40.0, until, HALF)
            .wire(until, 50.0, Told::Nothing)
    };
    story(40.0).passes();
    story(45.0).breaks(&[Rule::RunAtRest, Rule::Doubt]);
}

#[test]
fn a_permission_does_not_outlive_a_disarm_a_shutdown_or_another_sources_change_to_standby() {
    let story = |between: &[(usize, Word)]| {
        let mut story = ready(ZK5)
            .says(PILOT, 4.0, 8.0, Word::Run(Ask::Throttle(0)))
            .wire(4.0, 8.0, IDLE)
            .mark(5.0, Mark::Ignition)
            .turbine(5.0, 8.0, Phase::Ignition, 5000.0, 20.0);
        for (step, (source, word)) in between.iter().enumerate() {
            story = story.once(*source, 3.92 + 0.02 * step as f64, *word);
        }
        story
    };
    story(&[(2, Word::Arm)]).passes();
    story(&[(2, Word::Standby)]).passes();
    for between in [
        [(2, Word::Disarm), (2, Word::Arm)],
        [(2, Word::ShutDown), (2, Word::Arm)],
        [(2, Word::Run(Ask::Throttle(0))), (2, Word::Standby)],
    ] {
        story(&between).breaks(&[Rule::Ignition, Rule::RunAtRest]);
    }
}

#[test]
fn a_start_that_waited_is_checked_again_when_it_goes() {
    let story = || {
        ready(ZK5)
            .says(PILOT, 4.0, 14.0, Word::Run(Ask::Throttle(0)))
            .wire(4.0, 10.0, STANDBY)
            .wire(10.0, 14.0, IDLE)
            .mark(11.0, Mark::Ignition)
            .turbine(5.0, 11.0, Phase::Standby, 0.0, 15.0)
            .turbine(11.0, 14.0, Phase::Ignition, 5000.0, 20.0)
            .with(|h| h.rules.start_wait = 60 * SECOND)
    };
    story().passes();
    let hot = |h: &mut History| {
        for sample in h.samples.iter_mut().filter(|sample| sample.at > 7 * SECOND) {
            sample.egt = 180.0;
        }
    };
    story().with(hot).breaks(&[Rule::Ignition, Rule::RunAtRest]);
    let stick_up = |h: &mut History| {
        for said in h.said.iter_mut().filter(|said| said.at > 7 * SECOND) {
            said.word = Word::Run(Ask::Throttle(300));
        }
    };
    story().with(stick_up).breaks(&[Rule::Ignition, Rule::RunAtRest]);
    story()
        .once(PILOT, 7.0, Word::Disarm)
        .once(PILOT, 7.5, Word::Arm)
        .breaks(&[Rule::Ignition, Rule::RunAtRest]);
}

#[test]
fn an_exhaust_that_falls_ends_the_run_of_an_engine_with_error_sets() {
    let story = |told_until: f64, lowered: bool| {
        let story = flight(AMT, 40.0)
            .turbine(40.0, 70.0, Phase::Cooling, 5000.0, 0.0)
            .says(PILOT, 40.0, 70.0, Word::Run(Ask::Throttle(500)))
            .wire(40.0, told_until, if lowered { IDLE } else { HALF })
            .wire(told_until, 70.0, STANDBY);
        story.with(|h| {
            for sample in h.samples.iter_mut().filter(|sample| sample.at >= 40 * SECOND) {
                sample.fault = true;
                sample.egt = 700.0 - 20.5 * (sample.at - 40 * SECOND) as f64 / SECOND as f64;
            }
        })
    };
    story(44.0, false).passes();
    story(50.0, false).breaks(&[Rule::RunAtRest]);
    // It may be the lower demand: then it has to be cold.
    story(60.0, true).passes();
}

#[test]
fn in_doubt_nothing_goes_out_that_could_start_an_engine() {
    let story = |kind, again: f64| {
        flight(kind, 40.0)
            .says(PILOT, 40.0, 70.0, Word::Run(Ask::Throttle(500)))
            .turbine(40.0, 70.0, Phase::Running, 100_000.0, 500.0)
            .wire(40.0, 40.2, HALF)
            .wire(again, 70.0, HALF)
    };
    // Nothing is heard of it.
    let cut = |h: &mut History| h.mute = Spans::from(&[(40 * SECOND, 41 * SECOND)]);
    story(ZK5, 41.5).with(cut).passes();
    story(ZK5, 41.1).with(cut).breaks(&[Rule::Doubt]);
    story(ZK5, 40.3).with(cut).breaks(&[Rule::Doubt]);
    // The node was reset.
    let reset = |h: &mut History| {
        h.resets.push(Reset { down: 40_200 * MS, up: 40_500 * MS, cause: Cause::Watchdog });
    };
    story(ZK5, 41.0).with(reset).passes();
    story(ZK5, 40.55).with(reset).breaks(&[Rule::Doubt]);
    // An AMT ECU says in one set that it runs.
    story(AMT, 40.55).with(reset).passes();
    // Damaged frames stand for frames for 10 s.
    let damaged = |h: &mut History| {
        (h.ruined, h.noise) =
            (Spans::from(&[(40 * SECOND, 55 * SECOND)]), Spans::from(&[(40 * SECOND, 55 * SECOND)]));
    };
    let nothing = |from: f64| {
        move |h: &mut History| {
            h.frames.retain(|frame| !(micros(from)..micros(55.6)).contains(&frame.at));
        }
    };
    story(ZK5, 40.2).with(damaged).with(nothing(50.1)).passes();
    story(ZK5, 40.2).with(damaged).with(nothing(52.0)).breaks(&[Rule::Doubt]);
}

#[test]
fn in_doubt_a_speed_goes_on() {
    let story = |told: Told| {
        let mut story = started(ZK5)
            .says(PILOT, 31.0, 60.0, Word::Run(Ask::Rpm(100_000)))
            .turbine(RUNS as f64, 60.0, Phase::Running, 100_000.0, 500.0)
            .with(|h| h.mute = Spans::from(&[(45 * SECOND, 55 * SECOND)]))
            .with(|h| h.frames.retain(|frame| frame.at < 31 * SECOND));
        for slot in 0..290_u64 {
            let at = 31.0 + slot as f64 * 0.1;
            let doubt = (45.2..56.0).contains(&at);
            let mode = if doubt { Told::Nothing } else { Told::Mode(Some(Switch::Run), 4) };
            story = story.wire(at, at + 0.01, if doubt { told } else { Told::Rpm(100_000) });
            story = story.wire(at + 0.05, at + 0.06, mode);
        }
        story
    };
    story(Told::Rpm(100_000)).passes();
    story(Told::Nothing).breaks(&[Rule::HeldDown]);
}

#[test]
fn a_start_that_is_asked_for_as_documented_begins() {
    let story = |told: Told| {
        Story::new(ZK5)
            .once(PILOT, 0.5, Word::Arm)
            .says(PILOT, 1.0, 14.0, Word::Standby)
            .says(PILOT, 14.0, 16.0, Word::Run(Ask::Throttle(0)))
            .wire(1.0, 14.1, STANDBY)
            .wire(14.1, 16.0, told)
            .turbine(0.0, 16.0, Phase::Standby, 0.0, 15.0)
    };
    story(IDLE).passes();
    story(STANDBY).breaks(&[Rule::Granted]);
    // A lower source that repeats standby uses up its own permission only, one that changes to it every other.
    story(STANDBY).says(2, 1.0, 16.0, Word::Standby).breaks(&[Rule::Granted]);
    story(STANDBY)
        .says(2, 1.0, 13.5, Word::Run(Ask::Throttle(0)))
        .says(2, 13.5, 16.0, Word::Standby)
        .passes();
    story(STANDBY).once(2, 13.0, Word::Disarm).passes();
}

#[test]
fn an_engine_that_is_shut_down_goes_out() {
    let story = |out: f64| {
        flight(ZK5, 60.0)
            .wire(60.0, 90.0, STANDBY)
            .turbine(60.0, out, Phase::Running, 60_000.0, 480.0)
            .turbine(out, 90.0, Phase::Cooling, 5000.0, 300.0)
    };
    let by_word = |word, out| story(out).once(PILOT, 60.0, word);
    by_word(Word::ShutDown, 60.2).passes();
    by_word(Word::ShutDown, 66.0).breaks(&[Rule::Obeyed]);
    let second = |h: &mut History| h.frames.retain(|f| !(micros(60.0)..micros(60.15)).contains(&f.at));
    let by_stream = |out| story(out).says(PILOT, 60.0, 90.0, Word::Standby).with(second);
    by_stream(60.3).passes();
    by_stream(80.0).breaks(&[Rule::Obeyed]);
    // A lower source's, when the stages of loss have run out.
    let by_lower = |out| story(out).says(2, 60.0, 90.0, Word::Standby).wire(60.0, 67.0, IDLE);
    let waits = |story: Story| {
        story.with(|h| h.frames.retain(|f| f.told != STANDBY || f.at < 60 * SECOND || f.at > 68 * SECOND))
    };
    waits(by_lower(68.1)).passes();
    waits(by_lower(85.0)).breaks(&[Rule::Obeyed]);
    let stopped =
        |h: &mut History| h.frames.iter_mut().filter(|f| f.at >= 60 * SECOND).for_each(|f| f.told = STOP);
    by_word(Word::Stop, 60.2).with(stopped).passes();
    by_word(Word::Stop, 66.0).with(stopped).breaks(&[Rule::Obeyed]);
    // The wire to it is cut.
    let cut = |h: &mut History| h.deaf = Spans::from(&[(59 * SECOND, 90 * SECOND)]);
    by_word(Word::ShutDown, 66.0).with(cut).passes();
}

/// A node that was reset did not hear the power-up, and the first set still says that the engine runs: with its shaft above half of
/// idle, as it is set, it is answered.
#[test]
fn a_first_set_that_is_stale_is_answered_while_the_shaft_turns() {
    let story = |rpm| {
        flight(AMT, 40.0)
            .with(|h| {
                h.unpowered = Spans::from(&[(40 * SECOND, 45 * SECOND)]);
                h.resets.push(Reset { down: 45_200 * MS, up: 45_350 * MS, cause: Cause::Watchdog });
                h.rules.stale = 1;
            })
            .turbine(40.0, 50.0, Phase::Cooling, rpm, 400.0)
            .says(PILOT, 40.0, 50.0, Word::Run(Ask::Throttle(500)))
            .wire(45.4, 45.5, HALF)
            .wire(45.6, 50.0, STANDBY)
    };
    story(15_000.0).passes();
    story(10_000.0).breaks(&[Rule::RunAtRest]);
}

/// A start that its ECU has not reported yet, and an outage that is shorter than a gap: at rest still fits, until a gap can be
/// seen.
#[test]
fn an_unreported_start_goes_on_until_a_gap_can_be_seen() {
    let story = |until: f64| {
        ready(ZK5)
            .says(PILOT, 4.0, 20.0, Word::Run(Ask::Throttle(0)))
            .wire(4.0, until, IDLE)
            .wire(until, 20.0, STANDBY)
            .mark(5.0, Mark::Ignition)
            .turbine(5.0, 5.15, Phase::Ignition, 1000.0, 20.0)
            .turbine(5.15, 20.0, Phase::Standby, 0.0, 20.0)
            .with(|h| {
                h.rules.boot = 50 * MS;
                h.unpowered = Spans::from(&[(5100 * MS, 5150 * MS)]);
                h.mute = Spans::from(&[(8 * SECOND, 12 * SECOND)]);
            })
    };
    story(8.2).passes();
    story(9.0).breaks_beside(&[Rule::Doubt], &[Rule::RunAtRest]);
}

#[test]
fn with_all_sources_silent_the_demand_goes_to_the_fail_safe() {
    let silent = |falls: bool| {
        let story = flight(ZK5, 40.0).turbine(46.0, 60.0, Phase::Running, 52_000.0, 480.0);
        let story = story.turbine(40.0, 46.0, Phase::Running, 80_000.0, 480.0);
        match falls {
            true => story.wire(40.0, 41.5, HALF).ramp(41.5, 500, 0).wire(42.6, 60.0, IDLE),
            false => story.wire(40.0, 60.0, HALF),
        }
    };
    silent(true).passes();
    silent(false).breaks(&[Rule::SilentWire]);
}

#[test]
fn with_all_sources_silent_a_start_ends() {
    let story = |ends: f64| {
        ready(ZK5)
            .says(PILOT, 4.0, 6.0, Word::Run(Ask::Throttle(0)))
            .wire(4.0, ends, IDLE)
            .wire(ends, 40.0, STANDBY)
            .mark(5.0, Mark::Ignition)
            .turbine(5.0, ends + 0.1, Phase::FuelRamp, 20_000.0, 400.0)
            .turbine(ends + 0.1, 40.0, Phase::Cooling, 5000.0, 300.0)
    };
    story(17.5).passes();
    story(25.0).breaks(&[Rule::SilentWire]);
}

#[test]
fn resets_do_not_keep_a_lost_demand_alive() {
    // Every 1.5 s a reset, and half throttle between them.
    let story = |until: u64| {
        let mut story = flight(ZK5, 40.0);
        let mut at = 40_000;
        while at < 58_000 {
            let from = at as f64 / 1000.0;
            let told = if at < until * 1000 { HALF } else { IDLE };
            story = story.wire(from + 0.75, from + 1.5, told).with(|h| {
                let reset = Reset { down: at * MS, up: (at + 300) * MS, cause: Cause::Watchdog };
                h.resets.push(reset);
            });
            at += 1500;
        }
        story.turbine(40.0, 50.0, Phase::Running, 100_000.0, 480.0).turbine(
            50.0,
            60.0,
            Phase::Running,
            52_000.0,
            480.0,
        )
    };
    story(46).passes();
    story(60).breaks(&[Rule::SilentWire]);
}

/// A node without memory begins with what its ECU obeys, which is what came to it last.
#[test]
fn a_node_that_loses_its_memory_late_begins_the_stages_with_what_it_finds() {
    let story = |arrived: bool, cause| {
        flight(ZK5, 40.0)
            .with(|h| h.mute = Spans::from(&[(39 * SECOND, 50 * SECOND)]))
            .wire(40.0, 41.5, if arrived { IDLE } else { Told::Nothing })
            .wire(41.5, 51.0, Told::Nothing)
            .with(|h| h.resets.push(Reset { down: 51 * SECOND, up: 51_500 * MS, cause }))
            .wire(52.5, 54.0, HALF)
            .ramp(54.0, 500, 0)
            .wire(55.1, 70.0, IDLE)
            .turbine(40.0, 55.0, Phase::Running, 100_000.0, 500.0)
            .turbine(55.0, 70.0, Phase::Running, 50_000.0, 500.0)
    };
    story(false, Cause::PowerOn).breaks_beside(&[Rule::Doubt], &[]);
    story(false, Cause::Watchdog).breaks_beside(&[Rule::Doubt], &[Rule::SilentWire]);
    story(true, Cause::PowerOn).breaks_beside(&[Rule::Doubt], &[Rule::SilentWire]);
}

#[test]
fn with_all_sources_silent_a_demand_that_does_not_reach_the_engine_ends_in_standby() {
    let story = |standby: bool| {
        let story = flight(ZK5, 40.0)
            .with(|h| h.mute = Spans::from(&[(39_800 * MS, 90 * SECOND)]))
            .wire(40.0, 52.0, Told::Nothing)
            .wire(52.0, 90.0, if standby { STANDBY } else { Told::Nothing })
            .turbine(40.0, 52.0, Phase::Running, 100_000.0, 500.0);
        match standby {
            true => story.turbine(52.0, 90.0, Phase::Cooling, 5000.0, 200.0),
            false => story.turbine(52.0, 90.0, Phase::Running, 100_000.0, 500.0),
        }
    };
    story(true).passes();
    story(false).breaks(&[Rule::SilentTurbine]);
}

#[test]
fn a_stop_is_in_every_frame_until_its_release() {
    let story = |kind, told: Told| {
        flight(kind, 40.0)
            .once(2, 40.0, Word::Stop)
            .wire(40.1, 45.0, STOP)
            .wire(45.0, 45.2, told)
            .wire(45.2, 50.0, STOP)
            .turbine(40.0, 50.0, Phase::Stopped, 0.0, 400.0)
    };
    for kind in [AMT, ZK5] {
        story(kind, STOP).passes();
        story(kind, STANDBY).breaks(&[Rule::Stop]);
    }
    // One frame to close the pump is a stop, two of them after each other are not.
    let close = |times: f64| {
        let gone = move |h: &mut History| {
            let closes = 45 * SECOND..micros(45.0 + times * 0.05);
            h.frames.retain(|f| f.told == Told::Action(13) || !closes.contains(&f.at));
        };
        story(ZK5, STOP).wire(45.0, 45.0 + times * 0.05, Told::Action(13)).with(gone)
    };
    close(1.0).passes();
    close(3.0).breaks(&[Rule::Stop]);
    // And not before the first stop.
    let first = |from: f64| {
        let shift = move |h: &mut History| h.frames.retain(|f| f.told != STOP || f.at > micros(from));
        story(ZK5, STOP).wire(40.05, 40.06, Told::Action(13)).with(shift)
    };
    first(40.0).with(|h| h.frames.retain(|f| f.told != Told::Action(13))).passes();
    first(40.1).breaks(&[Rule::Stop]);
}

#[test]
fn nothing_old_goes_out_after_a_transmitter_stood_still() {
    let story = |frames: u64| {
        let story = flight(ZK5, 40.0).says(PILOT, 40.0, 41.0, Word::Run(Ask::Throttle(500)));
        story.wire(40.0, 41.0, HALF).turbine(40.0, 41.5, Phase::Running, 100_000.0, 500.0).with(|h| {
            h.deaf = Spans::from(&[(39_500 * MS, 40_001 * MS)]);
            h.stalls = vec![40_001 * MS];
            let frame = h.frames[0];
            h.frames.extend((0..frames).map(|n| Frame { at: 40_002 * MS + n * 4 * MS, told: HALF, ..frame }));
        })
    };
    story(1).passes();
    story(8).breaks(&[Rule::Frame]);
}

#[test]
fn a_stop_is_on_the_wire_at_once_and_at_every_slot() {
    let story = |kind, from: f64, gap: f64| {
        flight(kind, 40.0)
            .once(2, 40.0, Word::Stop)
            .wire(40.0 + from, 42.0, STOP)
            .wire(42.0 + gap, 50.0, STOP)
            .turbine(40.0, 50.0, Phase::Stopped, 0.0, 400.0)
    };
    story(ZK5, 0.05, 0.0).passes();
    story(ZK5, 0.4, 0.0).breaks(&[Rule::Stop]);
    story(ZK5, 0.05, 1.0).breaks(&[Rule::Stop]);
    story(AMT, 0.1, 1.0).breaks(&[Rule::Stop]);
    // A ZK ECU that is not heard is told all the same; an AMT ECU that says nothing cannot be answered.
    let mute = |h: &mut History| h.mute = Spans::from(&[(41 * SECOND, 44 * SECOND)]);
    story(ZK5, 0.05, 1.0).with(mute).breaks(&[Rule::Stop]);
    story(AMT, 0.1, 1.0).with(mute).passes();
    // After a reset, too.
    let reset = |h: &mut History| {
        h.resets.push(Reset { down: 42 * SECOND, up: 42_500 * MS, cause: Cause::Watchdog });
    };
    story(ZK5, 0.05, 0.6).with(reset).passes();
    story(ZK5, 0.05, 6.0).with(reset).breaks(&[Rule::Stop]);
    // Nothing leaves a transmitter that stands still. A wire that is cut is another matter: what is sent is on it.
    let deaf = |h: &mut History| h.deaf = Spans::from(&[(42 * SECOND, 43 * SECOND)]);
    let stall = |h: &mut History| h.stalls = vec![43 * SECOND];
    story(ZK5, 0.05, 1.0).with(deaf).with(stall).passes();
    story(ZK5, 0.05, 1.0).with(deaf).breaks(&[Rule::Stop]);
    story(ZK5, 0.05, 1.5).with(deaf).with(stall).breaks(&[Rule::Stop]);
}

#[test]
fn no_fuel_flows_into_a_hot_engine_at_rest() {
    let story = |egt| Story::new(ZK5).turbine(0.0, 10.0, Phase::Cooling, 5000.0, egt).fuel(4.0, 6.0);
    story(60.0).passes();
    story(300.0).breaks(&[Rule::HotFuel]);
}

#[test]
fn services_that_move_fuel_are_asked_for_in_standby_cold_and_armed() {
    let pump = Told::Action(5);
    let story = |word| ready(ZK5).once(PILOT, 2.0, word).wire(2.05, 2.06, pump).wire(4.0, 5.0, STANDBY);
    story(Word::Service(5)).passes();
    story(Word::Service(4)).breaks(&[Rule::Service]);
    let disarmed = |h: &mut History| h.said.retain(|said| said.word != Word::Arm);
    story(Word::Service(5)).with(disarmed).breaks(&[Rule::Service]);
    let cooling = |h: &mut History| h.samples.iter_mut().for_each(|sample| sample.phase = Phase::Cooling);
    story(Word::Service(5)).with(cooling).breaks(&[Rule::Service]);
    let hot = |h: &mut History| h.samples.iter_mut().for_each(|sample| sample.egt = 130.0);
    story(Word::Service(5)).with(hot).breaks(&[Rule::Service]);
}

#[test]
fn an_open_pump_is_closed_when_its_source_falls_silent_and_at_a_disarm() {
    let story = |spoken: f64, flows: f64| {
        Story::new(ZK5)
            .once(PILOT, 0.5, Word::Arm)
            .says(PILOT, 0.0, spoken, Word::Standby)
            .once(PILOT, 2.0, Word::Service(12))
            .wire(0.0, 2.0, STANDBY)
            .wire(2.05, 2.06, Told::Action(12))
            .wire(2.1, 40.0, STANDBY)
            .turbine(0.0, 60.0, Phase::Standby, 0.0, 15.0)
            .fuel(2.1, flows)
    };
    story(20.0, 21.0).passes();
    story(5.0, 20.0).breaks(&[Rule::Pump]);
    story(20.0, 12.0).once(PILOT, 10.0, Word::Disarm).passes();
    story(20.0, 16.0).once(PILOT, 10.0, Word::Disarm).breaks(&[Rule::Pump]);
    // Its bound in time.
    story(50.0, 50.0).breaks(&[Rule::Pump]);
}

#[test]
fn a_demand_rises_at_a_rate_unless_a_pilot_moves_the_stick() {
    // The stick was up during the start.
    let up = |jumps: bool| {
        let story = started(ZK5)
            .says(PILOT, 15.0, 40.0, Word::Run(Ask::Throttle(800)))
            .turbine(RUNS as f64, 40.0, Phase::Running, 100_000.0, 500.0)
            .with(|h| {
                h.said.retain(|said| said.at < 15 * SECOND || said.word != Word::Run(Ask::Throttle(0)))
            });
        match jumps {
            true => story.wire(31.0, 40.0, Told::Full(Switch::Run, 800)),
            false => story.ramp(31.0, 0, 800).wire(32.8, 40.0, Told::Full(Switch::Run, 800)),
        }
    };
    up(false).passes();
    up(true).breaks(&[Rule::Rate]);
    // A pilot who moves it, with and without a slew.
    let moved = || {
        started(ZK5)
            .says(PILOT, 31.0, 40.0, Word::Run(Ask::Throttle(800)))
            .says(PILOT, 30.5, 31.0, Word::Run(Ask::Throttle(0)))
            .wire(31.0, 40.0, Told::Full(Switch::Run, 800))
            .turbine(RUNS as f64, 40.0, Phase::Running, 100_000.0, 500.0)
    };
    moved().passes();
    moved().with(|h| h.rules.slew_up = Some(500)).breaks(&[Rule::Rate]);
}

/// With the wire to the ECU cut, standby is not obeyed. A node that has lost its memory goes on with the throttle that it finds.
#[test]
fn a_node_without_memory_goes_on_with_the_throttle_that_it_finds() {
    let story = |cause, tenths, arrived| {
        flight(ZK5, 40.0)
            .once(PILOT, 40.0, Word::ShutDown)
            .wire(40.05, 42.0, STANDBY)
            .wire(42.6, 46.0, Told::Full(Switch::Run, tenths))
            .turbine(40.0, 46.0, Phase::Running, 100_000.0, 500.0)
            .with(|h| {
                h.resets.push(Reset { down: 42 * SECOND, up: 42_500 * MS, cause });
                h.deaf = Spans::from(&[(40 * SECOND, 50 * SECOND)]);
                for frame in h.frames.iter_mut().filter(|frame| frame.at > 40_050 * MS) {
                    frame.arrived = arrived;
                }
            })
    };
    story(Cause::PowerOn, 500, false).breaks_beside(&[Rule::Doubt], &[]);
    story(Cause::PowerOn, 800, false).breaks_beside(&[Rule::Doubt], &[Rule::Rate]);
    story(Cause::Watchdog, 500, false).breaks_beside(&[Rule::Doubt], &[Rule::Rate]);
    story(Cause::PowerOn, 500, true).breaks_beside(&[Rule::Doubt], &[Rule::Rate]);
    // A throttle that has come to an ECU which holds a speed is not obeyed before the ID 6 that ends that. The throttle that it
    // reports is that of the speed.
    let speed = |mode: bool| {
        flight(ZK5, 40.0)
            .with(|h| h.frames.retain(|frame| frame.at < 39 * SECOND))
            .says(PILOT, 39.0, 40.0, Word::Run(Ask::Rpm(140_000)))
            .wire(39.0, 39.01, Told::Mode(Some(Switch::Run), 4))
            .wire(39.05, 40.0, Told::Rpm(140_000))
            .says(PILOT, 40.0, 45.0, Word::Run(Ask::Throttle(200)))
            .wire(40.0, 40.04, Told::Full(Switch::Run, 200))
            .wire(40.05, 40.06, if mode { Told::Mode(Some(Switch::Run), 0) } else { Told::Nothing })
            .wire(40.1, 40.14, if mode { Told::Full(Switch::Run, 200) } else { Told::Nothing })
            .wire(40.7, 41.0, Told::Full(Switch::Run, 700))
            .wire(41.0, 45.0, Told::Full(Switch::Run, 200))
            .turbine(40.0, 45.0, Phase::Running, 100_000.0, 500.0)
            .with(|h| h.resets.push(Reset { down: 40_150 * MS, up: 40_250 * MS, cause: Cause::PowerOn }))
    };
    speed(false).breaks_beside(&[Rule::Doubt], &[]);
    speed(true).breaks_beside(&[Rule::Doubt], &[Rule::Rate]);
}

#[test]
fn a_running_engine_is_shut_down_by_two_words_or_by_one_of_a_person() {
    let story = |words: &[(f64, Word)]| {
        let mut story = flight(ZK5, 40.0)
            .wire(40.3, 45.0, STANDBY)
            .turbine(40.0, 40.5, Phase::Running, 100_000.0, 500.0)
            .turbine(40.5, 45.0, Phase::Cooling, 5000.0, 300.0)
            .wire(40.0, 40.3, HALF);
        for &(at, word) in words {
            story = story.once(0, at, word);
        }
        story.says(PILOT, 40.0, 45.0, Word::Run(Ask::Throttle(500)))
    };
    story(&[(40.0, Word::Standby), (40.2, Word::Standby)]).passes();
    story(&[(40.2, Word::ShutDown)]).passes();
    // Decided a slot before another word came.
    story(&[(40.05, Word::Standby), (40.25, Word::Standby), (40.29, Word::Run(Ask::Throttle(0)))]).passes();
    story(&[(40.2, Word::Standby)]).breaks(&[Rule::ShutDown]);
    // One word of a higher source that has yet to take over, and is silent again.
    let word = |at, until| {
        let story = flight(ZK5, 40.0).says(0, 20.0, at, Word::Nothing);
        story
            .says(0, at, until, Word::Run(Ask::Throttle(500)))
            .says(PILOT, 40.0, 45.0, Word::Standby)
            .wire(40.0, 40.6, HALF)
            .wire(40.6, 45.0, STANDBY)
            .turbine(40.0, 45.0, Phase::Running, 100_000.0, 500.0)
    };
    word(40.0, 40.01).passes();
    word(37.0, 40.01).breaks(&[Rule::ShutDown]);
    story(&[(37.0, Word::Standby), (40.2, Word::Standby)]).breaks(&[Rule::ShutDown]);
    story(&[]).breaks(&[Rule::ShutDown]);
}

/// A node that is reset again and again, each time before two reports agree, knows of a start only what it knew before: a
/// disarm ends it.
#[test]
fn a_node_in_a_reset_loop_cannot_know_that_a_start_has_reached_running() {
    let story = |resets_from: u64| {
        let resets = (resets_from * 2..80).map(|half| Reset {
            down: half * SECOND / 2,
            up: half * SECOND / 2 + 20 * MS,
            cause: Cause::Watchdog,
        });
        flight(ZK5, 40.0)
            .once(PILOT, 40.0, Word::Disarm)
            .wire(40.0, 45.0, STANDBY)
            .turbine(40.0, 45.0, Phase::Running, 60_000.0, 480.0)
            .says(PILOT, 40.0, 45.0, Word::Run(Ask::Throttle(500)))
            .with(|h| h.resets = resets.collect())
    };
    story(29).breaks_beside(&[Rule::Doubt], &[]);
    // It ran before the loop for long enough.
    story(34).breaks_beside(&[Rule::Doubt], &[Rule::ShutDown]);
}

#[test]
fn a_lower_sources_standby_waits_for_the_stages_of_loss() {
    let story = |standby: f64| {
        flight(ZK5, 40.0)
            .says(2, 20.0, 60.0, Word::Standby)
            .wire(40.0, 41.5, HALF)
            .ramp(41.5, 500, 0)
            .wire(42.6, standby, IDLE)
            .wire(standby, 60.0, STANDBY)
            .turbine(40.0, standby + 0.1, Phase::Running, 60_000.0, 480.0)
            .turbine(standby + 0.1, 60.0, Phase::Cooling, 5000.0, 300.0)
    };
    story(48.0).passes();
    story(43.0).breaks(&[Rule::ShutDown]);
    // One that has spoken again for as long as it takes until just now was not in control when it was decided.
    let back = |from| story(47.9).says(PILOT, from, 59.9, Word::Run(Ask::Throttle(0)));
    back(44.88).passes();
    back(43.0).breaks(&[Rule::ShutDown]);
}

#[test]
fn silence_shuts_an_engine_down_only_where_that_is_configured() {
    let story = || {
        flight(ZK5, 40.0)
            .wire(40.0, 41.5, HALF)
            .ramp(41.5, 500, 0)
            .wire(42.6, 46.0, IDLE)
            .wire(46.0, 60.0, STANDBY)
            .turbine(40.0, 46.1, Phase::Running, 60_000.0, 480.0)
            .turbine(46.1, 60.0, Phase::Cooling, 5000.0, 300.0)
    };
    story().breaks(&[Rule::ShutDown]);
    story().with(|h| h.rules.standby_after = Some(4 * SECOND)).passes();
    // Who is present and wants nothing is silent from then on, and not from an age limit later.
    let late = |h: &mut History| {
        h.rules.standby_after = Some(5 * SECOND);
        h.rules.ages = [SECOND; 4];
    };
    story().with(late).breaks(&[Rule::ShutDown]);
    story().with(late).says(PILOT, 40.0, 60.0, Word::Nothing).passes();
}

#[test]
fn a_limit_with_standby_is_exempt_and_counted() {
    let story = flight(ZK5, 40.0)
        .says(PILOT, 40.0, 45.0, Word::Run(Ask::Throttle(500)))
        .wire(40.0, 45.0, STANDBY)
        .turbine(40.0, 41.0, Phase::Running, 100_000.0, 900.0)
        .turbine(41.0, 45.0, Phase::Cooling, 5000.0, 300.0)
        .with(|h| h.rules.limit_egt = Some((800.0, true)));
    let verdict = story.judged();
    assert_eq!(verdict.rules(), []);
    let exempt = verdict.exempt["a limit whose action is standby"];
    assert!((900 * MS..=1100 * MS).contains(&exempt), "{exempt}");
    assert!((10 * SECOND..12 * SECOND).contains(&verdict.applied), "{}", verdict.applied);
}

#[test]
fn an_ecu_does_not_put_out_an_engine_for_want_of_commands() {
    let story = |kind| {
        flight(kind, 40.0)
            .says(PILOT, 40.0, 45.0, Word::Run(Ask::Throttle(500)))
            .mark(40.0, Mark::GivenUp)
            .turbine(40.0, 45.0, Phase::Cooling, 50_000.0, 400.0)
            .wire(40.0, 45.0, STANDBY)
    };
    for kind in [AMT, Kind::Zk(3)] {
        story(kind).breaks(&[Rule::GivenUp]);
        // A wire that is cut is exempt.
        let cut = |h: &mut History| {
            h.deaf = Spans::from(&[(37_500 * MS, 41 * SECOND)]);
            h.frames.retain(|frame| !(37_700 * MS..40 * SECOND).contains(&frame.at));
        };
        story(kind).with(cut).passes();
    }
    // A gap of the node that the ECU has to put up with is none.
    let reset = |length: u64| {
        let down = 38 * SECOND;
        move |h: &mut History| h.resets.push(Reset { down, up: down + length * MS, cause: Cause::Watchdog })
    };
    story(AMT).with(reset(800)).breaks(&[Rule::GivenUp]);
    story(AMT).with(reset(950)).breaks(&[Rule::GivenUp]);
    story(AMT).with(reset(1000)).passes();
    story(AMT).with(reset(2100)).passes();
    // After a loss of power, with error sets only, nobody knows whether it runs. Another reset is no excuse, whatever the exhaust.
    let faults = |h: &mut History| {
        for sample in h.samples.iter_mut().filter(|sample| sample.at >= 37 * SECOND) {
            sample.fault = true;
        }
    };
    let early = |cause| {
        move |h: &mut History| {
            let down = 37_200 * MS;
            h.frames.retain(|frame| frame.at < down);
            h.resets.push(Reset { down, up: down + 50 * MS, cause });
        }
    };
    story(AMT).with(faults).with(early(Cause::PowerOn)).passes();
    story(AMT).with(early(Cause::PowerOn)).breaks(&[Rule::GivenUp]);
    story(AMT).with(faults).with(early(Cause::Watchdog)).breaks(&[Rule::GivenUp]);
    story(AMT).with(faults).breaks(&[Rule::GivenUp]);
    story(AMT).with(early(Cause::Watchdog)).breaks(&[Rule::GivenUp]);
}

#[test]
fn a_demand_is_not_held_below_what_is_asked_for() {
    let story = |tenths| {
        flight(ZK5, 40.0)
            .says(PILOT, 40.0, 60.0, Word::Run(Ask::Throttle(500)))
            .wire(40.0, 60.0, Told::Full(Switch::Run, tenths))
            .turbine(40.0, 60.0, Phase::Running, 80_000.0, 500.0)
    };
    story(500).passes();
    story(480).breaks(&[Rule::HeldDown]);
    // A source that comes back after a short gap goes on without a take-over.
    let comes_back = |low: f64| {
        flight(ZK5, 50.0)
            .says(PILOT, 50.9, 65.0, Word::Run(Ask::Throttle(500)))
            .wire(50.0, 50.9, HALF)
            .wire(50.9, 50.9 + low, Told::Full(Switch::Run, 300))
            .ramp(50.9 + low, 300, 500)
            .wire(51.35 + low, 65.0, HALF)
            .turbine(50.0, 65.0, Phase::Running, 80_000.0, 500.0)
    };
    comes_back(0.1).passes();
    comes_back(4.0).breaks(&[Rule::HeldDown]);
    // Nothing of it on the wire.
    flight(ZK5, 40.0)
        .says(PILOT, 40.0, 60.0, Word::Run(Ask::Throttle(500)))
        .wire(40.0, 60.0, Told::Nothing)
        .turbine(40.0, 60.0, Phase::Running, 80_000.0, 500.0)
        .breaks(&[Rule::HeldDown]);
    // A transmitter that stands still for less than the ECU waits.
    let stalls = |from: u64, to: u64| {
        let stalls = move |h: &mut History| {
            h.frames.retain(|frame| !(from..to).contains(&frame.at));
            h.deaf = Spans::from(&[(from, to)]);
        };
        story(500).with(stalls)
    };
    stalls(50 * SECOND, 51_900 * MS).passes();
    let silent = |h: &mut History| h.deaf = Spans::default();
    stalls(50 * SECOND, 51_900 * MS).with(silent).breaks(&[Rule::HeldDown]);
}

/// A flame-out passes a limit of how values change. The ECU lights it again in the same life, and the limit holds until standby.
#[test]
fn a_limit_holds_the_demand_of_an_engine_that_was_lit_again() {
    let story = || {
        flight(ZK5, 40.0)
            .says(PILOT, 40.0, 90.0, Word::Run(Ask::Throttle(500)))
            .wire(40.0, 41.0, HALF)
            .ramp(41.0, 500, 0)
            .wire(42.1, 90.0, IDLE)
            .turbine(40.0, 42.0, Phase::Running, 60_000.0, 450.0)
            .with(|h| {
                h.samples.iter_mut().filter(|sample| sample.at >= 40 * SECOND).for_each(|s| s.lit = false)
            })
            .mark(42.0, Mark::Relight)
            .turbine(42.0, 60.0, Phase::FuelRamp, 30_000.0, 450.0)
            .turbine(60.0, 90.0, Phase::Running, 50_000.0, 450.0)
    };
    story().with(|h| h.rules.limit_change = Some(false)).passes();
    story().breaks(&[Rule::HeldDown]);
}

#[test]
fn the_pwm_input_is_given_the_engine_when_a_pilot_says_so() {
    let pwm = Told::Full(Switch::Pwm, 0);
    let story = || ready(ZK5).wire(4.0, 10.0, pwm).turbine(5.0, 10.0, Phase::Standby, 0.0, 15.0);
    story().once(PILOT, 4.0, Word::Pwm).passes();
    story().breaks(&[Rule::Pwm]);
    story().once(2, 4.0, Word::Pwm).breaks(&[Rule::Pwm]);
    let disarmed = |h: &mut History| h.said.retain(|said| said.word != Word::Arm);
    story().once(PILOT, 4.0, Word::Pwm).with(disarmed).breaks(&[Rule::Pwm]);
    // For one life of the ECU.
    let dip = |h: &mut History| h.unpowered = Spans::from(&[(6 * SECOND, 7 * SECOND)]);
    story().once(PILOT, 4.0, Word::Pwm).with(dip).breaks(&[Rule::Pwm]);
}

#[test]
fn nothing_is_sent_that_the_ecus_version_does_not_know() {
    let story = |kind, told| ready(kind).wire(4.0, 5.0, told);
    let by_id6 = |switch| Told::Mode(Some(switch), 0);
    story(Kind::Zk(4), by_id6(Switch::Standby)).passes();
    story(Kind::Zk(3), by_id6(Switch::Standby)).passes();
    for told in [Told::Rpm(60_000), Told::Mode(None, 3)] {
        story(Kind::Zk(4), told).passes();
        story(Kind::Zk(3), told).breaks(&[Rule::Version]);
    }
    // Another ECU was plugged in while the line was dead.
    let story =
        ready(Kind::Zk(5)).wire(4.0, 20.0, Told::Mode(None, 3)).turbine(5.0, 20.0, Phase::Standby, 0.0, 15.0);
    let swapped = |h: &mut History| {
        h.unpowered = Spans::from(&[(6 * SECOND, 9 * SECOND)]);
        h.versions = vec![(6 * SECOND, 3)];
    };
    story.with(swapped).breaks(&[Rule::Version]);
}

#[test]
fn every_frame_is_one_of_the_document() {
    ready(AMT).wire(4.0, 4.1, Told::Bad([0xFF, 0x14, 0x20, 0x14, 0x21])).breaks(&[Rule::Frame]);
}

#[test]
fn a_limit_that_is_passed_has_its_action() {
    let story = |tenths, egt, standby| {
        flight(ZK5, 40.0)
            .says(PILOT, 40.0, 60.0, Word::Run(Ask::Throttle(500)))
            .wire(40.0, 41.0, HALF)
            .ramp(41.0, 500, tenths)
            .wire(if tenths == 500 { 41.05 } else { 42.1 }, 60.0, Told::Full(Switch::Run, tenths))
            .turbine(40.0, 60.0, Phase::Running, 100_000.0, egt)
            .with(move |h| h.rules.limit_egt = Some((600.0, standby)))
    };
    story(0, 640.0, false).passes();
    story(500, 560.0, false).passes();
    story(500, 640.0, false).breaks(&[Rule::Limit]);
    story(500, 640.0, true).breaks(&[Rule::Limit]);
    let rpm = |h: &mut History| {
        h.rules.limit_egt = None;
        h.rules.limit_rpm = Some((80_000.0, false));
        for sample in h.samples.iter_mut().filter(|sample| sample.at < 40 * SECOND) {
            sample.rpm = 70_000.0;
        }
    };
    story(500, 500.0, false).with(rpm).breaks(&[Rule::Limit]);
    story(0, 500.0, false).with(rpm).passes();
}

#[test]
fn a_demand_is_reduced_while_another_engine_has_failed() {
    let story = |tenths| {
        flight(ZK5, 40.0)
            .says(PILOT, 40.0, 60.0, Word::Run(Ask::Throttle(500)))
            .ramp(40.0, 500, tenths)
            .wire(41.0, 60.0, Told::Full(Switch::Run, tenths))
            .turbine(40.0, 60.0, Phase::Running, 80_000.0, 500.0)
            .with(|h| {
                h.rules.when_other_fails = Some(500);
                h.other_down = Spans::from(&[(40 * SECOND, 70 * SECOND)]);
                h.other_failed = h.other_down.clone();
            })
    };
    story(250).passes();
    story(500).breaks(&[Rule::Reduction]);
}

#[test]
fn a_source_that_takes_over_is_held_off() {
    let story = |wait: f64| {
        flight(ZK5, 60.0)
            .says(PILOT, 60.0, 70.0, Word::Run(Ask::Throttle(500)))
            .says(0, 60.0, 70.0, Word::Run(Ask::Throttle(200)))
            .wire(60.0, 60.0 + wait, HALF)
            .wire(60.0 + wait, 70.0, Told::Full(Switch::Run, 200))
            .turbine(60.0, 70.0, Phase::Running, 80_000.0, 500.0)
    };
    story(2.0).passes();
    story(0.1).breaks(&[Rule::TakeOver]);
    // The demand of one that is lost meanwhile falls.
    let lost = flight(ZK5, 60.0)
        .says(PILOT, 60.0, 60.3, Word::Run(Ask::Throttle(500)))
        .says(0, 60.0, 70.0, Word::Run(Ask::Throttle(200)))
        .wire(60.0, 60.8, HALF)
        .ramp(60.8, 500, 400)
        .wire(61.0, 62.0, Told::Full(Switch::Run, 400))
        .wire(62.0, 70.0, Told::Full(Switch::Run, 200))
        .turbine(60.0, 70.0, Phase::Running, 80_000.0, 500.0);
    lost.with(|h| h.rules.hold = 0).passes();
}

//! When each engine is started and shut down, calculated from its turbine's times.

use super::engines::Engine;
use super::faults::{Cut, Failure, Faults};
use super::quantity::seconds;
use super::simulated::parameters;
use embassy_time::{Duration, Instant};

/// Duration of a run unless `--duration` sets another, or the engines need longer.
const USUAL_LENGTH: Duration = Duration::from_secs(180);
/// The first start.
const FIRST_START: Duration = Duration::from_secs(3);
/// Shortest time of an engine between its start and its shutdown.
pub const LEAST_RUNNING: Duration = Duration::from_secs(20);
/// Between the end of the faults and the first shutdown, to see that all recovers.
const RECOVERY: Duration = Duration::from_secs(15);
/// Shortest length of a run without a start.
const SHORTEST_STANDBY: Duration = Duration::from_secs(2);

/// The times of a run.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Total length aimed at; `None`: it lasts until somebody ends it.
    pub length: Option<Duration>,
    /// What commands the engines.
    pub flown_by: FlownBy,
    /// Of each engine.
    pub engines: Vec<EnginePlan>,
}

/// What commands the engines of a run.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum FlownBy {
    /// Pilots, that start, fly and shut down.
    Pilots,
    /// Pilots that start no engine.
    PilotsInStandby,
    /// MAVLink or radio control: nobody knows when.
    Outside,
}

/// The times of one engine.
#[derive(Clone, Copy, Debug)]
pub struct EnginePlan {
    /// When its start is commanded.
    pub start_at: Instant,
    /// What a start takes, roughly.
    pub start_takes: Duration,
    /// When it is shut down.
    pub shutdown_at: Instant,
    /// What shutdown and cooling take, roughly.
    pub cooling_takes: Duration,
    /// Time from which its source may fall silent for a while, if it should.
    pub silent_at: Option<Instant>,
}

impl Plan {
    /// For these engines. Completes `faults`: on the lines they end before the first shutdown.
    pub fn new(
        engines: &[Engine],
        length: Option<Duration>,
        flown_by: FlownBy,
        faults: &mut Faults,
    ) -> Result<Self, String> {
        match flown_by {
            FlownBy::Pilots => {}
            FlownBy::PilotsInStandby => return Self::standby(engines.len(), length, faults),
            FlownBy::Outside => return Self::outside(engines.len(), length, faults),
        }
        let mut start_at = Instant::MIN + FIRST_START;
        let mut plans: Vec<EnginePlan> = engines
            .iter()
            .map(|engine| {
                let p = parameters(engine);
                let start = p.ignition_s + p.preheat_s + p.ramp_s + p.learn_s + 4.0;
                // From idle to 100 °C, and until the shaft is at rest.
                let cooling = 1.8 * p.cooling_s + 9.0;
                let plan = EnginePlan {
                    start_at,
                    start_takes: Duration::from_millis((start * 1000.0) as u64),
                    shutdown_at: Instant::MIN,
                    cooling_takes: Duration::from_millis((cooling * 1000.0) as u64),
                    silent_at: None,
                };
                // The node starts one engine of a group after the other.
                start_at += plan.start_takes;
                plan
            })
            .collect();
        let needed = |plan: &EnginePlan| {
            (plan.start_at - Instant::MIN) + plan.start_takes + LEAST_RUNNING + plan.cooling_takes
        };
        let shortest = plans.iter().map(needed).max().unwrap_or(Duration::MIN);
        let shortest = Duration::from_secs(shortest.as_millis().div_ceil(1000));
        let length = length.unwrap_or(USUAL_LENGTH.max(shortest + LEAST_RUNNING));
        if length < shortest {
            return Err(format!(
                "--duration {} is too short: starting, running and cooling these engines takes at least {}s",
                text(length),
                shortest.as_secs()
            ));
        }
        for plan in &mut plans {
            plan.shutdown_at = Instant::MIN + (length - plan.cooling_takes);
        }
        let first_shutdown = plans.iter().map(|plan| plan.shutdown_at).min().unwrap_or(Instant::MIN);
        let latest_end = (first_shutdown - Instant::MIN) - RECOVERY;
        end_of_faults(faults, latest_end)?;
        Ok(Self { length: Some(length), flown_by, engines: plans })
    }

    /// The source of the first engine falls silent for a while when all engines run: what the run without options shows.
    pub fn with_a_silence(mut self) -> Self {
        let all_run = self.engines.iter().map(|plan| plan.start_at + plan.start_takes).max();
        if let (Some(first), Some(at)) = (self.engines.first_mut(), all_run) {
            first.silent_at = Some(at);
        }
        self
    }

    /// Checks that the flame of this engine burns at this time, as its pilot flies it.
    pub fn burns(&self, engine: usize, config: &Engine, at: Duration) -> Result<(), String> {
        let Some(times) = self.engines.get(engine) else { return Ok(()) };
        match self.flown_by {
            FlownBy::Pilots => {}
            FlownBy::PilotsInStandby => return Err("no engine is started".to_owned()),
            FlownBy::Outside => return Ok(()),
        }
        let lit = times.start_at - Instant::MIN + lights_after(config);
        let out = times.shutdown_at - Instant::MIN;
        if (lit..out).contains(&at) {
            return Ok(());
        }
        Err(format!("its flame burns from about {:.0} s to {:.0} s in this run", seconds(lit), seconds(out)))
    }

    /// The flame-out after which it cannot burn yet at this time, and when it does at the earliest: it cools, and is started again.
    pub fn out_until(
        &self,
        engine: usize,
        config: &Engine,
        mut others: impl Iterator<Item = Duration>,
        at: Duration,
    ) -> Option<(Duration, Duration)> {
        let times = self.engines.get(engine).filter(|_| self.flown_by == FlownBy::Pilots)?;
        let again = times.cooling_takes + lights_after(config);
        let first = others.find(|&first| (first..first + again).contains(&at))?;
        Some((first, first + again))
    }

    fn standby(engines: usize, length: Option<Duration>, faults: &mut Faults) -> Result<Self, String> {
        let length = length.unwrap_or(Duration::from_secs(10));
        if length < SHORTEST_STANDBY {
            return Err(format!(
                "--duration {} is too short: with --standby it is at least {}",
                text(length),
                text(SHORTEST_STANDBY)
            ));
        }
        // The last third is for the recovery.
        end_of_faults(faults, length * 2 / 3)?;
        Ok(Self {
            length: Some(length),
            flown_by: FlownBy::PilotsInStandby,
            engines: no_start(engines, Instant::MIN + length),
        })
    }

    /// Faults on the lines may last to the end: somebody flies who may want them so.
    fn outside(engines: usize, length: Option<Duration>, faults: &Faults) -> Result<Self, String> {
        let too_late = |time: Duration| length.is_some_and(|length| time >= length);
        if faults.on_lines() && too_late(faults.from) {
            return Err("--faults: `from` has to be earlier than --duration".to_owned());
        }
        Ok(Self { length, flown_by: FlownBy::Outside, engines: no_start(engines, Instant::MAX) })
    }
}

/// Times of engines that no pilot starts.
fn no_start(engines: usize, end: Instant) -> Vec<EnginePlan> {
    let plan = EnginePlan {
        start_at: Instant::MIN,
        start_takes: Duration::MIN,
        shutdown_at: end,
        cooling_takes: Duration::MIN,
        silent_at: None,
    };
    vec![plan; engines]
}

/// The faults on the lines end in time, or the command line is wrong.
fn end_of_faults(faults: &mut Faults, latest: Duration) -> Result<(), String> {
    if !faults.on_lines() {
        return Ok(());
    }
    let until = *faults.until.get_or_insert(latest);
    if until > latest {
        return Err(format!(
            "--faults: `until` has to be {} or earlier in this run, so that recovery can be seen",
            text(latest)
        ));
    }
    if faults.from >= until {
        return Err(format!(
            "--faults: `from` has to be earlier than the end of the faults, which is {} in this run",
            text(until)
        ));
    }
    Ok(())
}

fn text(time: Duration) -> String {
    format!("{}s", time.as_millis() as f64 / 1e3)
}

impl Faults {
    /// The first of them that comes after this end of the run, which a script file sets.
    pub fn after(&self, end: Duration, engines: &[Engine]) -> Option<String> {
        let name = |engine: usize| engines.get(engine).map_or("?", Engine::name);
        let at = |what: &str, engine: usize, at: Duration| {
            (at >= end).then(|| format!("the {what} of {} at {} s", name(engine), seconds(at)))
        };
        let noise = (self.on_lines() && self.from >= end)
            .then(|| format!("the noise from {} s on", seconds(self.from)));
        let cuts = self.cuts.iter().filter_map(|cut| at("cut", cut.engine, cut.at));
        let failures = self.failures.iter().filter_map(|&(engine, failure)| match failure {
            Failure::FlameOut(when) => at("flame-out", engine, when),
            Failure::HotStart | Failure::NoLight => None,
        });
        let first = noise.into_iter().chain(cuts).chain(failures).next()?;
        Some(format!("{first} comes after the end of the run at {} s", seconds(end)))
    }

    /// Whether each of them can act in this run.
    pub fn check(&self, plan: &Plan, engines: &[Engine]) -> Result<(), String> {
        let name = |engine: usize| engines.get(engine).map_or("?", Engine::name);
        let after_the_end = |what: &str, engine: usize, at: Duration| match plan.length {
            Some(length) if at >= length => Err(format!(
                "--faults: {what} of {} at {} s comes after the end of the run at {} s",
                name(engine),
                seconds(at),
                seconds(length)
            )),
            _ => Ok(()),
        };
        self.cuts.iter().try_for_each(|cut| after_the_end("the cut", cut.engine, cut.at))?;
        for (i, &(engine, failure)) in self.failures.iter().enumerate() {
            match plan.flown_by {
                FlownBy::Pilots => {}
                FlownBy::PilotsInStandby => {
                    return Err(format!(
                        "--faults: {} cannot act with --standby: no engine is started",
                        failure.name()
                    ));
                }
                FlownBy::Outside => {
                    if let Failure::FlameOut(at) = failure {
                        after_the_end("the flame-out", engine, at)?;
                    }
                    continue;
                }
            }
            let (Some(times), Some(config)) = (plan.engines.get(engine), engines.get(engine)) else {
                continue;
            };
            let Failure::FlameOut(at) = failure else {
                // The command to run has to reach the ECU at some time.
                let covers = |cut: &&Cut| {
                    cut.engine == engine
                        && Instant::MIN + cut.at <= times.start_at
                        && Instant::MIN + cut.at + cut.length >= times.shutdown_at
                };
                if let Some(cut) = self.cuts.iter().find(covers) {
                    return Err(format!(
                        "--faults: {} of {} cannot act: its line is cut until {} s, and no start comes through",
                        failure.name(),
                        name(engine),
                        seconds(cut.at + cut.length)
                    ));
                }
                continue;
            };
            plan.burns(engine, config, at).map_err(|what| {
                format!("--faults: flame-out of {} at {} s: {what}", name(engine), seconds(at))
            })?;
            if let Some((cut, again)) = self.stopped_by_a_cut(engine, config, times, at) {
                return Err(format!(
                    "--faults: flame-out of {} at {} s: after the cut at {} s its flame burns again from about {:.0} s",
                    name(engine),
                    seconds(at),
                    seconds(cut),
                    seconds(again)
                ));
            }
            let others = self.failures.iter().enumerate().filter(|(j, (of, _))| *j != i && *of == engine);
            let others = others.filter_map(|(_, (_, other))| match other {
                Failure::FlameOut(first) => Some(*first),
                Failure::HotStart | Failure::NoLight => None,
            });
            if let Some((first, again)) = plan.out_until(engine, config, others, at) {
                return Err(format!(
                    "--faults: flame-out of {} at {} s: after the one at {} s its flame burns again from about {:.0} s",
                    name(engine),
                    seconds(at),
                    seconds(first),
                    seconds(again)
                ));
            }
        }
        Ok(())
    }
}

impl Faults {
    /// The cut by which the engine is stopped at this time, or kept from its start, and when it burns again.
    fn stopped_by_a_cut(
        &self,
        engine: usize,
        config: &Engine,
        times: &EnginePlan,
        at: Duration,
    ) -> Option<(Duration, Duration)> {
        let (start, lights) = (times.start_at - Instant::MIN, lights_after(config));
        self.cuts.iter().filter(|cut| cut.engine == engine).find_map(|cut| {
            let end = cut.at + cut.length;
            let (from, again) = if cut.at < start + lights {
                // In the start, or before it.
                (cut.at, end.max(start) + lights)
            } else {
                // An ECU that stops its engine without commands.
                let stopped = cut.at + config.stops_without_commands().filter(|delay| *delay < cut.length)?;
                (stopped, end.max(stopped + times.cooling_takes) + lights)
            };
            let is_out = end > start && (from..again).contains(&at);
            is_out.then_some((cut.at, again))
        })
    }
}

/// From the command to run until the flame burns, roughly.
fn lights_after(engine: &Engine) -> Duration {
    let p = parameters(engine);
    Duration::from_millis(((p.ignition_s + p.preheat_s) * 1000.0) as u64)
}

#[cfg(test)]
mod tests {
    use super::super::engines::engines;
    use super::*;

    #[test]
    fn all_engines_have_time_to_run_and_to_cool() {
        let engines = engines(&[]).unwrap();
        let plan = Plan::new(&engines, None, FlownBy::Pilots, &mut Faults::default()).unwrap();
        assert_eq!(plan.engines.len(), 4);
        for engine in &plan.engines {
            assert!(engine.shutdown_at >= engine.start_at + engine.start_takes + LEAST_RUNNING);
            assert!(engine.shutdown_at + engine.cooling_takes <= Instant::MIN + plan.length.unwrap());
        }
    }

    #[test]
    fn a_run_that_is_too_short_is_refused_with_the_shortest() {
        let engines = engines(&[]).unwrap();
        let none = &mut Faults::default();
        let error = Plan::new(&engines, Some(Duration::from_secs(60)), FlownBy::Pilots, none).unwrap_err();
        let least: u64 =
            error.rsplit(' ').next().and_then(|word| word.strip_suffix('s')?.parse().ok()).unwrap();
        assert!(Plan::new(&engines, Some(Duration::from_secs(least - 1)), FlownBy::Pilots, none).is_err());
        assert!(Plan::new(&engines, Some(Duration::from_secs(least)), FlownBy::Pilots, none).is_ok());
        assert!(Plan::new(&engines, Some(Duration::from_secs(1)), FlownBy::PilotsInStandby, none).is_err());
    }

    #[test]
    fn faults_end_before_the_first_shutdown() {
        let engines = engines(&[]).unwrap();
        let mut heavy = Faults::parse("heavy", &engines).unwrap();
        let plan = Plan::new(&engines, None, FlownBy::Pilots, &mut heavy).unwrap();
        let until = Instant::MIN + heavy.until.unwrap();
        assert!(plan.engines.iter().all(|engine| until + RECOVERY <= engine.shutdown_at));
        // A third of a duration must not show six decimals.
        let mut late = Faults::parse("heavy,from=20s", &engines).unwrap();
        let error = Plan::new(&engines, None, FlownBy::PilotsInStandby, &mut late).unwrap_err();
        assert!(error.contains("which is 6.666s in this run"), "{error}");
        for text in ["heavy,until=175s", "heavy,from=170s"] {
            let mut late = Faults::parse(text, &engines).unwrap();
            assert!(Plan::new(&engines, None, FlownBy::Pilots, &mut late).is_err(), "{text}");
        }
    }
}

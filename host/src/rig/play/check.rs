//! Whether each fault of a script file can act: a fault that cannot act is a mistake, as with `--faults`.

use super::super::disturbances::{By, Disturbances};
use super::super::engines::Engine;
use super::super::plan::Plan;
use super::super::quantity::seconds;
use super::action::{Act, Action, Fault};
use embassy_time::{Duration, Instant};

/// The run in which the actions take place.
#[derive(Clone, Copy, Debug)]
pub struct Played<'a> {
    /// When the pilots fly.
    pub plan: &'a Plan,
    /// The engines.
    pub engines: &'a [Engine],
    /// One transmitter commands all engines.
    pub transmitter: bool,
    /// The file has an end of its own.
    pub has_end: bool,
}

/// Checks that each of them can act.
pub fn check(actions: &[(Instant, Action)], played: &Played<'_>) -> Result<(), String> {
    let mut lasting = vec![Disturbances::default(); played.engines.len()];
    for (place, &(at, action)) in actions.iter().enumerate() {
        let Act::Fault(fault, begins) = action.act else { continue };
        let wrong = |what: &str| {
            Err(format!("`{} {}`: {what}", seconds(at - Instant::MIN), action.text(played.engines)))
        };
        let all = played.transmitter && fault == Fault::Silence;
        let concerned =
            (0..lasting.len()).filter(|engine| all || action.engine.is_none_or(|of| of == *engine));
        let concerned: Vec<usize> = concerned.collect();
        if !fault.is_once() {
            let mut changes = false;
            for &engine in &concerned {
                changes |= lasting[engine].set(at, By::Hand, fault, begins);
            }
            if !changes {
                return wrong(if begins { "that lasts already" } else { "nothing of that kind lasts" });
            }
        }
        if played.has_end {
            continue;
        }
        if let Some(end) = end(actions, played).filter(|end| at >= Instant::MIN + *end) {
            return wrong(&format!("it comes after the end of the run at about {:.0} s", seconds(end)));
        }
        if fault == Fault::FlameOut {
            let is_out = |engine: &usize| {
                // It is unknown when a script restarts.
                let flown = !acts(actions, *engine).any(|other| other < at);
                let config = played.engines.get(*engine)?;
                let when = at - Instant::MIN;
                let before = actions.iter().take(place).filter(|(_, other)| {
                    other.act == action.act && other.engine.is_none_or(|of| of == *engine)
                });
                let before = before.map(|(at, _)| *at - Instant::MIN);
                let burns = played.plan.burns(*engine, config, when);
                // Not every pilot starts it again.
                let out = played.plan.out_until(*engine, config, before, when).map(|(first, again)| {
                    let (first, again) = (seconds(first), seconds(again));
                    format!("after the one at {first} s its flame does not burn before about {again:.0} s")
                });
                burns.err().or(out).filter(|_| flown)
            };
            let out: Vec<String> = concerned.iter().filter_map(is_out).collect();
            if let Some(what) = out.first().filter(|_| out.len() == concerned.len()) {
                return wrong(what);
            }
        }
    }
    Ok(())
}

/// When this engine is commanded by hand.
fn acts(actions: &[(Instant, Action)], engine: usize) -> impl Iterator<Item = Instant> {
    let of_it = move |(_, action): &&(Instant, Action)| {
        action.engine.is_none_or(|of| of == engine) && !matches!(action.act, Act::Fault(..))
    };
    actions.iter().filter(of_it).map(|(at, _)| *at)
}

/// When all engines have flown, at the latest: one that restarts its script does not take longer than the whole run.
fn end(actions: &[(Instant, Action)], played: &Played<'_>) -> Option<Duration> {
    let length = played.plan.length?;
    let last = (0..played.engines.len()).filter_map(|engine| acts(actions, engine).max()).max();
    Some(last.map_or(length, |at| at - Instant::MIN + length))
}

#[cfg(test)]
mod tests {
    use super::super::super::engines::engines;
    use super::super::super::faults::Faults;
    use super::super::super::plan::FlownBy;
    use super::super::script::Script;
    use super::*;

    #[test]
    fn a_fault_that_cannot_act_is_refused() {
        let engines = engines(&[]).unwrap();
        let check = |text: &str, transmitter| {
            let script = Script::parse(&format!("jetlink rig script, version 0.1.0\n{text}")).unwrap();
            let flown_by = if script.header.standby { FlownBy::PilotsInStandby } else { FlownBy::Pilots };
            let plan = Plan::new(&engines, None, flown_by, &mut Faults::default()).unwrap();
            let has_end = script.end.is_some();
            let played = Played { plan: &plan, engines: &engines, transmitter, has_end };
            check(&script.actions(&engines).unwrap(), &played)
        };
        for text in [
            "60 left flame-out",
            "60 all flame-out",
            "5 left cut\n6 left cut-to-ecu\n7 left mend\n8 left mend-to-ecu",
            "5 left cut\n6 all cut\n7 all mend",
            // Restarted, or with an end: unknown.
            "1 left disarm\n2 left script\n170 left flame-out",
            "3 left flame-out\n9 end",
            "5 left node-reset\n5 left node-reset",
            "40 left flame-out\n60 right flame-out\n110 left flame-out",
            "60 left flame-out\n61 left flame-out\n70 end",
            "60 left flame-out\n61 all flame-out",
        ] {
            assert_eq!(check(text, false), Ok(()), "{text}");
        }
        for (text, part) in [
            ("9999 left flame-out", "`9999 left flame-out`: it comes after the end of the run at about"),
            ("9999 left cut", "after the end"),
            ("1 left disarm\n2 left script\n9999 left flame-out", "after the end"),
            ("3.5 left flame-out", "`3.5 left flame-out`: its flame burns from about"),
            ("standby\n3 left flame-out", "no engine is started"),
            ("5 left mend", "`5 left mend`: nothing of that kind lasts"),
            ("5 left cut\n6 right mend", "nothing of that kind lasts"),
            ("5 left cut\n6 left cut", "that lasts already"),
            ("5 all noise\n6 left quiet\n7 all quiet\n8 all quiet", "`8 all quiet`"),
            ("5 left mend\n9 end", "nothing of that kind lasts"),
            (
                "60 left flame-out\n61 left flame-out",
                "`61 left flame-out`: after the one at 60 s its flame does not burn before about 123 s",
            ),
            ("60 all flame-out\n61 left flame-out", "after the one at 60 s its flame does not burn before"),
        ] {
            let error = check(text, false).expect_err(text);
            assert!(error.contains(part), "{text}: {error}");
        }
        // One transmitter for all.
        assert_eq!(check("5 left silent\n6 right speak\n9 end", true), Ok(()));
        assert!(check("5 left silent\n6 right speak\n9 end", false).is_err());
    }
}

//! Random worlds: one or two engines with simulated ECUs on a node that is reset now and then, and sources that
//! command them well and badly. Everything comes from one seed.

mod boots;
mod disturbances;
mod rig;
mod settings;
mod sources;

use super::oracle::{Input, Retained, Tally};
use super::rng::Rng;
use embassy_time::Duration;
use jetlink::command::Order;
use jetlink::engine::retained::{Reset, RetainedMemory};
use jetlink::event::LossStage;
use rig::{MS, Rig, now};
use sim::clock;

/// A failure, described for a reader.
#[derive(Debug)]
pub struct Failure {
    pub seed: u64,
    pub text: String,
}

/// Runs a world for this time.
pub fn run(seed: u64, length: Duration) -> Result<(u64, Tally), Failure> {
    let mut rng = Rng(seed);
    if rng.percent(25) { play::<2>(seed, &mut rng, length) } else { play::<1>(seed, &mut rng, length) }
}

fn play<const N: usize>(seed: u64, rng: &mut Rng, length: Duration) -> Result<(u64, Tally), Failure> {
    clock::reset();
    let gap = Duration::from_millis(rng.pick(&[0, 3000, 10_000]));
    let mut rigs: [Rig; N] = std::array::from_fn(|port| settings::rig(rng, port as u8, gap));
    let configs = rigs.each_ref().map(|rig| rig.config);
    // It outlives every node, as memory does; a few bytes for each world.
    let memory: &'static [RetainedMemory; N] =
        Box::leak(Box::new(std::array::from_fn(|_| RetainedMemory::new())));
    let end = now() + length.as_micros();
    let fail = |rigs: &[Rig; N], port: usize, why: String| {
        use std::fmt::Write;
        let rig = &rigs[port];
        let mut text = format!("seed {seed}, engine {port}: {why}\n{:?}\n", rig.config);
        for (at, what) in &rig.trace {
            let _ = writeln!(text, "{at:>12} µs  {what}");
        }
        Failure { seed, text }
    };
    let mut how = Reset::PowerLost;
    loop {
        match boots::boot(rng, &mut rigs, &configs, (memory, how), end) {
            Ok(boots::End::Time) => break,
            Ok(boots::End::Reset(retained)) => {
                let down = if rng.percent(70) { rng.below(300 * MS) } else { rng.below(1_500 * MS) };
                boots::down_for(&mut rigs, down);
                for (rig, memory) in rigs.iter_mut().zip(memory) {
                    rig.look_at_ecu();
                    let record = memory.load(rig.config.fingerprint(), Reset::Warm);
                    let demand = record.and_then(|record| match record.order {
                        Order::Run(demand) if record.ran => {
                            Some((record.origin, demand, record.loss >= LossStage::FailSafe))
                        }
                        _ => None,
                    });
                    let retained =
                        if let Retained::Whole(_) = retained { Retained::Whole(demand) } else { retained };
                    how = if retained == Retained::PowerLost { Reset::PowerLost } else { Reset::Warm };
                    rig.input(Input::Boot { retained, down });
                }
            }
            Err((port, why)) => return Err(fail(&rigs, port, why)),
        }
    }
    let mut tally = Tally::default();
    for port in 0..N {
        if let Err(why) = rigs[port].judge(true) {
            return Err(fail(&rigs, port, why));
        }
        tally.add(&rigs[port].oracle.tally);
    }
    Ok((length.as_secs() * N as u64, tally))
}

impl Tally {
    pub fn add(&mut self, other: &Self) {
        self.frames += other.frames;
        self.run_frames += other.run_frames;
        self.stop_frames += other.stop_frames;
        self.starts += other.starts;
        self.silent_frames += other.silent_frames;
        self.fail_safe_frames += other.fail_safe_frames;
        self.resets_running += other.resets_running;
        self.resumed_runs += other.resumed_runs;
        self.exact_frames += other.exact_frames;
        self.rpm_frames += other.rpm_frames;
        self.takeovers += other.takeovers;
        self.rising_frames += other.rising_frames;
        self.healthy_ends += other.healthy_ends;
        self.dark_runs += other.dark_runs;
    }
}

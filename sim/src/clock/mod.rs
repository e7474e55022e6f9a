//! Embassy's time driver on the host: one virtual clock per thread.
//!
//! `cargo test` gives every test its own thread, so every test has its own clock and all of them
//! can run in parallel. Time does not advance while there is work to do, and then jumps to the next
//! alarm: at once, or in [`Pace::RealTime`] when the wall clock gets there. Events and their virtual
//! times are the same in both: a host that is late delays the run without affecting it.
//!
//! The root future is polled when it was woken or when one of its alarms is due, never "just in
//! case", so that a wake-up that the code under test forgets is detected. Each waker has one alarm,
//! the earliest requested since its last alarm. Embassy's executor does the same with each task, and
//! as there, an alarm polls the task, which requests a new one for anything it still waits for.

mod pacer;
mod waker;

use core::cell::{Cell, RefCell};
use core::future::{Future, poll_fn};
use core::pin::pin;
use core::task::{Context, Poll, Waker};
use std::sync::Arc;
use std::time::Instant as WallInstant;

use embassy_time::{Duration, Instant};

use self::pacer::Pacer;
use self::waker::Root;

/// Number of polls at one instant of virtual time that counts as a busy loop.
const BUSY_LOOP_POLLS: u32 = 1_000_000;

/// Pace of time on this thread.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Pace {
    /// Jumps to the next alarm as soon as there is no work left.
    #[default]
    Unlimited,
    /// The same, but never ahead of the wall clock by more than 2 ms.
    RealTime,
    /// Multiple of the speed of the wall clock, at least 1.
    Times(u32),
}

struct Alarm {
    at: u64,
    waker: Waker,
}

struct Clock {
    /// The time in ticks.
    now: Cell<u64>,
    /// Limits the time in [`Pace::RealTime`].
    pacer: Cell<Option<Pacer>>,
    alarms: RefCell<Vec<Alarm>>,
    /// Polls of the root future and of tasks.
    polls: Cell<u64>,
    running: Cell<bool>,
    root: Arc<Root>,
}

thread_local! {
    static CLOCK: Clock = Clock {
        now: const { Cell::new(0) },
        pacer: const { Cell::new(None) },
        alarms: const { RefCell::new(Vec::new()) },
        polls: const { Cell::new(0) },
        running: const { Cell::new(false) },
        root: Root::new(),
    };
}

impl Clock {
    /// Jumps to this time; in real time, when the wall clock gets there.
    fn jump(&self, to: u64) {
        if let Some(mut pacer) = self.pacer.get() {
            std::thread::sleep(pacer.wait(to, WallInstant::now()));
            self.pacer.set(Some(pacer));
        }
        self.now.set(to);
    }

    fn count_poll(&self) {
        self.polls.set(self.polls.get() + 1);
    }

    fn next_alarm(&self) -> Option<u64> {
        self.alarms.borrow().iter().map(|alarm| alarm.at).min()
    }

    /// Wakes everything that is due, the earliest first.
    fn ring(&self, now: u64) {
        loop {
            let due = {
                let mut alarms = self.alarms.borrow_mut();
                let first = (0..alarms.len()).min_by_key(|&i| alarms[i].at);
                match first {
                    Some(i) if alarms[i].at <= now => alarms.remove(i),
                    _ => return,
                }
            };
            // The borrow has ended: a waker may do anything.
            due.waker.wake();
        }
    }
}

struct ThreadClock;

embassy_time_driver::time_driver_impl!(static DRIVER: ThreadClock = ThreadClock);

impl embassy_time_driver::Driver for ThreadClock {
    fn now(&self) -> u64 {
        CLOCK.with(|clock| clock.now.get())
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        // Embassy uses the end of time for "never"; an alarm there would hide a deadlock.
        if at == u64::MAX {
            return;
        }
        CLOCK.with(|clock| {
            if at <= clock.now.get() {
                waker.wake_by_ref();
                return;
            }
            let mut alarms = clock.alarms.borrow_mut();
            match alarms.iter_mut().find(|alarm| alarm.waker.will_wake(waker)) {
                Some(alarm) => alarm.at = alarm.at.min(at),
                None => alarms.push(Alarm { at, waker: waker.clone() }),
            }
        });
    }
}

/// Sets this thread's clock to 0 in [`Pace::Unlimited`] and clears all alarms.
pub fn reset() {
    CLOCK.with(|clock| {
        assert!(!clock.running.get(), "clock::reset() inside a running future");
        clock.now.set(0);
        clock.pacer.set(None);
        clock.polls.set(0);
        let forgotten = clock.alarms.take();
        drop(forgotten);
    });
}

/// Polls of the root future and of tasks on this thread since [`reset`]: the work of a run, counted.
pub fn polls() -> u64 {
    CLOCK.with(|clock| clock.polls.get())
}

/// Changes the pace of this thread's clock; the time continues from its current value.
pub fn set_pace(pace: Pace) {
    CLOCK.with(|clock| {
        let speed = match pace {
            Pace::Unlimited => None,
            Pace::RealTime => Some(1),
            Pace::Times(speed) => Some(speed.max(1)),
        };
        clock.pacer.set(speed.map(|speed| Pacer::new(clock.now.get(), WallInstant::now(), speed)));
    });
}

/// The time on this thread in ns, with the resolution of embassy's tick, 1 µs.
pub fn now_ns() -> u64 {
    Instant::now().as_micros() * 1000
}

/// Runs a future to completion.
///
/// # Panics
///
/// If the future can never complete: nothing is woken and no alarm is armed, or it wakes itself
/// endlessly while no time passes.
pub fn run<F: Future>(future: F) -> F::Output {
    match drive(future, None) {
        Some(output) => output,
        None => unreachable!("a run without a limit ends with the future"),
    }
}

/// Runs a future for at most `limit`; `None` if it has not completed by then.
///
/// The future is still polled for alarms due exactly at the limit. It may be a `&mut` to a pinned
/// future, to be continued later.
///
/// # Panics
///
/// As [`run`]: a deadlock before the limit is a deadlock, not a timeout.
pub fn run_for<F: Future>(future: F, limit: Duration) -> Option<F::Output> {
    drive(future, Some((Instant::now() + limit).as_ticks()))
}

/// Waits until `done` holds, checking it every `look`. False if it does not within `limit`.
pub async fn until(limit: Duration, look: Duration, done: impl Fn() -> bool) -> bool {
    let end = Instant::now() + limit;
    while !done() {
        if Instant::now() >= end {
            return false;
        }
        embassy_time::Timer::after(look).await;
    }
    true
}

/// A task: a future that is polled only when it was woken or when one of its alarms is due, however often the future around it
/// is polled.
pub async fn task<F: Future>(future: F) -> F::Output {
    let own = Root::new();
    own.wake();
    let waker = waker::waker(&own);
    let mut future = pin!(future);
    poll_fn(|cx| {
        own.inside(cx.waker());
        if !own.take_woken() {
            return Poll::Pending;
        }
        CLOCK.with(Clock::count_poll);
        future.as_mut().poll(&mut Context::from_waker(&waker))
    })
    .await
}

/// Advances time with no future running.
pub fn advance(by: Duration) {
    // Not `run_for(pending())`: with nothing armed that is a deadlock.
    run(embassy_time::Timer::after(by));
}

fn drive<F: Future>(future: F, end: Option<u64>) -> Option<F::Output> {
    struct Running;
    impl Drop for Running {
        fn drop(&mut self) {
            CLOCK.with(|clock| clock.running.set(false));
        }
    }

    let root = CLOCK.with(|clock| {
        assert!(!clock.running.replace(true), "a run of the clock inside another one on the same thread");
        clock.root.clone()
    });
    let _running = Running;
    let waker = waker::waker(&root);
    // The first poll requests all its alarms again; those left by an earlier root must not fire.
    CLOCK.with(|clock| clock.alarms.borrow_mut().retain(|alarm| !alarm.waker.will_wake(&waker)));

    let mut future = pin!(future);
    let mut context = Context::from_waker(&waker);
    let mut polls = 0;
    root.wake();
    loop {
        if root.take_woken() {
            CLOCK.with(Clock::count_poll);
            if let Poll::Ready(output) = future.as_mut().poll(&mut context) {
                return Some(output);
            }
            polls += 1;
        }
        let now = CLOCK.with(|clock| {
            let now = clock.now.get();
            clock.ring(now);
            now
        });
        if root.is_woken() {
            assert!(
                polls < BUSY_LOOP_POLLS,
                "busy loop: the future woke itself {polls} times at {now} µs and no time passed"
            );
            continue;
        }
        let Some(next) = CLOCK.with(Clock::next_alarm) else {
            panic!(
                "deadlock at {now} µs: nothing is woken and no alarm is armed, so nothing can ever happen again"
            );
        };
        polls = 0;
        if let Some(end) = end.filter(|&end| next > end) {
            CLOCK.with(|clock| clock.jump(end));
            return None;
        }
        CLOCK.with(|clock| {
            clock.jump(next);
            clock.ring(next);
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::future::pending;
    use embassy_futures::join::join3;
    use embassy_futures::select::{Either, select};
    use embassy_sync::blocking_mutex::raw::NoopRawMutex;
    use embassy_sync::signal::Signal;
    use embassy_time::{Ticker, Timer};

    #[test]
    fn virtual_time_jumps_to_the_next_alarm() {
        reset();
        let real = WallInstant::now();
        run(async {
            Timer::after_secs(3600).await;
            assert_eq!(now_ns(), 3_600_000_000_000);
            let mut ticker = Ticker::every(Duration::from_millis(50));
            for _ in 0..20 {
                ticker.next().await;
            }
            assert_eq!(now_ns(), 3_601_000_000_000);
        });
        assert!(real.elapsed().as_secs() < 10);
    }

    #[test]
    fn the_limit_stops_a_future_and_is_the_time_afterwards() {
        reset();
        assert_eq!(run_for(Timer::after_millis(11), Duration::from_millis(10)), None);
        assert_eq!(now_ns(), 10_000_000);
        // Alarms due exactly at the limit still fire.
        assert_eq!(run_for(Timer::after_millis(10), Duration::from_millis(10)), Some(()));
        assert_eq!(now_ns(), 20_000_000);
        advance(Duration::from_micros(7));
        assert_eq!(now_ns(), 20_007_000);
    }

    #[test]
    fn a_task_is_polled_only_when_it_was_woken_or_its_alarm_is_due() {
        reset();
        let polls = Cell::new(0);
        let signal = Signal::<NoopRawMutex, ()>::new();
        let counted = task(async {
            let mut waits = pin!(select(signal.wait(), Timer::after_millis(30)));
            poll_fn(|cx| {
                polls.set(polls.get() + 1);
                waits.as_mut().poll(cx)
            })
            .await
        });
        let others = async {
            for _ in 0..20 {
                Timer::after_millis(1).await;
            }
            assert_eq!(polls.get(), 1);
            signal.signal(());
            Timer::after_millis(20).await;
        };
        let (first, ()) = run(embassy_futures::join::join(counted, others));
        assert!(matches!(first, Either::First(())));
        assert_eq!(polls.get(), 2);

        reset();
        run(task(Timer::after_millis(30)));
        assert_eq!(now_ns(), 30_000_000);
    }

    #[test]
    fn polls_are_counted() {
        reset();
        let timers = || async {
            for _ in 0..5 {
                Timer::after_millis(1).await;
            }
        };
        run(timers());
        assert_eq!(polls(), 6);
        // The same with a task: the future around it is polled at least as often.
        run(task(timers()));
        assert!(polls() >= 6 + 12, "{}", polls());
        reset();
        assert_eq!(polls(), 0);
    }

    #[test]
    fn a_pinned_future_can_be_run_on() {
        reset();
        let mut future = pin!(async {
            Timer::after_millis(30).await;
            5
        });
        assert_eq!(run_for(&mut future, Duration::from_millis(20)), None);
        assert_eq!(run_for(&mut future, Duration::from_millis(20)), Some(5));
        assert_eq!(now_ns(), 30_000_000);
    }

    #[test]
    fn alarms_of_joined_futures_all_ring() {
        reset();
        let rung = RefCell::new(Vec::new());
        let after = |ms| {
            let rung = &rung;
            async move {
                Timer::after_millis(ms).await;
                rung.borrow_mut().push((ms, now_ns() / 1_000_000));
            }
        };
        run(join3(after(30), after(10), after(20)));
        assert_eq!(*rung.borrow(), [(10, 10), (20, 20), (30, 30)]);
    }

    #[test]
    fn the_loser_of_a_select_does_not_hold_the_clock() {
        reset();
        run(async {
            match select(Timer::after_millis(1), Timer::after_secs(1000)).await {
                Either::First(()) => {}
                Either::Second(()) => panic!("the later timer won"),
            }
            Timer::after_millis(1).await;
            assert_eq!(now_ns(), 2_000_000);
        });
    }

    #[test]
    fn each_thread_has_its_own_clock() {
        reset();
        advance(Duration::from_secs(5));
        let other = std::thread::spawn(now_ns).join().unwrap();
        assert_eq!(other, 0);
        assert_eq!(now_ns(), 5_000_000_000);
    }

    #[test]
    #[should_panic(expected = "deadlock at 0 µs")]
    fn a_deadlock_panics() {
        reset();
        run(pending::<()>());
    }

    #[test]
    #[should_panic(expected = "deadlock at 1000 µs")]
    fn a_deadlock_panics_although_there_is_a_limit() {
        reset();
        run_for(
            async {
                Timer::after_millis(1).await;
                pending::<()>().await;
            },
            Duration::from_secs(10),
        );
    }

    #[test]
    #[should_panic(expected = "deadlock at 10000 µs")]
    fn an_alarm_of_an_earlier_run_does_not_hide_a_deadlock() {
        reset();
        assert_eq!(run_for(Timer::after_secs(1), Duration::from_millis(10)), None);
        run(pending::<()>());
    }

    #[test]
    #[should_panic(expected = "deadlock")]
    fn an_alarm_at_the_end_of_time_is_not_an_alarm() {
        reset();
        run(Timer::at(Instant::MAX));
    }

    #[test]
    #[should_panic(expected = "busy loop")]
    fn waking_oneself_for_ever_panics() {
        reset();
        run(poll_fn::<(), _>(|cx| {
            cx.waker().wake_by_ref();
            Poll::Pending
        }));
    }

    #[test]
    #[should_panic(expected = "deadlock")]
    fn a_missed_wake_is_not_hidden_by_polling() {
        reset();
        let flag = Cell::new(false);
        let waits = poll_fn(|_| if flag.get() { Poll::Ready(()) } else { Poll::Pending });
        run(async {
            let waits = pin!(waits);
            // Polled once at the start and never woken again, although the flag is set.
            let mut waits = Some(waits);
            poll_fn(|cx| {
                let done = waits.as_mut().is_some_and(|w| w.as_mut().poll(cx).is_ready());
                flag.set(true);
                if done { Poll::Ready(()) } else { Poll::Pending }
            })
            .await;
        });
    }

    #[test]
    fn wakers_that_are_not_the_root_get_their_own_alarms() {
        reset();
        let (a, b) = (Root::new(), Root::new());
        embassy_time_driver::schedule_wake(100, &waker::waker(&a));
        embassy_time_driver::schedule_wake(300, &waker::waker(&a));
        embassy_time_driver::schedule_wake(200, &waker::waker(&b));
        run_for(Timer::after_micros(150), Duration::from_secs(1)).unwrap();
        assert!(a.take_woken() && !b.is_woken());
        run_for(Timer::after_micros(250), Duration::from_secs(1)).unwrap();
        // One alarm per waker, the earliest: `a` was woken at 100 and has not requested another.
        assert!(!a.is_woken() && b.is_woken());
    }

    #[test]
    fn real_time_follows_the_wall_clock() {
        reset();
        set_pace(Pace::RealTime);
        let real = WallInstant::now();
        assert_eq!(run_for(Timer::after_millis(40), Duration::from_secs(5)), Some(()));
        assert_eq!(run_for(Timer::after_secs(5), Duration::from_millis(40)), None);
        let took = real.elapsed();
        assert!(took.as_millis() >= 76, "{took:?}");
        // Unlike the wall clock it arrives exactly.
        assert_eq!(now_ns(), 80_000_000);
        // Back to jumping.
        set_pace(Pace::Unlimited);
        advance(Duration::from_secs(3600));
        assert!(real.elapsed().as_secs() < 1800);
    }

    #[test]
    fn a_stalled_host_delays_the_run_and_is_not_seen_in_it() {
        let run_with = |pace, stall: u64| {
            reset();
            set_pace(pace);
            let real = WallInstant::now();
            let mut times = Vec::new();
            run(async {
                let mut ticker = Ticker::every(Duration::from_millis(20));
                for i in 0..20 {
                    ticker.next().await;
                    times.push(now_ns());
                    if i == 5 {
                        std::thread::sleep(core::time::Duration::from_millis(stall));
                    }
                }
            });
            (times, real.elapsed().as_millis())
        };
        let (expected, _) = run_with(Pace::Unlimited, 0);
        let (times, took) = run_with(Pace::RealTime, 500);
        assert_eq!(times, expected);
        // 500 ms, and its own 400 ms except for the tick that was due in the stall: it does not race to catch up.
        assert!(took >= 870, "{took} ms");
    }
}

//! The watch for a watchdog: a runner that is stuck is reported, one that had no time to progress is not.

use core::future::{Future, pending, poll_fn};
use core::pin::{Pin, pin};
use core::task::Poll;
use embassy_time::Duration;
use jetlink::config::EngineConfig;
use jetlink::ecu::zk::codec::Rate;
use jetlink::line::Line;
use jetlink::node::Node;
use jetlink::watch::RunnerWatch;
use sim::clock;
use std::cell::RefCell;

/// A UART that receives nothing, and sends everything at once.
pub struct Silent;

impl embedded_io_async::ErrorType for Silent {
    type Error = core::convert::Infallible;
}

impl embedded_io_async::Read for Silent {
    async fn read(&mut self, _: &mut [u8]) -> Result<usize, Self::Error> {
        pending().await
    }
}

impl embedded_io_async::Write for Silent {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Self::Error> {
        Ok(bytes.len())
    }

    async fn flush(&mut self) -> Result<(), Self::Error> {
        Ok(())
    }
}

/// Runs two engines under a watch, and calls `at` every 10 ms with the time in ms: `true` if the runner of `right` is not
/// polled. Returns what each check found.
fn watched(hangs: impl Fn(u64) -> bool, stall: Option<(u64, u64)>) -> Vec<Vec<String>> {
    clock::reset();
    let engine = |name, port| EngineConfig::zk(name, port, Line::new(115_200), Rate::Hz20);
    let node = Node::new(&[engine("left", 0), engine("right", 1)], None).unwrap();
    let errors = [jetlink::runner::LineErrors::new(), jetlink::runner::LineErrors::new()];
    let [left, right] = node.runners();
    let mut left = pin!(left.run(Silent, Silent, &errors[0]));
    let mut right = pin!(right.run(Silent, Silent, &errors[1]));
    let found = RefCell::new(Vec::new());
    let mut watch = pin!(async {
        let mut watch = RunnerWatch::new(node.handles());
        loop {
            let stuck: Vec<String> = watch.check().await.iter().map(|name| (*name).to_owned()).collect();
            found.borrow_mut().push(stuck);
        }
    });
    // The watch is polled first: after a stall it sees the time before any runner does.
    let mut all = pin!(poll_fn(|cx| {
        let _: Poll<()> = watch.as_mut().poll(cx);
        let _ = left.as_mut().poll(cx);
        if !hangs(clock::now_ns() / 1_000_000) {
            let _ = Pin::as_mut(&mut right).poll(cx);
        }
        Poll::<()>::Pending
    }));
    while clock::now_ns() < 10_000_000_000 {
        clock::run_for(all.as_mut(), Duration::from_millis(10));
        if let Some((at, long)) = stall
            && clock::now_ns() == at * 1_000_000
        {
            clock::advance(Duration::from_millis(long));
        }
    }
    found.take()
}

#[test]
fn runner_that_hangs_is_stuck_until_it_progresses_again() {
    let found = watched(|ms| (2000..4000).contains(&ms), None);
    let stuck: Vec<_> = (1..).zip(&found).filter(|(_, stuck)| !stuck.is_empty()).collect();
    assert!((6..=8).contains(&stuck.len()), "{found:?}");
    for (check, stuck) in stuck {
        assert_eq!(stuck, &["right"], "check {check}");
        assert!((9..=16).contains(&check), "check {check}");
    }
    assert!(found.iter().filter(|stuck| stuck.is_empty()).count() > 30, "{found:?}");
}

#[test]
fn nothing_is_stuck_after_a_stall_of_everything() {
    let found = watched(|_| false, Some((3000, 5000)));
    assert!(found.iter().all(Vec::is_empty), "{found:?}");
    assert!(found.len() > 15, "{found:?}");
}

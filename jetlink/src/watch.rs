//! Which engines' runners are stuck, for a board's watchdog.

use crate::channel::Handle;
use embassy_time::{Duration, Timer};
use heapless::Vec;

/// Watches the runners of `N` engines. Feed the watchdog after each [`RunnerWatch::check`] that finds none stuck.
///
/// ```
/// # async fn supervise(node: &jetlink::node::Node<2>, feed: impl Fn()) {
/// let mut watch = jetlink::watch::RunnerWatch::new(node.handles());
/// loop {
///     if watch.check().await.is_empty() {
///         feed();
///     }
/// }
/// # }
/// ```
#[derive(Debug)]
pub struct RunnerWatch<'a, const N: usize> {
    handles: [Handle<'a>; N],
    /// Progress of each runner when all had progressed.
    before: [u32; N],
}

impl<'a, const N: usize> RunnerWatch<'a, N> {
    /// Time of one check, 250 ms: a runner that works progresses every 100 ms.
    pub const INTERVAL: Duration = Duration::from_millis(250);

    /// Watches these engines.
    pub fn new(handles: [Handle<'a>; N]) -> Self {
        Self { handles, before: handles.map(|handle| handle.progress()) }
    }

    /// Waits for [`Self::INTERVAL`], and returns the names of the engines whose runners have not progressed since the last check
    /// that found none stuck.
    #[expect(clippy::disallowed_methods, reason = "it watches the runners, and waits between two looks")]
    pub async fn check(&mut self) -> Vec<&'a str, N> {
        // Not a ticker: after a stall it would catch up, and report runners as stuck that had no time to progress.
        Timer::after(Self::INTERVAL).await;
        let progress = self.handles.map(|handle| handle.progress());
        let counts = self.handles.iter().zip(self.before).zip(progress);
        let stuck = counts.filter(|((_, before), now)| before == now);
        let stuck: Vec<_, N> = stuck.map(|((handle, _), _)| handle.name()).collect();
        if stuck.is_empty() {
            self.before = progress;
        }
        stuck
    }
}

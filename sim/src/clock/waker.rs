//! The wakers of the one future that a thread's clock runs, and of tasks in it.
//!
//! Its table is a `static`: with `Waker::from(Arc<impl Wake>)` the table is a constant that may
//! exist more than once (Miri does that on purpose), two clones then do not recognise each other
//! by `will_wake`, and embassy-sync then wakes the "other" one at every registration.

#![allow(unsafe_code)]

use core::sync::atomic::{AtomicBool, Ordering};
use core::task::{RawWaker, RawWakerVTable, Waker};
use std::sync::{Arc, OnceLock};

/// Whether the root future of a thread, or a task in it, has to be polled.
#[derive(Debug)]
pub(super) struct Root {
    woken: AtomicBool,
    /// Waker of the future that polls it.
    outer: OnceLock<Waker>,
}

impl Root {
    pub(super) fn new() -> Arc<Self> {
        Arc::new(Self { woken: AtomicBool::new(false), outer: OnceLock::new() })
    }

    pub(super) fn wake(&self) {
        self.woken.store(true, Ordering::Release);
        if let Some(outer) = self.outer.get() {
            outer.wake_by_ref();
        }
    }

    /// Sets the waker of the future that polls this one, at the first poll.
    pub(super) fn inside(&self, waker: &Waker) {
        let outer = self.outer.get_or_init(|| waker.clone());
        debug_assert!(outer.will_wake(waker), "a task stays where it was first polled");
    }

    pub(super) fn is_woken(&self) -> bool {
        self.woken.load(Ordering::Acquire)
    }

    pub(super) fn take_woken(&self) -> bool {
        self.is_woken() && self.woken.swap(false, Ordering::AcqRel)
    }
}

pub(super) fn waker(root: &Arc<Root>) -> Waker {
    let data = Arc::into_raw(root.clone()).cast();
    // SAFETY: `data` owns one strong count of an `Arc<Root>`, which is what the table expects, and
    // `Root` is `Send` and `Sync`.
    unsafe { Waker::from_raw(RawWaker::new(data, &TABLE)) }
}

static TABLE: RawWakerVTable = RawWakerVTable::new(clone, wake, wake_by_ref, drop);

// SAFETY of all four: `data` came from `Arc::<Root>::into_raw`, and as long as a waker with it
// exists one strong count belongs to that waker.

unsafe fn clone(data: *const ()) -> RawWaker {
    unsafe { Arc::increment_strong_count(data.cast::<Root>()) };
    RawWaker::new(data, &TABLE)
}

unsafe fn wake(data: *const ()) {
    unsafe { Arc::from_raw(data.cast::<Root>()) }.wake();
}

unsafe fn wake_by_ref(data: *const ()) {
    unsafe { &*data.cast::<Root>() }.wake();
}

unsafe fn drop(data: *const ()) {
    unsafe { Arc::decrement_strong_count(data.cast::<Root>()) };
}

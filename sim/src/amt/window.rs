//! The reply window (AMT-11), measured by the ECU itself: from the last stop bit of its own set to
//! the last stop bit of the host's message.

use crate::ecu::Nanos;

/// Tolerance for a message that seems to begin before the end of the set: the ECU knows when a byte
/// ended and subtracts the duration of a byte.
const TOLERANCE: Nanos = 1_000;

/// Relation of a message to the window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Reply {
    /// The first message after a set, complete in time, with this margin.
    InWindow { margin: Nanos },
    /// The first message after a set, but too late.
    Late,
    /// A second message to one set, or one that began while the set was still being sent.
    Unsolicited,
}

#[derive(Clone, Copy, Debug)]
struct Sent {
    start: Nanos,
    end: Nanos,
    answered: bool,
}

/// The sets whose replies may still arrive.
#[derive(Clone, Debug, Default)]
pub(super) struct Window {
    /// A late message may still be arriving while the next set is already being sent.
    previous: Option<Sent>,
    current: Option<Sent>,
}

impl Window {
    /// A set is sent from `start` to `end`.
    pub(super) fn sent(&mut self, start: Nanos, end: Nanos) {
        self.previous = self.current.replace(Sent { start, end, answered: false });
    }

    /// Whether a set has finally remained unanswered; each is reported once.
    pub(super) fn gave_up(&mut self, now: Nanos) -> bool {
        // A message that began before the current set is complete before the set is.
        let over = self.current.is_some_and(|current| current.end <= now);
        over && self.previous.take().is_some_and(|previous| !previous.answered)
    }

    /// A well-formed message that began at `start` was complete at `end`.
    pub(super) fn classify(&mut self, start: Nanos, end: Nanos, window: Nanos) -> Reply {
        let sets = [&mut self.current, &mut self.previous];
        let Some(set) = sets.into_iter().flatten().find(|set| set.start <= start) else {
            return Reply::Unsolicited;
        };
        if set.answered || start + TOLERANCE < set.end {
            return Reply::Unsolicited;
        }
        set.answered = true;
        match (set.end + window).checked_sub(end) {
            Some(margin) => Reply::InWindow { margin },
            None => Reply::Late,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ecu::MILLIS;

    const WINDOW: Nanos = 30 * MILLIS;

    fn window() -> Window {
        let mut window = Window::default();
        window.sent(100 * MILLIS, 125 * MILLIS);
        window
    }

    #[test]
    fn a_reply_is_in_time_until_the_last_nanosecond_of_the_window() {
        let start = 125 * MILLIS;
        let margin = |end| window().classify(start, end, WINDOW);
        assert_eq!(margin(146 * MILLIS), Reply::InWindow { margin: 9 * MILLIS });
        assert_eq!(margin(155 * MILLIS), Reply::InWindow { margin: 0 });
        assert_eq!(margin(155 * MILLIS + 1), Reply::Late);
    }

    #[test]
    fn one_reply_to_each_set() {
        let mut window = window();
        window.classify(126 * MILLIS, 147 * MILLIS, WINDOW);
        assert_eq!(window.classify(147 * MILLIS, 150 * MILLIS, WINDOW), Reply::Unsolicited);
    }

    #[test]
    fn a_message_that_begins_before_the_set_is_over_is_unsolicited() {
        assert_eq!(window().classify(90 * MILLIS, 99 * MILLIS, WINDOW), Reply::Unsolicited);
        assert_eq!(window().classify(124 * MILLIS, 145 * MILLIS, WINDOW), Reply::Unsolicited);
    }

    #[test]
    fn a_late_message_belongs_to_the_set_it_began_after() {
        let mut window = window();
        window.sent(225 * MILLIS, 250 * MILLIS);
        assert_eq!(window.classify(220 * MILLIS, 241 * MILLIS, WINDOW), Reply::Late);
        assert!(!window.gave_up(250 * MILLIS));
        assert_eq!(
            window.classify(250 * MILLIS, 271 * MILLIS, WINDOW),
            Reply::InWindow { margin: 9 * MILLIS }
        );
    }

    #[test]
    fn a_set_without_reply_is_reported_once() {
        let mut window = window();
        assert!(!window.gave_up(200 * MILLIS));
        window.sent(225 * MILLIS, 250 * MILLIS);
        assert!(!window.gave_up(249 * MILLIS));
        assert!(window.gave_up(250 * MILLIS));
        assert!(!window.gave_up(260 * MILLIS));
    }
}

//! Cancellation of planning from another thread.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// A flag that planning checks; clones share it. The flag cannot be cleared.
#[derive(Debug, Clone, Default)]
pub struct Cancel {
    flag: Arc<AtomicBool>,
    /// Time after which the flag counts as set.
    end: Option<Instant>,
}

impl Cancel {
    /// Creates a flag that is not set.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Sets the flag: planning ends soon, with [`crate::Status::Cancelled`].
    pub fn cancel(&self) {
        self.flag.store(true, Ordering::Relaxed);
    }

    /// Returns the flag with a time after which it counts as set, too.
    pub(crate) fn until(self, end: Option<Instant>) -> Self {
        Self { end: end.or(self.end), ..self }
    }

    /// Whether the flag is set.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        self.flag.load(Ordering::Relaxed) || self.end.is_some_and(|end| Instant::now() >= end)
    }
}

/// Returns the time at which planning that started at `begun` must end; `None` for no deadline, or one too far for the
/// clock.
pub(crate) fn end_of(begun: Instant, deadline: Option<Duration>) -> Option<Instant> {
    deadline.and_then(|time| begun.checked_add(time))
}

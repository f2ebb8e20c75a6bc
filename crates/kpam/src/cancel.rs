//! Lets another thread cancel planning.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// A flag that cancels planning. Clones share the flag. It cannot be cleared.
#[derive(Debug, Clone, Default)]
pub struct Cancel {
    flag: Arc<AtomicBool>,
    /// Time from which on the flag counts as set, whether or not it was set.
    end: Option<Instant>,
}

impl Cancel {
    /// Creates a flag that is not set.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Sets the flag; planning then ends soon with [`crate::Status::Cancelled`].
    pub fn cancel(&self) {
        self.flag.store(true, Ordering::Relaxed);
    }

    /// Returns the flag with a time from which on it counts as set, too.
    pub(crate) fn until(self, end: Option<Instant>) -> Self {
        Self { end: end.or(self.end), ..self }
    }

    /// Returns whether the flag is set.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        self.flag.load(Ordering::Relaxed) || self.end.is_some_and(|end| Instant::now() >= end)
    }
}

/// Returns the time at which planning that began at `begun` must end. `None` if there is no deadline, or if the clock
/// cannot represent its end.
pub(crate) fn end_of(begun: Instant, deadline: Option<Duration>) -> Option<Instant> {
    deadline.and_then(|time| begun.checked_add(time))
}

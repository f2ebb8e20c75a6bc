//! Ending planning from another thread.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// A flag that planning looks at; clones share it. Once set it stays set.
#[derive(Debug, Clone, Default)]
pub struct Cancel {
    flag: Arc<AtomicBool>,
    /// Time from which on it counts as set.
    end: Option<Instant>,
}

impl Cancel {
    /// Makes a flag that is not set.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Sets the flag: planning ends soon, with [`crate::Status::Cancelled`].
    pub fn cancel(&self) {
        self.flag.store(true, Ordering::Relaxed);
    }

    /// The same flag, which counts as set from a time on.
    pub(crate) fn until(self, end: Option<Instant>) -> Self {
        Self { end: end.or(self.end), ..self }
    }

    /// Whether the flag is set.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        self.flag.load(Ordering::Relaxed) || self.end.is_some_and(|end| Instant::now() >= end)
    }
}

/// Time at which planning that began at `begun` has to end; never where that is too far to tell.
pub(crate) fn end_of(begun: Instant, deadline: Option<Duration>) -> Option<Instant> {
    deadline.and_then(|time| begun.checked_add(time))
}

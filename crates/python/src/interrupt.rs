//! Long work that Ctrl-C can interrupt: it runs on its own thread without the GIL, while the calling thread checks for
//! signals.

use std::sync::Mutex;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread;
use std::time::{Duration, Instant};

use gensim2_kpam::Cancel;
use pyo3::prelude::*;

use crate::KpamError;

/// Interval between two checks for signals.
const POLL: Duration = Duration::from_millis(50);

/// Time that cancelled work gets to end.
const GRACE: Duration = Duration::from_millis(300);

/// Runs `work` on its own thread. If a signal handler raises an exception meanwhile, this function sets the flag
/// `cancel`, waits until `work` ends or [`GRACE`] has passed, and returns the exception. Work that ignores the flag,
/// such as building a tree over millions of triangles, ends later on its thread; its cached results are kept.
pub(crate) fn interruptible<T: Send + 'static>(
    py: Python<'_>,
    cancel: Cancel,
    work: impl FnOnce(&Cancel) -> T + Send + 'static,
) -> PyResult<T> {
    let (sender, receiver) = channel();
    let flag = cancel.clone();
    thread::Builder::new()
        // Sending fails if a signal has made the caller return before the work ended.
        .spawn(move || drop(sender.send(work(&flag))))
        .map_err(|e| KpamError::new_err(format!("threads: cannot be started ({e})")))?;
    let receiver = Mutex::new(receiver);
    loop {
        match wait(py, &receiver) {
            Ok(value) => return Ok(value),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => {
                return Err(KpamError::new_err("internal error: the work ended without a result; please report it"));
            }
        }
        if let Err(raised) = py.check_signals() {
            cancel.cancel();
            let end = Instant::now() + GRACE;
            while Instant::now() < end && matches!(wait(py, &receiver), Err(RecvTimeoutError::Timeout)) {}
            return Err(raised);
        }
    }
}

fn wait<T: Send>(py: Python<'_>, receiver: &Mutex<Receiver<T>>) -> Result<T, RecvTimeoutError> {
    py.detach(|| match receiver.lock() {
        Ok(receiver) => receiver.recv_timeout(POLL),
        Err(_) => Err(RecvTimeoutError::Disconnected),
    })
}

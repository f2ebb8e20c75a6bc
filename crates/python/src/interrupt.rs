//! Long work that Ctrl-C ends: it runs on a thread of its own, without the GIL, while the calling thread listens for
//! signals.

use std::sync::Mutex;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread;
use std::time::{Duration, Instant};

use gensim2_kpam::Cancel;
use pyo3::prelude::*;

use crate::KpamError;

/// Interval at which signals are listened for.
const POLL: Duration = Duration::from_millis(50);

/// Time that work has to end by itself once it is cancelled.
const GRACE: Duration = Duration::from_millis(300);

/// Runs `work`; where a signal handler raises meanwhile, the flag `cancel` that `work` looks at is set, and what the
/// handler raised is handed on: once `work` has ended, or after [`GRACE`] where it has not looked (trees over millions of
/// triangles are built in one go). Its thread then ends by itself, and what it makes for later is kept.
pub(crate) fn interruptible<T: Send + 'static>(
    py: Python<'_>,
    cancel: Cancel,
    work: impl FnOnce(&Cancel) -> T + Send + 'static,
) -> PyResult<T> {
    let (sender, receiver) = channel();
    let flag = cancel.clone();
    thread::Builder::new()
        // The caller has gone where a signal has come.
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

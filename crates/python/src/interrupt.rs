//! Long work that Ctrl-C ends: it runs on a thread of its own, without the GIL, while the calling thread listens for
//! signals.

use std::sync::Mutex;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

use gensim2_kpam::Cancel;
use pyo3::prelude::*;

use crate::KpamError;

/// How often signals are listened for.
const POLL: Duration = Duration::from_millis(50);

/// Runs `work`; where a signal handler raises meanwhile, the flag `cancel` that `work` looks at is set, and what the
/// handler raised is handed on once `work` has ended.
pub(crate) fn interruptible<T: Send>(
    py: Python<'_>,
    cancel: Cancel,
    work: impl FnOnce(&Cancel) -> T + Send,
) -> PyResult<T> {
    let (sender, receiver) = channel();
    let receiver = Mutex::new(receiver);
    thread::scope(|scope| {
        let flag = &cancel;
        thread::Builder::new()
            // Nobody listens any more where a signal has come.
            .spawn_scoped(scope, move || drop(sender.send(work(flag))))
            .map_err(|e| KpamError::new_err(format!("threads: cannot be started ({e})")))?;
        let mut raised = None;
        loop {
            let answer = py.detach(|| match receiver.lock() {
                Ok(receiver) => receiver.recv_timeout(POLL),
                Err(_) => Err(RecvTimeoutError::Disconnected),
            });
            match (answer, raised.take()) {
                (Ok(_) | Err(RecvTimeoutError::Disconnected), Some(error)) => return Err(error),
                (Ok(value), None) => return Ok(value),
                (Err(RecvTimeoutError::Disconnected), None) => {
                    return Err(KpamError::new_err(
                        "internal error: planning ended without a result; please report it",
                    ));
                }
                (Err(RecvTimeoutError::Timeout), Some(error)) => raised = Some(error),
                (Err(RecvTimeoutError::Timeout), None) => {
                    raised = py.check_signals().err();
                    if raised.is_some() {
                        cancel.cancel();
                    }
                }
            }
        }
    })
}

/// Runs `work` that cannot be cancelled on a thread of its own, without the GIL; where a signal handler raises meanwhile,
/// what it raised is handed on at once, and the thread ends by itself.
pub(crate) fn abandonable<T: Send + 'static>(py: Python<'_>, work: impl FnOnce() -> T + Send + 'static) -> PyResult<T> {
    let (sender, receiver) = channel();
    thread::Builder::new()
        .spawn(move || drop(sender.send(work())))
        .map_err(|e| KpamError::new_err(format!("threads: cannot be started ({e})")))?;
    let receiver = Mutex::new(receiver);
    loop {
        let answer = py.detach(|| match receiver.lock() {
            Ok(receiver) => receiver.recv_timeout(POLL),
            Err(_) => Err(RecvTimeoutError::Disconnected),
        });
        match answer {
            Ok(value) => return Ok(value),
            Err(RecvTimeoutError::Timeout) => py.check_signals()?,
            Err(RecvTimeoutError::Disconnected) => {
                return Err(KpamError::new_err("internal error: the work ended without a result; please report it"));
            }
        }
    }
}

//! Long work that Ctrl-C can interrupt: it runs on its own thread without the GIL, while the calling thread checks for
//! signals. Each calling thread keeps one such thread for its next call, because starting one takes longer than many plans.

use std::cell::Cell;
use std::sync::Mutex;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SendError, Sender, channel};
use std::thread;
use std::time::{Duration, Instant};

use gensim2_kpam::Cancel;
use pyo3::prelude::*;

use crate::KpamError;

/// Interval between two checks for signals.
const POLL: Duration = Duration::from_millis(50);

/// Time that cancelled work gets to end.
const GRACE: Duration = Duration::from_millis(300);

type Job = Box<dyn FnOnce() + Send>;

/// Thread that runs jobs, and the process that started it.
struct Worker {
    process: u32,
    jobs: Option<Sender<Job>>,
}

impl Worker {
    fn new(jobs: Sender<Job>) -> Self {
        Self { process: std::process::id(), jobs: Some(jobs) }
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        // A forked process has no such thread, and the thread may have held the lock of the channel.
        if self.process != std::process::id() {
            std::mem::forget(self.jobs.take());
        }
    }
}

thread_local! {
    /// Idle thread that runs the work of this thread.
    static WORKER: Cell<Option<Worker>> = const { Cell::new(None) };
}

/// Passes work to the idle thread, or to a new one if there is none; returns the thread.
fn start(job: Job) -> PyResult<Worker> {
    let job = match WORKER.try_with(Cell::take).ok().flatten() {
        Some(Worker { process, jobs: Some(ref jobs) }) if process == std::process::id() => match jobs.send(job) {
            Ok(()) => return Ok(Worker::new(jobs.clone())),
            Err(SendError(job)) => job,
        },
        _ => job,
    };
    let failed = |e: &dyn std::fmt::Display| KpamError::new_err(format!("threads: cannot be started ({e})"));
    let (worker, jobs) = channel::<Job>();
    thread::Builder::new().spawn(move || jobs.into_iter().for_each(|job| job())).map_err(|e| failed(&e))?;
    worker.send(job).map_err(|e| failed(&e))?;
    Ok(Worker::new(worker))
}

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
    // Sending fails if a signal has made the caller return before the work ended.
    let worker = start(Box::new(move || drop(sender.send(work(&flag)))))?;
    let receiver = Mutex::new(receiver);
    loop {
        match wait(py, &receiver) {
            Ok(value) => {
                // While the calling thread ends, there is no place for the idle thread any more.
                let _ = WORKER.try_with(|idle| idle.set(Some(worker)));
                return Ok(value);
            }
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

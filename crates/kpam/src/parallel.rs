//! Work on several threads.

use rayon::prelude::*;

use crate::ProblemError;

/// Maximum number of threads of [`plan_batch`](crate::plan_batch) and [`plan_to_many`](crate::plan_to_many).
pub const MAX_THREADS: usize = 256;

/// Computes `work` for each item on `threads` threads, 1 to [`MAX_THREADS`]; `None` uses one thread for each processor
/// core. Keeps the order of the items.
pub(crate) fn in_parallel<T: Sync, R: Send>(
    items: &[T],
    threads: Option<usize>,
    work: impl Fn(&T) -> R + Sync + Send,
) -> Result<Vec<R>, ProblemError> {
    if let Some(count) = threads
        && !(1..=MAX_THREADS).contains(&count)
    {
        return Err(ProblemError::new("threads", format!("must be 1 to {MAX_THREADS}, not {count}")));
    }
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads.unwrap_or(cores).min(MAX_THREADS).min(items.len()).max(1))
        .build()
        .map_err(|e| ProblemError::new("threads", format!("cannot be started: {e}")))?;
    Ok(pool.install(|| items.par_iter().map(work).collect()))
}

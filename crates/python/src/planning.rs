//! Python functions that plan problems.

use std::sync::Arc;

use gensim2_kpam::{Cancel, KeypointProblem, Request};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use crate::convert;
use crate::errors::from_problem;
use crate::interrupt::interruptible;
use crate::plan::PyPlan;
use crate::problem::PyKeypointProblem;
use crate::renamed;
use crate::scene::PyCancel;
use crate::transit::deadline;

/// Plans one problem without the GIL; Ctrl-C interrupts. `warm_start` is an earlier plan, whose solution is tried
/// first. `resume` is the label of the next keyframe if q_start lies in the middle of that plan's motion. `max_checks`
/// limits the number of collision checks, and `deadline_ms` the wall-clock time; `cancel` ends planning from another
/// thread. With `explain`, the plan records the result for each tried pose.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
#[pyo3(signature = (problem, *, warm_start = None, resume = None, max_checks = None, deadline_ms = None, cancel = None, explain = false, **others), text_signature = "(problem, *, warm_start=None, resume=None, max_checks=None, deadline_ms=None, cancel=None, explain=False)")]
pub(crate) fn plan(
    py: Python<'_>,
    problem: &Bound<'_, PyKeypointProblem>,
    warm_start: Option<&Bound<'_, PyPlan>>,
    resume: Option<&str>,
    max_checks: Option<u64>,
    deadline_ms: Option<f64>,
    cancel: Option<&Bound<'_, PyCancel>>,
    explain: bool,
    others: Option<&Bound<'_, PyDict>>,
) -> PyResult<PyPlan> {
    let problem = Arc::clone(&problem.get().0);
    let warm_start = warm_start.map(|plan| plan.clone().unbind());
    let warm_start = renamed::keyword(py, warm_start, others, ("former", "warm_start"))?;
    let resume = resume.map(str::to_owned);
    let cancel = cancel.map_or_else(Cancel::new, |c| c.get().0.clone());
    let deadline = deadline_ms.map(deadline).transpose()?;
    let planned = interruptible(py, cancel, move |cancel| {
        let mut request = Request::default();
        request.warm_start = warm_start.as_ref().map(|plan| &plan.get().0);
        (request.resume, request.max_checks, request.deadline) = (resume.as_deref(), max_checks, deadline);
        (request.cancel, request.explain) = (Some(cancel.clone()), explain);
        let planned = gensim2_kpam::plan_with(&problem, &request);
        (planned, warm_start) // which goes where the GIL is held
    })?
    .0;
    planned.map(|(plan, times)| PyPlan(plan, times)).map_err(|e| from_problem(&e))
}

/// Returns at most `max_solutions` distinct joint vectors that meet the problem's constraints, ignoring obstacles,
/// those with the lowest cost first: dicts `q` (n,) and `cost`.
#[pyfunction]
#[pyo3(signature = (problem, max_solutions = None, **others), text_signature = "(problem, max_solutions=10)")]
pub(crate) fn ik<'py>(
    py: Python<'py>,
    problem: &Bound<'py, PyKeypointProblem>,
    max_solutions: Option<usize>,
    others: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyList>> {
    let max_solutions = renamed::keyword(py, max_solutions, others, ("most", "max_solutions"))?.unwrap_or(10);
    let problem = Arc::clone(&problem.get().0);
    let found = py.detach(|| gensim2_kpam::ik(&problem, max_solutions)).map_err(|e| from_problem(&e))?;
    convert::dicts(py, found, |d, pose| {
        d.set_item("q", convert::array1(py, &pose.q))?;
        d.set_item("cost", pose.cost)
    })
}

/// Returns the travel (N,) of the object's joint that the planner assumes at times (N,) of a plan's motion (rad or m,
/// from the joint's current value).
#[pyfunction]
pub(crate) fn joint_travel<'py>(
    py: Python<'py>,
    problem: &Bound<'py, PyKeypointProblem>,
    plan: &Bound<'py, PyPlan>,
    times: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyAny>> {
    let times = convert::vector(times, "times", None)?;
    let (problem, plan) = (&problem.get().0, &plan.get().0);
    let found = py.detach(|| gensim2_kpam::joint_travel(problem, plan, &times));
    Ok(convert::array1(py, &found).into_any())
}

/// Plans several problems on `threads` threads, 1 to 256 (default: number of cores), without the GIL; Ctrl-C
/// interrupts. For any number of threads, the results are the same as those of `plan`, in the order of the problems.
#[pyfunction]
#[pyo3(signature = (problems, threads = None))]
pub(crate) fn plan_batch(
    py: Python<'_>,
    problems: Vec<PyRef<'_, PyKeypointProblem>>,
    threads: Option<usize>,
) -> PyResult<Vec<PyPlan>> {
    let shared: Vec<Arc<KeypointProblem>> = problems.iter().map(|p| Arc::clone(&p.0)).collect();
    drop(problems);
    let plans = interruptible(py, Cancel::new(), move |cancel| {
        let borrowed: Vec<&KeypointProblem> = shared.iter().map(AsRef::as_ref).collect();
        gensim2_kpam::plan_batch(&borrowed, threads, cancel)
    })?;
    let plans = plans.map_err(|e| from_problem(&e))?;
    Ok(plans.into_iter().map(|(plan, times)| PyPlan(plan, times)).collect())
}

/// Returns the smallest signed distances (m) along a plan's motion, sampled every `step` seconds, for the kinds `self`,
/// `table` and `object`; each is None if no such pair comes closer than 1 m. Returns None if the plan has no motion.
#[pyfunction]
pub(crate) fn min_clearance<'py>(
    py: Python<'py>,
    problem: &Bound<'py, PyKeypointProblem>,
    plan: &Bound<'py, PyPlan>,
    step: f64,
) -> PyResult<Option<Bound<'py, PyDict>>> {
    let (problem, plan) = (Arc::clone(&problem.get().0), plan.get().0.clone());
    let found =
        interruptible(py, Cancel::new(), move |cancel| gensim2_kpam::min_clearance(&problem, &plan, step, cancel))?;
    let Some([itself, table, object]) = found.map_err(|e| from_problem(&e))? else { return Ok(None) };
    let out = PyDict::new(py);
    for (name, distance) in [("self", itself), ("table", table), ("object", object)] {
        out.set_item(name, distance.is_finite().then_some(distance))?;
    }
    Ok(Some(out))
}

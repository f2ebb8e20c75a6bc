//! Trajectories, retiming and refinement.

use std::sync::Arc;

use gensim2_kpam::{Braking, Cancel, Limits, RefineOptions, RetimeOptions, SpeedScale, Trajectory};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadwriteArray1, ndarray};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::convert;
use crate::errors::{from_problem, problem_error};
use crate::interrupt::interruptible;
use crate::plan::PyPlan;
use crate::problem::PyKeypointProblem;

/// Maximum number of rows returned for a sampled motion.
const MAX_ROWS: f64 = 1e6;

/// A timed motion of all joints. Instances can be pickled.
#[pyclass(name = "Trajectory", module = "gensim2_kpam", frozen)]
pub(crate) struct PyTrajectory(pub(crate) Trajectory);

#[pymethods]
impl PyTrajectory {
    /// Times (N,) in seconds, including every keyframe time.
    #[getter]
    fn times<'py>(&self, py: Python<'py>) -> Bound<'py, PyAny> {
        convert::array1(py, self.0.times()).into_any()
    }

    /// (N, n) joint positions at `times`.
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> Bound<'py, PyAny> {
        convert::array2(py, &self.0.positions(), self.0.joints()).into_any()
    }

    /// Duration of the motion (s).
    #[getter]
    fn duration(&self) -> f64 {
        self.0.end() - self.0.start()
    }

    /// Returns position, velocity, acceleration at t (s), each (n,), or (N, n) for (N,) times; at rest after the end.
    fn sample<'py>(
        &self,
        py: Python<'py>,
        t: &Bound<'py, PyAny>,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let (times, shape) = convert::numbers(t, "t")?;
        if let Some(time) = times.iter().find(|t| !t.is_finite()) {
            return Err(problem_error("t", format!("{time} is not finite")));
        }
        if shape.is_empty() {
            let s = self.0.sample(times[0]);
            let array = |v: &[f64]| convert::array1(py, v).into_any();
            return Ok((array(&s.position), array(&s.velocity), array(&s.acceleration)));
        }
        if shape.len() != 1 {
            return Err(problem_error("t", format!("must be a number or have shape (N,), not {shape:?}")));
        }
        let joints = self.0.joints();
        let samples: Vec<_> = py.detach(|| times.iter().map(|t| self.0.sample(*t)).collect());
        let array = |part: fn(&gensim2_kpam::Sample) -> &[f64]| {
            let shape = (samples.len(), joints);
            let table = ndarray::Array2::from_shape_fn(shape, |(r, c)| part(&samples[r])[c]);
            PyArray2::from_owned_array(py, table).into_any()
        };
        Ok((array(|s| &s.position), array(|s| &s.velocity), array(|s| &s.acceleration)))
    }

    /// Returns positions (ceil(duration / dt) + 1, n), one row every `dt` seconds; the last row is the end.
    fn sample_every<'py>(&self, py: Python<'py>, dt: f64) -> PyResult<Bound<'py, PyAny>> {
        let (start, end) = (self.0.start(), self.0.end());
        let steps = ((end - start) / dt - 1e-9).ceil();
        if !(dt > 0.0 && dt.is_finite() && steps < MAX_ROWS) {
            let least = (end - start) / MAX_ROWS;
            return Err(problem_error(
                "dt",
                format!("must be above {least:.3e} s for at most {MAX_ROWS:e} rows, not {dt}"),
            ));
        }
        let rows: Vec<Vec<f64>> =
            (0..=steps as usize).map(|k| self.0.sample((start + dt * k as f64).min(end)).position).collect();
        Ok(convert::array2(py, &rows, self.0.joints()).into_any())
    }

    /// Write position, velocity and acceleration at t into three contiguous float64 arrays (n,), without allocating
    /// memory.
    fn sample_into(
        &self,
        t: f64,
        position: &Bound<'_, PyArray1<f64>>,
        velocity: &Bound<'_, PyArray1<f64>>,
        acceleration: &Bound<'_, PyArray1<f64>>,
    ) -> PyResult<()> {
        if !t.is_finite() {
            return Err(problem_error("t", format!("{t} is not finite")));
        }
        let (mut position, mut velocity, mut acceleration) =
            (writable(position, "position")?, writable(velocity, "velocity")?, writable(acceleration, "acceleration")?);
        let slice = |field: &'static str| move |_| problem_error(field, "must be contiguous");
        self.0
            .sample_into(
                t,
                position.as_slice_mut().map_err(slice("position"))?,
                velocity.as_slice_mut().map_err(slice("velocity"))?,
                acceleration.as_slice_mut().map_err(slice("acceleration"))?,
            )
            .map_err(|e| from_problem(&e))
    }

    /// Return the fastest stop from the state at t, within the limits and along the path of the motion.
    fn brake(&self, py: Python<'_>, t: f64) -> PyResult<Self> {
        py.detach(|| self.0.brake(t)).map(Self).map_err(|e| from_problem(&e))
    }

    /// Return this motion until t and `next` from t on; both must have the same state at t (within 1e-6).
    fn splice(&self, py: Python<'_>, next: &Bound<'_, Self>, t: f64) -> PyResult<Self> {
        let next = &next.get().0;
        py.detach(|| self.0.splice(next, t)).map(Self).map_err(|e| from_problem(&e))
    }

    /// Return the part of this motion from t on.
    fn since(&self, t: f64) -> PyResult<Self> {
        self.0.since(t).map(Self).map_err(|e| from_problem(&e))
    }

    #[staticmethod]
    fn _thaw(bytes: &[u8]) -> PyResult<Self> {
        convert::thaw(bytes).map(Self)
    }

    fn __repr__(&self) -> String {
        let (start, end) = (self.0.start(), self.0.end());
        format!("Trajectory({} joints, {start:.2} to {end:.2} s)", self.0.joints())
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        Ok((py.get_type::<Self>().getattr("_thaw")?, (PyBytes::new(py, &convert::freeze(&self.0)?),)))
    }
}

/// Executes a motion at a speed scale that may change in every step.
#[pyclass(name = "SpeedScale", module = "gensim2_kpam")]
pub(crate) struct PySpeedScale {
    scaled: SpeedScale,
    /// Position, velocity and acceleration of all joints after the last step.
    state: [Vec<f64>; 3],
}

#[pymethods]
impl PySpeedScale {
    #[new]
    #[pyo3(signature = (motion, dt = 0.001))]
    fn new(motion: &Bound<'_, PyTrajectory>, dt: f64) -> PyResult<Self> {
        let motion = motion.get().0.clone();
        let start = motion.sample(motion.start());
        let state = [start.position, start.velocity, start.acceleration];
        SpeedScale::new(motion, dt).map(|scaled| Self { scaled, state }).map_err(|e| from_problem(&e))
    }

    /// Advances by one step toward the speed scale `target`, 0 to 1, and returns position, velocity and acceleration,
    /// each (n,).
    fn step<'py>(
        &mut self,
        py: Python<'py>,
        target: f64,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let Self { scaled, state: [q, v, a] } = self;
        scaled.step(target, q, v, a).map_err(|e| from_problem(&e))?;
        let array = |v: &[f64]| convert::array1(py, v).into_any();
        Ok((array(q), array(v), array(a)))
    }

    /// Time of the motion (s) at which the robot is.
    #[getter]
    fn time(&self) -> f64 {
        self.scaled.time()
    }

    /// Current speed scale, 0 to 1.
    #[getter]
    fn scale(&self) -> f64 {
        self.scaled.scale()
    }

    /// Whether the robot has reached the end of the motion.
    #[getter]
    fn is_finished(&self) -> bool {
        self.scaled.is_finished()
    }

    fn __repr__(&self) -> String {
        format!("SpeedScale(at {:.3} s of the motion, scale {:.3})", self.scaled.time(), self.scaled.scale())
    }
}

fn writable<'py>(array: &Bound<'py, PyArray1<f64>>, field: &str) -> PyResult<PyReadwriteArray1<'py, f64>> {
    if !convert::is_aligned(array) {
        return Err(problem_error(field, "must be contiguous and aligned"));
    }
    array.try_readwrite().map_err(|e| problem_error(field, format!("cannot be written: {e}")))
}

/// Returns the fastest motion along the spline through waypoints (N, n) within velocity, acceleration and jerk limits
/// (n,), with stops at the waypoints with indices `stops` and at the last; and the times (N,) of the waypoints.
#[pyfunction]
#[pyo3(signature = (
    waypoints, velocity_limits, acceleration_limits, jerk_limits, *, stops = Vec::new(), slowest = None,
    start_velocity = None, start_acceleration = None, start_time = 0.0, position_limits = None, braking = None
))]
#[allow(clippy::too_many_arguments)]
pub(crate) fn retime<'py>(
    py: Python<'py>,
    waypoints: &Bound<'py, PyAny>,
    velocity_limits: &Bound<'py, PyAny>,
    acceleration_limits: &Bound<'py, PyAny>,
    jerk_limits: &Bound<'py, PyAny>,
    stops: Vec<usize>,
    slowest: Option<&Bound<'py, PyAny>>,
    start_velocity: Option<&Bound<'py, PyAny>>,
    start_acceleration: Option<&Bound<'py, PyAny>>,
    start_time: f64,
    position_limits: Option<(Bound<'py, PyAny>, Bound<'py, PyAny>)>,
    braking: Option<Vec<Option<[f64; 4]>>>,
) -> PyResult<(PyTrajectory, Bound<'py, PyAny>)> {
    let limits = Limits::new(
        &convert::list(velocity_limits, "velocity_limits")?,
        &convert::list(acceleration_limits, "acceleration_limits")?,
        &convert::list(jerk_limits, "jerk_limits")?,
    );
    let bounds = braking.map(|list| {
        let one = |[upper, lower, gain, offset]: [f64; 4]| Braking { upper, lower, gain, offset };
        list.into_iter().map(|b| b.map(one)).collect::<Vec<_>>()
    });
    let limits = match bounds {
        Some(list) => limits.and_then(|l| l.with_braking(&list)),
        None => limits,
    }
    .map_err(|e| from_problem(&e))?;
    let (data, shape) = convert::numbers(waypoints, "waypoints")?;
    if shape.len() != 2 || shape[1] != limits.joints() {
        let message = format!("must have shape (N, {}), not {shape:?}", limits.joints());
        return Err(problem_error("waypoints", message));
    }
    let rows: Vec<Vec<f64>> = data.chunks_exact(limits.joints()).map(<[f64]>::to_vec).collect();
    let optional = |value: Option<&Bound<'_, PyAny>>, field: &str| {
        value.map(|v| convert::vector(v, field, Some(limits.joints()))).transpose()
    };
    let mut options = RetimeOptions::default();
    options.stops = stops;
    options.slowest = slowest.map(|v| convert::vector(v, "slowest", None)).transpose()?.unwrap_or_default();
    options.start_velocity = optional(start_velocity, "start_velocity")?;
    options.start_acceleration = optional(start_acceleration, "start_acceleration")?;
    options.start_time = start_time;
    options.position_limits = position_limits
        .map(|(lower, upper)| {
            PyResult::Ok((convert::list(&lower, "position_limits[0]")?, convert::list(&upper, "position_limits[1]")?))
        })
        .transpose()?;
    let cancel = Cancel::new();
    options.cancel = Some(cancel.clone());
    let found = interruptible(py, cancel, move |_| gensim2_kpam::retime(&rows, &limits, &options))?;
    let out = found.map_err(|e| from_problem(&e))?;
    Ok((PyTrajectory(out.trajectory), convert::array1(py, &out.times).into_any()))
}

/// Shortens a plan's waypoint path by sequential quadratic programming; returns a dict of `waypoints` (N, n), `times`
/// (N,), `keyframes` (indices of their waypoints), `cost_before`, `cost_after` and `rounds`.
#[pyfunction]
#[pyo3(signature = (problem, plan, *, times = None, keep_paths = false))]
pub(crate) fn refine<'py>(
    py: Python<'py>,
    problem: &Bound<'py, PyKeypointProblem>,
    plan: &Bound<'py, PyPlan>,
    times: Option<&Bound<'py, PyAny>>,
    keep_paths: bool,
) -> PyResult<Bound<'py, PyDict>> {
    let mut options = RefineOptions::default();
    options.times = times.map(|v| convert::vector(v, "times", None)).transpose()?;
    options.keep_paths = keep_paths;
    let (problem, plan) = (Arc::clone(&problem.get().0), plan.get().0.clone());
    let columns = problem.robot().joints().len();
    let found = interruptible(py, Cancel::new(), move |_| gensim2_kpam::refine(&problem, &plan, &options))?
        .map_err(|e| from_problem(&e))?;
    let out = PyDict::new(py);
    out.set_item("waypoints", convert::array2(py, &found.waypoints, columns))?;
    out.set_item("times", convert::array1(py, &found.times))?;
    out.set_item("keyframes", found.keyframes)?;
    out.set_item("cost_before", found.cost_before)?;
    out.set_item("cost_after", found.cost_after)?;
    out.set_item("rounds", found.rounds)?;
    Ok(out)
}

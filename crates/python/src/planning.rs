//! Configs, problems, plans, trajectories.

use std::collections::BTreeMap;
use std::sync::Arc;

use gensim2_kpam::{CollisionCheck, Gripper, KeypointProblem, Options, Plan, SolverConfig, StageTimes, Trajectory};
use nalgebra::Vector3;
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList, PyMapping};

use crate::convert::{self, problem_error};
use crate::geometry::{PyBody, PyJoint, PyRobot};
use crate::{ConfigError, KpamError, ProblemError};

/// A validated solver config. Unknown fields, unknown types and non-finite numbers raise ConfigError naming the field.
#[pyclass(name = "SolverConfig", module = "gensim2_kpam", frozen)]
pub(crate) struct PySolverConfig(SolverConfig);

#[pymethods]
impl PySolverConfig {
    #[new]
    fn new(config: &Bound<'_, PyAny>) -> PyResult<Self> {
        let value = convert::json(config, "", 0)?;
        SolverConfig::from_value(&value).map(Self).map_err(|e| ConfigError::new_err(e.to_string()))
    }

    /// The config as it was given.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let value = serde_json::from_str(&self.0.source).map_err(|e| KpamError::new_err(e.to_string()))?;
        convert::python(py, &value)
    }

    #[getter]
    fn gripper(&self) -> &'static str {
        match self.0.gripper {
            Gripper::Open => "open",
            Gripper::Closed => "closed",
            Gripper::Grasp => "grasp",
        }
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyAny>,))> {
        Ok((py.get_type::<Self>().into_any(), (self.to_dict(py)?,)))
    }
}

fn keypoints(value: &Bound<'_, PyAny>, field: &str) -> PyResult<BTreeMap<String, Vector3<f64>>> {
    let mapping = value.cast::<PyMapping>().map_err(|_| problem_error(field, "must map names to (3,) arrays"))?;
    let mut out = BTreeMap::new();
    for item in mapping.items()?.iter() {
        let (name, point): (Bound<'_, PyAny>, Bound<'_, PyAny>) = item.extract()?;
        let name: String = name.extract().map_err(|_| problem_error(field, "has a name that is not text"))?;
        let point = convert::vector3(&point, &format!("{field}[{name:?}]"))?;
        out.insert(name, point);
    }
    Ok(out)
}

/// Everything one plan needs; checked on construction. Pickles.
#[pyclass(name = "KeypointProblem", module = "gensim2_kpam", frozen)]
pub(crate) struct PyKeypointProblem(Arc<KeypointProblem>);

#[pymethods]
impl PyKeypointProblem {
    #[new]
    #[pyo3(signature = (
        robot, config, q_start, *, tool_keypoints, object_keypoints, T_base_object, joint = None, object_axis = "y",
        object_yaw = 0.0, T_base_world = None, bodies = Vec::new(), options = None
    ))]
    #[allow(non_snake_case, clippy::too_many_arguments)]
    fn new(
        robot: &Bound<'_, PyRobot>,
        config: &Bound<'_, PySolverConfig>,
        q_start: &Bound<'_, PyAny>,
        tool_keypoints: &Bound<'_, PyAny>,
        object_keypoints: &Bound<'_, PyAny>,
        T_base_object: &Bound<'_, PyAny>,
        joint: Option<&Bound<'_, PyJoint>>,
        object_axis: &str,
        object_yaw: f64,
        T_base_world: Option<&Bound<'_, PyAny>>,
        bodies: Vec<PyRef<'_, PyBody>>,
        options: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let options = match options {
            None => Options::default(),
            Some(o) => {
                let value = convert::json(o, "options", 0)?;
                serde_json::from_value(value).map_err(|e| problem_error("options", e))?
            }
        };
        let object_axis = match object_axis {
            "x" => 0,
            "y" => 1,
            "z" => 2,
            other => return Err(problem_error("object_axis", format!("must be x, y or z, not {other:?}"))),
        };
        let problem = KeypointProblem {
            robot: Arc::clone(&robot.get().0),
            config: config.get().0.clone(),
            q_start: convert::vector(q_start, "q_start", None)?,
            tool_keypoints: keypoints(tool_keypoints, "tool_keypoints")?,
            object_keypoints: keypoints(object_keypoints, "object_keypoints")?,
            object: convert::pose(T_base_object, "T_base_object")?,
            joint: joint.map(|j| j.get().0),
            object_axis,
            object_yaw,
            world: convert::optional_pose(T_base_world, "T_base_world")?,
            bodies: bodies.iter().map(|b| b.0.clone()).collect(),
            options,
        };
        problem.check().map_err(|e| ProblemError::new_err(e.to_string()))?;
        Ok(Self(Arc::new(problem)))
    }

    #[staticmethod]
    fn _thaw(bytes: &[u8]) -> PyResult<Self> {
        convert::thaw(bytes).map(|p| Self(Arc::new(p)))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        let bytes = convert::freeze(self.0.as_ref())?;
        Ok((py.get_type::<Self>().getattr("_thaw")?, (PyBytes::new(py, &bytes),)))
    }
}

/// Timed joint motion. Pickles.
#[pyclass(name = "Trajectory", module = "gensim2_kpam", frozen)]
pub(crate) struct PyTrajectory(Trajectory);

#[pymethods]
impl PyTrajectory {
    /// (N,) seconds; every keyframe time is among them.
    #[getter]
    fn times<'py>(&self, py: Python<'py>) -> Bound<'py, PyAny> {
        convert::array1(py, self.0.times()).into_any()
    }

    /// (N, n) joint positions at `times`.
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> Bound<'py, PyAny> {
        let rows = self.0.positions();
        let columns = rows.first().map_or(0, Vec::len);
        convert::array2(py, &rows, columns).into_any()
    }

    /// Seconds from the first waypoint to the last.
    #[getter]
    fn duration(&self) -> f64 {
        self.0.end() - self.0.start()
    }

    /// Position, velocity, acceleration at t, each (n,); at rest before the start and after the end.
    fn sample<'py>(&self, py: Python<'py>, t: f64) -> (Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>) {
        let s = self.0.sample(t);
        let array = |v: &[f64]| convert::array1(py, v).into_any();
        (array(&s.position), array(&s.velocity), array(&s.acceleration))
    }

    /// (ceil(duration / dt) + 1, n) positions, the last one at the end.
    fn sample_every<'py>(&self, py: Python<'py>, dt: f64) -> PyResult<Bound<'py, PyAny>> {
        let (start, end) = (self.0.start(), self.0.end());
        let steps = ((end - start) / dt - 1e-9).ceil();
        if !(dt > 0.0 && steps < 1e7) {
            return Err(problem_error("dt", format!("must be positive and not tiny, not {dt}")));
        }
        let rows: Vec<Vec<f64>> =
            (0..=steps as usize).map(|k| self.0.sample((start + dt * k as f64).min(end)).position).collect();
        let columns = rows.first().map_or(0, Vec::len);
        Ok(convert::array2(py, &rows, columns).into_any())
    }

    #[staticmethod]
    fn _thaw(bytes: &[u8]) -> PyResult<Self> {
        convert::thaw(bytes).map(Self)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        Ok((py.get_type::<Self>().getattr("_thaw")?, (PyBytes::new(py, &convert::freeze(&self.0)?),)))
    }
}

/// What was solved, each residual, what failed. Pickles.
#[pyclass(name = "Plan", module = "gensim2_kpam", frozen)]
pub(crate) struct PyPlan(pub Plan, pub StageTimes);

fn optional<'py>(py: Python<'py>, q: Option<&Vec<f64>>) -> Option<Bound<'py, PyAny>> {
    q.map(|q| convert::array1(py, q).into_any())
}

#[pymethods]
impl PyPlan {
    #[getter]
    fn status(&self) -> &'static str {
        self.0.status.name()
    }

    #[getter]
    fn reason(&self) -> &str {
        &self.0.reason
    }

    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.0.warnings.clone()
    }

    #[getter]
    fn q_actuation<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyAny>> {
        optional(py, self.0.q_actuation.as_ref())
    }

    #[getter]
    fn q_plan<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyAny>> {
        optional(py, self.0.q_plan.as_ref())
    }

    #[getter]
    fn q_best_effort<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyAny>> {
        optional(py, self.0.q_best_effort.as_ref())
    }

    #[getter]
    fn cost(&self) -> Option<f64> {
        self.0.cost
    }

    /// Thread CPU time (ms) that planning took: `actuation`, `trajectory`, `total`. Not part of what pickles.
    #[getter]
    fn cpu_ms<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let out = PyDict::new(py);
        out.set_item("actuation", 1e3 * self.1.actuation)?;
        out.set_item("trajectory", 1e3 * self.1.trajectory)?;
        out.set_item("total", 1e3 * (self.1.actuation + self.1.trajectory))?;
        Ok(out)
    }

    #[getter]
    fn reached_fraction(&self) -> f64 {
        self.0.reached_fraction
    }

    #[getter]
    fn start_overlap(&self) -> f64 {
        self.0.start_overlap
    }

    #[getter]
    fn residuals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let out = PyList::empty(py);
        for r in &self.0.residuals {
            let d = PyDict::new(py);
            d.set_item("name", &r.name)?;
            d.set_item("residual", r.residual)?;
            d.set_item("tolerance", r.tolerance)?;
            d.set_item("satisfied", r.satisfied)?;
            out.append(d)?;
        }
        Ok(out)
    }

    #[getter]
    fn keyframes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let out = PyList::empty(py);
        for k in &self.0.keyframes {
            let d = PyDict::new(py);
            d.set_item("label", &k.label)?;
            d.set_item("time", k.time)?;
            let rows: Vec<Vec<f64>> = k.hand.iter().map(|r| r.to_vec()).collect();
            d.set_item("T_base_hand", convert::array2(py, &rows, 4))?;
            d.set_item("reached", k.reached)?;
            out.append(d)?;
        }
        Ok(out)
    }

    #[getter]
    fn collisions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let out = PyList::empty(py);
        for c in &self.0.collisions {
            let d = PyDict::new(py);
            d.set_item("bodies", (&c.bodies[0], &c.bodies[1]))?;
            d.set_item("time", c.time)?;
            d.set_item("toward", &c.toward)?;
            d.set_item("distance", c.distance)?;
            d.set_item("point", convert::array1(py, &c.point))?;
            out.append(d)?;
        }
        Ok(out)
    }

    #[getter]
    fn trajectory(&self) -> Option<PyTrajectory> {
        self.0.trajectory.clone().map(PyTrajectory)
    }

    /// Plain values, as JSON holds them; the trajectory as `times` and `positions`.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let mut value = serde_json::to_value(&self.0).map_err(|e| KpamError::new_err(e.to_string()))?;
        if let (Some(map), Some(t)) = (value.as_object_mut(), &self.0.trajectory) {
            map.insert("trajectory".to_owned(), serde_json::json!({"times": t.times(), "positions": t.positions()}));
        }
        convert::python(py, &value)
    }

    #[staticmethod]
    fn _thaw(bytes: &[u8]) -> PyResult<Self> {
        convert::thaw(bytes).map(|plan| Self(plan, StageTimes::default()))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        Ok((py.get_type::<Self>().getattr("_thaw")?, (PyBytes::new(py, &convert::freeze(&self.0)?),)))
    }

    fn __repr__(&self) -> String {
        format!("Plan({}: {})", self.0.status.name(), self.0.reason)
    }
}

/// Plans one problem. The GIL is released meanwhile.
#[pyfunction]
pub(crate) fn plan(py: Python<'_>, problem: &Bound<'_, PyKeypointProblem>) -> PyPlan {
    let problem = Arc::clone(&problem.get().0);
    let (plan, times) = py.detach(|| gensim2_kpam::plan_timed(&problem));
    PyPlan(plan, times)
}

/// Plans many problems on `threads` threads (default: all cores), the GIL released. Results are those of `plan`, in
/// order, whatever the number of threads.
#[pyfunction]
#[pyo3(signature = (problems, threads = None))]
pub(crate) fn plan_batch(
    py: Python<'_>,
    problems: Vec<PyRef<'_, PyKeypointProblem>>,
    threads: Option<usize>,
) -> PyResult<Vec<PyPlan>> {
    if threads == Some(0) {
        return Err(problem_error("threads", "must be at least 1"));
    }
    let shared: Vec<Arc<KeypointProblem>> = problems.iter().map(|p| Arc::clone(&p.0)).collect();
    drop(problems);
    let plans = py.detach(|| {
        let borrowed: Vec<&KeypointProblem> = shared.iter().map(AsRef::as_ref).collect();
        gensim2_kpam::plan_batch(&borrowed, threads)
    });
    plans.map(|p| p.into_iter().map(|(plan, times)| PyPlan(plan, times)).collect()).map_err(KpamError::new_err)
}

/// Smallest signed distances (m) of the judged pairs along a plan's motion, sampled every `step` seconds: `self`,
/// `table`, `object`. None where the plan has no motion.
#[pyfunction]
pub(crate) fn min_clearance<'py>(
    py: Python<'py>,
    problem: &Bound<'py, PyKeypointProblem>,
    plan: &Bound<'py, PyPlan>,
    step: f64,
) -> PyResult<Option<Bound<'py, PyDict>>> {
    if step.is_nan() || step <= 0.0 {
        return Err(problem_error("step", format!("must be positive, not {step}")));
    }
    let (problem, plan) = (&problem.get().0, &plan.get().0);
    let Some([itself, table, object]) = py.detach(|| gensim2_kpam::min_clearance(problem, plan, step)) else {
        return Ok(None);
    };
    let out = PyDict::new(py);
    out.set_item("self", itself)?;
    out.set_item("table", table)?;
    out.set_item("object", object)?;
    Ok(Some(out))
}

/// Whether the robot overlaps a body or itself at each configuration: (n,) -> bool, (N, n) -> (N,) bool.
#[pyfunction]
pub(crate) fn in_collision<'py>(
    py: Python<'py>,
    problem: &Bound<'py, PyKeypointProblem>,
    q: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyAny>> {
    let problem = &problem.get().0;
    let n = problem.robot.joints().len();
    let (data, count) = convert::joint_rows(q, n)?;
    let hits: Vec<bool> = py.detach(|| {
        let mut check = CollisionCheck::new(problem);
        data.chunks_exact(n).map(|row| check.hits(row)).collect()
    });
    if count.is_none() {
        return Ok(hits[0].into_pyobject(py)?.to_owned().into_any());
    }
    Ok(PyArray1::from_vec(py, hits).into_any())
}

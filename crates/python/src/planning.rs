//! Configs, problems, plans, trajectories.

use std::collections::BTreeMap;
use std::sync::Arc;

use gensim2_kpam::config::Constraint;
use gensim2_kpam::{Body, Cancel, KeypointProblem, KeypointProblemBuilder, Plan, Request, SolverConfig, StageTimes};
use nalgebra::Vector3;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList, PyMapping};
use serde::de::DeserializeOwned;

use crate::KpamError;
use crate::convert;
use crate::errors::{config_error, from_config, from_problem, problem_error};
use crate::geometry::{PyBody, PyJoint, PyRobot};
use crate::interrupt::interruptible;
use crate::scene::{PyCancel, PyScene};
use crate::timing::PyTrajectory;

/// A validated solver config. Unknown fields, unknown types and non-finite numbers raise ConfigError naming the field.
#[pyclass(name = "SolverConfig", module = "gensim2_kpam", frozen)]
pub(crate) struct PySolverConfig(SolverConfig);

#[pymethods]
impl PySolverConfig {
    #[new]
    fn new(config: &Bound<'_, PyAny>) -> PyResult<Self> {
        let value = convert::json(config, "", 0, config_error)?;
        SolverConfig::from_value(&value).map(Self).map_err(|e| from_config(&e))
    }

    /// The config as it was given.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let value = serde_json::from_str(self.0.source()).map_err(|e| KpamError::new_err(e.to_string()))?;
        convert::python(py, &value)
    }

    #[getter]
    fn gripper(&self) -> &'static str {
        self.0.gripper().name()
    }

    /// How far (m) the hand moves back at the end, once it has let go; None where it stays.
    #[getter]
    fn let_go(&self) -> Option<f64> {
        self.0.let_go()
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyAny>,))> {
        Ok((py.get_type::<Self>().into_any(), (self.to_dict(py)?,)))
    }

    fn __repr__(&self) -> String {
        let config = &self.0;
        let constraints: Vec<String> = config.constraints().iter().map(Constraint::name).collect();
        format!(
            "SolverConfig({}; {} motions before and {} after; gripper {})",
            constraints.join(", "),
            config.pre().len(),
            config.post().len(),
            config.gripper().name()
        )
    }
}

/// Names of bodies with their roles; the first of many.
pub(crate) fn bodies_listed(bodies: &[Body]) -> String {
    const MOST: usize = 10;
    if bodies.is_empty() {
        return "none".to_owned();
    }
    let mut listed: Vec<String> =
        bodies.iter().take(MOST).map(|b| format!("{} ({})", b.name(), b.role().name())).collect();
    if bodies.len() > MOST {
        listed.push(format!("{} more", bodies.len() - MOST));
    }
    listed.join(", ")
}

pub(crate) fn keypoints(value: &Bound<'_, PyAny>, field: &str) -> PyResult<BTreeMap<String, Vector3<f64>>> {
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

/// Options from a mapping, or the defaults; errors name the option.
pub(crate) fn read_options<O: DeserializeOwned + Default>(value: Option<&Bound<'_, PyAny>>) -> PyResult<O> {
    match value {
        None => Ok(O::default()),
        Some(o) => {
            let value = convert::json(o, "options", 0, problem_error)?;
            serde_path_to_error::deserialize(value).map_err(|e| match e.path().to_string().as_str() {
                "." => problem_error("options", e.inner()),
                path => problem_error(&format!("options.{path}"), e.inner()),
            })
        }
    }
}

/// What a problem asks, beside what it is asked of.
#[allow(non_snake_case)]
pub(crate) struct Question<'a, 'py> {
    pub config: &'a Bound<'py, PySolverConfig>,
    pub q_start: &'a Bound<'py, PyAny>,
    pub tool_keypoints: Option<&'a Bound<'py, PyAny>>,
    pub object_keypoints: Option<&'a Bound<'py, PyAny>>,
    pub T_base_object: Option<&'a Bound<'py, PyAny>>,
    pub object_axis: &'a str,
    pub object_yaw: f64,
    pub T_base_world: Option<&'a Bound<'py, PyAny>>,
    pub options: Option<&'a Bound<'py, PyAny>>,
}

impl Question<'_, '_> {
    pub fn config(&self) -> SolverConfig {
        self.config.get().0.clone()
    }

    pub fn q_start(&self) -> PyResult<Vec<f64>> {
        convert::vector(self.q_start, "q_start", None)
    }

    /// The problem that is asked of what the builder has: robot, bodies, joint.
    pub fn asked_of(&self, builder: KeypointProblemBuilder) -> PyResult<PyKeypointProblem> {
        let object_axis = match self.object_axis {
            "x" => 0,
            "y" => 1,
            "z" => 2,
            other => return Err(problem_error("object_axis", format!("must be x, y or z, not {other:?}"))),
        };
        let named = |value: Option<&Bound<'_, PyAny>>, field: &str| {
            value.map_or_else(|| Ok(BTreeMap::new()), |v| keypoints(v, field))
        };
        builder
            .options(read_options(self.options)?)
            .tool_keypoints(named(self.tool_keypoints, "tool_keypoints")?)
            .object_keypoints(named(self.object_keypoints, "object_keypoints")?)
            .object(convert::optional_pose(self.T_base_object, "T_base_object")?)
            .object_axis(object_axis)
            .object_yaw(self.object_yaw)
            .world(convert::optional_pose(self.T_base_world, "T_base_world")?)
            .build()
            .map(|p| PyKeypointProblem(Arc::new(p)))
            .map_err(|e| from_problem(&e))
    }
}

/// Everything one plan needs; checked on construction. Pickles.
#[pyclass(name = "KeypointProblem", module = "gensim2_kpam", frozen)]
pub(crate) struct PyKeypointProblem(pub Arc<KeypointProblem>);

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
        let question = Question {
            config,
            q_start,
            tool_keypoints: Some(tool_keypoints),
            object_keypoints: Some(object_keypoints),
            T_base_object: Some(T_base_object),
            object_axis,
            object_yaw,
            T_base_world,
            options,
        };
        let bodies: Vec<Body> = bodies.iter().map(|b| b.0.clone()).collect();
        let robot = Arc::clone(&robot.get().0);
        let builder = KeypointProblem::builder(robot, question.config(), question.q_start()?).bodies(bodies);
        question.asked_of(match joint {
            Some(joint) => builder.joint(joint.get().0),
            None => builder,
        })
    }

    /// The same problem from another state: joints (n,), their velocity (n,) (at rest where none is given), and the time
    /// (s) on the motion's clock.
    #[pyo3(signature = (q, velocity = None, time = 0.0))]
    fn with_start(&self, q: &Bound<'_, PyAny>, velocity: Option<&Bound<'_, PyAny>>, time: f64) -> PyResult<Self> {
        let q = convert::vector(q, "q", None)?;
        let velocity = velocity.map(|v| convert::vector(v, "velocity", None)).transpose()?;
        self.0.with_start(q, velocity, time).map(|p| Self(Arc::new(p))).map_err(|e| from_problem(&e))
    }

    /// The scene that it is asked of; a joint is named "joint" there.
    #[getter]
    fn scene(&self) -> PyScene {
        PyScene(self.0.scene())
    }

    #[staticmethod]
    fn _thaw(bytes: &[u8]) -> PyResult<Self> {
        convert::thaw(bytes).map(|p| Self(Arc::new(p)))
    }

    fn __repr__(&self) -> String {
        let problem = &self.0;
        let names = |points: &BTreeMap<String, Vector3<f64>>| points.keys().cloned().collect::<Vec<_>>().join(", ");
        let constraints: Vec<String> = problem.config().constraints().iter().map(Constraint::name).collect();
        format!(
            "KeypointProblem({:?} with {} joints; {}; tool keypoints: {}; object keypoints: {}; {}; bodies: {})",
            problem.robot().name(),
            problem.q_start().len(),
            constraints.join(", "),
            names(problem.tool_keypoints()),
            names(problem.object_keypoints()),
            problem.joint().map_or_else(|| "no joint".to_owned(), |j| format!("joint at {:.3}", j.value())),
            bodies_listed(problem.bodies())
        )
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        let bytes = convert::freeze(self.0.as_ref())?;
        Ok((py.get_type::<Self>().getattr("_thaw")?, (PyBytes::new(py, &bytes),)))
    }
}

/// What was solved, each residual, what failed. Pickles.
#[pyclass(name = "Plan", module = "gensim2_kpam", frozen)]
pub(crate) struct PyPlan(pub(crate) Plan, pub(crate) StageTimes);

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

    /// Number of poses whose motion was tried.
    #[getter]
    fn tried(&self) -> usize {
        self.0.tried
    }

    /// What became of each pose that was tried, where that was asked for: dicts `q`, `rank`, `status`, `reason`.
    #[getter]
    fn tried_poses<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let out = PyList::empty(py);
        for pose in &self.0.tried_poses {
            let d = PyDict::new(py);
            d.set_item("q", convert::array1(py, &pose.q))?;
            d.set_item("rank", pose.rank)?;
            d.set_item("status", pose.status.name())?;
            d.set_item("reason", &pose.reason)?;
            out.append(d)?;
        }
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
        let plan = &self.0;
        let motion = plan.trajectory.as_ref().map_or_else(
            || "no motion".to_owned(),
            |t| {
                let met = plan.keyframes.iter().filter(|k| k.time.is_some()).map(|k| k.label.as_str());
                format!("{:.2} s by {}", t.end() - t.start(), met.collect::<Vec<_>>().join(", "))
            },
        );
        format!("Plan({}: {}; {motion})", plan.status.name(), plan.reason)
    }
}

/// Plans one problem; the GIL is released meanwhile, and Ctrl-C ends it. `former` is an earlier plan, tried first; `resume` the keyframe to go
/// on to from q_start in the middle of that plan's motion; `max_checks` ends planning after so many collision checks,
/// `cancel` from another thread; with `explain` the plan says what became of each pose that was tried.
#[pyfunction]
#[pyo3(signature = (problem, *, former = None, resume = None, max_checks = None, cancel = None, explain = false))]
pub(crate) fn plan(
    py: Python<'_>,
    problem: &Bound<'_, PyKeypointProblem>,
    former: Option<&Bound<'_, PyPlan>>,
    resume: Option<&str>,
    max_checks: Option<u64>,
    cancel: Option<&Bound<'_, PyCancel>>,
    explain: bool,
) -> PyResult<PyPlan> {
    let problem = Arc::clone(&problem.get().0);
    let former = former.map(|plan| &plan.get().0);
    let cancel = cancel.map_or_else(Cancel::new, |c| c.get().0.clone());
    let mut request = Request::default();
    (request.former, request.resume, request.most_checks) = (former, resume, max_checks);
    (request.cancel, request.explain) = (Some(cancel.clone()), explain);
    let planned = interruptible(py, cancel, |_| gensim2_kpam::plan_with(&problem, &request))?;
    planned.map(|(plan, times)| PyPlan(plan, times)).map_err(|e| from_problem(&e))
}

/// The cheapest distinct poses that meet the problem's constraints, cheapest first and `most` of them: dicts `q` (n,)
/// and `cost`. Obstacles are left out.
#[pyfunction]
#[pyo3(signature = (problem, most = 10))]
pub(crate) fn ik<'py>(
    py: Python<'py>,
    problem: &Bound<'py, PyKeypointProblem>,
    most: usize,
) -> PyResult<Bound<'py, PyList>> {
    let problem = Arc::clone(&problem.get().0);
    let found = py.detach(|| gensim2_kpam::ik(&problem, most)).map_err(|e| from_problem(&e))?;
    let out = PyList::empty(py);
    for pose in found {
        let d = PyDict::new(py);
        d.set_item("q", convert::array1(py, &pose.q))?;
        d.set_item("cost", pose.cost)?;
        out.append(d)?;
    }
    Ok(out)
}

/// Travel of the object's joint (rad or m, from where it stands) at times (N,) of a plan's motion, as the planner takes
/// it: (N,).
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

/// Plans many problems on `threads` threads, 1 to 256 (default: all cores), the GIL released; Ctrl-C ends it. Results
/// are those of `plan`, in order, whatever the number of threads.
#[pyfunction]
#[pyo3(signature = (problems, threads = None))]
pub(crate) fn plan_batch(
    py: Python<'_>,
    problems: Vec<PyRef<'_, PyKeypointProblem>>,
    threads: Option<usize>,
) -> PyResult<Vec<PyPlan>> {
    let shared: Vec<Arc<KeypointProblem>> = problems.iter().map(|p| Arc::clone(&p.0)).collect();
    drop(problems);
    let plans = interruptible(py, Cancel::new(), |cancel| {
        let borrowed: Vec<&KeypointProblem> = shared.iter().map(AsRef::as_ref).collect();
        gensim2_kpam::plan_batch(&borrowed, threads, cancel)
    })?;
    let plans = plans.map_err(|e| from_problem(&e))?;
    Ok(plans.into_iter().map(|(plan, times)| PyPlan(plan, times)).collect())
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
    let (problem, plan) = (problem.get().0.as_ref(), &plan.get().0);
    let found = interruptible(py, Cancel::new(), |cancel| gensim2_kpam::min_clearance(problem, plan, step, cancel))?;
    let Some([itself, table, object]) = found.map_err(|e| from_problem(&e))? else { return Ok(None) };
    let out = PyDict::new(py);
    out.set_item("self", itself)?;
    out.set_item("table", table)?;
    out.set_item("object", object)?;
    Ok(Some(out))
}

//! Solver configs and problems.

use std::collections::BTreeMap;
use std::sync::Arc;

use gensim2_kpam::config::Constraint;
use gensim2_kpam::{Body, KeypointProblem, KeypointProblemBuilder, SolverConfig};
use nalgebra::Vector3;
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyMapping};
use serde::de::DeserializeOwned;

use crate::KpamError;
use crate::convert;
use crate::errors::{config_error, from_config, from_problem, problem_error};
use crate::geometry::{PyBody, PyJoint, PyRobot};
use crate::renamed;
use crate::scene::PyScene;

/// A validated solver config. Unknown fields, unknown types and non-finite numbers raise a ConfigError that names the
/// field.
#[pyclass(name = "SolverConfig", module = "gensim2_kpam", frozen)]
pub(crate) struct PySolverConfig(pub(crate) SolverConfig);

#[pymethods]
impl PySolverConfig {
    #[new]
    fn new(config: &Bound<'_, PyAny>) -> PyResult<Self> {
        let value = convert::json(config, "", 0, config_error)?;
        SolverConfig::from_value(&value).map(Self).map_err(|e| from_config(&e))
    }

    /// Returns the config in the form in which the caller gave it.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let value = serde_json::from_str(self.0.source()).map_err(|e| KpamError::new_err(e.to_string()))?;
        convert::python(py, &value)
    }

    #[getter]
    fn gripper(&self) -> &'static str {
        self.0.gripper().name()
    }

    /// Distance (m) by which the hand retreats after releasing the object; None without a release.
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

/// Lists names of bodies with their roles, truncated if there are many.
pub(crate) fn bodies_listed(bodies: &[Body]) -> String {
    const MAX_LISTED: usize = 10;
    if bodies.is_empty() {
        return "none".to_owned();
    }
    let mut listed: Vec<String> =
        bodies.iter().take(MAX_LISTED).map(|b| format!("{} ({})", b.name(), b.role().name())).collect();
    if bodies.len() > MAX_LISTED {
        listed.push(format!("{} more", bodies.len() - MAX_LISTED));
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

/// Reads options from a mapping, or returns the defaults; errors name the option.
pub(crate) fn read_options<O: DeserializeOwned + Default>(value: Option<&Bound<'_, PyAny>>) -> PyResult<O> {
    match value {
        None => Ok(O::default()),
        Some(o) => {
            let mut value = convert::json(o, "options", 0, problem_error)?;
            renamed::options(o.py(), &mut value)?;
            serde_path_to_error::deserialize(value).map_err(|e| match e.path().to_string().as_str() {
                "." => problem_error("options", e.inner()),
                path => problem_error(&format!("options.{path}"), e.inner()),
            })
        }
    }
}

/// All arguments of a problem except its scene.
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

    /// Adds these arguments to a builder that has the robot, bodies and joint, and builds the problem.
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

/// A planning problem: robot, scene, solver config, start and options, validated on construction. Instances can be
/// pickled.
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

    /// Return the problem with another start state: joints (n,), velocity and acceleration (n,), zero by default, and
    /// the time (s) at which the motion starts.
    #[pyo3(signature = (q, velocity = None, time = 0.0, *, acceleration = None))]
    fn with_start(
        &self,
        q: &Bound<'_, PyAny>,
        velocity: Option<&Bound<'_, PyAny>>,
        time: f64,
        acceleration: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let q = convert::vector(q, "q", None)?;
        let velocity = velocity.map(|v| convert::vector(v, "velocity", None)).transpose()?;
        let acceleration = acceleration.map(|v| convert::vector(v, "acceleration", None)).transpose()?;
        self.0.with_start(q, velocity, acceleration, time).map(|p| Self(Arc::new(p))).map_err(|e| from_problem(&e))
    }

    /// Target (3,) of each point constraint in the base frame, in the order of the config.
    #[getter]
    fn point_targets<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyArray1<f64>>>> {
        let targets = self.0.point_targets().map_err(|e| from_problem(&e))?;
        Ok(targets.iter().map(|target| convert::array1(py, target.as_slice())).collect())
    }

    /// Scene of the problem, in which the object's joint has the name "joint".
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

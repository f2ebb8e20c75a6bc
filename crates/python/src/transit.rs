//! Motions to goals that are given as joint values or as poses.

use std::time::Duration;

use gensim2_geometry::Pose;
use gensim2_kpam::options::LimitSet;
use gensim2_kpam::{Cancel, Goal, Motion, NoMotion, PathTolerance, TransitOptions};
use pyo3::conversion::FromPyObjectOwned;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::convert;
use crate::errors::{from_problem, problem_error};
use crate::interrupt::interruptible;
use crate::problem::{PySolverConfig, keypoints};
use crate::scene::{PyCancel, PyScene};
use crate::timing::PyTrajectory;

/// Result of planning a motion to a goal.
#[pyclass(name = "Motion", module = "gensim2_kpam", frozen)]
pub(crate) struct PyMotion(Result<Motion, NoMotion>, f64);

impl PyMotion {
    /// Returns the name of the member of `MotionStatus`.
    fn word(&self) -> &'static str {
        match &self.0 {
            Ok(_) => "solved",
            Err(NoMotion::StartBlocked(_)) => "start_blocked",
            Err(NoMotion::GoalsBlocked(_)) => "goals_blocked",
            Err(NoMotion::Unreachable | NoMotion::OffPath { .. }) => "unreachable",
            Err(NoMotion::Untimed) => "untimed",
            Err(NoMotion::CannotStop(..)) => "cannot_stop",
            Err(NoMotion::Late) => "late",
            Err(NoMotion::Cancelled) => "cancelled",
            Err(NoMotion::Overloaded(..)) => "overloaded",
            Err(_) => "not_found",
        }
    }
}

#[pymethods]
impl PyMotion {
    /// Result of planning as a member of `MotionStatus`, which is a string.
    #[getter]
    fn status<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        convert::member(py, "MotionStatus", self.word())
    }

    /// Reason of a failure in one sentence; empty if solved.
    #[getter]
    fn reason(&self) -> String {
        self.0.as_ref().err().map_or_else(String::new, NoMotion::to_string)
    }

    #[getter]
    fn trajectory(&self) -> Option<PyTrajectory> {
        self.0.as_ref().ok().map(|m| PyTrajectory(m.trajectory.clone()))
    }

    /// Index, in the list of goals, of the goal at which the motion ends.
    #[getter]
    fn goal(&self) -> Option<usize> {
        self.0.as_ref().ok().map(|m| m.goal)
    }

    /// (K, n) vertices of the path that the motion follows.
    #[getter]
    fn corners<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyAny>> {
        let motion = self.0.as_ref().ok()?;
        let joints = motion.corners.first().map_or(0, Vec::len);
        Some(convert::array2(py, &motion.corners, joints).into_any())
    }

    /// Pairs closer than the margin at the start or the reached goal: (name, name, distance in m).
    #[getter]
    fn nearer(&self) -> Vec<(String, String, f64)> {
        let all = self.0.as_ref().map_or(&[][..], |m| m.nearer.as_slice());
        all.iter().map(|a| (a.bodies[0].clone(), a.bodies[1].clone(), a.distance)).collect()
    }

    /// Number of configurations checked for collisions.
    #[getter]
    fn checks(&self) -> Option<u64> {
        self.0.as_ref().ok().map(|m| m.checks)
    }

    /// Limits ("acceleration", "jerk") for which default values are assumed because neither the options nor the URDF
    /// give them; empty without a motion.
    #[getter]
    fn assumed_limits(&self) -> Vec<String> {
        self.0.as_ref().map_or_else(|_| Vec::new(), |m| m.assumed_limits.clone())
    }

    /// Warnings: assumed limits with their joints, and links that are never checked for collisions.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.0.as_ref().map_or_else(|_| Vec::new(), |m| m.warnings.clone())
    }

    /// CPU time of planning (ms).
    #[getter]
    fn cpu_ms(&self) -> f64 {
        self.1
    }

    #[staticmethod]
    fn _thaw(bytes: &[u8]) -> PyResult<Self> {
        convert::thaw(bytes).map(|(found, cpu_ms)| Self(found, cpu_ms))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        Ok((py.get_type::<Self>().getattr("_thaw")?, (PyBytes::new(py, &convert::freeze(&(&self.0, self.1))?),)))
    }

    fn __repr__(&self) -> String {
        match &self.0 {
            Ok(m) => format!("Motion(solved, {:.3} s, goal {})", m.trajectory.end(), m.goal),
            Err(why) => format!("Motion({}: {why})", self.word()),
        }
    }
}

/// Reads two links with their poses (4, 4).
pub(crate) fn two_poses(given: &Bound<'_, PyDict>, field: &str) -> PyResult<[(String, Pose); 2]> {
    let poses = given.iter().map(|(link, pose)| {
        let link: String = link.extract()?;
        let pose = convert::pose(&pose, &format!("{field}[{link:?}]"))?;
        Ok((link, pose))
    });
    let poses: Vec<(String, Pose)> = poses.collect::<PyResult<_>>()?;
    let count = poses.len();
    poses.try_into().map_err(|_| problem_error(field, format!("must give two links a pose each, not {count}")))
}

/// Reads joint vectors (n,) or (K, n), poses (4, 4) or (K, 4, 4) of a link, or a dict of two links and their poses. For a
/// robot with four joints, a rigid transform is a pose.
fn goal_of(goal: &Bound<'_, PyAny>, field: &str, joints: usize, link: Option<String>) -> PyResult<Goal> {
    if let Ok(poses) = goal.cast::<PyDict>() {
        if link.is_some() {
            return Err(problem_error("link", "must be omitted: the goal names its links"));
        }
        return two_poses(poses, field).map(Goal::TwoPoses);
    }
    let (values, shape) = convert::numbers(goal, field)?;
    match (shape.as_slice(), link) {
        ([4, 4], link) if link.is_some() || joints != 4 || convert::pose(goal, field).is_ok() => {
            Ok(Goal::Poses { poses: vec![convert::pose(goal, field)?], link })
        }
        ([_, 4, 4], link) => Ok(Goal::Poses { poses: convert::poses(goal, field)?, link }),
        ([n], None) if *n == joints => Ok(Goal::Joints(vec![values])),
        ([k, n], None) if *n == joints && *k > 0 => {
            Ok(Goal::Joints(values.chunks_exact((*n).max(1)).map(<[f64]>::to_vec).collect()))
        }
        _ => Err(problem_error(
            field,
            format!("must have shape ({joints},) or (K, {joints}), or (4, 4) or (K, 4, 4) of a link, not {shape:?}"),
        )),
    }
}

/// Keyword arguments that the functions for motions share.
#[derive(Default)]
pub(crate) struct Arguments {
    link: Option<String>,
    options: TransitOptions,
}

impl Arguments {
    /// Reads keyword arguments for a robot. A name in `unknown` is refused like any other unknown name.
    pub fn read(given: Option<&Bound<'_, PyDict>>, joints: usize, unknown: &[&str]) -> PyResult<Self> {
        let mut out = Self::default();
        let options = &mut out.options;
        for (key, value) in given.into_iter().flatten() {
            let (key, value): (String, _) = (key.extract()?, &value);
            let key = key.as_str();
            let given = || Some(value).filter(|value| !value.is_none());
            let listed = || given().map(|list| convert::list(list, key)).transpose();
            let rates = || given().map(|list| convert::vector(list, key, Some(joints))).transpose();
            match key {
                _ if unknown.contains(&key) => return Err(unexpected(key)),
                "link" => out.link = argument(key, value)?,
                "margin" => options.margin = argument(key, value)?,
                "samples" => options.samples = argument(key, value)?,
                "seed" => options.seed = argument(key, value)?,
                "velocity_scale" => options.velocity_scale = argument(key, value)?,
                "acceleration_scale" => options.acceleration_scale = argument(key, value)?,
                "limits" => {
                    let name: Option<String> = argument(key, value)?;
                    options.limits = name.as_deref().map(limit_set).transpose()?;
                }
                "velocity_limits" => options.velocity_limits = listed()?,
                "acceleration_limits" => options.acceleration_limits = listed()?,
                "jerk_limits" => options.jerk_limits = listed()?,
                "torque_limits" => options.torque_limits = listed()?,
                "path" => {
                    let config: Option<Py<PySolverConfig>> = argument(key, value)?;
                    options.path = config.map(|config| config.get().0.clone());
                }
                "tool_keypoints" => {
                    options.tool_keypoints = given().map(|map| keypoints(map, key)).transpose()?.unwrap_or_default();
                }
                "start_velocity" => options.start_velocity = rates()?,
                "start_acceleration" => options.start_acceleration = rates()?,
                "start_time" => options.start_time = argument(key, value)?,
                "warm_start" => {
                    let motion: Option<Py<PyTrajectory>> = argument(key, value)?;
                    options.warm_start = motion.map(|motion| motion.get().0.clone());
                }
                "max_checks" => options.max_checks = argument(key, value)?,
                "deadline_ms" => {
                    let limit: Option<f64> = argument(key, value)?;
                    options.deadline = limit.map(deadline).transpose()?;
                }
                "cancel" => {
                    let flag: Option<Py<PyCancel>> = argument(key, value)?;
                    options.cancel = flag.map(|flag| flag.get().0.clone());
                }
                _ => return Err(unexpected(key)),
            }
        }
        Ok(out)
    }

    /// Runs `work` on an interruptible thread with the options.
    fn run<T: Send + 'static>(
        mut self,
        py: Python<'_>,
        work: impl FnOnce(&TransitOptions) -> T + Send + 'static,
    ) -> PyResult<T> {
        let cancel = self.options.cancel.get_or_insert_with(Cancel::new).clone();
        interruptible(py, cancel, move |_| work(&self.options))
    }
}

fn unexpected(key: &str) -> PyErr {
    PyTypeError::new_err(format!("got an unexpected keyword argument '{key}'"))
}

/// Converts the value of a keyword argument; an error has the same note as for a named argument.
fn argument<'py, T: FromPyObjectOwned<'py>>(key: &str, value: &Bound<'py, PyAny>) -> PyResult<T> {
    value.extract::<T>().map_err(|e| {
        let e: PyErr = e.into();
        match e.add_note(value.py(), format!("while processing '{key}'")) {
            Ok(()) => e,
            Err(other) => other,
        }
    })
}

fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let clock = cpu_time::ThreadTime::now();
    let found = work();
    (found, 1e3 * clock.elapsed().as_secs_f64())
}

impl PyScene {
    pub(crate) fn motion_to(
        &self,
        py: Python<'_>,
        q_start: &Bound<'_, PyAny>,
        goal: &Bound<'_, PyAny>,
        mut arguments: Arguments,
    ) -> PyResult<PyMotion> {
        let joints = self.0.robot().joints().len();
        let q_start = convert::vector(q_start, "q_start", Some(joints))?;
        let goal = goal_of(goal, "goal", joints, arguments.link.take())?;
        let scene = self.0.clone();
        let (found, time) =
            arguments.run(py, move |options| timed(|| gensim2_kpam::plan_to(&scene, &q_start, &goal, options)))?;
        found.map(|m| PyMotion(m, time)).map_err(|e| from_problem(&e))
    }

    pub(crate) fn motions_to(
        &self,
        py: Python<'_>,
        q_starts: &[Bound<'_, PyAny>],
        goals: &[Bound<'_, PyAny>],
        threads: Option<usize>,
        mut arguments: Arguments,
    ) -> PyResult<Vec<PyMotion>> {
        let joints = self.0.robot().joints().len();
        if q_starts.len() != goals.len() {
            let message = format!("has {} entries, but q_starts has {}", goals.len(), q_starts.len());
            return Err(problem_error("goals", message));
        }
        let link = arguments.link.take();
        let pairs = q_starts.iter().zip(goals).enumerate().map(|(k, (q_start, goal))| {
            let q_start = convert::vector(q_start, &format!("q_starts[{k}]"), Some(joints))?;
            Ok((q_start, goal_of(goal, &format!("goals[{k}]"), joints, link.clone())?))
        });
        let pairs: Vec<(Vec<f64>, Goal)> = pairs.collect::<PyResult<_>>()?;
        let scene = self.0.clone();
        let found = arguments.run(py, move |options| gensim2_kpam::plan_to_many(&scene, &pairs, options, threads))?;
        let found = found.map_err(|e| from_problem(&e))?;
        Ok(found.into_iter().map(|(motion, time)| PyMotion(motion, 1e3 * time)).collect())
    }

    pub(crate) fn motion_along(
        &self,
        py: Python<'_>,
        q_start: &Bound<'_, PyAny>,
        poses: Vec<Bound<'_, PyAny>>,
        tolerance: PathTolerance,
        arguments: Arguments,
    ) -> PyResult<PyMotion> {
        let q_start = convert::vector(q_start, "q_start", Some(self.0.robot().joints().len()))?;
        let poses = poses.iter().enumerate().map(|(k, pose)| convert::pose(pose, &format!("poses[{k}]")));
        let poses: Vec<Pose> = poses.collect::<PyResult<_>>()?;
        let scene = self.0.clone();
        let (found, time) = arguments.run(py, move |options| {
            timed(|| gensim2_kpam::plan_along(&scene, &q_start, &poses, &tolerance, options))
        })?;
        found.map(|m| PyMotion(m, time)).map_err(|e| from_problem(&e))
    }
}

/// Converts a time limit in milliseconds.
pub(crate) fn deadline(ms: f64) -> PyResult<Duration> {
    if (0.0..=1e9).contains(&ms) {
        return Ok(Duration::from_secs_f64(1e-3 * ms));
    }
    Err(problem_error("deadline_ms", format!("must lie in 0 to 1e9 ms, not {ms}")))
}

/// Returns the set of limits with this name.
pub(crate) fn limit_set(name: &str) -> PyResult<LimitSet> {
    match name {
        "panda" => Ok(LimitSet::Panda),
        "fr3" => Ok(LimitSet::Fr3),
        "plain" => Ok(LimitSet::Plain),
        _ => Err(problem_error("limits", format!("must be \"panda\", \"fr3\" or \"plain\", not {name:?}"))),
    }
}

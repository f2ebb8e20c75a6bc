//! Motions to goals that are given as joint values or as poses.

use std::time::Duration;

use gensim2_kpam::options::LimitSet;
use gensim2_kpam::{Cancel, Goal, Motion, NoMotion, TransitOptions};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::convert;
use crate::errors::{from_problem, problem_error};
use crate::interrupt::interruptible;
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
            Err(NoMotion::Unreachable) => "unreachable",
            Err(NoMotion::Untimed) => "untimed",
            Err(NoMotion::CannotStop(..)) => "cannot_stop",
            Err(NoMotion::Late) => "late",
            Err(NoMotion::Cancelled) => "cancelled",
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

/// Reads joint vectors (n,) or (K, n), or a pose (4, 4) with its link. For a robot with four joints, a rigid transform
/// is a pose.
fn goal_of(goal: &Bound<'_, PyAny>, joints: usize, link: Option<String>) -> PyResult<Goal> {
    let (values, shape) = convert::numbers(goal, "goal")?;
    match (shape.as_slice(), link) {
        ([4, 4], link) if link.is_some() || joints != 4 || convert::pose(goal, "goal").is_ok() => {
            Ok(Goal::Pose { pose: convert::pose(goal, "goal")?, link })
        }
        ([n], None) if *n == joints => Ok(Goal::Joints(vec![values])),
        ([k, n], None) if *n == joints && *k > 0 => {
            Ok(Goal::Joints(values.chunks_exact((*n).max(1)).map(<[f64]>::to_vec).collect()))
        }
        _ => Err(problem_error(
            "goal",
            format!("must have shape ({joints},) or (K, {joints}), or (4, 4) of a link, not {shape:?}"),
        )),
    }
}

/// Arguments of `Scene.plan_to`, converted from Python.
pub(crate) struct Asked<'a, 'py> {
    pub goal: &'a Bound<'py, PyAny>,
    pub link: Option<String>,
    pub deadline_ms: Option<f64>,
    pub cancel: Option<&'a Bound<'py, PyCancel>>,
    pub options: TransitOptions,
}

impl PyScene {
    pub(crate) fn motion_to(
        &self,
        py: Python<'_>,
        q_start: &Bound<'_, PyAny>,
        asked: Asked<'_, '_>,
    ) -> PyResult<PyMotion> {
        let joints = self.0.robot().joints().len();
        let q_start = convert::vector(q_start, "q_start", Some(joints))?;
        let goal = goal_of(asked.goal, joints, asked.link)?;
        let cancel = asked.cancel.map_or_else(Cancel::new, |c| c.get().0.clone());
        let mut options = asked.options;
        options.cancel = Some(cancel.clone());
        options.deadline = asked.deadline_ms.map(deadline).transpose()?;
        let scene = self.0.clone();
        let (found, time) = interruptible(py, cancel, move |_| {
            let clock = cpu_time::ThreadTime::now();
            let found = gensim2_kpam::plan_to(&scene, &q_start, &goal, &options);
            (found, clock.elapsed().as_secs_f64())
        })?;
        found.map(|m| PyMotion(m, 1e3 * time)).map_err(|e| from_problem(&e))
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

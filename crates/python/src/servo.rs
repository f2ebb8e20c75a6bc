//! Servoing: steps toward a changing target.

use std::sync::{Mutex, MutexGuard, PoisonError};

use gensim2_kpam::{Servo, ServoLimit, ServoOptions, ServoStatus, ServoStep, Target};
use pyo3::prelude::*;

use crate::convert;
use crate::errors::{from_problem, problem_error};
use crate::scene::PyScene;
use crate::transit::limit_set;

/// State of the arm after a step of `Servo`.
#[pyclass(name = "ServoStep", module = "gensim2_kpam", frozen)]
pub(crate) struct PyServoStep {
    step: ServoStep,
    limited_by: Vec<String>,
}

#[pymethods]
impl PyServoStep {
    /// Positions (n,) of all joints, rad or m.
    #[getter]
    fn position<'py>(&self, py: Python<'py>) -> Bound<'py, PyAny> {
        convert::array1(py, &self.step.position).into_any()
    }

    /// Velocities (n,) of all joints, rad/s or m/s.
    #[getter]
    fn velocity<'py>(&self, py: Python<'py>) -> Bound<'py, PyAny> {
        convert::array1(py, &self.step.velocity).into_any()
    }

    /// Accelerations (n,) of all joints, rad/s^2 or m/s^2.
    #[getter]
    fn acceleration<'py>(&self, py: Python<'py>) -> Bound<'py, PyAny> {
        convert::array1(py, &self.step.acceleration).into_any()
    }

    /// How the step was chosen, as a member of `ServoStatus`, which is a string.
    #[getter]
    fn status<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        convert::member(py, "ServoStatus", self.word())
    }

    /// Limits that determine the step.
    #[getter]
    fn limited_by(&self) -> Vec<String> {
        self.limited_by.clone()
    }

    /// Smallest signed distance (m) over all checked pairs before the step; infinity if it is above 80 mm.
    #[getter]
    fn distance(&self) -> f64 {
        self.step.distance
    }

    fn __repr__(&self) -> String {
        let position: Vec<String> = self.step.position.iter().map(|v| format!("{v:.3}")).collect();
        format!("ServoStep({}, position=[{}])", self.word(), position.join(", "))
    }
}

impl PyServoStep {
    /// Returns the name of the member of `ServoStatus`.
    fn word(&self) -> &'static str {
        match self.step.status {
            ServoStatus::Tracking => "tracking",
            ServoStatus::Limited => "limited",
            _ => "braking",
        }
    }
}

/// Moves an arm toward a changing target, one step at a time, within all limits and away from obstacles.
#[pyclass(name = "Servo", module = "gensim2_kpam", frozen)]
pub(crate) struct PyServo {
    servo: Mutex<Servo>,
    joints: Vec<String>,
    dt: f64,
}

impl PyServo {
    fn lock(&self) -> MutexGuard<'_, Servo> {
        self.servo.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn limit(&self, servo: &Servo, limit: ServoLimit) -> String {
        let joint = |index: usize| self.joints.get(index).map_or("", String::as_str);
        match limit {
            ServoLimit::Velocity(j) => format!("velocity of {}", joint(j)),
            ServoLimit::Acceleration(j) => format!("acceleration of {}", joint(j)),
            ServoLimit::Position(j) => format!("range of {}", joint(j)),
            ServoLimit::Distance(a, b) => format!("distance of {} and {}", servo.body_name(a), servo.body_name(b)),
            _ => String::new(),
        }
    }
}

#[pymethods]
impl PyServo {
    #[new]
    #[pyo3(signature = (
        scene, q, *, link = None, margin = 0.005, posture = None, dt = 0.001, velocity_scale = 1.0,
        acceleration_scale = 1.0, limits = None, velocity_limits = None, acceleration_limits = None, jerk_limits = None
    ))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        py: Python<'_>,
        scene: &Bound<'_, PyScene>,
        q: &Bound<'_, PyAny>,
        link: Option<String>,
        margin: f64,
        posture: Option<&Bound<'_, PyAny>>,
        dt: f64,
        velocity_scale: f64,
        acceleration_scale: f64,
        limits: Option<&str>,
        velocity_limits: Option<&Bound<'_, PyAny>>,
        acceleration_limits: Option<&Bound<'_, PyAny>>,
        jerk_limits: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let scene = &scene.get().0;
        let joints = scene.robot().joints();
        let q = convert::vector(q, "q", Some(joints.len()))?;
        let mut options = ServoOptions::default();
        (options.link, options.margin, options.dt) = (link, margin, dt);
        options.posture = posture.map(|q| convert::vector(q, "posture", Some(joints.len()))).transpose()?;
        (options.velocity_scale, options.acceleration_scale) = (velocity_scale, acceleration_scale);
        options.limits = limits.map(limit_set).transpose()?;
        let listed =
            |list: Option<&Bound<'_, PyAny>>, field: &str| list.map(|list| convert::list(list, field)).transpose();
        options.velocity_limits = listed(velocity_limits, "velocity_limits")?;
        options.acceleration_limits = listed(acceleration_limits, "acceleration_limits")?;
        options.jerk_limits = listed(jerk_limits, "jerk_limits")?;
        let servo = py.detach(|| Servo::new(scene, &q, &options)).map_err(|e| from_problem(&e))?;
        let joints = joints.iter().map(|joint| joint.name().to_owned()).collect();
        Ok(Self { servo: Mutex::new(servo), joints, dt })
    }

    /// Moves the arm by one step and returns its new state. `target` is a pose (4, 4) of the link in the base frame, or
    /// joints (n,); `twist` (6,) is the velocity of the pose, or without a target that of the link. Without both, the
    /// arm comes to rest.
    #[pyo3(signature = (target = None, *, twist = None))]
    fn step(&self, target: Option<&Bound<'_, PyAny>>, twist: Option<&Bound<'_, PyAny>>) -> PyResult<PyServoStep> {
        let twist = twist.map(|twist| convert::vector(twist, "twist", Some(6))).transpose()?;
        let twist = twist.map(|v| [v[0], v[1], v[2], v[3], v[4], v[5]]);
        let target = match (target, twist) {
            (None, None) => Target::Rest,
            (None, Some(twist)) => Target::Twist(twist),
            (Some(target), twist) => self.target(target, twist)?,
        };
        let mut servo = self.lock();
        let step = servo.step(&target).map_err(|e| from_problem(&e))?;
        let limited_by = step.limited_by.iter().map(|limit| self.limit(&servo, *limit)).collect();
        Ok(PyServoStep { step, limited_by })
    }

    /// Sets the state of the arm, by default at rest.
    #[pyo3(signature = (q, velocity = None, acceleration = None))]
    fn reset(
        &self,
        q: &Bound<'_, PyAny>,
        velocity: Option<&Bound<'_, PyAny>>,
        acceleration: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let n = self.joints.len();
        let q = convert::vector(q, "q", Some(n))?;
        let rates = |list: Option<&Bound<'_, PyAny>>, field: &str| {
            list.map(|list| convert::vector(list, field, Some(n))).transpose()
        };
        let (velocity, acceleration) = (rates(velocity, "velocity")?, rates(acceleration, "acceleration")?);
        self.lock().reset(&q, velocity.as_deref(), acceleration.as_deref()).map_err(|e| from_problem(&e))
    }

    /// Length of a step, s.
    #[getter]
    fn dt(&self) -> f64 {
        self.dt
    }

    /// Warnings: assumed limits with their joints, and links that are never checked for collisions.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.lock().warnings()
    }

    fn __repr__(&self) -> String {
        let servo = self.lock();
        format!("Servo({:?} with {} joints, dt={})", servo.scene().robot().name(), self.joints.len(), self.dt)
    }
}

impl PyServo {
    fn target(&self, target: &Bound<'_, PyAny>, twist: Option<[f64; 6]>) -> PyResult<Target> {
        let n = self.joints.len();
        let (values, shape) = convert::numbers(target, "target")?;
        match (shape.as_slice(), twist) {
            ([4, 4], twist) => {
                Ok(Target::Pose { pose: convert::pose(target, "target")?, twist: twist.unwrap_or([0.0; 6]) })
            }
            ([m], None) if *m == n => Ok(Target::Joints(values)),
            ([m], Some(_)) if *m == n => {
                Err(problem_error("twist", "needs a pose (4, 4) or no target; leave it out for a target of joints"))
            }
            _ => Err(problem_error("target", format!("must have shape (4, 4) or ({n},), not {shape:?}"))),
        }
    }
}

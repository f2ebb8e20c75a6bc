//! Question and answer of a motion to a goal: options, motion, and the reason where there is none.

use std::collections::BTreeMap;
use std::time::Duration;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::checked::checked_when_read;
use crate::options::LimitSet;
use crate::{Cancel, CannotStop, Options, ProblemError, SolverConfig, Trajectory};

/// Greatest seed.
const MAX_SEED: usize = 1_000_000;

/// Options of a motion to a goal.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct TransitOptions {
    /// Distance (m) that everything keeps all along, 5 mm unless told. A pair that is nearer at the start or at a goal
    /// keeps the distance that it has there.
    pub margin: f64,
    /// Most samples of a search.
    pub samples: usize,
    /// Which samples are drawn.
    pub seed: usize,
    /// Share of the velocity limits.
    pub velocity_scale: f64,
    /// Share of the acceleration and jerk limits.
    pub acceleration_scale: f64,
    /// Acceleration and jerk limits of an arm that is known.
    pub limits: Option<LimitSet>,
    /// Velocity limits (rad/s or m/s), one entry a joint; the URDF's where there are none.
    pub velocity_limits: Option<Vec<f64>>,
    /// Acceleration limits (rad/s^2 or m/s^2), one entry a joint; those of `limits` where there are none.
    pub acceleration_limits: Option<Vec<f64>>,
    /// Jerk limits (rad/s^3 or m/s^3), likewise.
    pub jerk_limits: Option<Vec<f64>>,
    /// Torque limits (N m; N for sliding joints), one entry a joint; torques are not looked at where there are none.
    pub torque_limits: Option<Vec<f64>>,
    /// A config whose axis constraints hold all along the motion: between keypoints of the tool, to fixed directions of the
    /// base (frame `world`).
    pub path: Option<SolverConfig>,
    /// Keypoints of the tool that it names (m, hand frame), beside those of what the hand holds.
    pub tool_keypoints: BTreeMap<String, Vector3<f64>>,
    /// Velocity at the start (rad/s or m/s), one entry a joint; at rest where there is none.
    pub start_velocity: Option<Vec<f64>>,
    /// Acceleration there (rad/s^2 or m/s^2), likewise.
    pub start_acceleration: Option<Vec<f64>>,
    /// Time of the start (s).
    pub start_time: f64,
    /// The motion under way. Where it passes the start at `start_time` and is still free, it goes on unless another one
    /// ends sooner.
    pub warm_start: Option<Trajectory>,
    /// Ends the search after so many configurations.
    pub max_checks: Option<u64>,
    /// Ends the search after so long; without one, the same question has the same answer.
    pub deadline: Option<Duration>,
    /// Ends the search from another thread.
    pub cancel: Option<Cancel>,
}

impl Default for TransitOptions {
    fn default() -> Self {
        Self {
            margin: 0.005,
            samples: 100_000,
            seed: 0,
            velocity_scale: 1.0,
            acceleration_scale: 1.0,
            limits: None,
            velocity_limits: None,
            acceleration_limits: None,
            jerk_limits: None,
            torque_limits: None,
            path: None,
            tool_keypoints: BTreeMap::new(),
            start_velocity: None,
            start_acceleration: None,
            start_time: 0.0,
            warm_start: None,
            max_checks: None,
            deadline: None,
            cancel: None,
        }
    }
}

/// Two things that are near each other at an end of a motion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Approached {
    /// Link or held body, and body or link.
    pub bodies: [String; 2],
    /// Signed distance (m).
    pub distance: f64,
}

/// A motion found: timed, and proven to keep its distances all along.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(remote = "Self")]
#[non_exhaustive]
pub struct Motion {
    /// The motion; it begins at the start time.
    pub trajectory: Trajectory,
    /// Index, among the goals that were given, of the one that the motion ends at.
    pub goal: usize,
    /// Corners of the way that it follows, one entry a joint each.
    pub corners: Vec<Vec<f64>>,
    /// Pairs that are nearer than the margin at the start or at that goal, with the distance that they keep.
    pub nearer: Vec<Approached>,
    /// Configurations that were looked at.
    pub checks: u64,
    /// Limits ("acceleration", "jerk") of which neither the options nor the URDF say anything, so that plain ones are
    /// assumed.
    pub assumed_limits: Vec<String>,
    /// What a user should know: limits that are assumed for which joints, and links that are never checked.
    pub warnings: Vec<String>,
}

checked_when_read!(Motion);

impl Motion {
    /// Whether its corners have an entry a joint, and its numbers are finite.
    fn check(&self) -> Result<(), ProblemError> {
        let fits = |q: &Vec<f64>| q.len() == self.trajectory.joints() && q.iter().all(|v| v.is_finite());
        if self.corners.iter().all(fits) && self.nearer.iter().all(|a| a.distance.is_finite()) {
            return Ok(());
        }
        Err(ProblemError::new("corners", "must have a finite number a joint"))
    }
}

/// Why there is no motion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum NoMotion {
    /// Something overlaps at the start.
    StartBlocked(Approached),
    /// Something overlaps at every goal; at the first, this.
    GoalsBlocked(Approached),
    /// No goal can be reached: no joint values within the limits bring the link there.
    Unreachable,
    /// The samples or checks are spent; there may be a motion. What was in the way of the last that was timed.
    NotFound(Option<Approached>),
    /// A free way was found, and no motion along it that keeps the limits of velocity, acceleration, jerk and torque.
    Untimed,
    /// No motion from the state at the start stays within the joints' limits: the joint, by its name, and why.
    CannotStop(String, CannotStop),
    /// The time is up; there may be a motion.
    Late,
    /// The caller cancelled it.
    Cancelled,
}

impl std::fmt::Display for NoMotion {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let told = |a: &Approached| format!("{} and {} ({:.1} mm)", a.bodies[0], a.bodies[1], 1e3 * a.distance);
        match self {
            Self::StartBlocked(a) => write!(f, "at the start, {} overlap", told(a)),
            Self::GoalsBlocked(a) => write!(f, "at every goal something overlaps: {}", told(a)),
            Self::Unreachable => write!(f, "no joint values within the limits bring the link to the goal"),
            Self::NotFound(None) => write!(f, "the search was spent without a free motion; there may be one"),
            Self::NotFound(Some(a)) => {
                write!(f, "the search was spent without a free motion; the last came too near at {}", told(a))
            }
            Self::Untimed => write!(f, "a free way was found, and no motion along it keeps the joints' limits"),
            Self::CannotStop(joint, e) => write!(f, "{joint} cannot be stopped in time: {}", e.reason),
            Self::Late => write!(f, "the time was up before a free motion was found"),
            Self::Cancelled => write!(f, "planning was cancelled"),
        }
    }
}

impl TransitOptions {
    /// Timing options, in the form of a problem's.
    pub(super) fn limits(&self) -> Options {
        Options {
            velocity_scale: self.velocity_scale,
            acceleration_scale: self.acceleration_scale,
            limits: self.limits,
            velocity_limits: self.velocity_limits.clone(),
            acceleration_limits: self.acceleration_limits.clone(),
            jerk_limits: self.jerk_limits.clone(),
            torque_limits: self.torque_limits.clone(),
            start_velocity: self.start_velocity.clone(),
            start_acceleration: self.start_acceleration.clone(),
            start_time: self.start_time,
            ..Options::default()
        }
    }

    pub(super) fn check(&self) -> Result<(), ProblemError> {
        let fail = |field: &str, message: String| Err(ProblemError::new(field, message));
        if !(0.0..=0.1).contains(&self.margin) {
            return fail("margin", format!("must lie in 0 to 0.1 m, not {}", self.margin));
        }
        check_seed(self.seed)
    }
}

/// Refuses seeds beyond those of `options.seed`.
pub(super) fn check_seed(seed: usize) -> Result<(), ProblemError> {
    if seed > MAX_SEED {
        return Err(ProblemError::new("seed", format!("must be 0 to {MAX_SEED}, not {seed}")));
    }
    Ok(())
}

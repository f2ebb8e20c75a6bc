//! Options of planning a motion to a goal, and its result or the reason for its failure.

use std::collections::BTreeMap;
use std::time::Duration;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::options::LimitSet;
use crate::{Cancel, CannotStop, Options, Overload, ProblemError, SolverConfig, Trajectory};
use gensim2_geometry::checked_when_read;

/// Largest permitted seed.
const MAX_SEED: usize = 1_000_000;

/// Options of planning a motion to a goal.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct TransitOptions {
    /// Minimum distance (m) between the bodies of each checked pair along the whole motion, 5 mm by default. A pair
    /// that is closer at the start or at a goal keeps the smaller distance. Links whose shapes [prevent
    /// the margin](gensim2_geometry::Robot::is_often_close) must only not collide.
    pub margin: f64,
    /// Maximum number of random samples of a search.
    pub samples: usize,
    /// Seed of the random samples.
    pub seed: usize,
    /// Fraction of the velocity limits that the motion may use.
    pub velocity_scale: f64,
    /// Fraction of the acceleration and jerk limits that the motion may use.
    pub acceleration_scale: f64,
    /// Acceleration and jerk limits of a known arm.
    pub limits: Option<LimitSet>,
    /// Velocity limits (rad/s or m/s), one entry for each joint; default: the URDF's.
    pub velocity_limits: Option<Vec<f64>>,
    /// Acceleration limits (rad/s^2 or m/s^2), one entry for each joint; default: the URDF's, else those of `limits`.
    pub acceleration_limits: Option<Vec<f64>>,
    /// Jerk limits (rad/s^3 or m/s^3), one entry for each joint; default: the URDF's, else those of `limits`.
    pub jerk_limits: Option<Vec<f64>>,
    /// Torque limits (N m; N for sliding joints), one entry for each joint; default: torques are not limited.
    pub torque_limits: Option<Vec<f64>>,
    /// A config whose axis constraints hold along the whole motion, between keypoints of the tool and fixed directions
    /// of the base (frame `world`).
    pub path: Option<SolverConfig>,
    /// Keypoints of the tool that `path` names (m, hand frame), in addition to those of attached bodies.
    pub tool_keypoints: BTreeMap<String, Vector3<f64>>,
    /// Velocity at the start (rad/s or m/s), one entry for each joint; default: at rest.
    pub start_velocity: Option<Vec<f64>>,
    /// Acceleration at the start (rad/s^2 or m/s^2), one entry for each joint; default: zero.
    pub start_acceleration: Option<Vec<f64>>,
    /// Time at which the motion starts (s).
    pub start_time: f64,
    /// The current motion. If it passes through the start at `start_time` and is still collision-free, it is continued
    /// unless another motion ends earlier.
    pub warm_start: Option<Trajectory>,
    /// Maximum number of configurations checked for collisions.
    pub max_checks: Option<u64>,
    /// Wall-clock limit of the search; without a limit, the result is reproducible.
    pub deadline: Option<Duration>,
    /// Flag that ends the search from another thread.
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

/// Two bodies that are close to each other at an end of a motion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Approached {
    /// Names of a link or attached body, and of the body or link close to it.
    pub bodies: [String; 2],
    /// Signed distance of the two bodies (m).
    pub distance: f64,
}

/// A timed motion, proven to keep its required distances throughout.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(remote = "Self")]
#[non_exhaustive]
pub struct Motion {
    /// The motion, which begins at the start time.
    pub trajectory: Trajectory,
    /// Index, in the list of goals or poses, of the goal at which the motion ends.
    pub goal: usize,
    /// Vertices of the path that the motion follows; each vertex has one entry for each joint.
    pub corners: Vec<Vec<f64>>,
    /// Pairs closer than the margin at the start or at the reached goal, with their distance there.
    pub nearer: Vec<Approached>,
    /// Number of configurations checked for collisions.
    pub checks: u64,
    /// Limits ("acceleration", "jerk") for which defaults are assumed because neither the options nor the URDF give
    /// them.
    pub assumed_limits: Vec<String>,
    /// Warnings: assumed limits with their joints, and links that are never checked for collisions.
    pub warnings: Vec<String>,
}

checked_when_read!(Motion);

impl Motion {
    /// Validates that the vertices have one entry for each joint, and that the numbers are finite.
    fn check(&self) -> Result<(), ProblemError> {
        let fits = |q: &Vec<f64>| q.len() == self.trajectory.joints() && q.iter().all(|v| v.is_finite());
        if self.corners.iter().all(fits) && self.nearer.iter().all(|a| a.distance.is_finite()) {
            return Ok(());
        }
        Err(ProblemError::new("corners", "must have one finite number per joint"))
    }
}

/// Reason why no motion was found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum NoMotion {
    /// Bodies overlap at the start.
    StartBlocked(Approached),
    /// Bodies overlap at every goal; contains the overlapping pair of the first goal.
    GoalsBlocked(Approached),
    /// No joint values within the limits bring the link to the goal pose.
    Unreachable,
    /// The samples or checks were used up; a motion may exist. Contains the last timed motion's obstacle.
    NotFound(Option<Approached>),
    /// The hand cannot follow the line to the pose with this index beyond this fraction of the line; contains the joint
    /// that is at a limit, if any.
    OffPath {
        /// Index of the pose.
        pose: usize,
        /// Fraction of the line to the pose, 0 to 1.
        share: f64,
        /// Name of the joint, and the limit at which it is.
        limit: Option<String>,
    },
    /// The timed motion exceeds the tolerance on the line to the pose with this index.
    OffTolerance {
        /// Index of the pose.
        pose: usize,
        /// Fraction of the line to the pose, 0 to 1.
        share: f64,
    },
    /// These bodies are too close on the line to the pose with this index.
    PathBlocked {
        /// Index of the pose.
        pose: usize,
        /// The bodies and their distance.
        pair: Approached,
    },
    /// A free path was found, but no motion along it within the limits of velocity, acceleration, jerk and torque.
    Untimed,
    /// No motion from the start state stays within a joint's limits; contains the joint's name and the reason.
    CannotStop(String, CannotStop),
    /// The time limit has passed; a motion may exist.
    Late,
    /// The caller cancelled planning.
    Cancelled,
    /// A joint's torque limit does not suffice to hold the robot and its payload still; contains the joint and the place:
    /// the start, every goal, or a position on the path.
    Overloaded(Overload, String),
}

impl std::fmt::Display for NoMotion {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let told = |a: &Approached| format!("{} and {} ({:.1} mm)", a.bodies[0], a.bodies[1], 1e3 * a.distance);
        match self {
            Self::StartBlocked(a) => write!(f, "at the start, {} overlap", told(a)),
            Self::GoalsBlocked(a) => write!(f, "the robot is in collision at every goal: {}", told(a)),
            Self::Unreachable => write!(f, "no joint values within the limits bring the link to the goal"),
            Self::NotFound(None) => {
                write!(f, "the search used up its samples without finding a collision-free motion; one may exist")
            }
            Self::NotFound(Some(a)) => {
                write!(
                    f,
                    "the search used up its samples without finding a collision-free motion; the last one tried came too close at {}",
                    told(a)
                )
            }
            Self::OffPath { pose, share, limit } => {
                let why = limit.as_deref().unwrap_or("no joint is at a limit: the arm is stretched or singular there");
                write!(f, "the hand covers only {:.0} % of the line to poses[{pose}]: {why}", 100.0 * share)
            }
            Self::OffTolerance { pose, share } => write!(
                f,
                "the motion exceeds the tolerance at {:.0} % of the line to poses[{pose}]; increase the tolerance",
                100.0 * share
            ),
            Self::PathBlocked { pose, pair } => write!(f, "on the line to poses[{pose}], {} are too close", told(pair)),
            Self::Untimed => {
                write!(f, "a collision-free path was found, but no motion along it keeps the joint limits")
            }
            Self::CannotStop(joint, e) => write!(f, "{joint} cannot be stopped in time: {}", e.reason),
            Self::Late => write!(f, "the deadline passed before a collision-free motion was found"),
            Self::Cancelled => write!(f, "planning was cancelled"),
            Self::Overloaded(Overload { joint, torque, limit }, place) => write!(
                f,
                "holding the arm still {place} takes a torque of {:.2} at {joint}, whose limit is {limit:.2} (N m; N for \
                 sliding joints); reduce the payload, or keep it closer to the joint",
                torque.abs()
            ),
        }
    }
}

impl TransitOptions {
    /// Returns the timing options as [`Options`] of a keypoint problem.
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

/// Refuses seeds above the maximum.
pub(super) fn check_seed(seed: usize) -> Result<(), ProblemError> {
    if seed > MAX_SEED {
        return Err(ProblemError::new("seed", format!("must be 0 to {MAX_SEED}, not {seed}")));
    }
    Ok(())
}

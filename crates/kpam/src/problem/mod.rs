//! The planning problem: a robot, a config, keypoints, the object's joint, obstacles and options.

use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

use gensim2_geometry::{Pose, Robot, checked_when_read};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::config::Constraint;
use crate::model::{MAX_JOINTS, Model, Row};
use crate::world::{Compiled, Schedule};
use crate::{Bodies, Body, ObjectJoint, Options, ProblemError, Role, Scene, SolverConfig};

mod build;
mod check;

pub use build::KeypointProblemBuilder;

/// A validated planning problem.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(remote = "Self")]
pub struct KeypointProblem {
    pub(crate) robot: Arc<Robot>,
    pub(crate) config: SolverConfig,
    pub(crate) q_start: Vec<f64>,
    pub(crate) tool_keypoints: BTreeMap<String, Vector3<f64>>,
    pub(crate) object_keypoints: BTreeMap<String, Vector3<f64>>,
    pub(crate) object: Pose,
    pub(crate) joint: Option<ObjectJoint>,
    pub(crate) object_axis: usize,
    pub(crate) object_yaw: f64,
    pub(crate) world: Pose,
    pub(crate) bodies: Bodies,
    pub(crate) options: Options,
    /// The robot and the bodies prepared for fast collision checks, shared with the scene and by changed problems.
    #[serde(skip)]
    pub(crate) compiled: Arc<OnceLock<Compiled>>,
}

checked_when_read!(KeypointProblem);

impl KeypointProblem {
    /// Returns the weight of each variable's squared step from the start in the cost.
    pub(crate) fn joint_weights(&self, model: &Model) -> Row {
        self.options.joint_weights.as_ref().map_or([1.0; MAX_JOINTS], |weights| model.pick(weights))
    }

    /// Returns the robot.
    #[must_use]
    pub fn robot(&self) -> &Arc<Robot> {
        &self.robot
    }

    /// Returns the solver config.
    #[must_use]
    pub fn config(&self) -> &SolverConfig {
        &self.config
    }

    /// Returns the joint positions (rad or m) at the start, one entry for each joint of the robot.
    #[must_use]
    pub fn q_start(&self) -> &[f64] {
        &self.q_start
    }

    /// Returns the keypoints of the tool, with their positions in the hand frame (m).
    #[must_use]
    pub fn tool_keypoints(&self) -> &BTreeMap<String, Vector3<f64>> {
        &self.tool_keypoints
    }

    /// Returns the keypoints of the object, with their positions in the base frame (m).
    #[must_use]
    pub fn object_keypoints(&self) -> &BTreeMap<String, Vector3<f64>> {
        &self.object_keypoints
    }

    /// Returns the pose of the object frame in the base frame.
    #[must_use]
    pub fn object(&self) -> &Pose {
        &self.object
    }

    /// Returns the object's joint, if it has one.
    #[must_use]
    pub fn joint(&self) -> Option<&ObjectJoint> {
        self.joint.as_ref()
    }

    /// Returns the bodies around the robot: obstacles, targets and attached bodies.
    #[must_use]
    pub fn bodies(&self) -> &Bodies {
        &self.bodies
    }

    /// Returns the options.
    #[must_use]
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Returns the problem with another state at the start: joint positions, velocities and accelerations (zero if
    /// `None`), and the start time (s).
    ///
    /// # Errors
    /// The same as for [`KeypointProblemBuilder::build`].
    pub fn with_start(
        &self,
        q: Vec<f64>,
        velocity: Option<Vec<f64>>,
        acceleration: Option<Vec<f64>>,
        time: f64,
    ) -> Result<Self, ProblemError> {
        let mut out = self.clone();
        out.q_start = q;
        out.options.start_velocity = velocity;
        out.options.start_acceleration = acceleration;
        out.options.start_time = time;
        out.check()?;
        Ok(out)
    }

    /// Returns the robot, its bodies and the rules of contact, without the task.
    #[must_use]
    pub fn scene(&self) -> Scene {
        Scene::of(self)
    }

    /// Returns whether the named body is attached to the hand in some segment of the motion.
    pub(crate) fn rides(&self, name: &str) -> bool {
        let attached = |b: &Body| b.name == name && b.role == Role::Attached;
        self.options.pick.iter().any(|n| n == name) || self.bodies.iter().any(attached)
    }

    /// Returns the index of a label of contact windows in time order: `start`, then the keyframes, then `end`.
    pub(crate) fn window_index(&self, label: &str) -> Option<usize> {
        let schedule = Schedule::of(&self.config);
        match label {
            "start" => Some(0),
            "end" => Some(1 + schedule.len()),
            _ => schedule.keyframe(label).map(|k| 1 + k),
        }
    }

    /// Returns the tool keypoint of the first point constraint in the hand frame (m), or the origin without one.
    pub(crate) fn contact_point(&self) -> Vector3<f64> {
        self.config
            .constraints
            .iter()
            .find_map(|c| match c {
                Constraint::Point { keypoint, .. } => self.tool_keypoints.get(keypoint).copied(),
                _ => None,
            })
            .unwrap_or_else(Vector3::zeros)
    }
}

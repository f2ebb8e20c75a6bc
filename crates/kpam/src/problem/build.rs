//! Builder that creates problems in code.

use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

use gensim2_geometry::{Pose, Robot};
use nalgebra::Vector3;

use super::KeypointProblem;
use crate::world::Compiled;
use crate::{Bodies, ObjectJoint, Options, ProblemError, SolverConfig};

/// Builds a [`KeypointProblem`]; [`KeypointProblemBuilder::build`] validates it.
#[derive(Debug, Clone)]
#[must_use]
pub struct KeypointProblemBuilder(KeypointProblem);

impl KeypointProblem {
    /// Returns a builder for a robot with joints at `q_start` (one entry for each joint), without keypoints, object
    /// joint or bodies. Object frame and world frame equal the base frame, and options have their defaults.
    pub fn builder(robot: Arc<Robot>, config: SolverConfig, q_start: Vec<f64>) -> KeypointProblemBuilder {
        KeypointProblemBuilder(Self {
            robot,
            config,
            q_start,
            tool_keypoints: BTreeMap::new(),
            object_keypoints: BTreeMap::new(),
            object: Pose::identity(),
            joint: None,
            object_axis: 1,
            object_yaw: 0.0,
            world: Pose::identity(),
            bodies: Bodies::default(),
            options: Options::default(),
            compiled: Arc::default(),
        })
    }

    /// Returns a builder that starts with the values of this problem.
    pub fn changed(&self) -> KeypointProblemBuilder {
        KeypointProblemBuilder(self.clone())
    }
}

impl KeypointProblemBuilder {
    /// Sets the joint positions (rad or m) at the start, one entry for each joint of the robot.
    pub fn q_start(mut self, q: Vec<f64>) -> Self {
        self.0.q_start = q;
        self
    }

    /// Sets the config.
    pub fn config(mut self, config: SolverConfig) -> Self {
        self.0.config = config;
        self
    }

    /// Adds a keypoint of the tool, with its position in the hand frame (m).
    pub fn tool_keypoint(mut self, name: impl Into<String>, point: Vector3<f64>) -> Self {
        self.0.tool_keypoints.insert(name.into(), point);
        self
    }

    /// Adds keypoints of the tool, with their positions in the hand frame (m).
    pub fn tool_keypoints(mut self, points: impl IntoIterator<Item = (String, Vector3<f64>)>) -> Self {
        self.0.tool_keypoints.extend(points);
        self
    }

    /// Adds a keypoint of the object, with its position in the base frame (m).
    pub fn object_keypoint(mut self, name: impl Into<String>, point: Vector3<f64>) -> Self {
        self.0.object_keypoints.insert(name.into(), point);
        self
    }

    /// Adds keypoints of the object, with their positions in the base frame (m).
    pub fn object_keypoints(mut self, points: impl IntoIterator<Item = (String, Vector3<f64>)>) -> Self {
        self.0.object_keypoints.extend(points);
        self
    }

    /// Sets the pose of the object frame in the base frame.
    pub fn object(mut self, pose: Pose) -> Self {
        self.0.object = pose;
        self
    }

    /// Sets the object's joint, which moves the bodies with the role [`crate::Role::MovingLink`].
    pub fn joint(mut self, joint: ObjectJoint) -> Self {
        self.0.joint = Some(joint);
        self
    }

    /// Sets the axis of the motion "rotate" in the object frame: 0, 1 or 2; default 1.
    pub fn object_axis(mut self, axis: usize) -> Self {
        self.0.object_axis = axis;
        self
    }

    /// Sets the yaw (rad) of the object in the randomized scene; only [`crate::options::Frames::Original`] uses it.
    pub fn object_yaw(mut self, yaw: f64) -> Self {
        self.0.object_yaw = yaw;
        self
    }

    /// Sets the pose of the world frame in the base frame.
    pub fn world(mut self, pose: Pose) -> Self {
        self.0.world = pose;
        self
    }

    /// Sets the bodies around the robot: obstacles, targets and attached bodies.
    pub fn bodies(mut self, bodies: impl Into<Bodies>) -> Self {
        (self.0.bodies, self.0.compiled) = (bodies.into(), Arc::default());
        self
    }

    /// Sets the bodies of a scene; `bodies` may have other roles. The problem shares the compiled collision shapes of the
    /// scene.
    pub(crate) fn bodies_of(mut self, bodies: Bodies, compiled: &Arc<OnceLock<Compiled>>) -> Self {
        (self.0.bodies, self.0.compiled) = (bodies, Arc::clone(compiled));
        self
    }

    /// Sets the options.
    pub fn options(mut self, options: Options) -> Self {
        self.0.options = options;
        self
    }

    /// Returns the problem.
    ///
    /// # Errors
    /// Names the first invalid field: a number is not finite, a name is unknown, a direction is zero, a joint is
    /// outside its limits, or an option is out of range.
    pub fn build(self) -> Result<KeypointProblem, ProblemError> {
        self.0.check()?;
        Ok(self.0)
    }
}

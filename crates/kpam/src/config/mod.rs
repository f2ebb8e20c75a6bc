//! The language of solver configs: keypoint constraints, and motions before and after the actuation pose.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::ConfigError;
use gensim2_geometry::checked_when_read;

mod build;
mod read;

pub use build::SolverConfigBuilder;

/// Frame in which a config gives a direction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Frame {
    /// The world frame.
    World,
    /// The object frame.
    Object,
    /// The joint frame at the config's target keypoint: y is the direction in which the keypoint moves when the joint
    /// opens, z points along the joint axis, and x = y × z.
    Joint,
}

/// A direction of the object in an axis constraint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum TargetAxis {
    /// A constant unit vector in a frame.
    Fixed {
        /// The unit vector.
        axis: Vector3<f64>,
        /// Frame of the unit vector.
        frame: Frame,
    },
    /// The direction from one keypoint of the object to another.
    Keypoints {
        /// Name of the keypoint at which the direction starts.
        from: String,
        /// Name of the keypoint at which the direction ends.
        to: String,
    },
}

/// One entry of `constraint_list`: a constraint or a cost of the actuation pose.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Constraint {
    /// `point2point_constraint`: the keypoints' base coordinates each differ by at most `tolerance` (m).
    Point {
        /// Name of the tool keypoint.
        keypoint: String,
        /// Name of the object keypoint.
        target: String,
        /// Offset (m) that is added to the object keypoint's position.
        offset: Vector3<f64>,
        /// Frame in which the offset is given.
        frame: Frame,
        /// Maximum difference of each coordinate (m).
        tolerance: f64,
    },
    /// An axis constraint: the angle between two directions differs from `arccos(inner)` by at most `tolerance`.
    Axis {
        /// Type as written in the config, for example `frame_axis_parallel`.
        kind: String,
        /// Name of the tool keypoint at which the tool's direction starts.
        from: String,
        /// Name of the tool keypoint at which the tool's direction ends.
        to: String,
        /// Direction of the object.
        target: TargetAxis,
        /// Inner product of the two unit directions at the target angle.
        inner: f64,
        /// Maximum difference from the target angle (rad).
        tolerance: f64,
    },
    /// `point2point_cost`: weight times the squared distance (m^2) between two keypoints.
    PointCost {
        /// Name of the tool keypoint.
        keypoint: String,
        /// Name of the object keypoint.
        target: String,
        /// Weight of the squared distance in the cost.
        weight: f64,
    },
    /// `point2plane_cost`: weight times the squared distance (m^2) of a tool keypoint from a plane.
    PlaneCost {
        /// Name of the tool keypoint.
        keypoint: String,
        /// Name of the object keypoint.
        target: String,
        /// Unit normal of the plane.
        normal: Vector3<f64>,
        /// Frame in which the normal is given.
        frame: Frame,
        /// Weight of the squared distance in the cost.
        weight: f64,
    },
}

impl Constraint {
    /// Returns the name used in reports: the type of the constraint and its keypoint names.
    #[must_use]
    pub fn name(&self) -> String {
        match self {
            Self::Point { keypoint, target, .. } => format!("point2point_constraint({keypoint}, {target})"),
            Self::Axis { kind, from, to, target, .. } => match target {
                TargetAxis::Fixed { axis, frame } => {
                    // A normalized axis has up to 16 digits. Adding zero turns -0 into 0.
                    let [x, y, z] = [axis.x, axis.y, axis.z].map(|v| (v * 1e4).round() / 1e4 + 0.0);
                    format!("{kind}({from} -> {to}, {} axis [{x}, {y}, {z}])", frame.name())
                }
                TargetAxis::Keypoints { from: a, to: b } => format!("{kind}({from} -> {to}, {a} -> {b})"),
            },
            Self::PointCost { keypoint, target, .. } => format!("point2point_cost({keypoint}, {target})"),
            Self::PlaneCost { keypoint, target, .. } => format!("point2plane_cost({keypoint}, {target})"),
        }
    }

    /// Returns the unit of the residual.
    pub(crate) fn unit(&self) -> &'static str {
        if matches!(self, Self::Axis { .. }) { "rad" } else { "m" }
    }
}

impl Frame {
    fn name(self) -> &'static str {
        match self {
            Self::World => "world",
            Self::Object => "object",
            Self::Joint => "joint",
        }
    }
}

/// One motion of the hand before or after the actuation pose.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Motion {
    /// Translates the hand along one of its own axes.
    Translate {
        /// Index of the hand axis: 0, 1 or 2.
        axis: usize,
        /// Distance (m).
        distance: f64,
    },
    /// Translates the hand by this vector in the base frame (m).
    Move(Vector3<f64>),
    /// Rotates the hand by this angle (rad) about the problem's object axis through the origin of the object frame.
    Rotate(f64),
    /// Moves the hand rigidly with the object's joint while the joint travels by this amount (rad or m).
    FollowJoint(f64),
    /// Moves the hand rigidly with the object's joint to this openness (0 closed, 1 open, other values allowed).
    FollowJointTo(f64),
    /// Moves the tool keypoint of the point constraint with the object's joint while the joint travels by this amount
    /// (rad or m). The hand keeps its orientation.
    TraceJoint(f64),
    /// Like `TraceJoint`, to this openness (0 closed, 1 open, other values allowed).
    TraceJointTo(f64),
}

impl Motion {
    /// Returns whether the motion needs the object's joint.
    pub fn follows_joint(&self) -> bool {
        matches!(self, Self::FollowJoint(_) | Self::FollowJointTo(_) | Self::TraceJoint(_) | Self::TraceJointTo(_))
    }
}

/// Mode of the fingers during the motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Gripper {
    /// The fingers are open throughout the motion.
    Open,
    /// The fingers are closed throughout the motion.
    Closed,
    /// The fingers close at the actuation pose.
    Grasp,
    /// The fingers do not move, because the hand holds an object throughout the motion.
    Hold,
    /// The fingers open at the actuation pose.
    Release,
}

impl Gripper {
    /// Returns the name of the finger mode as written in configs.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Open => "open",
            Self::Closed => "closed",
            Self::Grasp => "grasp",
            Self::Hold => "hold",
            Self::Release => "release",
        }
    }

    /// Returns whether the fingers move at the actuation pose, so that the hand must stop there.
    pub(crate) fn acts(self) -> bool {
        match self {
            Self::Grasp | Self::Release => true,
            Self::Open | Self::Closed | Self::Hold => false,
        }
    }
}

/// A validated solver config, read from JSON or built in code.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(remote = "Self")]
pub struct SolverConfig {
    /// Constraints and costs of the actuation pose.
    pub(crate) constraints: Vec<Constraint>,
    /// Motions before the actuation pose. The first one is directly before the pose, and the last one is executed
    /// first.
    pub(crate) pre: Vec<Motion>,
    /// Motions after the actuation pose, in the order of execution.
    pub(crate) post: Vec<Motion>,
    /// Time of the actuation pose (s).
    pub(crate) actuation_time: Option<f64>,
    /// Times (s) of the keyframes before the actuation pose, increasing; the last one belongs to `pre[0]`.
    pub(crate) pre_times: Option<Vec<f64>>,
    /// Times (s) of the keyframes after the actuation pose.
    pub(crate) post_times: Option<Vec<f64>>,
    /// Mode of the fingers.
    pub(crate) gripper: Gripper,
    /// Distance (m) of the hand's retreat along its own z axis after the release; `None` for no release.
    pub(crate) let_go: Option<f64>,
    /// The JSON text that the config was read from.
    pub(crate) source: String,
}

checked_when_read!(SolverConfig);

type Result<T> = std::result::Result<T, ConfigError>;

impl SolverConfig {
    /// Reads JSON text.
    ///
    /// # Errors
    /// The text is not valid JSON or not a valid config; the error gives the path of the field.
    ///
    /// ```
    /// let bad = gensim2_kpam::SolverConfig::from_json(r#"{"constraint_list": [], "speed": 2}"#);
    /// assert_eq!(bad.unwrap_err().field, "speed");
    /// ```
    pub fn from_json(text: &str) -> Result<Self> {
        let value: Value = serde_json::from_str(text).map_err(|e| ConfigError::new("config", format!("{e}")))?;
        Self::from_value(&value)
    }

    /// Returns a builder for a config in code.
    ///
    /// ```
    /// use gensim2_kpam::SolverConfig;
    /// use gensim2_kpam::config::{Constraint, Motion};
    ///
    /// let config = SolverConfig::builder()
    ///     .constraint(Constraint::point("tip", "handle", 0.001))
    ///     .pre(Motion::Translate { axis: 2, distance: -0.1 })
    ///     .build()?;
    /// assert_eq!(config.pre().len(), 1);
    /// let wrong = SolverConfig::builder().constraint(Constraint::point("tip", "handle", -1.0)).build();
    /// assert_eq!(wrong.unwrap_err().field, "constraint_list[0].tolerance");
    /// # Ok::<(), gensim2_kpam::ConfigError>(())
    /// ```
    pub fn builder() -> SolverConfigBuilder {
        SolverConfigBuilder::new()
    }

    /// Returns the constraints and costs of the actuation pose.
    #[must_use]
    pub fn constraints(&self) -> &[Constraint] {
        &self.constraints
    }

    /// Returns the motions before the actuation pose; the first one is directly before the pose.
    #[must_use]
    pub fn pre(&self) -> &[Motion] {
        &self.pre
    }

    /// Returns the motions after the actuation pose.
    #[must_use]
    pub fn post(&self) -> &[Motion] {
        &self.post
    }

    /// Returns the mode of the fingers.
    #[must_use]
    pub fn gripper(&self) -> Gripper {
        self.gripper
    }

    /// Returns the distance (m) of the hand's retreat along its own z axis after the release; `None` for no release.
    #[must_use]
    pub fn let_go(&self) -> Option<f64> {
        self.let_go
    }

    /// Returns the JSON text that the config was read from; empty if the config was built in code.
    #[must_use]
    pub fn source(&self) -> &str {
        &self.source
    }

    /// Returns whether the config sets any time.
    #[must_use]
    pub fn has_times(&self) -> bool {
        self.actuation_time.is_some() || self.pre_times.is_some() || self.post_times.is_some()
    }

    /// Returns the times (s) of all keyframes on the config's clock, increasing. By default, the actuation is at 24 s
    /// and each motion takes 4 s; the release always takes 4 s.
    ///
    /// # Errors
    /// The times do not increase, or the first keyframe is not after `start` (s).
    pub fn clock(&self, start: f64) -> Result<Vec<f64>> {
        const STEP: f64 = 4.0;
        let actuation = self.actuation_time.unwrap_or(24.0);
        let before = self.pre.len();
        let mut out = match &self.pre_times {
            Some(t) => t.clone(),
            None => (0..before).map(|i| actuation - STEP * (before - i) as f64).collect(),
        };
        out.push(actuation);
        match &self.post_times {
            Some(t) => out.extend_from_slice(t),
            None => out.extend((0..self.post.len()).map(|i| actuation + STEP * (i + 1) as f64)),
        }
        if self.let_go.is_some() {
            out.push(out[out.len() - 1] + STEP);
        }
        let mut last = start;
        for (i, t) in out.iter().enumerate() {
            if *t <= last {
                let field = match i.cmp(&before) {
                    std::cmp::Ordering::Less => format!("pre_actuation_times[{i}]"),
                    std::cmp::Ordering::Equal => "actuation_time".to_owned(),
                    std::cmp::Ordering::Greater => format!("post_actuation_times[{}]", i - before - 1),
                };
                return Err(ConfigError::new(field, format!("{t} s must come after {last} s")));
            }
            last = *t;
        }
        Ok(out)
    }

    /// Returns the name of the keypoint at the joint frame's origin: the target of the first point constraint.
    #[must_use]
    pub fn target_keypoint(&self) -> Option<&str> {
        self.constraints.iter().find_map(|c| match c {
            Constraint::Point { target, .. } => Some(target.as_str()),
            _ => None,
        })
    }
}

//! The solver config language: keypoint constraints, and motions before and after the actuation pose.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::ConfigError;
use crate::checked::checked_when_read;

mod build;
mod read;

pub use build::SolverConfigBuilder;

/// Frame in which a config writes a direction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Frame {
    /// World axes.
    World,
    /// The object frame.
    Object,
    /// The joint frame at the config's target keypoint: y in the direction in which the keypoint moves when the joint
    /// opens, z along the joint axis, x = y × z.
    Joint,
}

/// Direction of the object in an axis constraint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum TargetAxis {
    /// Unit direction in a frame.
    Fixed {
        /// The direction.
        axis: Vector3<f64>,
        /// Frame of the axis.
        frame: Frame,
    },
    /// Axis from one keypoint of the object to another.
    Keypoints {
        /// Start of the axis.
        from: String,
        /// End of the axis.
        to: String,
    },
}

/// One entry of `constraint_list`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Constraint {
    /// `point2point_constraint`: each base coordinate of the keypoint lies within `tolerance` (m) of the target's.
    Point {
        /// Keypoint of the tool.
        keypoint: String,
        /// Keypoint of the object.
        target: String,
        /// Offset of the target (m).
        offset: Vector3<f64>,
        /// Frame of the offset.
        frame: Frame,
        /// Tolerance (m).
        tolerance: f64,
    },
    /// The four axis constraints: the angle between two directions lies within `tolerance` (rad) of `arccos(inner)`.
    Axis {
        /// Type as written in the config, for example `frame_axis_parallel`.
        kind: String,
        /// Tool keypoint at the start of the tool's direction.
        from: String,
        /// Tool keypoint at its end.
        to: String,
        /// Direction on the object.
        target: TargetAxis,
        /// Target inner product.
        inner: f64,
        /// Tolerance (rad).
        tolerance: f64,
    },
    /// `point2point_cost`: weight times the squared distance (m^2) of two keypoints.
    PointCost {
        /// Keypoint of the tool.
        keypoint: String,
        /// Keypoint of the object.
        target: String,
        /// Weight.
        weight: f64,
    },
    /// `point2plane_cost`: weight times the squared distance (m^2) of a keypoint from a plane through the target.
    PlaneCost {
        /// Keypoint of the tool.
        keypoint: String,
        /// Keypoint of the object.
        target: String,
        /// Unit normal.
        normal: Vector3<f64>,
        /// Frame of the normal.
        frame: Frame,
        /// Weight.
        weight: f64,
    },
}

impl Constraint {
    /// Name for reports: the type and the names that it refers to.
    #[must_use]
    pub fn name(&self) -> String {
        match self {
            Self::Point { keypoint, target, .. } => format!("point2point_constraint({keypoint}, {target})"),
            Self::Axis { kind, from, to, target, .. } => match target {
                TargetAxis::Fixed { axis, frame } => {
                    format!("{kind}({from} -> {to}, {} axis [{}, {}, {}])", frame.name(), axis.x, axis.y, axis.z)
                }
                TargetAxis::Keypoints { from: a, to: b } => format!("{kind}({from} -> {to}, {a} -> {b})"),
            },
            Self::PointCost { keypoint, target, .. } => format!("point2point_cost({keypoint}, {target})"),
            Self::PlaneCost { keypoint, target, .. } => format!("point2plane_cost({keypoint}, {target})"),
        }
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

/// One entry of a motion list.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Motion {
    /// Translation along axis 0, 1 or 2 of the hand (m).
    Translate {
        /// Hand axis.
        axis: usize,
        /// Metres.
        distance: f64,
    },
    /// Translation of the hand along the axes of the base (m).
    Move(Vector3<f64>),
    /// Rotation about the object axis through the object frame's origin (rad).
    Rotate(f64),
    /// Moves the hand with the object's joint by this travel (rad or m).
    FollowJoint(f64),
    /// Moves the hand with the object's joint to this openness (0..1, may exceed the range).
    FollowJointTo(f64),
    /// Moves the tool keypoint of the point constraint with the object's joint by this travel (rad or m); the hand
    /// keeps its orientation.
    TraceJoint(f64),
    /// Like `TraceJoint`, to this openness (0..1, may exceed the range).
    TraceJointTo(f64),
}

impl Motion {
    /// Whether the motion needs the object's joint.
    pub fn follows_joint(&self) -> bool {
        matches!(self, Self::FollowJoint(_) | Self::FollowJointTo(_) | Self::TraceJoint(_) | Self::TraceJointTo(_))
    }
}

/// Finger mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Gripper {
    /// Open throughout.
    Open,
    /// Closed throughout.
    Closed,
    /// Closing at the actuation pose.
    Grasp,
    /// Unchanged throughout, because an object is held.
    Hold,
    /// Opening at the actuation pose.
    Release,
}

impl Gripper {
    /// Name of the finger mode as written in configs.
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

    /// Whether the fingers move at the actuation pose, so that the motion must stop there.
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
    /// Motions before the actuation pose, in the order away from it: the first one is adjacent, and the last one is
    /// executed first.
    pub(crate) pre: Vec<Motion>,
    /// Motions after the actuation pose.
    pub(crate) post: Vec<Motion>,
    /// Time of the actuation pose (s).
    pub(crate) actuation_time: Option<f64>,
    /// Times of the pre-actuation keyframes (s), increasing; the last one belongs to the first motion in `pre`.
    pub(crate) pre_times: Option<Vec<f64>>,
    /// Times of the post-actuation keyframes (s).
    pub(crate) post_times: Option<Vec<f64>>,
    /// Fingers.
    pub(crate) gripper: Gripper,
    /// Distance (m) by which the hand retreats along its own z axis after the final release.
    pub(crate) let_go: Option<f64>,
    /// The original JSON text.
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

    /// Constraints and costs of the actuation pose.
    #[must_use]
    pub fn constraints(&self) -> &[Constraint] {
        &self.constraints
    }

    /// Motions before the actuation pose; the first one is adjacent to it.
    #[must_use]
    pub fn pre(&self) -> &[Motion] {
        &self.pre
    }

    /// Motions after the actuation pose.
    #[must_use]
    pub fn post(&self) -> &[Motion] {
        &self.post
    }

    /// Finger mode.
    #[must_use]
    pub fn gripper(&self) -> Gripper {
        self.gripper
    }

    /// Retreat (m) of the hand along its own z axis after the final release; `None` for no release.
    #[must_use]
    pub fn let_go(&self) -> Option<f64> {
        self.let_go
    }

    /// The original JSON text; empty if the config was built in code.
    #[must_use]
    pub fn source(&self) -> &str {
        &self.source
    }

    /// Whether the config sets any time.
    #[must_use]
    pub fn has_times(&self) -> bool {
        self.actuation_time.is_some() || self.pre_times.is_some() || self.post_times.is_some()
    }

    /// Keyframe times (s) on the config's clock, increasing: pre-actuation, actuation, post-actuation, release. By
    /// default, the actuation is at 24 s and each motion takes 4 s; the release always takes 4 s.
    ///
    /// # Errors
    /// The times do not increase from `start`.
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

    /// Name of the keypoint at the origin of the joint frame: the target of the first point constraint.
    #[must_use]
    pub fn target_keypoint(&self) -> Option<&str> {
        self.constraints.iter().find_map(|c| match c {
            Constraint::Point { target, .. } => Some(target.as_str()),
            _ => None,
        })
    }
}

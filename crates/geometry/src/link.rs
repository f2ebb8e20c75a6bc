//! Links and joints, the parts of a kinematic tree.

use nalgebra::{Rotation3, Translation3, Vector3};
use serde::{Deserialize, Serialize};

use crate::checked_when_read;
use crate::{Convex, Inertia, Pose, RobotError, is_rigid, rotation_about};

/// Tolerance for the length of unit axes.
const UNIT: f64 = 1e-6;
/// Maximum distance of a link from its parent (m). Larger coordinates lose the precision that planning needs.
pub(crate) const FURTHEST: f64 = 1000.0;

/// Motion type of a joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum JointKind {
    /// The joint rotates about its axis (rad). A continuous joint has no limits.
    Revolute,
    /// The joint slides along its axis (m).
    Prismatic,
}

/// A mimic joint's relation to another joint: `value = multiplier * source + offset`. The source is independent, since
/// chains of mimic joints are composed when a URDF is read.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Mimic {
    /// Index of the source in the joint vector; the source is not a mimic joint.
    pub source: usize,
    /// Factor applied to the source's value.
    pub multiplier: f64,
    /// Offset added after the multiplication (rad or m).
    pub offset: f64,
}

/// A moving joint. Joint vectors use the same index as [`crate::Robot::joints`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(remote = "Self")]
pub struct Joint {
    pub(crate) name: String,
    pub(crate) kind: JointKind,
    pub(crate) axis: Vector3<f64>,
    #[serde(with = "crate::checked::open_below")]
    pub(crate) lower: f64,
    #[serde(with = "crate::checked::open_above")]
    pub(crate) upper: f64,
    #[serde(with = "crate::checked::open_above")]
    pub(crate) velocity: f64,
    #[serde(with = "crate::checked::open_above")]
    pub(crate) effort: f64,
    #[serde(with = "crate::checked::open_above")]
    pub(crate) acceleration: f64,
    #[serde(with = "crate::checked::open_above")]
    pub(crate) jerk: f64,
    pub(crate) mimic: Option<Mimic>,
}

impl Joint {
    /// Name of the joint, unique in the robot.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Motion type: rotation or translation.
    #[inline]
    #[must_use]
    pub fn kind(&self) -> JointKind {
        self.kind
    }

    /// Unit axis in the joint frame.
    #[inline]
    #[must_use]
    pub fn axis(&self) -> &Vector3<f64> {
        &self.axis
    }

    /// Lower limit (rad or m), minus infinity for a continuous joint.
    #[inline]
    #[must_use]
    pub fn lower(&self) -> f64 {
        self.lower
    }

    /// Upper limit (rad or m), infinity for a continuous joint.
    #[inline]
    #[must_use]
    pub fn upper(&self) -> f64 {
        self.upper
    }

    /// Velocity limit (rad/s or m/s); infinity if unknown.
    #[inline]
    #[must_use]
    pub fn velocity(&self) -> f64 {
        self.velocity
    }

    /// Torque limit (N m; N for a sliding joint); infinity if unknown.
    #[inline]
    #[must_use]
    pub fn effort(&self) -> f64 {
        self.effort
    }

    /// Acceleration limit (rad/s^2 or m/s^2); infinity if unknown.
    #[inline]
    #[must_use]
    pub fn acceleration(&self) -> f64 {
        self.acceleration
    }

    /// Jerk limit (rad/s^3 or m/s^3); infinity if unknown.
    #[inline]
    #[must_use]
    pub fn jerk(&self) -> f64 {
        self.jerk
    }

    /// Relation to the joint that this joint follows, if any.
    #[inline]
    #[must_use]
    pub fn mimic(&self) -> Option<Mimic> {
        self.mimic
    }

    /// Validates that the axis has length 1 and the limits are consistent.
    pub(crate) fn check(&self) -> Result<(), RobotError> {
        let fail = |part: &str, message: String| Err(RobotError::new(format!("joint {}: {part}", self.name), message));
        let off = (self.axis.norm() - 1.0).abs();
        if off.is_nan() || off > UNIT {
            return fail("axis", format!("must be a unit vector, not {:?}", self.axis.as_slice()));
        }
        if self.lower.is_nan() || self.upper.is_nan() || self.lower > self.upper {
            return fail("limit", format!("lower {} must not exceed upper {}", self.lower, self.upper));
        }
        let rates = [
            ("velocity", self.velocity),
            ("effort", self.effort),
            ("acceleration", self.acceleration),
            ("jerk", self.jerk),
        ];
        if let Some((name, value)) = rates.into_iter().find(|(_, v)| v.is_nan() || *v <= 0.0) {
            return fail("limit", format!("{name} {value} must be positive"));
        }
        if let Some(m) = self.mimic
            && !(m.multiplier.is_finite() && m.offset.is_finite())
        {
            return fail("mimic", "gives a multiplier that is not finite".to_owned());
        }
        Ok(())
    }

    /// Transform of the child link relative to the joint frame at joint value `q`.
    #[must_use]
    pub fn motion(&self, q: f64) -> Pose {
        match self.kind {
            JointKind::Revolute => Pose::from_parts(Translation3::identity(), rotation_about(&self.axis, q)),
            JointKind::Prismatic => Pose::from_parts(Translation3::from(self.axis * q), Rotation3::identity()),
        }
    }
}

/// A link. Links are ordered with parents first; the base is link 0.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(remote = "Self")]
pub struct Link {
    pub(crate) name: String,
    pub(crate) parent: Option<usize>,
    pub(crate) origin: Pose,
    pub(crate) joint: Option<usize>,
    pub(crate) shapes: Vec<Convex>,
    pub(crate) inertia: Option<Inertia>,
}

impl Link {
    /// Name of the link, unique in the robot.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Index of the parent link; `None` for the base.
    #[inline]
    #[must_use]
    pub fn parent(&self) -> Option<usize> {
        self.parent
    }

    /// Pose of the joint frame in the parent link.
    #[inline]
    #[must_use]
    pub fn origin(&self) -> &Pose {
        &self.origin
    }

    /// Index of the moving joint between the parent and this link; `None` if the connection is fixed.
    #[inline]
    #[must_use]
    pub fn joint(&self) -> Option<usize> {
        self.joint
    }

    /// Collision shapes in the link frame.
    #[inline]
    #[must_use]
    pub fn shapes(&self) -> &[Convex] {
        &self.shapes
    }

    /// Mass properties; `None` for a massless link.
    #[inline]
    #[must_use]
    pub fn inertia(&self) -> Option<&Inertia> {
        self.inertia.as_ref()
    }

    /// Validates that the link is rigidly attached to its parent, within the maximum distance.
    pub(crate) fn check(&self) -> Result<(), RobotError> {
        if let Some(inertia) = &self.inertia {
            inertia.check(&self.name)?;
        }
        let near = self.origin.translation.vector.iter().all(|v| v.abs() <= FURTHEST);
        if is_rigid(&self.origin) && near {
            return Ok(());
        }
        let message = format!("must be a rigid transform within {FURTHEST} m");
        Err(RobotError::new(format!("link {}: origin", self.name), message))
    }
}

checked_when_read!(Joint, Link);

//! The moving joint of an object.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::ProblemError;
use crate::body::place;
use gensim2_geometry::checked_when_read;

/// Permitted deviation of an axis's length from 1.
const UNIT: f64 = 1e-6;

/// Type of an object's joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum ObjectJointKind {
    /// The joint rotates (rad).
    Revolute,
    /// The joint slides (m).
    Prismatic,
}

/// The moving joint of an object, given in the robot's base frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(remote = "Self")]
pub struct ObjectJoint {
    pub(crate) kind: ObjectJointKind,
    pub(crate) origin: Vector3<f64>,
    pub(crate) axis: Vector3<f64>,
    pub(crate) value: f64,
    pub(crate) lower: f64,
    pub(crate) upper: f64,
}

checked_when_read!(ObjectJoint);

impl ObjectJoint {
    /// Creates a joint that rotates about `axis` or slides along it. The axis passes through `origin` (m). `value` is
    /// the joint's current value (rad or m), `lower` its value at openness 0, and `upper` its value at openness 1.
    ///
    /// # Errors
    /// The axis is zero, the limits are inverted, or a number is not finite.
    pub fn new(
        kind: ObjectJointKind,
        origin: Vector3<f64>,
        axis: Vector3<f64>,
        value: f64,
        [lower, upper]: [f64; 2],
    ) -> Result<Self, ProblemError> {
        let axis = axis.try_normalize(1e-9).ok_or_else(|| ProblemError::new("axis", "has no direction"))?;
        let joint = Self { kind, origin, axis, value, lower, upper };
        joint.check().map(|()| joint)
    }

    /// Returns the type of the joint.
    #[must_use]
    pub fn kind(&self) -> ObjectJointKind {
        self.kind
    }

    /// Returns a point on the axis (m, base frame).
    #[must_use]
    pub fn origin(&self) -> &Vector3<f64> {
        &self.origin
    }

    /// Returns the unit vector of the axis in the base frame; the joint opens in this direction.
    #[must_use]
    pub fn axis(&self) -> &Vector3<f64> {
        &self.axis
    }

    /// Returns the current value (rad or m).
    #[must_use]
    pub fn value(&self) -> f64 {
        self.value
    }

    /// Returns the values (rad or m) at openness 0 and 1.
    #[must_use]
    pub fn range(&self) -> [f64; 2] {
        [self.lower, self.upper]
    }

    fn check(&self) -> Result<(), ProblemError> {
        let fail = |field: &str, message: String| Err(ProblemError::new(field, message));
        place("origin", &self.origin)?;
        let off = (self.axis.norm() - 1.0).abs();
        if off.is_nan() || off > UNIT {
            return fail("axis", format!("must be a unit vector, not {:?}", self.axis.as_slice()));
        }
        if ![self.value, self.lower, self.upper].iter().all(|v| v.is_finite()) {
            return fail("value", "and limits must be finite".to_owned());
        }
        if self.lower > self.upper {
            return fail("lower", format!("{} must not exceed upper {}", self.lower, self.upper));
        }
        Ok(())
    }
}

//! Bodies around the robot or attached to its hand.

use std::collections::BTreeMap;
use std::sync::Arc;

use gensim2_geometry::{Convex, Pose, checked_when_read, is_rigid};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::ProblemError;

/// Maximum distance (m) of a body's points from the base; a larger distance counts as damaged input.
const FARTHEST: f64 = 1e3;

/// Role of a body, which decides by default what it may touch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Role {
    /// The table.
    Table,
    /// The fixed part of the object.
    ObjectBody,
    /// The part of the object that the object's joint moves.
    MovingLink,
    /// Any other obstacle.
    Rigid,
    /// A rigid object that the hand reaches for and may touch.
    Target,
    /// A body attached to the hand; its pose is given in the hand frame.
    Attached,
}

impl Role {
    /// Returns the name of the role as used in Python, such as `table`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Table => "table",
            Self::ObjectBody => "object_body",
            Self::MovingLink => "moving_link",
            Self::Rigid => "rigid",
            Self::Target => "target",
            Self::Attached => "attached",
        }
    }
}

/// A body of the scene: an obstacle, a target of the hand, or an attached body. Clones share its shapes.
///
/// ```
/// use gensim2_geometry::{Convex, Pose};
/// use gensim2_kpam::{Body, Role};
/// use nalgebra::Vector3;
///
/// let cube = Body::builder("cube", Role::Target)
///     .shape(Convex::cuboid([0.02; 3], &Pose::identity())?)
///     .pose(Pose::translation(0.5, 0.0, 0.02))
///     .keypoint("top", Vector3::new(0.0, 0.0, 0.02))
///     .build()?;
/// assert_eq!(cube.name(), "cube");
/// let lost = Body::builder("cube", Role::Target).pose(Pose::translation(f64::NAN, 0.0, 0.0)).build();
/// assert_eq!(lost.unwrap_err().field, "pose");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(remote = "Self")]
pub struct Body {
    pub(crate) name: String,
    pub(crate) role: Role,
    pub(crate) shapes: Arc<[Convex]>,
    pub(crate) pose: Pose,
    pub(crate) keypoints: BTreeMap<String, Vector3<f64>>,
}

checked_when_read!(Body);

/// Builds a [`Body`]; [`BodyBuilder::build`] validates it.
#[derive(Debug, Clone)]
#[must_use]
pub struct BodyBuilder {
    name: String,
    role: Role,
    shapes: Vec<Convex>,
    pose: Pose,
    keypoints: BTreeMap<String, Vector3<f64>>,
}

impl Body {
    /// Returns a builder for a body at the base frame, without shapes. The name must be unique in the scene.
    pub fn builder(name: impl Into<String>, role: Role) -> BodyBuilder {
        let (shapes, keypoints) = (Vec::new(), BTreeMap::new());
        BodyBuilder { name: name.into(), role, shapes, pose: Pose::identity(), keypoints }
    }

    /// Returns the name, which is unique in the scene.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the role.
    #[must_use]
    pub fn role(&self) -> Role {
        self.role
    }

    /// Returns the convex shapes in the body frame.
    #[must_use]
    pub fn shapes(&self) -> &[Convex] {
        &self.shapes
    }

    /// Returns the pose in the robot's base frame, or in the hand frame for an attached body.
    #[must_use]
    pub fn pose(&self) -> &Pose {
        &self.pose
    }

    /// Returns the keypoints in the body frame (m). Only scenes use them.
    #[must_use]
    pub fn keypoints(&self) -> &BTreeMap<String, Vector3<f64>> {
        &self.keypoints
    }

    /// Returns the body with a new role and a new pose.
    pub(crate) fn placed(&self, role: Role, pose: Pose) -> Result<Self, ProblemError> {
        let body = Self { role, pose, ..self.clone() };
        body.check().map(|()| body)
    }

    fn check(&self) -> Result<(), ProblemError> {
        rigid("pose", &self.pose)?;
        let extent = |shape: &Convex| shape.center().coords.norm() + shape.bound();
        if let Some((k, shape)) = self.shapes.iter().enumerate().find(|(_, shape)| extent(shape) > FARTHEST) {
            let message = format!(
                "extends {:.4e} m from the origin of body {:?}; shapes must lie within {FARTHEST} m: check the unit, or \
                 drop stray points",
                extent(shape),
                self.name
            );
            return Err(ProblemError::new(format!("shapes[{k}]"), message));
        }
        self.keypoints.iter().try_for_each(|(name, p)| place(&format!("keypoints[{name:?}]"), p))
    }
}

impl BodyBuilder {
    /// Adds a convex shape, given in the body frame.
    pub fn shape(mut self, shape: Convex) -> Self {
        self.shapes.push(shape);
        self
    }

    /// Adds convex shapes, given in the body frame.
    pub fn shapes(mut self, shapes: impl IntoIterator<Item = Convex>) -> Self {
        self.shapes.extend(shapes);
        self
    }

    /// Sets the pose in the robot's base frame, or in the hand frame for an attached body.
    pub fn pose(mut self, pose: Pose) -> Self {
        self.pose = pose;
        self
    }

    /// Adds a keypoint with its position in the body frame (m).
    pub fn keypoint(mut self, name: impl Into<String>, point: Vector3<f64>) -> Self {
        self.keypoints.insert(name.into(), point);
        self
    }

    /// Returns the validated body.
    ///
    /// # Errors
    /// The pose is not rigid, or a position or shape is not within 1,000 m.
    pub fn build(self) -> Result<Body, ProblemError> {
        let Self { name, role, shapes, pose, keypoints } = self;
        let body = Body { name, role, shapes: shapes.into(), pose, keypoints };
        body.check().map(|()| body)
    }
}

/// Checks that a position is at most 1,000 m from the base; `field` is its name in errors.
pub(crate) fn place(field: &str, p: &Vector3<f64>) -> Result<(), ProblemError> {
    if p.iter().all(|v| v.is_finite() && v.abs() <= FARTHEST) {
        return Ok(());
    }
    Err(ProblemError::new(field, format!("{:?} is not a finite place within {FARTHEST} m", p.as_slice())))
}

/// Checks that a transform is rigid and at most 1,000 m from the base; `field` is its name in errors.
pub(crate) fn rigid(field: &str, pose: &Pose) -> Result<(), ProblemError> {
    place(field, &pose.translation.vector)?;
    if is_rigid(pose) { Ok(()) } else { Err(ProblemError::new(field, "has a rotation that is not orthonormal")) }
}

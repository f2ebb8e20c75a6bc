//! Builders for robots defined in code.

use nalgebra::Vector3;

use crate::{Convex, Inertia, Joint, JointKind, Link, Mimic, Pose, Robot, RobotError, mimic};

/// Builds a [`Robot`] from links: the base comes first, and every parent before its children. [`RobotBuilder::build`]
/// validates the result.
#[derive(Debug, Clone)]
#[must_use]
pub struct RobotBuilder {
    name: String,
    links: Vec<LinkBuilder>,
    free: Vec<(String, String)>,
}

/// Builds a [`Link`]; [`RobotBuilder::build`] validates it.
#[derive(Debug, Clone)]
#[must_use]
pub struct LinkBuilder {
    name: String,
    parent: Option<String>,
    origin: Pose,
    joint: Option<JointBuilder>,
    shapes: Vec<Convex>,
    inertia: Option<Inertia>,
}

/// Builds a [`Joint`]; [`RobotBuilder::build`] validates it.
#[derive(Debug, Clone)]
#[must_use]
pub struct JointBuilder {
    joint: Joint,
    follows: Option<(String, f64, f64)>,
}

impl Joint {
    /// Returns a joint that rotates about a direction of its frame, without limits until they are set.
    pub fn revolute(name: impl Into<String>, axis: Vector3<f64>) -> JointBuilder {
        JointBuilder::new(name.into(), JointKind::Revolute, axis)
    }

    /// Returns a joint that slides along a direction of its frame, without limits until they are set.
    pub fn prismatic(name: impl Into<String>, axis: Vector3<f64>) -> JointBuilder {
        JointBuilder::new(name.into(), JointKind::Prismatic, axis)
    }
}

impl JointBuilder {
    fn new(name: String, kind: JointKind, axis: Vector3<f64>) -> Self {
        // Keep a zero vector so that `build` returns an error for it.
        let axis = axis.try_normalize(0.0).unwrap_or(axis);
        let (lower, upper, open) = (f64::NEG_INFINITY, f64::INFINITY, f64::INFINITY);
        let [velocity, effort, acceleration, jerk] = [open; 4];
        let joint = Joint { name, kind, axis, lower, upper, velocity, effort, acceleration, jerk, mimic: None };
        Self { joint, follows: None }
    }

    /// Sets the limits (rad or m).
    pub fn limits(mut self, lower: f64, upper: f64) -> Self {
        (self.joint.lower, self.joint.upper) = (lower, upper);
        self
    }

    /// Sets the velocity limit (rad/s or m/s).
    pub fn velocity(mut self, limit: f64) -> Self {
        self.joint.velocity = limit;
        self
    }

    /// Sets the torque limit (N m; N for a sliding joint).
    pub fn effort(mut self, limit: f64) -> Self {
        self.joint.effort = limit;
        self
    }

    /// Sets the acceleration and jerk limits (rad/s^2 and rad/s^3, or m/s^2 and m/s^3).
    pub fn acceleration(mut self, limit: f64, jerk: f64) -> Self {
        (self.joint.acceleration, self.joint.jerk) = (limit, jerk);
        self
    }

    /// Makes the joint follow another joint: `value = multiplier * source + offset`.
    pub fn follows(mut self, source: impl Into<String>, multiplier: f64, offset: f64) -> Self {
        self.follows = Some((source.into(), multiplier, offset));
        self
    }
}

impl Link {
    /// Returns the base link, the root of the tree.
    pub fn base(name: impl Into<String>) -> LinkBuilder {
        LinkBuilder::new(name.into(), None)
    }

    /// Returns a link attached to a parent link. The connection is fixed until a joint is set.
    pub fn below(parent: impl Into<String>, name: impl Into<String>) -> LinkBuilder {
        LinkBuilder::new(name.into(), Some(parent.into()))
    }
}

impl LinkBuilder {
    fn new(name: String, parent: Option<String>) -> Self {
        Self { name, parent, origin: Pose::identity(), joint: None, shapes: Vec::new(), inertia: None }
    }

    /// Sets the pose of the joint frame in the parent link.
    pub fn at(mut self, origin: Pose) -> Self {
        self.origin = origin;
        self
    }

    /// Sets the joint between the parent and this link.
    pub fn moved_by(mut self, joint: JointBuilder) -> Self {
        self.joint = Some(joint);
        self
    }

    /// Adds a collision shape, given in the link frame.
    pub fn shape(mut self, shape: Convex) -> Self {
        self.shapes.push(shape);
        self
    }

    /// Sets the mass properties of the link.
    pub fn inertia(mut self, inertia: Inertia) -> Self {
        self.inertia = Some(inertia);
        self
    }
}

impl RobotBuilder {
    pub(crate) fn new(name: String) -> Self {
        Self { name, links: Vec::new(), free: Vec::new() }
    }

    /// Adds a link.
    pub fn link(mut self, link: LinkBuilder) -> Self {
        self.links.push(link);
        self
    }

    /// Disables the collision check between two links. Neighbours, and links that overlap in almost all configurations,
    /// are not checked anyway.
    pub fn disabled_collisions(mut self, one: impl Into<String>, other: impl Into<String>) -> Self {
        self.free.push((one.into(), other.into()));
        self
    }

    /// Returns the robot whose tool is attached to the link `hand`. Joints are numbered in the order in which their
    /// links were added.
    ///
    /// # Errors
    /// The robot has no base or several; a name is unknown or repeated; a parent comes after its child; an axis is
    /// zero; limits are inverted; or mimic joints form a cycle.
    pub fn build(self, hand: &str) -> Result<Robot, RobotError> {
        let names: Vec<String> = self.links.iter().map(|l| l.name.clone()).collect();
        let index = |name: &str, field: &str| {
            let message = || format!("{name:?} is not a link; links: {}", names.join(", "));
            names.iter().position(|n| n == name).ok_or_else(|| RobotError::new(field, message()))
        };
        let builders: Vec<JointBuilder> = self.links.iter().filter_map(|l| l.joint.clone()).collect();
        let mut joints = Vec::with_capacity(builders.len());
        for JointBuilder { mut joint, follows } in builders.clone() {
            if let Some((source, multiplier, offset)) = follows {
                let named = |b: &JointBuilder| b.joint.name == source && b.joint.name != joint.name;
                let source = builders.iter().position(named).ok_or_else(|| {
                    RobotError::new(format!("joint {}: mimic", joint.name), format!("{source:?} is not another joint"))
                })?;
                joint.mimic = Some(Mimic { source, multiplier, offset });
            }
            joints.push(joint);
        }
        mimic::compose(&mut joints)?;
        let mut links = Vec::with_capacity(self.links.len());
        let mut count = 0;
        for link in self.links {
            let parent = link.parent.map(|p| index(&p, &format!("link {}", link.name))).transpose()?;
            let joint = link.joint.map(|_| count);
            count += usize::from(joint.is_some());
            let LinkBuilder { name, origin, shapes, inertia, .. } = link;
            links.push(Link { name, parent, origin, joint, shapes, inertia });
        }
        let hand = index(hand, "hand")?;
        let mut pairs = Vec::with_capacity(self.free.len());
        for (one, other) in &self.free {
            let (a, b) = (index(one, "disabled_collisions")?, index(other, "disabled_collisions")?);
            pairs.push((a.min(b), a.max(b)));
        }
        Robot::of_parts(self.name, links, joints, hand, pairs)
    }
}

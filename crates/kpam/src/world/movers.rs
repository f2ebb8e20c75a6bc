//! The joints that move links during a motion.

use gensim2_geometry::{JointKind, Pose, Robot};
use nalgebra::{Point3, Vector3};

use crate::model::{DrivenJoint, Model, Row};

/// All joints that move when the planned variables change, including mimic joints.
pub(crate) struct Movers(Vec<DrivenJoint>);

impl Movers {
    /// Returns the moving joints of a model.
    pub fn new(model: &Model) -> Self {
        Self(model.map().driven().to_vec())
    }

    /// Iterates over the moving joints.
    pub fn iter(&self) -> std::slice::Iter<'_, DrivenJoint> {
        self.0.iter()
    }

    /// Number of moving joints.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Returns for each joint whether it moves a link.
    pub fn carrying<'a>(&'a self, robot: &'a Robot, link: usize) -> impl Iterator<Item = bool> + 'a {
        self.0.iter().map(move |joint| is_below(robot, link, joint.link))
    }

    /// Writes how far each joint moves between the variables `a` and `b` (rad or m, not negative).
    pub fn steps(&self, a: &Row, b: &Row, out: &mut Vec<f64>) {
        out.clear();
        out.extend(self.0.iter().map(|joint| (joint.factor * (b[joint.variable] - a[joint.variable])).abs()));
    }

    /// Returns the maximum displacement (m) of a point within `extent` of `middle` (base frame) per unit of joint `m`.
    pub fn lever(&self, robot: &Robot, m: usize, links: &[Pose], middle: &Point3<f64>, extent: f64) -> f64 {
        let frame = &links[self.0[m].link];
        let joint = &robot.joints()[self.0[m].joint];
        match joint.kind() {
            JointKind::Prismatic => 1.0,
            JointKind::Revolute => {
                let axis = frame.rotation * joint.axis();
                off_axis(middle, &frame.translation.vector, &axis) + extent
            }
        }
    }
}

/// Distance (m) of a point from the line through `origin` along the unit vector `axis`.
pub(crate) fn off_axis(point: &Point3<f64>, origin: &Vector3<f64>, axis: &Vector3<f64>) -> f64 {
    let arm = point.coords - origin;
    (arm - axis * arm.dot(axis)).norm()
}

/// Returns whether a link is `top` or below it.
pub(crate) fn is_below(robot: &Robot, mut link: usize, top: usize) -> bool {
    loop {
        if link == top {
            return true;
        }
        match robot.links()[link].parent() {
            Some(parent) => link = parent,
            None => return false,
        }
    }
}

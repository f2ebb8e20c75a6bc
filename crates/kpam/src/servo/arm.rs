//! Kinematics of the arm in its present state, which the quadratic program needs.

use gensim2_geometry::{JointKind, Other, Pose, Screen};
use nalgebra::{Point3, Vector3, Vector6};

use super::guard::Surroundings;
use crate::model::{MAX_JOINTS, Row};
use crate::world::{Compiled, is_below};

/// A joint that a variable drives.
#[derive(Debug, Clone, Copy)]
struct Axis {
    variable: usize,
    kind: JointKind,
    /// Direction of the joint's axis times the factor of the variable, and a point on the axis (m), base frame.
    direction: Vector3<f64>,
    origin: Vector3<f64>,
    factor: f64,
}

impl Axis {
    /// Returns the velocity of a point (base frame) per unit of the variable.
    fn velocity(&self, point: &Vector3<f64>) -> Vector3<f64> {
        match self.kind {
            JointKind::Prismatic => self.direction,
            JointKind::Revolute => self.direction.cross(&(point - self.origin)),
        }
    }

    /// Returns the maximum distance (m) from the axis of the points in a sphere, 1 for a prismatic joint.
    fn lever(&self, center: &Vector3<f64>, radius: f64) -> f64 {
        match self.kind {
            JointKind::Prismatic => 1.0,
            JointKind::Revolute => self.velocity(center).norm() / self.factor + radius,
        }
    }
}

/// Poses of all links and axes of all driven joints, with buffers that are reused.
#[derive(Debug)]
pub(super) struct Arm {
    /// Link that follows targets.
    link: usize,
    /// Indices of the axes that move this link, and of those that move each group.
    movers: Vec<usize>,
    group_movers: Vec<Vec<usize>>,
    axes: Vec<Axis>,
    q: Vec<f64>,
    pub poses: Vec<Pose>,
}

impl Arm {
    /// Creates the kinematics with the link that follows targets.
    pub fn new(around: Surroundings<'_>, link: usize) -> Self {
        let (robot, driven) = (around.scene.robot(), around.model.map().driven());
        let group_movers = around.scene.compiled().carriers.iter().map(|carriers| {
            let carries = |joint: usize| carriers.iter().any(|(j, _)| *j == joint);
            (0..driven.len()).filter(|d| carries(driven[*d].joint)).collect()
        });
        Self {
            link,
            movers: (0..driven.len()).filter(|d| is_below(robot, link, driven[*d].link)).collect(),
            group_movers: group_movers.collect(),
            axes: Vec::with_capacity(driven.len()),
            q: Vec::new(),
            poses: Vec::new(),
        }
    }

    /// Computes all poses and axes at the variables `x`.
    pub fn place(&mut self, around: Surroundings<'_>, x: &Row) {
        around.model.map().positions(x, &mut self.q);
        Compiled::poses(around.scene, &self.q, &mut self.poses);
        self.axes.clear();
        for driven in around.model.map().driven() {
            let (joint, pose) = (&around.scene.robot().joints()[driven.joint], &self.poses[driven.link]);
            self.axes.push(Axis {
                variable: driven.variable,
                kind: joint.kind(),
                direction: pose.rotation * (joint.axis() * driven.factor),
                origin: pose.translation.vector,
                factor: driven.factor.abs(),
            });
        }
    }

    /// Returns the pose of the link that follows targets.
    pub fn tip(&self) -> &Pose {
        &self.poses[self.link]
    }

    /// Returns the Jacobian of this link by columns: linear velocity of its origin (m) and angular velocity (rad), base
    /// frame, per unit of each variable.
    pub fn twists(&self) -> [Vector6<f64>; MAX_JOINTS] {
        let mut columns = [Vector6::zeros(); MAX_JOINTS];
        let tip = self.tip().translation.vector;
        for axis in self.movers.iter().map(|k| &self.axes[*k]) {
            let (linear, column) = (axis.velocity(&tip), &mut columns[axis.variable]);
            for k in 0..3 {
                column[k] += linear[k];
                column[k + 3] += if axis.kind == JointKind::Revolute { axis.direction[k] } else { 0.0 };
            }
        }
        columns
    }

    /// Adds to `out` the velocity of a group's point (base frame) along a direction, per unit of each variable.
    pub fn add_gradient(&self, group: usize, point: &Point3<f64>, direction: &Vector3<f64>, out: &mut Row) {
        for axis in self.group_movers[group].iter().map(|k| &self.axes[*k]) {
            out[axis.variable] += direction.dot(&axis.velocity(&point.coords));
        }
    }

    /// Returns the variables that move one of two bodies relative to the other, each with the factor and the lever of
    /// the joint that it drives.
    pub fn levers<'a>(
        &'a self,
        screen: &Screen,
        group: usize,
        other: Other,
    ) -> impl Iterator<Item = (usize, f64, f64)> + 'a {
        let second = if let Other::Pair(pair) = other { Some(screen.pairs()[pair].1) } else { None };
        let sphere = |group: usize| {
            let (link, center, radius) = screen.sphere(group);
            ((self.poses[link] * center).coords, radius)
        };
        let none: &[usize] = &[];
        let (one, two) = (&self.group_movers[group], second.map_or(none, |second| &self.group_movers[second]));
        let (mine, theirs) = (sphere(group), second.map(sphere));
        let first = one.iter().filter(|k| !two.contains(k)).map(move |k| (*k, mine));
        let second = two.iter().filter(|k| !one.contains(k)).filter_map(move |k| Some((*k, theirs?)));
        first.chain(second).map(|(k, (center, radius))| {
            let axis = &self.axes[k];
            (axis.variable, axis.factor, axis.lever(&center, radius))
        })
    }
}

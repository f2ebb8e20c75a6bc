//! Maps the variables x of planning to joint vectors q of the whole robot: `q = A x + b`. At most one variable drives
//! each joint, directly or as a mimic joint, so `A` is stored as a list of factors.

use gensim2_geometry::Robot;
use serde::{Deserialize, Serialize};

use crate::model::{MAX_JOINTS, Row};

/// A joint of the robot that follows a variable: `q[joint] = factor * x[variable] + offset`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DrivenJoint {
    /// Index of the joint in the joint vector of the whole robot.
    pub joint: usize,
    /// Index of the variable that drives the joint.
    pub variable: usize,
    /// 1 for the variable's own joint; for a mimic joint, the multiplier of its whole chain of mimics; never 0.
    pub factor: f64,
    /// 0 for the variable's own joint; for a mimic joint, the offset (rad or m) of the whole chain of mimics.
    pub offset: f64,
    /// Index of the link that the joint moves; links below it move with it.
    pub link: usize,
}

/// Map from variables to joint vectors of the whole robot. Joints that no variable drives keep fixed values.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JointMap {
    rest: Vec<f64>,
    /// For each variable, the index of its own joint in the joint vector of the whole robot.
    indices: Vec<usize>,
    driven: Vec<DrivenJoint>,
}

impl JointMap {
    /// Creates a map with the independent joints `indices` of a robot as variables. Joints that they do not drive keep
    /// the values in `rest`, a joint vector of the whole robot, except that mimic joints follow their sources.
    pub(crate) fn new(robot: &Robot, indices: Vec<usize>, rest: &[f64]) -> Self {
        let mut driven = Vec::new();
        for (link, joint) in robot.links().iter().enumerate().filter_map(|(l, link)| Some((l, link.joint()?))) {
            let Some(drive) = robot.drive(joint) else { continue };
            let variable = indices.iter().position(|i| *i == drive.source);
            if let (Some(variable), true) = (variable, drive.multiplier != 0.0) {
                let (factor, offset) = (drive.multiplier, drive.offset);
                driven.push(DrivenJoint { joint, variable, factor, offset, link });
            }
        }
        let mut rest = rest.to_vec();
        robot.apply_mimic(&mut rest);
        Self { rest, indices, driven }
    }

    /// Creates a map in which every joint is a variable of its own.
    pub(crate) fn each(joints: usize, rest: &[f64]) -> Self {
        let own = |joint| DrivenJoint { joint, variable: joint, factor: 1.0, offset: 0.0, link: joint };
        Self { rest: rest.to_vec(), indices: (0..joints).collect(), driven: (0..joints).map(own).collect() }
    }

    /// Returns whether all indices refer to existing joints and variables, and all numbers are finite.
    pub(crate) fn is_sound(&self) -> bool {
        let (joints, variables) = (self.rest.len(), self.indices.len());
        let drives = |d: &DrivenJoint| {
            d.joint < joints && d.variable < variables && d.factor.is_finite() && d.offset.is_finite()
        };
        variables <= MAX_JOINTS
            && self.rest.iter().all(|v| v.is_finite())
            && self.indices.iter().all(|j| *j < joints)
            && self.driven.iter().all(drives)
    }

    /// Returns whether a variable drives a joint, directly or as the source of a mimic joint.
    pub(crate) fn moves(&self, joint: usize) -> bool {
        self.driven.iter().any(|driven| driven.joint == joint)
    }

    /// Returns the number of joints of the whole robot.
    #[must_use]
    pub fn joints(&self) -> usize {
        self.rest.len()
    }

    /// Returns, for each variable, the index of its own joint in the joint vector of the whole robot.
    #[must_use]
    pub fn indices(&self) -> &[usize] {
        &self.indices
    }

    /// Returns the joint vector of the whole robot that holds the values of the joints that no variable drives.
    #[must_use]
    pub fn rest(&self) -> &[f64] {
        &self.rest
    }

    /// Returns every driven joint. They are ordered like the links that they move, parents first.
    #[must_use]
    pub fn driven(&self) -> &[DrivenJoint] {
        &self.driven
    }

    /// Returns the variables of a joint vector of the whole robot, or their rates from a vector of rates.
    #[must_use]
    pub fn pick(&self, full: &[f64]) -> Row {
        let mut x = [0.0; MAX_JOINTS];
        for (value, j) in x.iter_mut().zip(&self.indices) {
            *value = full[*j];
        }
        x
    }

    /// Computes the positions (rad or m) of all joints from variables `x`.
    pub fn positions(&self, x: &Row, out: &mut Vec<f64>) {
        out.clear();
        out.extend_from_slice(&self.rest);
        for d in &self.driven {
            out[d.joint] = d.factor * x[d.variable] + d.offset;
        }
    }

    /// Computes the rates (velocity, acceleration or jerk) of all joints from those of the variables; others get 0.
    pub fn rates(&self, rates: &Row, out: &mut Vec<f64>) {
        out.clear();
        out.resize(self.rest.len(), 0.0);
        for d in &self.driven {
            out[d.joint] = d.factor * rates[d.variable];
        }
    }

    /// Writes positions, velocities and accelerations of all joints into slices of [`JointMap::joints`] numbers, given
    /// those of the variables.
    pub(crate) fn fill(&self, state: &[Row; 3], position: &mut [f64], velocity: &mut [f64], acceleration: &mut [f64]) {
        position.copy_from_slice(&self.rest);
        velocity.fill(0.0);
        acceleration.fill(0.0);
        for d in &self.driven {
            position[d.joint] = d.factor * state[0][d.variable] + d.offset;
            velocity[d.joint] = d.factor * state[1][d.variable];
            acceleration[d.joint] = d.factor * state[2][d.variable];
        }
    }

    /// Returns, for each variable, the maximum rate at which no joint driven by it exceeds its limit. `limit(joint)`
    /// returns the limit of a joint by its index in the joint vector of the whole robot.
    #[must_use]
    pub fn least(&self, limit: impl Fn(usize) -> f64) -> Row {
        let mut out = [f64::INFINITY; MAX_JOINTS];
        for d in &self.driven {
            out[d.variable] = out[d.variable].min(limit(d.joint) / d.factor.abs());
        }
        out
    }
}

//! Full joint vectors as an affine function of the joints that planning moves: `q = A x + b`. Every joint is driven by
//! at most one variable, directly or through a mimic, so `A` is a list of factors.

use gensim2_geometry::Robot;
use serde::{Deserialize, Serialize};

use crate::model::{MAX_JOINTS, Row};

/// A joint of the robot that a variable drives: `q[joint] = factor * x[variable] + offset`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DrivenJoint {
    /// Index in the full joint vector.
    pub joint: usize,
    /// The variable that drives it.
    pub variable: usize,
    /// 1 for the joint of the variable itself, the composed multiplier for a mimic joint; never 0.
    pub factor: f64,
    /// 0 for the joint of the variable itself, the composed offset (rad or m) for a mimic joint.
    pub offset: f64,
    /// The link that the joint carries; links below it move with it.
    pub link: usize,
}

/// Map from variables to full joint vectors; joints that no variable drives keep their values.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JointMap {
    rest: Vec<f64>,
    /// Index in the full joint vector of each variable.
    indices: Vec<usize>,
    driven: Vec<DrivenJoint>,
}

impl JointMap {
    /// Creates the map for the independent joints `indices` of a robot; other joints keep the values of the full vector
    /// `rest`.
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
        Self { rest: rest.to_vec(), indices, driven }
    }

    /// Creates the map in which every joint is its own variable.
    pub(crate) fn each(joints: usize, rest: &[f64]) -> Self {
        let own = |joint| DrivenJoint { joint, variable: joint, factor: 1.0, offset: 0.0, link: joint };
        Self { rest: rest.to_vec(), indices: (0..joints).collect(), driven: (0..joints).map(own).collect() }
    }

    /// Whether the map refers only to existing joints and variables, and its numbers are finite.
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

    /// Length of a full joint vector.
    #[must_use]
    pub fn joints(&self) -> usize {
        self.rest.len()
    }

    /// Index in the full joint vector of each variable.
    #[must_use]
    pub fn indices(&self) -> &[usize] {
        &self.indices
    }

    /// Full joint vector with the values of undriven joints.
    #[must_use]
    pub fn rest(&self) -> &[f64] {
        &self.rest
    }

    /// Every driven joint, in the order of the links that they carry (parents first).
    #[must_use]
    pub fn driven(&self) -> &[DrivenJoint] {
        &self.driven
    }

    /// Returns the variables of a full joint vector of positions or rates.
    #[must_use]
    pub fn pick(&self, full: &[f64]) -> Row {
        let mut x = [0.0; MAX_JOINTS];
        for (value, j) in x.iter_mut().zip(&self.indices) {
            *value = full[*j];
        }
        x
    }

    /// Computes full joint positions (rad or m) from variables `x`.
    pub fn positions(&self, x: &Row, out: &mut Vec<f64>) {
        out.clear();
        out.extend_from_slice(&self.rest);
        for d in &self.driven {
            out[d.joint] = d.factor * x[d.variable] + d.offset;
        }
    }

    /// Computes full joint rates (velocity, acceleration or jerk) from rates of the variables; undriven joints get 0.
    pub fn rates(&self, rates: &Row, out: &mut Vec<f64>) {
        out.clear();
        out.resize(self.rest.len(), 0.0);
        for d in &self.driven {
            out[d.joint] = d.factor * rates[d.variable];
        }
    }

    /// Writes full position, velocity and acceleration from rows of the variables into slices of [`JointMap::joints`]
    /// numbers.
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

    /// Returns the maximum rate of each variable at which no driven joint exceeds its own limit; `limit(joint)` is the
    /// limit of a joint of the full vector.
    #[must_use]
    pub fn least(&self, limit: impl Fn(usize) -> f64) -> Row {
        let mut out = [f64::INFINITY; MAX_JOINTS];
        for d in &self.driven {
            out[d.variable] = out[d.variable].min(limit(d.joint) / d.factor.abs());
        }
        out
    }
}

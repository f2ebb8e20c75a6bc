//! Velocities that a target asks of the planned variables.
//!
//! A pose or joint target is approached at a speed proportional to the remaining distance, reduced so that every joint
//! can brake before it. The wanted velocities of the variables are
//!
//! ```text
//! d = J' (J J' + damping)^-1 u + N p
//! ```
//!
//! with `J` the link's Jacobian, `u` the wanted velocity of the link, `p` the velocities toward the posture, and `N` the
//! projection onto the motions that do not move the link. The step minimizes `|J (w - d)|^2 + weight |w - d|^2` over the
//! velocities `w` that keep the limits.

use gensim2_geometry::{Pose, rotation_log};
use nalgebra::{Matrix6, Vector6};

use super::arm::Arm;
use super::joint::JointLimits;
use crate::model::{MAX_JOINTS, Model, Row};

/// Ratio of speed to distance near a target (1/s), and the same for the posture.
const GAIN: f64 = 12.0;
const POSTURE_GAIN: f64 = 1.5;
/// Fractions of the velocity and acceleration limits that the approach of a target plans with.
const SPEED: f64 = 0.95;
const BRAKING: f64 = 0.6;
/// Length (m) by which angles (rad) are weighted against distances.
const ARM: f64 = 0.3;
/// Damping at the target (m^2), and its increase per distance from the target (m). The increase exceeds the curvature of
/// the link's path, so that an arm that is stretched toward a pose out of reach comes to rest.
const DAMPING: f64 = 1e-4;
const DISTANCE_DAMPING: f64 = 0.3;
/// Weight (m^2) of deviations of the joints from the wanted velocities, relative to deviations of the link. Near a
/// singularity, a joint at its limit would otherwise cause large velocities of the others.
const JOINT_WEIGHT: f64 = 0.05;

/// Returns the speed at which a target at a distance is approached: the distance times `gain` (1/s) near the target, and
/// further away the speed from which the deceleration `braking` leads to that.
pub(super) fn approach(distance: f64, braking: f64, gain: f64) -> f64 {
    let near = braking >= gain * gain * distance;
    if near { gain * distance } else { (braking * (2.0 * distance - braking / (gain * gain))).sqrt() }
}

/// Target of a step.
#[derive(Debug, Clone, Copy)]
pub(super) enum Aim {
    /// A pose of the link, and the velocity of this pose (linear and angular, base frame).
    Pose(Pose, Vector6<f64>),
    /// A velocity of the link (linear and angular, base frame).
    Twist(Vector6<f64>),
    /// Values of the variables.
    Joints(Row),
    /// Rest.
    Rest,
}

/// A quadratic cost of the velocities of the variables: `w' H w / 2 + g' w`.
pub(super) struct Cost {
    pub hessian: [Row; MAX_JOINTS],
    pub gradient: Row,
}

/// The state that a cost is computed for.
pub(super) struct Setting<'s> {
    pub model: &'s Model,
    pub arm: &'s Arm,
    pub limits: &'s [JointLimits],
    pub x: &'s Row,
    pub posture: &'s Row,
    /// Fraction of the wanted velocities that may be used, 0 to 1.
    pub share: f64,
}

impl Setting<'_> {
    pub fn cost(&self, aim: &Aim) -> Cost {
        match aim {
            Aim::Rest => self.joint_cost(&[0.0; MAX_JOINTS]),
            Aim::Joints(goal) => {
                let goal = self.model.unwound(goal, self.x);
                let mut left = [0.0; MAX_JOINTS];
                for (v, limits) in self.limits.iter().enumerate() {
                    left[v] = goal[v].clamp(limits.lower, limits.upper) - self.x[v];
                }
                let speed = self.share * self.speed(&left);
                self.joint_cost(&left.map(|way| speed * way))
            }
            Aim::Pose(pose, twist) => {
                let tip = self.arm.tip();
                let shift = pose.translation.vector - tip.translation.vector;
                let turn = rotation_log(&(pose.rotation * tip.rotation.inverse()));
                let left = Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z);
                self.link_cost(&left, twist)
            }
            Aim::Twist(twist) => self.link_cost(&Vector6::zeros(), twist),
        }
    }

    fn joint_cost(&self, wanted: &Row) -> Cost {
        let mut hessian = [[0.0; MAX_JOINTS]; MAX_JOINTS];
        (0..self.limits.len()).for_each(|v| hessian[v][v] = 1.0);
        Cost { hessian, gradient: wanted.map(|w| -w) }
    }

    /// Returns the speed, in fractions of `way` per second, at which the variables approach the end of `way` within
    /// their limits of velocity and acceleration.
    fn speed(&self, way: &Row) -> f64 {
        let (mut fastest, mut braking) = (f64::INFINITY, f64::INFINITY);
        for (limits, way) in self.limits.iter().zip(way).filter(|(_, way)| way.abs() > 1e-9) {
            fastest = fastest.min(SPEED * limits.velocity / way.abs());
            braking = braking.min(BRAKING * limits.acceleration / way.abs());
        }
        fastest.min(approach(1.0, braking, GAIN))
    }

    fn link_cost(&self, left: &Vector6<f64>, twist: &Vector6<f64>) -> Cost {
        let n = self.limits.len();
        let weight = Vector6::new(1.0, 1.0, 1.0, ARM, ARM, ARM);
        let columns = self.arm.twists().map(|column| column.component_mul(&weight));
        let left = left.component_mul(&weight);
        let damping = DAMPING + DISTANCE_DAMPING * left.norm();
        let mut normal = Matrix6::identity() * damping;
        columns[..n].iter().for_each(|column| normal.syger(1.0, column, column, 1.0));
        normal.fill_upper_triangle_with_lower_triangle();
        let solved = normal.cholesky();
        // Returns the smallest damped movement of the variables that moves the link by a twist.
        let movement = |twist: &Vector6<f64>| {
            let mut out = [0.0; MAX_JOINTS];
            if let Some(solved) = &solved {
                let force = solved.solve(twist);
                (0..n).for_each(|v| out[v] = columns[v].dot(&force));
            }
            out
        };
        let speed = if left == Vector6::zeros() { 0.0 } else { self.speed(&movement(&left)) };
        let wanted = (left * speed + twist.component_mul(&weight)) * self.share;
        let mut rest = [0.0; MAX_JOINTS];
        let mut moved = Vector6::zeros();
        for (v, limits) in self.limits.iter().enumerate() {
            let most = 0.3 * limits.velocity;
            rest[v] = self.share * (POSTURE_GAIN * (self.posture[v] - self.x[v])).clamp(-most, most);
            moved += columns[v] * rest[v];
        }
        let lost = movement(&moved);
        let mut velocities = movement(&wanted);
        (0..n).for_each(|v| velocities[v] += rest[v] - lost[v]);
        let mut cost = Cost { hessian: [[0.0; MAX_JOINTS]; MAX_JOINTS], gradient: [0.0; MAX_JOINTS] };
        for v in 0..n {
            for k in 0..n {
                cost.hessian[v][k] = columns[v].dot(&columns[k]) + if v == k { JOINT_WEIGHT } else { 0.0 };
                cost.gradient[v] -= cost.hessian[v][k] * velocities[k];
            }
        }
        cost
    }
}

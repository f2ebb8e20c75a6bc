//! Masses of links, and inverse dynamics by the recursive Newton-Euler algorithm (Luh, Walker and Paul, 1980) over the
//! whole kinematic tree, in base coordinates.

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use crate::link::FURTHEST;
use crate::{JointCountError, JointKind, Pose, Robot, RobotError};

/// Mass properties of a link.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Inertia {
    /// Mass (kg).
    pub mass: f64,
    /// Centre of mass in the link frame (m).
    pub center: Vector3<f64>,
    /// Rotational inertia about the centre of mass, in axes of the link frame (kg m^2).
    pub tensor: Matrix3<f64>,
}

impl Inertia {
    /// Validates that the numbers are finite, the mass is not negative and the tensor is symmetric.
    pub(crate) fn check(&self, link: &str) -> Result<(), RobotError> {
        let fail = |message: &str| Err(RobotError::new(format!("link {link}: inertial"), message));
        let finite = self.center.iter().chain(self.tensor.iter()).all(|v| v.is_finite());
        if !(finite && self.mass.is_finite() && self.mass >= 0.0) {
            return fail("must contain finite numbers and a mass of at least 0 kg");
        }
        if (self.tensor - self.tensor.transpose()).amax() > 1e-9 * self.tensor.amax() {
            return fail("its tensor must be symmetric");
        }
        Ok(())
    }

    /// Validates the mass properties of an object in the hand.
    pub(crate) fn check_payload(&self) -> Result<(), RobotError> {
        let fail = |field: &str, message: String| Err(RobotError::new(field, message));
        if !(self.mass.is_finite() && self.mass >= 0.0) {
            return fail("mass", format!("must be finite and at least 0 kg, not {}", self.mass));
        }
        if !self.center.iter().all(|v| v.abs() <= FURTHEST) {
            return fail("center_of_mass", format!("{:?} is not within {FURTHEST} m", self.center.as_slice()));
        }
        let (tensor, size) = (&self.tensor, self.tensor.amax());
        let symmetric = (tensor - tensor.transpose()).amax() <= 1e-9 * size;
        if !(size.is_finite() && symmetric && tensor.symmetric_eigenvalues().min() >= -1e-9 * size) {
            return fail("inertia", "must be finite, symmetric and positive semidefinite (kg m^2)".to_owned());
        }
        Ok(())
    }
}

/// Gravity (m/s^2) in the base frame of an upright robot.
pub const GRAVITY: Vector3<f64> = Vector3::new(0.0, 0.0, -9.81);

/// Motion of a link, expressed in the axes of the base frame.
#[derive(Debug, Clone, Copy)]
struct Moving {
    turn: Vector3<f64>,
    turn_rate: Vector3<f64>,
    /// Acceleration of the link frame's origin minus gravity.
    acceleration: Vector3<f64>,
    /// Vector from the origin of the parent link to the origin of this link.
    arm: Vector3<f64>,
    force: Vector3<f64>,
    moment: Vector3<f64>,
}

/// Buffers that [`Robot::inverse_dynamics`] reuses.
#[derive(Debug, Clone, Default)]
pub struct DynamicsScratch {
    poses: Vec<Pose>,
    links: Vec<Moving>,
}

impl Robot {
    /// Sum of the masses of all links and of the payload (kg).
    #[must_use]
    pub fn mass(&self) -> f64 {
        self.links().iter().filter_map(|l| l.inertia()).chain(self.payload()).map(|i| i.mass).sum()
    }

    /// Writes into `out` the torque (N m; N for sliding joints) of each joint for the given positions, velocities and
    /// accelerations under gravity, including the payload. Links without inertia are massless; friction and motor inertia are ignored. Joints
    /// that follow others are treated as independent.
    ///
    /// # Errors
    /// A list does not have one entry for each joint.
    pub fn inverse_dynamics(
        &self,
        [q, velocity, acceleration]: [&[f64]; 3],
        gravity: &Vector3<f64>,
        scratch: &mut DynamicsScratch,
        out: &mut Vec<f64>,
    ) -> Result<(), JointCountError> {
        let DynamicsScratch { poses, links } = scratch;
        self.link_poses(q, poses)?;
        for list in [velocity, acceleration] {
            JointCountError::check(self.joints().len(), list)?;
        }
        links.clear();
        for (l, link) in self.links().iter().enumerate() {
            let pose = &poses[l];
            let mut now = Moving {
                turn: Vector3::zeros(),
                turn_rate: Vector3::zeros(),
                acceleration: -gravity,
                arm: Vector3::zeros(),
                force: Vector3::zeros(),
                moment: Vector3::zeros(),
            };
            if let Some(p) = link.parent() {
                let Moving { turn, turn_rate, acceleration: below, .. } = links[p];
                let arm = pose.translation.vector - poses[p].translation.vector;
                let carried = below + turn_rate.cross(&arm) + turn.cross(&turn.cross(&arm));
                now = Moving { turn, turn_rate, acceleration: carried, arm, ..now };
                if let Some(j) = link.joint() {
                    let axis = pose.rotation * self.joints()[j].axis();
                    let (rate, gain) = (axis * velocity[j], axis * acceleration[j]);
                    match self.joints()[j].kind() {
                        JointKind::Revolute => {
                            now.turn += rate;
                            now.turn_rate += gain + turn.cross(&rate);
                        }
                        JointKind::Prismatic => now.acceleration += gain + 2.0 * turn.cross(&rate),
                    }
                }
            }
            let payload = self.payload().filter(|_| l == self.hand());
            for inertia in link.inertia().into_iter().chain(payload) {
                let center = pose.rotation * inertia.center;
                let turned = pose.rotation.matrix() * inertia.tensor * pose.rotation.matrix().transpose();
                let at_center =
                    now.acceleration + now.turn_rate.cross(&center) + now.turn.cross(&now.turn.cross(&center));
                let force = inertia.mass * at_center;
                now.force += force;
                now.moment += turned * now.turn_rate + now.turn.cross(&(turned * now.turn)) + center.cross(&force);
            }
            links.push(now);
        }
        out.clear();
        out.resize(self.joints().len(), 0.0);
        for (l, link) in self.links().iter().enumerate().rev() {
            let Moving { arm, force, moment, .. } = links[l];
            if let Some(j) = link.joint() {
                let axis = poses[l].rotation * self.joints()[j].axis();
                out[j] = match self.joints()[j].kind() {
                    JointKind::Revolute => axis.dot(&moment),
                    JointKind::Prismatic => axis.dot(&force),
                };
            }
            if let Some(p) = link.parent() {
                links[p].force += force;
                links[p].moment += moment + arm.cross(&force);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Joint, Link};

    /// Two point masses on massless rods, whose equations of motion are given in textbooks (Craig, section 6.7).
    #[test]
    fn two_links_have_their_textbook_torques() {
        let (m1, m2, l1, l2, g) = (2.0, 3.0, 0.5, 0.4, 9.81);
        let point =
            |mass: f64, length: f64| Inertia { mass, center: Vector3::new(length, 0.0, 0.0), tensor: Matrix3::zeros() };
        let robot = Robot::builder("two")
            .link(Link::base("base"))
            .link(Link::below("base", "one").moved_by(Joint::revolute("a", Vector3::z())).inertia(point(m1, l1)))
            .link(
                Link::below("one", "two")
                    .at(Pose::translation(l1, 0.0, 0.0))
                    .moved_by(Joint::revolute("b", Vector3::z()))
                    .inertia(point(m2, l2)),
            )
            .build("two")
            .unwrap();
        assert_eq!(robot.mass(), 5.0);
        let (q, v, a) = ([0.3, -0.8], [1.2, -0.7], [2.0, 3.5]);
        let mut out = Vec::new();
        let down = Vector3::new(0.0, -g, 0.0);
        robot.inverse_dynamics([&q, &v, &a], &down, &mut DynamicsScratch::default(), &mut out).unwrap();
        let (c1, c12, c2, s2) = (q[0].cos(), (q[0] + q[1]).cos(), q[1].cos(), q[1].sin());
        let second = m2 * l2 * l2 * (a[0] + a[1]) + m2 * l1 * l2 * (c2 * a[0] + s2 * v[0] * v[0]) + m2 * l2 * g * c12;
        let first = second + m2 * l1 * l2 * c2 * (a[0] + a[1]) + (m1 + m2) * l1 * l1 * a[0]
            - m2 * l1 * l2 * s2 * (v[0] + v[1]) * (v[0] + v[1])
            + (m1 + m2) * l1 * g * c1;
        assert!((out[0] - first).abs() < 1e-12 && (out[1] - second).abs() < 1e-12, "{out:?} {first} {second}");
    }

    #[test]
    fn a_payload_adds_the_torques_of_a_link_of_its_mass() {
        let tensor = Matrix3::new(0.02, 0.001, 0.0, 0.001, 0.03, -0.002, 0.0, -0.002, 0.01);
        let cup = Inertia { mass: 1.5, center: Vector3::new(0.1, -0.05, 0.2), tensor };
        let own = Inertia { mass: 2.0, center: Vector3::new(0.1, 0.0, 0.0), tensor: 0.5 * tensor };
        let built = |with: bool| {
            let mut robot = Robot::builder("two")
                .link(Link::base("base"))
                .link(Link::below("base", "one").moved_by(Joint::revolute("a", Vector3::z())))
                .link(
                    Link::below("one", "two")
                        .at(Pose::translation(0.4, 0.1, 0.0))
                        .moved_by(Joint::prismatic("b", Vector3::y()))
                        .inertia(own),
                );
            if with {
                robot = robot.link(Link::below("two", "cup").inertia(cup));
            }
            robot.build("two").unwrap()
        };
        let (bare, wanted) = (built(false), built(true));
        let loaded = bare.with_payload(Some(cup)).unwrap();
        assert_eq!((loaded.mass(), bare.mass()), (3.5, 2.0));
        let torques = |robot: &Robot| {
            let mut out = Vec::new();
            let state = [&[0.3, -0.8][..], &[1.2, -0.7], &[2.0, 3.5]];
            robot.inverse_dynamics(state, &GRAVITY, &mut DynamicsScratch::default(), &mut out).unwrap();
            out
        };
        let (found, wanted) = (torques(&loaded), torques(&wanted));
        assert!(found.iter().zip(&wanted).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?} {wanted:?}");
        assert_eq!(torques(&loaded.with_payload(None).unwrap()), torques(&bare));
        for (field, bad) in [
            ("mass", Inertia { mass: f64::NAN, ..cup }),
            ("center_of_mass", Inertia { center: Vector3::new(0.0, f64::INFINITY, 0.0), ..cup }),
            ("inertia", Inertia { tensor: -tensor, ..cup }),
        ] {
            assert_eq!(bare.with_payload(Some(bad)).unwrap_err().field, field);
        }
    }

    #[test]
    fn a_mass_below_zero_is_refused() {
        let bad = Inertia { mass: -1.0, center: Vector3::zeros(), tensor: Matrix3::zeros() };
        let built = Robot::builder("x").link(Link::base("base").inertia(bad)).build("base");
        assert!(built.unwrap_err().to_string().contains("link base: inertial"));
    }
}

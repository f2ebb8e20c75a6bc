//! Torque limits of the joints' motors, computed by inverse dynamics.
//!
//! Along a path q(s), a torque is `a u + b x + c` with `x = (ds/dt)^2` and `u = d²s/dt²`: `a` accelerates the masses
//! along the tangent, `b` is due to the path's curvature, and `c` compensates gravity. Torque limits are therefore
//! linear in u and x like acceleration limits, but their ranges are not centred at zero.

use std::sync::Arc;

use gensim2_geometry::{DynamicsScratch, GRAVITY, Robot};
use serde::{Deserialize, Serialize};

use super::motion::Piece;
use crate::Options;
use crate::joint_map::JointMap;
use crate::model::{MAX_JOINTS, Model, Row};

/// Fraction of the torque left after gravity that samples may use; the remainder is for the motion between samples.
pub(crate) const SAMPLED: f64 = 0.9995;
/// Maximum time between samples (s).
const STEP: f64 = 1e-3;
/// Maximum number of samples. A motion that would need more is so slow that they suffice.
const MAX_SAMPLES: f64 = 2e5;

/// Dynamic model and torque limits of the joints that planning moves.
#[derive(Debug, Clone)]
pub(crate) struct Dynamics {
    robot: Arc<Robot>,
    map: JointMap,
    /// Maximum torque of each variable (N m; N for sliding joints).
    pub max_torque: Row,
}

/// Torques at a position of a path: `of_u u + of_x x + rest`, one entry for each variable.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Torque {
    pub of_u: Row,
    pub of_x: Row,
    pub rest: Row,
}

impl Torque {
    /// Returns the range of `of_u u + of_x x` for variable `v`: the fraction `room` of what gravity leaves of `limit`.
    pub fn band(&self, v: usize, limit: f64, room: f64) -> [f64; 2] {
        [room * (-limit - self.rest[v]), room * (limit - self.rest[v])]
    }
}

/// A joint that cannot hold the robot still against gravity.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Overload {
    /// Name of the joint.
    pub joint: String,
    /// Torque that holds the joint still (N m; N for a sliding joint).
    pub torque: f64,
    /// Torque limit of the joint (N m; N for a sliding joint).
    pub limit: f64,
}

/// Dynamic model with torque limits, and the usable fraction of the torque that gravity leaves.
pub(crate) type Load<'a> = Option<(&'a Dynamics, f64)>;

impl Dynamics {
    /// Returns the torque limits in the options, if any.
    pub fn asked(robot: &Arc<Robot>, model: &Model, options: &Options) -> Option<Self> {
        let list = options.torque_limits.as_ref()?;
        let mut max_torque = [f64::INFINITY; MAX_JOINTS];
        for (limit, j) in max_torque.iter_mut().zip(model.map().indices()) {
            *limit = list[*j];
        }
        Some(Self { robot: Arc::clone(robot), map: model.map().clone(), max_torque })
    }

    /// Returns the torque of each variable for a state of the joints.
    pub fn torques(&self, [position, velocity, acceleration]: &[Row; 3], buffers: &mut Buffers) -> Row {
        let Buffers { scratch, q, velocity: full_velocity, acceleration: full_acceleration, out } = buffers;
        self.map.positions(position, q);
        self.map.rates(velocity, full_velocity);
        self.map.rates(acceleration, full_acceleration);
        let state = [q.as_slice(), full_velocity.as_slice(), full_acceleration.as_slice()];
        let fits = self.robot.inverse_dynamics(state, &GRAVITY, scratch, out);
        debug_assert!(fits.is_ok(), "a model's map has an entry for each joint of its robot");
        let mut torques = [0.0; MAX_JOINTS];
        // The motor of a variable also drives the mimic joints that follow it.
        for d in self.map.driven() {
            torques[d.variable] += d.factor * out[d.joint];
        }
        torques
    }

    /// Returns the coefficients of the torques at a position of a path with the derivatives `first` and `second`.
    pub fn along(&self, position: &Row, first: &Row, second: &Row, buffers: &mut Buffers) -> Torque {
        let still = [0.0; MAX_JOINTS];
        let rest = self.torques(&[*position, still, still], buffers);
        let less = |mut row: Row| {
            row.iter_mut().zip(&rest).for_each(|(t, c)| *t -= c);
            row
        };
        let of_u = less(self.torques(&[*position, still, *first], buffers));
        let of_x = less(self.torques(&[*position, *first, *second], buffers));
        Torque { of_u, of_x, rest }
    }

    /// Returns the maximum path acceleration from rest that the torque limits allow in both directions of the path.
    pub fn hardest(&self, torque: &Torque, room: f64) -> f64 {
        let least = |v: usize| {
            let [low, high] = torque.band(v, self.max_torque[v], room);
            (-low).min(high).max(0.0) / torque.of_u[v].abs()
        };
        (0..self.map.indices().len()).map(least).fold(f64::INFINITY, f64::min)
    }

    /// Returns whether the torque limits suffice to hold all joints still against gravity.
    pub fn holds(&self, torque: &Torque) -> bool {
        (0..self.map.indices().len()).all(|v| torque.rest[v].abs() < self.max_torque[v])
    }

    /// Returns the joint whose torque limit is exceeded most if all joints stand still, with this torque and the limit.
    pub fn overload(&self, position: &Row) -> Option<Overload> {
        let still = [0.0; MAX_JOINTS];
        let torques = self.torques(&[*position, still, still], &mut Buffers::default());
        let share = |v: &usize| torques[*v].abs() / self.max_torque[*v];
        let worst = (0..self.map.indices().len()).max_by(|a, b| share(a).total_cmp(&share(b)))?;
        (share(&worst) >= 1.0).then(|| Overload {
            joint: self.robot.joints()[self.map.indices()[worst]].name().to_owned(),
            torque: torques[worst],
            limit: self.max_torque[worst],
        })
    }

    /// Returns the largest used fraction of the torque that gravity leaves, from samples at the ends of the motion's
    /// polynomials and between them.
    pub fn share(&self, piece: &Piece) -> f64 {
        let mut buffers = Buffers::default();
        let still = [0.0; MAX_JOINTS];
        let mut out = 0.0_f64;
        let shortest = STEP.max(piece.duration() / MAX_SAMPLES);
        for pair in piece.corners().windows(2) {
            let parts = ((pair[1] - pair[0]) / shortest).ceil().max(2.0) as usize;
            for k in 0..=parts {
                let state = piece.at(pair[0] + (pair[1] - pair[0]) * k as f64 / parts as f64);
                let torque = self.torques(&state, &mut buffers);
                let rest = self.torques(&[state[0], still, still], &mut buffers);
                for v in 0..self.map.indices().len() {
                    let moved = torque[v] - rest[v];
                    let room = if moved > 0.0 { self.max_torque[v] - rest[v] } else { self.max_torque[v] + rest[v] };
                    if room <= 0.0 {
                        return f64::INFINITY;
                    }
                    out = out.max(moved.abs() / room);
                }
            }
        }
        out
    }
}

/// Memory that inverse dynamics reuses between calls.
#[derive(Debug, Default)]
pub(crate) struct Buffers {
    scratch: DynamicsScratch,
    q: Vec<f64>,
    velocity: Vec<f64>,
    acceleration: Vec<f64>,
    out: Vec<f64>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::timing::{Builder, Limits, Spline};
    use gensim2_geometry::{Inertia, Joint, Link, Pose};
    use nalgebra::{Matrix3, Vector3};
    use proptest::prelude::*;

    fn body(mass: f64, length: f64) -> Inertia {
        let bar = mass * length * length / 12.0;
        let tensor = Matrix3::from_diagonal(&Vector3::new(0.1 * bar, bar, bar));
        Inertia { mass, center: Vector3::new(0.5 * length, 0.0, 0.0), tensor }
    }

    /// An arm of two links in a vertical plane.
    fn arm() -> Arc<Robot> {
        let hinge = |name: &str| Joint::revolute(name, -Vector3::y()).limits(-3.0, 3.0).velocity(2.0);
        let robot = Robot::builder("arm")
            .link(Link::base("base"))
            .link(Link::below("base", "upper").moved_by(hinge("shoulder")).inertia(body(3.0, 0.5)))
            .link(
                Link::below("upper", "fore")
                    .at(Pose::translation(0.5, 0.0, 0.0))
                    .moved_by(hinge("elbow"))
                    .inertia(body(2.0, 0.4)),
            )
            .build("fore");
        Arc::new(robot.unwrap())
    }

    fn motion(
        robot: &Arc<Robot>,
        limits: Limits,
        torque: Option<Vec<f64>>,
        way: &[Vec<f64>],
    ) -> Option<crate::Trajectory> {
        let model = Model::new(robot, &way[0]).unwrap();
        let options = Options { torque_limits: torque, ..Options::default() };
        let dynamics = Dynamics::asked(robot, &model, &options);
        let mut builder = Builder::new(limits, 0.0).loaded(dynamics);
        let rows: Vec<Row> = way.iter().map(|w| model.pick(w)).collect();
        let path = Spline::through(limits.joints(), &rows, None);
        builder.push(&path, &[], &[0.0; MAX_JOINTS], None, &[]).ok()?;
        Some(builder.build(model.map()))
    }

    #[test]
    fn a_mass_on_a_rail_takes_the_time_that_its_motor_needs() {
        let rail = Joint::prismatic("rail", Vector3::x()).limits(-2.0, 2.0).velocity(5.0);
        let load = Inertia { mass: 2.0, center: Vector3::zeros(), tensor: Matrix3::zeros() };
        let robot = Robot::builder("cart")
            .link(Link::base("base"))
            .link(Link::below("base", "cart").moved_by(rail).inertia(load))
            .build("cart");
        let robot = Arc::new(robot.unwrap());
        let way = [vec![-1.0], vec![1.0]];
        for jerk in [1e6, 200.0] {
            let limits = Limits::new(&[5.0], &[50.0], &[jerk]).unwrap();
            let time = motion(&robot, limits, Some(vec![4.0]), &way).unwrap().end();
            // With 4 N on 2 kg, the mass accelerates to the middle and then brakes, in 2 sqrt(d / a).
            assert!((time - 2.0).abs() < 0.05, "{time}");
            assert!(time >= 2.0);
        }
    }

    #[test]
    fn what_cannot_be_held_is_not_moved() {
        let limits = Limits::new(&[2.0; 2], &[10.0; 2], &[5000.0; 2]).unwrap();
        // With the arm stretched out, the shoulder holds 3 kg at 0.25 m and 2 kg at 0.7 m: 21.1 N m.
        let way = [vec![0.0, 0.0], vec![0.3, 0.2]];
        assert!(motion(&arm(), limits, Some(vec![21.0, 50.0]), &way).is_none());
        assert!(motion(&arm(), limits, Some(vec![22.0, 50.0]), &way).is_some());
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn torques_keep_their_limits_all_along(
            way in prop::collection::vec(prop::collection::vec(-2.5..2.5f64, 2), 2..6),
            (shoulder, elbow) in (24.0..60.0f64, 5.0..20.0f64),
            (acceleration, jerk) in prop_oneof![Just((10.0, 5000.0)), Just((5.0, 50.0))],
        ) {
            let robot = arm();
            let limits = Limits::new(&[2.0; 2], &[acceleration; 2], &[jerk; 2]).unwrap();
            let free = motion(&robot, limits, None, &way).unwrap();
            let bound = motion(&robot, limits, Some(vec![shoulder, elbow]), &way);
            let bound = bound.ok_or_else(|| TestCaseError::fail("held everywhere, so slow motions are possible"))?;
            prop_assert!(bound.end() >= free.end() * (1.0 - 5e-3));
            let (mut scratch, mut out) = (DynamicsScratch::default(), Vec::new());
            for k in 0..=20_000 {
                let now = bound.sample(bound.end() * f64::from(k) / 20_000.0);
                let state = [now.position.as_slice(), now.velocity.as_slice(), now.acceleration.as_slice()];
                robot.inverse_dynamics(state, &GRAVITY, &mut scratch, &mut out).unwrap();
                prop_assert!(out[0].abs() <= shoulder * (1.0 + 1e-6) && out[1].abs() <= elbow * (1.0 + 1e-6), "{out:?}");
                prop_assert!(now.velocity.iter().all(|v| v.abs() <= 2.0 * (1.0 + 1e-6)));
            }
        }
    }
}

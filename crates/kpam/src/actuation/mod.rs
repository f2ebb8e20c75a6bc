//! Searches the actuation pose: the joint vector that meets the keypoint constraints at the lowest cost.
//!
//! Many start values are first projected onto the constraints by damped Gauss-Newton, and then moved along the
//! constraints by sequential quadratic programming (SQP) with the exact Hessian of the Lagrangian.

mod bands;
mod batch;
mod clearing;
mod descent;
mod look;
mod multistart;
mod projection;
pub(crate) mod seeds;
mod step;

use gensim2_geometry::Pose;

use self::batch::BatchProjection;
pub(crate) use self::clearing::HEEDED;
use self::multistart::Aside;
use self::projection::{Aim, Residuals};
use crate::model::{MAX_JOINTS, Model, Placed, Row, Weighed};
use crate::qp::{ActiveSet, Bound};
use crate::resolve::Resolved;
use crate::{Cancel, KeypointProblem};

/// Two poses count as the same if no joint differs by more than this (rad or m).
const SAME: f64 = 0.02;

/// A pose that meets all constraints, with its cost.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Candidate {
    pub x: Row,
    pub cost: f64,
}

/// Result of the search for the actuation pose.
pub(crate) struct Actuation {
    /// Distinct poses that meet every constraint, cheapest first.
    pub candidates: Vec<Candidate>,
    /// Pose with the smallest constraint error, if no pose meets the constraints.
    pub best_effort: Option<Row>,
}

pub(crate) struct ActuationSearch<'p> {
    problem: &'p KeypointProblem,
    model: &'p Model,
    resolved: &'p Resolved,
    /// Flag with which another thread ends the search.
    pub over: Cancel,
    start: Row,
    start_hand: Pose,
    lower: Row,
    upper: Row,
    /// Weight of each variable's squared step from the start in the cost.
    weights: Row,
    /// Norm of the residuals below which a projection has converged.
    near: f64,
    /// Point within the tolerances that projections aim at.
    aim: Aim,
    placed: Placed,
    /// Joint vectors for which violation and cost were computed last, each with its value.
    violated: (Row, f64),
    cost_at: (Row, f64),
    batch: BatchProjection,
    aside: Aside,
    qp: ActiveSet,
    // Memory reused between iterations.
    residuals: Residuals,
    trial_residuals: Residuals,
    bounds: Vec<Bound>,
    forces: Vec<Weighed>,
    pulls: Vec<Weighed>,
}

impl<'p> ActuationSearch<'p> {
    pub fn new(problem: &'p KeypointProblem, model: &'p Model, resolved: &'p Resolved) -> Self {
        let (start, near) = (model.start(), resolved.nearness());
        let mut placed = Placed::default();
        placed.place(&problem.robot, model, &start);
        Self {
            problem,
            model,
            resolved,
            over: Cancel::new(),
            start,
            start_hand: placed.hand,
            lower: model.lower,
            upper: model.upper,
            weights: problem.joint_weights(model),
            near,
            aim: Aim::default(),
            batch: BatchProjection::new(problem, model, resolved, &placed.hand, near),
            placed,
            violated: ([f64::NAN; MAX_JOINTS], 0.0),
            cost_at: ([f64::NAN; MAX_JOINTS], 0.0),
            aside: Aside::default(),
            qp: ActiveSet::default(),
            residuals: Vec::new(),
            trial_residuals: Vec::new(),
            bounds: Vec::new(),
            forces: Vec::new(),
            pulls: Vec::new(),
        }
    }

    /// Returns the hand pose at `x`.
    pub fn hand(&mut self, x: &Row) -> Pose {
        self.place(x);
        self.placed.hand
    }

    fn place(&mut self, x: &Row) {
        self.placed.place(&self.problem.robot, self.model, x);
    }

    /// Creates a candidate from a pose that meets the constraints. Unlimited joints are shifted by whole turns to
    /// within half a turn of the start.
    fn candidate(&mut self, x: &Row) -> Candidate {
        Candidate { x: self.model.unwound(x, &self.start), cost: self.cost(x) }
    }

    /// Projects the additional start value `index` onto the constraints; returns the pose if it meets them. Most
    /// projections aim near the centre of the tolerances; with `at_edge`, the pose may lie anywhere within them.
    pub fn sample(&mut self, index: usize, at_edge: bool) -> Option<Candidate> {
        let mut x = self.further_start(index);
        if at_edge {
            self.aim = Aim::anywhere();
        } else if self.problem.options.reach_clearance.is_some() {
            // The pose at the centre of the tolerances may be too close to the target, so projections aim at various points.
            self.aim = Aim::within(self.resolved, index + 1);
        }
        let met = self.project(&mut x) <= 0.0;
        self.aim = Aim::default();
        met.then(|| self.candidate(&x))
    }

    /// Returns `x` if it meets the constraints, otherwise its projection onto them; `None` if the projection fails.
    pub fn from(&mut self, x: &Row) -> Option<Candidate> {
        let mut x = *x;
        (self.violation(&x) <= 0.0 || self.project(&mut x) <= 0.0).then(|| self.candidate(&x))
    }

    /// Sorts poses by cost, and drops each pose that nearly equals a cheaper one.
    fn distinct(&self, mut poses: Vec<Candidate>) -> Vec<Candidate> {
        poses.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        let mut out: Vec<Candidate> = Vec::new();
        for pose in poses {
            if !out.iter().any(|c| self.model.are_near(&c.x, &pose.x, SAME)) {
                out.push(pose);
            }
        }
        out
    }

    /// Returns the difference of `x` from the start in each joint; an unlimited joint takes the shorter direction.
    fn steps(&self, x: &Row) -> Row {
        let mut out = self.model.unwound(x, &self.start);
        for v in 0..self.model.n() {
            out[v] -= self.start[v];
        }
        out
    }

    /// Returns the cost of a pose: weighted squared joint steps from the start, squared translation of the hand, 1 -
    /// cos of the hand's rotation, and the cost terms of the config.
    pub fn cost(&mut self, x: &Row) -> f64 {
        self.place(x);
        if self.cost_at.0 == *x {
            return self.cost_at.1;
        }
        let steps = self.steps(x);
        let joints: f64 = (0..self.model.n()).map(|v| self.weights[v] * steps[v].powi(2)).sum();
        let hand = &self.placed.hand;
        let way = (hand.translation.vector - self.start_hand.translation.vector).norm_squared();
        let turn = 0.5 * (3.0 - (self.start_hand.rotation.matrix().transpose() * hand.rotation.matrix()).trace());
        let terms: f64 = self
            .resolved
            .costs
            .iter()
            .map(|t| {
                let p = hand.rotation * t.on_hand + hand.translation.vector;
                t.weight * t.normal.dot(&(p - t.target)).powi(2)
            })
            .sum();
        let cost = joints + way + turn + terms;
        self.cost_at = (*x, cost);
        cost
    }

    /// Returns the largest amount (m or rad) by which a constraint exceeds its tolerance. Joint limits and the
    /// workspace count as constraints.
    pub fn violation(&mut self, x: &Row) -> f64 {
        self.place(x);
        if self.violated.0 == *x {
            return self.violated.1;
        }
        let hand = self.placed.hand;
        let mut worst: f64 = 0.0;
        for p in &self.resolved.points {
            let miss = hand.rotation * p.on_hand + hand.translation.vector - p.target;
            worst = worst.max(miss.amax() - p.tolerance);
        }
        for a in &self.resolved.axes {
            worst = worst.max(a.residual(&hand) - a.tolerance);
        }
        for v in 0..self.model.n() {
            worst = worst.max(self.lower[v] - x[v]).max(x[v] - self.upper[v]);
        }
        if let Some([low, high]) = self.problem.options.workspace {
            for i in 0..3 {
                let c = hand.translation.vector[i];
                worst = worst.max(low[i] - c).max(c - high[i]);
            }
        }
        self.violated = (*x, worst);
        worst
    }
}

#[cfg(test)]
mod tests {
    use super::bands::axis_bands;
    use super::descent::Curvature;
    use super::*;
    use crate::SolverConfig;
    use crate::resolve::AxisBound;
    use gensim2_geometry::{ChainFrames, Robot};
    use nalgebra::Vector3;
    use proptest::prelude::*;
    use std::sync::Arc;

    /// A six-joint arm with a spherical wrist.
    fn arm() -> Arc<Robot> {
        let joint = |i: usize, axis: &str, xyz: &str| {
            format!(
                r#"<joint name="j{i}" type="revolute"><parent link="l{}"/><child link="l{i}"/><origin xyz="{xyz}"/>
                <axis xyz="{axis}"/><limit lower="-2.8" upper="2.8" effort="1" velocity="2"/></joint>"#,
                i - 1
            )
        };
        let links: String = (0..7).map(|i| format!(r#"<link name="l{i}"/>"#)).collect();
        let joints = [
            joint(1, "0 0 1", "0 0 0.3"),
            joint(2, "0 1 0", "0 0 0"),
            joint(3, "0 1 0", "0 0 0.4"),
            joint(4, "0 0 1", "0 0 0.4"),
            joint(5, "0 1 0", "0 0 0"),
            joint(6, "0 0 1", "0 0 0.1"),
        ]
        .concat();
        let text = format!(r#"<robot name="arm">{links}{joints}</robot>"#);
        Arc::new(Robot::from_urdf_str(&text, "arm.urdf", None, "l6", None).unwrap())
    }

    pub(super) fn problem(inner: f64, tolerance: f64, target: [f64; 3]) -> KeypointProblem {
        let config = SolverConfig::from_json(&format!(
            r#"{{"constraint_list": [
                {{"type": "point2point_constraint", "keypoint_name": "tip", "target_keypoint_name": "goal",
                  "tolerance": 0.001}},
                {{"type": "frame_axis_parallel", "axis_from_keypoint_name": "base", "axis_to_keypoint_name": "tip",
                  "target_axis": [0, 0, 1], "target_axis_frame": "world", "target_inner_product": {inner},
                  "tolerance": {tolerance}}}]}}"#
        ))
        .unwrap();
        let point = |z: f64| Vector3::new(0.0, 0.0, z);
        KeypointProblem::builder(arm(), config, vec![0.2, 0.5, 0.6, 0.1, 0.4, 0.0])
            .tool_keypoint("base", point(0.0))
            .tool_keypoint("tip", point(0.1))
            .object_keypoint("goal", Vector3::from(target))
            .build()
            .unwrap()
    }

    #[test]
    fn the_gradient_and_hessian_are_those_of_the_cost() {
        let problem = problem(-1.0, 0.02, [0.5, 0.1, 0.3]);
        let model = Model::new(&problem.robot, &problem.q_start).unwrap();
        let mut resolved = problem.resolve().unwrap();
        resolved.points.clear();
        resolved.axes.clear();
        resolved.costs.push(crate::resolve::PlaneTerm {
            on_hand: Vector3::new(0.1, 0.0, 0.2),
            target: Vector3::new(0.3, 0.2, 0.1),
            normal: Vector3::new(0.6, 0.0, 0.8),
            weight: 3.0,
        });
        let mut search = ActuationSearch::new(&problem, &model, &resolved);
        let mut x = search.start;
        for (v, d) in [0.3, -0.2, 0.4, 0.5, -0.3, 0.8].iter().enumerate() {
            x[v] += d;
        }
        let (g, hessian) = (search.gradient(&x), search.hessian(&x, &Curvature::default()));
        for v in 0..6 {
            let h = 1e-5;
            let (mut up, mut down) = (x, x);
            up[v] += h;
            down[v] -= h;
            let slope = (search.cost(&up) - search.cost(&down)) / (2.0 * h);
            assert!((slope - g[v]).abs() < 1e-6, "{v}: {slope} {}", g[v]);
            let (gu, gd) = (search.gradient(&up), search.gradient(&down));
            for w in 0..6 {
                let curve = (gu[w] - gd[w]) / (2.0 * h);
                assert!((curve - hessian[v][w]).abs() < 1e-5, "{v} {w}: {curve} {}", hessian[v][w]);
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(30))]
        #[test]
        fn poses_found_meet_the_constraints(
            inner in -1.0..1.0f64, tolerance in 0.005..0.2f64,
            angle in -1.5..1.5f64, out in 0.35..0.6f64, up in 0.2..0.5f64,
            met_at in prop::option::of(prop::collection::vec(-2.5..2.5f64, 6)),
        ) {
            // The target is random, or one that a known joint vector meets.
            let (inner, target) = match &met_at {
                None => (inner, [out * angle.cos(), out * angle.sin(), up]),
                Some(q) => {
                    let robot = arm();
                    let mut frames = ChainFrames::default();
                    robot.chain().forward(q, &mut frames).unwrap();
                    let along = frames.tip.rotation * Vector3::z();
                    (along.z, (frames.tip.translation.vector + 0.1 * along).into())
                }
            };
            let mut problem = problem(inner, tolerance, target);
            problem.options.workspace = None;
            let model = Model::new(&problem.robot, &problem.q_start).unwrap();
            let resolved = problem.resolve().unwrap();
            let mut search = ActuationSearch::new(&problem, &model, &resolved);
            let found = search.all(24);
            prop_assert!(met_at.is_none() || !found.candidates.is_empty(), "{met_at:?}");
            for c in &found.candidates {
                prop_assert!(search.violation(&c.x) <= 0.0);
                prop_assert!((search.cost(&c.x) - c.cost).abs() < 1e-9);
            }
            prop_assert!(found.candidates.windows(2).all(|w| w[0].cost <= w[1].cost));
            prop_assert_eq!(found.candidates.is_empty(), found.best_effort.is_some());
        }

        #[test]
        fn bands_hold_what_the_angle_allows(
            inner in -1.0..1.0f64, tolerance in 0.01..0.4f64, polar in 0.0..3.1f64, around in 0.0..6.2f64,
        ) {
            let bound = AxisBound {
                entry: 0, on_hand: Vector3::x(), target: Vector3::z(), center: inner.acos(), tolerance,
            };
            let u = Vector3::new(polar.sin() * around.cos(), polar.sin() * around.sin(), polar.cos());
            let allowed = (polar - bound.center).abs() <= 0.97 * tolerance;
            let inside = axis_bands(&bound, &u).all(|(m, low, high)| (low..=high).contains(&u.dot(&m)));
            prop_assert!(!allowed || inside, "{polar} {}", bound.center);
        }
    }
}

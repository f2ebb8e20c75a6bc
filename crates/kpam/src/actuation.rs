//! The actuation pose: multi-start sequential quadratic programming over the keypoint constraints.
//!
//! Each start is first projected onto the constraints by damped Gauss-Newton, then moved along them by SQP with the
//! exact Hessian of the Lagrangian (kinematic second derivatives are cross products of what the Jacobian has anyway).

use gensim2_geometry::{ChainFrames, Pose};
use nalgebra::{Matrix3, Vector3};

use crate::KeypointProblem;
use crate::model::{MOST_JOINTS, Model, Row};
use crate::problem::{AxisBound, Resolved};
use crate::qp::{ActiveSet, Bound, Qp, QpOutcome, QpSolver};

/// Constraints are aimed at this fraction of their tolerance, so that rounding never leaves it.
const INSIDE: f64 = 0.995;
/// Sides of the polygon inscribed in the cone of a parallel constraint: 0.5 % of the tolerance is given away.
const CONE_SIDES: usize = 16;
/// Iterations of the projection onto the constraints.
const PROJECTIONS: usize = 25;
/// Iterations of the SQP.
const ITERATIONS: usize = 30;
/// Largest change of a joint in one iteration (rad or m).
const STEP: f64 = 0.5;
/// Projected poses that are moved to their optimum, cheapest first.
const DESCENTS: usize = 8;
/// Width of the starts about the present joints, as a fraction of the joint ranges.
const NEARBY: f64 = 0.5;
/// Poses closer than this in every joint are one (rad or m).
const SAME: f64 = 0.02;

/// A pose that meets all constraints.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Candidate {
    pub x: Row,
    pub cost: f64,
}

/// What the search found.
pub(crate) struct Actuation {
    /// Distinct poses that meet every constraint, cheapest first.
    pub candidates: Vec<Candidate>,
    /// The pose that misses the constraints least, where none meets them.
    pub best_effort: Option<Row>,
}

/// The least-squares weights of the original: the base joint costs ten times the others.
fn joint_weight(v: usize) -> f64 {
    if v == 0 { 10.0 } else { 1.0 }
}

pub(crate) struct ActuationSearch<'p> {
    problem: &'p KeypointProblem,
    model: &'p Model,
    resolved: &'p Resolved,
    start: Row,
    start_hand: Pose,
    lower: Row,
    upper: Row,
    q: Vec<f64>,
    frames: ChainFrames,
    qp: ActiveSet,
}

impl<'p> ActuationSearch<'p> {
    pub fn new(problem: &'p KeypointProblem, model: &'p Model, resolved: &'p Resolved) -> Self {
        let start = model.pick(&model.rest);
        let mut search = Self {
            problem,
            model,
            resolved,
            start,
            start_hand: Pose::identity(),
            lower: model.lower,
            upper: model.upper,
            q: Vec::new(),
            frames: ChainFrames::default(),
            qp: ActiveSet::default(),
        };
        search.place(&start);
        search.start_hand = search.frames.tip;
        search
    }

    fn place(&mut self, x: &Row) {
        self.model.forward(&self.problem.robot, x, &mut self.q, &mut self.frames);
    }

    /// Searches from the present joints, from points about them, and from points spread evenly over the joint ranges.
    ///
    /// Every start is projected onto the constraints; the cheapest of the distinct poses that gives are then moved to
    /// their optima. Projected poses stay candidates: off the optimum they are other points of the constraint set,
    /// from which the motion may be free where the cheapest pose's is not.
    pub fn run(&mut self, seeds: usize) -> Actuation {
        let mut poses: Vec<Candidate> = Vec::new();
        let mut least = f64::INFINITY;
        let mut best_effort = None;
        for seed in 0..seeds {
            let mut x = self.seed(seed);
            let miss = self.project(&mut x);
            if miss > 0.0 {
                if miss < least {
                    least = miss;
                    best_effort = Some(x);
                }
                continue;
            }
            poses.push(Candidate { x, cost: self.cost(&x) });
        }
        let mut poses = self.distinct(poses);
        let mut optima: Vec<Candidate> = Vec::new();
        for pose in poses.iter().take(DESCENTS) {
            if let Some(better) = self.descend(&pose.x) {
                optima.push(better);
            }
        }
        poses.extend(optima);
        let candidates = self.distinct(poses);
        if !candidates.is_empty() {
            best_effort = None;
        }
        Actuation { candidates, best_effort }
    }

    /// The pose that start value number `seed` projects to, where it meets the constraints.
    pub fn sample(&mut self, seed: usize) -> Option<Candidate> {
        let mut x = self.seed(seed);
        (self.project(&mut x) <= 0.0).then(|| Candidate { x, cost: self.cost(&x) })
    }

    /// Start value number `seed`: the present joints, then by turns points about them and points all over the ranges.
    fn seed(&self, seed: usize) -> Row {
        let mut x = self.start;
        if seed == 0 {
            return x;
        }
        for (v, value) in x.iter_mut().enumerate().take(self.model.n()) {
            let (low, high) = self.model.range(v);
            let draw = halton(seed, v);
            *value = if seed % 2 == 1 {
                low + (high - low) * draw
            } else {
                (*value + NEARBY * (high - low) * (draw - 0.5)).clamp(low, high)
            };
        }
        x
    }

    /// Poses by cost, without those that are near a cheaper one.
    fn distinct(&self, mut poses: Vec<Candidate>) -> Vec<Candidate> {
        poses.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        let mut out: Vec<Candidate> = Vec::new();
        for pose in poses {
            let near = |c: &Candidate| (0..self.model.n()).all(|v| (c.x[v] - pose.x[v]).abs() < SAME);
            if !out.iter().any(near) {
                out.push(pose);
            }
        }
        out
    }

    /// Cost of a pose: weighted squared joint steps, squared way of the hand, 1 - cos of its turn, and the config's
    /// own cost terms.
    pub fn cost(&mut self, x: &Row) -> f64 {
        self.place(x);
        let joints: f64 =
            (0..self.model.n()).map(|v| joint_weight(self.model.indices[v]) * (x[v] - self.start[v]).powi(2)).sum();
        let hand = &self.frames.tip;
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
        joints + way + turn + terms
    }

    /// Largest violation over all constraints beyond their tolerance (m or rad), limits and workspace included.
    pub fn violation(&mut self, x: &Row) -> f64 {
        self.place(x);
        let hand = self.frames.tip;
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
        worst
    }

    /// Damped Gauss-Newton onto the constraints; returns the violation that is left.
    fn project(&mut self, x: &mut Row) -> f64 {
        let n = self.model.n();
        for v in 0..n {
            x[v] = x[v].clamp(self.lower[v], self.upper[v]);
        }
        let mut damping = 1e-3;
        let mut rows: Vec<(Row, f64)> = Vec::new();
        self.residual_rows(x, &mut rows);
        let mut norm = square_sum(&rows);
        for _ in 0..PROJECTIONS {
            if norm < 1e-24 {
                break;
            }
            let mut gradient = [0.0; MOST_JOINTS];
            let mut normal = [[0.0; MOST_JOINTS]; MOST_JOINTS];
            for (row, r) in &rows {
                for i in 0..n {
                    gradient[i] += row[i] * r;
                    for k in 0..=i {
                        normal[i][k] += row[i] * row[k];
                    }
                }
            }
            // Joints at a limit that would be pushed further stay there.
            let mut free = [true; MOST_JOINTS];
            for v in 0..n {
                free[v] =
                    !((x[v] <= self.lower[v] && gradient[v] > 0.0) || (x[v] >= self.upper[v] && gradient[v] < 0.0));
            }
            let Some(step) = solve_damped(n, &normal, &gradient, &free, damping) else { break };
            let longest = step[..n].iter().fold(0.0, |m: f64, s| m.max(s.abs()));
            let shrink = if longest > STEP { STEP / longest } else { 1.0 };
            let mut trial = *x;
            for v in 0..n {
                trial[v] = (x[v] + shrink * step[v]).clamp(self.lower[v], self.upper[v]);
            }
            let mut trial_rows = std::mem::take(&mut rows);
            let previous = trial_rows.clone();
            self.residual_rows(&trial, &mut trial_rows);
            let next = square_sum(&trial_rows);
            if next < norm {
                *x = trial;
                norm = next;
                rows = trial_rows;
                damping = (damping * 0.2).max(1e-9);
            } else {
                rows = previous;
                damping *= 10.0;
                if damping > 1e3 {
                    break;
                }
            }
        }
        self.violation(x)
    }

    /// Residuals that vanish well inside the constraints, with their gradients.
    fn residual_rows(&mut self, x: &Row, out: &mut Vec<(Row, f64)>) {
        self.place(x);
        out.clear();
        let robot = &self.problem.robot;
        let hand = self.frames.tip;
        for p in &self.resolved.points {
            let at = hand.rotation * p.on_hand + hand.translation.vector;
            for k in 0..3 {
                let axis = Vector3::ith(k, 1.0);
                out.push((self.model.linear_row(robot, &self.frames, &at, &axis), at[k] - p.target[k]));
            }
        }
        for a in &self.resolved.axes {
            let u = hand.rotation * a.on_hand;
            let cross = u.cross(&a.target);
            let sin = cross.norm();
            let angle = sin.atan2(u.dot(&a.target));
            let slack = 0.3 * a.tolerance;
            let miss = angle - angle.clamp(a.center - slack, a.center + slack);
            // Where the directions are (anti)parallel, any axis across them turns one away from the other.
            let normal = if sin > 1e-9 { cross / sin } else { any_across(&u) };
            let mut row = self.model.angular_row(robot, &self.frames, &normal);
            row.iter_mut().for_each(|v| *v = -*v);
            out.push((row, miss));
        }
        if let Some([low, high]) = self.problem.options.workspace {
            for k in 0..3 {
                let c = hand.translation.vector[k];
                let inner = 1e-3_f64.min(0.5 * (high[k] - low[k]));
                let miss = c - c.clamp(low[k] + inner, high[k] - inner);
                if miss != 0.0 {
                    let axis = Vector3::ith(k, 1.0);
                    out.push((self.model.linear_row(robot, &self.frames, &hand.translation.vector, &axis), miss));
                }
            }
        }
    }

    /// SQP from a pose that meets the constraints; the cheapest pose on the way that still meets them.
    fn descend(&mut self, from: &Row) -> Option<Candidate> {
        let n = self.model.n();
        let mut x = *from;
        let mut best: Option<Candidate> = None;
        let mut curvature = Curvature::default();
        let mut radius = STEP;
        let mut value = self.cost(&x);
        let mut bad = self.violation(&x).max(0.0);
        for _ in 0..ITERATIONS {
            let (gradient, mut hessian, mut bounds) = (self.gradient(&x), self.hessian(&x, &curvature), Vec::new());
            self.linearize(&x, &mut bounds);
            let constraints = bounds.len();
            for v in 0..n {
                let mut row = [0.0; MOST_JOINTS];
                row[v] = 1.0;
                let low = (self.lower[v] - x[v]).max(-radius);
                let high = (self.upper[v] - x[v]).min(radius);
                bounds.push(Bound { row, low: low.min(high), high });
            }
            let mut shift = 0.0;
            let outcome = loop {
                let qp = Qp { n, hessian: &hessian[..n], gradient: &gradient, bounds: &bounds };
                match self.qp.solve(&qp) {
                    QpOutcome::Failed if shift < 1e3 => {
                        let more = if shift == 0.0 { 0.3 } else { 3.0 * shift };
                        for (i, row) in hessian.iter_mut().enumerate().take(n) {
                            row[i] += more - shift;
                        }
                        shift = more;
                    }
                    other => break other,
                }
            };
            let QpOutcome::Solved { step, multipliers } = outcome else {
                // Curvature took the pose out of the linearized constraints' reach: come back first.
                if self.project(&mut x) > 1e-6 {
                    break;
                }
                value = self.cost(&x);
                bad = 0.0;
                radius *= 0.5;
                if radius < 1e-4 {
                    break;
                }
                continue;
            };
            let length = step[..n].iter().fold(0.0, |m: f64, s| m.max(s.abs()));
            let price = 1.5 * multipliers[..constraints].iter().fold(1.0, |m: f64, u| m.max(u.abs()));
            let mut trial = x;
            for v in 0..n {
                trial[v] = (x[v] + step[v]).clamp(self.lower[v], self.upper[v]);
            }
            let trial_bad = self.project_gently(&mut trial);
            let trial_value = self.cost(&trial);
            if trial_bad <= 0.0 && best.is_none_or(|b| trial_value < b.cost) {
                best = Some(Candidate { x: trial, cost: trial_value });
            }
            if trial_value + price * trial_bad <= value + price * bad + 1e-12 {
                x = trial;
                let gain = value - trial_value;
                value = trial_value;
                bad = trial_bad;
                curvature = self.curvature_of(&multipliers);
                if length < 0.3 * radius {
                    radius = radius.max(2.0 * length).min(STEP);
                } else {
                    radius = (2.0 * radius).min(STEP);
                }
                if length < 1e-6 || (gain.abs() < 1e-7 * (1.0 + value) && bad <= 0.0) {
                    break;
                }
            } else {
                radius = 0.25 * length;
                if radius < 1e-5 {
                    break;
                }
            }
        }
        best
    }

    /// Two Gauss-Newton corrections onto the constraints, least change of the joints; returns the violation left.
    fn project_gently(&mut self, x: &mut Row) -> f64 {
        let n = self.model.n();
        let mut bounds = Vec::new();
        for _ in 0..3 {
            let bad = self.violation(x);
            if bad <= 0.0 {
                return 0.0;
            }
            self.linearize(x, &mut bounds);
            for v in 0..n {
                let mut row = [0.0; MOST_JOINTS];
                row[v] = 1.0;
                bounds.push(Bound { row, low: self.lower[v] - x[v], high: self.upper[v] - x[v] });
            }
            let mut hessian = [[0.0; MOST_JOINTS]; MOST_JOINTS];
            for (v, row) in hessian.iter_mut().enumerate().take(n) {
                row[v] = 1.0;
            }
            let gradient = [0.0; MOST_JOINTS];
            let qp = Qp { n, hessian: &hessian[..n], gradient: &gradient, bounds: &bounds };
            let QpOutcome::Solved { step, .. } = self.qp.solve(&qp) else { return bad };
            for v in 0..n {
                x[v] = (x[v] + step[v]).clamp(self.lower[v], self.upper[v]);
            }
        }
        self.violation(x).max(0.0)
    }

    /// Constraints linearized at `x` (frames are placed there), as bounds on the step.
    fn linearize(&mut self, x: &Row, out: &mut Vec<Bound>) {
        self.place(x);
        out.clear();
        let robot = &self.problem.robot;
        let hand = self.frames.tip;
        for p in &self.resolved.points {
            let at = hand.rotation * p.on_hand + hand.translation.vector;
            for k in 0..3 {
                let row = self.model.linear_row(robot, &self.frames, &at, &Vector3::ith(k, 1.0));
                let (miss, t) = (at[k] - p.target[k], INSIDE * p.tolerance);
                out.push(Bound { row, low: -t - miss, high: t - miss });
            }
        }
        for a in &self.resolved.axes {
            for (m, low, high) in axis_bands(a, &(hand.rotation * a.on_hand)) {
                let u = hand.rotation * a.on_hand;
                let row = self.model.angular_row(robot, &self.frames, &u.cross(&m));
                let value = u.dot(&m);
                out.push(Bound { row, low: low - value, high: high - value });
            }
        }
        if let Some([low, high]) = self.problem.options.workspace {
            let at = hand.translation.vector;
            for k in 0..3 {
                let row = self.model.linear_row(robot, &self.frames, &at, &Vector3::ith(k, 1.0));
                out.push(Bound { row, low: low[k] - at[k], high: high[k] - at[k] });
            }
        }
    }

    /// Multipliers gathered into the vectors whose second derivatives the Lagrangian needs. Frames are those of the
    /// pose at which the bounds were linearized; the next pose is near enough.
    fn curvature_of(&mut self, multipliers: &[f64]) -> Curvature {
        let mut out = Curvature::default();
        let mut next = multipliers.iter().copied();
        let mut take = || next.next().unwrap_or(0.0);
        for p in &self.resolved.points {
            let force = Vector3::new(take(), take(), take());
            out.points.push((p.on_hand, -force));
        }
        for a in &self.resolved.axes {
            let u = self.frames.tip.rotation * a.on_hand;
            let pull = axis_bands(a, &u).fold(Vector3::zeros(), |sum, (m, _, _)| sum - m * take());
            out.axes.push((a.on_hand, pull));
        }
        if self.problem.options.workspace.is_some() {
            let force = Vector3::new(take(), take(), take());
            out.points.push((Vector3::zeros(), -force));
        }
        out
    }

    fn gradient(&mut self, x: &Row) -> Row {
        self.place(x);
        let robot = &self.problem.robot;
        let hand = self.frames.tip;
        let mut g = [0.0; MOST_JOINTS];
        for v in 0..self.model.n() {
            g[v] = 2.0 * joint_weight(self.model.indices[v]) * (x[v] - self.start[v]);
        }
        let mut add = |row: &Row, factor: f64| g.iter_mut().zip(row).for_each(|(a, b)| *a += factor * b);
        let way = hand.translation.vector - self.start_hand.translation.vector;
        add(&self.model.linear_row(robot, &self.frames, &hand.translation.vector, &way), 2.0);
        // d(1 - cos) = -1/2 sum_k s_k . (w x r_k) = -1/2 w . sum_k r_k x s_k
        let pull = columns(&hand)
            .zip(columns(&self.start_hand))
            .fold(Vector3::zeros(), |sum: Vector3<f64>, (r, s)| sum + r.cross(&s));
        add(&self.model.angular_row(robot, &self.frames, &pull), -0.5);
        for t in &self.resolved.costs {
            let p = hand.rotation * t.on_hand + hand.translation.vector;
            let row = self.model.linear_row(robot, &self.frames, &p, &t.normal);
            add(&row, 2.0 * t.weight * t.normal.dot(&(p - t.target)));
        }
        g
    }

    /// Hessian of the Lagrangian, with a proximal term across the constraints where it would be indefinite.
    fn hessian(&mut self, x: &Row, curvature: &Curvature) -> [Row; MOST_JOINTS] {
        self.place(x);
        let n = self.model.n();
        let robot = &self.problem.robot;
        let hand = self.frames.tip;
        let origin = hand.translation.vector;
        let mut h = [[0.0; MOST_JOINTS]; MOST_JOINTS];
        for v in 0..n {
            h[v][v] = 2.0 * joint_weight(self.model.indices[v]);
        }
        let mut add = |row: &Row, factor: f64| {
            for i in 0..n {
                for k in 0..n {
                    h[i][k] += factor * row[i] * row[k];
                }
            }
        };
        let unit = Matrix3::<f64>::identity();
        for k in 0..3 {
            add(&self.model.linear_row(robot, &self.frames, &origin, &unit.column(k).into()), 2.0);
        }
        for t in &self.resolved.costs {
            let p = hand.rotation * t.on_hand + origin;
            add(&self.model.linear_row(robot, &self.frames, &p, &t.normal), 2.0 * t.weight);
        }
        // Across the constraints the step is set by them, not by this Hessian: stiffness there only keeps it convex.
        const STIFF: f64 = 20.0;
        for p in &self.resolved.points {
            let at = hand.rotation * p.on_hand + origin;
            for k in 0..3 {
                add(&self.model.linear_row(robot, &self.frames, &at, &unit.column(k).into()), STIFF);
            }
        }
        for (a, (_, pull)) in self.resolved.axes.iter().zip(&curvature.axes) {
            if pull.norm() > 1e-9 {
                let u = hand.rotation * a.on_hand;
                add(&self.model.angular_row(robot, &self.frames, &u.cross(&pull.normalize())), STIFF);
            }
        }
        let mut points: Vec<(Vector3<f64>, Vector3<f64>)> =
            curvature.points.iter().map(|(p, f)| (hand.rotation * p + origin, *f)).collect();
        points.push((origin, 2.0 * (origin - self.start_hand.translation.vector)));
        let mut axes: Vec<(Vector3<f64>, Vector3<f64>)> =
            curvature.axes.iter().map(|(a, m)| (hand.rotation * a, *m)).collect();
        axes.extend(columns(&hand).zip(columns(&self.start_hand)).map(|(r, s)| (r, -0.5 * s)));
        for t in &self.resolved.costs {
            let p = hand.rotation * t.on_hand + origin;
            points.push((p, t.normal * (2.0 * t.weight * t.normal.dot(&(p - t.target)))));
        }
        self.model.second_derivatives(robot, &self.frames, &points, &axes, &mut h);
        h
    }
}

/// Vectors that weigh second derivatives: forces on points of the hand, and pulls on its directions.
#[derive(Default)]
struct Curvature {
    points: Vec<(Vector3<f64>, Vector3<f64>)>,
    axes: Vec<(Vector3<f64>, Vector3<f64>)>,
}

fn columns(pose: &Pose) -> impl Iterator<Item = Vector3<f64>> + '_ {
    (0..3).map(|k| pose.rotation.matrix().column(k).into())
}

/// An axis constraint as bands `low <= u . m <= high` of the hand's direction `u`.
///
/// A band whose cone closes at the target (parallel constraints) becomes a polygon inscribed in the cone; an open band
/// becomes one band along the direction in which the angle changes.
fn axis_bands(a: &AxisBound, u: &Vector3<f64>) -> impl Iterator<Item = (Vector3<f64>, f64, f64)> + use<> {
    let u = *u;
    let flipped = a.center > std::f64::consts::FRAC_PI_2;
    let target = if flipped { -a.target } else { a.target };
    let center = if flipped { std::f64::consts::PI - a.center } else { a.center };
    let t = INSIDE * a.tolerance;
    let closed = center - t <= 0.0;
    let (e1, e2) = across(&target);
    let cross = target.cross(&u);
    let sin = cross.norm();
    // Unit direction across the target in which u lies.
    let outward = if sin > 1e-9 { cross.cross(&target) / sin } else { e1 };
    let half_turn = std::f64::consts::PI;
    let wide = center + t >= std::f64::consts::FRAC_PI_2;
    (0..if closed && !wide { CONE_SIDES } else { 1 }).map(move |k| {
        if closed && !wide {
            let step = 2.0 * half_turn / CONE_SIDES as f64;
            let (s, c) = (step * k as f64).sin_cos();
            (e1 * c + e2 * s, f64::NEG_INFINITY, (center + t).sin() * (step / 2.0).cos())
        } else {
            // With u = cos(angle) target + sin(angle) outward, the angle is measured from the direction in the middle
            // of the band: its sine is u . m with m across that direction.
            let middle = target * center.cos() + outward * center.sin();
            let m = outward * center.cos() - target * center.sin();
            let along = u.dot(&middle);
            if along > 0.0 { (m, -(t.min(1.5)).sin(), (t.min(1.5)).sin()) } else { (m, -1.0, 1.0) }
        }
    })
}

fn any_across(u: &Vector3<f64>) -> Vector3<f64> {
    across(u).0
}

fn across(u: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let least = u.iamin();
    let e1 = u.cross(&Vector3::ith(least, 1.0)).normalize();
    (e1, u.cross(&e1))
}

fn square_sum(rows: &[(Row, f64)]) -> f64 {
    rows.iter().map(|(_, r)| r * r).sum()
}

/// Solves `(N + damping I) d = -g` over the free variables; `N` is given by its lower triangle.
fn solve_damped(
    n: usize,
    normal: &[Row; MOST_JOINTS],
    gradient: &Row,
    free: &[bool; MOST_JOINTS],
    damping: f64,
) -> Option<Row> {
    let mut l = [[0.0; MOST_JOINTS]; MOST_JOINTS];
    let mut y = [0.0; MOST_JOINTS];
    for i in 0..n {
        if !free[i] {
            l[i][i] = 1.0;
            continue;
        }
        for k in 0..=i {
            if !free[k] {
                continue;
            }
            let mut sum = normal[i][k] + if i == k { damping } else { 0.0 };
            for m in 0..k {
                sum -= l[i][m] * l[k][m];
            }
            if i == k {
                if sum.is_nan() || sum <= 0.0 {
                    return None;
                }
                l[i][i] = sum.sqrt();
            } else {
                l[i][k] = sum / l[k][k];
            }
        }
        let mut sum = -gradient[i];
        for k in 0..i {
            sum -= l[i][k] * y[k];
        }
        y[i] = sum / l[i][i];
    }
    for i in (0..n).rev() {
        let mut sum = y[i];
        for k in i + 1..n {
            sum -= l[k][i] * y[k];
        }
        y[i] = sum / l[i][i];
        if !free[i] {
            y[i] = 0.0;
        }
    }
    Some(y)
}

/// Element `index` of the Halton sequence in dimension `dimension`: evenly spread, the same on every machine.
pub(crate) fn halton(index: usize, dimension: usize) -> f64 {
    const PRIMES: [usize; MOST_JOINTS] = [2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37];
    let base = PRIMES[dimension % MOST_JOINTS];
    let (mut i, mut f, mut r) = (index, 1.0, 0.0);
    while i > 0 {
        f /= base as f64;
        r += f * (i % base) as f64;
        i /= base;
    }
    r
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SolverConfig;
    use gensim2_geometry::Robot;
    use proptest::prelude::*;
    use std::collections::BTreeMap;
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

    fn problem(inner: f64, tolerance: f64, target: [f64; 3]) -> KeypointProblem {
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
        let tool = BTreeMap::from([("base".to_owned(), point(0.0)), ("tip".to_owned(), point(0.1))]);
        let goal = BTreeMap::from([("goal".to_owned(), Vector3::from(target))]);
        let start = vec![0.2, 0.5, 0.6, 0.1, 0.4, 0.0];
        KeypointProblem::new(arm(), config, start, tool, goal, Pose::identity()).unwrap()
    }

    #[test]
    fn the_gradient_and_hessian_are_those_of_the_cost() {
        let problem = problem(-1.0, 0.02, [0.5, 0.1, 0.3]);
        let model = Model::new(&problem.robot, &problem.q_start).unwrap();
        let mut resolved = problem.resolve().unwrap();
        resolved.points.clear();
        resolved.axes.clear();
        resolved.costs.push(crate::problem::PlaneTerm {
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
        ) {
            let problem = problem(inner, tolerance, [out * angle.cos(), out * angle.sin(), up]);
            let model = Model::new(&problem.robot, &problem.q_start).unwrap();
            let resolved = problem.resolve().unwrap();
            let mut search = ActuationSearch::new(&problem, &model, &resolved);
            let found = search.run(24);
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

//! Joint motion for a given hand path. The path is followed in small steps. Each step reaches the next hand pose
//! exactly and within the joint limits, and uses redundant joints to move away from the limits.

use gensim2_geometry::{Chain, JointKind, Pose, Robot, rotation_log};
use nalgebra::Vector3;

use crate::Cancel;
use crate::model::{MAX_JOINTS, Model, Placed, Row};
use crate::motion::HandPath;
use crate::qp::{ActiveSet, Bound, Qp, QpOutcome, smallest_step};
use crate::timing::Spline;

/// Maximum translation (m) and rotation (rad) of the hand between two waypoints.
const STRIDE: f64 = 0.01;
const TURN: f64 = 0.05;
/// A joint that moves more than this (rad or m) between waypoints has switched branches or passed a singularity.
const JUMP: f64 = 0.25;
/// Maximum error (m and rad) of the hand pose at a waypoint.
const EXACT: f64 = 1e-6;
/// Maximum distance (m) of the curve through the waypoints from the hand path.
pub(crate) const OFF_PATH: f64 = 2e-3;
/// If the curve leaves the hand path or the joint limits, the waypoint spacing is divided by these factors in turn.
const FINER: [usize; 3] = [1, 4, 16];
/// Fraction of a step's redundant motion that continues in the next step. With 1, the arm would oscillate.
const KEEP: f64 = 0.5;
/// Redundant motion (rad) per step by which a joint moves away from its limit.
const PUSH: f64 = 0.03;
/// Weight of the step's size when the hand pose cannot be reached exactly and its error is minimized.
const FREE_WEIGHT: f64 = 1e-8;
/// Distance (rad or m) that waypoints keep from the joint limits, so that the spline between them stays inside.
pub(crate) const LIMIT_MARGIN: f64 = 1e-3;
/// A joint closer than this (rad or m) to a limit counts as being at the limit.
const AT_LIMIT: f64 = 10.0 * LIMIT_MARGIN;

/// Waypoints along a hand path up to the point where the arm cannot follow it any further.
pub(crate) struct Followed {
    /// Joint vectors at equal steps of the path, including its start.
    pub waypoints: Vec<Row>,
    /// Fraction of the path that the arm can follow; 1 for the complete path.
    pub fraction: f64,
}

/// A path of the hand with a parameter from 0 to 1.
pub(crate) trait Guide {
    /// Returns the hand pose at the parameter `s`, 0 to 1.
    fn at(&self, s: f64) -> Pose;
    /// Returns the length (m) of the path of the hand's origin, and the angle (rad) by which the hand rotates.
    fn length(&self) -> (f64, f64);
}

impl Guide for HandPath {
    fn at(&self, s: f64) -> Pose {
        HandPath::at(self, s)
    }

    fn length(&self) -> (f64, f64) {
        HandPath::length(self)
    }
}

/// A second link that keeps its pose relative to the hand, such as another hand that holds the same object.
pub(crate) struct SecondLink {
    chain: Chain,
    /// Joints of the chain that variables drive, as in [`Model::columns_of`].
    columns: Vec<(usize, usize, f64)>,
    /// Pose of the link in the hand frame.
    in_hand: Pose,
    placed: Placed,
}

pub(crate) struct Follower<'p> {
    robot: &'p Robot,
    model: &'p Model,
    second: Option<SecondLink>,
    /// For each variable, whether it moves the hand or the second link. All other variables keep their values.
    moves: [bool; MAX_JOINTS],
    /// Unit axis of the hand frame about which the hand may rotate freely.
    pub free_axis: Option<Vector3<f64>>,
    /// Maximum distance (m) and angle (rad) of the curve through the waypoints from the hand path.
    pub tolerance: [f64; 2],
    /// Joint values that redundant joints move toward, instead of away from their limits.
    pub posture: Option<Row>,
    placed: Placed,
    /// Joint vector of `placed`.
    at: Row,
    qp: ActiveSet,
    bounds: Vec<Bound>,
    /// Flag that ends the following of a path.
    over: Cancel,
}

impl<'p> Follower<'p> {
    pub fn new(robot: &'p Robot, model: &'p Model, over: Cancel) -> Self {
        Self {
            robot,
            model,
            second: None,
            moves: model.moves(robot.chain()),
            free_axis: None,
            tolerance: [OFF_PATH, f64::INFINITY],
            posture: None,
            placed: Placed::default(),
            at: [f64::NAN; MAX_JOINTS],
            qp: ActiveSet::default(),
            bounds: Vec::new(),
            over,
        }
    }

    /// Lets the link of a chain keep the pose relative to the hand that it has at the joint vector `x`.
    pub fn with_second(mut self, chain: Chain, x: &Row) -> Self {
        let (columns, moves) = (self.model.columns_of(&chain), self.model.moves(&chain));
        for (one, other) in self.moves.iter_mut().zip(moves) {
            *one |= other;
        }
        let mut placed = Placed::default();
        placed.place_along(&chain, &columns, self.model, x);
        let in_hand = self.hand(x).inverse() * placed.hand;
        self.second = Some(SecondLink { chain, columns, in_hand, placed });
        self
    }

    /// Returns the number of variables that move the hand or the second link.
    pub fn movers(&self) -> usize {
        self.moves.iter().filter(|moves| **moves).count()
    }

    /// Returns the distance (m) and the angle (rad) by which the second link is off its pose relative to the hand at
    /// `x`; zero if there is no second link.
    pub fn second_off(&mut self, x: &Row) -> [f64; 2] {
        let hand = self.hand(x);
        let Some(second) = &mut self.second else { return [0.0; 2] };
        second.placed.place_along(&second.chain, &second.columns, self.model, x);
        let (way, turn) = left(&(hand * second.in_hand), &second.placed.hand, None);
        [way.norm(), turn.norm()]
    }

    /// Returns the hand pose at the joint vector `x`.
    pub fn hand(&mut self, x: &Row) -> Pose {
        if self.at != *x {
            self.placed.place(self.robot, self.model, x);
            self.at = *x;
        }
        self.placed.hand
    }

    /// Follows `path` from `x`, at which the hand is at the start of the path (at its end if `backwards` is set).
    ///
    /// The motion runs along the spline through the waypoints, which must stay on the path and within the joint limits
    /// between waypoints, too. If it does not, the waypoints are placed closer together, or the result ends there.
    pub fn follow(&mut self, path: &impl Guide, x: &Row, backwards: bool) -> Followed {
        let (way, turn) = path.length();
        let steps = ((way / STRIDE).max(turn / TURN).ceil() as usize).max(1);
        let mut out = Followed { waypoints: vec![*x], fraction: 0.0 };
        for finer in FINER {
            out = self.follow_in(path, x, backwards, steps, finer);
            let Some(stray) = self.strays(path, &out, backwards, steps * finer) else { return out };
            out.waypoints.truncate(stray + 1);
            out.fraction = stray as f64 / (steps * finer) as f64;
            if self.over.is_cancelled() {
                break;
            }
        }
        out
    }

    fn follow_in(&mut self, path: &impl Guide, x: &Row, backwards: bool, strides: usize, finer: usize) -> Followed {
        let steps = strides * finer;
        // Smaller steps share the redundant motion of a full step, so that joints move equally far in total.
        let keep = KEEP.powf(1.0 / finer as f64);
        let push = PUSH * (1.0 - keep) / finer as f64;
        let mut waypoints = vec![*x];
        let mut last = *x;
        let mut drift = [0.0; MAX_JOINTS];
        for k in 1..=steps {
            let s = k as f64 / steps as f64;
            let goal = path.at(if backwards { 1.0 - s } else { s });
            let next = if self.over.is_cancelled() { None } else { self.reach(&goal, &last, &drift, push) };
            let Some(next) = next else {
                return Followed { waypoints, fraction: (k - 1) as f64 / steps as f64 };
            };
            for v in 0..self.model.n() {
                drift[v] = keep * (next[v] - last[v]);
            }
            last = next;
            waypoints.push(next);
        }
        Followed { waypoints, fraction: 1.0 }
    }

    /// Returns the first waypoint after which the spline leaves the hand path or the joint limits.
    fn strays(&mut self, path: &impl Guide, followed: &Followed, backwards: bool, steps: usize) -> Option<usize> {
        let n = self.model.n();
        let waypoints = &followed.waypoints;
        let curve = Spline::through(n, waypoints, None);
        if curve.intervals() + 1 != waypoints.len() {
            return None; // the path is shorter than one step
        }
        (0..waypoints.len() - 1).find(|&i| {
            if self.over.is_cancelled() {
                return true;
            }
            let limited = curve.keeps_within(i..i + 1, &self.model.lower, &self.model.upper);
            let mut on_path = || {
                let s = (i as f64 + 0.5) / steps as f64;
                let middle = curve.at(i, 0.5);
                let off = self.second_off(&middle);
                let hand = self.hand(&middle);
                let (way, turn) = left(&path.at(if backwards { 1.0 - s } else { s }), &hand, self.free_axis.as_ref());
                let kept = |way: f64, turn: f64| way < self.tolerance[0] && turn < self.tolerance[1];
                kept(way.norm(), turn.norm()) && kept(off[0], off[1])
            };
            !(limited && on_path())
        })
    }

    /// Returns a joint vector near `from` with the hand at `goal`. `drift` is the part of the previous step's redundant
    /// motion that continues, and `push` the strength with which joints move away from their limits.
    fn reach(&mut self, goal: &Pose, from: &Row, drift: &Row, push: f64) -> Option<Row> {
        let n = self.model.n();
        let mut x = *from;
        for round in 0..12 {
            let hand = self.hand(&x);
            let (way, turn) = left(goal, &hand, self.free_axis.as_ref());
            let second = self.second_rows(goal, &x);
            let met = |value: f64| value.abs() < EXACT;
            let second_met = second.as_ref().is_none_or(|(_, values)| values.iter().all(|v| met(*v)));
            if way.amax() < EXACT && turn.amax() < EXACT && second_met {
                let jumped = (0..n).any(|v| (x[v] - from[v]).abs() > JUMP);
                return (!jumped).then_some(x);
            }
            let mut gradient = [0.0; MAX_JOINTS];
            if round == 0 {
                for v in 0..n {
                    gradient[v] = -drift[v] - push * self.push(v, &x);
                }
            }
            let [x_row, y_row, z_row] = self.placed.point_rows(&hand.translation.vector);
            let about = |axis: &Vector3<f64>| (self.placed.angular_row(axis), turn.dot(axis));
            let step = match self.free_axis {
                None => {
                    let [roll, pitch, yaw] = [0, 1, 2].map(|k| about(&Vector3::ith(k, 1.0)));
                    let rows = [x_row, y_row, z_row, roll.0, pitch.0, yaw.0];
                    let values = [way.x, way.y, way.z, roll.1, pitch.1, yaw.1];
                    match second {
                        None => self.step(&x, &rows, &values, &gradient)?,
                        Some((more_rows, more_values)) => {
                            let (mut all, mut both) = ([[0.0; MAX_JOINTS]; 12], [0.0; 12]);
                            all[..6].copy_from_slice(&rows);
                            all[6..].copy_from_slice(&more_rows);
                            both[..6].copy_from_slice(&values);
                            both[6..].copy_from_slice(&more_values);
                            self.step(&x, &all, &both, &gradient)?
                        }
                    }
                }
                Some(axis) => {
                    let axis = hand.rotation * axis;
                    let across = perpendicular(&axis);
                    let [one, two] = [about(&across), about(&axis.cross(&across))];
                    let rows = [x_row, y_row, z_row, one.0, two.0];
                    self.step(&x, &rows, &[way.x, way.y, way.z, one.1, two.1], &gradient)?
                }
            };
            if step[..n].iter().any(|s| s.is_nan() || s.abs() > 2.0 * JUMP) {
                return None;
            }
            for v in 0..n {
                x[v] += step[v];
            }
        }
        None
    }

    /// Returns the gradients of the second link's translation and rotation at `x`, and the translation (m) and rotation
    /// (rad) to its pose for the hand at `goal`; `None` if there is no second link.
    fn second_rows(&mut self, goal: &Pose, x: &Row) -> Option<([Row; 6], [f64; 6])> {
        let second = self.second.as_mut()?;
        second.placed.place_along(&second.chain, &second.columns, self.model, x);
        let at = second.placed.hand;
        let (way, turn) = left(&(goal * second.in_hand), &at, None);
        let [x_row, y_row, z_row] = second.placed.point_rows(&at.translation.vector);
        let [roll, pitch, yaw] = [0, 1, 2].map(|k| second.placed.angular_row(&Vector3::ith(k, 1.0)));
        Some(([x_row, y_row, z_row, roll, pitch, yaw], [way.x, way.y, way.z, turn.x, turn.y, turn.z]))
    }

    /// Returns the smallest step with `rows . step = values` within joint limits.
    fn step<const M: usize>(&mut self, x: &Row, rows: &[Row; M], values: &[f64; M], gradient: &Row) -> Option<Row> {
        // In most steps no joint reaches a limit, so equalities suffice.
        match smallest_step(self.model.n(), rows, values, gradient) {
            Some(step) if self.within_limits(x, &step) => Some(step),
            _ => self.limited_step(x, rows, values, gradient),
        }
    }

    /// Returns how far joint `v` may move from `x` in both directions while it keeps a margin to its limits. The value
    /// is 0 in a direction in which it is already closer to the limit than the margin.
    fn room(&self, v: usize, x: &Row) -> (f64, f64) {
        let (low, high) = (self.model.lower[v] + LIMIT_MARGIN, self.model.upper[v] - LIMIT_MARGIN);
        (low.min(x[v]) - x[v], high.max(x[v]) - x[v])
    }

    fn within_limits(&self, x: &Row, step: &Row) -> bool {
        (0..self.model.n()).all(|v| {
            let (low, high) = self.room(v, x);
            low <= step[v] && step[v] <= high
        })
    }

    /// Returns the same step as [`Follower::step`] for joints near their limits. With fewer joints than rows, the rows are
    /// dependent and contradict each other by rounding, so the step with the smallest error is returned.
    fn limited_step(&mut self, x: &Row, rows: &[Row], values: &[f64], gradient: &Row) -> Option<Row> {
        let n = self.model.n();
        let few = n < rows.len();
        let mut hessian = [[0.0; MAX_JOINTS]; MAX_JOINTS];
        let mut slope = *gradient;
        self.bounds.clear();
        if few {
            for v in 0..n {
                for w in 0..n {
                    hessian[v][w] = rows.iter().map(|row| row[v] * row[w]).sum();
                }
                let miss: f64 = rows.iter().zip(values).map(|(row, b)| row[v] * b).sum();
                slope[v] = FREE_WEIGHT * gradient[v] - miss;
            }
        } else {
            self.bounds.extend(rows.iter().zip(values).map(|(row, b)| Bound { row: *row, low: *b, high: *b }));
        }
        for v in 0..n {
            hessian[v][v] += if few { FREE_WEIGHT } else { 1.0 };
            let (low, high) = self.room(v, x);
            let mut row = [0.0; MAX_JOINTS];
            row[v] = 1.0;
            self.bounds.push(Bound { row, low, high });
        }
        let qp = Qp { n, hessian: &hessian[..n], gradient: &slope, bounds: &self.bounds };
        match self.qp.solve(&qp) {
            QpOutcome::Solved { step, .. } => Some(step),
            QpOutcome::Infeasible | QpOutcome::Failed => None,
        }
    }

    /// Returns the name of the joint that is closest to a limit at `x` and the limit, if it is close.
    pub fn limit_at(&self, x: &Row) -> Option<String> {
        let limits = (0..self.model.n())
            .flat_map(|v| [(v, "lower", self.model.lower[v]), (v, "upper", self.model.upper[v])])
            .map(|(v, end, limit)| ((x[v] - limit).abs(), v, end, limit));
        let nearest = limits.min_by(|a, b| a.0.total_cmp(&b.0)).filter(|(off, ..)| *off < AT_LIMIT);
        nearest.map(|(_, v, end, limit)| {
            let joint = &self.robot.joints()[self.model.map().indices()[v]];
            let unit = if joint.kind() == JointKind::Prismatic { "m" } else { "rad" };
            format!("{} is at its {end} limit, {limit:.4} {unit}", joint.name())
        })
    }

    /// Returns the direction and strength with which a joint makes use of redundancy: toward the posture, or away from
    /// its limits.
    fn push(&self, v: usize, x: &Row) -> f64 {
        match &self.posture {
            _ if !self.moves[v] => 0.0,
            Some(posture) => (posture[v] - x[v]).clamp(-1.0, 1.0),
            None => self.limit_push(v, x),
        }
    }

    /// Returns the strength with which a joint moves away from its limits; it grows near them and has a sign.
    fn limit_push(&self, v: usize, x: &Row) -> f64 {
        let (low, high) = (self.model.lower[v], self.model.upper[v]);
        if !(low.is_finite() && high.is_finite() && low < high) {
            return 0.0;
        }
        let half = 0.5 * (high - low);
        let u = (x[v] - 0.5 * (low + high)) / half;
        -u.powi(5) * half.min(1.0)
    }
}

/// Returns the translation (m) and rotation (rad) in the base frame from a hand pose to a goal. With a free axis of the
/// hand frame, the rotation is the smallest one that brings this axis to its direction at the goal.
pub(crate) fn left(goal: &Pose, hand: &Pose, free_axis: Option<&Vector3<f64>>) -> (Vector3<f64>, Vector3<f64>) {
    let way = goal.translation.vector - hand.translation.vector;
    let Some(axis) = free_axis else {
        return (way, rotation_log(&(goal.rotation * hand.rotation.inverse())));
    };
    let (now, then) = (hand.rotation * axis, goal.rotation * axis);
    let cross = now.cross(&then);
    let (sin, cos) = (cross.norm(), now.dot(&then));
    let about = if sin > 1e-9 { cross / sin } else { perpendicular(&now) };
    (way, about * sin.atan2(cos))
}

/// Returns a unit vector perpendicular to a unit vector.
fn perpendicular(to: &Vector3<f64>) -> Vector3<f64> {
    to.cross(&Vector3::ith(to.iamin(), 1.0)).normalize()
}

//! Trajectory optimization: shortens the path through a plan's waypoints by sequential quadratic programming.
//!
//! The cost is the sum of squared joint steps between waypoints, weighted by the problem's `joint_weights` (GenSim2
//! uses 10 for the first joint and 1 for the others). The hand keeps its poses at keyframes (position exactly,
//! orientation within 0.03 rad) and, optionally, its path after the actuation. Joint limits are linearized at each
//! waypoint, clearances also halfway between two waypoints. Each round solves one banded quadratic program. Its step is
//! accepted only if the path becomes cheaper, and no part that was collision-free collides.

mod program;

use gensim2_geometry::{Pose, rotation_log};
use nalgebra::{Matrix3, Vector3};

use crate::fingers::resting_joints;
use crate::hand_path::LIMIT_MARGIN;
use crate::model::{Model, Placed, Row};
use crate::motion::motions;
use crate::world::{Clearance, Margins, MotionSegment, State, Way, World, travel_over};
use crate::{KeypointProblem, Plan, ProblemError};
use program::{Bound, Program};

/// Maximum rotation (rad) of the hand from its original pose at a keyframe.
const TURN: f64 = 0.03;
/// Maximum deviation (m) of the hand's position at a keyframe.
const EXACT: f64 = 1e-6;
/// The quadratic program bounds the distances of pairs of bodies that are closer to each other than this (m).
const REACH: f64 = 0.06;
/// Initial bound (rad or m) on the step of a joint in a round.
const TRUST: f64 = 0.3;
/// The refinement ends when the bound on a joint's step has fallen below this value (rad or m).
const FINEST: f64 = 0.01;
/// Maximum number of rounds, each with one quadratic program.
const ROUNDS: usize = 5;
/// The refinement ends after a round that reduces the cost by less than this fraction.
const SMALL: f64 = 5e-3;
/// Approximate number of waypoints if the options give no times.
const WAYPOINTS: f64 = 40.0;

/// Options of a refinement.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct RefineOptions {
    /// Times (s) in the plan's motion at which waypoints are taken, in addition to its start, end and keyframes. If
    /// `None`, there are about 40 waypoints in total.
    pub times: Option<Vec<f64>>,
    /// Whether the hand keeps its path after the actuation, and not only its poses at keyframes.
    pub keep_paths: bool,
}

/// A refined path, with its cost before and after the refinement.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Refined {
    /// Joint vectors (rad or m) of the waypoints; the first one is the start.
    pub waypoints: Vec<Vec<f64>>,
    /// Time (s) in the plan's motion at which each waypoint was taken.
    pub times: Vec<f64>,
    /// For each keyframe that the motion reaches, the index of its waypoint.
    pub keyframes: Vec<usize>,
    /// Sum of the weighted squared joint steps before the refinement.
    pub cost_before: f64,
    /// Sum of the weighted squared joint steps after the refinement; never larger than before it.
    pub cost_after: f64,
    /// Number of quadratic programs that were solved.
    pub rounds: usize,
}

/// Position of a waypoint in the plan's motion.
struct Place {
    segment: MotionSegment,
    travel: f64,
    hand: Option<Pose>,
}

struct Refinement<'p> {
    problem: &'p KeypointProblem,
    model: &'p Model,
    world: World<'p>,
    placed: Placed,
    weights: Row,
    places: Vec<Place>,
    /// Whether the step from each waypoint to the next must stay collision-free.
    free: Vec<bool>,
    margins: Margins,
}

/// Shortens the path through a plan's waypoints.
///
/// # Errors
/// The plan has no motion, or a time lies outside its motion; the error names the field.
pub fn refine(problem: &KeypointProblem, plan: &Plan, options: &RefineOptions) -> Result<Refined, ProblemError> {
    let (Some(trajectory), Some(q_plan)) = (plan.trajectory(), &plan.q_plan) else {
        return Err(ProblemError::new("plan", "has no motion"));
    };
    let model = Model::of_hand(&problem.robot, &resting_joints(problem)?)?;
    if q_plan.len() != problem.robot.joints().len() || trajectory.joints() != q_plan.len() {
        return Err(ProblemError::new("plan", "is one for another robot"));
    }
    let (begin, end) = (trajectory.start(), trajectory.end());
    let met: Vec<f64> = plan.keyframes.iter().filter_map(|k| k.time).collect();
    let mut times: Vec<f64> = match &options.times {
        Some(times) => times.clone(),
        None => (1..WAYPOINTS as usize).map(|k| begin + (end - begin) * k as f64 / WAYPOINTS).collect(),
    };
    if let Some(time) = times.iter().find(|t| !(begin..=end).contains(*t)) {
        return Err(ProblemError::new("times", format!("{time} is not within the motion, {begin} to {end}")));
    }
    // A keyframe replaces a waypoint that is close to it in time.
    let close = 0.2 * (end - begin) / (times.len() + 1) as f64;
    times.retain(|t| met.iter().all(|m| (m - t).abs() > close));
    times.extend_from_slice(&met);
    times.extend([begin, end]);
    times.sort_by(f64::total_cmp);
    times.dedup_by(|b, a| *b - *a < 1e-9);
    let waypoints: Vec<Row> = times.iter().map(|t| trajectory.moving(*t)).collect();

    let mut placed = Placed::default();
    placed.place(&problem.robot, &model, &model.pick(q_plan));
    let motions = motions(problem, &placed.hand);
    let mut world = World::new(problem, &model);
    let entry = plan.keyframes.iter().position(|k| k.time.is_some()).unwrap_or(0);
    world.measure_start(State::still(&waypoints[0]), world.schedule.toward(entry));
    world.act_at(&model.pick(q_plan), motions.letting_go());
    let mut places = Vec::with_capacity(times.len());
    let mut former = 0.0;
    for (k, time) in times.iter().enumerate() {
        // Index of the next keyframe after this time, or of the keyframe at this time.
        let next = plan.keyframes.iter().position(|f| f.time.is_some_and(|t| *time <= t + 1e-9));
        let next = next.unwrap_or(plan.keyframes.len().saturating_sub(1)).max(entry);
        let is_keyframe = met.iter().any(|m| (m - time).abs() < 1e-9) || k + 1 == times.len();
        let past = next.checked_sub(motions.actuation + 1);
        let mut travel = former;
        if let (Some(post), Some(path)) = (past, next.checked_sub(1).and_then(|p| motions.paths.get(p))) {
            let from = plan.keyframes[next - 1].time.unwrap_or(begin);
            let to = plan.keyframes[next].time.unwrap_or(end);
            let share = if to > from { ((time - from) / (to - from)).clamp(0.0, 1.0) } else { 1.0 };
            travel = travel_over(problem, post, path, former, 0.0..share);
            if share >= 1.0 {
                former = travel;
            }
        }
        placed.place(&problem.robot, &model, &waypoints[k]);
        let kept = is_keyframe || (options.keep_paths && past.is_some());
        places.push(Place {
            segment: world.schedule.toward(next),
            travel,
            hand: (k > 0 && kept).then_some(placed.hand),
        });
    }
    let weights = problem.joint_weights(&model);
    let margins = Margins::plain(0.0);
    let mut work = Refinement { problem, model: &model, world, placed, weights, places, free: Vec::new(), margins };
    work.free = (1..waypoints.len()).map(|k| work.is_free(&waypoints, k)).collect();
    let cost_before = work.cost(&waypoints);
    let (waypoints, rounds) = work.run(waypoints);
    let cost_after = work.cost(&waypoints);
    let keyframes = met.iter().map(|m| times.partition_point(|t| *t < m - 1e-9)).collect();
    let full = |x: &Row| {
        let mut q = Vec::new();
        model.map().positions(x, &mut q);
        q
    };
    Ok(Refined { waypoints: waypoints.iter().map(full).collect(), times, keyframes, cost_before, cost_after, rounds })
}

impl Refinement<'_> {
    fn cost(&self, waypoints: &[Row]) -> f64 {
        let steps = waypoints.windows(2);
        steps.map(|w| (0..self.model.n()).map(|v| self.weights[v] * (w[1][v] - w[0][v]).powi(2)).sum::<f64>()).sum()
    }

    /// Returns whether the straight joint path to waypoint `k` from the previous one is collision-free.
    fn is_free(&mut self, waypoints: &[Row], k: usize) -> bool {
        let travel = [self.places[k - 1].travel, self.places[k].travel];
        let way = Way { waypoints: &waypoints[k - 1..=k], travel: &travel, off: &[] };
        self.world.sweep_along(way, self.places[k].segment, &self.margins).is_none()
    }

    fn run(&mut self, mut waypoints: Vec<Row>) -> (Vec<Row>, usize) {
        let mut cost = self.cost(&waypoints);
        let mut trust = TRUST;
        let mut rounds = 0;
        let mut bounds = self.bounds(&waypoints);
        while rounds < ROUNDS && trust > FINEST {
            rounds += 1;
            let boxes = self.boxes(&waypoints, trust);
            let program = Program {
                joints: self.model.n(),
                weights: &self.weights,
                waypoints: &waypoints,
                bounds: &bounds,
                boxes: &boxes,
            };
            let next = program.solve().and_then(|steps| self.stepped(&waypoints, &steps));
            match next {
                Some(next) if self.cost(&next) < cost => {
                    let saved = 1.0 - self.cost(&next) / cost;
                    cost = self.cost(&next);
                    waypoints = next;
                    if saved < SMALL {
                        break;
                    }
                    bounds = self.bounds(&waypoints);
                }
                _ => trust *= 0.4,
            }
        }
        (waypoints, rounds)
    }

    /// Returns the waypoints after a step, corrected so that the hand has its required poses. `None` if a hand pose
    /// cannot be reached, a joint limit is exceeded or the path collides.
    fn stepped(&mut self, waypoints: &[Row], steps: &[Row]) -> Option<Vec<Row>> {
        let n = self.model.n();
        let mut out = waypoints.to_vec();
        for (k, x) in out.iter_mut().enumerate().skip(1) {
            for v in 0..n {
                x[v] += steps[k][v];
            }
            if let Some(hand) = self.places[k].hand {
                *x = self.brought_to(&hand, x)?;
            }
            let (low, high) = self.limits(&waypoints[k]);
            if (0..n).any(|v| x[v] < low[v] - 1e-9 || x[v] > high[v] + 1e-9) {
                return None;
            }
        }
        (1..out.len()).all(|k| !self.free[k - 1] || self.is_free(&out, k)).then_some(out)
    }

    /// Returns joints near `x` with the hand at the position of `hand`, and rotated from it by at most `TURN`.
    fn brought_to(&mut self, hand: &Pose, x: &Row) -> Option<Row> {
        let n = self.model.n();
        let mut x = *x;
        for _ in 0..6 {
            self.placed.place(&self.problem.robot, self.model, &x);
            let here = self.placed.hand;
            let way = hand.translation.vector - here.translation.vector;
            if way.amax() < EXACT {
                let turn = rotation_log(&(here.rotation * hand.rotation.inverse()));
                return (turn.norm() <= TURN).then_some(x);
            }
            let rows = self.placed.point_rows(&here.translation.vector);
            let gram = Matrix3::from_fn(|r, c| (0..n).map(|v| rows[r][v] * rows[c][v]).sum());
            let pull = gram.cholesky()?.solve(&way);
            for v in 0..n {
                x[v] += (0..3).map(|r| rows[r][v] * pull[r]).sum::<f64>();
            }
        }
        None
    }

    /// Returns the joint limits, widened if the waypoint `x` lies outside.
    fn limits(&self, x: &Row) -> (Row, Row) {
        let (mut low, mut high) = (*x, *x);
        for v in 0..self.model.n() {
            low[v] = low[v].min(self.model.lower[v] + LIMIT_MARGIN);
            high[v] = high[v].max(self.model.upper[v] - LIMIT_MARGIN);
        }
        (low, high)
    }

    fn boxes(&self, waypoints: &[Row], trust: f64) -> Vec<(Row, Row)> {
        let boxed = |x: &Row| {
            let (mut low, mut high) = self.limits(x);
            for v in 0..self.model.n() {
                low[v] = (low[v] - x[v]).max(-trust);
                high[v] = (high[v] - x[v]).min(trust);
            }
            (low, high)
        };
        waypoints.iter().map(boxed).collect()
    }

    /// Returns the bounds on hand poses and clearances, linearized at the waypoints.
    fn bounds(&mut self, waypoints: &[Row]) -> Vec<Bound> {
        let n = self.model.n();
        // This cube lies inside the sphere of permitted rotations.
        let turn_bound = 0.99 * TURN / 3.0_f64.sqrt();
        let mut out = Vec::new();
        for k in 1..waypoints.len() {
            if let Some(hand) = self.places[k].hand {
                self.placed.place(&self.problem.robot, self.model, &waypoints[k]);
                let here = self.placed.hand;
                let way = hand.translation.vector - here.translation.vector;
                let turn = rotation_log(&(here.rotation * hand.rotation.inverse()));
                let rows = self.placed.point_rows(&here.translation.vector);
                for r in 0..3 {
                    out.push(Bound { parts: vec![(k, rows[r])], low: way[r], high: way[r] });
                    let row = self.placed.angular_row(&Vector3::ith(r, 1.0));
                    let (low, high) = (-turn_bound - turn[r], turn_bound - turn[r]);
                    out.push(Bound { parts: vec![(k, row)], low: low.min(0.0), high: high.max(0.0) });
                }
            }
            if !self.free[k - 1] {
                continue;
            }
            let mut near: Vec<Clearance> = Vec::new();
            let mut middle = waypoints[k];
            for v in 0..n {
                middle[v] = 0.5 * (waypoints[k - 1][v] + waypoints[k][v]);
            }
            let (place, before) = (&self.places[k], &self.places[k - 1]);
            let half = 0.5 * (place.travel + before.travel);
            for (state, share) in
                [(State { x: &waypoints[k], travel: place.travel }, 1.0), (State { x: &middle, travel: half }, 0.5)]
            {
                near.clear();
                self.world.clearances(state, place.segment, &self.margins, REACH, &mut near);
                for c in &near {
                    let low = -c.gap.max(0.0);
                    let row = c.gradient.map(|g| share * g);
                    let mut parts = vec![(k, row)];
                    if share < 1.0 {
                        parts.push((k - 1, row));
                    }
                    out.push(Bound { parts, low, high: f64::INFINITY });
                }
            }
        }
        out
    }
}

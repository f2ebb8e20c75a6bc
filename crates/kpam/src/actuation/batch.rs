//! Projects eight start values at a time onto the constraints, in single precision, by damped Gauss-Newton as in
//! `projection`. Results are refined in double precision, so that they do not depend on rounding here.

use std::f64::consts::TAU;

use gensim2_geometry::lanes::{F32x8, WIDTH, wide};
use gensim2_geometry::{Frames, JointKind, Pose, Posing};
use nalgebra::Vector3;

use super::bands::any_across;
use super::look::Look;
use super::projection::{INNER, PATIENCE, SLACK};
use super::step::{Step, Take};
use crate::KeypointProblem;
use crate::model::{DrivenJoint, MAX_JOINTS, Model, Row};
use crate::resolve::Resolved;

/// Residuals below this (m or rad) count as rounding errors.
const ROUNDING: f64 = 4e-6;
/// Minimum, initial and maximum damping: less would vanish in rounding, and more would make no progress.
const DAMPING: [f32; 3] = [1e-6, 1e-3, 1e3];

/// One number for each variable, in eight SIMD lanes.
pub(super) type Lanes = [F32x8; MAX_JOINTS];
/// Normal equations of a Gauss-Newton step: half the gradient of the squared residuals, and the lower triangle of the
/// sum of outer products of the residuals' gradients.
#[derive(Debug, Clone)]
pub(super) struct Normal {
    pub gradient: Lanes,
    pub matrix: [Lanes; MAX_JOINTS],
}

impl Normal {
    const ZERO: Self = Self { gradient: [F32x8::ZERO; MAX_JOINTS], matrix: [[F32x8::ZERO; MAX_JOINTS]; MAX_JOINTS] };
}

pub(super) type Single = [f32; 3];

/// A joint of the chain from base to hand that moves the hand.
pub(super) struct Column {
    pub link: usize,
    pub variable: usize,
    /// Axis in the link's frame, multiplied by the mimic factor between the joint and its variable.
    pub axis: Single,
    pub turns: bool,
}

pub(super) struct Axis {
    pub on_hand: Single,
    pub target: Single,
    /// A direction perpendicular to the target; any of them will do.
    pub across: Single,
    /// Minimum and maximum angle (rad) for which the residual is zero.
    pub range: [f32; 2],
}

/// A cost term: weight times the squared distance of a hand point from a plane.
pub(super) struct Plane {
    pub on_hand: Single,
    pub target: Single,
    pub normal: Single,
    pub weight: f32,
}

/// Constraints and cost of a problem, for eight joint vectors at a time.
pub(super) struct BatchProjection {
    pub posing: Posing,
    pub hand: usize,
    pub n: usize,
    pub rest: Vec<F32x8>,
    pub driven: Vec<DrivenJoint>,
    pub columns: Vec<Column>,
    pub points: Vec<[Single; 2]>,
    pub axes: Vec<Axis>,
    pub workspace: Option<[Single; 2]>,
    pub lower: [f32; MAX_JOINTS],
    pub upper: [f32; MAX_JOINTS],
    /// Two limits on the squared norm of the residuals. Below the first, a projection has converged; below the second,
    /// the pose may be within the tolerances.
    pub near: [f32; 2],
    /// Weights of the joints' steps relative to their mean.
    pub metric: [f32; MAX_JOINTS],
    /// Weight of each joint's squared step in the cost.
    pub weights: [f32; MAX_JOINTS],
    /// Joint vector at the start, from which costs are measured, with unlimited joints shifted close to zero; rotation
    /// (by rows) and position of the hand there.
    pub begin: Row,
    pub begin_turn: [Single; 3],
    pub begin_at: Single,
    pub costs: Vec<Plane>,
    pub endless: [bool; MAX_JOINTS],
    pub q: Vec<F32x8>,
    pub frames: Vec<Frames>,
}

/// Returns the weights divided by their mean, limited to 0.03..30 for single precision.
fn metric(weights: &[f64]) -> [f32; MAX_JOINTS] {
    let mean = weights.iter().sum::<f64>() / weights.len().max(1) as f64;
    let mut out = [1.0; MAX_JOINTS];
    out.iter_mut().zip(weights).for_each(|(m, w)| *m = (w / mean).clamp(0.03, 30.0) as f32);
    out
}

/// A start value of a projection, with the damping of its first step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seed {
    pub x: Row,
    damping: f32,
}

impl Seed {
    pub fn at(x: Row) -> Self {
        Self { x, damping: DAMPING[1] }
    }
}

/// Result of the projection of a start value.
#[derive(Debug, Clone, Copy)]
pub(super) struct Arrival {
    pub seed: Seed,
    /// Cost of the pose, computed in single precision.
    pub cost: f32,
    /// Sum of squared residuals (m², rad²).
    pub miss: f32,
    /// Whether the pose may meet the constraints; this is decided in double precision later.
    pub near: bool,
    /// Whether the projection has not converged yet but may converge with more steps.
    pub late: bool,
}

/// Progress of the projection in one SIMD lane.
#[derive(Clone, Copy)]
struct Seat {
    /// Index of the start value; `None` if the lane is unused.
    start: Option<usize>,
    rounds: usize,
    milestone: f32,
}

fn single(v: &Vector3<f64>) -> Single {
    [v.x as f32, v.y as f32, v.z as f32]
}

impl BatchProjection {
    /// Prepares the constraints and cost of a problem. `hand` is the hand pose at the start, and `near` the norm of the
    /// residuals below which a projection has converged.
    pub fn new(problem: &KeypointProblem, model: &Model, resolved: &Resolved, hand: &Pose, near: f64) -> Self {
        let (robot, weights) = (&problem.robot, problem.joint_weights(model));
        let joints = robot.joints();
        let chain: Vec<usize> = robot.chain().joint_indices().collect();
        let link_of = |joint: usize| robot.links().iter().position(|l| l.joint() == Some(joint));
        let columns = model.columns().iter().filter_map(|&(i, variable, factor)| {
            let joint = chain[i];
            Some(Column {
                link: link_of(joint)?,
                variable,
                axis: single(&(joints[joint].axis() * factor)),
                turns: joints[joint].kind() == JointKind::Revolute,
            })
        });
        let axes = resolved.axes.iter().map(|a| {
            let slack = SLACK * a.tolerance;
            Axis {
                on_hand: single(&a.on_hand),
                target: single(&a.target),
                across: single(&any_across(&a.target)),
                range: [(a.center - slack) as f32, (a.center + slack) as f32],
            }
        });
        let costs = resolved.costs.iter().map(|t| Plane {
            on_hand: single(&t.on_hand),
            target: single(&t.target),
            normal: single(&t.normal),
            weight: t.weight as f32,
        });
        let inside = |[low, high]: [[f64; 3]; 2]| {
            let inner = |k: usize| INNER.min(0.25 * (high[k] - low[k]));
            [[0, 1, 2].map(|k| (low[k] + inner(k)) as f32), [0, 1, 2].map(|k| (high[k] - inner(k)) as f32)]
        };
        let limits = |values: &Row| std::array::from_fn(|v| values[v] as f32);
        let near = near.max(ROUNDING);
        // Constraints that contradict each other slightly may all be within tolerance with nonzero residuals.
        let tolerances = resolved.points.iter().map(|p| p.tolerance).chain(resolved.axes.iter().map(|a| a.tolerance));
        let reach = near + tolerances.map(|t| 3.0 * t * t).sum::<f64>().sqrt();
        Self {
            posing: Posing::new(robot, |l| l == robot.hand()),
            hand: robot.hand(),
            n: model.n().min(MAX_JOINTS),
            rest: model.map().rest().iter().map(|v| F32x8::splat(*v as f32)).collect(),
            driven: model.map().driven().to_vec(),
            columns: columns.collect(),
            points: resolved.points.iter().map(|p| [single(&p.on_hand), single(&p.target)]).collect(),
            axes: axes.collect(),
            workspace: problem.options.workspace.map(inside),
            lower: limits(&model.lower),
            upper: limits(&model.upper),
            near: [(near * near) as f32, (reach * reach) as f32],
            weights: std::array::from_fn(|v| weights[v] as f32),
            begin_turn: [0, 1, 2].map(|i| [0, 1, 2].map(|j| hand.rotation[(i, j)] as f32)),
            begin_at: single(&hand.translation.vector),
            costs: costs.collect(),
            metric: metric(&weights[..model.n().min(MAX_JOINTS)]),
            begin: model.unwound(&model.start(), &[0.0; MAX_JOINTS]),
            endless: *model.endless(),
            q: Vec::new(),
            frames: Vec::new(),
        }
    }

    /// Projects start values onto the constraints with at most `rounds` steps each; keeps the order of `seeds`.
    pub fn project(&mut self, seeds: &[Seed], rounds: usize) -> Vec<Arrival> {
        let nowhere = Seed::at([0.0; MAX_JOINTS]);
        let nothing = Arrival { seed: nowhere, cost: f32::INFINITY, miss: f32::INFINITY, near: false, late: false };
        let mut out = vec![nothing; seeds.len()];
        let (mut cost, mut begin) = (F32x8::ZERO, [F32x8::ZERO; MAX_JOINTS]);
        let (mut x, mut trial) = ([F32x8::ZERO; MAX_JOINTS], [F32x8::ZERO; MAX_JOINTS]);
        let (mut norm, mut damping) = ([f32::INFINITY; WIDTH], [DAMPING[1]; WIDTH]);
        let mut equations = [Normal::ZERO, Normal::ZERO];
        let [one, two] = &mut equations;
        let (mut normal, mut trial_normal) = (one, two);
        let mut seats = [Seat { start: None, rounds: 0, milestone: f32::INFINITY }; WIDTH];
        let mut next_start = 0;
        loop {
            // If all lanes have just received new start values, no step was made that could be evaluated.
            if seats.iter().any(|seat| seat.start.is_some()) {
                trial = wide(Step { batch: self, x: &x, normal, damping: F32x8::new(damping) });
            }
            for (lane, seat) in seats.iter_mut().enumerate().filter(|(_, seat)| seat.start.is_none()) {
                // The first evaluation of a start value is always accepted. Unused lanes repeat the first start value.
                let start = seeds.get(next_start).or(seeds.first());
                for (v, value) in start.into_iter().flat_map(|seed| &seed.x).take(self.n).enumerate() {
                    trial[v].set(lane, (*value as f32).clamp(self.lower[v], self.upper[v]));
                    let turns = if self.endless[v] { ((*value - self.begin[v]) / TAU).round() } else { 0.0 };
                    begin[v].set(lane, (self.begin[v] + TAU * turns) as f32);
                }
                norm[lane] = f32::INFINITY;
                damping[lane] = start.map_or(DAMPING[1], |seed| seed.damping);
                let taken = (next_start < seeds.len()).then_some(next_start);
                *seat = Seat { start: taken, rounds: 0, milestone: f32::INFINITY };
                next_start += usize::from(taken.is_some());
            }
            if seats.iter().all(|seat| seat.start.is_none()) {
                return out;
            }
            // After this evaluation, no lane makes another step.
            let last = seats.iter().all(|seat| seat.start.is_none() || seat.rounds >= rounds);
            let [next, new_cost] = self.look(&trial, &begin, (!last).then_some(&mut *trial_normal));
            let after = next.to_array();
            if after.iter().zip(&norm).all(|(after, before)| after < before) {
                (x, cost) = (trial, new_cost);
                std::mem::swap(&mut normal, &mut trial_normal);
            } else {
                let (cost, x, normal) = (&mut cost, &mut x, &mut *normal);
                let (trial, new) = (&trial, &*trial_normal);
                wide(Take { n: self.n, before: F32x8::new(norm), after: next, cost, new_cost, x, trial, normal, new });
            }
            for (lane, seat) in seats.iter_mut().enumerate() {
                let Some(start) = seat.start else { continue };
                let taken = after[lane] < norm[lane];
                let left = if taken { after[lane] } else { norm[lane] };
                norm[lane] = left;
                if seat.rounds == 0 {
                    seat.milestone = left;
                } else {
                    damping[lane] = if taken { (0.2 * damping[lane]).max(DAMPING[0]) } else { 10.0 * damping[lane] };
                }
                let due = seat.rounds > 0 && seat.rounds.is_multiple_of(PATIENCE);
                let lost = damping[lane] > DAMPING[2];
                let stuck = due && left > 0.5 * seat.milestone || lost;
                if due {
                    seat.milestone = left;
                }
                let arrived = left < self.near[0];
                if arrived || stuck || seat.rounds >= rounds {
                    let mut end = [0.0; MAX_JOINTS];
                    for v in 0..self.n {
                        end[v] = f64::from(x[v].to_array()[lane]);
                    }
                    let near = left < self.near[1];
                    let seed = Seed { x: end, damping: damping[lane] };
                    let late = !(near || stuck);
                    out[start] = Arrival { seed, cost: cost.to_array()[lane], miss: left, near, late };
                    seat.start = None;
                }
                seat.rounds += 1;
            }
        }
    }

    /// Returns the sum of squared residuals and the cost. Residuals are zero within the constraints. On request, also
    /// computes the normal equations.
    fn look(&mut self, x: &Lanes, begin: &Lanes, normal: Option<&mut Normal>) -> [F32x8; 2] {
        let mut q = std::mem::take(&mut self.q);
        let mut frames = std::mem::take(&mut self.frames);
        q.clear();
        q.extend_from_slice(&self.rest);
        for d in &self.driven {
            q[d.joint] = x[d.variable] * d.factor as f32 + F32x8::splat(d.offset as f32);
        }
        self.posing.place(&q, &mut frames);
        let seen = wide(Look { batch: self, frames: &frames, x, begin, normal });
        (self.q, self.frames) = (q, frames);
        seen
    }
}

#[cfg(test)]
mod tests {
    use super::super::ActuationSearch;
    use super::super::projection::PROJECTIONS;
    use super::super::tests::problem;
    use super::*;
    use crate::resolve::PlaneTerm;

    #[test]
    fn eight_at_a_time_arrive_where_one_at_a_time_does() {
        let problem = problem(-1.0, 0.02, [0.5, 0.1, 0.3]);
        let model = Model::new(&problem.robot, &problem.q_start).unwrap();
        let resolved = problem.resolve().unwrap();
        let mut search = ActuationSearch::new(&problem, &model, &resolved);
        let seeds: Vec<Seed> = (0..41).map(|k| Seed::at(search.start(k))).collect();
        let found = search.batch.project(&seeds, PROJECTIONS);
        assert_eq!(found.len(), seeds.len());
        let (mut arrived, mut same) = (0, 0);
        for (start, Arrival { seed: Seed { x: end, .. }, near: there, .. }) in seeds.iter().zip(&found) {
            let mut alone = start.x;
            let single = search.project(&mut alone) <= 0.0;
            arrived += usize::from(*there);
            if *there {
                let (mut home, before) = (*end, search.violation(end));
                assert!(before < 0.05 && search.project(&mut home) <= 0.0, "{before}");
            }
            // The steps in single and in double precision must agree except for rounding.
            if *there && single {
                same += usize::from(model.are_near(&alone, end, 0.01));
            }
        }
        let alone = seeds.iter().filter(|start| search.project(&mut start.x.clone()) <= 0.0).count();
        assert!(arrived > 8 && arrived.abs_diff(alone) <= 3, "{arrived} {alone}");
        assert!(4 * same > 3 * arrived, "{same} of {arrived}");
    }

    #[test]
    fn the_cost_of_eight_at_a_time_is_that_of_one() {
        let mut problem = problem(-1.0, 0.02, [0.5, 0.1, 0.3]);
        problem.options.joint_weights = Some(vec![10.0, 0.3, 1.0, 2.0, 1.0, 5.0]);
        let model = Model::new(&problem.robot, &problem.q_start).unwrap();
        let mut resolved = problem.resolve().unwrap();
        let plane = |normal: [f64; 3], weight: f64| PlaneTerm {
            on_hand: Vector3::new(0.1, -0.05, 0.2),
            target: Vector3::new(0.3, 0.2, 0.1),
            normal: normal.into(),
            weight,
        };
        resolved.costs = vec![plane([0.6, 0.0, 0.8], 3.0), plane([0.0, 1.0, 0.0], 0.7)];
        let mut search = ActuationSearch::new(&problem, &model, &resolved);
        let seeds: Vec<Seed> = (0..43).map(|k| Seed::at(search.start(k))).collect();
        // With zero steps, the start values themselves are returned.
        let begun = search.batch.project(&seeds, 0);
        for (seed, there) in seeds.iter().zip(&begun) {
            let wanted = search.cost(&seed.x);
            assert!((f64::from(there.cost) - wanted).abs() < 1e-5 * (1.0 + wanted), "{} {wanted}", there.cost);
        }
    }
}

//! Onto the constraints, eight seeds at a time and in single precision: damped Gauss-Newton as in `projection`. What
//! arrives is brought home in double precision, so nothing that is found depends on how numbers are rounded here.

use gensim2_geometry::lanes::{F32x8, WIDTH, Wide, wide};
use gensim2_geometry::{Frames, JointKind, Posing, Robot};
use nalgebra::Vector3;

use super::bands::any_across;
use super::projection::{INNER, PATIENCE, PROJECTIONS, SLACK, STEP};
use crate::model::{DrivenJoint, MAX_JOINTS, Model, Row};
use crate::resolve::Resolved;

/// Smaller residuals than this (m or rad) are rounding.
const ROUNDING: f64 = 4e-6;
/// Damping stays within this: less is rounding, more is no way on.
const DAMPING: [f32; 3] = [1e-6, 1e-3, 1e3];

/// One number a variable.
type Lanes = [F32x8; MAX_JOINTS];
/// A residual with its gradient.
type Line = (Lanes, F32x8);
type Single = [f32; 3];

/// A joint that moves the hand.
struct Column {
    link: usize,
    variable: usize,
    factor: f32,
    axis: Single,
    turns: bool,
}

struct Axis {
    on_hand: Single,
    target: Single,
    /// Some direction across the target.
    across: Single,
    /// Least and greatest angle that is not pulled.
    range: [f32; 2],
}

/// The constraints of a problem, for eight joint vectors at a time.
pub(super) struct BatchProjection {
    posing: Posing,
    hand: usize,
    n: usize,
    rest: Vec<F32x8>,
    driven: Vec<DrivenJoint>,
    columns: Vec<Column>,
    points: Vec<[Single; 2]>,
    axes: Vec<Axis>,
    workspace: Option<[Single; 2]>,
    lower: [f32; MAX_JOINTS],
    upper: [f32; MAX_JOINTS],
    /// Squared norm of residuals below which a projection has arrived, and below which it may be within the tolerances.
    near: [f32; 2],
    q: Vec<F32x8>,
    frames: Vec<Frames>,
}

/// State of the start in one lane.
#[derive(Clone, Copy)]
struct Seat {
    /// Number of the start; none where the lane is empty.
    start: Option<usize>,
    rounds: usize,
    milestone: f32,
}

fn single(v: &Vector3<f64>) -> Single {
    [v.x as f32, v.y as f32, v.z as f32]
}

impl BatchProjection {
    /// `near` is what residuals have to be less than together.
    pub fn new(robot: &Robot, model: &Model, resolved: &Resolved, workspace: Option<[[f64; 3]; 2]>, near: f64) -> Self {
        let joints = robot.joints();
        let chain: Vec<usize> = robot.chain().joint_indices().collect();
        let link_of = |joint: usize| robot.links().iter().position(|l| l.joint() == Some(joint));
        let columns = model.columns().iter().filter_map(|&(i, variable, factor)| {
            let joint = chain[i];
            Some(Column {
                link: link_of(joint)?,
                variable,
                factor: factor as f32,
                axis: single(joints[joint].axis()),
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
        let inside = |[low, high]: [[f64; 3]; 2]| {
            let inner = |k: usize| INNER.min(0.25 * (high[k] - low[k]));
            [[0, 1, 2].map(|k| (low[k] + inner(k)) as f32), [0, 1, 2].map(|k| (high[k] - inner(k)) as f32)]
        };
        let limits = |values: &Row| std::array::from_fn(|v| values[v] as f32);
        let near = near.max(ROUNDING);
        // Constraints that contradict each other a little are met without any residual vanishing.
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
            workspace: workspace.map(inside),
            lower: limits(&model.lower),
            upper: limits(&model.upper),
            near: [(near * near) as f32, (reach * reach) as f32],
            q: Vec::new(),
            frames: Vec::new(),
        }
    }

    /// Takes seeds onto the constraints: where each ends, in their order, and whether it may meet them there.
    pub fn project(&mut self, seeds: &[Row]) -> Vec<(Row, bool)> {
        let mut out = vec![([0.0; MAX_JOINTS], false); seeds.len()];
        let (mut x, mut norm) = ([F32x8::ZERO; MAX_JOINTS], F32x8::splat(f32::INFINITY));
        let mut damping = F32x8::splat(DAMPING[1]);
        let (mut lines, mut trial_lines): (Vec<Line>, Vec<Line>) = (Vec::new(), Vec::new());
        let mut seats = [Seat { start: None, rounds: 0, milestone: f32::INFINITY }; WIDTH];
        let mut next_start = 0;
        loop {
            let mut trial = wide(Step { batch: self, x: &x, lines: &lines, damping });
            for (lane, seat) in seats.iter_mut().enumerate().filter(|(_, seat)| seat.start.is_none()) {
                // A start is a step that is always taken; lanes that are left over take up what others began with.
                let start = seeds.get(next_start).or(seeds.first());
                for (v, value) in start.into_iter().flatten().take(self.n).enumerate() {
                    trial[v].set(lane, (*value as f32).clamp(self.lower[v], self.upper[v]));
                }
                norm.set(lane, f32::INFINITY);
                damping.set(lane, DAMPING[1]);
                let taken = (next_start < seeds.len()).then_some(next_start);
                *seat = Seat { start: taken, rounds: 0, milestone: f32::INFINITY };
                next_start += usize::from(taken.is_some());
            }
            if seats.iter().all(|seat| seat.start.is_none()) {
                return out;
            }
            let next = self.look(&trial, &mut trial_lines);
            if lines.len() == trial_lines.len() {
                wide(Take {
                    before: norm,
                    after: next,
                    x: &mut x,
                    trial: &trial,
                    lines: &mut lines,
                    new: &trial_lines,
                });
            } else {
                x = trial;
                std::mem::swap(&mut lines, &mut trial_lines);
            }
            let (before, after) = (norm.to_array(), next.to_array());
            for (lane, seat) in seats.iter_mut().enumerate() {
                let Some(start) = seat.start else { continue };
                let damped = damping.to_array()[lane];
                let taken = after[lane] < before[lane];
                damping.set(lane, if taken { (0.2 * damped).max(DAMPING[0]) } else { 10.0 * damped });
                let left = if taken { after[lane] } else { before[lane] };
                norm.set(lane, left);
                if seat.rounds == 0 {
                    seat.milestone = left;
                }
                let late = seat.rounds > 0 && seat.rounds.is_multiple_of(PATIENCE);
                let stuck = late && left > 0.5 * seat.milestone;
                if late {
                    seat.milestone = left;
                }
                let arrived = left < self.near[0];
                if arrived || stuck || seat.rounds >= PROJECTIONS || damping.to_array()[lane] > DAMPING[2] {
                    let mut end = [0.0; MAX_JOINTS];
                    for v in 0..self.n {
                        end[v] = f64::from(x[v].to_array()[lane]);
                    }
                    out[start] = (end, left < self.near[1]);
                    seat.start = None;
                }
                seat.rounds += 1;
            }
        }
    }

    /// Residuals that vanish inside the constraints, with their gradients; the sum of their squares.
    fn look(&mut self, x: &Lanes, lines: &mut Vec<Line>) -> F32x8 {
        let mut q = std::mem::take(&mut self.q);
        let mut frames = std::mem::take(&mut self.frames);
        q.clear();
        q.extend_from_slice(&self.rest);
        for d in &self.driven {
            q[d.joint] = x[d.variable] * d.factor as f32 + F32x8::splat(d.offset as f32);
        }
        self.posing.place(&q, &mut frames);
        lines.clear();
        let sum = wide(Look { batch: self, frames: &frames, lines });
        (self.q, self.frames) = (q, frames);
        sum
    }
}

/// Takes steps where they lead nearer.
struct Take<'a> {
    before: F32x8,
    after: F32x8,
    x: &'a mut Lanes,
    trial: &'a Lanes,
    lines: &'a mut [Line],
    new: &'a [Line],
}

impl Wide for Take<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { before, after, x, trial, lines, new } = self;
        for v in 0..MAX_JOINTS {
            x[v] = after.below(before, trial[v], x[v]);
        }
        for i in 0..lines.len().min(new.len()) {
            let ((row, r), (other, s)) = (&mut lines[i], &new[i]);
            for v in 0..MAX_JOINTS {
                row[v] = after.below(before, other[v], row[v]);
            }
            *r = after.below(before, *s, *r);
        }
    }
}

/// A look at where the hand is.
struct Look<'a> {
    batch: &'a BatchProjection,
    frames: &'a [Frames],
    lines: &'a mut Vec<Line>,
}

type Vector = [F32x8; 3];

#[inline(always)]
fn cross(a: &Vector, b: &Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
fn dot(a: &Vector, b: &Vector) -> F32x8 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn splat(v: &Single) -> Vector {
    [F32x8::splat(v[0]), F32x8::splat(v[1]), F32x8::splat(v[2])]
}

impl Wide for Look<'_> {
    type Output = F32x8;

    #[inline(always)]
    fn run(self) -> F32x8 {
        let Self { batch, frames, lines } = self;
        let zero = F32x8::ZERO;
        // Turn, and velocity of the point at the base origin, of each column.
        let mut columns = [([zero; 3], [zero; 3]); MAX_JOINTS];
        let count = batch.columns.len().min(MAX_JOINTS);
        for k in 0..count {
            let column = &batch.columns[k];
            let frame = &frames[column.link];
            let axis = frame.direction(&column.axis);
            let axis = [axis[0] * column.factor, axis[1] * column.factor, axis[2] * column.factor];
            columns[k] = if column.turns { (axis, cross(&frame.t, &axis)) } else { ([zero; 3], axis) };
        }
        let hand = &frames[batch.hand];
        let mut sum = zero;
        for p in &batch.points {
            let at = hand.point(&p[0]);
            let mut rows = [[zero; MAX_JOINTS]; 3];
            for k in 0..count {
                let (turn, shift) = &columns[k];
                let way = cross(turn, &at);
                let v = batch.columns[k].variable;
                for e in 0..3 {
                    rows[e][v] = rows[e][v] + shift[e] + way[e];
                }
            }
            for e in 0..3 {
                let miss = at[e] - F32x8::splat(p[1][e]);
                sum = sum + miss * miss;
                lines.push((rows[e], miss));
            }
        }
        for a in &batch.axes {
            let u = hand.direction(&a.on_hand);
            let target = splat(&a.target);
            let between = cross(&u, &target);
            let sin = dot(&between, &between).sqrt();
            let angle = F32x8::angle(sin, dot(&u, &target));
            let miss = angle - angle.max(F32x8::splat(a.range[0])).min(F32x8::splat(a.range[1]));
            let flat = F32x8::splat(1e-5);
            let scale = F32x8::ONE / sin.max(flat);
            let across = splat(&a.across);
            let mut row = [zero; MAX_JOINTS];
            let mut normal = [zero; 3];
            for e in 0..3 {
                normal[e] = sin.below(flat, across[e], between[e] * scale);
            }
            for k in 0..count {
                let v = batch.columns[k].variable;
                row[v] = row[v] - dot(&normal, &columns[k].0);
            }
            sum = sum + miss * miss;
            lines.push((row, miss));
        }
        if let Some([low, high]) = &batch.workspace {
            for e in 0..3 {
                let c = hand.t[e];
                let miss = c - c.max(F32x8::splat(low[e])).min(F32x8::splat(high[e]));
                let mut row = [zero; MAX_JOINTS];
                for k in 0..count {
                    let (turn, shift) = &columns[k];
                    let v = batch.columns[k].variable;
                    // Where the hand is inside, nothing pulls.
                    let way = shift[e] + cross(turn, &hand.t)[e];
                    row[v] = row[v] + zero.below(miss.abs(), way, zero);
                }
                sum = sum + miss * miss;
                lines.push((row, miss));
            }
        }
        sum
    }
}

/// The next step of every lane.
struct Step<'a> {
    batch: &'a BatchProjection,
    x: &'a Lanes,
    lines: &'a [Line],
    damping: F32x8,
}

impl Wide for Step<'_> {
    type Output = Lanes;

    #[inline(always)]
    fn run(self) -> Lanes {
        // Arms have six or seven joints: for those the compiler unrolls all loops.
        match self.batch.n {
            6 => self.of(6),
            7 => self.of(7),
            n => self.of(n),
        }
    }
}

impl Step<'_> {
    #[inline(always)]
    fn of(self, n: usize) -> Lanes {
        let Self { batch, x, lines, damping } = self;
        let n = n.min(MAX_JOINTS);
        let zero = F32x8::ZERO;
        let mut gradient = [zero; MAX_JOINTS];
        let mut normal = [[zero; MAX_JOINTS]; MAX_JOINTS];
        for (row, r) in lines {
            for i in 0..n {
                gradient[i] = gradient[i] + row[i] * *r;
                for k in 0..=i {
                    normal[i][k] = normal[i][k] + row[i] * row[k];
                }
            }
        }
        for v in 0..n {
            // Joints at a limit that would be pushed further stay there.
            let (low, high) = (F32x8::splat(batch.lower[v]), F32x8::splat(batch.upper[v]));
            let down = low.below(x[v], F32x8::ONE, zero.below(gradient[v], zero, F32x8::ONE));
            let up = x[v].below(high, F32x8::ONE, gradient[v].below(zero, zero, F32x8::ONE));
            let moves = down * up;
            gradient[v] = gradient[v] * moves;
            for k in 0..n {
                if k != v {
                    let (i, j) = if v > k { (v, k) } else { (k, v) };
                    normal[i][j] = normal[i][j] * moves;
                }
            }
            normal[v][v] = normal[v][v] * moves + (F32x8::ONE - moves) + damping;
        }
        // An LDL factorization, and the step that it gives.
        let mut l = [[zero; MAX_JOINTS]; MAX_JOINTS];
        let mut scaled = [[zero; MAX_JOINTS]; MAX_JOINTS];
        let mut inverse = [zero; MAX_JOINTS];
        let mut step = [zero; MAX_JOINTS];
        for i in 0..n {
            let mut rest = zero - gradient[i];
            let mut pivot = normal[i][i];
            for k in 0..i {
                let mut sum = normal[i][k];
                for m in 0..k {
                    sum = sum - l[i][m] * scaled[k][m];
                }
                scaled[i][k] = sum;
                l[i][k] = sum * inverse[k];
                pivot = pivot - l[i][k] * sum;
                rest = rest - l[i][k] * step[k];
            }
            inverse[i] = F32x8::ONE / pivot;
            step[i] = rest;
        }
        let mut longest = zero;
        for i in (0..n).rev() {
            let mut sum = step[i] * inverse[i];
            for k in i + 1..n {
                sum = sum - l[k][i] * step[k];
            }
            step[i] = sum;
            longest = longest.max(sum.abs());
        }
        let most = F32x8::splat(STEP as f32);
        let shrink = most / longest.max(most);
        let mut out = *x;
        for v in 0..n {
            let moved = x[v] + step[v] * shrink;
            out[v] = moved.max(F32x8::splat(batch.lower[v])).min(F32x8::splat(batch.upper[v]));
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::super::ActuationSearch;
    use super::super::tests::problem;
    use super::*;

    #[test]
    fn eight_at_a_time_arrive_where_one_at_a_time_does() {
        let problem = problem(-1.0, 0.02, [0.5, 0.1, 0.3]);
        let model = Model::new(&problem.robot, &problem.q_start).unwrap();
        let resolved = problem.resolve().unwrap();
        let mut search = ActuationSearch::new(&problem, &model, &resolved);
        let seeds: Vec<Row> = (0..41).map(|k| search.start(k)).collect();
        let found = search.batch.project(&seeds);
        assert_eq!(found.len(), seeds.len());
        let (mut arrived, mut same) = (0, 0);
        for (start, (end, there)) in seeds.iter().zip(&found) {
            let mut alone = *start;
            let single = search.project(&mut alone) <= 0.0;
            arrived += usize::from(*there);
            if *there {
                let (mut home, before) = (*end, search.violation(end));
                assert!(before < 0.05 && search.project(&mut home) <= 0.0, "{before}");
            }
            // Steps are the same but for rounding.
            if *there && single {
                same += usize::from(model.are_near(&alone, end, 0.01));
            }
        }
        let alone = seeds.iter().filter(|start| search.project(&mut (**start).clone()) <= 0.0).count();
        assert!(arrived > 8 && arrived.abs_diff(alone) <= 3, "{arrived} {alone}");
        assert!(4 * same > 3 * arrived, "{same} of {arrived}");
    }
}

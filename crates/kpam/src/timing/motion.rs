//! A piece of a trajectory: cubics between nodes, averaged over a short time window, or quintics between nodes.

use serde::{Deserialize, Serialize};

use super::limits::Limits;
use crate::model::{MAX_JOINTS, Row};

/// Position and velocity of every joint at one time.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Node {
    /// Time (s).
    pub time: f64,
    pub position: Row,
    pub velocity: Row,
    /// Acceleration, if known and continuous; positions of nodes close in time determine it inaccurately.
    pub acceleration: Option<Row>,
}

/// Accelerations below this (rad/s^2 or m/s^2) may be rounding errors.
const NOISE: f64 = 1e-8;

/// The cubic between two nodes: position, velocity, half the second and a sixth of the third derivative at its start.
struct Cubic([Row; 4]);

impl Cubic {
    fn between(joints: usize, a: &Node, b: &Node) -> Self {
        let h = b.time - a.time;
        let mut out = [a.position, a.velocity, [0.0; MAX_JOINTS], [0.0; MAX_JOINTS]];
        for v in 0..joints {
            let accelerations = a.acceleration.zip(b.acceleration).map(|(from, to)| [from[v], to[v]]);
            let [_, _, bend, change] =
                cubic([a.position[v], a.velocity[v]], [b.position[v], b.velocity[v]], accelerations, h);
            (out[2][v], out[3][v]) = (bend, change);
        }
        Self(out)
    }

    /// Returns the coefficients of joint `v`.
    fn of(&self, v: usize) -> [f64; 4] {
        [0, 1, 2, 3].map(|k| self.0[k][v])
    }

    /// Returns the Bernstein coefficients of the position of joint `v` over a duration `h` (s).
    fn positions(&self, v: usize, h: f64) -> [f64; 4] {
        let [p, d, c, e] = [self.0[0][v], h * self.0[1][v], h * h * self.0[2][v], h * h * h * self.0[3][v]];
        [p, p + d / 3.0, p + (2.0 * d + c) / 3.0, p + d + c + e]
    }

    /// Returns the Bernstein coefficients of the velocity of joint `v` over a duration `h` (s).
    fn velocities(&self, v: usize, h: f64) -> [f64; 3] {
        let [d, c, e] = [self.0[1][v], h * self.0[2][v], h * h * self.0[3][v]];
        [d, d + c, d + 2.0 * c + 3.0 * e]
    }
}

/// Returns the coefficients of the cubic of one joint between two nodes that are `h` (s) apart, each given by position
/// and velocity: position, velocity, half the second and a sixth of the third derivative at the first node.
#[inline]
fn cubic(from: [f64; 2], to: [f64; 2], accelerations: Option<[f64; 2]>, h: f64) -> [f64; 4] {
    let [p, d] = from;
    if let Some([before, after]) = accelerations {
        return [p, d, 0.5 * before, (after - before) / (6.0 * h)];
    }
    let slope = (to[0] - p) / h;
    // Between nodes close in time, the acceleration computed from positions is only rounding error.
    let rounding = f64::EPSILON * p.abs().max(to[0].abs());
    let even = d == to[1] && (slope - to[1]).abs() * h <= 4.0 * rounding;
    if even && rounding > NOISE * h * h {
        return [p, d, 0.0, 0.0];
    }
    [p, d, (3.0 * slope - 2.0 * d - to[1]) / h, (d + to[1] - 2.0 * slope) / (h * h)]
}

/// Returns position, velocity and acceleration of a cubic at time `t` (s) after its start, averaged over a time window
/// of `width` (s) centred at `t`.
#[inline]
fn average([p, d, c, e]: [f64; 4], t: f64, width: f64) -> [f64; 3] {
    let spread = width * width / 12.0;
    let velocity = d + t * (2.0 * c + 3.0 * e * t);
    let acceleration = 2.0 * c + 6.0 * e * t;
    [p + t * (d + t * (c + t * e)) + 0.5 * acceleration * spread, velocity + 3.0 * e * spread, acceleration]
}

/// Returns the largest used fractions of the velocity and acceleration limits on the cubic between two nodes. Velocity
/// is quadratic and acceleration linear in time, so both maxima have a closed form.
pub(crate) fn shares(limits: &Limits, a: &Node, b: &Node) -> [f64; 2] {
    let joints = limits.joints();
    let cubic = Cubic::between(joints, a, b);
    let h = b.time - a.time;
    let mut out = [0.0_f64; 2];
    for v in 0..joints {
        let [_, d, c, e] = [0, 1, 2, 3].map(|k| cubic.0[k][v]);
        let mut speed = a.velocity[v].abs().max(b.velocity[v].abs());
        let flat = -c / (3.0 * e);
        if flat > 0.0 && flat < h {
            speed = speed.max((d + c * flat).abs());
        }
        let gain = (2.0 * c).abs().max((2.0 * c + 6.0 * e * h).abs());
        out[0] = out[0].max(speed / limits.velocity[v]);
        out[1] = out[1].max(gain / limits.acceleration[v]);
        if let Some(envelope) = &limits.envelope {
            out[0] = out[0].max(envelope.share(v, &cubic.positions(v, h), &cubic.velocities(v, h)));
        }
    }
    out
}

/// The quintic with given position, velocity and acceleration at two nodes, stored as Bernstein coefficients.
struct Quintic {
    h: f64,
    /// Bernstein coefficients of the position minus the first coefficient.
    control: [f64; 6],
}

impl Quintic {
    fn between(a: &Node, b: &Node, v: usize) -> Self {
        let h = b.time - a.time;
        let gain = |node: &Node| node.acceleration.map_or(0.0, |row| row[v]) * h * h / 20.0;
        let (from, to) = (a.velocity[v] * h / 5.0, b.velocity[v] * h / 5.0);
        let whole = b.position[v] - a.position[v];
        Self { h, control: [0.0, from, 2.0 * from + gain(a), whole - 2.0 * to + gain(b), whole - to, whole] }
    }

    /// Returns the Bernstein coefficients of velocity, acceleration and jerk; unused entries are at the end.
    fn rates(&self) -> [[f64; 5]; 3] {
        let mut out = [[0.0; 5]; 3];
        for i in 0..5 {
            out[0][i] = 5.0 * (self.control[i + 1] - self.control[i]) / self.h;
        }
        for i in 0..4 {
            out[1][i] = 4.0 * (out[0][i + 1] - out[0][i]) / self.h;
        }
        for i in 0..3 {
            out[2][i] = 3.0 * (out[1][i + 1] - out[1][i]) / self.h;
        }
        out
    }

    /// Returns an upper bound of the absolute acceleration between two fractions of the duration: the larger value at
    /// the ends, plus an eighth of the squared time between them times the maximum second derivative, which is linear.
    fn hardest(&self, from: f64, to: f64) -> f64 {
        let jerk = self.rates()[2];
        let second = |i: usize| 2.0 * (jerk[i + 1] - jerk[i]) / self.h;
        let bend = second(0).abs().max(second(1).abs());
        let time = (to - from) * self.h;
        self.at(from)[2].abs().max(self.at(to)[2].abs()) + 0.125 * time * time * bend
    }

    /// Returns position (relative to the start), velocity and acceleration at a fraction of the duration.
    fn at(&self, share: f64) -> [f64; 3] {
        let rates = self.rates();
        [bernstein(&self.control, share), bernstein(&rates[0], share), bernstein(&rates[1][..4], share)]
    }
}

/// Evaluates a polynomial in Bernstein form on [0, 1] (de Casteljau).
fn bernstein(coefficients: &[f64], at: f64) -> f64 {
    let mut list = [0.0; 6];
    let count = coefficients.len();
    list[..count].copy_from_slice(coefficients);
    for level in 1..count {
        for i in 0..count - level {
            list[i] += at * (list[i + 1] - list[i]);
        }
    }
    list[0]
}

/// Returns upper bounds of the used fractions of the velocity, acceleration and jerk limits on the quintics between two
/// nodes. The bounds are Bernstein coefficients, which no polynomial exceeds.
pub(crate) fn peaks(limits: &Limits, a: &Node, b: &Node) -> [f64; 3] {
    let mut out = [0.0_f64; 3];
    for v in 0..limits.joints() {
        let quintic = Quintic::between(a, b, v);
        let rates = quintic.rates();
        if let Some(envelope) = &limits.envelope {
            let position = quintic.control.map(|c| a.position[v] + c);
            out[0] = out[0].max(envelope.share(v, &position, &rates[0]));
        }
        for ((share, list), most) in
            out.iter_mut().zip(&rates).zip([limits.velocity[v], limits.acceleration[v], limits.jerk[v]])
        {
            *share = list.iter().fold(*share, |s, c| s.max(c.abs() / most));
        }
    }
    out
}

/// Returns a lower and an upper bound of joint `v` on the quintic between two nodes: its extreme Bernstein
/// coefficients.
pub(crate) fn smooth_range(a: &Node, b: &Node, v: usize) -> (f64, f64) {
    let control = Quintic::between(a, b, v).control.map(|c| a.position[v] + c);
    control.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), c| (low.min(*c), high.max(*c)))
}

/// Returns the Bernstein coefficients of position and velocity of joint `v` on the cubic between two nodes.
pub(crate) fn curve(joints: usize, v: usize, a: &Node, b: &Node) -> ([f64; 4], [f64; 3]) {
    let (cubic, h) = (Cubic::between(joints, a, b), b.time - a.time);
    (cubic.positions(v, h), cubic.velocities(v, h))
}

/// Returns the minimum and maximum position of joint `v` on the cubic between two nodes.
pub(crate) fn range(joints: usize, v: usize, a: &Node, b: &Node) -> (f64, f64) {
    let cubic = Cubic::between(joints, a, b);
    let [_, slope, bend, change] = [0, 1, 2, 3].map(|k| cubic.0[k][v]);
    let (mut low, mut high) = (a.position[v].min(b.position[v]), a.position[v].max(b.position[v]));
    // Extrema lie where slope + 2 bend t + 3 change t^2 = 0 inside the interval.
    let root = (bend * bend - 3.0 * change * slope).max(0.0).sqrt();
    let q = -(bend + root.copysign(bend));
    for t in [q / (3.0 * change), slope / q] {
        if t > 0.0 && t < b.time - a.time {
            let value = average(cubic.of(v), t, 0.0)[0];
            (low, high) = (low.min(value), high.max(value));
        }
    }
    (low, high)
}

/// A part of a trajectory: at local time `t`, its state is the average over `[t - w, t]` of the cubics between nodes.
///
/// Averaging keeps every bound on position, velocity and acceleration, and bounds the jerk by twice the maximum
/// acceleration divided by `w`. With `w = 0`, the part equals the cubics themselves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Piece {
    /// Time (s) of the trajectory at which the piece starts.
    pub start: f64,
    /// Time (s) from which the trajectory uses this piece; at or after `start`.
    pub counts: f64,
    width: f64,
    joints: usize,
    /// Times (s) of the nodes, relative to `start`; the first one is `-width`.
    times: Vec<f64>,
    /// Positions and velocities of the nodes, ordered by joint.
    states: Vec<f64>,
    /// Accelerations right after each node, ordered by joint; empty if the cubics determine them.
    accelerations: Vec<f64>,
    /// Indices of the nodes at marked waypoints, in increasing order.
    marks: Vec<usize>,
    /// Whether the nodes are connected by quintics with given accelerations at the nodes.
    smooth: bool,
}

impl Piece {
    /// Creates the motion along cubics through `nodes` without averaging. The first node is at time 0.
    pub fn plain(start: f64, joints: usize, nodes: &[Node]) -> Self {
        Self::new(start, 0.0, joints, nodes, &[])
    }

    /// Creates the motion along quintics through `nodes`. The first node is at time 0.
    pub fn smooth(start: f64, joints: usize, nodes: &[Node], marks: &[usize]) -> Self {
        Self { smooth: true, ..Self::new(start, 0.0, joints, nodes, marks) }
    }

    /// Creates the motion along cubics through `nodes`, averaged over `width` (s), which ends at rest. It reaches the
    /// first node, at time 0, `width / 2` after its own start, so a moving start is extended backwards in time.
    pub fn averaged(start: f64, width: f64, joints: usize, nodes: &[Node], marks: &[usize]) -> Self {
        let (Some(first), Some(last)) = (nodes.first(), nodes.last()) else {
            return Self::new(start, 0.0, joints, nodes, &[]);
        };
        if width == 0.0 {
            return Self::new(start, width, joints, nodes, marks);
        }
        let mut before = *first;
        before.time = -width;
        for v in 0..joints {
            before.position[v] -= width * first.velocity[v];
        }
        let mut after = *last;
        after.time += width;
        let mut all = Vec::with_capacity(nodes.len() + 2);
        all.push(before);
        all.extend_from_slice(nodes);
        all.push(after);
        let marks: Vec<usize> = marks.iter().map(|m| m + 1).collect();
        Self::new(start, width, joints, &all, &marks)
    }

    fn new(start: f64, width: f64, joints: usize, nodes: &[Node], marks: &[usize]) -> Self {
        let mut states = Vec::with_capacity(2 * joints * nodes.len());
        let known = nodes.iter().map_while(|n| n.acceleration);
        let mut accelerations: Vec<f64> = known.flat_map(|row| row.into_iter().take(joints)).collect();
        if accelerations.len() < joints * nodes.len() {
            accelerations.clear();
        }
        for node in nodes {
            states.extend_from_slice(&node.position[..joints]);
            states.extend_from_slice(&node.velocity[..joints]);
        }
        let times = nodes.iter().map(|n| n.time).collect();
        Self { start, counts: start, width, joints, times, states, accelerations, marks: marks.to_vec(), smooth: false }
    }

    /// Returns the number of joints.
    pub fn joints(&self) -> usize {
        self.joints
    }

    /// Returns the motion through the same nodes with constant jerk between neighbouring nodes.
    pub fn with_even_jerk(self) -> Self {
        Self { smooth: false, ..self }
    }

    /// Returns the motion with all times increased by `time` (s).
    pub fn delayed(mut self, time: f64) -> Self {
        self.start += time;
        self.counts += time;
        self
    }

    /// Returns whether the times of the nodes increase and all lists have matching lengths.
    pub fn is_sound(&self) -> bool {
        let (nodes, joints) = (self.times.len(), self.joints);
        let finite = |list: &[f64]| list.iter().all(|v| v.is_finite());
        nodes > 0
            && (1..=MAX_JOINTS).contains(&joints)
            && self.states.len() == 2 * joints * nodes
            && !(self.smooth && self.accelerations.is_empty() && nodes > 1)
            && (self.accelerations.is_empty() || self.accelerations.len() == joints * nodes)
            && finite(&[self.start, self.counts, self.width])
            && self.start <= self.counts
            && self.width >= 0.0
            && [&self.times, &self.states, &self.accelerations].into_iter().all(|list| finite(list))
            && self.times.windows(2).all(|pair| pair[0] <= pair[1])
            && self.duration() >= 0.0
            && self.marks.iter().all(|m| *m < nodes)
    }

    /// Returns the duration (s).
    pub fn duration(&self) -> f64 {
        self.times[self.times.len() - 1]
    }

    pub fn end(&self) -> f64 {
        self.start + self.duration()
    }

    /// Returns the time (s) of the trajectory at which it passes closest to a node.
    fn time_of(&self, node: usize) -> f64 {
        self.start + (self.times[node] + 0.5 * self.width).clamp(0.0, self.duration())
    }

    /// Returns the times (s) of the trajectory between which the acceleration is a single polynomial. At these times,
    /// an end of the averaging window passes a node.
    pub fn corners(&self) -> Vec<f64> {
        let inside = |t: &f64| (0.0..=self.duration()).contains(t);
        let mut out: Vec<f64> = self.times.iter().flat_map(|t| [*t, t + self.width]).filter(inside).collect();
        out.extend([0.0, self.duration()]);
        out.sort_by(f64::total_cmp);
        out.dedup();
        out.iter_mut().for_each(|t| *t += self.start);
        out
    }

    /// Returns times (s) of the trajectory that represent it: nodes about `spacing` (s) apart, all marks, the start and
    /// the end.
    pub fn landmarks(&self, spacing: f64) -> Vec<f64> {
        let mut out = vec![self.start];
        for node in 0..self.times.len() {
            let time = self.time_of(node);
            let marked = self.marks.binary_search(&node).is_ok();
            let last = out[out.len() - 1];
            if time > last && (marked || (time - last >= spacing && self.end() - time >= 0.5 * spacing)) {
                out.push(time);
            }
        }
        out.push(self.end());
        out
    }

    /// Returns the coefficients of the cubic of joint `v` after node `i`.
    #[inline]
    fn cubic(&self, i: usize, v: usize) -> [f64; 4] {
        let n = self.joints;
        let state = |k: usize| [self.states[2 * n * k + v], self.states[2 * n * k + n + v]];
        let acceleration = |k: usize| self.accelerations.get(n * k + v).copied();
        let accelerations = acceleration(i).zip(acceleration(i + 1)).map(|(a, b)| [a, b]);
        cubic(state(i), state(i + 1), accelerations, self.times[i + 1] - self.times[i])
    }

    fn node(&self, i: usize) -> Node {
        let n = self.joints;
        let state = &self.states[2 * n * i..2 * n * (i + 1)];
        let row = |values: &[f64]| {
            let mut out = [0.0; MAX_JOINTS];
            out[..n].copy_from_slice(values);
            out
        };
        let acceleration = self.accelerations.get(n * i..n * (i + 1)).map(row);
        Node { time: self.times[i], position: row(&state[..n]), velocity: row(&state[n..]), acceleration }
    }

    /// Raises `most` to upper bounds of each joint's absolute acceleration between two times (s) of the trajectory, and adds
    /// upper bounds of its integral to `total`. The average of an acceleration is bounded by the acceleration itself,
    /// which is linear between nodes.
    pub fn widen_to_accelerations(&self, [from, to]: [f64; 2], most: &mut Row, total: &mut Row) {
        let local = |time: f64| (time - self.start).clamp(0.0, self.duration());
        let (from, to) = (local(from) - self.width, local(to));
        let first = self.times.partition_point(|t| *t <= from).saturating_sub(1);
        for cell in first..self.times.len().saturating_sub(1) {
            let (start, h) = (self.times[cell], self.times[cell + 1] - self.times[cell]);
            if start > to {
                return;
            }
            if h <= 0.0 {
                continue;
            }
            let (begin, end) = ((from - start).clamp(0.0, h), (to - start).clamp(0.0, h));
            let ends = self.smooth.then(|| (self.node(cell), self.node(cell + 1)));
            for v in 0..self.joints {
                let hardest = match &ends {
                    Some((a, b)) => Quintic::between(a, b, v).hardest(begin / h, end / h),
                    None => {
                        let [_, _, bend, change] = self.cubic(cell, v);
                        let acceleration = |t: f64| 2.0 * bend + 6.0 * change * t;
                        acceleration(begin).abs().max(acceleration(end).abs())
                    }
                };
                most[v] = most[v].max(hardest);
                total[v] += hardest * (end - begin);
            }
        }
    }

    /// Returns position, velocity and acceleration at a time (s) of the trajectory. Before the start and after the end,
    /// it is the state at the start or end.
    pub fn at(&self, time: f64) -> [Row; 3] {
        let to = (time - self.start).clamp(0.0, self.duration());
        let from = to - self.width;
        let last = self.times.len().saturating_sub(2);
        let mut out = [[0.0; MAX_JOINTS]; 3];
        if self.times.len() < 2 {
            out[0] = self.node(0).position;
            return out;
        }
        let mut cell = self.times.partition_point(|t| *t <= from).saturating_sub(1).min(last);
        if self.smooth {
            let (a, b) = (self.node(cell), self.node(cell + 1));
            let h = b.time - a.time;
            for v in 0..self.joints {
                let values = Quintic::between(&a, &b, v).at((to - a.time) / h);
                [out[0][v], out[1][v], out[2][v]] = [a.position[v] + values[0], values[1], values[2]];
            }
            return out;
        }
        loop {
            let (start, next) = (self.times[cell], self.times[cell + 1]);
            let (begin, end) = (start.max(from), if cell == last { to } else { next.min(to) });
            let share = if self.width > 0.0 { (end - begin) / self.width } else { 1.0 };
            for v in 0..self.joints {
                let values = average(self.cubic(cell, v), 0.5 * (begin + end) - start, end - begin);
                for (row, value) in out.iter_mut().zip(values) {
                    row[v] += share * value;
                }
            }
            if cell == last || next >= to {
                return out;
            }
            cell += 1;
        }
    }
}

//! Timed joint motion: a twice differentiable curve through each segment's waypoints, driven from rest to rest by a
//! quintic time law, so that velocity, acceleration and jerk are bounded and the ends of segments are met exactly.

use serde::{Deserialize, Serialize};

use crate::KeypointProblem;
use crate::model::{MOST_JOINTS, Model, Row};

/// Limits of every moving joint.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limits {
    pub velocity: Row,
    pub acceleration: Row,
    pub jerk: Row,
}

impl Limits {
    /// Those of the problem's moving joints, scaled as its options say.
    pub fn of(problem: &KeypointProblem, model: &Model) -> Self {
        const FRANKA_ACCELERATION: [f64; 7] = [15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0];
        const FRANKA_JERK: [f64; 7] = [7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10_000.0, 10_000.0];
        let o = &problem.options;
        let seven = model.n() == 7;
        let mut out = Self { velocity: [1.0; MOST_JOINTS], acceleration: [1.0; MOST_JOINTS], jerk: [1.0; MOST_JOINTS] };
        for (v, j) in model.indices.iter().enumerate() {
            let given = |list: &Option<Vec<f64>>| list.as_ref().map(|l| l[*j]);
            let velocity = given(&o.velocity_limits).unwrap_or(problem.robot.joints()[*j].velocity);
            let acceleration =
                given(&o.acceleration_limits).unwrap_or(if seven { FRANKA_ACCELERATION[v] } else { 10.0 });
            let jerk = given(&o.jerk_limits).unwrap_or(if seven { FRANKA_JERK[v] } else { 5000.0 });
            out.velocity[v] = o.velocity_scale * velocity;
            out.acceleration[v] = o.acceleration_scale * acceleration;
            out.jerk[v] = o.acceleration_scale * jerk;
        }
        out
    }
}

/// A curve through waypoints over 0..1, its joints' cubics joined with continuous second derivatives.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Curve {
    knots: Vec<f64>,
    values: Vec<Vec<f64>>,
    second: Vec<Vec<f64>>,
}

impl Curve {
    /// Natural cubic spline of `n` joints. Its knots lie as far apart as the limits make the way between them last, so
    /// that a sharp bend is driven slowly and the rest is not.
    pub fn new(n: usize, waypoints: &[Row], limits: &Limits) -> Self {
        let mut lengths = Vec::new();
        let mut points: Vec<Row> = waypoints.first().copied().into_iter().collect();
        for w in waypoints.iter().skip(1) {
            let last = points[points.len() - 1];
            let d: f64 = (0..n).map(|v| (w[v] - last[v]).powi(2)).sum::<f64>().sqrt();
            if d > 1e-9 {
                lengths.push(d);
                points.push(*w);
            }
        }
        let values: Vec<Vec<f64>> = (0..n).map(|v| points.iter().map(|p| p[v]).collect()).collect();
        let mut out = Self::through(values, &lengths);
        if lengths.len() > 1 {
            let speeds = out.speeds(limits);
            let durations: Vec<f64> =
                out.knots.windows(2).zip(speeds.windows(2)).map(|(u, s)| 2.0 * (u[1] - u[0]) / (s[0] + s[1])).collect();
            out = Self::through(out.values, &durations);
        }
        out
    }

    /// The spline whose knots are these distances apart, scaled to 0..1.
    fn through(values: Vec<Vec<f64>>, distances: &[f64]) -> Self {
        let mut knots = vec![0.0];
        for d in distances {
            knots.push(knots[knots.len() - 1] + d);
        }
        let total = knots[knots.len() - 1];
        if total > 0.0 {
            knots.iter_mut().for_each(|k| *k /= total);
        }
        let second = values.iter().map(|y| natural_second_derivatives(&knots, y)).collect();
        Self { knots, values, second }
    }

    /// Speed (1/s) at each knot that keeps to the limits there and can be reached from those of its neighbours.
    fn speeds(&self, limits: &Limits) -> Vec<f64> {
        let count = self.knots.len();
        let n = self.values.len();
        let mut speeds = vec![f64::INFINITY; count];
        // Gain of speed (1/s^2), and of that gain (1/s^3).
        let mut gains = vec![[f64::INFINITY; 2]; count];
        for i in 0..count - 1 {
            for (k, u) in [(i, self.knots[i]), (i + 1, self.knots[i + 1])] {
                for v in 0..n {
                    let [_, q1, q2, q3] = self.joint(v, i, u).map(f64::abs);
                    speeds[k] = speeds[k]
                        .min(limits.velocity[v] / q1)
                        .min((limits.acceleration[v] / q2).sqrt())
                        .min((limits.jerk[v] / q3).cbrt());
                    gains[k][0] = gains[k][0].min(limits.acceleration[v] / q1);
                    gains[k][1] = gains[k][1].min(limits.jerk[v] / q1);
                }
            }
        }
        let reach = |gain: &mut f64, from: f64, to: f64, gains: [f64; 2], way: f64| {
            *gain = (*gain + gains[1] * way / from).min(gains[0]);
            let speed = to.min((from * from + 2.0 * *gain * way).sqrt());
            *gain = ((speed * speed - from * from) / (2.0 * way)).max(0.0);
            speed
        };
        let mut gain = 0.0;
        for i in 1..count {
            speeds[i] = reach(&mut gain, speeds[i - 1], speeds[i], gains[i], self.knots[i] - self.knots[i - 1]);
        }
        gain = 0.0;
        for i in (0..count - 1).rev() {
            speeds[i] = reach(&mut gain, speeds[i + 1], speeds[i], gains[i], self.knots[i + 1] - self.knots[i]);
        }
        speeds
    }

    /// Points on the curve, about `spacing` apart.
    pub fn along(&self, spacing: f64) -> Vec<Row> {
        let mut out = vec![self.at(0, 0.0)];
        for i in 0..self.knots.len().saturating_sub(1) {
            let way: f64 = self.values.iter().map(|y| (y[i + 1] - y[i]).powi(2)).sum::<f64>().sqrt();
            let steps = (way / spacing).ceil().max(1.0) as usize;
            out.extend((1..=steps).map(|k| self.at(i, k as f64 / steps as f64)));
        }
        out
    }

    /// Value and first three derivatives of joint `v` in interval `i` at `u`.
    fn joint(&self, v: usize, i: usize, u: f64) -> [f64; 4] {
        let (y, m) = (&self.values[v], &self.second[v]);
        if self.knots.len() < 2 {
            return [y[0], 0.0, 0.0, 0.0];
        }
        let h = self.knots[i + 1] - self.knots[i];
        let (a, b) = ((self.knots[i + 1] - u) / h, (u - self.knots[i]) / h);
        let value = a * y[i] + b * y[i + 1] + ((a.powi(3) - a) * m[i] + (b.powi(3) - b) * m[i + 1]) * h * h / 6.0;
        let first = (y[i + 1] - y[i]) / h + ((3.0 * b * b - 1.0) * m[i + 1] - (3.0 * a * a - 1.0) * m[i]) * h / 6.0;
        [value, first, a * m[i] + b * m[i + 1], (m[i + 1] - m[i]) / h]
    }

    /// Number of knots: that of the waypoints, less those that repeat the one before.
    pub fn knots(&self) -> usize {
        self.knots.len()
    }

    /// Joints at a fraction of interval `i`.
    pub fn at(&self, i: usize, fraction: f64) -> Row {
        let u = match self.knots.get(i + 1) {
            Some(next) => self.knots[i] + fraction * (next - self.knots[i]),
            None => 0.0,
        };
        let mut x = [0.0; MOST_JOINTS];
        for (v, value) in x.iter_mut().enumerate().take(self.values.len()) {
            *value = self.joint(v, i, u)[0];
        }
        x
    }

    /// Least and greatest value of joint `v` in interval `i`.
    pub fn range(&self, v: usize, i: usize) -> (f64, f64) {
        let (start, end) = (self.knots[i], self.knots[i + 1]);
        let [first, slope, bend, change] = self.joint(v, i, start);
        let last = self.joint(v, i, end)[0];
        let (mut low, mut high) = (first.min(last), first.max(last));
        // Where slope + bend t + change t^2 / 2 vanishes inside.
        let (a, b, c) = (0.5 * change, bend, slope);
        let root = (b * b - 4.0 * a * c).max(0.0).sqrt();
        let q = -0.5 * (b + root.copysign(b));
        for t in [q / a, c / q] {
            if t > 0.0 && t < end - start {
                let value = self.joint(v, i, start + t)[0];
                (low, high) = (low.min(value), high.max(value));
            }
        }
        (low, high)
    }

    /// Whether every joint stays between `lower` and `upper` all along.
    pub fn keeps_within(&self, lower: &Row, upper: &Row) -> bool {
        (0..self.values.len()).all(|v| {
            (0..self.knots.len().saturating_sub(1)).all(|i| {
                let (low, high) = self.range(v, i);
                low >= lower[v] && high <= upper[v]
            })
        })
    }

    fn interval(&self, u: f64) -> usize {
        let last = self.knots.len().saturating_sub(2);
        self.knots.partition_point(|k| *k <= u).saturating_sub(1).min(last)
    }
}

/// Waypoints on a polygon: its corners, and points at most `spacing` apart between them. The curve through them bends
/// about as far before and after a corner as they are apart.
pub(crate) fn rounded(n: usize, corners: &[Row], spacing: f64) -> Vec<Row> {
    let mut out: Vec<Row> = corners.first().copied().into_iter().collect();
    for pair in corners.windows(2) {
        let steps = (length(n, pair) / spacing).ceil().max(1.0) as usize;
        for k in 1..=steps {
            let mut x = pair[0];
            for v in 0..n {
                x[v] = pair[0][v] + (pair[1][v] - pair[0][v]) * k as f64 / steps as f64;
            }
            out.push(x);
        }
    }
    out
}

/// Length of the polygon through waypoints.
pub(crate) fn length(n: usize, waypoints: &[Row]) -> f64 {
    waypoints.windows(2).map(|w| (0..n).map(|v| (w[1][v] - w[0][v]).powi(2)).sum::<f64>().sqrt()).sum()
}

/// Second derivatives at the knots of the natural cubic spline: one tridiagonal sweep.
fn natural_second_derivatives(knots: &[f64], y: &[f64]) -> Vec<f64> {
    let n = knots.len();
    let mut m = vec![0.0; n];
    if n < 3 {
        return m;
    }
    let mut upper = vec![0.0; n];
    for i in 1..n - 1 {
        let (h0, h1) = (knots[i] - knots[i - 1], knots[i + 1] - knots[i]);
        let rhs = 6.0 * ((y[i + 1] - y[i]) / h1 - (y[i] - y[i - 1]) / h0);
        let pivot = 2.0 * (h0 + h1) - h0 * upper[i - 1];
        upper[i] = h1 / pivot;
        m[i] = (rhs - h0 * m[i - 1]) / pivot;
    }
    for i in (1..n - 1).rev() {
        m[i] -= upper[i] * m[i + 1];
    }
    m
}

/// The time law s(t) on 0..1 with its first three derivatives: rest to rest, smooth in acceleration.
fn quintic(t: f64) -> [f64; 4] {
    let t = t.clamp(0.0, 1.0);
    let (t2, t3) = (t * t, t * t * t);
    [
        t3 * (10.0 - 15.0 * t + 6.0 * t2),
        30.0 * t2 * (1.0 - 2.0 * t + t2),
        60.0 * t * (1.0 - 3.0 * t + 2.0 * t2),
        60.0 * (1.0 - 6.0 * t + 6.0 * t2),
    ]
}

/// The time at which the law is at `s`.
fn time_of(s: f64) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..30 {
        let middle = 0.5 * (low + high);
        if quintic(middle)[0] < s {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

/// Part of a trajectory.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
enum Law {
    /// Along a curve, from rest to rest.
    Move(Curve),
    /// Straight on from `position` with `velocity` until it has died down.
    Brake { position: Vec<f64>, velocity: Vec<f64> },
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Segment {
    start: f64,
    duration: f64,
    law: Law,
}

/// A timed joint motion of all joints of the robot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Trajectory {
    segments: Vec<Segment>,
    /// Place of the moving joints in the full vector.
    indices: Vec<usize>,
    /// Full joint vector that holds what does not move.
    rest: Vec<f64>,
    times: Vec<f64>,
}

/// Position, velocity and acceleration at one time, each one entry a joint.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// rad or m.
    pub position: Vec<f64>,
    /// rad/s or m/s.
    pub velocity: Vec<f64>,
    /// rad/s^2 or m/s^2.
    pub acceleration: Vec<f64>,
}

/// Waypoints of a trajectory are at most this far apart (s).
const WAYPOINT_STEP: f64 = 0.1;

/// What a trajectory is built from.
pub(crate) struct Builder {
    n: usize,
    limits: Limits,
    segments: Vec<Segment>,
    now: f64,
}

impl Builder {
    pub fn new(n: usize, limits: Limits, start: f64) -> Self {
        Self { n, limits, segments: Vec::new(), now: start }
    }

    /// Time so far (s).
    pub fn now(&self) -> f64 {
        self.now
    }

    /// Brings a motion under way to rest; returns where.
    pub fn brake(&mut self, x: &Row, velocity: &Row) -> Row {
        // v(t) = v0 (1 - s(t)): acceleration peaks at 15/8 v0/T, jerk at 5.774 v0/T^2.
        let mut duration: f64 = 0.0;
        for v in 0..self.n {
            let speed = velocity[v].abs();
            duration = duration
                .max(1.875 * speed / self.limits.acceleration[v])
                .max((5.774 * speed / self.limits.jerk[v]).sqrt());
        }
        let mut end = *x;
        if duration > 0.0 {
            for v in 0..self.n {
                end[v] += 0.5 * velocity[v] * duration;
            }
            let law = Law::Brake { position: x[..self.n].to_vec(), velocity: velocity[..self.n].to_vec() };
            self.segments.push(Segment { start: self.now, duration, law });
            self.now += duration;
        }
        end
    }

    /// Least time (s) in which the limits let a curve be driven.
    fn least_time(&self, curve: &Curve) -> f64 {
        const EVEN: usize = 64;
        const PARTS: usize = 4;
        let mut least: f64 = 0.0;
        let mut look = |t: f64, i: usize| {
            let [s, s1, s2, s3] = quintic(t);
            for v in 0..self.n {
                let [_, q1, q2, q3] = curve.joint(v, i, s);
                let velocity = (q1 * s1).abs();
                let acceleration = (q2 * s1 * s1 + q1 * s2).abs();
                let jerk = (q3 * s1.powi(3) + 3.0 * q2 * s1 * s2 + q1 * s3).abs();
                least = least
                    .max(velocity / self.limits.velocity[v])
                    .max((acceleration / self.limits.acceleration[v]).sqrt())
                    .max((jerk / self.limits.jerk[v]).cbrt());
            }
        };
        // Even steps of time for the peaks of the time law, parts of every interval for those of the curve, whose
        // third derivative jumps at its knots.
        for k in 0..=EVEN {
            let t = k as f64 / EVEN as f64;
            look(t, curve.interval(quintic(t)[0]));
        }
        for (i, ends) in curve.knots.windows(2).enumerate() {
            for k in 0..=PARTS {
                let s = ends[0] + (ends[1] - ends[0]) * k as f64 / PARTS as f64;
                look(time_of(s), i);
            }
        }
        // Between those a peak may be missed by a little.
        1.02 * least
    }

    /// Appends a motion through waypoints; ends at `end` where that is given, as soon as the limits allow otherwise.
    /// Fails with the least time where `end` comes too early.
    pub fn push(&mut self, waypoints: &[Row], end: Option<f64>) -> Result<(), f64> {
        let curve = Curve::new(self.n, waypoints, &self.limits);
        let least = self.least_time(&curve);
        let duration = match end {
            Some(end) if end - self.now < least => return Err(least),
            Some(end) => end - self.now,
            None => least.max(1e-3),
        };
        self.segments.push(Segment { start: self.now, duration, law: Law::Move(curve) });
        self.now += duration;
        Ok(())
    }

    /// The trajectory of the moving joints at `indices` in `rest`.
    pub fn build(self, indices: &[usize], rest: &[f64]) -> Trajectory {
        let mut times = Vec::new();
        for s in &self.segments {
            let steps = ((s.duration / WAYPOINT_STEP).ceil() as usize).max(1);
            times.extend((0..steps).map(|k| s.start + s.duration * k as f64 / steps as f64));
        }
        times.push(self.now);
        Trajectory { segments: self.segments, indices: indices.to_vec(), rest: rest.to_vec(), times }
    }
}

impl Trajectory {
    /// Waypoint times (s); every keyframe time is among them.
    #[must_use]
    pub fn times(&self) -> &[f64] {
        &self.times
    }

    /// Time of the first waypoint (s).
    #[must_use]
    pub fn start(&self) -> f64 {
        self.times[0]
    }

    /// Time of the last waypoint (s).
    #[must_use]
    pub fn end(&self) -> f64 {
        self.times[self.times.len() - 1]
    }

    /// Position, velocity and acceleration of all joints at time `t` (s); before the start and after the end it rests.
    #[must_use]
    pub fn sample(&self, t: f64) -> Sample {
        let joints = self.rest.len();
        let mut out =
            Sample { position: self.rest.clone(), velocity: vec![0.0; joints], acceleration: vec![0.0; joints] };
        let at = self.segments.partition_point(|s| s.start <= t).saturating_sub(1);
        let Some(segment) = self.segments.get(at) else { return out };
        let duration = segment.duration;
        let local = ((t - segment.start) / duration).clamp(0.0, 1.0);
        match &segment.law {
            Law::Move(curve) => {
                let [s, s1, s2, _] = quintic(local);
                let i = curve.interval(s);
                for (v, j) in self.indices.iter().enumerate() {
                    let [q, q1, q2, _] = curve.joint(v, i, s);
                    out.position[*j] = q;
                    out.velocity[*j] = q1 * s1 / duration;
                    out.acceleration[*j] = (q2 * s1 * s1 + q1 * s2) / (duration * duration);
                }
            }
            Law::Brake { position, velocity } => {
                let [s, s1, _, _] = quintic(local);
                let t = local;
                let gone = t - (2.5 * t.powi(4) - 3.0 * t.powi(5) + t.powi(6));
                for (v, j) in self.indices.iter().enumerate() {
                    out.position[*j] = position[v] + velocity[v] * duration * gone;
                    out.velocity[*j] = velocity[v] * (1.0 - s);
                    out.acceleration[*j] = -velocity[v] * s1 / duration;
                }
            }
        }
        out
    }

    /// Joint positions at the waypoint times.
    #[must_use]
    pub fn positions(&self) -> Vec<Vec<f64>> {
        self.times.iter().map(|t| self.sample(*t).position).collect()
    }

    /// The moving joints at a time, for checks.
    pub(crate) fn moving(&self, t: f64) -> Row {
        let q = self.sample(t).position;
        let mut x = [0.0; MOST_JOINTS];
        for (v, j) in self.indices.iter().enumerate() {
            x[v] = q[*j];
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn limits() -> Limits {
        Limits { velocity: [1.0; MOST_JOINTS], acceleration: [2.0; MOST_JOINTS], jerk: [20.0; MOST_JOINTS] }
    }

    fn row(a: f64, b: f64) -> Row {
        let mut out = [0.0; MOST_JOINTS];
        (out[0], out[1]) = (a, b);
        out
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn limits_hold_and_waypoints_are_met(
            points in prop::collection::vec((-2.0..2.0f64, -2.0..2.0f64), 2..7),
            v0 in -0.9..0.9f64,
        ) {
            let mut builder = Builder::new(2, limits(), 0.0);
            let begin = row(points[0].0, points[0].1);
            let rest = builder.brake(&begin, &row(v0, -0.5 * v0));
            let mut way: Vec<Row> = vec![rest];
            way.extend(points.iter().skip(1).map(|(a, b)| row(*a, *b)));
            prop_assert!(builder.push(&way, None).is_ok());
            let trajectory = builder.build(&[0, 2], &[0.0, 7.0, 0.0]);
            prop_assert!((trajectory.sample(0.0).velocity[0] - v0).abs() < 1e-12);
            let end = trajectory.sample(trajectory.end()).position;
            let last = points[points.len() - 1];
            prop_assert!((end[0] - last.0).abs() < 1e-9 && (end[2] - last.1).abs() < 1e-9 && end[1] == 7.0);
            let h = trajectory.end() / 3000.0;
            let mut previous = trajectory.sample(0.0);
            for k in 1..=3000 {
                let now = trajectory.sample(h * f64::from(k));
                for j in [0, 2] {
                    prop_assert!(now.velocity[j].abs() <= 1.0 + 1e-6);
                    prop_assert!(now.acceleration[j].abs() <= 2.0 + 1e-6);
                    // Derivatives are those of the positions.
                    let slope = (now.position[j] - previous.position[j]) / h;
                    let between = 0.5 * (now.velocity[j] + previous.velocity[j]);
                    prop_assert!((slope - between).abs() < 20.0 * h * h + 1e-9, "{slope} {between}");
                    prop_assert!((now.acceleration[j] - previous.acceleration[j]).abs() <= 20.0 * 1.02 * h + 1e-9);
                }
                previous = now;
            }
        }
    }

    #[test]
    fn a_clock_too_fast_is_refused() {
        let mut builder = Builder::new(2, limits(), 0.0);
        let way = [row(0.0, 0.0), row(1.0, 0.0)];
        let least = builder.push(&way, Some(0.5)).unwrap_err();
        assert!(least > 1.8 && builder.push(&way, Some(least)).is_ok());
    }

    #[test]
    fn a_sharp_bend_is_slow_only_there() {
        let time = |bend: f64| {
            let franka =
                Limits { velocity: [2.0; MOST_JOINTS], acceleration: [10.0; MOST_JOINTS], jerk: [5000.0; MOST_JOINTS] };
            let mut builder = Builder::new(2, franka, 0.0);
            let leg = |k: i32| f64::from(k) * 0.005;
            let mut way: Vec<Row> = (0..=200).map(|k| row(leg(k), 0.0)).collect();
            way.extend((1..=200).map(|k| row(1.0 + leg(k) * bend.cos(), leg(k) * bend.sin())));
            assert!(builder.push(&way, None).is_ok());
            builder.now()
        };
        let (straight, bent) = (time(0.0), time(1.5));
        // Two legs from rest to rest take less than twice as long as both in one go.
        assert!(straight < bent && bent < 2.0 * straight, "{straight} {bent}");
    }
}

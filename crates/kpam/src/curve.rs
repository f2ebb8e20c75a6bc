//! Curves through joint waypoints: twice differentiable, with knots as far apart as the joints' limits make the way
//! between them last.

use serde::{Deserialize, Serialize};

use crate::KeypointProblem;
use crate::default_limits::default_limits;
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
        let o = &problem.options;
        let mut out = Self { velocity: [1.0; MOST_JOINTS], acceleration: [1.0; MOST_JOINTS], jerk: [1.0; MOST_JOINTS] };
        // Limits of mimic joints bind the variables that drive them.
        let given = |list: &Option<Vec<f64>>| list.as_ref().map(|l| model.map().least(|j| l[j]));
        let velocity = given(&o.velocity_limits).unwrap_or(model.velocity);
        let usual = default_limits(&problem.robot, model, o);
        let acceleration = given(&o.acceleration_limits).unwrap_or(usual.0);
        let jerk = given(&o.jerk_limits).unwrap_or(usual.1);
        for v in 0..model.n() {
            out.velocity[v] = o.velocity_scale * velocity[v];
            out.acceleration[v] = o.acceleration_scale * acceleration[v];
            out.jerk[v] = o.acceleration_scale * jerk[v];
        }
        out
    }
}

/// A curve through waypoints over 0..1, its joints' cubics joined with continuous second derivatives.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Curve {
    pub knots: Vec<f64>,
    values: Vec<Vec<f64>>,
    second: Vec<Vec<f64>>,
}

/// A place on a curve: its interval, that one's length, and the weights of its ends.
pub(crate) struct Place {
    i: usize,
    h: f64,
    a: f64,
    b: f64,
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
            // Joints without a limit on their speed may say nothing of how long the way takes.
            if durations.iter().all(|d| d.is_finite() && *d > 0.0) {
                out = Self::through(out.values, &durations);
            }
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
        // Least of what the limits on velocity, acceleration and jerk allow: the speed, its square, its cube.
        let mut allowed = vec![[f64::INFINITY; 3]; count];
        // Gain of speed (1/s^2), and of that gain (1/s^3).
        let mut gains = vec![[f64::INFINITY; 2]; count];
        for i in 0..count - 1 {
            for (k, u) in [(i, self.knots[i]), (i + 1, self.knots[i + 1])] {
                let place = self.place(i, u);
                for v in 0..n {
                    let [_, q1, q2, q3] = self.joint(v, &place).map(f64::abs);
                    allowed[k][0] = allowed[k][0].min(limits.velocity[v] / q1);
                    allowed[k][1] = allowed[k][1].min(limits.acceleration[v] / q2);
                    allowed[k][2] = allowed[k][2].min(limits.jerk[v] / q3);
                    gains[k][0] = gains[k][0].min(limits.acceleration[v] / q1);
                    gains[k][1] = gains[k][1].min(limits.jerk[v] / q1);
                }
            }
        }
        let mut speeds: Vec<f64> = allowed.iter().map(|[v, a, j]| v.min(a.sqrt()).min(j.cbrt())).collect();
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

    /// A place in interval `i`, at `u`.
    pub fn place(&self, i: usize, u: f64) -> Place {
        if self.knots.len() < 2 {
            return Place { i: 0, h: 0.0, a: 1.0, b: 0.0 };
        }
        let h = self.knots[i + 1] - self.knots[i];
        Place { i, h, a: (self.knots[i + 1] - u) / h, b: (u - self.knots[i]) / h }
    }

    /// Value and first three derivatives of joint `v` at a place.
    pub fn joint(&self, v: usize, place: &Place) -> [f64; 4] {
        let (y, m) = (&self.values[v], &self.second[v]);
        let Place { i, h, a, b } = *place;
        if self.knots.len() < 2 {
            return [y[0], 0.0, 0.0, 0.0];
        }
        let value = a * y[i] + b * y[i + 1] + ((a * a * a - a) * m[i] + (b * b * b - b) * m[i + 1]) * h * h / 6.0;
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
        let place = self.place(i, u);
        for (v, value) in x.iter_mut().enumerate().take(self.values.len()) {
            *value = self.joint(v, &place)[0];
        }
        x
    }

    /// Least and greatest value of joint `v` in interval `i`.
    pub fn range(&self, v: usize, i: usize) -> (f64, f64) {
        let (start, end) = (self.knots[i], self.knots[i + 1]);
        let [first, slope, bend, change] = self.joint(v, &self.place(i, start));
        let last = self.joint(v, &self.place(i, end))[0];
        let (mut low, mut high) = (first.min(last), first.max(last));
        // Where slope + bend t + change t^2 / 2 vanishes inside.
        let (a, b, c) = (0.5 * change, bend, slope);
        let root = (b * b - 4.0 * a * c).max(0.0).sqrt();
        let q = -0.5 * (b + root.copysign(b));
        for t in [q / a, c / q] {
            if t > 0.0 && t < end - start {
                let value = self.joint(v, &self.place(i, start + t))[0];
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

    pub fn interval(&self, u: f64) -> usize {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn joints_without_a_speed_limit_still_move() {
        let free = [f64::INFINITY; MOST_JOINTS];
        let limits = Limits { velocity: free, acceleration: free, jerk: free };
        let waypoints: Vec<Row> = (0..4).map(|k| [0.1 * f64::from(k); MOST_JOINTS]).collect();
        let curve = Curve::new(2, &waypoints, &limits);
        assert_eq!(curve.knots(), 4);
        for (i, wanted) in [0.05, 0.15, 0.25].into_iter().enumerate() {
            let x = curve.at(i, 0.5);
            assert!((x[0] - wanted).abs() < 1e-12 && (x[1] - wanted).abs() < 1e-12, "{x:?}");
        }
    }
}

//! The geometric path: a twice differentiable curve through joint waypoints.

use crate::model::{MAX_JOINTS, Row};

/// Maximum deviation (rad or m) of a timed motion from its curve. It has two causes: the motion is cubic in time
/// between points of the curve, and it is averaged.
const IN_TIME: f64 = 2e-4;

/// Waypoints closer than this (rad or m) share a knot.
const SAME: f64 = 1e-9;

/// A cubic spline through waypoints with continuous second derivatives. Its parameter is the chord length.
#[derive(Debug, Clone)]
pub(crate) struct Spline {
    joints: usize,
    pub knots: Vec<f64>,
    values: Vec<Row>,
    second: Vec<Row>,
    /// Index of the knot of each waypoint.
    knot_of: Vec<usize>,
}

impl Spline {
    /// Returns the spline of `joints` joints through waypoints, with zero second derivatives at both ends. With
    /// `tangent`, the spline leaves the first waypoint in this direction, for a moving start without acceleration. It
    /// then passes only close to the second of more than two waypoints.
    pub fn through(joints: usize, waypoints: &[Row], tangent: Option<&Row>) -> Self {
        let mut values: Vec<Row> = Vec::with_capacity(waypoints.len());
        let mut knots: Vec<f64> = Vec::with_capacity(waypoints.len());
        let mut knot_of = Vec::with_capacity(waypoints.len());
        for w in waypoints {
            match (values.last(), knots.last()) {
                (Some(last), Some(at)) => {
                    let way = distance(joints, last, w);
                    if way > SAME {
                        knots.push(at + way);
                        values.push(*w);
                    }
                }
                _ => {
                    knots.push(0.0);
                    values.push(*w);
                }
            }
            knot_of.push(knots.len() - 1);
        }
        let second = second_derivatives(joints, &knots, &mut values, tangent);
        Self { joints, knots, values, second, knot_of }
    }

    /// Returns the index of a waypoint's knot; repeated waypoints share a knot.
    pub fn knot_of(&self, waypoint: usize) -> usize {
        self.knot_of[waypoint]
    }

    /// Returns ds/dt at the start of a motion with `velocity`, from the velocity's component along the tangent; 0 if
    /// this component points backwards.
    pub fn start_speed(&self, velocity: &Row) -> f64 {
        let tangent = &self.derivatives(0, 0.0)[1][..self.joints];
        let square: f64 = tangent.iter().map(|t| t * t).sum();
        (velocity.iter().zip(tangent).map(|(v, t)| v * t).sum::<f64>() / square).max(0.0)
    }

    /// Returns the maximum ds/dt in each interval between knots, given the minimum times `slowest` (s) between
    /// waypoints; infinity without a minimum time.
    pub fn paces(&self, slowest: &[f64]) -> Vec<f64> {
        let mut least = vec![0.0_f64; self.intervals()];
        for (w, time) in slowest.iter().enumerate().take(self.waypoints().saturating_sub(1)) {
            if self.knot_of(w + 1) > self.knot_of(w) {
                least[self.knot_of(w)] += time;
            }
        }
        let lengths = self.knots.windows(2).map(|pair| pair[1] - pair[0]);
        lengths.zip(least).map(|(s, time)| if time > 0.0 { s / time } else { f64::INFINITY }).collect()
    }

    /// Returns the number of waypoints of the spline.
    pub fn waypoints(&self) -> usize {
        self.knot_of.len()
    }

    /// Returns the number of intervals between knots.
    pub fn intervals(&self) -> usize {
        self.knots.len() - 1
    }

    pub fn length(&self) -> f64 {
        self.knots[self.knots.len() - 1]
    }

    /// Returns the joint values and their first two derivatives with respect to s, at `s` in interval `i`.
    pub fn derivatives(&self, i: usize, s: f64) -> [Row; 3] {
        if self.intervals() == 0 {
            return [self.values[0], [0.0; MAX_JOINTS], [0.0; MAX_JOINTS]];
        }
        let h = self.knots[i + 1] - self.knots[i];
        let (a, b) = ((self.knots[i + 1] - s) / h, (s - self.knots[i]) / h);
        let mut out = [[0.0; MAX_JOINTS]; 3];
        let (y0, y1, m0, m1) = (&self.values[i], &self.values[i + 1], &self.second[i], &self.second[i + 1]);
        for v in 0..self.joints {
            let bend = (a * a * a - a) * m0[v] + (b * b * b - b) * m1[v];
            out[0][v] = a * y0[v] + b * y1[v] + bend * h * h / 6.0;
            let turn = (3.0 * b * b - 1.0) * m1[v] - (3.0 * a * a - 1.0) * m0[v];
            out[1][v] = (y1[v] - y0[v]) / h + turn * h / 6.0;
            out[2][v] = a * m0[v] + b * m1[v];
        }
        out
    }

    /// Returns the third derivative of the joint values with respect to s in interval `i`.
    pub fn third(&self, i: usize) -> Row {
        let h = self.knots[i + 1] - self.knots[i];
        let mut out = [0.0; MAX_JOINTS];
        for v in 0..self.joints {
            out[v] = (self.second[i + 1][v] - self.second[i][v]) / h;
        }
        out
    }

    /// Returns the largest absolute second derivative of any joint.
    pub fn bend(&self) -> f64 {
        self.second.iter().flat_map(|row| &row[..self.joints]).fold(0.0, |most, m| most.max(m.abs()))
    }

    /// Returns the joint values at a fraction of interval `i`.
    pub fn at(&self, i: usize, fraction: f64) -> Row {
        let s = match self.knots.get(i + 1) {
            Some(next) => self.knots[i] + fraction * (next - self.knots[i]),
            None => 0.0,
        };
        self.derivatives(i, s)[0]
    }

    /// Returns points on the curve between two knots, about `spacing` apart in s, including both ends.
    pub fn along(&self, knots: std::ops::Range<usize>, spacing: f64) -> Vec<Row> {
        let mut out = vec![self.at(knots.start, 0.0)];
        for i in knots {
            let steps = ((self.knots[i + 1] - self.knots[i]) / spacing).ceil().max(1.0) as usize;
            out.extend((1..=steps).map(|k| self.at(i, k as f64 / steps as f64)));
        }
        out
    }

    /// Returns the minimum and maximum value of joint `v` in interval `i`.
    pub fn range(&self, v: usize, i: usize) -> (f64, f64) {
        let (start, end) = (self.knots[i], self.knots[i + 1]);
        let [first, slope, bend] = self.derivatives(i, start).map(|row| row[v]);
        let last = self.values[i + 1][v];
        let (mut low, mut high) = (first.min(last), first.max(last));
        // Extrema lie where slope + bend t + change t^2 / 2 = 0 inside the interval.
        let change = (self.second[i + 1][v] - self.second[i][v]) / (end - start);
        let (a, b, c) = (0.5 * change, bend, slope);
        let root = (b * b - 4.0 * a * c).max(0.0).sqrt();
        let q = -0.5 * (b + root.copysign(b));
        for t in [q / a, c / q] {
            if t > 0.0 && t < end - start {
                let value = self.derivatives(i, start + t)[0][v];
                (low, high) = (low.min(value), high.max(value));
            }
        }
        (low, high)
    }

    /// Returns whether every joint stays between `lower` and `upper` in these intervals, with a margin of [`IN_TIME`].
    /// Waypoints may lie outside the limits if the start does; the curve between them must not lie further outside.
    pub fn keeps_within(&self, mut intervals: std::ops::Range<usize>, lower: &Row, upper: &Row) -> bool {
        intervals.all(|i| {
            (0..self.joints).all(|v| {
                let (low, high) = self.range(v, i);
                let (from, to) = (self.values[i][v], self.values[i + 1][v]);
                low >= (lower[v] + IN_TIME).min(from).min(to) && high <= (upper[v] - IN_TIME).max(from).max(to)
            })
        })
    }
}

pub(crate) fn distance(joints: usize, a: &Row, b: &Row) -> f64 {
    (0..joints).map(|v| (b[v] - a[v]).powi(2)).sum::<f64>().sqrt()
}

/// Returns the length of the polyline through waypoints.
pub(crate) fn length(joints: usize, waypoints: &[Row]) -> f64 {
    waypoints.windows(2).map(|w| distance(joints, &w[0], &w[1])).sum()
}

/// Returns waypoints on a polyline: its vertices, and points at most `spacing` apart between them. The curve through
/// them bends only about one spacing before and after a vertex. Towards both ends the distance of the waypoints
/// decreases to `near`, so that another curve joined at an end bends this one only there.
pub(crate) fn rounded(joints: usize, corners: &[Row], spacing: f64, near: f64) -> Vec<Row> {
    let mut out: Vec<Row> = corners.first().copied().into_iter().collect();
    for (k, pair) in corners.windows(2).enumerate() {
        let whole = distance(joints, &pair[0], &pair[1]);
        let (first, last) = (k == 0, k + 2 == corners.len());
        let mut fractions = Vec::new();
        if whole > 0.0 {
            let mut step = near;
            let mut gone = near;
            while step < spacing && gone < 0.5 * whole {
                if first {
                    fractions.push(gone / whole);
                }
                if last {
                    fractions.push(1.0 - gone / whole);
                }
                step *= 2.0;
                gone += step;
            }
        }
        fractions.push(1.0);
        fractions.sort_by(f64::total_cmp);
        let mut from = 0.0;
        for to in fractions {
            let steps = ((to - from) * whole / spacing).ceil().max(1.0) as usize;
            for step in 1..=steps {
                let at = from + (to - from) * step as f64 / steps as f64;
                let mut x = pair[1];
                if at < 1.0 {
                    for v in 0..joints {
                        x[v] = pair[0][v] + (pair[1][v] - pair[0][v]) * at;
                    }
                }
                out.push(x);
            }
            from = to;
        }
    }
    out
}

/// Computes the second derivatives of the cubic spline at its knots, zero at both ends, by one tridiagonal solve for
/// all joints. With a tangent, the second of more than two waypoints is moved.
fn second_derivatives(joints: usize, knots: &[f64], y: &mut [Row], tangent: Option<&Row>) -> Vec<Row> {
    let count = knots.len();
    let mut m = vec![[0.0; MAX_JOINTS]; count];
    if count < 3 {
        return m;
    }
    let mut upper = vec![0.0; count];
    for i in 1..count - 1 {
        let (h0, h1) = (knots[i] - knots[i - 1], knots[i + 1] - knots[i]);
        // With a tangent t, the value at the second knot is y0 + t h + m1 h^2 / 6, where h is the first step.
        let given = if i <= 2 { tangent } else { None };
        let first = knots[1] - knots[0];
        let (mut before, mut pivot) = (h0, 2.0 * (h0 + h1));
        match (given, i) {
            (Some(_), 1) => pivot = 3.0 * h0 + 2.0 * h1 + h0 * h0 / h1,
            (Some(_), _) => before -= first * first / h0,
            _ => {}
        }
        pivot -= before * upper[i - 1];
        upper[i] = h1 / pivot;
        for v in 0..joints {
            let along = given.map(|tangent| y[0][v] + tangent[v] * first);
            let (after, behind) = match (given, along) {
                (Some(tangent), Some(along)) if i == 1 => ((y[2][v] - along) / h1, tangent[v]),
                (Some(_), Some(along)) => ((y[3][v] - y[2][v]) / h1, (y[2][v] - along) / h0),
                _ => ((y[i + 1][v] - y[i][v]) / h1, (y[i][v] - y[i - 1][v]) / h0),
            };
            m[i][v] = (6.0 * (after - behind) - before * m[i - 1][v]) / pivot;
        }
    }
    for i in (1..count - 1).rev() {
        let next = m[i + 1];
        for v in 0..joints {
            m[i][v] -= upper[i] * next[v];
        }
    }
    if let Some(tangent) = tangent {
        let first = knots[1] - knots[0];
        for v in 0..joints {
            y[1][v] = y[0][v] + tangent[v] * first + m[1][v] * first * first / 6.0;
        }
    }
    m
}

#[cfg(test)]
mod tests {
    use super::super::testing::row;
    use super::*;

    #[test]
    fn it_meets_waypoints_and_tangent_and_is_twice_differentiable() {
        let waypoints = [row(&[0.0, 0.0]), row(&[0.3, 0.1]), row(&[0.4, 0.4]), row(&[0.4, 0.4]), row(&[0.1, 0.9])];
        let tangent = row(&[0.6, -0.8]);
        for start in [None, Some(&tangent)] {
            let spline = Spline::through(2, &waypoints, start);
            assert_eq!(spline.intervals(), 3);
            for (w, point) in waypoints.iter().enumerate() {
                let k = spline.knot_of(w);
                let i = k.min(spline.intervals() - 1);
                let x = spline.at(i, (k - i) as f64);
                assert!(distance(2, &x, point) < if k == 1 && start.is_some() { 0.6 } else { 1e-12 });
            }
            for k in 1..spline.intervals() {
                let s = spline.knots[k];
                let (before, after) = (spline.derivatives(k - 1, s), spline.derivatives(k, s));
                for d in 0..3 {
                    assert!(distance(2, &before[d], &after[d]) < 1e-9, "derivative {d} at knot {k}");
                }
            }
            assert!(distance(2, &spline.derivatives(0, 0.0)[2], &row(&[0.0, 0.0])) < 1e-12);
            if start.is_some() {
                assert!(distance(2, &spline.derivatives(0, 0.0)[1], &tangent) < 1e-12);
            }
        }
    }

    #[test]
    fn rounded_keeps_corners_and_spacing() {
        let corners = [row(&[0.0, 0.0]), row(&[1.0, 0.0]), row(&[1.0, 1.5])];
        let points = rounded(2, &corners, 0.4, 0.05);
        for corner in &corners {
            assert!(points.iter().any(|p| distance(2, p, corner) == 0.0));
        }
        let steps: Vec<f64> = points.windows(2).map(|w| distance(2, &w[0], &w[1])).collect();
        assert!(steps.iter().all(|s| *s <= 0.4 + 1e-12));
        assert!((steps[0] - 0.05).abs() < 1e-12 && (steps[steps.len() - 1] - 0.05).abs() < 1e-12, "{steps:?}");
    }
}

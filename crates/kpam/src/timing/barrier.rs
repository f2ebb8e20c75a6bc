//! Log-barrier problem of a time-optimal speed with jerk limits (see `third_order`): linear forms of the spline
//! coefficients, their bounds, and Newton steps with pentadiagonal matrices.

use super::limits::Limits;
use super::third_order::{PathProblem, Station};

/// A linear form of three consecutive spline coefficients c; the first of them belongs to cell `at`.
#[derive(Clone, Copy)]
pub(super) struct Form {
    pub at: usize,
    pub of: [f64; 3],
}

impl Form {
    pub(super) fn value(&self, c: &[f64]) -> f64 {
        self.of.iter().zip(&c[self.at..]).map(|(f, c)| f * c).sum()
    }
}

/// A limit on a linear form `row`. If `x` names a station: |row| sqrt(x) <= limit; otherwise |row - middle| <= limit.
pub(super) struct Bound {
    pub row: Form,
    pub middle: f64,
    pub limit: f64,
    pub x: Option<usize>,
}

impl Bound {
    /// Returns the used fraction of the limit, without the factor sqrt(x).
    pub(super) fn value(&self, c: &[f64]) -> f64 {
        (self.row.value(c) - self.middle) / self.limit
    }
}

pub(super) struct Problem {
    pub cells: usize,
    pub steps: Vec<f64>,
    /// x = (ds/dt)² at each station except the first and the last.
    pub x: Vec<Form>,
    /// d²s/dt² at the same stations.
    pub w: Vec<Form>,
    /// Forms of x at the stations and in the middle of the cells, each with the maximum that the velocity limits allow.
    pub ceilings: Vec<(Form, f64)>,
    pub bounds: Vec<Bound>,
    /// The duration is the sum of step / sqrt(x) over these pairs of x in the middle of a cell and the cell's step.
    pub times: Vec<(Form, f64)>,
    /// Ratios of the first and the last coefficient c to their neighbours; `fixed` is added to the first coefficient.
    pub ends: [f64; 2],
    pub fixed: f64,
}

/// Returns the maximum x at a position, at which the first joint reaches its velocity limit.
fn greatest(limits: &Limits, slope: impl Fn(usize) -> f64, pace: f64, share: f64) -> f64 {
    let speed = (0..limits.joints()).map(|v| limits.velocity[v] / slope(v).abs()).fold(pace, f64::min);
    share * share * speed * speed
}

impl Problem {
    pub(super) fn new(path: &PathProblem<'_>) -> Self {
        let (limits, stations) = (path.limits, path.stations);
        let cells = stations.len() - 1;
        let n = limits.joints();
        let steps: Vec<f64> = stations.windows(2).map(|p| p[1].s - p[0].s).collect();
        let moving = path.begin > 0.0;
        let end = |near: f64, next: f64| 0.5 * near / (next + 1.5 * near);
        let last = cells - 1;
        let ends = [if moving { 0.0 } else { end(steps[0], steps[1]) }, end(steps[last], steps[last - 1])];
        let blank = Form { at: 0, of: [0.0; 3] };
        let (mut x, mut w) = (vec![blank; cells + 1], vec![blank; cells + 1]);
        for k in 1..cells {
            let both = steps[k - 1] + steps[k];
            x[k] = Form { at: k - 1, of: [steps[k] / both, steps[k - 1] / both, 0.0] };
            w[k] = Form { at: k - 1, of: [-1.0 / both, 1.0 / both, 0.0] };
        }
        let at_station = |k: usize| {
            let beside = &path.shares[k.saturating_sub(1)..(k + 1).min(cells)];
            let share = beside.iter().map(|s| s[0]).fold(1.0, f64::min);
            greatest(limits, |v| stations[k].first[v], path.pace[k], share)
        };
        let mut at_stations: Vec<f64> = (0..=cells).map(at_station).collect();
        // With constant jerk J from rest, s = J t^3 / 6, so x = (9 J s^2 / 2)^(2/3) at the end of the cell.
        for (cell, near, at_end) in [(0, 1, false), (last, last, true)] {
            if at_end || !moving {
                let jerk = (0..n)
                    .map(|v| {
                        let slope = stations[cell].first[v].abs().max(stations[cell + 1].first[v].abs());
                        path.shares[cell][2] * limits.jerk[v] / slope
                    })
                    .fold(f64::INFINITY, f64::min);
                let square = (4.5 * 0.97 * jerk * steps[cell] * steps[cell]).powf(2.0 / 3.0);
                at_stations[near] = at_stations[near].min(square);
            }
        }
        let ceilings = (1..cells).map(|k| (x[k], at_stations[k])).filter(|(_, most)| most.is_finite()).collect();
        let mut out = Self {
            cells,
            steps,
            x,
            w,
            ceilings,
            bounds: Vec::new(),
            times: Vec::new(),
            ends,
            fixed: path.begin * path.begin,
        };
        out.collect(path, moving);
        // The durations of the first and the last cell are 3 Δs / sqrt(x).
        out.times.push((out.x[last], 3.0 * out.steps[last]));
        if !moving {
            out.times.push((out.x[1], 3.0 * out.steps[0]));
        }
        out
    }

    /// Collects the forms of acceleration at stations, of jerk at both ends of cells, and of duration and velocity
    /// limits in the middle of cells.
    pub(super) fn collect(&mut self, path: &PathProblem<'_>, moving: bool) {
        let (limits, stations) = (path.limits, path.stations);
        let n = limits.joints();
        for k in 1..self.cells {
            let share = path.shares[k - 1][1].min(path.shares[k][1]);
            let (x, w) = (self.x[k], self.w[k]);
            for v in 0..n {
                let (first, second) = (stations[k].first[v], stations[k].second[v]);
                let of = [0, 1, 2].map(|i| first * w.of[i] + second * x.of[i]);
                let limit = share * limits.acceleration[v];
                self.bounds.push(Bound { row: Form { at: k - 1, of }, middle: 0.0, limit, x: None });
            }
            let (Some(torque), Some((most, room))) = (&stations[k].torque, path.load) else { continue };
            for v in 0..n {
                let [low, high] = torque.band(v, most[v], room);
                let of = [0, 1, 2].map(|i| torque.of_u[v] * w.of[i] + torque.of_x[v] * x.of[i]);
                let (middle, limit) = (0.5 * (low + high), 0.5 * (high - low));
                self.bounds.push(Bound { row: Form { at: k - 1, of }, middle, limit, x: None });
            }
        }
        // At a moving start, x and w are known, and the forms of the first cell depend on the first coefficient only.
        for cell in usize::from(!moving)..self.cells - 1 {
            let step = self.steps[cell];
            let at = cell.saturating_sub(1);
            let shifted = |form: &Form| {
                let mut of = [0.0; 3];
                for i in 0..3 {
                    if form.at + i >= at && form.at + i < at + 3 {
                        of[form.at + i - at] += form.of[i];
                    }
                }
                of
            };
            let own = cell - at;
            let mut start = shifted(&self.x[cell]);
            let end = shifted(&self.x[cell + 1]);
            if cell == 0 {
                start = [1.0, 0.0, 0.0];
            }
            let mut change = [0, 1, 2].map(|i| (start[i] + end[i]) / (step * step));
            change[own] -= 2.0 / (step * step);
            let mut middle = [0, 1, 2].map(|i| 0.25 * (start[i] + end[i]));
            middle[own] += 0.5;
            let middle = Form { at, of: middle };
            self.times.push((middle, step));
            // In the first cell of a moving start, x is nearly constant, so its middle needs no bound.
            if cell > 0 {
                let (h, Station { first, second, third, .. }) = (0.5 * step, &stations[cell]);
                let slope = |v: usize| first[v] + h * (second[v] + 0.5 * h * third[v]);
                let most = greatest(limits, slope, path.pace_inside[cell], path.shares[cell][0]);
                if most.is_finite() {
                    self.ceilings.push((middle, most));
                }
            }
            for (k, x) in [(cell, start), (cell + 1, end)] {
                // At a moving start, w is 0 and the jerk nearly equals that at the cell's end, which is bounded.
                if k == 0 {
                    continue;
                }
                let w = shifted(&self.w[k]);
                for v in 0..n {
                    let [first, second] = [stations[k].first[v], stations[k].second[v]];
                    let third = stations[cell].third[v];
                    let of = [0, 1, 2].map(|i| first * change[i] + 3.0 * second * w[i] + third * x[i]);
                    let limit = path.shares[cell][2] * limits.jerk[v];
                    self.bounds.push(Bound { row: Form { at, of }, middle: 0.0, limit, x: Some(k) });
                }
            }
        }
    }

    /// Sets the first and the last coefficient, which the boundary conditions determine from the other coefficients.
    pub(super) fn spread(&self, c: &mut [f64]) {
        let last = self.cells - 1;
        c[0] = self.fixed + self.ends[0] * c[1];
        c[last] = self.ends[1] * c[last - 1];
    }

    /// Returns the largest used fraction of the velocity limits (in terms of x), acceleration limits and jerk limits.
    pub(super) fn usage(&self, c: &[f64]) -> [f64; 3] {
        let mut out = [0.0_f64; 3];
        for (x, most) in &self.ceilings {
            out[0] = out[0].max(x.value(c) / most);
        }
        for bound in &self.bounds {
            let value = bound.value(c).abs();
            match bound.x {
                None => out[1] = out[1].max(value),
                Some(k) => out[2] = out[2].max(value * self.x[k].value(c).max(0.0).sqrt()),
            }
        }
        out
    }

    /// Returns the duration times `weight`, plus the barrier; `None` if a limit is violated. `slack` widens the limits.
    pub(super) fn merit(&self, c: &[f64], weight: f64, slack: f64) -> Option<f64> {
        let mut out = 0.0;
        let mut product = 1.0_f64;
        // One logarithm of a product of many terms is faster than one logarithm of each term.
        let mut log = |value: f64| {
            if value <= 0.0 || value.is_nan() {
                return false;
            }
            product *= value;
            if !(1e-200..1e200).contains(&product) {
                out -= product.ln();
                product = 1.0;
            }
            true
        };
        if c.iter().any(|v| *v <= 0.0) {
            return None;
        }
        if !self.ceilings.iter().all(|(x, most)| log(slack - x.value(c) / most)) {
            return None;
        }
        let roots = self.roots(c);
        for bound in &self.bounds {
            let value = bound.value(c) * bound.x.map_or(1.0, |k| roots[k]);
            if !(log(slack - value) && log(slack + value)) {
                return None;
            }
        }
        out -= product.ln();
        let time: f64 = self.times.iter().map(|(form, step)| step / form.value(c).sqrt()).sum();
        Some(out + weight * time)
    }

    pub(super) fn roots(&self, c: &[f64]) -> Vec<f64> {
        (0..=self.cells).map(|k| if k == 0 || k == self.cells { 1.0 } else { self.x[k].value(c).sqrt() }).collect()
    }

    /// Returns the Newton step of the free coefficients, and the Newton decrement.
    pub(super) fn newton(&self, c: &[f64], weight: f64, slack: f64) -> Option<(Vec<f64>, f64)> {
        let cells = self.cells;
        let mut gradient = vec![0.0; cells];
        let mut band = vec![[0.0; 3]; cells];
        let mut add = |at: usize, of: &[f64; 3], slope: f64, bend: f64| {
            for i in 0..3 {
                if of[i] != 0.0 {
                    gradient[at + i] += slope * of[i];
                    for k in i..3 {
                        band[at + i][k - i] += bend * of[i] * of[k];
                    }
                }
            }
        };
        for (x, most) in &self.ceilings {
            let slope = 1.0 / (slack * most - x.value(c));
            add(x.at, &x.of, slope, slope * slope);
        }
        let roots = self.roots(c);
        for bound in &self.bounds {
            let at = bound.row.at;
            let mut value = bound.value(c);
            let mut of = bound.row.of.map(|f| f / bound.limit);
            if let Some(k) = bound.x {
                let (x, root) = (self.x[k], roots[k]);
                for i in 0..3 {
                    let share = if at + i >= x.at && at + i < x.at + 3 { x.of[at + i - x.at] } else { 0.0 };
                    of[i] = root * of[i] + 0.5 * value / root * share;
                }
                value *= root;
            }
            let (below, above) = ((slack - value).recip(), (slack + value).recip());
            add(at, &of, below - above, below * below + above * above);
        }
        for (form, step) in &self.times {
            let middle = form.value(c);
            let root = middle.sqrt().recip();
            let slope = -0.5 * weight * step * root / middle;
            add(form.at, &form.of, slope, 1.5 * -slope / middle);
        }
        self.tie(&mut gradient, &mut band);
        let step = solve(&mut band[1..cells - 1], &gradient[1..cells - 1])?;
        let decrement = -step.iter().zip(&gradient[1..]).map(|(d, g)| d * g).sum::<f64>();
        Some((step, decrement))
    }

    /// Eliminates the first and the last coefficient, which depend on their neighbours.
    pub(super) fn tie(&self, gradient: &mut [f64], band: &mut [[f64; 3]]) {
        let last = self.cells - 1;
        let [first, end] = self.ends;
        gradient[1] += first * gradient[0];
        let [own, next, over] = band[0];
        band[1][0] += first * (2.0 * next + first * own);
        band[1][1] += first * over;
        gradient[last - 1] += end * gradient[last];
        let (own, next) = (band[last][0], band[last - 1][1]);
        band[last - 1][0] += end * (2.0 * next + end * own);
        if last >= 2 {
            let over = band[last - 2][2];
            band[last - 2][1] += end * over;
        }
    }
}

/// Solves the pentadiagonal system `band x = -right`; `None` if the matrix is not positive definite.
pub(super) fn solve(band: &mut [[f64; 3]], right: &[f64]) -> Option<Vec<f64>> {
    let n = band.len();
    let mut out: Vec<f64> = right.iter().map(|r| -r).collect();
    for i in 0..n {
        let pivot = band[i][0];
        if pivot <= 0.0 || pivot.is_nan() {
            return None;
        }
        let [one, two] = [band[i][1] / pivot, band[i][2] / pivot];
        if i + 1 < n {
            band[i + 1][0] -= one * band[i][1];
            band[i + 1][1] -= one * band[i][2];
            out[i + 1] -= one * out[i];
        }
        if i + 2 < n {
            band[i + 2][0] -= two * band[i][2];
            out[i + 2] -= two * out[i];
        }
        out[i] /= pivot;
        (band[i][1], band[i][2]) = (one, two);
    }
    for i in (0..n).rev() {
        let mut value = out[i];
        if i + 1 < n {
            value -= band[i][1] * out[i + 1];
        }
        if i + 2 < n {
            value -= band[i][2] * out[i + 2];
        }
        out[i] = value;
    }
    Some(out)
}

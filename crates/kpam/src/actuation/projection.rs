//! Projects joint vectors onto the constraints by damped Gauss-Newton within joint limits.

use nalgebra::Vector3;

use super::ActuationSearch;
use super::bands::any_across;
use super::seeds::halton;
use crate::ldl::solve_ldl;
use crate::model::{MAX_JOINTS, Row};
use crate::resolve::Resolved;

/// Maximum number of iterations of the projection.
pub(super) const PROJECTIONS: usize = 25;
/// A projection is abandoned if it does not halve its squared error within this number of iterations.
pub(super) const PATIENCE: usize = 8;
/// Maximum change (rad or m) of a joint in one iteration.
pub(super) const STEP: f64 = 0.5;
/// Fraction of an angle's tolerance within which its residual is zero.
pub(super) const SLACK: f64 = 0.3;
/// Fraction of every tolerance within which the residual is zero if no pose near the centre of the tolerances exists, and
/// the factor of the norm below which such a projection has converged. The norm is then at most 0.2 of the tightest
/// tolerance, so a converged pose is within `WIDE + 0.2 * CLOSER`, 0.98, of every tolerance.
const WIDE: f64 = 0.9;
const CLOSER: f64 = 0.4;
/// Distance (m) from the faces of the workspace box that projections aim for.
pub(super) const INNER: f64 = 1e-3;

/// Fractions of the tolerances of points and of angles from which the target of a projection is chosen.
const POINT_AIM: f64 = 0.7;
const ANGLE_AIM: f64 = 0.4;
/// Number of dimensions of the Halton sequence from which aims are drawn, the last one first, because the first
/// dimensions are used for start values.
const AIMED: usize = 12;

/// Point within the tolerances that a projection aims at; the default is their centre.
#[derive(Debug, Clone, Default)]
pub(super) struct Aim {
    /// Offset (m) from the target of each point constraint.
    points: Vec<Vector3<f64>>,
    /// Offset (rad) from the target angle of each axis constraint.
    angles: Vec<f64>,
    /// Whether any point within the tolerances will do.
    anywhere: bool,
}

impl Aim {
    /// Returns element `number`, counted from 1, of a fixed sequence of aims that covers the tolerances.
    pub fn within(resolved: &Resolved, number: usize) -> Self {
        let mut dimension = AIMED;
        let mut draw = || {
            dimension = dimension.checked_sub(1).unwrap_or(AIMED - 1);
            2.0 * halton(number, dimension) - 1.0
        };
        let points = resolved.points.iter().map(|p| {
            let [x, y, z] = [draw(), draw(), draw()];
            POINT_AIM * p.tolerance * Vector3::new(x, y, z)
        });
        let points = points.collect();
        let angles = resolved.axes.iter().map(|a| ANGLE_AIM * a.tolerance * draw()).collect();
        Self { points, angles, anywhere: false }
    }

    /// Returns an aim that every point within the tolerances meets.
    pub fn anywhere() -> Self {
        Self { anywhere: true, ..Self::default() }
    }
}

/// Residuals, each with its gradient.
pub(super) type Residuals = Vec<(Row, f64)>;

impl ActuationSearch<'_> {
    /// Moves `x` onto the constraints. Returns the remaining violation; zero or less means that they are met.
    pub(super) fn project(&mut self, x: &mut Row) -> f64 {
        let n = self.model.n().min(MAX_JOINTS);
        for v in 0..n {
            x[v] = x[v].clamp(self.lower[v], self.upper[v]);
        }
        let mut damping = 1e-3;
        let mut rows = std::mem::take(&mut self.residuals);
        let mut trial_rows = std::mem::take(&mut self.trial_residuals);
        self.residual_rows(x, &mut rows);
        let mut norm = square_sum(&rows);
        let near = if self.aim.anywhere { CLOSER * self.near } else { self.near };
        let near = near * near;
        let mut milestone = norm;
        for iteration in 1..=PROJECTIONS {
            if norm < near {
                break;
            }
            if iteration % PATIENCE == 0 {
                if norm > 0.5 * milestone {
                    break;
                }
                milestone = norm;
            }
            // Most arms have six or seven joints; with a fixed number the compiler unrolls all loops.
            let step = match n {
                6 => self.gauss_newton(6, x, &rows, damping),
                7 => self.gauss_newton(7, x, &rows, damping),
                _ => self.gauss_newton(n, x, &rows, damping),
            };
            let Some(step) = step else { break };
            let longest = step[..n].iter().fold(0.0, |m: f64, s| m.max(s.abs()));
            let shrink = if longest > STEP { STEP / longest } else { 1.0 };
            let mut trial = *x;
            for v in 0..n {
                trial[v] = (x[v] + shrink * step[v]).clamp(self.lower[v], self.upper[v]);
            }
            self.residual_rows(&trial, &mut trial_rows);
            let next = square_sum(&trial_rows);
            if next < norm {
                *x = trial;
                norm = next;
                std::mem::swap(&mut rows, &mut trial_rows);
                damping = (damping * 0.2).max(1e-9);
            } else {
                damping *= 10.0;
                if damping > 1e3 {
                    break;
                }
            }
        }
        self.residuals = rows;
        self.trial_residuals = trial_rows;
        self.violation(x)
    }

    /// Returns the damped Gauss-Newton step from `x`.
    #[inline(always)]
    fn gauss_newton(&self, n: usize, x: &Row, rows: &Residuals, damping: f64) -> Option<Row> {
        let mut gradient = [0.0; MAX_JOINTS];
        let mut normal = [[0.0; MAX_JOINTS]; MAX_JOINTS];
        for i in 0..n {
            gradient[i] = rows.iter().map(|(row, r)| row[i] * r).sum();
            for k in 0..=i {
                normal[i][k] = rows.iter().map(|(row, _)| row[i] * row[k]).sum();
            }
        }
        for v in 0..n {
            let pushed_out =
                (x[v] <= self.lower[v] && gradient[v] > 0.0) || (x[v] >= self.upper[v] && gradient[v] < 0.0);
            if pushed_out {
                // A joint at its limit stays there if the step would move it further out.
                gradient[v] = 0.0;
                for k in 0..n {
                    normal[v.max(k)][v.min(k)] = 0.0;
                }
                normal[v][v] = 1.0;
            }
        }
        for v in 0..n {
            normal[v][v] += damping;
            gradient[v] = -gradient[v];
        }
        solve_ldl(n, &normal, &gradient, |_| 0.0)
    }

    /// Computes the residuals and their gradients. A residual is zero well inside its constraint.
    fn residual_rows(&mut self, x: &Row, out: &mut Residuals) {
        self.place(x);
        out.clear();
        let placed = &self.placed;
        let hand = placed.hand;
        for (i, p) in self.resolved.points.iter().enumerate() {
            let at = hand.rotation * p.on_hand + hand.translation.vector;
            let target = self.aim.points.get(i).map_or(p.target, |off| p.target + off);
            let slack = if self.aim.anywhere { WIDE * p.tolerance } else { 0.0 };
            for (k, row) in placed.point_rows(&at).into_iter().enumerate() {
                let miss = at[k] - target[k];
                let miss = miss - miss.clamp(-slack, slack);
                // Within the tolerances, the pose may move freely.
                if miss != 0.0 || !self.aim.anywhere {
                    out.push((row, miss));
                }
            }
        }
        for (i, a) in self.resolved.axes.iter().enumerate() {
            let u = hand.rotation * a.on_hand;
            let cross = u.cross(&a.target);
            let sin = cross.norm();
            let angle = sin.atan2(u.dot(&a.target));
            let slack = if self.aim.anywhere { WIDE } else { SLACK } * a.tolerance;
            let center = a.center + self.aim.angles.get(i).copied().unwrap_or(0.0);
            let miss = angle - angle.clamp(center - slack, center + slack);
            if miss == 0.0 && self.aim.anywhere {
                continue;
            }
            // If the directions are parallel or antiparallel, a rotation about any perpendicular axis separates them.
            let normal = if sin > 1e-9 { cross / sin } else { any_across(&u) };
            out.push((placed.angular_row(&-normal), miss));
        }
        if let Some([low, high]) = self.problem.options.workspace {
            for k in 0..3 {
                let c = hand.translation.vector[k];
                // In a thin box, the margin is at most a quarter of the thickness, so that the two ends stay in order.
                let inner = INNER.min(0.25 * (high[k] - low[k]));
                let miss = c - c.clamp(low[k] + inner, high[k] - inner);
                if miss != 0.0 {
                    out.push((placed.linear_row(&hand.translation.vector, &Vector3::ith(k, 1.0)), miss));
                }
            }
        }
    }
}

impl Resolved {
    /// Returns a norm of the residuals below which every constraint holds, well inside the tightest tolerance.
    pub(super) fn nearness(&self) -> f64 {
        let points = self.points.iter().map(|p| p.tolerance);
        let angles = self.axes.iter().map(|a| a.tolerance);
        (0.2 * points.chain(angles).fold(INNER, f64::min)).max(1e-12)
    }
}

fn square_sum(rows: &[(Row, f64)]) -> f64 {
    rows.iter().map(|(_, r)| r * r).sum()
}

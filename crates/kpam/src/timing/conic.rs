//! Time-optimal speed along a path as a second-order cone program (Verscheure, Demeulenaere, Swevers, De Schutter and
//! Diehl, "Time-Optimal Path Tracking for Robots: A Convex Optimization Approach", 2009), solved by Clarabel.
//!
//! Variables: x at each station, c <= sqrt(x) at each station, d >= 1 / (c_i + c_i+1) on each cell. The time of a cell
//! is 2 Δs d. The path acceleration u follows as (x_i+1 - x_i) / 2 Δs.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultInfo, DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SecondOrderConeT, SolverStatus,
    SupportedConeT, ZeroConeT,
};

use super::grid::Grid;
use super::limits::Limits;
use crate::Cancel;

/// Rows of A x + s = b, with s in a cone, collected as triplets.
#[derive(Default)]
struct Rows {
    rows: Vec<usize>,
    columns: Vec<usize>,
    values: Vec<f64>,
    b: Vec<f64>,
}

impl Rows {
    fn push(&mut self, entries: &[(usize, f64)], b: f64) {
        for (column, value) in entries {
            self.rows.push(self.b.len());
            self.columns.push(*column);
            self.values.push(*value);
        }
        self.b.push(b);
    }
}

/// Returns the squared path speed x = (ds/dt)² of the fastest motion at each station of the grid. It is `begin` at the
/// first station and 0 at the last. `None` if no motion exists.
pub(crate) fn fastest(grid: &Grid, limits: &Limits, begin: f64, cancel: Option<&Cancel>) -> Option<Vec<f64>> {
    let cells = grid.cells();
    let ceilings = grid.ceilings(limits, begin);
    // The median ceiling scales x to about 1 along the path. The maximum ceiling is unsuitable: where the path hardly
    // moves any joint, velocity limits allow an arbitrarily large x, and x elsewhere would fall below the solver's
    // tolerance.
    let mut finite: Vec<f64> = ceilings.iter().copied().filter(|c| c.is_finite() && *c > 0.0).collect();
    finite.sort_by(f64::total_cmp);
    let unit = finite.get(finite.len() / 2).copied().unwrap_or(1.0);
    let (x, c, d) = (|k: usize| k, |k: usize| cells + 1 + k, |k: usize| 2 * (cells + 1) + k);
    let variables = 3 * cells + 2;
    let mut rows = Rows::default();
    rows.push(&[(x(0), 1.0)], begin / unit);
    rows.push(&[(x(cells), 1.0)], 0.0);
    let equalities = rows.b.len();
    for (k, ceiling) in ceilings.iter().enumerate() {
        rows.push(&[(x(k), -1.0)], 0.0);
        if ceiling.is_finite() {
            rows.push(&[(x(k), 1.0)], ceiling / unit);
        }
    }
    let mut bounds = Vec::new();
    for cell in 0..cells {
        let twice = 2.0 * grid.step(cell);
        grid.rows(limits, cell, &mut bounds);
        for &[a, b, low, high] in &bounds {
            // With u = (x_next - x) / 2 Δs, a row low <= a u + b x <= high becomes linear in x and x_next.
            let (now, next) = (b - a / twice, a / twice);
            let size = now.abs().max(next.abs()) * unit;
            if size > 0.0 {
                for (sign, most) in [(1.0, high), (-1.0, -low)] {
                    let entries = [(x(cell), sign * now * unit / size), (x(cell + 1), sign * next * unit / size)];
                    rows.push(&entries, most / size);
                }
            }
        }
    }
    let inequalities = rows.b.len() - equalities;
    let mut cones: Vec<SupportedConeT<f64>> = vec![ZeroConeT(equalities), NonnegativeConeT(inequalities)];
    for k in 0..=cells {
        // Cone form of c^2 <= x: |(2 c, x - 1)| <= x + 1.
        rows.push(&[(x(k), -1.0)], 1.0);
        rows.push(&[(c(k), -2.0)], 0.0);
        rows.push(&[(x(k), -1.0)], -1.0);
        cones.push(SecondOrderConeT(3));
    }
    let mut q = vec![0.0; variables];
    let length = grid.stations[cells].s;
    for k in 0..cells {
        // Cone form of 1 <= d (c + c_next): |(2, c + c_next - d)| <= c + c_next + d.
        rows.push(&[(c(k), -1.0), (c(k + 1), -1.0), (d(k), -1.0)], 0.0);
        rows.push(&[], 2.0);
        rows.push(&[(c(k), -1.0), (c(k + 1), -1.0), (d(k), 1.0)], 0.0);
        cones.push(SecondOrderConeT(3));
        q[d(k)] = 2.0 * grid.step(k) / length;
    }
    let count = rows.b.len();
    let a = CscMatrix::new_from_triplets(count, variables, rows.rows, rows.columns, rows.values);
    let p = CscMatrix::zeros((variables, variables));
    let settings = DefaultSettings { verbose: false, ..DefaultSettings::default() };
    let mut solver = DefaultSolver::new(&p, &q, &a, &rows.b, &cones, settings).ok()?;
    if let Some(cancel) = cancel.cloned() {
        solver.set_termination_callback(move |_: &DefaultInfo<f64>| cancel.is_cancelled());
    }
    solver.solve();
    if !matches!(solver.solution.status, SolverStatus::Solved | SolverStatus::AlmostSolved) {
        return None;
    }
    let mut out: Vec<f64> = solver.solution.x[..=cells].iter().map(|v| v.max(0.0) * unit).collect();
    (out[0], out[cells]) = (begin, 0.0);
    Some(out)
}

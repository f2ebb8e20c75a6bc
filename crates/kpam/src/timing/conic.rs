//! Time-optimal speed along a path as a second-order cone program, solved by Clarabel (Verscheure, Demeulenaere,
//! Swevers, De Schutter and Diehl, "Time-Optimal Path Tracking for Robots: A Convex Optimization Approach", 2009). Tests
//! check reachability analysis against it.
//!
//! Variables: x at each station, c <= sqrt(x) at each station, d >= 1 / (c_i + c_i+1) on each cell. The time of a cell
//! is 2 Δs d. The path acceleration u follows as (x_i+1 - x_i) / 2 Δs.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SecondOrderConeT, SolverStatus, SupportedConeT,
    ZeroConeT,
};

use proptest::prelude::*;

use super::grid::Grid;
use super::limits::Limits;
use super::spline::Spline;
use super::{reachability, testing};

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
fn fastest(grid: &Grid, limits: &Limits, begin: f64) -> Option<Vec<f64>> {
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
    solver.solve();
    if !matches!(solver.solution.status, SolverStatus::Solved | SolverStatus::AlmostSolved) {
        return None;
    }
    let mut out: Vec<f64> = solver.solution.x[..=cells].iter().map(|v| v.max(0.0) * unit).collect();
    (out[0], out[cells]) = (begin, 0.0);
    Some(out)
}

/// Checks that reachability analysis finds a motion through waypoints that takes as long as the solution of the cone
/// program.
fn agree(waypoints: &[[f64; 3]]) -> Result<(), TestCaseError> {
    let limits = Limits::new(&[1.0, 2.0, 1.5], &[4.0, 3.0, 5.0], &[1e5; 3]).unwrap();
    let rows: Vec<_> = waypoints.iter().map(|values| testing::row(values)).collect();
    let grid = Grid::new(3, &Spline::through(3, &rows, None), &[]);
    let duration = |x: Option<Vec<f64>>| -> f64 {
        let speed: Vec<f64> = x.unwrap().into_iter().map(f64::sqrt).collect();
        (0..grid.cells()).map(|cell| 2.0 * grid.step(cell) / (speed[cell] + speed[cell + 1])).sum()
    };
    let [direct, conic] = [reachability::fastest(&grid, &limits, 0.0), fastest(&grid, &limits, 0.0)].map(duration);
    prop_assert!((conic / direct - 1.0).abs() < 0.02, "{conic} {direct}");
    Ok(())
}

proptest! {
    #[test]
    fn reachability_analysis_is_as_fast(waypoints in prop::collection::vec(prop::array::uniform3(-2.0..2.0f64), 2..6)) {
        agree(&waypoints)?;
    }
}

#[test]
fn reachability_analysis_is_as_fast_where_velocity_allows_any_speed() {
    // Near its middle waypoint, this path hardly moves any joint, so the maximum x is far greater there.
    agree(&[
        [-0.7041559606013992, 0.7335081398911925, 0.0],
        [-1.571756411584735, 0.6090956407429002, -0.8730807125134804],
        [0.5219715893610742, 0.8694962914828714, 1.2345207445595956],
    ])
    .unwrap();
}

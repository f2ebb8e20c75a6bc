//! Time-optimal speed along a path by reachability analysis (Pham and Pham, "A New Approach to Time-Optimal Path
//! Parameterization Based on Reachability Analysis", 2018). A backward pass computes the greatest x at each station
//! from which the end can be reached; a forward pass drives as fast as these bounds allow. Each step is a linear
//! program in (u, x), solved in closed form.

use super::grid::Grid;
use super::limits::Limits;
use super::time_scaling::ROUNDING;

/// A row's coefficient of u counts as zero if it is smaller than this multiple of the row's coefficient of x.
const FLAT: f64 = 1e-9;

/// Range of the path acceleration u: slope * x + below <= u <= slope * x + above.
#[derive(Debug, Clone, Copy)]
struct Band {
    slope: f64,
    below: f64,
    above: f64,
}

/// Ranges of u for all cells in one list, and the maximum x that the rows without u allow in each cell.
struct Bands {
    bands: Vec<Band>,
    ends: Vec<usize>,
    caps: Vec<f64>,
}

impl Bands {
    fn new(grid: &Grid, limits: &Limits) -> Self {
        let mut out = Self { bands: Vec::new(), ends: vec![0], caps: Vec::new() };
        let mut rows = Vec::new();
        for cell in 0..grid.cells() {
            grid.rows(limits, cell, &mut rows);
            let mut cap = f64::INFINITY;
            for &[a, b, low, high] in &rows {
                if a.abs() > FLAT * b.abs() {
                    let (below, above) = if a > 0.0 { (low / a, high / a) } else { (high / a, low / a) };
                    out.bands.push(Band { slope: -b / a, below, above });
                } else if b != 0.0 {
                    cap = cap.min(if b > 0.0 { high / b } else { low / b });
                }
            }
            out.ends.push(out.bands.len());
            out.caps.push(cap);
        }
        out
    }

    fn of(&self, cell: usize) -> &[Band] {
        &self.bands[self.ends[cell]..self.ends[cell + 1]]
    }

    /// Returns the minimum and maximum u in a cell of length `step`, if x is given at the cell's start and is at most
    /// `next` at its end.
    fn range(&self, cell: usize, x: f64, step: f64, next: f64) -> (f64, f64) {
        let turn = 0.5 / step;
        let (mut low, mut high) = (-turn * x, turn * (next - x));
        for band in self.of(cell) {
            let middle = band.slope * x;
            let (least, most) = (middle + band.below, middle + band.above);
            low = if least > low { least } else { low };
            high = if most < high { most } else { high };
        }
        (low, high)
    }

    /// Returns the derivative with respect to x of the width of the range of u that `range` returns.
    fn room_slope(&self, cell: usize, x: f64, step: f64, (low, high): (f64, f64)) -> f64 {
        let (mut below, mut above) = (-0.5 / step, -0.5 / step);
        for band in self.of(cell) {
            let middle = band.slope * x;
            below = if middle + band.below >= low { band.slope } else { below };
            above = if middle + band.above <= high { band.slope } else { above };
        }
        above - below
    }

    /// Returns the maximum x up to `most` at a cell's start from which some u leads to at most `next` at its end.
    fn greatest(&self, cell: usize, most: f64, step: f64, next: f64) -> f64 {
        let mut x = most.min(self.caps[cell]).min(1e30);
        // The width of the range of u is concave in x and positive at zero, so Newton's method descends to its root.
        // The number of steps is at most the number of different bounds.
        for _ in 0..32 {
            let (low, high) = self.range(cell, x, step, next);
            let room = high - low;
            if room >= -1e-12 * (high.abs() + low.abs()) {
                break;
            }
            let slope = self.room_slope(cell, x, step, (low, high));
            if slope >= 0.0 {
                break;
            }
            x = (x - room / slope).max(0.0);
        }
        x
    }
}

/// Returns x of the fastest motion at each station, from `begin` to 0 at the last; `None` if `begin` is too large.
pub(crate) fn fastest(grid: &Grid, limits: &Limits, begin: f64) -> Option<Vec<f64>> {
    let cells = grid.cells();
    let bands = Bands::new(grid, limits);
    let mut x = grid.ceilings(limits, begin);
    x[cells] = 0.0;
    for cell in (0..cells).rev() {
        x[cell] = bands.greatest(cell, x[cell], grid.step(cell), x[cell + 1]);
    }
    if begin > x[0] * (1.0 + ROUNDING) {
        return None;
    }
    x[0] = begin;
    for cell in 0..cells {
        let step = grid.step(cell);
        let (low, high) = bands.range(cell, x[cell], step, x[cell + 1]);
        x[cell + 1] = (x[cell] + 2.0 * step * high.max(low)).clamp(0.0, x[cell + 1]);
    }
    Some(x)
}

//! Point clouds as obstacles: a bucket grid, and how many cells away the nearest point is.

use crate::lanes::{F32x8, WIDTH, Wide, wide};
use nalgebra::Point3;

use super::solid::Points;
use crate::Aabb;

/// Edge of a cell (m); coarser where the cloud is large.
const CELL: f64 = 0.04;
/// Most cells of a grid.
const MAX_CELLS: f64 = 400_000.0;

/// Points of one radius in cells of a grid.
#[derive(Debug, Clone)]
pub(crate) struct PointGrid {
    /// Body that the points belong to.
    pub body: usize,
    /// Radius of every point (m).
    pub radius: f64,
    points: Vec<Point3<f64>>,
    lanes: Vec<Points>,
    /// First block of lanes of each cell.
    starts: Vec<u32>,
    /// Cells between each cell and the nearest that holds a point (Chebyshev).
    near: Vec<u8>,
    origin: Point3<f64>,
    cell: f64,
    dims: [usize; 3],
    /// Bound on the rounding error of a distance in single precision (m).
    slack: f32,
}

/// Cells around the occupied ones, so that places near the cloud lie in the grid.
const RIM: usize = 3;

impl PointGrid {
    /// The grid of a cloud in the base frame.
    pub fn new(body: usize, points: Vec<Point3<f64>>, radius: f64) -> Self {
        let bounds = Aabb::around(&points, 0.0);
        let span = bounds.max - bounds.min;
        let count = |cell: f64| (0..3).map(move |k| (span[k] / cell).floor() + 1.0 + 2.0 * RIM as f64);
        let mut cell = CELL;
        while count(cell).product::<f64>() > MAX_CELLS {
            cell *= 1.5;
        }
        let mut dims = [0; 3];
        for (d, n) in dims.iter_mut().zip(count(cell)) {
            *d = n as usize;
        }
        let origin = bounds.min - nalgebra::Vector3::repeat(cell * RIM as f64);
        let size = points.iter().map(|p| p.coords.norm()).fold(1.0, f64::max);
        let mut out = Self {
            body,
            radius,
            points,
            lanes: Vec::new(),
            starts: Vec::new(),
            near: Vec::new(),
            origin,
            cell,
            dims,
            slack: (2e-6 * size) as f32,
        };
        out.fill();
        out
    }

    fn fill(&mut self) {
        let cells = self.dims.iter().product::<usize>();
        let home: Vec<u32> = self
            .points
            .iter()
            .map(|p| self.index([0, 1, 2].map(|k| (p[k] - self.origin[k]) / self.cell)) as u32)
            .collect();
        let mut counts = vec![0u32; cells];
        for c in &home {
            counts[*c as usize] += 1;
        }
        self.starts = Vec::with_capacity(cells + 1);
        let mut total = 0;
        for n in &counts {
            self.starts.push(total);
            total += n.div_ceil(8);
        }
        self.starts.push(total);
        // Lanes that hold no point are out of reach of everything.
        let mut flat = vec![[[1e9f32; 8]; 3]; total as usize];
        let mut filled = vec![0u32; cells];
        for (p, c) in self.points.iter().zip(&home) {
            let c = *c as usize;
            let (block, lane) = (self.starts[c] + filled[c] / 8, filled[c] % 8);
            for k in 0..3 {
                flat[block as usize][k][lane as usize] = p[k] as f32;
            }
            filled[c] += 1;
        }
        self.lanes = flat.into_iter().map(|[x, y, z]| [F32x8::new(x), F32x8::new(y), F32x8::new(z)]).collect();
        self.near = counts.iter().map(|n| if *n > 0 { 0 } else { u8::MAX }).collect();
        self.spread();
    }

    /// Chebyshev distances, axis by axis: along each, a cell is `max(steps, distance there)` from the best in its row.
    fn spread(&mut self) {
        const FURTHEST: usize = 12;
        let [nx, ny, nz] = self.dims;
        let mut next = self.near.clone();
        for (stride, length) in [(1, nx), (nx, ny), (nx * ny, nz)] {
            next.fill(u8::MAX);
            let lines = nx * ny * nz / length.max(1);
            for line in 0..lines {
                let first = match stride {
                    1 => line * nx,
                    s if s == nx => (line / nx) * nx * ny + line % nx,
                    _ => line,
                };
                for i in 0..length {
                    let value = self.near[first + i * stride];
                    if value == u8::MAX {
                        continue;
                    }
                    let (low, high) = (i.saturating_sub(FURTHEST), (i + FURTHEST).min(length - 1));
                    for j in low..=high {
                        let steps = i.abs_diff(j) as u8;
                        let at = first + j * stride;
                        next[at] = next[at].min(value.max(steps));
                    }
                }
            }
            std::mem::swap(&mut self.near, &mut next);
        }
        for n in &mut self.near {
            *n = (*n).min(FURTHEST as u8 + 1);
        }
    }

    fn index(&self, at: [f64; 3]) -> usize {
        let clamp = |k: usize| (at[k].max(0.0) as usize).min(self.dims[k] - 1);
        clamp(0) + self.dims[0] * (clamp(1) + self.dims[1] * clamp(2))
    }

    /// Lower bounds of the distance (m) from places to the nearest ball of the cloud. Beyond a cell's width they are coarse.
    pub fn distances(&self, p: &Points) -> [f32; WIDTH] {
        struct Work<'a>(&'a PointGrid, &'a Points);
        impl Wide for Work<'_> {
            type Output = [f32; WIDTH];
            #[inline(always)]
            fn run(self) -> Self::Output {
                let [x, y, z] = [self.1[0].to_array(), self.1[1].to_array(), self.1[2].to_array()];
                let mut out = [0.0; WIDTH];
                for l in 0..WIDTH {
                    out[l] = self.0.distance([x[l], y[l], z[l]]);
                }
                out
            }
        }
        wide(Work(self, p))
    }

    #[inline(always)]
    fn distance(&self, p: [f32; 3]) -> f32 {
        let at = [0, 1, 2].map(|k| (f64::from(p[k]) - self.origin[k]) / self.cell);
        // Outside of the grid: at least as far as its empty rim is wide, and what lies between.
        let mut outside: f64 = 0.0;
        for k in 0..3 {
            outside = outside.max(-at[k]).max(at[k] - self.dims[k] as f64);
        }
        let cell = self.cell as f32;
        let ball = self.radius as f32 + self.slack;
        if outside > 0.0 {
            return (outside as f32 + RIM as f32 - 1.0) * cell - ball;
        }
        let near = self.near[self.index(at)];
        if near > 1 {
            return f32::from(near - 1) * cell - ball;
        }
        // Points beyond the neighbouring cells are at least one cell away.
        let mut least = F32x8::splat(cell * cell);
        let home = at.map(|v| v as usize);
        let [x, y, z] = p.map(F32x8::splat);
        for k in home[2].saturating_sub(1)..=(home[2] + 1).min(self.dims[2] - 1) {
            for j in home[1].saturating_sub(1)..=(home[1] + 1).min(self.dims[1] - 1) {
                let row = self.dims[0] * (j + self.dims[1] * k);
                let (from, to) = (home[0].saturating_sub(1), (home[0] + 1).min(self.dims[0] - 1));
                // Cells of a row lie one after the other.
                let blocks = self.starts[row + from] as usize..self.starts[row + to + 1] as usize;
                for [a, b, c] in &self.lanes[blocks] {
                    let (a, b, c) = (*a - x, *b - y, *c - z);
                    least = least.min(a * a + b * b + c * c);
                }
            }
        }
        least.to_array().into_iter().fold(f32::MAX, f32::min).sqrt() - ball
    }

    /// Calls `visit` with the points in a box, eight at a time; lanes without a point are far away.
    #[inline(always)]
    pub fn within(&self, bounds: &Aabb, mut visit: impl FnMut(&Points) -> bool) -> bool {
        let low = [0, 1, 2].map(|k| ((bounds.min[k] - self.origin[k]) / self.cell).floor());
        let high = [0, 1, 2].map(|k| ((bounds.max[k] - self.origin[k]) / self.cell).floor());
        if (0..3).any(|k| high[k] < 0.0 || low[k] >= self.dims[k] as f64) {
            return true;
        }
        let range = |k: usize| (low[k].max(0.0) as usize, (high[k] as usize).min(self.dims[k] - 1));
        let ([xl, xh], [yl, yh], [zl, zh]) =
            ([range(0).0, range(0).1], [range(1).0, range(1).1], [range(2).0, range(2).1]);
        for k in zl..=zh {
            for j in yl..=yh {
                let row = self.dims[0] * (j + self.dims[1] * k);
                for block in self.starts[row + xl] as usize..self.starts[row + xh + 1] as usize {
                    if !visit(&self.lanes[block]) {
                        return false;
                    }
                }
            }
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn bounds_are_never_above_the_distance(
            cloud in prop::collection::vec(prop::array::uniform3(-0.4..0.4f64), 1..60),
            at in prop::array::uniform3(-0.8..0.8f64),
        ) {
            let points: Vec<Point3<f64>> = cloud.iter().map(|p| Point3::from(*p)).collect();
            let grid = PointGrid::new(0, points.clone(), 0.01);
            let wanted = points.iter().map(|p| (p - Point3::from(at)).norm()).fold(f64::INFINITY, f64::min) - 0.01;
            let found = f64::from(grid.distances(&at.map(|v| F32x8::splat(v as f32)))[5]);
            prop_assert!(found <= wanted + 1e-7, "{found} {wanted}");
            // Near the cloud it is the distance itself.
            prop_assert!(wanted > 0.03 || (found - wanted).abs() < 1e-5, "{found} {wanted}");
        }
    }
}

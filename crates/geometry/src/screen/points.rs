//! Point clouds and voxels as obstacles, sorted into a grid. Its corners store lower bounds of the distance to the
//! nearest point, or to the nearest centre of a voxel.

use crate::lanes::{F32x8, WIDTH};
use nalgebra::{Point3, Rotation3, Vector3};

use super::solid::Points;
use crate::Aabb;

/// Edge length of a grid cell (m); larger for a large cloud.
const CELL: f64 = 0.04;
/// Maximum number of cells of a grid.
const MAX_CELLS: f64 = 400_000.0;
/// Distances along an axis are capped at this number of grid cells.
const FURTHEST: i16 = 12;
/// Up to this distance (cells), bounds use the boxes around the cells' points; beyond it, the cells themselves.
const TIGHT: usize = 3;
/// Number of consecutive grid corners compared with a cell's box at once, which covers all within [`TIGHT`] cells.
const RUN: usize = 8;
/// Relative error of a squared distance in single precision.
const ROUNDING: f32 = 1e-6;

/// Relative rounding error of a position in single precision, in any direction.
const PLACED: f64 = 1.1e-7;

/// Shape of the elements of a grid around their centres.
#[derive(Debug, Clone)]
pub(crate) enum Element {
    /// Spheres of a radius (m).
    Ball(f64),
    /// Cubes with half an edge length (m), and the rotation of their axes in the base frame.
    Cube(f64, Rotation3<f64>),
}

/// Spheres or cubes of equal size, sorted into the cells of the grid that encloses their centres.
#[derive(Debug, Clone)]
pub(crate) struct PointGrid {
    /// Index of the body to which the points belong.
    pub body: usize,
    /// Radius (m) by which every element's core is enlarged: the radius of spheres, whose core is a point, and 0 for
    /// cubes, which are their own core.
    pub radius: f64,
    /// Vertices of the core relative to its centre (m, base axes): one for spheres, eight for cubes.
    pub core: Vec<Vector3<f64>>,
    /// Maximum distance (m) of a point of the screened core from its centre; 0 for spheres.
    pub extent: f64,
    /// Half the edge length (m) of screened cubes, and the rotation from base axes to their axes.
    cube: Option<(f32, [[f32; 3]; 3])>,
    /// Lower bound of the distance (m) between the base's origin and every point's sphere; 0 if unknown.
    pub from_base: f32,
    lanes: Vec<Points>,
    /// Centre of the element in each lane of `lanes` (m, base frame), for exact distances.
    centers: Vec<Point3<f64>>,
    /// Index of each cell's first block of eight points.
    starts: Vec<u32>,
    /// Lower bound of the squared distance (m²) from each cell corner to the nearest point.
    field: Vec<f32>,
    origin: Point3<f64>,
    cell: f64,
    dims: [usize; 3],
    /// Upper bound on the rounding error of a distance in single precision (m).
    slack: f32,
    /// Upper bound on the rounding error of a squared distance (m²).
    squared_slack: f32,
}

/// Box around the points of a cell, measured in cells from the grid's origin.
#[derive(Clone, Copy)]
struct Extent {
    low: [f32; 3],
    high: [f32; 3],
}

impl Extent {
    const NOTHING: Self = Self { low: [f32::INFINITY; 3], high: [f32::NEG_INFINITY; 3] };
}

impl PointGrid {
    /// Creates the grid of elements with these centres (base frame); `from_base` has the meaning of the field.
    pub fn new(body: usize, points: &[Point3<f64>], element: &Element, from_base: f32) -> Self {
        let bounds = Aabb::around(points, 0.0);
        let span = bounds.max - bounds.min;
        let count = |cell: f64| (0..3).map(move |k| (span[k] / cell).floor() + 1.0);
        let mut cell = match element {
            Element::Ball(_) => CELL,
            // A cell smaller than a cube would have empty lanes.
            Element::Cube(half, _) => CELL.max(2.0 * half),
        };
        while count(cell).product::<f64>() > MAX_CELLS {
            cell *= 1.5;
        }
        let mut dims = [0; 3];
        for (d, n) in dims.iter_mut().zip(count(cell)) {
            *d = n as usize;
        }
        let size = points.iter().map(|p| p.coords.norm()).fold(1.0, f64::max);
        let (mut radius, mut core, mut extent, mut cube) = (0.0, vec![Vector3::zeros()], 0.0, None);
        match element {
            Element::Ball(r) => radius = *r,
            Element::Cube(half, axes) => {
                let corner = |i: usize| Vector3::from_fn(|k, _| if i >> k & 1 == 0 { -half } else { *half });
                core = (0..8).map(|i| axes * corner(i)).collect();
                // Screening uses centres in single precision; the enlarged cube contains the cube that was given.
                let half = half + PLACED * size;
                extent = half * 3.0_f64.sqrt();
                let turn = axes.inverse();
                let row = |r: usize| [0, 1, 2].map(|c| turn.matrix()[(r, c)] as f32);
                cube = Some((half as f32, [row(0), row(1), row(2)]));
            }
        }
        let mut out = Self {
            body,
            radius,
            core,
            extent,
            cube,
            from_base,
            lanes: Vec::new(),
            centers: Vec::new(),
            starts: Vec::new(),
            field: Vec::new(),
            origin: bounds.min,
            cell,
            dims,
            slack: (4e-6 * size) as f32,
            // The rounding error of a square grows with the square; below 4 m, measurements showed a smaller error.
            squared_slack: ROUNDING * (size * (size / 4.0).max(1.0)) as f32,
        };
        out.fill(points);
        out
    }

    fn fill(&mut self, points: &[Point3<f64>]) {
        let cells = self.dims.iter().product::<usize>();
        let mut counts = vec![0u32; cells];
        let mut extents = vec![Extent::NOTHING; cells];
        let place = |p: &Point3<f64>| {
            let at = [0, 1, 2].map(|k| (p[k] - self.origin[k]) / self.cell);
            let c = self.index(at);
            counts[c] += 1;
            let extent = &mut extents[c];
            for k in 0..3 {
                extent.low[k] = extent.low[k].min(at[k] as f32);
                extent.high[k] = extent.high[k].max(at[k] as f32);
            }
            c as u32
        };
        let home: Vec<u32> = points.iter().map(place).collect();
        let mut starts = Vec::with_capacity(cells + 1);
        let mut total = 0;
        for n in &counts {
            starts.push(total);
            total += n.div_ceil(WIDTH as u32);
        }
        starts.push(total);
        // Unused lanes hold a point that is far from everything.
        let mut lanes = vec![[F32x8::splat(1e9); 3]; total as usize];
        let mut centers = vec![Point3::new(1e9, 1e9, 1e9); total as usize * WIDTH];
        let mut filled = vec![0u32; cells];
        for (p, c) in points.iter().zip(&home) {
            let c = *c as usize;
            let (block, lane) = (starts[c] as usize + filled[c] as usize / WIDTH, filled[c] as usize % WIDTH);
            for k in 0..3 {
                lanes[block][k].set(lane, p[k] as f32);
            }
            centers[block * WIDTH + lane] = *p;
            filled[c] += 1;
        }
        self.field = self.spread(&counts, &extents);
        (self.lanes, self.centers, self.starts) = (lanes, centers, starts);
    }

    /// Computes the lower bound of the squared distance (m²) from each cell corner to the nearest point.
    fn spread(&self, counts: &[u32], extents: &[Extent]) -> Vec<f32> {
        let (far, near) = (self.beyond_cells(counts), self.beyond_extents(extents));
        let [mx, my, mz] = self.dims.map(|n| n + 1);
        let stride = mx + RUN - 1;
        let mut field = Vec::with_capacity(mx * my * mz);
        let squared = (self.cell * self.cell) as f32;
        for (far, near) in far.chunks_exact(mx).zip(near.chunks_exact(stride)) {
            // Both values are lower bounds, so the larger one is valid and tighter.
            field.extend(far.iter().zip(&near[TIGHT..]).map(|(f, n)| f32::from(*f).max(*n) * squared));
        }
        field
    }

    /// Returns the squared distance, in cells, from each corner to the nearest occupied cell, computed axis by axis
    /// and capped at [`FURTHEST`] along each axis.
    fn beyond_cells(&self, counts: &[u32]) -> Vec<i16> {
        const MOST: i16 = FURTHEST * FURTHEST;
        let [nx, ny, nz] = self.dims;
        let (mx, my) = (nx + 1, ny + 1);
        let mut rows = vec![MOST; mx * ny * nz];
        for (row, cells) in rows.chunks_exact_mut(mx).zip(counts.chunks_exact(nx)) {
            let mut gap = FURTHEST;
            for v in 0..mx {
                gap = if v > 0 && cells[v - 1] > 0 { 0 } else { (gap + 1).min(FURTHEST) };
                row[v] = gap;
            }
            gap = FURTHEST;
            for v in (0..mx).rev() {
                gap = if v < nx && cells[v] > 0 { 0 } else { (gap + 1).min(FURTHEST) };
                let least = row[v].min(gap);
                row[v] = least * least;
            }
        }
        let slabs = further(&rows, nz, ny, mx);
        further(&slabs, 1, nz, mx * my)
    }

    /// Returns the squared distance, in cells, from each corner to the nearest box around a cell's points, capped at
    /// [`TIGHT`] cells. Rows are padded at both ends.
    fn beyond_extents(&self, extents: &[Extent]) -> Vec<f32> {
        let [nx, ny, nz] = self.dims;
        let (my, mz) = (ny + 1, nz + 1);
        let stride = nx + RUN;
        let mut near = vec![(TIGHT * TIGHT) as f32; stride * my * mz];
        let off = |corner: usize, low: f32, high: f32| (low - corner as f32).max(corner as f32 - high).max(0.0).powi(2);
        for (c, e) in extents.iter().enumerate().filter(|(_, e)| e.low[0] <= e.high[0]) {
            let home = [c % nx, c / nx % ny, c / nx / ny];
            let mut along = [0.0; RUN];
            for (i, value) in along.iter_mut().enumerate() {
                let corner = (home[0] + i) as f32 - TIGHT as f32;
                *value = (e.low[0] - corner).max(corner - e.high[0]).max(0.0).powi(2);
            }
            let range = |k: usize, m: usize| home[k].saturating_sub(TIGHT - 1)..(home[k] + TIGHT + 1).min(m);
            for z in range(2, mz) {
                let above = off(z, e.low[2], e.high[2]);
                for y in range(1, my) {
                    let aside = above + off(y, e.low[1], e.high[1]);
                    let first = stride * (y + my * z) + home[0];
                    for (value, x) in near[first..first + RUN].iter_mut().zip(&along) {
                        let squared = aside + x;
                        *value = if squared < *value { squared } else { *value };
                    }
                }
            }
        }
        near
    }

    fn index(&self, at: [f64; 3]) -> usize {
        let clamp = |k: usize| (at[k].max(0.0) as usize).min(self.dims[k] - 1);
        clamp(0) + self.dims[0] * (clamp(1) + self.dims[1] * clamp(2))
    }

    /// Distance (m) from an element's core up to which a position may touch the element, rounding included.
    #[inline(always)]
    pub fn ball(&self) -> f32 {
        self.radius as f32 + self.slack
    }

    /// Distance (m) from an element's core below which a position certainly touches the element.
    #[inline(always)]
    pub fn inner_ball(&self) -> f32 {
        self.radius as f32 - self.slack
    }

    /// Returns lower bounds of the distance (m) from positions to the nearest point's sphere.
    ///
    /// The squared distance to a point minus the squared distance to the origin is linear, and the minimum of linear
    /// functions is concave. Inside a cell it is therefore at least the interpolation between the corners.
    #[inline(always)]
    pub fn bounds(&self, p: &Points) -> F32x8 {
        let cell = self.cell as f32;
        let inverse = 1.0 / cell;
        let mut squared = F32x8::splat(-self.squared_slack);
        let mut shares = [[0.0_f32; WIDTH]; 3];
        let mut first = [0_u32; WIDTH];
        let mut stride = 1;
        for k in 0..3 {
            let most = F32x8::splat(self.dims[k] as f32 * cell);
            let from = p[k] - F32x8::splat(self.origin[k] as f32);
            // All points lie inside the grid. For a position outside, the squared distance to the closest position
            // inside is added.
            let inside = from.max(F32x8::ZERO).min(most);
            let beyond = from - inside;
            squared = squared + beyond * beyond;
            let at = (inside * inverse).to_array();
            let last = (self.dims[k] - 1) as u32;
            for l in 0..WIDTH {
                let corner = (at[l] as u32).min(last);
                first[l] += corner * stride;
                shares[k][l] = at[l] - corner as f32;
            }
            stride *= self.dims[k] as u32 + 1;
        }
        let (row, slab) = (self.dims[0] + 1, (self.dims[0] + 1) * (self.dims[1] + 1));
        let mut corners = [[0.0_f32; WIDTH]; 8];
        for l in 0..WIDTH {
            for (k, start) in [0, row, slab, slab + row].into_iter().enumerate() {
                let at = first[l] as usize + start;
                corners[2 * k][l] = self.field[at];
                corners[2 * k + 1][l] = self.field[at + 1];
            }
        }
        let (x, y, z) = (F32x8::new(shares[0]), F32x8::new(shares[1]), F32x8::new(shares[2]));
        let mut edges = [F32x8::ZERO; 4];
        for k in 0..4 {
            let (low, high) = (F32x8::new(corners[2 * k]), F32x8::new(corners[2 * k + 1]));
            edges[k] = low + (high - low) * x;
        }
        let (near, far) = (edges[0] + (edges[1] - edges[0]) * y, edges[2] + (edges[3] - edges[2]) * y);
        let between = near + (far - near) * z;
        let bend = x * (F32x8::ONE - x) + y * (F32x8::ONE - y) + z * (F32x8::ONE - z);
        squared = squared + between - bend * (cell * cell);
        squared.max(F32x8::ZERO).sqrt() - F32x8::splat(self.ball() + self.extent as f32)
    }

    /// Returns the squared distance (m²) from the differences between eight centres and a position to the cores.
    #[inline(always)]
    fn to_core(&self, [a, b, c]: [F32x8; 3]) -> F32x8 {
        let Some((half, axes)) = &self.cube else { return a * a + b * b + c * c };
        let beyond = |[x, y, z]: [f32; 3]| ((a * x + b * y + c * z).abs() - F32x8::splat(*half)).max(F32x8::ZERO);
        let [x, y, z] = axes.map(beyond);
        x * x + y * y + z * z
    }

    /// Returns the distance (m) from a position to the nearest core, 0 inside it, if it is less than `within`.
    #[inline(always)]
    pub fn nearest(&self, p: [f32; 3], within: f32) -> Option<f32> {
        if !p.iter().all(|v| v.is_finite()) {
            return Some(0.0);
        }
        let cell = self.cell as f32;
        let inverse = 1.0 / cell;
        let at = [0, 1, 2].map(|k| (p[k] - self.origin[k] as f32) * inverse);
        let [x, y, z] = p.map(F32x8::splat);
        let mut least = F32x8::splat(within * within);
        let mut most = within * within;
        // Squared distance up to which a centre may belong to a core that is closer than the square root of `most`.
        let extent = self.extent as f32;
        let widened = |most: f32| if extent > 0.0 { (most.sqrt() + extent).powi(2) } else { most };
        let mut centers = widened(most);
        // Cells along an axis that lie within this radius, with a margin for rounding.
        let range = |k: usize, radius: f32| {
            let (low, high) = (at[k] - radius * inverse - 1e-3, at[k] + radius * inverse + 1e-3);
            let last = self.dims[k] - 1;
            let empty = high < 0.0 || low >= self.dims[k] as f32;
            if empty { (1, 0) } else { (low.max(0.0) as usize, (high as usize).min(last)) }
        };
        let gap = |k: usize, c: usize| {
            let c = c as f32;
            (c - at[k] - 1e-3).max(at[k] - c - 1.0 - 1e-3).max(0.0) * cell
        };
        let (planes, rows) = (range(2, within + extent), range(1, within + extent));
        for k in outwards(at[2], planes) {
            let above = gap(2, k).powi(2);
            if above >= centers {
                continue;
            }
            for j in outwards(at[1], rows) {
                let aside = above + gap(1, j).powi(2);
                if aside >= centers {
                    continue;
                }
                let (from, to) = range(0, (centers - aside).sqrt());
                if from > to {
                    continue;
                }
                let row = self.dims[0] * (j + self.dims[1] * k);
                // The cells of a row are stored consecutively.
                let blocks = self.starts[row + from] as usize..self.starts[row + to + 1] as usize;
                if blocks.is_empty() {
                    continue;
                }
                for [a, b, c] in &self.lanes[blocks] {
                    least = least.min(self.to_core([*a - x, *b - y, *c - z]));
                }
                most = least.to_array().into_iter().fold(most, |m, d| if d < m { d } else { m });
                centers = widened(most);
            }
        }
        (most < within * within).then(|| most.sqrt())
    }

    /// Returns the centre of an element (m, base frame) by its index, which [`PointGrid::within`] gives.
    pub fn center(&self, index: u32) -> &Point3<f64> {
        &self.centers[index as usize]
    }

    /// Calls `visit` with the points in a box, eight at a time, and the index of the first of them; unused lanes hold a
    /// point far away.
    #[inline(always)]
    pub fn within(&self, bounds: &Aabb, mut visit: impl FnMut(&Points, u32)) {
        let low = [0, 1, 2].map(|k| ((bounds.min[k] - self.origin[k]) / self.cell).floor());
        let high = [0, 1, 2].map(|k| ((bounds.max[k] - self.origin[k]) / self.cell).floor());
        if (0..3).any(|k| high[k] < 0.0 || low[k] >= self.dims[k] as f64) {
            return;
        }
        let range = |k: usize| (low[k].max(0.0) as usize, (high[k] as usize).min(self.dims[k] - 1));
        let ([xl, xh], [yl, yh], [zl, zh]) =
            ([range(0).0, range(0).1], [range(1).0, range(1).1], [range(2).0, range(2).1]);
        for k in zl..=zh {
            for j in yl..=yh {
                let row = self.dims[0] * (j + self.dims[1] * k);
                for block in self.starts[row + xl] as usize..self.starts[row + xh + 1] as usize {
                    visit(&self.lanes[block], (block * WIDTH) as u32);
                }
            }
        }
    }
}

/// Extends squared distances from cells by one axis: `blocks` blocks of `count` lines of `width` entries, one line for
/// each cell, become lines at the cells' `count + 1` corners.
fn further(lines: &[i16], blocks: usize, count: usize, width: usize) -> Vec<i16> {
    const MOST: i16 = FURTHEST * FURTHEST;
    let mut out = vec![MOST; blocks * (count + 1) * width];
    for (block, below) in out.chunks_exact_mut((count + 1) * width).zip(lines.chunks_exact(count * width)) {
        for (corner, line) in block.chunks_exact_mut(width).enumerate() {
            let reach = FURTHEST as usize;
            for c in corner.saturating_sub(reach)..(corner + reach).min(count) {
                let gap = if c >= corner { c - corner } else { corner - c - 1 } as i16;
                for (value, d) in line.iter_mut().zip(&below[c * width..(c + 1) * width]) {
                    *value = (*value).min(*d + gap * gap);
                }
            }
        }
    }
    out
}

/// Yields the numbers from `from` to `to`, those closest to `at` first; none if `from` exceeds `to`.
#[inline(always)]
fn outwards(at: f32, (from, to): (usize, usize)) -> impl Iterator<Item = usize> {
    let middle = (at.max(0.0) as usize).clamp(from.min(to), to.max(from));
    let steps = if from > to { 0 } else { (middle - from).max(to - middle) + 1 };
    (0..steps).flat_map(move |step| {
        let below = middle.checked_sub(step).filter(|k| *k >= from);
        let above = Some(middle + step).filter(|k| step > 0 && *k <= to);
        below.into_iter().chain(above)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn bounds_are_never_above_the_distance_nor_far_below(
            cloud in prop::collection::vec(prop::array::uniform3(-0.4..0.4f64), 1..60),
            at in prop::array::uniform3(-0.6..0.6f64),
            within in 0.001..1.0f32,
        ) {
            let points: Vec<Point3<f64>> = cloud.iter().map(|p| Point3::from(*p)).collect();
            let grid = PointGrid::new(0, &points, &Element::Ball(0.01), 0.0);
            let wanted = points.iter().map(|p| (p - Point3::from(at)).norm()).fold(f64::INFINITY, f64::min);
            let found = f64::from(grid.bounds(&at.map(|v| F32x8::splat(v as f32))).to_array()[5]);
            prop_assert!(found <= wanted - 0.01 + 1e-7, "{found} {wanted}");
            // The tolerance is a cell's diagonal plus the loss of interpolation, which may be larger outside the grid.
            let bounds = Aabb::around(&points, 0.0);
            let inside = (0..3).all(|k| (bounds.min[k]..=bounds.max[k]).contains(&at[k]));
            prop_assert!(!inside || wanted > 0.4 || found >= wanted - 0.01 - 0.08, "{found} {wanted}");
            let nearest = grid.nearest(at.map(|v| v as f32), within).map(f64::from);
            let close = |d: f64| (d - wanted).abs() < 1e-5;
            prop_assert!(nearest.map_or(wanted > f64::from(within) - 1e-5, close), "{nearest:?} {wanted} {within}");
        }

        #[test]
        fn bounds_beside_a_wall_are_nearly_the_distance(
            x in 0.0..0.11f64, y in 0.1..0.9f64, z in 0.1..0.9f64, shift in 0.0..0.04f64,
        ) {
            let points: Vec<Point3<f64>> = (0..10_000)
                .map(|k| Point3::new(0.0, f64::from(k % 100) * 0.01, f64::from(k / 100) * 0.01))
                .chain([-0.3 - shift, 0.5].map(|x| Point3::new(x, 0.0, 0.0)))
                .collect();
            let grid = PointGrid::new(0, &points, &Element::Ball(0.0), 0.0);
            let found = f64::from(grid.bounds(&[x, y, z].map(|v| F32x8::splat(v as f32))).to_array()[2]);
            prop_assert!(found <= x.hypot(0.0072) && (x < 0.04 || found > x - 0.015), "{found} {x}");
        }
    }
}

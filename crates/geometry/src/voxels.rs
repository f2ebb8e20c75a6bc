//! Voxel grids and signed distance fields as solid cubes.
//!
//! A solid block of 2 x 2 x 2 voxels is replaced by one larger cube, and a solid block of such cubes again, as in an
//! octree. The cubes fill exactly the occupied voxels, so the inside of an object stays solid and needs few cubes.

use nalgebra::{Point3, Vector3};

use crate::{Convex, ShapeError};

/// Maximum number of cubes of a grid.
const MOST_CUBES: usize = 1_000_000;
/// Maximum number of voxels of a grid.
const MOST_VOXELS: usize = 1 << 28;

/// Placement of a regular grid of voxels in the body frame.
///
/// Voxel `[i, j, k]` is the cube between `origin + size * [i, j, k]` and `origin + size * [i + 1, j + 1, k + 1]`. Lists
/// of values contain the voxels in the order of a C array of shape `dims`: `k` changes fastest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VoxelGrid {
    dims: [usize; 3],
    size: f64,
    origin: Point3<f64>,
}

impl VoxelGrid {
    /// Creates a grid of `dims` voxels with edges of `size` (m), whose first voxel begins at `origin` (m).
    ///
    /// # Errors
    /// The size is not positive and finite, the origin is not finite, or there are more than 2^28 voxels.
    pub fn new(dims: [usize; 3], size: f64, origin: Point3<f64>) -> Result<Self, ShapeError> {
        check_size("voxel_size", size)?;
        if !origin.iter().all(|v| v.is_finite()) {
            return Err(ShapeError::new("origin", format!("{:?} is not finite", origin.coords.as_slice())));
        }
        let count = dims.iter().try_fold(1_usize, |n, d| n.checked_mul(*d)).filter(|n| *n <= MOST_VOXELS);
        if count.is_none() {
            let message = format!("has {dims:?} voxels, more than {MOST_VOXELS} in all; crop the grid");
            return Err(ShapeError::new("shape", message));
        }
        Ok(Self { dims, size, origin })
    }

    /// Number of voxels.
    #[must_use]
    pub fn count(&self) -> usize {
        self.dims.iter().product()
    }

    /// Returns solid cubes that fill exactly the occupied voxels; no cubes if no voxel is occupied.
    ///
    /// # Errors
    /// The list does not have one entry for each voxel, or the solid has more than 1,000,000 cubes.
    ///
    /// ```
    /// use gensim2_geometry::VoxelGrid;
    /// use nalgebra::Point3;
    ///
    /// let grid = VoxelGrid::new([2, 2, 4], 0.05, Point3::origin())?;
    /// // Two blocks of 2 x 2 x 2 voxels, each of which becomes one cube with edges of 0.1 m.
    /// assert_eq!(grid.solids(&[true; 16])?.len(), 2);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn solids(&self, occupied: &[bool]) -> Result<Vec<Convex>, ShapeError> {
        if occupied.len() != self.count() {
            let message = format!("has {} entries for {} voxels", occupied.len(), self.count());
            return Err(ShapeError::new("occupied", message));
        }
        let mut levels: Vec<Level> = Vec::new();
        while let Some(next) =
            levels.last().map_or_else(|| Some(Level { dims: self.dims, full: occupied.to_vec() }), Level::coarser)
        {
            levels.push(next);
        }
        let mut out = Vec::new();
        for (l, level) in levels.iter().enumerate() {
            let above = levels.get(l + 1);
            for index in (0..level.full.len()).filter(|i| level.full[*i]) {
                let at = level.place(index);
                if above.is_some_and(|above| above.is_full(at.map(|v| v / 2))) {
                    continue;
                }
                if out.len() == MOST_CUBES {
                    let message = format!("needs more than {MOST_CUBES} cubes; crop the grid or use larger voxels");
                    return Err(ShapeError::new("occupied", message));
                }
                // Cubes that touch share the same coordinates exactly, so there are no gaps.
                let corner =
                    |plus: usize| self.origin + Vector3::from_fn(|k, _| ((at[k] + plus) << l) as f64 * self.size);
                out.push(cube(corner(0), corner(1))?);
            }
        }
        Ok(out)
    }

    /// Returns which voxels may contain a part of an obstacle, from signed distances (m) at the centres of the voxels,
    /// negative inside obstacles. A voxel is occupied if its distance is at most `threshold` (m). The value of unknown
    /// voxels, whose distance is NaN, is `unknown`.
    ///
    /// With a threshold of at least [`VoxelGrid::half_diagonal`], the occupied voxels contain every obstacle point in
    /// known voxels: no point of a voxel is further from its centre, so a larger distance proves that the voxel is free.
    /// The distances must not exceed the true ones; a truncation does not matter if it is above the threshold.
    ///
    /// # Errors
    /// The list does not have one entry for each voxel, a distance is infinite, or the threshold is not finite.
    pub fn occupied(&self, distances: &[f64], threshold: f64, unknown: bool) -> Result<Vec<bool>, ShapeError> {
        if distances.len() != self.count() {
            let message = format!("has {} entries for {} voxels", distances.len(), self.count());
            return Err(ShapeError::new("distances", message));
        }
        if !threshold.is_finite() {
            return Err(ShapeError::new("threshold", format!("must be finite, not {threshold}")));
        }
        if let Some(i) = distances.iter().position(|d| d.is_infinite()) {
            let [x, y, z] = Level { dims: self.dims, full: Vec::new() }.place(i);
            let message =
                format!("is {}; use NaN for unknown voxels, and a finite number for a large distance", distances[i]);
            return Err(ShapeError::new(format!("distances[{x}, {y}, {z}]"), message));
        }
        Ok(distances.iter().map(|d| if d.is_nan() { unknown } else { *d <= threshold }).collect())
    }

    /// Half the length (m) of a voxel's diagonal: the maximum distance of a point of a voxel from the voxel's centre.
    #[must_use]
    pub fn half_diagonal(&self) -> f64 {
        0.5 * 3.0_f64.sqrt() * self.size
    }
}

/// Returns solid cubes with edges of `sizes` (m) around `centers` (m), for example the leaves of an octree.
///
/// # Errors
/// The lists differ in length, a number is not finite, a size is not positive, or there are more than 1,000,000 cubes.
pub fn cubes(centers: &[Point3<f64>], sizes: &[f64]) -> Result<Vec<Convex>, ShapeError> {
    if sizes.len() != centers.len() {
        let message = format!("has {} entries for {} centers", sizes.len(), centers.len());
        return Err(ShapeError::new("sizes", message));
    }
    if centers.len() > MOST_CUBES {
        let message = format!("has {} entries, more than {MOST_CUBES}; crop the map", centers.len());
        return Err(ShapeError::new("centers", message));
    }
    let one = |(i, (center, size)): (usize, (&Point3<f64>, &f64))| {
        check_size(&format!("sizes[{i}]"), *size)?;
        if !center.iter().all(|v| v.is_finite()) {
            return Err(ShapeError::new(format!("centers[{i}]"), "is not finite"));
        }
        let half = Vector3::repeat(0.5 * size);
        cube(center - half, center + half)
    };
    centers.iter().zip(sizes).enumerate().map(one).collect()
}

fn check_size(field: &str, size: f64) -> Result<(), ShapeError> {
    if size.is_finite() && size > 0.0 {
        return Ok(());
    }
    Err(ShapeError::new(field, format!("must be positive and finite, not {size}")))
}

fn cube(low: Point3<f64>, high: Point3<f64>) -> Result<Convex, ShapeError> {
    let out = Convex::voxel(low, high);
    if out.bound().is_finite() && (0..3).all(|k| low[k] < high[k]) {
        return Ok(out);
    }
    let message = format!("is too small or too far away: a voxel at {:?} m has no volume", low.coords.as_slice());
    Err(ShapeError::new("voxel_size", message))
}

/// Cubes of equal size, and which of them are full.
struct Level {
    dims: [usize; 3],
    full: Vec<bool>,
}

impl Level {
    fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        (i * self.dims[1] + j) * self.dims[2] + k
    }

    fn place(&self, index: usize) -> [usize; 3] {
        let [_, ny, nz] = self.dims;
        [index / (ny * nz), index / nz % ny, index % nz]
    }

    /// Returns whether a cube is full; false for a cube outside.
    fn is_full(&self, at: [usize; 3]) -> bool {
        (0..3).all(|k| at[k] < self.dims[k]) && self.full[self.index(at)]
    }

    /// Returns the level of cubes with twice the edge length; `None` if none of them is full.
    fn coarser(&self) -> Option<Self> {
        let dims = self.dims.map(|n| n / 2);
        let mut out = Self { dims, full: vec![true; dims.iter().product()] };
        for index in 0..out.full.len() {
            let [i, j, k] = out.place(index).map(|v| 2 * v);
            let row = |i: usize, j: usize| {
                let at = self.index([i, j, k]);
                self.full[at] && self.full[at + 1]
            };
            out.full[index] = row(i, j) && row(i, j + 1) && row(i + 1, j) && row(i + 1, j + 1);
        }
        out.full.contains(&true).then_some(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Corners, signed_distance};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn cubes_fill_exactly_the_occupied_voxels(
            dims in prop::array::uniform3(1..9usize), seed in any::<u64>(), share in 0.0..1.0f64,
        ) {
            let grid = VoxelGrid::new(dims, 0.1, Point3::new(0.3, -0.2, 0.1)).unwrap();
            let mut draws = crate::Draws::of(seed, 0);
            let occupied: Vec<bool> = (0..grid.count()).map(|_| draws.unit() < share).collect();
            let solids = grid.solids(&occupied).unwrap();
            let mut filled = vec![0; grid.count()];
            let level = Level { dims, full: Vec::new() };
            for (i, covered) in filled.iter_mut().enumerate() {
                let middle = grid.origin + Vector3::from(level.place(i).map(|v| 0.1 * (v as f64 + 0.5)));
                let holds = |s: &&Convex| (middle - s.center()).amax() < s.cube_half().unwrap();
                *covered = solids.iter().filter(holds).count();
            }
            let wanted: Vec<usize> = occupied.iter().map(|o| usize::from(*o)).collect();
            prop_assert_eq!(filled, wanted);
            let volume: f64 = solids.iter().map(|s| (2.0 * s.cube_half().unwrap()).powi(3)).sum();
            let count = occupied.iter().filter(|o| **o).count();
            prop_assert!((volume - 1e-3 * count as f64).abs() < 1e-9);
        }

        #[test]
        fn occupied_voxels_contain_the_obstacle_whose_distances_are_given(
            at in prop::array::uniform3(0.1..0.5f64), radius in 0.02..0.2f64, truncation in 0.06..0.3f64,
        ) {
            // The obstacle is a sphere, whose signed distance is exact.
            let (dims, size) = ([12; 3], 0.05);
            let grid = VoxelGrid::new(dims, size, Point3::origin()).unwrap();
            let level = Level { dims, full: Vec::new() };
            let middle = |i: usize| Vector3::from(level.place(i).map(|v| size * (v as f64 + 0.5)));
            let far = |p: Vector3<f64>| (p - Vector3::from(at)).norm() - radius;
            let distances: Vec<f64> =
                (0..grid.count()).map(|i| far(middle(i)).clamp(-truncation, truncation)).collect();
            let occupied = grid.occupied(&distances, grid.half_diagonal(), false).unwrap();
            let mut draws = crate::Draws::of(7, 0);
            for _ in 0..2000 {
                let p = Vector3::from_fn(|_, _| 0.6 * draws.unit());
                let voxel = level.index([0, 1, 2].map(|k| ((p[k] / size) as usize).min(11)));
                prop_assert!(far(p) > 0.0 || occupied[voxel]);
                // No point of an occupied voxel is further from the obstacle than a whole diagonal.
                prop_assert!(!occupied[voxel] || far(p) <= 2.0 * grid.half_diagonal() + 1e-12);
            }
        }
    }

    #[test]
    fn unknown_voxels_are_what_the_caller_says() {
        let grid = VoxelGrid::new([1, 1, 2], 0.1, Point3::origin()).unwrap();
        for unknown in [true, false] {
            assert_eq!(grid.occupied(&[f64::NAN, 0.5], 0.1, unknown).unwrap(), [unknown, false]);
        }
    }

    #[test]
    fn unusable_grids_are_refused_with_the_field() {
        let field = |e: ShapeError| e.field;
        assert_eq!(field(VoxelGrid::new([1; 3], 0.0, Point3::origin()).unwrap_err()), "voxel_size");
        assert_eq!(field(VoxelGrid::new([1; 3], 0.1, Point3::new(f64::NAN, 0.0, 0.0)).unwrap_err()), "origin");
        assert_eq!(field(VoxelGrid::new([usize::MAX, 2, 1], 0.1, Point3::origin()).unwrap_err()), "shape");
        let grid = VoxelGrid::new([1, 2, 1], 0.1, Point3::origin()).unwrap();
        assert_eq!(field(grid.solids(&[true]).unwrap_err()), "occupied");
        assert_eq!(field(grid.occupied(&[0.0, f64::INFINITY], 0.1, true).unwrap_err()), "distances[0, 1, 0]");
        assert_eq!(field(cubes(&[Point3::origin()], &[-1.0]).unwrap_err()), "sizes[0]");
        assert_eq!(field(cubes(&[Point3::new(0.0, f64::NAN, 0.0)], &[1.0]).unwrap_err()), "centers[0]");
        // At this distance, adding the size does not change the coordinate.
        assert_eq!(field(cubes(&[Point3::new(1e10, 0.0, 0.0)], &[1e-9]).unwrap_err()), "voxel_size");
    }

    #[test]
    fn a_shape_inside_a_solid_overlaps_it() {
        let grid = VoxelGrid::new([40; 3], 0.02, Point3::origin()).unwrap();
        let solids = grid.solids(&vec![true; grid.count()]).unwrap();
        assert!(solids.len() < 600, "{}", solids.len());
        let ball = Corners::of(&[Point3::new(0.41, 0.39, 0.403)]);
        let overlaps = |s: &Convex| {
            let other = Corners::of(s.points());
            signed_distance((&ball, 0.003), (&other, 0.0), &mut Vector3::x(), 0.0).is_some_and(|c| c.distance < 0.0)
        };
        assert!(solids.iter().any(overlaps));
    }
}

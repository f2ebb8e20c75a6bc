//! Vertices of a hull in a memory layout for fast searches.

use nalgebra::{Point3, Vector3};
use parry3d_f64::shape::SupportMap;

use crate::Pose;
use crate::lanes::{Wide, wide};

/// Largest coordinate whose square can be computed and summed without overflow.
pub(crate) const FURTHEST: f64 = 1e100;

/// Number of vertices processed at once.
const LANES: usize = 4;
/// With fewer blocks than this, dispatching to the widest vector instructions costs more than it saves.
const FEW: usize = 3;

/// Vertices of a hull, stored by coordinate. Most of the time is spent on the search for the furthest vertex, and this
/// layout lets the compiler process several vertices at once.
#[derive(Debug, Clone, Default)]
pub struct Corners {
    /// Blocks of x, y and z; the last block is padded with copies of its first vertex.
    blocks: Vec<[[f64; LANES]; 3]>,
    /// Whether a coordinate is not finite, or so large that its square overflows.
    unbounded: bool,
}

impl Corners {
    /// Stores points as the vertices of a hull.
    #[must_use]
    pub fn of(points: &[Point3<f64>]) -> Self {
        let mut corners = Self::default();
        corners.place(points, &Pose::identity());
        corners
    }

    /// Replaces the vertices by `points`, transformed by `pose`.
    pub fn place(&mut self, points: &[Point3<f64>], pose: &Pose) {
        self.blocks.clear();
        self.unbounded = false;
        self.add(points, pose);
    }

    /// Adds `points`, transformed by `pose`, to the vertices.
    pub(crate) fn add(&mut self, points: &[Point3<f64>], pose: &Pose) {
        self.blocks.reserve(points.len().div_ceil(LANES));
        // The sum is non-finite if any coordinate is, so the loop needs no branch.
        let mut total = [0.0; LANES];
        let (r, t) = (pose.rotation.matrix(), &pose.translation.vector);
        for chunk in points.chunks(LANES) {
            let mut own = [[0.0; LANES]; 3];
            for lane in 0..LANES {
                let p = chunk.get(lane).unwrap_or(&chunk[0]);
                for k in 0..3 {
                    own[k][lane] = p[k];
                }
            }
            let mut block = [[0.0; LANES]; 3];
            for k in 0..3 {
                for lane in 0..LANES {
                    block[k][lane] =
                        r[(k, 0)] * own[0][lane] + r[(k, 1)] * own[1][lane] + r[(k, 2)] * own[2][lane] + t[k];
                }
            }
            for lane in 0..LANES {
                total[lane] += block[0][lane].abs() + block[1][lane].abs() + block[2][lane].abs();
            }
            self.blocks.push(block);
        }
        self.unbounded |= total.iter().any(|t| t.is_nan() || *t > FURTHEST);
    }

    /// Centre of the first block of vertices. For a single vertex, this is the vertex itself.
    pub(crate) fn middle(&self) -> Point3<f64> {
        self.blocks.first().map_or_else(Point3::origin, |[x, y, z]| Point3::new(x[0], y[0], z[0]))
    }

    /// Whether there are vertices, all with finite coordinates whose squares do not overflow.
    pub(crate) fn are_measurable(&self) -> bool {
        !self.blocks.is_empty() && !self.unbounded
    }

    /// Returns the vertex furthest along `direction`, the first one if several are equally far.
    pub(crate) fn furthest(&self, direction: &Vector3<f64>) -> Point3<f64> {
        struct Work<'a>(&'a Corners, &'a Vector3<f64>);
        impl Wide for Work<'_> {
            type Output = Point3<f64>;
            #[inline(always)]
            fn run(self) -> Point3<f64> {
                self.0.furthest_of(self.1)
            }
        }
        // Detecting the machine's vector width costs as much as a few blocks.
        if self.blocks.len() > FEW { wide(Work(self, direction)) } else { self.furthest_of(direction) }
    }

    #[inline(always)]
    fn furthest_of(&self, direction: &Vector3<f64>) -> Point3<f64> {
        let mut best = [f64::NEG_INFINITY; LANES];
        // Indices are stored as floating-point numbers, because the compiler then selects them in all lanes at once.
        let mut at = [0.0; LANES];
        let mut index = 0.0;
        for [x, y, z] in &self.blocks {
            for lane in 0..LANES {
                let value = x[lane] * direction.x + y[lane] * direction.y + z[lane] * direction.z;
                let further = value > best[lane];
                best[lane] = if further { value } else { best[lane] };
                at[lane] = if further { index } else { at[lane] };
            }
            index += 1.0;
        }
        let mut lane = 0;
        for other in 1..LANES {
            if best[other] > best[lane] || (best[other] == best[lane] && at[other] < at[lane]) {
                lane = other;
            }
        }
        let [x, y, z] = &self.blocks[at[lane] as usize];
        Point3::new(x[lane], y[lane], z[lane])
    }
}

impl SupportMap for Corners {
    fn local_support_point(&self, dir: &Vector3<f64>) -> Point3<f64> {
        self.furthest(dir)
    }
}

//! Decomposition of a surface into convex parts, where its hull is much larger than the surface.

use nalgebra::{Point3, Vector3};
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::TriMesh;

use crate::link::FURTHEST;

/// A triangle of a surface (m).
pub(crate) type Triangle = [Point3<f64>; 3];

/// Maximum number of parts of one mesh. Each part costs time in every collision check.
pub(crate) const MAX_PARTS: usize = 16;
/// Numbers of planes that are tried along each axis for a cut.
const CUTS: usize = 15;
/// Number of samples on the surface of a part, about; and maximum number of them that are looked for inside the solid.
const SAMPLES: usize = 3000;
const LOOKS: usize = 300;
/// Maximum number of triangles; finer meshes keep their hull, because their decomposition would take minutes.
const MAX_TRIANGLES: usize = 100_000;
/// Distance (m) inside its box at which a corner is looked for inside the solid. At the corner itself, which may lie on
/// a face, the answer would depend on rounding.
const NUDGE: f64 = 1e-7;
/// If no cut reduces the volume by this fraction, the part is cut in the middle.
const WORTHWHILE: f64 = 0.005;

/// Returns the points of convex parts that together contain a surface, and the volume that it encloses if it is closed
/// and all its triangles face outwards, or all inwards. `None` if no sample of the surface's hull is farther than
/// `tolerance` (m) from the solid, or if the surface is too large for a link or has too many triangles.
///
/// The part that is farthest from the solid is cut in two by a plane, until all parts are within `tolerance` or there
/// are [`MAX_PARTS`]. Each part covers the solid inside one box. Its points are the surface inside the box, clipped
/// exactly, and those corners of the box that lie in the solid: all other extreme points lie on the surface.
pub(crate) fn decompose(surface: &[Triangle], tolerance: f64) -> Option<Vec<Vec<Point3<f64>>>> {
    if surface.len() > MAX_TRIANGLES || !surface.iter().flatten().flat_map(Point3::iter).all(|c| c.abs() <= FURTHEST) {
        return None;
    }
    let solid = Solid::new(surface)?;
    let whole = Part::new(&solid, surface.to_vec(), [[f64::NEG_INFINITY; 3], [f64::INFINITY; 3]], tolerance);
    if whole.excess <= tolerance {
        return None;
    }
    let mut parts = vec![whole];
    while parts.len() < MAX_PARTS {
        let order = |a: &usize, b: &usize| parts[*a].excess.total_cmp(&parts[*b].excess);
        let worst = (0..parts.len()).filter(|i| parts[*i].excess > tolerance).max_by(order);
        let Some(worst) = worst else { break };
        match parts[worst].best_cut() {
            Some((axis, at)) => {
                let part = parts.swap_remove(worst);
                parts.extend(
                    part.cut(&solid, axis, at).map(|(surface, cell)| Part::new(&solid, surface, cell, tolerance)),
                );
            }
            // The part is too small to be cut.
            None => parts[worst].excess = 0.0,
        }
    }
    Some(merged(&solid, parts, tolerance).into_iter().map(|part| part.points).collect())
}

/// Joins parts whose common hull is within the tolerance of the solid.
fn merged(solid: &Solid<'_>, mut parts: Vec<Part>, tolerance: f64) -> Vec<Part> {
    let mut at = 0;
    while at < parts.len() {
        let joined = (at + 1..parts.len()).find_map(|other| {
            let points = [&parts[at].points[..], &parts[other].points[..]].concat();
            let hull = Hull::new(&points);
            // A hull that is much larger than both parts contains free space, so its distance need not be measured.
            let small = hull.volume <= 1.5 * (parts[at].volume + parts[other].volume) + tolerance.powi(3);
            let excess = small.then(|| solid.excess(&hull, tolerance)).filter(|excess| *excess <= tolerance)?;
            Some((other, Part { volume: hull.volume, points: hull.vertices, excess, ..Part::default() }))
        });
        match joined {
            Some((other, part)) => {
                parts.swap_remove(other);
                parts[at] = part;
                at = 0;
            }
            None => at += 1,
        }
    }
    parts
}

/// The surface that is decomposed.
struct Solid<'s> {
    surface: &'s [Triangle],
    tree: TriMesh,
}

impl<'s> Solid<'s> {
    fn new(surface: &'s [Triangle]) -> Option<Self> {
        let vertices: Vec<_> = surface.iter().flatten().copied().collect();
        let faces = (0..u32::try_from(surface.len()).ok()?).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        Some(Self { surface, tree: TriMesh::new(vertices, faces).ok()? })
    }

    /// Returns whether a point is inside, by the winding number of the surface. The surface may have small gaps.
    fn contains(&self, point: &Point3<f64>) -> bool {
        let mut turns = 0.0;
        for triangle in self.surface {
            let [a, b, c] = triangle.map(|v| v - point);
            let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
            let below = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
            turns += a.dot(&b.cross(&c)).atan2(below);
        }
        turns.abs() > std::f64::consts::PI
    }

    /// Returns the corners of a box near which the box contains a piece of the solid.
    fn corners(&self, cell: &[[f64; 3]; 2]) -> impl Iterator<Item = Point3<f64>> {
        let inner = [cell[0].map(|c| c + NUDGE), cell[1].map(|c| c - NUDGE)];
        corners(*cell).zip(corners(inner)).filter(|(_, inner)| self.contains(inner)).map(|(corner, _)| corner)
    }

    /// Returns about the largest distance (m) of a hull's surface from the solid; 0 within the tolerance.
    fn excess(&self, hull: &Hull, tolerance: f64) -> f64 {
        let mut samples: Vec<(f64, Point3<f64>)> = hull
            .samples(tolerance / 2.0)
            .into_iter()
            .map(|p| (self.tree.distance_to_local_point(&p, false), p))
            .filter(|(distance, _)| *distance > tolerance)
            .collect();
        samples.sort_by(|a, b| b.0.total_cmp(&a.0));
        samples.iter().take(LOOKS).find(|(_, p)| !self.contains(p)).map_or(0.0, |(distance, _)| *distance)
    }
}

/// The surface within a box, and the points whose hull contains the solid in this box.
#[derive(Default)]
struct Part {
    surface: Vec<Triangle>,
    /// Lowest and highest corner of the box.
    cell: [[f64; 3]; 2],
    points: Vec<Point3<f64>>,
    volume: f64,
    /// Largest distance (m) of the part's hull from the solid.
    excess: f64,
}

impl Part {
    fn new(solid: &Solid<'_>, surface: Vec<Triangle>, cell: [[f64; 3]; 2], tolerance: f64) -> Self {
        let mut points: Vec<Point3<f64>> = surface.iter().flatten().copied().collect();
        points.extend(solid.corners(&cell));
        let hull = Hull::new(&points);
        let excess = solid.excess(&hull, tolerance);
        Self { surface, cell, points: hull.vertices, volume: hull.volume, excess }
    }

    /// Returns the axis and position of the plane that leaves the least volume in both halves; `None` for a part
    /// without extent.
    fn best_cut(&self) -> Option<(usize, f64)> {
        let low = |axis: usize| self.points.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min);
        let high = |axis: usize| self.points.iter().map(|p| p[axis]).fold(f64::NEG_INFINITY, f64::max);
        let extent: [(f64, f64); 3] = std::array::from_fn(|axis| (low(axis), high(axis)));
        let longest = (0..3).max_by(|a, b| (extent[*a].1 - extent[*a].0).total_cmp(&(extent[*b].1 - extent[*b].0)))?;
        let length = extent[longest].1 - extent[longest].0;
        if !(length.is_finite() && length > 1e-6) {
            return None;
        }
        let before = outline_volume(&self.surface);
        let candidates = (0..3).filter(|axis| extent[*axis].1 - extent[*axis].0 > 0.1 * length).flat_map(|axis| {
            let (low, high) = extent[axis];
            (1..=CUTS).map(move |k| (axis, low + (high - low) * k as f64 / (CUTS + 1) as f64))
        });
        let measured = candidates.map(|(axis, at)| {
            let volume: f64 = halves(&self.surface, axis, at).iter().map(|half| outline_volume(half)).sum();
            (volume, axis, at)
        });
        let (volume, axis, at) = measured.min_by(|a, b| a.0.total_cmp(&b.0))?;
        if volume < (1.0 - WORTHWHILE) * before {
            Some((axis, at))
        } else {
            Some((longest, 0.5 * (extent[longest].0 + extent[longest].1)))
        }
    }

    /// Returns the surface and the box of both sides of a plane; a side without any of the solid is omitted.
    fn cut(&self, solid: &Solid<'_>, axis: usize, at: f64) -> impl Iterator<Item = (Vec<Triangle>, [[f64; 3]; 2])> {
        let (mut below, mut above) = (self.cell, self.cell);
        (below[1][axis], above[0][axis]) = (at, at);
        let both = halves(&self.surface, axis, at).into_iter().zip([below, above]);
        both.filter(|(surface, cell)| !surface.is_empty() || solid.corners(cell).next().is_some())
    }
}

/// Returns the corners of a box whose coordinates are finite.
fn corners(cell: [[f64; 3]; 2]) -> impl Iterator<Item = Point3<f64>> {
    let corner = move |i: usize| Point3::new(cell[i & 1][0], cell[i >> 1 & 1][1], cell[i >> 2][2]);
    (0..8).map(corner).filter(|p| p.iter().all(|c| c.is_finite()))
}

/// Returns the parts of a surface below and above a plane. The plane is perpendicular to an axis.
fn halves(surface: &[Triangle], axis: usize, at: f64) -> [Vec<Triangle>; 2] {
    let (mut below, mut above) = (Vec::new(), Vec::new());
    for triangle in surface {
        let heights = triangle.map(|v| v[axis] - at);
        if heights.iter().all(|h| *h <= 0.0) {
            below.push(*triangle);
        } else if heights.iter().all(|h| *h >= 0.0) {
            above.push(*triangle);
        } else {
            clip(triangle, heights, &mut below);
            clip(triangle, heights.map(|h| -h), &mut above);
        }
    }
    [below, above]
}

/// Adds the part of a triangle whose heights are not positive.
fn clip(triangle: &Triangle, heights: [f64; 3], out: &mut Vec<Triangle>) {
    let mut corners: Vec<Point3<f64>> = Vec::with_capacity(4);
    for i in 0..3 {
        let j = (i + 1) % 3;
        if heights[i] <= 0.0 {
            corners.push(triangle[i]);
        }
        if (heights[i] < 0.0) != (heights[j] < 0.0) && heights[i] != heights[j] {
            let share = heights[i] / (heights[i] - heights[j]);
            corners.push(triangle[i] + (triangle[j] - triangle[i]) * share);
        }
    }
    out.extend((1..corners.len().saturating_sub(1)).map(|k| [corners[0], corners[k], corners[k + 1]]));
}

/// Returns about the volume (m³) of the hull of a surface: that of its extreme points in many directions.
fn outline_volume(surface: &[Triangle]) -> f64 {
    const DIRECTIONS: usize = 60;
    if surface.is_empty() {
        return 0.0;
    }
    let directions: Vec<Vector3<f64>> = (0..DIRECTIONS)
        .map(|k| {
            let z = 1.0 - 2.0 * (k as f64 + 0.5) / DIRECTIONS as f64;
            let (sin, cos) = (k as f64 * std::f64::consts::PI * (1.0 + 5.0_f64.sqrt())).sin_cos();
            let width = (1.0 - z * z).sqrt();
            Vector3::new(width * cos, width * sin, z)
        })
        .chain((0..6).map(|k| Vector3::ith(k / 2, if k % 2 == 0 { 1.0 } else { -1.0 })))
        .collect();
    let mut best = vec![(f64::NEG_INFINITY, Point3::origin()); directions.len()];
    for vertex in surface.iter().flatten() {
        for (best, direction) in best.iter_mut().zip(&directions) {
            let height = direction.dot(&vertex.coords);
            if height > best.0 {
                *best = (height, *vertex);
            }
        }
    }
    Hull::new(&best.into_iter().map(|(_, vertex)| vertex).collect::<Vec<_>>()).volume
}

/// The convex hull of points, with its faces.
struct Hull {
    vertices: Vec<Point3<f64>>,
    faces: Vec<[u32; 3]>,
    volume: f64,
}

impl Hull {
    /// Creates the hull. Points without a volume are all kept, without faces.
    fn new(points: &[Point3<f64>]) -> Self {
        let mut unique = points.to_vec();
        unique.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z)));
        unique.dedup();
        let made = (unique.len() >= 4).then(|| parry3d_f64::transformation::try_convex_hull(&unique));
        let Some(Ok((vertices, faces))) = made.filter(|made| made.as_ref().is_ok_and(|(v, _)| v.len() >= 4)) else {
            return Self { vertices: unique, faces: Vec::new(), volume: 0.0 };
        };
        let origin = vertices[0];
        let edge = |v: u32| vertices[v as usize] - origin;
        let volume = faces.iter().map(|[a, b, c]| edge(*a).dot(&edge(*b).cross(&edge(*c)))).sum::<f64>().abs() / 6.0;
        Self { vertices, faces, volume }
    }

    /// Returns points on the faces, at most about `spacing` (m) apart unless that takes too many points.
    fn samples(&self, spacing: f64) -> Vec<Point3<f64>> {
        let corner = |v: u32| self.vertices[v as usize];
        let area = |[a, b, c]: &[u32; 3]| (corner(*b) - corner(*a)).cross(&(corner(*c) - corner(*a))).norm() / 2.0;
        let total: f64 = self.faces.iter().map(area).sum();
        let spacing = spacing.max((total / SAMPLES as f64).sqrt());
        let mut out = Vec::new();
        for face in &self.faces {
            let [a, b, c] = face.map(corner);
            let longest = (b - a).norm().max((c - a).norm()).max((c - b).norm());
            let count = (area(face) / (spacing * spacing) + longest / spacing).ceil().max(1.0) as usize;
            out.extend((0..count).map(|k| {
                // The R2 sequence covers the unit square evenly; the half above the diagonal is mirrored.
                let share = |step: f64| (0.5 + k as f64 * step).fract();
                let (u, v) = (share(0.754_877_666_246_692_7), share(0.569_840_290_998_053_3));
                let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
                a + (b - a) * u + (c - a) * v
            }));
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Draws;

    /// Returns the surface of a box.
    fn cuboid(low: [f64; 3], high: [f64; 3]) -> Vec<Triangle> {
        let corner =
            |i: usize| Point3::from([[low, high][i & 1][0], [low, high][i >> 1 & 1][1], [low, high][i >> 2][2]]);
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
            .iter()
            .flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]])
            .map(|t| t.map(corner))
            .collect()
    }

    /// Boxes (lowest and highest corner) that form a C with unequal arms.
    const C: [([f64; 3], [f64; 3]); 3] = [
        ([0.0, 0.0, 0.0], [0.05, 0.1, 0.3]),
        ([0.0, 0.0, 0.0], [0.2, 0.1, 0.06]),
        ([0.0, 0.0, 0.25], [0.15, 0.1, 0.3]),
    ];

    fn inside(part: &Hull, point: &Point3<f64>, by: f64) -> bool {
        let middle = part.vertices.iter().map(|v| v.coords).sum::<Vector3<f64>>() / part.vertices.len() as f64;
        part.faces.iter().all(|face| {
            let [a, b, c] = face.map(|v| part.vertices[v as usize]);
            let normal = (b - a).cross(&(c - a));
            let normal = normal * (a.coords - middle).dot(&normal).signum();
            normal.dot(&(point - a)) <= by * normal.norm()
        })
    }

    #[test]
    fn parts_contain_the_solid_and_leave_its_opening_free() {
        let surface: Vec<Triangle> = C.iter().flat_map(|(low, high)| cuboid(*low, *high)).collect();
        let parts: Vec<Hull> = decompose(&surface, 0.005).unwrap().iter().map(|points| Hull::new(points)).collect();
        assert!((3..=5).contains(&parts.len()), "{}", parts.len());
        let mut draws = Draws::of(3, 0);
        let mut draw = |low: f64, high: f64| low + (high - low) * draws.unit();
        for (low, high) in C.iter().cycle().take(3000) {
            let point = Point3::from(std::array::from_fn(|k| draw(low[k], high[k])));
            assert!(parts.iter().any(|part| inside(part, &point, 1e-9)), "{point}");
        }
        for _ in 0..1000 {
            let point = Point3::new(draw(0.056, 0.15), draw(0.0, 0.1), draw(0.066, 0.244));
            assert!(!parts.iter().any(|part| inside(part, &point, 0.0)), "{point}");
        }
    }

    /// Returns the faces between occupied and free cells of a grid of cubes, and the occupied cells.
    fn voxels(size: [usize; 3], occupied: &[bool]) -> (Vec<Triangle>, Vec<[f64; 3]>) {
        const CELL: f64 = 1.0 / 16.0;
        let [nx, ny, nz] = size.map(|n| n as i64);
        let is_solid = |[x, y, z]: [i64; 3]| {
            let inside = (0..nx).contains(&x) && (0..ny).contains(&y) && (0..nz).contains(&z);
            inside && occupied[((x * ny + y) * nz + z) as usize]
        };
        let (mut out, mut cells) = (Vec::new(), Vec::new());
        for [x, y, z] in (0..nx).flat_map(|x| (0..ny).flat_map(move |y| (0..nz).map(move |z| [x, y, z]))) {
            if !is_solid([x, y, z]) {
                continue;
            }
            let low = [x, y, z].map(|c| c as f64 * CELL);
            let faces = cuboid(low, low.map(|c| c + CELL));
            cells.push(low);
            // In the order of the faces of `cuboid`.
            for (face, step) in [[0, 0, -1], [0, 0, 1], [0, -1, 0], [0, 1, 0], [-1, 0, 0], [1, 0, 0]].iter().enumerate()
            {
                if !is_solid([x + step[0], y + step[1], z + step[2]]) {
                    out.extend_from_slice(&faces[2 * face..2 * face + 2]);
                }
            }
        }
        (out, cells)
    }

    #[test]
    fn parts_contain_solids_whose_faces_lie_in_the_planes_of_the_cuts() {
        let mut draws = Draws::of(11, 4);
        let mut decomposed = 0;
        for round in 0..60 {
            // The first solid is one that lost a corner, because the corner lay on a face.
            let (size, occupied) = if round == 0 {
                let rows = "00001111 00001111 11111101 01010101".replace(' ', "");
                ([4, 4, 2], rows.chars().map(|c| c == '1').collect::<Vec<_>>())
            } else {
                let size = [0; 3].map(|_: usize| 2 + (3.0 * draws.unit()) as usize);
                (size, (0..size.iter().product()).map(|_| draws.unit() < 0.7).collect())
            };
            let (surface, cells) = voxels(size, &occupied);
            let Some(parts) = decompose(&surface, 0.004 + 0.02 * draws.unit()) else { continue };
            let parts: Vec<Hull> = parts.iter().map(|points| Hull::new(points)).collect();
            decomposed += 1;
            for low in cells.iter().cycle().take(1000) {
                let point = Point3::from(low.map(|c| c + draws.unit() / 16.0));
                assert!(parts.iter().any(|part| inside(part, &point, 1e-9)), "{round}: {point}");
            }
        }
        assert!(decomposed > 40, "{decomposed}");
    }

    #[test]
    fn a_surface_near_its_hull_is_not_decomposed() {
        assert!(decompose(&cuboid([0.0; 3], [0.1, 0.2, 0.3]), 0.001).is_none());
        assert!(decompose(&[[Point3::origin(); 3]], 0.001).is_none());
    }
}

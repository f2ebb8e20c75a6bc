//! Covers a convex shape with a few spheres that contain the shape without extending far beyond it.

use std::collections::HashSet;

use nalgebra::{Point3, Vector3};
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::Triangle;

use crate::{Aabb, Convex};

/// A sphere that contains part of a shape.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Ball {
    pub center: Point3<f64>,
    pub radius: f64,
    /// Radius of a sphere with the same centre that lies inside the shape; minus infinity if none is known.
    pub inner: f64,
}

/// Maximum number of spheres for one shape.
pub(super) const MAX_BALLS: usize = 20;
/// Number of vertices beyond which a hull is simplified.
const DENSE: usize = 128;
/// A shape is divided only if it may have at least this number of spheres.
const WORTH: usize = 4;
/// A sphere is not split if it extends beyond the shape by less than this (m).
const SLOP: f64 = 0.004;
/// Number of iterations of the algorithm that finds a smallest sphere around points (Badoiu and Clarkson).
const ROUNDS: usize = 48;
/// Number of directions in which a sphere is measured to find how far it extends beyond the shape.
const LOOKS: usize = 48;

/// Returns an approximately smallest sphere around points, enlarged by `radius`.
pub(crate) fn ball_around(points: &[Point3<f64>], radius: f64) -> Ball {
    let bounds = Aabb::around(points, 0.0);
    let mut center = nalgebra::center(&bounds.min, &bounds.max);
    let furthest = |from: &Point3<f64>| {
        points.iter().fold((0.0, *from), |best, p| {
            let d = (p - from).norm_squared();
            if d > best.0 { (d, *p) } else { best }
        })
    };
    let (mut reach, mut far) = furthest(&center);
    let mut best = Ball { center, radius: reach.sqrt(), inner: f64::NEG_INFINITY };
    for round in 1..=ROUNDS {
        center += (far - center) / (round + 1) as f64;
        (reach, far) = furthest(&center);
        if reach.sqrt() < best.radius {
            best = Ball { center, radius: reach.sqrt(), ..best };
        }
    }
    best.radius += radius;
    best
}

/// The part of a hull inside a box: its surface in the box, and all vertices of this part.
struct Cell {
    bounds: Aabb,
    surface: Vec<Vec<Point3<f64>>>,
    corners: Vec<Point3<f64>>,
    ball: Ball,
    slop: f64,
}

/// A hull, given by its faces (outward unit normal and offset) and its triangles.
struct Hull {
    faces: Vec<(Vector3<f64>, f64)>,
    looks: Vec<Vector3<f64>>,
}

impl Hull {
    fn height(&self, p: &Point3<f64>) -> f64 {
        self.faces.iter().map(|(n, d)| n.dot(&p.coords) - d).fold(f64::NEG_INFINITY, f64::max)
    }

    fn cell(&self, bounds: Aabb, surface: Vec<Vec<Point3<f64>>>) -> Option<Cell> {
        // Triangles share their vertices, and each further copy of a vertex takes time in every round.
        let mut seen = HashSet::new();
        let is_new = |p: &Point3<f64>| seen.insert(<[f64; 3]>::from(*p).map(f64::to_bits));
        let mut corners: Vec<Point3<f64>> = surface.iter().flatten().copied().filter(is_new).collect();
        for i in 0..8 {
            let pick = |k: usize, low: f64, high: f64| if i & (1 << k) == 0 { low } else { high };
            let corner = Point3::new(
                pick(0, bounds.min.x, bounds.max.x),
                pick(1, bounds.min.y, bounds.max.y),
                pick(2, bounds.min.z, bounds.max.z),
            );
            if self.height(&corner) <= 1e-9 {
                corners.push(corner);
            }
        }
        if corners.is_empty() {
            return None;
        }
        let ball = ball_around(&corners, 0.0);
        let slop = self.looks.iter().map(|u| self.height(&(ball.center + u * ball.radius))).fold(0.0, f64::max);
        Some(Cell { bounds, surface, corners, ball, slop })
    }

    /// Splits a cell in two, by a plane perpendicular to an axis in the middle of the box around its vertices.
    fn halves(&self, cell: &Cell, axis: usize) -> Vec<Cell> {
        let held = Aabb::around(&cell.corners, 0.0);
        let at = 0.5 * (held.min[axis] + held.max[axis]);
        [false, true]
            .into_iter()
            .filter_map(|above| {
                let mut bounds = cell.bounds;
                if above {
                    bounds.min[axis] = at;
                } else {
                    bounds.max[axis] = at;
                }
                let surface =
                    cell.surface.iter().map(|polygon| clipped(polygon, axis, at, above)).filter(|p| !p.is_empty());
                self.cell(bounds, surface.collect())
            })
            .collect()
    }
}

/// Returns the part of a polygon on one side of a plane perpendicular to an axis.
fn clipped(polygon: &[Point3<f64>], axis: usize, at: f64, above: bool) -> Vec<Point3<f64>> {
    let inside = |p: &Point3<f64>| if above { p[axis] >= at } else { p[axis] <= at };
    let mut out = Vec::with_capacity(polygon.len() + 2);
    for (i, p) in polygon.iter().enumerate() {
        let next = &polygon[(i + 1) % polygon.len()];
        if inside(p) {
            out.push(*p);
        }
        if inside(p) != inside(next) {
            let mut crossing = p + (next - p) * ((at - p[axis]) / (next[axis] - p[axis]));
            crossing[axis] = at;
            out.push(crossing);
        }
    }
    out
}

/// Returns up to [`MAX_BALLS`] spheres that together contain a shape.
pub(crate) fn cover(shape: &Convex) -> Vec<Ball> {
    cover_by(shape, MAX_BALLS)
}

/// Returns up to `most` spheres that together contain a shape. A hull with many vertices is represented by few of them,
/// and the spheres are enlarged by the distance of the others.
pub(crate) fn cover_quickly(shape: &Convex, most: usize) -> Vec<Ball> {
    if shape.points().len() <= DENSE || most < WORTH {
        return cover_by(shape, most);
    }
    let furthest = |u: &Vector3<f64>| {
        let height = |p: &Point3<f64>| p.coords.dot(u);
        shape.points().iter().copied().max_by(|a, b| height(a).total_cmp(&height(b)))
    };
    let kept: Vec<Point3<f64>> = directions(DENSE / 2).iter().filter_map(furthest).collect();
    let Ok(inner) = Convex::rounded_hull(&kept, shape.radius()) else { return cover_by(shape, most) };
    let middle = inner.points().iter().map(|p| p.coords).sum::<Vector3<f64>>() / inner.points().len() as f64;
    let mut faces: Vec<(Vector3<f64>, Triangle)> = Vec::new();
    for [a, b, c] in inner.faces() {
        let Some(normal) = (b - a).cross(&(c - a)).try_normalize(1e-16) else { continue };
        let outwards = if normal.dot(&(a.coords - middle)) < 0.0 { -normal } else { normal };
        faces.push((outwards, Triangle::new(a, b, c)));
    }
    // The distance to any triangle of the inner hull bounds the distance to this hull.
    let off = |p: &Point3<f64>| {
        let above = faces.iter().map(|(normal, face)| (normal.dot(&(p - face.a)), face));
        let highest = above.max_by(|a, b| a.0.total_cmp(&b.0));
        highest.map_or(
            f64::INFINITY,
            |(height, face)| if height > 0.0 { face.distance_to_local_point(p, true) } else { 0.0 },
        )
    };
    let missed = shape.points().iter().map(off).fold(0.0, f64::max);
    if !missed.is_finite() {
        return cover_by(shape, most);
    }
    let balls = cover_by(&inner, most).into_iter();
    balls.map(|ball| Ball { radius: ball.radius + missed, ..ball }).collect()
}

/// Returns up to `most` spheres that together contain a shape; a capsule may have more.
pub(crate) fn cover_by(shape: &Convex, most: usize) -> Vec<Ball> {
    let points = shape.points();
    if let [a, b] = points {
        return along_segment(a, b, shape.radius());
    }
    if let [p] = points {
        return vec![Ball { center: *p, radius: shape.radius(), inner: shape.radius() }];
    }
    let whole = || vec![ball_around(points, shape.radius())];
    if points.len() < 4 || most < WORTH {
        return whole();
    }
    let middle = points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points.len() as f64;
    let mut faces: Vec<(Vector3<f64>, f64)> = Vec::new();
    let mut surface = Vec::new();
    for [a, b, c] in shape.faces() {
        surface.push(vec![a, b, c]);
        let Some(normal) = (b - a).cross(&(c - a)).try_normalize(1e-16) else { continue };
        let normal = if normal.dot(&(a.coords - middle)) < 0.0 { -normal } else { normal };
        let offset = points.iter().map(|p| normal.dot(&p.coords)).fold(f64::NEG_INFINITY, f64::max);
        if !faces.iter().any(|(n, d)| n.dot(&normal) > 1.0 - 1e-9 && (d - offset).abs() < 1e-9) {
            faces.push((normal, offset));
        }
    }
    if surface.is_empty() {
        return whole();
    }
    let hull = Hull { faces, looks: directions(LOOKS) };
    let Some(first) = hull.cell(Aabb::around(points, 0.0), surface) else { return whole() };
    let mut cells = vec![first];
    while cells.len() < most {
        let Some(worst) = (0..cells.len()).max_by(|a, b| cells[*a].slop.total_cmp(&cells[*b].slop)) else { break };
        if cells[worst].slop <= SLOP {
            break;
        }
        let worst = cells.swap_remove(worst);
        let score = |halves: &[Cell]| halves.iter().map(|c| c.slop).fold(0.0, f64::max);
        let best = (0..3)
            .map(|axis| hull.halves(&worst, axis))
            .filter(|halves| !halves.is_empty())
            .min_by(|a, b| score(a).total_cmp(&score(b)));
        match best {
            Some(halves) => cells.extend(halves),
            None => {
                cells.push(worst);
                break;
            }
        }
    }
    let radius = shape.radius();
    let ball = |cell: &Cell| {
        let height = hull.height(&cell.ball.center);
        let inner = if height < 0.0 { radius - height } else { f64::NEG_INFINITY };
        Ball { radius: cell.ball.radius + radius, inner, ..cell.ball }
    };
    cells.iter().map(ball).collect()
}

/// Returns spheres along the axis of a capsule.
fn along_segment(a: &Point3<f64>, b: &Point3<f64>, radius: f64) -> Vec<Ball> {
    let length = (b - a).norm();
    // With this distance between the centres, the spheres extend only slightly beyond the capsule.
    let step = (2.0 * (2.0 * radius * SLOP + SLOP * SLOP).sqrt()).max(length / MAX_BALLS as f64).max(1e-9);
    let parts = (length / step).ceil().clamp(1.0, MAX_BALLS as f64) as usize;
    let half = 0.5 * length / parts as f64;
    (0..parts)
        .map(|k| {
            // The caps belong to the first and the last part.
            let reach = if k == 0 || k + 1 == parts { half + radius } else { half.hypot(radius) };
            Ball { center: a + (b - a) * ((k as f64 + 0.5) / parts as f64), radius: reach, inner: radius }
        })
        .collect()
}

/// Returns unit directions spread evenly (a Fibonacci lattice).
pub(crate) fn directions(count: usize) -> Vec<Vector3<f64>> {
    let golden = std::f64::consts::PI * (1.0 + 5f64.sqrt());
    (0..count)
        .map(|i| {
            let step = i as f64 + 0.5;
            let z = 1.0 - 2.0 * step / count as f64;
            let (sin, cos) = (golden * step).sin_cos();
            let r = (1.0 - z * z).sqrt();
            Vector3::new(r * cos, r * sin, z)
        })
        .collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn few_spheres_contain_a_hull_with_many_vertices() {
        let long = |u: &Vector3<f64>| Point3::new(0.2 * u.x, 0.05 * u.y, 0.03 + 0.1 * u.z);
        let points: Vec<Point3<f64>> = directions(1500).iter().map(long).collect();
        let shape = Convex::rounded_hull(&points, 0.01).unwrap();
        let balls = cover_quickly(&shape, 12);
        assert!((4..=12).contains(&balls.len()), "{}", balls.len());
        let within = |p: &Point3<f64>| balls.iter().any(|b| (p - b.center).norm() <= b.radius - 0.01 + 1e-9);
        for [a, b, c] in shape.faces() {
            assert!([a, b, c].iter().all(within));
            assert!(within(&Point3::from((a.coords + b.coords + c.coords) / 3.0)));
        }
        let largest = balls.iter().map(|b| b.radius).fold(0.0, f64::max);
        assert!(largest < 0.12, "{largest}");
        // The inner spheres lie inside the shape.
        let exact = cover_by(&shape, 1)[0].radius;
        assert!(balls.iter().all(|b| b.inner <= 0.06 + 1e-3 && b.radius < exact));
    }
}

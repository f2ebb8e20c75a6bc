//! Lower bounds of the distance between points and convex obstacles, for eight points at a time.

use std::sync::OnceLock;

use crate::lanes::F32x8;
use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};

use super::Sphere;
use super::between::Swept;
use crate::{Aabb, Convex, Pose};

/// Maximum number of faces by which a hull is represented.
const MAX_FACES: usize = 28;
/// Faces are merged if the cosine between their normals exceeds this.
const SAME_FACE: f64 = 0.985;
/// Relative rounding error of sums of a few terms in single precision.
pub(super) const ROUNDING: f64 = 1e-6;

/// Coordinates x, y and z of eight points.
pub type Points = [F32x8; 3];

/// A convex obstacle in a form for fast distance queries of points. It contains the original shape.
#[derive(Debug, Clone)]
pub(crate) enum Solid {
    /// Rounded box: centre, axes as rows, half extents.
    Cuboid { center: [f32; 3], axes: [[f32; 3]; 3], half: [f32; 3], radius: f32 },
    /// Cylinder: centre, unit axis, half length, radius.
    Cylinder { center: [f32; 3], axis: [f32; 3], half: f32, radius: f32 },
    /// Capsule (a sphere if the length is 0): one end, direction, length.
    Capsule { end: [f32; 3], axis: [f32; 3], length: f32, radius: f32 },
    /// Hull: outward normals and offsets of its faces.
    Hull { faces: Vec<[f32; 4]>, radius: f32 },
}

fn single(v: &Vector3<f64>) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

#[inline(always)]
fn dot(a: &[f32; 3], b: &Points) -> F32x8 {
    b[0] * a[0] + b[1] * a[1] + b[2] * a[2]
}

#[inline(always)]
fn from(p: &Points, c: &[f32; 3]) -> Points {
    [p[0] - F32x8::splat(c[0]), p[1] - F32x8::splat(c[1]), p[2] - F32x8::splat(c[2])]
}

#[inline(always)]
pub(crate) fn length(v: &Points) -> F32x8 {
    (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt()
}

impl Solid {
    /// Returns the form of a shape (base frame) that is a box, a cylinder or a capsule.
    fn simple(shape: &Convex) -> Option<Self> {
        let (points, radius) = (shape.points(), enlarged(shape));
        match points {
            [p] => Some(Self::Capsule { end: single(&p.coords), axis: [1.0, 0.0, 0.0], length: 0.0, radius }),
            [a, b] => {
                let way = b - a;
                let axis = way.try_normalize(1e-12).unwrap_or_else(Vector3::x);
                Some(Self::Capsule { end: single(&a.coords), axis: single(&axis), length: way.norm() as f32, radius })
            }
            _ => cuboid(points, radius).or_else(|| cylinder(points, radius)),
        }
    }

    /// Returns the box of a shape (base frame) along the axes of the base.
    fn box_around(shape: &Convex) -> Self {
        let Aabb { min, max } = shape.aabb_at(&Pose::identity());
        Self::Cuboid {
            center: single(&nalgebra::center(&min, &max).coords),
            axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            half: single(&(0.5 * (max - min))),
            radius: enlarged(shape) - shape.radius() as f32,
        }
    }

    /// Lower bound of the distance (m) from each point to the obstacle.
    #[inline(always)]
    pub fn distance(&self, p: &Points) -> F32x8 {
        match self {
            Self::Cuboid { center, axes, half, radius } => to_cuboid(p, center, axes, half, *radius),
            Self::Cylinder { center, axis, half, radius } => to_cylinder(p, center, axis, *half, *radius),
            Self::Capsule { end, axis, length, radius } => to_capsule(p, end, axis, *length, *radius),
            Self::Hull { faces, radius } => to_hull(p, faces, *radius),
        }
    }

    /// Lower bounds of the distance (m) between the obstacle and the nearest of `balls`, which are at `centers` in
    /// eight configurations; then the same for their inner spheres. For motions, the radii are larger by
    /// `swells`, and the inner spheres are left out.
    #[inline(always)]
    pub fn least<S: Swept>(&self, centers: &[Points], balls: &[Sphere], swells: &[F32x8]) -> [F32x8; 2] {
        let mut least = [F32x8::splat(f32::MAX); 2];
        // The loop is inside each match arm, so that the type of solid is tested only once.
        macro_rules! over {
            ($distance:ident($($part:expr),*)) => {
                if S::MOVES {
                    for ((center, ball), swell) in centers.iter().zip(balls).zip(swells) {
                        let d = $distance(center, $($part),*);
                        least[0] = least[0].min(d - F32x8::splat(ball.radius) - *swell);
                    }
                } else {
                    for (center, ball) in centers.iter().zip(balls) {
                        let d = $distance(center, $($part),*);
                        least[0] = least[0].min(d - F32x8::splat(ball.radius));
                        least[1] = least[1].min(d - F32x8::splat(ball.inner));
                    }
                }
            };
        }
        match self {
            Self::Cuboid { center, axes, half, radius } => over!(to_cuboid(center, axes, half, *radius)),
            Self::Cylinder { center, axis, half, radius } => over!(to_cylinder(center, axis, *half, *radius)),
            Self::Capsule { end, axis, length, radius } => over!(to_capsule(end, axis, *length, *radius)),
            Self::Hull { faces, radius } => over!(to_hull(faces, *radius)),
        }
        least
    }

    /// Returns by how much (m) the true distance of `shape` exceeds the bound at most; infinite if unknown.
    pub fn looseness(&self, shape: &Convex) -> f32 {
        let rounded = |size: f32| 4.0 * ROUNDING as f32 * (1.0 + size);
        match self {
            Self::Cuboid { center, half, .. } => rounded(sum(center) + sum(half)),
            Self::Capsule { end, length, .. } => rounded(sum(end) + length),
            Self::Cylinder { center, half, radius, .. } => {
                // The faces of a prism lie inside its circumscribed cylinder.
                let sides = (shape.points().len() / 2) as f32;
                radius * (1.0 - (std::f32::consts::PI / sides).cos()) + rounded(sum(center) + half + radius)
            }
            Self::Hull { .. } => f32::INFINITY,
        }
    }
}

/// Returns the radius of a shape, enlarged so that the shape stays inside despite rounding to single precision.
fn enlarged(shape: &Convex) -> f32 {
    let size = shape.points().iter().map(|p| p.coords.norm()).fold(1.0, f64::max);
    (shape.radius() + ROUNDING * size) as f32
}

/// A convex obstacle. The faces of a hull are computed when a robot first comes close to its box, because this takes
/// longer than most plans need.
#[derive(Debug, Clone)]
pub(crate) struct Obstacle {
    /// The obstacle, or the box around a hull.
    pub first: Solid,
    hull: Option<(Convex, OnceLock<Solid>)>,
    /// Largest difference (m) between the true distance and the lower bound; infinite for a hull.
    pub looseness: f32,
}

impl Obstacle {
    /// Prepares a shape (base frame).
    pub fn new(shape: Convex) -> Self {
        match Solid::simple(&shape) {
            Some(first) => Self { looseness: first.looseness(&shape), first, hull: None },
            None => {
                let first = Solid::box_around(&shape);
                Self { first, hull: Some((shape, OnceLock::new())), looseness: f32::INFINITY }
            }
        }
    }

    /// Returns the faces of a hull; `None` for another shape.
    pub fn hull(&self) -> Option<&Solid> {
        self.hull.as_ref().map(|(shape, faces)| faces.get_or_init(|| hull(shape)))
    }
}

fn sum(v: &[f32; 3]) -> f32 {
    v.iter().map(|x| x.abs()).sum()
}

#[inline(always)]
fn to_cuboid(p: &Points, center: &[f32; 3], axes: &[[f32; 3]; 3], half: &[f32; 3], radius: f32) -> F32x8 {
    let zero = F32x8::ZERO;
    let v = from(p, center);
    let q = [
        dot(&axes[0], &v).abs() - F32x8::splat(half[0]),
        dot(&axes[1], &v).abs() - F32x8::splat(half[1]),
        dot(&axes[2], &v).abs() - F32x8::splat(half[2]),
    ];
    let outside = [q[0].max(zero), q[1].max(zero), q[2].max(zero)];
    let inside = q[0].max(q[1]).max(q[2]).min(zero);
    length(&outside) + inside - F32x8::splat(radius)
}

#[inline(always)]
fn to_cylinder(p: &Points, center: &[f32; 3], axis: &[f32; 3], half: f32, radius: f32) -> F32x8 {
    let zero = F32x8::ZERO;
    let v = from(p, center);
    let along = dot(axis, &v);
    let across = [v[0] - along * axis[0], v[1] - along * axis[1], v[2] - along * axis[2]];
    let (a, b) = (along.abs() - F32x8::splat(half), length(&across) - F32x8::splat(radius));
    let (x, y) = (a.max(zero), b.max(zero));
    (x * x + y * y).sqrt() + a.max(b).min(zero)
}

#[inline(always)]
fn to_capsule(p: &Points, end: &[f32; 3], axis: &[f32; 3], long: f32, radius: f32) -> F32x8 {
    let v = from(p, end);
    let along = dot(axis, &v).max(F32x8::ZERO).min(F32x8::splat(long));
    let way = [v[0] - along * axis[0], v[1] - along * axis[1], v[2] - along * axis[2]];
    length(&way) - F32x8::splat(radius)
}

#[inline(always)]
fn to_hull(p: &Points, faces: &[[f32; 4]], radius: f32) -> F32x8 {
    let mut highest = F32x8::splat(f32::MIN);
    for [x, y, z, d] in faces {
        highest = highest.max(p[0] * *x + p[1] * *y + p[2] * *z - F32x8::splat(*d));
    }
    highest - F32x8::splat(radius)
}

/// Returns the box with these eight points as vertices; `None` if they do not form a box.
fn cuboid(points: &[Point3<f64>], radius: f32) -> Option<Solid> {
    if points.len() != 8 {
        return None;
    }
    let center = points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / 8.0;
    let ways: Vec<Vector3<f64>> = points[1..].iter().map(|p| p - points[0]).collect();
    let size = ways.iter().map(Vector3::norm).fold(0.0, f64::max);
    let near = |v: f64| v.abs() < 1e-6 * size;
    for i in 0..7 {
        for j in i + 1..7 {
            if !near(ways[i].dot(&ways[j]) / size) {
                continue;
            }
            for k in j + 1..7 {
                let square = near(ways[i].dot(&ways[k]) / size) && near(ways[j].dot(&ways[k]) / size);
                let opposite = points[0].coords + 0.5 * (ways[i] + ways[j] + ways[k]) - center;
                if !(square && near(opposite.norm())) {
                    continue;
                }
                let mut axes = [[0.0; 3]; 3];
                let mut half = [0.0; 3];
                for (row, edge) in [ways[i], ways[j], ways[k]].iter().enumerate() {
                    let axis = edge.try_normalize(1e-12)?;
                    axes[row] = single(&axis);
                    // The box must include all vertices despite rounding.
                    half[row] = points.iter().map(|p| axis.dot(&(p.coords - center)).abs()).fold(0.0, f64::max) as f32;
                }
                return Some(Solid::Cuboid { center: single(&center), axes, half, radius });
            }
        }
    }
    None
}

/// Returns the cylinder around a regular prism with many sides; `None` if the points do not form one.
fn cylinder(points: &[Point3<f64>], radius: f32) -> Option<Solid> {
    if points.len() < 24 {
        return None;
    }
    let center = points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points.len() as f64;
    let spread = points.iter().fold(Matrix3::zeros(), |sum, p| {
        let v = p.coords - center;
        sum + v * v.transpose()
    });
    let size = points.iter().map(|p| (p.coords - center).norm()).fold(0.0, f64::max);
    for column in SymmetricEigen::new(spread).eigenvectors.column_iter() {
        let axis: Vector3<f64> = column.into();
        let reach = |p: &Point3<f64>| {
            let v = p.coords - center;
            let along = axis.dot(&v);
            (along.abs(), (v - axis * along).norm())
        };
        let (half, round) = reach(&points[0]);
        let regular = |p: &Point3<f64>| {
            let (a, b) = reach(p);
            (a - half).abs() < 1e-6 * size && (b - round).abs() < 1e-6 * size
        };
        if points.iter().all(regular) {
            let grown = radius + (1e-6 * size) as f32;
            return Some(Solid::Cylinder {
                center: single(&center),
                axis: single(&axis),
                half: half as f32 + grown,
                radius: round as f32 + grown,
            });
        }
    }
    None
}

/// Returns a hull with the largest faces of a shape. Any subset of the faces encloses the shape.
fn hull(shape: &Convex) -> Solid {
    let (points, radius) = (shape.points(), enlarged(shape));
    let offset = |n: &Vector3<f64>| points.iter().map(|p| n.dot(&p.coords)).fold(f64::NEG_INFINITY, f64::max);
    let mut found: Vec<(f64, Vector3<f64>)> = Vec::new();
    let middle = points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points.len().max(1) as f64;
    for [a, b, c] in shape.faces() {
        let cross = (b - a).cross(&(c - a));
        let Some(normal) = cross.try_normalize(1e-16) else { continue };
        let normal = if normal.dot(&(a.coords - middle)) < 0.0 { -normal } else { normal };
        match found.iter_mut().find(|(_, n)| n.dot(&normal) > SAME_FACE) {
            Some((area, _)) => *area += cross.norm(),
            None => found.push((cross.norm(), normal)),
        }
    }
    if found.is_empty()
        && let [a, b, c, ..] = points
        && let Some(normal) = (b - a).cross(&(c - a)).try_normalize(1e-16)
    {
        found.extend([(1.0, normal), (1.0, -normal)]);
        for (from, to) in [(a, b), (b, c), (c, a)] {
            found.extend((to - from).cross(&normal).try_normalize(1e-16).map(|n| (1.0, n)));
        }
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.truncate(MAX_FACES - 6);
    for k in 0..3 {
        found.extend([(0.0, Vector3::ith(k, 1.0)), (0.0, Vector3::ith(k, -1.0))]);
    }
    let faces = found.iter().map(|(_, n)| {
        let [x, y, z] = single(n);
        [x, y, z, offset(n) as f32]
    });
    Solid::Hull { faces: faces.collect(), radius }
}

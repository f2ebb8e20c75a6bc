//! Intersections of lines with an object: where a line enters and leaves the material, and the normals there.

use gensim2_geometry::{Aabb, Bvh, Convex};
use nalgebra::{Point3, Vector3};

use crate::ProblemError;
use crate::actuation::seeds::halton;

/// Gaps between two pieces of material are ignored if they are narrower than this (m).
const JOIN: f64 = 1e-4;
/// A point lies on the surface if it is closer to the surface than this (m).
pub(super) const ON_SURFACE: f64 = 1e-6;
/// Sampling weight of a horizontal face relative to a vertical one: objects rest on horizontal faces, and are grasped
/// at the sides.
const LEVEL: f64 = 0.2;
/// Two planes count as one plane if they are closer than this.
const SAME_PLANE: f64 = 1e-7;

#[derive(Debug, Clone, Copy)]
pub(super) struct Plane {
    normal: Vector3<f64>,
    offset: f64,
}

impl Plane {
    /// Height of a point above the plane (m).
    pub fn height(&self, point: &Point3<f64>) -> f64 {
        self.normal.dot(&point.coords) - self.offset
    }
}

#[derive(Debug)]
enum Piece {
    /// A convex region: all points below these planes.
    Hull(Vec<Plane>),
    /// A triangle of a closed mesh.
    Triangle([Point3<f64>; 3]),
}

/// An interval of a line inside material.
#[derive(Debug, Clone, Copy)]
pub(super) struct Span {
    /// Position on the line (m) where the interval starts.
    pub enter: f64,
    /// Position on the line (m) where the interval ends.
    pub exit: f64,
    /// Outward surface normal at the start.
    pub enter_normal: Vector3<f64>,
    /// Outward surface normal at the end.
    pub exit_normal: Vector3<f64>,
}

/// The surface of a body of convex parts, triangles of closed meshes, or both.
#[derive(Debug)]
pub(super) struct Surface {
    pieces: Vec<Piece>,
    tree: Bvh,
    triangles: Vec<[Point3<f64>; 3]>,
    /// Cumulative sampling weights of the triangles.
    weights: Vec<f64>,
    /// Centroid of the body's volume.
    pub center: Point3<f64>,
    /// Whether there are mesh triangles, whose normals may point inwards.
    pub meshes: bool,
}

impl Surface {
    /// Prepares shapes in the body frame; `up` is the direction against gravity, if any. A hull of three points without
    /// rounding is a mesh triangle. With `per_part` all shapes are sampled equally often, otherwise in proportion to
    /// their area.
    pub fn new(shapes: &[Convex], up: Option<&Vector3<f64>>, per_part: bool) -> Result<Self, ProblemError> {
        let (mut pieces, mut boxes, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
        let mut weights: Vec<f64> = Vec::new();
        let weight = |[a, b, c]: &[Point3<f64>; 3]| {
            let area = (b - a).cross(&(c - a));
            let level = up.map_or(0.0, |up| area.dot(up).powi(2) / area.norm_squared().max(f64::MIN_POSITIVE));
            area.norm() * (1.0 - (1.0 - LEVEL) * level)
        };
        let (mut moment, mut volume) = (Vector3::zeros(), 0.0);
        for shape in shapes {
            let faces = shape.triangles();
            if faces.is_empty() {
                continue;
            }
            let single = faces.len() == 1;
            if single {
                pieces.push(Piece::Triangle(faces[0]));
            } else {
                for [a, b, c] in &faces {
                    let part = a.coords.dot(&b.coords.cross(&c.coords)) / 6.0;
                    volume += part;
                    moment += (a.coords + b.coords + c.coords) * (part / 4.0);
                }
                pieces.push(Piece::Hull(planes(&faces)));
            }
            let corners: Vec<Point3<f64>> = faces.iter().flatten().copied().collect();
            boxes.push(Aabb::around(&corners, 0.0));
            let begin = weights.len();
            weights.extend(faces.iter().map(weight));
            if per_part {
                let whole: f64 = weights[begin..].iter().sum();
                weights[begin..].iter_mut().for_each(|w| *w /= whole.max(f64::MIN_POSITIVE));
            }
            triangles.extend(faces);
        }
        let mut sum = 0.0;
        for weight in &mut weights {
            sum += *weight;
            *weight = sum;
        }
        if sum.is_nan() || sum <= 0.0 {
            return Err(ProblemError::new("body.shapes", "have no surface; use hulls with a volume or a closed mesh"));
        }
        let center = if volume > 0.0 {
            Point3::from(moment / volume)
        } else {
            let bounds = boxes.iter().fold(Aabb::EMPTY, |a, b| a.union(b));
            nalgebra::center(&bounds.min, &bounds.max)
        };
        let meshes = pieces.iter().any(|p| matches!(p, Piece::Triangle(_)));
        Ok(Self { pieces, tree: Bvh::new(&boxes), triangles, weights, center, meshes })
    }

    /// Returns the surface point with number `index` in an evenly spread sequence, with the normal at the point.
    pub fn sample(&self, index: usize) -> Option<(Point3<f64>, Vector3<f64>)> {
        let total = *self.weights.last()?;
        let wanted = total * halton(index + 1, 0);
        let at = self.weights.partition_point(|sum| *sum <= wanted).min(self.triangles.len() - 1);
        let [a, b, c] = self.triangles[at];
        let (root, share) = (halton(index + 1, 1).sqrt(), halton(index + 1, 2));
        let p = a + (b - a) * (root * (1.0 - share)) + (c - a) * (root * share);
        let normal = (b - a).cross(&(c - a)).try_normalize(1e-16)?;
        if !self.meshes {
            return Some((p, normal));
        }
        // Along an outward normal, the line leaves material at the point.
        let mut spans = Vec::new();
        self.spans(&p, &normal, &mut spans);
        let enters = spans.iter().any(|s| s.enter.abs() < ON_SURFACE);
        Some((p, if enters { -normal } else { normal }))
    }

    /// Computes the intervals of a line that are inside material, in order along the line.
    pub fn spans(&self, origin: &Point3<f64>, direction: &Vector3<f64>, out: &mut Vec<Span>) {
        out.clear();
        let mut crossings: Vec<(f64, Vector3<f64>)> = Vec::new();
        self.tree.along(origin, direction, |piece| match &self.pieces[piece] {
            Piece::Hull(planes) => out.extend(through_hull(planes, origin, direction)),
            Piece::Triangle(corners) => crossings.extend(through_triangle(corners, origin, direction)),
        });
        crossings.sort_by(|a, b| a.0.total_cmp(&b.0));
        // A line through an edge hits both adjacent triangles.
        crossings.dedup_by(|b, a| b.0 - a.0 < 1e-9);
        out.extend(crossings.chunks_exact(2).map(|pair| Span {
            enter: pair[0].0,
            exit: pair[1].0,
            enter_normal: against(&pair[0].1, direction),
            exit_normal: -against(&pair[1].1, direction),
        }));
        join(out);
    }
}

/// The planes of a hull's faces.
pub(super) fn planes(faces: &[[Point3<f64>; 3]]) -> Vec<Plane> {
    let mut out: Vec<Plane> = Vec::new();
    for [a, b, c] in faces {
        let Some(normal) = (b - a).cross(&(c - a)).try_normalize(1e-16) else { continue };
        let offset = normal.dot(&a.coords);
        let same = |p: &Plane| (p.normal - normal).amax() < SAME_PLANE && (p.offset - offset).abs() < SAME_PLANE;
        if !out.iter().any(same) {
            out.push(Plane { normal, offset });
        }
    }
    out
}

fn through_hull(planes: &[Plane], origin: &Point3<f64>, direction: &Vector3<f64>) -> Option<Span> {
    let (zero, inf) = (Vector3::zeros(), f64::INFINITY);
    let mut span = Span { enter: -inf, exit: inf, enter_normal: zero, exit_normal: zero };
    for plane in planes {
        let slope = plane.normal.dot(direction);
        let room = -plane.height(origin);
        if slope.abs() < 1e-12 {
            if room < 0.0 {
                return None;
            }
        } else if slope > 0.0 {
            if room / slope < span.exit {
                (span.exit, span.exit_normal) = (room / slope, plane.normal);
            }
        } else if room / slope > span.enter {
            (span.enter, span.enter_normal) = (room / slope, plane.normal);
        }
        if span.enter >= span.exit {
            return None;
        }
    }
    (span.enter.is_finite() && span.exit.is_finite()).then_some(span)
}

/// Returns the line parameter and the normal at the point where a line crosses a triangle (Möller and Trumbore 1997).
fn through_triangle(
    [a, b, c]: &[Point3<f64>; 3],
    origin: &Point3<f64>,
    direction: &Vector3<f64>,
) -> Option<(f64, Vector3<f64>)> {
    let (ab, ac) = (b - a, c - a);
    let across = direction.cross(&ac);
    let determinant = ab.dot(&across);
    if determinant.abs() < 1e-16 {
        return None;
    }
    let from = origin - a;
    let u = from.dot(&across) / determinant;
    let q = from.cross(&ab);
    let v = direction.dot(&q) / determinant;
    if u < 0.0 || v < 0.0 || u + v > 1.0 {
        return None;
    }
    Some((ac.dot(&q) / determinant, ab.cross(&ac).try_normalize(1e-16)?))
}

fn against(normal: &Vector3<f64>, direction: &Vector3<f64>) -> Vector3<f64> {
    if normal.dot(direction) > 0.0 { -normal } else { *normal }
}

/// Merges intervals that overlap or nearly touch.
fn join(spans: &mut Vec<Span>) {
    spans.sort_by(|a, b| a.enter.total_cmp(&b.enter));
    spans.dedup_by(|next, last| {
        let touching = next.enter <= last.exit + JOIN;
        if touching && next.exit > last.exit {
            (last.exit, last.exit_normal) = (next.exit, next.exit_normal);
        }
        touching
    });
}

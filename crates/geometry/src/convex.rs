//! The only shape of this crate: the convex hull of points, rounded by a radius.
//!
//! Boxes, spheres, capsules, hulls, triangles and cloud points are all such hulls, so one distance query serves every
//! pair.

use std::collections::HashMap;
use std::path::Path;
use std::sync::{Arc, OnceLock};

use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use crate::checked_when_read;
use crate::pose::rotated;
use crate::{Aabb, Corners, Pose, ShapeError, mesh};

/// Number of sides of the prism that approximates a cylinder. The prism is circumscribed: at its corners it is up to
/// 0.5 % wider than the cylinder, and never narrower.
const CYLINDER_SIDES: usize = 32;

/// Relative tolerance for the equal edges of a cube.
const CUBE: f64 = 1e-6;

/// Triangles of a surface, as indices of points.
type Faces = Arc<[[u32; 3]]>;

/// Convex hull of points, enlarged by a radius.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(remote = "Self")]
pub struct Convex {
    points: Vec<Point3<f64>>,
    radius: f64,
    center: Point3<f64>,
    half: Vector3<f64>,
    bound: f64,
    /// Triangles of the surface, as indices of points; empty for a flat set. They are computed on first use, unless the
    /// hull was computed when the shape was created.
    #[serde(skip)]
    faces: OnceLock<Faces>,
}

checked_when_read!(Convex);

impl PartialEq for Convex {
    fn eq(&self, other: &Self) -> bool {
        let of = |shape: &Self| (shape.radius, shape.center, shape.half, shape.bound);
        self.points == other.points && of(self) == of(other)
    }
}

impl Convex {
    /// Creates the hull of points (m), enlarged by `radius` (m, at least 0).
    ///
    /// # Errors
    /// There are no points, or a number is not finite.
    pub fn rounded_hull(points: &[Point3<f64>], radius: f64) -> Result<Self, ShapeError> {
        if points.is_empty() {
            return Err(ShapeError::new("points", "a hull needs at least one point"));
        }
        if let Some(i) = points.iter().position(|p| p.iter().any(|c| !c.is_finite())) {
            return Err(ShapeError::new(format!("points[{i}]"), "is not finite"));
        }
        if !(radius.is_finite() && radius >= 0.0) {
            return Err(ShapeError::new("radius", format!("must be finite and not negative, not {radius}")));
        }
        let (vertices, faces) = extreme_points(points);
        let hull = Self::measured(vertices, radius, faces.map_or_else(OnceLock::new, OnceLock::from));
        if !hull.bound.is_finite() {
            return Err(ShapeError::new("points", "are too far apart for distance computations"));
        }
        Ok(hull)
    }

    /// Creates the hull from its vertices, with its bounding box and bounding sphere.
    fn measured(points: Vec<Point3<f64>>, radius: f64, faces: OnceLock<Faces>) -> Self {
        let Aabb { min, max } = Aabb::around(&points, 0.0);
        let center = nalgebra::center(&min, &max);
        let bound = points.iter().map(|p| (p - center).norm()).fold(0.0, f64::max) + radius;
        Self { points, radius, center, half: (max - min) * 0.5, bound, faces }
    }

    /// Validates a deserialized shape: it must equal a shape made by [`Convex::rounded_hull`].
    fn check(&self) -> Result<(), ShapeError> {
        let whole = !self.points.is_empty() && self.radius >= 0.0 && self.bound.is_finite();
        // A NaN differs from itself, and an infinite number makes the bounding sphere infinite.
        if whole && *self == Self::measured(self.points.clone(), self.radius, OnceLock::new()) {
            return Ok(());
        }
        Err(ShapeError::new("shape", "is damaged: its box is not that of its points"))
    }

    /// Creates the hull of points (m).
    ///
    /// # Errors
    /// There are no points, or a number is not finite.
    pub fn hull(points: &[Point3<f64>]) -> Result<Self, ShapeError> {
        Self::rounded_hull(points, 0.0)
    }

    /// Creates a box with half extents (m) along the axes of a pose.
    ///
    /// # Errors
    /// A half extent is not positive and finite.
    pub fn cuboid(half: [f64; 3], pose: &Pose) -> Result<Self, ShapeError> {
        positive("half_extents", &half)?;
        let corner = |i: usize| {
            let sign = |bit: usize| if i & bit == 0 { -1.0 } else { 1.0 };
            pose * Point3::new(sign(1) * half[0], sign(2) * half[1], sign(4) * half[2])
        };
        Self::hull(&(0..8).map(corner).collect::<Vec<_>>())
    }

    /// Creates the cube between two opposite corners, whose edges are parallel to the axes of the shape's frame.
    pub(crate) fn voxel(low: Point3<f64>, high: Point3<f64>) -> Self {
        // The order of vertices is that of `extreme_points`.
        let corner =
            |i: usize| Point3::from_slice(&[0, 1, 2].map(|k| if i >> (2 - k) & 1 == 0 { low[k] } else { high[k] }));
        Self::measured((0..8).map(corner).collect(), 0.0, OnceLock::new())
    }

    /// Returns half the edge length (m) of a cube whose edges are parallel to the axes; `None` for any other shape.
    pub(crate) fn cube_half(&self) -> Option<f64> {
        let half = self.half.max();
        if self.points.len() != 8 || self.radius != 0.0 || half <= 0.0 {
            return None;
        }
        let mut corners = 0_u8;
        for p in &self.points {
            let v = p - self.center;
            if !v.iter().all(|x| (x.abs() - half).abs() <= CUBE * half) {
                return None;
            }
            corners |= 1 << (0..3).map(|k| usize::from(v[k] > 0.0) << k).sum::<usize>();
        }
        (corners == u8::MAX).then_some(half)
    }

    /// Creates a sphere of a radius (m) around `center`.
    ///
    /// # Errors
    /// The radius is not positive and finite.
    pub fn ball(radius: f64, center: Point3<f64>) -> Result<Self, ShapeError> {
        positive("radius", &[radius])?;
        Self::rounded_hull(&[center], radius)
    }

    /// Creates a capsule along the z axis of the pose; `length` (m) is the distance between the centres of its caps.
    ///
    /// # Errors
    /// Radius or length is not positive and finite.
    pub fn capsule(radius: f64, length: f64, pose: &Pose) -> Result<Self, ShapeError> {
        positive("radius and length", &[radius, length])?;
        let end = |z: f64| pose * Point3::new(0.0, 0.0, z);
        Self::rounded_hull(&[end(-length / 2.0), end(length / 2.0)], radius)
    }

    /// Creates a cylinder along the z axis of the pose, approximated by a circumscribed prism.
    ///
    /// # Errors
    /// Radius or length is not positive and finite.
    pub fn cylinder(radius: f64, length: f64, pose: &Pose) -> Result<Self, ShapeError> {
        positive("radius and length", &[radius, length])?;
        let step = std::f64::consts::TAU / CYLINDER_SIDES as f64;
        let outer = radius / (step / 2.0).cos();
        let mut points = Vec::with_capacity(2 * CYLINDER_SIDES);
        for i in 0..CYLINDER_SIDES {
            let (s, c) = (step * i as f64).sin_cos();
            for z in [-length / 2.0, length / 2.0] {
                points.push(pose * Point3::new(outer * c, outer * s, z));
            }
        }
        Self::hull(&points)
    }

    /// Creates the hull of the surface in a mesh file (.stl, .ply, .obj, .dae, .glb or .gltf). `scale` multiplies the x,
    /// y and z coordinates of its vertices, for example 0.001 each for a file in millimetres.
    ///
    /// # Errors
    /// The file cannot be read or has no faces, or a factor is zero or not finite.
    pub fn hull_of_file(path: impl AsRef<Path>, scale: [f64; 3]) -> Result<Self, ShapeError> {
        if scale.iter().any(|factor| !factor.is_finite() || *factor == 0.0) {
            return Err(ShapeError::new("scale", "a factor is 0 or not finite; use finite factors other than 0"));
        }
        let vertices =
            mesh::read(path.as_ref()).map(|surface| surface.vertices).map_err(|why| ShapeError::new("path", why))?;
        let scaled = |v: &Point3<f64>| Point3::new(v.x * scale[0], v.y * scale[1], v.z * scale[2]);
        Self::hull(&vertices.iter().map(scaled).collect::<Vec<_>>())
    }

    /// Vertices of the hull, in the shape's frame.
    #[must_use]
    pub fn points(&self) -> &[Point3<f64>] {
        &self.points
    }

    /// Triangles of the hull's surface, without the radius and in no particular orientation; none for a flat set.
    pub(crate) fn faces(&self) -> impl Iterator<Item = [Point3<f64>; 3]> {
        let faces = self.faces.get_or_init(|| faces_of(&self.points).into());
        faces.iter().map(|face| face.map(|k| self.points[k as usize]))
    }

    /// Radius (m) by which the hull is enlarged.
    #[must_use]
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// Centre of the bounding sphere.
    #[must_use]
    pub fn center(&self) -> &Point3<f64> {
        &self.center
    }

    /// Radius of the bounding sphere (m), rounding included.
    #[must_use]
    pub fn bound(&self) -> f64 {
        self.bound
    }

    /// Returns a box around the shape at a pose. It encloses the posed bounding box, which is fast but not tight.
    #[must_use]
    pub fn aabb_at(&self, pose: &Pose) -> Aabb {
        let r = pose.rotation.matrix();
        let center = Point3::from(rotated(r, &self.center.coords) + pose.translation.vector);
        let reach = rotated(&r.abs(), &self.half) + Vector3::repeat(self.radius);
        Aabb { min: center - reach, max: center + reach }
    }

    /// Writes the vertices of the shape at a pose into `out`.
    pub fn corners_at(&self, pose: &Pose, out: &mut Corners) {
        out.place(&self.points, pose);
    }

    /// Returns the shape at a pose.
    #[must_use]
    pub fn moved(&self, pose: &Pose) -> Self {
        Self::measured(self.points.iter().map(|p| pose * p).collect(), self.radius, self.faces.clone())
    }
}

fn positive(field: &str, values: &[f64]) -> Result<(), ShapeError> {
    match values.iter().find(|v| !(v.is_finite() && **v > 0.0)) {
        Some(v) => Err(ShapeError::new(field, format!("must be positive and finite, not {v}"))),
        None => Ok(()),
    }
}

/// Drops points inside the hull, and returns the triangles of its surface if they were computed. Coplanar points are all
/// kept, since a support function needs no volume.
fn extreme_points(points: &[Point3<f64>]) -> (Vec<Point3<f64>>, Option<Faces>) {
    let mut unique: Vec<Point3<f64>> = points.to_vec();
    unique.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z)));
    unique.dedup();
    if unique.len() <= 8 {
        return (unique, None);
    }
    match parry3d_f64::transformation::try_convex_hull(&unique) {
        Ok((vertices, faces)) if vertices.len() >= 4 => (vertices, Some(faces.into())),
        _ => (unique, None),
    }
}

/// Returns the triangles of the hull of points.
fn faces_of(points: &[Point3<f64>]) -> Vec<[u32; 3]> {
    if points.len() < 4 {
        return Vec::new();
    }
    let Ok((vertices, faces)) = parry3d_f64::transformation::try_convex_hull(points) else { return Vec::new() };
    let bits = |p: &Point3<f64>| <[f64; 3]>::from(*p).map(f64::to_bits);
    let places: HashMap<[u64; 3], u32> = (0..).zip(points).map(|(k, p)| (bits(p), k)).collect();
    let of = |face: [u32; 3]| -> Option<[u32; 3]> {
        let mut out = [0; 3];
        for (k, vertex) in out.iter_mut().zip(face) {
            *k = *places.get(&bits(&vertices[vertex as usize]))?;
        }
        Some(out)
    };
    faces.into_iter().map(of).collect::<Option<_>>().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn degenerate_input_is_refused() {
        assert!(Convex::hull(&[]).is_err());
        assert!(Convex::hull(&[Point3::new(f64::NAN, 0.0, 0.0)]).is_err());
        assert!(Convex::ball(0.0, Point3::origin()).is_err());
    }
}

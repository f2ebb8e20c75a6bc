//! Collision shapes of bodies.

use std::ffi::c_char;

use gensim2_geometry::{Convex, ShapeError};
use nalgebra::Point3;

use crate::guard::{Fault, array, freed, giving, kpam_status, numbers, optional_numbers, optional_pose, text};

/// A collision shape, in the frame of the body that it becomes a part of. One shape may serve several bodies.
pub struct kpam_shape(pub(crate) Vec<Convex>);

fn fault(error: ShapeError) -> Fault {
    let status = if error.field == "path" { kpam_status::KPAM_FILE } else { kpam_status::KPAM_INVALID };
    Fault(status, error.to_string())
}

fn one(shape: Result<Convex, ShapeError>) -> Result<kpam_shape, Fault> {
    shape.map(|shape| kpam_shape(vec![shape])).map_err(fault)
}

/// Returns points of an argument.
///
/// # Safety
/// `data` is null or points to 3 numbers for each point.
pub(crate) unsafe fn points(data: *const f64, count: usize, name: &str) -> Result<Vec<Point3<f64>>, Fault> {
    // SAFETY: guaranteed by the caller.
    let rows = unsafe { array(data, count, 3, name) }?;
    let read = |(k, p): (usize, &[f64])| {
        let point = Point3::new(p[0], p[1], p[2]);
        let is_finite = point.iter().all(|c| c.is_finite());
        if is_finite { Ok(point) } else { Err(Fault::invalid(format!("{name}[{k}]: {p:?} is not finite"))) }
    };
    rows.chunks_exact(3).enumerate().map(read).collect()
}

/// Creates a box with half extents (3 numbers, m) along the axes of `pose` in the body frame; a null pose is the
/// identity.
///
/// # Safety
/// `half_extents` is null or points to 3 numbers; `pose` is null or points to 16; `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_shape_box(
    half_extents: *const f64,
    pose: *const f64,
    out: *mut *mut kpam_shape,
) -> kpam_status {
    let make = || {
        // SAFETY: guaranteed by the caller.
        let (half, pose) = unsafe { (numbers(half_extents, 3, "half_extents")?, optional_pose(pose, "pose")?) };
        one(Convex::cuboid([half[0], half[1], half[2]], &pose))
    };
    // SAFETY: guaranteed by the caller.
    unsafe { giving(out, make) }
}

/// Creates a sphere with a radius (m) around `center` (3 numbers, m, body frame); a null centre is the origin.
///
/// # Safety
/// `center` is null or points to 3 numbers; `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_shape_sphere(radius: f64, center: *const f64, out: *mut *mut kpam_shape) -> kpam_status {
    let make = || {
        // SAFETY: guaranteed by the caller.
        let center = unsafe { optional_numbers(center, 3, "center") }?;
        one(Convex::ball(radius, center.map_or(Point3::origin(), |c| Point3::new(c[0], c[1], c[2]))))
    };
    // SAFETY: guaranteed by the caller.
    unsafe { giving(out, make) }
}

/// Creates a capsule with a radius (m) along the z axis of `pose` in the body frame; a null pose is the identity.
/// `length` (m) is the distance between the centres of its caps.
///
/// # Safety
/// `pose` is null or points to 16 numbers; `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_shape_capsule(
    radius: f64,
    length: f64,
    pose: *const f64,
    out: *mut *mut kpam_shape,
) -> kpam_status {
    // SAFETY: guaranteed by the caller.
    unsafe { giving(out, || one(Convex::capsule(radius, length, &optional_pose(pose, "pose")?))) }
}

/// Creates a cylinder with a radius and a length (m) along the z axis of `pose` in the body frame; a null pose is the
/// identity. The cylinder is approximated by a circumscribed prism of 32 sides.
///
/// # Safety
/// `pose` is null or points to 16 numbers; `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_shape_cylinder(
    radius: f64,
    length: f64,
    pose: *const f64,
    out: *mut *mut kpam_shape,
) -> kpam_status {
    // SAFETY: guaranteed by the caller.
    unsafe { giving(out, || one(Convex::cylinder(radius, length, &optional_pose(pose, "pose")?))) }
}

/// Creates the convex hull of points (`count` x 3 numbers, m, body frame).
///
/// # Safety
/// `points` is null or points to `count` x 3 numbers; `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_shape_convex_hull(
    points: *const f64,
    count: usize,
    out: *mut *mut kpam_shape,
) -> kpam_status {
    // SAFETY: guaranteed by the caller.
    unsafe { giving(out, || one(Convex::hull(&self::points(points, count, "points")?))) }
}

/// Creates the convex hull of the surface in a mesh file (.stl, .ply, .obj, .dae, .glb or .gltf), as for a collision
/// mesh of a URDF. `scale` (3 factors, null for 1 each) multiplies the coordinates; use 0.001 each for a file in
/// millimetres. A concave object needs several hulls, or `kpam_shape_mesh`.
///
/// # Safety
/// `path` is null or a zero-terminated string; `scale` is null or points to 3 numbers; `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_shape_hull_of_file(
    path: *const c_char,
    scale: *const f64,
    out: *mut *mut kpam_shape,
) -> kpam_status {
    let make = || {
        // SAFETY: guaranteed by the caller.
        let (path, scale) = unsafe { (text(path, "path")?, optional_numbers(scale, 3, "scale")?) };
        one(Convex::hull_of_file(path, scale.map_or([1.0; 3], |s| [s[0], s[1], s[2]])))
    };
    // SAFETY: guaranteed by the caller.
    unsafe { giving(out, make) }
}

/// Creates a surface of `triangle_count` triangles (3 indices each, from 0) over vertices (`vertex_count` x 3 numbers,
/// m, body frame). The surface is not solid: a body entirely inside does not collide with it.
///
/// # Safety
/// `vertices` is null or points to `vertex_count` x 3 numbers; `triangles` is null or points to `triangle_count` x 3
/// indices; `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_shape_mesh(
    vertices: *const f64,
    vertex_count: usize,
    triangles: *const u32,
    triangle_count: usize,
    out: *mut *mut kpam_shape,
) -> kpam_status {
    let make = || {
        // SAFETY: guaranteed by the caller.
        let vertices = unsafe { points(vertices, vertex_count, "vertices") }?;
        // SAFETY: guaranteed by the caller.
        let triangles = unsafe { array(triangles, triangle_count, 3, "triangles") }?;
        if triangles.is_empty() {
            return Err(Fault::invalid("triangles: is empty"));
        }
        let corner = |t: usize, index: u32| {
            vertices.get(index as usize).copied().ok_or_else(|| {
                let message = format!("triangles[{t}]: names vertex {index} of {}; count from 0", vertices.len());
                Fault::invalid(message)
            })
        };
        let facet = |(t, corners): (usize, &[u32])| {
            let corners = [corner(t, corners[0])?, corner(t, corners[1])?, corner(t, corners[2])?];
            Convex::hull(&corners).map_err(fault)
        };
        triangles.chunks_exact(3).enumerate().map(facet).collect::<Result<_, _>>().map(kpam_shape)
    };
    // SAFETY: guaranteed by the caller.
    unsafe { giving(out, make) }
}

/// Creates a point cloud (`count` x 3 numbers, m, body frame) in which each point is a sphere of a radius (m). An empty
/// cloud is no obstacle. Choose at least half the distance between neighbouring points as the radius, so that the cloud
/// has no holes; the margin of a motion is kept in addition.
///
/// # Safety
/// `points` is null or points to `count` x 3 numbers; `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_shape_point_cloud(
    points: *const f64,
    count: usize,
    radius: f64,
    out: *mut *mut kpam_shape,
) -> kpam_status {
    let make = || {
        // SAFETY: guaranteed by the caller.
        let points = unsafe { self::points(points, count, "points") }?;
        // Validates the radius even if the cloud is empty.
        Convex::ball(radius, Point3::origin()).map_err(fault)?;
        let balls = points.into_iter().map(|point| Convex::ball(radius, point).map_err(fault));
        balls.collect::<Result<_, _>>().map(kpam_shape)
    };
    // SAFETY: guaranteed by the caller.
    unsafe { giving(out, make) }
}

/// Frees a shape; null is ignored. Bodies that were made of the shape stay valid.
///
/// # Safety
/// `shape` is null or a shape that was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_shape_free(shape: *mut kpam_shape) {
    // SAFETY: guaranteed by the caller.
    unsafe { freed(shape) }
}

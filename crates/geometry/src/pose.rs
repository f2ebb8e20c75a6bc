//! Rigid transforms. A [`Pose`] stores its rotation as a matrix, because most of the work consists of products, which
//! are cheaper with matrices than with quaternions.

use nalgebra::{ArrayStorage, IsometryMatrix3, Matrix3, Matrix4, Rotation3, Translation3, Unit, Vector3};

/// Rigid transform `T_a_b`, which maps coordinates in frame `b` to frame `a`.
pub type Pose = IsometryMatrix3<f64>;

/// Creates a pose from a translation and fixed-axis roll, pitch, yaw, as in URDF.
#[must_use]
pub fn pose_from_xyz_rpy(xyz: [f64; 3], rpy: [f64; 3]) -> Pose {
    Pose::from_parts(Translation3::from(Vector3::from(xyz)), Rotation3::from_euler_angles(rpy[0], rpy[1], rpy[2]))
}

/// Creates a pose from a homogeneous matrix; `None` if it is not a finite rigid transform within `tolerance`.
///
/// The rotation is replaced by the nearest orthonormal one, so that single-precision errors do not grow in products.
#[must_use]
pub fn pose_from_matrix(m: &Matrix4<f64>, tolerance: f64) -> Option<Pose> {
    if m.iter().any(|v| !v.is_finite()) {
        return None;
    }
    let r: Matrix3<f64> = m.fixed_view::<3, 3>(0, 0).into();
    let orthonormal = (r.transpose() * r - Matrix3::identity()).amax() <= tolerance && r.determinant() > 0.0;
    let last = m.row(3);
    let affine = last[0].abs() <= tolerance
        && last[1].abs() <= tolerance
        && last[2].abs() <= tolerance
        && (last[3] - 1.0).abs() <= tolerance;
    if !(orthonormal && affine) {
        return None;
    }
    let svd = r.svd(true, true);
    let exact = svd.u? * svd.v_t?;
    let t: Vector3<f64> = m.fixed_view::<3, 1>(0, 3).into();
    Some(Pose::from_parts(Translation3::from(t), Rotation3::from_matrix_unchecked(exact)))
}

/// Tolerance of the orthonormality of rotations.
const ORTHONORMAL: f64 = 1e-5;

/// Returns whether a pose is finite and its rotation orthonormal.
#[must_use]
pub fn is_rigid(pose: &Pose) -> bool {
    let r = pose.rotation.matrix();
    // Comparisons with a non-finite number are false.
    pose.translation.vector.iter().all(|v| v.is_finite())
        && (r.transpose() * r - Matrix3::identity()).iter().all(|v| v.abs() <= ORTHONORMAL)
        && r.determinant() > 0.0
}

/// Returns the homogeneous 4 x 4 matrix of a pose.
#[must_use]
pub fn pose_to_matrix(pose: &Pose) -> Matrix4<f64> {
    pose.to_homogeneous()
}

/// Returns the matrix of a rotation by `angle` about a unit axis.
#[must_use]
pub fn rotation_about(axis: &Vector3<f64>, angle: f64) -> Rotation3<f64> {
    Rotation3::from_axis_angle(&Unit::new_unchecked(*axis), angle)
}

/// Returns a matrix times a vector, inlined like [`product`].
#[inline(always)]
pub(crate) fn rotated(m: &Matrix3<f64>, v: &Vector3<f64>) -> Vector3<f64> {
    let [x, y, z] = &m.data.0;
    Vector3::new(
        x[0] * v.x + y[0] * v.y + z[0] * v.z,
        x[1] * v.x + y[1] * v.y + z[1] * v.z,
        x[2] * v.x + y[2] * v.y + z[2] * v.z,
    )
}

/// Returns a product of matrices. It is inlined because the library's version is a function call, and planning computes
/// millions of products.
#[inline(always)]
pub(crate) fn product(a: &Matrix3<f64>, b: &Matrix3<f64>) -> Matrix3<f64> {
    let (a, b) = (&a.data.0, &b.data.0);
    let mut out = [[0.0; 3]; 3];
    for (column, weights) in out.iter_mut().zip(b) {
        for (i, value) in column.iter_mut().enumerate() {
            *value = a[0][i] * weights[0] + a[1][i] * weights[1] + a[2][i] * weights[2];
        }
    }
    Matrix3::from_array_storage(ArrayStorage(out))
}

/// Returns a rotation followed by a rotation about a unit axis. Rotations about z, as in most URDF arms, are faster.
#[inline(always)]
pub(crate) fn turned(r: &Matrix3<f64>, axis: &Vector3<f64>, angle: f64) -> Matrix3<f64> {
    if axis.x == 0.0 && axis.y == 0.0 {
        let (s, c) = (angle * axis.z).sin_cos();
        let [x, y, z] = r.data.0;
        let along = [0, 1, 2].map(|i| x[i] * c + y[i] * s);
        let across = [0, 1, 2].map(|i| y[i] * c - x[i] * s);
        return Matrix3::from_array_storage(ArrayStorage([along, across, z]));
    }
    product(r, rotation_about(axis, angle).matrix())
}

/// Returns the rotation vector of a rotation: its unit axis times its angle (0..pi).
#[must_use]
pub fn rotation_log(rotation: &Rotation3<f64>) -> Vector3<f64> {
    let m = rotation.matrix();
    let vee = Vector3::new(m[(2, 1)] - m[(1, 2)], m[(0, 2)] - m[(2, 0)], m[(1, 0)] - m[(0, 1)]) * 0.5;
    let sin = vee.norm();
    let cos = ((m.trace() - 1.0) * 0.5).clamp(-1.0, 1.0);
    let angle = sin.atan2(cos);
    if sin > 1e-7 {
        return vee * (angle / sin);
    }
    if cos > 0.0 {
        return vee;
    }
    // Near half a turn the antisymmetric part vanishes, but R + 1 = 2 a a^T; its largest column gives axis a.
    let s = (m + Matrix3::identity()) * 0.5;
    let i = (0..3).fold(0, |best, k| if s[(k, k)] > s[(best, best)] { k } else { best });
    let axis: Vector3<f64> = s.column(i).into();
    let axis = axis / axis.norm();
    let sign = if axis.dot(&vee) < 0.0 { -1.0 } else { 1.0 };
    axis * (angle * sign)
}

/// Returns the rotation by `angle` about the line through `point` with unit direction `axis`.
#[must_use]
pub fn screw_about(point: &Vector3<f64>, axis: &Vector3<f64>, angle: f64) -> Pose {
    let r = rotation_about(axis, angle);
    Pose::from_parts(Translation3::from(point - r * point), r)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector() -> impl Strategy<Value = Vector3<f64>> {
        prop::array::uniform3(-1.0..1.0f64).prop_map(Vector3::from)
    }

    proptest! {
        #[test]
        fn log_inverts_the_exponential(w in vector(), angle in 0.0..3.1f64) {
            prop_assume!(w.norm() > 1e-3);
            let v = w.normalize() * angle;
            let back = rotation_log(&Rotation3::new(v));
            prop_assert!((back - v).norm() < 1e-7);
        }

        #[test]
        fn log_survives_half_a_turn(w in vector(), off in -1e-9..1e-9f64) {
            prop_assume!(w.norm() > 1e-3);
            let v = w.normalize() * (std::f64::consts::PI + off);
            let r = Rotation3::new(v);
            let again = Rotation3::new(rotation_log(&r));
            prop_assert!((again.matrix() - r.matrix()).amax() < 1e-6);
        }

        #[test]
        fn a_screw_keeps_its_axis(p in vector(), w in vector(), s in -2.0..2.0f64, angle in -3.0..3.0f64) {
            prop_assume!(w.norm() > 1e-3);
            let axis = w.normalize();
            let on = p + axis * s;
            let moved = screw_about(&p, &axis, angle) * nalgebra::Point3::from(on);
            prop_assert!((moved.coords - on).norm() < 1e-12);
        }
    }

    #[test]
    fn refuses_what_is_not_rigid() {
        let mut m = Matrix4::identity();
        m[(0, 0)] = 1.1;
        assert!(pose_from_matrix(&m, 1e-4).is_none());
        m[(0, 0)] = f64::NAN;
        assert!(pose_from_matrix(&m, 1e-4).is_none());
        let mirror = Matrix4::from_diagonal(&nalgebra::Vector4::new(-1.0, 1.0, 1.0, 1.0));
        assert!(pose_from_matrix(&mirror, 1e-4).is_none());
    }
}

//! Camera points that belong to the robot itself.

use nalgebra::{Point3, Vector3};

use crate::{Aabb, Convex, Corners, Pose, signed_distance};

/// Marks the points (base frame, m) that lie inside or within `clearance` of posed shapes, such as a robot's links at a
/// joint vector. A camera sees these points, but they are no obstacle.
#[must_use]
pub fn points_within<'s>(
    points: &[Point3<f64>],
    shapes: impl IntoIterator<Item = (Pose, &'s Convex)>,
    clearance: f64,
) -> Vec<bool> {
    let mut out = vec![false; points.len()];
    let wide = Vector3::repeat(clearance);
    for (pose, shape) in shapes {
        let Aabb { min, max } = shape.aabb_at(&pose);
        let (min, max) = (min - wide, max + wide);
        let mut corners = Corners::default();
        shape.corners_at(&pose, &mut corners);
        let mut toward = Vector3::x();
        for (point, own) in points.iter().zip(&mut out) {
            let near = (0..3).all(|i| min[i] <= point[i] && point[i] <= max[i]);
            if *own || !near {
                continue;
            }
            let at = Corners::of(&[*point]);
            // Points with invalid coordinates count as the robot's own, since planning could not avoid them.
            *own = signed_distance((&corners, shape.radius()), (&at, 0.0), &mut toward, clearance)
                .is_some_and(|contact| contact.distance <= clearance);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose_from_xyz_rpy;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn marks_are_those_of_a_box_and_a_ball(
            list in prop::collection::vec((-1.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64), 60),
            at in (-0.3..0.3f64, -0.3..0.3f64, -0.3..0.3f64),
            turn in (-3.0..3.0f64, -1.5..1.5f64, -3.0..3.0f64),
            clearance in 0.0..0.3f64,
        ) {
            let half = [0.3, 0.2, 0.1];
            let cuboid = Convex::cuboid(half, &Pose::identity()).unwrap();
            let ball = Convex::ball(0.15, Point3::new(0.5, 0.0, 0.0)).unwrap();
            let pose = pose_from_xyz_rpy([at.0, at.1, at.2], [turn.0, turn.1, turn.2]);
            let points: Vec<Point3<f64>> = list.iter().map(|(x, y, z)| Point3::new(*x, *y, *z)).collect();
            let marks = points_within(&points, [(pose, &cuboid), (pose, &ball)], clearance);
            for (point, own) in points.iter().zip(marks) {
                let local = pose.inverse_transform_point(point);
                let out = Vector3::from_fn(|i, _| (local[i].abs() - half[i]).max(0.0)).norm();
                let from_ball = (local - Point3::new(0.5, 0.0, 0.0)).norm() - 0.15;
                let near = out.min(from_ball);
                prop_assume!((near - clearance).abs() > 1e-7);
                prop_assert_eq!(own, near < clearance);
            }
        }
    }
}

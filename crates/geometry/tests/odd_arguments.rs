//! No public function panics on unsuitable arguments.
#![allow(clippy::unwrap_used)]

use gensim2_geometry::{
    Aabb, Bvh, ChainFrames, Convex, Corners, MovingShapes, Obstacles, Pose, Robot, Scratch, checked_pairs,
    pose_from_matrix, rotation_about, rotation_log, screw_about, signed_distance,
};
use nalgebra::{Matrix4, Point3, Rotation3, Translation3, Vector3};
use proptest::prelude::*;

/// Two moving links with shapes, the second joint following the first.
fn robot() -> Robot {
    let link = |name: &str| {
        format!(r#"<link name="{name}"><collision><geometry><box size="0.1 0.2 0.3"/></geometry></collision></link>"#)
    };
    let text = format!(
        r#"<robot name="arm">{}{}{}
        <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 0 0.4"/>
          <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="1" velocity="2"/></joint>
        <joint name="slide" type="prismatic"><parent link="arm"/><child link="hand"/><axis xyz="0 0 1"/>
          <limit lower="0" upper="1" effort="1" velocity="2"/><mimic joint="turn" multiplier="0.5"/></joint></robot>"#,
        link("base"),
        link("arm"),
        link("hand")
    );
    Robot::from_urdf_str(&text, "arm.urdf", None, "hand", None).unwrap()
}

fn number() -> impl Strategy<Value = f64> {
    let odd = [0.0, -0.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, f64::MIN_POSITIVE, 1e200, -1e160];
    prop_oneof![3 => -2.0..2.0f64, 1 => prop::sample::select(odd.to_vec())]
}

fn vector() -> impl Strategy<Value = Vector3<f64>> {
    prop::array::uniform3(number()).prop_map(Vector3::from)
}

fn pose() -> impl Strategy<Value = Pose> {
    (vector(), prop::array::uniform3(number()))
        .prop_map(|(t, r)| Pose::from_parts(Translation3::from(t), Rotation3::from_euler_angles(r[0], r[1], r[2])))
}

fn index() -> impl Strategy<Value = usize> {
    prop_oneof![4 => 0..5usize, 1 => Just(usize::MAX)]
}

proptest! {
    #[test]
    fn a_robot_takes_any_joint_vector_and_index(
        q in prop::collection::vec(number(), 0..4),
        i in index(),
        point in vector(),
        short in 0..3usize,
    ) {
        let robot = robot();
        let fits = q.len() == robot.joints().len();
        let mut poses = Vec::new();
        prop_assert_eq!(robot.link_poses(&q, &mut poses).is_ok(), fits);
        prop_assert_eq!(poses.len(), if fits { 3 } else { 0 });
        prop_assert_eq!(robot.link_pose(&q, i).is_some(), fits && i < 3);
        prop_assert_eq!(robot.drive(i).is_some(), i < 2);
        prop_assert_eq!(robot.range(i).is_some(), i < 2);
        let mut followed = q.clone();
        robot.apply_mimic(&mut followed);
        prop_assert_eq!(followed.len(), q.len());
        prop_assert_eq!(robot.chain_to(i).is_some(), i < 3);
        for chain in robot.chain_to(i).iter().chain([robot.chain()]) {
            let mut frames = ChainFrames::default();
            prop_assert_eq!(chain.forward(&q, &mut frames).is_ok(), fits);
            frames.axes.truncate(short);
            let there = i < chain.len() && i < frames.axes.len();
            prop_assert_eq!(chain.kind(i).is_some(), i < chain.len());
            prop_assert_eq!(chain.linear(&frames, i, &point).is_some(), there);
            prop_assert_eq!(chain.angular(&frames, i).is_some(), there);
        }
        let _ = robot.joints()[0].motion(point.x);
        let _ = checked_pairs(&robot, |_, _| true);
    }

    #[test]
    fn shapes_take_any_numbers(
        points in prop::collection::vec(vector(), 0..12),
        more in prop::collection::vec(vector(), 0..12),
        numbers in prop::array::uniform4(number()),
        pose in pose(),
        mut toward in vector(),
    ) {
        let as_points = |list: &[Vector3<f64>]| -> Vec<Point3<f64>> { list.iter().map(|p| Point3::from(*p)).collect() };
        let (points, more) = (as_points(&points), as_points(&more));
        let [a, b, c, reach] = numbers;
        let shapes: Vec<Convex> = [
            Convex::rounded_hull(&points, a),
            Convex::hull(&more),
            Convex::cuboid([a, b, c], &pose),
            Convex::capsule(a, b, &pose),
            Convex::cylinder(a, b, &pose),
            Convex::ball(a, Point3::new(b, c, a)),
        ]
        .into_iter()
        .flatten()
        .collect();
        for shape in &shapes {
            let _ = (shape.aabb_at(&pose), shape.moved(&pose), shape.triangles());
            let mut corners = Corners::of(&points);
            let _ = signed_distance((&corners, a), (&Corners::of(&more), b), &mut toward, reach);
            shape.corners_at(&pose, &mut corners);
            let _ = signed_distance((&corners, shape.radius()), (&Corners::of(shape.points()), c), &mut toward, reach);
        }
    }

    #[test]
    fn queries_take_any_groups_and_memory(
        poses in prop::collection::vec(pose(), 0..4),
        still in pose(),
        groups in prop::collection::vec(index(), 0..4),
        pairs in prop::collection::vec((index(), index()), 0..4),
        which in prop::collection::vec(index(), 0..4),
        limits in prop::array::uniform2(number()),
        placed in any::<bool>(),
        remembers in any::<bool>(),
    ) {
        let robot = robot();
        let [coarse, reach] = limits;
        let shapes = MovingShapes::new(robot.links().iter().map(|l| l.shapes()));
        let obstacles = Obstacles::new(robot.links().iter().map(|l| (l.shapes(), &still)));
        let mut scratch = if remembers { Scratch::remembering() } else { Scratch::default() };
        if placed {
            shapes.place(&groups, &mut scratch, |out| out.clone_from(&poses));
        }
        for group in &groups {
            let _ = (shapes.is_bare(*group), shapes.extent(*group, &shapes.middle(*group)));
        }
        let seen = |group: usize| placed && groups.contains(&group) && group < poses.len().min(3);
        let mut wrong = Vec::new();
        shapes.near_bodies(&groups, &obstacles, &mut scratch, coarse, |_, _| reach, |p| {
            wrong.extend((!seen(p.group)).then_some(p.group));
            true
        });
        shapes.near_pairs(&pairs, &which, &mut scratch, coarse, |_| reach, |index, p| {
            wrong.extend((!seen(pairs[index].0) || !seen(pairs[index].1)).then_some(p.group));
            true
        });
        prop_assert!(wrong.is_empty(), "{:?}", wrong);
    }

    #[test]
    fn boxes_and_rotations_take_any_numbers(
        corners in prop::collection::vec((vector(), vector()), 0..20),
        entries in prop::collection::vec(number(), 16),
        tolerance in number(),
        pose in pose(),
        point in vector(),
        axis in vector(),
        value in number(),
    ) {
        let boxes: Vec<Aabb> = corners.iter().map(|(a, b)| Aabb { min: (*a).into(), max: (*b).into() }).collect();
        let tree = Bvh::new(&boxes);
        tree.near(&Aabb::of_ball(&Point3::from(point), value), tolerance, |i| assert!(i < boxes.len()));
        tree.along(&Point3::from(point), &axis, |i| assert!(i < boxes.len()));
        let _ = pose_from_matrix(&Matrix4::from_iterator(entries), tolerance);
        let _ = (rotation_log(&pose.rotation), rotation_about(&axis, value), screw_about(&point, &axis, value));
    }
}

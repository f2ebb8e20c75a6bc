//! Checks that no public function panics on unsuitable arguments.
#![allow(clippy::unwrap_used)]

use std::sync::Arc;

use gensim2_geometry::{Convex, Pose, Robot};
use gensim2_kpam::config::{Constraint, Frame, Motion, TargetAxis};
use gensim2_kpam::grasp::GripperKeypoints;
use gensim2_kpam::qp::{ActiveSet, Bound, Qp, QpOutcome};
use gensim2_kpam::{
    Body, Cancel, GraspOptions, GraspTask, KeypointProblem, Limits, MAX_JOINTS, ObjectJoint, ObjectJointKind, Options,
    ParallelGripper, Plan, RefineOptions, Request, RetimeOptions, Role, Row, Scene, SceneJoint, SolverConfig, Status,
    ik, joint_travel, min_clearance, plan, plan_batch, plan_with, refine, retime,
};
use nalgebra::{Point3, Rotation3, Translation3, Vector3};
use proptest::prelude::*;

const ODD: [f64; 9] = [0.0, -0.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, f64::MIN_POSITIVE, 1e200, -1e9];

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![4 => -2.0..2.0f64, 1 => prop::sample::select(ODD.to_vec())]
}

fn numbers(most: usize) -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(number(), 0..most)
}

fn vector() -> impl Strategy<Value = Vector3<f64>> {
    prop::array::uniform3(number()).prop_map(Vector3::from)
}

fn pose() -> impl Strategy<Value = Pose> {
    (vector(), prop::array::uniform3(number()))
        .prop_map(|(t, r)| Pose::from_parts(Translation3::from(t), Rotation3::from_euler_angles(r[0], r[1], r[2])))
}

fn name() -> impl Strategy<Value = String> {
    prop::sample::select(vec!["tip", "goal", "box", "lid", "joint", "pre_0", "actuation", "", "nothing"])
        .prop_map(str::to_owned)
}

/// Returns a gantry robot whose links have shapes.
fn robot() -> Arc<Robot> {
    let link = |i: usize| {
        format!(r#"<link name="l{i}"><collision><geometry><box size="0.05 0.05 0.2"/></geometry></collision></link>"#)
    };
    let joint = |i: usize, axis: &str| {
        format!(
            r#"<joint name="j{i}" type="prismatic"><parent link="l{i}"/><child link="l{}"/><origin xyz="0.3 0 0.1"/>
            <axis xyz="{axis}"/><limit lower="-2" upper="2" effort="1" velocity="2"/></joint>"#,
            i + 1
        )
    };
    let links: String = (0..4).map(link).collect();
    let joints = [joint(0, "1 0 0"), joint(1, "0 1 0"), joint(2, "0 0 1")].concat();
    let text = format!(r#"<robot name="gantry">{links}{joints}</robot>"#);
    Arc::new(Robot::from_urdf_str(&text, "gantry.urdf", None, "l3", None).unwrap())
}

/// Returns a body; `None` if the pose is invalid.
fn body(name: &str, role: Role, pose: Pose) -> Option<Body> {
    let shape = Convex::cuboid([0.05; 3], &Pose::identity()).unwrap();
    let builder = Body::builder(name, role).shape(shape).keypoint("top", Vector3::new(0.0, 0.0, 0.05));
    builder.pose(pose).build().ok()
}

fn problem() -> KeypointProblem {
    let config = SolverConfig::builder()
        .constraint(Constraint::point("tip", "goal", 1e-3))
        .pre(Motion::Translate { axis: 2, distance: 0.02 })
        .post(Motion::Move(Vector3::new(0.0, 0.0, 0.02)))
        .build()
        .unwrap();
    let mut options = Options::default();
    (options.num_seeds, options.candidates, options.extra_seeds) = (4, 2, 0);
    (options.samples, options.workspace) = (20, None);
    KeypointProblem::builder(robot(), config, vec![0.1; 3])
        .tool_keypoint("tip", Vector3::new(0.1, 0.0, 0.0))
        .object_keypoint("goal", Vector3::new(0.8, 0.2, 0.1))
        .options(options)
        .build()
        .unwrap()
}

fn solved() -> &'static (KeypointProblem, Plan) {
    static SOLVED: std::sync::OnceLock<(KeypointProblem, Plan)> = std::sync::OnceLock::new();
    SOLVED.get_or_init(|| {
        let problem = problem();
        let plan = plan(&problem);
        assert_eq!(plan.status(), Status::Solved, "{}", plan.reason);
        (problem, plan)
    })
}

fn constraint() -> impl Strategy<Value = Constraint> {
    let frame = prop::sample::select(vec![Frame::World, Frame::Object, Frame::Joint]);
    prop_oneof![
        (name(), name(), number()).prop_map(|(a, b, t)| Constraint::point(a, b, t)),
        (name(), name(), vector(), frame.clone(), number()).prop_map(|(keypoint, target, offset, frame, tolerance)| {
            Constraint::Point { keypoint, target, offset, frame, tolerance }
        }),
        (name(), name(), vector(), frame.clone(), number(), number())
            .prop_map(|(a, b, axis, frame, c, t)| Constraint::axis(a, b, TargetAxis::Fixed { axis, frame }, c, t)),
        (name(), name(), vector(), frame, number()).prop_map(|(keypoint, target, normal, frame, weight)| {
            Constraint::PlaneCost { keypoint, target, normal, frame, weight }
        }),
        (name(), name(), number()).prop_map(|(keypoint, target, weight)| Constraint::PointCost {
            keypoint,
            target,
            weight
        }),
    ]
}

fn motion() -> impl Strategy<Value = Motion> {
    prop_oneof![
        (0..5usize, number()).prop_map(|(axis, distance)| Motion::Translate { axis, distance }),
        vector().prop_map(Motion::Move),
        number().prop_map(Motion::Rotate),
        number().prop_map(Motion::FollowJoint),
        number().prop_map(Motion::TraceJointTo),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    #[test]
    fn configs_take_anything(
        constraints in prop::collection::vec(constraint(), 0..3),
        pre in prop::collection::vec(motion(), 0..3),
        post in prop::collection::vec(motion(), 0..3),
        times in prop::option::of((number(), numbers(4), numbers(4))),
    ) {
        let mut builder = SolverConfig::builder();
        builder = constraints.into_iter().fold(builder, |b, c| b.constraint(c));
        builder = pre.into_iter().fold(builder, |b, m| b.pre(m));
        builder = post.into_iter().fold(builder, |b, m| b.post(m));
        if let Some((actuation, pre, post)) = times {
            builder = builder.times(actuation, pre, post);
        }
        if let Ok(config) = builder.build() {
            prop_assert!(config.clock(0.0).is_ok() || !config.has_times());
            if let Ok(whole) = problem().changed().config(config).build() {
                let _ = plan(&whole);
            }
        }
    }

    #[test]
    fn problems_take_anything(
        q in numbers(5),
        keypoint in vector(),
        object in pose(),
        axis in 0..5usize,
        velocity in prop::option::of(numbers(5)),
        limits in prop::option::of(numbers(5)),
        joint in prop::option::of((vector(), vector(), numbers(3))),
        box_pose in pose(),
        odd in prop::array::uniform4(number()),
        label in name(),
        counts in prop::array::uniform3(0..3usize),
        which in 0..9usize,
    ) {
        let odd_one = problem().changed();
        let mut options = problem().options().clone();
        let odd_one = match which {
            0 => odd_one.q_start(q.clone()),
            1 => odd_one.tool_keypoint("tip", keypoint),
            2 => odd_one.object(object).world(box_pose).object_axis(axis),
            3 => {
                (options.start_velocity, options.velocity_limits) = (velocity.clone(), limits);
                odd_one.options(options)
            }
            4 => {
                let bodies = [body("box", Role::Rigid, box_pose), body("lid", Role::Attached, object)];
                odd_one.bodies(bodies.into_iter().flatten().collect::<Vec<_>>())
            }
            5 => {
                (options.margin, options.velocity_scale, options.start_time) = (odd[0], odd[1], odd[2]);
                odd_one.options(options)
            }
            6 => {
                (options.num_seeds, options.candidates, options.num_refinements) = (counts[0], counts[1], counts[2]);
                odd_one.options(options)
            }
            7 => {
                options.pick = vec![label.clone()];
                odd_one.options(options)
            }
            _ => {
                let made = joint.and_then(|(origin, axis, v)| {
                    let at = |i: usize| v.get(i).copied().unwrap_or(0.0);
                    ObjectJoint::new(ObjectJointKind::Revolute, origin, axis, at(0), [at(1), at(2)]).ok()
                });
                made.into_iter().fold(odd_one, |odd_one, joint| odd_one.joint(joint))
            }
        };
        let Ok(wrong) = odd_one.build() else { return Ok(()) };
        prop_assert!(ik(&wrong, counts[0]).is_ok());
        let _ = plan(&wrong);
        let _ = plan_batch(&[&wrong], Some(counts[1]), &Cancel::new());
        let (right, former) = solved();
        let mut request = Request::default();
        (request.warm_start, request.resume, request.max_checks) = (Some(former), Some(label.as_str()), Some(50));
        let _ = plan_with(&wrong, &request);
        let _ = right.with_start(q.clone(), velocity.clone(), velocity.clone(), odd[3]).map(|p| plan(&p));
        let _ = wrong.scene();
        // A plan that belongs to another problem.
        let _ = joint_travel(&wrong, former, &odd);
        let _ = min_clearance(&wrong, former, odd[0].max(0.5), &Cancel::new());
        let _ = refine(&wrong, former, &RefineOptions::default());
    }

    #[test]
    fn plans_are_looked_at_with_anything(times in numbers(6), step in number(), keep in any::<bool>(), q in numbers(5)) {
        let (problem, plan) = solved();
        let trajectory = plan.trajectory().unwrap();
        for t in &times {
            let sample = trajectory.sample(*t);
            prop_assert_eq!(sample.position.len(), 3);
        }
        prop_assert_eq!(joint_travel(problem, plan, &times).len(), times.len());
        let _ = min_clearance(problem, plan, if step > 0.0 { step.max(0.05) } else { step }, &Cancel::new());
        let mut options = RefineOptions::default();
        (options.times, options.keep_paths) = (Some(times), keep);
        let _ = refine(problem, plan, &options);
        let mut other = plan.clone();
        // A plan in which the time of a keyframe was changed arbitrarily.
        other.keyframes[0].time = Some(step * 1e9);
        other.q_plan = Some(q.clone());
        let mut request = Request::default();
        (request.warm_start, request.resume, request.max_checks) = (Some(&other), Some("actuation"), Some(50));
        let _ = plan_with(problem, &request);
        (other.q_plan, other.keyframes) = (Some(q), Vec::new());
        let _ = refine(problem, &other, &RefineOptions::default());
        let _ = min_clearance(problem, &other, 0.5, &Cancel::new());
        let _ = joint_travel(problem, &other, &[0.0, 1.0]);
    }

    #[test]
    fn retiming_takes_anything(
        waypoints in prop::collection::vec(numbers(4), 0..5),
        lists in prop::array::uniform5(numbers(4)),
        stops in prop::collection::vec(0..6usize, 0..3),
        positions in prop::option::of((numbers(4), numbers(4))),
        fitting in any::<bool>(),
    ) {
        let [velocity, acceleration, jerk, start, slowest] = lists;
        let limits = match Limits::new(&velocity, &acceleration, &jerk) {
            Ok(limits) if !fitting => limits,
            _ => Limits::new(&[1.0, 2.0], &[3.0, 4.0], &[50.0, 60.0]).unwrap(),
        };
        let mut options = RetimeOptions::default();
        (options.stops, options.slowest, options.position_limits) = (stops, slowest, positions);
        options.start_velocity = Some(start);
        if let Ok(found) = retime(&waypoints, &limits, &options) {
            prop_assert_eq!(found.times.len(), waypoints.len());
        }
    }

    #[test]
    fn scenes_take_anything(
        q in numbers(5),
        reach in number(),
        here in pose(),
        there in pose(),
        names in prop::array::uniform3(name()),
        value in number(),
        origin in vector(),
    ) {
        let [first, second, third] = &names;
        let bodies = [body(first, Role::Rigid, here), body(second, Role::Target, there)];
        let bodies: Vec<Body> = bodies.into_iter().flatten().collect();
        let kind = ObjectJointKind::Prismatic;
        let Ok(joint) = ObjectJoint::new(kind, origin, Vector3::z(), 0.0, [-1.0, value]) else { return Ok(()) };
        let joints = vec![SceneJoint::new(third.clone(), joint, vec![first.clone()])];
        let Ok(scene) = Scene::new(robot(), bodies, joints) else { return Ok(()) };
        let fits = q.len() == 3 && q.iter().all(|v| v.is_finite());
        let attached = scene.attached(second, &there);
        let moved = scene.with_joint(third, value);
        let posed = scene.with_pose(third, &here);
        let freed = scene.detached(first, &here, Some(third));
        for scene in [Ok(scene), attached, moved, posed, freed].into_iter().flatten() {
            let mut checker = scene.checker();
            prop_assert_eq!(checker.hits(&q).is_ok(), fits);
            prop_assert_eq!(checker.near(&q, reach).is_ok(), fits);
            prop_assert_eq!(checker.distance(&q, reach).is_ok(), fits);
            let _ = (scene.tool_keypoints(), scene.object_keypoints(), scene.bodies_about(Some(first)).is_ok());
        }
    }

    #[test]
    fn grasps_take_anything(
        at in pose(),
        grip in pose(),
        pad in prop::array::uniform2(number()),
        stroke in prop::array::uniform2(number()),
        keypoints in prop::array::uniform3(vector()),
        middle in prop::option::of(vector()),
        odd in prop::array::uniform3(number()),
        plain in any::<bool>(),
        q in numbers(5),
    ) {
        let [head, tail, side] = keypoints;
        let keypoints = GripperKeypoints { head, tail, side };
        let _ = ParallelGripper::of_robot(&robot(), &keypoints);
        let _ = ParallelGripper::frame(&keypoints);
        let finger = || vec![Convex::cuboid([0.01; 3], &Pose::identity()).unwrap()];
        let made = if plain {
            ParallelGripper::new(Pose::identity(), [0.01, 0.01], [0.0, 0.12], vec![], [finger(), finger()])
        } else {
            ParallelGripper::new(grip, pad, stroke, vec![], [finger(), finger()])
        };
        let Ok(gripper) = made else { return Ok(()) };
        gripper.set_opening(&mut q.clone(), odd[0]);
        let mut options = GraspOptions::default();
        (options.count, options.samples, options.trials) = (2, 8, 8);
        if !plain {
            (options.friction, options.approach, options.clearance) = (odd[0], odd[1], odd[2]);
        }
        let bodies = [body("lid", Role::Target, at), body("box", Role::Rigid, grip)];
        let scene = Scene::new(robot(), bodies.into_iter().flatten().collect(), vec![]).unwrap();
        let found = scene.grasps("lid", &gripper, middle.map(Point3::from), &options).unwrap_or_default();
        let task = GraspTask::new("lid", gripper, q).approach(odd[1]).lift(head);
        let _ = scene.plan_grasp(&task, &found);
    }

    #[test]
    fn programs_take_anything(
        n in prop_oneof![4 => 0..4usize, 1 => Just(MAX_JOINTS + 1), 1 => Just(usize::MAX)],
        rows in 0..5usize,
        values in prop::collection::vec(number(), 64),
        bounds in prop::collection::vec((numbers(4), number(), number()), 0..4),
    ) {
        let row = |values: &[f64]| -> Row { std::array::from_fn(|v| values.get(v).copied().unwrap_or(0.0)) };
        let mut hessian: Vec<Row> = values.chunks(4).take(rows).map(row).collect();
        for (i, h) in hessian.iter_mut().enumerate() {
            h[i] += 10.0;
        }
        let gradient = row(&values[60..]);
        let bounds: Vec<Bound> =
            bounds.iter().map(|(r, low, high)| Bound { row: row(r), low: *low, high: *high }).collect();
        let qp = Qp { n, hessian: &hessian, gradient: &gradient, bounds: &bounds };
        let outcome = ActiveSet::default().solve(&qp);
        prop_assert!(n <= rows || outcome == QpOutcome::Failed);
    }
}

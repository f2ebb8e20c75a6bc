//! Plans for a robot that moves at the start. They begin in its state, keep times and limits, and avoid collisions.
#![allow(clippy::unwrap_used)]

use std::sync::Arc;

use gensim2_geometry::{Convex, Joint, Link, Pose, Robot};
use gensim2_kpam::config::{Constraint, Motion};
use gensim2_kpam::{Body, KeypointProblem, Options, Plan, Request, Role, SolverConfig, Status, plan, plan_with};
use nalgebra::Vector3;

const GOAL: [f64; 3] = [1.2, 0.32, 0.0];

/// A small cube on three sliding joints with low acceleration limits. It moves to the goal, and then as far again.
/// `obstacle` is the centre and half width of a wall.
fn problem(times: Option<(f64, f64)>, options: Options, obstacle: Option<([f64; 2], f64)>) -> KeypointProblem {
    let cube = |width: f64| Convex::cuboid([0.01, width, 0.01], &Pose::identity()).unwrap();
    let slide = |name: &str, axis| Joint::prismatic(name, axis).limits(-3.0, 3.0).velocity(1.0);
    let robot = Robot::builder("gantry")
        .link(Link::base("rail"))
        .link(Link::below("rail", "bridge").moved_by(slide("x", Vector3::x())))
        .link(Link::below("bridge", "column").moved_by(slide("y", Vector3::y())))
        .link(Link::below("column", "hand").moved_by(slide("z", Vector3::z())).shape(cube(0.01)))
        .build("hand")
        .unwrap();
    let mut config = SolverConfig::builder()
        .constraint(Constraint::point("tip", "goal", 1e-3))
        .post(Motion::Move(Vector3::from(GOAL)));
    if let Some((actuation, post)) = times {
        config = config.times(actuation, Vec::new(), vec![post]);
    }
    let wall = |([x, y], width): ([f64; 2], f64)| {
        let builder = Body::builder("wall", Role::Rigid).shape(cube(width));
        builder.pose(Pose::translation(x, y, 0.0)).build().unwrap()
    };
    KeypointProblem::builder(Arc::new(robot), config.build().unwrap(), vec![0.0; 3])
        .object(Pose::identity())
        .tool_keypoint("tip", Vector3::zeros())
        .object_keypoint("goal", Vector3::from(GOAL))
        .bodies(obstacle.map(wall).into_iter().collect::<Vec<_>>())
        .options(options)
        .build()
        .unwrap()
}

fn slow() -> Options {
    let mut options = Options::default();
    (options.acceleration_limits, options.jerk_limits) = (Some(vec![1.0; 3]), Some(vec![100.0; 3]));
    (options.workspace, options.velocity_scale, options.acceleration_scale) = (None, 1.0, 1.0);
    options
}

/// Returns positions, velocities and accelerations of a plan's motion at a time (s).
fn state(plan: &Plan, time: f64) -> [Vec<f64>; 3] {
    let sample = plan.trajectory().unwrap().sample(time);
    [sample.position, sample.velocity, sample.acceleration]
}

fn go_on(problem: &KeypointProblem, former: &Plan, time: f64, [q, v, a]: &[Vec<f64>; 3], resume: &str) -> Plan {
    let start = problem.with_start(q.clone(), Some(v.clone()), Some(a.clone()), time).unwrap();
    let mut request = Request::default();
    (request.warm_start, request.resume) = (Some(former), Some(resume));
    plan_with(&start, &request).unwrap().0
}

fn assert_near(a: &[f64], b: &[f64]) {
    assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6), "{a:?} {b:?}");
}

/// Returns the time (s) in the middle of the motion to a keyframe.
fn halfway(former: &Plan, keyframe: usize) -> f64 {
    let begin = if keyframe == 0 { 0.0 } else { former.keyframes[keyframe - 1].time.unwrap() };
    0.5 * (begin + former.keyframes[keyframe].time.unwrap())
}

#[test]
fn what_is_left_of_a_blocked_path_is_the_stop() {
    let former = plan(&problem(None, slow(), None));
    assert_eq!(former.status(), Status::Solved, "{}", former.reason);
    let now = halfway(&former, 1);
    let mut start = state(&former, now);
    (start[1], start[2]) = (vec![0.0, 0.3, 0.0], vec![0.0; 3]);
    let stop = start[0][1] + 0.5 * 0.3 * (0.3 + 0.01);
    let mut options = slow();
    options.allow_partial = true;
    let found = go_on(&problem(None, options, Some(([start[0][0] + 0.03, stop], 0.1))), &former, now, &start, "post_0");
    assert_eq!(found.status(), Status::Partial, "{}", found.reason);
    let motion = found.trajectory().unwrap();
    let first = motion.sample(now);
    assert_near(&first.position, &start[0]);
    assert_near(&first.velocity, &start[1]);
    assert_near(&motion.sample(motion.end()).position, &[start[0][0], stop, start[0][2]]);
}

#[test]
fn a_start_under_way_keeps_the_clock() {
    let question = problem(Some((4.0, 8.0)), slow(), None);
    let velocity = Some(vec![-0.3, 0.2, 0.0]);
    let found = plan(&question.with_start(vec![0.0; 3], velocity.clone(), None, 0.0).unwrap());
    assert_eq!(found.status(), Status::Solved, "{}", found.reason);
    for (keyframe, due) in found.keyframes.iter().zip([4.0, 8.0]) {
        assert!((keyframe.time.unwrap() - due).abs() < 1e-9, "{:?}", keyframe.time);
    }
    // The times of the config include the time needed for braking.
    let short = problem(Some((2.4, 8.0)), slow(), None);
    assert_eq!(plan(&short).status(), Status::Solved);
    assert_eq!(plan(&short.with_start(vec![0.0; 3], velocity, None, 0.0).unwrap()).status(), Status::TooFast);
}

#[test]
fn a_free_motion_goes_on_past_what_is_in_the_way_of_the_stop() {
    let former = plan(&problem(None, slow(), None));
    for (keyframe, resume) in [(0, "actuation"), (1, "post_0")] {
        let now = halfway(&former, keyframe);
        let start = state(&former, now);
        let stop: Vec<f64> = (0..3).map(|v| start[0][v] + 0.5 * start[1][v] * start[1][v].abs()).collect();
        let question = problem(None, slow(), Some(([stop[0], stop[1]], 0.01)));
        let found = go_on(&question, &former, now, &start, resume);
        assert_eq!(found.status(), Status::Solved, "{resume}: {}", found.reason);
        assert!((found.trajectory().unwrap().end() - former.trajectory().unwrap().end()).abs() < 1e-6);
        // If the motion that the robot executes is blocked as well, planning finds no motion.
        let way = state(&former, now + 0.12)[0].clone();
        let found = go_on(&problem(None, slow(), Some(([way[0], way[1]], 0.01))), &former, now, &start, resume);
        assert!(found.trajectory().is_none(), "{resume}: {}", found.reason);
    }
}

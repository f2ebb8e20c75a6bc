//! A robot in a closed chamber: after the search has failed for some poses, planning does not search for the others.
#![allow(clippy::unwrap_used)]

use std::collections::BTreeMap;
use std::sync::Arc;

use gensim2_geometry::{Convex, Joint, Link, Pose, Robot};
use gensim2_kpam::config::Constraint;
use gensim2_kpam::{Body, KeypointProblem, Request, Role, SolverConfig, Status, plan_with};
use nalgebra::Vector3;

/// A bar on two slides and a pivot in a chamber that is hardly larger. Its middle should reach a point outside, at one
/// of many permitted angles.
fn problem() -> KeypointProblem {
    let bar = Convex::cuboid([0.1, 0.01, 0.01], &Pose::identity()).unwrap();
    let slide = |name: &str, axis| Joint::prismatic(name, axis).limits(-1.0, 1.0).velocity(1.0);
    let robot = Robot::builder("plotter")
        .link(Link::base("rail"))
        .link(Link::below("rail", "bridge").moved_by(slide("x", Vector3::x())))
        .link(Link::below("bridge", "head").moved_by(slide("y", Vector3::y())))
        .link(
            Link::below("head", "bar")
                .moved_by(Joint::revolute("turn", Vector3::z()).limits(-3.0, 3.0).velocity(1.0))
                .shape(bar),
        )
        .build("bar")
        .unwrap();
    let wall = |name: &str, x: f64, y: f64, half: [f64; 3]| {
        let shape = Convex::cuboid(half, &Pose::identity()).unwrap();
        Body::builder(name, Role::Rigid).shape(shape).pose(Pose::translation(x, y, 0.0)).build().unwrap()
    };
    let walls = vec![
        wall("left", -0.13, 0.0, [0.01, 0.04, 0.1]),
        wall("right", 0.13, 0.0, [0.01, 0.04, 0.1]),
        wall("bottom", 0.0, -0.03, [0.14, 0.01, 0.1]),
        wall("top", 0.0, 0.03, [0.14, 0.01, 0.1]),
    ];
    let config = SolverConfig::builder().constraint(Constraint::point("middle", "goal", 1e-3)).build().unwrap();
    let point = |name: &str, x: f64| BTreeMap::from([(name.to_owned(), Vector3::new(x, 0.0, 0.0))]);
    KeypointProblem::builder(Arc::new(robot), config, vec![0.0; 3])
        .object(Pose::identity())
        .tool_keypoints(point("middle", 0.0))
        .object_keypoints(point("goal", 0.6))
        .bodies(walls)
        .build()
        .unwrap()
}

#[test]
fn no_pose_costs_a_search_of_its_own() {
    let mut request = Request::default();
    // Planning needs a third of these checks; separate searches for all poses need more than ten times as many.
    request.max_checks = Some(30_000);
    let (plan, _) = plan_with(&problem(), &request).unwrap();
    assert_eq!(plan.status(), Status::NotFound, "{}", plan.reason);
    assert!(!plan.reason.contains("spent"), "{}", plan.reason);
}

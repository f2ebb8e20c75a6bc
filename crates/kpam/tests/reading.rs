//! Checks that deserialized values pass the same checks as values created in code: damaged data cause an error that
//! names what is wrong, and accepted values can be used for planning.
#![allow(clippy::unwrap_used)]

use std::sync::Arc;

use gensim2_geometry::{Convex, Joint, Link, Pose, Robot};
use gensim2_kpam::config::{Constraint, Motion};
use gensim2_kpam::grasp::{GraspOptions, ParallelGripper};
use gensim2_kpam::{
    Body, KeypointProblem, ObjectJoint, ObjectJointKind, Options, Plan, Request, Role, Scene, SceneJoint, SolverConfig,
    Status, Trajectory, joint_travel, plan, plan_with,
};
use nalgebra::Vector3;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

fn cube(half: f64) -> Convex {
    Convex::cuboid([half; 3], &Pose::identity()).unwrap()
}

/// Returns a gantry robot with a mimic joint.
fn robot() -> Robot {
    let slide = |name: &str, axis| Joint::prismatic(name, axis).limits(-2.0, 2.0).velocity(2.0);
    let link =
        |parent: &str, name: &str| Link::below(parent, name).at(Pose::translation(0.3, 0.0, 0.1)).shape(cube(0.02));
    Robot::builder("gantry")
        .link(Link::base("l0").shape(cube(0.02)))
        .link(link("l0", "l1").moved_by(slide("j0", Vector3::x())))
        .link(link("l1", "l2").moved_by(slide("j1", Vector3::y())))
        .link(link("l2", "l3").moved_by(slide("j2", Vector3::z())))
        .link(link("l3", "finger").moved_by(slide("j3", Vector3::x()).follows("j2", 0.01, 0.0)))
        .disabled_collisions("l0", "l3")
        .build("l3")
        .unwrap()
}

fn scene() -> Scene {
    let body = |name: &str, role, x: f64| {
        let pose = Pose::translation(x, 0.5, 0.1);
        Body::builder(name, role).shape(cube(0.03)).pose(pose).keypoint("top", Vector3::z() * 0.03).build().unwrap()
    };
    let bodies =
        vec![body("box", Role::Rigid, 0.2), body("flap", Role::Rigid, 1.4), body("held", Role::Attached, 0.05)];
    let joint = ObjectJoint::new(ObjectJointKind::Prismatic, Vector3::zeros(), Vector3::y(), 0.0, [0.0, 0.4]).unwrap();
    Scene::new(Arc::new(robot()), bodies, vec![SceneJoint::new("rail", joint, vec!["flap".into()])]).unwrap()
}

fn problem() -> KeypointProblem {
    let config = SolverConfig::builder()
        .constraint(Constraint::point("tip", "goal", 1e-3))
        .pre(Motion::Translate { axis: 2, distance: 0.02 })
        .post(Motion::FollowJoint(0.02))
        .let_go(0.03)
        .build()
        .unwrap();
    let mut options = Options::default();
    (options.num_seeds, options.candidates, options.extra_seeds, options.samples) = (4, 2, 2, 20);
    options.workspace = None;
    let builder = scene().problem(config, vec![0.1, 0.1, 0.1, 0.001], Some("rail")).unwrap();
    builder
        .tool_keypoint("tip", Vector3::new(0.1, 0.0, 0.0))
        .object_keypoint("goal", Vector3::new(1.2, 0.2, 0.6))
        .options(options)
        .build()
        .unwrap()
}

/// Pseudorandom number generator with a fixed seed.
struct Draw(u64);

impl Draw {
    fn below(&mut self, most: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % most
    }
}

/// Returns a copy of `bytes` in which a few bytes are changed, removed or inserted.
fn damaged(bytes: &[u8], draw: &mut Draw) -> Vec<u8> {
    let mut out = bytes.to_vec();
    for _ in 0..1 + draw.below(3) {
        let at = draw.below(out.len());
        match draw.below(8) {
            0 => out.truncate(at.max(1)),
            1 => out.insert(at, draw.below(256) as u8),
            // Replace eight bytes by a special number: not finite, huge and negative, or zero.
            2 if at + 8 <= out.len() => {
                let odd = [f64::NAN, f64::INFINITY, -1e300, 0.0][draw.below(4)];
                out[at..at + 8].copy_from_slice(&odd.to_le_bytes());
            }
            3 | 4 => out[at] = draw.below(256) as u8,
            _ => out[at] ^= 1 << draw.below(8),
        }
    }
    out
}

/// Deserializes `rounds` damaged copies of a value, and calls `with` on each accepted one. Returns how many copies were
/// accepted and how many were refused.
fn read_damaged<T: Serialize + DeserializeOwned>(value: &T, rounds: usize, with: impl Fn(&T)) -> (usize, usize) {
    let bytes = postcard::to_stdvec(value).unwrap();
    let whole: T = postcard::from_bytes(&bytes).unwrap();
    with(&whole);
    let mut draw = Draw(7);
    let (mut passed, mut refused) = (0, 0);
    for _ in 0..rounds {
        match postcard::from_bytes::<T>(&damaged(&bytes, &mut draw)) {
            Ok(value) => {
                with(&value);
                passed += 1;
            }
            Err(_) => refused += 1,
        }
    }
    (passed, refused)
}

#[test]
fn damaged_problems_are_refused_or_planned() {
    let mut request = Request::default();
    request.max_checks = Some(300);
    let counts = read_damaged(&problem(), 2000, |p| {
        let few = p.options().num_seeds <= 64 && p.options().extra_seeds <= 64 && p.options().num_refinements <= 64;
        if few {
            let _ = plan_with(p, &request);
        }
    });
    assert!(counts.0 > 50 && counts.1 > 500, "{counts:?}");
}

#[test]
fn damaged_scenes_are_refused_or_answer() {
    let gripper =
        ParallelGripper::new(Pose::identity(), [0.01; 2], [0.0, 0.1], vec![cube(0.01)], [vec![], vec![]]).unwrap();
    let mut options = GraspOptions::default();
    (options.count, options.samples, options.trials) = (2, 8, 8);
    let counts = read_damaged(&scene(), 2000, |scene| {
        let q = vec![0.1; scene.robot().joints().len()];
        let _ = scene.checker().near(&q, 0.1).unwrap();
        let _ = (scene.with_joint("rail", 0.2), scene.tool_keypoints(), scene.grasps("box", &gripper, None, &options));
    });
    assert!(counts.0 > 50 && counts.1 > 500, "{counts:?}");
    let counts = read_damaged(&gripper, 500, |gripper| {
        gripper.set_opening(&mut [0.0; 3], 0.05);
        let _ = scene().grasps("box", gripper, None, &options);
    });
    assert!(counts.0 > 10 && counts.1 > 50, "{counts:?}");
}

#[test]
fn damaged_plans_are_refused_or_looked_at() {
    let problem = problem();
    let plan = plan(&problem);
    assert_eq!(plan.status(), Status::Solved, "{}", plan.reason);
    let mut request = Request::default();
    request.max_checks = Some(300);
    let counts = read_damaged(&plan, 1500, |former: &Plan| {
        let _ = joint_travel(&problem, former, &[0.0, 0.5]);
        for label in ["actuation", "post_0", "let_go"] {
            let mut request = request.clone();
            (request.warm_start, request.resume) = (Some(former), Some(label));
            let _ = plan_with(&problem, &request);
        }
    });
    assert!(counts.0 > 50 && counts.1 > 200, "{counts:?}");
    let counts = read_damaged(plan.trajectory().unwrap(), 1500, |trajectory: &Trajectory| {
        for k in -1..=5 {
            let t = trajectory.start() + 0.2 * f64::from(k) * (trajectory.end() - trajectory.start());
            assert_eq!(trajectory.sample(t).position.len(), trajectory.joints());
        }
    });
    assert!(counts.0 > 50 && counts.1 > 200, "{counts:?}");
}

/// Returns the error from deserializing a value after one part of its JSON has been replaced.
fn refusal<T: Serialize + DeserializeOwned>(value: &T, part: &str, by: Value) -> String {
    let mut text = serde_json::to_value(value).unwrap();
    *text.pointer_mut(part).unwrap() = by;
    serde_json::from_value::<T>(text).err().map(|e| e.to_string()).unwrap_or_default()
}

#[test]
fn what_does_not_fit_is_named() {
    let problem = problem();
    assert_eq!(refusal(&problem, "/object_axis", json!(2)), "", "what fits is read");
    for (part, by, says) in [
        ("/q_start", json!([0.1]), "q_start: has 1 entries"),
        ("/q_start/0", json!(7.0), "q_start[0]: 7 is outside the limits"),
        ("/object_axis", json!(7), "object_axis"),
        ("/options/margin", json!(-1.0), "options.margin"),
        ("/config/constraints/0/Point/tolerance", json!(-1.0), "constraint_list[0].tolerance"),
        ("/config/let_go", json!(1.0), "let_go"),
        ("/bodies/1/name", json!("box"), "names must be unique"),
        ("/bodies/0/pose/rotation/0", json!(2.0), "pose"),
        ("/bodies/0/shapes/0/points/0/0", json!(9.0), "shape: is damaged"),
        ("/joint/axis/1", json!(0.5), "axis: must be a unit vector"),
        ("/joint/lower", json!(2.0), "lower: 2 must not exceed upper"),
        ("/robot/links/2/parent", json!(3), "must come after its parent"),
        ("/robot/links/2/joint", json!(0), "must have its own parent joint"),
        ("/robot/joints/3/mimic/source", json!(3), "must not itself mimic another"),
        ("/robot/joints/0/axis/0", json!(0.0), "joint j0: axis"),
        ("/robot/joints/1/lower", json!(5.0), "joint j1: limit"),
        ("/robot/hand", json!(9), "hand"),
        ("/robot/hand", json!(2), "chain: is not that of the links"),
        ("/robot/allowed/0/1", json!(40), "allowed pairs"),
        ("/robot/chain/joints/0/joint", json!(12), "chain: names joint 12 of 4"),
    ] {
        let text = refusal(&problem, part, by);
        assert!(text.contains(says), "{part}: {text:?} does not say {says:?}");
    }
    let scene = scene();
    assert!(refusal(&scene, "/joints/0/moves/0", json!("lid")).contains("\"lid\" is not a body"));
    let solved = plan(&problem);
    assert!(refusal(&solved, "/outcome/solved/times", json!([])).contains("trajectory: is damaged"));
    assert!(refusal(&solved, "/outcome/solved/pieces/0/states/0", json!(null)).contains("invalid type"));
}

#[test]
fn what_is_built_wrong_is_named() {
    let field = |e: Result<Robot, gensim2_geometry::RobotError>| e.unwrap_err().field;
    let turn = |axis| Joint::revolute("turn", axis);
    let arm = |joint| Robot::builder("arm").link(Link::base("base")).link(Link::below("base", "hand").moved_by(joint));
    assert!(arm(turn(Vector3::z())).build("hand").is_ok());
    assert_eq!(field(arm(turn(Vector3::zeros())).build("hand")), "joint turn: axis");
    assert_eq!(field(arm(turn(Vector3::z()).limits(1.0, -1.0)).build("hand")), "joint turn: limit");
    assert_eq!(field(arm(turn(Vector3::z()).velocity(0.0)).build("hand")), "joint turn: limit");
    assert_eq!(field(arm(turn(Vector3::z()).follows("turn", 1.0, 0.0)).build("hand")), "joint turn: mimic");
    assert_eq!(field(arm(turn(Vector3::z())).build("tool")), "hand");
    assert_eq!(field(arm(turn(Vector3::z())).link(Link::base("other")).build("hand")), "link other");
    assert_eq!(field(arm(turn(Vector3::z())).link(Link::below("base", "hand")).build("hand")), "link hand");
    assert_eq!(
        field(arm(turn(Vector3::z())).link(Link::below("sky", "a")).build("hand")),
        "link sky".replace("sky", "a")
    );
    assert_eq!(field(Robot::builder("none").build("hand")), "hand");
    let far = Body::builder("far", Role::Rigid).pose(Pose::translation(0.0, 2e3, 0.0)).build();
    assert_eq!(far.unwrap_err().field, "pose");
    let lost = Body::builder("lost", Role::Rigid).keypoint("top", Vector3::new(0.0, f64::NAN, 0.0)).build();
    assert_eq!(lost.unwrap_err().field, "keypoints[\"top\"]");
    let joint = |axis, range| ObjectJoint::new(ObjectJointKind::Revolute, Vector3::zeros(), axis, 0.0, range);
    assert_eq!(joint(Vector3::zeros(), [0.0, 1.0]).unwrap_err().field, "axis");
    assert_eq!(joint(Vector3::z(), [1.0, 0.0]).unwrap_err().field, "lower");
    assert_eq!(joint(Vector3::z(), [0.0, f64::INFINITY]).unwrap_err().field, "value");
    let wrong = problem().changed();
    assert_eq!(wrong.clone().q_start(vec![f64::NAN; 4]).build().unwrap_err().field, "q_start[0]");
    assert_eq!(wrong.object(Pose::translation(f64::NAN, 0.0, 0.0)).build().unwrap_err().field, "T_base_object");
}

//! Whole problems from arbitrary parts: an error or a plan within its budget, never a panic or a hang, and what is
//! emitted is finite and inside the joint limits.
#![no_main]

use std::sync::{Arc, OnceLock};

use gensim2_geometry::{Convex, Pose, Robot};
use gensim2_kpam::options::ContactWindow;
use gensim2_kpam::{
    Body, KeypointProblem, ObjectJoint, ObjectJointKind, Options, Request, Role, SolverConfig, plan_with,
};
use libfuzzer_sys::arbitrary::{self, Arbitrary};
use libfuzzer_sys::fuzz_target;
use nalgebra::{Point3, Rotation3, Translation3, Vector3};
use serde_json::{Value, json};

/// A number that is mostly of a size that occurs, and now and then anything.
#[derive(Debug, Clone, Copy, Arbitrary)]
enum Number {
    Thousandths(i16),
    Hundredths(i8),
    Any(f64),
}

impl Number {
    fn value(self) -> f64 {
        match self {
            Self::Thousandths(n) => f64::from(n) * 1e-3,
            Self::Hundredths(n) => f64::from(n) * 1e-2,
            Self::Any(x) => x,
        }
    }
}

#[derive(Debug, Arbitrary)]
enum Shape {
    Box([Number; 3]),
    Ball(Number),
    Capsule(Number, Number),
    Cylinder(Number, Number),
    Hull([[Number; 3]; 5]),
}

#[derive(Debug, Arbitrary)]
struct Thing {
    role: u8,
    shape: Shape,
    at: [Number; 3],
    turn: [i8; 3],
}

#[derive(Debug, Arbitrary)]
enum Step {
    Translate(u8, Number),
    Move(u8),
    Rotate(Number),
    Follow(bool, bool, Number),
}

#[derive(Debug, Arbitrary)]
struct Whole {
    robot: u8,
    start: [Number; 6],
    velocity: Option<[Number; 6]>,
    acceleration: Option<[Number; 6]>,
    target: [Number; 3],
    tip: [Number; 3],
    axis: Option<([Number; 3], u8, Number, Number)>,
    tolerance: Number,
    before: Vec<Step>,
    after: Vec<Step>,
    times: Option<[Number; 4]>,
    joint: Option<(bool, [Number; 3], [i8; 3], [Number; 3])>,
    things: Vec<Thing>,
    limits: [Option<[Number; 6]>; 3],
    scales: [Number; 2],
    margin: Number,
    finger_width: Option<Number>,
    contact_speed: Option<Number>,
    workspace: Option<[[Number; 3]; 2]>,
    budgets: [u8; 4],
    flags: u8,
    let_go: Option<Number>,
    window: Option<(u8, u8, Option<Number>)>,
    resume: Option<u8>,
}

const JOINT: &str = r#"<limit lower="-2.5" upper="2.5" velocity="2" effort="1"/>"#;

/// Arms with two to six joints: turning, sliding, endless; mimics before and after their sources, and of each other.
fn robots() -> &'static [Arc<Robot>] {
    static ROBOTS: OnceLock<Vec<Arc<Robot>>> = OnceLock::new();
    ROBOTS.get_or_init(|| {
        let kinds: [&[(&str, &str, &str)]; 5] = [
            &[("revolute", "0 0 1", ""), ("revolute", "0 1 0", "")],
            &[("prismatic", "0 0 1", ""), ("continuous", "0 1 0", ""), ("revolute", "1 0 0", "")],
            &[
                ("revolute", "0 0 1", r#"<mimic joint="j2" multiplier="-0.5"/>"#),
                ("revolute", "0 1 0", ""),
                ("revolute", "0 1 0", r#"<mimic joint="j1" multiplier="2" offset="0.1"/>"#),
                ("continuous", "1 0 0", ""),
            ],
            &[
                ("revolute", "0 0 1", ""),
                ("revolute", "0 1 0", ""),
                ("revolute", "0 1 0", ""),
                ("revolute", "1 0 0", ""),
                ("revolute", "0 1 0", ""),
                ("revolute", "1 0 0", ""),
            ],
            &[
                ("continuous", "0 0 1", ""),
                ("revolute", "0 1 0", ""),
                ("prismatic", "1 0 0", ""),
                ("continuous", "1 0 0", ""),
                ("revolute", "0 1 0", r#"<mimic joint="j1" multiplier="-1"/>"#),
                ("continuous", "1 0 0", ""),
            ],
        ];
        let mut out = Vec::new();
        for joints in kinds {
            for bare in [false, true] {
                let mut links = String::from(r#"<link name="l0"/>"#);
                let mut text = String::new();
                for (i, (kind, axis, mimic)) in joints.iter().enumerate() {
                    let solid = r#"<collision><origin xyz="0 0 0.1"/><geometry><capsule radius="0.03" length="0.12"/></geometry></collision>"#;
                    links += &format!(r#"<link name="l{}">{solid}</link>"#, i + 1);
                    text += &format!(
                        r#"<joint name="j{i}" type="{kind}"><parent link="l{i}"/><child link="l{}"/><origin xyz="0 0 0.2"/><axis xyz="{axis}"/>{JOINT}{mimic}</joint>"#,
                        i + 1
                    );
                }
                let palm = if bare { "" } else { r#"<collision><geometry><box size="0.05 0.05 0.05"/></geometry></collision>"# };
                let last = joints.len();
                text += &format!(
                    r#"<link name="hand">{palm}</link><joint name="flange" type="fixed"><parent link="l{last}"/><child link="hand"/><origin xyz="0 0 0.25"/></joint>"#
                );
                let urdf = format!(r#"<robot name="r">{links}{text}</robot>"#);
                out.extend(Robot::from_urdf_str(&urdf, "fuzz.urdf", None, "hand", None).ok().map(Arc::new));
            }
        }
        assert_eq!(out.len(), 10, "every robot of the family is valid");
        out
    })
}

fn vector(v: [Number; 3]) -> Vector3<f64> {
    Vector3::new(v[0].value(), v[1].value(), v[2].value())
}

fn first(n: usize, v: [Number; 6]) -> Vec<f64> {
    v.iter().take(n).map(|x| x.value()).collect()
}

fn motion(step: &Step) -> Value {
    match step {
        Step::Translate(axis, by) => {
            let name = ["translate_x", "translate_y", "translate_z"][*axis as usize % 3];
            json!([name, by.value()])
        }
        Step::Move(way) => {
            json!((["move-up", "move-down", "move-left", "move-right", "move-forward"][*way as usize % 5]))
        }
        Step::Rotate(by) => json!(["rotate", by.value()]),
        Step::Follow(trace, to, by) => {
            let name = ["follow_joint", "trace_joint", "follow_joint_to", "trace_joint_to"];
            let name = name[usize::from(*trace) + 2 * usize::from(*to)];
            json!([name, by.value()])
        }
    }
}

fn config(whole: &Whole) -> Option<SolverConfig> {
    let mut constraints = vec![json!({
        "type": "point2point_constraint", "keypoint_name": "tip", "target_keypoint_name": "goal",
        "tolerance": whole.tolerance.value(),
    })];
    if let Some((axis, frame, inner, tolerance)) = &whole.axis {
        constraints.push(json!({
            "type": "frame_axis_parallel", "axis_from_keypoint_name": "tip", "axis_to_keypoint_name": "origin",
            "target_axis": vector(*axis).as_slice(),
            "target_axis_frame": (["world", "object", "joint"][*frame as usize % 3]),
            "target_inner_product": inner.value(), "tolerance": tolerance.value(),
        }));
    }
    let list = |steps: &[Step]| steps.iter().take(3).map(motion).collect::<Vec<_>>();
    let mut out = json!({
        "constraint_list": constraints, "pre_actuation_motions": list(&whole.before),
        "post_actuation_motions": list(&whole.after), "let_go": whole.let_go.map(Number::value),
        "gripper": (["open", "closed", "grasp", "hold", "release"][whole.flags as usize % 5]),
    });
    if let (Some(times), Some(map)) = (&whole.times, out.as_object_mut()) {
        let mut at = 0.0;
        let mut next = |i: usize| {
            at += times[i % 4].value();
            at
        };
        let before: Vec<f64> = (0..whole.before.len().min(3)).map(&mut next).collect();
        map.insert("pre_actuation_times".into(), json!(before));
        map.insert("actuation_time".into(), json!(next(1)));
        let after: Vec<f64> = (0..whole.after.len().min(3)).map(&mut next).collect();
        map.insert("post_actuation_times".into(), json!(after));
    }
    SolverConfig::from_value(&out).ok()
}

fn shape(shape: &Shape) -> Option<Convex> {
    let one = Pose::identity();
    match shape {
        Shape::Box(half) => Convex::cuboid([half[0].value(), half[1].value(), half[2].value()], &one).ok(),
        Shape::Ball(radius) => Convex::ball(radius.value(), Point3::origin()).ok(),
        Shape::Capsule(radius, length) => Convex::capsule(radius.value(), length.value(), &one).ok(),
        Shape::Cylinder(radius, length) => Convex::cylinder(radius.value(), length.value(), &one).ok(),
        Shape::Hull(points) => {
            let points: Vec<_> = points.iter().map(|p| Point3::from(vector(*p))).collect();
            Convex::hull(&points).ok()
        }
    }
}

fn bodies(things: &[Thing]) -> Vec<Body> {
    let roles = [Role::Table, Role::ObjectBody, Role::MovingLink, Role::Rigid, Role::Target, Role::Attached];
    let body = |(i, thing): (usize, &Thing)| {
        let [roll, pitch, yaw] = thing.turn.map(|t| f64::from(t) * 0.03);
        let turn = Rotation3::from_euler_angles(roll, pitch, yaw);
        Body::builder(format!("thing{i}"), roles[thing.role as usize % roles.len()])
            .shape(shape(&thing.shape)?)
            .pose(Pose::from_parts(Translation3::from(vector(thing.at)), turn))
            .build()
            .ok()
    };
    things.iter().take(5).enumerate().filter_map(body).collect()
}

fn options(whole: &Whole, n: usize) -> Options {
    let flag = |bit: u8| whole.flags & (1 << bit) != 0;
    let limits = |i: usize| whole.limits[i].map(|l| first(n, l));
    let labels = ["start", "pre_1", "pre_0", "actuation", "post_0", "post_1", "let_go", "end"];
    let label = |k: u8| labels[k as usize % labels.len()].to_owned();
    let window = |(from, to, depth): (u8, u8, Option<Number>)| ContactWindow {
        links: vec!["hand".to_owned()],
        bodies: vec!["thing0".to_owned()],
        from: label(from),
        to: label(to),
        depth: depth.map(Number::value),
    };
    let mut options = Options::default();
    options.velocity_scale = if flag(3) { 1.0 } else { whole.scales[0].value() };
    options.acceleration_scale = if flag(3) { 1.0 } else { whole.scales[1].value() };
    options.velocity_limits = limits(0);
    options.acceleration_limits = limits(1);
    options.jerk_limits = limits(2);
    options.start_velocity = whole.velocity.map(|v| first(n, v));
    options.start_acceleration = whole.acceleration.map(|v| first(n, v));
    options.contact_speed = whole.contact_speed.map(Number::value);
    options.workspace = whole.workspace.map(|corners| corners.map(|c| c.map(Number::value)));
    options.margin = if flag(4) { 0.005 } else { whole.margin.value() };
    options.allow_partial = flag(5);
    options.avoid_collisions = !flag(6);
    options.finger_width = whole.finger_width.map(Number::value);
    options.num_seeds = 1 + whole.budgets[0] as usize % 8;
    options.candidates = 1 + whole.budgets[1] as usize % 4;
    options.extra_seeds = whole.budgets[2] as usize % 4;
    options.clearings = whole.budgets[2] as usize / 4 % 8;
    options.samples = whole.budgets[3] as usize % 32;
    options.contacts = whole.window.map(|w| vec![window(w)]);
    options.pick = if flag(7) { vec!["thing0".to_owned()] } else { Vec::new() };
    options
}

fuzz_target!(|whole: Whole| {
    let robot = &robots()[whole.robot as usize % robots().len()];
    let n = robot.joints().len();
    let Some(config) = config(&whole) else { return };
    let mut q = first(n, whole.start);
    for (i, joint) in robot.joints().iter().enumerate() {
        if let Some(m) = joint.mimic() {
            q[i] = m.multiplier * q[m.source] + m.offset;
        }
    }
    let mut builder = KeypointProblem::builder(robot.clone(), config, q)
        .tool_keypoint("tip", vector(whole.tip))
        .tool_keypoint("origin", Vector3::zeros())
        .object_keypoint("goal", vector(whole.target))
        .bodies(bodies(&whole.things))
        .options(options(&whole, n));
    if let Some((turns, origin, axis, [value, lower, upper])) = whole.joint {
        let kind = if turns { ObjectJointKind::Revolute } else { ObjectJointKind::Prismatic };
        let (axis, range) = (Vector3::from(axis.map(f64::from)), [lower.value(), upper.value()]);
        let Ok(joint) = ObjectJoint::new(kind, vector(origin), axis, value.value(), range) else { return };
        builder = builder.joint(joint);
    }
    let Ok(problem) = builder.build() else { return };
    let resume = whole.resume.map(|k| ["pre_0", "actuation", "post_0", "let_go"][k as usize % 4]);
    let mut request = Request::default();
    (request.resume, request.max_checks) = (resume, Some(2000));
    let Ok((plan, _)) = plan_with(&problem, &request) else { return };
    let Some(trajectory) = plan.trajectory() else { return };
    let start = problem.q_start();
    for k in 0..=20 {
        let t = trajectory.start() + (trajectory.end() - trajectory.start()) * f64::from(k) / 20.0;
        let sample = trajectory.sample(t);
        for (i, joint) in robot.joints().iter().enumerate() {
            let q = sample.position[i];
            assert!(q.is_finite() && sample.velocity[i].is_finite() && sample.acceleration[i].is_finite());
            let (lower, upper) = (joint.lower().min(start[i]), joint.upper().max(start[i]));
            assert!(q >= lower - 1e-6 && q <= upper + 1e-6, "{} at {q}", joint.name());
        }
    }
});

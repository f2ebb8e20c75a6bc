//! A C program gets the same results from the interface as Rust code gets from the solver.
#![allow(clippy::unwrap_used)]

use std::fmt::Write;
use std::sync::Arc;
use std::time::Duration;

use gensim2_geometry::{ChainFrames, Convex, Pose, Robot, pose_from_matrix, pose_to_matrix};
use gensim2_kpam::options::LimitSet;
use gensim2_kpam::{
    Body, Cancel, Goal, IkOptions, Motion, NoMotion, PathTolerance, Role, Scene, TransitOptions, plan_along, plan_to,
    solutions,
};
use nalgebra::{Matrix4, Point3, Vector3};

mod compiled;

const Q: [[f64; 6]; 2] = [[0.1, -1.2, 1.5, -1.9, -1.6, 0.3], [-1.2, -1.0, 1.3, -1.7, -1.5, 0.4]];
const HOME: [f64; 6] = [1.5, -1.4, 1.5, -1.7, -1.57, 0.0];
/// A tetrahedron as a mesh file, in millimetres.
const OBJ: &str = "v 0 0 0\nv 100 0 0\nv 0 50 0\nv 0 0 100\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n";

/// The lines that the program must print.
struct Lines(String);

impl Lines {
    fn line(&mut self, text: &str) {
        writeln!(self.0, "{text}").unwrap();
    }

    fn numbers(&mut self, word: &str, numbers: impl IntoIterator<Item = f64>) {
        let list: Vec<String> = numbers.into_iter().map(|value| value.to_string()).collect();
        self.line(&format!("{word} {}", list.join(" ")));
    }

    fn pose(&mut self, word: &str, pose: &Pose) {
        self.numbers(word, pose_to_matrix(pose).transpose().iter().copied());
    }

    fn surroundings(&mut self, scene: &Scene) {
        let mut checker = scene.checker();
        self.numbers("distance", Q.map(|q| checker.distance(&q, 1.0).unwrap()));
        let [one, two] = Q.map(|q| u8::from(checker.hits(&q).unwrap()));
        self.line(&format!("hits {one} {two}"));
        for pair in checker.near(&Q[0], 0.2).unwrap() {
            let numbers = [pair.distance, pair.point.x, pair.point.y, pair.point.z];
            self.numbers(&format!("{} | {} |", pair.first, pair.second), numbers);
        }
    }

    fn motion(&mut self, word: &str, motion: &Motion) {
        self.line(&format!("{word} {}", motion.goal));
        motion.warnings.iter().for_each(|warning| self.line(&format!("warning {warning}")));
        motion.assumed_limits.iter().for_each(|limit| self.line(&format!("assumed {limit}")));
        let (start, end) = (motion.trajectory.start(), motion.trajectory.end());
        for k in 0..=4 {
            let sample = motion.trajectory.sample(start + 0.25 * f64::from(k) * (end - start));
            self.numbers("state", [sample.position, sample.velocity, sample.acceleration].concat());
        }
    }

    fn failure(&mut self, status: u8, why: &impl ToString) {
        self.line(&format!("failure {status} null {}", why.to_string()));
    }
}

/// Returns a pose as C passes it: through a matrix, which rounds it.
fn passed(pose: &Pose) -> Pose {
    pose_from_matrix(&pose_to_matrix(pose), 1e-6).unwrap()
}

fn at(x: f64, y: f64, z: f64) -> Pose {
    Pose::translation(x, y, z)
}

fn body(name: &str, shapes: Vec<Convex>, pose: Pose) -> Body {
    Body::builder(name, Role::Rigid).shapes(shapes).pose(pose).build().unwrap()
}

fn of_bodies(robot: &Arc<Robot>, bodies: Vec<Body>) -> Scene {
    Scene::new(Arc::clone(robot), bodies, Vec::new()).unwrap()
}

fn bodies() -> Vec<Body> {
    let half = [0.05, 0.1, 0.2];
    let rows = [0., 0., 1., 0., 0., 1., 0., 0., -1., 0., 0., 0., 0., 0., 0., 1.];
    let turned = pose_from_matrix(&Matrix4::from_row_slice(&rows), 1e-6).unwrap();
    let corners = [[0.0; 3], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]].map(Point3::from);
    let facet = |indices: [usize; 3]| Convex::hull(&indices.map(|i| corners[i])).unwrap();
    let file = [[0.0; 3], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]].map(Point3::from);
    vec![
        body("box", vec![Convex::cuboid(half, &turned).unwrap()], at(0.75, 0.1, 0.1)),
        body("sphere", vec![Convex::ball(0.07, Point3::new(0.0, 0.0, 0.1)).unwrap()], at(0.6, 0.4, 0.2)),
        body("capsule", vec![Convex::capsule(0.03, 0.3, &turned).unwrap()], at(0.6, 0.2, 0.1)),
        body("cylinder", vec![Convex::cylinder(0.03, 0.3, &Pose::identity()).unwrap()], at(0.75, 0.3, 0.2)),
        body("hull", vec![Convex::hull(&corners).unwrap()], at(0.55, -0.1, 0.1)),
        body("mesh", vec![facet([0, 1, 2]), facet([0, 2, 3])], at(0.75, -0.2, 0.3)),
        body("file", vec![Convex::hull(&file).unwrap()], at(0.4, -0.2, 0.2)),
        body("cloud", corners.map(|p| Convex::ball(0.01, p).unwrap()).to_vec(), at(0.5, 0.0, 0.0)),
        body("part", vec![Convex::cuboid(half, &Pose::identity()).unwrap()], at(0.0, -0.7, 0.2)),
    ]
}

fn hand(robot: &Robot, q: &[f64]) -> Pose {
    robot.link_pose(q, robot.hand()).unwrap()
}

/// Lines about the robot: limits, names, kinematics.
fn about_the_robot(out: &mut Lines, robot: &Arc<Robot>) {
    let joints = robot.joints();
    out.line(&format!("version {} 2", env!("CARGO_PKG_VERSION")));
    let limits = [
        joints.iter().map(|j| j.lower()).collect::<Vec<f64>>(),
        joints.iter().map(|j| j.upper()).collect(),
        joints.iter().map(|j| j.velocity()).collect(),
        joints.iter().map(|j| j.acceleration()).collect(),
        joints.iter().map(|j| j.jerk()).collect(),
        joints.iter().map(|j| j.effort()).collect(),
    ];
    out.numbers("limits", limits.concat());
    joints.iter().for_each(|joint| out.line(&format!("joint {}", joint.name())));
    robot.links().iter().for_each(|link| out.line(&format!("link {}", link.name())));
    out.pose("pose", &hand(robot, &Q[0]));
    let link = |name: &str| robot.link_index(name).unwrap();
    out.pose("pose", &robot.link_pose(&Q[1], link("forearm_link")).unwrap());
    // The Jacobian by finite differences is exact to about 1e-9.
    for (q, index) in [(Q[0], robot.hand()), (Q[1], link("wrist_1_link"))] {
        let chain = robot.chain_to(index).unwrap();
        let mut frames = ChainFrames::default();
        chain.forward(&q, &mut frames).unwrap();
        let columns = robot.jacobian(&chain, &frames);
        out.numbers("jacobian", (0..6).flat_map(|k| columns.iter().map(move |column| column[k])));
        for (j, column) in columns.iter().enumerate() {
            let moved = |step: f64| {
                let mut q = q;
                q[j] += step;
                robot.link_pose(&q, index).unwrap()
            };
            let (high, low) = (moved(1e-5), moved(-1e-5));
            let linear = (high.translation.vector - low.translation.vector) / 2e-5;
            let angular = gensim2_geometry::rotation_log(&(high.rotation * low.rotation.inverse())) / 2e-5;
            let measured = linear.iter().chain(&angular);
            assert!(measured.zip(column).all(|(a, b)| (a - b).abs() < 1e-8), "{column:?}");
        }
    }
    let scene = of_bodies(robot, Vec::new());
    let mut options = IkOptions::default();
    options.max_solutions = 8;
    let found = solutions(&scene, &hand(robot, &Q[0]), &Q[1], &options).unwrap();
    assert!(found.len() > 3);
    out.numbers("ik", found.concat());
    (options.link, options.margin, options.seed) = (Some("wrist_2_link".to_owned()), Some(0.0), 3);
    (options.max_solutions, options.min_distance, options.manipulability) = (3, 0.2, 0.5);
    options.posture = Some(Q[0].to_vec());
    let mut pose = robot.link_pose(&Q[0], link("wrist_2_link")).unwrap();
    let found = solutions(&scene, &pose, &Q[1], &options).unwrap();
    assert!(!found.is_empty());
    out.numbers("ik", found.concat());
    pose.translation.vector.x = 5.0;
    assert!(solutions(&scene, &pose, &Q[1], &options).unwrap().is_empty());
    out.line("ik");
}

/// Lines about the bodies; returns the scene after the changes.
fn about_the_bodies(out: &mut Lines, robot: &Arc<Robot>) -> Scene {
    let before = of_bodies(robot, bodies());
    out.surroundings(&before);
    let kept = before.bodies().iter().filter(|body| body.name() != "mesh").cloned().collect();
    let there = at(0.1, -0.8, 0.3);
    let scene = of_bodies(robot, kept).with_pose("part", &there).unwrap();
    let scene = scene.attached("part", &hand(robot, &Q[1])).unwrap();
    out.pose("attached", scene.body("part").unwrap().pose());
    out.surroundings(&scene);
    let scene = scene.detached("part", &hand(robot, &Q[0]), None).unwrap();
    out.pose("detached", scene.body("part").unwrap().pose());
    let scene = scene.with_pose("part", &there).unwrap();
    scene.bodies().iter().for_each(|body| out.line(&format!("body {}", body.name())));
    out.surroundings(&before);
    let place = hand(robot, &Q[0]).translation.vector;
    let cloud = [Point3::new(0.0, 0.0, 0.5), place.into(), Point3::new(2.0, 0.0, 0.0), Point3::new(0.0, 0.0, 0.1)];
    let marks: Vec<String> =
        scene.own_points(&Q[0], &cloud, 0.02).unwrap().iter().map(|own| u8::from(*own).to_string()).collect();
    assert_eq!(marks[1..], ["1", "0", "1"]);
    out.line(&format!("own {}", marks.join(" ")));
    scene
}

/// Lines about motions and failures.
fn about_motions(out: &mut Lines, scene: &Scene) {
    let robot = scene.robot();
    let mut options = TransitOptions::default();
    (options.seed, options.margin, options.velocity_scale) = (4, 0.004, 0.5);
    let mut goals = [Q[0], Q[1], Q[1]];
    (0..3).for_each(|k| goals[k][5] += 0.2 * k as f64);
    let poses = goals.map(|q| hand(robot, &q));
    let mut bodies = scene.bodies().to_vec();
    let block = Convex::cuboid([0.05, 0.1, 0.2], &Pose::identity()).unwrap();
    bodies.push(body("block", vec![block], Pose::from(poses[0].translation)));
    let scene = &of_bodies(robot, bodies);
    let joints = |goals: &[[f64; 6]]| Goal::Joints(goals.iter().map(|q| q.to_vec()).collect());
    let several = |poses: &[Pose]| Goal::Poses { poses: poses.iter().map(passed).collect(), link: None };
    let to = |start: &[f64], goal: &Goal, options: &TransitOptions| plan_to(scene, start, goal, options).unwrap();
    let motion = to(&HOME, &joints(&goals), &options).unwrap();
    assert!(motion.goal > 0 && motion.warnings.len() == 2);
    out.motion("joints", &motion);
    options.limits = Some(LimitSet::Plain);
    let motion = to(&HOME, &several(&poses), &options).unwrap();
    assert!(motion.goal > 0 && motion.warnings.is_empty());
    out.motion("poses", &motion);

    let mut tolerance = PathTolerance::default();
    (tolerance.position, tolerance.rotation, tolerance.free_axis) = (0.002, 0.05, Some(Vector3::z()));
    let from = hand(robot, &HOME).translation.vector;
    let mut line = [hand(robot, &HOME); 2];
    line[0].translation.vector = from + Vector3::new(0.0, 0.0, 0.05);
    line[1].translation.vector = from + Vector3::new(0.0, 0.05, 0.05);
    line = line.map(|pose| passed(&pose));
    out.motion("along", &plan_along(scene, &HOME, &line, &tolerance, &options).unwrap().unwrap());

    let current = to(&HOME, &joints(&goals[1..2]), &options).unwrap().trajectory;
    options.start_time = 0.3;
    let state = current.sample(options.start_time);
    (options.start_velocity, options.start_acceleration) = (Some(state.velocity), Some(state.acceleration));
    options.warm_start = Some(current);
    options.velocity_limits = Some(vec![3.0; 6]);
    options.acceleration_limits = Some(vec![8.0; 6]);
    options.jerk_limits = Some(vec![4e3; 6]);
    options.velocity_scale = 1.0;
    let moving = to(&state.position, &joints(&goals[2..]), &options).unwrap();
    assert!((moving.trajectory.start() - 0.3).abs() < 1e-12);
    out.motion("moving", &moving);

    let mut options = TransitOptions::default();
    options.cancel = Some(Cancel::new());
    let mut fails = |status: u8, found: Result<Motion, NoMotion>| out.failure(status, &found.unwrap_err());
    fails(6, to(&HOME, &joints(&goals[..1]), &options));
    fails(5, to(&goals[0], &joints(&[HOME]), &options));
    line[0].translation.vector.x = 4.0;
    fails(7, to(&HOME, &several(&line[..1]), &options));
    fails(7, plan_along(scene, &HOME, &line, &PathTolerance::default(), &options).unwrap());
    options.cancel.as_ref().unwrap().cancel();
    let cancelled = to(&HOME, &joints(&goals[1..2]), &options);
    options.cancel = None;
    options.deadline = Some(Duration::from_secs_f64(1e-9));
    let late = to(&HOME, &joints(&goals[1..2]), &options);
    out.line("cancelled 1");
    out.failure(11, &cancelled.unwrap_err());
    out.failure(10, &late.unwrap_err());
    let unknown = Goal::Poses { poses: line[1..].to_vec(), link: Some("no_link".to_owned()) };
    out.failure(2, &plan_to(scene, &HOME, &unknown, &TransitOptions::default()).unwrap_err());
    let rigid = "is not a finite rigid transform (row-major, rotation orthonormal, last row 0 0 0 1)";
    out.line(&format!("failure 2 null goals[0]: {rigid}"));
}

/// Returns whether two words are equal, or numbers that differ by at most 1e-9.
fn are_equal(one: &str, two: &str) -> bool {
    let close = |a: f64, b: f64| a == b || (a - b).abs() <= 1e-9;
    one == two || matches!((one.parse(), two.parse()), (Ok(a), Ok(b)) if close(a, b))
}

#[test]
fn c_and_rust_get_the_same_results() {
    let file = compiled::built().join("gensim2_results.obj");
    std::fs::write(&file, OBJ).unwrap();
    let said = compiled::run(&compiled::compile("tests/c/results.c"), &[&compiled::ur5e(), &file]);
    let robot = Arc::new(Robot::from_urdf(compiled::ur5e(), None, "flange", None, &[], None).unwrap());
    let mut lines = Lines(String::new());
    about_the_robot(&mut lines, &robot);
    let scene = about_the_bodies(&mut lines, &robot);
    about_motions(&mut lines, &scene);
    let (said, expected): (Vec<&str>, Vec<&str>) = (said.lines().collect(), lines.0.lines().collect());
    for (k, (one, two)) in said.iter().zip(&expected).enumerate() {
        let (a, b): (Vec<&str>, Vec<&str>) = (one.split_whitespace().collect(), two.split_whitespace().collect());
        let same = a.len() == b.len() && a.iter().zip(&b).all(|(a, b)| are_equal(a, b));
        assert!(same, "line {}: C gets\n{one}\nand Rust\n{two}", k + 1);
    }
    assert_eq!(said.len(), expected.len());
    assert!(said.len() > 100, "{}", said.len());
}

//! Replays a recording of `benchmarks/servo.py --record` and prints the CPU time of the steps:
//! `cargo run --release -p gensim2-kpam --example servo_steps -- RECORDING [STEPS [POSITIONS]]`.
//!
//! The file POSITIONS gets the joint values after each step as numbers of 8 bytes, lowest byte first.
//! Under `valgrind --tool=callgrind --toggle-collect='*Servo::step*'`, the number of instructions is that of the steps
//! alone.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead, BufReader, BufWriter, Write};
use std::path::Path;
use std::sync::Arc;

use cpu_time::ThreadTime;
use gensim2_geometry::{Convex, Pose, Robot};
use gensim2_kpam::options::LimitSet;
use gensim2_kpam::{Body, Role, Scene, Servo, ServoLimit, ServoOptions, ServoStatus, Target};
use nalgebra::{Matrix3, Point3, Rotation3, Vector3};
use serde::Deserialize;

type Failure = Box<dyn std::error::Error>;

/// First line of a recording.
#[derive(Deserialize)]
struct Header {
    urdf: String,
    file: String,
    srdf: Option<String>,
    hand: String,
    bodies: Vec<Obstacle>,
    start: Vec<f64>,
    margin: f64,
    dt: f64,
    options: Limits,
}

#[derive(Deserialize)]
struct Obstacle {
    name: String,
    kind: String,
    size: Vec<f64>,
    points: Option<Vec<[f64; 3]>>,
    pose: [[f64; 4]; 4],
}

#[derive(Deserialize)]
struct Limits {
    limits: Option<String>,
    acceleration_limits: Option<Vec<f64>>,
    jerk_limits: Option<Vec<f64>>,
}

/// One of the other lines: the arguments of `Servo.step`.
#[derive(Deserialize)]
struct Step {
    target: Option<Goal>,
    twist: Option<[f64; 6]>,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Goal {
    Pose([[f64; 4]; 4]),
    Joints(Vec<f64>),
}

fn pose_of(rows: &[[f64; 4]; 4]) -> Pose {
    let turn = Matrix3::from_fn(|i, j| rows[i][j]);
    let shift = Vector3::from_fn(|i, _| rows[i][3]);
    Pose::from_parts(shift.into(), Rotation3::from_matrix_unchecked(turn))
}

fn shapes(obstacle: &Obstacle) -> Result<Vec<Convex>, Failure> {
    let (size, same) = (&obstacle.size, Pose::identity());
    if let Some(points) = &obstacle.points {
        return Ok(points.iter().map(|p| Convex::ball(size[0], Point3::from(*p))).collect::<Result<_, _>>()?);
    }
    Ok(vec![match obstacle.kind.as_str() {
        "box" => Convex::cuboid([size[0], size[1], size[2]], &same)?,
        "capsule" => Convex::capsule(size[0], size[1], &same)?,
        kind => return Err(format!("unknown kind of obstacle {kind:?}").into()),
    }])
}

fn target_of(step: Step) -> Target {
    match (step.target, step.twist) {
        (None, None) => Target::Rest,
        (None, Some(twist)) => Target::Twist(twist),
        (Some(Goal::Joints(q)), _) => Target::Joints(q),
        (Some(Goal::Pose(pose)), twist) => Target::Pose { pose: pose_of(&pose), twist: twist.unwrap_or([0.0; 6]) },
    }
}

fn main() -> Result<(), Failure> {
    let mut arguments = std::env::args().skip(1);
    let file = arguments.next().ok_or("usage: servo_steps RECORDING [STEPS]")?;
    let most = arguments.next().map_or(Ok(usize::MAX), |text| text.parse())?;
    let mut positions = arguments.next().map(|file| File::create(file).map(BufWriter::new)).transpose()?;
    let mut lines = BufReader::new(File::open(file)?).lines();
    let header: Header = serde_json::from_str(&lines.next().ok_or("the recording is empty")??)?;
    let robot = Robot::from_urdf_str(&header.urdf, &header.file, header.srdf.as_deref(), &header.hand, None)?;
    let mut bodies = Vec::new();
    for obstacle in &header.bodies {
        let body = Body::builder(&obstacle.name, Role::Rigid).pose(pose_of(&obstacle.pose));
        bodies.push(body.shapes(shapes(obstacle)?).build()?);
    }
    let scene = Scene::new(Arc::new(robot), bodies, Vec::new())?;
    let mut options = ServoOptions::default();
    (options.margin, options.dt) = (header.margin, header.dt);
    options.limits = header.options.limits.map(|_| LimitSet::Plain);
    options.acceleration_limits = header.options.acceleration_limits;
    options.jerk_limits = header.options.jerk_limits;
    let mut servo = Servo::new(&scene, &header.start, &options)?;
    let (mut checker, path) = (scene.checker(), Path::new(&header.file));
    let (mut times, mut counts, mut nearest, mut sum) = (Vec::new(), [0; 3], f64::INFINITY, 0.0);
    let mut causes: BTreeMap<String, usize> = BTreeMap::new();
    for line in lines.take(most) {
        let target = target_of(serde_json::from_str(&line?)?);
        let clock = ThreadTime::now();
        let step = servo.step(&target)?;
        times.push(clock.elapsed().as_secs_f64() * 1e6);
        let kind = match step.status {
            ServoStatus::Tracking => 0,
            ServoStatus::Limited => 1,
            _ => 2,
        };
        counts[kind] += 1;
        sum += step.position.iter().sum::<f64>();
        if let Some(file) = &mut positions {
            step.position.iter().try_for_each(|value| file.write_all(&value.to_le_bytes()))?;
        }
        if step.status == ServoStatus::Braking {
            let cause = match step.limited_by.first() {
                Some(ServoLimit::Distance(a, b)) => format!("{}, {}", servo.body_name(*a), servo.body_name(*b)),
                _ => "limits of the joints".to_owned(),
            };
            *causes.entry(cause).or_default() += 1;
        }
        if times.len() % 20 == 0 {
            nearest = checker.distance(&step.position, 1.0)?.min(nearest);
        }
    }
    times.sort_by(f64::total_cmp);
    let at = |share: f64| times[((times.len() - 1) as f64 * share) as usize];
    println!(
        "{}: {} steps, {:.1} us, 90 % {:.1}, 99 % {:.1}, most {:.0}, mean {:.1}; tracking {}, limited {}, braking {}; \
         {:.2} mm; sum {sum:.9}",
        path.file_stem().map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
        times.len(),
        at(0.5),
        at(0.9),
        at(0.99),
        at(1.0),
        times.iter().sum::<f64>() / times.len() as f64,
        counts[0],
        counts[1],
        counts[2],
        1e3 * nearest
    );
    let mut causes: Vec<_> = causes.into_iter().collect();
    causes.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    for (cause, count) in causes.iter().take(5) {
        println!("  braking before {cause}: {count} steps");
    }
    Ok(())
}

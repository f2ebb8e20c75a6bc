//! Tests of the servo on an arm next to a box and a ball.

use std::sync::Arc;

use gensim2_geometry::{Convex, Draws, Joint, Link, Pose, Robot};
use nalgebra::Vector3;

use super::guard::Surroundings;
use super::pairs::gradient;
use super::*;
use crate::world::Compiled;
use crate::{Body, Role};

/// An arm with a revolute, a sliding and two further revolute joints, next to a box and a ball.
fn scene() -> Scene {
    let cylinder = |length: f64| Convex::cylinder(0.03, length, &Pose::translation(0.0, 0.0, 0.5 * length)).unwrap();
    let turn = |name: &str, axis| Joint::revolute(name, axis).limits(-2.5, 2.5).velocity(2.0);
    let slide = Joint::prismatic("slide", Vector3::z()).limits(-0.05, 0.2).velocity(1.0);
    let robot = Robot::builder("arm")
        .link(Link::base("base").shape(Convex::cuboid([0.1, 0.1, 0.02], &Pose::identity()).unwrap()))
        .link(Link::below("base", "lower").at(Pose::translation(0.0, 0.0, 0.1)).moved_by(turn("a", Vector3::y())))
        .link(Link::below("lower", "upper").moved_by(slide).shape(cylinder(0.3)))
        .link(
            Link::below("upper", "fore")
                .at(Pose::translation(0.0, 0.0, 0.4))
                .moved_by(turn("b", Vector3::x()))
                .shape(cylinder(0.25)),
        )
        .link(
            Link::below("fore", "hand")
                .at(Pose::translation(0.02, 0.0, 0.3))
                .moved_by(turn("c", Vector3::new(0.0, 0.6, 0.8)))
                .shape(cylinder(0.1)),
        )
        .build("hand")
        .unwrap();
    let wall = Convex::cuboid([0.2, 0.03, 0.3], &Pose::identity()).unwrap();
    let ball = Convex::ball(0.06, nalgebra::Point3::origin()).unwrap();
    let bodies = [(wall, "wall", [0.1, 0.4, 0.5]), (ball, "ball", [0.35, -0.1, 0.75])];
    let bodies = bodies.map(|(shape, name, [x, y, z])| {
        Body::builder(name, Role::Rigid).shape(shape).pose(Pose::translation(x, y, z)).build().unwrap()
    });
    Scene::new(Arc::new(robot), bodies.to_vec(), Vec::new()).unwrap()
}

fn servo(scene: &Scene) -> Servo {
    let mut options = ServoOptions::default();
    (options.acceleration_limits, options.jerk_limits) = (Some(vec![8.0; 4]), Some(vec![600.0; 4]));
    Servo::new(scene, &[0.0; 4], &options).unwrap()
}

#[test]
fn gradients_are_those_of_the_distances() {
    let scene = scene();
    let (world, mut servo, mut draws) = (scene.compiled(), servo(&scene), Draws::of(3, 1));
    let (mut compared, step) = (0, 1e-6);
    let others: Vec<(usize, Other)> = (0..world.screen.groups())
        .flat_map(|group| (0..2).map(move |e| (group, Other::Element(e))))
        .chain((0..world.screen.pairs().len()).map(|pair| (world.screen.pairs()[pair].0, Other::Pair(pair))))
        .collect();
    for _ in 0..60 {
        let q: Vec<f64> = [2.0, 0.2, 2.0, 2.0].iter().map(|range| range * (draws.unit() - 0.5)).collect();
        let mut poses = Vec::new();
        let x = servo.model.pick(&q);
        servo.arm.place(Surroundings { scene: &scene, model: &servo.model }, &x);
        for &(group, other) in &others {
            let Some(contact) = world.screen.contact(group, other, &servo.arm.poses, 1.0, None) else { continue };
            if contact.distance < 1e-3 {
                continue;
            }
            assert!((contact.distance - world.screen.distance(group, other, &servo.arm.poses, 1.0)).abs() < 1e-12);
            let gradient = gradient(&servo.arm, &world.screen, (group, other), &contact);
            for v in 0..4 {
                let ends = [-step, step].map(|shift| {
                    let mut moved = q.clone();
                    moved[v] += shift;
                    Compiled::poses(&scene, &moved, &mut poses);
                    world.screen.distance(group, other, &poses, 2.0)
                });
                let slope = (ends[1] - ends[0]) / (2.0 * step);
                // Where the closest feature changes, the distance has a kink.
                let bent = (ends[0] + ends[1] - 2.0 * contact.distance).abs() > 1e-9;
                assert!(bent || (slope - gradient[v]).abs() < 2e-4, "{other:?} {v}: {slope} {}", gradient[v]);
                compared += usize::from(!bent);
            }
        }
    }
    assert!(compared > 1000, "{compared}");
}

#[test]
fn the_jacobian_is_that_of_the_pose() {
    let scene = scene();
    let (mut servo, step) = (servo(&scene), 1e-6);
    let x: Row = std::array::from_fn(|v| if v < 4 { 0.3 - 0.1 * v as f64 } else { 0.0 });
    let around = Surroundings { scene: &scene, model: &servo.model };
    servo.arm.place(around, &x);
    let columns = servo.arm.twists();
    for v in 0..4 {
        let [before, after] = [-step, step].map(|shift| {
            let mut moved = x;
            moved[v] += shift;
            servo.arm.place(around, &moved);
            *servo.arm.tip()
        });
        let shift = (after.translation.vector - before.translation.vector) / (2.0 * step);
        let turn = gensim2_geometry::rotation_log(&(after.rotation * before.rotation.inverse())) / (2.0 * step);
        let found = Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z);
        assert!((found - columns[v]).amax() < 1e-7, "{v}: {found} {}", columns[v]);
    }
}

#[test]
fn no_target_leads_into_an_obstacle_or_beyond_a_limit() {
    let scene = scene();
    let (mut servo, mut checker, mut draws) = (servo(&scene), scene.checker(), Draws::of(5, 2));
    let mut past: Vec<Vec<f64>> = vec![vec![0.0; 4]; 4];
    let (mut braked, mut nearest) = (0, f64::INFINITY);
    let most = [[2.0, 8.0, 600.0], [1.0, 8.0, 600.0], [2.0, 8.0, 600.0], [2.0, 8.0, 600.0]];
    for target in 0..16 {
        let mut spread = |size: f64| std::array::from_fn::<f64, 6, _>(|_| size * (draws.unit() - 0.5));
        // Poses lie inside the wall and the ball in turn.
        let [x, y, z] = [[0.1, 0.4, 0.5], [0.35, -0.1, 0.75]][target / 2 % 2];
        let turn = spread(0.6);
        let pose = Pose::from_parts(
            Vector3::new(x, y, z).into(),
            nalgebra::Rotation3::new(Vector3::new(turn[0], turn[1], turn[2])),
        );
        let aim = match target % 4 {
            0 => Target::Twist(spread(6.0)),
            1 => Target::Joints(spread(8.0)[..4].to_vec()),
            2 if target == 14 => Target::Rest,
            _ => Target::Pose { pose, twist: spread(0.5) },
        };
        for k in 0..400 {
            let step = servo.step(&aim).unwrap();
            braked += usize::from(step.status == ServoStatus::Braking);
            past.remove(0);
            past.push(step.position);
            for (j, [velocity, acceleration, jerk]) in most.iter().enumerate() {
                let [a, b, c, d] = [0, 1, 2, 3].map(|i| past[i][j]);
                assert!((d - c).abs() <= velocity * 1e-3 * (1.0 + 1e-6), "velocity of joint {j}");
                assert!((d - 2.0 * c + b).abs() <= acceleration * 1e-6 * (1.0 + 1e-6), "acceleration of joint {j}");
                assert!((d - 3.0 * c + 3.0 * b - a).abs() <= jerk * 1e-9 * (1.0 + 1e-6) + 1e-14, "jerk of {j}");
                let (lower, upper) = if j == 1 { (-0.05, 0.2) } else { (-2.5, 2.5) };
                assert!(d >= lower - 1e-8 && d <= upper + 1e-8, "range of joint {j}");
            }
            if k % 5 == 0 {
                nearest = checker.distance(&past[3], 1.0).unwrap().min(nearest);
                assert!(nearest >= 0.005 - 1e-9, "{nearest}");
            }
        }
    }
    // The arm comes close to obstacles, and is moving most of the time.
    assert!(nearest < 0.012 && braked < 1500, "{nearest} {braked}");
}

#[test]
fn a_proven_motion_keeps_all_distances() {
    let scene = scene();
    let (mut servo, mut checker, mut draws) = (servo(&scene), scene.checker(), Draws::of(7, 3));
    let (mut proven, mut refuted, mut nearest) = (0, 0, f64::INFINITY);
    // Enough motions are proven, some of them close to an obstacle, and some lead too close.
    while proven < 60 || nearest > 0.008 || refuted < 10 {
        let q: Vec<f64> = [2.4, 0.2, 2.4, 2.4].iter().map(|range| range * (draws.unit() - 0.5)).collect();
        let distance = checker.distance(&q, 0.1).unwrap();
        if !(0.006..0.03).contains(&distance) {
            continue;
        }
        let courses: Vec<Course> = (0..4)
            .map(|v| {
                let state = [q[v], 1.5 * draws.unit() - 0.75, 6.0 * draws.unit() - 3.0];
                Course::step(state, 600.0 * (2.0 * draws.unit() - 1.0), 1e-3, &servo.joints[v])
            })
            .collect();
        let end = courses.iter().map(Course::duration).fold(0.0, f64::max);
        let least = (0..=200).map(|k| {
            let q: Vec<f64> = courses.iter().map(|course| course.at(end * f64::from(k) / 200.0)[0]).collect();
            checker.distance(&q, 0.1).unwrap()
        });
        let least = least.fold(f64::INFINITY, f64::min);
        // The second proof uses what the first has learnt.
        for _ in 0..2 {
            if servo.guard.proves(Surroundings { scene: &scene, model: &servo.model }, &courses) {
                assert!(least >= 0.005 - 1e-8, "{least}");
                (proven, nearest) = (proven + 1, least.min(nearest));
            } else {
                refuted += usize::from(least < 0.005);
                assert!(least < 0.0052, "a motion that keeps {least} m is not proven");
            }
        }
    }
}

#[test]
fn an_attached_body_is_lifted_from_its_support_and_put_down_again() {
    let mut bodies = scene().bodies().to_vec();
    let part = Convex::cuboid([0.05, 0.04, 0.02], &Pose::identity()).unwrap();
    let table = Convex::cuboid([0.1, 0.1, 0.3], &Pose::identity()).unwrap();
    for (name, shape, z) in [("part", part, 0.62), ("table", table, 0.3)] {
        let pose = Pose::translation(0.25, 0.0, z);
        bodies.push(Body::builder(name, Role::Rigid).shape(shape).pose(pose).build().unwrap());
    }
    let robot = Arc::clone(scene().robot());
    let hand = Pose::translation(0.02, 0.0, 0.8);
    let scene = Scene::new(robot, bodies, Vec::new()).unwrap().attached("part", &hand).unwrap();
    let mut servo = servo(&scene);
    let pose = |shift: f64| Target::Pose { pose: Pose::translation(0.02, 0.0, 0.8 + shift), twist: [0.0; 6] };
    let place = |servo: &mut Servo, target: &Target| {
        let mut checker = scene.checker();
        let (mut found, mut nearest) = (Vec::new(), f64::INFINITY);
        for _ in 0..1000 {
            found = servo.step(target).unwrap().position;
            nearest = checker.distance(&found, 1.0).unwrap().min(nearest);
        }
        (found, nearest)
    };
    let (lifted, nearest) = place(&mut servo, &pose(0.04));
    assert!((lifted[1] - 0.04).abs() < 1e-3 && nearest > -1.1e-4, "{lifted:?} {nearest}");
    let (put_down, nearest) = place(&mut servo, &pose(0.0));
    assert!(put_down[1].abs() < 5e-4 && nearest > -1.1e-4, "{put_down:?} {nearest}");
    let (_, nearest) = place(&mut servo, &pose(-0.03));
    assert!(nearest > -1.1e-4, "{nearest}");
}

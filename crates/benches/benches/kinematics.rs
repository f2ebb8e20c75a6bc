//! Forward kinematics and Jacobians of a seven-joint arm: `cargo bench -p gensim2-benches --bench kinematics`.
#![allow(missing_docs, clippy::unwrap_used)]

use criterion::{Criterion, criterion_group, criterion_main};
use gensim2_geometry::{ChainFrames, Convex, Corners, Pose, Robot, signed_distance};
use nalgebra::{Point3, Vector3};
use std::hint::black_box;

fn arm() -> Robot {
    let links: String = (0..8).map(|i| format!(r#"<link name="l{i}"/>"#)).collect();
    let joints: String = (1..8)
        .map(|i| {
            format!(
                r#"<joint name="j{i}" type="revolute"><parent link="l{}"/><child link="l{i}"/>
                <origin xyz="0.05 0 0.2" rpy="{} 0 0"/><axis xyz="0 0 1"/>
                <limit lower="-2.8" upper="2.8" effort="1" velocity="2"/></joint>"#,
                i - 1,
                if i % 2 == 0 { 1.57 } else { -1.57 }
            )
        })
        .collect();
    let text = format!(r#"<robot name="arm">{links}{joints}</robot>"#);
    Robot::from_urdf_str(&text, "arm.urdf", None, "l7", None).unwrap()
}

fn kinematics(c: &mut Criterion) {
    let (robot, q) = (arm(), [0.1, 0.2, -0.3, 0.4, -0.5, 0.6, 0.7]);
    let mut frames = ChainFrames::default();
    c.bench_function("forward kinematics, 7 joints", |b| {
        b.iter(|| robot.chain().forward(black_box(&q), &mut frames));
    });
    c.bench_function("Jacobian, 7 joints", |b| {
        b.iter(|| {
            robot.chain().forward(black_box(&q), &mut frames).unwrap();
            let tip = frames.tip.translation.vector;
            (0..7)
                .filter_map(|i| Some(robot.chain().linear(&frames, i, &tip)? + robot.chain().angular(&frames, i)?))
                .sum::<Vector3<f64>>()
        });
    });
}

fn distances(c: &mut Criterion) {
    let ring = |n: usize, at: f64| -> Vec<Point3<f64>> {
        (0..n)
            .flat_map(|i| {
                let (s, c) = (std::f64::consts::TAU * i as f64 / n as f64).sin_cos();
                [Point3::new(at + 0.05 * c, 0.05 * s, 0.0), Point3::new(at + 0.05 * c, 0.05 * s, 0.1)]
            })
            .collect()
    };
    for corners in [8, 64] {
        let shapes = [0.0, 0.13].map(|at| Convex::hull(&ring(corners / 2, at)).unwrap().moved(&Pose::identity()));
        let [a, b] = shapes.map(|s| Corners::of(s.points()));
        c.bench_function(&format!("signed distance, {corners} corners each"), |bench| {
            bench.iter(|| signed_distance((&a, 0.0), (&b, 0.0), black_box(&mut Vector3::x()), 1.0));
        });
    }
}

criterion_group!(benches, kinematics, distances);
criterion_main!(benches);

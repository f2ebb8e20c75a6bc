//! A QP of the solver's size, and a whole plan: `cargo bench -p gensim2-benches --bench solver`.
#![allow(missing_docs, clippy::unwrap_used)]

use std::hint::black_box;
use std::sync::Arc;

use criterion::{Criterion, criterion_group, criterion_main};
use gensim2_geometry::{Convex, Pose, Robot};
use gensim2_kpam::qp::{ActiveSet, Bound, Qp};
use gensim2_kpam::{Body, KeypointProblem, MAX_JOINTS, Role, Row, SolverConfig, plan};
use nalgebra::Vector3;

/// A step of the actuation pose: three point rows, a cone of sixteen sides, seven joints within a trust region.
fn step() -> (Vec<Row>, Row, Vec<Bound>) {
    let wave = |a: usize, b: usize| ((3 * a + 7 * b + 1) as f64).sin();
    let row = |k: usize| std::array::from_fn(|v| if v < 7 { wave(k, v) } else { 0.0 });
    let hessian: Vec<Row> = (0..7)
        .map(|i| {
            let mut h = [0.0; MAX_JOINTS];
            for (j, value) in h.iter_mut().enumerate().take(7) {
                *value = 0.3 * (0..7).map(|k| wave(i, k) * wave(j, k)).sum::<f64>() + if i == j { 2.0 } else { 0.0 };
            }
            h
        })
        .collect();
    let mut bounds: Vec<Bound> = (0..3).map(|k| Bound { row: row(k), low: -0.011, high: -0.009 }).collect();
    bounds.extend((3..19).map(|k| Bound { row: row(k), low: f64::NEG_INFINITY, high: 0.05 }));
    bounds.extend((0..7).map(|v| {
        let mut row = [0.0; MAX_JOINTS];
        row[v] = 1.0;
        Bound { row, low: -0.5, high: 0.5 }
    }));
    (hessian, row(40), bounds)
}

fn qps(c: &mut Criterion) {
    let (hessian, gradient, bounds) = step();
    let qp = Qp { n: 7, hessian: &hessian, gradient: &gradient, bounds: &bounds };
    let mut dense = ActiveSet::default();
    c.bench_function("QP of a step, dense active set", |b| b.iter(|| dense.solve(black_box(&qp))));
}

/// A six-joint arm over a table.
fn problem() -> KeypointProblem {
    let joint = |i: usize, axis: &str, z: f64| {
        format!(
            r#"<joint name="j{i}" type="revolute"><parent link="l{}"/><child link="l{i}"/><origin xyz="0 0 {z}"/>
            <axis xyz="{axis}"/><limit lower="-2.8" upper="2.8" effort="1" velocity="2"/></joint>"#,
            i - 1
        )
    };
    let link = |i: usize| {
        format!(
            r#"<link name="l{i}"><collision><origin xyz="0 0 0.1"/><geometry><cylinder radius="0.03" length="0.15"/>
            </geometry></collision></link>"#
        )
    };
    let links: String = (0..7).map(link).collect();
    let axes = ["0 0 1", "0 1 0", "0 1 0", "0 0 1", "0 1 0", "0 0 1"];
    let lengths = [0.3, 0.2, 0.4, 0.4, 0.2, 0.1];
    let joints: String = (1..7).map(|i| joint(i, axes[i - 1], lengths[i - 1])).collect();
    let text = format!(r#"<robot name="arm">{links}{joints}</robot>"#);
    let robot = Arc::new(Robot::from_urdf_str(&text, "arm.urdf", None, "l6", None).unwrap());
    let config = SolverConfig::from_json(
        r#"{"constraint_list": [
        {"type": "point2point_constraint", "keypoint_name": "tip", "target_keypoint_name": "goal", "tolerance": 0.001},
        {"type": "frame_axis_parallel", "axis_from_keypoint_name": "palm", "axis_to_keypoint_name": "tip",
         "target_axis": [0, 0, -1], "target_axis_frame": "world", "target_inner_product": 1, "tolerance": 0.05}],
        "pre_actuation_motions": [["translate_z", -0.08]], "post_actuation_motions": ["move-up"]}"#,
    )
    .unwrap();
    let tool = [("palm", 0.0), ("tip", 0.2)].map(|(name, z)| (name.to_owned(), Vector3::new(0.0, 0.0, z)));
    let top = Convex::cuboid([0.5, 0.5, 0.02], &Pose::translation(0.6, 0.0, -0.02)).unwrap();
    let table = Body::builder("table", Role::Table).shape(top).build().unwrap();
    KeypointProblem::builder(robot, config, vec![0.2, 0.5, 0.6, 0.1, 0.4, 0.0])
        .tool_keypoints(tool)
        .object_keypoint("goal", Vector3::new(0.5, 0.2, 0.15))
        .bodies(vec![table])
        .build()
        .unwrap()
}

fn plans(c: &mut Criterion) {
    let problem = problem();
    println!("the plan: {}", plan(&problem).reason);
    c.bench_function("whole plan, six joints over a table", |b| b.iter(|| plan(black_box(&problem))));
}

criterion_group!(benches, qps, plans);
criterion_main!(benches);

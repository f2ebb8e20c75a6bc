//! Compares analytic derivatives with finite differences.
#![allow(clippy::unwrap_used)]

use std::sync::Arc;

use gensim2_geometry::Robot;
use nalgebra::Vector3;
use proptest::prelude::*;

use crate::model::{Model, Placed};

/// An arm with revolute, prismatic and mimic joints about skew axes.
const ARM: &str = r#"<robot name="arm">
  <link name="base"/><link name="a"/><link name="b"/><link name="c"/><link name="d"/><link name="hand"/>
  <joint name="j1" type="revolute"><parent link="base"/><child link="a"/><origin xyz="0 0.1 0.3" rpy="0.2 0 0.4"/>
    <axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="j2" type="prismatic"><parent link="a"/><child link="b"/><origin xyz="0.2 0 0" rpy="0 0.5 0"/>
    <axis xyz="1 2 0.5"/><limit lower="-0.5" upper="0.5" effort="1" velocity="1"/></joint>
  <joint name="j3" type="continuous"><parent link="b"/><child link="c"/><origin xyz="0.1 0.3 0"/>
    <axis xyz="0.3 -1 0.2"/></joint>
  <joint name="j4" type="revolute"><parent link="c"/><child link="d"/><origin xyz="0 0 0.2"/>
    <axis xyz="1 0 0"/><limit lower="-3" upper="3" effort="1" velocity="1"/><mimic joint="j1" multiplier="-0.7" offset="0.1"/></joint>
  <joint name="j5" type="revolute"><parent link="d"/><child link="hand"/><origin xyz="0.2 0 0" rpy="1 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
</robot>"#;

fn arm() -> Arc<Robot> {
    Arc::new(Robot::from_urdf_str(ARM, "arm.urdf", None, "hand", None).unwrap())
}

/// The same arm, but mimic joints are declared before the joints that they follow: j1 follows j4, j4 follows j5, and j3
/// follows a joint that does not move the hand.
fn tangled_arm() -> Arc<Robot> {
    let mimic = |joint: &str, factor: f64| format!(r#"<mimic joint="{joint}" multiplier="{factor}" offset="0.1"/>"#);
    let text = ARM
        .replace(r#"<mimic joint="j1" multiplier="-0.7" offset="0.1"/>"#, &mimic("j5", -0.7))
        .replacen("</joint>", &(mimic("j4", 1.5) + "</joint>"), 1)
        .replace(r#"<axis xyz="0.3 -1 0.2"/>"#, &(r#"<axis xyz="0.3 -1 0.2"/>"#.to_owned() + &mimic("side", 2.0)))
        .replace(
            "</robot>",
            r#"<link name="flap"/><joint name="side" type="revolute"><parent link="base"/><child link="flap"/>
            <axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>"#,
        );
    Arc::new(Robot::from_urdf_str(&text, "arm.urdf", None, "hand", None).unwrap())
}

#[test]
fn a_mimic_joint_is_no_variable() {
    let robot = arm();
    let model = Model::new(&robot, &[0.0; 5]).unwrap();
    assert_eq!(model.map().indices(), [0, 1, 2, 4]);
    let mut q = Vec::new();
    model.map().positions(&model.pick(&[0.5, 0.1, 0.2, 9.0, 0.3]), &mut q);
    assert!((q[3] - (0.1 - 0.35)).abs() < 1e-12);
}

#[test]
fn every_driven_joint_knows_its_variable() {
    let robot = tangled_arm();
    let model = Model::new(&robot, &[0.0; 6]).unwrap();
    // j5 drives j1 and j4; j2 is independent; the flap's joint drives j3.
    assert_eq!(model.map().indices(), [4, 1, 5]);
    let driven: Vec<(&str, usize, usize)> =
        model.map().driven().iter().map(|d| (robot.links()[d.link].name(), d.joint, d.variable)).collect();
    // Driven joints are ordered like the links that they move; the joint of the flap is last.
    let carried = [("a", 0, 0), ("b", 1, 1), ("c", 2, 2), ("d", 3, 0), ("hand", 4, 0), ("flap", 5, 2)];
    assert_eq!(driven, carried);
    let factors: Vec<f64> = model.map().driven().iter().map(|d| d.factor).collect();
    assert!((factors[0] - 1.5 * -0.7).abs() < 1e-12 && factors[2] == 2.0, "{factors:?}");
    // Because of j1 = -1.05 j5 + 0.25, the limits [-2, 2] and 1 rad/s of j1 bound j5.
    assert!((model.lower[0] - -1.75 / 1.05).abs() < 1e-12, "{}", model.lower[0]);
    assert!((model.velocity[0] - 1.0 / 1.05).abs() < 1e-12, "{}", model.velocity[0]);
    let (mut q, mut rates) = (Vec::new(), Vec::new());
    let x = model.pick(&[0.0, 0.2, 0.0, 0.0, 0.3, 0.4]);
    model.map().positions(&x, &mut q);
    assert!((q[3] - (-0.21 + 0.1)).abs() < 1e-12 && (q[0] - (1.5 * q[3] + 0.1)).abs() < 1e-12, "{q:?}");
    model.map().rates(&x, &mut rates);
    assert!((rates[0] - -1.05 * 0.3).abs() < 1e-12 && (rates[2] - 0.8).abs() < 1e-12, "{rates:?}");
}

proptest! {
    #[test]
    fn rows_are_gradients(
        tangled in any::<bool>(),
        values in prop::collection::vec(-1.0..1.0f64, 4),
        on_hand in prop::array::uniform3(-0.3..0.3f64),
        direction in prop::array::uniform3(-1.0..1.0f64),
    ) {
        let robot = if tangled { tangled_arm() } else { arm() };
        let model = Model::new(&robot, &vec![0.0; robot.joints().len()]).unwrap();
        let (on_hand, direction) = (Vector3::from(on_hand), Vector3::from(direction));
        let mut x = model.start();
        x[..model.n()].copy_from_slice(&values[..model.n()]);
        let at = |x: &crate::model::Row| {
            let mut placed = Placed::default();
            placed.place(&robot, &model, x);
            placed
        };
        let here = at(&x);
        let carried = here.hand.rotation * on_hand;
        let point = carried + here.hand.translation.vector;
        let linear = here.linear_row(&point, &direction);
        let rows = here.point_rows(&point);
        let angular = here.angular_row(&carried.cross(&direction));
        for v in 0..model.n() {
            let h = 1e-6;
            let (mut up, mut down) = (x, x);
            up[v] += h;
            down[v] -= h;
            let (up, down) = (at(&up), at(&down));
            let place = |p: &Placed| p.hand.rotation * on_hand + p.hand.translation.vector;
            let slope = direction.dot(&(place(&up) - place(&down))) / (2.0 * h);
            prop_assert!((slope - linear[v]).abs() < 1e-7, "{slope} {}", linear[v]);
            let by_rows: f64 = (0..3).map(|k| direction[k] * rows[k][v]).sum();
            prop_assert!((slope - by_rows).abs() < 1e-7, "{slope} {by_rows}");
            let turn = direction.dot(&(up.hand.rotation * on_hand - down.hand.rotation * on_hand)) / (2.0 * h);
            prop_assert!((turn - angular[v]).abs() < 1e-7, "{turn} {}", angular[v]);
        }
    }
}

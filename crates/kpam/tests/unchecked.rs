//! A problem whose fields were set wrong after it was built is refused, not a panic.
#![allow(clippy::unwrap_used)]

use std::collections::BTreeMap;
use std::sync::Arc;

use gensim2_geometry::{Pose, Robot};
use gensim2_kpam::{KeypointProblem, SolverConfig, Status, ik, plan};
use nalgebra::Vector3;

fn problem() -> KeypointProblem {
    let joint = |i: usize, axis: &str| {
        format!(
            r#"<joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{}"/><origin xyz="0.3 0 0.1"/>
            <axis xyz="{axis}"/><limit lower="-2" upper="2" effort="1" velocity="2"/></joint>"#,
            i + 1
        )
    };
    let links: String = (0..4).map(|i| format!(r#"<link name="l{i}"/>"#)).collect();
    let joints = [joint(0, "0 0 1"), joint(1, "0 1 0"), joint(2, "0 1 0")].concat();
    let text = format!(r#"<robot name="arm">{links}{joints}</robot>"#);
    let robot = Arc::new(Robot::from_urdf_str(&text, "arm.urdf", None, "l3", None).unwrap());
    let config = SolverConfig::from_json(
        r#"{"constraint_list": [{"type": "point2point_constraint", "keypoint_name": "tip", "tolerance": 0.001,
            "target_keypoint_name": "goal"}], "pre_actuation_motions": [["rotate", 0.1]]}"#,
    )
    .unwrap();
    let tool = BTreeMap::from([("tip".to_owned(), Vector3::zeros())]);
    let goal = BTreeMap::from([("goal".to_owned(), Vector3::new(0.8, 0.1, 0.2))]);
    KeypointProblem::new(robot, config, vec![0.1; 3], tool, goal, Pose::identity()).unwrap()
}

#[test]
fn fields_that_were_set_wrong_are_refused() {
    let changes: [fn(&mut KeypointProblem); 5] = [
        |p| p.q_start = vec![0.0],
        |p| p.q_start[1] = f64::NAN,
        |p| p.object_axis = 7,
        |p| p.options.velocity_limits = Some(vec![1.0]),
        |p| p.options.velocity_scale = 1e-30,
    ];
    for change in changes {
        let mut wrong = problem();
        change(&mut wrong);
        let plan = plan(&wrong);
        assert_eq!(plan.status, Status::ActuationInfeasible);
        assert!(plan.trajectory.is_none() && plan.q_actuation.is_none(), "{}", plan.reason);
        assert!(ik(&wrong, 3).is_err());
    }
}

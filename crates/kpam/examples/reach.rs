//! Plans a motion of a Panda arm to a handle: `cargo run --release -p gensim2-kpam --example reach -- panda_v2.urdf`.

use std::sync::Arc;

use gensim2_geometry::Robot;
use gensim2_kpam::config::{Constraint, Motion};
use gensim2_kpam::{KeypointProblem, SolverConfig, plan};
use nalgebra::Vector3;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let urdf = std::env::args().nth(1).ok_or("usage: reach PANDA_URDF")?;
    let robot = Arc::new(Robot::from_urdf(&urdf, None, "panda_hand", None, &[], None)?);
    let config = SolverConfig::builder()
        .constraint(Constraint::point("tip", "handle", 0.001))
        .pre(Motion::Translate { axis: 2, distance: -0.1 })
        .post(Motion::Move(Vector3::new(0.0, 0.0, 0.06)))
        .build()?;
    let start = vec![0.0, -0.32, 0.0, -2.618, 0.0, 2.23, 0.785, 0.04, 0.04];
    let problem = KeypointProblem::builder(robot, config, start)
        .tool_keypoint("tip", Vector3::new(0.0, 0.0, 0.105))
        .object_keypoint("handle", Vector3::new(0.5, 0.2, 0.15))
        .build()?;
    let plan = plan(&problem);
    println!("{}: {}", plan.status().name(), plan.reason);
    for keyframe in &plan.keyframes {
        let time = keyframe.time.unwrap_or(f64::NAN);
        println!("  {:10} at {time:.2} s, hand at z = {:.3} m", keyframe.label, keyframe.hand[2][3]);
    }
    Ok(())
}

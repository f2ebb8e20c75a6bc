//! Keypoint constraints in, collision-free joint motion out.
//!
//! A [`KeypointProblem`] holds a robot, a [`SolverConfig`], keypoints, the object's joint and obstacles; [`plan`] finds
//! the cheapest actuation pose whose whole motion is reachable and free, and returns a [`Plan`] that says what was
//! solved and what was not. Metres, radians, seconds; poses are in the robot base frame. No function panics: what does
//! not fit is an error that names the field, or a plan's status.
//!
//! ```
//! use std::collections::BTreeMap;
//! use std::sync::Arc;
//!
//! use gensim2_geometry::{Pose, Robot};
//! use gensim2_kpam::config::{Constraint, Frame, Motion, TargetAxis};
//! use gensim2_kpam::{KeypointProblem, SolverConfig, Status, plan};
//! use nalgebra::Vector3;
//!
//! // Three sliding joints and a wrist that turns.
//! let joint = |name: &str, kind: &str, parent: &str, child: &str, axis: &str| {
//!     format!(
//!         r#"<link name="{child}"/><joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
//!         <axis xyz="{axis}"/><limit lower="-2" upper="2" effort="1" velocity="0.5"/></joint>"#
//!     )
//! };
//! let urdf = [
//!     r#"<robot name="gantry"><link name="base"/>"#.to_owned(),
//!     joint("x", "prismatic", "base", "bridge", "1 0 0"),
//!     joint("y", "prismatic", "bridge", "carriage", "0 1 0"),
//!     joint("z", "prismatic", "carriage", "column", "0 0 1"),
//!     joint("wrist", "revolute", "column", "hand", "0 0 1"),
//!     "</robot>".to_owned(),
//! ]
//! .concat();
//! let robot = Arc::new(Robot::from_urdf_str(&urdf, "gantry.urdf", None, "hand", None)?);
//!
//! // The fingertip on the handle, the finger along y within 0.01 rad; there from above, and straight up after.
//! let along_y = TargetAxis::Fixed { axis: Vector3::y(), frame: Frame::World };
//! let config = SolverConfig::builder()
//!     .constraint(Constraint::point("tip", "handle", 0.001))
//!     .constraint(Constraint::axis("palm", "tip", along_y, 1.0, 0.01))
//!     .pre(Motion::Move(Vector3::new(0.0, 0.0, 0.1)))
//!     .post(Motion::Move(Vector3::new(0.0, 0.0, 0.2)))
//!     .build()?;
//! let tool = BTreeMap::from([("palm".to_owned(), Vector3::zeros()), ("tip".to_owned(), Vector3::new(0.1, 0.0, 0.0))]);
//! let handle = BTreeMap::from([("handle".to_owned(), Vector3::new(0.4, 0.3, 0.2))]);
//! let problem = KeypointProblem::new(robot, config, vec![0.0; 4], tool, handle, Pose::identity())?;
//!
//! let plan = plan(&problem);
//! assert_eq!(plan.status, Status::Solved, "{}", plan.reason);
//! let labels: Vec<&str> = plan.keyframes.iter().map(|k| k.label.as_str()).collect();
//! assert_eq!(labels, ["pre_0", "actuation", "post_0"]);
//! let trajectory = plan.trajectory.ok_or("solved plans have a trajectory")?;
//! let end = trajectory.sample(trajectory.end());
//! assert!((end.position[2] - 0.4).abs() < 0.002 && end.velocity.iter().all(|v| *v == 0.0));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod actuation;
mod cancel;
pub mod config;
mod default_limits;
#[cfg(test)]
mod derivatives;
mod error;
mod fingers;
mod free_space;
pub mod grasp;
mod hand_path;
mod joint_map;
mod ldl;
mod model;
mod motion;
pub mod options;
mod plan;
mod problem;
pub mod qp;
mod refine;
mod resolve;
mod timing;
mod world;

pub use cancel::Cancel;
pub use config::{Gripper, SolverConfig, SolverConfigBuilder};
pub use error::{ConfigError, ProblemError};
pub use grasp::{Grasp, GraspOptions, ParallelGripper, grasps};
pub use model::{MOST_JOINTS, Row};
pub use options::Options;
pub use plan::{
    Collision, IkSolution, KeyframeReport, MOST_CHECKS, MOST_THREADS, Plan, Request, Residual, StageTimes, Status,
    TriedPose, ik, joint_travel, min_clearance, plan, plan_batch, plan_timed, plan_with,
};
pub use problem::{Body, KeypointProblem, ObjectJoint, ObjectJointKind, Role};
pub use refine::{RefineOptions, Refined, refine};
pub use timing::{CannotStop, Limits, Method, RetimeOptions, Retimed, Sample, Trajectory, retime};
pub use world::{Bodies, Checker, Nearness, Scene, SceneJoint};

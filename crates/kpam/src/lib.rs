//! Keypoint constraints in, collision-free joint motion out.
//!
//! A [`KeypointProblem`] holds a robot, a [`SolverConfig`], keypoints, the object's joint and obstacles; [`plan`] finds
//! the cheapest actuation pose whose whole motion is reachable and free, and returns a [`Plan`] that says what was
//! solved and what was not. Metres, radians, seconds; poses are in the robot base frame.

mod actuation;
mod collision_check;
pub mod config;
mod contact;
mod curve;
mod error;
mod free_space;
pub mod grasp;
mod hand_path;
mod ldl;
mod margins;
pub mod model;
mod motion;
pub mod options;
mod plan;
mod problem;
pub mod qp;
mod trajectory;

pub use collision_check::CollisionCheck;
pub use config::{Gripper, SolverConfig};
pub use error::{ConfigError, ProblemError};
pub use grasp::{Grasp, GraspOptions, ParallelGripper, grasps};
pub use options::Options;
pub use plan::{
    Collision, KeyframeReport, Plan, Residual, StageTimes, Status, min_clearance, plan, plan_batch, plan_timed,
};
pub use problem::{Body, KeypointProblem, ObjectJoint, ObjectJointKind, Role};
pub use trajectory::{Sample, Trajectory};

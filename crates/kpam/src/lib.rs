//! Keypoint constraints in, collision-free joint motion out.
//!
//! A [`KeypointProblem`] holds a robot, a [`SolverConfig`], keypoints, the object's joint and obstacles; [`plan`] finds
//! the cheapest actuation pose whose whole motion is reachable and free, and returns a [`Plan`] that says what was
//! solved and what was not. Metres, radians, seconds; poses are in the robot base frame.

mod actuation;
mod cancel;
mod collision_check;
pub mod config;
mod contact;
mod curve;
mod default_limits;
mod error;
mod fingers;
mod free_space;
mod hand_path;
mod joint_map;
mod ldl;
mod margins;
pub mod model;
mod motion;
pub mod options;
mod plan;
mod problem;
pub mod qp;
mod resolve;
mod trajectory;

pub use cancel::Cancel;
pub use collision_check::CollisionCheck;
pub use config::{Gripper, SolverConfig};
pub use error::{ConfigError, ProblemError};
pub use options::Options;
pub use plan::{
    Collision, KeyframeReport, MOST_CHECKS, MOST_THREADS, Plan, Residual, StageTimes, Status, min_clearance, plan,
    plan_batch, plan_timed,
};
pub use problem::{Body, KeypointProblem, ObjectJoint, ObjectJointKind, Role};
pub use trajectory::{Sample, Trajectory};

//! Keypoint constraints in, collision-free joint motion out.
//!
//! A [`KeypointProblem`] holds a robot, a [`SolverConfig`], keypoints, the object's joint and obstacles; [`plan`] finds
//! the cheapest actuation pose whose whole motion is reachable and free, and returns a [`Plan`] that says what was
//! solved and what was not. Metres, radians, seconds; poses are in the robot base frame.

mod actuation;
mod cancel;
pub mod config;
mod default_limits;
mod error;
mod fingers;
mod free_space;
pub mod grasp;
mod hand_path;
mod joint_map;
mod ldl;
pub mod model;
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
pub use config::{Gripper, SolverConfig};
pub use error::{ConfigError, ProblemError};
pub use grasp::{Grasp, GraspOptions, ParallelGripper, grasps};
pub use options::Options;
pub use plan::{
    Collision, IkSolution, KeyframeReport, MOST_CHECKS, MOST_THREADS, Plan, Request, Residual, StageTimes, Status,
    TriedPose, ik, joint_travel, min_clearance, plan, plan_batch, plan_timed, plan_with,
};
pub use problem::{Body, KeypointProblem, ObjectJoint, ObjectJointKind, Role};
pub use refine::{RefineOptions, Refined, refine};
pub use timing::{CannotStop, Limits, Method, RetimeOptions, Retimed, Sample, Trajectory, retime};
pub use world::{Bodies, Checker, Nearness, Scene, SceneJoint};

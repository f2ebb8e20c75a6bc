//! Motion planning from keypoint constraints to collision-free joint motions.
//!
//! A [`KeypointProblem`] holds a robot, a [`SolverConfig`], keypoints, the object's joint and obstacles; [`plan`] finds
//! the cheapest actuation pose whose whole motion is reachable and collision-free, and returns a [`Plan`] with the
//! motion or the reason of the failure. Metres, radians, seconds; poses are in the robot base frame. No function
//! panics: invalid input is an error that names the field, and a failed plan has a status.
//!
//! The actuation pose `q` solves
//!
//! ```text
//! minimize    (q - q0)' W (q - q0) + |p(q) - p(q0)|^2 + 1 - cos(angle(R(q0), R(q))) + costs of the config
//! subject to  lower <= q <= upper
//!             |p_tool(q) - p_target| <= tolerance, by coordinate            for each point constraint
//!             |angle(a_tool(q), a_target) - arccos(d)| <= tolerance         for each axis constraint
//! ```
//!
//! with `q0` the start, `W` the joint weights, `p` and `R` the hand's origin and orientation. The motion through it is
//! the fastest found within velocity, acceleration, jerk and torque limits, and keeps a margin from all obstacles.
//!
//! ```
//! use std::sync::Arc;
//!
//! use gensim2_geometry::{Joint, Link, Robot};
//! use gensim2_kpam::config::{Constraint, Frame, Motion, TargetAxis};
//! use gensim2_kpam::{KeypointProblem, SolverConfig, Status, plan};
//! use nalgebra::Vector3;
//!
//! // Three sliding joints and a wrist that turns.
//! let slide = |name: &str, axis| Joint::prismatic(name, axis).limits(-2.0, 2.0).velocity(0.5);
//! let turn = Joint::revolute("wrist", Vector3::z()).limits(-2.0, 2.0).velocity(0.5);
//! let robot = Robot::builder("gantry")
//!     .link(Link::base("base"))
//!     .link(Link::below("base", "bridge").moved_by(slide("x", Vector3::x())))
//!     .link(Link::below("bridge", "carriage").moved_by(slide("y", Vector3::y())))
//!     .link(Link::below("carriage", "column").moved_by(slide("z", Vector3::z())))
//!     .link(Link::below("column", "hand").moved_by(turn))
//!     .build("hand")?;
//!
//! // Put the fingertip on the handle with the finger along y; approach from above, and lift afterwards.
//! let along_y = TargetAxis::Fixed { axis: Vector3::y(), frame: Frame::World };
//! let config = SolverConfig::builder()
//!     .constraint(Constraint::point("tip", "handle", 0.001))
//!     .constraint(Constraint::axis("palm", "tip", along_y, 1.0, 0.01))
//!     .pre(Motion::Move(Vector3::new(0.0, 0.0, 0.1)))
//!     .post(Motion::Move(Vector3::new(0.0, 0.0, 0.2)))
//!     .build()?;
//! let problem = KeypointProblem::builder(Arc::new(robot), config, vec![0.0; 4])
//!     .tool_keypoint("palm", Vector3::zeros())
//!     .tool_keypoint("tip", Vector3::new(0.1, 0.0, 0.0))
//!     .object_keypoint("handle", Vector3::new(0.4, 0.3, 0.2))
//!     .build()?;
//!
//! let plan = plan(&problem);
//! assert_eq!(plan.status(), Status::Solved, "{}", plan.reason);
//! let labels: Vec<&str> = plan.keyframes.iter().map(|k| k.label.as_str()).collect();
//! assert_eq!(labels, ["pre_0", "actuation", "post_0"]);
//! let trajectory = plan.trajectory().ok_or("solved plans have a trajectory")?;
//! let end = trajectory.sample(trajectory.end());
//! assert!((end.position[2] - 0.4).abs() < 0.002 && end.velocity.iter().all(|v| *v == 0.0));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod actuation;
mod body;
mod cancel;
pub mod config;
mod default_limits;
#[cfg(test)]
mod derivatives;
mod error;
mod fingers;
pub mod grasp;
mod hand_path;
mod joint_map;
mod ldl;
mod model;
mod motion;
mod object_joint;
pub mod options;
mod parallel;
mod plan;
mod problem;
pub mod qp;
mod refine;
mod resolve;
mod servo;
mod timing;
mod transit;
mod world;

pub use body::{Body, BodyBuilder, Role};
pub use cancel::Cancel;
pub use config::{Gripper, SolverConfig, SolverConfigBuilder};
pub use error::{ConfigError, ProblemError};
pub use grasp::{Grasp, GraspOptions, GraspPlan, GraspTask, ParallelGripper};
pub use model::{MAX_JOINTS, Row};
pub use object_joint::{ObjectJoint, ObjectJointKind};
pub use options::Options;
pub use parallel::MAX_THREADS;
pub use plan::{
    Collision, Guess, IkSolution, KeyframeReport, Lack, MAX_CHECKS, Outcome, Plan, Request, Residual, StageTimes,
    Status, Tight, Touch, TriedPose, ik, joint_travel, min_clearance, plan, plan_batch, plan_timed, plan_with,
};
pub use problem::{KeypointProblem, KeypointProblemBuilder};
pub use refine::{RefineOptions, Refined, refine};
pub use servo::{Servo, ServoLimit, ServoOptions, ServoStatus, ServoStep, Target};
pub use timing::{
    Braking, CannotStop, Limits, Overload, RetimeOptions, Retimed, Sample, SpeedScale, Trajectory, retime,
};
pub use transit::{
    Approached, Goal, IkOptions, MAX_SOLUTIONS, Motion, NoMotion, PathTolerance, TimedMotion, TransitOptions,
    plan_along, plan_to, plan_to_many, solutions,
};
pub use world::{Bodies, Checker, Nearness, Scene, SceneJoint};

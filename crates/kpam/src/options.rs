//! What a problem may set beside the config.

use serde::{Deserialize, Serialize};

/// How keyframes get their times.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Timing {
    /// As fast as velocity, acceleration and jerk limits allow.
    Limits,
    /// On the config's clock.
    Config,
}

/// How list-type translations after the actuation are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Frames {
    /// In the hand frame.
    Object,
    /// In the hand frame turned by the object's yaw about the hand's z axis.
    Original,
}

/// How "rotate" moves the hand between its keyframes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RotatePath {
    /// On the arc about the object's axis.
    Arc,
    /// On the straight line between the ends.
    Chord,
}

/// Bodies that may overlap for a while.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ContactWindow {
    /// Links of the robot.
    pub links: Vec<String>,
    /// Bodies of the scene.
    pub bodies: Vec<String>,
    /// First keyframe of the window (in time: `start`, ..., `pre_1`, `pre_0`, `actuation`, `post_0`, ...).
    pub from: String,
    /// Last keyframe of the window, or `end`.
    pub to: String,
}

/// Options of a problem. Fields that are not set take the defaults below; unknown fields are refused.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Options {
    /// Keyframe times; by default the config's clock where it sets times, else the limits.
    pub timing: Option<Timing>,
    /// Time of the first waypoint (s), on the config's clock.
    pub start_time: f64,
    /// Fraction of the velocity limits, 0..1.
    pub velocity_scale: f64,
    /// Fraction of the acceleration and jerk limits, 0..1.
    pub acceleration_scale: f64,
    /// Velocity limits (rad/s or m/s) a full joint; by default the URDF's.
    pub velocity_limits: Option<Vec<f64>>,
    /// Acceleration limits (rad/s^2) a full joint; by default Franka's for seven-joint arms, else 10.
    pub acceleration_limits: Option<Vec<f64>>,
    /// Jerk limits (rad/s^3) a full joint; by default Franka's for seven-joint arms, else 5,000.
    pub jerk_limits: Option<Vec<f64>>,
    /// Velocity at the start, a full joint; by default at rest.
    pub start_velocity: Option<Vec<f64>>,
    /// Reading of list-type post-actuation translations.
    pub frames: Frames,
    /// Path of "rotate".
    pub rotate_path: RotatePath,
    /// Number of start values of the actuation pose, the present joints included.
    pub seeds: usize,
    /// Box of the hand's origin at the actuation pose: lower and upper corner in the base frame (m); null for none.
    pub workspace: Option<[[f64; 3]; 2]>,
    /// Clearance kept on the free approach (m). Where start or goal are nearer to something, that is kept instead.
    pub margin: f64,
    /// Take the longest part of the motion where the whole is out of reach or blocked after the actuation pose.
    pub allow_partial: bool,
    /// Value of the finger joints (those below the hand) during the motion (m or rad), within their limits; mimic joints
    /// among them follow. By default as in `q_start`.
    pub finger_width: Option<f64>,
    /// Most actuation poses that are tried for the whole motion.
    pub candidates: usize,
    /// Further start values that are spent where no pose from `seeds` allows the whole motion.
    pub harvest: usize,
    /// Most samples of the free-space planner a candidate.
    pub samples: usize,
    /// Whether collisions decide. Without, they are only reported.
    pub avoid_collisions: bool,
    /// Contact windows in place of the default rules; null for those.
    pub contacts: Option<Vec<ContactWindow>>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            timing: None,
            start_time: 0.0,
            velocity_scale: 0.5,
            acceleration_scale: 0.5,
            velocity_limits: None,
            acceleration_limits: None,
            jerk_limits: None,
            start_velocity: None,
            frames: Frames::Object,
            rotate_path: RotatePath::Arc,
            seeds: 48,
            workspace: Some([[0.05, -1.0, 0.0], [1.0, 1.0, 1.0]]),
            margin: 0.005,
            allow_partial: false,
            finger_width: None,
            candidates: 40,
            harvest: 200,
            samples: 2000,
            avoid_collisions: true,
            contacts: None,
        }
    }
}

//! Targets and results of steps.

use gensim2_geometry::Pose;

/// Target of a step. Velocities are linear (m/s) and angular (rad/s), in the base frame.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Target {
    /// A pose of the link in the base frame, and the velocity of this pose.
    Pose {
        /// Pose of the link.
        pose: Pose,
        /// Velocity of the pose; zero if it does not move.
        twist: [f64; 6],
    },
    /// A velocity of the link.
    Twist([f64; 6]),
    /// Values of all joints (rad or m).
    Joints(Vec<f64>),
    /// Rest, as soon as the limits allow.
    Rest,
}

/// How a step was chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ServoStatus {
    /// The arm moves as the target asks.
    Tracking,
    /// Limits or obstacles change the motion that the target asks for.
    Limited,
    /// No step toward the target was proven safe; the arm follows the stop that was proven last.
    Braking,
}

/// A limit that determines a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ServoLimit {
    /// The velocity limit of a joint, by its index in the joint vector.
    Velocity(usize),
    /// The acceleration or jerk limit of a joint.
    Acceleration(usize),
    /// The range of a joint, or a velocity limit that depends on its position.
    Position(usize),
    /// The distance of two bodies, by their indices in [`Servo::body_name`](crate::Servo::body_name).
    Distance(usize, usize),
}

/// State of the arm after a step.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct ServoStep {
    /// Positions of all joints (rad or m).
    pub position: Vec<f64>,
    /// Velocities of all joints (rad/s or m/s).
    pub velocity: Vec<f64>,
    /// Accelerations of all joints (rad/s^2 or m/s^2).
    pub acceleration: Vec<f64>,
    /// How the step was chosen.
    pub status: ServoStatus,
    /// Limits that determine the step.
    pub limited_by: Vec<ServoLimit>,
    /// Smallest signed distance (m) over all checked pairs before the step; infinite if it is above 80 mm.
    pub distance: f64,
}

//! Options of servoing.

use crate::Options;
use crate::options::LimitSet;

/// Options of servoing.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct ServoOptions {
    /// Link that follows poses and twists; the hand if `None`.
    pub link: Option<String>,
    /// Minimum distance (m) between the bodies of each checked pair, 5 mm by default. A pair that is closer at the start
    /// keeps the smaller distance. Links whose shapes [prevent the
    /// margin](gensim2_geometry::Robot::is_often_close) must only not collide.
    pub margin: f64,
    /// Joint values (rad or m, one for each joint) that a redundant arm moves toward as long as the link does not move;
    /// default: the start.
    pub posture: Option<Vec<f64>>,
    /// Length of a step (s).
    pub dt: f64,
    /// Fraction of the velocity limits that may be used.
    pub velocity_scale: f64,
    /// Fraction of the acceleration and jerk limits that may be used.
    pub acceleration_scale: f64,
    /// Acceleration and jerk limits of a known arm.
    pub limits: Option<LimitSet>,
    /// Velocity limits (rad/s or m/s), one entry for each joint; default: the URDF's.
    pub velocity_limits: Option<Vec<f64>>,
    /// Acceleration limits (rad/s^2 or m/s^2), one entry for each joint; default: the URDF's, else those of `limits`.
    pub acceleration_limits: Option<Vec<f64>>,
    /// Jerk limits (rad/s^3 or m/s^3), one entry for each joint; default: the URDF's, else those of `limits`.
    pub jerk_limits: Option<Vec<f64>>,
}

impl Default for ServoOptions {
    fn default() -> Self {
        Self {
            link: None,
            margin: 0.005,
            posture: None,
            dt: 1e-3,
            velocity_scale: 1.0,
            acceleration_scale: 1.0,
            limits: None,
            velocity_limits: None,
            acceleration_limits: None,
            jerk_limits: None,
        }
    }
}

impl ServoOptions {
    /// Returns the limits as [`Options`] of a keypoint problem.
    pub(super) fn asked(&self) -> Options {
        Options {
            velocity_scale: self.velocity_scale,
            acceleration_scale: self.acceleration_scale,
            limits: self.limits,
            velocity_limits: self.velocity_limits.clone(),
            acceleration_limits: self.acceleration_limits.clone(),
            jerk_limits: self.jerk_limits.clone(),
            ..Options::default()
        }
    }
}

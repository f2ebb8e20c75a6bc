//! Inputs shared by tests of several modules.

use super::{Limits, RetimeOptions, Trajectory, retime};
use crate::model::{MAX_JOINTS, Row};

/// Returns a row whose first entries are `values`.
pub(crate) fn row(values: &[f64]) -> Row {
    let mut out = [0.0; MAX_JOINTS];
    out[..values.len()].copy_from_slice(values);
    out
}

/// Returns a motion of two joints that reverses three times.
pub(crate) fn wavy(limits: &Limits) -> Trajectory {
    let waypoints: Vec<Vec<f64>> = vec![vec![0.0, 0.0], vec![0.8, 0.5], vec![1.5, -0.2], vec![2.0, 0.4]];
    retime(&waypoints, limits, &RetimeOptions::default()).unwrap().trajectory
}

/// Returns the fastest motion to `goal` from the state that `motion` has at `time`.
pub(crate) fn going_on(motion: &Trajectory, time: f64, goal: &[f64]) -> Trajectory {
    let now = motion.sample(time);
    let options = RetimeOptions {
        start_velocity: Some(now.velocity),
        start_acceleration: Some(now.acceleration),
        start_time: time,
        ..RetimeOptions::default()
    };
    retime(&[now.position, goal.to_vec()], motion.limits(), &options).unwrap().trajectory
}

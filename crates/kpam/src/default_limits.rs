//! Acceleration and jerk limits where none are given: a URDF holds neither.

use crate::ProblemError;
use crate::model::{MOST_JOINTS, Model, Row};
use crate::options::{LimitSet, Options};

/// Of a joint that nothing is known of (rad/s^2 or m/s^2, and rad/s^3 or m/s^3); Franka's Research 3 has the same.
const ACCELERATION: f64 = 10.0;
const JERK: f64 = 5000.0;
/// The same in words.
pub(crate) const ASSUMED: &str = "10 rad/s^2, 5,000 rad/s^3";
/// As Franka publishes them for the Panda.
const PANDA_ACCELERATION: [f64; 7] = [15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0];
const PANDA_JERK: [f64; 7] = [7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10_000.0, 10_000.0];

/// Acceleration and jerk limits of the variables that hold where the options give none.
pub(crate) fn default_limits(options: &Options) -> (Row, Row) {
    let (mut acceleration, mut jerk) = ([ACCELERATION; MOST_JOINTS], [JERK; MOST_JOINTS]);
    if options.limits == Some(LimitSet::Panda) {
        acceleration[..7].copy_from_slice(&PANDA_ACCELERATION);
        jerk[..7].copy_from_slice(&PANDA_JERK);
    }
    (acceleration, jerk)
}

/// Names of the limits that nothing is known of and that are assumed.
pub(crate) fn assumed_limits(options: &Options) -> Vec<String> {
    let given = [("acceleration", &options.acceleration_limits), ("jerk", &options.jerk_limits)];
    let open = given.into_iter().filter(|(_, list)| options.limits.is_none() && list.is_none());
    open.map(|(name, _)| name.to_owned()).collect()
}

/// Refuses the Panda's limits for an arm that has not its seven joints.
pub(crate) fn check_limit_set(model: &Model, options: &Options) -> Result<(), ProblemError> {
    if options.limits == Some(LimitSet::Panda) && model.n() != 7 {
        let message = format!("\"panda\" is for 7 joints, and {} move the hand; leave it out", model.n());
        return Err(ProblemError::new("options.limits", message));
    }
    Ok(())
}

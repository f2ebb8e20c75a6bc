//! Acceleration and jerk limits where none are given: a URDF holds neither.

use gensim2_geometry::Robot;

use crate::ProblemError;
use crate::model::{MOST_JOINTS, Model, Row};
use crate::options::{LimitSet, Options};

/// Of a joint that nothing is known of (rad/s^2 or m/s^2, and rad/s^3 or m/s^3); Franka's Research 3 has the same.
const ACCELERATION: f64 = 10.0;
const JERK: f64 = 5000.0;
/// As Franka publishes them for the Panda.
const PANDA_ACCELERATION: [f64; 7] = [15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0];
const PANDA_JERK: [f64; 7] = [7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10_000.0, 10_000.0];

/// Acceleration and jerk limits of the variables that hold where the options give none.
pub(crate) fn default_limits(robot: &Robot, model: &Model, options: &Options) -> (Row, Row) {
    let panda = match options.limits {
        Some(LimitSet::Panda) => true,
        Some(LimitSet::Plain) => false,
        None => is_panda(robot, model),
    };
    let (mut acceleration, mut jerk) = ([ACCELERATION; MOST_JOINTS], [JERK; MOST_JOINTS]);
    if panda {
        acceleration[..7].copy_from_slice(&PANDA_ACCELERATION);
        jerk[..7].copy_from_slice(&PANDA_JERK);
    }
    (acceleration, jerk)
}

/// Whether the planned joints are named as Franka names those of the Panda (`panda_joint1` or, later, `fer_joint1` to
/// `..7`), whatever stands before that.
fn is_panda(robot: &Robot, model: &Model) -> bool {
    let names = model.map().indices().iter().map(|j| robot.joints()[*j].name());
    let named =
        |(k, name): (usize, &str)| ["panda", "fer"].iter().any(|arm| name.ends_with(&format!("{arm}_joint{}", k + 1)));
    model.n() == 7 && names.enumerate().all(named)
}

/// Refuses the Panda's limits for an arm that has not its seven joints.
pub(crate) fn check_limit_set(model: &Model, options: &Options) -> Result<(), ProblemError> {
    if options.limits == Some(LimitSet::Panda) && model.n() != 7 {
        let message = format!("\"panda\" is for 7 joints, and {} move the hand; leave it out", model.n());
        return Err(ProblemError::new("options.limits", message));
    }
    Ok(())
}

//! Acceleration and jerk limits for robots without such limits in options and URDF; most URDFs have none.

use gensim2_geometry::Robot;

use crate::ProblemError;
use crate::model::{MAX_JOINTS, Model, Row};
use crate::options::{LimitSet, Options};
use crate::timing::{Braking, Envelope};

/// Default limits of acceleration (rad/s^2 or m/s^2) and jerk (rad/s^3 or m/s^3) for a joint without known limits. They
/// equal those of Franka's Research 3.
const ACCELERATION: f64 = 10.0;
const JERK: f64 = 5000.0;
/// The default acceleration limit as text for messages.
const ASSUMED_ACCELERATION: &str = "10 rad/s^2 or m/s^2";
const ASSUMED_JERK: &str = "5,000 rad/s^3 or m/s^3";
/// Acceleration limits (rad/s^2) and jerk limits (rad/s^3) that Franka publishes for the Panda.
const PANDA_ACCELERATION: [f64; 7] = [15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0];
const PANDA_JERK: [f64; 7] = [7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10_000.0, 10_000.0];

/// Limits that Franka publishes for the Research 3: maximum velocities (rad/s); and upper ends, lower ends, gains and
/// offsets of the position-dependent velocity limits.
const FR3_VELOCITY: [f64; 7] = [2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26];
const FR3_BRAKING: [[f64; 4]; 7] = [
    [2.7501, -2.7501, 12.0, 0.3],
    [1.7918, -1.7918, 5.17, 0.2],
    [2.9065, -2.9065, 7.0, 0.2],
    [-0.1458, -3.0481, 8.0, 0.3],
    [2.8101, -2.8101, 34.0, 0.35],
    [4.5205, 0.54092, 11.0, 0.35],
    [3.0196, -3.0196, 34.0, 0.35],
];

/// Returns the position-dependent velocity limits of the arm named in the options, if any.
pub(crate) fn braking(options: &Options) -> Option<Envelope> {
    let one = |[upper, lower, gain, offset]: [f64; 4]| Some(Braking { upper, lower, gain, offset });
    let list = FR3_BRAKING.map(one);
    (options.limits == Some(LimitSet::Fr3)).then(|| Envelope::new(list.len(), &list).ok()).flatten()
}

/// Returns the velocity limits of the arm named in the options, if any. They apply in addition to the URDF's.
pub(crate) fn greatest_velocity(options: &Options) -> Option<[f64; 7]> {
    (options.limits == Some(LimitSet::Fr3)).then_some(FR3_VELOCITY)
}

/// Returns the acceleration and jerk limits of the variables if the options give none: those of the URDF, otherwise
/// those of the arm named in the options, otherwise the defaults.
pub(crate) fn default_limits(model: &Model, options: &Options) -> (Row, Row) {
    let (mut acceleration, mut jerk) = ([ACCELERATION; MAX_JOINTS], [JERK; MAX_JOINTS]);
    if options.limits == Some(LimitSet::Panda) {
        acceleration[..7].copy_from_slice(&PANDA_ACCELERATION);
        jerk[..7].copy_from_slice(&PANDA_JERK);
    }
    let named = matches!(options.limits, Some(LimitSet::Panda | LimitSet::Fr3));
    for (usual, own) in [(&mut acceleration, &model.acceleration), (&mut jerk, &model.jerk)] {
        for (usual, own) in usual.iter_mut().zip(own) {
            *usual = if named || own.is_infinite() { usual.min(*own) } else { *own };
        }
    }
    (acceleration, jerk)
}

/// Returns the names of the limits for which defaults apply.
pub(crate) fn assumed_limits(model: &Model, options: &Options) -> Vec<String> {
    unknown_limits(model, options).into_iter().map(|(name, _)| name.to_owned()).collect()
}

/// Returns the names of the limits that neither options nor URDF give, each with the variables concerned.
fn unknown_limits(model: &Model, options: &Options) -> Vec<(&'static str, Vec<usize>)> {
    let known = [
        ("acceleration", &options.acceleration_limits, &model.acceleration),
        ("jerk", &options.jerk_limits, &model.jerk),
    ];
    let lacking = known.into_iter().filter(|(_, list, _)| options.limits.is_none() && list.is_none());
    let open = lacking.map(|(name, _, own)| (name, (0..model.n()).filter(|v| own[*v].is_infinite()).collect()));
    open.filter(|(_, joints): &(_, Vec<usize>)| !joints.is_empty()).collect()
}

/// Returns warnings about every motion of a robot: default limits, and links without collision checks.
pub(crate) fn warnings(robot: &Robot, model: &Model, options: &Options) -> Vec<String> {
    let mut out = Vec::new();
    for (name, variables) in unknown_limits(model, options) {
        let joint = |v: &usize| robot.joints()[model.map().indices()[*v]].name();
        let joints: Vec<_> = variables.iter().map(joint).collect();
        let assumed = if name == "jerk" { ASSUMED_JERK } else { ASSUMED_ACCELERATION };
        out.push(format!(
            "limits on {name} are assumed ({assumed}) for {}; set {name}_limits, or limits for a known arm",
            joints.join(", ")
        ));
    }
    let unchecked = robot.unchecked_pairs();
    if !unchecked.is_empty() {
        let links = robot.links();
        let names: Vec<_> =
            unchecked.iter().map(|(a, b)| format!("{} and {}", links[*a].name(), links[*b].name())).collect();
        out.push(format!(
            "not checked for collisions with each other, because they overlap in almost all configurations and there is no SRDF: {}",
            names.join(", ")
        ));
    }
    out
}

/// Returns the remedy for a collision of two bodies if both are links of the robot, otherwise an empty text.
pub(crate) fn links_may_touch(robot: &Robot, bodies: [&str; 2]) -> &'static str {
    if bodies.iter().all(|name| robot.link_index(name).is_some()) {
        "; if these links may touch, disable the pair in an SRDF, which robot.self_collisions writes"
    } else {
        ""
    }
}

/// Returns an error if the options name a seven-joint arm but the robot does not have seven joints.
pub(crate) fn check_limit_set(model: &Model, options: &Options) -> Result<(), ProblemError> {
    let name = match options.limits {
        Some(LimitSet::Panda) => "panda",
        Some(LimitSet::Fr3) => "fr3",
        Some(LimitSet::Plain) | None => return Ok(()),
    };
    if model.n() != 7 {
        let message = format!("{name:?} is for 7 joints, and {} move the hand; leave it out", model.n());
        return Err(ProblemError::new("options.limits", message));
    }
    Ok(())
}

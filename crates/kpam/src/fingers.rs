//! Finger joints: the moving joints of links below the hand. Planning keeps them fixed, at `finger_width` if given.

use gensim2_geometry::Robot;

use crate::{KeypointProblem, ProblemError};

/// Permitted excess (rad or m) over a finger's limits, for rounding.
const ROUNDING: f64 = 1e-6;

/// Returns the moving joints of the links below the hand.
fn finger_joints(robot: &Robot) -> Vec<usize> {
    let links = robot.links();
    let mut below = vec![false; links.len()];
    let mut out = Vec::new();
    for (l, link) in links.iter().enumerate() {
        below[l] = link.parent().is_some_and(|p| p == robot.hand() || below[p]);
        out.extend(link.joint().filter(|_| below[l]));
    }
    out
}

/// Returns the joint vector of the whole robot for planning. It equals `q_start`, except that `finger_width` (if given)
/// sets every independent finger joint and the joints that follow them.
///
/// # Errors
/// The robot has no finger joints, or the width exceeds the limits of one of them.
pub(crate) fn resting_joints(problem: &KeypointProblem) -> Result<Vec<f64>, ProblemError> {
    let mut rest = problem.q_start.clone();
    let Some(width) = problem.options.finger_width else { return Ok(rest) };
    let fail = |message: String| ProblemError::new("options.finger_width", message);
    let robot = &problem.robot;
    let fingers = finger_joints(robot);
    if fingers.is_empty() {
        let hand = &robot.links()[robot.hand()].name();
        return Err(fail(format!("is {width}, but no joint below {hand:?} moves; leave it out")));
    }
    for &finger in &fingers {
        let Some(drive) = robot.drive(finger).filter(|d| fingers.contains(&d.source)) else { continue };
        let value = drive.multiplier * width + drive.offset;
        let joint = &robot.joints()[finger];
        if value.is_nan() || value < joint.lower() - ROUNDING || value > joint.upper() + ROUNDING {
            let (lower, upper) = (joint.lower(), joint.upper());
            return Err(fail(format!("of {width} takes {} to {value}, outside [{lower}, {upper}]", joint.name())));
        }
        rest[finger] = value.clamp(joint.lower(), joint.upper());
    }
    Ok(rest)
}

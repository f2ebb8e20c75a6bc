//! Travel of the object's joint during a motion after the actuation.

use std::ops::Range;

use nalgebra::{Point3, Vector3};

use crate::config::Motion;
use crate::motion::HandPath;
use crate::{KeypointProblem, ObjectJoint, ObjectJointKind};

/// A contact point closer than this (m) to the axis of a revolute joint does not rotate the joint.
const ON_AXIS: f64 = 1e-3;

/// Returns the travel (rad or m) of the object's joint along each path after the actuation, if known. Motions that
/// follow or trace the joint define it, `options.joint_travel` defines it for all motions, and a hand that picks or
/// releases a body, or has released the object, does not move the joint.
pub(crate) fn joint_steps(problem: &KeypointProblem) -> Vec<Option<f64>> {
    let mut value = problem.joint.map_or(0.0, |j| j.value);
    let motions = problem.config.post.iter().enumerate();
    let busy = !(problem.options.pick.is_empty() && problem.options.release.is_empty());
    motions
        .map(|(i, motion)| {
            let step = match *motion {
                Motion::FollowJoint(step) | Motion::TraceJoint(step) => Some(step),
                Motion::FollowJointTo(openness) | Motion::TraceJointTo(openness) => {
                    problem.joint.map(|j| j.lower + openness * (j.upper - j.lower) - value)
                }
                Motion::Translate { .. } | Motion::Move(_) | Motion::Rotate(_) => {
                    let named = problem.options.joint_travel.as_ref().and_then(|travel| travel.get(i)).copied();
                    named.or(busy.then_some(0.0))
                }
            };
            value += step.unwrap_or(0.0);
            step
        })
        .chain(problem.config.let_go.map(|_| Some(0.0)))
        .collect()
}

/// Returns the travel of the object's joint along post-actuation path `post`, at the path fractions `done` (0..1,
/// increasing, closely spaced); `from` is the travel at the first of them.
///
/// If the travel is not defined, the joint moves as far as the contact point moves along or around the joint's axis,
/// within the joint's range.
pub(crate) fn travel_along(
    problem: &KeypointProblem,
    post: usize,
    path: &HandPath,
    from: f64,
    done: &[f64],
) -> Vec<f64> {
    let Some(joint) = &problem.joint else { return vec![0.0; done.len()] };
    let named = joint_steps(problem).get(post).copied().flatten();
    let contact = Point3::from(problem.contact_point());
    let begin = done.first().copied().unwrap_or(0.0);
    let mut last = path.at(begin) * contact;
    let mut gone = 0.0;
    done.iter()
        .map(|s| {
            let free = match named {
                Some(step) => step * (s - begin),
                None => {
                    let now = path.at(*s) * contact;
                    gone += carried(joint, &last.coords, &now.coords);
                    last = now;
                    gone
                }
            };
            within_range(joint, from + free)
        })
        .collect()
}

/// Returns the travel at the end of a part of a path, given the travel `from` at its start.
pub(crate) fn travel_over(problem: &KeypointProblem, post: usize, path: &HandPath, from: f64, part: Range<f64>) -> f64 {
    travel_along(problem, post, path, from, &even(&part, PLACES)).pop().unwrap_or(from)
}

/// Number of positions on a path from which the travel is estimated.
const PLACES: usize = 64;

/// Returns `count` evenly spaced path fractions over a part of a path.
pub(crate) fn even(part: &Range<f64>, count: usize) -> Vec<f64> {
    let steps = count.saturating_sub(1).max(1) as f64;
    (0..count).map(|k| part.start + (part.end - part.start) * k as f64 / steps).collect()
}

/// Returns the travel of the joint caused by a small displacement of the contact point.
fn carried(joint: &ObjectJoint, from: &Vector3<f64>, to: &Vector3<f64>) -> f64 {
    match joint.kind {
        ObjectJointKind::Prismatic => (to - from).dot(&joint.axis),
        ObjectJointKind::Revolute => {
            let across = |p: &Vector3<f64>| {
                let arm = p - joint.origin;
                arm - joint.axis * arm.dot(&joint.axis)
            };
            let (a, b) = (across(from), across(to));
            if a.norm() < ON_AXIS || b.norm() < ON_AXIS { 0.0 } else { a.cross(&b).dot(&joint.axis).atan2(a.dot(&b)) }
        }
    }
}

fn within_range(joint: &ObjectJoint, travel: f64) -> f64 {
    let (low, high) = (joint.lower.min(joint.value), joint.upper.max(joint.value));
    (joint.value + travel).clamp(low, high) - joint.value
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hinge(kind: ObjectJointKind) -> ObjectJoint {
        ObjectJoint::new(kind, Vector3::zeros(), Vector3::z(), 0.2, [0.0, 1.0]).unwrap()
    }

    #[test]
    fn a_contact_point_takes_the_joint_along() {
        let turn = |angle: f64| Vector3::new(angle.cos(), angle.sin(), 0.3);
        let along = carried(&hinge(ObjectJointKind::Revolute), &turn(0.1), &turn(0.15));
        assert!((along - 0.05).abs() < 1e-12, "{along}");
        let slide = carried(&hinge(ObjectJointKind::Prismatic), &turn(0.1), &(turn(0.4) + Vector3::z() * 0.07));
        assert!((slide - 0.07).abs() < 1e-12, "{slide}");
    }

    #[test]
    fn no_joint_leaves_its_range() {
        let joint = hinge(ObjectJointKind::Prismatic);
        assert!((within_range(&joint, 5.0) - 0.8).abs() < 1e-12);
        assert!((within_range(&joint, -5.0) + 0.2).abs() < 1e-12);
    }
}

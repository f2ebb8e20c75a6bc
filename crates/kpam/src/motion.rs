//! Computes hand poses at keyframes, and hand paths between them, from an actuation pose and the config.

use gensim2_geometry::{Pose, rotation_about, rotation_log, screw_about};
use nalgebra::{Rotation3, Translation3, Vector3};

use crate::config::Motion;
use crate::options::{Frames, RotatePath};
use crate::world::{Schedule, joint_steps};
use crate::{KeypointProblem, ObjectJointKind};

/// A named hand pose that the motion passes.
#[derive(Debug, Clone)]
pub(crate) struct Keyframe {
    pub label: String,
    pub hand: Pose,
}

/// Path of the hand between two keyframes.
#[derive(Debug, Clone, Copy)]
pub(crate) enum HandPath {
    /// The hand moves along a straight line and rotates uniformly.
    Line { from: Pose, to: Pose },
    /// The hand moves rigidly on an arc about the line through `point` along `axis`.
    Arc { from: Pose, point: Vector3<f64>, axis: Vector3<f64>, angle: f64 },
    /// The hand point `tip` moves on an arc about a line, while the hand keeps its orientation.
    Trace { from: Pose, tip: Vector3<f64>, point: Vector3<f64>, axis: Vector3<f64>, angle: f64 },
}

impl HandPath {
    /// Returns the hand pose at the parameter `s`, 0 to 1.
    pub fn at(&self, s: f64) -> Pose {
        match self {
            Self::Line { from, to } => {
                let turn = rotation_log(&(from.rotation.inverse() * to.rotation));
                let rotation =
                    if turn.norm() < 1e-12 { from.rotation } else { from.rotation * Rotation3::new(turn * s) };
                let t = from.translation.vector.lerp(&to.translation.vector, s);
                Pose::from_parts(Translation3::from(t), rotation)
            }
            Self::Arc { from, point, axis, angle } => screw_about(point, axis, angle * s) * from,
            Self::Trace { from, tip, point, axis, angle } => {
                let moved = screw_about(point, axis, angle * s) * nalgebra::Point3::from(*tip);
                shifted(from, &(moved.coords - tip))
            }
        }
    }

    /// Returns the length (m) of the path of the hand's origin, and the angle (rad) by which the hand rotates.
    pub fn length(&self) -> (f64, f64) {
        match self {
            Self::Line { from, to } => (
                (to.translation.vector - from.translation.vector).norm(),
                rotation_log(&(from.rotation.inverse() * to.rotation)).norm(),
            ),
            Self::Arc { from, point, axis, angle } => {
                let arm = from.translation.vector - point;
                ((arm - axis * arm.dot(axis)).norm() * angle.abs(), angle.abs())
            }
            Self::Trace { tip, point, axis, angle, .. } => {
                let arm = tip - point;
                ((arm - axis * arm.dot(axis)).norm() * angle.abs(), 0.0)
            }
        }
    }
}

/// Keyframes in time order (pre_{n-1}, ..., pre_0, actuation, post_0, ..., let_go), and hand paths between them. Path i
/// leads from keyframe i to keyframe i + 1.
#[derive(Clone)]
pub(crate) struct Motions {
    pub keyframes: Vec<Keyframe>,
    pub paths: Vec<HandPath>,
    pub actuation: usize,
    /// Index of the keyframe at which the hand releases the object at the end; `None` for no release.
    pub lets_go_at: Option<usize>,
}

impl Motions {
    /// Returns the hand pose at the release, if there is one.
    pub fn letting_go(&self) -> Option<&Pose> {
        self.lets_go_at.map(|k| &self.keyframes[k].hand)
    }
}

/// Returns keyframes and hand paths for a hand pose at the actuation.
pub(crate) fn motions(problem: &KeypointProblem, actuation: &Pose) -> Motions {
    let config = &problem.config;
    let schedule = Schedule::of(config);
    let before = schedule.actuation();
    let mut keyframes = vec![Keyframe { label: schedule.label(before), hand: *actuation }];
    let mut paths = Vec::new();
    // The config lists motions before the actuation from the actuation pose backwards in time.
    for (i, motion) in config.pre.iter().enumerate() {
        let next = keyframes[0].hand;
        let (hand, path) = match *motion {
            Motion::Rotate(angle) => {
                let (point, axis) = object_axis(problem);
                let hand = screw_about(&point, &axis, angle) * next;
                (hand, rotation_path(problem, HandPath::Arc { from: hand, point, axis, angle: -angle }))
            }
            Motion::Translate { axis, distance } => {
                let hand = shifted(&next, &(next.rotation * Vector3::ith(axis, distance)));
                (hand, HandPath::Line { from: hand, to: next })
            }
            Motion::Move(v) => {
                let hand = shifted(&next, &v);
                (hand, HandPath::Line { from: hand, to: next })
            }
            // Validation rejects configs with these motions before the actuation.
            Motion::FollowJoint(_) | Motion::FollowJointTo(_) | Motion::TraceJoint(_) | Motion::TraceJointTo(_) => {
                (next, HandPath::Line { from: next, to: next })
            }
        };
        keyframes.insert(0, Keyframe { label: schedule.label(before - 1 - i), hand });
        paths.insert(0, path);
    }
    let steps = joint_steps(problem);
    for (i, motion) in config.post.iter().enumerate() {
        let last = keyframes[keyframes.len() - 1].hand;
        let path = match *motion {
            Motion::Translate { axis, distance } => {
                let mut direction = Vector3::ith(axis, distance);
                if problem.options.frames == Frames::Original {
                    direction = rotation_about(&Vector3::z(), problem.object_yaw) * direction;
                }
                HandPath::Line { from: last, to: shifted(&last, &(last.rotation * direction)) }
            }
            Motion::Move(v) => HandPath::Line { from: last, to: shifted(&last, &v) },
            Motion::Rotate(angle) => {
                let (point, axis) = object_axis(problem);
                rotation_path(problem, HandPath::Arc { from: last, point, axis, angle })
            }
            Motion::FollowJoint(_) | Motion::FollowJointTo(_) => follow(problem, last, steps[i].unwrap_or(0.0), true),
            Motion::TraceJoint(_) | Motion::TraceJointTo(_) => follow(problem, last, steps[i].unwrap_or(0.0), false),
        };
        keyframes.push(Keyframe { label: schedule.label(keyframes.len()), hand: path.at(1.0) });
        paths.push(path);
    }
    if let Some(distance) = config.let_go {
        let from = keyframes[keyframes.len() - 1].hand;
        let hand = shifted(&from, &(from.rotation * Vector3::z() * -distance));
        keyframes.push(Keyframe { label: schedule.label(keyframes.len()), hand });
        paths.push(HandPath::Line { from, to: hand });
    }
    Motions { keyframes, paths, actuation: before, lets_go_at: schedule.lets_go_at() }
}

fn shifted(pose: &Pose, by: &Vector3<f64>) -> Pose {
    Pose::from_parts(Translation3::from(pose.translation.vector + by), pose.rotation)
}

fn object_axis(problem: &KeypointProblem) -> (Vector3<f64>, Vector3<f64>) {
    let axis = problem.object.rotation * Vector3::ith(problem.object_axis, 1.0);
    (problem.object.translation.vector, axis)
}

fn rotation_path(problem: &KeypointProblem, arc: HandPath) -> HandPath {
    match problem.options.rotate_path {
        RotatePath::Arc => arc,
        RotatePath::Chord => HandPath::Line { from: arc.at(0.0), to: arc.at(1.0) },
    }
}

/// Returns the hand path for the travel `value` of the object's joint. The hand moves rigidly with the joint if
/// `turning` is set; otherwise only its contact point follows the joint.
fn follow(problem: &KeypointProblem, from: Pose, value: f64, turning: bool) -> HandPath {
    match problem.joint {
        Some(j) if j.kind == ObjectJointKind::Revolute => {
            let (point, axis) = (j.origin, j.axis);
            if turning {
                return HandPath::Arc { from, point, axis, angle: value };
            }
            let tip = (from * nalgebra::Point3::from(problem.contact_point())).coords;
            HandPath::Trace { from, tip, point, axis, angle: value }
        }
        Some(j) => HandPath::Line { from, to: shifted(&from, &(j.axis * value)) },
        // Validation rejects a config that follows the object's joint if there is none, so this path is never used.
        None => HandPath::Line { from, to: from },
    }
}

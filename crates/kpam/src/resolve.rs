//! Turns the constraints of a problem into numbers: names become positions, and directions are converted to base axes.

use std::collections::BTreeMap;

use gensim2_geometry::Pose;
use nalgebra::Vector3;

use crate::config::{Constraint, Frame, TargetAxis};
use crate::{KeypointProblem, ObjectJointKind, ProblemError};

impl KeypointProblem {
    fn tool(&self, name: &str) -> Result<Vector3<f64>, ProblemError> {
        look_up(&self.tool_keypoints, "tool_keypoints", name)
    }

    fn target(&self, name: &str) -> Result<Vector3<f64>, ProblemError> {
        look_up(&self.object_keypoints, "object_keypoints", name)
    }

    /// Returns the axes of a frame as the columns of a matrix in the base frame.
    fn axes(&self, frame: Frame, field: &str) -> Result<nalgebra::Matrix3<f64>, ProblemError> {
        match frame {
            Frame::World => Ok(*self.world.rotation.matrix()),
            Frame::Object => Ok(*self.object.rotation.matrix()),
            Frame::Joint => self.joint_frame(field),
        }
    }

    /// Returns the joint frame at the config's target keypoint; columns are its axes x, y, z in the base frame.
    fn joint_frame(&self, field: &str) -> Result<nalgebra::Matrix3<f64>, ProblemError> {
        let joint = self
            .joint
            .ok_or_else(|| ProblemError::new("joint", format!("is missing, but {field} uses the joint frame")))?;
        let (y, z) = match joint.kind {
            ObjectJointKind::Prismatic => {
                let up = self.world.rotation * Vector3::z();
                let side = self.world.rotation * Vector3::x();
                let across = |v: Vector3<f64>| v - joint.axis * v.dot(&joint.axis);
                let z = if across(up).norm() > 1e-3 { across(up) } else { across(side) };
                (joint.axis, z.normalize())
            }
            ObjectJointKind::Revolute => {
                let name = self.config.target_keypoint().ok_or_else(|| {
                    ProblemError::new(field, "uses the joint frame, whose origin needs a point2point_constraint")
                })?;
                let arm = self.target(name)? - joint.origin;
                let y = joint.axis.cross(&arm);
                if y.norm() < 1e-6 {
                    let message =
                        format!("lies on the joint's axis, where the joint frame of {field} has no direction");
                    return Err(ProblemError::new(format!("object_keypoints[{name:?}]"), message));
                }
                (y.normalize(), joint.axis)
            }
        };
        Ok(nalgebra::Matrix3::from_columns(&[y.cross(&z), y, z]))
    }

    /// Returns the target (m, base frame) of each point constraint in the order of the config: the keypoint of the
    /// object, shifted by the offset.
    pub fn point_targets(&self) -> Result<Vec<Vector3<f64>>, ProblemError> {
        Ok(self.resolve()?.points.iter().map(|point| point.target).collect())
    }

    /// Returns the constraints with numbers in place of names and frames.
    pub(crate) fn resolve(&self) -> Result<Resolved, ProblemError> {
        let mut out = Resolved::default();
        for (i, c) in self.config.constraints.iter().enumerate() {
            let field = format!("constraint_list[{i}]");
            match c {
                Constraint::Point { keypoint, target, offset, frame, tolerance } => {
                    let shift = self.axes(*frame, &field)? * offset;
                    out.points.push(PointBound {
                        entry: i,
                        on_hand: self.tool(keypoint)?,
                        target: self.target(target)? + shift,
                        tolerance: *tolerance,
                    });
                }
                Constraint::Axis { from, to, target, inner, tolerance, .. } => {
                    let mine = direction(self.tool(to)? - self.tool(from)?, "tool_keypoints", from, to)?;
                    let theirs = match target {
                        TargetAxis::Fixed { axis, frame } => self.axes(*frame, &field)? * axis,
                        TargetAxis::Keypoints { from, to } => {
                            direction(self.target(to)? - self.target(from)?, "object_keypoints", from, to)?
                        }
                    };
                    let center = inner.acos();
                    out.axes.push(AxisBound {
                        entry: i,
                        on_hand: mine,
                        target: theirs.normalize(),
                        center,
                        tolerance: *tolerance,
                    });
                }
                Constraint::PointCost { keypoint, target, weight } => {
                    for k in 0..3 {
                        out.costs.push(PlaneTerm {
                            on_hand: self.tool(keypoint)?,
                            target: self.target(target)?,
                            normal: Vector3::ith(k, 1.0),
                            weight: *weight,
                        });
                    }
                }
                Constraint::PlaneCost { keypoint, target, normal, frame, weight } => {
                    out.costs.push(PlaneTerm {
                        on_hand: self.tool(keypoint)?,
                        target: self.target(target)?,
                        normal: (self.axes(*frame, &field)? * normal).normalize(),
                        weight: *weight,
                    });
                }
            }
        }
        Ok(out)
    }
}

fn look_up(map: &BTreeMap<String, Vector3<f64>>, field: &str, name: &str) -> Result<Vector3<f64>, ProblemError> {
    map.get(name).copied().ok_or_else(|| {
        let known: Vec<&str> = map.keys().map(String::as_str).take(30).collect();
        ProblemError::new(field, format!("has no {name:?}, which the config names; it has {}", known.join(", ")))
    })
}

fn direction(v: Vector3<f64>, field: &str, from: &str, to: &str) -> Result<Vector3<f64>, ProblemError> {
    let length = v.norm();
    if length > 1e-6 {
        return Ok(v / length);
    }
    Err(ProblemError::new(field, format!("{from:?} and {to:?} coincide, so the axis between them has no direction")))
}

/// A point of the hand that must lie in a box.
#[derive(Debug, Clone)]
pub(crate) struct PointBound {
    pub entry: usize,
    pub on_hand: Vector3<f64>,
    pub target: Vector3<f64>,
    pub tolerance: f64,
}

/// A direction of the hand whose angle from a fixed direction must lie in a range.
#[derive(Debug, Clone)]
pub(crate) struct AxisBound {
    pub entry: usize,
    pub on_hand: Vector3<f64>,
    pub target: Vector3<f64>,
    pub center: f64,
    pub tolerance: f64,
}

impl AxisBound {
    /// Returns the difference (rad) of the angle from the target angle.
    pub fn residual(&self, hand: &Pose) -> f64 {
        let a = hand.rotation * self.on_hand;
        (a.cross(&self.target).norm().atan2(a.dot(&self.target)) - self.center).abs()
    }
}

/// A cost: weight times the squared distance of a point of the hand from a plane.
#[derive(Debug, Clone)]
pub(crate) struct PlaneTerm {
    pub on_hand: Vector3<f64>,
    pub target: Vector3<f64>,
    pub normal: Vector3<f64>,
    pub weight: f64,
}

/// All constraints and costs of a problem, as numbers.
#[derive(Debug, Clone, Default)]
pub(crate) struct Resolved {
    pub points: Vec<PointBound>,
    pub axes: Vec<AxisBound>,
    pub costs: Vec<PlaneTerm>,
}

//! The problem: a robot, a config, keypoints, the object's joint, obstacles, options; checked once, here.

use std::collections::BTreeMap;
use std::sync::Arc;

use gensim2_geometry::{Convex, Pose, Robot};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::config::{Constraint, Frame, TargetAxis};
use crate::fingers::resting_joints;
use crate::model::Model;
use crate::{Options, ProblemError, SolverConfig};

/// What the default contact rules go by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// The table.
    Table,
    /// The part of the object that stands still.
    ObjectBody,
    /// The part that moves.
    MovingLink,
    /// Anything else.
    Rigid,
    /// A rigid object that the hand may touch: what it reaches for.
    Target,
    /// Rides on the hand; its pose is in the hand frame.
    Attached,
}

/// An obstacle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Body {
    /// Unique name.
    pub name: String,
    /// Role.
    pub role: Role,
    /// Convex shapes in the body frame.
    pub shapes: Vec<Convex>,
    /// Pose in the robot base frame; of an attached body, in the hand frame.
    pub pose: Pose,
}

/// Kind of the object's joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum ObjectJointKind {
    /// Turns (rad).
    Revolute,
    /// Slides (m).
    Prismatic,
}

/// The object's moving joint in the robot base frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ObjectJoint {
    /// Kind.
    pub kind: ObjectJointKind,
    /// Point on the axis (m).
    pub origin: Vector3<f64>,
    /// Unit axis; the joint opens in its positive sense where `upper` is open.
    pub axis: Vector3<f64>,
    /// Present value (rad or m).
    pub value: f64,
    /// Value at openness 0.
    pub lower: f64,
    /// Value at openness 1.
    pub upper: f64,
}

/// A checked planning problem.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct KeypointProblem {
    /// The robot.
    pub robot: Arc<Robot>,
    /// The config.
    pub config: SolverConfig,
    /// Joints at the start, one entry a joint of the robot.
    pub q_start: Vec<f64>,
    /// Tool keypoints in the hand frame (m).
    pub tool_keypoints: BTreeMap<String, Vector3<f64>>,
    /// Object keypoints in the base frame (m).
    pub object_keypoints: BTreeMap<String, Vector3<f64>>,
    /// Object frame in the base frame.
    pub object: Pose,
    /// The object's joint.
    pub joint: Option<ObjectJoint>,
    /// Axis of "rotate": 0, 1 or 2 of the object frame.
    pub object_axis: usize,
    /// Yaw (rad) that the scene's randomization drew, for the original's reading of frames.
    pub object_yaw: f64,
    /// World in the base frame.
    pub world: Pose,
    /// Obstacles.
    pub bodies: Vec<Body>,
    /// Options.
    pub options: Options,
}

/// Farthest that anything may lie from the base (m); beyond, the input is taken for damage.
const FARTHEST: f64 = 1e3;

/// Simulators rest a hair outside joint limits, and mimic joints beside where they should (rad or m).
const SLACK: f64 = 0.01;

/// Fastest joint that a motion may start with (rad/s or m/s).
const FASTEST: f64 = 100.0;

impl KeypointProblem {
    /// A problem with default options, no joint, no obstacles, and the world at the base.
    ///
    /// # Errors
    /// As [`KeypointProblem::check`].
    pub fn new(
        robot: Arc<Robot>,
        config: SolverConfig,
        q_start: Vec<f64>,
        tool_keypoints: BTreeMap<String, Vector3<f64>>,
        object_keypoints: BTreeMap<String, Vector3<f64>>,
        object: Pose,
    ) -> Result<Self, ProblemError> {
        let problem = Self {
            robot,
            config,
            q_start,
            tool_keypoints,
            object_keypoints,
            object,
            joint: None,
            object_axis: 1,
            object_yaw: 0.0,
            world: Pose::identity(),
            bodies: Vec::new(),
            options: Options::default(),
        };
        problem.check()?;
        Ok(problem)
    }

    /// Checks that all parts fit: numbers finite, names known, directions with a length, limits in order.
    ///
    /// # Errors
    /// The first part that does not fit, by field.
    pub fn check(&self) -> Result<(), ProblemError> {
        let fail = |field: &str, message: String| Err(ProblemError::new(field, message));
        let joints = self.robot.joints();
        if self.q_start.len() != joints.len() {
            let names: Vec<&str> = joints.iter().map(|j| j.name.as_str()).collect();
            let message = format!(
                "has {} entries; the robot has {} joints: {}",
                self.q_start.len(),
                joints.len(),
                names.join(", ")
            );
            return fail("q_start", message);
        }
        for (i, (q, joint)) in self.q_start.iter().zip(joints).enumerate() {
            if !q.is_finite() {
                return fail(&format!("q_start[{i}]"), format!("{q} is not finite"));
            }
            if *q < joint.lower - SLACK || *q > joint.upper + SLACK {
                let message = format!("{q} is outside the limits [{}, {}] of {}", joint.lower, joint.upper, joint.name);
                return fail(&format!("q_start[{i}]"), message);
            }
        }
        let model = Model::new(&self.robot, &self.q_start)?;
        self.check_mimics(&model)?;
        for (field, map) in [("tool_keypoints", &self.tool_keypoints), ("object_keypoints", &self.object_keypoints)] {
            for (name, p) in map {
                place(&format!("{field}[{name:?}]"), p)?;
            }
        }
        place("T_base_object", &self.object.translation.vector)?;
        place("T_base_world", &self.world.translation.vector)?;
        if self.object_axis > 2 || !self.object_yaw.is_finite() {
            return fail("object_axis", "must be x, y or z, and object_yaw finite".to_owned());
        }
        if let Some(j) = &self.joint {
            place("joint.origin", &j.origin)?;
            if (j.axis.norm() - 1.0).abs() > 1e-6 {
                return fail("joint.axis", format!("must be a unit vector, not {:?}", j.axis.as_slice()));
            }
            if ![j.value, j.lower, j.upper].iter().all(|v| v.is_finite()) || j.lower > j.upper {
                return fail("joint", format!("lower {} must not exceed upper {}, all finite", j.lower, j.upper));
            }
        }
        for (i, body) in self.bodies.iter().enumerate() {
            place(&format!("bodies[{i}].pose"), &body.pose.translation.vector)?;
            if self.bodies[..i].iter().any(|b| b.name == body.name) {
                return fail(&format!("bodies[{i}].name"), format!("{:?} is taken; names are unique", body.name));
            }
        }
        self.check_options()?;
        self.check_motions()?;
        self.resolve().map(|_| ())
    }

    /// Mimic joints that planning moves stand where their sources take them.
    fn check_mimics(&self, model: &Model) -> Result<(), ProblemError> {
        let mut q = Vec::new();
        model.map().positions(&model.start(), &mut q);
        for (i, (given, follows)) in self.q_start.iter().zip(&q).enumerate() {
            if (given - follows).abs() > SLACK {
                let joints = self.robot.joints();
                let (name, source) = (&joints[i].name, &joints[self.robot.drive(i).source].name);
                let message = format!("{given} is not where {name} stands as it follows {source}: {follows}");
                return Err(ProblemError::new(format!("q_start[{i}]"), message));
            }
        }
        Ok(())
    }

    fn check_options(&self) -> Result<(), ProblemError> {
        let o = &self.options;
        let fail = |field: &str, message: String| Err(ProblemError::new(format!("options.{field}"), message));
        for (name, v) in [("velocity_scale", o.velocity_scale), ("acceleration_scale", o.acceleration_scale)] {
            if !(v > 0.0 && v <= 1.0) {
                return fail(name, format!("must lie above 0 and not above 1, not {v}"));
            }
        }
        if !(o.margin >= 0.0 && o.margin <= 0.2) {
            return fail("margin", format!("must lie in 0 to 0.2 m, not {}", o.margin));
        }
        if o.start_time.is_nan() || o.start_time.abs() > 1e6 {
            return fail("start_time", format!("must lie within 1e6 s, not {}", o.start_time));
        }
        if !(1..=1000).contains(&o.seeds)
            || !(1..=1000).contains(&o.candidates)
            || o.samples > 1_000_000
            || o.harvest > 100_000
        {
            return fail("seeds", "seeds and candidates must be 1 to 1000, samples at most 1,000,000".to_owned());
        }
        if let Some([low, high]) = o.workspace
            && !(0..3).all(|i| low[i] <= high[i])
        {
            return fail("workspace", format!("lower corner {low:?} must not exceed upper corner {high:?}"));
        }
        let n = self.robot.joints().len();
        for (name, v) in [
            ("velocity_limits", &o.velocity_limits),
            ("acceleration_limits", &o.acceleration_limits),
            ("jerk_limits", &o.jerk_limits),
        ] {
            if let Some(v) = v
                && (v.len() != n || !v.iter().all(|l| (1e-6..=1e9).contains(l)))
            {
                return fail(name, format!("needs {n} numbers from 1e-6 to 1e9, one a joint"));
            }
        }
        if let Some(v) = &o.start_velocity
            && (v.len() != n || !v.iter().all(|l| l.abs() <= FASTEST))
        {
            return fail("start_velocity", format!("needs {n} numbers within {FASTEST} per second, one a joint"));
        }
        resting_joints(self)?;
        for (i, window) in o.contacts.iter().flatten().enumerate() {
            if let Some(name) = window.links.iter().find(|name| self.robot.link_index(name).is_none()) {
                return fail(&format!("contacts[{i}].links"), format!("{name:?} is not a link"));
            }
            if let Some(name) = window.bodies.iter().find(|name| !self.bodies.iter().any(|b| b.name == **name)) {
                return fail(&format!("contacts[{i}].bodies"), format!("{name:?} is not a body"));
            }
            for end in [&window.from, &window.to] {
                if self.keyframe_index(end).is_none() {
                    let message =
                        format!("{end:?} is not a keyframe: start, ..., pre_1, pre_0, actuation, post_0, ..., end");
                    return fail(&format!("contacts[{i}]"), message);
                }
            }
        }
        Ok(())
    }

    /// Place in time of a keyframe label: start, pre_{n-1}, ..., pre_0, actuation, post_0, ...; `end` is one past the
    /// last.
    pub(crate) fn keyframe_index(&self, label: &str) -> Option<usize> {
        let (before, after) = (self.config.pre.len(), self.config.post.len());
        let numbered = |prefix: &str, count: usize| {
            label.strip_prefix(prefix).and_then(|n| n.parse::<usize>().ok()).filter(|n| *n < count)
        };
        match label {
            "start" => Some(0),
            "actuation" => Some(1 + before),
            "end" => Some(2 + before + after),
            _ => numbered("pre_", before)
                .map(|i| before - i)
                .or_else(|| numbered("post_", after).map(|i| 2 + before + i)),
        }
    }

    fn check_motions(&self) -> Result<(), ProblemError> {
        use crate::config::Motion;
        if self.joint.is_none()
            && let Some(i) = self.config.post.iter().position(Motion::follows_joint)
        {
            return Err(ProblemError::new(
                "joint",
                format!("is missing, but post_actuation_motions[{i}] follows it; pass the object's joint"),
            ));
        }
        Ok(())
    }

    /// The point of the hand frame that touches: the tool keypoint of the first point constraint, or else the origin.
    pub(crate) fn contact_point(&self) -> Vector3<f64> {
        use crate::config::Constraint;
        self.config
            .constraints
            .iter()
            .find_map(|c| match c {
                Constraint::Point { keypoint, .. } => self.tool_keypoints.get(keypoint).copied(),
                _ => None,
            })
            .unwrap_or_else(Vector3::zeros)
    }

    fn tool(&self, name: &str) -> Result<Vector3<f64>, ProblemError> {
        look_up(&self.tool_keypoints, "tool_keypoints", name)
    }

    fn target(&self, name: &str) -> Result<Vector3<f64>, ProblemError> {
        look_up(&self.object_keypoints, "object_keypoints", name)
    }

    /// Axes of a frame in the base frame, as columns.
    fn axes(&self, frame: Frame, field: &str) -> Result<nalgebra::Matrix3<f64>, ProblemError> {
        match frame {
            Frame::World => Ok(*self.world.rotation.matrix()),
            Frame::Object => Ok(*self.object.rotation.matrix()),
            Frame::Joint => self.joint_frame(field),
        }
    }

    /// The joint frame at the config's target keypoint, as columns x, y, z in the base frame.
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
                    ProblemError::new(field, "uses the joint frame, which needs a point2point_constraint to stand at")
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

    /// The constraints with every name and frame replaced by numbers.
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

fn place(field: &str, p: &Vector3<f64>) -> Result<(), ProblemError> {
    if p.iter().all(|v| v.is_finite() && v.abs() <= FARTHEST) {
        return Ok(());
    }
    Err(ProblemError::new(field, format!("{:?} is not a finite place within {FARTHEST} m", p.as_slice())))
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

/// A point of the hand bound to a box.
#[derive(Debug, Clone)]
pub(crate) struct PointBound {
    pub entry: usize,
    pub on_hand: Vector3<f64>,
    pub target: Vector3<f64>,
    pub tolerance: f64,
}

/// A direction of the hand bound to a band of angles about a direction.
#[derive(Debug, Clone)]
pub(crate) struct AxisBound {
    pub entry: usize,
    pub on_hand: Vector3<f64>,
    pub target: Vector3<f64>,
    pub center: f64,
    pub tolerance: f64,
}

impl AxisBound {
    /// How far the angle is from the target angle (rad).
    pub fn residual(&self, hand: &Pose) -> f64 {
        let a = hand.rotation * self.on_hand;
        (a.cross(&self.target).norm().atan2(a.dot(&self.target)) - self.center).abs()
    }
}

/// Weighted squared distance of a point of the hand from a plane.
#[derive(Debug, Clone)]
pub(crate) struct PlaneTerm {
    pub on_hand: Vector3<f64>,
    pub target: Vector3<f64>,
    pub normal: Vector3<f64>,
    pub weight: f64,
}

/// Constraints in numbers.
#[derive(Debug, Clone, Default)]
pub(crate) struct Resolved {
    pub points: Vec<PointBound>,
    pub axes: Vec<AxisBound>,
    pub costs: Vec<PlaneTerm>,
}

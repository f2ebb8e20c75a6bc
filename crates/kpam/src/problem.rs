//! The problem: a robot, a config, keypoints, the object's joint, obstacles, options; checked once, here.

use std::collections::BTreeMap;
use std::sync::Arc;

use gensim2_geometry::{Convex, Pose, Robot};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::fingers::resting_joints;
use crate::model::Model;
use crate::world::Course;
use crate::{Bodies, Options, ProblemError, Scene, SolverConfig};

/// What the default contact rules go by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
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

impl Role {
    /// Name, as in Python.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Table => "table",
            Self::ObjectBody => "object_body",
            Self::MovingLink => "moving_link",
            Self::Rigid => "rigid",
            Self::Target => "target",
            Self::Attached => "attached",
        }
    }
}

/// An obstacle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Body {
    /// Unique name.
    pub name: String,
    /// Role.
    pub role: Role,
    /// Convex shapes in the body frame.
    pub shapes: Arc<[Convex]>,
    /// Pose in the robot base frame; of an attached body, in the hand frame.
    pub pose: Pose,
    /// Keypoints in the body frame (m); of use to scenes.
    pub keypoints: BTreeMap<String, Vector3<f64>>,
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
    /// Obstacles, and what rides on the hand.
    pub bodies: Bodies,
    /// Options.
    pub options: Options,
}

/// Farthest that anything may lie from the base (m); beyond, the input is taken for damage.
const FARTHEST: f64 = 1e3;

/// Simulators rest a hair outside joint limits, and mimic joints beside where they should (rad or m).
const SLACK: f64 = 0.01;

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
            bodies: Bodies::default(),
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
        self.config.check().map_err(|e| ProblemError::new(format!("config.{}", e.field), e.message))?;
        let model = Model::new(&self.robot, &self.q_start)?;
        self.check_mimics(&model)?;
        for (field, map) in [("tool_keypoints", &self.tool_keypoints), ("object_keypoints", &self.object_keypoints)] {
            for (name, p) in map {
                place(&format!("{field}[{name:?}]"), p)?;
            }
        }
        place("T_base_object", &self.object.translation.vector)?;
        place("T_base_world", &self.world.translation.vector)?;
        if self.object_axis > 2 {
            return fail("object_axis", format!("must be 0, 1 or 2 for x, y or z, not {}", self.object_axis));
        }
        if !self.object_yaw.is_finite() {
            return fail("object_yaw", format!("{} is not finite", self.object_yaw));
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
        self.options.check(&self.robot, &model)?;
        resting_joints(self)?;
        self.check_contacts()?;
        self.check_motions()?;
        self.check_acts()?;
        self.resolve().map(|_| ())
    }

    /// The same problem from another state: joints, their velocity (at rest where none is given), and the time (s).
    ///
    /// # Errors
    /// As [`KeypointProblem::check`].
    pub fn with_start(&self, q: Vec<f64>, velocity: Option<Vec<f64>>, time: f64) -> Result<Self, ProblemError> {
        let mut out = self.clone();
        out.q_start = q;
        (out.options.start_velocity, out.options.start_time) = (velocity, time);
        out.check()?;
        Ok(out)
    }

    /// The scene that it is asked of.
    #[must_use]
    pub fn scene(&self) -> Scene {
        Scene::of(self)
    }

    /// Whether a body rides on the hand in some leg of the motion.
    pub(crate) fn rides(&self, name: &str) -> bool {
        let attached = |b: &Body| b.name == name && b.role == Role::Attached;
        self.options.pick.iter().any(|n| n == name) || self.bodies.iter().any(attached)
    }

    /// What the hand picks and releases is there, and the joint's travel has an entry a motion.
    fn check_acts(&self) -> Result<(), ProblemError> {
        let fail = |field: &str, message: String| Err(ProblemError::new(format!("options.{field}"), message));
        for (field, names) in [("pick", &self.options.pick), ("release", &self.options.release)] {
            for (i, name) in names.iter().enumerate() {
                match self.bodies.iter().find(|b| b.name == *name) {
                    None => return fail(&format!("{field}[{i}]"), format!("{name:?} is not a body")),
                    Some(b) if field == "pick" && b.role == Role::MovingLink => {
                        return fail(&format!("{field}[{i}]"), format!("{name:?} is moved by the joint"));
                    }
                    Some(b) if field == "release" && b.role != Role::Attached => {
                        return fail(&format!("{field}[{i}]"), format!("{name:?} is not attached"));
                    }
                    Some(_) => {}
                }
            }
        }
        if let Some(travel) = &self.options.joint_travel {
            let motions = self.config.post.len();
            if self.joint.is_none() {
                return fail("joint_travel", "is given without a joint".to_owned());
            }
            if travel.len() != motions || travel.iter().any(|t| !t.is_finite()) {
                return fail("joint_travel", format!("needs {motions} finite numbers, one a post-actuation motion"));
            }
        }
        Ok(())
    }

    /// Mimic joints that planning moves stand where their sources take them.
    fn check_mimics(&self, model: &Model) -> Result<(), ProblemError> {
        let mut q = Vec::new();
        model.map().positions(&model.start(), &mut q);
        for (i, (given, follows)) in self.q_start.iter().zip(&q).enumerate() {
            if (given - follows).abs() > SLACK {
                let joints = self.robot.joints();
                let name = &joints[i].name;
                let source = joints[i].mimic.map_or(name, |m| &joints[m.source].name);
                let message = format!("{given} is not where {name} stands as it follows {source}: {follows}");
                return Err(ProblemError::new(format!("q_start[{i}]"), message));
            }
        }
        Ok(())
    }

    fn check_contacts(&self) -> Result<(), ProblemError> {
        let fail = |field: &str, message: String| Err(ProblemError::new(format!("options.{field}"), message));
        for (i, window) in self.options.contacts.iter().flatten().enumerate() {
            let known = |name: &String| self.robot.link_index(name).is_some() || self.rides(name);
            if let Some(name) = window.links.iter().find(|name| !known(name)) {
                let message = format!("{name:?} is neither a link nor a body that rides on the hand");
                return fail(&format!("contacts[{i}].links"), message);
            }
            if let Some(name) = window.bodies.iter().find(|name| !self.bodies.iter().any(|b| b.name == **name)) {
                return fail(&format!("contacts[{i}].bodies"), format!("{name:?} is not a body"));
            }
            for (which, end) in [("from", &window.from), ("to", &window.to)] {
                if self.window_index(end).is_none() {
                    let message = format!("{end:?} is not start, end or a keyframe: {}", Course::of(&self.config));
                    return fail(&format!("contacts[{i}].{which}"), message);
                }
            }
        }
        Ok(())
    }

    /// Place in time of a label of a contact window: start, then the keyframes; `end` is one past the last.
    pub(crate) fn window_index(&self, label: &str) -> Option<usize> {
        let course = Course::of(&self.config);
        match label {
            "start" => Some(0),
            "end" => Some(1 + course.len()),
            _ => course.keyframe(label).map(|k| 1 + k),
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
}

fn place(field: &str, p: &Vector3<f64>) -> Result<(), ProblemError> {
    if p.iter().all(|v| v.is_finite() && v.abs() <= FARTHEST) {
        return Ok(());
    }
    Err(ProblemError::new(field, format!("{:?} is not a finite place within {FARTHEST} m", p.as_slice())))
}

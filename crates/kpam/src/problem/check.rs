//! Checks that the parts of a problem fit each other, whether it is built in code or deserialized.

use super::KeypointProblem;
use crate::body::{place, rigid};
use crate::config::Motion;
use crate::fingers::resting_joints;
use crate::model::Model;
use crate::world::Schedule;
use crate::{ProblemError, Role};

/// Permitted violation (rad or m) of joint limits and mimic relations, since simulators slightly violate both.
const SLACK: f64 = 0.01;

impl KeypointProblem {
    /// Checks that all parts fit each other. Robot, config, joint and bodies have already been validated individually.
    pub(super) fn check(&self) -> Result<(), ProblemError> {
        let fail = |field: &str, message: String| Err(ProblemError::new(field, message));
        let joints = self.robot.joints();
        if self.q_start.len() != joints.len() {
            let names: Vec<&str> = joints.iter().map(|j| j.name()).collect();
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
            if *q < joint.lower() - SLACK || *q > joint.upper() + SLACK {
                let message =
                    format!("{q} is outside the limits [{}, {}] of {}", joint.lower(), joint.upper(), joint.name());
                return fail(&format!("q_start[{i}]"), message);
            }
        }
        let model = Model::of_hand(&self.robot, &self.q_start)?;
        self.check_mimics(&model)?;
        for (field, map) in [("tool_keypoints", &self.tool_keypoints), ("object_keypoints", &self.object_keypoints)] {
            for (name, p) in map {
                place(&format!("{field}[{name:?}]"), p)?;
            }
        }
        rigid("T_base_object", &self.object)?;
        rigid("T_base_world", &self.world)?;
        if self.object_axis > 2 {
            return fail("object_axis", format!("must be 0, 1 or 2 for x, y or z, not {}", self.object_axis));
        }
        if !self.object_yaw.is_finite() {
            return fail("object_yaw", format!("{} is not finite", self.object_yaw));
        }
        self.bodies.check_names(&self.robot)?;
        self.options.check(&self.robot, &model)?;
        resting_joints(self)?;
        self.check_contacts()?;
        self.check_motions()?;
        self.check_acts()?;
        self.resolve().map(|_| ())
    }

    /// Checks that picked and released bodies exist, and that `joint_travel` has one entry for each motion.
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

    /// Checks that each mimic joint that planning moves has the value that follows from its source joint.
    fn check_mimics(&self, model: &Model) -> Result<(), ProblemError> {
        let mut q = Vec::new();
        model.map().positions(&model.start(), &mut q);
        for i in model.map().driven().iter().map(|d| d.joint) {
            let (given, follows) = (self.q_start[i], q[i]);
            if (given - follows).abs() > SLACK {
                let joints = self.robot.joints();
                let name = joints[i].name();
                let source = joints[i].mimic().map_or(name, |m| joints[m.source].name());
                let message = format!(
                    "{given} contradicts the mimic joint {name}, which follows {source}: {follows}; use robot.apply_mimic(q)"
                );
                return Err(ProblemError::new(format!("q_start[{i}]"), message));
            }
        }
        Ok(())
    }

    fn check_contacts(&self) -> Result<(), ProblemError> {
        let fail = |field: &str, message: String| Err(ProblemError::new(format!("options.{field}"), message));
        if self.options.contacts.is_some() && self.options.reach_clearance.is_some() {
            let message =
                "is part of the default rules, which options.contacts replaces; omit one of the two options".to_owned();
            return fail("reach_clearance", message);
        }
        for (i, window) in self.options.contacts.iter().flatten().enumerate() {
            let known = |name: &String| self.robot.link_index(name).is_some() || self.rides(name);
            if let Some(name) = window.links.iter().find(|name| !known(name)) {
                let message = format!("{name:?} is neither a link nor a body attached to the hand");
                return fail(&format!("contacts[{i}].links"), message);
            }
            if let Some(name) = window.bodies.iter().find(|name| !self.bodies.iter().any(|b| b.name == **name)) {
                return fail(&format!("contacts[{i}].bodies"), format!("{name:?} is not a body"));
            }
            for (which, end) in [("from", &window.from), ("to", &window.to)] {
                if self.window_index(end).is_none() {
                    let message = format!("{end:?} is not start, end or a keyframe: {}", Schedule::of(&self.config));
                    return fail(&format!("contacts[{i}].{which}"), message);
                }
            }
        }
        Ok(())
    }

    fn check_motions(&self) -> Result<(), ProblemError> {
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
}

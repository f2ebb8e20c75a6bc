//! The grasp with which a motion exists: the pick, and every place that the object is to be taken to.

use std::collections::BTreeMap;
use std::sync::Arc;

use gensim2_geometry::{Pose, Robot};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::{Grasp, ParallelGripper};
use crate::config::{Constraint, Frame, Motion, SolverConfigBuilder, TargetAxis};
use crate::{Body, Gripper, KeypointProblem, Options, Plan, ProblemError, Role, SolverConfig, Status, plan};

/// Tolerances of the hand's pose (m, rad).
const PLACE: f64 = 2e-4;
const DIRECTION: f64 = 5e-3;
/// Distance of the keypoints that give directions (m).
const ARM: f64 = 0.1;

/// A pose that the object is to be brought to.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Target {
    /// The object in the base frame.
    pub object: Pose,
    /// Direction (base frame) about which the object may come turned by any angle; none where its pose is fixed.
    pub free_axis: Option<Vector3<f64>>,
}

/// What is to be picked, by whom, and where it goes.
#[derive(Debug, Clone)]
pub struct GraspTask {
    /// The robot.
    pub robot: Arc<Robot>,
    /// Its gripper.
    pub gripper: ParallelGripper,
    /// Joints at the start, one entry a joint of the robot.
    pub q_start: Vec<f64>,
    /// What is picked.
    pub object: Body,
    /// What stands around it.
    pub bodies: Vec<Body>,
    /// Way (m) that the open hand comes straight along its fingers.
    pub approach: f64,
    /// Motion (m, base frame) of the hand right after the grasp; also how the object comes to its targets.
    pub lift: Vector3<f64>,
    /// Where the object is taken, one after the other.
    pub targets: Vec<Target>,
    /// Options of every plan.
    pub options: Options,
}

/// A grasp with its motions, all of them solved.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct GraspPlan {
    /// Number of the grasp in the list.
    pub index: usize,
    /// The hand in the object frame: the grasp's, or that with the fingers swapped.
    pub object_hand: Pose,
    /// From the start to the grasp and up.
    pub pick: Plan,
    /// From there to each target.
    pub carries: Vec<Plan>,
}

/// The first of `grasps` with which the object can be picked and brought to every target.
///
/// Each is tried as it is and with the fingers swapped. While it is carried, the object is judged as part of the hand:
/// targets are to be free, so a little above what it is put on. `None` where no grasp will do.
///
/// # Errors
/// Parts of the task that do not fit each other.
pub fn plan_grasp(task: &GraspTask, grasps: &[Grasp]) -> Result<Option<GraspPlan>, ProblemError> {
    for (index, grasp) in grasps.iter().enumerate() {
        let half_turn = task.gripper.grip() * Pose::rotation(Vector3::z() * std::f64::consts::PI);
        let swapped = grasp.object_hand * half_turn * task.gripper.grip().inverse();
        for object_hand in [grasp.object_hand, swapped] {
            if let Some((pick, carries)) = task.motions(grasp, &object_hand)? {
                return Ok(Some(GraspPlan { index, object_hand, pick, carries }));
            }
        }
    }
    Ok(None)
}

impl GraspTask {
    fn motions(&self, grasp: &Grasp, object_hand: &Pose) -> Result<Option<(Plan, Vec<Plan>)>, ProblemError> {
        let pick = plan(&self.pick(grasp, object_hand)?);
        let Some(mut q) = end(&pick) else { return Ok(None) };
        let mut carries = Vec::with_capacity(self.targets.len());
        for target in &self.targets {
            self.gripper.set_opening(&mut q, grasp.width);
            let carry = plan(&self.carry(target, object_hand, q)?);
            let Some(next) = end(&carry) else { return Ok(None) };
            q = next;
            carries.push(carry);
        }
        Ok(Some((pick, carries)))
    }

    fn pick(&self, grasp: &Grasp, object_hand: &Pose) -> Result<KeypointProblem, ProblemError> {
        let mut q = self.q_start.clone();
        self.gripper.set_opening(&mut q, grasp.opening);
        let mut bodies = self.bodies.clone();
        bodies.push(Body { role: Role::Rigid, ..self.object.clone() });
        let hand = self.object.pose * object_hand;
        let (pre, post) = (vec![Motion::Move(grasp.approach * -self.approach)], vec![Motion::Move(self.lift)]);
        // The hand may touch it on the straight approach alone; from the actuation on it is part of the hand.
        let options = Options { pick: vec![self.object.name.clone()], ..self.options.clone() };
        self.problem(q, bodies, &Pose::identity(), &hand, None, (pre, post), options)
    }

    fn carry(&self, target: &Target, object_hand: &Pose, q: Vec<f64>) -> Result<KeypointProblem, ProblemError> {
        let mut bodies = self.bodies.clone();
        let hand_object = object_hand.inverse();
        bodies.push(Body { role: Role::Attached, pose: hand_object, ..self.object.clone() });
        let motions = (vec![Motion::Move(self.lift)], vec![]);
        self.problem(q, bodies, &hand_object, &target.object, target.free_axis, motions, self.options.clone())
    }

    /// Brings a frame that rides on the hand to a pose, up to turns about `free_axis`.
    #[allow(clippy::too_many_arguments)]
    fn problem(
        &self,
        q_start: Vec<f64>,
        bodies: Vec<Body>,
        hand_frame: &Pose,
        target: &Pose,
        free_axis: Option<Vector3<f64>>,
        (pre, post): (Vec<Motion>, Vec<Motion>),
        options: Options,
    ) -> Result<KeypointProblem, ProblemError> {
        let mut directions = vec![target.rotation * Vector3::x(), target.rotation * Vector3::z()];
        if let Some(axis) = free_axis {
            let message = "must have a direction, or be none";
            directions = vec![axis.try_normalize(1e-9).ok_or_else(|| ProblemError::new("targets.free_axis", message))?];
        }
        let origin = hand_frame.translation.vector;
        let mut tool_keypoints = BTreeMap::from([(String::from("origin"), origin)]);
        let mut config =
            SolverConfig::builder().constraint(Constraint::point("origin", "origin", PLACE)).gripper(Gripper::Grasp);
        for (i, axis) in directions.into_iter().enumerate() {
            let name = format!("along_{i}");
            let on_hand = hand_frame.rotation * (target.rotation.inverse() * axis);
            tool_keypoints.insert(name.clone(), origin + on_hand * ARM);
            let target = TargetAxis::Fixed { axis, frame: Frame::World };
            config = config.constraint(Constraint::axis("origin", name, target, 1.0, DIRECTION));
        }
        let config = pre.into_iter().fold(config, SolverConfigBuilder::pre);
        let config = post.into_iter().fold(config, SolverConfigBuilder::post);
        let config = config.build().map_err(|e| ProblemError::new(e.field, e.message))?;
        let problem = KeypointProblem {
            robot: Arc::clone(&self.robot),
            config,
            q_start,
            tool_keypoints,
            object_keypoints: BTreeMap::from([(String::from("origin"), target.translation.vector)]),
            object: *target,
            joint: None,
            object_axis: 1,
            object_yaw: 0.0,
            world: Pose::identity(),
            bodies: bodies.into(),
            options,
        };
        problem.check()?;
        Ok(problem)
    }
}

/// Joints at the end of a solved plan.
fn end(plan: &Plan) -> Option<Vec<f64>> {
    let trajectory = plan.trajectory.as_ref().filter(|_| plan.status == Status::Solved)?;
    Some(trajectory.sample(trajectory.end()).position)
}

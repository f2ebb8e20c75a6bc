//! Planning of a pick and its placements with the first grasp that allows all motions.

use std::sync::Arc;

use gensim2_geometry::{Pose, is_rigid};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::{Grasp, ParallelGripper};
use crate::config::{Constraint, Frame, Motion, SolverConfigBuilder, TargetAxis};
use crate::{
    Bodies, Cancel, Gripper, KeypointProblem, Options, Outcome, Plan, ProblemError, Role, Scene, SolverConfig,
    plan_timed,
};

/// Tolerances of the position (m) and the orientation (rad) of the hand.
const PLACE: f64 = 2e-4;
const DIRECTION: f64 = 5e-3;
/// Distance (m) between the keypoint at the hand's origin and the keypoints that define the hand's directions.
const ARM: f64 = 0.1;

/// A target pose of the object.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Target {
    /// Pose of the object in the base frame.
    pub object: Pose,
    /// Direction (base frame) about which the object may be rotated by any angle; `None` for a fixed orientation.
    pub free_axis: Option<Vector3<f64>>,
}

/// An object to pick, and the target poses to which it is carried.
#[derive(Debug, Clone)]
#[must_use]
pub struct GraspTask {
    body: String,
    gripper: ParallelGripper,
    q_start: Vec<f64>,
    approach: f64,
    lift: Vector3<f64>,
    targets: Vec<Target>,
    options: Options,
    cancel: Cancel,
}

impl GraspTask {
    /// Creates the task of picking a body of a scene from joints `q_start` (one entry for each joint of the robot),
    /// with a straight approach of 0.1 m and a lift of 0.1 m.
    pub fn new(body: impl Into<String>, gripper: ParallelGripper, q_start: Vec<f64>) -> Self {
        let (lift, options) = (Vector3::new(0.0, 0.0, 0.1), Options::default());
        let (body, cancel) = (body.into(), Cancel::new());
        Self { body, gripper, q_start, approach: 0.1, lift, targets: Vec::new(), options, cancel }
    }

    /// Sets the length (m) of the straight approach of the open hand.
    pub fn approach(mut self, way: f64) -> Self {
        self.approach = way;
        self
    }

    /// Sets the translation (m, base frame) of the hand after the grasp. Targets are approached by the reverse
    /// translation.
    pub fn lift(mut self, way: Vector3<f64>) -> Self {
        self.lift = way;
        self
    }

    /// Adds a target pose, which is reached after those added before.
    pub fn target(mut self, target: Target) -> Self {
        self.targets.push(target);
        self
    }

    /// Sets the options of every plan. A start velocity or acceleration applies to the pick only.
    pub fn options(mut self, options: Options) -> Self {
        self.options = options;
        self
    }

    /// Sets the flag with which another thread ends the search; no plan is returned then.
    pub fn cancel(mut self, cancel: Cancel) -> Self {
        self.cancel = cancel;
        self
    }

    fn check(&self) -> Result<(), ProblemError> {
        if !(0.0..=1.0).contains(&self.approach) {
            let message = format!("must lie in 0 to 1 m, not {}", self.approach);
            return Err(ProblemError::new("approach", message));
        }
        match self.targets.iter().position(|t| !is_rigid(&t.object)) {
            Some(i) => Err(ProblemError::new(format!("targets[{i}]"), "is not a rigid transform")),
            None => Ok(()),
        }
    }
}

/// A grasp with the planned motions of the pick and its placements.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct GraspPlan {
    /// Index of the grasp in the list of candidate grasps.
    pub index: usize,
    /// The hand in the object frame, possibly with the fingers swapped.
    pub object_hand: Pose,
    /// Plan from the start to the grasp and the lift.
    pub pick: Plan,
    /// Plans that carry the object to the targets, one for each target.
    pub carries: Vec<Plan>,
}

impl Scene {
    /// Returns the first of `grasps` with which the body can be picked and brought to every target.
    ///
    /// Each grasp is also tried with the fingers swapped. A carried body is checked for collisions as part of the hand,
    /// so targets must lie slightly above the support. `None` if no grasp works.
    ///
    /// # Errors
    /// The body does not exist or is already attached, or parts of the task do not fit each other.
    pub fn plan_grasp(&self, task: &GraspTask, grasps: &[Grasp]) -> Result<Option<GraspPlan>, ProblemError> {
        task.check()?;
        if self.body(&task.body)?.role == Role::Attached {
            return Err(ProblemError::new("body", format!("{:?} is already attached to the hand", task.body)));
        }
        let asked = Asked { scene: self, task };
        for (index, grasp) in grasps.iter().enumerate() {
            let half_turn = task.gripper.grip() * Pose::rotation(Vector3::z() * std::f64::consts::PI);
            let swapped = grasp.object_hand * half_turn * task.gripper.grip().inverse();
            for object_hand in [grasp.object_hand, swapped] {
                if let Some((pick, carries)) = asked.motions(grasp, &object_hand)? {
                    return Ok(Some(GraspPlan { index, object_hand, pick, carries }));
                }
            }
        }
        Ok(None)
    }
}

/// A grasp task in its scene.
struct Asked<'a> {
    scene: &'a Scene,
    task: &'a GraspTask,
}

impl Asked<'_> {
    fn motions(&self, grasp: &Grasp, object_hand: &Pose) -> Result<Option<(Plan, Vec<Plan>)>, ProblemError> {
        if self.task.cancel.is_cancelled() {
            return Ok(None);
        }
        let pick = plan_timed(&self.pick(grasp, object_hand)?, &self.task.cancel).0;
        let Some(mut q) = end(&pick) else { return Ok(None) };
        let mut carries = Vec::with_capacity(self.task.targets.len());
        for target in &self.task.targets {
            self.task.gripper.set_opening(&mut q, grasp.width);
            let carry = plan_timed(&self.carry(target, object_hand, q)?, &self.task.cancel).0;
            let Some(next) = end(&carry) else { return Ok(None) };
            q = next;
            carries.push(carry);
        }
        Ok(Some((pick, carries)))
    }

    /// Returns the bodies of the scene, with the given role and pose of the picked body.
    fn bodies(&self, role: Role, pose: impl Fn(&Pose) -> Pose) -> Result<Bodies, ProblemError> {
        self.scene.with_bodies(|body| body.name == self.task.body, role, pose)
    }

    fn pick(&self, grasp: &Grasp, object_hand: &Pose) -> Result<KeypointProblem, ProblemError> {
        let mut q = self.task.q_start.clone();
        self.task.gripper.set_opening(&mut q, grasp.opening);
        let hand = self.scene.body(&self.task.body)?.pose * object_hand;
        let motions = (vec![Motion::Move(grasp.approach * -self.task.approach)], vec![Motion::Move(self.task.lift)]);
        // The hand may touch the body only during the straight approach; after the actuation the body is part of the
        // hand.
        let options = Options { pick: vec![self.task.body.clone()], ..self.task.options.clone() };
        let bodies = self.bodies(Role::Rigid, |pose| *pose)?;
        self.problem(q, bodies, &Pose::identity(), &hand, None, motions, options)
    }

    fn carry(&self, target: &Target, object_hand: &Pose, q: Vec<f64>) -> Result<KeypointProblem, ProblemError> {
        let hand_object = object_hand.inverse();
        let bodies = self.bodies(Role::Attached, |_| hand_object)?;
        let motions = (vec![Motion::Move(self.task.lift)], vec![]);
        // A motion to a target starts at rest at the end of the previous motion.
        let options = Options { start_velocity: None, start_acceleration: None, ..self.task.options.clone() };
        self.problem(q, bodies, &hand_object, &target.object, target.free_axis, motions, options)
    }

    /// Formulates the problem of moving a frame attached to the hand to a pose, up to rotations about `free_axis`.
    #[allow(clippy::too_many_arguments)]
    fn problem(
        &self,
        q_start: Vec<f64>,
        bodies: Bodies,
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
        let mut tool_keypoints = vec![(String::from("origin"), origin)];
        let mut config =
            SolverConfig::builder().constraint(Constraint::point("origin", "origin", PLACE)).gripper(Gripper::Grasp);
        for (i, axis) in directions.into_iter().enumerate() {
            let name = format!("along_{i}");
            let on_hand = hand_frame.rotation * (target.rotation.inverse() * axis);
            tool_keypoints.push((name.clone(), origin + on_hand * ARM));
            let target = TargetAxis::Fixed { axis, frame: Frame::World };
            config = config.constraint(Constraint::axis("origin", name, target, 1.0, DIRECTION));
        }
        let config = pre.into_iter().fold(config, SolverConfigBuilder::pre);
        let config = post.into_iter().fold(config, SolverConfigBuilder::post);
        let config = config.build().map_err(|e| ProblemError::new(e.field, e.message))?;
        KeypointProblem::builder(Arc::clone(self.scene.robot()), config, q_start)
            .tool_keypoints(tool_keypoints)
            .object_keypoint("origin", target.translation.vector)
            .object(*target)
            .bodies(bodies)
            .options(options)
            .build()
    }
}

/// Returns the joint values at the end of a solved plan.
fn end(plan: &Plan) -> Option<Vec<f64>> {
    let Outcome::Solved(trajectory) = &plan.outcome else { return None };
    Some(trajectory.sample(trajectory.end()).position)
}

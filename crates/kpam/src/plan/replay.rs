//! Replays the motion of a plan: the state at a given time, and distances between bodies along the motion.

use super::Plan;
use super::resume::Rest;
use crate::fingers::resting_joints;
use crate::model::Model;
use crate::motion::{Motions, motions};
use crate::world::{Clearances, State, World, travel_over};
use crate::{Cancel, KeypointProblem, ProblemError, Trajectory};

/// Maximum number of states that [`min_clearance`] measures.
pub const MAX_CHECKS: usize = 100_000;

/// The motion of a plan.
struct Replay<'p> {
    problem: &'p KeypointProblem,
    plan: &'p Plan,
    trajectory: &'p Trajectory,
    motions: Motions,
    /// Travel of the object's joint at the start of each path.
    before: Vec<f64>,
}

impl<'p> Replay<'p> {
    /// Returns `None` if the plan has no motion, or if its motion is one of another robot.
    fn new(problem: &'p KeypointProblem, plan: &'p Plan) -> Option<Self> {
        let (trajectory, q) = (plan.trajectory()?, plan.q_plan.as_ref()?);
        let motions = motions(problem, &problem.robot.link_pose(q, problem.robot.hand())?);
        let act = motions.actuation;
        let mut before = vec![0.0; motions.paths.len() + 1];
        for i in act..motions.paths.len() {
            before[i + 1] = travel_over(problem, i - act, &motions.paths[i], before[i], 0.0..1.0);
        }
        Some(Self { problem, plan, trajectory, motions, before })
    }

    /// Returns the index of the keyframe at time `t` (s), or of the next keyframe after it.
    fn toward(&self, t: f64) -> usize {
        let keyframes = &self.plan.keyframes;
        let due = keyframes.iter().position(|k| k.time.is_some_and(|due| due >= t - 1e-9));
        let after_last = || keyframes.iter().rposition(|k| k.time.is_some()).map_or(0, |k| k + 1);
        due.unwrap_or_else(after_last).min(keyframes.len().saturating_sub(1))
    }

    /// Returns the travel of the object's joint (rad or m) at time `t` (s).
    fn travel(&self, t: f64) -> f64 {
        let act = self.motions.actuation;
        if self.problem.joint.is_none() {
            return 0.0;
        }
        let Some(i) = self.toward(t).checked_sub(1).filter(|i| *i >= act) else { return 0.0 };
        let robot = &self.problem.robot;
        let Some(hand) = robot.link_pose(&self.trajectory.sample(t).position, robot.hand()) else { return 0.0 };
        let (path, before) = (&self.motions.paths[i], self.before[i]);
        let done = Rest::new(path, &hand).begin;
        travel_over(self.problem, i - act, path, before, 0.0..done)
    }
}

/// Returns the travel of the object's joint (rad or m, measured from its current value) that the planner assumes at
/// `times` (s) of a plan's motion. All are zero if the plan has no motion or the problem has no object joint.
#[must_use]
pub fn joint_travel(problem: &KeypointProblem, plan: &Plan, times: &[f64]) -> Vec<f64> {
    match Replay::new(problem, plan) {
        Some(replay) => times.iter().map(|t| replay.travel(*t)).collect(),
        None => vec![0.0; times.len()],
    }
}

/// Returns the smallest signed distances (m) between the checked pairs of bodies, sampled every `step` seconds of a
/// plan's motion. `None` if the plan has no motion or `cancel` is set; infinite if every pair is more than a metre
/// apart.
///
/// # Errors
/// The step is not positive, or would give more than [`MAX_CHECKS`] samples.
pub fn min_clearance(
    problem: &KeypointProblem,
    plan: &Plan,
    step: f64,
    cancel: &Cancel,
) -> Result<Option<[f64; 3]>, ProblemError> {
    let Some(replay) = Replay::new(problem, plan) else { return Ok(None) };
    let trajectory = replay.trajectory;
    let (start, end) = (trajectory.start(), trajectory.end());
    let steps = ((end - start) / step).ceil().max(1.0);
    if !(step > 0.0 && step.is_finite() && steps <= MAX_CHECKS as f64) {
        let least = (end - start) / MAX_CHECKS as f64;
        return Err(ProblemError::new("step", format!("must be at least {least:.3e} s for this motion, not {step}")));
    }
    let model = Model::of_hand(&problem.robot, &resting_joints(problem)?)?;
    let mut world = World::new(problem, &model);
    if let Some(q) = plan.q_plan.as_ref().filter(|q| q.len() == problem.q_start.len()) {
        world.act_at(&model.pick(q), replay.motions.letting_go());
    }
    let mut out = Clearances { itself: f64::INFINITY, table: f64::INFINITY, object: f64::INFINITY };
    for k in 0..=steps as usize {
        if cancel.is_cancelled() {
            return Ok(None);
        }
        let t = (start + step * k as f64).min(end);
        let segment = world.schedule.toward(replay.toward(t));
        world.measure(State { x: &trajectory.moving(t), travel: replay.travel(t) }, segment, &mut out);
    }
    Ok(Some([out.itself, out.table, out.object]))
}

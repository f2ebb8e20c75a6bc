//! Planning: finds the cheapest actuation pose whose whole motion is reachable and collision-free.

mod approach;
mod attempt;
mod connect;
mod emitted;
mod failure;
mod follow;
mod outcome;
mod planner;
mod replay;
mod report;
mod request;
mod resume;
mod timed;
mod trials;

use serde::{Deserialize, Serialize};

use crate::actuation::ActuationSearch;
use crate::cancel::end_of;
use crate::fingers::resting_joints;
use crate::model::{Model, Row};
use crate::parallel::in_parallel;
use crate::resolve::Resolved;
use crate::world::Schedule;
use crate::{Cancel, KeypointProblem, ProblemError, Trajectory};
pub use outcome::{Lack, Outcome, Status};
use planner::Planner;
pub use replay::{MAX_CHECKS, joint_travel, min_clearance};
pub use request::Request;
use resume::warm_start_pose;

/// Residual of one constraint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Residual {
    /// Type of the constraint, followed by the keypoint names in it.
    pub name: String,
    /// Largest coordinate difference (m) between the keypoints, or difference (rad) from the target angle.
    pub residual: f64,
    /// Tolerance of the constraint in the config (m or rad).
    pub tolerance: f64,
    /// Whether the residual is within the tolerance.
    pub satisfied: bool,
}

/// A keyframe of the motion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct KeyframeReport {
    /// Label: ..., `pre_1`, `pre_0`, `actuation`, `post_0`, ..., `let_go` in time order; numbers are indices in the
    /// config's lists.
    pub label: String,
    /// Time (s) at which the motion reaches the keyframe; `None` if it does not.
    pub time: Option<f64>,
    /// Pose of the hand in the base frame as a 4 x 4 matrix, row by row.
    pub hand: [[f64; 4]; 4],
    /// Whether the motion reaches the keyframe.
    pub reached: bool,
}

/// Two bodies that come too close to each other during the motion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Collision {
    /// Names of a link and a body, or of two links.
    pub bodies: [String; 2],
    /// Time (s) of the collision, if the motion is timed.
    pub time: Option<f64>,
    /// Label of the keyframe at the end of the segment in which the bodies collide.
    pub toward: String,
    /// Signed distance between the two bodies (m).
    pub distance: f64,
    /// Position of the collision in the base frame (m).
    pub point: [f64; 3],
}

/// Two bodies that are closer than the margin at a keyframe. In the segment before or after the keyframe they may not
/// touch, and the motion keeps this distance instead of the margin.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Tight {
    /// Names of a link and a body, or of two links.
    pub bodies: [String; 2],
    /// `start`, or the label of the keyframe.
    pub at: String,
    /// Signed distance between the two bodies (m).
    pub distance: f64,
}

/// Two bodies in permitted contact at a keyframe.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Touch {
    /// Names of a link and a body, or of two links.
    pub bodies: [String; 2],
    /// Label of the keyframe.
    pub at: String,
    /// Depth of the overlap (m).
    pub depth: f64,
}

/// Estimated travel of the object's joint during a motion for which the config does not define the travel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Guess {
    /// Label of the keyframe at the end of the motion.
    pub toward: String,
    /// Estimated travel of the joint (rad or m).
    pub travel: f64,
    /// Overlap (m) with the object's moving link that is tolerated because the travel is only an estimate.
    pub depth: f64,
}

/// Result of planning with one candidate for the actuation pose.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct TriedPose {
    /// Joint vector (rad or m), one entry for each joint.
    pub q: Vec<f64>,
    /// Position of the pose in the order in which poses are tried; 0 is the first.
    pub rank: usize,
    /// Status of the motion through the pose.
    pub status: Status,
    /// Explanation of the status in one sentence.
    pub reason: String,
}

/// Result of planning: the motion, constraint residuals, and reasons of a failure.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Plan {
    /// Version number of the layout in which plans are serialized.
    pub schema_version: u32,
    /// Status of planning, with the motion if there is one.
    pub outcome: Outcome,
    /// Explanation of the status in one sentence.
    pub reason: String,
    /// Clearance (m) that the motion keeps from bodies that it may not touch, except the pairs in `tight`.
    pub margin: f64,
    /// Pairs of bodies that are closer than `margin` at the start or at a keyframe.
    pub tight: Vec<Tight>,
    /// Permitted contacts of two bodies at keyframes.
    pub touches: Vec<Touch>,
    /// Motions for which the travel of the object's joint is an estimate.
    pub guesses: Vec<Guess>,
    /// Names of the limits (`acceleration`, `jerk`) that neither options nor URDF give; defaults apply.
    pub assumed_limits: Vec<String>,
    /// Warnings about the plan in whole sentences.
    pub warnings: Vec<String>,
    /// The cheapest joint vector that meets the constraints, ignoring obstacles.
    pub q_actuation: Option<Vec<f64>>,
    /// Cost of `q_actuation`.
    pub cost: Option<f64>,
    /// The joint vector with the smallest constraint error, if no joint vector meets the constraints.
    pub q_best_effort: Option<Vec<f64>>,
    /// The actuation pose of the motion, or of the failed attempt whose motion extends furthest.
    pub q_plan: Option<Vec<f64>>,
    /// Position of `q_plan` in the order in which poses are tried; 0 is the cheapest.
    pub rank: Option<usize>,
    /// Number of actuation poses for which planning a motion was attempted.
    pub tried: usize,
    /// Result for each tried pose, if [`Request::explain`] is set.
    pub tried_poses: Vec<TriedPose>,
    /// Residuals of the constraints at `q_plan`; without it, at `q_actuation` or `q_best_effort`.
    pub residuals: Vec<Residual>,
    /// Keyframes of the motion through `q_plan`.
    pub keyframes: Vec<KeyframeReport>,
    /// Fraction of the motion after the actuation pose that is reachable and collision-free, 0..1.
    pub reached_fraction: f64,
    /// Collisions that block the motion.
    pub collisions: Vec<Collision>,
    /// Depth (m) of the deepest overlap at the start among the pairs of bodies that are checked.
    pub start_overlap: f64,
}

impl Plan {
    /// Returns the status without the motion.
    #[must_use]
    pub fn status(&self) -> Status {
        self.outcome.status()
    }

    /// Returns the motion, if there is one.
    #[must_use]
    pub fn trajectory(&self) -> Option<&Trajectory> {
        self.outcome.trajectory()
    }
}

/// CPU time (s) of the planning thread in each stage. The plan does not hold these times, because plans are
/// reproducible.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[non_exhaustive]
pub struct StageTimes {
    /// Preparing the collision checks and checking the start.
    pub setup: f64,
    /// Searching the actuation pose.
    pub actuation: f64,
    /// All later stages: following paths, collision checks and timing.
    pub trajectory: f64,
}

/// Plans the motion for one problem.
#[must_use]
pub fn plan(problem: &KeypointProblem) -> Plan {
    plan_timed(problem, &Cancel::new()).0
}

/// Plans the motion for one problem, and returns the plan with the time of each stage. Planning ends early with
/// [`Status::Cancelled`] if `cancel` is set.
#[must_use]
pub fn plan_timed(problem: &KeypointProblem, cancel: &Cancel) -> (Plan, StageTimes) {
    let request = Request { cancel: Some(cancel.clone()), ..Request::default() };
    plan_with(problem, &request)
        .unwrap_or_else(|e| (refused(Lack::ActuationInfeasible, e.to_string()), StageTimes::default()))
}

/// Plans the motion for one problem with the options in `request`, and returns the plan with the time of each stage.
///
/// # Errors
/// The motion has no keyframe with the requested label; or the keyframe lies after the actuation pose and `warm_start`
/// has no actuation pose.
pub fn plan_with(problem: &KeypointProblem, request: &Request<'_>) -> Result<(Plan, StageTimes), ProblemError> {
    let begun = std::time::Instant::now();
    let mut times = StageTimes::default();
    let clock = cpu_time::ThreadTime::now();
    if request.cancel.as_ref().is_some_and(Cancel::is_cancelled) {
        return Ok((refused(Lack::Cancelled, "it was cancelled".to_owned()), times));
    }
    let model = Model::of_hand(&problem.robot, &resting_joints(problem)?)?;
    let resolved = problem.resolve()?;
    let entry = entry(problem, request)?;
    let over = request.cancel.clone().unwrap_or_default().until(end_of(begun, request.deadline));
    let mut search = ActuationSearch::new(problem, &model, &resolved);
    search.over = over.clone();
    let mut planner = match Planner::new(problem, &model, &resolved, request, begun, entry, over) {
        Ok(planner) => planner,
        Err(e) => {
            let joint = &problem.robot.joints()[model.map().indices()[e.joint]].name();
            let reason = format!("{joint} cannot be stopped in time: {}", e.reason);
            times.setup = clock.elapsed().as_secs_f64();
            return Ok((refused(Lack::CannotStop, reason), times));
        }
    };
    let blocked = planner.too_deep_at_start();
    times.setup = clock.elapsed().as_secs_f64();
    if let Some(plan) = blocked {
        return Ok((plan, times));
    }
    let joints = problem.robot.joints().len();
    if let Some(warm_start) = request.warm_start
        && let Some(x) = warm_start_pose(warm_start, |q| model.pick(q), joints)
        && let Some(plan) = planner.warm_start_motion(&mut search, &x)
    {
        times.trajectory = clock.elapsed().as_secs_f64() - times.setup;
        return Ok((plan, times));
    }
    let found = search.cheapest(problem.options.num_seeds);
    times.actuation = clock.elapsed().as_secs_f64() - times.setup;
    let plan = match found.candidates.first() {
        None if planner.world.is_over() => planner.ended("no actuation pose was found"),
        None => {
            let boxed = outside_the_box(problem, &model, &resolved, found.best_effort.as_ref());
            planner.infeasible(found.best_effort, boxed)
        }
        Some(_) => planner.whole_motion(&found, &mut search),
    };
    times.trajectory = clock.elapsed().as_secs_f64() - times.setup - times.actuation;
    Ok((plan, times))
}

/// Distance (m) from the faces of the workspace box at which the box no longer keeps the hand from its target.
const INSIDE: f64 = 0.02;

/// Returns how far (m) the hand lies outside the workspace box at the best pose that meets the other constraints.
/// `None` if there is no such pose or no box. The search begins at `nearest`, the pose that misses all constraints least;
/// if its hand is well inside the box, the box is not the reason.
fn outside_the_box(
    problem: &KeypointProblem,
    model: &Model,
    resolved: &Resolved,
    nearest: Option<&Row>,
) -> Option<f64> {
    let [low, high] = problem.options.workspace?;
    let mut open = problem.clone();
    open.options.workspace = None;
    let mut search = ActuationSearch::new(&open, model, resolved);
    let is_inside = |x: &Row| {
        let hand = search.hand(x).translation.vector;
        (0..3).all(|i| hand[i] > low[i] + INSIDE && hand[i] < high[i] - INSIDE)
    };
    if nearest.is_some_and(is_inside) {
        return None;
    }
    let candidates = match nearest.and_then(|x| search.from(x)) {
        Some(candidate) => vec![candidate],
        None => search.all(problem.options.num_seeds).candidates,
    };
    let mut outside = |x: &Row| {
        let hand = search.hand(x).translation.vector;
        (0..3).map(|i| (low[i] - hand[i]).max(hand[i] - high[i])).fold(0.0, f64::max)
    };
    candidates.iter().map(|c| outside(&c.x)).reduce(f64::min)
}

/// Returns the index of the first keyframe that the motion must reach. Keyframes are numbered in time order.
fn entry(problem: &KeypointProblem, request: &Request<'_>) -> Result<usize, ProblemError> {
    let Some(label) = request.resume else { return Ok(0) };
    let schedule = Schedule::of(&problem.config);
    let entry = schedule
        .keyframe(label)
        .ok_or_else(|| ProblemError::new("resume", format!("{label:?} is not a keyframe of the motion: {schedule}")))?;
    let posed = request.warm_start.is_some_and(|f| f.q_plan.as_ref().is_some_and(|q| q.len() == problem.q_start.len()));
    if entry > schedule.actuation() && !posed {
        let message = format!(
            "{label:?} comes after the actuation pose; pass the earlier plan, which contains the actuation pose"
        );
        return Err(ProblemError::new("warm_start", message));
    }
    Ok(entry)
}

/// Returns distinct joint vectors that meet the constraints, ignoring obstacles: at most `max_solutions`, the cheapest
/// first.
///
/// # Errors
/// A problem from [`KeypointProblem::builder`] never causes an error.
pub fn ik(problem: &KeypointProblem, max_solutions: usize) -> Result<Vec<IkSolution>, ProblemError> {
    let model = Model::of_hand(&problem.robot, &resting_joints(problem)?)?;
    let resolved = problem.resolve()?;
    let mut search = ActuationSearch::new(problem, &model, &resolved);
    let seeds = problem.options.num_seeds;
    let found = if max_solutions > 1 { search.all(seeds) } else { search.cheapest(seeds) };
    let full = |x| {
        let mut q = Vec::new();
        model.map().positions(x, &mut q);
        q
    };
    Ok(found.candidates.iter().take(max_solutions).map(|c| IkSolution { q: full(&c.x), cost: c.cost }).collect())
}

/// A joint vector that meets the constraints.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct IkSolution {
    /// Joint values (rad or m), one entry for each joint.
    pub q: Vec<f64>,
    /// Cost of the joint vector.
    pub cost: f64,
}

/// Plans many problems on `threads` threads, 1 to [`MAX_THREADS`](crate::MAX_THREADS); `None` uses one thread for each
/// processor core. Each result equals that of [`plan_timed`].
///
/// # Errors
/// The number of threads is out of range, or threads cannot be started.
pub fn plan_batch(
    problems: &[&KeypointProblem],
    threads: Option<usize>,
    cancel: &Cancel,
) -> Result<Vec<(Plan, StageTimes)>, ProblemError> {
    in_parallel(problems, threads, |p| plan_timed(p, cancel))
}

fn refused(lack: Lack, reason: String) -> Plan {
    Plan {
        schema_version: 3,
        outcome: Outcome::Failed(lack),
        reason,
        margin: 0.0,
        tight: Vec::new(),
        touches: Vec::new(),
        guesses: Vec::new(),
        assumed_limits: Vec::new(),
        warnings: Vec::new(),
        q_actuation: None,
        cost: None,
        q_best_effort: None,
        q_plan: None,
        rank: None,
        tried: 0,
        tried_poses: Vec::new(),
        residuals: Vec::new(),
        keyframes: Vec::new(),
        reached_fraction: 0.0,
        collisions: Vec::new(),
        start_overlap: 0.0,
    }
}

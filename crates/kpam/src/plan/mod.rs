//! Putting it together: the cheapest actuation pose whose whole motion is reachable and free.

mod approach;
mod attempt;
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
    /// Type and what it binds.
    pub name: String,
    /// Largest coordinate difference (m) or angle from the target angle (rad).
    pub residual: f64,
    /// Tolerance of the config.
    pub tolerance: f64,
    /// Whether it does.
    pub satisfied: bool,
}

/// A keyframe of the motion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct KeyframeReport {
    /// In time: ..., `pre_1`, `pre_0`, `actuation`, `post_0`, ..., `let_go`; numbers are places in the config's lists.
    pub label: String,
    /// Time (s), where the motion has one.
    pub time: Option<f64>,
    /// Hand in the base frame, rows.
    pub hand: [[f64; 4]; 4],
    /// Whether the motion found gets there.
    pub reached: bool,
}

/// Two bodies too near each other.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Collision {
    /// Link and body, or two links.
    pub bodies: [String; 2],
    /// Time (s), where the motion has one.
    pub time: Option<f64>,
    /// Keyframe that the motion was leading to.
    pub toward: String,
    /// Signed distance (m).
    pub distance: f64,
    /// Place in the base frame (m).
    pub point: [f64; 3],
}

/// Two bodies that are nearer to each other at a keyframe than the margin, though they may not touch on the way there, or
/// from there on. The motion in which they may not keeps what they have there, in place of the margin.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Tight {
    /// Link and body, or two links.
    pub bodies: [String; 2],
    /// `start`, or the label of a keyframe.
    pub at: String,
    /// Signed distance (m).
    pub distance: f64,
}

/// Two bodies that overlap at a keyframe and may: a contact.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Touch {
    /// Link and body, or two links.
    pub bodies: [String; 2],
    /// Label of the keyframe.
    pub at: String,
    /// Depth (m).
    pub depth: f64,
}

/// Assumed travel of the object's joint during a motion whose travel the config leaves open.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Guess {
    /// The keyframe that the motion leads to.
    pub toward: String,
    /// Travel of the joint (rad or m) over the motion.
    pub travel: f64,
    /// Overlap (m) with what the joint moves that is let pass for it.
    pub depth: f64,
}

/// Outcome of an actuation pose.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct TriedPose {
    /// Joint vector (rad or m), one entry a joint.
    pub q: Vec<f64>,
    /// Its number in the order of trial.
    pub rank: usize,
    /// Status of its motion.
    pub status: Status,
    /// One sentence for a person.
    pub reason: String,
}

/// Result of planning: motion, residuals, failures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Plan {
    /// Version of this value's layout.
    pub schema_version: u32,
    /// Outcome of planning, with the motion.
    pub outcome: Outcome,
    /// One sentence for a person.
    pub reason: String,
    /// Clearance (m) that the motion keeps from what it may not touch, but for what is `tight`.
    pub margin: f64,
    /// Pairs that are nearer than that at the start or at a keyframe.
    pub tight: Vec<Tight>,
    /// Permitted overlaps at keyframes.
    pub touches: Vec<Touch>,
    /// Motions that move the object's joint by an amount that is a guess.
    pub guesses: Vec<Guess>,
    /// Limits (`acceleration`, `jerk`) of which nothing was said, so that plain ones are assumed.
    pub assumed_limits: Vec<String>,
    /// Warnings to the caller.
    pub warnings: Vec<String>,
    /// The cheapest pose that meets the constraints, obstacles left out.
    pub q_actuation: Option<Vec<f64>>,
    /// Its cost.
    pub cost: Option<f64>,
    /// If no pose meets them: the one that misses least.
    pub q_best_effort: Option<Vec<f64>>,
    /// The actuation pose that the trajectory takes (or that came furthest).
    pub q_plan: Option<Vec<f64>>,
    /// Number of that pose in the order of trial: 0 is the cheapest.
    pub rank: Option<usize>,
    /// Number of poses whose motion was tried.
    pub tried: usize,
    /// Outcome of each of them, where [`Request::explain`] asks for it.
    pub tried_poses: Vec<TriedPose>,
    /// Constraints at `q_plan`, else at `q_actuation`, else at `q_best_effort`.
    pub residuals: Vec<Residual>,
    /// Keyframes that follow from `q_plan`.
    pub keyframes: Vec<KeyframeReport>,
    /// Part of the motion after the actuation pose that can be taken, 0..1 of its paths.
    pub reached_fraction: f64,
    /// Obstacle.
    pub collisions: Vec<Collision>,
    /// Deepest checked overlap at the start (m).
    pub start_overlap: f64,
}

impl Plan {
    /// Status as a word.
    #[must_use]
    pub fn status(&self) -> Status {
        self.outcome.status()
    }

    /// The motion, where there is one.
    #[must_use]
    pub fn trajectory(&self) -> Option<&Trajectory> {
        self.outcome.trajectory()
    }
}

/// CPU time of the planning thread by stages (s); beside the plan, because a plan is the same on every run.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[non_exhaustive]
pub struct StageTimes {
    /// The world compiled, and the start looked at.
    pub setup: f64,
    /// Actuation pose.
    pub actuation: f64,
    /// Everything after it.
    pub trajectory: f64,
}

/// Plans one problem.
#[must_use]
pub fn plan(problem: &KeypointProblem) -> Plan {
    plan_timed(problem, &Cancel::new()).0
}

/// As [`plan`], with the time each stage took; ends early, with [`Status::Cancelled`], where `cancel` is set.
#[must_use]
pub fn plan_timed(problem: &KeypointProblem, cancel: &Cancel) -> (Plan, StageTimes) {
    let request = Request { cancel: Some(cancel.clone()), ..Request::default() };
    plan_with(problem, &request)
        .unwrap_or_else(|e| (refused(Lack::ActuationInfeasible, e.to_string()), StageTimes::default()))
}

/// As [`plan_timed`], with what the request asks for.
///
/// # Errors
/// A keyframe that the motion does not have, or one past the actuation pose without an earlier plan that has one.
pub fn plan_with(problem: &KeypointProblem, request: &Request<'_>) -> Result<(Plan, StageTimes), ProblemError> {
    let begun = std::time::Instant::now();
    let mut times = StageTimes::default();
    let clock = cpu_time::ThreadTime::now();
    if request.cancel.as_ref().is_some_and(Cancel::is_cancelled) {
        return Ok((refused(Lack::Cancelled, "it was cancelled".to_owned()), times));
    }
    let model = Model::new(&problem.robot, &resting_joints(problem)?)?;
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
            let boxed = outside_the_box(problem, &model, &resolved);
            planner.infeasible(found.best_effort, boxed)
        }
        Some(_) => planner.whole_motion(&found, &mut search),
    };
    times.trajectory = clock.elapsed().as_secs_f64() - times.setup - times.actuation;
    Ok((plan, times))
}

/// Distance (m) of the hand outside the workspace box where it meets the constraints; `None` where it meets them
/// nowhere, or there is no box.
fn outside_the_box(problem: &KeypointProblem, model: &Model, resolved: &Resolved) -> Option<f64> {
    let [low, high] = problem.options.workspace?;
    let mut open = problem.clone();
    open.options.workspace = None;
    let mut search = ActuationSearch::new(&open, model, resolved);
    let found = search.all(problem.options.num_seeds);
    let mut outside = |x: &Row| {
        let hand = search.hand(x).translation.vector;
        (0..3).map(|i| (low[i] - hand[i]).max(hand[i] - high[i])).fold(0.0, f64::max)
    };
    found.candidates.iter().map(|c| outside(&c.x)).reduce(f64::min)
}

/// Number in time of the keyframe that the motion goes to first.
fn entry(problem: &KeypointProblem, request: &Request<'_>) -> Result<usize, ProblemError> {
    let Some(label) = request.resume else { return Ok(0) };
    let schedule = Schedule::of(&problem.config);
    let entry = schedule
        .keyframe(label)
        .ok_or_else(|| ProblemError::new("resume", format!("{label:?} is not a keyframe of the motion: {schedule}")))?;
    let posed = request.warm_start.is_some_and(|f| f.q_plan.as_ref().is_some_and(|q| q.len() == problem.q_start.len()));
    if entry > schedule.actuation() && !posed {
        let message = format!("{label:?} lies past the actuation pose; pass the earlier plan that has one");
        return Err(ProblemError::new("warm_start", message));
    }
    Ok(entry)
}

/// The cheapest distinct poses that meet the constraints, cheapest first and at most `max_solutions`, obstacles left out.
///
/// # Errors
/// None for a problem that was built.
pub fn ik(problem: &KeypointProblem, max_solutions: usize) -> Result<Vec<IkSolution>, ProblemError> {
    let model = Model::new(&problem.robot, &resting_joints(problem)?)?;
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

/// A pose that meets the constraints.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct IkSolution {
    /// Joint values, one entry a joint.
    pub q: Vec<f64>,
    /// Its cost.
    pub cost: f64,
}

/// Most threads that [`plan_batch`] starts.
pub const MAX_THREADS: usize = 256;

/// Plans many problems on `threads` threads, 1 to [`MAX_THREADS`] (one a core where `None`). Each result is that of
/// [`plan_timed`].
///
/// # Errors
/// A number of threads out of range, or threads that cannot be started.
pub fn plan_batch(
    problems: &[&KeypointProblem],
    threads: Option<usize>,
    cancel: &Cancel,
) -> Result<Vec<(Plan, StageTimes)>, ProblemError> {
    use rayon::prelude::*;
    if let Some(count) = threads
        && !(1..=MAX_THREADS).contains(&count)
    {
        return Err(ProblemError::new("threads", format!("must be 1 to {MAX_THREADS}, not {count}")));
    }
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads.unwrap_or(cores).min(MAX_THREADS).min(problems.len()).max(1))
        .build()
        .map_err(|e| ProblemError::new("threads", format!("cannot be started: {e}")))?;
    Ok(pool.install(|| problems.par_iter().map(|p| plan_timed(p, cancel)).collect()))
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

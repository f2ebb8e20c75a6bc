//! Putting it together: the cheapest actuation pose whose whole motion is reachable and free.

mod attempt;
mod planner;
mod report;

use serde::{Deserialize, Serialize};

use crate::actuation::ActuationSearch;
use crate::contact::{Clearances, Judge};
use crate::fingers::resting_joints;
use crate::model::Model;
use crate::{Cancel, KeypointProblem, ProblemError, Trajectory};
use planner::Planner;

/// How planning ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// The whole motion is reachable and free.
    Solved,
    /// A part of the motion that the caller allowed to take.
    Partial,
    /// No joint values meet the constraints.
    ActuationInfeasible,
    /// A keyframe is out of reach from every actuation pose tried.
    Unreachable,
    /// Something is in the way from every actuation pose tried.
    Collision,
    /// The clock asks for more than the joints' limits give.
    TooFast,
    /// The search for a free motion spent its samples and found none; there may be one.
    NotFound,
    /// The caller cancelled it.
    Cancelled,
}

impl Status {
    /// Name, as in reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Solved => "solved",
            Self::Partial => "partial",
            Self::ActuationInfeasible => "actuation_infeasible",
            Self::Unreachable => "unreachable",
            Self::Collision => "collision",
            Self::TooFast => "too_fast",
            Self::NotFound => "not_found",
            Self::Cancelled => "cancelled",
        }
    }
}

/// How one constraint is met.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Residual {
    /// Type and what it binds.
    pub name: String,
    /// Largest coordinate difference (m) or angle from the target angle (rad).
    pub residual: f64,
    /// What the config allows.
    pub tolerance: f64,
    /// Whether it does.
    pub satisfied: bool,
}

/// A keyframe of the motion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct KeyframeReport {
    /// In time: ..., `pre_1`, `pre_0`, `actuation`, `post_0`, ...; numbers are places in the config's lists.
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
pub struct Collision {
    /// Link and body, or two links.
    pub bodies: [String; 2],
    /// Time (s), where the motion has one.
    pub time: Option<f64>,
    /// Keyframe that the motion was leading to.
    pub toward: String,
    /// Signed distance (m).
    pub distance: f64,
    /// Where, in the base frame (m).
    pub point: [f64; 3],
}

/// What was solved, each residual, and what failed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// Version of this value's layout.
    pub schema_version: u32,
    /// How planning ended.
    pub status: Status,
    /// One sentence for a person.
    pub reason: String,
    /// What a caller should know beside that.
    pub warnings: Vec<String>,
    /// The cheapest pose that meets the constraints, obstacles left out.
    pub q_actuation: Option<Vec<f64>>,
    /// Its cost.
    pub cost: Option<f64>,
    /// Where no pose meets them: the one that misses least.
    pub q_best_effort: Option<Vec<f64>>,
    /// The actuation pose that the trajectory takes (or that came furthest).
    pub q_plan: Option<Vec<f64>>,
    /// Number of that pose in the order of trial: 0 is the cheapest.
    pub rank: Option<usize>,
    /// Number of poses whose motion was tried.
    pub tried: usize,
    /// Constraints at `q_plan`, else at `q_actuation`, else at `q_best_effort`.
    pub residuals: Vec<Residual>,
    /// Keyframes that follow from `q_plan`.
    pub keyframes: Vec<KeyframeReport>,
    /// The motion.
    pub trajectory: Option<Trajectory>,
    /// Part of the motion after the actuation pose that can be taken, 0..1 of its paths.
    pub reached_fraction: f64,
    /// What is in the way.
    pub collisions: Vec<Collision>,
    /// Deepest judged overlap at the start (m).
    pub start_overlap: f64,
}

/// CPU time of the planning thread in the two stages (s); beside the plan, because a plan is the same on every run.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct StageTimes {
    /// Actuation pose.
    pub actuation: f64,
    /// Everything after it.
    pub trajectory: f64,
}

/// Plans one problem.
///
/// The problem must have passed [`KeypointProblem::check`]; one that has not is reported as infeasible, not a panic.
#[must_use]
pub fn plan(problem: &KeypointProblem) -> Plan {
    plan_timed(problem, &Cancel::new()).0
}

/// As [`plan`], with the time each stage took; ends early, with [`Status::Cancelled`], where `cancel` is set.
#[must_use]
pub fn plan_timed(problem: &KeypointProblem, cancel: &Cancel) -> (Plan, StageTimes) {
    let mut times = StageTimes::default();
    if cancel.is_cancelled() {
        return (Plan { status: Status::Cancelled, ..refused("it was cancelled".to_owned()) }, times);
    }
    let clock = cpu_time::ThreadTime::now();
    let model = resting_joints(problem).and_then(|rest| Model::new(&problem.robot, &rest));
    let (model, resolved) = match (model, problem.resolve()) {
        (Ok(model), Ok(resolved)) => (model, resolved),
        (Err(e), _) | (_, Err(e)) => return (refused(e.to_string()), times),
    };
    let mut search = ActuationSearch::new(problem, &model, &resolved);
    let found = search.run(problem.options.starts);
    times.actuation = clock.elapsed().as_secs_f64();
    let mut planner = Planner::new(problem, &model, &resolved);
    let plan = match found.candidates.first() {
        None => planner.infeasible(found.best_effort),
        Some(_) => planner.whole_motion(&found, &mut search),
    };
    times.trajectory = clock.elapsed().as_secs_f64() - times.actuation;
    (plan, times)
}

/// Most threads that [`plan_batch`] starts.
pub const MOST_THREADS: usize = 256;

/// Plans many problems on `threads` threads, 1 to [`MOST_THREADS`] (one a core where `None`). Each result is that of
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
        && !(1..=MOST_THREADS).contains(&count)
    {
        return Err(ProblemError::new("threads", format!("must be 1 to {MOST_THREADS}, not {count}")));
    }
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads.unwrap_or(cores).min(MOST_THREADS).min(problems.len()).max(1))
        .build()
        .map_err(|e| ProblemError::new("threads", format!("cannot be started: {e}")))?;
    Ok(pool.install(|| problems.par_iter().map(|p| plan_timed(p, cancel)).collect()))
}

fn refused(reason: String) -> Plan {
    Plan {
        schema_version: 1,
        status: Status::ActuationInfeasible,
        reason,
        warnings: Vec::new(),
        q_actuation: None,
        cost: None,
        q_best_effort: None,
        q_plan: None,
        rank: None,
        tried: 0,
        residuals: Vec::new(),
        keyframes: Vec::new(),
        trajectory: None,
        reached_fraction: 0.0,
        collisions: Vec::new(),
        start_overlap: 0.0,
    }
}

/// Most places of a motion that [`min_clearance`] measures.
pub const MOST_CHECKS: usize = 100_000;

/// Smallest signed distances (m) of judged pairs along a plan's motion, sampled every `step` seconds. `None` where a
/// plan has no motion or `cancel` is set; infinite where nothing is judged within a metre.
///
/// # Errors
/// A step that is not positive, or that would make more than [`MOST_CHECKS`] of the motion.
pub fn min_clearance(
    problem: &KeypointProblem,
    plan: &Plan,
    step: f64,
    cancel: &Cancel,
) -> Result<Option<[f64; 3]>, ProblemError> {
    let Some(trajectory) = &plan.trajectory else { return Ok(None) };
    let (start, end) = (trajectory.start(), trajectory.end());
    let steps = ((end - start) / step).ceil().max(1.0);
    if !(step > 0.0 && steps <= MOST_CHECKS as f64) {
        let least = (end - start) / MOST_CHECKS as f64;
        return Err(ProblemError::new("step", format!("must be at least {least:.3e} s for this motion, not {step}")));
    }
    let model = Model::new(&problem.robot, &resting_joints(problem)?)?;
    let mut judge = Judge::new(problem, &model);
    let mut out = Clearances { itself: f64::INFINITY, table: f64::INFINITY, object: f64::INFINITY };
    let due: Vec<f64> = plan.keyframes.iter().filter_map(|k| k.time).collect();
    for k in 0..=steps as usize {
        if cancel.is_cancelled() {
            return Ok(None);
        }
        let t = (start + step * k as f64).min(end);
        let stage = 1 + due.iter().filter(|d| **d < t - 1e-9).count();
        judge.measure(&trajectory.moving(t), stage, &mut out);
    }
    Ok(Some([out.itself, out.table, out.object]))
}

//! Putting it together: the cheapest actuation pose whose whole motion is reachable and free.

use gensim2_geometry::{Pose, pose_to_matrix};
use serde::{Deserialize, Serialize};

use crate::actuation::{Actuation, ActuationSearch, Candidate};
use crate::contact::{Clearances, Hit, Judge, Margins, TOUCH};
use crate::free_space;
use crate::hand_path::Follower;
use crate::model::{MOST_JOINTS, Model, Row};
use crate::motion::{Motions, motions};
use crate::options::Timing;
use crate::problem::Resolved;
use crate::trajectory::{Builder, Curve, Limits};
use crate::{KeypointProblem, Trajectory};

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
    /// `pre_0`, ..., `actuation`, `post_0`, ...
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
    plan_timed(problem).0
}

/// As [`plan`], with the time each stage took.
#[must_use]
pub fn plan_timed(problem: &KeypointProblem) -> (Plan, StageTimes) {
    let mut times = StageTimes::default();
    let clock = cpu_time::ThreadTime::now();
    let rest = resting_joints(problem);
    let (model, resolved) = match (Model::new(&problem.robot, &rest), problem.resolve()) {
        (Some(model), Ok(resolved)) => (model, resolved),
        (None, _) => return (refused("the robot has no joints to plan for".to_owned()), times),
        (_, Err(e)) => return (refused(e.to_string()), times),
    };
    let mut search = ActuationSearch::new(problem, &model, &resolved);
    let found = search.run(problem.options.seeds);
    times.actuation = clock.elapsed().as_secs_f64();
    let mut planner = Planner::new(problem, &model, &resolved);
    let plan = match found.candidates.first() {
        None => planner.infeasible(found.best_effort),
        Some(_) => planner.whole_motion(&found, &mut search),
    };
    times.trajectory = clock.elapsed().as_secs_f64() - times.actuation;
    (plan, times)
}

/// Plans many problems on `threads` threads (all cores where `None`). Each result is that of [`plan_timed`].
///
/// # Errors
/// A sentence, where the threads cannot be started.
pub fn plan_batch(problems: &[&KeypointProblem], threads: Option<usize>) -> Result<Vec<(Plan, StageTimes)>, String> {
    use rayon::prelude::*;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads.unwrap_or(0))
        .build()
        .map_err(|e| format!("cannot start threads: {e}"))?;
    Ok(pool.install(|| problems.par_iter().map(|p| plan_timed(p)).collect()))
}

/// Joint values while planning: the start, with fingers at the width asked for.
fn resting_joints(problem: &KeypointProblem) -> Vec<f64> {
    let mut rest = problem.q_start.clone();
    if let Some(width) = problem.options.finger_width {
        let robot = &problem.robot;
        for (l, link) in robot.links().iter().enumerate() {
            let mut above = Some(l);
            while let Some(a) = above
                && a != robot.hand()
            {
                above = robot.links()[a].parent;
            }
            if let (Some(j), Some(_)) = (link.joint, above)
                && l != robot.hand()
            {
                rest[j] = width;
            }
        }
    }
    rest
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

/// Why a candidate's motion ends before its end.
#[derive(Debug, Clone)]
enum Failure {
    /// The hand cannot follow the path to this keyframe beyond this fraction.
    Unreachable { keyframe: usize, fraction: f64 },
    /// Something is in the way on the path to this keyframe.
    Blocked { keyframe: usize, hit: Hit },
    /// The clock allows this much less than needed.
    TooFast { keyframe: usize, allowed: f64, needed: f64 },
}

/// A candidate's motion as far as it goes: joint waypoints of each path, and what stopped it.
struct Attempt {
    x: Row,
    rank: usize,
    motions: Motions,
    /// Free motions to the first keyframe, each from rest to rest; empty where there is none.
    approach: Vec<Vec<Row>>,
    /// Waypoints of the path to keyframe i + 1, as far as it goes.
    paths: Vec<Vec<Row>>,
    /// Number of whole paths after the actuation and the fraction of the next one.
    after: (usize, f64),
    hits: Vec<(usize, Hit)>,
    failure: Option<Failure>,
    /// Whether approach and pre-actuation motions stand.
    starts: bool,
}

impl Attempt {
    fn score(&self) -> f64 {
        if self.starts { 1.0 + self.after.0 as f64 + self.after.1 } else { 0.0 }
    }
}

/// What has been tried, and the best of it.
#[derive(Default)]
struct Trial {
    best: Option<Attempt>,
    tried: usize,
    /// Poses that lack nothing but the free approach, with their ranks.
    again: Vec<(Row, usize)>,
}

impl Trial {
    fn done(&self) -> bool {
        self.best.as_ref().is_some_and(|b| b.failure.is_none())
    }

    fn score(&self) -> f64 {
        self.best.as_ref().map_or(0.0, Attempt::score)
    }

    fn keep(&mut self, attempt: Attempt) {
        if self.best.as_ref().is_none_or(|b| attempt.failure.is_none() || attempt.score() > b.score()) {
            self.best = Some(attempt);
        }
    }
}

struct Planner<'p> {
    problem: &'p KeypointProblem,
    model: &'p Model,
    resolved: &'p Resolved,
    follower: Follower<'p>,
    judge: Judge<'p>,
    limits: Limits,
    clock: Option<Vec<f64>>,
    /// Where the start leaves what it overlaps, once that was looked for.
    exit: Option<Option<Row>>,
}

/// Samples of the first round over all candidates; only where all fail is the full number spent.
const FIRST_SAMPLES: usize = 150;
/// Clearance (m) of the free approach where the one asked for cannot be kept.
const TIGHT: f64 = 2e-4;
/// Candidates that get the full number.
const SECOND_CHANCES: usize = 4;

impl<'p> Planner<'p> {
    fn new(problem: &'p KeypointProblem, model: &'p Model, resolved: &'p Resolved) -> Self {
        let timing =
            problem.options.timing.unwrap_or(if problem.config.has_times() { Timing::Config } else { Timing::Limits });
        let clock = match timing {
            Timing::Limits => None,
            // The config's own check has passed; a start time past its first keyframe ends as TooFast.
            Timing::Config => problem.config.clock(f64::NEG_INFINITY).ok(),
        };
        Self {
            problem,
            model,
            resolved,
            follower: Follower::new(problem, model),
            judge: Judge::new(problem, model),
            limits: Limits::of(problem, model),
            clock,
            exit: None,
        }
    }

    fn full(&self, x: &Row) -> Vec<f64> {
        let mut q = Vec::new();
        self.model.fill(&self.problem.robot, x, &mut q);
        q
    }

    fn residuals(&mut self, x: &Row) -> Vec<Residual> {
        let hand = self.follower.hand(x);
        let mut out: Vec<(usize, f64, f64)> = Vec::new();
        for p in &self.resolved.points {
            let miss = (hand.rotation * p.on_hand + hand.translation.vector - p.target).amax();
            out.push((p.entry, miss, p.tolerance));
        }
        for a in &self.resolved.axes {
            out.push((a.entry, a.residual(&hand), a.tolerance));
        }
        out.sort_by_key(|(entry, _, _)| *entry);
        out.into_iter()
            .map(|(entry, residual, tolerance)| Residual {
                name: self.problem.config.constraints[entry].name(),
                residual,
                tolerance,
                satisfied: residual <= tolerance,
            })
            .collect()
    }

    fn infeasible(&mut self, best_effort: Option<Row>) -> Plan {
        let mut out = refused("no joint values meet the constraints".to_owned());
        out.start_overlap = self.judge.start_overlap;
        if let Some(x) = best_effort {
            out.q_best_effort = Some(self.full(&x));
            out.residuals = self.residuals(&x);
            let worst = out
                .residuals
                .iter()
                .filter(|r| !r.satisfied)
                .max_by(|a, b| (a.residual - a.tolerance).total_cmp(&(b.residual - b.tolerance)));
            out.reason = match worst {
                Some(r) => format!(
                    "no joint values meet the constraints: at best {} misses by {:.4} (tolerance {})",
                    r.name,
                    r.residual - r.tolerance,
                    r.tolerance
                ),
                None => "the constraints can be met only outside the workspace box or the joint limits".to_owned(),
            };
            let hand = self.follower.hand(&x);
            out.keyframes = keyframe_reports(&motions(self.problem, &hand), |_| (None, false));
        }
        out
    }

    fn whole_motion(&mut self, found: &Actuation, search: &mut ActuationSearch<'_>) -> Plan {
        let cheapest = found.candidates[0];
        let options = &self.problem.options;
        let (samples, most) = (options.samples, options.candidates);
        let mut trial = Trial::default();
        self.try_each(&found.candidates, most, samples.min(FIRST_SAMPLES), &mut trial);
        if !trial.done() && found.used < options.seeds {
            // The poses that the cheapest one did not need, cheapest first.
            let more = search.more(found.used, options.seeds);
            let left = most.saturating_sub(trial.tried);
            self.try_each(&more, left, samples.min(FIRST_SAMPLES), &mut trial);
        }
        // Yet more poses of the same constraints, for a motion that the cheap ones do not allow.
        let mut extra = 0;
        for seed in options.seeds..options.seeds + options.harvest {
            if trial.done() || extra > most {
                break;
            }
            let Some(c) = search.sample(seed) else { continue };
            let at_once = self.try_one(&c.x, samples.min(FIRST_SAMPLES), &mut trial);
            // Poses that overlap something themselves cost next to nothing to turn down.
            extra += usize::from(!at_once);
        }
        for (x, rank) in std::mem::take(&mut trial.again) {
            if trial.done() {
                break;
            }
            let attempt = self.attempt(&x, rank, samples, trial.score());
            trial.keep(attempt);
        }
        let Trial { best, tried, .. } = trial;
        let mut out = match best {
            Some(attempt) => self.report(attempt),
            None => refused("no actuation pose was tried".to_owned()),
        };
        out.tried = tried;
        out.q_actuation = Some(self.full(&cheapest.x));
        out.cost = Some(cheapest.cost);
        out.start_overlap = self.judge.start_overlap;
        if out.start_overlap > 0.0 {
            out.warnings.push(format!("the robot overlaps something by {:.4} m at the start", out.start_overlap));
        }
        out
    }

    fn try_each(&mut self, candidates: &[Candidate], most: usize, samples: usize, trial: &mut Trial) {
        for c in candidates.iter().take(most) {
            if trial.done() {
                return;
            }
            self.try_one(&c.x, samples, trial);
        }
    }

    /// Tries one pose; whether it was turned down at once, because it overlaps something itself.
    fn try_one(&mut self, x: &Row, samples: usize, trial: &mut Trial) -> bool {
        let attempt = self.attempt(x, trial.tried, samples, trial.score());
        trial.tried += 1;
        let blocked_approach = matches!(attempt.failure, Some(Failure::Blocked { keyframe: 0, .. }));
        if blocked_approach && samples < self.problem.options.samples && trial.again.len() < SECOND_CHANCES {
            trial.again.push((*x, attempt.rank));
        }
        let at_once = matches!(attempt.failure, Some(Failure::Blocked { keyframe, .. })
            if keyframe == attempt.motions.actuation && attempt.paths.iter().all(Vec::is_empty));
        trial.keep(attempt);
        at_once
    }

    /// The motion through the keyframes of one actuation pose, as far as it goes. The free approach is searched only
    /// where the motion goes further than one of score `bar`.
    fn attempt(&mut self, x: &Row, rank: usize, samples: usize, bar: f64) -> Attempt {
        let hand = self.follower.hand(x);
        let motions = motions(self.problem, &hand);
        let act = motions.actuation;
        let paths = vec![Vec::new(); motions.paths.len()];
        let mut out = Attempt {
            x: *x,
            rank,
            motions,
            approach: Vec::new(),
            paths,
            after: (0, 0.0),
            hits: Vec::new(),
            failure: None,
            starts: false,
        };
        let avoid = self.problem.options.avoid_collisions;
        // What overlapped at the start has come apart on the approach.
        let plain = Margins::plain(0.0).parted();
        if let Some(hit) = self.judge.at(x, act + 1, &plain) {
            out.hits.push((act, hit.clone()));
            if avoid {
                out.failure = Some(Failure::Blocked { keyframe: act, hit });
                return out;
            }
        }
        // Before the actuation everything must stand, or there is no motion at all.
        let mut first = *x;
        for i in (0..act).rev() {
            let followed = self.follower.follow(&out.motions.paths[i], &first, true);
            if followed.fraction < 1.0 {
                out.failure = Some(Failure::Unreachable { keyframe: i, fraction: followed.fraction });
                return out;
            }
            let mut waypoints = followed.waypoints;
            waypoints.reverse();
            if let Some((_, hit)) = self.judge.sweep_along(&waypoints, i + 2, &plain) {
                out.hits.push((i + 1, hit.clone()));
                if avoid {
                    out.failure = Some(Failure::Blocked { keyframe: i + 1, hit });
                    return out;
                }
            }
            first = waypoints[0];
            out.paths[i] = waypoints;
        }
        let mut last = *x;
        for i in act..out.motions.paths.len() {
            let followed = self.follower.follow(&out.motions.paths[i], &last, false);
            let mut waypoints = followed.waypoints;
            let mut fraction = followed.fraction;
            if fraction < 1.0 {
                out.failure = Some(Failure::Unreachable { keyframe: i + 1, fraction });
            }
            if let Some((k, hit)) = self.judge.sweep_along(&waypoints, i + 2, &plain) {
                out.hits.push((i + 1, hit.clone()));
                if avoid {
                    let steps = (waypoints.len() - 1).max(1) as f64;
                    fraction *= k as f64 / steps;
                    waypoints.truncate(k + 1);
                    out.failure = Some(Failure::Blocked { keyframe: i + 1, hit });
                }
            }
            last = waypoints[waypoints.len() - 1];
            out.paths[i] = waypoints;
            if out.failure.is_some() {
                out.after.1 = fraction;
                break;
            }
            out.after.0 += 1;
        }
        let further = 1.0 + out.after.0 as f64 + out.after.1 > bar;
        if out.failure.is_some() && !(self.problem.options.allow_partial && further) {
            // Still say how far it goes, but do not spend the free motion on it.
            return out;
        }
        match self.approach(&first, samples) {
            Ok((approach, hit)) => {
                out.approach = approach;
                out.hits.extend(hit.map(|h| (0, h)));
                out.starts = true;
                if let Some(failure) = self.too_fast(&out) {
                    out.starts = false;
                    out.failure = Some(failure);
                }
            }
            Err(hit) => {
                out.hits.push((0, hit.clone()));
                out.failure = Some(Failure::Blocked { keyframe: 0, hit });
            }
        }
        out
    }

    /// Free motion from the start to the first keyframe: pieces from rest to rest, and what it hits where hits do not
    /// count.
    fn approach(&mut self, goal: &Row, samples: usize) -> Result<(Vec<Vec<Row>>, Option<Hit>), Hit> {
        let n = self.model.n();
        let start = self.start_after_brake();
        let near = self.model.pick(&self.model.rest);
        let braking = self.judge.sweep(&near, &start, 1, &Margins::plain(0.0));
        let straight = |hit| Ok((vec![vec![start, *goal]], Some(hit)));
        if let Some(hit) = braking {
            return if self.problem.options.avoid_collisions { Err(hit) } else { straight(hit) };
        }
        if !self.problem.options.avoid_collisions {
            let hit = self.judge.sweep(&start, goal, 1, &Margins::plain(0.0));
            return Ok((vec![vec![start, *goal]], hit));
        }
        // What overlaps at the start comes apart first, and then stays apart.
        let out = self.way_out(&start);
        let (begin, mut pieces) = out.map_or((start, Vec::new()), |exit| (exit, vec![vec![start, exit]]));
        let wish = self.problem.options.margin;
        let (corners, margins) = match self.connect(&begin, goal, wish, out.is_some(), samples) {
            // The clearance is a wish; a free motion without it is still free.
            Err(_) if wish > TIGHT => self.connect(&begin, goal, TIGHT, out.is_some(), samples)?,
            other => other?,
        };
        if corners.len() == 2 {
            pieces.push(corners);
            return Ok((pieces, None));
        }
        // One smooth curve where it stays free, with knots ever closer to the corners; else stop at each corner.
        let (mut lower, mut upper) = (self.model.lower, self.model.upper);
        for v in 0..n {
            lower[v] = lower[v].min(begin[v]).min(goal[v]);
            upper[v] = upper[v].max(begin[v]).max(goal[v]);
        }
        for spacing in [0.5, 0.2, 0.08] {
            let curve = crate::trajectory::rounded(n, &corners, spacing);
            let course = Curve::new(n, &curve, &self.limits);
            if course.keeps_within(&lower, &upper)
                && self.judge.sweep_along(&course.along(0.05), 1, &margins.eased(1e-3)).is_none()
            {
                pieces.push(curve);
                return Ok((pieces, None));
            }
        }
        pieces.extend(corners.windows(2).map(<[Row]>::to_vec));
        Ok((pieces, None))
    }

    /// Corners of a free motion that keeps a clearance, and the margins that they keep to.
    fn connect(
        &mut self,
        from: &Row,
        to: &Row,
        clearance: f64,
        parted: bool,
        samples: usize,
    ) -> Result<(Vec<Row>, Margins), Hit> {
        let margins = self.judge.margins_between(from, to, 1, clearance);
        let margins = if parted { margins.parted() } else { margins };
        let corners = free_space::connect(&mut self.judge, self.model, from, to, 1, &margins, samples)?;
        Ok((corners, margins))
    }

    /// A free pose near the start, where that overlaps something and can get out of it.
    fn way_out(&mut self, start: &Row) -> Option<Row> {
        if self.judge.start_overlap <= TOUCH {
            return None;
        }
        if self.exit.is_none() {
            self.exit = Some(free_space::way_out(&mut self.judge, self.model, start, 1));
        }
        self.exit.flatten()
    }

    fn start_velocity(&self) -> Row {
        self.problem.options.start_velocity.as_ref().map_or([0.0; MOST_JOINTS], |v| self.model.pick(v))
    }

    fn start_after_brake(&self) -> Row {
        let mut builder = Builder::new(self.model.n(), self.limits, 0.0);
        builder.brake(&self.model.pick(&self.model.rest), &self.start_velocity())
    }

    /// The timed motion of an attempt as far as it goes, with the time at which each keyframe is met.
    fn timed(&self, attempt: &Attempt) -> Result<(Trajectory, Vec<Option<f64>>), Failure> {
        let count = attempt.motions.keyframes.len();
        let mut times = vec![None; count];
        let mut builder = Builder::new(self.model.n(), self.limits, self.problem.options.start_time);
        builder.brake(&self.model.pick(&self.model.rest), &self.start_velocity());
        let due = |keyframe: usize| self.clock.as_ref().map(|c| c[keyframe]);
        let late = |keyframe: usize, builder: &Builder, needed: f64| {
            let allowed = due(keyframe).map_or(0.0, |d| d - builder.now());
            Failure::TooFast { keyframe, allowed, needed }
        };
        let pieces = attempt.approach.len();
        let lengths: Vec<f64> = attempt.approach.iter().map(|p| crate::trajectory::length(self.model.n(), p)).collect();
        let total: f64 = lengths.iter().sum();
        let begin = builder.now();
        let mut gone = 0.0;
        for (k, piece) in attempt.approach.iter().enumerate() {
            gone += lengths[k];
            // Pieces share the time by their length.
            let end =
                due(0).map(|d| if k + 1 == pieces || total == 0.0 { d } else { begin + (d - begin) * gone / total });
            builder.push(piece, end).map_err(|needed| late(0, &builder, needed))?;
        }
        times[0] = Some(builder.now());
        for (i, waypoints) in attempt.paths.iter().enumerate() {
            if waypoints.len() < 2 {
                break;
            }
            let whole = i < attempt.motions.actuation + attempt.after.0;
            // A part of a path takes its part of the time.
            let end = due(i + 1).map(|d| if whole { d } else { builder.now() + (d - builder.now()) * attempt.after.1 });
            builder.push(waypoints, end).map_err(|needed| late(i + 1, &builder, needed))?;
            if whole {
                times[i + 1] = Some(builder.now());
            }
        }
        Ok((builder.build(&self.model.indices, &self.model.rest), times))
    }

    fn too_fast(&self, attempt: &Attempt) -> Option<Failure> {
        self.clock.as_ref()?;
        self.timed(attempt).err()
    }

    fn report(&mut self, attempt: Attempt) -> Plan {
        let act = attempt.motions.actuation;
        let label = |k: usize| attempt.motions.keyframes[k].label.clone();
        let mut out = refused(String::new());
        let timed = if attempt.starts {
            self.timed(&attempt)
        } else {
            Err(Failure::Unreachable { keyframe: 0, fraction: 0.0 })
        };
        let (trajectory, times) = match timed {
            Ok((trajectory, times)) => (Some(trajectory), times),
            Err(_) => (None, vec![None; attempt.motions.keyframes.len()]),
        };
        out.q_plan = Some(self.full(&attempt.x));
        out.rank = Some(attempt.rank);
        out.residuals = self.residuals(&attempt.x);
        let after = attempt.motions.paths.len() - act;
        out.reached_fraction = if after == 0 { 1.0 } else { (attempt.after.0 as f64 + attempt.after.1) / after as f64 };
        let paths = &attempt.paths;
        out.keyframes = keyframe_reports(&attempt.motions, |k| {
            let reached = if k <= act { k == act || !paths[k].is_empty() } else { k - act <= attempt.after.0 };
            (times[k], reached)
        });
        for (k, hit) in &attempt.hits {
            out.collisions.push(Collision {
                bodies: [hit.first.clone(), hit.second.clone()],
                time: times[*k].filter(|_| trajectory.is_some()),
                toward: label(*k),
                distance: hit.distance,
                point: [hit.at.x, hit.at.y, hit.at.z],
            });
        }
        let (status, reason) = match &attempt.failure {
            None => (Status::Solved, "the whole motion is reachable and free".to_owned()),
            Some(Failure::Unreachable { keyframe, fraction }) => (
                Status::Unreachable,
                format!("{} is out of reach: the hand gets {:.0} % of the way", label(*keyframe), 100.0 * fraction),
            ),
            Some(Failure::Blocked { keyframe, hit }) => (
                Status::Collision,
                format!(
                    "{} and {} come within {:.4} m on the way to {}, at ({:.3}, {:.3}, {:.3})",
                    hit.first,
                    hit.second,
                    hit.distance,
                    label(*keyframe),
                    hit.at.x,
                    hit.at.y,
                    hit.at.z
                ),
            ),
            Some(Failure::TooFast { keyframe, allowed, needed }) => (
                Status::TooFast,
                format!("the clock gives {allowed:.2} s to {}, the joints need {needed:.2} s", label(*keyframe)),
            ),
        };
        let partial = attempt.failure.is_some() && trajectory.is_some();
        out.status = if partial { Status::Partial } else { status };
        out.reason = reason;
        out.trajectory = trajectory;
        out
    }
}

fn keyframe_reports(motions: &Motions, state: impl Fn(usize) -> (Option<f64>, bool)) -> Vec<KeyframeReport> {
    motions
        .keyframes
        .iter()
        .enumerate()
        .map(|(k, frame)| {
            let (time, reached) = state(k);
            KeyframeReport { label: frame.label.clone(), time, hand: rows(&frame.hand), reached }
        })
        .collect()
}

fn rows(pose: &Pose) -> [[f64; 4]; 4] {
    let m = pose_to_matrix(pose);
    std::array::from_fn(|r| std::array::from_fn(|c| m[(r, c)]))
}

/// Smallest signed distances (m) of judged pairs along a plan's motion, sampled every `step` seconds. `None` where a
/// plan has no motion; infinite where nothing is judged within a metre.
#[must_use]
pub fn min_clearance(problem: &KeypointProblem, plan: &Plan, step: f64) -> Option<[f64; 3]> {
    let trajectory = plan.trajectory.as_ref()?;
    let model = Model::new(&problem.robot, &resting_joints(problem))?;
    let mut judge = Judge::new(problem, &model);
    let mut out = Clearances { itself: f64::INFINITY, table: f64::INFINITY, object: f64::INFINITY };
    let due: Vec<f64> = plan.keyframes.iter().filter_map(|k| k.time).collect();
    let steps = ((trajectory.end() - trajectory.start()) / step).ceil().max(1.0) as usize;
    for k in 0..=steps {
        let t = (trajectory.start() + step * k as f64).min(trajectory.end());
        let stage = 1 + due.iter().filter(|d| **d < t - 1e-9).count();
        judge.measure(&trajectory.moving(t), stage, &mut out);
    }
    Some([out.itself, out.table, out.object])
}

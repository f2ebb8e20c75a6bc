//! The search for the cheapest actuation pose whose whole motion is reachable and free.

use super::attempt::Attempt;
use super::failure::Failure;
use super::{Plan, Request, Status, TriedPose, refused};
use crate::KeypointProblem;
use crate::actuation::{Actuation, ActuationSearch, Candidate};
use crate::curve::{Curve, Limits, length, rounded};
use crate::free_space::{self, NoWay};
use crate::hand_path::Follower;
use crate::model::{MOST_JOINTS, Model, Row};
use crate::options::Timing;
use crate::resolve::Resolved;
use crate::trajectory::{Builder, Trajectory};
use crate::world::{Hit, Leg, Margins, State, TOUCH, Way, World};

/// What has been tried, and the best of it.
#[derive(Default)]
struct Trial {
    best: Option<Attempt>,
    tried: usize,
    /// What became of each pose, where that is asked for.
    poses: Vec<TriedPose>,
    /// Poses that lack nothing but the free approach, with their ranks.
    again: Vec<(Row, usize)>,
}

impl Trial {
    fn done(&self) -> bool {
        self.best.as_ref().is_some_and(|b| b.failure.is_none())
    }

    /// The score to beat, once there is one.
    fn bar(&self) -> Option<f64> {
        self.best.as_ref().map(Attempt::score)
    }

    fn keep(&mut self, attempt: Attempt) {
        if self.best.as_ref().is_none_or(|b| attempt.failure.is_none() || attempt.score() > b.score()) {
            self.best = Some(attempt);
        }
    }
}

pub(super) struct Planner<'p> {
    pub problem: &'p KeypointProblem,
    pub model: &'p Model,
    pub resolved: &'p Resolved,
    pub follower: Follower<'p>,
    pub world: World<'p>,
    pub limits: Limits,
    pub clock: Option<Vec<f64>>,
    /// Where the start leaves what it overlaps, once that was looked for.
    pub exit: Option<Option<Row>>,
    /// Number in time of the keyframe that the motion goes to first; what comes before it is done.
    pub entry: usize,
    pub former: Option<&'p Plan>,
    explain: bool,
}

/// Samples of the first round over all candidates; only where all fail is the full number spent.
const FIRST_SAMPLES: usize = 150;
/// Clearance (m) of the free approach where the one asked for cannot be kept.
const TIGHT: f64 = 2e-4;
/// A smooth curve may take this much of the clearance of its corners (m).
const CURVED: f64 = 1e-3;
/// Candidates that get the full number.
const SECOND_CHANCES: usize = 4;

impl<'p> Planner<'p> {
    pub(super) fn new(
        problem: &'p KeypointProblem,
        model: &'p Model,
        resolved: &'p Resolved,
        request: &Request<'p>,
        entry: usize,
    ) -> Self {
        let mut world = World::new(problem, model);
        world.measure_start(State::still(&model.start()), world.course.toward(entry));
        world.limit(request.most_checks, request.cancel.clone());
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
            world,
            limits: Limits::of(problem, model),
            clock,
            exit: None,
            entry,
            former: request.former,
            explain: request.explain,
        }
    }

    pub(super) fn full(&self, x: &Row) -> Vec<f64> {
        let mut q = Vec::new();
        self.model.map().positions(x, &mut q);
        q
    }

    /// The motion that goes on from an earlier plan: through its actuation pose, where that still serves. Past the
    /// actuation there is no other.
    pub(super) fn former_motion(&mut self, search: &mut ActuationSearch<'_>, x: &Row) -> Option<Plan> {
        let past = self.entry > self.problem.config.pre.len();
        let pose = if past { Candidate { x: *x, cost: search.cost(x) } } else { search.from(x)? };
        let mut trial = Trial::default();
        let samples = if past { 0 } else { self.problem.options.samples.min(FIRST_SAMPLES) };
        self.try_one(&pose.x, samples, &mut trial);
        (past || trial.done()).then(|| self.conclude(trial, &pose))
    }

    pub(super) fn whole_motion(&mut self, found: &Actuation, search: &mut ActuationSearch<'_>) -> Plan {
        let options = &self.problem.options;
        let (samples, most) = (options.samples, options.candidates);
        let mut trial = Trial::default();
        self.try_each(&found.candidates, most, samples.min(FIRST_SAMPLES), &mut trial);
        // Yet more poses of the same constraints, for a motion that the cheap ones do not allow.
        let mut extra = 0;
        for start in found.used..found.used + options.harvest {
            if self.is_done(&trial) || extra > most {
                break;
            }
            let Some(c) = search.sample(start) else { continue };
            let overlaps = self.try_one(&c.x, samples.min(FIRST_SAMPLES), &mut trial);
            // Poses that overlap something themselves cost next to nothing to turn down.
            extra += usize::from(!overlaps);
        }
        for (x, rank) in std::mem::take(&mut trial.again) {
            if self.is_done(&trial) {
                break;
            }
            let attempt = self.attempt(&x, rank, samples, trial.bar());
            self.keep(attempt, &mut trial);
        }
        self.conclude(trial, &found.candidates[0])
    }

    /// Whether there is nothing more to try: a whole motion is found, or planning has to end.
    fn is_done(&self, trial: &Trial) -> bool {
        trial.done() || self.world.is_over()
    }

    fn keep(&self, attempt: Attempt, trial: &mut Trial) {
        if self.explain {
            trial.poses.push(self.explained(&attempt));
        }
        trial.keep(attempt);
    }

    /// What the trials come to; `cheapest` is the pose that obstacles aside would be taken.
    fn conclude(&mut self, trial: Trial, cheapest: &Candidate) -> Plan {
        let solved = trial.done();
        let Trial { best, tried, poses, .. } = trial;
        let mut out = match best {
            Some(attempt) => self.report(attempt),
            None => refused("no actuation pose was tried".to_owned()),
        };
        if !solved && self.world.is_cancelled() {
            (out.status, out.reason) = (Status::Cancelled, "planning was cancelled".to_owned());
        } else if !solved && self.world.is_spent() && out.status != Status::Partial {
            out.status = Status::NotFound;
            out.reason = format!("the collision checks are spent; so far {}", out.reason);
        }
        out.tried = tried;
        out.tried_poses = poses;
        out.q_actuation = Some(self.full(&cheapest.x));
        out.cost = Some(cheapest.cost);
        out.start_overlap = self.world.start_overlap;
        if out.start_overlap > 0.0 {
            out.warnings.push(format!("the robot overlaps something by {:.4} m at the start", out.start_overlap));
        }
        out
    }

    fn try_each(&mut self, candidates: &[Candidate], most: usize, samples: usize, trial: &mut Trial) {
        for c in candidates.iter().take(most) {
            if self.is_done(trial) {
                return;
            }
            self.try_one(&c.x, samples, trial);
        }
    }

    /// Tries one pose; whether it was turned down at once, because it overlaps something itself.
    fn try_one(&mut self, x: &Row, samples: usize, trial: &mut Trial) -> bool {
        let attempt = self.attempt(x, trial.tried, samples, trial.bar());
        trial.tried += 1;
        let overlaps = attempt.overlaps;
        let not_found = matches!(attempt.failure, Some(Failure::NotFound { .. }));
        if not_found && samples < self.problem.options.samples && trial.again.len() < SECOND_CHANCES {
            trial.again.push((*x, attempt.rank));
        }
        self.keep(attempt, trial);
        overlaps
    }

    /// Free motion from the start to the first keyframe: pieces from rest to rest, and what it hits where hits do not
    /// count.
    pub(super) fn approach(&mut self, goal: &Row, samples: usize) -> Result<(Vec<Vec<Row>>, Option<Hit>), NoWay> {
        let leg = self.world.course.toward(self.entry);
        let start = self.start_after_brake();
        let braking = self.world.sweep(&self.model.start(), &start, leg, &Margins::plain(0.0));
        let straight = |hit| Ok((vec![vec![start, *goal]], Some(hit)));
        if let Some(hit) = braking {
            return if self.problem.options.avoid_collisions { Err(NoWay::Blocked(hit)) } else { straight(hit) };
        }
        if !self.problem.options.avoid_collisions {
            let hit = self.world.sweep(&start, goal, leg, &Margins::plain(0.0));
            return Ok((vec![vec![start, *goal]], hit));
        }
        // What overlaps at the start comes apart first, and then stays apart.
        let out = self.way_out(&start, leg);
        let (begin, mut pieces) = out.map_or((start, Vec::new()), |exit| (exit, vec![vec![start, exit]]));
        let wish = self.problem.options.margin;
        let kept = self.margins(&begin, goal, leg, wish, out.is_some()).eased(CURVED);
        if let Some(way) = self.former_way(&begin, goal, leg, &kept) {
            pieces.push(way);
            return Ok((pieces, None));
        }
        let (corners, margins) = match self.connect(&begin, goal, leg, wish, out.is_some(), samples) {
            // The clearance is a wish; a free motion without it is still free.
            Err(_) if wish > TIGHT => self.connect(&begin, goal, leg, TIGHT, out.is_some(), samples)?,
            other => other?,
        };
        if corners.len() == 2 {
            pieces.push(corners);
            return Ok((pieces, None));
        }
        match self.rounded(&begin, goal, &corners, leg, &margins) {
            Some(curve) => pieces.push(curve),
            None => pieces.extend(corners.windows(2).map(<[Row]>::to_vec)),
        }
        Ok((pieces, None))
    }

    /// One smooth curve near the corners, with knots ever closer to them, where one stays free.
    fn rounded(&mut self, from: &Row, to: &Row, corners: &[Row], leg: Leg, margins: &Margins) -> Option<Vec<Row>> {
        let n = self.model.n();
        let (mut lower, mut upper) = (self.model.lower, self.model.upper);
        for v in 0..n {
            lower[v] = lower[v].min(from[v]).min(to[v]);
            upper[v] = upper[v].max(from[v]).max(to[v]);
        }
        [0.5, 0.2, 0.08].into_iter().map(|spacing| rounded(n, corners, spacing)).find(|curve| {
            let course = Curve::new(n, curve, &self.limits);
            course.keeps_within(&lower, &upper)
                && self.world.sweep_along(Way::still(&course.along(0.05)), leg, &margins.eased(CURVED)).is_none()
        })
    }

    /// Margins of the free motion between two poses; `parted` where what overlapped at the start has come apart.
    fn margins(&mut self, from: &Row, to: &Row, leg: Leg, clearance: f64, parted: bool) -> Margins {
        let margins = self.world.margins_between(from, to, leg, clearance);
        if parted { margins.parted() } else { margins }
    }

    /// Corners of a free motion that keeps a clearance, and the margins that they keep to.
    fn connect(
        &mut self,
        from: &Row,
        to: &Row,
        leg: Leg,
        clearance: f64,
        parted: bool,
        samples: usize,
    ) -> Result<(Vec<Row>, Margins), NoWay> {
        let margins = self.margins(from, to, leg, clearance, parted);
        let corners = free_space::connect(&mut self.world, self.model, from, to, leg, &margins, samples)?;
        Ok((corners, margins))
    }

    /// A free pose near the start, where that overlaps something and can get out of it.
    fn way_out(&mut self, start: &Row, leg: Leg) -> Option<Row> {
        if self.world.start_overlap <= TOUCH {
            return None;
        }
        if self.exit.is_none() {
            self.exit = Some(free_space::way_out(&mut self.world, self.model, start, leg));
        }
        self.exit.flatten()
    }

    fn start_velocity(&self) -> Row {
        self.problem.options.start_velocity.as_ref().map_or([0.0; MOST_JOINTS], |v| self.model.pick(v))
    }

    pub(super) fn start_after_brake(&self) -> Row {
        let mut builder = Builder::new(self.model.n(), self.limits, 0.0);
        builder.brake(&self.model.start(), &self.start_velocity())
    }

    /// The timed motion of an attempt as far as it goes, with the time at which each keyframe is met.
    pub(super) fn timed(&self, attempt: &Attempt) -> Result<(Trajectory, Vec<Option<f64>>), Failure> {
        let count = attempt.motions.keyframes.len();
        let mut times = vec![None; count];
        let mut builder = Builder::new(self.model.n(), self.limits, self.problem.options.start_time);
        builder.brake(&self.model.start(), &self.start_velocity());
        let due = |keyframe: usize| self.clock.as_ref().map(|c| c[keyframe]);
        let late = |keyframe: usize, builder: &Builder, needed: f64| {
            let allowed = due(keyframe).map_or(0.0, |d| d - builder.now());
            Failure::TooFast { keyframe, allowed, needed }
        };
        let pieces = attempt.approach.len();
        let lengths: Vec<f64> = attempt.approach.iter().map(|p| length(self.model.n(), p)).collect();
        let total: f64 = lengths.iter().sum();
        let begin = builder.now();
        let mut gone = 0.0;
        for (k, piece) in attempt.approach.iter().enumerate() {
            gone += lengths[k];
            // Pieces share the time by their length.
            let end = due(self.entry)
                .map(|d| if k + 1 == pieces || total == 0.0 { d } else { begin + (d - begin) * gone / total });
            builder.push(piece, end).map_err(|needed| late(self.entry, &builder, needed))?;
        }
        if self.entry <= attempt.motions.actuation {
            times[self.entry] = Some(builder.now());
        }
        for (i, waypoints) in attempt.paths.iter().enumerate().skip(attempt.first) {
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
        Ok((builder.build(self.model.map()), times))
    }

    pub(super) fn too_fast(&self, attempt: &Attempt) -> Option<Failure> {
        self.clock.as_ref()?;
        self.timed(attempt).err()
    }
}

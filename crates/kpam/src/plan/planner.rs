//! The search for the cheapest actuation pose whose whole motion is reachable and free.

use std::time::Instant;

use super::attempt::Attempt;
use super::failure::{Failure, inside};
use super::{Collision, Lack, Outcome, Plan, Request, TriedPose, refused};
use crate::KeypointProblem;
use crate::actuation::{Actuation, ActuationSearch, Candidate};
use crate::default_limits::{ASSUMED, assumed_limits};
use crate::free_space::{self, NoWay, Sampling};
use crate::hand_path::Follower;
use crate::model::{MAX_JOINTS, Model, Row};
use crate::options::Timing;
use crate::resolve::Resolved;
use crate::timing::{
    Builder, CannotStop, Dynamics, Limits, Method, Spline, Start, StartTransition, rounded, start_transitions, turn,
};
use crate::world::{Hit, Margins, MotionSegment, State, TOUCH, Way, World};

/// Trials so far, and the best of them.
#[derive(Default)]
struct Trial {
    best: Option<Attempt>,
    tried: usize,
    /// Outcome of each pose, where that is asked for.
    poses: Vec<TriedPose>,
    /// Poses that lack nothing but the free approach, with their ranks.
    again: Vec<(Row, usize)>,
}

impl Trial {
    fn done(&self) -> bool {
        self.best.as_ref().is_some_and(Attempt::is_whole)
    }

    /// The score to beat, once there is one.
    fn bar(&self) -> Option<f64> {
        self.best.as_ref().map(Attempt::score)
    }

    fn keep(&mut self, attempt: Attempt) {
        if self.best.as_ref().is_none_or(|b| attempt.is_whole() || attempt.score() > b.score()) {
            self.best = Some(attempt);
        }
    }
}

/// A free motion to the first keyframe.
pub(super) struct Approach {
    /// Pieces end at rest, and begin there but for the first of a start under way.
    pub pieces: Vec<Vec<Row>>,
    /// The same motion with a stop wherever it turns.
    pub corners: Vec<Vec<Row>>,
    /// Margins that it keeps.
    pub kept: Margins,
    /// Hits, where hits do not count.
    pub hit: Option<Hit>,
}

pub(super) struct Planner<'p> {
    pub problem: &'p KeypointProblem,
    pub model: &'p Model,
    pub resolved: &'p Resolved,
    pub follower: Follower<'p>,
    pub world: World<'p>,
    /// State at the start, the ways from there to where planning begins, and the one that is taken.
    pub start: Start,
    pub transitions: Vec<StartTransition>,
    pub transition: usize,
    /// Clearance (m) that is kept from what may not be touched.
    pub margin: f64,
    /// Obstacle to all of them, once that was looked at.
    transition_checked: Option<Option<Hit>>,
    /// Inputs of a trajectory of this problem.
    pub builder: Builder,
    pub clock: Option<Vec<f64>>,
    /// State in which the start has left what it overlaps, once that was looked for.
    pub exit: Option<Option<Row>>,
    /// Number in time of the keyframe that the motion goes to first; what comes before it is done.
    pub entry: usize,
    pub warm_start: Option<&'p Plan>,
    pub explain: bool,
}

/// Samples of the first round over all candidates; only where all fail is the full number spent.
const FIRST_SAMPLES: usize = 150;
/// Free motions are searched for with this much more than the margin (m): a smooth curve may take it from its corners.
const CURVED: f64 = 1e-3;
/// Paths are swept with this much more than the margin (m), for what timing moves them.
pub(super) const PAD: f64 = 2e-4;
/// Spacings of waypoints (rad or m) on the free approach, and that near its ends.
const SPACINGS: [f64; 3] = [WIDE, 0.2, 0.08];
pub(super) const WIDE: f64 = 0.5;
pub(super) const NEAR: f64 = 0.04;
/// Candidates that get the full number.
const SECOND_CHANCES: usize = 4;

impl<'p> Planner<'p> {
    /// # Errors
    /// No motion from the start stays within the joint limits.
    pub(super) fn new(
        problem: &'p KeypointProblem,
        model: &'p Model,
        resolved: &'p Resolved,
        request: &Request<'p>,
        begun: Instant,
        entry: usize,
    ) -> Result<Self, CannotStop> {
        let rates = |list: &Option<Vec<f64>>| list.as_ref().map_or([0.0; MAX_JOINTS], |v| model.pick(v));
        let options = &problem.options;
        let start = Start {
            position: model.start(),
            velocity: rates(&options.start_velocity),
            acceleration: rates(&options.start_acceleration),
        };
        let mut builder = Builder::new(Limits::of(problem, model), Method::default(), options.start_time)
            .loaded(Dynamics::asked(&problem.robot, model, options));
        let transitions = start_transitions(&mut builder, &start, &model.lower, &model.upper)?;
        let mut world = World::new(problem, model);
        world.measure_start(State::still(&model.start()), world.schedule.toward(entry));
        world.limit(request.max_checks, request.deadline.map(|d| begun + d), request.cancel.clone());
        let timing =
            problem.options.timing.unwrap_or(if problem.config.has_times() { Timing::Config } else { Timing::Limits });
        let clock = match timing {
            Timing::Limits => None,
            // The config's own check has passed; a start time past its first keyframe ends as TooFast.
            Timing::Config => problem.config.clock(f64::NEG_INFINITY).ok(),
        };
        Ok(Self {
            problem,
            model,
            resolved,
            follower: Follower::new(problem, model),
            world,
            start,
            transitions,
            transition: 0,
            margin: options.margin,
            transition_checked: None,
            builder,
            clock,
            exit: None,
            entry,
            warm_start: request.warm_start,
            explain: request.explain,
        })
    }

    pub(super) fn full(&self, x: &Row) -> Vec<f64> {
        let mut q = Vec::new();
        self.model.map().positions(x, &mut q);
        q
    }

    /// The motion that goes on from an earlier plan: through its actuation pose, where that still serves. Past the
    /// actuation there is no other.
    pub(super) fn warm_start_motion(&mut self, search: &mut ActuationSearch<'_>, x: &Row) -> Option<Plan> {
        let past = self.entry > self.world.schedule.actuation();
        let pose = if past { Candidate { x: *x, cost: search.cost(x) } } else { search.from(x)? };
        let mut trial = Trial::default();
        let samples = if past { 0 } else { self.problem.options.samples.min(FIRST_SAMPLES) };
        for margin in self.margins_in_turn() {
            self.set_margin(margin);
            self.try_one(&pose.x, samples, &mut trial);
            if self.is_done(&trial) {
                break;
            }
        }
        let stands = past || trial.done();
        if !stands {
            self.set_margin(self.problem.options.margin);
        }
        stands.then(|| self.conclude(trial, &pose))
    }

    pub(super) fn whole_motion(&mut self, found: &Actuation, search: &mut ActuationSearch<'_>) -> Plan {
        let options = &self.problem.options;
        let (samples, most) = (options.samples, options.candidates);
        let mut trial = Trial::default();
        // Poses beside the cheapest are looked for where no motion to that one stands.
        let (cheapest, mut others) = (found.candidates[0], None);
        for margin in self.margins_in_turn() {
            self.set_margin(margin);
            // The longest part that keeps less is no measure for what keeps more.
            trial = Trial { tried: trial.tried, poses: trial.poses, ..Trial::default() };
            self.try_each(&[cheapest], most, samples.min(FIRST_SAMPLES), &mut trial);
            if !self.is_done(&trial) {
                let others = others.get_or_insert_with(|| search.others(&found.candidates));
                others.retain(|c| c.x != cheapest.x);
                self.try_each(others, most - 1, samples.min(FIRST_SAMPLES), &mut trial);
            }
            if self.is_done(&trial) {
                break;
            }
        }
        // Yet more poses of the same constraints, for a motion that the cheap ones do not allow.
        let mut extra = 0;
        for start in 0..options.extra_seeds {
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
        let better = others.iter().flatten().find(|c| c.cost < cheapest.cost);
        self.conclude(trial, better.unwrap_or(&cheapest))
    }

    /// Margins that are tried one after the other.
    fn margins_in_turn(&self) -> Vec<f64> {
        let options = &self.problem.options;
        let least = options.least_margin.filter(|least| *least < options.margin && options.avoid_collisions);
        std::iter::once(options.margin).chain(least).collect()
    }

    fn set_margin(&mut self, margin: f64) {
        if self.margin.to_bits() != margin.to_bits() {
            (self.margin, self.transition_checked, self.exit) = (margin, None, None);
        }
    }

    /// Body that the robot is too deep inside of at the start, if any.
    pub(super) fn too_deep(&self) -> Option<Hit> {
        let options = &self.problem.options;
        let deep = options.avoid_collisions && self.world.start_overlap > options.start_depth;
        self.world.start_hit.clone().filter(|_| deep)
    }

    /// The plan of a problem that begins too deep inside something.
    pub(super) fn too_deep_at_start(&self) -> Option<Plan> {
        // Past the actuation it is not yet known where things are.
        let hit = self.too_deep().filter(|_| self.entry <= self.world.schedule.actuation())?;
        let depth = self.problem.options.start_depth;
        let mut out = refused(Lack::StartInCollision, format!("{}; start_depth allows {depth} m", inside(&hit)));
        out.start_overlap = self.world.start_overlap;
        out.collisions = vec![Collision {
            bodies: [hit.first, hit.second],
            time: None,
            toward: self.world.schedule.label(self.entry),
            distance: hit.distance,
            point: [hit.at.x, hit.at.y, hit.at.z],
        }];
        Some(out)
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

    /// Result of the trials; `cheapest` is the pose that obstacles aside would be taken.
    fn conclude(&mut self, trial: Trial, cheapest: &Candidate) -> Plan {
        let solved = trial.done();
        let Trial { best, tried, poses, .. } = trial;
        let mut out = match best {
            Some(attempt) => self.report(attempt),
            None => refused(Lack::NotFound, "no actuation pose was tried".to_owned()),
        };
        if !solved && self.world.is_cancelled() {
            (out.outcome, out.reason) = (Outcome::Failed(Lack::Cancelled), "planning was cancelled".to_owned());
        } else if !solved && self.world.is_spent() && out.trajectory().is_none() {
            out.outcome = Outcome::Failed(Lack::NotFound);
            out.reason = format!("the collision checks are spent; so far {}", out.reason);
        } else if !solved && self.world.is_late() && out.trajectory().is_none() {
            out.outcome = Outcome::Failed(Lack::NotFound);
            out.reason = format!("the time is up; so far {}", out.reason);
        }
        out.tried = tried;
        out.tried_poses = poses;
        out.q_actuation = Some(self.full(&cheapest.x));
        out.cost = Some(cheapest.cost);
        out.start_overlap = self.world.start_overlap;
        out.assumed_limits = assumed_limits(&self.problem.options);
        if !out.assumed_limits.is_empty() {
            let names = out.assumed_limits.join(" and ");
            out.warnings
                .push(format!("limits on {names} are assumed ({ASSUMED}); options.limits or lists of them say better"));
        }
        let unchecked = self.problem.robot.unchecked_pairs();
        if !unchecked.is_empty() {
            let links = self.problem.robot.links();
            let names: Vec<_> =
                unchecked.iter().map(|(a, b)| format!("{} and {}", links[*a].name(), links[*b].name())).collect();
            out.warnings.push(format!(
                "never checked against each other, for they overlap at the middle of all joint ranges and no SRDF says whether they may: {}",
                names.join(", ")
            ));
        }
        if out.start_overlap > 0.0 {
            if let Some(hit) = self.world.start_hit.as_ref().filter(|_| solved) {
                out.reason
                    .push_str(&format!("; it begins {:.4} m inside: {} and {}", -hit.distance, hit.first, hit.second));
            }
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

    /// Free motion from the start to the first keyframe.
    pub(super) fn approach(&mut self, goal: &Row, samples: usize) -> Result<Approach, NoWay> {
        let n = self.model.n();
        let segment = self.world.schedule.toward(self.entry);
        let braking = self.choose_start_transition(segment);
        if let (Some(hit), true) = (&braking, self.problem.options.avoid_collisions) {
            return Err(NoWay::Blocked(hit.clone()));
        }
        let transition = self.transitions[self.transition].clone();
        let start = transition.rest();
        let straight = |corners: &[Row]| rounded(n, corners, WIDE, NEAR);
        if !self.problem.options.avoid_collisions {
            let hit = braking.or_else(|| self.world.sweep(&start, goal, segment, &Margins::plain(0.0)));
            let room = [&self.model.lower, &self.model.upper];
            let pieces = match turn(
                &self.builder,
                &transition,
                room,
                goal,
                |end| straight(&[*end, *goal])[1..].to_vec(),
                |_| true,
            ) {
                Some(turned) => vec![turned.waypoints],
                None => transition.line().into_iter().chain([straight(&[start, *goal])]).collect(),
            };
            return Ok(Approach { pieces, corners: Vec::new(), kept: Margins::plain(0.0), hit });
        }
        // What overlaps at the start comes apart first, and then stays apart.
        let out = self.way_out(&start, segment);
        let (begin, mut pieces) = out.map_or((start, Vec::new()), |exit| (exit, vec![vec![start, exit]]));
        pieces.splice(0..0, transition.line());
        let mut wide = self.margins(&start, goal, segment, self.margin + CURVED, out.is_some());
        if out.is_some() {
            // What came apart keeps what it has there; all else what it has at the start, not on the way out.
            let there = self.margins(&begin, &begin, segment, self.margin + CURVED, true);
            self.world.keep_apart(&mut wide, there);
        }
        let curved = wide.with_clearance(self.margin + PAD);
        // On the way out of what it overlaps at the start the motion is still inside.
        let kept = Margins { forgiving: true, ..wide.with_clearance(self.margin) };
        if let Some(way) = self.warm_start_way(&begin, goal, segment, &curved) {
            let along = |_: &Row, _: f64| way.clone();
            let corners: Vec<_> = pieces.iter().cloned().chain(way.windows(2).map(<[_]>::to_vec)).collect();
            if let Some(turned) = self.turned(&way, segment, &curved, along).filter(|_| out.is_none()) {
                return Ok(Approach { pieces: vec![turned], corners, kept, hit: None });
            }
            if curve_is_free(&mut self.world, self.model, &Spline::through(n, &way, None), segment, &curved) {
                pieces.push(way);
                return Ok(Approach { pieces, corners, kept, hit: None });
            }
        }
        let corners = match self.connect(&begin, goal, segment, &wide, samples) {
            // Straight from stop to stop no more than the margin is needed.
            Err(_) => self.connect(&begin, goal, segment, &curved, samples)?,
            Ok(corners) => corners,
        };
        let stops: Vec<_> = pieces.iter().cloned().chain(corners.windows(2).map(straight)).collect();
        let from = |end: &Row, spacing: f64| {
            let mut corners = corners.clone();
            corners[0] = *end;
            rounded(n, &corners, spacing, NEAR)
        };
        if let Some(turned) = self.turned(&corners, segment, &curved, from).filter(|_| out.is_none()) {
            return Ok(Approach { pieces: vec![turned], corners: stops, kept, hit: None });
        }
        if corners.len() == 2 {
            return Ok(Approach { pieces: stops, corners: Vec::new(), kept, hit: None });
        }
        match self.rounded(&corners, segment, &curved) {
            Some(curve) => pieces.push(curve),
            None => pieces.extend(corners.windows(2).map(straight)),
        }
        Ok(Approach { pieces, corners: stops, kept, hit: None })
    }

    /// One smooth curve near the corners, with knots ever closer to them, where one stays free.
    fn rounded(&mut self, corners: &[Row], segment: MotionSegment, margins: &Margins) -> Option<Vec<Row>> {
        let n = self.model.n();
        SPACINGS.into_iter().map(|spacing| rounded(n, corners, spacing, NEAR)).find(|curve| {
            curve_is_free(&mut self.world, self.model, &Spline::through(n, curve, None), segment, margins)
        })
    }

    /// The way along waypoints from a start under way, which leaves its line in a turn without coming to rest, where
    /// such a one is free. `from` gives the waypoints from the end of the turn on, that end first, for a spacing.
    fn turned(
        &mut self,
        way: &[Row],
        segment: MotionSegment,
        margins: &Margins,
        from: impl Fn(&Row, f64) -> Vec<Row>,
    ) -> Option<Vec<Row>> {
        let transition = &self.transitions[self.transition];
        let (builder, model, world) = (&self.builder, self.model, &mut self.world);
        SPACINGS.into_iter().find_map(|spacing| {
            let free = |path: &Spline| curve_is_free(world, model, path, segment, margins);
            turn(
                builder,
                transition,
                [&model.lower, &model.upper],
                way.get(1)?,
                |end| from(end, spacing)[1..].to_vec(),
                free,
            )
            .map(|turned| turned.waypoints)
        })
    }

    /// Margins of the free motion between two poses; `parted` where what overlapped at the start has come apart.
    fn margins(&mut self, from: &Row, to: &Row, segment: MotionSegment, clearance: f64, parted: bool) -> Margins {
        let margins = self.world.margins_between([State::still(from), State::still(to)], segment, clearance);
        if parted { margins.parted() } else { margins }
    }

    /// Chooses the first way from the start to rest that is free, where none was chosen yet; what is in the way where
    /// none is.
    fn choose_start_transition(&mut self, segment: MotionSegment) -> Option<Hit> {
        if self.transition_checked.is_none() {
            let mut first = None;
            let clearance = if self.problem.options.avoid_collisions { self.margin } else { 0.0 };
            let start = self.start.position;
            let margins = self.margins(&start, &start, segment, clearance, false);
            for (k, transition) in self.transitions.iter().enumerate() {
                let way = transition.way(&self.start);
                match self.world.sweep_along(Way::still(&way), segment, &margins) {
                    None => {
                        (self.transition, first) = (k, None);
                        break;
                    }
                    Some((_, hit)) => first = first.or(Some(hit)),
                }
            }
            self.transition_checked = Some(first);
        }
        self.transition_checked.clone().flatten()
    }

    /// Corners of a free motion that keeps to margins.
    fn connect(
        &mut self,
        from: &Row,
        to: &Row,
        segment: MotionSegment,
        margins: &Margins,
        samples: usize,
    ) -> Result<Vec<Row>, NoWay> {
        let sampling = Sampling { max_samples: samples, seed: self.problem.options.seed };
        free_space::connect(&mut self.world, self.model, from, to, segment, margins, sampling)
    }

    /// A free pose near the start, where that overlaps something and can get out of it.
    fn way_out(&mut self, start: &Row, segment: MotionSegment) -> Option<Row> {
        if self.world.start_overlap <= TOUCH {
            return None;
        }
        if self.exit.is_none() {
            let kept = self.margins(start, start, segment, self.margin, false);
            let seed = self.problem.options.seed;
            self.exit = Some(free_space::way_out(&mut self.world, self.model, start, segment, &kept, seed));
        }
        self.exit.flatten()
    }
}

/// Whether a curve stays within the joint limits, or where its waypoints are, and off everything.
fn curve_is_free(
    world: &mut World<'_>,
    model: &Model,
    path: &Spline,
    segment: MotionSegment,
    margins: &Margins,
) -> bool {
    let all = 0..path.intervals();
    path.keeps_within(all.clone(), &model.lower, &model.upper)
        && world.sweep_along(Way::still(&path.along(all, 0.05)), segment, margins).is_none()
}

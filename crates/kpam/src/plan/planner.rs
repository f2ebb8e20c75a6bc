//! The search for the cheapest actuation pose whose whole motion is reachable and free.

use super::attempt::{Attempt, Failure};
use super::{Plan, refused};
use crate::KeypointProblem;
use crate::actuation::{Actuation, ActuationSearch, Candidate};
use crate::contact::{Hit, Judge, TOUCH};
use crate::free_space;
use crate::hand_path::Follower;
use crate::margins::Margins;
use crate::model::{MOST_JOINTS, Model, Row};
use crate::options::Timing;
use crate::problem::Resolved;
use crate::timing::{Builder, CannotStop, Lead, Limits, Method, Spline, Start, leads, rounded, turn};

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
    pub judge: Judge<'p>,
    /// State at the start, the ways from there to where planning begins, and the one that is taken.
    pub start: Start,
    pub leads: Vec<Lead>,
    pub lead: usize,
    /// What is in the way of all of them, once that was looked at.
    lead_judged: Option<Option<Hit>>,
    /// What a trajectory of this problem is built from.
    pub builder: Builder,
    pub clock: Option<Vec<f64>>,
    /// Where the start leaves what it overlaps, once that was looked for.
    pub exit: Option<Option<Row>>,
}

/// Samples of the first round over all candidates; only where all fail is the full number spent.
const FIRST_SAMPLES: usize = 150;
/// Clearance (m) of the free approach where the one asked for cannot be kept.
const TIGHT: f64 = 2e-4;
/// Less clearance (m) that curves may keep than the polygons that they follow.
const EASED: f64 = 1e-3;
/// Spacings of waypoints (rad or m) on the free approach, and that near its ends.
const SPACINGS: [f64; 3] = [WIDE, 0.2, 0.08];
const WIDE: f64 = 0.5;
const NEAR: f64 = 0.04;
/// Candidates that get the full number.
const SECOND_CHANCES: usize = 4;

impl<'p> Planner<'p> {
    /// # Errors
    /// No motion from the start stays within the joint limits.
    pub(super) fn new(
        problem: &'p KeypointProblem,
        model: &'p Model,
        resolved: &'p Resolved,
    ) -> Result<Self, CannotStop> {
        let rates = |list: &Option<Vec<f64>>| list.as_ref().map_or([0.0; MOST_JOINTS], |v| model.pick(v));
        let options = &problem.options;
        let start = Start {
            position: model.start(),
            velocity: rates(&options.start_velocity),
            acceleration: rates(&options.start_acceleration),
        };
        let builder = Builder::new(Limits::of(problem, model), Method::default(), options.start_time);
        let leads = leads(&builder, &start, &model.lower, &model.upper)?;
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
            judge: Judge::new(problem, model),
            start,
            leads,
            lead: 0,
            lead_judged: None,
            builder,
            clock,
            exit: None,
        })
    }

    pub(super) fn full(&self, x: &Row) -> Vec<f64> {
        let mut q = Vec::new();
        self.model.map().positions(x, &mut q);
        q
    }

    pub(super) fn whole_motion(&mut self, found: &Actuation, search: &mut ActuationSearch<'_>) -> Plan {
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
            let overlaps = self.try_one(&c.x, samples.min(FIRST_SAMPLES), &mut trial);
            // Poses that overlap something themselves cost next to nothing to turn down.
            extra += usize::from(!overlaps);
        }
        for (x, rank) in std::mem::take(&mut trial.again) {
            if trial.done() {
                break;
            }
            let attempt = self.attempt(&x, rank, samples, trial.bar());
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
        let attempt = self.attempt(x, trial.tried, samples, trial.bar());
        trial.tried += 1;
        let blocked_approach = matches!(attempt.failure, Some(Failure::Blocked { keyframe: 0, .. }));
        let overlaps = attempt.overlaps;
        if blocked_approach && !overlaps && samples < self.problem.options.samples && trial.again.len() < SECOND_CHANCES
        {
            trial.again.push((*x, attempt.rank));
        }
        trial.keep(attempt);
        overlaps
    }

    /// Free motion from the start to the first keyframe, and what it hits where hits do not count. Pieces end at rest,
    /// and begin there but for the first of a start under way.
    pub(super) fn approach(&mut self, goal: &Row, samples: usize) -> Result<(Vec<Vec<Row>>, Option<Hit>), Hit> {
        let n = self.model.n();
        let braking = self.choose_lead();
        if let (Some(hit), true) = (&braking, self.problem.options.avoid_collisions) {
            return Err(hit.clone());
        }
        let lead = self.leads[self.lead].clone();
        let start = lead.rest();
        let straight = |corners: &[Row]| rounded(n, corners, WIDE, NEAR);
        if !self.problem.options.avoid_collisions {
            let hit = braking.or_else(|| self.judge.sweep(&start, goal, 1, &Margins::plain(0.0)));
            let way = match turn(&self.builder, &lead, goal, |end| straight(&[*end, *goal])[1..].to_vec(), |_| true) {
                Some(turned) => vec![turned.waypoints],
                None => lead.line().into_iter().chain([straight(&[start, *goal])]).collect(),
            };
            return Ok((way, hit));
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
        let (mut lower, mut upper) = (self.model.lower, self.model.upper);
        for v in 0..n {
            lower[v] = lower[v].min(begin[v]).min(goal[v]);
            upper[v] = upper[v].max(begin[v]).max(goal[v]);
        }
        let eased = margins.eased(EASED);
        let free = |judge: &mut Judge<'_>, path: &Spline| {
            let all = 0..path.intervals();
            path.keeps_within(all.clone(), &lower, &upper)
                && judge.sweep_along(&path.along(all, 0.05), 1, &eased).is_none()
        };
        if out.is_none() {
            let rest = |end: &Row, spacing: f64| {
                let mut corners = corners.clone();
                corners[0] = *end;
                rounded(n, &corners, spacing, NEAR)[1..].to_vec()
            };
            for spacing in SPACINGS {
                let judge = &mut self.judge;
                let turned =
                    turn(&self.builder, &lead, &corners[1], |end| rest(end, spacing), |path| free(judge, path));
                if let Some(turned) = turned {
                    return Ok((vec![turned.waypoints], None));
                }
            }
        }
        pieces.splice(0..0, lead.line());
        if corners.len() == 2 {
            pieces.push(straight(&corners));
            return Ok((pieces, None));
        }
        // One smooth curve where it stays free, with knots ever closer to the corners; else stop at each corner.
        for spacing in SPACINGS {
            let curve = rounded(n, &corners, spacing, NEAR);
            if free(&mut self.judge, &Spline::through(n, &curve, None)) {
                pieces.push(curve);
                return Ok((pieces, None));
            }
        }
        pieces.extend(corners.windows(2).map(straight));
        Ok((pieces, None))
    }

    /// Chooses the first way from the start to rest that is free, where none was chosen yet; what is in the way where
    /// none is.
    fn choose_lead(&mut self) -> Option<Hit> {
        if self.lead_judged.is_none() {
            let mut first = None;
            for (k, lead) in self.leads.iter().enumerate() {
                match self.judge.sweep_along(&lead.way(&self.start), 1, &Margins::plain(0.0)) {
                    None => {
                        (self.lead, first) = (k, None);
                        break;
                    }
                    Some((_, hit)) => first = first.or(Some(hit)),
                }
            }
            self.lead_judged = Some(first);
        }
        self.lead_judged.clone().flatten()
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
}

//! Free motions from one joint vector to others: several goals at once, everything kept at a distance, timed and proven
//! free all along.

mod field;
mod goal;
mod shorten;
mod sweep;
mod tree;

use std::time::{Duration, Instant};

use gensim2_geometry::{Needs, Other};

use crate::model::{MOST_JOINTS, Model, Row};
use crate::timing::{Builder, Limits, Method, Spline, rounded};
use crate::world::{Compiled, TOUCH};
use crate::{Cancel, ProblemError, Scene, Trajectory};

use field::{Ending, Field, RESOLUTION};
pub use goal::{Goal, MAX_SOLUTIONS, solutions};
use sweep::{Breach, Sweep};

/// What the search keeps beyond the margin (m), for the curve that the corners are rounded to.
const CURVED: f64 = 1e-3;
/// Searches, each with a finer look at edges than the one before.
const TRIES: usize = 4;
/// Spacings of waypoints on the way (rad or m), and that near its ends.
const SPACINGS: [f64; 4] = [0.5, 0.25, 0.12, 0.05];
const NEAR: f64 = 0.04;

/// What a motion to a goal may set.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct TransitOptions {
    /// Distance (m) that everything keeps all along, 5 mm unless told. A pair that is nearer at the start or at a goal
    /// keeps the distance that it has there.
    pub margin: f64,
    /// Most samples of a search.
    pub samples: usize,
    /// Which samples are drawn.
    pub seed: usize,
    /// Share of the joints' velocity limits, and of acceleration and jerk limits.
    pub velocity_scale: f64,
    /// Share of the acceleration and jerk limits.
    pub acceleration_scale: f64,
    /// Ends the search after so many configurations.
    pub max_checks: Option<u64>,
    /// Ends the search after so long; without one, the same question has the same answer.
    pub deadline: Option<Duration>,
    /// Ends the search from another thread.
    pub cancel: Option<Cancel>,
}

impl Default for TransitOptions {
    fn default() -> Self {
        Self {
            margin: 0.005,
            samples: 20_000,
            seed: 0,
            velocity_scale: 1.0,
            acceleration_scale: 1.0,
            max_checks: None,
            deadline: None,
            cancel: None,
        }
    }
}

/// Two things that are near each other at an end of a motion.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Approached {
    /// Link or held body, and body or link.
    pub bodies: [String; 2],
    /// Signed distance (m).
    pub distance: f64,
}

/// A motion found: timed, and proven to keep its distances all along.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Motion {
    /// The motion; it begins at time 0.
    pub trajectory: Trajectory,
    /// Number of the goal at which it ends.
    pub goal: usize,
    /// Corners of the way that it follows, one entry a joint each.
    pub corners: Vec<Vec<f64>>,
    /// Pairs that are nearer than the margin at the start or at that goal, with the distance that they keep.
    pub nearer: Vec<Approached>,
    /// Configurations that were looked at.
    pub checks: u64,
}

/// Why there is no motion.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum NoMotion {
    /// Something overlaps at the start.
    StartBlocked(Approached),
    /// Something overlaps at every goal; at the first, this.
    GoalsBlocked(Approached),
    /// No goal can be reached: no joint values within the limits bring the link there.
    Unreachable,
    /// The samples or checks are spent; there may be a motion.
    NotFound,
    /// The time is up; there may be a motion.
    Late,
    /// The caller cancelled it.
    Cancelled,
}

impl std::fmt::Display for NoMotion {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let told = |a: &Approached| format!("{} and {} ({:.1} mm)", a.bodies[0], a.bodies[1], 1e3 * a.distance);
        match self {
            Self::StartBlocked(a) => write!(f, "at the start, {} overlap", told(a)),
            Self::GoalsBlocked(a) => write!(f, "at every goal something overlaps: {}", told(a)),
            Self::Unreachable => write!(f, "no joint values within the limits bring the link to the goal"),
            Self::NotFound => write!(f, "the search was spent without a free motion; there may be one"),
            Self::Late => write!(f, "the time was up before a free motion was found"),
            Self::Cancelled => write!(f, "planning was cancelled"),
        }
    }
}

/// Plans a motion from rest at `q_start` (one entry a joint) to rest at one of the goals, the easiest to reach; joints
/// that do not move the hand stay where they are.
///
/// # Errors
/// A start, goals or options that do not fit, by field.
pub fn plan_to(
    scene: &Scene,
    q_start: &[f64],
    goal: &Goal,
    options: &TransitOptions,
) -> Result<Result<Motion, NoMotion>, ProblemError> {
    let begun = Instant::now();
    options.check()?;
    let robot = scene.robot();
    finite("q_start", q_start)?;
    let model = Model::new(robot, q_start)?;
    let start = model.start();
    within_limits(&model, "q_start", &start)?;
    let goals = goal.joints(scene, &model, q_start, options)?;
    if goals.is_empty() {
        return Ok(Err(NoMotion::Unreachable));
    }
    let ending = Ending {
        cancel: options.cancel.clone(),
        deadline: options.deadline.map(|d| begun + d),
        max_checks: options.max_checks,
    };
    Ok(Transit { scene, model: &model, options, start, goals, ending }.plan())
}

struct Transit<'a> {
    scene: &'a Scene,
    model: &'a Model,
    options: &'a TransitOptions,
    start: Row,
    goals: Vec<Row>,
    ending: Ending,
}

/// What an end of a motion is nearer to than the margin: group, what, and distance.
type Close = Vec<(usize, Other, f64)>;

impl Transit<'_> {
    fn plan(self) -> Result<Motion, NoMotion> {
        let world = self.scene.compiled();
        let margin = self.options.margin;
        let told = |(group, other, distance): &(usize, Other, f64)| Approached {
            bodies: world.named(self.scene, *group, *other),
            distance: *distance,
        };
        let overlap = |close: &Close| close.iter().find(|c| c.2 < 0.0).map(told);
        let at_start = self.close(&self.start);
        if let Some(hit) = overlap(&at_start) {
            return Err(NoMotion::StartBlocked(hit));
        }
        let mut open: Vec<(usize, Row, Close)> = Vec::new();
        let mut blocked = None;
        for (k, goal) in self.goals.iter().enumerate() {
            let close = self.close(goal);
            match overlap(&close) {
                Some(hit) => blocked = blocked.or(Some(hit)),
                None => open.push((k, *goal, close)),
            }
        }
        if let (true, Some(hit)) = (open.is_empty(), blocked) {
            return Err(NoMotion::GoalsBlocked(hit));
        }
        let limits = Limits::usual(
            self.scene.robot(),
            self.model,
            self.options.velocity_scale,
            self.options.acceleration_scale,
        );
        let mut pace = [0.0; MOST_JOINTS];
        for v in 0..self.model.n() {
            pace[v] = 1.0 / limits.velocity[v].min(1e3);
        }
        let nearer = |closes: &[&Close], clearance: f64| {
            let mut needs = world.needs(clearance);
            for (group, other, distance) in closes.iter().copied().flatten() {
                // Screens say nothing of overlaps: touching is the least that can be asked for.
                let need = (distance - TOUCH).min(clearance).max(0.0);
                let place = match world.screen.body(*other) {
                    Some(body) => &mut needs.bodies[group * world.screen.bodies() + body],
                    None => match other {
                        Other::Pair(pair) => &mut needs.pairs[*pair],
                        Other::Element(_) | Other::Cloud(_) => continue,
                    },
                };
                *place = place.min(need);
            }
            needs
        };
        let all: Vec<&Close> = std::iter::once(&at_start).chain(open.iter().map(|g| &g.2)).collect();
        let mut checks = 0;
        let goals: Vec<Row> = open.iter().map(|g| g.1).collect();
        let mut field = Field::new(self.scene, self.model, nearer(&all, margin + CURVED), self.ending.clone());
        for attempt in 0..TRIES {
            field.resolution = RESOLUTION / f64::from(1 << attempt);
            // What cannot be kept beyond the margin is not asked for in the end.
            if attempt > 1 {
                field.needs = nearer(&all, margin + 0.2 * CURVED);
            }
            let seed = self.options.seed + attempt;
            let Some(mut path) = tree::search(&mut field, &self.start, &goals, self.options.samples, seed) else {
                break;
            };
            let last = path[path.len() - 1];
            let Some((number, _, close)) = open.iter().find(|g| g.1 == last) else { break };
            shorten::shorten(&mut field, &mut path, &pace, seed);
            let needs = nearer(&[&at_start, close], margin);
            let found = self.timed(&path, &needs, &limits, &field.weights, &mut checks);
            if let Ok(trajectory) = found {
                let mut near: Vec<Approached> = at_start.iter().chain(close).map(told).collect();
                near.sort_by(|a, b| a.bodies.cmp(&b.bodies).then(a.distance.total_cmp(&b.distance)));
                near.dedup_by(|b, a| a.bodies == b.bodies);
                let corners = path.iter().map(|x| self.full(x)).collect();
                checks += field.checks;
                return Ok(Motion { trajectory, goal: *number, corners, nearer: near, checks });
            }
            if field.is_over() {
                break;
            }
        }
        Err(match () {
            () if field.is_cancelled() => NoMotion::Cancelled,
            () if field.is_late() => NoMotion::Late,
            () => NoMotion::NotFound,
        })
    }

    fn full(&self, x: &Row) -> Vec<f64> {
        let mut q = Vec::new();
        self.model.map().positions(x, &mut q);
        q
    }

    /// Everything that is nearer than the margin in a configuration.
    fn close(&self, x: &Row) -> Close {
        let world = self.scene.compiled();
        let reach = self.options.margin + CURVED;
        let needs = world.needs(0.0);
        let (q, mut poses, mut batch) = (self.full(x), Vec::new(), gensim2_geometry::Batch::default());
        (0..gensim2_geometry::LANES).for_each(|lane| batch.set(&world.screen, lane, &q));
        world.screen.place(&mut batch);
        let mut seen = Vec::new();
        world.screen.survey(&mut batch, &needs, reach as f32 + 1e-6, |s| {
            seen.push((s.group, s.other));
            true
        });
        Compiled::poses(self.scene, &q, &mut poses);
        seen.into_iter()
            .filter_map(|(group, other)| {
                let distance = world.screen.distance(group, other, &poses, reach);
                (distance < reach).then_some((group, other, distance))
            })
            .collect()
    }

    /// The motion along corners: rounded as widely as it stays free, else stopping at each corner.
    fn timed(
        &self,
        corners: &[Row],
        needs: &Needs,
        limits: &Limits,
        weights: &Row,
        checks: &mut u64,
    ) -> Result<Trajectory, Breach> {
        let n = self.model.n();
        let joints = self.scene.robot().joints().len();
        let mut acceleration = vec![0.0; joints];
        for driven in self.model.map().driven() {
            acceleration[driven.joint] = driven.factor.abs() * limits.acceleration[driven.variable];
        }
        let mut sweep = Sweep::new(self.scene, self.model, needs, acceleration, *weights);
        let mut outcome = None;
        let rest = [0.0; MOST_JOINTS];
        for spacing in SPACINGS.into_iter().map(Some).chain([None]) {
            let mut builder = Builder::new(*limits, Method::default(), 0.0);
            let whole = match spacing {
                Some(spacing) => {
                    let path = Spline::through(n, &rounded(n, corners, spacing, NEAR), None);
                    path.keeps_within(0..path.intervals(), &self.model.lower, &self.model.upper)
                        && builder.push(&path, &[], &rest, None, &[]).is_ok()
                }
                None => corners
                    .windows(2)
                    .all(|edge| builder.push(&Spline::through(n, edge, None), &[], &rest, None, &[]).is_ok()),
            };
            if !whole {
                continue;
            }
            let trajectory = builder.build(self.model.map());
            let breach = sweep.breach(&trajectory);
            match breach {
                None => {
                    *checks += sweep.checks;
                    return Ok(trajectory);
                }
                Some(breach) => outcome = Some(breach),
            }
            if corners.len() < 3 {
                break;
            }
        }
        *checks += sweep.checks;
        Err(outcome.unwrap_or(Breach { names: [String::new(), String::new()], distance: 0.0, time: 0.0 }))
    }
}

impl TransitOptions {
    fn check(&self) -> Result<(), ProblemError> {
        let fail = |field: &str, message: String| Err(ProblemError::new(field, message));
        if !(0.0..=0.1).contains(&self.margin) {
            return fail("margin", format!("must lie in 0 to 0.1 m, not {}", self.margin));
        }
        for (field, value) in
            [("velocity_scale", self.velocity_scale), ("acceleration_scale", self.acceleration_scale)]
        {
            if !(value > 0.0 && value <= 1.0) {
                return fail(field, format!("must lie in 0 (excluded) to 1, not {value}"));
            }
        }
        Ok(())
    }
}

/// Refuses joint vectors that are not finite.
fn finite(field: &str, q: &[f64]) -> Result<(), ProblemError> {
    match q.iter().position(|v| !v.is_finite()) {
        Some(i) => Err(ProblemError::new(format!("{field}[{i}]"), format!("{} is not finite", q[i]))),
        None => Ok(()),
    }
}

/// Refuses variables outside their limits; rounding is forgiven.
fn within_limits(model: &Model, field: &str, x: &Row) -> Result<(), ProblemError> {
    const SLACK: f64 = 1e-6;
    for v in 0..model.n() {
        let (low, high) = (model.lower[v], model.upper[v]);
        if !(x[v] >= low - SLACK && x[v] <= high + SLACK) {
            let place = format!("{field}[{}]", model.map().indices()[v]);
            return Err(ProblemError::new(place, format!("{} is outside the limits [{low}, {high}]", x[v])));
        }
    }
    Ok(())
}

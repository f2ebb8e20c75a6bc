//! Plans collision-free motions from one joint vector to one of several goals. Each motion is timed, keeps a clearance,
//! and is proven collision-free along its whole length.

mod along_poses;
mod field;
mod goal;
mod ik;
mod moving;
mod normals;
mod path;
mod paths;
mod question;
mod rounding;
mod shorten;
mod sweep;
mod tree;

use std::time::Instant;

use gensim2_geometry::Other;

use crate::cancel::end_of;
use crate::default_limits::{assumed_limits, warnings};
use crate::error::finite;
use crate::model::{MAX_JOINTS, Model, Row, between};
use crate::parallel::in_parallel;
use crate::timing::{Builder, Dynamics, Limits, Spline, can_stop, stop};
use crate::world::{CONTACT, Close, Hit, Required};
use crate::{Cancel, Overload, ProblemError, Scene, Trajectory};

pub use along_poses::{PathTolerance, plan_along};
pub(crate) use field::{Ending, Field};
pub use goal::Goal;
pub(crate) use goal::check_others;
pub use ik::{IkOptions, MAX_SOLUTIONS, solutions};
use moving::State;
use path::Along;
pub(crate) use paths::Searches;
pub use question::{Approached, Motion, NoMotion, TransitOptions};
pub(crate) use rounding::Rounding;
pub(crate) use shorten::effort_along;
pub(crate) use sweep::{Breach, Carriage, Sweep};

/// Clearance (m) that the search keeps in addition to the margin, because rounded corners may come closer to obstacles.
const CURVED: f64 = 1e-3;
/// Tolerance of joint values (rad or m) for rounding.
const SLACK: f64 = 1e-6;
/// Number of parts of an edge at whose ends the torques that hold the robot are computed, to explain a failure.
const STRAINED: u32 = 20;

/// Plans a motion from `q_start` (one entry per joint) that ends at rest at whichever goal is easiest to reach. Joints
/// that are not planned keep their values, and goals must contain the same values. The motion begins at rest, or
/// with the velocity and acceleration in the options.
///
/// From a moving start, the candidates are the fastest motion to each goal, regardless of obstacles, and the rest of
/// the current motion, if given. The planner returns the collision-free candidate that ends first. If every candidate
/// collides, it searches for a path around the obstacles.
///
/// ```
/// use std::sync::Arc;
///
/// use gensim2_geometry::{Convex, Joint, Link, Pose, Robot};
/// use gensim2_kpam::{Body, Goal, Role, Scene, TransitOptions, plan_to};
/// use nalgebra::Vector3;
///
/// let cube = || Convex::cuboid([0.05; 3], &Pose::identity());
/// let slide = |name: &str, axis| Joint::prismatic(name, axis).limits(-1.0, 1.0).velocity(0.5);
/// let robot = Robot::builder("plotter")
///     .link(Link::base("frame"))
///     .link(Link::below("frame", "bridge").moved_by(slide("x", Vector3::x())))
///     .link(Link::below("bridge", "pen").moved_by(slide("y", Vector3::y())).shape(cube()?))
///     .build("pen")?;
/// let post = Body::builder("post", Role::Rigid).shape(cube()?).build()?;
/// let scene = Scene::new(Arc::new(robot), vec![post], Vec::new())?;
/// let goal = Goal::Joints(vec![vec![0.5, 0.0]]);
/// let found = plan_to(&scene, &[-0.5, 0.0], &goal, &TransitOptions::default())?;
/// let motion = found.map_err(|refused| format!("{refused:?}"))?;
/// assert!(motion.trajectory.end() > 1.0); // 1 m at 0.5 m/s, around the post
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// Start, goals or options are invalid; names the field.
pub fn plan_to(
    scene: &Scene,
    q_start: &[f64],
    goal: &Goal,
    options: &TransitOptions,
) -> Result<Result<Motion, NoMotion>, ProblemError> {
    let begun = Instant::now();
    finite("q_start", q_start)?;
    let robot = scene.robot();
    let model = Model::new(robot, q_start)?;
    let mut transit = Transit::new(scene, &model, options, begun)?;
    transit.goals = goal.joints(scene, &model, q_start, options, &transit.over)?;
    if transit.goals.is_empty() {
        return Ok(Err(transit.ending.reason().unwrap_or(NoMotion::Unreachable)));
    }
    if let Some(along) = &mut transit.along {
        transit.goals.iter().try_for_each(|(_, x)| along.check(&model, "goal", x))?;
    }
    if transit.is_moving {
        let [position, velocity, acceleration] = &transit.state;
        if let Err(e) = can_stop(&transit.limits, &model.lower, &model.upper, position, velocity, acceleration) {
            let joint = robot.joints()[model.map().indices()[e.joint]].name().to_owned();
            return Ok(Err(NoMotion::CannotStop(joint, e)));
        }
        transit.limits = transit.limits.admitting(position, velocity, acceleration);
    }
    Ok(transit.plan())
}

/// A motion, or the reason why there is none, and the CPU time (s) of planning.
pub type TimedMotion = (Result<Motion, NoMotion>, f64);

/// Plans a motion for each pair of a start and a goal, all with the same options, on `threads` threads, 1 to
/// [`MAX_THREADS`](crate::MAX_THREADS); `None` uses one thread for each processor core. Each result equals that of
/// [`plan_to`], and comes with the CPU time (s) that it took.
///
/// # Errors
/// A start, a goal or an option is invalid, with the index of the first such pair in the name of the field; or the number
/// of threads is out of range.
pub fn plan_to_many(
    scene: &Scene,
    pairs: &[(Vec<f64>, Goal)],
    options: &TransitOptions,
    threads: Option<usize>,
) -> Result<Vec<TimedMotion>, ProblemError> {
    let found = in_parallel(pairs, threads, |(q_start, goal)| {
        let clock = cpu_time::ThreadTime::now();
        plan_to(scene, q_start, goal, options).map(|found| (found, clock.elapsed().as_secs_f64()))
    })?;
    let placed = |(k, found): (usize, Result<_, ProblemError>)| {
        found.map_err(|e| {
            let place = |name: &str| e.field.strip_prefix(name).map(|rest| format!("{name}s[{k}]{rest}"));
            ProblemError::new(place("q_start").or_else(|| place("goal")).unwrap_or(e.field.clone()), e.message.clone())
        })
    };
    found.into_iter().enumerate().map(placed).collect()
}

struct Transit<'a> {
    scene: &'a Scene,
    model: &'a Model,
    options: &'a TransitOptions,
    state: State,
    /// Whether the start is moving.
    is_moving: bool,
    /// Joint values of the goals, each with the index of its goal.
    goals: Vec<(usize, Row)>,
    ending: Ending,
    /// Flag that ends planning.
    over: Cancel,
    limits: Limits,
    dynamics: Option<Dynamics>,
    along: Option<Along>,
}

/// Reason why a path cannot be turned into a motion.
enum Stuck {
    Near(Approached),
    /// The curve violates the path constraints.
    Off,
    Untimed,
    /// The path is blocked between the configurations that the search has checked.
    Blocked,
    /// Planning was cancelled, or a limit of the search was reached.
    Over,
}

impl<'a> Transit<'a> {
    /// Prepares planning from the start of a model, without goals.
    fn new(
        scene: &'a Scene,
        model: &'a Model,
        options: &'a TransitOptions,
        begun: Instant,
    ) -> Result<Self, ProblemError> {
        options.check()?;
        let start = model.start();
        within_limits(model, "q_start", &start)?;
        let mut along = Along::of(options.path.as_ref(), scene, &options.tool_keypoints)?;
        if let Some(along) = &mut along {
            along.check(model, "q_start", &start)?;
        }
        let deadline = end_of(begun, options.deadline);
        let over = options.cancel.clone().unwrap_or_default().until(deadline);
        let ending = Ending { cancel: options.cancel.clone(), deadline, max_checks: options.max_checks };
        let asked = options.limits();
        asked.check(scene.robot(), model)?;
        let rates = |list: &Option<Vec<f64>>| list.as_ref().map_or([0.0; MAX_JOINTS], |v| model.pick(v));
        let state = [start, rates(&options.start_velocity), rates(&options.start_acceleration)];
        Ok(Self {
            scene,
            model,
            options,
            state,
            is_moving: state[1..].iter().flatten().any(|v| *v != 0.0),
            goals: Vec::new(),
            ending,
            over,
            limits: Limits::asked(model, &asked),
            dynamics: Dynamics::asked(scene.robot(), model, &asked),
            along,
        })
    }
}

impl Transit<'_> {
    fn plan(self) -> Result<Motion, NoMotion> {
        let (world, robot) = (self.scene.compiled(), self.scene.robot());
        let margin = self.options.margin;
        let overlap = |close: &Close| close.iter().find(|c| c.2 < -CONTACT).map(|c| self.approached(c));
        let at_start = self.close(&self.state[0]);
        if let Some(hit) = overlap(&at_start) {
            return Err(NoMotion::StartBlocked(hit));
        }
        self.is_held_at_start()?;
        let mut open: Vec<(usize, Row, Close)> = Vec::new();
        let mut blocked = None;
        for (k, goal) in &self.goals {
            if let Some(reason) = self.ending.reason() {
                return Err(reason);
            }
            let close = self.close(goal);
            match overlap(&close) {
                Some(hit) => blocked = blocked.or(Some(hit)),
                None => open.push((*k, *goal, close)),
            }
        }
        if let (true, Some(hit)) = (open.is_empty(), blocked) {
            return Err(NoMotion::GoalsBlocked(hit));
        }
        let mut overload = None;
        open.retain(|g| {
            let found = self.overload(&g.1);
            let is_held = found.is_none();
            overload = overload.take().or(found);
            is_held
        });
        if let (true, Some(first)) = (open.is_empty(), overload) {
            return Err(NoMotion::Overloaded(first, "at the goal".to_owned()));
        }
        let pace = self.limits.pace();
        let all: Vec<&Close> = std::iter::once(&at_start).chain(open.iter().map(|g| &g.2)).collect();
        let nearer = |closes: &[&Close], clearance: f64| {
            let mut needs = world.needs_beside(robot, closes.iter().copied().flatten(), clearance, margin);
            world.leave_out_still(&mut needs, self.model.map());
            Required::from(needs)
        };
        let goals: Vec<Row> = open.iter().map(|g| g.1).collect();
        let mut field = Field::new(self.scene, self.model, nearer(&all, margin + CURVED), self.ending.clone());
        field.along.clone_from(&self.along);
        let told_of = |field: &Field<'_>, trajectory: Trajectory, way: &[Row], number: usize, close: &Close| {
            self.motion(trajectory, way, number, at_start.iter().chain(close), field.checks)
        };
        let soonest = self.at_once(&mut field, &open, |close| nearer(&[&at_start, close], margin));
        if let Some((trajectory, k)) = soonest {
            let (number, goal, close) = &open[k];
            return Ok(told_of(&field, trajectory, &[self.state[0], *goal], *number, close));
        }
        if self.is_moving {
            let asked = |goal: &Row| open.iter().find(|g| g.1 == *goal).map(|g| nearer(&[&at_start, &g.2], margin));
            if let Some((trajectory, way)) = self.around(&mut field, &goals, &pace, asked)
                && let Some((number, _, close)) = open.iter().find(|g| Some(&g.1) == way.last())
            {
                return Ok(told_of(&field, trajectory, &way, *number, close));
            }
        }
        let begin = self.beginning(&mut field);
        let (mut breach, mut strained) = (None, None);
        let mut searches = Searches::new(self.options.samples, self.options.seed);
        while let Some(found) = searches.next(&mut field, &begin, &goals, &pace) {
            let Ok(paths) = found else {
                // After a failed search, reduce the clearance that is kept in addition to the margin.
                field.needs = nearer(&all, margin + 0.2 * CURVED);
                continue;
            };
            for path in &paths {
                let Some((number, _, close)) = open.iter().find(|g| path.last() == Some(&g.1)) else { continue };
                let needs = nearer(&[&at_start, close], margin);
                let timed = match self.is_moving {
                    true => self.blended(&mut field, path, &needs),
                    false => self.timed(&mut field, path, &needs),
                };
                match timed {
                    Ok(trajectory) => return Ok(told_of(&field, trajectory, path, *number, close)),
                    Err(Stuck::Blocked) => {}
                    Err(stuck) => {
                        strained = matches!(stuck, Stuck::Untimed).then(|| self.strained(path)).flatten();
                        breach = Some(stuck);
                    }
                }
            }
            field.refine();
        }
        Err(self.ending.reason().unwrap_or(match breach {
            Some(Stuck::Untimed) => strained.unwrap_or(NoMotion::Untimed),
            Some(Stuck::Near(found)) => NoMotion::NotFound(Some(found)),
            Some(Stuck::Off | Stuck::Blocked | Stuck::Over) | None => NoMotion::NotFound(None),
        }))
    }

    /// Returns the joint whose torque limit does not suffice to hold the robot still, if torques are limited.
    fn overload(&self, x: &Row) -> Option<Overload> {
        self.dynamics.as_ref()?.overload(x)
    }

    /// Refuses a start at which a joint cannot hold the robot.
    fn is_held_at_start(&self) -> Result<(), NoMotion> {
        match self.overload(&self.state[0]) {
            Some(overload) => Err(NoMotion::Overloaded(overload, "at the start".to_owned())),
            None => Ok(()),
        }
    }

    /// Returns the reason why a path has no motion, if it is that a joint cannot hold the robot on the path.
    fn strained(&self, path: &[Row]) -> Option<NoMotion> {
        self.dynamics.as_ref()?;
        let found = path.windows(2).find_map(|pair| {
            (0..=STRAINED).find_map(|k| {
                let share = f64::from(k) / f64::from(STRAINED);
                self.overload(&between(&pair[0], &pair[1], share))
            })
        });
        found.map(|overload| NoMotion::Overloaded(overload, "on the path".to_owned()))
    }

    fn approached(&self, (group, other, distance): &(usize, Other, f64)) -> Approached {
        Approached { bodies: self.scene.compiled().named(self.scene, *group, *other), distance: *distance }
    }

    /// Returns a proven motion with its facts. `way` are the vertices of its path, and `near` the pairs that are close to
    /// each other at the start or at the goal.
    fn motion<'c>(
        &self,
        trajectory: Trajectory,
        way: &[Row],
        goal: usize,
        near: impl Iterator<Item = &'c (usize, Other, f64)>,
        checks: u64,
    ) -> Motion {
        let mut nearer: Vec<Approached> = near.map(|c| self.approached(c)).collect();
        nearer.sort_by(|a, b| a.bodies.cmp(&b.bodies).then(a.distance.total_cmp(&b.distance)));
        nearer.dedup_by(|b, a| a.bodies == b.bodies);
        let limits = self.options.limits();
        Motion {
            trajectory,
            goal,
            corners: way.iter().map(|x| self.full(x)).collect(),
            nearer,
            checks,
            assumed_limits: assumed_limits(self.model, &limits),
            warnings: warnings(self.scene.robot(), self.model, &limits),
        }
    }

    fn full(&self, x: &Row) -> Vec<f64> {
        let mut q = Vec::new();
        self.model.map().positions(x, &mut q);
        q
    }

    /// Returns all pairs closer than the margin at a configuration that the motion can bring closer.
    fn close(&self, x: &Row) -> Close {
        self.scene.compiled().close(self.scene, &self.full(x), self.options.margin + CURVED, self.model.map())
    }

    /// Returns the configuration at which a search begins: where a moving arm would stop, or the start.
    fn beginning(&self, field: &mut Field<'_>) -> Row {
        let [position, velocity, acceleration] = &self.state;
        let nodes = stop(&self.limits, position, velocity, acceleration);
        match nodes.last() {
            Some(last) if self.is_moving && field.blocked_at(&[last.position]).is_none() => last.position,
            _ => *position,
        }
    }

    fn sweep<'s>(&'s self, needs: &'s Required, field: &Field<'_>) -> Sweep<'s> {
        Sweep::new((self.scene, self.scene.compiled()), self.model, needs, field.weights, &self.over)
    }

    /// Proves that a motion keeps its required distances and path constraints.
    fn proven(&self, field: &mut Field<'_>, sweep: &mut Sweep<'_>, motion: &Trajectory) -> Result<(), Stuck> {
        let found = sweep.breach(motion, [motion.start(), motion.end()]);
        field.checks += std::mem::take(&mut sweep.checks);
        found.map_err(|breach| match breach {
            Breach::Near(Hit { first, second, distance, .. }) => {
                Stuck::Near(Approached { bodies: [first, second], distance })
            }
            Breach::Over => Stuck::Over,
        })?;
        let is_over = || self.over.is_cancelled();
        let stays = self.along.clone().is_none_or(|mut along| along.proves(self.model, motion, &is_over));
        if stays { Ok(()) } else { Err(Stuck::Off) }
    }

    fn builder(&self) -> Builder {
        Builder::new(self.limits, self.options.start_time)
            .loaded(self.dynamics.clone())
            .cancelled_by(Some(self.over.clone()))
    }

    /// Returns a motion along a path. Its corners are rounded as widely as possible; if this fails, the motion stops at
    /// each corner. Returns the obstacle if neither motion is collision-free.
    fn timed(&self, field: &mut Field<'_>, corners: &[Row], needs: &Required) -> Result<Trajectory, Stuck> {
        let n = self.model.n();
        let mut sweep = self.sweep(needs, field);
        let rest = [0.0; MAX_JOINTS];
        let mut breach = Stuck::Untimed;
        let mut rounding = Rounding::new(corners);
        while let Some((path, ..)) = rounding.next(field, n, self.model) {
            let mut builder = self.builder();
            if builder.push(&path, &[], &rest, None, &[]).is_err() {
                break;
            }
            let trajectory = builder.build(self.model.map());
            match self.proven(field, &mut sweep, &trajectory) {
                Ok(()) => return Ok(trajectory),
                Err(found) => breach = found,
            }
            if corners.len() < 3 {
                return Err(breach);
            }
            if rounding.is_blocked(field) {
                break;
            }
            rounding.tighten();
        }
        if rounding.is_blocked(field) {
            return Err(Stuck::Blocked);
        }
        let mut builder = self.builder();
        let straight = |edge: &[Row]| Spline::through(n, edge, None);
        if corners.windows(2).all(|edge| builder.push(&straight(edge), &[], &rest, None, &[]).is_ok()) {
            let trajectory = builder.build(self.model.map());
            return self.proven(field, &mut sweep, &trajectory).map(|()| trajectory);
        }
        Err(breach)
    }
}

/// Returns an error if variables exceed their limits by more than rounding.
pub(crate) fn within_limits(model: &Model, field: &str, x: &Row) -> Result<(), ProblemError> {
    for v in 0..model.n() {
        let (low, high) = (model.lower[v], model.upper[v]);
        if !(x[v] >= low - SLACK && x[v] <= high + SLACK) {
            let place = format!("{field}[{}]", model.map().indices()[v]);
            return Err(ProblemError::new(place, format!("{} is outside the limits [{low}, {high}]", x[v])));
        }
    }
    Ok(())
}

//! Servoing: differential inverse kinematics for control loops. Each step moves the arm toward a target that may change
//! at any time, and keeps the limits of all joints and a distance from obstacles.
//!
//! A step ([`Servo::step`]) has five parts:
//!
//! 1. The velocities that the joint limits permit are computed ([`joint`]).
//! 2. The pairs of bodies near each other are measured ([`pairs`]).
//! 3. The target determines wanted velocities ([`task`]).
//! 4. A quadratic program chooses permitted velocities close to the wanted ones ([`program`]).
//! 5. The step is taken only if the stop that may follow it is proven to keep the required distances ([`guard`]).
//!    Otherwise the arm follows the stop that was proven last, so that it never reaches a state from which it could not
//!    stop safely.

mod arm;
mod bubble;
mod guard;
mod joint;
mod motion;
mod options;
mod pairs;
mod program;
mod task;
#[cfg(test)]
mod tests;
mod types;

use gensim2_geometry::Other;
use nalgebra::Vector6;

use crate::body::rigid;
use crate::error::{finite, for_each_joint};
use crate::model::{MAX_JOINTS, Model, Row};
use crate::timing::{Limits, State, can_stop};
use crate::transit::{check_others, within_limits};
use crate::world::{CONTACT, TOUCH, is_below};
use crate::{ProblemError, Scene};

use arm::Arm;
use guard::{Guard, Surroundings};
use joint::{Course, JointLimits, Settled};
use pairs::{Pair, Present, near_pairs};
use program::{Choice, Program};
use task::{Aim, Setting};

pub use options::ServoOptions;
pub use types::{ServoLimit, ServoStatus, ServoStep, Target};

/// Factor of the wanted velocities after a step that was not proven, and after a proven step.
const SLOWER: f64 = 0.5;
const FASTER: f64 = 1.02;
const SLOWEST: f64 = 0.05;
/// Range of the length of a step (s).
const STEPS: std::ops::RangeInclusive<f64> = 1e-4..=0.1;

/// Moves an arm toward a changing target, one step at a time.
///
/// ```
/// use std::sync::Arc;
///
/// use gensim2_geometry::{Convex, Joint, Link, Pose, Robot};
/// use gensim2_kpam::{Body, Role, Scene, Servo, ServoOptions, Target};
/// use nalgebra::Vector3;
///
/// let cube = || Convex::cuboid([0.05; 3], &Pose::identity());
/// let slide = |name: &str, axis| Joint::prismatic(name, axis).limits(-1.0, 1.0).velocity(0.5);
/// let robot = Robot::builder("plotter")
///     .link(Link::base("frame"))
///     .link(Link::below("frame", "bridge").moved_by(slide("x", Vector3::x())))
///     .link(Link::below("bridge", "pen").moved_by(slide("y", Vector3::y())).shape(cube()?))
///     .build("pen")?;
/// let wall = Body::builder("wall", Role::Rigid).shape(cube()?).pose(Pose::translation(0.4, 0.0, 0.0)).build()?;
/// let scene = Scene::new(Arc::new(robot), vec![wall], Vec::new())?;
/// let mut servo = Servo::new(&scene, &[0.0, 0.0], &ServoOptions::default())?;
/// let target = Target::Pose { pose: Pose::translation(0.5, 0.0, 0.0), twist: [0.0; 6] };
/// let mut last = servo.step(&target)?;
/// for _ in 0..3000 {
///     last = servo.step(&target)?;
/// }
/// // The wall is in the way: the pen keeps 5 mm from it.
/// assert!(last.position[0] < 0.295 && !scene.checker().hits(&last.position)?);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Servo {
    scene: Scene,
    model: Model,
    options: ServoOptions,
    posture: Row,
    limits: Limits,
    joints: Vec<JointLimits>,
    arm: Arm,
    guard: Guard,
    program: Program,
    /// The proven motion that the arm follows, and the time (s) since its start.
    courses: Vec<Course>,
    elapsed: f64,
    /// Fraction of the wanted velocities that is used.
    share: f64,
    /// Buffers of a step.
    states: Vec<State>,
    pairs: Vec<Pair>,
    ranges: Vec<Settled>,
    next: Vec<Course>,
}

impl Servo {
    /// Creates a servo for an arm that rests at the joints `q`. Joints that are not planned keep their values.
    ///
    /// # Errors
    /// An option or the start is invalid, or bodies overlap at the start; names the field.
    pub fn new(scene: &Scene, q: &[f64], options: &ServoOptions) -> Result<Self, ProblemError> {
        let robot = &**scene.robot();
        if !(0.0..=0.1).contains(&options.margin) {
            return Err(ProblemError::new("margin", format!("must lie in 0 to 0.1 m, not {}", options.margin)));
        }
        if !STEPS.contains(&options.dt) {
            return Err(ProblemError::new("dt", format!("must lie in 0.0001 to 0.1 s, not {}", options.dt)));
        }
        for_each_joint("q", q, robot.joints().len())?;
        let model = Model::new(robot, q)?;
        let asked = options.asked();
        asked.check(robot, &model)?;
        let limits = Limits::asked(&model, &asked);
        let link = match &options.link {
            None => robot.hand(),
            Some(name) => robot
                .link_index(name)
                .ok_or_else(|| ProblemError::new("link", format!("{name:?} is not a link of {:?}", robot.name())))?,
        };
        if !model.map().driven().iter().any(|driven| is_below(robot, link, driven.link)) {
            let message = format!("no planned joint moves {:?}; name another link", robot.links()[link].name());
            return Err(ProblemError::new("link", message));
        }
        let posture = match &options.posture {
            None => model.start(),
            Some(posture) => {
                for_each_joint("posture", posture, robot.joints().len())?;
                let posture = model.pick(posture);
                within_limits(&model, "posture", &posture)?;
                posture
            }
        };
        let around = Surroundings { scene, model: &model };
        let (arm, guard) = (Arm::new(around, link), Guard::new(around, scene.compiled().needs(options.margin)));
        let mut out = Self {
            scene: scene.clone(),
            model,
            options: options.clone(),
            posture,
            limits,
            joints: Vec::new(),
            arm,
            guard,
            program: Program::default(),
            courses: Vec::new(),
            elapsed: 0.0,
            share: 1.0,
            states: Vec::new(),
            pairs: Vec::new(),
            ranges: Vec::new(),
            next: Vec::new(),
        };
        out.reset(q, None, None)?;
        Ok(out)
    }

    /// Sets the state of the arm, by default at rest. Joints that are not planned keep the values of `q`.
    ///
    /// # Errors
    /// The state is invalid, bodies overlap, or the arm cannot stop within its limits and without a collision; the
    /// servo then keeps its former state.
    pub fn reset(
        &mut self,
        q: &[f64],
        velocity: Option<&[f64]>,
        acceleration: Option<&[f64]>,
    ) -> Result<(), ProblemError> {
        let robot = &**self.scene.robot();
        let n = robot.joints().len();
        for_each_joint("q", q, n)?;
        let model = Model::new(robot, q)?;
        let x = model.start();
        within_limits(&model, "q", &x)?;
        let rates = |field: &str, list: Option<&[f64]>| match list {
            None => Ok([0.0; MAX_JOINTS]),
            Some(list) => for_each_joint(field, list, n).map(|()| model.pick(list)),
        };
        let (velocity, acceleration) = (rates("velocity", velocity)?, rates("acceleration", acceleration)?);
        can_stop(&self.limits, &model.lower, &model.upper, &x, &velocity, &acceleration).map_err(|e| {
            let joint = robot.joints()[model.map().indices()[e.joint]].name();
            ProblemError::new("velocity", format!("joint {joint} cannot be stopped in time: {}", e.reason))
        })?;
        let world = self.scene.compiled();
        let margin = self.options.margin;
        let close = world.close(&self.scene, model.map().rest(), margin + TOUCH, model.map());
        if let Some((group, other, distance)) = close.iter().find(|c| c.2 < -CONTACT) {
            let [one, two] = world.named(&self.scene, *group, *other);
            let message = format!(
                "{one} and {two} overlap by {:.1} mm; start from a configuration without collisions",
                -1e3 * distance
            );
            return Err(ProblemError::new("q", message));
        }
        let mut needs = world.needs_beside(robot, &close, margin, margin);
        // Bodies in contact may move apart, or slide within a tolerance: unlike screening, the proof by planes holds for
        // overlaps too.
        for (group, other, distance) in close.iter().filter(|c| c.2 < TOUCH) {
            if let Some(need) = world.need_mut(&mut needs, *group, *other) {
                *need = need.min(distance - TOUCH);
            }
        }
        world.leave_out_still(&mut needs, model.map());
        let limits = self.limits.admitting(&x, &velocity, &acceleration);
        let joints: Vec<JointLimits> = (0..model.n())
            .map(|v| JointLimits {
                variable: v,
                lower: model.lower[v],
                upper: model.upper[v],
                velocity: limits.velocity[v],
                acceleration: limits.acceleration[v],
                jerk: limits.jerk[v],
                envelope: limits.envelope,
            })
            .collect();
        // A start that exceeds a limit by rounding keeps the limit of its stop.
        let mut courses = Vec::with_capacity(joints.len());
        let mut wider = joints;
        for limits in &mut wider {
            let v = limits.variable;
            let course = Course::stop([x[v], velocity[v], acceleration[v]], limits);
            limits.include(&course);
            courses.push(course);
        }
        let around = Surroundings { scene: &self.scene, model: &model };
        let mut guard = Guard::new(around, needs);
        if !guard.proves(around, &courses) {
            let what = guard.blocked.map_or_else(
                || "its surroundings".to_owned(),
                |(group, other)| world.named(&self.scene, group, other).join(" and "),
            );
            let message = format!(
                "no stop from this state is proven to keep {:.1} mm from obstacles ({what}); \
                 reduce the velocity or the margin, or start further away",
                1e3 * margin
            );
            return Err(ProblemError::new("q", message));
        }
        if self.options.posture.is_none() {
            self.posture = x;
        }
        (self.model, self.joints, self.guard, self.courses) = (model, wider, guard, courses);
        (self.elapsed, self.share) = (0.0, 1.0);
        Ok(())
    }

    /// Moves the arm by one step toward a target, and returns its new state.
    ///
    /// # Errors
    /// The target is not finite, has the wrong length, or changes a joint that does not move the hand; the state of the
    /// arm then stays the same.
    pub fn step(&mut self, target: &Target) -> Result<ServoStep, ProblemError> {
        let aim = self.aim(target)?;
        let x = self.place();
        self.bound_velocities();
        let distance = self.measure_pairs(&x);
        let choice = self.choose_velocities(&aim, &x);
        let (status, limited_by) = self.take_if_proven(choice.as_ref());
        self.adapt_speed(status);
        self.elapsed += self.options.dt;
        Ok(self.report(status, limited_by, distance))
    }

    /// Computes the present states of the variables and the kinematics there. Returns the variables.
    fn place(&mut self) -> Row {
        let mut x = [0.0; MAX_JOINTS];
        self.states.clear();
        for (course, value) in self.courses.iter().zip(&mut x) {
            let state = course.at(self.elapsed);
            *value = state[0];
            self.states.push(state);
        }
        self.arm.place(Surroundings { scene: &self.scene, model: &self.model }, &x);
        x
    }

    /// Computes the velocities that the limits of the joints permit.
    fn bound_velocities(&mut self) {
        self.ranges.clear();
        let dt = self.options.dt;
        self.ranges.extend(self.joints.iter().zip(&self.states).map(|(joint, state)| joint.range(*state, dt)));
    }

    /// Measures the pairs of bodies near each other. Returns the smallest distance (m).
    fn measure_pairs(&mut self, x: &Row) -> f64 {
        let around = Surroundings { scene: &self.scene, model: &self.model };
        self.guard.look_around(around, &self.courses, x);
        let (arm, limits, states, ranges) = (&self.arm, &self.joints, &self.states, &self.ranges);
        near_pairs(around, &mut self.guard, &Present { arm, limits, states, x, ranges }, &mut self.pairs)
    }

    /// Chooses permitted velocities close to those that a target asks for; `None` if no velocities are permitted.
    fn choose_velocities(&mut self, aim: &Aim, x: &Row) -> Option<Choice> {
        let setting = Setting {
            model: &self.model,
            arm: &self.arm,
            limits: &self.joints,
            x,
            posture: &self.posture,
            share: self.share,
        };
        self.program.solve(&setting.cost(aim), &self.ranges, &self.pairs)
    }

    /// Follows chosen velocities if the stop after the step is proven to be safe. Returns how the step was chosen, and the
    /// limits that determine it.
    fn take_if_proven(&mut self, choice: Option<&Choice>) -> (ServoStatus, Vec<ServoLimit>) {
        let Some(choice) = choice else {
            let nearest = self.pairs.first().map(|pair| self.apart(pair.group, pair.other));
            return (ServoStatus::Braking, nearest.into_iter().collect());
        };
        self.next.clear();
        for (v, (joint, state)) in self.joints.iter().zip(&self.states).enumerate() {
            self.next.push(joint.toward(*state, &self.ranges[v], choice.settled[v], self.options.dt));
        }
        let around = Surroundings { scene: &self.scene, model: &self.model };
        if !self.guard.proves(around, &self.next) {
            let blocked = self.guard.blocked.map(|(group, other)| self.apart(group, other));
            return (ServoStatus::Braking, blocked.into_iter().collect());
        }
        std::mem::swap(&mut self.courses, &mut self.next);
        self.elapsed = 0.0;
        let limited_by = self.active(&choice.multipliers);
        let status = if limited_by.is_empty() { ServoStatus::Tracking } else { ServoStatus::Limited };
        (status, limited_by)
    }

    /// Reduces the wanted velocities after a step that was not proven, and restores them slowly.
    fn adapt_speed(&mut self, status: ServoStatus) {
        self.share = match status {
            ServoStatus::Braking => (SLOWER * self.share).max(SLOWEST),
            ServoStatus::Tracking | ServoStatus::Limited => (FASTER * self.share).min(1.0),
        };
    }

    /// Returns the state of the arm.
    fn report(&self, status: ServoStatus, limited_by: Vec<ServoLimit>, distance: f64) -> ServoStep {
        let mut rows = [[0.0; MAX_JOINTS]; 3];
        for (v, course) in self.courses.iter().enumerate() {
            let state = course.at(self.elapsed);
            rows.iter_mut().zip(state).for_each(|(row, value)| row[v] = value);
        }
        let n = self.model.map().joints();
        let [mut position, mut velocity, mut acceleration] = [vec![0.0; n], vec![0.0; n], vec![0.0; n]];
        self.model.map().fill(&rows, &mut position, &mut velocity, &mut acceleration);
        ServoStep { position, velocity, acceleration, status, limited_by, distance }
    }

    /// Checks a target and reduces it to the variables.
    fn aim(&self, target: &Target) -> Result<Aim, ProblemError> {
        let twist = |values: &[f64; 6]| finite("twist", values).map(|()| Vector6::from(*values));
        match target {
            Target::Pose { pose, twist: velocity } => {
                rigid("target", pose)?;
                Ok(Aim::Pose(*pose, twist(velocity)?))
            }
            Target::Twist(velocity) => twist(velocity).map(Aim::Twist),
            Target::Joints(q) => {
                for_each_joint("target", q, self.model.map().joints())?;
                check_others(&self.scene, &self.model, "target", self.model.map().rest(), q)?;
                Ok(Aim::Joints(self.model.pick(q)))
            }
            Target::Rest => Ok(Aim::Rest),
        }
    }

    /// Returns the limits that determine a step, from the multipliers of the quadratic program.
    fn active(&self, multipliers: &[f64]) -> Vec<ServoLimit> {
        let (ranges, pairs) = (&self.ranges, &self.pairs);
        let mut out = Vec::new();
        for (v, (range, force)) in ranges.iter().zip(multipliers).enumerate().filter(|(_, (_, f))| **f != 0.0) {
            let joint = self.model.map().indices()[v];
            let (end, by_range) =
                if *force > 0.0 { (range.low, range.by_range[0]) } else { (range.high, range.by_range[1]) };
            out.push(match by_range {
                true if end.abs() >= self.joints[v].velocity * (1.0 - 1e-4) => ServoLimit::Velocity(joint),
                true => ServoLimit::Position(joint),
                false => ServoLimit::Acceleration(joint),
            });
        }
        for (pair, force) in pairs.iter().zip(&multipliers[ranges.len()..]) {
            let limit = self.apart(pair.group, pair.other);
            if *force != 0.0 && !out.contains(&limit) {
                out.push(limit);
            }
        }
        out
    }

    fn apart(&self, group: usize, other: Other) -> ServoLimit {
        let screen = &self.scene.compiled().screen;
        let second = match other {
            Other::Pair(pair) => screen.pairs()[pair].1,
            Other::Element(_) | Other::Cloud(_) => screen.groups() + screen.body(other).unwrap_or(0),
        };
        ServoLimit::Distance(group, second)
    }

    /// Returns the name of a body in [`ServoLimit::Distance`]: a link, or a body of the scene.
    #[must_use]
    pub fn body_name(&self, index: usize) -> &str {
        let names = &self.scene.compiled().names;
        let body = || self.scene.bodies().get(index - names.len()).map_or("", |body| body.name());
        names.get(index).map_or_else(body, String::as_str)
    }

    /// The scene.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Warnings: assumed limits with their joints, and links that are never checked for collisions.
    #[must_use]
    pub fn warnings(&self) -> Vec<String> {
        crate::default_limits::warnings(self.scene.robot(), &self.model, &self.options.asked())
    }
}

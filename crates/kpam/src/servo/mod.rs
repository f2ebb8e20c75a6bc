//! Servoing: differential inverse kinematics for control loops. Each step moves the arm toward a target that may change
//! at any time, and keeps the limits of all joints and a distance from obstacles.
//!
//! A step chooses velocities by a quadratic program ([`task`]) whose bounds keep every joint within its limits
//! ([`joint`]) and slow down the approach of obstacles. The step is taken only if the stop that may follow it is proven
//! to keep the required distances ([`guard`]). Otherwise the arm follows the stop that was proven last, so that it never
//! reaches a state from which it could not stop safely.

mod guard;
mod joint;
mod task;

use gensim2_geometry::{Chain, ChainFrames, Contact, JointKind, Other, Pose};
use nalgebra::Vector6;

use crate::body::rigid;
use crate::error::{finite, for_each_joint};
use crate::model::{MAX_JOINTS, Model, Row};
use crate::options::LimitSet;
use crate::qp::{ActiveSet, Bound, Qp, QpOutcome, QpSolver};
use crate::timing::{Limits, State, can_stop};
use crate::transit::{check_others, within_limits};
use crate::world::{CONTACT, Compiled, TOUCH};
use crate::{Options, ProblemError, Scene};

use guard::{Guard, INFLUENCE};
use joint::{Course, JointLimits, Settled};
use task::{Aim, Setting, approach};

/// Distance (m) that the quadratic program keeps in addition to the margin, so that steps along obstacles are proven.
const BUFFER: f64 = 2e-3;
/// Ratio of the speed of approach to the remaining distance (1/s).
const DAMPER: f64 = 15.0;
/// Fraction of the joints' acceleration limits with which the approach of an obstacle is planned.
const BRAKING: f64 = 0.25;
/// Maximum number of pairs of bodies that bound a step.
const PAIRS: usize = 16;
/// Factor of the wanted velocities after a step that was not proven, and after a proven step.
const SLOWER: f64 = 0.5;
const FASTER: f64 = 1.02;
const SLOWEST: f64 = 0.05;
/// Range of the length of a step (s).
const STEPS: std::ops::RangeInclusive<f64> = 1e-4..=0.1;

/// Options of servoing.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct ServoOptions {
    /// Link that follows poses and twists; the hand if `None`.
    pub link: Option<String>,
    /// Minimum distance (m) between the bodies of each checked pair, 5 mm by default. A pair that is closer at the start
    /// keeps the smaller distance. Links that are closer in every configuration must only not collide.
    pub margin: f64,
    /// Joint values (rad or m, one for each joint) that a redundant arm moves toward as long as the link does not move;
    /// default: the start.
    pub posture: Option<Vec<f64>>,
    /// Length of a step (s).
    pub dt: f64,
    /// Fraction of the velocity limits that may be used.
    pub velocity_scale: f64,
    /// Fraction of the acceleration and jerk limits that may be used.
    pub acceleration_scale: f64,
    /// Acceleration and jerk limits of a known arm.
    pub limits: Option<LimitSet>,
    /// Velocity limits (rad/s or m/s), one entry for each joint; default: the URDF's.
    pub velocity_limits: Option<Vec<f64>>,
    /// Acceleration limits (rad/s^2 or m/s^2), one entry for each joint; default: the URDF's, else those of `limits`.
    pub acceleration_limits: Option<Vec<f64>>,
    /// Jerk limits (rad/s^3 or m/s^3), one entry for each joint; default: the URDF's, else those of `limits`.
    pub jerk_limits: Option<Vec<f64>>,
}

impl Default for ServoOptions {
    fn default() -> Self {
        Self {
            link: None,
            margin: 0.005,
            posture: None,
            dt: 1e-3,
            velocity_scale: 1.0,
            acceleration_scale: 1.0,
            limits: None,
            velocity_limits: None,
            acceleration_limits: None,
            jerk_limits: None,
        }
    }
}

/// Target of a step. Velocities are linear (m/s) and angular (rad/s), in the base frame.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Target {
    /// A pose of the link in the base frame, and the velocity of this pose.
    Pose {
        /// Pose of the link.
        pose: Pose,
        /// Velocity of the pose; zero if it does not move.
        twist: [f64; 6],
    },
    /// A velocity of the link.
    Twist([f64; 6]),
    /// Values of all joints (rad or m).
    Joints(Vec<f64>),
    /// Rest, as soon as the limits allow.
    Rest,
}

/// How a step was chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ServoStatus {
    /// The arm moves as the target asks.
    Tracking,
    /// Limits or obstacles change the motion that the target asks for.
    Limited,
    /// No step toward the target was proven safe; the arm follows the stop that was proven last.
    Braking,
}

/// A limit that determines a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ServoLimit {
    /// The velocity limit of a joint, by its index in the joint vector.
    Velocity(usize),
    /// The acceleration or jerk limit of a joint.
    Acceleration(usize),
    /// The range of a joint, or a velocity limit that depends on its position.
    Position(usize),
    /// The distance of two bodies, by their indices in [`Servo::body_name`].
    Distance(usize, usize),
}

/// State of the arm after a step.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct ServoStep {
    /// Positions of all joints (rad or m).
    pub position: Vec<f64>,
    /// Velocities of all joints (rad/s or m/s).
    pub velocity: Vec<f64>,
    /// Accelerations of all joints (rad/s^2 or m/s^2).
    pub acceleration: Vec<f64>,
    /// How the step was chosen.
    pub status: ServoStatus,
    /// Limits that determine the step.
    pub limited_by: Vec<ServoLimit>,
    /// Smallest signed distance (m) over all checked pairs before the step; infinite if it is above 80 mm.
    pub distance: f64,
}

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
    chain: Chain,
    options: ServoOptions,
    posture: Row,
    limits: Limits,
    joints: Vec<JointLimits>,
    guard: Guard,
    solver: ActiveSet,
    frames: ChainFrames,
    /// The proven motion that the arm follows, and the time (s) since its start.
    courses: Vec<Course>,
    elapsed: f64,
    /// Fraction of the wanted velocities that is used.
    share: f64,
    q: Vec<f64>,
    poses: Vec<Pose>,
    bounds: Vec<Bound>,
}

/// Two bodies whose approach bounds a step.
struct Pair {
    group: usize,
    other: Other,
    /// Distance (m), and its gradient by the variables.
    distance: f64,
    gradient: Row,
    /// Largest permitted speed of approach (m/s).
    speed: f64,
}

impl Servo {
    /// Creates a servo for an arm that rests at the joints `q`. Joints that do not move the hand keep their values.
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
        let unknown = || ProblemError::new("link", format!("is not a link of {:?}", robot.name()));
        let chain = robot.chain_to(link).ok_or_else(unknown)?;
        if !chain.joint_indices().any(|joint| model.map().moves(joint)) {
            let message =
                format!("no joint that moves the hand moves {:?}; name another link", robot.links()[link].name());
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
        let guard = Guard::new(scene, scene.compiled().needs(options.margin));
        let mut out = Self {
            scene: scene.clone(),
            model,
            chain,
            options: options.clone(),
            posture,
            limits,
            joints: Vec::new(),
            guard,
            solver: ActiveSet::default(),
            frames: ChainFrames::default(),
            courses: Vec::new(),
            elapsed: 0.0,
            share: 1.0,
            q: Vec::new(),
            poses: Vec::new(),
            bounds: Vec::new(),
        };
        out.reset(q, None, None)?;
        Ok(out)
    }

    /// Sets the state of the arm, by default at rest. Joints that do not move the hand keep the values of `q`.
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
        let close = world.close(&self.scene, model.map().rest(), margin + TOUCH);
        if let Some((group, other, distance)) = close.iter().find(|c| c.2 < -CONTACT) {
            let [one, two] = world.named(&self.scene, *group, *other);
            let message = format!(
                "{one} and {two} overlap by {:.1} mm; start from a configuration without collisions",
                -1e3 * distance
            );
            return Err(ProblemError::new("q", message));
        }
        let mut needs = world.needs_beside(robot, &close, margin, margin);
        world.leave_out_still(&mut needs, |joint| model.map().moves(joint));
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
        let mut guard = Guard::new(&self.scene, needs);
        if !guard.proves(&self.scene, &model, &courses) {
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
        let dt = self.options.dt;
        let mut x = [0.0; MAX_JOINTS];
        let states: Vec<State> = self.courses.iter().map(|course| course.at(self.elapsed)).collect();
        states.iter().zip(&mut x).for_each(|(state, value)| *value = state[0]);
        self.model.forward_along(&self.chain, &x, &mut self.q, &mut self.frames);
        let pairs = self.pairs(&states);
        let ranges: Vec<Settled> =
            self.joints.iter().zip(&states).map(|(joint, state)| joint.range(*state, dt)).collect();
        let setting = Setting {
            model: &self.model,
            chain: &self.chain,
            frames: &self.frames,
            limits: &self.joints,
            x: &x,
            posture: &self.posture,
            share: self.share,
        };
        let cost = setting.cost(&aim);
        let distance = pairs.iter().map(|pair| pair.distance).fold(f64::INFINITY, f64::min);
        let solved = self.solve(&cost, &ranges, &pairs);
        let mut limited_by = Vec::new();
        let mut status = ServoStatus::Braking;
        if let Some((settled, multipliers)) = solved {
            let courses: Vec<Course> =
                (0..self.joints.len()).map(|v| self.joints[v].toward(states[v], &ranges[v], settled[v], dt)).collect();
            if self.guard.proves(&self.scene, &self.model, &courses) {
                (self.courses, self.elapsed) = (courses, 0.0);
                limited_by = self.active(&ranges, &pairs, &multipliers);
                status = if limited_by.is_empty() { ServoStatus::Tracking } else { ServoStatus::Limited };
            } else if let Some((group, other)) = self.guard.blocked {
                limited_by.push(self.apart(group, other));
            }
        } else if let Some(pair) = pairs.first() {
            limited_by.push(self.apart(pair.group, pair.other));
        }
        self.share = match status {
            ServoStatus::Braking => (SLOWER * self.share).max(SLOWEST),
            ServoStatus::Tracking | ServoStatus::Limited => (FASTER * self.share).min(1.0),
        };
        self.elapsed += dt;
        Ok(self.state(status, limited_by, distance))
    }

    /// Returns the state of the arm.
    fn state(&self, status: ServoStatus, limited_by: Vec<ServoLimit>, distance: f64) -> ServoStep {
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

    /// Measures the pairs near each other, closest first, with the largest speeds at which they may approach.
    fn pairs(&mut self, states: &[State]) -> Vec<Pair> {
        let world = self.scene.compiled();
        let mut out: Vec<Pair> = Vec::with_capacity(self.guard.near.len());
        if self.guard.near.is_empty() {
            return out;
        }
        Compiled::poses(&self.scene, &self.q, &mut self.poses);
        for &(group, other) in &self.guard.near {
            let need = self.guard.need(&self.scene, group, other);
            let Some(contact) = world.screen.contact(group, other, &self.poses, need + INFLUENCE) else { continue };
            let gradient = self.gradient(world, group, other, &contact);
            let room = contact.distance - need - BUFFER.min(0.5 * need.max(2.0 * TOUCH));
            // Deceleration of the approach if every joint brakes with a part of its limit.
            let braking: f64 =
                self.joints.iter().zip(&gradient).map(|(joint, g)| BRAKING * joint.acceleration * g.abs()).sum();
            let speed = approach(room, braking, DAMPER);
            out.push(Pair { group, other, distance: contact.distance, gradient, speed });
        }
        let nearest = |pair: &Pair| {
            // Pairs count as nearer the faster they approach.
            let approach: f64 = states.iter().zip(&pair.gradient).map(|(state, g)| -g * state[1]).sum();
            pair.speed - approach
        };
        out.sort_by(|a, b| nearest(a).total_cmp(&nearest(b)));
        out.truncate(PAIRS);
        out
    }

    /// Returns the gradient of the distance of two bodies by the variables.
    fn gradient(&self, world: &Compiled, group: usize, other: Other, contact: &Contact) -> Row {
        let mut out = [0.0; MAX_JOINTS];
        let mut add = |group: usize, point: &nalgebra::Point3<f64>, direction: nalgebra::Vector3<f64>| {
            for (joint, link) in &world.carriers[group] {
                let Some(driven) = self.model.map().driven().iter().find(|d| d.joint == *joint) else { continue };
                let (frame, joint) = (&self.poses[*link], &self.scene.robot().joints()[*joint]);
                let axis = frame.rotation * joint.axis();
                let velocity = match joint.kind() {
                    JointKind::Prismatic => axis,
                    JointKind::Revolute => axis.cross(&(point.coords - frame.translation.vector)),
                };
                out[driven.variable] += driven.factor * direction.dot(&velocity);
            }
        };
        // The normal points from the first body to the second: moving the first body along it reduces the distance.
        add(group, &contact.on_first, -contact.normal);
        if let Other::Pair(pair) = other {
            add(world.screen.pairs()[pair].1, &contact.on_second, contact.normal);
        }
        out
    }

    /// Solves the quadratic program of a step. Returns the velocities to which the variables settle, and the multiplier
    /// of each bound; `None` if no step meets the bounds.
    fn solve(&mut self, cost: &task::Cost, ranges: &[Settled], pairs: &[Pair]) -> Option<(Row, Vec<f64>)> {
        let n = ranges.len();
        // A pair within its buffer moves apart, unless this contradicts the limits of the joints.
        for parting in [true, false] {
            self.bounds.clear();
            for (v, range) in ranges.iter().enumerate() {
                let mut row = [0.0; MAX_JOINTS];
                row[v] = 1.0;
                self.bounds.push(Bound { row, low: range.low, high: range.high });
            }
            for pair in pairs {
                let speed = if parting { pair.speed } else { pair.speed.max(0.0) };
                self.bounds.push(Bound { row: pair.gradient, low: -speed, high: f64::INFINITY });
            }
            let qp = Qp { n, hessian: &cost.hessian, gradient: &cost.gradient, bounds: &self.bounds };
            if let QpOutcome::Solved { step, multipliers } = self.solver.solve(&qp) {
                return Some((step, multipliers));
            }
            if pairs.iter().all(|pair| pair.speed >= 0.0) {
                break;
            }
        }
        None
    }

    /// Returns the limits that determine a step.
    fn active(&self, ranges: &[Settled], pairs: &[Pair], multipliers: &[f64]) -> Vec<ServoLimit> {
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

impl ServoOptions {
    /// Returns the limits as [`Options`] of a keypoint problem.
    fn asked(&self) -> Options {
        Options {
            velocity_scale: self.velocity_scale,
            acceleration_scale: self.acceleration_scale,
            limits: self.limits,
            velocity_limits: self.velocity_limits.clone(),
            acceleration_limits: self.acceleration_limits.clone(),
            jerk_limits: self.jerk_limits.clone(),
            ..Options::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use gensim2_geometry::{Convex, Draws, Joint, Link, Robot};
    use nalgebra::Vector3;

    use super::*;
    use crate::{Body, Role};

    /// An arm with a revolute, a sliding and two further revolute joints, next to a box and a ball.
    fn scene() -> Scene {
        let cylinder =
            |length: f64| Convex::cylinder(0.03, length, &Pose::translation(0.0, 0.0, 0.5 * length)).unwrap();
        let turn = |name: &str, axis| Joint::revolute(name, axis).limits(-2.5, 2.5).velocity(2.0);
        let slide = Joint::prismatic("slide", Vector3::z()).limits(-0.05, 0.2).velocity(1.0);
        let robot = Robot::builder("arm")
            .link(Link::base("base").shape(Convex::cuboid([0.1, 0.1, 0.02], &Pose::identity()).unwrap()))
            .link(Link::below("base", "lower").at(Pose::translation(0.0, 0.0, 0.1)).moved_by(turn("a", Vector3::y())))
            .link(Link::below("lower", "upper").moved_by(slide).shape(cylinder(0.3)))
            .link(
                Link::below("upper", "fore")
                    .at(Pose::translation(0.0, 0.0, 0.4))
                    .moved_by(turn("b", Vector3::x()))
                    .shape(cylinder(0.25)),
            )
            .link(
                Link::below("fore", "hand")
                    .at(Pose::translation(0.02, 0.0, 0.3))
                    .moved_by(turn("c", Vector3::new(0.0, 0.6, 0.8)))
                    .shape(cylinder(0.1)),
            )
            .build("hand")
            .unwrap();
        let wall = Convex::cuboid([0.2, 0.03, 0.3], &Pose::identity()).unwrap();
        let ball = Convex::ball(0.06, nalgebra::Point3::origin()).unwrap();
        let bodies = [(wall, "wall", [0.1, 0.4, 0.5]), (ball, "ball", [0.35, -0.1, 0.75])];
        let bodies = bodies.map(|(shape, name, [x, y, z])| {
            Body::builder(name, Role::Rigid).shape(shape).pose(Pose::translation(x, y, z)).build().unwrap()
        });
        Scene::new(Arc::new(robot), bodies.to_vec(), Vec::new()).unwrap()
    }

    fn servo(scene: &Scene) -> Servo {
        let mut options = ServoOptions::default();
        (options.acceleration_limits, options.jerk_limits) = (Some(vec![8.0; 4]), Some(vec![600.0; 4]));
        Servo::new(scene, &[0.0; 4], &options).unwrap()
    }

    #[test]
    fn gradients_are_those_of_the_distances() {
        let scene = scene();
        let (world, mut servo, mut draws) = (scene.compiled(), servo(&scene), Draws::of(3, 1));
        let (mut compared, step) = (0, 1e-6);
        let others: Vec<(usize, Other)> = (0..world.screen.groups())
            .flat_map(|group| (0..2).map(move |e| (group, Other::Element(e))))
            .chain((0..world.screen.pairs().len()).map(|pair| (world.screen.pairs()[pair].0, Other::Pair(pair))))
            .collect();
        for _ in 0..60 {
            let q: Vec<f64> = [2.0, 0.2, 2.0, 2.0].iter().map(|range| range * (draws.unit() - 0.5)).collect();
            let mut poses = Vec::new();
            Compiled::poses(&scene, &q, &mut servo.poses);
            for &(group, other) in &others {
                let Some(contact) = world.screen.contact(group, other, &servo.poses, 1.0) else { continue };
                if contact.distance < 1e-3 {
                    continue;
                }
                assert!((contact.distance - world.screen.distance(group, other, &servo.poses, 1.0)).abs() < 1e-12);
                let gradient = servo.gradient(world, group, other, &contact);
                for v in 0..4 {
                    let ends = [-step, step].map(|shift| {
                        let mut moved = q.clone();
                        moved[v] += shift;
                        Compiled::poses(&scene, &moved, &mut poses);
                        world.screen.distance(group, other, &poses, 2.0)
                    });
                    let slope = (ends[1] - ends[0]) / (2.0 * step);
                    // Where the closest feature changes, the distance has a kink.
                    let bent = (ends[0] + ends[1] - 2.0 * contact.distance).abs() > 1e-9;
                    assert!(bent || (slope - gradient[v]).abs() < 2e-4, "{other:?} {v}: {slope} {}", gradient[v]);
                    compared += usize::from(!bent);
                }
            }
        }
        assert!(compared > 1000, "{compared}");
    }

    #[test]
    fn the_jacobian_is_that_of_the_pose() {
        let scene = scene();
        let (mut servo, step) = (servo(&scene), 1e-6);
        let x: Row = std::array::from_fn(|v| if v < 4 { 0.3 - 0.1 * v as f64 } else { 0.0 });
        servo.model.forward_along(&servo.chain, &x, &mut servo.q, &mut servo.frames);
        let columns = servo.model.twists(&servo.chain, &servo.frames);
        for v in 0..4 {
            let [before, after] = [-step, step].map(|shift| {
                let mut moved = x;
                moved[v] += shift;
                servo.model.forward_along(&servo.chain, &moved, &mut servo.q, &mut servo.frames);
                servo.frames.tip
            });
            let shift = (after.translation.vector - before.translation.vector) / (2.0 * step);
            let turn = gensim2_geometry::rotation_log(&(after.rotation * before.rotation.inverse())) / (2.0 * step);
            let found = Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z);
            assert!((found - columns[v]).amax() < 1e-7, "{v}: {found} {}", columns[v]);
        }
    }

    #[test]
    fn no_target_leads_into_an_obstacle_or_beyond_a_limit() {
        let scene = scene();
        let (mut servo, mut checker, mut draws) = (servo(&scene), scene.checker(), Draws::of(5, 2));
        let mut past: Vec<Vec<f64>> = vec![vec![0.0; 4]; 4];
        let (mut braked, mut nearest) = (0, f64::INFINITY);
        let most = [[2.0, 8.0, 600.0], [1.0, 8.0, 600.0], [2.0, 8.0, 600.0], [2.0, 8.0, 600.0]];
        for target in 0..16 {
            let mut spread = |size: f64| std::array::from_fn::<f64, 6, _>(|_| size * (draws.unit() - 0.5));
            // Poses lie inside the wall and the ball in turn.
            let [x, y, z] = [[0.1, 0.4, 0.5], [0.35, -0.1, 0.75]][target / 2 % 2];
            let turn = spread(0.6);
            let pose = Pose::from_parts(
                Vector3::new(x, y, z).into(),
                nalgebra::Rotation3::new(Vector3::new(turn[0], turn[1], turn[2])),
            );
            let aim = match target % 4 {
                0 => Target::Twist(spread(6.0)),
                1 => Target::Joints(spread(8.0)[..4].to_vec()),
                2 if target == 14 => Target::Rest,
                _ => Target::Pose { pose, twist: spread(0.5) },
            };
            for k in 0..400 {
                let step = servo.step(&aim).unwrap();
                braked += usize::from(step.status == ServoStatus::Braking);
                past.remove(0);
                past.push(step.position);
                for (j, [velocity, acceleration, jerk]) in most.iter().enumerate() {
                    let [a, b, c, d] = [0, 1, 2, 3].map(|i| past[i][j]);
                    assert!((d - c).abs() <= velocity * 1e-3 * (1.0 + 1e-6), "velocity of joint {j}");
                    assert!((d - 2.0 * c + b).abs() <= acceleration * 1e-6 * (1.0 + 1e-6), "acceleration of joint {j}");
                    assert!((d - 3.0 * c + 3.0 * b - a).abs() <= jerk * 1e-9 * (1.0 + 1e-6) + 1e-14, "jerk of {j}");
                    let (lower, upper) = if j == 1 { (-0.05, 0.2) } else { (-2.5, 2.5) };
                    assert!(d >= lower - 1e-8 && d <= upper + 1e-8, "range of joint {j}");
                }
                if k % 5 == 0 {
                    nearest = checker.distance(&past[3], 1.0).unwrap().min(nearest);
                    assert!(nearest >= 0.005 - 1e-9, "{nearest}");
                }
            }
        }
        // The arm comes close to obstacles, and is moving most of the time.
        assert!(nearest < 0.012 && braked < 1500, "{nearest} {braked}");
    }
}

//! Options of a problem beside the config.

use std::ops::RangeInclusive;

use gensim2_geometry::Robot;
use serde::{Deserialize, Serialize};

use crate::ProblemError;
use crate::default_limits::{check_limit_set, greatest_velocity};
use crate::model::Model;

/// Slowest, gentlest limits (per second, and its powers): motions under them still have a length one can store.
const GENTLEST: f64 = 1e-3;
/// Fastest joint that a motion may start with (rad/s or m/s).
const FASTEST: f64 = 100.0;
/// Greatest acceleration that a motion may start with (rad/s^2 or m/s^2).
const HARDEST: f64 = 1e4;

/// Timing of keyframes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Timing {
    /// As fast as velocity, acceleration and jerk limits allow.
    Limits,
    /// On the config's clock.
    Config,
}

/// Acceleration and jerk limits of an arm, of which its URDF says nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum LimitSet {
    /// As Franka publishes them for the Panda: 7.5 to 20 rad/s^2, 3,750 to 10,000 rad/s^3.
    Panda,
    /// As Franka publishes them for the Research 3: 10 rad/s^2, 5,000 rad/s^3, and velocity limits that fall towards the
    /// ends of the joints' ranges.
    Fr3,
    /// 10 rad/s^2 and 5,000 rad/s^3 (m for sliding joints) every joint.
    Plain,
}

/// Frame of list-type translations after the actuation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Frames {
    /// In the hand frame.
    Object,
    /// In the hand frame turned by the object's yaw about the hand's z axis.
    Original,
}

/// Path by which "rotate" moves the hand between its keyframes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum RotatePath {
    /// On the arc about the object's axis.
    Arc,
    /// On the straight line between the ends.
    Chord,
}

/// Bodies that may overlap for a while.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ContactWindow {
    /// Links of the robot, and bodies that ride on the hand.
    pub links: Vec<String>,
    /// Bodies of the scene.
    pub bodies: Vec<String>,
    /// First keyframe of the window (in time: `start`, ..., `pre_1`, `pre_0`, `actuation`, `post_0`, ...).
    pub from: String,
    /// Last keyframe of the window, or `end`.
    pub to: String,
    /// Depth by which they may overlap (m), 0 to 1; by default as `contact_depth` says.
    #[serde(default)]
    pub depth: Option<f64>,
}

/// Options of a problem. Fields that are not set take the defaults below; unknown fields are refused.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[non_exhaustive]
pub struct Options {
    /// Keyframe times; by default the config's clock where it sets times, else the limits.
    pub timing: Option<Timing>,
    /// Time of the first waypoint (s), on the config's clock, within 1e6.
    pub start_time: f64,
    /// Fraction of the velocity limits, 0.001 to 1.
    pub velocity_scale: f64,
    /// Fraction of the acceleration and jerk limits, 0.001 to 1.
    pub acceleration_scale: f64,
    /// Velocity limits (rad/s or m/s) a full joint, 0.001 to 1e9; by default the URDF's.
    pub velocity_limits: Option<Vec<f64>>,
    /// Acceleration limits (rad/s^2 or m/s^2) a full joint, 0.001 to 1e9; by default the URDF's, else those of `limits`.
    pub acceleration_limits: Option<Vec<f64>>,
    /// Jerk limits (rad/s^3 or m/s^3) a full joint, 0.001 to 1e9; by default the URDF's, else those of `limits`.
    pub jerk_limits: Option<Vec<f64>>,
    /// Torque limits (N m; N for sliding joints) a full joint, 0.001 to 1e9; by default torques are not looked at.
    pub torque_limits: Option<Vec<f64>>,
    /// Acceleration and jerk limits where none are given; by default plain ones, and the plan says that they are assumed.
    pub limits: Option<LimitSet>,
    /// Velocity at the start, a full joint, within 100 rad/s or m/s; by default at rest.
    pub start_velocity: Option<Vec<f64>>,
    /// Acceleration at the start, a full joint, within 1e4 rad/s^2 or m/s^2; by default none.
    pub start_acceleration: Option<Vec<f64>>,
    /// Greatest speed (m/s) of the point that touches, from the actuation on, 0.001 to 1,000; null for what the joints can do.
    pub contact_speed: Option<f64>,
    /// Reading of list-type post-actuation translations.
    pub frames: Frames,
    /// Path of "rotate".
    pub rotate_path: RotatePath,
    /// Weight of each joint's squared way to the actuation pose in its cost, a full joint, 0.001 to 1e6; by default 1.
    pub joint_weights: Option<Vec<f64>>,
    /// Start values of the actuation pose, the present joints included: 1 to 1,000.
    pub num_seeds: usize,
    /// Poses on the constraints, cheapest first, that are moved to their optimum: 1 to 1,000.
    pub num_refinements: usize,
    /// Box of the hand's origin at the actuation pose: lower and upper corner in the base frame (m); null for none.
    pub workspace: Option<[[f64; 3]; 2]>,
    /// Clearance (m) that the whole motion keeps from what it may not touch, 0 to 0.2. Two bodies that are nearer to each
    /// other where a segment begins or ends keep what they have there; the plan says so.
    pub margin: f64,
    /// Clearance (m) that will do where no motion keeps `margin`, 0 to that; by default none will.
    pub least_margin: Option<f64>,
    /// Overlap (m) allowed to things that may touch, 0 to 1; null for no limit. Contact windows may have their own.
    pub contact_depth: Option<f64>,
    /// Depth (m) allowed to arm and held bodies inside of what the object's joint moves where it is a guess how far it
    /// moves, 0 to 0.1.
    pub guess_depth: f64,
    /// Depth (m) allowed to the robot inside of something at the start, 0 to 1: it comes out first. Deeper, nothing is
    /// planned.
    pub start_depth: f64,
    /// Clearance (m) that robot and held bodies keep from what the hand reaches for (the moving link, targets, what it
    /// picks) on the way to the actuation pose and at it, 0 to 0.05. By default hand and fingers may touch it in the
    /// last segment before the actuation pose, and a target always.
    pub reach_clearance: Option<f64>,
    /// Take the longest part of the motion where the whole is out of reach or blocked after the actuation pose.
    pub allow_partial: bool,
    /// Value of the finger joints (those below the hand) during the motion (m or rad), within their limits; mimic joints
    /// among them follow. By default as in `q_start`.
    pub finger_width: Option<f64>,
    /// Most actuation poses that are tried for the whole motion: 1 to 1,000.
    pub candidates: usize,
    /// Further start values that are spent where no pose from `num_seeds` allows the whole motion: at most 100,000.
    pub extra_seeds: usize,
    /// Most poses that are moved out of what they overlap, where that is what stops all others: at most 1,000.
    pub clearings: usize,
    /// Most samples of the free-space planner a candidate: at most 1,000,000.
    pub samples: usize,
    /// Which start values and samples are drawn, 0 to 1,000,000: other ones lead to other motions where there are several.
    pub seed: usize,
    /// Whether collisions decide. Without, they are only reported.
    pub avoid_collisions: bool,
    /// Contact windows in place of the default rules; null for those.
    pub contacts: Option<Vec<ContactWindow>>,
    /// Bodies that the hand picks at the actuation pose: they ride on it from there on.
    pub pick: Vec<String>,
    /// Attached bodies that the hand releases at the actuation pose: they stand there from there on.
    pub release: Vec<String>,
    /// By how much (rad or m) each post-actuation motion moves the object's joint, one entry a motion. By default
    /// motions that follow or trace the joint say so, and others take it along with the contact point.
    pub joint_travel: Option<Vec<f64>>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            timing: None,
            start_time: 0.0,
            velocity_scale: 0.5,
            acceleration_scale: 0.5,
            velocity_limits: None,
            acceleration_limits: None,
            jerk_limits: None,
            torque_limits: None,
            limits: None,
            start_velocity: None,
            start_acceleration: None,
            contact_speed: None,
            frames: Frames::Object,
            rotate_path: RotatePath::Arc,
            joint_weights: None,
            num_seeds: 64,
            num_refinements: 2,
            workspace: None,
            margin: 0.005,
            least_margin: None,
            contact_depth: Some(0.003),
            guess_depth: 0.05,
            start_depth: 0.01,
            reach_clearance: None,
            allow_partial: false,
            finger_width: None,
            candidates: 40,
            extra_seeds: 200,
            clearings: 64,
            samples: 2000,
            seed: 0,
            avoid_collisions: true,
            contacts: None,
            pick: Vec::new(),
            release: Vec::new(),
            joint_travel: None,
        }
    }
}

impl Options {
    /// Checks each option against its range, and the robot's own speeds against the slowest that is planned.
    pub(crate) fn check(&self, robot: &Robot, model: &Model) -> Result<(), ProblemError> {
        let fail = |field: &str, message: String| Err(ProblemError::new(format!("options.{field}"), message));
        let numbers = [
            ("start_time", self.start_time, -1e6..=1e6),
            ("velocity_scale", self.velocity_scale, 1e-3..=1.0),
            ("acceleration_scale", self.acceleration_scale, 1e-3..=1.0),
            ("margin", self.margin, 0.0..=0.2),
            ("guess_depth", self.guess_depth, 0.0..=0.1),
            ("start_depth", self.start_depth, 0.0..=1.0),
        ];
        for (name, value, range) in numbers {
            within(name, value, &range)?;
        }
        let counts = [
            ("num_seeds", self.num_seeds, 1..=1000),
            ("num_refinements", self.num_refinements, 1..=1000),
            ("candidates", self.candidates, 1..=1000),
            ("extra_seeds", self.extra_seeds, 0..=100_000),
            ("clearings", self.clearings, 0..=1000),
            ("samples", self.samples, 0..=1_000_000),
            ("seed", self.seed, 0..=1_000_000),
        ];
        for (name, value, range) in counts {
            within(name, value, &range)?;
        }
        if let Some([low, high]) = self.workspace
            && !(0..3).all(|i| low[i] <= high[i])
        {
            return fail("workspace", format!("lower corner {low:?} must not exceed upper corner {high:?}"));
        }
        let n = robot.joints().len();
        let lists = [
            ("velocity_limits", &self.velocity_limits, GENTLEST..=1e9),
            ("acceleration_limits", &self.acceleration_limits, GENTLEST..=1e9),
            ("jerk_limits", &self.jerk_limits, GENTLEST..=1e9),
            ("torque_limits", &self.torque_limits, GENTLEST..=1e9),
            ("joint_weights", &self.joint_weights, 1e-3..=1e6),
            ("start_velocity", &self.start_velocity, -FASTEST..=FASTEST),
            ("start_acceleration", &self.start_acceleration, -HARDEST..=HARDEST),
        ];
        for (name, list, range) in lists {
            let Some(list) = list else { continue };
            if list.len() != n {
                return fail(name, format!("has {} entries; the robot has {n} joints", list.len()));
            }
            for (j, value) in list.iter().enumerate() {
                within(&format!("{name}[{j}]"), *value, &range)?;
            }
        }
        if let Some(clearance) = self.reach_clearance {
            within("reach_clearance", clearance, &(0.0..=0.05))?;
        }
        if let Some(least) = self.least_margin {
            within("least_margin", least, &(0.0..=self.margin))?;
        }
        if let Some(depth) = self.contact_depth {
            within("contact_depth", depth, &(0.0..=1.0))?;
        }
        for (i, window) in self.contacts.iter().flatten().enumerate() {
            if let Some(depth) = window.depth {
                within(&format!("contacts[{i}].depth"), depth, &(0.0..=1.0))?;
            }
        }
        if let Some(speed) = self.contact_speed {
            within("contact_speed", speed, &(1e-3..=1e3))?;
        }
        if self.torque_limits.is_some() && robot.mass() <= 0.0 {
            let message =
                "needs masses, and the robot has none: give its links <inertial> in the URDF, or leave it out";
            return fail("torque_limits", message.to_owned());
        }
        check_limit_set(model, self)?;
        check_speeds(robot, model, self)
    }
}

/// A joint that all but stands still has no motion that one could wait for, or store; one without a limit would go as fast
/// as its acceleration allows.
fn check_speeds(robot: &Robot, model: &Model, options: &Options) -> Result<(), ProblemError> {
    let mut velocity = options.velocity_limits.as_ref().map_or(model.velocity, |l| model.map().least(|j| l[j]));
    if let Some(most) = greatest_velocity(options) {
        velocity.iter_mut().zip(most).for_each(|(own, most)| *own = own.min(most));
    }
    for (name, own) in [("acceleration", &model.acceleration), ("jerk", &model.jerk)] {
        let odd = |limit: f64| limit.is_finite() && !(GENTLEST..=1e9).contains(&limit);
        if let Some((j, limit)) = model.map().indices().iter().zip(own).find(|(_, limit)| odd(**limit)) {
            let message = format!(
                "joint {} has the {name} limit {limit:e} in the URDF; give {GENTLEST} to 1e9 there or here",
                robot.joints()[*j].name()
            );
            return Err(ProblemError::new(format!("options.{name}_limits"), message));
        }
    }
    let odd = |speed: f64| speed < GENTLEST || speed.is_infinite();
    match model.map().indices().iter().zip(velocity).find(|(_, speed)| odd(*speed)) {
        None => Ok(()),
        Some((j, speed)) => {
            let name = &robot.joints()[*j].name();
            let message = if speed.is_infinite() {
                format!(
                    "joint {name} has no velocity limit (velocity=\"0\" in a URDF says that it is not known); write it in the \
                     joint's <limit>, or give options.velocity_limits"
                )
            } else {
                format!(
                    "let {name} go at {speed:e} per second (those of joints that mimic it included); give at least {GENTLEST}"
                )
            };
            Err(ProblemError::new("options.velocity_limits", message))
        }
    }
}

fn within<T: PartialOrd + std::fmt::Display>(
    name: &str,
    value: T,
    range: &RangeInclusive<T>,
) -> Result<(), ProblemError> {
    if range.contains(&value) {
        return Ok(());
    }
    let message = format!("must be {} to {}, not {value}", range.start(), range.end());
    Err(ProblemError::new(format!("options.{name}"), message))
}

//! Options of a problem in addition to the config.

use std::ops::RangeInclusive;

use gensim2_geometry::Robot;
use serde::{Deserialize, Serialize};

use crate::ProblemError;
use crate::default_limits::{check_limit_set, greatest_velocity};
use crate::model::Model;

/// Minimum joint limit (per second, or its powers); with lower limits, motions would be too long to be stored.
const GENTLEST: f64 = 1e-3;
/// Maximum joint velocity at the start of a motion (rad/s or m/s).
const FASTEST: f64 = 100.0;
/// Maximum joint acceleration at the start of a motion (rad/s^2 or m/s^2).
const HARDEST: f64 = 1e4;

/// Source of the times of keyframes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Timing {
    /// The motion is as fast as the velocity, acceleration and jerk limits allow.
    Limits,
    /// The motion reaches keyframes at the times given in the config.
    Config,
}

/// Acceleration and jerk limits for arms whose URDF has none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum LimitSet {
    /// Limits that Franka publishes for the Panda: 7.5 to 20 rad/s^2 and 3,750 to 10,000 rad/s^3.
    Panda,
    /// Limits that Franka publishes for the Research 3: 10 rad/s^2, 5,000 rad/s^3, and velocity limits that decrease
    /// towards the ends of the joints' ranges.
    Fr3,
    /// The same acceleration and jerk limits for every joint: 10 rad/s^2 and 5,000 rad/s^3, or m/s^2 and m/s^3.
    Plain,
}

/// Frame of post-actuation translations that the config writes as lists, such as `["translate_z", 0.1]`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Frames {
    /// Translations are in the hand frame.
    Object,
    /// Translations are in the hand frame, rotated about its z axis by the object's yaw, as in the original GenSim2.
    Original,
}

/// Path of the hand in the motion "rotate".
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum RotatePath {
    /// The hand moves on the arc about the object's axis.
    Arc,
    /// The hand moves on the straight line between the ends of the arc.
    Chord,
}

/// A permission for links and bodies to overlap between two keyframes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ContactWindow {
    /// Names of robot links and attached bodies.
    pub links: Vec<String>,
    /// Names of bodies in the scene.
    pub bodies: Vec<String>,
    /// First keyframe of the window: one of `start`, ..., `pre_1`, `pre_0`, `actuation`, `post_0`, ..., in time order.
    pub from: String,
    /// Last keyframe of the window, or `end`.
    pub to: String,
    /// Maximum overlap (m), 0 to 1; by default that of the option `contact_depth`.
    #[serde(default)]
    pub depth: Option<f64>,
}

/// Options of a problem. Omitted fields have the defaults given below; unknown fields are errors.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[non_exhaustive]
pub struct Options {
    /// Source of the keyframe times; default: the config if it sets any time, otherwise the joint limits.
    pub timing: Option<Timing>,
    /// Time (s) at which the motion starts on the config's clock, from -1e6 to 1e6.
    pub start_time: f64,
    /// Fraction of the velocity limits that the motion may use, 0.001 to 1.
    pub velocity_scale: f64,
    /// Fraction of the acceleration and jerk limits that the motion may use, 0.001 to 1.
    pub acceleration_scale: f64,
    /// Velocity limit (rad/s or m/s) of each joint, 0.001 to 1e9; default: the URDF's.
    pub velocity_limits: Option<Vec<f64>>,
    /// Acceleration limit (rad/s^2 or m/s^2) of each joint, 0.001 to 1e9; default: the URDF's, otherwise that of the
    /// option `limits`.
    pub acceleration_limits: Option<Vec<f64>>,
    /// Jerk limit (rad/s^3 or m/s^3) of each joint, 0.001 to 1e9; default: the URDF's, otherwise that of `limits`.
    pub jerk_limits: Option<Vec<f64>>,
    /// Torque limit (N m; N for sliding joints) of each joint, 0.001 to 1e9; default: torques are not limited.
    pub torque_limits: Option<Vec<f64>>,
    /// Acceleration and jerk limits where URDF and options give none; default: `Plain`, with a note in the plan.
    pub limits: Option<LimitSet>,
    /// Velocity of each joint at the start, at most 100 rad/s or m/s; default: zero.
    pub start_velocity: Option<Vec<f64>>,
    /// Acceleration of each joint at the start, at most 1e4 rad/s^2 or m/s^2; default: zero.
    pub start_acceleration: Option<Vec<f64>>,
    /// Maximum speed (m/s) of the tool's contact point from the actuation on, 0.001 to 1,000; null for no limit.
    pub contact_speed: Option<f64>,
    /// Frame of post-actuation translations that the config writes as lists.
    pub frames: Frames,
    /// Path of the hand in the motion "rotate".
    pub rotate_path: RotatePath,
    /// Weight of each joint's squared step from the start in the cost of the actuation pose, 0.001 to 1e6; default: 1.
    pub joint_weights: Option<Vec<f64>>,
    /// Number of start values in the search for the actuation pose, including the current joints: 1 to 1,000.
    pub num_seeds: usize,
    /// Number of poses that meet the constraints and whose cost is then minimized, cheapest first: 1 to 1,000.
    pub num_refinements: usize,
    /// Box for the hand's origin at the actuation pose: lower and upper corner in the base frame (m); null for no box.
    pub workspace: Option<[[f64; 3]; 2]>,
    /// Clearance (m), 0 to 0.2, of robot and attached bodies from bodies that they may not touch. A pair that is closer
    /// at the start or end of a segment keeps at least that distance on the segment; the plan reports such pairs.
    pub margin: f64,
    /// Smaller clearance (m), 0 to `margin`, for a second attempt if no motion keeps `margin`; default: no second
    /// attempt.
    pub least_margin: Option<f64>,
    /// Maximum overlap (m) of pairs that may touch, 0 to 1; null for no limit. A contact window may set another limit.
    pub contact_depth: Option<f64>,
    /// Maximum overlap (m), 0 to 0.1, of arm or attached bodies with the moving link if its travel is estimated.
    pub guess_depth: f64,
    /// Maximum overlap (m) of the robot with a body at the start, 0 to 1. The motion first leaves the overlap. Planning
    /// fails if an overlap is deeper.
    pub start_depth: f64,
    /// Clearance (m), 0 to 0.05, that robot and attached bodies keep from the handled bodies (moving link, targets,
    /// picked bodies) until the actuation pose. By default, hand and fingers may touch these bodies in the last segment
    /// before the actuation pose, and may always touch targets.
    pub reach_clearance: Option<f64>,
    /// Whether to return the longest part of the motion if a part after the actuation pose is unreachable or blocked.
    pub allow_partial: bool,
    /// Value (m or rad) of the finger joints, which are the joints below the hand, during the motion. It must be within
    /// their limits; mimic joints follow. By default, they keep their values in `q_start`.
    pub finger_width: Option<f64>,
    /// Maximum number of actuation poses for which planning the whole motion is attempted: 1 to 1,000.
    pub candidates: usize,
    /// Maximum number of further start values if no pose from the first `num_seeds` allows the motion: at most 100,000.
    pub extra_seeds: usize,
    /// Maximum number of poses that are moved out of an overlap with a body if all other poses fail: at most 1,000.
    pub clearings: usize,
    /// Maximum number of random samples of the path planner for each pose: at most 1,000,000.
    pub samples: usize,
    /// Seed of start values and random samples, 0 to 1,000,000; another seed may give another motion.
    pub seed: usize,
    /// Whether the motion must avoid collisions; otherwise the plan only reports them.
    pub avoid_collisions: bool,
    /// Contact windows that replace the default rules of contact; null for the default rules.
    pub contacts: Option<Vec<ContactWindow>>,
    /// Names of bodies that the hand picks up at the actuation pose; from then on they are attached to the hand.
    pub pick: Vec<String>,
    /// Names of attached bodies that the hand releases at the actuation pose; from then on they stay where they are.
    pub release: Vec<String>,
    /// Travel (rad or m) of the object's joint in each post-actuation motion. By default, a motion that follows or
    /// traces the joint determines the travel, and in other motions the contact point moves the joint.
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
    /// Checks that each option is in its range, and that the URDF's velocity limits are not too low.
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

/// Returns an error for velocity limits that are so low that motions would be too long to be stored, and for missing
/// velocity limits, without which only acceleration limits would bound the speed.
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
                    "joint {name} has no velocity limit (velocity=\"0\" in a URDF means unknown); write it in the \
                     joint's <limit>, or give options.velocity_limits"
                )
            } else {
                format!(
                    "limit {name} to {speed:e} per second (including the limits of joints that mimic it); give at least {GENTLEST}"
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

//! Options of a problem in addition to the config.

use std::ops::RangeInclusive;

use gensim2_geometry::Robot;
use serde::{Deserialize, Serialize};

use crate::ProblemError;
use crate::default_limits::{check_limit_set, greatest_velocity};
use crate::model::Model;

/// Minimum limit (per second, and its powers), so that motions have a duration that can be stored.
const GENTLEST: f64 = 1e-3;
/// Maximum joint velocity at the start of a motion (rad/s or m/s).
const FASTEST: f64 = 100.0;
/// Maximum joint acceleration at the start of a motion (rad/s^2 or m/s^2).
const HARDEST: f64 = 1e4;

/// Timing of keyframes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Timing {
    /// As fast as velocity, acceleration and jerk limits allow.
    Limits,
    /// At the times given in the config.
    Config,
}

/// Acceleration and jerk limits for arms whose URDF lacks them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum LimitSet {
    /// Limits published by Franka for the Panda: 7.5 to 20 rad/s^2, 3,750 to 10,000 rad/s^3.
    Panda,
    /// Limits published by Franka for the Research 3: 10 rad/s^2, 5,000 rad/s^3, and velocity limits that decrease
    /// towards the ends of the joints' ranges.
    Fr3,
    /// The same acceleration and jerk limits for every joint: 10 rad/s^2 and 5,000 rad/s^3, or m/s^2 and m/s^3.
    Plain,
}

/// Frame of translations after the actuation that the config writes as lists, such as `["translate_z", 0.1]`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Frames {
    /// In the hand frame.
    Object,
    /// In the hand frame rotated by the object's yaw about the hand's z axis.
    Original,
}

/// Path of the hand between the keyframes of "rotate".
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum RotatePath {
    /// On the arc about the object's axis.
    Arc,
    /// On the straight line between the ends.
    Chord,
}

/// Bodies that may overlap between two keyframes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ContactWindow {
    /// Links of the robot, and attached bodies.
    pub links: Vec<String>,
    /// Bodies of the scene.
    pub bodies: Vec<String>,
    /// First keyframe of the window: one of `start`, ..., `pre_1`, `pre_0`, `actuation`, `post_0`, ..., in time order.
    pub from: String,
    /// Last keyframe of the window, or `end`.
    pub to: String,
    /// Maximum overlap (m), 0 to 1; default: `contact_depth`.
    #[serde(default)]
    pub depth: Option<f64>,
}

/// Options of a problem. Omitted fields have the defaults below; unknown fields are refused.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[non_exhaustive]
pub struct Options {
    /// Timing of keyframes; default: the config's times if it sets any, otherwise the limits.
    pub timing: Option<Timing>,
    /// Start time of the motion (s) on the config's clock, from -1e6 to 1e6.
    pub start_time: f64,
    /// Fraction of the velocity limits, 0.001 to 1.
    pub velocity_scale: f64,
    /// Fraction of the acceleration and jerk limits, 0.001 to 1.
    pub acceleration_scale: f64,
    /// Velocity limits (rad/s or m/s) for each joint, 0.001 to 1e9; default: the URDF's.
    pub velocity_limits: Option<Vec<f64>>,
    /// Acceleration limits (rad/s^2 or m/s^2) for each joint, 0.001 to 1e9; default: the URDF's, else those of
    /// `limits`.
    pub acceleration_limits: Option<Vec<f64>>,
    /// Jerk limits (rad/s^3 or m/s^3) for each joint, 0.001 to 1e9; default: the URDF's, else those of `limits`.
    pub jerk_limits: Option<Vec<f64>>,
    /// Torque limits (N m; N for sliding joints) for each joint, 0.001 to 1e9; default: torques are not limited.
    pub torque_limits: Option<Vec<f64>>,
    /// Source of missing acceleration and jerk limits; default: `Plain`, which the plan reports as assumed.
    pub limits: Option<LimitSet>,
    /// Velocity of each joint at the start, within 100 rad/s or m/s; default: at rest.
    pub start_velocity: Option<Vec<f64>>,
    /// Acceleration of each joint at the start, within 1e4 rad/s^2 or m/s^2; default: none.
    pub start_acceleration: Option<Vec<f64>>,
    /// Maximum speed (m/s) of the contact point from the actuation on, 0.001 to 1,000; null for no limit.
    pub contact_speed: Option<f64>,
    /// Frame of post-actuation translations that the config writes as lists.
    pub frames: Frames,
    /// Hand path of "rotate".
    pub rotate_path: RotatePath,
    /// Weight of each joint's squared step in the cost of the actuation pose, 0.001 to 1e6; default: 1.
    pub joint_weights: Option<Vec<f64>>,
    /// Number of start values for the actuation pose, including the current joints: 1 to 1,000.
    pub num_seeds: usize,
    /// Number of feasible poses, cheapest first, that are optimized: 1 to 1,000.
    pub num_refinements: usize,
    /// Bounds of the hand's origin at the actuation pose: lower and upper corner in the base frame (m); null for none.
    pub workspace: Option<[[f64; 3]; 2]>,
    /// Clearance (m) of the whole motion from bodies that it may not touch, 0 to 0.2. A pair that is closer at the
    /// start or end of a segment keeps at least this smaller distance along the segment; the plan reports such pairs.
    pub margin: f64,
    /// Smaller clearance (m) for a second attempt if no motion keeps `margin`, 0 to `margin`; default: no second
    /// attempt.
    pub least_margin: Option<f64>,
    /// Maximum overlap (m) of pairs that may touch, 0 to 1; null for no limit. Contact windows may set their own limit.
    pub contact_depth: Option<f64>,
    /// Maximum overlap (m) of arm or attached bodies with the moving link if its travel is estimated, 0 to 0.1.
    pub guess_depth: f64,
    /// Maximum overlap (m) of the robot at the start, 0 to 1; the motion first leaves the overlap. Planning fails if
    /// the overlap is deeper.
    pub start_depth: f64,
    /// Clearance (m) of robot and attached bodies from the handled bodies (moving link, targets, picked bodies) up to
    /// the actuation pose, 0 to 0.05. By default, hand and fingers may touch these bodies in the last segment before
    /// the actuation pose, and targets always.
    pub reach_clearance: Option<f64>,
    /// Whether to accept the longest part of the motion if the rest after the actuation pose is unreachable or blocked.
    pub allow_partial: bool,
    /// Value of the finger joints (joints below the hand) during the motion (m or rad), within their limits; mimic
    /// joints follow. Default: as in `q_start`.
    pub finger_width: Option<f64>,
    /// Maximum number of actuation poses for which planning the whole motion is attempted: 1 to 1,000.
    pub candidates: usize,
    /// Number of additional start values if no pose from `num_seeds` allows the whole motion: at most 100,000.
    pub extra_seeds: usize,
    /// Maximum number of overlapping poses that are moved out of contact if all other poses fail: at most 1,000.
    pub clearings: usize,
    /// Maximum number of samples of the path planner for each pose: at most 1,000,000.
    pub samples: usize,
    /// Seed of start values and samples, 0 to 1,000,000; another seed may give another motion.
    pub seed: usize,
    /// Whether collisions are avoided; otherwise they are only reported.
    pub avoid_collisions: bool,
    /// Contact windows that replace the default rules; null for the defaults.
    pub contacts: Option<Vec<ContactWindow>>,
    /// Bodies that the hand picks at the actuation pose; they are attached to the hand from there on.
    pub pick: Vec<String>,
    /// Attached bodies that the hand releases at the actuation pose; they stay in place from there on.
    pub release: Vec<String>,
    /// Travel of the object's joint (rad or m) in each post-actuation motion. By default, motions that follow or trace
    /// the joint define it, and other motions move the joint with the contact point.
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
    /// Validates each option against its range, and the robot's own velocity limits against the minimum.
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

/// Returns an error for velocity limits so low that motions would take too long to be stored, and for missing velocity
/// limits, without which only the acceleration would limit the speed.
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

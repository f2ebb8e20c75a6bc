//! Grasps of an object for a parallel gripper.
//!
//! The search casts a line along the normal through evenly spread surface points. Two opposite points on a line form a
//! pair if their normals lie within the friction cone. For each pair, the hand is tried at several angles about the
//! line and at several depths. The contacts of its pads and the clearance of the open hand on its approach rank the
//! grasps.

mod clearance;
mod gripper;
mod hold;
mod plan;
mod quality;
mod search;
mod surface;

pub use gripper::{GripperKeypoints, ParallelGripper};
pub use plan::{GraspPlan, GraspTask, Target};
pub use quality::Quality;

use gensim2_geometry::{Convex, Pose};
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use crate::{ProblemError, Role, Scene};

/// Options of a search for grasps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[non_exhaustive]
pub struct GraspOptions {
    /// Maximum number of grasps to return.
    pub count: usize,
    /// Number of surface points from which grasps are derived.
    pub samples: usize,
    /// Whether every part of the body gets the same number of samples regardless of its area; useful for a knob, which
    /// is a small part of a drawer.
    pub per_part: bool,
    /// Maximum number of hand poses whose contacts and approach are checked, the most promising first.
    pub trials: usize,
    /// Friction coefficient between pads and object.
    pub friction: f64,
    /// Length (m) of the straight approach of the open hand along its fingers.
    pub approach: f64,
    /// Minimum distance (m) between the hand and all bodies until the pads touch the object.
    pub clearance: f64,
    /// Direction against gravity, base frame, or `None`. With gravity, grasps from above and close to the centre of
    /// mass rank higher.
    pub up: Option<[f64; 3]>,
    /// Minimum and maximum angle (rad) between the approach direction and straight down; other grasps are not returned.
    /// Ignored without gravity.
    pub tilt: [f64; 2],
}

impl Default for GraspOptions {
    fn default() -> Self {
        Self {
            count: 100,
            samples: 256,
            per_part: false,
            trials: 2000,
            friction: 0.6,
            approach: 0.1,
            clearance: 0.001,
            up: Some([0.0, 0.0, 1.0]),
            tilt: [0.0, std::f64::consts::PI],
        }
    }
}

/// A grasp of an object.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Grasp {
    /// Pose of the hand in the object frame.
    pub object_hand: Pose,
    /// Pose of the hand in the base frame, for the object's current pose.
    pub base_hand: Pose,
    /// Unit direction in which the hand moves towards the object, base frame.
    pub approach: Vector3<f64>,
    /// Distance between the pads in the grasp (m).
    pub width: f64,
    /// Distance between the pads during the approach (m).
    pub opening: f64,
    /// Score from 0 to 1; grasps with a higher score rank first.
    pub score: f64,
    /// Quantities from which the score is computed.
    pub quality: Quality,
}

impl Scene {
    /// Returns grasps of a body, best first, that avoid all other bodies except attached ones; may be empty.
    ///
    /// `center_of_mass` is in the body frame; by default the centroid of the body's volume. The search is
    /// deterministic.
    ///
    /// # Errors
    /// The body does not exist, is attached or has no surface, or an option is out of range.
    pub fn grasps(
        &self,
        body: &str,
        gripper: &ParallelGripper,
        center_of_mass: Option<Point3<f64>>,
        options: &GraspOptions,
    ) -> Result<Vec<Grasp>, ProblemError> {
        options.check()?;
        let object = self.body(body)?;
        if object.role == Role::Attached {
            return Err(ProblemError::new("body", format!("{body:?} is already attached to the hand")));
        }
        let object_base = object.pose.inverse();
        let up = match options.up {
            Some(up) => Some(object_base.rotation * unit("options.up", up)?),
            None => None,
        };
        if center_of_mass.is_some_and(|center| !center.iter().all(|v| v.is_finite())) {
            return Err(ProblemError::new("center_of_mass", "is not finite"));
        }
        let surface = surface::Surface::new(&object.shapes, up.as_ref(), options.per_part)?;
        let stands = self.bodies().iter().filter(|b| b.name != body && b.role != Role::Attached);
        let others: Vec<(&[Convex], Pose)> = stands.map(|b| (&b.shapes[..], object_base * b.pose)).collect();
        let around = clearance::Surroundings::new(&object.shapes, &others);
        let center_of_mass = center_of_mass.unwrap_or(surface.center);
        let physics = quality::Physics { cone: options.friction.atan(), up, center_of_mass };
        let found = search::Search { surface: &surface, around: &around, gripper, options, physics }.run()?;
        Ok(found
            .into_iter()
            .map(|found| {
                let object_hand = found.grip * gripper.grip().inverse();
                Grasp {
                    object_hand,
                    base_hand: object.pose * object_hand,
                    approach: object.pose.rotation * (found.grip.rotation * Vector3::z()),
                    width: found.width,
                    opening: found.opening,
                    score: found.score,
                    quality: found.quality,
                }
            })
            .collect())
    }
}

fn unit(field: &str, v: [f64; 3]) -> Result<Vector3<f64>, ProblemError> {
    let v = Vector3::from(v);
    let direction = v.try_normalize(1e-9).filter(|d| d.iter().all(|c| c.is_finite()));
    direction.ok_or_else(|| ProblemError::new(field, "must be a direction, or null"))
}

impl GraspOptions {
    fn check(&self) -> Result<(), ProblemError> {
        let fail = |field: &str, message: String| Err(ProblemError::new(format!("options.{field}"), message));
        if !(1..=100_000).contains(&self.count) {
            return fail("count", format!("must lie in 1 to 100,000, not {}", self.count));
        }
        if !(1..=100_000).contains(&self.samples) {
            return fail("samples", format!("must lie in 1 to 100,000, not {}", self.samples));
        }
        if !(1..=10_000_000).contains(&self.trials) {
            return fail("trials", format!("must lie in 1 to 10,000,000, not {}", self.trials));
        }
        if !(0.01..=10.0).contains(&self.friction) {
            return fail("friction", format!("must lie in 0.01 to 10, not {}", self.friction));
        }
        if !(0.0..=1.0).contains(&self.approach) {
            return fail("approach", format!("must lie in 0 to 1 m, not {}", self.approach));
        }
        if !(0.0..=clearance::FAR).contains(&self.clearance) {
            return fail("clearance", format!("must lie in 0 to {} m, not {}", clearance::FAR, self.clearance));
        }
        let [least, most] = self.tilt;
        if !(0.0 <= least && least <= most && most <= std::f64::consts::PI) {
            return fail("tilt", format!("must be two angles from 0 to pi, the smaller first, not {:?}", self.tilt));
        }
        Ok(())
    }
}

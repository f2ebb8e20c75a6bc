//! Quality of grasps.

use gensim2_geometry::Pose;
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::hold::Hold;

/// Quantities from which the score of a grasp is computed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Quality {
    /// Angle (rad) between the line of the contacts and the edge of the narrower friction cone.
    pub friction_margin: f64,
    /// Fraction of a pad's area in contact, 0..1; the smaller value of both pads.
    pub contact: f64,
    /// Lever arm (m) of gravity about the midpoint between the pads; without gravity, the distance between the centre
    /// of mass and this midpoint.
    pub lever: f64,
    /// Minimum distance (m) between the open hand on its approach and the object or any other body.
    pub clearance: f64,
    /// Angle (rad) between the approach direction and straight down; 0 without gravity.
    pub tilt: f64,
}

/// Contact fraction beyond which the score no longer increases.
const FULL_CONTACT: f64 = 0.4;
/// Lever arm (m) that halves its term of the score.
const LEVER: f64 = 0.04;
/// Clearance (m) beyond which the score no longer increases.
const ROOMY: f64 = 0.006;
/// Weights of friction margin, contact, lever, clearance and tilt in the score; they add up to 1.
const WEIGHTS: [f64; 5] = [0.25, 0.25, 0.3, 0.1, 0.1];

/// Properties of a grasped object.
pub(super) struct Physics {
    /// Half angle of the friction cone (rad).
    pub cone: f64,
    /// Direction against gravity in the object frame, if any.
    pub up: Option<Vector3<f64>>,
    /// Centre of mass in the object frame (m).
    pub center_of_mass: Point3<f64>,
}

/// Angle between two directions (rad).
pub(super) fn angle(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    a.cross(b).norm().atan2(a.dot(b))
}

impl Quality {
    /// Rates contacts for the grip frame `grip` (object frame), given the clearance of the hand (m); `None` if the
    /// contact line is outside the friction cone.
    pub(super) fn of(hold: &Hold, grip: &Pose, physics: &Physics, clearance: f64) -> Option<Self> {
        let [first, second] = &hold.patches;
        let axis = grip.rotation * Vector3::x();
        let off = [hold.press, axis].map(|line| angle(&-line, &first.normal).max(angle(&line, &second.normal)));
        let friction_margin = physics.cone - off[0].max(off[1]);
        let middle = nalgebra::center(&first.center, &second.center);
        let contact = first.share.min(second.share);
        let (lever, tilt) = physics.lever_and_tilt(&middle, grip);
        (friction_margin > 0.0).then_some(Self { friction_margin, contact, lever, clearance, tilt })
    }

    /// Returns an upper bound of the quality for two contact points whose normals deviate by `off` (rad) from the
    /// closing axis.
    pub(super) fn at_best(middle: &Point3<f64>, grip: &Pose, off: f64, physics: &Physics) -> Self {
        let (lever, tilt) = physics.lever_and_tilt(middle, grip);
        Self { friction_margin: physics.cone - off, contact: 1.0, lever, clearance: ROOMY, tilt }
    }

    /// Returns the score from 0 to 1.
    pub(super) fn score(&self, physics: &Physics) -> f64 {
        let parts = [
            (self.friction_margin / physics.cone).min(1.0),
            (self.contact / FULL_CONTACT).min(1.0),
            1.0 / (1.0 + (self.lever / LEVER).powi(2)),
            (self.clearance / ROOMY).min(1.0),
            0.5 * (1.0 + self.tilt.cos()),
        ];
        parts.iter().zip(WEIGHTS).map(|(part, weight)| part * weight).sum()
    }
}

impl Physics {
    fn lever_and_tilt(&self, middle: &Point3<f64>, grip: &Pose) -> (f64, f64) {
        let arm = self.center_of_mass - middle;
        match &self.up {
            Some(up) => (arm.cross(up).norm(), angle(&-up, &(grip.rotation * Vector3::z()))),
            None => (arm.norm(), 0.0),
        }
    }
}

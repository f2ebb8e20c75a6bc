//! What makes a grasp good.

use gensim2_geometry::Pose;
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::hold::Hold;

/// What a grasp's rank is made of.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Quality {
    /// Angle (rad) by which the line between the touched places stays inside both friction cones.
    pub friction_margin: f64,
    /// Part of the pad that touches, 0..1, on the side where it is less.
    pub contact: f64,
    /// Lever (m) of gravity about the middle between the pads; without gravity the distance of the centre of mass.
    pub lever: f64,
    /// Distance (m) that the open hand keeps on its way, from the object and from everything else.
    pub clearance: f64,
    /// Angle (rad) between the approach and straight down; 0 without gravity.
    pub tilt: f64,
}

/// Contact beyond which more does not count.
const FULL_CONTACT: f64 = 0.4;
/// Lever at which a grasp is half as good (m).
const LEVER: f64 = 0.04;
/// Clearance beyond which more does not count (m).
const ROOMY: f64 = 0.006;
/// Weights of margin, contact, lever, clearance and tilt; they add up to 1.
const WEIGHTS: [f64; 5] = [0.25, 0.25, 0.3, 0.1, 0.1];

impl Quality {
    /// Of a hold in the grip frame `grip` (object frame). `cone` is the half angle of the friction cone (rad), `up` the
    /// direction against gravity in the object frame. `None` where the hold is outside the cone.
    pub(super) fn of(
        hold: &Hold,
        grip: &Pose,
        cone: f64,
        up: Option<&Vector3<f64>>,
        center_of_mass: &Point3<f64>,
        clearance: f64,
    ) -> Option<Self> {
        let [first, second] = &hold.patches;
        let axis = grip.rotation * Vector3::x();
        let across = (second.center - first.center).try_normalize(1e-9)?;
        let off = |from: &Vector3<f64>, to: &Vector3<f64>| from.cross(to).norm().atan2(from.dot(to));
        // The pads press along the closing axis; the force between the touched places runs along their line.
        let worst = [off(&-across, &first.normal), off(&across, &second.normal), off(&-axis, &first.normal)]
            .into_iter()
            .chain([off(&axis, &second.normal)])
            .fold(0.0, f64::max);
        if worst >= cone {
            return None;
        }
        let middle = nalgebra::center(&first.center, &second.center);
        let arm = center_of_mass - middle;
        let lever = up.map_or(arm.norm(), |up| arm.cross(up).norm());
        let tilt = up.map_or(0.0, |up| off(&-up, &(grip.rotation * Vector3::z())));
        Some(Self {
            friction_margin: cone - worst,
            contact: first.share.min(second.share),
            lever,
            clearance,
            tilt,
        })
    }

    /// Rank from 0 to 1.
    pub(super) fn score(&self, cone: f64) -> f64 {
        let parts = [
            (self.friction_margin / cone).min(1.0),
            (self.contact / FULL_CONTACT).min(1.0),
            1.0 / (1.0 + (self.lever / LEVER).powi(2)),
            (self.clearance / ROOMY).min(1.0),
            0.5 * (1.0 + self.tilt.cos()),
        ];
        parts.iter().zip(WEIGHTS).map(|(part, weight)| part * weight).sum()
    }
}

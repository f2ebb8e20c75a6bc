//! From the surface to ranked grasps.

use gensim2_geometry::{Pose, rotation_about};
use nalgebra::{Matrix3, Point3, Rotation3, Translation3, Vector3};

use super::GraspOptions;
use super::clearance::{FAR, HandSweep, Surroundings};
use super::gripper::ParallelGripper;
use super::hold::{Hold, Lines};
use super::quality::Quality;
use super::surface::{ON_SURFACE, Span, Surface};
use crate::ProblemError;

/// Directions about a closing axis from which the hand comes.
const TURNS: usize = 12;
/// Distances from the fingertips at which the pads take the object, as parts of a pad's length.
const DEPTHS: [f64; 5] = [0.06, 0.16, 0.33, 0.5, 0.75];
/// Room on each side of the object that an opening must leave (m).
const ROOM: f64 = 0.006;
/// Openings that are tried beyond the width, widest first, after the full stroke (m).
const OPENINGS: [f64; 3] = [0.04, 0.024, 2.0 * ROOM];
/// Clearance at which no narrower opening is looked for (m).
const COMFORTABLE: f64 = 0.005;
/// Grasps nearer than this to a better one, in place and direction, are the same (m, cosine).
const SAME: (f64, f64) = (0.006, 0.95);
/// Lines nearer than this are one (m, cosine).
const SAME_LINE: (f64, f64) = (0.002, 0.99);

/// Two opposite places of the surface.
struct Pair {
    middle: Point3<f64>,
    axis: Vector3<f64>,
    width: f64,
}

/// A grasp before it is known whether the hand gets there.
struct Proposal {
    grip: Pose,
    hold: Hold,
    score: f64,
}

/// A grasp in the object frame.
pub(super) struct Found {
    pub grip: Pose,
    pub width: f64,
    pub opening: f64,
    pub score: f64,
    pub quality: Quality,
}

pub(super) struct Search<'a> {
    pub surface: &'a Surface,
    pub around: &'a Surroundings,
    pub gripper: &'a ParallelGripper,
    pub options: &'a GraspOptions,
    /// Against gravity, object frame.
    pub up: Option<Vector3<f64>>,
    pub center_of_mass: Point3<f64>,
}

impl Search<'_> {
    /// Distinct grasps that the hand gets to, best first.
    pub fn run(&self) -> Result<Vec<Found>, ProblemError> {
        let mut sweep = HandSweep::new(self.gripper, self.options.approach)?;
        let mut found: Vec<Found> = Vec::new();
        for proposal in self.proposals() {
            // Ranked without clearance, so that what is left can at most be as good as it was.
            if found.len() >= self.options.count {
                break;
            }
            if found.iter().any(|f| same(&f.grip, &proposal.grip)) {
                continue;
            }
            found.extend(self.reached(&mut sweep, &proposal));
        }
        found.sort_by(|a, b| b.score.total_cmp(&a.score));
        Ok(found)
    }

    fn cone(&self) -> f64 {
        self.options.friction.atan()
    }

    /// All holds that lie within the friction cone, best first.
    fn proposals(&self) -> Vec<Proposal> {
        let pad = self.gripper.pad();
        let mut lines = Lines::default();
        let mut out = Vec::new();
        for pair in self.pairs() {
            for approach in self.approaches(&pair.axis) {
                let axes = Matrix3::from_columns(&[pair.axis, approach.cross(&pair.axis), approach]);
                let rotation = Rotation3::from_matrix_unchecked(axes);
                for depth in DEPTHS {
                    let middle = pair.middle + approach * (pad[1] * (2.0 * depth - 1.0));
                    let at = Pose::from_parts(Translation3::from(middle.coords), rotation);
                    let opening = (pair.width + 2.0 * ROOM).min(self.gripper.stroke()[1]);
                    let Some(hold) = lines.hold(self.surface, &at, pad, opening) else { continue };
                    let grip = Translation3::from(pair.axis * hold.offset) * at;
                    let quality = Quality::of(&hold, &grip, self.cone(), self.up.as_ref(), &self.center_of_mass, FAR);
                    let Some(quality) = quality else { continue };
                    out.push(Proposal { grip, hold, score: quality.score(self.cone()) });
                }
            }
        }
        out.sort_by(|a, b| b.score.total_cmp(&a.score));
        out
    }

    /// Opposite places within the friction cone and the stroke.
    fn pairs(&self) -> Vec<Pair> {
        let cosine = self.cone().cos();
        let (mut out, mut spans): (Vec<Pair>, Vec<_>) = (Vec::new(), Vec::new());
        for index in 0..self.options.samples {
            let Some((point, normal)) = self.surface.sample(index) else { continue };
            let level = self.up.and_then(|up| (normal - up * normal.dot(&up)).try_normalize(0.2));
            for outward in [Some(normal), level].into_iter().flatten() {
                let axis = -outward;
                self.surface.spans(&point, &axis, &mut spans);
                let begins = |s: &Span| s.enter.abs() < ON_SURFACE && -s.enter_normal.dot(&axis) >= cosine;
                let Some(first) = spans.iter().position(begins) else { continue };
                for last in &spans[first..] {
                    let width = last.exit - spans[first].enter;
                    if width > self.gripper.stroke()[1] - 2.0 * ROOM.min(0.002) {
                        break;
                    }
                    if width < self.gripper.stroke()[0] || last.exit_normal.dot(&axis) < cosine {
                        continue;
                    }
                    let middle = point + axis * (0.5 * width);
                    let pair = Pair { middle, axis, width };
                    if !out.iter().any(|other| other.is(&pair)) {
                        out.push(pair);
                    }
                }
            }
        }
        out
    }

    /// Directions at right angles to a closing axis, straight down first and without those from below, where there is
    /// a down.
    fn approaches(&self, axis: &Vector3<f64>) -> Vec<Vector3<f64>> {
        let down = self.up.and_then(|up| (axis * up.dot(axis) - up).try_normalize(0.05));
        let side = if axis.x.abs() < 0.8 { Vector3::x() } else { Vector3::y() };
        let first = down.unwrap_or_else(|| axis.cross(&side).normalize());
        let turned = (0..TURNS).map(|k| {
            let angle = std::f64::consts::TAU * k as f64 / TURNS as f64;
            rotation_about(axis, angle) * first
        });
        match self.up {
            Some(up) => turned.filter(|z| z.dot(&up) < 0.3).collect(),
            None => turned.collect(),
        }
    }

    /// The grasp with the widest opening with which the hand gets there comfortably, or else with the most room.
    fn reached(&self, sweep: &mut HandSweep<'_>, proposal: &Proposal) -> Option<Found> {
        let width = proposal.hold.width;
        let full = self.gripper.stroke()[1];
        let mut best: Option<(f64, f64)> = None;
        for opening in std::iter::once(full).chain(OPENINGS.iter().map(|o| width + o).filter(|o| *o < full)) {
            let least = best.map_or(self.options.clearance, |(kept, _)| kept);
            let kept = sweep.clearance(self.around, &proposal.grip, opening, width, least);
            let Some(kept) = kept else { continue };
            if best.is_none_or(|(most, _)| kept > most) {
                best = Some((kept, opening));
            }
            if kept >= COMFORTABLE {
                break;
            }
        }
        let (kept, opening) = best?;
        let (cone, up) = (self.cone(), self.up.as_ref());
        let quality = Quality::of(&proposal.hold, &proposal.grip, cone, up, &self.center_of_mass, kept)?;
        Some(Found { grip: proposal.grip, width, opening, score: quality.score(cone), quality })
    }
}

impl Pair {
    /// Whether both are the same line with the same ends, up to their order.
    fn is(&self, other: &Self) -> bool {
        (self.middle - other.middle).norm_squared() < SAME_LINE.0 * SAME_LINE.0
            && self.axis.dot(&other.axis).abs() > SAME_LINE.1
    }
}

/// Whether two grasps are the same up to a swap of the fingers.
fn same(a: &Pose, b: &Pose) -> bool {
    let (p, q) = (a.rotation.matrix(), b.rotation.matrix());
    (a.translation.vector - b.translation.vector).norm_squared() < SAME.0 * SAME.0
        && p.column(0).dot(&q.column(0)).abs() > SAME.1
        && p.column(2).dot(&q.column(2)) > SAME.1
}

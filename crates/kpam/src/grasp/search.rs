//! Search for grasps: from surface points of the object to ranked grasps.

use gensim2_geometry::{Pose, rotation_about};
use nalgebra::{Matrix3, Point3, Rotation3, Translation3, Vector3};

use super::GraspOptions;
use super::clearance::{FAR, HandSweep, Surroundings};
use super::gripper::ParallelGripper;
use super::hold::Lines;
use super::quality::{Physics, Quality, angle};
use super::surface::{ON_SURFACE, Span, Surface};
use crate::ProblemError;

/// Number of approach directions that are tried around each closing axis.
const TURNS: usize = 12;
/// Depths of the pads beyond the contact points that are tried, as fractions of a pad's length, deepest first.
const DEPTHS: [f64; 4] = [0.75, 0.5, 0.3, 0.15];
/// Minimum depth of the pads beyond the contact points, as a fraction of a pad's length.
const SHALLOWEST: f64 = 0.04;
/// Number of bisections in the search for the maximum depth above an obstacle.
const HALVINGS: usize = 5;
/// Minimum distance between the object and each open pad (m).
const ROOM: f64 = 0.006;
/// Excess of the opening over the object's width (m) in the attempts after the one with the full stroke, widest first.
const OPENINGS: [f64; 4] = [0.04, 0.024, 2.0 * ROOM, ROOM];
/// If an opening gives at least this clearance (m), narrower openings are not tried.
const COMFORTABLE: f64 = 0.005;
/// A grasp counts as the same as a better grasp if the hands are closer than this in position (m) and direction
/// (cosine).
const SAME: (f64, f64) = (0.006, 0.95);
/// Two lines count as the same if they are closer than this in position (m) and direction (cosine).
const SAME_LINE: (f64, f64) = (0.002, 0.99);

/// Two opposite surface points between which the pads can close.
struct Pair {
    middle: Point3<f64>,
    axis: Vector3<f64>,
    width: f64,
    /// Maximum angle (rad) between the line through both points and the surface normals.
    off: f64,
}

/// A candidate grasp: a pose of the hand whose clearance has not been checked yet.
struct Trial {
    grip: Pose,
    /// Distance between the two contact points (m).
    width: f64,
    /// Upper bound of the score of the grasp.
    bound: f64,
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
    pub physics: Physics,
}

impl Search<'_> {
    /// Returns distinct collision-free grasps, best first.
    pub fn run(&self) -> Result<Vec<Found>, ProblemError> {
        let mut sweep = HandSweep::new(self.gripper, self.options.approach)?;
        let mut lines = Lines::default();
        let mut found: Vec<Found> = Vec::new();
        let mut left = self.options.trials;
        for trial in self.trials() {
            if found.len() >= self.options.count || left == 0 {
                break;
            }
            if !found.iter().any(|f| same(&f.grip, &trial.grip)) {
                left -= 1;
                found.extend(self.attempt(&trial, &mut lines, &mut sweep));
            }
        }
        found.sort_by(|a, b| b.score.total_cmp(&a.score));
        Ok(found)
    }

    /// Returns hand poses at all pairs, from all directions and at several depths, most promising first.
    fn trials(&self) -> Vec<Trial> {
        let mut out = Vec::new();
        for pair in self.pairs() {
            for approach in self.approaches(&pair.axis) {
                let axes = Matrix3::from_columns(&[pair.axis, approach.cross(&pair.axis), approach]);
                let rotation = Rotation3::from_matrix_unchecked(axes);
                let at = |depth: f64| {
                    let shift = approach * (self.gripper.pad()[1] * (2.0 * depth - 1.0));
                    Pose::from_parts(Translation3::from(pair.middle.coords + shift), rotation)
                };
                let Some(deepest) = self.deepest(pair.width, at) else { continue };
                let bound = Quality::at_best(&pair.middle, &at(deepest), pair.off, &self.physics).score(&self.physics);
                let first = std::iter::once(deepest);
                for depth in first.chain(DEPTHS.into_iter().filter(|depth| *depth < deepest)) {
                    out.push(Trial { grip: at(depth), width: pair.width, bound });
                }
            }
        }
        out.sort_by(|a, b| b.bound.total_cmp(&a.bound));
        out
    }

    /// Returns the maximum depth at which the tips of the closed pads are not inside another body.
    fn deepest(&self, width: f64, at: impl Fn(f64) -> Pose) -> Option<f64> {
        let [across, along] = self.gripper.pad();
        let free = |depth: f64| {
            let grip = at(depth);
            let tip = |x: f64, y: f64| grip * Point3::new(x * 0.5 * width, y * across, along);
            let corners = [tip(-1.0, -1.0), tip(-1.0, 1.0), tip(1.0, -1.0), tip(1.0, 1.0)];
            !corners.iter().any(|corner| self.around.bury(corner, self.options.clearance))
        };
        let (mut low, mut high) = (SHALLOWEST, DEPTHS[0]);
        if free(high) {
            return Some(high);
        }
        if !free(low) {
            return None;
        }
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if free(middle) { low = middle } else { high = middle }
        }
        Some(low)
    }

    /// Returns the grasp of a hand pose, if the pads touch the object and the approach is collision-free.
    fn attempt(&self, trial: &Trial, lines: &mut Lines, sweep: &mut HandSweep<'_>) -> Option<Found> {
        let pad = self.gripper.pad();
        let opening = (trial.width + 2.0 * ROOM).min(self.gripper.stroke()[1]);
        let hold = lines.hold(self.surface, &trial.grip, pad, opening)?;
        let closing = trial.grip.rotation * Vector3::x();
        let grip = Translation3::from(closing * hold.offset) * trial.grip;
        Quality::of(&hold, &grip, &self.physics, FAR)?;
        let (clearance, opening) = self.room(sweep, &grip, hold.width)?;
        let quality = Quality::of(&hold, &grip, &self.physics, clearance)?;
        Some(Found { grip, width: hold.width, opening, score: quality.score(&self.physics), quality })
    }

    /// Returns pairs of opposite surface points with normals within the friction cone and a distance below the maximum
    /// opening.
    fn pairs(&self) -> Vec<Pair> {
        let cone = self.physics.cone;
        let (mut out, mut spans): (Vec<Pair>, Vec<_>) = (Vec::new(), Vec::new());
        for index in 0..self.options.samples {
            let Some((point, normal)) = self.surface.sample(index) else { continue };
            let level = self.physics.up.and_then(|up| (normal - up * normal.dot(&up)).try_normalize(0.2));
            let halfway = level.and_then(|level| (normal + level).try_normalize(0.2));
            for outward in [Some(normal), level, halfway].into_iter().flatten() {
                let axis = -outward;
                self.surface.spans(&point, &axis, &mut spans);
                let begins = |s: &Span| s.enter.abs() < ON_SURFACE && angle(&s.enter_normal, &outward) < cone;
                let Some(first) = spans.iter().position(begins) else { continue };
                for last in &spans[first..] {
                    let width = last.exit - spans[first].enter;
                    if width > self.gripper.stroke()[1] - 2.0 * ROOM.min(0.002) {
                        break;
                    }
                    let off = angle(&spans[first].enter_normal, &outward).max(angle(&last.exit_normal, &axis));
                    if width < self.gripper.stroke()[0] || off >= cone {
                        continue;
                    }
                    let pair = Pair { middle: point + axis * (0.5 * width), axis, width, off };
                    if !out.iter().any(|other| other.is(&pair)) {
                        out.push(pair);
                    }
                }
            }
        }
        out
    }

    /// Returns directions perpendicular to a closing axis, straight down first if there is gravity, within the allowed
    /// tilt.
    fn approaches(&self, axis: &Vector3<f64>) -> Vec<Vector3<f64>> {
        let down = self.physics.up.and_then(|up| (axis * up.dot(axis) - up).try_normalize(0.05));
        let side = if axis.x.abs() < 0.8 { Vector3::x() } else { Vector3::y() };
        let first = down.unwrap_or_else(|| axis.cross(&side).normalize());
        let turned = (0..TURNS).map(|k| {
            let angle = std::f64::consts::TAU * k as f64 / TURNS as f64;
            rotation_about(axis, angle) * first
        });
        match self.physics.up {
            Some(up) => {
                let [least, most] = self.options.tilt;
                let leans = |z: &Vector3<f64>| (least..=most).contains(&angle(&-up, z));
                turned.filter(|z| z.dot(&up) < 0.3 && leans(z)).collect()
            }
            None => turned.collect(),
        }
    }

    /// Returns the clearance of the hand (m) and the opening (m) that gives this clearance: the widest opening with a
    /// sufficient clearance, otherwise the opening with the largest clearance.
    fn room(&self, sweep: &mut HandSweep<'_>, grip: &Pose, width: f64) -> Option<(f64, f64)> {
        let full = self.gripper.stroke()[1];
        let palm = sweep.palm(self.around, grip, self.options.clearance)?;
        let narrower = OPENINGS.iter().map(|beyond| width + beyond).filter(|opening| *opening < full);
        let mut best: Option<(f64, f64)> = None;
        for opening in std::iter::once(full).chain(narrower) {
            let least = best.map_or(self.options.clearance, |(kept, _)| kept);
            let Some(kept) = sweep.fingers(self.around, grip, opening, width, least) else { continue };
            if best.is_none_or(|(most, _)| kept > most) {
                best = Some((kept, opening));
            }
            if kept >= COMFORTABLE {
                break;
            }
        }
        best.map(|(fingers, opening)| (fingers.min(palm), opening))
    }
}

impl Pair {
    /// Whether two lines coincide and end at the same points, in either order.
    fn is(&self, other: &Self) -> bool {
        (self.middle - other.middle).norm_squared() < SAME_LINE.0 * SAME_LINE.0
            && self.axis.dot(&other.axis).abs() > SAME_LINE.1
    }
}

/// Whether two grasps coincide, possibly with the fingers swapped.
fn same(a: &Pose, b: &Pose) -> bool {
    let (p, q) = (a.rotation.matrix(), b.rotation.matrix());
    (a.translation.vector - b.translation.vector).norm_squared() < SAME.0 * SAME.0
        && p.column(0).dot(&q.column(0)).abs() > SAME.1
        && p.column(2).dot(&q.column(2)) > SAME.1
}

//! Collision checks of configurations and straight edges during a search. Eight configurations at a time are screened
//! in single precision; undecided pairs are measured exactly.

use std::time::Instant;

use gensim2_geometry::{Batch, LANES, Other, Pose, Suspect};

use super::NoMotion;
use super::normals::Normals;
use super::path::Along;
use crate::model::{MAX_JOINTS, Model, Row, between};
use crate::world::{Compiled, Required};
use crate::{Cancel, Scene};

/// Distance (m) between neighbouring checked configurations of an edge; each variable is multiplied by its weight.
const RESOLUTION: f64 = 0.05;
/// Maximum factor by which failed proofs refine the checks of edges.
const FINEST: f64 = 8.0;
/// Factor by which the edges of a final path are checked more densely than those of the search.
const FINER: f64 = 2.0;

/// Value that is subtracted from the number of steps of an edge before it is rounded up, so that a rounding error does not
/// add a step.
const ROUNDING: f64 = 1e-6;
/// Number of most recently hit obstacles that are checked before all others.
const LATEST: usize = 6;

/// If the lower bound of a gap is below this value (m), the bodies usually overlap.
const DEEP: f32 = -0.02;

/// Conditions that end a search early.
#[derive(Debug, Clone, Default)]
pub(crate) struct Ending {
    pub cancel: Option<Cancel>,
    pub deadline: Option<Instant>,
    pub max_checks: Option<u64>,
}

impl Ending {
    /// Returns the reason why planning must end, if it was cancelled or is late.
    pub fn reason(&self) -> Option<NoMotion> {
        if self.cancel.as_ref().is_some_and(Cancel::is_cancelled) {
            return Some(NoMotion::Cancelled);
        }
        self.deadline.is_some_and(|end| Instant::now() >= end).then_some(NoMotion::Late)
    }
}

/// A scene prepared for one search.
pub(crate) struct Field<'s> {
    pub scene: &'s Scene,
    pub world: &'s Compiled,
    pub model: &'s Model,
    /// Required distance of each checked pair.
    pub needs: Required,
    /// Weight of each variable in lengths: mean displacement (m) of the robot's furthest point per unit.
    pub weights: Row,
    pub resolution: f64,
    /// Path constraints.
    pub(super) along: Option<Along>,
    /// Number of configurations checked so far.
    pub checks: u64,
    ending: Ending,
    batch: Batch,
    suspects: Vec<Suspect>,
    /// Most recent collisions as (group, obstacle), the latest first.
    latest: Vec<(usize, Other)>,
    normals: Normals,
    poses: Vec<Pose>,
    q: Vec<f64>,
    rows: [Row; LANES],
}

impl<'s> Field<'s> {
    pub fn new(scene: &'s Scene, model: &'s Model, needs: Required, ending: Ending) -> Self {
        let world = scene.compiled();
        let mut batch = Batch::default();
        (0..LANES).for_each(|lane| batch.set(&world.screen, lane, model.map().rest()));
        Self {
            scene,
            world,
            model,
            needs,
            weights: model.mean_levers(scene.robot()),
            resolution: RESOLUTION,
            along: None,
            checks: 0,
            ending,
            batch,
            suspects: Vec::new(),
            latest: Vec::new(),
            normals: Normals::default(),
            poses: Vec::new(),
            q: Vec::new(),
            rows: [[0.0; MAX_JOINTS]; LANES],
        }
    }

    /// Returns whether the search must end because it was cancelled, is late, or has used up its checks.
    pub fn is_over(&self) -> bool {
        self.ending.max_checks.is_some_and(|most| self.checks >= most) || self.ending.reason().is_some()
    }

    /// Checks edges twice as densely from now on, because the checks have missed an obstacle.
    pub fn refine(&mut self) {
        self.resolution = (0.5 * self.resolution).max(RESOLUTION / FINEST);
    }

    /// Moves a configuration so that it meets the path constraints; returns whether that is possible.
    pub fn pull(&mut self, x: &mut Row) -> bool {
        self.along.as_mut().is_none_or(|along| along.pull(self.model, x))
    }

    /// Returns the length (m) of a straight edge; each variable is multiplied by its weight.
    pub fn length(&self, a: &Row, b: &Row) -> f64 {
        (0..self.model.n()).map(|v| (self.weights[v] * (b[v] - a[v])).powi(2)).sum::<f64>().sqrt()
    }

    /// Returns the index of a configuration in collision among the first `count` rows, if any.
    fn blocked(&mut self, count: usize) -> Option<usize> {
        self.checks += count as u64;
        if let Some(along) = &mut self.along
            && let Some(off) = (0..count).find(|lane| !along.keeps(self.model, &self.rows[*lane]))
        {
            return Some(off);
        }
        let world = self.world;
        for d in self.model.map().driven() {
            // Lanes without a configuration repeat the first one.
            let value = |lane: usize| d.factor * self.rows[if lane < count { lane } else { 0 }][d.variable] + d.offset;
            self.batch.set_joint(&world.screen, d.joint, std::array::from_fn(value));
        }
        world.screen.place(&mut self.batch);
        self.suspects.clear();
        let Self { batch, suspects, latest, normals, poses, q, rows, needs, scene, model, .. } = self;
        // The lane for which the poses were computed last.
        let mut posed = usize::MAX;
        let mut keeps = |s: &Suspect, lane: usize| {
            if posed != lane {
                model.map().positions(&rows[lane], q);
                Compiled::poses(scene, q, poses);
                posed = lane;
            }
            let need = needs.of(&world.screen, s.group, s.other);
            world.screen.keeps(s.group, s.other, poses, need, normals.of(s.group, s.other))
        };
        // Finds a lane in which a pair is certainly too close. A pair that probably overlaps deeply is measured.
        let mut struck = |s: &Suspect| {
            let deepest = (0..count).min_by(|a, b| s.gap[*a].total_cmp(&s.gap[*b])).unwrap_or(0);
            // The upper bound of the gap is valid for pairs that may not overlap.
            let is_apart = needs.of(&world.screen, s.group, s.other) >= 0.0;
            (0..count)
                .find(|lane| is_apart && s.max_gap[*lane] < 0.0)
                .or_else(|| (s.gap[deepest] <= DEEP && !keeps(s, deepest)).then_some(deepest))
        };
        let mut hit = None;
        for k in 0..latest.len() {
            world.screen.look_at(batch, needs.screened(), latest[k], 0.0, |s| {
                hit = struck(s);
                suspects.push(*s);
                true
            });
            if hit.is_some() {
                latest[..=k].rotate_right(1);
                return hit;
            }
        }
        let mut by = None;
        world.screen.survey(batch, needs.screened(), 0.0, |s| {
            hit = struck(s);
            by = Some((s.group, s.other));
            suspects.push(*s);
            hit.is_none()
        });
        if let (Some(by), Some(_)) = (by, hit) {
            remember(latest, by);
        }
        if hit.is_some() || suspects.is_empty() {
            return hit;
        }
        // Pairs with the deepest estimated overlap are measured first, because they are the likeliest collisions.
        let deepest = |s: &Suspect| s.gap[..count].iter().copied().fold(f32::INFINITY, f32::min);
        suspects.sort_by(|a, b| deepest(a).total_cmp(&deepest(b)));
        for s in suspects.iter() {
            for lane in 0..count {
                // A NaN must not count as collision-free.
                if s.gap[lane] >= 0.0 {
                    continue;
                }
                if !keeps(s, lane) {
                    remember(latest, (s.group, s.other));
                    return Some(lane);
                }
            }
        }
        None
    }

    /// Returns the index of a configuration of a curve that is in collision, if any.
    pub fn blocked_at(&mut self, curve: &[Row]) -> Option<usize> {
        let batches = curve.len().div_ceil(LANES);
        for batch in 0..batches {
            let mut count = 0;
            for (row, x) in self.rows.iter_mut().zip(curve.iter().skip(batch).step_by(batches)) {
                *row = *x;
                count += 1;
            }
            if let Some(lane) = self.blocked(count) {
                return Some(batch + lane * batches);
            }
        }
        None
    }

    /// Returns whether the edges of a path are free. They are checked more densely than during the search.
    pub fn is_way_free(&mut self, way: &[Row]) -> bool {
        let usual = self.resolution;
        self.resolution = usual / FINER;
        let stands = way.windows(2).all(|edge| !self.is_over() && self.is_edge_free(&edge[0], &edge[1]));
        self.resolution = usual;
        stands
    }

    /// Returns whether the configurations checked along the straight edge from `a` to `b` are free; `a` is known to be
    /// free. They are spread over the whole edge first, then increasingly dense, and include `b`.
    pub fn is_edge_free(&mut self, a: &Row, b: &Row) -> bool {
        let steps = ((self.length(a, b) / self.resolution - ROUNDING).ceil() as usize).max(1);
        let batches = steps.div_ceil(LANES);
        for batch in 0..batches {
            let mut count = 0;
            // Every batch is spread along the whole edge; the first batch includes the last configuration.
            let mut k = steps - batch;
            loop {
                self.rows[count] = if k < steps { between(a, b, k as f64 / steps as f64) } else { *b };
                count += 1;
                if k <= batches || count == LANES {
                    break;
                }
                k -= batches;
            }
            if self.blocked(count).is_some() {
                return false;
            }
        }
        true
    }
}

/// Moves an obstacle to the front of the list of recently hit obstacles.
fn remember(latest: &mut Vec<(usize, Other)>, by: (usize, Other)) {
    match latest.iter().position(|other| *other == by) {
        Some(k) => latest[..=k].rotate_right(1),
        None => {
            latest.truncate(LATEST - 1);
            latest.insert(0, by);
        }
    }
}

//! Proves that a timed motion keeps its required distances. Between two checked configurations, nothing may move
//! further than the gaps at both allow. If this is not certain, a configuration between them is checked, too.

use gensim2_geometry::{Batch, JointKind, LANES, Pose, Screen, Suspect};

use super::{Approached, Stuck};
use crate::model::{Model, Row};
use crate::world::{Compiled, Required, place_of};
use crate::{Cancel, Scene, Trajectory};

/// Measured gaps are capped at this value (m).
const REACH: f32 = 0.08;
/// Initial distance (m) between checked configurations; joint movements are multiplied by lever arms.
const FIRST: f64 = 0.09;
/// Time between the positions from which the length of the motion is summed (s), and the maximum number of positions.
const STEP: f64 = 0.02;
const MAX_STEPS: f64 = 5e3;
/// Maximum number of checked configurations. A motion that needs more is not proven.
const MAX_LOOKS: usize = 20_000;
/// Pairs whose gap is smaller than this (m) are measured exactly.
const CLOSE: f32 = 0.02;

/// A checked configuration of the motion with its gaps.
pub(super) struct Look {
    pub time: f64,
    pub q: Vec<f64>,
    /// Distance minus required distance (m), for each group to the fixed bodies, and for each pair of groups.
    pub gaps: Vec<f32>,
    /// Whether each gap was measured exactly.
    measured: Vec<bool>,
    suspects: Vec<Suspect>,
    lane: usize,
    /// Whether the motion to the next configuration is proven collision-free.
    sure: bool,
    /// Maximum distance of each group's points from each joint's axis (m), one row for each group.
    pub levers: Vec<f32>,
    /// Corners of a box around each group (m, base frame): coordinates x, y and z of all eight corners.
    pub corners: Vec<[[f32; LANES]; 3]>,
}

/// Proof that one motion is collision-free.
pub(super) struct Sweep<'s> {
    pub scene: &'s Scene,
    pub model: &'s Model,
    pub world: &'s Compiled,
    pub needs: &'s Required,
    /// Mean lever arm of each joint (m), used for the initial spacing.
    pub weights: Row,
    pub checks: u64,
    /// Flag by which the caller ends the proof.
    over: &'s Cancel,
    /// Whether each joint is a sliding joint.
    pub slides: Vec<bool>,
    /// For each gap, the joints that move one of its two bodies relative to the other, each with the group that it moves.
    pub movers: Vec<Vec<(usize, usize)>>,
    /// Indices of the gaps with a required distance.
    active: Vec<usize>,
    batch: Batch,
    poses: Vec<Pose>,
}

impl<'s> Sweep<'s> {
    pub fn new(scene: &'s Scene, model: &'s Model, needs: &'s Required, weights: Row, over: &'s Cancel) -> Self {
        let world = scene.compiled();
        let slides = scene.robot().joints().iter().map(|joint| joint.kind() == JointKind::Prismatic).collect();
        let (screen, screened) = (&world.screen, needs.screened());
        let (groups, bodies) = (screen.groups(), screen.bodies());
        let is_checked = |need: &f64| *need > f64::NEG_INFINITY;
        let beside = (0..groups).filter(|g| screened.bodies[g * bodies..(g + 1) * bodies].iter().any(is_checked));
        let pairs = (0..screen.pairs().len()).filter(|pair| is_checked(&screened.pairs[*pair]));
        let active = beside.chain(pairs.map(|pair| groups + pair)).collect();
        Self {
            scene,
            model,
            world,
            needs,
            weights,
            checks: 0,
            over,
            slides,
            movers: world.movers(),
            active,
            batch: Batch::default(),
            poses: Vec::new(),
        }
    }

    pub(super) fn screen(&self) -> &'s Screen {
        &self.world.screen
    }

    /// Proves that the whole motion keeps its distances.
    ///
    /// # Errors
    /// The first violation found, or that the proof was ended.
    pub fn breach(&mut self, motion: &Trajectory) -> Result<(), Stuck> {
        let (start, end) = (motion.start(), motion.end());
        let mut times = vec![start];
        let steps = ((end - start) / STEP).ceil().clamp(1.0, MAX_STEPS) as usize;
        let (mut last, mut gone) = (motion.moving(start), 0.0);
        for k in 1..=steps {
            if self.over.is_cancelled() {
                return Err(Stuck::Over);
            }
            let t = start + (end - start) * k as f64 / steps as f64;
            let x = motion.moving(t);
            gone += (0..self.model.n()).map(|v| (self.weights[v] * (x[v] - last[v])).powi(2)).sum::<f64>().sqrt();
            last = x;
            if gone > FIRST || k == steps {
                times.push(t);
                gone = 0.0;
            }
        }
        let mut looks = self.look(motion, &times)?;
        loop {
            let mut between = Vec::new();
            for k in 0..looks.len() - 1 {
                let (before, after) = looks.split_at_mut(k + 1);
                if before[k].sure || self.certify(motion, &mut before[k], &mut after[0]) {
                    before[k].sure = true;
                    continue;
                }
                if let Some(breach) = self.touching(&before[k]).or_else(|| self.touching(&after[0])) {
                    return Err(Stuck::Near(breach));
                }
                between.push(0.5 * (before[k].time + after[0].time));
            }
            if between.is_empty() {
                return Ok(());
            }
            if looks.len() > MAX_LOOKS {
                let names = ["motion".to_owned(), "its surroundings".to_owned()];
                return Err(Stuck::Near(Approached { bodies: names, distance: 0.0 }));
            }
            let more = self.look(motion, &between)?;
            // Drop proven intervals; keep only new configurations and their neighbours.
            let mut merged: Vec<Look> = Vec::with_capacity(looks.len() + more.len());
            let mut old = looks.into_iter().peekable();
            for look in more {
                while let Some(before) = old.next_if(|l| l.time < look.time) {
                    merged.push(before);
                }
                merged.push(look);
            }
            merged.extend(old);
            looks = merged;
        }
    }

    /// Checks the configurations of a motion at the given times; returns an error if a pair is certainly too close.
    pub(super) fn look(&mut self, motion: &Trajectory, times: &[f64]) -> Result<Vec<Look>, Stuck> {
        let screen = self.screen();
        let (groups, joints) = (screen.groups(), self.scene.robot().joints().len());
        let count = groups + screen.pairs().len();
        let mut out: Vec<Look> = Vec::with_capacity(times.len());
        for chunk in times.chunks(LANES) {
            if self.over.is_cancelled() {
                return Err(Stuck::Over);
            }
            self.checks += chunk.len() as u64;
            let first = out.len();
            for (lane, time) in chunk.iter().enumerate() {
                let mut q = Vec::with_capacity(joints);
                self.model.map().positions(&motion.moving(*time), &mut q);
                self.batch.set(screen, lane, &q);
                out.push(Look {
                    time: *time,
                    q,
                    gaps: vec![REACH; count],
                    measured: vec![false; count],
                    suspects: Vec::new(),
                    lane,
                    sure: false,
                    levers: vec![0.0; groups * joints],
                    corners: vec![[[0.0; LANES]; 3]; groups],
                });
            }
            for lane in chunk.len()..LANES {
                self.batch.set(screen, lane, &out[first].q);
            }
            screen.place(&mut self.batch);
            let looks = &mut out[first..];
            screen.survey(&mut self.batch, self.needs.screened(), REACH, |s| {
                let place = place_of(s, groups);
                for look in looks.iter_mut() {
                    let gap = s.gap[look.lane];
                    // A NaN must not count as collision-free.
                    if !is_clear(gap, REACH) {
                        look.gaps[place] = if gap < look.gaps[place] { gap } else { look.gaps[place].min(gap) };
                        look.suspects.push(*s);
                    }
                }
                true
            });
            screen.levers(&self.batch, &self.world.carriers, self.scene.robot(), |group, joint, lever| {
                for look in looks.iter_mut() {
                    look.levers[group * joints + joint] = lever[look.lane];
                }
            });
            screen.corners(&self.batch, |group, corner, place| {
                for look in looks.iter_mut() {
                    (0..3).for_each(|k| look.corners[group][k][corner] = place[k][look.lane]);
                }
            });
            for look in looks {
                for k in 0..self.active.len() {
                    let place = self.active[k];
                    if !is_clear(look.gaps[place], 0.0) {
                        self.measure(look, place);
                        if let Some(breach) = self.touching(look) {
                            return Err(Stuck::Near(breach));
                        }
                    }
                }
            }
        }
        Ok(out)
    }

    /// Replaces the lower bounds of a gap by the exact distance.
    fn measure(&mut self, look: &mut Look, place: usize) {
        if look.measured[place] {
            return;
        }
        look.measured[place] = true;
        let screen = self.screen();
        Compiled::poses(self.scene, &look.q, &mut self.poses);
        let mut least = f64::from(REACH);
        for s in look.suspects.iter().filter(|s| place_of(s, screen.groups()) == place) {
            if f64::from(s.gap[look.lane]) >= least {
                continue;
            }
            let need = self.needs.of(screen, s.group, s.other);
            let reach = least.min(f64::from(s.gap[look.lane].max(0.0) + CLOSE)) + need;
            least = least.min(screen.distance(s.group, s.other, &self.poses, reach.max(0.0)) - need);
        }
        // The distance is rounded down.
        look.gaps[place] = (least - 1e-8) as f32;
    }

    /// Returns a pair whose exactly measured distance at a configuration is too small, if any.
    fn touching(&mut self, look: &Look) -> Option<Approached> {
        let screen = self.screen();
        let place = (0..look.gaps.len()).find(|p| look.measured[*p] && look.gaps[*p] < -1e-7)?;
        Compiled::poses(self.scene, &look.q, &mut self.poses);
        let (mut least, mut found) = (f64::INFINITY, None);
        for s in look.suspects.iter().filter(|s| place_of(s, screen.groups()) == place) {
            let need = self.needs.of(screen, s.group, s.other);
            let distance = screen.distance(s.group, s.other, &self.poses, need.max(0.0) + 1e-6);
            if distance - need < least {
                (least, found) = (distance - need, Some((s.group, s.other, distance)));
            }
        }
        let (group, other, distance) = found?;
        Some(Approached { bodies: self.world.named(self.scene, group, other), distance })
    }

    /// Returns whether no pair can be too close between two configurations.
    fn certify(&mut self, motion: &Trajectory, a: &mut Look, b: &mut Look) -> bool {
        let travel = self.travel(motion, a, b);
        let groups = self.screen().groups();
        (0..self.active.len()).all(|k| {
            let place = self.active[k];
            if self.covers(a, b, place, groups, &travel) {
                return true;
            }
            // The lower bounds from spheres may be far too low, so close pairs are measured exactly.
            let mut better = false;
            for look in [&mut *a, &mut *b] {
                if !look.measured[place] && look.gaps[place] < CLOSE {
                    self.measure(look, place);
                    better = true;
                }
            }
            (better && self.covers(a, b, place, groups, &travel)) || self.is_still(a, b, place, &travel.gone)
        })
    }
}

/// Returns whether a gap is at least a limit; false for NaN.
fn is_clear(gap: f32, limit: f32) -> bool {
    gap >= limit
}

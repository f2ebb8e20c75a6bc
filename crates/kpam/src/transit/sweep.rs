//! Proves that a timed motion keeps its required distances. The motion is divided into parts. Spheres in single
//! precision exclude most pairs of bodies in a part; the other pairs are measured exactly, and a part in which a pair is
//! not certainly far enough apart is halved for this pair.

use gensim2_geometry::{Chains, LANES, Motions, Other, Pose, Screen, Travel};

use super::normals::Normals;
use super::{Approached, Stuck};
use crate::model::{Model, Row};
use crate::world::{CONTACT, Compiled, Required, TOUCH};
use crate::{Cancel, Scene, Trajectory};

/// Maximum length (m) of the parts into which a motion is divided at first; joint movements are multiplied by lever
/// arms.
const FIRST: f64 = 0.045;
/// Minimum number of positions from which the length of the motion is summed, the maximum time between them (s), and
/// their maximum number.
const LEAST_STEPS: f64 = 32.0;
const STEP: f64 = 0.1;
const MAX_STEPS: f64 = 5e3;
/// Maximum number of checked configurations. A motion that needs more is not proven.
const MAX_PLACES: usize = 20_000;

/// Number of halvings of a part after which its ends are measured. Most parts are proven before.
const PATIENCE: u32 = 2;

/// Part of the motion between two places, in which one pair is not proven to keep its distance.
#[derive(Clone, Copy)]
struct Open {
    from: usize,
    to: usize,
    group: usize,
    other: Other,
}

/// Configurations of the motion.
#[derive(Default)]
struct Places {
    times: Vec<f64>,
    /// Full joint vectors, one after another.
    q: Vec<f64>,
    /// Poses of the links at the places for which they have been computed, one place after another.
    poses: Vec<Pose>,
    /// Index in `poses` of the first pose of each place; `None` if its poses have not been computed.
    posed: Vec<Option<usize>>,
}

/// Proof that one motion is collision-free.
pub(super) struct Sweep<'s> {
    scene: &'s Scene,
    model: &'s Model,
    world: &'s Compiled,
    needs: &'s Required,
    /// Mean lever arm of each joint (m), used for the initial spacing.
    weights: Row,
    pub checks: u64,
    /// Flag by which the caller ends the proof.
    over: &'s Cancel,
    motions: Motions,
    places: Places,
    travel: Vec<Travel>,
    q: Vec<f64>,
    poses: Vec<Pose>,
    normals: Normals,
}

impl<'s> Sweep<'s> {
    pub fn new(scene: &'s Scene, model: &'s Model, needs: &'s Required, weights: Row, over: &'s Cancel) -> Self {
        let world = scene.compiled();
        let chains = Chains::new(scene.robot(), &world.screen, &world.carriers);
        Self {
            scene,
            model,
            world,
            needs,
            weights,
            checks: 0,
            over,
            motions: Motions::new(chains),
            places: Places::default(),
            travel: vec![Travel::default(); scene.robot().joints().len()],
            q: Vec::new(),
            poses: Vec::new(),
            normals: Normals::default(),
        }
    }

    fn screen(&self) -> &'s Screen {
        &self.world.screen
    }

    /// Proves that the whole motion keeps its distances.
    ///
    /// # Errors
    /// The first violation found, or that the proof was ended.
    pub fn breach(&mut self, motion: &Trajectory) -> Result<(), Stuck> {
        self.divide(motion)?;
        let mut open: Vec<Open> = Vec::new();
        let parts: Vec<[usize; 2]> = (1..self.places.times.len()).map(|k| [k - 1, k]).collect();
        for chunk in parts.chunks(LANES) {
            self.place(motion, chunk)?;
            let screen = self.screen();
            let found = &mut open;
            screen.survey_between(&mut self.motions, self.needs.screened(), |s| {
                for (lane, [from, to]) in chunk.iter().enumerate() {
                    if !is_clear(s.gap[lane]) {
                        found.push(Open { from: *from, to: *to, group: s.group, other: s.other });
                    }
                }
                true
            });
            self.measure(&mut open, chunk, 0)?;
        }
        let mut halves: Vec<[usize; 2]> = Vec::new();
        let mut halvings = 0;
        while !open.is_empty() {
            halvings += 1;
            if self.places.times.len() > MAX_PLACES {
                let names = ["motion".to_owned(), "its surroundings".to_owned()];
                return Err(Stuck::Near(Approached { bodies: names, distance: 0.0 }));
            }
            open.sort_by_key(|o| o.from);
            // Open pairs of the halves, part by part.
            let mut next: Vec<Open> = Vec::new();
            halves.clear();
            for part in open.chunk_by(|a, b| a.from == b.from) {
                let (from, to) = (part[0].from, part[0].to);
                let middle = self.push(motion, 0.5 * (self.places.times[from] + self.places.times[to]));
                for half in [[from, middle], [middle, to]] {
                    halves.push(half);
                    next.extend(part.iter().map(|o| Open { from: half[0], to: half[1], ..*o }));
                }
            }
            open.clear();
            let mut rest = next.as_slice();
            for chunk in halves.chunks(LANES) {
                self.place(motion, chunk)?;
                let lane_of = |o: &Open| chunk.iter().position(|part| *part == [o.from, o.to]);
                let count = rest.iter().take_while(|o| lane_of(o).is_some()).count();
                let (own, others) = rest.split_at(count);
                rest = others;
                let first = open.len();
                for (k, o) in own.iter().enumerate() {
                    let is_same = |other: &&Open| other.group == o.group && other.other == o.other;
                    if own[..k].iter().any(|other| is_same(&other)) {
                        continue;
                    }
                    let (screen, needs) = (self.screen(), self.needs.screened());
                    let found = &mut open;
                    screen.look_between(&mut self.motions, needs, (o.group, o.other), |s| {
                        let same = own[k..].iter().filter(is_same);
                        found.extend(same.filter(|o| lane_of(o).is_none_or(|lane| !is_clear(s.gap[lane]))));
                        true
                    });
                }
                let mut unsure = open.split_off(first);
                self.measure(&mut unsure, chunk, halvings)?;
                open.append(&mut unsure);
            }
        }
        Ok(())
    }

    /// Divides a motion into parts of about equal length.
    fn divide(&mut self, motion: &Trajectory) -> Result<(), Stuck> {
        self.places.times.clear();
        self.places.q.clear();
        self.places.poses.clear();
        self.places.posed.clear();
        let (start, end) = (motion.start(), motion.end());
        let steps = ((end - start) / STEP).ceil().clamp(LEAST_STEPS, MAX_STEPS);
        let mut last = motion.moving(start);
        self.push(motion, start);
        for k in 1..=steps as usize {
            if self.over.is_cancelled() {
                return Err(Stuck::Over);
            }
            let before = start + (end - start) * (k - 1) as f64 / steps;
            let time = start + (end - start) * k as f64 / steps;
            let x = motion.moving(time);
            let gone = (0..self.model.n()).map(|v| (self.weights[v] * (x[v] - last[v])).powi(2)).sum::<f64>().sqrt();
            let parts = (gone / FIRST).ceil().max(1.0);
            for part in 1..parts as usize {
                self.push(motion, before + (time - before) * part as f64 / parts);
            }
            self.push_at(time, &x);
            last = x;
        }
        Ok(())
    }

    /// Adds the configuration at a time; returns its index.
    fn push(&mut self, motion: &Trajectory, time: f64) -> usize {
        self.push_at(time, &motion.moving(time))
    }

    fn push_at(&mut self, time: f64, x: &Row) -> usize {
        self.model.map().positions(x, &mut self.q);
        self.places.q.extend_from_slice(&self.q);
        self.places.times.push(time);
        self.places.posed.push(None);
        self.checks += 1;
        self.places.times.len() - 1
    }

    /// Places the robot in up to eight parts of the motion.
    fn place(&mut self, motion: &Trajectory, parts: &[[usize; 2]]) -> Result<(), Stuck> {
        if self.over.is_cancelled() {
            return Err(Stuck::Over);
        }
        let (screen, joints) = (self.screen(), self.travel.len());
        for lane in 0..LANES {
            // Lanes without a part repeat the first one.
            let ends = parts.get(lane).unwrap_or(&parts[0]);
            let [a, b] = ends.map(|k| &self.places.q[k * joints..(k + 1) * joints]);
            if lane < parts.len() {
                let [from, to] = ends.map(|k| self.places.times[k]);
                let (h, hardest) = (to - from, motion.hardest([from, to]));
                for (travel, (a, b)) in self.travel.iter_mut().zip(a.iter().zip(b)) {
                    let apart = (a - b).abs() as f32;
                    *travel = Travel { apart, gone: apart, off: 0.0 };
                }
                for driven in self.model.map().driven() {
                    let travel = &mut self.travel[driven.joint];
                    let reach = driven.factor.abs() * hardest[driven.variable] * h * h;
                    // A joint that reverses moves no further than its acceleration allows.
                    travel.gone = travel.gone.max((0.5 * reach) as f32);
                    travel.off = (0.125 * reach) as f32;
                }
            }
            self.motions.set(screen, lane, [a, b], &self.travel);
        }
        screen.place_between(&mut self.motions);
        Ok(())
    }

    /// Measures the open pairs of the parts exactly, and keeps those that are still not proven.
    ///
    /// # Errors
    /// A pair is too close at an end of a part.
    fn measure(&mut self, open: &mut Vec<Open>, parts: &[[usize; 2]], halvings: u32) -> Result<(), Stuck> {
        let mut kept = 0;
        for k in 0..open.len() {
            let o = open[k];
            let Some(lane) = parts.iter().position(|part| *part == [o.from, o.to]) else {
                // A pair of an earlier chunk.
                open[kept] = o;
                kept += 1;
                continue;
            };
            let firsts = [self.pose(o.from), self.pose(o.to)];
            let screen = self.screen();
            let need = self.needs.of(screen, o.group, o.other);
            let bend = self.motions.bend(o.group, o.other, lane);
            let links = self.poses.len();
            let ends = firsts.map(|first| &self.places.poses[first..first + links]);
            let normal = self.normals.of(o.group, o.other);
            if screen.keeps_between(o.group, o.other, ends, need + bend, normal) {
                continue;
            }
            for poses in ends.into_iter().filter(|_| halvings >= PATIENCE) {
                if !screen.keeps(o.group, o.other, poses, need - CONTACT, normal) {
                    let distance = screen.distance(o.group, o.other, poses, need.max(0.0) + 1e-6);
                    let bodies = self.world.named(self.scene, o.group, o.other);
                    return Err(Stuck::Near(Approached { bodies, distance }));
                }
            }
            // Both ends are so close to each other that rounding exceeds the movement between them.
            if halvings >= PATIENCE && screen.way_between(o.group, o.other, ends) + 2.0 * bend <= 0.5 * TOUCH {
                continue;
            }
            open[kept] = o;
            kept += 1;
        }
        open.truncate(kept);
        Ok(())
    }

    /// Computes the poses of the links at a place, if necessary; returns the index of the first one.
    fn pose(&mut self, place: usize) -> usize {
        if let Some(first) = self.places.posed[place] {
            return first;
        }
        let joints = self.travel.len();
        Compiled::poses(self.scene, &self.places.q[place * joints..(place + 1) * joints], &mut self.poses);
        let first = self.places.poses.len();
        self.places.poses.extend_from_slice(&self.poses);
        self.places.posed[place] = Some(first);
        first
    }
}

/// Returns whether a gap is not negative; false for NaN.
fn is_clear(gap: f32) -> bool {
    gap >= 0.0
}

//! Proves that a timed motion keeps its required distances. The motion is divided into parts. Spheres in single
//! precision exclude most pairs of bodies in a part; the other pairs are measured exactly, and a part in which a pair is
//! not certainly far enough apart is halved for this pair.

use std::sync::Arc;

use gensim2_geometry::{BodyJoint, JointKind, LANES, Motions, Other, Pose, Screen, Travel};
use nalgebra::Point3;

use super::normals::Normals;
use crate::model::{Model, Row};
use crate::world::{CONTACT, Compiled, Hit, Required, TOUCH, joint_motion};
use crate::{Cancel, ObjectJoint, ObjectJointKind, Scene, Trajectory};

/// Approximate length (m) of the parts into which a motion is divided at first; joint movements are multiplied by lever
/// arms.
const FIRST: f64 = 0.045;
/// Minimum number of positions from which the length of the motion is summed, the maximum time between them (s), and
/// their maximum number.
const LEAST_STEPS: f64 = 32.0;
const STEP: f64 = 0.5;
const MAX_STEPS: f64 = 5e3;
/// Maximum number of checked configurations. A motion that needs more is not proven.
const MAX_PLACES: usize = 20_000;

/// Distance (m) beyond the required distance up to which the points of a violation are measured.
const SEEN: f64 = 0.01;

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

/// Reason why a motion is not proven to keep its distances.
#[derive(Debug)]
pub(crate) enum Breach {
    /// Two bodies are too close to each other.
    Near(Hit),
    /// The proof was ended.
    Over,
}

/// Movement of the object's joint during a motion: its travel (rad or m) at ascending times (s), linear in between.
#[derive(Debug)]
pub(crate) struct Carriage {
    pub joint: ObjectJoint,
    pub times: Vec<f64>,
    pub travel: Vec<f64>,
}

impl Carriage {
    fn at(&self, time: f64) -> f64 {
        let next = self.times.partition_point(|t| *t <= time);
        match (next.checked_sub(1).map(|k| (self.times[k], self.travel[k])), self.times.get(next)) {
            (Some((from, a)), Some(to)) => a + (time - from) / (to - from) * (self.travel[next] - a),
            (Some((_, last)), None) => last,
            (None, _) => self.travel.first().copied().unwrap_or(0.0),
        }
    }

    /// Returns bounds on the joint's movement between two times.
    fn between(&self, [from, to]: [f64; 2]) -> Travel {
        let (a, b) = (self.at(from), self.at(to));
        let (mut gone, mut off) = ((b - a).abs(), 0.0_f64);
        let inside = self.times.partition_point(|t| *t <= from)..self.times.partition_point(|t| *t < to);
        for k in inside {
            let value = self.travel[k];
            gone = gone.max((value - a).abs()).max((value - b).abs());
            off = off.max((value - a - (self.times[k] - from) / (to - from) * (b - a)).abs());
        }
        Travel { apart: (b - a).abs() as f32, gone: gone as f32, off: off as f32 }
    }

    fn body_joint(&self) -> BodyJoint {
        let ObjectJoint { kind, origin, axis, .. } = self.joint;
        let kind = match kind {
            ObjectJointKind::Revolute => JointKind::Revolute,
            ObjectJointKind::Prismatic => JointKind::Prismatic,
        };
        BodyJoint { kind, origin: Point3::from(origin), axis }
    }

    /// Returns the pose of the base relative to the moved bodies.
    fn base(&self, travel: f64) -> Pose {
        joint_motion(&self.joint, travel).inverse()
    }
}

/// Proof that one motion is collision-free.
pub(crate) struct Sweep<'s> {
    scene: &'s Scene,
    model: &'s Model,
    world: &'s Compiled,
    needs: &'s Required,
    /// Movement of the bodies, if the joint of an object moves them. The motion is then considered relative to them.
    carriage: Option<Carriage>,
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
    /// Prepares proofs in a scene; `world` is the scene, prepared for fast checks.
    pub fn new(
        (scene, world): (&'s Scene, &'s Compiled),
        model: &'s Model,
        needs: &'s Required,
        weights: Row,
        over: &'s Cancel,
    ) -> Self {
        Self {
            scene,
            model,
            world,
            needs,
            carriage: None,
            weights,
            checks: 0,
            over,
            motions: Motions::new(Arc::clone(&world.chains)),
            places: Places::default(),
            travel: vec![Travel::default(); scene.robot().joints().len()],
            q: Vec::new(),
            poses: Vec::new(),
            normals: Normals::default(),
        }
    }

    /// Lets the joint of an object move the bodies. Proofs are then about the robot and all bodies that move with it
    /// relative to the moved bodies.
    pub fn beside(self, carriage: Carriage, needs: &'s Required) -> Self {
        let motions = Motions::new(Arc::clone(&self.world.chains)).beside(self.scene.robot(), &carriage.body_joint());
        let travel = vec![Travel::default(); self.scene.robot().joints().len() + 1];
        Self { motions, travel, needs, carriage: Some(carriage), normals: Normals::default(), ..self }
    }

    fn screen(&self) -> &'s Screen {
        &self.world.screen
    }

    /// Proves that a motion keeps its required distances between two times (s).
    ///
    /// # Errors
    /// The first violation found, or that the proof was ended.
    pub fn breach(&mut self, motion: &Trajectory, span: [f64; 2]) -> Result<(), Breach> {
        self.divide(motion, span)?;
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
                let Open { from, group, other, .. } = open[0];
                let first = self.pose(from);
                let hit = self.hit(group, other, first, self.needs.of(self.screen(), group, other), from);
                return Err(Breach::Near(hit));
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

    /// Divides the motion between two times into parts of about equal length.
    fn divide(&mut self, motion: &Trajectory, [start, end]: [f64; 2]) -> Result<(), Breach> {
        self.places.times.clear();
        self.places.q.clear();
        self.places.poses.clear();
        self.places.posed.clear();
        let steps = ((end - start) / STEP).ceil().clamp(LEAST_STEPS, MAX_STEPS);
        let mut last = motion.moving(start);
        self.push_at(start, &last);
        let (mut begin, mut length) = (start, 0.0);
        for k in 1..=steps as usize {
            if self.over.is_cancelled() {
                return Err(Breach::Over);
            }
            let time = start + (end - start) * k as f64 / steps;
            let x = motion.moving(time);
            length += (0..self.model.n()).map(|v| (self.weights[v] * (x[v] - last[v])).powi(2)).sum::<f64>().sqrt();
            last = x;
            if length < FIRST && k < steps as usize {
                continue;
            }
            let parts = (length / FIRST).round().max(1.0);
            for part in 1..parts as usize {
                self.push(motion, begin + (time - begin) * part as f64 / parts);
            }
            self.push_at(time, &x);
            (begin, length) = (time, 0.0);
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
        self.places.q.extend(self.carriage.as_ref().map(|carriage| carriage.at(time)));
        self.places.times.push(time);
        self.places.posed.push(None);
        self.checks += 1;
        self.places.times.len() - 1
    }

    /// Places the robot in up to eight parts of the motion.
    fn place(&mut self, motion: &Trajectory, parts: &[[usize; 2]]) -> Result<(), Breach> {
        if self.over.is_cancelled() {
            return Err(Breach::Over);
        }
        let (screen, joints) = (self.screen(), self.travel.len());
        for lane in 0..LANES {
            // Lanes without a part repeat the first one.
            let ends = parts.get(lane).unwrap_or(&parts[0]);
            let [a, b] = ends.map(|k| &self.places.q[k * joints..(k + 1) * joints]);
            if lane < parts.len() {
                let [from, to] = ends.map(|k| self.places.times[k]);
                let [off, reversed] = motion.deviations([from, to]);
                for (travel, (a, b)) in self.travel.iter_mut().zip(a.iter().zip(b)) {
                    let apart = (a - b).abs() as f32;
                    *travel = Travel { apart, gone: apart, off: 0.0 };
                }
                for driven in self.model.map().driven() {
                    let travel = &mut self.travel[driven.joint];
                    let [off, reversed] = [off, reversed].map(|of| (driven.factor.abs() * of[driven.variable]) as f32);
                    // A joint that reverses moves no further than its acceleration allows.
                    travel.gone = travel.gone.max(reversed.min(travel.gone + off));
                    travel.off = off;
                }
                if let (Some(carriage), Some(last)) = (&self.carriage, self.travel.last_mut()) {
                    *last = carriage.between([from, to]);
                }
            }
            if let Some(carriage) = &self.carriage {
                let [from, to] = [a, b].map(|q| carriage.base(q[joints - 1]));
                self.motions.set_base(lane, [&from, &to]);
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
    fn measure(&mut self, open: &mut Vec<Open>, parts: &[[usize; 2]], halvings: u32) -> Result<(), Breach> {
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
            let is_kept = |poses| halvings < PATIENCE || screen.keeps(o.group, o.other, poses, need - CONTACT, normal);
            if let Some(end) = ends.map(is_kept).iter().position(|kept| !kept) {
                return Err(Breach::Near(self.hit(o.group, o.other, firsts[end], need, [o.from, o.to][end])));
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

    /// Returns two bodies that are too close to each other at a place; `first` is the index of the poses of the links.
    fn hit(&self, group: usize, other: Other, first: usize, need: f64, place: usize) -> Hit {
        let poses = &self.places.poses[first..first + self.poses.len()];
        let [one, two] = self.world.named(self.scene, group, other);
        let contact = self.screen().contact(group, other, poses, need.max(0.0) + SEEN, None);
        let (distance, at) = match contact {
            Some(contact) => (contact.distance, nalgebra::center(&contact.on_first, &contact.on_second)),
            None => (need, Point3::from(poses[self.screen().sphere(group).0].translation.vector)),
        };
        let back = self.carriage.as_ref().map(|c| joint_motion(&c.joint, c.at(self.places.times[place])));
        Hit { first: one, second: two, distance, at: back.map_or(at, |back| back * at) }
    }

    /// Computes the poses of the links at a place, if necessary; returns the index of the first one.
    fn pose(&mut self, place: usize) -> usize {
        if let Some(first) = self.places.posed[place] {
            return first;
        }
        let joints = self.travel.len();
        let q = &self.places.q[place * joints..(place + 1) * joints];
        Compiled::poses(self.scene, &q[..self.scene.robot().joints().len()], &mut self.poses);
        if let Some(carriage) = &self.carriage {
            let base = carriage.base(q[joints - 1]);
            self.poses.iter_mut().for_each(|pose| *pose = base * *pose);
        }
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

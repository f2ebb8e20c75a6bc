//! Proof that the next step and the stop after it keep the required distances.
//!
//! Eight states of the motion are screened at once. Between two neighbouring states nothing may move further than the
//! gaps at both allow (Quinlan's bubbles): a point at distance r from a joint's axis moves at most r + d per radian
//! while it stays within d of its position. Where this is not certain, the time between the two states is divided.

use gensim2_geometry::{Batch, LANES, Needs, Other, Pose, Suspect};

use super::joint::{Course, Reversals};
use crate::Scene;
use crate::model::{MAX_JOINTS, Model};
use crate::world::{Compiled, TOUCH, place_of};

/// Pairs closer than their required distance plus this value (m) bound the approach of the two bodies.
pub(super) const INFLUENCE: f64 = 0.08;
/// Largest gap (m) that the screening distinguishes; larger gaps count as this value.
const REACH: f32 = 0.2;
/// Pairs whose gap is smaller than this (m) are measured exactly.
const CLOSE: f32 = 0.03;
/// Upper bound on the rounding error of an exact distance (m).
const ROUNDING: f64 = 1e-8;
/// Gap (m) that all pairs keep when the arm rests, so that the arm can always be proven to leave.
const REST: f64 = 0.5 * TOUCH;
/// Upper bound on the sum of the fractions of two gaps that a movement uses up.
const SHARES: f32 = 1.999;
/// Maximum number of times that a motion is divided, and maximum number of screened batches.
const DEPTH: usize = 4;
const BATCHES: usize = 10;

/// Checks of the motions of a robot among obstacles, with buffers that are reused.
pub(super) struct Guard {
    needs: Needs,
    /// For each gap, the joints that move one of its two bodies relative to the other, each with the group that it moves.
    movers: Vec<Vec<(usize, usize)>>,
    /// Pairs near each other at the start of the motion that was checked last.
    pub near: Vec<(usize, Other)>,
    /// A pair that was too close in the last motion that was not proven.
    pub blocked: Option<(usize, Other)>,
    batch: Batch,
    batches: usize,
    suspects: Vec<Suspect>,
    /// Whether the gap of each suspect is measured exactly, for each lane.
    measured: Vec<[bool; LANES]>,
    gaps: Vec<[f32; LANES]>,
    /// Maximum distance of each group's points from each joint's axis (m), one row for each group.
    levers: Vec<[f32; LANES]>,
    /// Movement of each joint of the robot from each lane to the next.
    travel: Vec<[f32; LANES]>,
    q: Vec<Vec<f64>>,
    poses: Vec<Vec<Pose>>,
}

/// The motion to prove: the courses of the planned variables.
struct Motion<'m> {
    scene: &'m Scene,
    model: &'m Model,
    courses: &'m [Course],
    reversals: [Reversals; MAX_JOINTS],
    end: f64,
}

impl Guard {
    pub fn new(scene: &Scene, needs: Needs) -> Self {
        let world = scene.compiled();
        let (groups, joints) = (world.screen.groups(), scene.robot().joints().len());
        Self {
            needs,
            movers: world.movers(),
            near: Vec::new(),
            blocked: None,
            batch: Batch::default(),
            batches: 0,
            suspects: Vec::new(),
            measured: Vec::new(),
            gaps: vec![[0.0; LANES]; groups + world.screen.pairs().len()],
            levers: vec![[0.0; LANES]; groups * joints],
            travel: vec![[0.0; LANES]; joints],
            q: vec![Vec::new(); LANES],
            poses: vec![Vec::new(); LANES],
        }
    }

    /// Returns the distance (m) that a group must keep from another body.
    pub fn need(&self, scene: &Scene, group: usize, other: Other) -> f64 {
        scene.compiled().screen.needed(&self.needs, group, other)
    }

    /// Returns whether all pairs keep their required distances until the variables have come to rest.
    pub fn proves(&mut self, scene: &Scene, model: &Model, courses: &[Course]) -> bool {
        let end = courses.iter().map(Course::duration).fold(0.0, f64::max);
        let mut reversals = [Reversals::default(); MAX_JOINTS];
        courses.iter().zip(&mut reversals).for_each(|(course, out)| *out = course.reversals());
        let motion = Motion { scene, model, courses, reversals, end };
        // At an even deceleration, these times divide the way to rest evenly.
        let times = std::array::from_fn(|lane| end * (1.0 - (1.0 - lane as f64 / (LANES - 1) as f64).sqrt()));
        (self.batches, self.blocked) = (0, None);
        self.proves_between(&motion, &times, 0)
    }

    fn proves_between(&mut self, motion: &Motion<'_>, times: &[f64; LANES], depth: usize) -> bool {
        self.batches += 1;
        if self.batches > BATCHES || depth > DEPTH {
            return false;
        }
        self.screen(motion, times, depth);
        let mut open = [false; LANES];
        for place in 0..self.gaps.len() {
            let Some(left) = self.left(motion, place) else { return false };
            open.iter_mut().zip(left).for_each(|(open, left)| *open |= left);
        }
        if depth == 0 && !self.rests(motion) {
            return false;
        }
        open[..LANES - 1].iter().enumerate().filter(|(_, open)| **open).all(|(lane, _)| {
            let (from, to) = (times[lane], times[lane + 1]);
            let between = std::array::from_fn(|k| from + (to - from) * k as f64 / (LANES - 1) as f64);
            self.proves_between(motion, &between, depth + 1)
        })
    }

    /// Places the states at some times, and bounds the gaps of all pairs there.
    fn screen(&mut self, motion: &Motion<'_>, times: &[f64; LANES], depth: usize) {
        let Motion { scene, model, courses, reversals, .. } = motion;
        let world = scene.compiled();
        let (screen, joints) = (&world.screen, scene.robot().joints().len());
        let mut rows = [[0.0; MAX_JOINTS]; LANES];
        for (lane, row) in rows.iter_mut().enumerate() {
            courses.iter().zip(row.iter_mut()).for_each(|(course, value)| *value = course.at(times[lane])[0]);
            model.map().positions(row, &mut self.q[lane]);
            self.batch.set(screen, lane, &self.q[lane]);
            self.poses[lane].clear();
        }
        screen.place(&mut self.batch);
        for driven in model.map().driven() {
            let v = driven.variable;
            for lane in 0..LANES - 1 {
                let ends = [lane, lane + 1].map(|lane| (times[lane], rows[lane][v]));
                self.travel[driven.joint][lane] = (driven.factor.abs() * reversals[v].travel(ends[0], ends[1])) as f32;
            }
        }
        let levers = &mut self.levers;
        screen.levers(&self.batch, &world.carriers, scene.robot(), |group, joint, lever| {
            levers[group * joints + joint] = lever;
        });
        // Gaps are screened as far as movements between the states require.
        let mut reach = if depth == 0 { INFLUENCE as f32 } else { 0.0 };
        for movers in &self.movers {
            for lane in 0..LANES - 1 {
                let (mut way, mut turn) = (0.0, 0.0);
                for (joint, group) in movers {
                    let (lever, travel) = (&self.levers[group * joints + joint], self.travel[*joint][lane]);
                    way += travel * lever[lane].max(lever[lane + 1]);
                    turn += travel;
                }
                reach = reach.max(way / (SHARES - turn).max(0.1));
            }
        }
        let reach = (1.001 * reach + 1e-6).min(REACH);
        self.gaps.fill([reach; LANES]);
        self.suspects.clear();
        let (suspects, gaps, groups) = (&mut self.suspects, &mut self.gaps, screen.groups());
        screen.survey(&mut self.batch, &self.needs, reach, |s| {
            for (least, gap) in gaps[place_of(s, groups)].iter_mut().zip(s.gap) {
                // A NaN must not count as collision-free.
                *least = if gap >= *least { *least } else { gap };
            }
            suspects.push(*s);
            true
        });
        self.measured.clear();
        self.measured.resize(self.suspects.len(), [false; LANES]);
        if depth == 0 {
            self.near.clear();
            let near = self.suspects.iter().filter(|s| s.gap[0] < INFLUENCE as f32).map(|s| (s.group, s.other));
            self.near.extend(near);
        }
    }

    /// Returns the intervals between neighbouring lanes in which a pair could come too close; `None` if it does.
    fn left(&mut self, motion: &Motion<'_>, place: usize) -> Option<[bool; LANES]> {
        let mut open = [false; LANES];
        for lane in 0..LANES - 1 {
            if self.covers(motion, place, lane) {
                continue;
            }
            // The bounds from spheres may be far too low.
            for lane in [lane, lane + 1] {
                if !self.measure(motion, place, lane) {
                    return None;
                }
            }
            open[lane] = !self.covers(motion, place, lane);
        }
        Some(open)
    }

    /// Returns whether the gaps of a pair in two neighbouring lanes exclude that it comes too close between them.
    fn covers(&self, motion: &Motion<'_>, place: usize, lane: usize) -> bool {
        let (one, two) = (self.gaps[place][lane], self.gaps[place][lane + 1]);
        if !(one > 0.0 && two > 0.0) {
            return false;
        }
        let joints = motion.scene.robot().joints().len();
        let mut shares = 0.0;
        for (joint, group) in &self.movers[place] {
            let lever = &self.levers[group * joints + joint];
            shares += self.travel[*joint][lane] * ((lever[lane] + one) / one).max((lever[lane + 1] + two) / two);
        }
        shares <= SHARES
    }

    /// Replaces the lower bounds of a gap in one lane by exact distances; returns whether the gap is not negative.
    fn measure(&mut self, motion: &Motion<'_>, place: usize, lane: usize) -> bool {
        let screen = &motion.scene.compiled().screen;
        let mut least = f32::INFINITY;
        for k in 0..self.suspects.len() {
            let Suspect { group, other, .. } = self.suspects[k];
            if place_of(&self.suspects[k], screen.groups()) != place {
                continue;
            }
            let bound = self.suspects[k].gap[lane];
            if !self.measured[k][lane] && (bound.is_nan() || bound < CLOSE) {
                let need = screen.needed(&self.needs, group, other);
                let reach = need + f64::from(bound.max(0.0) + CLOSE);
                let distance = screen.distance(group, other, self.posed(motion, lane), reach);
                self.suspects[k].gap[lane] = (distance - need - ROUNDING) as f32;
                self.measured[k][lane] = true;
            }
            let gap = self.suspects[k].gap[lane];
            least = if gap >= least { least } else { gap };
            if self.measured[k][lane] && (gap.is_nan() || gap < 0.0) {
                self.blocked = Some((group, other));
            }
        }
        if least.is_finite() || least.is_nan() {
            self.gaps[place][lane] = least;
        }
        self.gaps[place][lane] >= 0.0
    }

    fn posed(&mut self, motion: &Motion<'_>, lane: usize) -> &[Pose] {
        if self.poses[lane].is_empty() {
            Compiled::poses(motion.scene, &self.q[lane], &mut self.poses[lane]);
        }
        &self.poses[lane]
    }

    /// Returns whether all pairs keep the gap [`REST`] when the arm has come to rest, in the last lane.
    fn rests(&mut self, motion: &Motion<'_>) -> bool {
        let last = LANES - 1;
        (0..self.gaps.len()).all(|place| {
            let keeps = |guard: &Self| f64::from(guard.gaps[place][last]) >= REST;
            let rests = keeps(self) || (self.measure(motion, place, last) && keeps(self)) || motion.end == 0.0;
            if !rests {
                let groups = motion.scene.compiled().screen.groups();
                let close = self.suspects.iter().find(|s| place_of(s, groups) == place);
                self.blocked = self.blocked.or(close.map(|s| (s.group, s.other)));
            }
            rests
        })
    }
}

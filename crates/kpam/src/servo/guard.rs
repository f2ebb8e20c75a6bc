//! Proof that the next step and the stop after it keep the required distances.
//!
//! Pairs of bodies that the motion cannot bring too close need no measurement: [`Bubble`]s of earlier states contain the
//! whole motion. The other pairs are screened in eight states of the motion at once. Between two neighbouring states a
//! pair keeps its distance if bubbles around both contain the movement, or if two parallel planes stay between the
//! bodies. Where neither is certain, distances are measured, and then the time between the two states is divided.

use gensim2_geometry::{Batch, Contact, LANES, Needs, Other, Pose, Screen};
use nalgebra::Vector3;

use super::arm::Arm;
use super::bubble::Bubble;
use super::joint::Course;
use super::motion::{Motion, Samples};
use crate::Scene;
use crate::model::{Model, Row};
use crate::world::{Compiled, TOUCH};

/// Pairs closer than their required distance plus this value (m) bound the approach of the two bodies.
pub(super) const INFLUENCE: f64 = 0.08;
/// Range of the gaps (m) up to which pairs are neighbours, and factor of the motion that a survey serves.
const NEAREST: f32 = 0.12;
const FURTHEST: f64 = 0.4;
const AHEAD: f64 = 1.5;
/// Distance (m) beyond [`INFLUENCE`] up to which pairs are measured, so that they need not be measured in every step.
const BEYOND: f64 = 0.04;
/// State of the eight whose bubble serves the next motions: the one near the middle of the way.
const MIDDLE: usize = 3;
/// Pairs whose gap is smaller than this (m) are measured exactly.
const CLOSE: f32 = 0.03;
/// Upper bound on the rounding error of an exact distance (m).
const ROUNDING: f64 = 1e-8;
/// Gap (m) that all pairs keep when the arm rests, so that the arm can always be proven to leave.
const REST: f64 = 0.5 * TOUCH;
/// Upper bound on the sum of the fractions of two gaps that a movement uses up.
const SHARES: f32 = 1.999;
/// Maximum number of times that a motion is divided, and maximum number of screened batches.
const DEPTH: usize = 3;
const BATCHES: usize = 10;

/// A variable that moves one of the two bodies of a pair relative to the other.
#[derive(Debug, Clone, Copy)]
struct Mover {
    variable: usize,
    /// Absolute value of the factor of the joint that the variable drives.
    factor: f32,
    /// The group that moves, and the place of its lever in `Guard::levers`.
    group: usize,
    lever: usize,
}

/// A pair of bodies near each other at the last survey.
#[derive(Debug, Clone)]
pub(super) struct Neighbour {
    pub group: usize,
    pub other: Other,
    /// Required distance (m).
    pub need: f64,
    /// Index of the pair's movers.
    place: usize,
    /// Region in which the pair keeps its required distance, and the region around the state of the arm in which the pair
    /// was measured last.
    pub bubble: Bubble,
    pub seen: Bubble,
    /// Direction of the pair's gap when it was measured last, in the frame of the link that carries both bodies.
    normal: Option<Vector3<f64>>,
    /// Lower bounds of the gap (m) in the states of the current batch.
    gaps: [f32; LANES],
}

/// Checks of the motions of a robot among obstacles, with buffers that are reused.
pub(super) struct Guard {
    needs: Needs,
    /// Movers of each group relative to fixed bodies, and then of each pair of groups.
    movers: Vec<Vec<Mover>>,
    /// For each pair of groups, the last link that carries both; `None` if it is the base.
    common: Vec<Option<usize>>,
    /// Regions in which all pairs that are not neighbours keep their required distances, one for each list of movers.
    around: Vec<Bubble>,
    /// Whether the neighbours were looked for in the last step.
    is_known: bool,
    pub neighbours: Vec<Neighbour>,
    /// Neighbours that may be closer than their required distance plus [`INFLUENCE`], nearest first: lower bound of the
    /// gap (m), and index.
    pub near: Vec<(f64, usize)>,
    /// A pair that was too close, or not proven, in the last motion that was not proven.
    pub blocked: Option<(usize, Other)>,
    batch: Batch,
    batches: usize,
    samples: Samples,
    /// Maximum distance of each group's points from each joint's axis (m), one row for each group, and whether the row
    /// belongs to the current batch.
    levers: Vec<[f32; LANES]>,
    levered: Vec<bool>,
    q: Vec<Vec<f64>>,
    poses: Vec<Vec<Pose>>,
    /// Neighbours that are not proven yet, each with a bit for each interval.
    open: Vec<(usize, u8)>,
}

/// What the motions of an arm are checked against.
#[derive(Clone, Copy)]
pub(super) struct Surroundings<'s> {
    pub scene: &'s Scene,
    pub model: &'s Model,
}

impl<'s> Surroundings<'s> {
    fn world(&self) -> &'s Compiled {
        self.scene.compiled()
    }

    fn screen(&self) -> &'s Screen {
        &self.world().screen
    }
}

impl Guard {
    pub fn new(around: Surroundings<'_>, needs: Needs) -> Self {
        let (world, joints) = (around.world(), around.scene.robot().joints().len());
        let groups = world.screen.groups();
        let driven = around.model.map().driven();
        let mover = |(joint, group): &(usize, usize)| {
            let driven = driven.iter().find(|d| d.joint == *joint)?;
            let lever = group * joints + joint;
            Some(Mover { variable: driven.variable, factor: driven.factor.abs() as f32, group: *group, lever })
        };
        let movers: Vec<Vec<Mover>> =
            world.movers().iter().map(|list| list.iter().filter_map(mover).collect()).collect();
        let common = |(one, two): &(usize, usize)| {
            let links = world.carriers[*one].iter().filter(|carrier| world.carriers[*two].contains(carrier));
            links.map(|(_, link)| *link).next_back()
        };
        Self {
            needs,
            around: vec![Bubble::EMPTY; movers.len()],
            is_known: false,
            movers,
            common: world.screen.pairs().iter().map(common).collect(),
            neighbours: Vec::new(),
            near: Vec::new(),
            blocked: None,
            batch: Batch::default(),
            batches: 0,
            samples: Samples::default(),
            levers: vec![[0.0; LANES]; groups * joints],
            levered: vec![false; groups],
            q: vec![Vec::new(); LANES],
            poses: vec![Vec::new(); LANES],
            open: Vec::new(),
        }
    }

    /// Returns whether all pairs keep their required distances until the variables have come to rest.
    pub fn proves(&mut self, around: Surroundings<'_>, courses: &[Course]) -> bool {
        let motion = Motion::new(courses);
        let times = motion.times();
        (self.batches, self.blocked, self.is_known) = (0, None, true);
        self.open.clear();
        let [low, high] = [&motion.lower, &motion.upper];
        let known = self.around.iter().all(|bubble| bubble.contains(low, high, INFLUENCE));
        if known {
            let open = self.neighbours.iter().enumerate().filter(|(_, n)| !n.bubble.contains(low, high, REST));
            self.open.extend(open.map(|(k, _)| (k, 0)));
            if self.open.is_empty() {
                return true;
            }
            self.place(around, &motion, &times);
        } else {
            self.place(around, &motion, &times);
            if !self.survey(around, &motion) {
                return false;
            }
            self.open.extend((0..self.neighbours.len()).map(|k| (k, 0)));
        }
        self.proves_between(around, &motion, &times, 0, 0, known)
    }

    /// Places the states at some times.
    fn place(&mut self, around: Surroundings<'_>, motion: &Motion<'_>, times: &[f64; LANES]) {
        self.batches += 1;
        self.samples.take(motion, times);
        let screen = around.screen();
        for lane in 0..LANES {
            around.model.map().positions(&self.samples.rows[lane], &mut self.q[lane]);
            self.batch.set(screen, lane, &self.q[lane]);
            self.poses[lane].clear();
        }
        screen.place(&mut self.batch);
        self.levered.fill(false);
    }

    /// Finds the neighbours of the remaining motion if pairs other than the known ones could be near each other at `x`.
    pub fn look_around(&mut self, around: Surroundings<'_>, courses: &[Course], x: &Row) {
        // The last proof has found the neighbours, unless the last step did without one.
        let is_known = std::mem::take(&mut self.is_known);
        if !is_known && !self.around.iter().all(|bubble| bubble.contains(x, x, INFLUENCE)) {
            let motion = Motion::new(courses);
            self.place(around, &motion, &motion.times());
            self.survey(around, &motion);
        }
    }

    /// Finds the neighbours in the placed states. Returns whether all other pairs keep their required distances between
    /// these states.
    fn survey(&mut self, around: Surroundings<'_>, motion: &Motion<'_>) -> bool {
        let mut reach = NEAREST;
        for place in 0..self.movers.len() {
            reach = reach.max(self.reach(around, place)).max(self.reach_around(motion, place));
        }
        let (screen, groups) = (around.screen(), around.screen().groups());
        let mut found = Vec::with_capacity(self.neighbours.len());
        screen.survey(&mut self.batch, &self.needs, reach, |s| {
            let place = if let Other::Pair(pair) = s.other { groups + pair } else { s.group };
            let need = screen.needed(&self.needs, s.group, s.other);
            let known = self.neighbours.iter().find(|n| (n.group, n.other) == (s.group, s.other));
            let (normal, seen) = known.map_or((None, Bubble::EMPTY), |known| (known.normal, known.seen));
            let (group, other, gaps) = (s.group, s.other, s.gap);
            found.push(Neighbour { group, other, need, place, bubble: Bubble::EMPTY, seen, normal, gaps });
            true
        });
        self.neighbours = found;
        for place in 0..self.movers.len() {
            self.around[place] = self.bubble(place, reach);
        }
        (0..self.movers.len()).all(|place| self.left_by_bubbles(place, &[reach; LANES]) == 0)
    }

    /// Returns the gap (m) up to which a pair must be a neighbour, so that the survey serves a longer motion than this.
    fn reach_around(&self, motion: &Motion<'_>, place: usize) -> f32 {
        let (mut way, mut turn) = (0.0, 0.0);
        for mover in &self.movers[place] {
            let (v, center) = (mover.variable, self.samples.rows[MIDDLE][mover.variable]);
            let part = f64::from(mover.factor) * (motion.upper[v] - center).max(center - motion.lower[v]);
            way += part * f64::from(self.levers[mover.lever][MIDDLE]);
            turn += part;
        }
        let reach = (INFLUENCE + AHEAD * way) / (1.0 - AHEAD * turn).max(0.1);
        reach.min(FURTHEST) as f32
    }

    /// Proves that the neighbours in `open`, from index `from`, keep their distances between some times.
    fn proves_between(
        &mut self,
        around: Surroundings<'_>,
        motion: &Motion<'_>,
        times: &[f64; LANES],
        from: usize,
        depth: usize,
        looks: bool,
    ) -> bool {
        let until = self.open.len();
        for at in from..until {
            let k = self.open[at].0;
            let Some(left) = self.left(around, motion, k, depth, looks) else {
                self.blocked = Some((self.neighbours[k].group, self.neighbours[k].other));
                return false;
            };
            self.open[at].1 = left;
        }
        for lane in 0..LANES - 1 {
            for at in from..until {
                let (k, left) = self.open[at];
                if left & 1 << lane != 0 {
                    self.open.push((k, 0));
                }
            }
            let Some((k, _)) = self.open.get(until).copied() else { continue };
            if depth == DEPTH || self.batches == BATCHES {
                self.blocked = Some((self.neighbours[k].group, self.neighbours[k].other));
                return false;
            }
            let between = Samples::between(times[lane], times[lane + 1]);
            self.place(around, motion, &between);
            if !self.proves_between(around, motion, &between, until, depth + 1, true) {
                return false;
            }
            self.open.truncate(until);
        }
        true
    }

    /// Returns the intervals, as bits, in which a neighbour could come too close; `None` if it does.
    fn left(
        &mut self,
        around: Surroundings<'_>,
        motion: &Motion<'_>,
        k: usize,
        depth: usize,
        looks: bool,
    ) -> Option<u8> {
        let place = self.neighbours[k].place;
        let reach = self.reach(around, place);
        let mut left = u8::MAX >> 1;
        if looks {
            self.neighbours[k].gaps = [f32::NEG_INFINITY; LANES];
            if let Some(normal) = self.neighbours[k].normal {
                left &= self.left_by_planes(around, k, &normal);
            }
            if left != 0 || !self.keeps_at_rest(motion, k, depth) {
                let reach = if depth == 0 { reach.max(self.reach_around(motion, place)) } else { reach };
                self.look(around, k, reach);
            }
        }
        left &= self.left_by_bubbles(place, &self.neighbours[k].gaps);
        if !looks
            && left != 0
            && let Some(normal) = self.neighbours[k].normal
        {
            left &= self.left_by_planes(around, k, &normal);
        }
        let mut measured = 0_u8;
        while left != 0 || !self.keeps_at_rest(motion, k, depth) {
            // Each interval that is left is measured at both ends, the end with the smaller bound first.
            let last = if left == 0 { 1 << (LANES - 1) } else { 0 };
            let ends = (left | left << 1 | last) & !measured;
            let gaps = &self.neighbours[k].gaps;
            let lanes = (0..LANES).filter(|lane| ends & 1 << lane != 0);
            let Some(lane) = lanes.min_by(|a, b| gaps[*a].total_cmp(&gaps[*b])) else { break };
            measured |= 1 << lane;
            if gaps[lane] >= CLOSE {
                continue;
            }
            let normal = self.measure(around, k, lane)?;
            left &= self.left_by_bubbles(place, &self.neighbours[k].gaps);
            if left != 0
                && let Some(normal) = normal
            {
                left &= self.left_by_planes(around, k, &normal);
            }
        }
        if !self.keeps_at_rest(motion, k, depth) {
            return None;
        }
        if depth == 0 {
            self.neighbours[k].bubble = self.bubble(place, self.neighbours[k].gaps[MIDDLE]);
        }
        Some(left)
    }

    /// Returns whether a neighbour keeps the gap [`REST`] when the arm has come to rest.
    fn keeps_at_rest(&self, motion: &Motion<'_>, k: usize, depth: usize) -> bool {
        depth > 0 || motion.end == 0.0 || f64::from(self.neighbours[k].gaps[LANES - 1]) >= REST
    }

    /// Bounds the gaps of a neighbour up to `reach` (m) by spheres.
    fn look(&mut self, around: Surroundings<'_>, k: usize, reach: f32) {
        let neighbour = &mut self.neighbours[k];
        let mut found = [reach; LANES];
        around.screen().look_at(&mut self.batch, &self.needs, (neighbour.group, neighbour.other), reach, |s| {
            found = s.gap;
            true
        });
        raise(&mut neighbour.gaps, &found);
    }

    /// Measures a neighbour in one state. Returns the direction of its gap, unless it is a point cloud or far away; the
    /// outer `None` if it is too close.
    #[allow(clippy::option_option)]
    fn measure(&mut self, around: Surroundings<'_>, k: usize, lane: usize) -> Option<Option<Vector3<f64>>> {
        if self.poses[lane].is_empty() {
            Compiled::poses(around.scene, &self.q[lane], &mut self.poses[lane]);
        }
        let frame = self.frame(self.neighbours[k].other);
        let (poses, neighbour) = (&self.poses[lane], &mut self.neighbours[k]);
        let (group, other, need) = (neighbour.group, neighbour.other, neighbour.need);
        let reach = need + f64::from(neighbour.gaps[lane].max(0.0) + CLOSE);
        let guess = neighbour.normal.map(|normal| turned(poses, frame, &normal));
        let contact = around.screen().contact(group, other, poses, reach, guess.as_ref());
        let gap = contact.map_or(reach, |contact| contact.distance) - need - ROUNDING;
        // A NaN must not count as collision-free.
        if gap.is_nan() || gap < 0.0 {
            return None;
        }
        neighbour.gaps[lane] = gap as f32;
        let Some(contact) = contact.filter(|_| !matches!(other, Other::Cloud(_))) else { return Some(None) };
        let normal = turned_back(poses, frame, &contact.normal);
        neighbour.normal = Some(normal);
        Some(Some(normal))
    }

    /// Finds the neighbours that may be near in the present state of the arm.
    pub fn find_near(&mut self, x: &Row) {
        self.near.clear();
        for (k, neighbour) in self.neighbours.iter().enumerate() {
            let gap = neighbour.seen.gap_at(x).max(neighbour.bubble.gap_at(x));
            if gap < INFLUENCE {
                self.near.push((gap, k));
            }
        }
        self.near.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    }

    /// Measures a neighbour in the present state of the arm; `None` if it is much further away than [`INFLUENCE`].
    pub fn contact(&mut self, around: Surroundings<'_>, k: usize, arm: &Arm, x: &Row) -> Option<Contact> {
        let frame = self.frame(self.neighbours[k].other);
        let neighbour = &mut self.neighbours[k];
        let (poses, reach) = (&arm.poses, neighbour.need + INFLUENCE + BEYOND);
        let guess = neighbour.normal.map(|normal| turned(poses, frame, &normal));
        let contact = around.screen().contact(neighbour.group, neighbour.other, poses, reach, guess.as_ref());
        let gap = contact.map_or(reach, |contact| contact.distance) - neighbour.need - ROUNDING;
        neighbour.seen = Bubble::new(x, gap, arm.levers(around.screen(), neighbour.group, neighbour.other));
        neighbour.normal = Some(turned_back(poses, frame, &contact?.normal));
        contact
    }

    /// Returns the link in whose frame the normals of a pair are given; `None` for the base frame.
    fn frame(&self, other: Other) -> Option<usize> {
        match other {
            Other::Pair(pair) => self.common[pair],
            Other::Element(_) | Other::Cloud(_) => None,
        }
    }

    /// Computes the levers of a group in the placed states.
    fn ensure_levers(&mut self, around: Surroundings<'_>, place: usize) {
        let joints = around.scene.robot().joints().len();
        for mover in &self.movers[place] {
            let group = mover.group;
            if self.levered[group] {
                continue;
            }
            self.levered[group] = true;
            let (levers, carried) = (&mut self.levers, &around.world().carriers[group]);
            around.screen().levers_of(&self.batch, group, carried, around.scene.robot(), |joint, lever| {
                levers[group * joints + joint] = lever;
            });
        }
    }

    /// Returns the gap (m) with which bubbles of the placed states prove a pair.
    fn reach(&mut self, around: Surroundings<'_>, place: usize) -> f32 {
        self.ensure_levers(around, place);
        let ([way, turn], mut reach) = (self.ways(place), 0.0_f32);
        for lane in 0..LANES - 1 {
            reach = reach.max(way[lane] / (SHARES - turn[lane]).max(0.1));
        }
        1.001 * reach + 1e-6
    }

    /// Returns the movement (m) of the two bodies of a pair in each interval while no lever grows, and the sum of the
    /// movements of their joints (rad or m).
    fn ways(&self, place: usize) -> [[f32; LANES]; 2] {
        let [mut way, mut turn] = [[0.0; LANES]; 2];
        for mover in &self.movers[place] {
            let (lever, travel) = (&self.levers[mover.lever], &self.samples.travel[mover.variable]);
            for lane in 0..LANES - 1 {
                let part = mover.factor * travel[lane];
                way[lane] += part * lever[lane].max(lever[lane + 1]);
                turn[lane] += part;
            }
        }
        [way, turn]
    }

    /// Returns the region around the middle state in which a pair with a gap there (m) keeps its required distance.
    fn bubble(&self, place: usize, gap: f32) -> Bubble {
        let levers = self.movers[place].iter().map(|mover| {
            let lever = f64::from(self.levers[mover.lever][MIDDLE]);
            (mover.variable, f64::from(mover.factor), lever)
        });
        Bubble::new(&self.samples.rows[MIDDLE], f64::from(gap), levers)
    }

    /// Returns the intervals, as bits, that are not contained in the bubbles around the states at their ends.
    fn left_by_bubbles(&self, place: usize, gaps: &[f32; LANES]) -> u8 {
        let (mut shares, inverse) = ([0.0; LANES], gaps.map(|gap| 1.0 / gap));
        for mover in &self.movers[place] {
            let (lever, travel) = (&self.levers[mover.lever], &self.samples.travel[mover.variable]);
            for lane in 0..LANES - 1 {
                let (one, two) = (lever[lane] * inverse[lane], lever[lane + 1] * inverse[lane + 1]);
                shares[lane] += mover.factor * travel[lane] * (1.0 + one.max(two));
            }
        }
        let covers = |lane: &usize| gaps[*lane] > 0.0 && gaps[*lane + 1] > 0.0 && shares[*lane] <= SHARES;
        (0..LANES - 1).filter(|lane| !covers(lane)).fold(0, |bits, lane| bits | 1 << lane)
    }

    /// Raises the bounds of a neighbour's gaps to those along a direction. Returns the intervals, as bits, in which
    /// planes perpendicular to the direction are not certain to stay between the bodies.
    ///
    /// The gap between the planes changes like a linear function of time, up to a term that the accelerations of all
    /// points along the direction bound. With joint speeds s and accelerations a, a point at the distances r from the
    /// axes accelerates by at most `sum_j r_j (a_j + s_j (s_j + 2 sum_(i before j) s_i))`.
    fn left_by_planes(&mut self, around: Surroundings<'_>, k: usize, normal: &Vector3<f64>) -> u8 {
        let Neighbour { group, other, need, place, .. } = self.neighbours[k];
        let frame = self.frame(other);
        let Some(along) = around.screen().gap_along(&self.batch, (group, other), normal, frame) else {
            return u8::MAX >> 1;
        };
        let along = along.map(|distance| distance - need as f32);
        raise(&mut self.neighbours[k].gaps, &along);
        let [way, turn] = self.ways(place);
        let (mut bend, mut before, mut last) = ([0.0; LANES], [0.0; LANES], None);
        for mover in &self.movers[place] {
            if last.replace(mover.group) != Some(mover.group) {
                before = [0.0; LANES];
            }
            let (lever, v) = (&self.levers[mover.lever], mover.variable);
            for lane in 0..LANES - 1 {
                let speed = mover.factor * self.samples.speed[v][lane];
                let gain = mover.factor * self.samples.acceleration[v][lane];
                // Points move by no more than this within the interval, and so do their distances from the axes.
                let moved = way[lane] / (1.0 - turn[lane]);
                let lever = lever[lane].max(lever[lane + 1]) + moved;
                bend[lane] += lever * (gain + speed * (speed + 2.0 * before[lane]));
                before[lane] += speed;
            }
        }
        let stays = |lane: &usize| {
            let length = self.samples.lengths[*lane];
            // The factor covers rounding.
            let least = along[*lane].min(along[*lane + 1]) - 0.1251 * length * length * bend[*lane];
            turn[*lane] < 0.9 && least > 0.0
        };
        (0..LANES - 1).filter(|lane| !stays(lane)).fold(0, |bits, lane| bits | 1 << lane)
    }
}

/// Raises lower bounds to others. A NaN in `others` is ignored.
fn raise(bounds: &mut [f32; LANES], others: &[f32; LANES]) {
    for (bound, other) in bounds.iter_mut().zip(others) {
        *bound = if *other > *bound { *other } else { *bound };
    }
}

/// Returns a direction of a link's frame, or of the base frame without a link, in the base frame.
fn turned(poses: &[Pose], frame: Option<usize>, direction: &Vector3<f64>) -> Vector3<f64> {
    frame.map_or(*direction, |link| poses[link].rotation * direction)
}

/// Returns a direction of the base frame in a link's frame, or in the base frame without a link.
fn turned_back(poses: &[Pose], frame: Option<usize>, direction: &Vector3<f64>) -> Vector3<f64> {
    frame.map_or(*direction, |link| poses[link].rotation.inverse() * direction)
}

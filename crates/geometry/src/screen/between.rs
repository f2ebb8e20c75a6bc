//! Screening of eight motions at a time, each between two configurations. In a motion, every point of a link stays close
//! to the straight line between its two positions, so a sphere of a link stays inside a larger sphere around the middle
//! of that line.

use std::ops::Range;
use std::sync::Arc;

use nalgebra::{Point3, Vector3};

use crate::lanes::{F32x8, Wide, wide};

use super::posing::Frames;
use super::solid::{Points, length};
use super::survey::{all_at_least, apart};
use super::{Batch, LANES, Needs, Other, Screen, Suspect};
use crate::{JointKind, Pose, Robot};

/// Upper bound on the rounding error of positions in single precision (m).
const ROUNDING: f32 = 2e-5;
/// If all joints of a chain together rotate by more than this (rad) in a motion, the motion is not bounded.
const MOST_TURN: f32 = 0.8;
/// Bound (m) that stands for an unbounded motion; it exceeds every distance.
const UNBOUNDED: f32 = 1e9;

/// A joint between two bodies, and the link that the joint moves.
#[derive(Debug, Clone)]
struct Link {
    joint: usize,
    link: usize,
    axis: [f32; 3],
    slides: bool,
}

/// The joints that move each group relative to the base, and the second group of each pair relative to the first.
#[derive(Debug, Clone, Default)]
pub struct Chains {
    groups: Vec<Vec<Link>>,
    pairs: Vec<Vec<Link>>,
}

/// A joint that moves bodies (base frame).
#[derive(Debug, Clone, Copy)]
pub struct BodyJoint {
    /// Kind of the joint.
    pub kind: JointKind,
    /// A point on the axis (m).
    pub origin: Point3<f64>,
    /// Unit vector along the axis.
    pub axis: Vector3<f64>,
}

/// Frame of the bodies in which motions are considered.
#[derive(Debug, Clone)]
struct Beside {
    /// The joint between the bodies and the base.
    link: Link,
    /// Frame of the axis.
    axis: Frames,
    /// Poses of the base relative to the bodies at both ends.
    ends: [Frames; 2],
}

fn single(v: &Vector3<f64>) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

impl Chains {
    /// Collects the joints. `carriers` are the joints that move each group, from the base to the group, each with the
    /// link that the joint moves.
    #[must_use]
    pub fn new(robot: &Robot, screen: &Screen, carriers: &[Vec<(usize, usize)>]) -> Self {
        let of = |&(joint, link): &(usize, usize)| {
            let own = &robot.joints()[joint];
            Link { joint, link, axis: single(own.axis()), slides: own.kind() == JointKind::Prismatic }
        };
        let without = |one: usize, two: usize| carriers[one].iter().filter(move |c| !carriers[two].contains(c));
        let pair = |&(a, b): &(usize, usize)| {
            // Seen from the first group, the chain leads through its own joints backwards, then to the second group.
            let mut chain: Vec<Link> = without(a, b).map(of).collect();
            chain.reverse();
            chain.extend(without(b, a).map(of));
            chain
        };
        let groups = carriers.iter().map(|list| list.iter().map(of).collect()).collect();
        Self { groups, pairs: screen.pairs().iter().map(pair).collect() }
    }
}

/// Bounds on the movement of one joint in a motion (rad or m).
#[derive(Debug, Clone, Copy, Default)]
pub struct Travel {
    /// Distance between the joint's values at both ends.
    pub apart: f32,
    /// Upper bound on the joint's movement from either end.
    pub gone: f32,
    /// Maximum deviation from the values between both ends that are proportional to the time.
    pub off: f32,
}

/// Eight motions between two configurations each, with the intermediate results of their screening.
#[derive(Debug, Clone, Default)]
pub struct Motions {
    /// The first configurations. Their frames are replaced by the middles between first and last frames.
    pub(super) first: Batch,
    last: Batch,
    chains: Arc<Chains>,
    beside: Option<Beside>,
    travel: Vec<[F32x8; 3]>,
    between: Between,
}

/// Bounds on the positions during motions. They are empty in a batch of configurations.
#[derive(Debug, Clone, Default)]
pub(super) struct Between {
    firsts: Vec<Frames>,
    lasts: Vec<Frames>,
    /// Half of the difference between last and first frames.
    halves: Vec<Frames>,
    /// Maximum deviation (m) of each group's points from the straight lines.
    bends: Vec<F32x8>,
    /// The same for each pair, relative to the first group.
    pair_bends: Vec<F32x8>,
    /// Distance (m) that must be added to the radius of each group's surrounding sphere, and of each sphere.
    around: Vec<F32x8>,
    swells: Vec<F32x8>,
    levers: Vec<F32x8>,
}

/// Either eight configurations or eight motions, for code that screens both.
pub(super) trait Swept {
    /// Whether these are motions.
    const MOVES: bool;
    /// Returns the radius (m) of the sphere around a group, or around its movement.
    fn radius(&self, screen: &Screen, group: usize) -> F32x8;
    /// Computes the movements of a group's spheres.
    fn swell(&mut self, screen: &Screen, group: usize);
    /// Returns the distances (m) to add to the radii of some spheres; empty for configurations.
    fn swells(&self, balls: &Range<usize>) -> &[F32x8];
}

/// Eight configurations.
pub(super) struct Still;

impl Swept for Still {
    const MOVES: bool = false;
    #[inline(always)]
    fn radius(&self, screen: &Screen, group: usize) -> F32x8 {
        F32x8::splat(screen.groups[group].around.radius)
    }
    #[inline(always)]
    fn swell(&mut self, _: &Screen, _: usize) {}
    #[inline(always)]
    fn swells(&self, _: &Range<usize>) -> &[F32x8] {
        &[]
    }
}

impl Swept for Between {
    const MOVES: bool = true;
    #[inline(always)]
    fn radius(&self, screen: &Screen, group: usize) -> F32x8 {
        F32x8::splat(screen.groups[group].around.radius) + self.around[group]
    }
    #[inline(always)]
    fn swell(&mut self, screen: &Screen, group: usize) {
        let cluster = &screen.groups[group];
        let (half, bend) = (self.halves[cluster.link], self.bends[group] + F32x8::splat(ROUNDING));
        for b in cluster.balls.clone() {
            self.swells[b] = length(&half.point(&screen.balls[b].center)) + bend;
        }
    }
    #[inline(always)]
    fn swells(&self, balls: &Range<usize>) -> &[F32x8] {
        &self.swells[balls.clone()]
    }
}

impl Motions {
    /// Creates an empty set for robots with these chains.
    #[must_use]
    pub fn new(chains: impl Into<Arc<Chains>>) -> Self {
        Self { chains: chains.into(), ..Self::default() }
    }

    /// Considers all motions relative to the bodies that a joint moves, in place of the base. The joint's value and its
    /// [`Travel`] then follow those of the robot's joints, and [`Motions::set_base`] must be called for every lane.
    #[must_use]
    pub fn beside(mut self, robot: &Robot, joint: &BodyJoint) -> Self {
        let (number, frame) = (robot.joints().len(), robot.links().len());
        let slides = joint.kind == JointKind::Prismatic;
        let link = Link { joint: number, link: frame, axis: single(&joint.axis), slides };
        let axis = Frames::of(&Pose::translation(joint.origin.x, joint.origin.y, joint.origin.z));
        self.beside = Some(Beside { link, axis, ends: [Frames::of(&Pose::identity()); 2] });
        self
    }

    /// Sets the poses of the base relative to the moved bodies at both ends of one motion.
    pub fn set_base(&mut self, lane: usize, ends: [&Pose; 2]) {
        if let Some(beside) = &mut self.beside {
            beside.ends.iter_mut().zip(ends).for_each(|(frames, pose)| frames.set(lane, pose));
        }
    }

    /// Sets one motion: full joint vectors at both ends, and bounds for each joint.
    pub fn set(&mut self, screen: &Screen, lane: usize, ends: [&[f64]; 2], travel: &[Travel]) {
        self.first.set(screen, lane, ends[0]);
        self.last.set(screen, lane, ends[1]);
        self.travel.resize(travel.len(), [F32x8::ZERO; 3]);
        for (lanes, of) in self.travel.iter_mut().zip(travel) {
            lanes[0].set(lane, of.apart);
            lanes[1].set(lane, of.gone);
            lanes[2].set(lane, of.off);
        }
    }

    /// Returns the maximum deviation (m) of the points of a group from the straight lines between their positions at
    /// both ends, at the same fraction of the time. For a pair, positions are relative to the first group.
    #[must_use]
    pub fn bend(&self, group: usize, other: Other, lane: usize) -> f64 {
        let lanes = match other {
            Other::Pair(pair) => self.between.pair_bends[pair],
            Other::Element(_) | Other::Cloud(_) => self.between.bends[group],
        };
        f64::from(lanes.to_array()[lane])
    }
}

impl Screen {
    /// Computes the positions of all groups for the motions that were set.
    pub fn place_between(&self, motions: &mut Motions) {
        self.posing.place(&motions.last.q, &mut motions.last.frames);
        self.posing.place(&motions.first.q, &mut motions.first.frames);
        struct Work<'a>(&'a Screen, &'a mut Motions);
        impl Wide for Work<'_> {
            type Output = ();
            #[inline(always)]
            fn run(self) {
                self.0.placed_between(self.1);
            }
        }
        wide(Work(self, motions));
    }

    #[inline(always)]
    fn placed_between(&self, motions: &mut Motions) {
        let Motions { first, last, chains, travel, between, beside } = motions;
        if let Some(Beside { axis, ends, .. }) = beside {
            for (frames, base) in [(&mut first.frames, &ends[0]), (&mut last.frames, &ends[1])] {
                for frame in frames.iter_mut() {
                    *frame = base.after(frame);
                }
                frames.push(*axis);
            }
        }
        std::mem::swap(&mut between.firsts, &mut first.frames);
        std::mem::swap(&mut between.lasts, &mut last.frames);
        first.frames.clear();
        between.halves.clear();
        for (from, to) in between.firsts.iter().zip(&between.lasts) {
            let (middle, half) = from.halfway(to);
            first.frames.push(middle);
            between.halves.push(half);
        }
        self.place_around(first);
        // The regions that groups can reach are those relative to the base.
        first.within_travel &= beside.is_none();
        // Between its ends, a prismatic joint may exceed their values.
        for (joint, most) in &self.travels {
            let off = travel[*joint][2];
            for q in [first.q[*joint], last.q[*joint]] {
                first.within_travel &= all_at_least(F32x8::splat(*most) - q.abs(), off);
            }
        }
        between.bends.resize(self.groups.len(), F32x8::ZERO);
        between.around.resize(self.groups.len(), F32x8::ZERO);
        between.swells.resize(self.balls.len(), F32x8::ZERO);
        between.pair_bends.resize(self.pairs.len(), F32x8::ZERO);
        for (group, cluster) in self.groups.iter().enumerate() {
            if cluster.balls.is_empty() {
                continue;
            }
            let chain = beside.iter().map(|beside| &beside.link).chain(&chains.groups[group]);
            let bend = self.bend(chain, group, &between.firsts, travel, &mut between.levers);
            between.bends[group] = bend;
            let half = length(&between.halves[cluster.link].point(&cluster.around.center));
            between.around[group] = half + bend + F32x8::splat(ROUNDING);
        }
    }

    /// Returns the maximum deviation of a group's points from straight lines, if the joints of a chain move the group.
    #[inline(always)]
    fn bend<'a>(
        &self,
        chain: impl Iterator<Item = &'a Link> + Clone,
        group: usize,
        firsts: &[Frames],
        travel: &[[F32x8; 3]],
        levers: &mut Vec<F32x8>,
    ) -> F32x8 {
        let cluster = &self.groups[group];
        let center = firsts[cluster.link].point(&cluster.around.center);
        // A lever arm grows by at most the displacement of the group, which the lever arms themselves bound.
        let (mut turned, mut slid, mut longest) = (F32x8::ZERO, F32x8::ZERO, F32x8::ZERO);
        levers.clear();
        for link in chain.clone() {
            let [_, gone, off] = travel[link.joint];
            if link.slides {
                slid = slid + gone + off;
                levers.push(F32x8::ONE);
                longest = longest.max(F32x8::ONE);
                continue;
            }
            let frame = &firsts[link.link];
            let axis = frame.direction(&link.axis);
            let arm = [center[0] - frame.t[0], center[1] - frame.t[1], center[2] - frame.t[2]];
            let across = [
                arm[1] * axis[2] - arm[2] * axis[1],
                arm[2] * axis[0] - arm[0] * axis[2],
                arm[0] * axis[1] - arm[1] * axis[0],
            ];
            let lever = length(&across) + F32x8::splat(cluster.around.radius);
            turned = turned + gone + off;
            longest = longest.max(lever);
            levers.push(lever);
        }
        let grown = turned * (longest + slid) / (F32x8::ONE - turned) + slid;
        // The second derivative of a point by joints i and k, with i closer to the base, is at most the lever arm of k.
        // A curve with second derivative m deviates from its chord by at most m / 8.
        let (mut bend, mut before) = (F32x8::ZERO, F32x8::ZERO);
        for (link, lever) in chain.zip(levers.iter()) {
            let [own, _, off] = travel[link.joint];
            let lever = if link.slides { F32x8::ONE } else { *lever + grown };
            bend = bend + lever * (own * (own + before * 2.0) * 0.125 + off);
            before = before + own;
        }
        turned.below(F32x8::splat(MOST_TURN), bend, F32x8::splat(UNBOUNDED))
    }

    /// Calls `visit` for each pair that may come closer than the required distance during some motion. `visit` returns
    /// whether to continue. The suspect's gaps are lower bounds for the whole motion.
    pub fn survey_between(
        &self,
        motions: &mut Motions,
        needs: &Needs,
        mut visit: impl FnMut(&Suspect) -> bool,
    ) -> bool {
        struct Work<'a> {
            screen: &'a Screen,
            motions: &'a mut Motions,
            needs: &'a Needs,
            visit: &'a mut dyn FnMut(&Suspect) -> bool,
        }
        impl Wide for Work<'_> {
            type Output = bool;
            #[inline(always)]
            fn run(self) -> bool {
                let Self { screen, motions, needs, visit } = self;
                let Motions { first, between, chains, travel, .. } = motions;
                screen.surveyed(first, between, needs, 0.0, visit)
                    && (0..screen.pairs.len()).all(|pair| {
                        let need = needs.pairs[pair];
                        screen.against_group_between(pair, need, first, between, (chains, travel), visit)
                    })
            }
        }
        wide(Work { screen: self, motions, needs, visit: &mut visit })
    }

    /// Returns lower bounds of the gap between one group and one other body during each motion, as
    /// [`Screen::survey_between`] does for all pairs.
    pub fn look_between(
        &self,
        motions: &mut Motions,
        needs: &Needs,
        (group, other): (usize, Other),
        mut visit: impl FnMut(&Suspect) -> bool,
    ) {
        struct Work<'a> {
            screen: &'a Screen,
            motions: &'a mut Motions,
            of: (usize, Other),
            need: f64,
            visit: &'a mut dyn FnMut(&Suspect) -> bool,
        }
        impl Wide for Work<'_> {
            type Output = ();
            #[inline(always)]
            fn run(self) {
                let Self { screen, motions, of: (group, other), need, visit } = self;
                let Motions { first, between, chains, travel, .. } = motions;
                match other {
                    Other::Element(e) => screen.against_solid((group, e), need, first, between, 0.0, visit),
                    Other::Cloud(c) => screen.against_cloud((group, c), need, first, between, 0.0, visit),
                    Other::Pair(pair) => {
                        screen.against_group_between(pair, need, first, between, (chains, travel), visit)
                    }
                };
            }
        }
        let need = self.needed(needs, group, other);
        wide(Work { screen: self, motions, of: (group, other), need, visit: &mut visit });
    }

    #[inline(always)]
    fn against_group_between(
        &self,
        pair: usize,
        need: f64,
        first: &Batch,
        between: &mut Between,
        (chains, travel): (&Chains, &[[F32x8; 3]]),
        visit: &mut dyn FnMut(&Suspect) -> bool,
    ) -> bool {
        if need == f64::NEG_INFINITY {
            return true;
        }
        let (a, b) = self.pairs[pair];
        let (one, two, limit) = (&self.groups[a], &self.groups[b], F32x8::splat(need as f32));
        if one.balls.is_empty() || two.balls.is_empty() {
            return true;
        }
        // First in the base frame: the sphere around each group moves by its own half.
        let radii = one.around.radius + two.around.radius;
        let own = between.around[a] + between.around[b];
        let coarse = apart(&first.around[a], &first.around[b], radii) - own;
        if all_at_least(coarse, limit) {
            return true;
        }
        // Then relative to the first group, whose spheres do not move.
        let of = |frames: &[Frames]| frames[one.link].inverse_then(&frames[two.link]);
        let (middle, half) = of(&between.firsts).halfway(&of(&between.lasts));
        let bend = self.bend(chains.pairs[pair].iter(), b, &between.firsts, travel, &mut between.levers);
        between.pair_bends[pair] = bend;
        let bend = bend + F32x8::splat(ROUNDING);
        let splat = |p: &[f32; 3]| -> Points { [F32x8::splat(p[0]), F32x8::splat(p[1]), F32x8::splat(p[2])] };
        let whole = splat(&one.around.center);
        let far = |sphere: &super::Sphere| (middle.point(&sphere.center), length(&half.point(&sphere.center)) + bend);
        let (center, swell) = far(&two.around);
        let coarse = coarse.max(apart(&center, &whole, radii) - swell);
        if all_at_least(coarse, limit) {
            return true;
        }
        let mut least = F32x8::splat(f32::MAX);
        for theirs in &self.balls[two.balls.clone()] {
            let (center, swell) = far(theirs);
            let d = apart(&center, &whole, theirs.radius + one.around.radius) - swell;
            if all_at_least(d, limit) {
                least = least.min(d);
                continue;
            }
            for mine in &self.balls[one.balls.clone()] {
                least = least.min(apart(&center, &splat(&mine.center), mine.radius + theirs.radius) - swell);
            }
        }
        let bound = least.max(coarse);
        if all_at_least(bound, limit) {
            return true;
        }
        let gap = (bound - limit).to_array();
        visit(&Suspect { group: a, other: Other::Pair(pair), gap, max_gap: [f32::MAX; LANES] })
    }
}

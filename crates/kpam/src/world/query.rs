//! Queries about one state: contacts, depths and distances.

use gensim2_geometry::{Proximity, Target};

use super::rules::{Group, Verdict};
use super::{EXACT, Hit, Margins, MotionSegment, State, TOUCH, World};
use crate::Role;
use crate::model::Row;

/// Smallest signed distances (m) over the checked pairs of each kind.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Clearances {
    pub itself: f64,
    pub table: f64,
    pub object: f64,
}

/// A fixed body, or a pair of groups, that a query examines.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Seen {
    Body(usize),
    Pair(usize),
}

impl World<'_> {
    /// Visits the pairs checked in a segment at the current poses: `reach` returns how close (m) a pair must be,
    /// `visit` whether to continue.
    pub(super) fn look(
        &mut self,
        segment: MotionSegment,
        coarse: f64,
        reach: impl Fn(&Self, usize, Seen) -> f64,
        mut visit: impl FnMut(&Self, Seen, &Proximity) -> bool,
    ) -> bool {
        let mut scratch = std::mem::take(&mut self.scratch);
        let world = &*self;
        let table = world.table(segment);
        let bodies = world.problem.bodies.len();
        let checked = |group: usize, body: usize| match table.bodies[group * bodies + body] {
            Verdict::Checked | Verdict::MayTouch(_) => reach(world, group, Seen::Body(body)),
            Verdict::Apart => f64::NEG_INFINITY,
        };
        let whole =
            world.shapes.near_bodies(&table.present, world.obstacles, &mut scratch, coarse, checked, |p| {
                match p.target {
                    Target::Body(b) => visit(world, Seen::Body(b), &p),
                    Target::Group(_) => true,
                }
            }) && world.shapes.near_pairs(
                &world.objects.pairs,
                &table.pairs,
                &mut scratch,
                coarse,
                |pair| reach(world, world.objects.pairs[pair].0, Seen::Pair(pair)),
                |pair, p| visit(world, Seen::Pair(pair), &p),
            );
        self.scratch = scratch;
        whole
    }

    /// Returns the pairs checked in a segment that are within `reach` (m) of each other in a state, measured exactly.
    pub(super) fn near(
        &mut self,
        state: State<'_>,
        segment: MotionSegment,
        reach: impl Fn(&Self, usize, Seen) -> f64,
    ) -> Vec<(Seen, Proximity)> {
        self.place(state, segment);
        let mut found = Vec::new();
        self.look(segment, EXACT, reach, |_, seen, p| {
            found.push((seen, *p));
            true
        });
        found
    }

    /// Index of a group and another body in lists of distances.
    fn place_of(&self, group: usize, seen: Seen) -> usize {
        let bodies = self.problem.bodies.len();
        match seen {
            Seen::Body(body) => group * bodies + body,
            Seen::Pair(pair) => self.objects.groups.len() * bodies + pair,
        }
    }

    /// Returns the margin of a group and another body in a segment.
    pub(super) fn asked(&self, segment: MotionSegment, margins: &Margins, group: usize, seen: Seen) -> f64 {
        if let Some(depth) = self.depth(segment, group, seen) {
            return margins.touching(&self.known, self.place_of(group, seen), depth);
        }
        let clearance = match seen {
            Seen::Body(body) if self.is_about_to_touch(segment, group, body) => self.reach_clearance(),
            Seen::Body(_) | Seen::Pair(_) => margins.clearance.max(self.kept_from(segment, seen)),
        };
        let margin = margins.of(&self.known, self.place_of(group, seen), clearance);
        match seen {
            Seen::Pair(pair) if self.is_guess(segment, pair) => margin.min(-self.problem.options.guess_depth),
            Seen::Body(_) | Seen::Pair(_) => margin,
        }
    }

    /// Returns the permitted overlap (m) of a pair in a segment, if any.
    pub(super) fn depth(&self, segment: MotionSegment, group: usize, seen: Seen) -> Option<f64> {
        let table = self.table(segment);
        match seen {
            Seen::Body(body) => match table.bodies[group * self.problem.bodies.len() + body] {
                Verdict::MayTouch(depth) => Some(depth),
                Verdict::Checked | Verdict::Apart => None,
            },
            Seen::Pair(pair) if self.is_guess(segment, pair) => {
                table.depths[pair].map(|depth| depth.max(self.problem.options.guess_depth))
            }
            Seen::Pair(pair) => table.depths[pair],
        }
    }

    /// Returns whether the hand is about to touch a body from which it still keeps a clearance.
    fn is_about_to_touch(&self, segment: MotionSegment, group: usize, body: usize) -> bool {
        let touches = self.objects.touches(group) || matches!(self.objects.groups[group], Group::Riding(_));
        self.table(segment).reached[body] && segment == self.schedule.last_before_actuation() && touches
    }

    /// Returns the distance (m) below which a pair is visited: `reach` for pairs that may not touch.
    fn checked(&self, segment: MotionSegment, group: usize, seen: Seen, reach: f64) -> f64 {
        if self.depth(segment, group, seen).is_some() { f64::NEG_INFINITY } else { reach }
    }

    /// Returns the clearance (m) that the hand must keep from a handled body in a segment, zero for other bodies.
    fn kept_from(&self, segment: MotionSegment, seen: Seen) -> f64 {
        match seen {
            Seen::Body(body) if self.table(segment).reached[body] => self.reach_clearance(),
            Seen::Body(_) | Seen::Pair(_) => 0.0,
        }
    }

    /// Whether the travel of the object's joint in a segment is only estimated.
    pub fn guesses(&self, segment: MotionSegment) -> bool {
        self.table(segment).guessed && self.problem.joint.is_some() && segment != MotionSegment::LetGo
    }

    /// Whether the position of either group of a pair in a segment is only estimated.
    fn is_guess(&self, segment: MotionSegment, pair: usize) -> bool {
        self.table(segment).guessed && matches!(self.objects.groups[self.objects.pairs[pair].1], Group::Moved(_))
    }

    /// Records the distances of all pairs at the start. Pairs that begin too close need only keep this distance.
    pub fn measure_start(&mut self, state: State<'_>, segment: MotionSegment) {
        self.known.start.clear();
        (self.start_overlap, self.start_hit) = (0.0, None);
        let found = self.near(state, segment, |world, group, seen| {
            world.depth(segment, group, seen).map_or(world.kept_from(segment, seen), |depth| -depth)
        });
        for (seen, p) in found {
            let distance = p.contact.distance;
            if distance >= self.kept_from(segment, seen) {
                continue;
            }
            self.known.start.reduce(self.place_of(p.group, seen), distance);
            if self.depth(segment, p.group, seen).is_none() && -distance > self.start_overlap {
                self.start_overlap = -distance;
                self.start_hit = Some(self.hit(&p));
            }
        }
    }

    /// Records overlaps of picked bodies with their supports.
    pub(super) fn measure_picked(&mut self, x: &Row) {
        self.known.picked.clear();
        let Some(first) = self.schedule.first_after_actuation() else { return };
        let picked = |world: &Self, group: usize| matches!(world.objects.groups[group], Group::Riding(b) if world.problem.bodies[b].role != Role::Attached);
        let is_picked = |world: &Self, group: usize, seen: Seen| match seen {
            Seen::Body(_) => picked(world, group),
            Seen::Pair(pair) => {
                let (a, b) = world.objects.pairs[pair];
                // Overlaps with the robot are not recorded: a body inside the arm cannot be grasped.
                (picked(world, a) || picked(world, b)) && !matches!(world.objects.groups[a], Group::Link(_))
            }
        };
        let reach = |world: &Self, group: usize, seen: Seen| {
            if is_picked(world, group, seen) { world.checked(first, group, seen, 0.0) } else { f64::NEG_INFINITY }
        };
        for (seen, p) in self.near(State::still(x), first, reach) {
            if p.contact.distance < 0.0 {
                self.known.picked.reduce(self.place_of(p.group, seen), p.contact.distance);
            }
        }
    }

    /// Returns the depths (m) of the checked overlaps in a state.
    pub fn overlaps(&mut self, state: State<'_>, segment: MotionSegment) -> Vec<Overlap> {
        let found = self.near(state, segment, |world, group, seen| world.checked(segment, group, seen, -TOUCH));
        found.iter().map(|(seen, p)| Overlap { group: p.group, seen: *seen, depth: -p.contact.distance }).collect()
    }

    /// Returns the first checked pair closer than its margin, if any.
    pub fn hit_at(&mut self, state: State<'_>, segment: MotionSegment, margins: &Margins) -> Option<Hit> {
        self.place(state, segment);
        let mut found = None;
        self.look(
            segment,
            EXACT,
            |world, group, seen| world.asked(segment, margins, group, seen),
            |_, _, p| {
                found = Some(*p);
                false
            },
        );
        found.map(|p| self.hit(&p))
    }

    /// Returns the margins for the motion between two states: `clearance`, or the distance at either end if it is
    /// smaller. An overlap does not reduce the margin, since the motion cannot end there. Links whose shapes prevent
    /// the margin need only stay free of collisions.
    pub fn margins_between(&mut self, ends: [State<'_>; 2], segment: MotionSegment, clearance: f64) -> Margins {
        let mut out = Margins::plain(clearance);
        let (robot, least) = (&*self.problem.robot, clearance.min(self.problem.options.margin));
        for state in ends {
            let found = self.near(state, segment, |world, group, seen| {
                world.checked(segment, group, seen, world.kept_from(segment, seen).max(clearance))
            });
            for (seen, p) in found.iter().filter(|(_, p)| p.contact.distance >= -TOUCH) {
                out.smaller.reduce(self.place_of(p.group, *seen), p.contact.distance - TOUCH);
            }
        }
        for (pair, groups) in self.objects.pairs.iter().enumerate() {
            if robot.is_often_close(*groups, least) {
                out.smaller.reduce(self.place_of(groups.0, Seen::Pair(pair)), -TOUCH);
            }
        }
        out
    }

    /// Adds to `margins` the distances in `there` of pairs that overlapped at the start and have been separated.
    pub fn keep_apart(&self, margins: &mut Margins, there: Margins) {
        for (place, margin) in there.smaller.iter().filter(|(place, _)| self.known.start.get(*place).is_finite()) {
            margins.smaller.reduce(place, margin);
        }
    }

    /// Returns the pairs that may not touch and are closer than `clearance` (m) in a state, and the permitted overlaps.
    /// Each has its distance or depth (m), and whether the pair may touch.
    pub fn nearest(&mut self, state: State<'_>, segment: MotionSegment, clearance: f64) -> Vec<(Hit, bool)> {
        let found =
            self.near(
                state,
                segment,
                |world, group, seen| {
                    if world.depth(segment, group, seen).is_some() { 0.0 } else { clearance }
                },
            );
        let may_touch = |seen: Seen, group: usize| {
            let guess = matches!(seen, Seen::Pair(pair) if self.is_guess(segment, pair));
            guess || self.depth(segment, group, seen).is_some()
        };
        found.iter().map(|(seen, p)| (self.hit(p), may_touch(*seen, p.group))).collect()
    }

    /// Updates the smallest distances with those of a state. Pairs whose position is estimated are left out.
    pub fn measure(&mut self, state: State<'_>, segment: MotionSegment, out: &mut Clearances) {
        // Only distances below the smallest ones found so far matter.
        let (table, object, itself) = (out.table.min(1.0), out.object.min(1.0), out.itself.min(1.0));
        let kind = |world: &Self, seen: Seen| match seen {
            Seen::Body(b) if world.problem.bodies[b].role == Role::Table => Kind::Table,
            Seen::Body(_) => Kind::Object,
            Seen::Pair(pair) => match world.objects.groups[world.objects.pairs[pair].1] {
                Group::Moved(_) => Kind::Object,
                Group::Link(_) | Group::Riding(_) => Kind::Itself,
            },
        };
        let reach = |world: &Self, group: usize, seen: Seen| match kind(world, seen) {
            _ if world.depth(segment, group, seen).is_some() => f64::NEG_INFINITY,
            _ if matches!(seen, Seen::Pair(pair) if world.is_guess(segment, pair)) => f64::NEG_INFINITY,
            Kind::Table => table,
            Kind::Object => object,
            Kind::Itself => itself,
        };
        for (seen, p) in self.near(state, segment, reach) {
            let least = match kind(self, seen) {
                Kind::Table => &mut out.table,
                Kind::Object => &mut out.object,
                Kind::Itself => &mut out.itself,
            };
            *least = least.min(p.contact.distance);
        }
    }
}

/// A pair whose overlap exceeds rounding errors.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Overlap {
    group: usize,
    seen: Seen,
    /// Depth of the overlap (m).
    depth: f64,
}

impl Overlap {
    fn among(&self, others: &[Self]) -> Option<Self> {
        others.iter().copied().find(|other| other.group == self.group && other.seen == self.seen)
    }

    /// Whether this pair is missing in the list of earlier overlaps.
    pub fn is_new(&self, before: &[Self]) -> bool {
        self.among(before).is_none()
    }

    /// Whether this pair is in the list of earlier overlaps, and overlaps no deeper now.
    pub fn lessens(&self, before: &[Self]) -> bool {
        self.among(before).is_some_and(|other| self.depth <= other.depth + 0.1 * TOUCH)
    }
}

/// Kind of pair, by which a report classifies distances.
enum Kind {
    Table,
    Object,
    Itself,
}

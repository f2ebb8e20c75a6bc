//! Questions about one state: what touches, how deep, how near.

use gensim2_geometry::{Proximity, Target};

use super::rules::{Group, Verdict};
use super::{EXACT, GUESSED, Hit, Leg, Margins, State, TOUCH, World};
use crate::Role;
use crate::model::Row;

/// Smallest signed distances over what was checked.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Clearances {
    pub itself: f64,
    pub table: f64,
    pub object: f64,
}

/// What a visit to a near thing is about.
#[derive(Debug, Clone, Copy)]
pub(super) enum Seen {
    Body(usize),
    Pair(usize),
}

impl World<'_> {
    /// Visits what is judged in a leg as things are placed: `reach` says how near (m) something has to be, `visit`
    /// whether to go on.
    pub(super) fn look(
        &mut self,
        leg: Leg,
        coarse: f64,
        reach: impl Fn(&Self, usize, Seen) -> f64,
        mut visit: impl FnMut(&Self, Seen, &Proximity) -> bool,
    ) -> bool {
        let mut scratch = std::mem::take(&mut self.scratch);
        let world = &*self;
        let table = world.table(leg);
        let bodies = world.problem.bodies.len();
        let judged = |group: usize, body: usize| match table.bodies[group * bodies + body] {
            Verdict::Judged => reach(world, group, Seen::Body(body)),
            Verdict::MayTouch | Verdict::Apart => f64::NEG_INFINITY,
        };
        let whole =
            world.shapes.near_bodies(&table.present, world.obstacles, &mut scratch, coarse, judged, |p| {
                match p.target {
                    Target::Body(b) => visit(world, Seen::Body(b), &p),
                    Target::Group(_) => true,
                }
            }) && world.shapes.near_pairs(
                &world.cast.pairs,
                &table.pairs,
                &mut scratch,
                coarse,
                |pair| reach(world, world.cast.pairs[pair].0, Seen::Pair(pair)),
                |pair, p| visit(world, Seen::Pair(pair), &p),
            );
        self.scratch = scratch;
        whole
    }

    /// What margins ask of a group and something else in a leg.
    pub(super) fn asked(&self, leg: Leg, margins: &Margins, group: usize, seen: Seen) -> f64 {
        match seen {
            Seen::Body(body) => margins.body(&self.known, group, body, self.kept_from(leg, seen)),
            Seen::Pair(pair) if self.is_guess(leg, pair) => margins.pair(&self.known, pair).min(-GUESSED),
            Seen::Pair(pair) => margins.pair(&self.known, pair),
        }
    }

    /// Clearance (m) that is kept in a leg from what the hand reaches for, zero from all else.
    fn kept_from(&self, leg: Leg, seen: Seen) -> f64 {
        match seen {
            Seen::Body(body) if self.table(leg).reached[body] => self.reach_clearance(),
            Seen::Body(_) | Seen::Pair(_) => 0.0,
        }
    }

    /// Whether where one of a pair is in a leg is a guess.
    fn is_guess(&self, leg: Leg, pair: usize) -> bool {
        self.table(leg).guessed && matches!(self.cast.groups[self.cast.pairs[pair].1], Group::Moved(_))
    }

    /// Takes what is too near in a state for what is so at the start.
    pub fn measure_start(&mut self, state: State<'_>, leg: Leg) {
        self.known.start_bodies.fill(f64::INFINITY);
        self.known.start_pairs.fill(f64::INFINITY);
        self.start_overlap = 0.0;
        self.place(state, leg);
        let mut found = Vec::new();
        self.look(
            leg,
            EXACT,
            |world, _, seen| world.kept_from(leg, seen),
            |world, seen, p| {
                if p.contact.distance < world.kept_from(leg, seen) {
                    found.push((p.group, seen, p.contact.distance));
                }
                true
            },
        );
        for (group, seen, distance) in found {
            match seen {
                Seen::Body(body) => self.known.start_bodies[group * self.known.bodies + body] = distance,
                Seen::Pair(pair) => self.known.start_pairs[pair] = distance,
            }
            self.start_overlap = self.start_overlap.max(-distance);
        }
    }

    /// Overlaps of what is picked with what it lies on.
    pub(super) fn measure_picked(&mut self, x: &Row) {
        self.known.picked_bodies.fill(f64::INFINITY);
        self.known.picked_pairs.fill(f64::INFINITY);
        let Some(first) = self.course.first_after_actuation() else { return };
        self.place(State::still(x), first);
        let mut found = Vec::new();
        let picked = |world: &Self, group: usize| matches!(world.cast.groups[group], Group::Riding(b) if world.problem.bodies[b].role != Role::Attached);
        let is_picked = |world: &Self, group: usize, seen: Seen| match seen {
            Seen::Body(_) => picked(world, group),
            Seen::Pair(pair) => {
                let (a, b) = world.cast.pairs[pair];
                // Not what holds it: inside the arm nothing can be held.
                (picked(world, a) || picked(world, b)) && !matches!(world.cast.groups[a], Group::Link(_))
            }
        };
        let reach = |world: &Self, group: usize, seen: Seen| {
            if is_picked(world, group, seen) { 0.0 } else { f64::NEG_INFINITY }
        };
        self.look(first, EXACT, reach, |_, seen, p| {
            if p.contact.distance < 0.0 {
                found.push((p.group, seen, p.contact.distance));
            }
            true
        });
        for (group, seen, distance) in found {
            match seen {
                Seen::Body(body) => self.known.picked_bodies[group * self.known.bodies + body] = distance,
                Seen::Pair(pair) => self.known.picked_pairs[pair] = distance,
            }
        }
    }

    /// Depth (m) of the deepest judged overlap, zero where there is none.
    pub fn overlap(&mut self, state: State<'_>, leg: Leg) -> f64 {
        self.place(state, leg);
        let mut deepest: f64 = 0.0;
        self.look(
            leg,
            EXACT,
            |_, _, _| 0.0,
            |_, _, p| {
                deepest = deepest.max(-p.contact.distance);
                true
            },
        );
        deepest
    }

    /// The first judged pair nearer than its margin, if any.
    pub fn hit_at(&mut self, state: State<'_>, leg: Leg, margins: &Margins) -> Option<Hit> {
        self.place(state, leg);
        let mut found = None;
        self.look(
            leg,
            EXACT,
            |world, group, seen| world.asked(leg, margins, group, seen),
            |_, _, p| {
                found = Some(*p);
                false
            },
        );
        found.map(|p| self.hit(&p))
    }

    /// Margins for the free motion between two poses: `clearance`, or what either end leaves where that is less.
    pub fn margins_between(&mut self, a: &Row, b: &Row, leg: Leg, clearance: f64) -> Margins {
        let mut out = Margins::plain(clearance);
        for x in [a, b] {
            self.place(State::still(x), leg);
            self.look(
                leg,
                EXACT,
                |world, _, seen| world.kept_from(leg, seen).max(clearance),
                |_, seen, p| {
                    let left = (p.contact.distance - TOUCH).max(-TOUCH);
                    match seen {
                        Seen::Body(body) => out.bodies.push(((p.group, body), left)),
                        Seen::Pair(pair) => out.pairs.push((pair, left)),
                    }
                    true
                },
            );
        }
        out
    }

    /// Adds the distances in a state to the smallest so far; those of guesses are left out.
    pub fn measure(&mut self, state: State<'_>, leg: Leg, out: &mut Clearances) {
        self.place(state, leg);
        // Only what is nearer than the smallest so far matters.
        let (table, object, itself) = (out.table.min(1.0), out.object.min(1.0), out.itself.min(1.0));
        let kind = |world: &Self, seen: Seen| match seen {
            Seen::Body(b) if world.problem.bodies[b].role == Role::Table => Kind::Table,
            Seen::Body(_) => Kind::Object,
            Seen::Pair(pair) => match world.cast.groups[world.cast.pairs[pair].1] {
                Group::Moved(_) => Kind::Object,
                Group::Link(_) | Group::Riding(_) => Kind::Itself,
            },
        };
        let reach = |world: &Self, _: usize, seen: Seen| match kind(world, seen) {
            _ if matches!(seen, Seen::Pair(pair) if world.is_guess(leg, pair)) => f64::NEG_INFINITY,
            Kind::Table => table,
            Kind::Object => object,
            Kind::Itself => itself,
        };
        self.look(leg, EXACT, reach, |world, seen, p| {
            let least = match kind(world, seen) {
                Kind::Table => &mut out.table,
                Kind::Object => &mut out.object,
                Kind::Itself => &mut out.itself,
            };
            *least = least.min(p.contact.distance);
            true
        });
    }
}

/// What a distance is reported as.
enum Kind {
    Table,
    Object,
    Itself,
}

//! Distances between moving and fixed bodies, and between moving bodies.

use nalgebra::{Point3, Vector3};

use crate::distance::{Depth, measured};
use crate::{Aabb, Contact, Convex, Corners, Obstacles, Pose, Robot};

/// A fixed body or another group near a group.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Target {
    /// Index of a fixed body.
    Body(usize),
    /// Index of another group.
    Group(usize),
}

/// A group and the body or group near it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Proximity {
    /// The group.
    pub group: usize,
    /// The nearby body or group.
    pub target: Target,
    /// Closest or deepest points, base frame. The normal points from the group to the target.
    pub contact: Contact,
}

struct Piece<'a> {
    group: usize,
    shape: &'a Convex,
}

/// Groups of convex pieces. Each group moves rigidly: a link of a robot, an attached body, or a part of an object.
pub struct MovingShapes<'a> {
    pieces: Vec<Piece<'a>>,
    /// Index range of the pieces of each group.
    ranges: Vec<(usize, usize)>,
}

/// Buffers of collision queries, reused to avoid memory allocation.
#[derive(Default)]
pub struct Scratch {
    poses: Vec<Pose>,
    /// Boxes around each piece and around each group.
    boxes: Vec<Aabb>,
    group_boxes: Vec<Aabb>,
    corners: Vec<Corners>,
    placed: Vec<bool>,
    best: Vec<f64>,
    nearest: Vec<Option<Contact>>,
    /// Last direction from each piece to a nearby shape, used as initial guess; empty if directions are not remembered.
    hints: Vec<Vector3<f64>>,
    early_exit: bool,
}

/// Number of remembered directions. Several pairs may share an entry, because any direction is a valid guess.
const HINTS: usize = 4096;

impl Scratch {
    /// Returns buffers that remember directions from one query to the next, which is faster if bodies move little
    /// between the queries.
    #[must_use]
    pub fn remembering() -> Self {
        Self { hints: vec![Vector3::zeros(); HINTS], ..Self::default() }
    }

    /// Sets whether queries may return any shapes within reach instead of the closest ones. This is faster for callers
    /// that only need to know whether such shapes exist.
    pub fn set_early_exit(&mut self, early_exit: bool) {
        self.early_exit = early_exit;
    }

    /// Required accuracy of penetration depths.
    fn depth(&self) -> Depth {
        if self.early_exit { Depth::AtLeast } else { Depth::Measured }
    }

    /// Poses of the groups given by the last call of `place`.
    #[must_use]
    pub fn poses(&self) -> &[Pose] {
        &self.poses
    }

    /// Returns the last direction from a piece to another shape, or a guess if none is remembered.
    fn toward(&self, piece: usize, other: usize, guess: impl FnOnce() -> Vector3<f64>) -> Vector3<f64> {
        match self.hints.get(slot(piece, other)) {
            Some(hint) if *hint != Vector3::zeros() => *hint,
            _ => guess(),
        }
    }

    fn remember(&mut self, piece: usize, other: usize, direction: Vector3<f64>) {
        if let Some(hint) = self.hints.get_mut(slot(piece, other)) {
            *hint = direction;
        }
    }
}

fn slot(piece: usize, other: usize) -> usize {
    (piece * 257 + other) % HINTS
}

impl<'a> MovingShapes<'a> {
    /// Creates groups from their shapes, given in the group's frame. Groups without shapes keep their index.
    #[must_use]
    pub fn new(groups: impl IntoIterator<Item = &'a [Convex]>) -> Self {
        let mut out = Self { pieces: Vec::new(), ranges: Vec::new() };
        for (group, shapes) in groups.into_iter().enumerate() {
            let start = out.pieces.len();
            out.pieces.extend(shapes.iter().map(|shape| Piece { group, shape }));
            out.ranges.push((start, out.pieces.len()));
        }
        out
    }

    /// Number of groups.
    #[must_use]
    pub fn len(&self) -> usize {
        self.ranges.len()
    }

    /// Whether there are no groups.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.ranges.is_empty()
    }

    fn shapes_of(&self, group: usize) -> &[Piece<'a>] {
        self.ranges.get(group).map_or(&[], |(start, end)| &self.pieces[*start..*end])
    }

    /// Whether a group has no shapes or does not exist.
    #[must_use]
    pub fn is_bare(&self, group: usize) -> bool {
        self.shapes_of(group).is_empty()
    }

    /// Centre of the box around a group's shapes, group frame; the origin for a group without shapes.
    #[must_use]
    pub fn middle(&self, group: usize) -> Point3<f64> {
        if self.is_bare(group) {
            return Point3::origin();
        }
        let bounds = self
            .shapes_of(group)
            .iter()
            .map(|p| p.shape.aabb_at(&Pose::identity()))
            .fold(Aabb::EMPTY, |a, b| a.union(&b));
        nalgebra::center(&bounds.min, &bounds.max)
    }

    /// Maximum distance (m) between the point `from` in a group's frame and any point of the group's shapes.
    #[must_use]
    pub fn extent(&self, group: usize, from: &Point3<f64>) -> f64 {
        self.shapes_of(group)
            .iter()
            .flat_map(|piece| piece.shape.points().iter().map(|p| (p - from).norm() + piece.shape.radius()))
            .fold(0.0, f64::max)
    }

    /// Places groups for the following queries: `poses` writes one pose for each group (base frame), of which `present`
    /// lists the groups to place. Groups without a pose are ignored by the queries.
    pub fn place(&self, present: &[usize], scratch: &mut Scratch, poses: impl FnOnce(&mut Vec<Pose>)) {
        poses(&mut scratch.poses);
        scratch.boxes.resize(self.pieces.len(), Aabb::EMPTY);
        scratch.group_boxes.clear();
        scratch.group_boxes.resize(self.ranges.len(), Aabb::EMPTY);
        for &group in present {
            let (Some(&(start, end)), Some(pose)) = (self.ranges.get(group), scratch.poses.get(group)) else {
                continue;
            };
            let mut around = Aabb::EMPTY;
            for piece in start..end {
                let bounds = self.pieces[piece].shape.aabb_at(pose);
                around = around.union(&bounds);
                scratch.boxes[piece] = bounds;
            }
            scratch.group_boxes[group] = around;
        }
        scratch.placed.clear();
        scratch.placed.resize(self.pieces.len(), false);
        scratch.corners.resize_with(self.pieces.len(), Corners::default);
    }

    /// Index range of the placed pieces of a group; empty if it was not placed, or if `scratch` belongs to other
    /// shapes.
    fn placed(&self, group: usize, scratch: &Scratch) -> std::ops::Range<usize> {
        let same = scratch.boxes.len() == self.pieces.len() && scratch.group_boxes.len() == self.ranges.len();
        match self.ranges.get(group) {
            Some(&(start, end)) if same && scratch.group_boxes[group] != Aabb::EMPTY => start..end,
            _ => 0..0,
        }
    }

    fn ensure(&self, piece: usize, scratch: &mut Scratch) {
        if !scratch.placed[piece] {
            let p = &self.pieces[piece];
            p.shape.corners_at(&scratch.poses[p.group], &mut scratch.corners[piece]);
            scratch.placed[piece] = true;
        }
    }

    /// Calls `visit` for each group of `groups` within `reach(group, body)` of an obstacle, once for each group and
    /// body, with the closest shapes. A reach of negative infinity means that the pair is not checked. `visit` returns
    /// whether to continue; the result is false if it stopped. With `early_exit`, `visit` is called only for the first
    /// shapes of a group within reach of any obstacle. Shapes whose boxes are more than `coarse` (m) apart are not
    /// measured exactly; the distance of their boxes, a lower bound, is reported instead.
    pub fn near_bodies(
        &self,
        groups: &[usize],
        obstacles: &Obstacles,
        scratch: &mut Scratch,
        coarse: f64,
        reach: impl Fn(usize, usize) -> f64,
        mut visit: impl FnMut(Proximity) -> bool,
    ) -> bool {
        let mut nearest = std::mem::take(&mut scratch.nearest);
        let mut best = std::mem::take(&mut scratch.best);
        let mut whole = true;
        for &group in groups {
            let pieces = self.placed(group, scratch);
            if pieces.is_empty() {
                continue;
            }
            best.clear();
            best.extend((0..obstacles.len()).map(|b| reach(group, b)));
            let furthest = best.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            if furthest == f64::NEG_INFINITY {
                continue;
            }
            let mut any = false;
            for piece in pieces {
                if any && scratch.early_exit {
                    break;
                }
                let bounds = scratch.boxes[piece];
                obstacles.tree.near(&bounds, furthest.max(0.0), |e| {
                    if any && scratch.early_exit {
                        return;
                    }
                    let element = &obstacles.elements[e];
                    let limit = best[element.body];
                    if limit == f64::NEG_INFINITY {
                        return;
                    }
                    let apart = bounds.distance_squared(&element.bounds).sqrt();
                    if apart > 0.0 && apart >= limit {
                        return;
                    }
                    let contact = if apart > coarse {
                        Some(between_boxes(&bounds, &element.bounds, apart))
                    } else {
                        self.ensure(piece, scratch);
                        let mut toward =
                            scratch.toward(piece, e, || element.center - nalgebra::center(&bounds.min, &bounds.max));
                        let found = measured(
                            (&scratch.corners[piece], self.pieces[piece].shape.radius()),
                            (&element.corners, element.radius),
                            &mut toward,
                            limit,
                            scratch.depth(),
                        );
                        scratch.remember(piece, e, toward);
                        found.filter(|contact| contact.distance < limit)
                    };
                    if let Some(contact) = contact {
                        best[element.body] = contact.distance;
                        if !any {
                            nearest.clear();
                            nearest.resize(obstacles.len(), None);
                            any = true;
                        }
                        nearest[element.body] = Some(contact);
                    }
                });
            }
            let seen = if any { nearest.as_slice() } else { &[] };
            whole = seen.iter().enumerate().all(|(body, contact)| {
                contact.is_none_or(|contact| visit(Proximity { group, target: Target::Body(body), contact }))
            });
            if !whole {
                break;
            }
        }
        scratch.nearest = nearest;
        scratch.best = best;
        whole
    }

    /// Calls `visit` for each pair of groups in `pairs` within `reach(pair)` (m) of each other, as
    /// [`MovingShapes::near_bodies`] does for obstacles. `which` selects the pairs; `reach` and `visit` receive the
    /// index of a pair in `pairs`.
    pub fn near_pairs(
        &self,
        pairs: &[(usize, usize)],
        which: &[usize],
        scratch: &mut Scratch,
        coarse: f64,
        reach: impl Fn(usize) -> f64,
        mut visit: impl FnMut(usize, Proximity) -> bool,
    ) -> bool {
        for &index in which {
            let Some(&(a, b)) = pairs.get(index) else { continue };
            if let Some(contact) = self.nearest_of(a, b, scratch, coarse, reach(index))
                && !visit(index, Proximity { group: a, target: Target::Group(b), contact })
            {
                return false;
            }
        }
        true
    }

    /// Returns the closest shapes of two groups, if their distance is at most `limit`.
    fn nearest_of(&self, a: usize, b: usize, scratch: &mut Scratch, coarse: f64, mut limit: f64) -> Option<Contact> {
        if limit == f64::NEG_INFINITY {
            return None;
        }
        let (mine, theirs) = (self.placed(a, scratch), self.placed(b, scratch));
        if mine.is_empty() || theirs.is_empty() {
            return None;
        }
        let (one, two) = (scratch.group_boxes[a], scratch.group_boxes[b]);
        let apart = one.distance_squared(&two).sqrt();
        if apart > 0.0 && apart >= limit {
            return None;
        }
        if apart > coarse {
            return Some(between_boxes(&one, &two, apart));
        }
        let mut nearest = None;
        for i in mine {
            let mine = scratch.boxes[i];
            let apart = mine.distance_squared(&two).sqrt();
            if apart > 0.0 && apart >= limit {
                continue;
            }
            for j in theirs.clone() {
                let theirs = scratch.boxes[j];
                let apart = mine.distance_squared(&theirs).sqrt();
                if apart > 0.0 && apart >= limit {
                    continue;
                }
                if apart > coarse {
                    limit = apart;
                    nearest = Some(between_boxes(&mine, &theirs, apart));
                    continue;
                }
                self.ensure(i, scratch);
                self.ensure(j, scratch);
                // In the table of directions, entries of bodies start at the beginning, entries of pieces at the end.
                let other = HINTS - 1 - j % HINTS;
                let mut toward = scratch.toward(i, other, || {
                    nalgebra::center(&theirs.min, &theirs.max) - nalgebra::center(&mine.min, &mine.max)
                });
                let found = measured(
                    (&scratch.corners[i], self.pieces[i].shape.radius()),
                    (&scratch.corners[j], self.pieces[j].shape.radius()),
                    &mut toward,
                    limit,
                    scratch.depth(),
                );
                scratch.remember(i, other, toward);
                if let Some(contact) = found
                    && contact.distance < limit
                {
                    limit = contact.distance;
                    nearest = Some(contact);
                    if scratch.early_exit {
                        return nearest;
                    }
                }
            }
        }
        nearest
    }
}

/// Returns a lower bound of the distance between two shapes, computed from the boxes around them.
fn between_boxes(a: &Aabb, b: &Aabb, apart: f64) -> Contact {
    let (on_first, on_second) = (nalgebra::center(&a.min, &a.max), nalgebra::center(&b.min, &b.max));
    let normal = (on_second - on_first).try_normalize(0.0).unwrap_or_else(Vector3::x);
    Contact { distance: apart, on_first, on_second, normal }
}

/// Returns the pairs of links (lower index first) to check against each other: both have shapes, `changes` returns that
/// one can move relative to the other, and the robot does not allow them to touch.
#[must_use]
pub fn checked_pairs(robot: &Robot, changes: impl Fn(usize, usize) -> bool) -> Vec<(usize, usize)> {
    let links = robot.links();
    let allowed = robot.allowed_pairs();
    let mut pairs = Vec::new();
    for a in 0..links.len() {
        for b in a + 1..links.len() {
            let shaped = !links[a].shapes.is_empty() && !links[b].shapes.is_empty();
            if shaped && changes(a, b) && allowed.binary_search(&(a, b)).is_err() {
                pairs.push((a, b));
            }
        }
    }
    pairs
}

//! Distances of a posed robot to a scene and to itself.

use nalgebra::{Point3, Vector3};

use crate::{Aabb, Bvh, Contact, Convex, Corners, Pose, Robot, signed_distance};

/// What a link is near to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Target {
    /// Body of the scene, by index.
    Body(usize),
    /// Another link of the robot, by index.
    Link(usize),
}

/// A link and something near it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Proximity {
    /// Link of the robot.
    pub link: usize,
    /// What it is near to.
    pub target: Target,
    /// Nearest or deepest points, base frame; the normal points from the link to the target.
    pub contact: Contact,
}

struct Element {
    corners: Corners,
    radius: f64,
    center: Point3<f64>,
    bounds: Aabb,
    body: usize,
}

/// Bodies that stand still in the base frame, under one broad phase.
#[derive(Default)]
pub struct Scene {
    elements: Vec<Element>,
    tree: Bvh,
    bodies: usize,
}

impl Scene {
    /// Scene of bodies, each its shapes (body frame) and its pose in the base frame.
    #[must_use]
    pub fn new<'a>(bodies: impl IntoIterator<Item = (&'a [Convex], &'a Pose)>) -> Self {
        let mut scene = Self::default();
        for (index, (shapes, pose)) in bodies.into_iter().enumerate() {
            scene.bodies = index + 1;
            scene.elements.extend(shapes.iter().map(|s| {
                let shape = s.moved(pose);
                Element {
                    bounds: shape.aabb_at(&Pose::identity()),
                    corners: Corners::of(shape.points()),
                    radius: shape.radius(),
                    center: *shape.center(),
                    body: index,
                }
            }));
        }
        let boxes: Vec<Aabb> = scene.elements.iter().map(|e| e.bounds).collect();
        scene.tree = Bvh::new(&boxes);
        scene
    }

    /// Number of bodies.
    #[must_use]
    pub fn len(&self) -> usize {
        self.bodies
    }

    /// Whether there are no bodies.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.bodies == 0
    }
}

struct Piece {
    link: usize,
    shape: Convex,
}

/// The convex pieces of a robot's links, and which pairs of links can collide at all.
pub struct RobotShapes {
    pieces: Vec<Piece>,
    /// Range of pieces of each link.
    ranges: Vec<(usize, usize)>,
    pairs: Vec<(usize, usize)>,
}

/// Memory reused between queries.
#[derive(Default)]
pub struct Scratch {
    poses: Vec<Pose>,
    boxes: Vec<Aabb>,
    corners: Vec<Corners>,
    placed: Vec<bool>,
    best: Vec<f64>,
    /// Directions from pieces to what is near them, as last found; none where they are not remembered.
    hints: Vec<Vector3<f64>>,
}

/// Directions are remembered in a table of this size. Pairs may share a place there: any direction is a guess.
const HINTS: usize = 4096;

impl Scratch {
    /// Memory that keeps the directions of one query for the next: quicker where the robot moves little between them.
    #[must_use]
    pub fn remembering() -> Self {
        Self { hints: vec![Vector3::zeros(); HINTS], ..Self::default() }
    }

    /// Direction from a piece to something else as last found, or a guess.
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

impl RobotShapes {
    /// Shapes of a robot. `changes(a, b)` says whether one link can move against the other in what is planned: pairs
    /// that cannot are left out.
    #[must_use]
    pub fn new(robot: &Robot, changes: impl Fn(usize, usize) -> bool) -> Self {
        let links = robot.links();
        let mut pieces = Vec::new();
        let mut ranges = Vec::new();
        for (link, l) in links.iter().enumerate() {
            let start = pieces.len();
            pieces.extend(l.shapes.iter().map(|s| Piece { link, shape: s.clone() }));
            ranges.push((start, pieces.len()));
        }
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
        Self { pieces, ranges, pairs }
    }

    /// Pairs of links that are judged against each other.
    #[must_use]
    pub fn self_pairs(&self) -> &[(usize, usize)] {
        &self.pairs
    }

    /// Adds shapes that ride on a link, e.g. a grasped object, in the link's frame.
    pub fn attach(&mut self, link: usize, shapes: &[Convex]) {
        let mut all: Vec<Vec<Piece>> = self.ranges.iter().map(|_| Vec::new()).collect();
        for piece in self.pieces.drain(..) {
            all[piece.link].push(piece);
        }
        all[link].extend(shapes.iter().map(|s| Piece { link, shape: s.clone() }));
        self.ranges.clear();
        for pieces in all {
            let start = self.pieces.len();
            self.pieces.extend(pieces);
            self.ranges.push((start, self.pieces.len()));
        }
    }

    /// Middle of the box around a link's shapes, link frame.
    #[must_use]
    pub fn middle(&self, link: usize) -> Point3<f64> {
        let (start, end) = self.ranges[link];
        let bounds = self.pieces[start..end]
            .iter()
            .map(|p| p.shape.aabb_at(&Pose::identity()))
            .fold(Aabb::EMPTY, |a, b| a.union(&b));
        if start == end { Point3::origin() } else { nalgebra::center(&bounds.min, &bounds.max) }
    }

    /// Largest distance (m) of any point of a link's shapes from a point of the link frame.
    #[must_use]
    pub fn extent(&self, link: usize, from: &Point3<f64>) -> f64 {
        let (start, end) = self.ranges[link];
        self.pieces[start..end]
            .iter()
            .flat_map(|piece| piece.shape.points().iter().map(|p| (p - from).norm() + piece.shape.radius()))
            .fold(0.0, f64::max)
    }

    /// Poses the robot for the queries that follow.
    pub fn place(&self, robot: &Robot, q: &[f64], scratch: &mut Scratch) {
        robot.link_poses(q, &mut scratch.poses);
        scratch.boxes.clear();
        for piece in &self.pieces {
            scratch.boxes.push(piece.shape.aabb_at(&scratch.poses[piece.link]));
        }
        scratch.placed.clear();
        scratch.placed.resize(self.pieces.len(), false);
        scratch.corners.resize_with(self.pieces.len(), Corners::default);
    }

    fn ensure(&self, piece: usize, scratch: &mut Scratch) {
        if !scratch.placed[piece] {
            let p = &self.pieces[piece];
            p.shape.corners_at(&scratch.poses[p.link], &mut scratch.corners[piece]);
            scratch.placed[piece] = true;
        }
    }

    /// Calls `visit` for judged links that come within `reach(link, body)` of a body of the scene: once a body and
    /// link, with the nearest shapes. A negative infinite reach means that the pair is not judged. `visit` returns
    /// whether to go on; the result is false where it stopped. Shapes whose boxes are more than `coarse` (m) apart are
    /// not measured: the distance of their boxes, which is never more than theirs, stands in for it.
    pub fn near_bodies(
        &self,
        scene: &Scene,
        scratch: &mut Scratch,
        coarse: f64,
        reach: impl Fn(usize, usize) -> f64,
        mut visit: impl FnMut(Proximity) -> bool,
    ) -> bool {
        for (link, &(start, end)) in self.ranges.iter().enumerate() {
            if start == end {
                continue;
            }
            let mut best = std::mem::take(&mut scratch.best);
            best.clear();
            best.extend((0..scene.bodies).map(|b| reach(link, b)));
            let furthest = best.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let mut nearest: Vec<Option<Contact>> = Vec::new();
            if furthest > f64::NEG_INFINITY {
                for piece in start..end {
                    let bounds = scratch.boxes[piece];
                    scene.tree.near(&bounds, furthest.max(0.0), |e| {
                        let element = &scene.elements[e];
                        let limit = best[element.body];
                        if limit == f64::NEG_INFINITY {
                            return;
                        }
                        let apart = bounds.distance_squared(&element.bounds).sqrt();
                        if apart > 0.0 && apart >= limit {
                            return;
                        }
                        if apart > coarse {
                            best[element.body] = apart;
                            if nearest.is_empty() {
                                nearest.resize(scene.bodies, None);
                            }
                            nearest[element.body] = Some(between_boxes(&bounds, &element.bounds, apart));
                            return;
                        }
                        self.ensure(piece, scratch);
                        let mine = &self.pieces[piece].shape;
                        let mut toward =
                            scratch.toward(piece, e, || element.center - nalgebra::center(&bounds.min, &bounds.max));
                        let found = signed_distance(
                            (&scratch.corners[piece], mine.radius()),
                            (&element.corners, element.radius),
                            &mut toward,
                            limit.max(0.0),
                        );
                        scratch.remember(piece, e, toward);
                        if let Some(contact) = found
                            && contact.distance < limit
                        {
                            best[element.body] = contact.distance;
                            if nearest.is_empty() {
                                nearest.resize(scene.bodies, None);
                            }
                            nearest[element.body] = Some(contact);
                        }
                    });
                }
            }
            scratch.best = best;
            for (body, contact) in nearest.iter().enumerate() {
                if let Some(contact) = contact
                    && !visit(Proximity { link, target: Target::Body(body), contact: *contact })
                {
                    return false;
                }
            }
        }
        true
    }

    /// Calls `visit` for pairs of links that come within `reach` (m) of each other, as [`RobotShapes::near_bodies`]
    /// does for bodies. `judged(pair)` leaves pairs out, by their index in [`RobotShapes::self_pairs`].
    pub fn near_self(
        &self,
        scratch: &mut Scratch,
        coarse: f64,
        reach: impl Fn(usize) -> f64,
        mut visit: impl FnMut(usize, Proximity) -> bool,
    ) -> bool {
        for (index, &(a, b)) in self.pairs.iter().enumerate() {
            let mut limit = reach(index);
            if limit == f64::NEG_INFINITY {
                continue;
            }
            let mut nearest = None;
            for i in self.ranges[a].0..self.ranges[a].1 {
                for j in self.ranges[b].0..self.ranges[b].1 {
                    let apart = scratch.boxes[i].distance_squared(&scratch.boxes[j]).sqrt();
                    if apart > 0.0 && apart >= limit {
                        continue;
                    }
                    if apart > coarse {
                        limit = apart;
                        nearest = Some(between_boxes(&scratch.boxes[i], &scratch.boxes[j], apart));
                        continue;
                    }
                    self.ensure(i, scratch);
                    self.ensure(j, scratch);
                    // Bodies count from the start of the table, links from its end.
                    let other = HINTS - 1 - j;
                    let mut toward = scratch.toward(i, other, || {
                        nalgebra::center(&scratch.boxes[j].min, &scratch.boxes[j].max)
                            - nalgebra::center(&scratch.boxes[i].min, &scratch.boxes[i].max)
                    });
                    let found = signed_distance(
                        (&scratch.corners[i], self.pieces[i].shape.radius()),
                        (&scratch.corners[j], self.pieces[j].shape.radius()),
                        &mut toward,
                        limit.max(0.0),
                    );
                    scratch.remember(i, other, toward);
                    if let Some(contact) = found
                        && contact.distance < limit
                    {
                        limit = contact.distance;
                        nearest = Some(contact);
                    }
                }
            }
            if let Some(contact) = nearest
                && !visit(index, Proximity { link: a, target: Target::Link(b), contact })
            {
                return false;
            }
        }
        true
    }

    /// Poses of all links as last placed.
    #[must_use]
    pub fn poses<'a>(&self, scratch: &'a Scratch) -> &'a [Pose] {
        &scratch.poses
    }
}

/// A lower bound of the distance of two shapes, from their boxes.
fn between_boxes(a: &Aabb, b: &Aabb, apart: f64) -> Contact {
    let (on_first, on_second) = (nalgebra::center(&a.min, &a.max), nalgebra::center(&b.min, &b.max));
    let normal = (on_second - on_first).try_normalize(0.0).unwrap_or_else(Vector3::x);
    Contact { distance: apart, on_first, on_second, normal }
}

/// Pairs of links that overlap at `q`.
pub(crate) fn overlapping_pairs(robot: &Robot, q: &[f64]) -> Vec<(usize, usize)> {
    let shapes = RobotShapes::new(robot, |_, _| true);
    let mut scratch = Scratch::default();
    shapes.place(robot, q, &mut scratch);
    let mut out = Vec::new();
    shapes.near_self(
        &mut scratch,
        f64::INFINITY,
        |_| 0.0,
        |index, _| {
            out.push(shapes.pairs[index]);
            true
        },
    );
    out
}

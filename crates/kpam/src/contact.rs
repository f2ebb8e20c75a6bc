//! What may touch what and when, and whether a motion keeps to it.

use gensim2_geometry::{Contact, JointKind, Proximity, Robot, RobotShapes, Scene, Scratch, Target};
use nalgebra::Point3;

use crate::KeypointProblem;
use crate::margins::{Bubble, Margins, Near};
use crate::model::{MOST_JOINTS, Model, Row};
use crate::problem::Role;

/// Distances beyond this (m) are not measured: so far at most can one step of a sweep go.
const REACH: f64 = 0.12;
/// Next to something a step is short, and what is this many times further away, or this much (m), does not matter.
const AHEAD: f64 = 3.0;
const NARROW: f64 = 0.006;
/// Finest step of a sweep: no point of the robot moves more than this between two checks (m).
const FINEST: f64 = 0.0015;
/// Shapes whose boxes are further apart than this (m) count as that far apart.
const COARSE: f64 = 0.02;
/// No stand-ins for distances.
const EXACT: f64 = f64::INFINITY;
/// Overlaps up to this are rounding (m).
pub(crate) const TOUCH: f64 = 1e-4;

/// An overlap that breaks the rules, or a distance for a report.
#[derive(Debug, Clone)]
pub(crate) struct Hit {
    pub first: String,
    pub second: String,
    pub distance: f64,
    pub at: Point3<f64>,
}

/// Smallest signed distances over what was checked.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Clearances {
    pub itself: f64,
    pub table: f64,
    pub object: f64,
}

pub(crate) struct Judge<'p> {
    problem: &'p KeypointProblem,
    model: &'p Model,
    shapes: RobotShapes,
    scene: Scene,
    /// Which bodies of the problem the scene holds (attached ones are left out).
    bodies: Vec<usize>,
    /// Whether variable v moves link l.
    moves: Vec<Vec<bool>>,
    /// Link that carries each variable's joint.
    carrier: Vec<usize>,
    /// Link is the hand or rides on it.
    on_hand: Vec<bool>,
    /// Largest distance of a link's shapes from their middle (m).
    extents: Vec<f64>,
    /// Middle of a link's shapes, link frame.
    centers: Vec<Point3<f64>>,
    spare: Bubble,
    /// Overlaps at the start, by link and scene body, and by self pair: those may persist, not deepen.
    start_bodies: Vec<Vec<f64>>,
    start_self: Vec<f64>,
    pub start_overlap: f64,
    scratch: Scratch,
    q: Vec<f64>,
}

impl<'p> Judge<'p> {
    pub fn new(problem: &'p KeypointProblem, model: &'p Model) -> Self {
        let robot: &Robot = &problem.robot;
        let links = robot.links();
        let carrier: Vec<usize> =
            model.map().indices().iter().map(|j| links.iter().position(|l| l.joint == Some(*j)).unwrap_or(0)).collect();
        let below = |mut link: usize, top: usize| loop {
            if link == top {
                return true;
            }
            match links[link].parent {
                Some(p) => link = p,
                None => return false,
            }
        };
        let moves: Vec<Vec<bool>> = (0..links.len()).map(|l| carrier.iter().map(|c| below(l, *c)).collect()).collect();
        let on_hand: Vec<bool> = (0..links.len()).map(|l| below(l, robot.hand())).collect();
        // Links that the same joints move keep their distance.
        let mut shapes = RobotShapes::new(robot, |a, b| moves[a] != moves[b]);
        let bodies: Vec<usize> =
            (0..problem.bodies.len()).filter(|b| problem.bodies[*b].role != Role::Attached).collect();
        for body in problem.bodies.iter().filter(|b| b.role == Role::Attached) {
            let riding: Vec<_> = body.shapes.iter().map(|s| s.moved(&body.pose)).collect();
            shapes.attach(robot.hand(), &riding);
        }
        let scene = Scene::new(bodies.iter().map(|b| (problem.bodies[*b].shapes.as_slice(), &problem.bodies[*b].pose)));
        let mut judge = Self {
            problem,
            model,
            start_bodies: vec![vec![0.0; bodies.len()]; links.len()],
            start_self: vec![0.0; shapes.self_pairs().len()],
            start_overlap: 0.0,
            shapes,
            scene,
            bodies,
            moves,
            carrier,
            on_hand,
            extents: Vec::new(),
            centers: Vec::new(),
            spare: Bubble::default(),
            scratch: Scratch::remembering(),
            q: Vec::new(),
        };
        judge.centers = (0..links.len()).map(|l| judge.shapes.middle(l)).collect();
        judge.extents = (0..links.len()).map(|l| judge.shapes.extent(l, &judge.centers[l])).collect();
        judge.measure_start();
        judge
    }

    fn measure_start(&mut self) {
        let start = self.model.start();
        self.place(&start);
        let mut body_overlaps = Vec::new();
        let mut scratch = std::mem::take(&mut self.scratch);
        let reach = |link: usize, body: usize| if self.judged(link, body, 0) { 0.0 } else { f64::NEG_INFINITY };
        self.shapes.near_bodies(&self.scene, &mut scratch, EXACT, reach, |p| {
            body_overlaps.push(p);
            true
        });
        let mut self_overlaps = Vec::new();
        self.shapes.near_self(
            &mut scratch,
            EXACT,
            |_| 0.0,
            |i, p| {
                self_overlaps.push((i, p.contact.distance));
                true
            },
        );
        self.scratch = scratch;
        for p in body_overlaps {
            if let Target::Body(b) = p.target {
                self.start_bodies[p.link][b] = p.contact.distance.min(0.0);
                self.start_overlap = self.start_overlap.max(-p.contact.distance);
            }
        }
        for (i, d) in self_overlaps {
            self.start_self[i] = d.min(0.0);
            self.start_overlap = self.start_overlap.max(-d);
        }
    }

    /// Depth (m) of the deepest judged overlap at `x`, zero where there is none.
    pub fn overlap(&mut self, x: &Row, stage: usize) -> f64 {
        self.place(x);
        let mut deepest: f64 = 0.0;
        let mut scratch = std::mem::take(&mut self.scratch);
        let reach = |link: usize, body: usize| if self.judged(link, body, stage) { 0.0 } else { f64::NEG_INFINITY };
        self.shapes.near_bodies(&self.scene, &mut scratch, EXACT, reach, |p| {
            deepest = deepest.max(-p.contact.distance);
            true
        });
        self.shapes.near_self(
            &mut scratch,
            EXACT,
            |_| 0.0,
            |_, p| {
                deepest = deepest.max(-p.contact.distance);
                true
            },
        );
        self.scratch = scratch;
        deepest
    }

    fn place(&mut self, x: &Row) {
        self.model.map().positions(x, &mut self.q);
        self.shapes.place(&self.problem.robot, &self.q, &mut self.scratch);
    }

    /// Whether a link is judged against a body of the scene on the way to keyframe `stage` (1 is the first keyframe;
    /// stage 0 is the start itself).
    fn judged(&self, link: usize, scene_body: usize, stage: usize) -> bool {
        if !self.moves[link].iter().any(|m| *m) {
            return false;
        }
        let body = &self.problem.bodies[self.bodies[scene_body]];
        let before = self.problem.config.pre.len();
        if let Some(windows) = &self.problem.options.contacts {
            let name = &self.problem.robot.links()[link].name;
            return !windows.iter().any(|w| {
                let (from, to) = (self.problem.keyframe_index(&w.from), self.problem.keyframe_index(&w.to));
                w.links.contains(name)
                    && w.bodies.contains(&body.name)
                    && from.is_some_and(|f| f < stage || (f == 0 && stage == 0))
                    && to.is_some_and(|t| stage <= t)
            });
        }
        match body.role {
            Role::Table | Role::ObjectBody | Role::Rigid | Role::Attached => true,
            Role::Target => !self.on_hand[link],
            // Stage `before + 1` leads to the actuation pose: from pre_0 on.
            Role::MovingLink => {
                if stage > before + 1 {
                    false
                } else if stage == before + 1 || before == 0 {
                    !self.on_hand[link]
                } else {
                    true
                }
            }
        }
    }

    fn names(&self, p: &Proximity) -> (String, String) {
        let links = self.problem.robot.links();
        let second = match p.target {
            Target::Body(b) => self.problem.bodies[self.bodies[b]].name.clone(),
            Target::Link(l) => links[l].name.clone(),
        };
        (links[p.link].name.clone(), second)
    }

    fn hit(&self, p: &Proximity) -> Hit {
        let (first, second) = self.names(p);
        let Contact { distance, on_first, on_second, .. } = p.contact;
        Hit { first, second, distance, at: nalgebra::center(&on_first, &on_second) }
    }

    /// The first judged pair nearer than `margin` allows at `x`, if any.
    pub fn at(&mut self, x: &Row, stage: usize, margins: &Margins) -> Option<Hit> {
        self.place(x);
        let mut found = None;
        let mut scratch = std::mem::take(&mut self.scratch);
        let threshold = |link: usize, body: usize| {
            if self.judged(link, body, stage) {
                margins.body(&self.start_bodies, link, body)
            } else {
                f64::NEG_INFINITY
            }
        };
        self.shapes.near_bodies(&self.scene, &mut scratch, EXACT, threshold, |p| {
            found = Some(p);
            false
        });
        if found.is_none() {
            let threshold = |pair: usize| margins.itself(&self.start_self, pair);
            self.shapes.near_self(&mut scratch, EXACT, threshold, |_, p| {
                found = Some(p);
                false
            });
        }
        self.scratch = scratch;
        found.map(|p| self.hit(&p))
    }

    /// A judged pair nearer than its margin at any waypoint but the first, where there is one. One about the middle is
    /// looked at first, then those about the middles of what is left: what blocks a path shows soon.
    pub fn at_any(&mut self, waypoints: &[Row], stage: usize, margins: &Margins) -> Option<Hit> {
        let mut stride = waypoints.len().next_power_of_two();
        while stride > 1 {
            let half = stride / 2;
            for k in (half..waypoints.len()).step_by(stride) {
                if let Some(hit) = self.at(&waypoints[k], stage, margins) {
                    return Some(hit);
                }
            }
            stride = half;
        }
        None
    }

    /// Joint vectors around `x` that are surely free (Quinlan's bubble), or the pair that is nearer than its margin
    /// already. What is further than `reach` (m) counts as that far. The bound: a point at distance r from a joint's
    /// axis moves at most r + d per radian while it stays within d of where it is.
    fn bubble(&mut self, x: &Row, stage: usize, margins: &Margins, reach: f64) -> Result<Bubble, Hit> {
        self.place(x);
        let n = self.model.n();
        let links = self.problem.robot.links();
        let mut bubble = std::mem::take(&mut self.spare);
        bubble.center = *x;
        bubble.n = n;
        bubble.pairs.clear();
        bubble.levers.clear();
        bubble.levers.resize(links.len(), [0.0; MOST_JOINTS]);
        let poses = self.shapes.poses(&self.scratch);
        for v in 0..n {
            let joint = &self.problem.robot.joints()[self.model.map().indices()[v]];
            let frame = &poses[self.carrier[v]];
            let axis = frame.rotation * joint.axis;
            for l in 0..links.len() {
                if !self.moves[l][v] || links[l].shapes.is_empty() {
                    continue;
                }
                bubble.levers[l][v] = match joint.kind {
                    JointKind::Prismatic => 1.0,
                    JointKind::Revolute => {
                        let arm = poses[l] * self.centers[l] - frame.translation.vector;
                        let off = (arm.coords - axis * arm.coords.dot(&axis)).norm();
                        off + self.extents[l]
                    }
                };
            }
        }
        let mut blocked = None;
        // What stands in for a distance has to be more than any margin asks for.
        let coarse = COARSE.max(margins.clearance + NARROW);
        let mut scratch = std::mem::take(&mut self.scratch);
        let within = |link: usize, body: usize| if self.judged(link, body, stage) { reach } else { f64::NEG_INFINITY };
        self.shapes.near_bodies(&self.scene, &mut scratch, coarse, within, |p| {
            let Target::Body(b) = p.target else { return true };
            let gap = p.contact.distance - margins.body(&self.start_bodies, p.link, b);
            if gap < 0.0 {
                blocked = Some(p);
                return false;
            }
            bubble.pairs.push(Near { gap, link: p.link, other: None });
            true
        });
        let pairs = self.shapes.self_pairs();
        if blocked.is_none() {
            self.shapes.near_self(
                &mut scratch,
                coarse,
                |_| reach,
                |index, p| {
                    let gap = p.contact.distance - margins.itself(&self.start_self, index);
                    if gap < 0.0 {
                        blocked = Some(p);
                        return false;
                    }
                    bubble.pairs.push(Near { gap, link: pairs[index].0, other: Some(pairs[index].1) });
                    true
                },
            );
        }
        // What is not near is at least this far.
        for (l, link) in links.iter().enumerate() {
            if !link.shapes.is_empty() {
                bubble.pairs.push(Near { gap: reach - margins.clearance, link: l, other: None });
            }
        }
        self.scratch = scratch;
        match blocked {
            Some(p) => {
                self.spare = bubble;
                Err(self.hit(&p))
            }
            None => Ok(bubble),
        }
    }

    /// Sweeps the straight joint segment from `a` to `b`; the first hit.
    pub fn sweep(&mut self, a: &Row, b: &Row, stage: usize, margins: &Margins) -> Option<Hit> {
        self.sweep_along(&[*a, *b], stage, margins).map(|(_, hit)| hit)
    }

    /// Sweeps the straight joint segments between waypoints; the last free waypoint before the first hit, and the hit.
    pub fn sweep_along(&mut self, waypoints: &[Row], stage: usize, margins: &Margins) -> Option<(usize, Hit)> {
        let n = self.model.n();
        let last = waypoints.len() - 1;
        let at = |t: f64| {
            let k = (t as usize).min(last.saturating_sub(1));
            let (a, b) = (&waypoints[k], &waypoints[(k + 1).min(last)]);
            let mut x = *a;
            for v in 0..n {
                x[v] = a[v] + (t - k as f64) * (b[v] - a[v]);
            }
            x
        };
        let end = last as f64;
        let mut t = 0.0;
        let mut reach = REACH;
        loop {
            let bubble = match self.bubble(&at(t), stage, margins, reach) {
                Ok(bubble) => bubble,
                Err(hit) => return Some(((t.ceil() as usize).saturating_sub(1), hit)),
            };
            let gap = bubble.pairs.iter().map(|p| p.gap).fold(REACH, f64::min);
            reach = (margins.clearance + (AHEAD * gap).max(NARROW)).min(REACH);
            if t >= end {
                self.spare = bubble;
                return None;
            }
            // Whole segments while their far ends are inside, then a part of the next: a bubble is convex, so what
            // leads to a point inside is inside.
            let from = t as usize;
            let mut k = from;
            while k < last && bubble.holds(&self.moves, &waypoints[k + 1]) {
                k += 1;
            }
            let mut next = t.max(k as f64);
            if k < last && k == from {
                let mut step = [0.0; MOST_JOINTS];
                for v in 0..n {
                    step[v] = waypoints[k + 1][v] - waypoints[k][v];
                }
                next = (t + bubble.times(&self.moves, &step)).min((k + 1) as f64);
            } else if k < last {
                let (mut low, mut high) = (next, (k + 1) as f64);
                for _ in 0..6 {
                    let middle = 0.5 * (low + high);
                    if bubble.holds(&self.moves, &at(middle)) {
                        low = middle;
                    } else {
                        high = middle;
                    }
                }
                next = low;
            }
            // Where something is close, go on by the finest step, no further than the next waypoint: no point moves
            // further than that unseen.
            let k = (next as usize).min(last.saturating_sub(1));
            let fastest = bubble.fastest(&waypoints[k], &waypoints[k + 1]);
            let finest = if fastest > 0.0 { FINEST / fastest } else { 1.0 };
            t = next.max((t + finest).min((next as usize + 1) as f64)).min(end);
            self.spare = bubble;
        }
    }

    /// Margins for the free motion between two poses: `clearance`, or what either end leaves where that is less.
    pub fn margins_between(&mut self, a: &Row, b: &Row, stage: usize, clearance: f64) -> Margins {
        let mut out = Margins::plain(clearance);
        for x in [a, b] {
            self.place(x);
            let mut near = Vec::new();
            let mut near_self = Vec::new();
            let mut scratch = std::mem::take(&mut self.scratch);
            let reach = |l: usize, body: usize| {
                if self.judged(l, body, stage) { clearance } else { f64::NEG_INFINITY }
            };
            self.shapes.near_bodies(&self.scene, &mut scratch, EXACT, reach, |p| {
                if let Target::Body(body) = p.target {
                    near.push((p.link, body, p.contact.distance));
                }
                true
            });
            self.shapes.near_self(
                &mut scratch,
                EXACT,
                |_| clearance,
                |i, p| {
                    near_self.push((i, p.contact.distance));
                    true
                },
            );
            self.scratch = scratch;
            out.bodies.extend(near.into_iter().map(|(l, body, d)| ((l, body), (d - TOUCH).max(-TOUCH))));
            out.pairs.extend(near_self.into_iter().map(|(i, d)| (i, (d - TOUCH).max(-TOUCH))));
        }
        out
    }

    /// Adds the distances at `x` to the smallest so far.
    pub fn measure(&mut self, x: &Row, stage: usize, out: &mut Clearances) {
        self.place(x);
        let mut scratch = std::mem::take(&mut self.scratch);
        // Only what is nearer than the smallest so far matters.
        let (table, object, itself) = (out.table.min(1.0), out.object.min(1.0), out.itself.min(1.0));
        let reach = |link: usize, body: usize| match self.problem.bodies[self.bodies[body]].role {
            _ if !self.judged(link, body, stage) => f64::NEG_INFINITY,
            Role::Table => table,
            _ => object,
        };
        self.shapes.near_bodies(&self.scene, &mut scratch, EXACT, reach, |p| {
            if let Target::Body(b) = p.target {
                match self.problem.bodies[self.bodies[b]].role {
                    Role::Table => out.table = out.table.min(p.contact.distance),
                    _ => out.object = out.object.min(p.contact.distance),
                }
            }
            true
        });
        self.shapes.near_self(
            &mut scratch,
            EXACT,
            |_| itself,
            |_, p| {
                out.itself = out.itself.min(p.contact.distance);
                true
            },
        );
        self.scratch = scratch;
    }
}

//! A quick look at eight configurations at a time: lower bounds of all distances from balls that contain the links, in
//! single precision. It can show that a configuration is free, never that it is not; the rest is measured.

mod cover;
mod exact;
mod points;
mod posing;
mod solid;

use std::sync::Arc;

use nalgebra::Point3;
use wide::f32x8;

use crate::{Aabb, Bvh, Convex, JointKind, Pose, Robot};
use cover::{Ball, ball_around, cover};
pub use exact::Measure;
use exact::Piece;
use points::PointGrid;
use posing::{Frames, Posing};
use solid::{Points, Solid, length};

/// Configurations that are looked at in one go.
pub const LANES: usize = 8;
/// From so many obstacles on a tree finds those that are near.
const TREE: usize = 20;
/// Error of single precision (m), a metre of the robot's size.
const SLACK: f64 = 1e-5;

/// A ball in single precision.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sphere {
    center: [f32; 3],
    radius: f32,
}

impl Sphere {
    fn of(ball: &Ball, slack: f64) -> Self {
        let c = ball.center;
        Self { center: [c.x as f32, c.y as f32, c.z as f32], radius: (ball.radius + slack) as f32 }
    }
}

#[derive(Debug, Clone)]
struct Cluster {
    link: usize,
    around: Sphere,
    balls: std::ops::Range<usize>,
}

/// What is made of a robot's shapes once, whatever stands about it.
#[derive(Debug, Clone, Default)]
pub struct Cover {
    /// Balls that contain each link's shapes, in its frame.
    balls: Vec<Vec<Ball>>,
    pieces: Vec<Arc<[Piece]>>,
    levers: Vec<f64>,
}

/// Configurations over which levers are averaged.
const LOOKS: u32 = 64;

impl Cover {
    /// That of every link.
    #[must_use]
    pub fn of(robot: &Robot) -> Self {
        let links = robot.links();
        let balls: Vec<Vec<Ball>> = links.iter().map(|link| link.shapes().iter().flat_map(cover).collect()).collect();
        let pieces = links.iter().map(|link| link.shapes().iter().cloned().map(Piece::of).collect()).collect();
        let levers = mean_levers(robot, &balls);
        Self { balls, pieces, levers }
    }

    /// Mean over configurations of the furthest that any point of the robot is from each joint's axis (m); 1 for a
    /// sliding joint.
    #[must_use]
    pub fn levers(&self) -> &[f64] {
        &self.levers
    }
}

fn mean_levers(robot: &Robot, balls: &[Vec<Ball>]) -> Vec<f64> {
    let (joints, links) = (robot.joints(), robot.links());
    let mut sums = vec![0.0; joints.len()];
    let mut poses = Vec::new();
    let mut counter = 0_u32;
    for _ in 0..LOOKS {
        let mut q: Vec<f64> = joints
            .iter()
            .map(|joint| {
                // Multiples of the golden ratio: any even spread will do.
                counter += 1;
                let share = (f64::from(counter) * 0.618_033_988_749_894_9).fract();
                let (low, high) = (joint.lower().max(-3.2), joint.upper().min(3.2));
                low + (high - low) * share
            })
            .collect();
        robot.apply_mimic(&mut q);
        if robot.link_poses(&q, &mut poses).is_err() {
            continue;
        }
        for (moved, joint) in (0..links.len()).filter_map(|l| Some((l, links[l].joint()?))) {
            if joints[joint].kind() == JointKind::Prismatic {
                sums[joint] += 1.0;
                continue;
            }
            let (origin, axis) = (poses[moved].translation.vector, poses[moved].rotation * joints[joint].axis());
            let mut furthest: f64 = 0.0;
            for l in (0..links.len()).filter(|l| hangs_on(robot, *l, moved)) {
                for ball in &balls[l] {
                    let arm = (poses[l] * ball.center).coords - origin;
                    furthest = furthest.max((arm - axis * arm.dot(&axis)).norm() + ball.radius);
                }
            }
            sums[joint] += furthest;
        }
    }
    // A joint that carries nothing still moves something.
    sums.iter().map(|s| (s / f64::from(LOOKS)).max(0.01)).collect()
}

fn hangs_on(robot: &Robot, mut link: usize, top: usize) -> bool {
    while link != top {
        match robot.links()[link].parent() {
            Some(parent) => link = parent,
            None => return false,
        }
    }
    true
}

/// What a group is near to, for a screen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Other {
    /// One convex shape of a body.
    Element(usize),
    /// A cloud of points.
    Cloud(usize),
    /// A pair of groups, by its number.
    Pair(usize),
}

/// A group and something that it may be too near to.
#[derive(Debug, Clone, Copy)]
pub struct Suspect {
    /// The group; of a pair, the first.
    pub group: usize,
    /// What it may be too near to.
    pub other: Other,
    /// Lower bound of what each lane leaves beyond the distance that is needed (m).
    pub gap: [f32; LANES],
}

/// Distances (m) that have to be kept; minus infinity where two things are not judged.
#[derive(Debug, Clone, PartialEq)]
pub struct Needs {
    /// Of each group from each body, one row a group.
    pub bodies: Vec<f64>,
    /// Of each pair of groups.
    pub pairs: Vec<f64>,
}

/// Shapes that go with a link: its own, or those of what it holds, each with its pose in the link's frame.
pub struct Riders<'a> {
    /// The link.
    pub link: usize,
    /// Shapes and where they are in the link; none for the link's own.
    pub held: Option<(&'a [Convex], Pose)>,
}

/// A robot among obstacles, ready to be looked at quickly and measured exactly.
#[derive(Debug, Clone)]
pub struct Screen {
    posing: Posing,
    revolute: Vec<bool>,
    groups: Vec<Cluster>,
    balls: Vec<Sphere>,
    solids: Vec<Solid>,
    body_of: Vec<usize>,
    tree: Option<Bvh>,
    clouds: Vec<PointGrid>,
    bodies: usize,
    pairs: Vec<(usize, usize)>,
    measure: Measure,
}

/// Eight configurations, and what is known of them so far.
#[derive(Debug, Clone, Default)]
pub struct Batch {
    q: Vec<f32x8>,
    frames: Vec<Frames>,
    around: Vec<Points>,
    centers: Vec<Points>,
    ready: Vec<bool>,
    near: Vec<u32>,
    open: Vec<bool>,
}

impl Batch {
    /// Sets one lane to a full joint vector.
    pub fn set(&mut self, screen: &Screen, lane: usize, q: &[f64]) {
        self.q.resize(q.len(), f32x8::ZERO);
        for (k, (value, lanes)) in q.iter().zip(&mut self.q).enumerate() {
            // Whole turns change nothing, and small angles are known better.
            let turned = match screen.revolute.get(k) {
                Some(true) if value.abs() > 4.0 => {
                    value - std::f64::consts::TAU * (value / std::f64::consts::TAU).round()
                }
                _ => *value,
            };
            if let Some(place) = lanes.as_array_mut().get_mut(lane) {
                *place = turned as f32;
            }
        }
    }
}

impl Screen {
    /// A screen of groups of shapes that go with links, among bodies (their shapes, and their poses in the base frame).
    /// `pairs` are the groups that are judged against each other.
    #[must_use]
    pub fn new<'a>(
        robot: &Robot,
        cover_of: &Cover,
        groups: &[Riders<'a>],
        pairs: Vec<(usize, usize)>,
        bodies: impl IntoIterator<Item = (&'a [Convex], &'a Pose)>,
    ) -> Self {
        let posing = Posing::new(robot, |l| groups.iter().any(|g| g.link == l));
        let joints = robot.joints();
        let travel = |j: usize| joints[j].lower().abs().max(joints[j].upper().abs()).min(10.0);
        let slack = SLACK * (1.0 + posing.size(travel));
        let mut balls: Vec<Sphere> = Vec::new();
        let mut clusters = Vec::with_capacity(groups.len());
        for group in groups {
            let own: Vec<Ball> = match &group.held {
                None => cover_of.balls.get(group.link).cloned().unwrap_or_default(),
                Some((shapes, pose)) => shapes.iter().map(|s| s.moved(pose)).flat_map(|s| cover(&s)).collect(),
            };
            let start = balls.len();
            balls.extend(own.iter().map(|b| Sphere::of(b, slack)));
            clusters.push(Cluster { link: group.link, around: around(&own, slack), balls: start..balls.len() });
        }
        let pieces = groups.iter().map(|group| {
            let own: Arc<[Piece]> = match &group.held {
                None => cover_of.pieces.get(group.link).cloned().unwrap_or_default(),
                Some((shapes, pose)) => shapes.iter().map(|s| Piece::of(s.moved(pose))).collect(),
            };
            (group.link, own)
        });
        let measure = Measure::new(pieces.collect());
        let mut out = Self {
            posing,
            revolute: joints.iter().map(|j| j.kind() == JointKind::Revolute).collect(),
            groups: clusters,
            balls,
            solids: Vec::new(),
            body_of: Vec::new(),
            tree: None,
            clouds: Vec::new(),
            bodies: 0,
            pairs,
            measure,
        };
        let mut boxes = Vec::new();
        for (body, (shapes, pose)) in bodies.into_iter().enumerate() {
            out.bodies = body + 1;
            match as_cloud(shapes, pose) {
                Some((points, radius)) => out.clouds.push(PointGrid::new(body, points, radius)),
                None => {
                    for shape in shapes {
                        let placed = shape.moved(pose);
                        boxes.push(placed.aabb_at(&Pose::identity()));
                        out.solids.push(Solid::of(&placed));
                        out.body_of.push(body);
                        out.measure.add(&placed);
                    }
                }
            }
        }
        out.tree = (out.solids.len() >= TREE).then(|| Bvh::new(&boxes));
        out
    }

    /// Number of groups.
    #[must_use]
    pub fn groups(&self) -> usize {
        self.groups.len()
    }

    /// Pairs of groups that are judged.
    #[must_use]
    pub fn pairs(&self) -> &[(usize, usize)] {
        &self.pairs
    }

    /// Number of bodies.
    #[must_use]
    pub fn bodies(&self) -> usize {
        self.bodies
    }

    /// The body that something belongs to; `None` for a pair of groups.
    #[must_use]
    pub fn body(&self, other: Other) -> Option<usize> {
        match other {
            Other::Element(e) => self.body_of.get(e).copied(),
            Other::Cloud(c) => self.clouds.get(c).map(|c| c.body),
            Other::Pair(_) => None,
        }
    }

    /// The distance that a group has to keep from something.
    #[must_use]
    pub fn needed(&self, needs: &Needs, group: usize, other: Other) -> f64 {
        match (other, self.body(other)) {
            (Other::Pair(pair), _) => needs.pairs[pair],
            (_, Some(body)) => needs.bodies[group * self.bodies + body],
            (_, None) => f64::NEG_INFINITY,
        }
    }

    /// Poses the balls of a batch whose lanes are set.
    pub fn place(&self, batch: &mut Batch) {
        self.posing.place(&batch.q, &mut batch.frames);
        batch.around.clear();
        batch.around.extend(self.groups.iter().map(|g| batch.frames[g.link].point(&g.around.center)));
        batch.centers.resize(self.balls.len(), [f32x8::ZERO; 3]);
        batch.ready.clear();
        batch.ready.resize(self.groups.len(), false);
    }

    fn ensure(&self, group: usize, batch: &mut Batch) {
        if !batch.ready[group] {
            let cluster = &self.groups[group];
            let frame = batch.frames[cluster.link];
            for b in cluster.balls.clone() {
                batch.centers[b] = frame.point(&self.balls[b].center);
            }
            batch.ready[group] = true;
        }
    }

    /// Calls `visit` for everything that some lane may be nearer to than is needed and `reach` (m) more. It returns
    /// whether to go on.
    pub fn survey(
        &self,
        batch: &mut Batch,
        needs: &Needs,
        reach: f32,
        mut visit: impl FnMut(&Suspect) -> bool,
    ) -> bool {
        for group in 0..self.groups.len() {
            let cluster = &self.groups[group];
            if cluster.balls.is_empty() {
                continue;
            }
            let row = &needs.bodies[group * self.bodies..(group + 1) * self.bodies];
            let furthest = row.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            if furthest == f64::NEG_INFINITY {
                continue;
            }
            match &self.tree {
                None => {
                    for e in 0..self.solids.len() {
                        if !self.against_solid(group, e, row[self.body_of[e]], batch, reach, &mut visit) {
                            return false;
                        }
                    }
                }
                Some(tree) => {
                    let bounds = region(&batch.around[group], cluster.around.radius);
                    let mut near = std::mem::take(&mut batch.near);
                    near.clear();
                    tree.near(&bounds, (furthest + f64::from(reach)).max(0.0), |e| near.push(e as u32));
                    let whole = near.iter().all(|e| {
                        let e = *e as usize;
                        self.against_solid(group, e, row[self.body_of[e]], batch, reach, &mut visit)
                    });
                    batch.near = near;
                    if !whole {
                        return false;
                    }
                }
            }
            for (c, cloud) in self.clouds.iter().enumerate() {
                if !self.against_cloud(group, c, row[cloud.body], batch, reach, &mut visit) {
                    return false;
                }
            }
        }
        (0..self.pairs.len()).all(|pair| self.against_group(pair, needs.pairs[pair], batch, reach, &mut visit))
    }

    fn against_solid(
        &self,
        group: usize,
        e: usize,
        need: f64,
        batch: &mut Batch,
        reach: f32,
        visit: &mut impl FnMut(&Suspect) -> bool,
    ) -> bool {
        if need == f64::NEG_INFINITY {
            return true;
        }
        let (solid, cluster, need) = (&self.solids[e], &self.groups[group], need as f32);
        let limit = f32x8::splat(reach + need);
        let coarse = solid.distance(&batch.around[group]) - f32x8::splat(cluster.around.radius);
        if all_at_least(coarse, limit) {
            return true;
        }
        self.ensure(group, batch);
        let own = cluster.balls.clone();
        let least = solid.least(&batch.centers[own.clone()], &self.balls[own]);
        // Neither bound is above the distance: the greater counts.
        let bound = least.fast_max(coarse);
        if all_at_least(bound, limit) {
            return true;
        }
        visit(&Suspect { group, other: Other::Element(e), gap: (bound - f32x8::splat(need)).to_array() })
    }

    fn against_cloud(
        &self,
        group: usize,
        c: usize,
        need: f64,
        batch: &mut Batch,
        reach: f32,
        visit: &mut impl FnMut(&Suspect) -> bool,
    ) -> bool {
        if need == f64::NEG_INFINITY {
            return true;
        }
        let (cloud, cluster, need) = (&self.clouds[c], &self.groups[group], need as f32);
        let limit = reach + need;
        let each = |p: &Points, radius: f32| {
            let [x, y, z] = [p[0].to_array(), p[1].to_array(), p[2].to_array()];
            std::array::from_fn::<f32, LANES, _>(|l| cloud.distance([x[l], y[l], z[l]]) - radius)
        };
        let coarse = each(&batch.around[group], cluster.around.radius);
        if coarse.iter().all(|d| *d >= limit) {
            return true;
        }
        self.ensure(group, batch);
        let mut bound = [f32::MAX; LANES];
        for b in cluster.balls.clone() {
            let found = each(&batch.centers[b], self.balls[b].radius);
            for (least, d) in bound.iter_mut().zip(found) {
                *least = least.min(d);
            }
        }
        for (b, d) in bound.iter_mut().zip(coarse) {
            *b = b.max(d);
        }
        if bound.iter().all(|d| *d >= limit) {
            return true;
        }
        visit(&Suspect { group, other: Other::Cloud(c), gap: bound.map(|d| d - need) })
    }

    fn against_group(
        &self,
        pair: usize,
        need: f64,
        batch: &mut Batch,
        reach: f32,
        visit: &mut impl FnMut(&Suspect) -> bool,
    ) -> bool {
        if need == f64::NEG_INFINITY {
            return true;
        }
        let (a, b) = self.pairs[pair];
        let (one, two, need) = (&self.groups[a], &self.groups[b], need as f32);
        let limit = f32x8::splat(reach + need);
        let apart =
            |p: &Points, q: &Points, radii: f32| length(&[p[0] - q[0], p[1] - q[1], p[2] - q[2]]) - f32x8::splat(radii);
        let coarse = apart(&batch.around[a], &batch.around[b], one.around.radius + two.around.radius);
        if all_at_least(coarse, limit) {
            return true;
        }
        self.ensure(a, batch);
        self.ensure(b, batch);
        // Balls of the second that come near the first at all.
        let mut open = std::mem::take(&mut batch.open);
        open.clear();
        for k in two.balls.clone() {
            let d = apart(&batch.centers[k], &batch.around[a], self.balls[k].radius + one.around.radius);
            open.push(!all_at_least(d, limit));
        }
        let mut least = f32x8::splat(reach + need);
        for i in one.balls.clone() {
            let d = apart(&batch.centers[i], &batch.around[b], self.balls[i].radius + two.around.radius);
            if all_at_least(d, limit) {
                continue;
            }
            for (k, _) in two.balls.clone().zip(&open).filter(|(_, open)| **open) {
                let d = apart(&batch.centers[i], &batch.centers[k], self.balls[i].radius + self.balls[k].radius);
                least = least.fast_min(d);
            }
        }
        batch.open = open;
        let bound = least.fast_max(coarse);
        if all_at_least(bound, limit) {
            return true;
        }
        visit(&Suspect { group: a, other: Other::Pair(pair), gap: (bound - f32x8::splat(need)).to_array() })
    }

    /// Whether a group keeps at least `apart` (m) from something where `poses` puts the links, measured in full.
    pub fn keeps(&self, group: usize, other: Other, poses: &[Pose], apart: f64) -> bool {
        match other {
            Other::Element(e) => self.measure.keeps_from(group, e, poses, apart),
            Other::Cloud(c) => self.measure.keeps_from_cloud(group, &self.clouds[c], poses, apart),
            Other::Pair(pair) => self.measure.pair_keeps(self.pairs[pair], poses, apart),
        }
    }

    /// Distance (m) of a group from something where `poses` puts the links, measured in full up to `reach`: that where
    /// it is more, and negative or zero where they touch.
    pub fn distance(&self, group: usize, other: Other, poses: &[Pose], reach: f64) -> f64 {
        match other {
            Other::Element(e) => self.measure.distance(group, e, poses, reach),
            Other::Cloud(c) => self.measure.cloud_distance(group, &self.clouds[c], poses, reach),
            Other::Pair(pair) => self.measure.pair_distance(self.pairs[pair], poses, reach),
        }
    }

    /// Largest distances (m) of each group's points from the axes of the joints that carry it, lane by lane: `visit`
    /// gets group, joint and distances.
    pub fn levers(
        &self,
        batch: &Batch,
        carriers: &[Vec<(usize, usize)>],
        robot: &Robot,
        mut visit: impl FnMut(usize, usize, [f32; LANES]),
    ) {
        for (group, carried) in carriers.iter().enumerate() {
            let cluster = &self.groups[group];
            if cluster.balls.is_empty() {
                continue;
            }
            for (joint, link) in carried {
                if !self.revolute[*joint] {
                    visit(group, *joint, [1.0; LANES]);
                    continue;
                }
                let frame = &batch.frames[*link];
                let axis = robot.joints()[*joint].axis();
                let axis = frame.direction(&[axis.x as f32, axis.y as f32, axis.z as f32]);
                let c = &batch.around[group];
                let arm = [c[0] - frame.t[0], c[1] - frame.t[1], c[2] - frame.t[2]];
                let across = [
                    arm[1] * axis[2] - arm[2] * axis[1],
                    arm[2] * axis[0] - arm[0] * axis[2],
                    arm[0] * axis[1] - arm[1] * axis[0],
                ];
                visit(group, *joint, (length(&across) + f32x8::splat(cluster.around.radius)).to_array());
            }
        }
    }
}

/// Whether every lane is at least `limit`; one that is no number is not.
#[inline(always)]
fn all_at_least(value: f32x8, limit: f32x8) -> bool {
    use wide::CmpGe;
    value.cmp_ge(limit).all()
}

/// The ball around balls.
fn around(balls: &[Ball], slack: f64) -> Sphere {
    let centers: Vec<Point3<f64>> = balls.iter().map(|b| b.center).collect();
    if centers.is_empty() {
        return Sphere { center: [0.0; 3], radius: 0.0 };
    }
    let center = ball_around(&centers, 0.0).center;
    let radius = balls.iter().map(|b| (b.center - center).norm() + b.radius).fold(0.0, f64::max);
    Sphere::of(&Ball { center, radius }, slack)
}

/// Box around what a ball covers in all lanes.
fn region(center: &Points, radius: f32) -> Aabb {
    let low = |k: usize| f64::from(center[k].to_array().into_iter().fold(f32::MAX, f32::min) - radius);
    let high = |k: usize| f64::from(center[k].to_array().into_iter().fold(f32::MIN, f32::max) + radius);
    Aabb { min: Point3::new(low(0), low(1), low(2)), max: Point3::new(high(0), high(1), high(2)) }
}

/// The points of a body that is many balls of one radius.
fn as_cloud(shapes: &[Convex], pose: &Pose) -> Option<(Vec<Point3<f64>>, f64)> {
    const FEW: usize = 32;
    let radius = shapes.first()?.radius();
    let one = |s: &Convex| s.points().len() == 1 && s.radius() == radius;
    (shapes.len() > FEW && shapes.iter().all(one))
        .then(|| (shapes.iter().map(|s| pose * s.points()[0]).collect(), radius))
}

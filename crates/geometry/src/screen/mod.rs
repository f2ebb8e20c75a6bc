//! Fast screening of eight configurations at a time in single precision: spheres that contain the links give lower
//! bounds of all distances, and spheres inside the links give upper bounds. Undecided pairs are measured exactly.

mod between;
mod cover;
mod exact;
mod links;
mod planes;
mod points;
mod posing;
mod reach;
mod solid;
mod survey;

use std::sync::Arc;

use crate::lanes::F32x8;
use nalgebra::{Point3, Vector3};

use crate::{Aabb, Bvh, Contact, Convex, JointKind, Pose, Robot};
pub use between::{BodyJoint, Chains, Motions, Travel};
use cover::{Ball, MAX_BALLS, cover_quickly};
pub use exact::Measure;
use exact::Piece;
pub use links::Cover;
use links::around;
use points::{Element, PointGrid};
pub use posing::{Frames, Posing};
use reach::Region;
pub use solid::Points;
use solid::{Obstacle, ROUNDING};
use survey::all_at_least;

/// Number of configurations screened at once.
pub const LANES: usize = crate::lanes::WIDTH;
/// Minimum number of obstacles for which a tree is used to find those near the robot.
const TREE: usize = 160;
/// If a group stays further than this (m) from an obstacle at all joint values, the obstacle is skipped for this group,
/// unless a larger distance is required.
const CULL: f64 = 0.2;
/// Approximate number of spheres that cover a held body. Many spheres take longer to compute than most plans.
const HELD_BALLS: usize = 40;
/// Rounding error of single precision (m) per metre of the robot's size.
const SLACK: f64 = 1e-5;
/// Whole turns are subtracted from angles (rad) beyond this.
const SMALL: f64 = 4.0;
/// Cloud points more than this distance (m) beyond the robot's reach get a separate grid, so that stray points neither
/// coarsen the main grid nor reduce its precision.
const BEYOND: f64 = 1.0;

/// A sphere in single precision.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sphere {
    center: [f32; 3],
    radius: f32,
    /// Radius of a sphere with the same centre inside the enclosed shape; a large negative number if unknown.
    inner: f32,
}

impl Sphere {
    fn of(ball: &Ball, slack: f64) -> Self {
        let c = ball.center;
        let inner = (ball.inner - slack).max(-1e9) as f32;
        Self { center: [c.x as f32, c.y as f32, c.z as f32], radius: (ball.radius + slack) as f32, inner }
    }
}

/// Obstacles that a group can approach, and their boxes (minimum and maximum), eight at a time.
#[derive(Debug, Clone)]
struct Reachable {
    indices: Vec<u32>,
    boxes: Vec<[Points; 2]>,
}

impl Reachable {
    fn of(indices: Vec<u32>, all: &[Aabb]) -> Self {
        let block = |own: &[u32]| {
            let end = |of: &dyn Fn(&Aabb) -> f64| {
                F32x8::new(std::array::from_fn(|lane| own.get(lane).map_or(0.0, |e| of(&all[*e as usize]) as f32)))
            };
            [[0, 1, 2].map(|k| end(&|b| b.min[k])), [0, 1, 2].map(|k| end(&|b| b.max[k]))]
        };
        let boxes = indices.chunks(LANES).map(block).collect();
        Self { indices, boxes }
    }
}

/// Sphere of a group without shapes.
const NOTHING: Sphere = Sphere { center: [0.0; 3], radius: 0.0, inner: -1e9 };

#[derive(Debug, Clone)]
struct Cluster {
    link: usize,
    around: Sphere,
    balls: std::ops::Range<usize>,
}

/// The second body of a pair whose distance is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Other {
    /// Index of one convex shape of a body.
    Element(usize),
    /// Index of a point cloud.
    Cloud(usize),
    /// Index of a pair of groups.
    Pair(usize),
}

/// A group and another body that may be too close to each other.
#[derive(Debug, Clone, Copy)]
pub struct Suspect {
    /// Index of the group; for a pair of groups, the first of them.
    pub group: usize,
    /// The other body, point cloud or pair of groups.
    pub other: Other,
    /// Lower bound of the distance minus the required distance (m), for each lane.
    pub gap: [f32; LANES],
    /// Upper bound of the same difference (m); large if unknown. A negative bound proves that the two are too close.
    pub max_gap: [f32; LANES],
}

/// Required distances (m); minus infinity for pairs that are not checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Needs {
    /// Required distance of each group from each body, in rows by group.
    pub bodies: Vec<f64>,
    /// Required distance of each pair of groups.
    pub pairs: Vec<f64>,
}

/// Shapes that move with a link: the link's own shapes, or those of a body attached to it.
pub struct Riders<'a> {
    /// Index of the link.
    pub link: usize,
    /// Attached shapes and their pose in the link's frame; `None` for the link's own shapes.
    pub held: Option<(&'a [Convex], Pose)>,
}

/// A robot among obstacles, prepared for fast screening and for exact measurement.
#[derive(Debug, Clone)]
pub struct Screen {
    posing: Posing,
    revolute: Vec<bool>,
    groups: Vec<Cluster>,
    balls: Vec<Sphere>,
    solids: Vec<Obstacle>,
    body_of: Vec<usize>,
    tree: Option<Bvh>,
    /// For each group, the obstacles that it can approach to [`CULL`] or less while no prismatic joint exceeds its
    /// travel.
    reachable: Vec<Reachable>,
    /// Prismatic joints, each with the maximum absolute value (m) for which `reachable` holds.
    travels: Vec<(usize, f32)>,
    clouds: Vec<PointGrid>,
    bodies: usize,
    pairs: Vec<(usize, usize)>,
    measure: Measure,
    /// Rounding error (m) of positions in single precision.
    slack: f32,
}

/// Eight configurations with the intermediate results of their screening.
#[derive(Debug, Clone, Default)]
pub struct Batch {
    q: Vec<F32x8>,
    frames: Vec<Frames>,
    around: Vec<Points>,
    centers: Vec<Points>,
    ready: Vec<bool>,
    /// Whether no prismatic joint exceeds its travel.
    within_travel: bool,
    /// For each pair, the placement in which it was last examined alone.
    examined: Vec<u64>,
    /// Number of placements so far.
    placements: u64,
    near: Vec<u32>,
    open: Vec<bool>,
    bounds: Vec<F32x8>,
}

impl Batch {
    /// Sets the configuration in one lane to a full joint vector.
    pub fn set(&mut self, screen: &Screen, lane: usize, q: &[f64]) {
        self.q.resize(q.len(), F32x8::ZERO);
        for (k, (value, lanes)) in q.iter().zip(&mut self.q).enumerate() {
            lanes.set(lane, screen.turned(k, *value));
        }
    }

    /// Sets the value of one joint (rad or m) in every lane. All lanes must have been [set](Self::set) before.
    pub fn set_joint(&mut self, screen: &Screen, joint: usize, values: [f64; LANES]) {
        let Some(lanes) = self.q.get_mut(joint) else { return };
        let is_small = values.iter().all(|value| value.abs() <= SMALL);
        *lanes = F32x8::new(values.map(|value| if is_small { value as f32 } else { screen.turned(joint, value) }));
    }
}

impl Screen {
    /// Prepares a robot, as groups of shapes that move with links, among bodies (their shapes, and their poses in the
    /// base frame). `pairs` are the pairs of groups that are checked against each other.
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
        let travel = |j: usize| joints[j].lower().abs().max(joints[j].upper().abs());
        let slack = SLACK * (1.0 + posing.size(|j| travel(j).min(10.0)));
        let mut balls: Vec<Sphere> = Vec::new();
        let mut clusters = Vec::with_capacity(groups.len());
        for group in groups {
            let start = balls.len();
            let whole = match &group.held {
                None => {
                    balls.extend(cover_of.balls.get(group.link).into_iter().flatten().map(|b| Sphere::of(b, slack)));
                    cover_of.around.get(group.link).copied().flatten()
                }
                Some((shapes, pose)) => {
                    let most = (HELD_BALLS / shapes.len().max(1)).clamp(1, MAX_BALLS);
                    let own: Vec<Ball> = shapes.iter().flat_map(|s| cover_quickly(&s.moved(pose), most)).collect();
                    balls.extend(own.iter().map(|b| Sphere::of(b, slack)));
                    around(&own)
                }
            };
            let whole = whole.map_or(NOTHING, |ball| Sphere::of(&ball, slack));
            let balls = start..balls.len();
            clusters.push(Cluster { link: group.link, around: whole, balls });
        }
        let pieces = groups.iter().map(|group| {
            let own: Arc<[Piece]> = match &group.held {
                None => cover_of.pieces.get(group.link).cloned().unwrap_or_default(),
                Some((shapes, pose)) => shapes.iter().map(|s| Piece::of(s.moved(pose))).collect(),
            };
            (group.link, own)
        });
        let pieces: Vec<(usize, Arc<[Piece]>)> = pieces.collect();
        let measure = Measure::new(pieces);
        let extent = |cluster: &Cluster| Point3::from(cluster.around.center.map(f64::from)).coords.norm();
        let reach =
            posing.size(travel) + clusters.iter().map(|c| extent(c) + f64::from(c.around.radius)).fold(0.0, f64::max);
        let mut out = Self {
            posing,
            revolute: joints.iter().map(|j| j.kind() == JointKind::Revolute).collect(),
            groups: clusters,
            balls,
            solids: Vec::new(),
            body_of: Vec::new(),
            tree: None,
            reachable: Vec::new(),
            travels: joints
                .iter()
                .enumerate()
                .filter(|(_, joint)| joint.kind() == JointKind::Prismatic)
                .map(|(j, _)| (j, travel(j) as f32))
                .collect(),
            clouds: Vec::new(),
            bodies: 0,
            pairs,
            measure,
            slack: slack as f32,
        };
        let mut boxes = Vec::new();
        for (body, (shapes, pose)) in bodies.into_iter().enumerate() {
            out.bodies = body + 1;
            let (grids, others) = gridded(shapes, pose);
            for (points, element) in grids {
                let outer = match element {
                    Element::Ball(radius) => radius,
                    Element::Cube(half, _) => half * 3.0_f64.sqrt(),
                };
                let from_base = |p: &Point3<f64>| p.coords.norm() - outer;
                let (near, far): (Vec<_>, Vec<_>) = points.into_iter().partition(|p| from_base(p) < reach + BEYOND);
                if !near.is_empty() {
                    out.clouds.push(PointGrid::new(body, &near, &element, 0.0));
                }
                if !far.is_empty() {
                    // The margin of 1 cm covers rounding errors of single precision up to a distance of 1 km.
                    let least = far.iter().map(from_base).fold(f64::INFINITY, f64::min) - 0.01;
                    out.clouds.push(PointGrid::new(body, &far, &element, least as f32));
                }
            }
            for shape in others {
                let placed = shape.moved(pose);
                boxes.push(placed.aabb_at(&Pose::identity()));
                out.body_of.push(body);
                out.measure.add(&placed);
                out.solids.push(Obstacle::new(placed));
            }
        }
        // Joint values are compared with `travels` in single precision, so the regions allow for rounding.
        let regions = Region::of_links(robot, |j| travel(j) * (1.0 + ROUNDING) + SLACK);
        let near = |cluster: &Cluster| -> Reachable {
            let region = regions[cluster.link].at(&Vector3::from(cluster.around.center.map(f64::from)));
            let (center, radius) = region.ball();
            let place = [center.x, center.y, center.z].map(|v| F32x8::splat(v as f32));
            let far = (radius + f64::from(cluster.around.radius) + CULL + slack) as f32;
            let is_near = |solid: &Obstacle| !all_at_least(solid.first.distance(&place), F32x8::splat(far));
            let near = (0..).zip(&out.solids).filter(|(_, solid)| is_near(solid)).map(|(e, _)| e);
            Reachable::of(near.collect(), &boxes)
        };
        out.reachable = out.groups.iter().map(near).collect();
        out.tree = (out.solids.len() >= TREE).then(|| Bvh::new(&boxes));
        out
    }

    /// Returns a joint value in single precision. Whole turns are subtracted, since small angles have a higher precision.
    fn turned(&self, joint: usize, value: f64) -> f32 {
        match self.revolute.get(joint) {
            Some(true) if value.abs() > SMALL => {
                (value - std::f64::consts::TAU * (value / std::f64::consts::TAU).round()) as f32
            }
            _ => value as f32,
        }
    }

    /// Number of groups.
    #[must_use]
    pub fn groups(&self) -> usize {
        self.groups.len()
    }

    /// Index of a group's link, and a sphere around the group's shapes: centre in the link's frame (m) and radius (m).
    #[must_use]
    pub fn sphere(&self, group: usize) -> (usize, Point3<f64>, f64) {
        let Cluster { link, around, .. } = &self.groups[group];
        (*link, Point3::from(around.center.map(f64::from)), f64::from(around.radius))
    }

    /// Pairs of groups that are checked against each other.
    #[must_use]
    pub fn pairs(&self) -> &[(usize, usize)] {
        &self.pairs
    }

    /// Number of bodies.
    #[must_use]
    pub fn bodies(&self) -> usize {
        self.bodies
    }

    /// Index of the body to which an element or cloud belongs; `None` for a pair of groups.
    #[must_use]
    pub fn body(&self, other: Other) -> Option<usize> {
        match other {
            Other::Element(e) => self.body_of.get(e).copied(),
            Other::Cloud(c) => self.clouds.get(c).map(|c| c.body),
            Other::Pair(_) => None,
        }
    }

    /// Distance (m) that a group must keep from another body.
    #[must_use]
    pub fn needed(&self, needs: &Needs, group: usize, other: Other) -> f64 {
        match (other, self.body(other)) {
            (Other::Pair(pair), _) => needs.pairs[pair],
            (_, Some(body)) => needs.bodies[group * self.bodies + body],
            (_, None) => f64::NEG_INFINITY,
        }
    }

    /// Returns whether a group keeps at least `apart` (m) from another body at the given link poses, measured exactly.
    /// `toward` is as in [`Screen::keeps_between`].
    pub fn keeps(&self, group: usize, other: Other, poses: &[Pose], apart: f64, toward: &mut Vector3<f64>) -> bool {
        self.keeps_between(group, other, [poses; 2], apart, toward)
    }

    /// Returns whether a group keeps at least `apart` (m) from another body while its points move along straight lines
    /// between two lists of link poses. For a pair of groups, the lines are relative to the first group. `toward` is any
    /// vector. It is replaced by the normal of a separating plane, which makes the next test of a similar motion faster.
    pub fn keeps_between(
        &self,
        group: usize,
        other: Other,
        ends: [&[Pose]; 2],
        apart: f64,
        toward: &mut Vector3<f64>,
    ) -> bool {
        match other {
            Other::Element(e) => self.measure.keeps_from_between(group, e, ends, apart, toward),
            Other::Cloud(c) => self.measure.keeps_from_cloud_between(group, &self.clouds[c], ends, apart),
            Other::Pair(pair) => self.measure.pair_keeps_between(self.pairs[pair], ends, apart, toward),
        }
    }

    /// Returns the maximum distance (m) between the positions of a group's point at two lists of link poses. For a pair,
    /// it is a point of the second group relative to the first one.
    pub fn way_between(&self, group: usize, other: Other, ends: [&[Pose]; 2]) -> f64 {
        match other {
            Other::Element(_) | Other::Cloud(_) => self.measure.way(group, None, ends),
            Other::Pair(pair) => self.measure.way(self.pairs[pair].1, Some(self.pairs[pair].0), ends),
        }
    }

    /// Returns the exact distance (m) between a group and another body at the given link poses, at most `reach`; zero
    /// or negative if they touch.
    pub fn distance(&self, group: usize, other: Other, poses: &[Pose], reach: f64) -> f64 {
        self.measured(group, other, poses, reach, None).map_or(reach, |contact| contact.distance)
    }

    /// Returns the closest points (base frame) of a group and another body at the given link poses, if their distance
    /// is at most `reach` (m). `toward` is a guess of the direction from the group to the other body in the base frame;
    /// a good guess makes the search faster.
    #[must_use]
    pub fn contact(
        &self,
        group: usize,
        other: Other,
        poses: &[Pose],
        reach: f64,
        toward: Option<&Vector3<f64>>,
    ) -> Option<Contact> {
        let pose = self.measure.pose_of(group, poses);
        let toward = toward.map(|toward| pose.rotation.inverse() * toward);
        let contact = self.measured(group, other, poses, reach, toward)?;
        Some(Contact {
            distance: contact.distance,
            on_first: pose * contact.on_first,
            on_second: pose * contact.on_second,
            normal: pose.rotation * contact.normal,
        })
    }

    /// Returns the closest points in the frame of the group's link, in which the guess is also given.
    fn measured(
        &self,
        group: usize,
        other: Other,
        poses: &[Pose],
        reach: f64,
        toward: Option<Vector3<f64>>,
    ) -> Option<Contact> {
        match other {
            Other::Element(e) => self.measure.contact(group, e, poses, reach, toward),
            Other::Cloud(c) => self.measure.cloud_contact(group, &self.clouds[c], poses, reach),
            Other::Pair(pair) => self.measure.pair_contact(self.pairs[pair], poses, reach, toward),
        }
    }
}

/// Minimum number of equal spheres or cubes for which a grid is faster than separate shapes.
const MANY: usize = 33;

/// Centres (base frame) and shape of equal elements of a body.
type Equal = (Vec<Point3<f64>>, Element);

/// Returns the elements of a body that are sorted into grids, and its other shapes. Grids hold the points of a cloud, or
/// the voxels of a body, by size.
fn gridded<'a>(shapes: &'a [Convex], pose: &Pose) -> (Vec<Equal>, Vec<&'a Convex>) {
    let Some(first) = shapes.first().filter(|_| shapes.len() >= MANY) else {
        return (Vec::new(), shapes.iter().collect());
    };
    let radius = first.radius();
    if shapes.iter().all(|s| s.points().len() == 1 && s.radius() == radius) {
        return (vec![(shapes.iter().map(|s| pose * s.points()[0]).collect(), Element::Ball(radius))], Vec::new());
    }
    let (mut sizes, mut others): (Vec<(f64, Vec<&Convex>)>, Vec<&Convex>) = (Vec::new(), Vec::new());
    for shape in shapes {
        let Some(half) = shape.cube_half() else {
            others.push(shape);
            continue;
        };
        // Halves differ by rounding, so the grid uses the largest half.
        if let Some((most, same)) = sizes.iter_mut().find(|(h, _)| (*h - half).abs() <= 1e-6 * half) {
            *most = most.max(half);
            same.push(shape);
        } else if sizes.len() < SIZES {
            sizes.push((half, vec![shape]));
        } else {
            others.push(shape);
        }
    }
    let (many, few): (Vec<_>, Vec<_>) = sizes.into_iter().partition(|(_, same)| same.len() >= MANY);
    others.extend(few.into_iter().flat_map(|(_, same)| same));
    let grids = many.into_iter().map(|(half, same)| {
        let centers = same.iter().map(|s| pose * s.center()).collect();
        (centers, Element::Cube(half, pose.rotation))
    });
    (grids.collect(), others)
}

/// Maximum number of sizes of cubes that are distinguished in a body; voxels have one size for each level of an octree.
const SIZES: usize = 24;

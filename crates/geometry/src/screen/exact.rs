//! Exact distances of single pairs that the fast screening could not decide.

use std::sync::Arc;

use crate::lanes::{F32x8, Wide, wide};
use nalgebra::Vector3;

use super::points::PointGrid;
use super::solid::{Obstacle, Points};
use crate::distance::{Reach, keeps_apart};
use crate::{Aabb, Contact, Convex, Corners, Pose, signed_distance};

/// Upper bound on the rounding error of positions in single precision (m).
const ROUGH: f64 = 1e-4;

/// A convex part that moves with a link, given in the link's frame.
#[derive(Debug, Clone)]
pub(super) struct Piece {
    shape: Convex,
    corners: Corners,
    bounds: Aabb,
    /// The part in a form for the distance of points.
    solid: Obstacle,
}

impl Piece {
    pub fn of(shape: Convex) -> Self {
        let (corners, bounds) = (Corners::of(shape.points()), shape.aabb_at(&Pose::identity()));
        Self { solid: Obstacle::new(shape.clone()), corners, bounds, shape }
    }

    /// Returns the vertices of the box around some pieces, in their link's frame; all at the origin without pieces.
    pub fn corners_around(pieces: &[Self]) -> [[f32; 3]; 8] {
        let all = pieces.iter().fold(Aabb::EMPTY, |sum, piece| sum.union(&piece.bounds));
        let ends = if pieces.is_empty() { [[0.0; 3]; 2] } else { [all.min.into(), all.max.into()] };
        std::array::from_fn(|corner| std::array::from_fn(|k| ends[corner >> k & 1][k] as f32))
    }
}

#[derive(Debug, Clone)]
struct Placed {
    points: Vec<nalgebra::Point3<f64>>,
    bounds: Aabb,
    center: nalgebra::Point3<f64>,
    radius: f64,
}

/// Shapes for exact measurement of distances.
#[derive(Debug, Clone, Default)]
pub struct Measure {
    /// Index of each group's link, and the group's shapes in the frame of this link.
    groups: Vec<(usize, Arc<[Piece]>)>,
    elements: Vec<Placed>,
}

impl Measure {
    pub(super) fn new(groups: Vec<(usize, Arc<[Piece]>)>) -> Self {
        Self { groups, elements: Vec::new() }
    }

    pub(super) fn add(&mut self, shape: &Convex) {
        self.elements.push(Placed {
            points: shape.points().to_vec(),
            bounds: shape.aabb_at(&Pose::identity()),
            center: *shape.center(),
            radius: shape.radius(),
        });
    }

    /// Visits the shapes of a group whose boxes lie within `reach` of an element. The cheaper of both frames is used.
    fn near_element(
        &self,
        group: usize,
        e: usize,
        poses: &[Pose],
        reach: f64,
        mut visit: impl FnMut((&Corners, f64), (&Corners, f64), Vector3<f64>) -> bool,
    ) -> bool {
        let (link, pieces) = &self.groups[group];
        let (pose, element) = (&poses[*link], &self.elements[e]);
        let mut moved: Option<Corners> = None;
        pieces.iter().all(|piece| {
            let bounds = piece.shape.aabb_at(pose);
            if bounds.distance_squared(&element.bounds) > reach.max(0.0).powi(2) {
                return true;
            }
            let toward = element.center - pose * piece.shape.center();
            let here = moved.get_or_insert_with(|| {
                let mut out = Corners::default();
                out.place(&element.points, &pose.inverse());
                out
            });
            visit((&piece.corners, piece.shape.radius()), (here, element.radius), pose.rotation.inverse() * toward)
        })
    }

    pub(super) fn keeps_from(&self, group: usize, e: usize, poses: &[Pose], apart: f64) -> bool {
        self.near_element(group, e, poses, apart, |a, b, toward| keeps_apart(a, b, &toward, apart) == Reach::Beyond)
    }

    /// Returns the closest points of a group and an element in the frame of the group's link, if their distance is at
    /// most `reach`.
    pub(super) fn contact(
        &self,
        group: usize,
        e: usize,
        poses: &[Pose],
        reach: f64,
        guess: Option<Vector3<f64>>,
    ) -> Option<Contact> {
        let mut nearest = Nearest::within(reach);
        self.near_element(group, e, poses, reach, |a, b, toward| nearest.take(a, b, &mut guess.unwrap_or(toward)));
        nearest.contact
    }

    fn near_group(
        &self,
        (a, b): (usize, usize),
        poses: &[Pose],
        reach: f64,
        mut visit: impl FnMut((&Corners, f64), (&Corners, f64), Vector3<f64>) -> bool,
    ) -> bool {
        let ((one, mine), (two, theirs)) = (&self.groups[a], &self.groups[b]);
        let (first, second) = (&poses[*one], &poses[*two]);
        let way = first.inverse() * second;
        let mut moved = Corners::default();
        theirs.iter().all(|other| {
            let bounds = other.shape.aabb_at(&way);
            let mut ready = false;
            mine.iter().all(|piece| {
                if piece.bounds.distance_squared(&bounds) > reach.max(0.0).powi(2) {
                    return true;
                }
                if !ready {
                    moved.place(other.shape.points(), &way);
                    ready = true;
                }
                let toward = way * other.shape.center() - piece.shape.center();
                visit((&piece.corners, piece.shape.radius()), (&moved, other.shape.radius()), toward)
            })
        })
    }

    pub(super) fn pair_keeps(&self, pair: (usize, usize), poses: &[Pose], apart: f64) -> bool {
        self.near_group(pair, poses, apart, |a, b, toward| keeps_apart(a, b, &toward, apart) == Reach::Beyond)
    }

    /// Returns the closest points of two groups in the frame of the first group's link, if their distance is at most
    /// `reach`.
    pub(super) fn pair_contact(
        &self,
        pair: (usize, usize),
        poses: &[Pose],
        reach: f64,
        guess: Option<Vector3<f64>>,
    ) -> Option<Contact> {
        let mut nearest = Nearest::within(reach);
        self.near_group(pair, poses, reach, |a, b, toward| nearest.take(a, b, &mut guess.unwrap_or(toward)));
        nearest.contact
    }

    /// Returns the link and the shapes of a group, each as its vertices in the link's frame and its radius.
    pub(super) fn shapes_of(
        &self,
        group: usize,
    ) -> (usize, impl Iterator<Item = (&[nalgebra::Point3<f64>], f64)> + Clone) {
        let (link, pieces) = &self.groups[group];
        (*link, pieces.iter().map(|piece| (piece.shape.points(), piece.shape.radius())))
    }

    /// Returns the vertices (base frame) and the radius of an element.
    pub(super) fn element(&self, e: usize) -> (&[nalgebra::Point3<f64>], f64) {
        (&self.elements[e].points, self.elements[e].radius)
    }

    /// Returns the pose of the link of a group.
    pub(super) fn pose_of(&self, group: usize, poses: &[Pose]) -> Pose {
        poses[self.groups[group].0]
    }

    /// Returns the distance between a group and a point cloud or voxels, at most `reach`. `measured` returns the distance
    /// of a piece from an element's core, both in the link's frame, up to a limit. The likely closest elements are
    /// measured first, and elements that are certainly further away are skipped.
    fn to_cloud(
        &self,
        group: usize,
        cloud: &PointGrid,
        poses: &[Pose],
        reach: f64,
        mut measured: impl FnMut(&Piece, &Corners, f64) -> f64,
    ) -> f64 {
        let (link, pieces) = &self.groups[group];
        let pose = &poses[*link];
        let back = pose.inverse();
        let (mut least, mut one, mut near) = (reach, Corners::default(), Vec::new());
        let (outer, mut core) =
            (cloud.radius + cloud.extent, cloud.core.iter().map(|v| nalgebra::Point3::from(*v)).collect::<Vec<_>>());
        for piece in pieces.iter() {
            wide(Gather { piece, cloud, pose, back: &back, within: least.max(0.0) + outer, near: &mut near });
            if let Some(first) = (0..near.len()).min_by(|a, b| near[*a].0.total_cmp(&near[*b].0)) {
                near.swap(0, first);
            }
            for (bound, index) in &near {
                if f64::from(*bound) - ROUGH > least.max(0.0) + outer {
                    continue;
                }
                let center = cloud.center(*index);
                core.iter_mut().zip(&cloud.core).for_each(|(p, offset)| *p = center + offset);
                one.place(&core, &back);
                least = least.min(measured(piece, &one, least));
                if least == f64::NEG_INFINITY {
                    return least;
                }
            }
        }
        least
    }

    pub(super) fn keeps_from_cloud(&self, group: usize, cloud: &PointGrid, poses: &[Pose], apart: f64) -> bool {
        let found = self.to_cloud(group, cloud, poses, apart, |piece, point, _| {
            let toward = point.middle() - piece.shape.center();
            let shapes = ((&piece.corners, piece.shape.radius()), (point, cloud.radius));
            match keeps_apart(shapes.0, shapes.1, &toward, apart) {
                Reach::Beyond => apart,
                _ => f64::NEG_INFINITY,
            }
        });
        found > f64::NEG_INFINITY
    }

    /// Returns the closest points of a group and a point cloud in the frame of the group's link, if their distance is
    /// at most `reach`.
    pub(super) fn cloud_contact(&self, group: usize, cloud: &PointGrid, poses: &[Pose], reach: f64) -> Option<Contact> {
        let mut nearest = Nearest::within(reach);
        self.to_cloud(group, cloud, poses, reach, |piece, point, _| {
            let mut toward = point.middle() - piece.shape.center();
            nearest.take((&piece.corners, piece.shape.radius()), (point, cloud.radius), &mut toward);
            nearest.least
        });
        nearest.contact
    }
}

/// The closest of several measured pairs of shapes.
struct Nearest {
    least: f64,
    contact: Option<Contact>,
}

impl Nearest {
    fn within(reach: f64) -> Self {
        Self { least: reach, contact: None }
    }

    /// Measures another pair of shapes; returns true, so that all pairs are visited.
    fn take(&mut self, a: (&Corners, f64), b: (&Corners, f64), toward: &mut Vector3<f64>) -> bool {
        if let Some(contact) = signed_distance(a, b, toward, self.least.max(0.0))
            && contact.distance < self.least
        {
            (self.least, self.contact) = (contact.distance, Some(contact));
        }
        true
    }
}

/// Points of a cloud that may lie within `within` (m) of a piece, each as a lower bound of its distance and its index.
struct Gather<'a> {
    piece: &'a Piece,
    cloud: &'a PointGrid,
    pose: &'a Pose,
    back: &'a Pose,
    within: f64,
    near: &'a mut Vec<(f32, u32)>,
}

impl Wide for Gather<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { piece, cloud, pose, back, within, near } = self;
        near.clear();
        let m = back.rotation.matrix().cast::<f32>();
        let t = back.translation.vector.cast::<f32>();
        // Single precision is only used to exclude points that are certainly further away.
        let limit = F32x8::splat((within + ROUGH) as f32);
        let solid = piece.solid.hull().unwrap_or(&piece.solid.first);
        cloud.within(&piece.shape.aabb_at(pose).grown(within), |points: &Points, first: u32| {
            let here = [0, 1, 2]
                .map(|i| points[0] * m[(i, 0)] + points[1] * m[(i, 1)] + points[2] * m[(i, 2)] + F32x8::splat(t[i]));
            let bounds = solid.distance(&here);
            if super::survey::all_at_least(bounds, limit) {
                return;
            }
            let (bounds, limit) = (bounds.to_array(), limit.to_array());
            let inside = (0..super::LANES).filter(|l| bounds[*l] < limit[*l]);
            near.extend(inside.map(|l| (bounds[l], first + l as u32)));
        });
    }
}

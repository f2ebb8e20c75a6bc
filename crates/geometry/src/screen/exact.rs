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

    /// Returns a box around the part at two poses of its link.
    fn bounds_at_both(&self, ends: [&Pose; 2]) -> Aabb {
        let [first, last] = ends.map(|pose| self.shape.aabb_at(pose));
        first.union(&last)
    }

    /// Returns the vertices of the part at its own pose and at another one, in its own frame.
    fn and_at<'c>(&'c self, other: Option<&Pose>, out: &'c mut Corners) -> &'c Corners {
        let Some(pose) = other else { return &self.corners };
        out.place(self.shape.points(), &Pose::identity());
        out.add(self.shape.points(), pose);
        out
    }

    /// Returns whether a plane with the unit normal `toward` separates the vertices at both poses from another hull, by
    /// at least `apart` (m).
    fn is_behind(&self, ends: [&Pose; 2], other: &Corners, toward: &Vector3<f64>, apart: f64) -> bool {
        if !(self.corners.are_measurable() && other.are_measurable()) || (toward.norm_squared() - 1.0).abs() > 1e-9 {
            return false;
        }
        let nearest = other.furthest(&-toward).coords.dot(toward);
        ends.into_iter().all(|pose| {
            let own = pose.rotation.inverse() * toward;
            let height = self.corners.furthest(&own).coords.dot(&own) + pose.translation.vector.dot(toward);
            nearest - height >= apart
        })
    }
}

#[derive(Debug, Clone)]
struct Placed {
    points: Vec<nalgebra::Point3<f64>>,
    corners: Corners,
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
            corners: Corners::of(shape.points()),
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

    /// Returns whether a group keeps a distance from an element while its points move straight between two poses of the
    /// links. A plane between the element and both positions of a piece proves it. `toward` is a guess of the plane's
    /// normal in the base frame, from the group to the element, and is replaced by the normal found.
    pub(super) fn keeps_from_between(
        &self,
        group: usize,
        e: usize,
        ends: [&[Pose]; 2],
        apart: f64,
        toward: &mut Vector3<f64>,
    ) -> bool {
        let ((link, pieces), element) = (&self.groups[group], &self.elements[e]);
        let ends = ends.map(|poses| &poses[*link]);
        let (back, mut here) = (ends[0].inverse(), None);
        let way = (!std::ptr::eq(ends[0], ends[1])).then(|| back * ends[1]);
        let mut both = Corners::default();
        pieces.iter().all(|piece| {
            let bounds = piece.bounds_at_both(ends);
            if bounds.distance_squared(&element.bounds) > apart.max(0.0).powi(2) {
                return true;
            }
            let limit = apart + piece.shape.radius() + element.radius;
            if piece.is_behind(ends, &element.corners, toward, limit) {
                return true;
            }
            // The element usually has fewer vertices than the piece, so it is moved to the frame of the piece.
            let here = here.get_or_insert_with(|| {
                let mut out = Corners::default();
                out.place(&element.points, &back);
                out
            });
            let own = piece.and_at(way.as_ref(), &mut both);
            let mut normal = back * (element.center - nalgebra::center(&bounds.min, &bounds.max));
            let shapes = ((own, piece.shape.radius()), (&*here, element.radius));
            let found = keeps_apart(shapes.0, shapes.1, &mut normal, apart);
            *toward = ends[0].rotation * normal;
            found == Reach::Beyond
        })
    }

    /// The same for a pair of groups; the points of the second group move straight relative to the first group, and
    /// `toward` is in the frame of the first group.
    pub(super) fn pair_keeps_between(
        &self,
        (a, b): (usize, usize),
        ends: [&[Pose]; 2],
        apart: f64,
        toward: &mut Vector3<f64>,
    ) -> bool {
        let ((one, mine), (two, theirs)) = (&self.groups[a], &self.groups[b]);
        let ends = ends.map(|poses| poses[*one].inverse() * poses[*two]);
        let ends = [&ends[0], &ends[1]];
        let mut both = Corners::default();
        let is_same = ends[0] == ends[1];
        theirs.iter().all(|other| {
            let bounds = other.bounds_at_both(ends);
            let center = other.shape.center();
            let middle = nalgebra::center(&(ends[0] * center), &(ends[1] * center));
            let mut ready = false;
            mine.iter().all(|piece| {
                if piece.bounds.distance_squared(&bounds) > apart.max(0.0).powi(2) {
                    return true;
                }
                let limit = apart + piece.shape.radius() + other.shape.radius();
                if other.is_behind(ends, &piece.corners, &-*toward, limit) {
                    return true;
                }
                if !ready {
                    both.place(other.shape.points(), ends[0]);
                    if !is_same {
                        both.add(other.shape.points(), ends[1]);
                    }
                    ready = true;
                }
                *toward = middle - piece.shape.center();
                let shapes = ((&piece.corners, piece.shape.radius()), (&both, other.shape.radius()));
                keeps_apart(shapes.0, shapes.1, toward, apart) == Reach::Beyond
            })
        })
    }

    /// The same for a group and a point cloud.
    pub(super) fn keeps_from_cloud_between(
        &self,
        group: usize,
        cloud: &PointGrid,
        ends: [&[Pose]; 2],
        apart: f64,
    ) -> bool {
        let (link, pieces) = &self.groups[group];
        let [from, to] = ends.map(|poses| &poses[*link]);
        let back = from.inverse();
        let way = (!std::ptr::eq(from, to)).then(|| back * to);
        let moved = way.as_ref().map_or(0.0, |way| furthest(pieces, &Pose::identity(), way));
        let within = apart.max(0.0) + cloud.radius + cloud.extent + moved;
        let (mut one, mut both, mut near) = (Corners::default(), Corners::default(), Vec::new());
        let mut core: Vec<nalgebra::Point3<f64>> = cloud.core.iter().map(|v| nalgebra::Point3::from(*v)).collect();
        pieces.iter().all(|piece| {
            wide(Gather { piece, cloud, pose: from, back: &back, within, near: &mut near });
            // The likely closest points are measured first.
            near.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
            let own = if near.is_empty() { &piece.corners } else { piece.and_at(way.as_ref(), &mut both) };
            near.iter().all(|(_, index)| {
                let center = cloud.center(*index);
                core.iter_mut().zip(&cloud.core).for_each(|(p, offset)| *p = center + offset);
                one.place(&core, &back);
                let mut toward = one.middle() - piece.shape.center();
                let shapes = ((own, piece.shape.radius()), (&one, cloud.radius));
                keeps_apart(shapes.0, shapes.1, &mut toward, apart) == Reach::Beyond
            })
        })
    }

    /// Returns the maximum distance (m) between the positions of a group's point at two poses of the links; for a pair,
    /// relative to the first group.
    pub(super) fn way(&self, group: usize, first: Option<usize>, ends: [&[Pose]; 2]) -> f64 {
        let (link, pieces) = &self.groups[group];
        let [from, to] = ends.map(|poses| match first {
            Some(first) => poses[self.groups[first].0].inverse() * poses[*link],
            None => poses[*link],
        });
        furthest(pieces, &from, &to)
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

/// Returns the maximum distance between the positions of a point of some pieces at two poses. The distance is a convex
/// function of the point, so a vertex of the box around a piece is furthest.
fn furthest(pieces: &[Piece], from: &Pose, to: &Pose) -> f64 {
    let mut most = 0.0_f64;
    for piece in pieces {
        let ends = [piece.bounds.min, piece.bounds.max];
        for corner in 0..8 {
            let at = |k: usize| ends[corner >> k & 1][k];
            let p = nalgebra::Point3::new(at(0), at(1), at(2));
            most = most.max((to * p - from * p).norm());
        }
    }
    most
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

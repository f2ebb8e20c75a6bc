//! Clearance of the open hand on its approach to a grasp, and of the closing fingers.

use gensim2_geometry::{Aabb, Bvh, Convex, Corners, Pose, signed_distance};
use nalgebra::{Point3, Translation3, Vector3};

use super::gripper::ParallelGripper;
use super::surface::{Plane, planes};
use crate::ProblemError;

/// Measured distances from obstacles are capped at this value (m).
pub(super) const FAR: f64 = 0.01;
/// The closing fingers are checked until their pads are this far from the object (m).
const BEFORE_TOUCH: f64 = 1e-3;

struct Obstacle {
    corners: Corners,
    radius: f64,
    center: Point3<f64>,
    bounds: Aabb,
}

/// The object and the bodies around it, in the object frame.
pub(super) struct Surroundings {
    obstacles: Vec<Obstacle>,
    tree: Bvh,
    /// Faces of the other bodies.
    others: Vec<Vec<Plane>>,
}

impl Surroundings {
    /// Prepares `object` in its own frame, and the bodies `others`, each with its pose in the object frame.
    pub fn new(object: &[Convex], others: &[(&[Convex], Pose)]) -> Self {
        let moved: Vec<Convex> =
            others.iter().flat_map(|(shapes, pose)| shapes.iter().map(|s| s.moved(pose))).collect();
        let faces = moved.iter().map(|s| planes(&s.triangles())).filter(|planes| planes.len() > 1).collect();
        let obstacles: Vec<Obstacle> = object
            .iter()
            .chain(&moved)
            .map(|s| Obstacle {
                corners: Corners::of(s.points()),
                radius: s.radius(),
                center: *s.center(),
                bounds: s.aabb_at(&Pose::identity()),
            })
            .collect();
        let boxes: Vec<Aabb> = obstacles.iter().map(|o| o.bounds).collect();
        Self { obstacles, tree: Bvh::new(&boxes), others: faces }
    }

    /// Returns whether a point lies inside or within about `margin` (m) of another body.
    pub fn bury(&self, point: &Point3<f64>, margin: f64) -> bool {
        self.others.iter().any(|planes| planes.iter().all(|plane| plane.height(point) < margin))
    }

    /// Returns the distance of a shape from the nearest obstacle, at most `FAR`; the search stops at a distance below
    /// `enough`.
    fn distance(&self, corners: &Corners, radius: f64, bounds: &Aabb, enough: f64) -> f64 {
        let mut least = FAR;
        let middle = nalgebra::center(&bounds.min, &bounds.max);
        self.tree.near(bounds, FAR, |i| {
            let other = &self.obstacles[i];
            if least < enough || bounds.distance_squared(&other.bounds).sqrt() >= least {
                return;
            }
            let mut toward = other.center - middle;
            let pair = ((corners, radius), (&other.corners, other.radius));
            if let Some(contact) = signed_distance(pair.0, pair.1, &mut toward, least) {
                least = least.min(contact.distance);
            }
        });
        least
    }
}

/// Convex hulls around the parts of a gripper, swept along its approach, in the hand frame.
pub(super) struct HandSweep<'g> {
    gripper: &'g ParallelGripper,
    palm: Vec<Convex>,
    fingers: [Vec<Convex>; 2],
    corners: Corners,
}

impl<'g> HandSweep<'g> {
    /// Prepares the hand for a straight approach of length `approach` (m).
    pub fn new(gripper: &'g ParallelGripper, approach: f64) -> Result<Self, ProblemError> {
        let back = gripper.grip().rotation * Vector3::new(0.0, 0.0, -approach);
        let swept = |shapes: &[Convex]| shapes.iter().map(|s| sweep(s, &back)).collect::<Result<Vec<_>, _>>();
        let fingers = gripper.fingers();
        Ok(Self {
            gripper,
            palm: swept(gripper.palm())?,
            fingers: [swept(&fingers[0])?, swept(&fingers[1])?],
            corners: Corners::default(),
        })
    }

    /// Returns the minimum distance (m, at most `FAR`) between the palm on its approach and the surrounding bodies;
    /// `None` if the distance is below `least`.
    pub fn palm(&mut self, around: &Surroundings, grip: &Pose, least: f64) -> Option<f64> {
        let hand = grip * self.gripper.grip().inverse();
        kept(&self.palm, &hand, around, &mut self.corners, least)
    }

    /// Returns the minimum distance between the fingers, which approach at `opening` and then close to `width`, and the
    /// surrounding bodies.
    ///
    /// While they close, only the pads may touch the object, and other bodies must keep the distance `least`.
    pub fn fingers(&mut self, around: &Surroundings, grip: &Pose, opening: f64, width: f64, least: f64) -> Option<f64> {
        let hand = grip * self.gripper.grip().inverse();
        let closing = grip.rotation * Vector3::x();
        let shifted = |way: f64| Translation3::from(closing * way) * hand;
        let mut most = FAR;
        for (finger, sign) in [-1.0, 1.0].into_iter().enumerate() {
            let pose = shifted(sign * 0.5 * opening);
            most = most.min(kept(&self.fingers[finger], &pose, around, &mut self.corners, least)?);
        }
        for (finger, sign) in [-1.0, 1.0].into_iter().enumerate() {
            let (from, to) = (sign * 0.5 * opening, sign * (0.5 * width + BEFORE_TOUCH));
            if (to - from) * sign >= 0.0 {
                continue;
            }
            let (first, last) = (shifted(from), shifted(to));
            for shape in &self.gripper.fingers()[finger] {
                let both: Vec<Point3<f64>> =
                    [first, last].iter().flat_map(|pose| shape.points().iter().map(move |p| pose * p)).collect();
                self.corners.place(&both, &Pose::identity());
                let bounds = shape.aabb_at(&first).union(&shape.aabb_at(&last));
                let limit = least.min(0.5 * BEFORE_TOUCH);
                if around.distance(&self.corners, shape.radius(), &bounds, limit) < limit {
                    return None;
                }
            }
        }
        Some(most)
    }
}

/// Returns the minimum distance between the shapes of a hand part, placed at `pose`, and the surrounding bodies, at
/// most `FAR`; `None` if the distance is below `least`.
fn kept(shapes: &[Convex], pose: &Pose, around: &Surroundings, corners: &mut Corners, least: f64) -> Option<f64> {
    let mut most = FAR;
    for shape in shapes {
        shape.corners_at(pose, corners);
        most = most.min(around.distance(corners, shape.radius(), &shape.aabb_at(pose), least));
        if most < least {
            return None;
        }
    }
    Some(most)
}

fn sweep(shape: &Convex, way: &Vector3<f64>) -> Result<Convex, ProblemError> {
    let both: Vec<Point3<f64>> = shape.points().iter().flat_map(|p| [*p, p + way]).collect();
    Convex::rounded_hull(&both, shape.radius()).map_err(|e| ProblemError::new("gripper", e.to_string()))
}

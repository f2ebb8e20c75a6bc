//! Resumes a motion that was executed in part, and reuses the path of an earlier plan.

use gensim2_geometry::{Pose, rotation_log};
use nalgebra::{Rotation3, Vector3};

use super::Plan;
use super::planner::Planner;
use crate::hand_path::{Followed, Guide, OFF_PATH};
use crate::model::Row;
use crate::motion::HandPath;
use crate::world::{Margins, MotionSegment, Way};

/// Number of positions on a path among which the one nearest to the hand is searched.
const PLACES: usize = 32;
/// Length (m) that counts as much as one radian when hand poses are compared.
const LEVER: f64 = 0.1;
/// Time between waypoints taken from an earlier plan (s).
const STEP: f64 = 0.05;
/// Maximum number of waypoints taken from an earlier plan; waypoints of longer motions are further apart.
const MAX_STEPS: f64 = 1e4;
/// An earlier path is used if its ends are this close to the current state and to the goal (rad or m).
const NEAR_START: f64 = 0.05;
const AT_GOAL: f64 = 1e-3;
/// Maximum distance (m) between the hand's position at the last waypoint and the end of the path.
const AT_END: f64 = 1e-4;
/// A path of an earlier plan with a joint value beyond this (rad or m) counts as damaged.
const FURTHEST: f64 = 100.0;

/// The remaining part of a hand path. It begins at the current hand pose and gradually approaches the path.
pub(super) struct Rest<'p> {
    path: &'p HandPath,
    /// Fraction of the path that has been executed.
    pub begin: f64,
    off: Vector3<f64>,
    turned: Vector3<f64>,
}

impl<'p> Rest<'p> {
    /// Returns the remaining part of a path for a hand at the pose `hand`, which is close to the path.
    pub fn new(path: &'p HandPath, hand: &Pose) -> Self {
        let apart = |s: f64| {
            let at = path.at(s);
            let way = (hand.translation.vector - at.translation.vector).norm();
            way + LEVER * rotation_log(&(hand.rotation * at.rotation.inverse())).norm()
        };
        let place = |k: usize| k as f64 / PLACES as f64;
        let nearest = (0..=PLACES).min_by(|a, b| apart(place(*a)).total_cmp(&apart(place(*b)))).unwrap_or(0);
        let (mut low, mut high) = (place(nearest.saturating_sub(1)), place((nearest + 1).min(PLACES)));
        for _ in 0..24 {
            let (a, b) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
            if apart(a) < apart(b) {
                high = b;
            } else {
                low = a;
            }
        }
        let begin = 0.5 * (low + high);
        let at = path.at(begin);
        let off = hand.translation.vector - at.translation.vector;
        Self { path, begin, off, turned: rotation_log(&(hand.rotation * at.rotation.inverse())) }
    }
}

impl Guide for Rest<'_> {
    fn at(&self, s: f64) -> Pose {
        let pose = self.path.at(self.begin + (1.0 - self.begin) * s);
        let left = 1.0 - s;
        let off = pose.translation.vector + self.off * left;
        Pose::from_parts(off.into(), Rotation3::new(self.turned * left) * pose.rotation)
    }

    fn length(&self) -> (f64, f64) {
        let (way, turn) = self.path.length();
        let left = 1.0 - self.begin;
        (way * left + self.off.norm(), turn * left + self.turned.norm())
    }
}

impl Planner<'_> {
    /// Returns the remaining part of the current hand path: joint waypoints, the fraction of the whole path at each,
    /// and the fraction of the remaining part that the arm can follow. Uses the earlier plan's waypoints if the arm is
    /// on them.
    pub(super) fn rest_of(&mut self, path: &HandPath) -> (Vec<Row>, Vec<f64>, f64) {
        let start = self.rest();
        let rest = Rest::new(path, &self.follower.hand(&start));
        if let Some(way) = self.former_waypoints(&start, self.entry.checked_sub(1))
            && self.keeps_to(path, &way, rest.off.norm())
        {
            let done = way.iter().map(|x| Rest::new(path, &self.follower.hand(x)).begin).collect();
            return (way, done, 1.0);
        }
        let Followed { waypoints, fraction } = self.follower.follow(&rest, &start, false);
        let reached = (1.0 - rest.begin) * fraction;
        let steps = waypoints.len().saturating_sub(1).max(1) as f64;
        let done = (0..waypoints.len()).map(|k| rest.begin + reached * k as f64 / steps).collect();
        (waypoints, done, fraction)
    }

    /// Returns whether the hand starts within `off` (m) of a path, stays on the path and ends at its end.
    fn keeps_to(&mut self, path: &HandPath, way: &[Row], off: f64) -> bool {
        let Some(last) = way.last() else { return false };
        let (hand, end) = (self.follower.hand(last), path.at(1.0));
        let turned = rotation_log(&(hand.rotation * end.rotation.inverse())).norm();
        (hand.translation.vector - end.translation.vector).norm() + LEVER * turned < AT_END
            && way.iter().all(|x| Rest::new(path, &self.follower.hand(x)).off.norm() < OFF_PATH + off)
    }

    /// Returns the earlier plan's waypoints between `start` and `goal`, if their path is collision-free.
    pub(super) fn warm_start_way(
        &mut self,
        start: &Row,
        goal: &Row,
        segment: MotionSegment,
        margins: &Margins,
    ) -> Option<Vec<Row>> {
        let mut way = self.former_waypoints(start, None)?;
        let last = way.last_mut()?;
        if self.apart(last, goal) > AT_GOAL {
            return None;
        }
        *last = *goal;
        self.world.sweep_along(Way::still(&way), segment, margins).is_none().then_some(way)
    }

    /// Returns the earlier plan's waypoints from `start` to the first keyframe that is still to be reached. `after` is
    /// the index of the last passed keyframe, if any.
    fn former_waypoints(&self, start: &Row, after: Option<usize>) -> Option<Vec<Row>> {
        let warm_start = self.warm_start?;
        let (trajectory, end) = (warm_start.trajectory()?, warm_start.keyframes.get(self.entry)?.time?);
        // Times in an untrusted plan may be arbitrary.
        let within = |time: f64| time.max(trajectory.start()).min(trajectory.end());
        let begin = within(after.and_then(|k| warm_start.keyframes.get(k)?.time).unwrap_or(trajectory.start()));
        let end = within(end);
        let steps = ((end - begin) / STEP).ceil().clamp(1.0, MAX_STEPS);
        let at = |k: usize| trajectory.moving(begin + (end - begin) * k as f64 / steps);
        let mut way: Vec<Row> = (0..=steps as usize).map(at).collect();
        if way.iter().any(|x| self.apart(x, start) > FURTHEST) {
            return None;
        }
        let nearest =
            (0..way.len()).min_by(|a, b| self.apart(&way[*a], start).total_cmp(&self.apart(&way[*b], start)))?;
        if self.apart(&way[nearest], start) > NEAR_START {
            return None;
        }
        // Continue with the waypoint after the nearest one, which the arm may already have passed.
        way.drain(..(nearest + 1).min(way.len() - 1));
        way.insert(0, *start);
        Some(way)
    }

    /// Returns the largest difference (rad or m) between two joint vectors in one joint.
    fn apart(&self, a: &Row, b: &Row) -> f64 {
        (0..self.model.n()).map(|v| (a[v] - b[v]).abs()).fold(0.0, f64::max)
    }
}

/// Returns the actuation pose of an earlier plan, as values of the joints that planning moves.
pub(super) fn warm_start_pose(warm_start: &Plan, pick: impl Fn(&[f64]) -> Row, joints: usize) -> Option<Row> {
    warm_start.q_plan.as_ref().filter(|q| q.len() == joints).map(|q| pick(q))
}

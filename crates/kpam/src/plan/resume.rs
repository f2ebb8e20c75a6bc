//! Going on with a motion from its middle, and what an earlier plan is good for.

use gensim2_geometry::{Pose, rotation_log};
use nalgebra::{Rotation3, Vector3};

use super::Plan;
use super::planner::Planner;
use crate::hand_path::Guide;
use crate::model::Row;
use crate::motion::HandPath;
use crate::world::{Leg, Margins, Way};

/// Places at which a path is compared with where the hand is.
const PLACES: usize = 64;
/// A radian counts as this many metres there.
const LEVER: f64 = 0.1;
/// Time between waypoints that are taken from an earlier plan (s).
const STEP: f64 = 0.05;
/// The earlier way serves where its ends are within this of the present state and of the goal (rad or m).
const NEAR_START: f64 = 0.05;
const AT_GOAL: f64 = 1e-3;

/// The rest of a hand path, from where the hand is. What it is off the path fades out on the way.
pub(super) struct Rest<'p> {
    path: &'p HandPath,
    /// Part of the path that is done.
    pub begin: f64,
    off: Vector3<f64>,
    turned: Vector3<f64>,
}

impl<'p> Rest<'p> {
    /// The rest of a path for a hand that is near it.
    pub fn new(path: &'p HandPath, hand: &Pose) -> Self {
        let apart = |s: f64| {
            let at = path.at(s);
            let way = (hand.translation.vector - at.translation.vector).norm();
            way + LEVER * rotation_log(&(hand.rotation * at.rotation.inverse())).norm()
        };
        let place = |k: usize| k as f64 / PLACES as f64;
        let nearest = (0..=PLACES).min_by(|a, b| apart(place(*a)).total_cmp(&apart(place(*b)))).unwrap_or(0);
        let (mut low, mut high) = (place(nearest.saturating_sub(1)), place((nearest + 1).min(PLACES)));
        for _ in 0..40 {
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
    /// What is left of a path for the hand where the motion begins.
    pub(super) fn rest_of<'m>(&mut self, path: &'m HandPath) -> Rest<'m> {
        let start = self.leads[self.lead].rest();
        let hand = self.follower.hand(&start);
        Rest::new(path, &hand)
    }

    /// The way of the earlier plan from `start` to `goal`, where it leads there and is free.
    pub(super) fn former_way(&mut self, start: &Row, goal: &Row, leg: Leg, margins: &Margins) -> Option<Vec<Row>> {
        let former = self.former?;
        let (trajectory, end) = (former.trajectory.as_ref()?, former.keyframes.get(self.entry)?.time?);
        let n = self.model.n();
        let apart = |a: &Row, b: &Row| (0..n).map(|v| (a[v] - b[v]).abs()).fold(0.0, f64::max);
        let steps = ((end - trajectory.start()) / STEP).ceil().max(1.0);
        let mut way: Vec<Row> = (0..=steps as usize)
            .map(|k| trajectory.moving(trajectory.start() + (end - trajectory.start()) * k as f64 / steps))
            .collect();
        let nearest = (0..way.len()).min_by(|a, b| apart(&way[*a], start).total_cmp(&apart(&way[*b], start)))?;
        if apart(&way[nearest], start) > NEAR_START || apart(way.last()?, goal) > AT_GOAL {
            return None;
        }
        // On from the waypoint after the nearest: that one may lie behind.
        way.drain(..(nearest + 1).min(way.len() - 1));
        way.insert(0, *start);
        if let Some(last) = way.last_mut() {
            *last = *goal;
        }
        self.world.sweep_along(Way::still(&way), leg, margins).is_none().then_some(way)
    }
}

/// The actuation pose of an earlier plan as variables.
pub(super) fn former_pose(former: &Plan, pick: impl Fn(&[f64]) -> Row, joints: usize) -> Option<Row> {
    former.q_plan.as_ref().filter(|q| q.len() == joints).map(|q| pick(q))
}

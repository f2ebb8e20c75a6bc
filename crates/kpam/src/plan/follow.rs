//! Follows the hand paths before and after one candidate for the actuation pose.

use gensim2_geometry::Pose;

use super::attempt::Attempt;
use super::failure::{Failure, PathEnd};
use super::planner::Planner;
use crate::hand_path::Followed;
use crate::model::Row;
use crate::motion::motions;
use crate::world::{Margins, State, Way, World, even, travel_along, travel_over};

impl Planner<'_> {
    /// Follows the hand paths from one actuation pose as far as the arm can. If `one_of_many` is set, stops at the
    /// first reason to reject the pose.
    pub(super) fn followed(&mut self, x: &Row, one_of_many: bool) -> Attempt {
        let hand = self.follower.hand(x);
        let motions = motions(self.problem, &hand);
        let act = motions.actuation;
        let first = if self.entry > act { self.entry - 1 } else { self.entry };
        let mut out = Attempt::new(x, motions, first);
        self.act(&out);
        self.follow(&mut out, one_of_many);
        out.reach = (out.after, out.failure.clone());
        out
    }

    fn follow(&mut self, out: &mut Attempt, one_of_many: bool) {
        let act = out.motions.actuation;
        let plain = self.overlaps_only();
        let overlap = match self.entry <= act {
            true => {
                let segment = self.world.schedule.last_before_actuation();
                let x = out.x;
                self.judge(one_of_many, |world| world.hit_at(State::still(&x), segment, &plain))
            }
            false => None,
        };
        if let Some(hit) = overlap {
            out.hits.push((act, hit.clone()));
            if self.problem.options.avoid_collisions {
                out.failure = Some(Failure::Blocked { keyframe: act, hit });
                out.overlaps = true;
                return;
            }
        }
        self.follow_before(out);
        // A pose that the robot cannot approach is rejected, so the paths after the actuation need not be followed.
        if one_of_many {
            self.see_before(out);
        }
        if one_of_many && out.failure.is_some() {
            return;
        }
        if out.failure.is_none() {
            self.follow_after(out);
        }
        self.unwind(out);
        if self.entry > act {
            self.take_up(out);
        }
    }

    /// Returns margins of zero, so that only overlaps violate them. If the motion has an approach, bodies that
    /// overlapped at the start count as separated.
    pub(super) fn overlaps_only(&self) -> Margins {
        let plain = Margins::plain(0.0);
        if self.entry > self.world.schedule.actuation() { plain } else { plain.parted() }
    }

    /// Applies the gripper's action at the actuation pose to the scene: picked bodies are attached to the hand, and
    /// released bodies are left in place.
    pub(super) fn act(&mut self, attempt: &Attempt) {
        if self.acting != Some(attempt.origin) {
            self.world.act_at(&attempt.origin, attempt.motions.letting_go());
            self.acting = Some(attempt.origin);
        }
    }

    /// Returns a collision that rejects an attempt. If `one_of_many` is set, every collision does.
    pub(super) fn judge<T>(&mut self, one_of_many: bool, look: impl FnOnce(&mut World<'_>) -> Option<T>) -> Option<T> {
        self.world.set_early_exit(one_of_many && !self.explain && self.problem.options.avoid_collisions);
        let hit = look(&mut self.world);
        self.world.set_early_exit(false);
        hit
    }

    /// Looks for reasons to reject the motion before the actuation: an obstacle at a waypoint or at the free approach's
    /// end. On the approach, hand and fingers may not touch the bodies that they may touch on the next path.
    fn see_before(&mut self, out: &mut Attempt) {
        let act = out.motions.actuation;
        if out.failure.is_some() || self.entry > act || !self.problem.options.avoid_collisions {
            return;
        }
        let goal = out.arrival(self.entry);
        let toward = self.world.schedule.toward(self.entry);
        let mut plain = Margins::plain(0.0);
        if self.problem.options.reach_clearance.is_some() {
            // A pair of bodies that is already closer than the margin keeps its distance.
            plain = self.world.margins_between([State::still(&goal); 2], toward, 0.0);
        }
        if let Some(hit) = self.judge(true, |world| world.hit_at(State::still(&goal), toward, &plain)) {
            out.failure = Some(Failure::Blocked { keyframe: self.entry, hit });
            return;
        }
        let parted = self.overlaps_only();
        for i in (self.entry..act).rev() {
            let segment = self.world.schedule.along(i);
            let met = self.judge(true, |world| world.hit_at_any(out.way(i), segment, &parted));
            if let Some((_, hit)) = met {
                out.block(i, hit);
                return;
            }
        }
    }

    /// Resumes a motion after the actuation pose: overlaps at the current pose may persist, and the braking motion is
    /// swept. If it is blocked, the paths are followed from the current pose; the motion under execution may be free.
    fn take_up(&mut self, out: &mut Attempt) {
        let path = self.entry - 1;
        let segment = self.world.schedule.along(path);
        let travel = out.travel[path].first().copied().unwrap_or(0.0);
        let near = self.model.start();
        let start = State { x: &near, travel };
        self.world.measure_start(start, segment);
        if let Some(hit) = self.too_deep() {
            out.failure = Some(Failure::Inside { keyframe: self.entry, hit });
            return;
        }
        let way = self.stop_way();
        let brake = Way { waypoints: &way.waypoints, travel: &[travel], off: &way.off };
        let margins = self.world.margins_between([start, start], segment, self.margin);
        let hit = self.world.sweep_along(brake, segment, &margins).map(|(_, hit)| hit);
        if !self.stop.is_empty() {
            self.stop_checked = Some(hit.clone());
        }
        if self.blocked_stop().is_some() {
            out.failure = None;
            self.follow_after(out);
        } else if let Some(hit) = hit {
            out.hits.push((self.entry, hit.clone()));
            if self.problem.options.avoid_collisions {
                out.failure = Some(Failure::Blocked { keyframe: self.entry, hit });
            }
        }
    }

    /// Follows the paths before the actuation. The attempt fails unless all of them can be followed to their ends.
    fn follow_before(&mut self, out: &mut Attempt) {
        let act = out.motions.actuation;
        let mut at = out.x;
        for i in (self.entry..act).rev() {
            let Followed { mut waypoints, fraction } = self.follower.follow(&out.motions.paths[i], &at, true);
            if fraction < 1.0 {
                let end = self.path_end(&waypoints, &out.motions.paths[i].at(0.0));
                out.failure = Some(self.path_failure(i, fraction, end));
                return;
            }
            waypoints.reverse();
            at = waypoints[0];
            out.paths[i] = waypoints;
        }
    }

    /// Follows the paths after the actuation as far as possible.
    fn follow_after(&mut self, out: &mut Attempt) {
        let act = out.motions.actuation;
        let mut at = out.x;
        let mut travel = 0.0;
        for i in act..out.paths.len() {
            let path = &out.motions.paths[i];
            // Paths before keyframe `entry` are executed; the path to it is followed from the current state.
            if i + 1 < self.entry {
                travel = travel_over(self.problem, i - act, path, travel, 0.0..1.0);
                continue;
            }
            let (waypoints, done, fraction) = if i + 1 == self.entry {
                let (waypoints, done, fraction) = self.rest_of(path);
                travel = travel_over(self.problem, i - act, path, travel, 0.0..done[0]);
                (waypoints, done, fraction)
            } else {
                let Followed { waypoints, fraction } = self.follower.follow(path, &at, false);
                let done = even(&(0.0..fraction), waypoints.len());
                (waypoints, done, fraction)
            };
            at = waypoints[waypoints.len() - 1];
            out.travel[i] = travel_along(self.problem, i - act, path, travel, &done);
            travel = out.travel[i].last().copied().unwrap_or(travel);
            out.paths[i] = waypoints;
            if fraction < 1.0 {
                let end = self.path_end(&out.paths[i], &out.motions.paths[i].at(1.0));
                out.failure = Some(self.path_failure(i + 1, fraction, end));
                out.after = (i - act, fraction);
                return;
            }
            out.after.0 = i - act + 1;
        }
    }

    /// Returns the failure of a path that was followed only in part.
    fn path_failure(&self, keyframe: usize, fraction: f64, end: PathEnd) -> Failure {
        if self.over.is_cancelled() {
            return Failure::Unproven { keyframe };
        }
        Failure::Unreachable { keyframe, fraction, end }
    }

    /// Returns the reason why the hand cannot reach `goal` from the last waypoint.
    fn path_end(&mut self, waypoints: &[Row], goal: &Pose) -> PathEnd {
        let x = waypoints.last().copied().unwrap_or_else(|| self.model.start());
        let left = goal.translation.vector - self.follower.hand(&x).translation.vector;
        PathEnd { left, limit: self.follower.limit_at(&x) }
    }

    /// Subtracts whole turns of an unlimited joint if the motion would begin more than half a turn from the start, so
    /// that the approach turns the joint in the shorter direction.
    fn unwind(&self, out: &mut Attempt) {
        let before = out.paths.get(self.entry..out.motions.actuation);
        let Some(first) = before.and_then(<[_]>::first).and_then(|path| path.first()) else { return };
        let near = self.model.unwound(first, &self.model.start());
        let shift: Vec<f64> = (0..self.model.n()).map(|v| near[v] - first[v]).collect();
        for x in out.paths.iter_mut().flatten().chain(std::iter::once(&mut out.x)) {
            x.iter_mut().zip(&shift).for_each(|(value, by)| *value += by);
        }
    }
}

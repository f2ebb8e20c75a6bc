//! Sweeps: collision checks of the motion between states. Positions on a path are fractional indices of its waypoints.

use gensim2_geometry::Target;

use super::bubble::{Bubble, Near};
use super::movers::off_axis;
use super::query::Seen;
use super::rules::Carrier;
use super::way::{Gone, Way};
use super::{Hit, Margins, MotionSegment, State, World};
use crate::ObjectJointKind;
use crate::model::Row;

/// Gaps are capped at this value (m), so no step of a sweep is longer.
const REACH: f64 = 0.12;
/// Only bodies within this multiple of the smallest gap, and at least those within `NARROW` (m), are considered, since
/// steps are short close to an obstacle.
const AHEAD: f64 = 3.0;
const NARROW: f64 = 0.006;
/// Minimum step of a sweep (m). Between two checks, no point moves further than the gap or this value.
const FINEST: f64 = 0.0015;
/// If the boxes of two shapes are further apart than this (m), the distance of the boxes replaces the exact distance.
const COARSE: f64 = 0.02;

/// The next bubble is centred beyond the end of the last bubble by this fraction of that bubble's extent. It is useful
/// only if it extends back to that end.
const AGAIN: f64 = 0.7;

/// A path that is checked for collisions, and the progress of the check.
struct Course<'w> {
    way: Way<'w>,
    segment: MotionSegment,
    margins: &'w Margins,
    gone: Gone,
    end: f64,
    /// The path is free up to this position, where the next check starts.
    t: f64,
    /// Extent of the last bubble along the path.
    ahead: f64,
    /// Distance (m) at which gaps are capped.
    reach: f64,
}

/// Extent of a bubble along a path.
struct Onwards {
    /// Position of the centre.
    at: f64,
    /// Next position to check. It exceeds the position up to which the path is inside the bubble by at most the minimum
    /// step.
    next: f64,
}

impl World<'_> {
    /// Returns a waypoint, other than the first, at which a checked pair violates its margin, if any. The middle
    /// waypoint is checked first, then the middles of the remaining parts, because this order finds obstacles early.
    pub fn hit_at_any(&mut self, way: Way<'_>, segment: MotionSegment, margins: &Margins) -> Option<(usize, Hit)> {
        let mut stride = way.waypoints.len().next_power_of_two();
        while stride > 1 {
            let half = stride / 2;
            for k in (half..way.waypoints.len()).step_by(stride) {
                if self.cut_short() {
                    return None;
                }
                if let Some(hit) = self.hit_at(way.state(k), segment, margins) {
                    return Some((k, hit));
                }
            }
            stride = half;
        }
        None
    }

    /// Returns whether a checked pair violates its margin at any of `count` evenly spaced positions of `way`. The start
    /// is not checked, but the end is.
    pub fn is_hit_at(&mut self, way: Way<'_>, segment: MotionSegment, margins: &Margins, count: usize) -> bool {
        let end = (way.waypoints.len() - 1) as f64;
        (1..=count).any(|k| {
            let (x, travel) = way.at(end * k as f64 / count as f64);
            self.hit_at(State { x: &x, travel }, segment, margins).is_some()
        })
    }

    /// Computes the maximum displacement of each group's points per unit of each joint (m per rad or m).
    fn measure_levers(&self, segment: MotionSegment, levers: &mut Vec<f64>) {
        let table = self.table(segment);
        let joints = table.carried.joints;
        let poses = self.scratch.poses();
        levers.clear();
        levers.resize(joints * self.objects.groups.len(), 0.0);
        for &group in &table.present {
            if self.shapes.is_bare(group) {
                continue;
            }
            let middle = poses[group] * self.middles[group];
            let extent = self.extents[group];
            let row = &mut levers[group * joints..(group + 1) * joints];
            for (m, carries) in table.carried.row(group).iter().enumerate().take(joints - 1) {
                if *carries {
                    row[m] = self.movers.lever(&self.problem.robot, m, poses, &middle, extent);
                }
            }
            if table.carriers[group] == Carrier::Joint
                && let Some(joint) = &self.problem.joint
            {
                row[joints - 1] = match joint.kind {
                    ObjectJointKind::Prismatic => 1.0,
                    ObjectJointKind::Revolute => off_axis(&middle, &joint.origin, &joint.axis) + extent,
                };
            }
        }
    }

    /// Returns a bubble around a position of a path, or the pair that violates its margin there.
    fn bubble(&mut self, course: &Course<'_>, at: f64) -> Result<Bubble, Hit> {
        let &Course { segment, margins, reach, .. } = course;
        let (x, travel) = course.way.at(at);
        self.place(State { x: &x, travel }, segment);
        let mut bubble = std::mem::take(&mut self.spare);
        (bubble.center, bubble.travel) = (x, travel);
        bubble.joints = self.movers.len() + 1;
        bubble.pairs.clear();
        self.measure_levers(segment, &mut bubble.levers);
        let mut blocked = None;
        // Distances of boxes are used only where they exceed every margin.
        let clearance = margins.clearance.max(self.reach_clearance());
        let coarse = COARSE.max(clearance + NARROW);
        let within = clearance + reach;
        self.look(
            segment,
            coarse,
            |_, _, _| within,
            |world, seen, p| {
                let gap = p.contact.distance - world.asked(segment, margins, p.group, seen);
                if gap < 0.0 {
                    blocked = Some(*p);
                    return false;
                }
                let other = match (seen, p.target) {
                    (Seen::Pair(_), Target::Group(other)) => Some(other),
                    _ => None,
                };
                bubble.pairs.push(Near { gap, group: p.group, other });
                true
            },
        );
        if let Some(p) = blocked {
            self.spare = bubble;
            return Err(self.hit(&p));
        }
        // Groups for which no near body was found are at least this far away from all bodies.
        for &group in &self.table(segment).present {
            if !self.shapes.is_bare(group) {
                bubble.pairs.push(Near { gap: reach, group, other: None });
            }
        }
        Ok(bubble)
    }

    /// Returns how far each joint moves (not negative), the object's joint last.
    pub(super) fn steps(&mut self, from: (&Row, f64), to: (&Row, f64)) -> Vec<f64> {
        let mut steps = std::mem::take(&mut self.steps);
        self.movers.steps(from.0, to.0, &mut steps);
        steps.push((to.1 - from.1).abs());
        steps
    }

    /// Returns whether a state on a segment is inside the bubble, even after the permitted deviation.
    fn holds(&mut self, bubble: &Bubble, segment: MotionSegment, (x, travel): (&Row, f64), off: Option<&Row>) -> bool {
        let mut steps = self.steps((&bubble.center, bubble.travel), (x, travel));
        self.add_off(off, &mut steps);
        let inside = bubble.holds(&self.table(segment).carried, &steps);
        self.steps = steps;
        inside
    }

    /// Sweeps the straight joint segment from `a` to `b` with a fixed object joint; returns the first collision.
    pub fn sweep(&mut self, a: &Row, b: &Row, segment: MotionSegment, margins: &Margins) -> Option<Hit> {
        self.sweep_along(Way::still(&[*a, *b]), segment, margins).map(|(_, hit)| hit)
    }

    /// Prepares the check of a path from its start.
    fn course<'w>(&mut self, way: Way<'w>, segment: MotionSegment, margins: &'w Margins) -> Course<'w> {
        let (gone, end) = (self.gone(&way), (way.waypoints.len() - 1) as f64);
        Course { way, segment, margins, gone, end, t: 0.0, ahead: 0.0, reach: REACH }
    }

    /// Sweeps the straight joint segments between waypoints; returns the last waypoint before the first collision, and
    /// the collision. If planning must end, the sweep stops early without a collision and sets `unfinished`.
    pub fn sweep_along(&mut self, way: Way<'_>, segment: MotionSegment, margins: &Margins) -> Option<(usize, Hit)> {
        let mut course = self.course(way, segment, margins);
        while !self.cut_short() {
            match self.advance(&mut course) {
                Err(hit) => return Some(((course.t.ceil() as usize).saturating_sub(1), hit)),
                Ok(on) if on.at >= course.end => return None,
                Ok(on) => course.t = on.next,
            }
        }
        None
    }

    /// Returns the next bubble of a path, or the pair that violates its margin at the position that is checked next.
    fn advance(&mut self, course: &mut Course<'_>) -> Result<Onwards, Hit> {
        // A bubble centred further ahead that extends back to here covers nearly twice the length.
        let (t, at) = (course.t, (course.t + AGAIN * course.ahead).floor().min(course.end));
        if at > t
            && let Ok(bubble) = self.bubble(course, at)
        {
            let extends_back = self.holds_between(&bubble, course, (t as usize, at as usize));
            let on = extends_back.then(|| self.onwards(&bubble, course, at));
            self.spare = bubble;
            if let Some(on) = on {
                return Ok(on);
            }
        }
        let bubble = self.bubble(course, t)?;
        let is_end = t >= course.end;
        let on = if is_end { Onwards { at: t, next: t } } else { self.onwards(&bubble, course, t) };
        self.spare = bubble;
        Ok(on)
    }

    /// Returns how far a bubble around position `t` extends along a path, and where to continue.
    fn onwards(&mut self, bubble: &Bubble, course: &mut Course<'_>, t: f64) -> Onwards {
        let (way, segment) = (course.way, course.segment);
        let last = way.waypoints.len() - 1;
        let gap = bubble.pairs.iter().map(|p| p.gap).fold(REACH, f64::min);
        course.reach = (AHEAD * gap).clamp(NARROW, REACH);
        // First test whole segments, then a part of the next one. Bubbles are convex, so the straight line from the
        // centre to a point inside is inside, too.
        let from = t as usize;
        let mut k = from;
        let mut stride = 1;
        while k < last {
            let next = (k + stride).min(last);
            if self.holds_between(bubble, course, (from, next)) {
                k = next;
                stride *= 2;
            } else if stride > 1 {
                stride /= 2;
            } else {
                break;
            }
        }
        // The states are tested, too, because joints that have reversed are closer than their path length.
        while k < last && self.holds(bubble, segment, (&way.waypoints[k + 1], way.travel_at(k + 1)), way.off.get(k)) {
            k += 1;
        }
        let mut next = t.max(k as f64);
        if k < last && k == from {
            let steps = self.segment(&way, k);
            let mut times = bubble.times(&self.table(segment).carried, &steps);
            if let Some(off) = way.off.get(k) {
                // The used fraction of a gap grows linearly with the step; deviations from the segment leave less of
                // the gap for the step.
                let mut aside = vec![0.0; steps.len()];
                self.add_off(Some(off), &mut aside);
                times = (times * (1.0 - 1.0 / bubble.times(&self.table(segment).carried, &aside))).max(0.0);
            }
            next = (t + times).min((k + 1) as f64);
            self.steps = steps;
        } else if k < last {
            let (mut low, mut high) = (next, (k + 1) as f64);
            for _ in 0..6 {
                let middle = 0.5 * (low + high);
                let (x, travel) = way.at(middle);
                if self.holds(bubble, segment, (&x, travel), way.off.get(k)) {
                    low = middle;
                } else {
                    high = middle;
                }
            }
            next = low;
        }
        // Close to a body, continue by the minimum step, at most to the next waypoint, so that the movement between two
        // checks is bounded.
        let steps = self.segment(&way, (next as usize).min(last.saturating_sub(1)));
        let fastest = bubble.fastest(&steps);
        self.steps = steps;
        let finest = if fastest > 0.0 { FINEST / fastest } else { 1.0 };
        let on = next.max((t + finest).min((next as usize + 1) as f64)).min(last as f64);
        course.ahead = next - t;
        Onwards { at: t, next: on }
    }

    /// Returns whether the path between two waypoints is inside a bubble around a position between them.
    fn holds_between(&mut self, bubble: &Bubble, course: &Course<'_>, (from, to): (usize, usize)) -> bool {
        let gone = &course.gone;
        let mut steps = std::mem::take(&mut self.steps);
        steps.clear();
        let n = gone.joints;
        steps.extend((0..n).map(|j| gone.sums[to * n + j] - gone.sums[from * n + j] + gone.off[j]));
        let inside = bubble.holds(&self.table(course.segment).carried, &steps);
        self.steps = steps;
        inside
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::sync::Arc;

    use gensim2_geometry::{Pose, Robot};
    use nalgebra::Vector3;

    use super::*;
    use crate::model::{MAX_JOINTS, Model};
    use crate::{KeypointProblem, SolverConfig};

    #[test]
    fn sweeps_end_whatever_the_clearance() {
        // In an empty world every gap is at its maximum, for any clearance.
        let urdf = r#"<robot name="lever"><link name="base"/>
            <link name="bar"><collision><origin xyz="0.2 0 0"/><geometry><box size="0.4 0.02 0.02"/></geometry></collision></link>
            <joint name="turn" type="revolute"><parent link="base"/><child link="bar"/><axis xyz="0 0 1"/>
            <limit lower="-3" upper="3" effort="1" velocity="2"/></joint></robot>"#;
        let robot = Arc::new(Robot::from_urdf_str(urdf, "lever.urdf", None, "bar", None).unwrap());
        let config = SolverConfig::from_json(
            r#"{"constraint_list": [{"type": "point2point_constraint", "keypoint_name": "tip",
                "target_keypoint_name": "goal", "tolerance": 0.001}]}"#,
        )
        .unwrap();
        let point = |name: &str| BTreeMap::from([(name.to_owned(), Vector3::new(0.4, 0.0, 0.0))]);
        let (tip, goal, object) = (point("tip"), point("goal"), Pose::identity());
        let builder = KeypointProblem::builder(Arc::clone(&robot), config, vec![0.0]).object(object);
        let problem = builder.tool_keypoints(tip).object_keypoints(goal).build().unwrap();
        let model = Model::new(&robot, &[0.0]).unwrap();
        let mut world = World::new(&problem, &model);
        let row = |angle: f64| {
            let mut x = [0.0; MAX_JOINTS];
            x[0] = angle;
            x
        };
        let waypoints: Vec<Row> = (0..5).map(|k| row(0.3 * f64::from(k))).collect();
        for clearance in [0.0, 0.05, 0.12, 0.15, 0.2] {
            let hit = world.sweep_along(Way::still(&waypoints), MotionSegment::Approach, &Margins::plain(clearance));
            assert!(hit.is_none(), "{clearance}");
        }
        // A check that is cut short finds nothing, and says so.
        assert!(!world.unfinished);
        world.limit(None, Some(std::time::Instant::now()), None);
        let margins = Margins::plain(0.0);
        assert!(world.sweep_along(Way::still(&waypoints), MotionSegment::Approach, &margins).is_none());
        assert!(std::mem::take(&mut world.unfinished));
        assert!(world.hit_at_any(Way::still(&waypoints), MotionSegment::Approach, &margins).is_none());
        assert!(world.unfinished);
    }
}

//! The timed motion of an attempt. Segments are joined to one smooth path wherever the motion needs no stop.

use std::borrow::Cow;

use super::attempt::Attempt;
use super::failure::Failure;
use super::planner::Planner;
use crate::hand_path::OFF_PATH;
use crate::model::{MAX_JOINTS, Row};
use crate::motion::HandPath;
use crate::timing::{Blend, Builder, Node, Refusal, Spline, Trajectory, keeps, length, to_rest};
use crate::world::{Margins, MotionSegment};

/// The motion of an attempt as a trajectory in time.
#[derive(Clone)]
pub(super) struct Timed {
    pub trajectory: Trajectory,
    /// Time (s) at which the motion reaches each keyframe; `None` if it does not.
    pub times: Vec<Option<f64>>,
    /// Start and end of each segment (s).
    pub spans: Vec<[f64; 2]>,
}

/// Number of knots before and after a bend within which joining two segments changes the curve noticeably.
const BEND: usize = 6;
/// Number of parts of an interval between waypoints in which the speed of the contact point is checked.
const LOOKS: u32 = 4;
/// Maximum number of positions on the approach that are tried as the end of a motion leading from a moving start.
const PLACES: usize = 4;
/// A motion replaces the one that the robot executes only if it ends earlier by at least this time (s).
const SAVES: f64 = 1e-6;
/// Maximum difference of two states that count as equal (rad or m, and their rates per second).
const SAME: f64 = 1e-6;

/// How the motion continues from a moving start; the fastest kind comes first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum TakeUp {
    /// The robot continues the motion of the earlier plan.
    GoesOn,
    /// The motion begins while the arm still brakes from its start velocity.
    Blended,
    /// The motion begins once the arm has stopped.
    Stopped,
}

/// Joint waypoints of the part of a motion between two keyframes or stops.
#[derive(Clone)]
pub(super) struct Stretch<'a> {
    pub waypoints: Cow<'a, [Row]>,
    /// Travel of the object's joint at the waypoints.
    pub travel: Cow<'a, [f64]>,
    /// Identifies which pairs of bodies are checked; `kept` holds the minimum distances of these pairs.
    pub segment: MotionSegment,
    pub kept: &'a Margins,
    /// Keyframe at the end of the part; `None` if the part ends between keyframes.
    keyframe: Option<usize>,
    /// Index of the next keyframe that the part leads to.
    pub toward: usize,
    /// Whether the part lies after the actuation.
    contact: bool,
    /// Hand path that the part follows, and the fraction of the path that it covers.
    hand: Option<(&'a HandPath, f64)>,
    /// Whether the motion stops at the end of the part.
    pub stops: bool,
    due: Option<f64>,
}

impl Planner<'_> {
    /// Returns the timed motion along segments. A moving start joins the segments as early as possible; kinds of
    /// continuation faster than `manner` are excluded.
    pub(super) fn timed(
        &mut self,
        attempt: &Attempt,
        segments: &[Stretch<'_>],
        manner: TakeUp,
    ) -> Result<(Timed, TakeUp), Failure> {
        let keyframes = attempt.motions.keyframes.len();
        let going_on = if manner == TakeUp::GoesOn { self.going_on(attempt, segments) } else { None };
        if let Some(hit) = self.blocked_stop() {
            let blocked = Failure::Blocked { keyframe: self.entry, hit: hit.clone() };
            return going_on.map(|rest| (rest, TakeUp::GoesOn)).ok_or(blocked);
        }
        // If the config sets times, the start of the motion is fixed by them.
        let other = if self.stop.is_empty() || self.clock.is_some() {
            self.timed_from_rest(segments, keyframes).map(|timed| (timed, TakeUp::Stopped))
        } else {
            self.taken_up(segments, keyframes, manner.max(TakeUp::Blended))
        };
        match (going_on, other) {
            (Some(rest), Ok(other)) if rest.trajectory.end() > other.0.trajectory.end() + SAVES => Ok(other),
            (Some(rest), _) => Ok((rest, TakeUp::GoesOn)),
            (None, other) => other,
        }
    }

    /// Returns the remaining motion of the earlier plan, if it passes the current state at the start time and leads to
    /// the attempt's actuation pose.
    fn going_on(&self, attempt: &Attempt, segments: &[Stretch<'_>]) -> Option<Timed> {
        let former = self.warm_start?;
        let (motion, pose, start) = (former.trajectory()?, former.q_plan.as_ref()?, self.builder.now());
        let same = pose.len() == motion.joints()
            && motion.goes_on_from(self.model.map(), start, &self.start, SAME)
            && self.model.are_near(&self.model.pick(pose), &attempt.x, SAME)
            && self.builder.limits().admit(motion.limits())
            && former.keyframes.len() == attempt.motions.keyframes.len();
        if !same || self.stop.is_empty() || self.clock.is_some() || start >= motion.end() {
            return None;
        }
        let mut times = vec![None; former.keyframes.len()];
        let mut spans: Vec<[f64; 2]> = Vec::new();
        for segment in segments {
            let keyframe = segment.keyframe?;
            let (begin, end) = (spans.last().map_or(start, |span| span[1]), former.keyframes[keyframe].time?);
            if !(begin..=motion.end()).contains(&end) {
                return None;
            }
            times[keyframe] = Some(end);
            spans.push([begin, end]);
        }
        let trajectory = motion.since(start).ok()?;
        let whole = spans.last().is_some_and(|span| span[1] >= trajectory.end() - SAVES);
        (whole && self.builder.bears(&trajectory)).then_some(Timed { trajectory, times, spans })
    }

    /// Returns the earliest motion from a moving start. It first moves to a position on the approach, and follows the
    /// segments from there.
    fn taken_up(
        &mut self,
        segments: &[Stretch<'_>],
        keyframes: usize,
        manner: TakeUp,
    ) -> Result<(Timed, TakeUp), Failure> {
        // In contact the hand must keep its path and speed, but the sum of two motions does not keep them.
        let manner = if segments.first().is_none_or(|first| first.contact) { TakeUp::Stopped } else { manner };
        let free = segments.first().filter(|_| manner == TakeUp::Blended);
        let places = free.map_or(0, |first| first.waypoints.len() - 1);
        let mut best: Option<Timed> = None;
        let mut failure = None;
        for part in 0..=places.min(PLACES) {
            let place = part * places / places.clamp(1, PLACES);
            match self.past(segments, keyframes, place, manner) {
                Ok(Some(timed)) if best.as_ref().is_none_or(|b| timed.trajectory.end() < b.trajectory.end()) => {
                    best = Some(timed);
                }
                Ok(_) => {}
                Err(why) => failure = failure.or(Some(why)),
            }
        }
        let untimed = Failure::Untimed { keyframe: segments.first().map_or(self.entry, |first| first.toward) };
        best.map(|timed| (timed, manner)).ok_or_else(|| failure.unwrap_or(untimed))
    }

    /// Returns the motion to waypoint `place` of the first segment and on along the segments, as early as `manner`
    /// allows.
    fn past(
        &mut self,
        segments: &[Stretch<'_>],
        keyframes: usize,
        place: usize,
        manner: TakeUp,
    ) -> Result<Option<Timed>, Failure> {
        let room = [&self.model.lower, &self.model.upper];
        let mut rest = segments.to_vec();
        let mut lead = self.stop.clone();
        if place > 0 {
            let waypoints = segments[0].waypoints[place..].to_vec();
            let [position, velocity, acceleration] = &self.start;
            lead = to_rest(self.builder.limits(), position, velocity, acceleration, &waypoints[0]);
            let path = Spline::through(self.model.n(), &waypoints, None);
            if !keeps(self.builder.limits(), room, &lead) || !path.keeps_within(0..path.intervals(), room[0], room[1]) {
                return Ok(None);
            }
            rest[0].waypoints = Cow::Owned(waypoints);
        }
        let mut timed = self.timed_from_rest(&rest, keyframes)?;
        let start = timed.trajectory.start();
        // The motion reaches the first keyframe, or its end, only after the leading motion has stopped.
        let first = timed.times.iter().flatten().copied().fold(timed.trajectory.end(), f64::min);
        let earliest = lead.last().map_or(0.0, |node: &Node| node.time) - (first - start);
        let blend = Blend { lead: &lead, limits: self.builder.limits(), room, earliest };
        let (trajectory, late) = match manner {
            TakeUp::Stopped => blend.one_after_the_other(&timed.trajectory),
            TakeUp::GoesOn | TakeUp::Blended => blend.of(&timed.trajectory),
        };
        timed.times.iter_mut().flatten().for_each(|time| *time += late);
        timed.spans.iter_mut().flatten().for_each(|time| *time += late);
        if let Some(first) = timed.spans.first_mut() {
            first[0] = start;
        }
        if let Some(last) = timed.spans.last_mut() {
            last[1] = trajectory.end();
        }
        timed.trajectory = trajectory;
        Ok(self.builder.bears(&timed.trajectory).then_some(timed))
    }

    /// Returns the timed motion along segments from rest at their start. If the config sets times, the time of braking
    /// to rest is part of the motion.
    fn timed_from_rest(&mut self, segments: &[Stretch<'_>], keyframes: usize) -> Result<Timed, Failure> {
        let mut times = vec![None; keyframes];
        let mut ends: Vec<f64> = Vec::with_capacity(segments.len());
        let mut builder = self.builder.clone();
        if self.clock.is_some() {
            builder.append_nodes(&self.stop);
        }
        let mut rest = segments;
        let mut outcome = Ok(());
        while !rest.is_empty() && outcome.is_ok() {
            let whole = rest.iter().position(|segment| segment.stops).map_or(rest.len(), |k| k + 1);
            let mut joined = self.joined(&rest[..whole]);
            outcome = loop {
                match self.drive(&mut builder, &rest[..joined], &mut times) {
                    Ok(passed) => {
                        ends.extend(passed);
                        break Ok(());
                    }
                    Err(_) if joined > 1 && !self.over.is_cancelled() => joined -= 1,
                    Err(failure) => break Err(failure),
                }
            };
            rest = &rest[joined..];
        }
        outcome?;
        let trajectory = builder.build(self.model.map());
        if let Some(last) = ends.last_mut() {
            *last = trajectory.end();
        }
        let begins = std::iter::once(trajectory.start()).chain(ends.iter().copied());
        let spans = begins.zip(&ends).map(|(begin, end)| [begin, *end]).collect();
        Ok(Timed { trajectory, times, spans })
    }

    /// Returns the segments of an attempt's motion; `clock` holds the keyframe times of the config, if it sets any.
    pub(super) fn segments<'a>(&self, attempt: &'a Attempt, clock: Option<&[f64]>) -> Vec<Stretch<'a>> {
        let n = self.model.n();
        let act = attempt.motions.actuation;
        let options = &self.problem.options;
        // The gripper moves at the actuation pose and where the hand releases the object, so the motion stops there.
        let acts = self.problem.config.gripper.acts() || !options.pick.is_empty() || !options.release.is_empty();
        let lets_go_at = attempt.motions.lets_go_at;
        let rests = |keyframe: usize| clock.is_some() || (keyframe == act && acts) || lets_go_at == Some(keyframe);
        let mut segments = Vec::new();
        let total: f64 = attempt.approach.iter().map(|piece| length(n, piece)).sum();
        let mut gone = 0.0;
        let begin = self.builder.now() + self.stop.last().map_or(0.0, |node| node.time);
        for (k, waypoints) in attempt.approach.iter().enumerate() {
            gone += length(n, waypoints);
            let last = k + 1 == attempt.approach.len();
            // Each part of the approach gets time in proportion to its length.
            let due = clock.map(|c| {
                let end = c[self.entry];
                if last || total == 0.0 { end } else { begin + (end - begin) * gone / total }
            });
            segments.push(Stretch {
                waypoints: Cow::Borrowed(waypoints),
                travel: Cow::Borrowed(&[]),
                segment: self.world.schedule.toward(self.entry),
                kept: &attempt.kept,
                keyframe: last.then_some(self.entry),
                toward: self.entry,
                contact: self.entry > act,
                hand: None,
                stops: !last || rests(self.entry),
                due,
            });
        }
        let first = attempt.first;
        for (i, waypoints) in attempt.paths.iter().enumerate().skip(first) {
            if waypoints.len() < 2 {
                break;
            }
            let whole = i < act + attempt.after.0;
            let share = if whole { 1.0 } else { attempt.after.1 };
            // A part of a path gets the corresponding fraction of the path's time.
            let due = clock.map(|c| c[i] + (c[i + 1] - c[i]) * share);
            // A resumed motion first returns to its hand path, so it need not stay on the path.
            let kept = i >= act && i + 1 != self.entry;
            segments.push(Stretch {
                waypoints: Cow::Borrowed(waypoints),
                travel: Cow::Borrowed(&attempt.travel[i]),
                segment: self.world.schedule.along(i),
                kept: &attempt.margins[i],
                keyframe: whole.then_some(i + 1),
                toward: i + 1,
                contact: i >= act,
                hand: kept.then_some((&attempt.motions.paths[i], share)),
                stops: rests(i + 1),
                due,
            });
        }
        segments
    }

    /// Returns the number of segments that the motion can follow without a stop between them.
    fn joined(&mut self, segments: &[Stretch<'_>]) -> usize {
        let mut count = segments.len();
        // Dropping the last segment changes the shape of the curve only near its new end.
        while count > 1 {
            let (path, ends) = self.path(&segments[..count]);
            let bad = (0..count - 1).find(|k| !self.bend_stands(&segments[*k], &segments[k + 1], &path, &ends, *k));
            match bad {
                Some(k) => count = k + 1,
                None => break,
            }
        }
        count
    }

    /// Returns the spline through segments, and the indices of the waypoints at the ends of the segments.
    fn path(&self, segments: &[Stretch<'_>]) -> (Spline, Vec<usize>) {
        let mut waypoints: Vec<Row> = Vec::new();
        let mut ends = vec![0];
        for segment in segments {
            // The first waypoint of a segment equals the last one of the previous segment.
            waypoints.extend_from_slice(&segment.waypoints[usize::from(!waypoints.is_empty())..]);
            ends.push(waypoints.len() - 1);
        }
        (Spline::through(self.model.n(), &waypoints, None), ends)
    }

    /// Returns whether the path keeps the joint limits and the hand path near the bend after segment `k`.
    fn bend_stands(
        &mut self,
        segment: &Stretch<'_>,
        next: &Stretch<'_>,
        path: &Spline,
        ends: &[usize],
        k: usize,
    ) -> bool {
        let [start, corner, end] = [k, k + 1, k + 2].map(|i| path.knot_of(ends[i]));
        let before = start.max(corner.saturating_sub(BEND))..corner;
        let after = corner..end.min(corner + BEND);
        self.side_stands(segment, path, before, start) && self.side_stands(next, path, after, corner)
    }

    fn side_stands(
        &mut self,
        segment: &Stretch<'_>,
        path: &Spline,
        knots: std::ops::Range<usize>,
        first: usize,
    ) -> bool {
        if !path.keeps_within(knots.clone(), &self.model.lower, &self.model.upper) {
            return false;
        }
        if let Some((hand, share)) = segment.hand {
            let steps = (segment.waypoints.len() - 1) as f64;
            for i in knots.clone() {
                let wanted = hand.at(share * ((i - first) as f64 + 0.5) / steps).translation.vector;
                let there = self.follower.hand(&path.at(i, 0.5)).translation.vector;
                if (there - wanted).norm() > OFF_PATH {
                    return false;
                }
            }
        }
        true
    }

    /// Returns the minimum time (s) of each interval between waypoints at which the contact point keeps its speed
    /// limit, assuming constant speed in each interval.
    fn slowest(&mut self, segments: &[Stretch<'_>], path: &Spline, ends: &[usize]) -> Vec<f64> {
        let Some(speed) = self.problem.options.contact_speed else { return Vec::new() };
        let tip = nalgebra::Point3::from(self.problem.contact_point());
        let mut out = vec![0.0; path.waypoints() - 1];
        for (_, pair) in segments.iter().zip(ends.windows(2)).filter(|(segment, _)| segment.contact) {
            for w in pair[0]..pair[1] {
                let i = path.knot_of(w);
                if path.knot_of(w + 1) == i {
                    continue;
                }
                let mut last = self.follower.hand(&path.at(i, 0.0)) * tip;
                let mut furthest: f64 = 0.0;
                for k in 1..=LOOKS {
                    let now = self.follower.hand(&path.at(i, f64::from(k) / f64::from(LOOKS))) * tip;
                    furthest = furthest.max((now - last).norm());
                    last = now;
                }
                out[w] = f64::from(LOOKS) * furthest / speed;
            }
        }
        out
    }

    /// Appends a motion that follows several segments without a stop; returns the time at the end of each segment.
    fn drive(
        &mut self,
        builder: &mut Builder,
        segments: &[Stretch<'_>],
        times: &mut [Option<f64>],
    ) -> Result<Vec<f64>, Failure> {
        let (path, ends) = self.path(segments);
        let slowest = self.slowest(segments, &path, &ends);
        let last = &segments[segments.len() - 1];
        let marks = &ends[1..];
        let begin = builder.now();
        let passed =
            builder.push(&path, &slowest, &[0.0; MAX_JOINTS], last.due, marks).map_err(|refusal| match refusal {
                Refusal::TooLong(needed) => {
                    let allowed = last.due.map_or(0.0, |d| d - begin);
                    Failure::TooFast { keyframe: last.toward, allowed, needed }
                }
                Refusal::TooSharp => Failure::Untimed { keyframe: last.toward },
                Refusal::Cancelled => Failure::Unproven { keyframe: last.toward },
            })?;
        for (segment, time) in segments.iter().zip(&passed) {
            if let Some(keyframe) = segment.keyframe {
                times[keyframe] = Some(*time);
            }
        }
        Ok(passed)
    }
}

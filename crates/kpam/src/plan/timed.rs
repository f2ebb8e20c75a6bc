//! The timed motion of an attempt: segments joined to one smooth path wherever nothing has to stop.

use std::borrow::Cow;

use super::approach::{NEAR, WIDE};
use super::attempt::Attempt;
use super::failure::Failure;
use super::planner::Planner;
use crate::hand_path::OFF_PATH;
use crate::model::{MAX_JOINTS, Row};
use crate::motion::HandPath;
use crate::timing::{Builder, Refusal, Spline, Trajectory, append, length, rounded, unit};
use crate::world::{Margins, MotionSegment};

/// A motion in time.
#[derive(Clone)]
pub(super) struct Timed {
    pub trajectory: Trajectory,
    /// When each keyframe is met, where it is.
    pub times: Vec<Option<f64>>,
    /// When each segment begins and ends (s).
    pub spans: Vec<[f64; 2]>,
}

/// Knots on either side of a bend within which joining two segments moves the curve by anything that counts.
const BEND: usize = 6;
/// Parts of an interval in which the speed of the point that touches is looked at.
const LOOKS: u32 = 4;
/// Joint waypoints that lead from one keyframe, or stop, to the next.
pub(super) struct Stretch<'a> {
    pub waypoints: Cow<'a, [Row]>,
    /// Travel of the object's joint at the waypoints.
    pub travel: Cow<'a, [f64]>,
    /// Pairs checked along it, and the margins that it keeps.
    pub segment: MotionSegment,
    pub kept: &'a Margins,
    /// Keyframe at its end; none for part of the approach or of a path.
    keyframe: Option<usize>,
    /// Keyframe that it leads to.
    pub toward: usize,
    /// Whether it comes after the actuation.
    contact: bool,
    /// Path of the hand that it keeps to, and how much of that it goes.
    hand: Option<(&'a HandPath, f64)>,
    /// Whether the motion rests at its end.
    pub stops: bool,
    due: Option<f64>,
}

impl Planner<'_> {
    /// The timed motion along segments.
    pub(super) fn timed(&mut self, segments: &[Stretch<'_>], keyframes: usize) -> Result<Timed, Failure> {
        let mut times = vec![None; keyframes];
        let mut ends: Vec<f64> = Vec::with_capacity(segments.len());
        let transition = self.transitions[self.transition].clone();
        let mut builder = self.builder.clone();
        append(&mut builder, &transition, &self.start);
        let mut velocity = transition.velocity();
        let mut rest = segments;
        let mut outcome = Ok(());
        while !rest.is_empty() && outcome.is_ok() {
            let whole = rest.iter().position(|segment| segment.stops).map_or(rest.len(), |k| k + 1);
            let mut joined = self.joined(&rest[..whole], &velocity);
            outcome = loop {
                match self.drive(&mut builder, &rest[..joined], &velocity, &mut times) {
                    Ok(passed) => {
                        ends.extend(passed);
                        break Ok(());
                    }
                    // Only a start under way can be too fast for a bend.
                    Err(_) if joined > 1 => joined -= 1,
                    Err(failure) => break Err(failure),
                }
            };
            velocity = [0.0; MAX_JOINTS];
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

    /// The segments of an attempt as far as it goes.
    pub(super) fn segments<'a>(&self, attempt: &'a Attempt, clock: Option<&[f64]>) -> Vec<Stretch<'a>> {
        let n = self.model.n();
        let act = attempt.motions.actuation;
        let options = &self.problem.options;
        // The gripper acts at the actuation pose, and where the hand lets go.
        let acts = self.problem.config.gripper.acts() || !options.pick.is_empty() || !options.release.is_empty();
        let lets_go_at = attempt.motions.lets_go_at;
        let rests = |keyframe: usize| clock.is_some() || (keyframe == act && acts) || lets_go_at == Some(keyframe);
        let mut segments = Vec::new();
        let total: f64 = attempt.approach.iter().map(|piece| length(n, piece)).sum();
        let mut gone = 0.0;
        for (k, waypoints) in attempt.approach.iter().enumerate() {
            gone += length(n, waypoints);
            let last = k + 1 == attempt.approach.len();
            // Pieces share the time by their length.
            let due = clock.map(|c| {
                let (begin, end) = (self.builder.now(), c[self.entry]);
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
        if self.entry > act
            && let (Some(line), Some(travel)) =
                (self.transitions[self.transition].line(), attempt.travel[first].first())
        {
            // Under way past the actuation: on along the line, and back to the path of the hand without a stop.
            segments.push(Stretch {
                waypoints: Cow::Owned(rounded(n, &line, WIDE, NEAR)),
                travel: Cow::Owned(vec![*travel]),
                segment: self.world.schedule.along(first),
                kept: &attempt.margins[first],
                keyframe: None,
                toward: self.entry,
                contact: self.entry > act,
                hand: None,
                stops: clock.is_some(),
                due: None,
            });
        }
        for (i, waypoints) in attempt.paths.iter().enumerate().skip(first) {
            if waypoints.len() < 2 {
                break;
            }
            let whole = i < act + attempt.after.0;
            let share = if whole { 1.0 } else { attempt.after.1 };
            // A part of a path takes its part of the time.
            let due = clock.map(|c| c[i] + (c[i + 1] - c[i]) * share);
            // Taken up on the way, the hand comes back to its path by and by.
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

    /// Number of segments that can be driven in one go.
    fn joined(&mut self, segments: &[Stretch<'_>], velocity: &Row) -> usize {
        let mut count = segments.len();
        // A segment fewer may bend otherwise at the end, never more.
        while count > 1 {
            let (path, ends) = self.path(&segments[..count], velocity);
            let bad = (0..count - 1).find(|k| !self.bend_stands(&segments[*k], &segments[k + 1], &path, &ends, *k));
            match bad {
                Some(k) => count = k + 1,
                None => break,
            }
        }
        count
    }

    /// The path through segments, and the waypoint at the start of each and at the end.
    fn path(&self, segments: &[Stretch<'_>], velocity: &Row) -> (Spline, Vec<usize>) {
        let mut waypoints: Vec<Row> = Vec::new();
        let mut ends = vec![0];
        for segment in segments {
            // The first of a segment is the last of the one before.
            waypoints.extend_from_slice(&segment.waypoints[usize::from(!waypoints.is_empty())..]);
            ends.push(waypoints.len() - 1);
        }
        let n = self.model.n();
        let moving = velocity[..n].iter().any(|v| *v != 0.0);
        let tangent = unit(n, velocity);
        (Spline::through(n, &waypoints, moving.then_some(&tangent)), ends)
    }

    /// Whether the path keeps to joint limits and to the hand's path where segment `k` meets the next.
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

    /// Least time (s) of each interval between waypoints at the speed allowed in contact, were each driven evenly as
    /// fast as where the point that touches moves fastest.
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

    /// Appends the motion along segments that are driven in one go; when each of them ends.
    fn drive(
        &mut self,
        builder: &mut Builder,
        segments: &[Stretch<'_>],
        velocity: &Row,
        times: &mut [Option<f64>],
    ) -> Result<Vec<f64>, Failure> {
        let (path, ends) = self.path(segments, velocity);
        let slowest = self.slowest(segments, &path, &ends);
        let last = &segments[segments.len() - 1];
        let marks = &ends[1..];
        let begin = builder.now();
        let passed = builder.push(&path, &slowest, velocity, last.due, marks).map_err(|refusal| match refusal {
            Refusal::TooLong(needed) => {
                let allowed = last.due.map_or(0.0, |d| d - begin);
                Failure::TooFast { keyframe: last.toward, allowed, needed }
            }
            // Timing is not cancelled within a plan: it takes well under a millisecond.
            Refusal::TooSharp | Refusal::Cancelled => Failure::Untimed { keyframe: last.toward },
        })?;
        for (segment, time) in segments.iter().zip(&passed) {
            if let Some(keyframe) = segment.keyframe {
                times[keyframe] = Some(*time);
            }
        }
        Ok(passed)
    }
}

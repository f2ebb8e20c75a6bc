//! Planning of the motion through all keyframes for one candidate of the actuation pose.

use super::approach::Approach;
use super::connect::NoWay;
use super::failure::Failure;
use super::planner::{PAD, Planner};
use super::timed::Timed;
use crate::model::Row;
use crate::motion::Motions;
use crate::world::{Hit, Margins, MotionSegment, TOUCH, Way};

/// Number of positions at which a hand path is checked before its motion is timed.
const LOOKS: usize = 4;

/// Degree to which a motion has been checked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stage {
    /// The arm can follow the hand paths; obstacles have not been considered.
    Followed,
    /// All waypoints are collision-free; the motion between them has not been checked.
    Seen,
    /// The motion between the waypoints is collision-free as well and keeps its clearance.
    Swept,
}

/// The motion for one candidate up to its first failure: joint waypoints of each path, and the reason of the failure.
#[derive(Clone)]
pub(super) struct Attempt {
    pub x: Row,
    /// The actuation pose before whole turns of unlimited joints were subtracted.
    pub origin: Row,
    /// Index of the pose in the order in which the poses are tried.
    pub rank: usize,
    pub stage: Stage,
    pub motions: Motions,
    /// Waypoints of the free motions to the first keyframe, each from rest to rest; empty if none was found.
    pub approach: Vec<Vec<Row>>,
    /// Joint waypoints of each hand path; path `i` leads to keyframe `i + 1`. Paths after a failure are missing, and
    /// the path that failed ends at its last valid waypoint.
    pub paths: Vec<Vec<Row>>,
    /// Travel of the object's joint at the waypoints of each path; empty before the actuation.
    pub travel: Vec<Vec<f64>>,
    /// Free motions that stop at every corner. They are used if the motions in `approach` collide once they are timed.
    pub corners: Vec<Vec<Row>>,
    /// Whether the free motion was only checked at samples before it was timed.
    pub is_sampled: bool,
    /// Minimum distances between bodies on the free motion and on each path.
    pub kept: Margins,
    pub margins: Vec<Margins>,
    /// Number of paths after the actuation that were followed completely, and fraction of the next one.
    pub after: (usize, f64),
    pub hits: Vec<(usize, Hit)>,
    pub failure: Option<Failure>,
    /// Values of `after` without regard to obstacles, and the reason why the hand cannot go further.
    pub reach: ((usize, f64), Option<Failure>),
    /// Path and waypoint beyond which the motion is blocked, if an obstacle is known.
    seen: Option<(usize, usize)>,
    /// Whether the robot overlaps a body at the pose itself; no motion is searched then.
    pub overlaps: bool,
    /// The timed motion, if the motion up to the actuation pose is complete. It ends before the failure.
    pub timed: Option<Timed>,
    /// Index of the first path to plan; the robot has already executed the earlier paths.
    pub first: usize,
}

impl Attempt {
    pub fn new(x: &Row, motions: Motions, first: usize) -> Self {
        let count = motions.paths.len();
        let done = first.saturating_sub(motions.actuation);
        Self {
            x: *x,
            origin: *x,
            rank: 0,
            stage: Stage::Followed,
            motions,
            approach: Vec::new(),
            paths: vec![Vec::new(); count],
            travel: vec![Vec::new(); count],
            corners: Vec::new(),
            is_sampled: false,
            kept: Margins::plain(0.0),
            margins: vec![Margins::plain(0.0); count],
            after: (done, 0.0),
            hits: Vec::new(),
            failure: None,
            reach: ((done, 0.0), None),
            seen: None,
            overlaps: false,
            timed: None,
            first,
        }
    }

    /// Returns the extent of the timed motion, by which attempts are compared; zero if no motion was timed.
    pub fn score(&self) -> f64 {
        if self.timed.is_some() { self.extent() } else { 0.0 }
    }

    /// Whether the motion reaches the last keyframe.
    pub fn is_whole(&self) -> bool {
        self.timed.is_some() && self.failure.is_none()
    }

    /// Returns the extent of the motion, as if its approach were collision-free; zero if the motion ends at or before
    /// the actuation pose. The extent is an upper bound until the motion has been swept.
    pub fn extent(&self) -> f64 {
        let short = self.failure.as_ref().is_some_and(|f| f.keyframe() <= self.motions.actuation);
        if short { 0.0 } else { 1.0 + self.after.0 as f64 + self.after.1 }
    }

    /// Returns the fraction of a path after the actuation that was followed.
    fn followed(&self, path: usize) -> f64 {
        let (whole, part) = self.reach.0;
        if path - self.motions.actuation < whole { 1.0 } else { part }
    }

    /// Yields the paths in the order of checks: from the actuation pose back to the start, then onwards to the end.
    fn outwards(&self) -> impl Iterator<Item = usize> + use<> {
        let act = self.motions.actuation;
        (self.first..act).rev().chain(act.max(self.first)..self.paths.len())
    }

    /// Returns the joint vector at which the free motion to keyframe `entry` ends and the hand paths begin.
    pub fn arrival(&self, entry: usize) -> Row {
        self.paths[entry..self.motions.actuation].first().map_or(self.x, |path| path[0])
    }

    /// Returns the waypoints of a path with the travel of the object's joint along it.
    pub fn way(&self, path: usize) -> Way<'_> {
        Way { waypoints: &self.paths[path], travel: &self.travel[path], off: &[] }
    }

    /// Records an obstacle on a path. If the obstacle lies before the actuation pose, only the paths between the
    /// obstacle and the actuation pose are kept.
    pub fn block(&mut self, path: usize, hit: Hit) {
        let act = self.motions.actuation;
        if path < act {
            self.paths[..=path].iter_mut().for_each(Vec::clear);
            self.paths[act..].iter_mut().for_each(Vec::clear);
            self.after = (0, 0.0);
        }
        self.hits.push((path + 1, hit.clone()));
        self.failure = Some(Failure::Blocked { keyframe: path + 1, hit });
    }
}

impl Planner<'_> {
    /// Checks individual waypoints after the actuation. An obstacle at a waypoint limits the extent of the motion, and
    /// costs much less to find than by a sweep.
    pub(super) fn see(&mut self, out: &mut Attempt) {
        let act = out.motions.actuation;
        if self.problem.options.avoid_collisions {
            self.act(out);
            let (last_path, last) = out.seen.unwrap_or((out.paths.len(), 0));
            for i in act.max(out.first)..out.paths.len().min(last_path + 1) {
                let steps = out.paths[i].len().saturating_sub(1);
                let most = if i == last_path { last } else { steps };
                if most == 0 {
                    continue;
                }
                let segment = self.world.schedule.along(i);
                let plain = self.overlaps_only();
                let met = self.judge(true, |world| world.hit_at_any(out.way(i).until(most), segment, &plain));
                if let Some((k, hit)) = met {
                    out.seen = Some((i, k - 1));
                    out.after = (i - act, out.followed(i) * (k - 1) as f64 / steps as f64);
                    out.failure = Some(Failure::Blocked { keyframe: i + 1, hit });
                    return;
                }
            }
        }
        out.stage = Stage::Seen;
    }

    /// Returns the attempt with a straight free motion to the first keyframe and a timed motion, if this motion is
    /// collision-free. Only the timed motion is proven, so this is faster than a proof of each part before the timing.
    pub(super) fn straightaway(&mut self, attempt: &Attempt) -> Option<Attempt> {
        let from_rest = self.stop.is_empty() && self.warm_start.is_none() && self.world.start_overlap <= TOUCH;
        let is_on_the_way = self.entry > attempt.motions.actuation;
        if !self.problem.options.avoid_collisions || !from_rest || is_on_the_way || attempt.failure.is_some() {
            return None;
        }
        let mut out = attempt.clone();
        out.stage = Stage::Swept;
        self.act(&out);
        for path in attempt.outwards().filter(|path| !attempt.paths[*path].is_empty()) {
            let way = attempt.way(path);
            let (segment, wide) = self.wide(way, path);
            if self.world.is_hit_at(way, segment, &wide, LOOKS) {
                return None;
            }
            out.margins[path] = wide.with_clearance(self.margin);
        }
        let straight = self.straight_approach(&out.arrival(self.entry))?;
        (out.approach, out.kept) = (straight.pieces, straight.kept);
        out.timed = Some(self.emit(&mut out).ok()?);
        Some(out)
    }

    /// Returns the segment of a path, and the distances that bodies keep when the path is swept: the clearance, or their
    /// distance at the ends of `way` if that is smaller.
    fn wide(&mut self, way: Way<'_>, path: usize) -> (MotionSegment, Margins) {
        let segment = self.world.schedule.along(path);
        let clearance = if self.problem.options.avoid_collisions { self.margin } else { 0.0 };
        let ends = [way.state(0), way.state(way.waypoints.len() - 1)];
        let wide = self.world.margins_between(ends, segment, clearance + PAD);
        (segment, if self.entry > self.world.schedule.actuation() { wide } else { wide.parted() })
    }

    /// Searches the free motion to the first keyframe, and times the whole motion.
    pub(super) fn complete(&mut self, out: &mut Attempt, samples: usize) {
        self.act(out);
        // A free motion that is free at samples usually stands the proof of the timed motion.
        for proves in [false, true] {
            if self.entry <= out.motions.actuation && !self.approach_first(out, samples, proves) {
                return;
            }
            match self.emit(out) {
                Ok(timed) => out.timed = Some(timed),
                Err(Failure::Blocked { .. }) if out.is_sampled => continue,
                Err(failure) => {
                    if let Failure::Blocked { keyframe, hit } = &failure {
                        out.hits.push((*keyframe, hit.clone()));
                    }
                    out.failure = Some(failure);
                }
            }
            return;
        }
    }

    /// Searches the free motion to the first keyframe; returns whether the search succeeded. `proves` tells whether the
    /// motion must be proven before it is timed.
    fn approach_first(&mut self, out: &mut Attempt, samples: usize, proves: bool) -> bool {
        let goal = out.arrival(self.entry);
        let keyframe = self.entry;
        match self.approach(&goal, samples, proves) {
            Ok(Approach { pieces, corners, kept, hit, is_sampled }) => {
                (out.approach, out.corners, out.kept, out.is_sampled) = (pieces, corners, kept, is_sampled);
                out.hits.extend(hit.map(|h| (keyframe, h)));
                return true;
            }
            Err(NoWay::Blocked(hit)) => {
                out.hits.push((keyframe, hit.clone()));
                out.failure = Some(Failure::Blocked { keyframe, hit });
            }
            Err(NoWay::NotFound(hit) | NoWay::BoxedIn(hit)) => {
                out.hits.push((keyframe, hit.clone()));
                out.failure = Some(Failure::NotFound { keyframe, hit });
            }
        }
        false
    }

    /// Sweeps the paths, and ends the motion at the first collision. Each pair of bodies keeps the clearance, or its
    /// distance at the ends of the path if that is smaller.
    pub(super) fn sweep_all(&mut self, out: &mut Attempt, bar: Option<f64>) {
        out.stage = Stage::Swept;
        self.act(out);
        (out.after, out.failure) = out.reach.clone();
        let act = out.motions.actuation;
        for i in out.outwards() {
            if out.paths[i].is_empty() {
                continue;
            }
            let Some((k, hit)) = self.sweep_path(out, i, bar) else { continue };
            if !self.problem.options.avoid_collisions {
                out.hits.push((i + 1, hit));
                continue;
            }
            out.block(i, hit);
            if i < act {
                return;
            }
            let steps = (out.paths[i].len() - 1).max(1) as f64;
            out.after = (i - act, out.followed(i) * k as f64 / steps);
            out.paths[i].truncate(k + 1);
            out.travel[i].truncate(k + 1);
            out.paths[i + 1..].iter_mut().for_each(Vec::clear);
            return;
        }
    }

    /// Sweeps a path; returns the last collision-free waypoint and the obstacle. A shortened path has a new end with
    /// other distances between bodies, so it is swept again if its extent still exceeds `bar`.
    fn sweep_path(&mut self, out: &mut Attempt, path: usize, bar: Option<f64>) -> Option<(usize, Hit)> {
        let act = out.motions.actuation;
        let clearance = if self.problem.options.avoid_collisions { self.margin } else { 0.0 };
        let steps = out.paths[path].len() - 1;
        let mut met: Option<(usize, Hit)> = None;
        loop {
            let last = met.as_ref().map_or(steps, |(k, _)| *k);
            let way = out.way(path).until(last);
            let (segment, wide) = self.wide(way, path);
            let hit = self.world.sweep_along(way, segment, &wide);
            out.margins[path] = wide.with_clearance(clearance);
            match hit {
                Some((k, hit)) if met.as_ref().is_none_or(|(before, _)| k < *before) => met = Some((k, hit)),
                _ => return met,
            }
            let worth = |k: usize| {
                let extent = 1.0 + (path - act) as f64 + out.followed(path) * k as f64 / steps.max(1) as f64;
                self.explain || bar.is_none_or(|bar| extent > bar)
            };
            let partial = self.partial && path >= act;
            if !partial || met.as_ref().is_none_or(|(k, _)| *k == 0 || !worth(*k)) {
                return met;
            }
        }
    }
}

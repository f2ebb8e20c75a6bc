//! The motion through the keyframes of one actuation pose.

use super::failure::Failure;
use super::planner::{Approach, PAD, Planner};
use super::timed::Timed;
use crate::free_space::NoWay;
use crate::hand_path::Followed;
use crate::model::Row;
use crate::motion::{Motions, motions};
use crate::world::{Hit, Margins, State, Way, World, even, travel_along, travel_over};

/// A candidate's motion as far as it goes: joint waypoints of each path, and what stopped it.
pub(super) struct Attempt {
    pub x: Row,
    pub rank: usize,
    pub motions: Motions,
    /// Free motions to the first keyframe, each from rest to rest; empty where there is none.
    pub approach: Vec<Vec<Row>>,
    /// Waypoints of the path to keyframe i + 1, as far as it goes.
    pub paths: Vec<Vec<Row>>,
    /// Travel of the object's joint at those waypoints; none before the actuation.
    pub travel: Vec<Vec<f64>>,
    /// Free motions that stop wherever they turn, for where those of `approach` do not stand once they are timed.
    pub corners: Vec<Vec<Row>>,
    /// Margins of the free motion and of each path.
    pub kept: Margins,
    pub margins: Vec<Margins>,
    /// Number of whole paths after the actuation and the fraction of the next one.
    pub after: (usize, f64),
    pub hits: Vec<(usize, Hit)>,
    pub failure: Option<Failure>,
    /// Whether the pose itself overlaps something, so that no motion was looked for.
    pub overlaps: bool,
    /// The timed motion, once approach and pre-actuation motions stand: with a failure, the part before it.
    pub timed: Option<Timed>,
    /// First path that is planned; those before it are done.
    pub first: usize,
}

impl Attempt {
    fn new(x: &Row, rank: usize, motions: Motions, first: usize) -> Self {
        let count = motions.paths.len();
        // What lies before the first path is done.
        let done = first.saturating_sub(motions.actuation);
        Self {
            x: *x,
            rank,
            motions,
            approach: Vec::new(),
            paths: vec![Vec::new(); count],
            travel: vec![Vec::new(); count],
            corners: Vec::new(),
            kept: Margins::plain(0.0),
            margins: vec![Margins::plain(0.0); count],
            after: (done, 0.0),
            hits: Vec::new(),
            failure: None,
            overlaps: false,
            timed: None,
            first,
        }
    }

    /// Extent of the motion.
    pub fn score(&self) -> f64 {
        if self.timed.is_some() { self.extent() } else { 0.0 }
    }

    /// Whether the whole motion stands.
    pub fn is_whole(&self) -> bool {
        self.timed.is_some() && self.failure.is_none()
    }

    /// Extent if the approach to it is free: zero, if it does not get to the actuation pose and past it.
    fn extent(&self) -> f64 {
        let short = self.failure.as_ref().is_some_and(|f| f.keyframe() <= self.motions.actuation);
        if short { 0.0 } else { 1.0 + self.after.0 as f64 + self.after.1 }
    }

    /// Fraction of a path after the actuation that was followed.
    fn followed(&self, path: usize) -> f64 {
        if path - self.motions.actuation < self.after.0 { 1.0 } else { self.after.1 }
    }

    /// Paths in the order in which they are looked at: from the actuation pose to the start, then to the end.
    fn outwards(&self) -> impl Iterator<Item = usize> + use<> {
        let act = self.motions.actuation;
        (self.first..act).rev().chain(act.max(self.first)..self.paths.len())
    }

    /// A path with the travel of the object's joint along it.
    fn way(&self, path: usize) -> Way<'_> {
        Way { waypoints: &self.paths[path], travel: &self.travel[path], off: &[] }
    }

    /// Something is in the way on a path. Before the actuation that leaves no motion but what lies between it and there.
    fn block(&mut self, path: usize, hit: Hit) {
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
    /// The motion through the keyframes of one actuation pose, as far as it goes. Where there is a score to beat,
    /// `bar`, no more is spent on a motion than it takes to see that it does not.
    pub(super) fn attempt(&mut self, x: &Row, rank: usize, samples: usize, bar: Option<f64>) -> Attempt {
        let hand = self.follower.hand(x);
        let motions = motions(self.problem, &hand);
        let act = motions.actuation;
        let first = if self.entry > act { self.entry - 1 } else { self.entry };
        let mut out = Attempt::new(x, rank, motions, first);
        self.world.act_at(x, out.motions.letting_go());
        // What overlapped at the start has come apart on the approach, where there is one.
        let plain = if self.entry > act { Margins::plain(0.0) } else { Margins::plain(0.0).parted() };
        let overlap = match self.entry <= act {
            true => {
                let segment = self.world.schedule.last_before_actuation();
                self.judge(bar, |world| world.hit_at(State::still(x), segment, &plain))
            }
            false => None,
        };
        if let Some(hit) = overlap {
            out.hits.push((act, hit.clone()));
            if self.problem.options.avoid_collisions {
                out.failure = Some(Failure::Blocked { keyframe: act, hit });
                out.overlaps = true;
                return out;
            }
        }
        self.follow_before(&mut out);
        // What comes after the actuation is not followed where there is no way to it.
        if bar.is_some_and(|bar| self.falls_short(&mut out, bar, &plain, true)) {
            return out;
        }
        if out.failure.is_none() {
            self.follow_after(&mut out);
        }
        self.unwind(&mut out);
        if self.entry > act {
            self.take_up(&mut out);
        }
        if bar.is_some_and(|bar| self.falls_short(&mut out, bar, &plain, false)) {
            return out;
        }
        self.sweep_all(&mut out, bar);
        let worth = self.problem.options.allow_partial && out.extent() > bar.unwrap_or(0.0);
        if out.failure.is_some() && !worth {
            // It still says how far it goes, but the free motion is not spent on it.
            return out;
        }
        if self.entry > act || self.approach_first(&mut out, samples) {
            match self.emit(&mut out) {
                Ok(timed) => out.timed = Some(timed),
                Err(failure) => out.failure = Some(failure),
            }
        }
        out
    }

    /// A hit that turns an attempt down. Where there is a score to beat, its reason is not reported: any will do.
    fn judge(&mut self, bar: Option<f64>, look: impl FnOnce(&mut World<'_>) -> Option<Hit>) -> Option<Hit> {
        self.world.set_early_exit(bar.is_some() && !self.explain && self.problem.options.avoid_collisions);
        let hit = look(&mut self.world);
        self.world.set_early_exit(false);
        hit
    }

    /// Takes up a motion past the actuation pose: what overlaps there may persist, and the brake is swept.
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
        let way = self.transitions[self.transition].way(&self.start);
        let brake = Way { waypoints: &way, travel: &[travel], off: &[] };
        let margins = self.world.margins_between([start, start], segment, self.margin);
        if let Some((_, hit)) = self.world.sweep_along(brake, segment, &margins) {
            out.hits.push((self.entry, hit.clone()));
            if self.problem.options.avoid_collisions {
                out.failure = Some(Failure::Blocked { keyframe: self.entry, hit });
            }
        }
    }

    /// Looks for the free motion to the first keyframe; whether there is one.
    fn approach_first(&mut self, out: &mut Attempt, samples: usize) -> bool {
        let goal = out.paths[self.entry..out.motions.actuation].first().map_or(out.x, |path| path[0]);
        let keyframe = self.entry;
        match self.approach(&goal, samples) {
            Ok(Approach { pieces, corners, kept, hit }) => {
                (out.approach, out.corners, out.kept) = (pieces, corners, kept);
                out.hits.extend(hit.map(|h| (keyframe, h)));
                return true;
            }
            Err(NoWay::Blocked(hit)) => {
                out.hits.push((keyframe, hit.clone()));
                out.failure = Some(Failure::Blocked { keyframe, hit });
            }
            Err(NoWay::NotFound(hit)) => {
                out.hits.push((keyframe, hit.clone()));
                out.failure = Some(Failure::NotFound { keyframe, hit });
            }
        }
        false
    }

    /// Follows the paths before the actuation: all of them whole, or there is no motion at all.
    fn follow_before(&mut self, out: &mut Attempt) {
        let act = out.motions.actuation;
        let mut at = out.x;
        for i in (self.entry..act).rev() {
            let Followed { mut waypoints, fraction } = self.follower.follow(&out.motions.paths[i], &at, true);
            if fraction < 1.0 {
                out.failure = Some(Failure::Unreachable { keyframe: i, fraction });
                return;
            }
            waypoints.reverse();
            at = waypoints[0];
            out.paths[i] = waypoints;
        }
    }

    /// Follows the paths after the actuation as far as the hand gets.
    fn follow_after(&mut self, out: &mut Attempt) {
        let act = out.motions.actuation;
        let mut at = out.x;
        let mut travel = 0.0;
        for i in act..out.paths.len() {
            let path = &out.motions.paths[i];
            // What lies before the entry is done; the path to it is followed from the present state.
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
                out.failure = Some(Failure::Unreachable { keyframe: i + 1, fraction });
                out.after = (i - act, fraction);
                return;
            }
            out.after.0 = i - act + 1;
        }
    }

    /// Takes the motion as many whole turns back, in joints without limits, as it begins beyond half a turn from the
    /// start: the approach to it goes the short way.
    fn unwind(&self, out: &mut Attempt) {
        let before = out.paths.get(self.entry..out.motions.actuation);
        let Some(first) = before.and_then(<[_]>::first).and_then(|path| path.first()) else { return };
        let near = self.model.unwound(first, &self.model.start());
        let shift: Vec<f64> = (0..self.model.n()).map(|v| near[v] - first[v]).collect();
        for x in out.paths.iter_mut().flatten().chain(std::iter::once(&mut out.x)) {
            x.iter_mut().zip(&shift).for_each(|(value, by)| *value += by);
        }
    }

    /// Whether a look at single waypoints, before the actuation or after it, shows that the motion goes no further than
    /// `bar`. That costs far less than a sweep, and most motions of a problem that has no whole one end here.
    fn falls_short(&mut self, out: &mut Attempt, bar: f64, margins: &Margins, before: bool) -> bool {
        let partial = self.problem.options.allow_partial;
        if out.failure.is_some() && !(partial && out.extent() > bar) {
            return true;
        }
        if !self.problem.options.avoid_collisions {
            return false;
        }
        let act = out.motions.actuation;
        for i in out.outwards().filter(|i| (*i < act) == before) {
            let steps = out.paths[i].len().saturating_sub(1);
            // A hit here or before means that the last free waypoint is no further than the bar.
            let most = if i < act || !partial {
                steps
            } else {
                let left = (bar - 1.0 - (i - act) as f64) / out.followed(i);
                if left < 0.0 { 0 } else { ((left * steps as f64 + 1e-9) as usize + 1).min(steps) }
            };
            if most == 0 {
                continue;
            }
            let segment = self.world.schedule.along(i);
            let hit = self.judge(Some(bar), |world| world.hit_at_any(out.way(i).until(most), segment, margins));
            if let Some(hit) = hit {
                out.block(i, hit);
                return true;
            }
        }
        false
    }

    /// Sweeps the paths, and cuts the motion where it hits something. Each keeps the margin, or what either of its ends
    /// leaves where that is less.
    fn sweep_all(&mut self, out: &mut Attempt, bar: Option<f64>) {
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

    /// Sweeps a path; the last waypoint up to which it is free, and what it meets then. A path that ends earlier has
    /// another end, whose clearances are those that count: it is swept again, where it still goes further than `bar`.
    fn sweep_path(&mut self, out: &mut Attempt, path: usize, bar: Option<f64>) -> Option<(usize, Hit)> {
        let segment = self.world.schedule.along(path);
        let act = out.motions.actuation;
        let clearance = if self.problem.options.avoid_collisions { self.margin } else { 0.0 };
        let steps = out.paths[path].len() - 1;
        let mut met: Option<(usize, Hit)> = None;
        loop {
            let last = met.as_ref().map_or(steps, |(k, _)| *k);
            let way = out.way(path).until(last);
            let ends = [way.state(0), way.state(way.waypoints.len() - 1)];
            let wide = self.world.margins_between(ends, segment, clearance + PAD);
            let wide = if self.entry > act { wide } else { wide.parted() };
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
            let partial = self.problem.options.allow_partial && path >= act;
            if !partial || met.as_ref().is_none_or(|(k, _)| *k == 0 || !worth(*k)) {
                return met;
            }
        }
    }
}

//! The motion through the keyframes of one actuation pose.

use super::planner::Planner;
use crate::contact::Hit;
use crate::hand_path::Followed;
use crate::margins::Margins;
use crate::model::Row;
use crate::motion::{Motions, motions};

/// Why a candidate's motion ends before its end.
#[derive(Debug, Clone)]
pub(super) enum Failure {
    /// The hand cannot follow the path to this keyframe beyond this fraction.
    Unreachable { keyframe: usize, fraction: f64 },
    /// Something is in the way on the path to this keyframe.
    Blocked { keyframe: usize, hit: Hit },
    /// The clock allows this much less than needed.
    TooFast { keyframe: usize, allowed: f64, needed: f64 },
}

impl Failure {
    fn keyframe(&self) -> usize {
        match self {
            Self::Unreachable { keyframe, .. } | Self::Blocked { keyframe, .. } | Self::TooFast { keyframe, .. } => {
                *keyframe
            }
        }
    }
}

/// A candidate's motion as far as it goes: joint waypoints of each path, and what stopped it.
pub(super) struct Attempt {
    pub x: Row,
    pub rank: usize,
    pub motions: Motions,
    /// Free motions to the first keyframe, each from rest to rest; empty where there is none.
    pub approach: Vec<Vec<Row>>,
    /// Waypoints of the path to keyframe i + 1, as far as it goes.
    pub paths: Vec<Vec<Row>>,
    /// Number of whole paths after the actuation and the fraction of the next one.
    pub after: (usize, f64),
    pub hits: Vec<(usize, Hit)>,
    pub failure: Option<Failure>,
    /// Whether the pose itself overlaps something, so that no motion was looked for.
    pub overlaps: bool,
    /// Whether approach and pre-actuation motions stand.
    pub starts: bool,
}

impl Attempt {
    /// How far the motion goes.
    pub fn score(&self) -> f64 {
        if self.starts { self.extent() } else { 0.0 }
    }

    /// How far it goes if the approach to it is free: nowhere, if it does not get to the actuation pose and past it.
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
        (0..act).rev().chain(act..self.paths.len())
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
        let paths = vec![Vec::new(); motions.paths.len()];
        let mut out = Attempt {
            x: *x,
            rank,
            motions,
            approach: Vec::new(),
            paths,
            after: (0, 0.0),
            hits: Vec::new(),
            failure: None,
            overlaps: false,
            starts: false,
        };
        // What overlapped at the start has come apart on the approach.
        let plain = Margins::plain(0.0).parted();
        if let Some(hit) = self.judge.at(x, act + 1, &plain) {
            out.hits.push((act, hit.clone()));
            if self.problem.options.avoid_collisions {
                out.failure = Some(Failure::Blocked { keyframe: act, hit });
                out.overlaps = true;
                return out;
            }
        }
        self.follow_all(&mut out);
        self.unwind(&mut out);
        if bar.is_some_and(|bar| self.falls_short(&mut out, bar, &plain)) {
            return out;
        }
        self.sweep_all(&mut out, &plain);
        let worth = self.problem.options.allow_partial && out.extent() > bar.unwrap_or(0.0);
        if out.failure.is_some() && !worth {
            // It still says how far it goes, but the free motion is not spent on it.
            return out;
        }
        let first = out.paths[..act].first().map_or(*x, |path| path[0]);
        match self.approach(&first, samples) {
            Ok((approach, hit)) => {
                out.approach = approach;
                out.hits.extend(hit.map(|h| (0, h)));
                out.starts = true;
                if let Some(failure) = self.too_fast(&out) {
                    out.starts = false;
                    out.failure = Some(failure);
                }
            }
            Err(hit) => {
                out.hits.push((0, hit.clone()));
                out.failure = Some(Failure::Blocked { keyframe: 0, hit });
            }
        }
        out
    }

    /// Follows the paths as far as the hand gets. Before the actuation all must be followed whole, or there is no
    /// motion at all.
    fn follow_all(&mut self, out: &mut Attempt) {
        let act = out.motions.actuation;
        let mut at = out.x;
        for i in (0..act).rev() {
            let Followed { mut waypoints, fraction } = self.follower.follow(&out.motions.paths[i], &at, true);
            if fraction < 1.0 {
                out.failure = Some(Failure::Unreachable { keyframe: i, fraction });
                return;
            }
            waypoints.reverse();
            at = waypoints[0];
            out.paths[i] = waypoints;
        }
        at = out.x;
        for i in act..out.paths.len() {
            let Followed { waypoints, fraction } = self.follower.follow(&out.motions.paths[i], &at, false);
            at = waypoints[waypoints.len() - 1];
            out.paths[i] = waypoints;
            if fraction < 1.0 {
                out.failure = Some(Failure::Unreachable { keyframe: i + 1, fraction });
                out.after.1 = fraction;
                return;
            }
            out.after.0 += 1;
        }
    }

    /// Takes the motion as many whole turns back, in joints without limits, as it begins beyond half a turn from the
    /// start: the approach to it goes the short way.
    fn unwind(&self, out: &mut Attempt) {
        let Some(first) = out.paths[..out.motions.actuation].first().and_then(|path| path.first()) else { return };
        let near = self.model.unwound(first, &self.model.start());
        let shift: Vec<f64> = (0..self.model.n()).map(|v| near[v] - first[v]).collect();
        for x in out.paths.iter_mut().flatten().chain(std::iter::once(&mut out.x)) {
            x.iter_mut().zip(&shift).for_each(|(value, by)| *value += by);
        }
    }

    /// Whether a look at single waypoints shows that the motion goes no further than `bar`. That costs far less than
    /// a sweep, and most motions of a problem that has no whole one end here.
    fn falls_short(&mut self, out: &mut Attempt, bar: f64, margins: &Margins) -> bool {
        let partial = self.problem.options.allow_partial;
        if out.failure.is_some() && !(partial && out.extent() > bar) {
            return true;
        }
        if !self.problem.options.avoid_collisions {
            return false;
        }
        let act = out.motions.actuation;
        for i in out.outwards() {
            let steps = out.paths[i].len().saturating_sub(1);
            // A hit here or before means that the last free waypoint is no further than the bar.
            let most = if i < act || !partial {
                steps
            } else {
                let left = (bar - 1.0 - (i - act) as f64) / out.followed(i);
                if left < 0.0 { 0 } else { ((left * steps as f64 + 1e-9) as usize + 1).min(steps) }
            };
            if most > 0
                && let Some(hit) = self.judge.at_any(&out.paths[i][..=most], i + 2, margins)
            {
                out.block(i, hit);
                return true;
            }
        }
        false
    }

    /// Sweeps the paths, and cuts the motion where it hits something.
    fn sweep_all(&mut self, out: &mut Attempt, margins: &Margins) {
        let act = out.motions.actuation;
        for i in out.outwards() {
            if out.paths[i].is_empty() {
                continue;
            }
            let Some((k, hit)) = self.judge.sweep_along(&out.paths[i], i + 2, margins) else { continue };
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
            out.paths[i + 1..].iter_mut().for_each(Vec::clear);
            return;
        }
    }
}

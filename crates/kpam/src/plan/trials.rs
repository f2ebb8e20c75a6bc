//! Search for the cheapest actuation pose whose whole motion is reachable and collision-free, or else for the longest
//! partial motion after the actuation.
//!
//! Poses are tried in the order of their cost, and the first complete motion ends the search. For incomplete motions,
//! checks of single waypoints give an upper bound of their extent. If no pose allows the whole motion, the incomplete
//! motions are examined in the order of their bounds, so that only few are swept and usually one is timed.

use super::Plan;
use super::TriedPose;
use super::attempt::{Attempt, Stage};
use super::failure::Failure;
use super::planner::Planner;
use crate::actuation::{Actuation, ActuationSearch, Candidate, HEEDED};
use crate::model::Row;
use crate::world::State;

/// Number of samples per pose in the first round. The full number is used only if all poses fail.
const FIRST_SAMPLES: usize = 500;
/// Number of poses that get the full number of samples.
const SECOND_CHANCES: usize = 4;

/// The poses tried so far, and the best motion among them.
#[derive(Default)]
pub(super) struct Trials {
    pub best: Option<Attempt>,
    pub tried: usize,
    /// Result for each pose, if the request asks for it.
    pub poses: Vec<TriedPose>,
    /// Attempts with incomplete motions for which only an upper bound of the extent is known.
    parts: Vec<Attempt>,
    /// Attempts whose motions are complete except for the free approach to the first keyframe.
    again: Vec<Attempt>,
    /// Poses at which the robot overlaps a body.
    overlapping: Vec<Row>,
    /// Whether the hand can move beyond the actuation pose from at least one tried pose.
    is_passed: bool,
}

impl Trials {
    pub fn done(&self) -> bool {
        self.best.as_ref().is_some_and(Attempt::is_whole)
    }

    /// Returns the score that an attempt must exceed; of several equal scores, the cheapest pose wins.
    fn bar(&self, rank: usize) -> Option<f64> {
        self.best.as_ref().map(|b| if rank < b.rank { b.score().next_down() } else { b.score() })
    }

    /// Returns the incomplete motion with the largest bound (of several, the cheapest), if it may beat the best one.
    fn furthest(&mut self) -> Option<Attempt> {
        let order = |a: &Attempt, b: &Attempt| a.extent().total_cmp(&b.extent()).then(b.rank.cmp(&a.rank));
        let k = (0..self.parts.len()).max_by(|a, b| order(&self.parts[*a], &self.parts[*b]))?;
        let beats = self.bar(self.parts[k].rank).is_none_or(|bar| self.parts[k].extent() > bar);
        beats.then(|| self.parts.swap_remove(k))
    }

    fn keep(&mut self, attempt: Attempt) {
        self.is_passed |= attempt.extent() > 0.0;
        let beats = |bar: f64| attempt.is_whole() || attempt.score() > bar;
        if self.bar(attempt.rank).is_none_or(beats) {
            self.best = Some(attempt);
        }
    }
}

impl Planner<'_> {
    /// Returns the motion that continues an earlier plan through its actuation pose, if that pose still meets the
    /// constraints. A motion that is resumed after the actuation can only use this pose.
    pub(super) fn warm_start_motion(&mut self, search: &mut ActuationSearch<'_>, x: &Row) -> Option<Plan> {
        let past = self.entry > self.world.schedule.actuation();
        let pose = if past { Candidate { x: *x, cost: search.cost(x) } } else { search.from(x)? };
        let mut trials = Trials::default();
        let samples = if past { 0 } else { self.problem.options.samples.min(FIRST_SAMPLES) };
        for margin in self.margins_in_turn() {
            self.set_margin(margin);
            self.try_at_once(&pose.x, samples, &mut trials);
            if self.is_done(&trials) {
                break;
            }
        }
        let stands = past || trials.done();
        if !stands {
            self.set_margin(self.problem.options.margin);
        }
        stands.then(|| self.conclude(trials, &pose))
    }

    pub(super) fn whole_motion(&mut self, found: &Actuation, search: &mut ActuationSearch<'_>) -> Plan {
        let options = &self.problem.options;
        let (samples, most) = (options.samples.min(FIRST_SAMPLES), options.candidates);
        let mut trials = Trials::default();
        // Other poses are searched only if the cheapest one allows no motion.
        let (cheapest, mut others) = (found.candidates[0], None);
        // The hand paths from a pose are the same for every margin, so they are computed once.
        let mut followed: Vec<Attempt> = Vec::new();
        let margins = self.margins_in_turn();
        // Partial motion from the round with the previous, larger margin. It is returned if planning reaches a limit.
        let mut kept: Option<(f64, Attempt)> = None;
        for (round, margin) in margins.iter().enumerate() {
            let is_last = round + 1 == margins.len();
            if let Some(part) = trials.best.take_if(|best| round > 0 && best.timed.is_some()) {
                kept = Some((margins[round - 1], part));
            }
            self.set_margin(*margin);
            // A partial motion with a smaller margin must not replace one with a larger margin.
            self.partial = options.allow_partial && (is_last || self.world.is_limited());
            self.drop_parts(&mut trials);
            trials = Trials { tried: trials.tried, poses: trials.poses, ..Trials::default() };
            if most > 0 && !self.is_done(&trials) {
                self.try_at_once(&cheapest.x, samples, &mut trials);
            }
            if !self.is_done(&trials) {
                let others = others.get_or_insert_with(|| search.others(&found.candidates));
                others.retain(|c| c.x != cheapest.x);
                for (k, pose) in others.iter().take(most - 1).enumerate() {
                    if self.is_done(&trials) {
                        break;
                    }
                    if followed.len() == k {
                        followed.push(self.followed_and_seen(&pose.x));
                    }
                    let attempt = followed[k].clone();
                    self.try_followed(attempt, samples, &mut trials);
                }
            }
            if self.is_done(&trials) {
                break;
            }
        }
        // If no cheap pose allows a complete motion, try additional poses that meet the constraints.
        self.try_samples(search, false, samples, &mut trials);
        self.try_rest(samples, &mut trials);
        self.try_cleared(search, samples, &mut trials);
        self.try_rest(samples, &mut trials);
        // From other poses within the tolerances, the hand may reach further.
        self.try_samples(search, true, samples, &mut trials);
        self.try_rest(samples, &mut trials);
        self.drop_parts(&mut trials);
        let has_part = trials.best.as_ref().is_some_and(|best| best.timed.is_some());
        if let Some((margin, part)) = kept.filter(|_| self.world.is_over() && !has_part) {
            self.set_margin(margin);
            trials.best = Some(part);
        }
        let better = others.iter().flatten().find(|c| c.cost < cheapest.cost);
        self.conclude(trials, better.unwrap_or(&cheapest))
    }

    /// Tries additional poses that meet the constraints: poses near the centre of the tolerances or, with `at_edge`,
    /// poses anywhere within them.
    fn try_samples(&mut self, search: &mut ActuationSearch<'_>, at_edge: bool, samples: usize, trials: &mut Trials) {
        let options = &self.problem.options;
        let first = if at_edge { options.extra_seeds } else { 0 };
        let mut extra = 0;
        for start in first..first + options.extra_seeds {
            if self.is_done(trials) || extra > options.candidates {
                break;
            }
            let Some(pose) = search.sample(start, at_edge) else { continue };
            let attempt = self.followed_and_seen(&pose.x);
            // Only poses without an overlap count here, because an overlapping pose is rejected in hardly any time.
            extra += usize::from(!attempt.overlaps);
            self.try_followed(attempt, samples, trials);
        }
    }

    /// Returns whether the search must end: a complete motion was found, or planning has reached a limit.
    fn is_done(&self, trials: &Trials) -> bool {
        trials.done() || self.world.is_over()
    }

    fn keep(&self, attempt: Attempt, trials: &mut Trials) {
        if self.explain {
            trials.poses.push(self.explained(&attempt));
        }
        trials.keep(attempt);
    }

    /// Removes incomplete motions that can no longer affect the result.
    fn drop_parts(&self, trials: &mut Trials) {
        for attempt in std::mem::take(&mut trials.parts) {
            self.keep(attempt, trials);
        }
    }

    /// Tries the pose that is most likely to allow a complete motion, and records the result.
    fn try_at_once(&mut self, x: &Row, samples: usize, trials: &mut Trials) {
        let bar = trials.bar(trials.tried);
        let mut attempt = self.followed(x, false);
        attempt.rank = trials.tried;
        trials.tried += 1;
        if attempt.overlaps {
            trials.overlapping.push(attempt.origin);
        } else if let Some(whole) = self.straightaway(&attempt) {
            return self.keep(whole, trials);
        } else {
            self.sweep_all(&mut attempt, bar);
        }
        let worth = attempt.failure.is_none() || self.partial && attempt.extent() > bar.unwrap_or(0.0);
        if worth { self.finish(attempt, samples, trials) } else { self.keep(attempt, trials) }
    }

    /// Follows the hand paths from a pose and checks individual waypoints. This part of an attempt does not depend on
    /// the margin.
    fn followed_and_seen(&mut self, x: &Row) -> Attempt {
        let mut attempt = self.followed(x, true);
        if attempt.failure.is_none() {
            self.see(&mut attempt);
        }
        attempt
    }

    /// Tries one pose of many. An incomplete motion is stored and may be examined later.
    fn try_followed(&mut self, mut attempt: Attempt, samples: usize, trials: &mut Trials) {
        attempt.rank = trials.tried;
        trials.tried += 1;
        if attempt.overlaps {
            trials.overlapping.push(attempt.origin);
        }
        if attempt.failure.is_none() && self.blocked_stop().is_none() {
            let bar = trials.bar(attempt.rank);
            self.sweep_all(&mut attempt, bar);
            if attempt.failure.is_none() {
                return self.finish(attempt, samples, trials);
            }
        }
        if self.partial && attempt.extent() > 0.0 {
            trials.parts.push(attempt);
        } else {
            self.keep(attempt, trials);
        }
    }

    /// If the hand cannot move beyond the actuation pose from any tried pose, moves overlapping poses out of their
    /// overlaps and tries them, the smallest overlap first.
    fn try_cleared(&mut self, search: &mut ActuationSearch<'_>, samples: usize, trials: &mut Trials) {
        let most = self.problem.options.clearings;
        if trials.is_passed || most == 0 || self.is_done(trials) {
            return;
        }
        let segment = self.world.schedule.last_before_actuation();
        let margins = self.overlaps_only();
        let overlapping = std::mem::take(&mut trials.overlapping).into_iter();
        let lacking = |x: Row| (self.world.lacking(State::still(&x), segment, &margins), x);
        let mut overlapping: Vec<_> = overlapping.map(lacking).collect();
        overlapping.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (_, x) in overlapping.iter().take(most) {
            if self.is_done(trials) {
                break;
            }
            let pose = search.cleared(x, |x, out| {
                self.world.clearances(State::still(x), segment, &margins, HEEDED, out);
            });
            if let Some(pose) = pose {
                let attempt = self.followed_and_seen(&pose.x);
                self.try_followed(attempt, samples, trials);
            }
        }
    }

    /// Finds the longest incomplete motion, and repeats the search for the approach with more samples for motions that
    /// lack only the approach.
    fn try_rest(&mut self, samples: usize, trials: &mut Trials) {
        self.try_parts(samples, trials);
        for attempt in std::mem::take(&mut trials.again) {
            if self.is_done(trials) {
                break;
            }
            if trials.bar(attempt.rank).is_none_or(|bar| attempt.extent() > bar) {
                self.finish(attempt, self.problem.options.samples, trials);
            }
        }
    }

    /// Finds the longest incomplete motion.
    fn try_parts(&mut self, samples: usize, trials: &mut Trials) {
        while !self.is_done(trials)
            && let Some(mut attempt) = trials.furthest()
        {
            match attempt.stage {
                Stage::Followed => self.see(&mut attempt),
                Stage::Seen => {
                    let bar = trials.bar(attempt.rank);
                    self.sweep_all(&mut attempt, bar);
                }
                Stage::Swept => {
                    self.finish(attempt, samples, trials);
                    continue;
                }
            }
            trials.parts.push(attempt);
        }
    }

    /// Completes a candidate whose hand paths are collision-free: searches the free approach and times the whole
    /// motion.
    fn finish(&mut self, mut attempt: Attempt, samples: usize, trials: &mut Trials) {
        let before = (attempt.failure.clone(), attempt.hits.len());
        self.complete(&mut attempt, samples);
        let not_found = matches!(attempt.failure, Some(Failure::NotFound { .. }));
        if not_found && samples < self.problem.options.samples && trials.again.len() < SECOND_CHANCES {
            let mut again = attempt.clone();
            again.failure = before.0;
            again.hits.truncate(before.1);
            trials.again.push(again);
        }
        self.keep(attempt, trials);
    }
}

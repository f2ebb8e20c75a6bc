//! Report of a plan: residuals, keyframes, and reasons of failures.

use gensim2_geometry::{Pose, pose_to_matrix};

use super::attempt::Attempt;
use super::failure::millimetres;
use super::planner::Planner;
use super::{
    Collision, Guess, KeyframeReport, Lack, Outcome, Plan, Residual, Status, Tight, Touch, TriedPose, refused,
};
use crate::model::Row;
use crate::motion::{Motions, motions};
use crate::world::State;

impl Planner<'_> {
    pub(super) fn residuals(&mut self, x: &Row) -> Vec<Residual> {
        self.entries(x).into_iter().map(|(_, residual)| residual).collect()
    }

    /// Returns the residual of each constraint with the index of the constraint in the config.
    fn entries(&mut self, x: &Row) -> Vec<(usize, Residual)> {
        let hand = self.follower.hand(x);
        let mut out: Vec<(usize, f64, f64)> = Vec::new();
        for p in &self.resolved.points {
            let miss = (hand.rotation * p.on_hand + hand.translation.vector - p.target).amax();
            out.push((p.entry, miss, p.tolerance));
        }
        for a in &self.resolved.axes {
            out.push((a.entry, a.residual(&hand), a.tolerance));
        }
        out.sort_by_key(|(entry, _, _)| *entry);
        out.into_iter()
            .map(|(entry, residual, tolerance)| {
                let name = self.problem.config.constraints[entry].name();
                (entry, Residual { name, residual, tolerance, satisfied: residual <= tolerance })
            })
            .collect()
    }

    /// Returns the plan if no joint vector meets the constraints. `outside` is the distance (m) by which the hand
    /// leaves the workspace box at the best pose that meets the other constraints.
    pub(super) fn infeasible(&mut self, best_effort: Option<Row>, outside: Option<f64>) -> Plan {
        let mut out = refused(Lack::ActuationInfeasible, "no joint values meet the constraints".to_owned());
        out.start_overlap = self.world.start_overlap;
        if let Some(x) = best_effort {
            out.q_best_effort = Some(self.full(&x));
            let entries = self.entries(&x);
            let mut missed: Vec<_> = entries.iter().filter(|(_, r)| !r.satisfied).collect();
            // Metres and radians are only comparable as multiples of the tolerance.
            missed.sort_by(|(_, a), (_, b)| (b.residual / b.tolerance).total_cmp(&(a.residual / a.tolerance)));
            let told: Vec<_> = missed
                .into_iter()
                .map(|(entry, r)| {
                    let unit = self.problem.config.constraints[*entry].unit();
                    format!("{} has a residual of {:.4} {unit} (tolerance {} {unit})", r.name, r.residual, r.tolerance)
                })
                .collect();
            out.reason = if told.is_empty() {
                "the constraints can be met only outside the joint limits".to_owned()
            } else {
                format!("no joint values meet the constraints: at best {}", told.join(", and "))
            };
            out.residuals = entries.into_iter().map(|(_, residual)| residual).collect();
            if let Some(outside) = outside {
                out.reason = format!(
                    "the constraints can be met only with the hand outside options.workspace, by at least {outside:.4} m"
                );
            }
            let hand = self.follower.hand(&x);
            out.keyframes = keyframe_reports(&motions(self.problem, &hand), |_| (None, false));
        }
        out
    }

    pub(super) fn report(&mut self, attempt: Attempt) -> Plan {
        let act = attempt.motions.actuation;
        let label = |k: usize| attempt.motions.keyframes[k].label.clone();
        let (lack, reason) = match &attempt.failure {
            Some(failure) => (Some(failure.lack()), failure.reason(label)),
            None if self.problem.options.avoid_collisions => {
                (None, format!("the whole motion is reachable and keeps a clearance of {}", millimetres(self.margin)))
            }
            None => (None, "the whole motion is reachable; collisions were reported but not avoided".to_owned()),
        };
        let mut out = refused(Lack::Untimed, reason);
        out.margin = if self.problem.options.avoid_collisions { self.margin } else { 0.0 };
        if attempt.timed.is_some() {
            self.tell_of_contacts(&attempt, &mut out);
        }
        let times = match &attempt.timed {
            Some(timed) => timed.times.clone(),
            None => vec![None; attempt.motions.keyframes.len()],
        };
        out.q_plan = Some(self.full(&attempt.x));
        out.rank = Some(attempt.rank);
        out.residuals = self.residuals(&attempt.x);
        let after = attempt.motions.paths.len() - act;
        out.reached_fraction = if after == 0 { 1.0 } else { (attempt.after.0 as f64 + attempt.after.1) / after as f64 };
        let paths = &attempt.paths;
        out.keyframes = keyframe_reports(&attempt.motions, |k| {
            let reached = if k <= act {
                k == act || k < attempt.first || !paths[k].is_empty()
            } else {
                k - act <= attempt.after.0
            };
            (times[k], reached)
        });
        for (k, hit) in &attempt.hits {
            out.collisions.push(Collision {
                bodies: [hit.first.clone(), hit.second.clone()],
                time: times[*k],
                toward: label(*k),
                distance: hit.distance,
                point: [hit.at.x, hit.at.y, hit.at.z],
            });
        }
        out.outcome = match (attempt.timed, lack) {
            (Some(timed), None) => Outcome::Solved(timed.trajectory),
            (Some(timed), Some(lack)) => Outcome::Partial(timed.trajectory, lack),
            (None, lack) => Outcome::Failed(lack.unwrap_or(Lack::Untimed)),
        };
        out
    }

    /// Reports contacts, pairs of bodies closer than the margin, and estimated travels. Every keyframe ends one segment
    /// and begins the next: a pair that may touch in one of them may have to keep its distance in the other.
    fn tell_of_contacts(&mut self, attempt: &Attempt, out: &mut Plan) {
        let schedule = self.world.schedule;
        let start = self.start[0];
        let mut places = Vec::new();
        if self.entry <= attempt.motions.actuation {
            let approach = schedule.toward(self.entry);
            places.push((None, approach, start, 0.0));
            places.push((Some(self.entry), approach, attempt.arrival(self.entry), 0.0));
        }
        for (i, path) in attempt.paths.iter().enumerate() {
            let travel = |k: usize| attempt.travel[i].get(k).copied().unwrap_or(0.0);
            if let (Some(first), Some(last)) = (path.first(), path.last()) {
                let begins = (i > attempt.first || self.entry <= attempt.motions.actuation).then_some(i);
                places.push((begins, schedule.along(i), *first, travel(0)));
                places.push((Some(i + 1), schedule.along(i), *last, travel(path.len() - 1)));
                if let (true, Some(from), Some(to)) =
                    (self.world.guesses(schedule.along(i)), attempt.travel[i].first(), attempt.travel[i].last())
                {
                    let toward = attempt.motions.keyframes[i + 1].label.clone();
                    out.guesses.push(Guess { toward, travel: to - from, depth: self.problem.options.guess_depth });
                }
            }
        }
        for (keyframe, segment, x, travel) in places {
            let at = keyframe.map_or_else(|| "start".to_owned(), |k| attempt.motions.keyframes[k].label.clone());
            for (hit, may) in self.world.nearest(State { x: &x, travel }, segment, out.margin) {
                let bodies = [hit.first, hit.second];
                if may && hit.distance < 0.0 {
                    if !out.touches.iter().any(|t| t.at == at && t.bodies == bodies) {
                        out.touches.push(Touch { bodies, at: at.clone(), depth: -hit.distance });
                    }
                } else if !may && !out.tight.iter().any(|t| t.at == at && t.bodies == bodies) {
                    out.tight.push(Tight { bodies, at: at.clone(), distance: hit.distance });
                }
            }
        }
        if !out.tight.is_empty() && attempt.failure.is_none() {
            out.reason.push_str(", except for pairs that are closer at the start or at a keyframe");
        }
        if let Some(least) = out.tight.iter().min_by(|a, b| a.distance.total_cmp(&b.distance)) {
            out.warnings.push(format!(
                "closer than {} at the start or a keyframe: {} pairs, closest {} and {} at {} ({}{}); the motion keeps their distance there",
                millimetres(out.margin),
                out.tight.len(),
                least.bodies[0],
                least.bodies[1],
                least.at,
                if least.distance < 0.0 { "an overlap of " } else { "" },
                millimetres(least.distance.abs())
            ));
        }
        if out.margin < self.problem.options.margin && self.problem.options.avoid_collisions {
            out.warnings.push(format!(
                "no motion keeps a clearance of {}; this one keeps {}",
                millimetres(self.problem.options.margin),
                millimetres(out.margin)
            ));
        }
    }

    /// Returns the result of planning with one candidate for the actuation pose.
    pub(super) fn explained(&self, attempt: &Attempt) -> TriedPose {
        let label = |k: usize| attempt.motions.keyframes[k].label.clone();
        let (status, reason) = match &attempt.failure {
            None => (Status::Solved, "the whole motion is reachable and collision-free".to_owned()),
            Some(failure) => (failure.lack().into(), failure.reason(label)),
        };
        TriedPose { q: self.full(&attempt.x), rank: attempt.rank, status, reason }
    }
}

fn keyframe_reports(motions: &Motions, state: impl Fn(usize) -> (Option<f64>, bool)) -> Vec<KeyframeReport> {
    motions
        .keyframes
        .iter()
        .enumerate()
        .map(|(k, frame)| {
            let (time, reached) = state(k);
            KeyframeReport { label: frame.label.clone(), time, hand: rows(&frame.hand), reached }
        })
        .collect()
}

fn rows(pose: &Pose) -> [[f64; 4]; 4] {
    let m = pose_to_matrix(pose);
    std::array::from_fn(|r| std::array::from_fn(|c| m[(r, c)]))
}

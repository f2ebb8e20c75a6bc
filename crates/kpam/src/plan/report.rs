//! What a plan says: residuals, keyframes, reasons.

use gensim2_geometry::{Pose, pose_to_matrix};

use super::attempt::Attempt;
use super::failure::Failure;
use super::planner::Planner;
use super::{Collision, KeyframeReport, Plan, Residual, Status, TriedPose, refused};
use crate::model::Row;
use crate::motion::{Motions, motions};

impl Planner<'_> {
    pub(super) fn residuals(&mut self, x: &Row) -> Vec<Residual> {
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
            .map(|(entry, residual, tolerance)| Residual {
                name: self.problem.config.constraints[entry].name(),
                residual,
                tolerance,
                satisfied: residual <= tolerance,
            })
            .collect()
    }

    pub(super) fn infeasible(&mut self, best_effort: Option<Row>) -> Plan {
        let mut out = refused("no joint values meet the constraints".to_owned());
        out.start_overlap = self.world.start_overlap;
        if let Some(x) = best_effort {
            out.q_best_effort = Some(self.full(&x));
            out.residuals = self.residuals(&x);
            let worst = out
                .residuals
                .iter()
                .filter(|r| !r.satisfied)
                .max_by(|a, b| (a.residual - a.tolerance).total_cmp(&(b.residual - b.tolerance)));
            out.reason = match worst {
                Some(r) => format!(
                    "no joint values meet the constraints: at best {} misses by {:.4} (tolerance {})",
                    r.name,
                    r.residual - r.tolerance,
                    r.tolerance
                ),
                None => "the constraints can be met only outside the workspace box or the joint limits".to_owned(),
            };
            let hand = self.follower.hand(&x);
            out.keyframes = keyframe_reports(&motions(self.problem, &hand), |_| (None, false));
        }
        out
    }

    pub(super) fn report(&mut self, attempt: Attempt) -> Plan {
        let act = attempt.motions.actuation;
        let label = |k: usize| attempt.motions.keyframes[k].label.clone();
        let mut out = refused(String::new());
        let timed = if attempt.starts {
            self.timed(&attempt)
        } else {
            Err(Failure::Unreachable { keyframe: 0, fraction: 0.0 })
        };
        let (trajectory, times) = match timed {
            Ok((trajectory, times)) => (Some(trajectory), times),
            Err(_) => (None, vec![None; attempt.motions.keyframes.len()]),
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
                time: times[*k].filter(|_| trajectory.is_some()),
                toward: label(*k),
                distance: hit.distance,
                point: [hit.at.x, hit.at.y, hit.at.z],
            });
        }
        let (status, reason) = outcome(&attempt);
        let partial = attempt.failure.is_some() && trajectory.is_some();
        out.status = if partial { Status::Partial } else { status };
        out.reason = reason;
        out.trajectory = trajectory;
        out
    }

    /// What became of one pose.
    pub(super) fn explained(&self, attempt: &Attempt) -> TriedPose {
        let (status, reason) = outcome(attempt);
        TriedPose { q: self.full(&attempt.x), rank: attempt.rank, status, reason }
    }
}

fn outcome(attempt: &Attempt) -> (Status, String) {
    match &attempt.failure {
        None => (Status::Solved, "the whole motion is reachable and free".to_owned()),
        Some(failure) => (failure.status(), failure.reason(|k| attempt.motions.keyframes[k].label.clone())),
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

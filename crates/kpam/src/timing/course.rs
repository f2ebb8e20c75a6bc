//! Motions through several waypoints, from rest or from a moving start.

use super::blend::keeps;
use super::going_over::{gone_over, to_state};
use super::motion::Node;
use super::retime::Retimed;
use super::spline::Spline;
use super::trajectory::{Builder, Refusal};
use crate::ProblemError;
use crate::model::{JointMap, MAX_JOINTS, Row};

/// Number of states before the second waypoint at which a motion from a moving start may join a motion from rest.
const STATES: usize = 24;

/// Waypoints of a motion, waypoints at which it stops, and minimum times between waypoints.
pub(super) struct Course<'a> {
    pub points: &'a [Row],
    pub stops: &'a [usize],
    pub slowest: &'a [f64],
}

impl Course<'_> {
    /// Returns the motion through the waypoints that starts at rest; `first` replaces the first waypoint.
    pub fn driven_from_rest(&self, mut builder: Builder, first: Row) -> Result<Retimed, ProblemError> {
        let limits = *builder.limits();
        let joints = limits.joints();
        let refused = |refusal: Refusal| match refusal {
            Refusal::Cancelled => ProblemError::new("retime", "was cancelled"),
            _ if limits.envelope.is_some() => {
                ProblemError::new("waypoints", "lead through a position where a joint limit allows no further motion")
            }
            _ => ProblemError::new("waypoints", "cannot be traversed within the limits"),
        };
        let mut times = vec![builder.now()];
        let mut from = 0;
        for stop in self.stops {
            let mut way = self.points[from..=*stop].to_vec();
            if from == 0 {
                way[0] = first;
            }
            let marks: Vec<usize> = (1..way.len()).collect();
            let slowest = self.slowest.get(from..*stop).unwrap_or_default();
            let path = Spline::through(joints, &way, None);
            times.extend(builder.push(&path, slowest, &[0.0; MAX_JOINTS], None, &marks).map_err(refused)?);
            from = *stop;
        }
        Ok(Retimed { trajectory: builder.build(&JointMap::each(joints, &first[..joints])), times })
    }

    /// Returns the motion from a moving start that ends earliest. Before the second waypoint, it joins a motion that
    /// follows the path from rest. The motion from rest begins at one of three positions: the start, the position where
    /// braking from the start would end, or this position mirrored at the start.
    pub fn under_way(
        &self,
        builder: &Builder,
        start: &[Row; 3],
        room: [&Row; 2],
        resting: &[Node],
    ) -> Result<Retimed, ProblemError> {
        let limits = builder.limits();
        let rest = resting[resting.len() - 1].position;
        let mut back = start[0];
        for v in 0..limits.joints() {
            back[v] -= rest[v] - start[0][v];
        }
        let least = self.slowest.first().copied().unwrap_or(0.0);
        let mut refused = ProblemError::new("waypoints", "cannot be traversed from the start state");
        let mut soonest: Option<(f64, Vec<Node>, f64, Retimed)> = None;
        for first in [start[0], back, rest] {
            let along = match self.driven_from_rest(builder.clone(), first) {
                Ok(along) => along,
                Err(e) => {
                    refused = e;
                    continue;
                }
            };
            let (begin, pass) = (along.times[0], along.times[1]);
            let mut best: Option<(f64, Vec<Node>, f64)> = None;
            for k in 0..=STATES {
                let time = begin + (pass - begin) * k as f64 / STATES as f64;
                let lead = if k == 0 && first == rest {
                    Some(resting.to_vec())
                } else {
                    to_state(limits, start, &along.trajectory.moving_with_rates(time))
                };
                let Some(lead) = lead.filter(|nodes| keeps(limits, room, nodes)) else { continue };
                let late = lead[lead.len() - 1].time - (time - begin);
                let end = along.trajectory.end() + late;
                let is_slow = pass + late - begin >= least;
                if is_slow && best.as_ref().is_none_or(|(other, ..)| end < *other) {
                    best = Some((end, lead, time));
                }
            }
            if let Some((end, lead, time)) = best
                && soonest.as_ref().is_none_or(|(other, ..)| end < *other)
            {
                soonest = Some((end, lead, time, along));
            }
        }
        let Some((_, lead, time, along)) = soonest else { return Err(refused) };
        let late = lead[lead.len() - 1].time - (time - along.times[0]);
        let mut times = vec![along.times[0]];
        times.extend(along.times.iter().skip(1).map(|t| t + late));
        Ok(Retimed { trajectory: gone_over(limits, &lead, &along.trajectory, time), times })
    }
}

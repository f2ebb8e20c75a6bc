//! Blends of two motions: the second motion begins while the first one, called the lead, still decelerates, and their
//! velocities add up. In this way the robot rounds a corner without a stop.

use super::limits::{Limits, TOLERANCE};
use super::motion::{Node, Piece, peaks, range, smooth_range};
use super::trajectory::Trajectory;
use crate::model::Row;

/// Number of start times of the second motion that are tried, from the earliest one to the end of the lead. Also the
/// number of bisections between the first start time that keeps the limits and the previous one.
const TRIES: u32 = 12;
const HALVINGS: usize = 6;
/// Fraction of the jerk limit reserved for rounding errors; nodes closer in time than it permits are dropped.
const ROUNDED: f64 = 1e-7;
/// Rounding error of a quintic's jerk times the cube of its duration (rad or m).
const ROUNDING: f64 = 3e-14;

/// Inputs of a blend.
pub(crate) struct Blend<'a> {
    /// The lead: from time 0 to rest at the start of the motion.
    pub lead: &'a [Node],
    /// Limits of the blended motion.
    pub limits: &'a Limits,
    /// Lower and upper position limits of the joints.
    pub room: [&'a Row; 2],
    /// Earliest time (s) after the start of the lead at which the motion may begin.
    pub earliest: f64,
}

impl Blend<'_> {
    /// End time of the lead (s).
    fn end(&self) -> f64 {
        self.lead.last().map_or(0.0, |node| node.time)
    }

    /// Returns the lead followed by `motion`, which begins as early as the limits allow, and the delay (s) of the start
    /// of `motion` after the start of the lead.
    pub fn of(&self, motion: &Trajectory) -> (Trajectory, f64) {
        let end = self.end();
        let mut late = end;
        let mut found = None;
        for k in 0..TRIES {
            let begin = self.earliest.max(0.0) + (end - self.earliest.max(0.0)) * f64::from(k) / f64::from(TRIES);
            if begin >= end {
                break;
            }
            if let Some(nodes) = self.over(motion, begin) {
                (late, found) = (begin, Some(nodes));
                let mut low = begin - (end - self.earliest.max(0.0)) / f64::from(TRIES);
                for _ in 0..if k == 0 { 0 } else { HALVINGS } {
                    let middle = 0.5 * (low + late);
                    match self.over(motion, middle) {
                        Some(nodes) => (late, found) = (middle, Some(nodes)),
                        None => low = middle,
                    }
                }
                break;
            }
        }
        (self.joined(motion, late, found), late)
    }

    /// Returns the lead, followed by `motion`, which begins when the lead has ended.
    pub fn one_after_the_other(&self, motion: &Trajectory) -> (Trajectory, f64) {
        (self.joined(motion, self.end(), None), self.end())
    }

    /// Returns nodes of the sum of the lead and `motion` from time `begin` (s) to the end of the lead. The nodes' times
    /// count from `begin`. `None` if the sum exceeds a limit.
    fn over(&self, motion: &Trajectory, begin: f64) -> Option<Vec<Node>> {
        let joints = self.limits.joints();
        let lead = Piece::plain(0.0, joints, self.lead);
        let end = self.end();
        let start = motion.start();
        let base = self.lead.last()?.position;
        let at = |time: f64| {
            let mut sum = lead.at(begin + time);
            let [position, velocity, acceleration] = motion.moving_with_rates(start + time);
            for v in 0..joints {
                sum[0][v] += position[v] - base[v];
                sum[1][v] += velocity[v];
                sum[2][v] += acceleration[v];
            }
            let [position, velocity, acceleration] = sum;
            Node { time, position, velocity, acceleration: Some(acceleration) }
        };
        let mut times: Vec<f64> = self.lead.iter().map(|node| node.time - begin).collect();
        for piece in motion.pieces() {
            times.extend(piece.corners().iter().map(|t| t - start));
        }
        let jerk = self.limits.jerk[..joints].iter().copied().fold(f64::INFINITY, f64::min);
        let shortest = (ROUNDING / (ROUNDED * jerk)).cbrt();
        let whole = end - begin;
        times.retain(|t| *t > shortest && *t < whole - shortest);
        times.sort_by(f64::total_cmp);
        times.dedup_by(|b, a| *b - *a < shortest);
        times.push(whole);
        let mut nodes = vec![at(0.0)];
        for time in times {
            let (next, last) = (at(time), nodes[nodes.len() - 1]);
            let kept = peaks(self.limits, &last, &next).into_iter().all(|share| share <= 1.0 + TOLERANCE);
            let inside = |v: usize| {
                let (low, high) = smooth_range(&last, &next, v);
                let (first, most) = (self.lead[0].position[v], TOLERANCE);
                low >= self.room[0][v].min(first) - most && high <= self.room[1][v].max(first) + most
            };
            if !kept || !(0..joints).all(inside) {
                return None;
            }
            nodes.push(next);
        }
        Some(nodes)
    }

    /// Returns the lead and `motion`, which begins `late` seconds after it; `over` holds the nodes while both move.
    fn joined(&self, motion: &Trajectory, late: f64, over: Option<Vec<Node>>) -> Trajectory {
        let (joints, start, end) = (self.limits.joints(), motion.start(), self.end());
        if end <= 0.0 {
            return motion.clone();
        }
        let mut pieces = Vec::new();
        if late > 0.0 {
            pieces.push(Piece::plain(start, joints, self.lead));
        }
        if let Some(nodes) = over {
            pieces.push(Piece::smooth(start + late, joints, &nodes, &[]));
        }
        let whole = start + late + (motion.end() - start);
        if whole > start + end {
            pieces.extend(motion.from(start + end - late).into_iter().map(|piece| piece.delayed(late)));
        }
        let mut times = vec![start];
        times.extend(motion.times().iter().map(|t| t + late).filter(|t| *t > start));
        if whole < start + end {
            times.push(start + end);
        }
        motion.with(pieces, times, *self.limits)
    }
}

/// Returns whether a motion through nodes keeps the position limits and the position-dependent velocity limits. A joint
/// that starts outside its position limits may stay outside, but may not move further out.
pub(crate) fn keeps(limits: &Limits, room: [&Row; 2], nodes: &[Node]) -> bool {
    let joints = limits.joints();
    nodes.windows(2).all(|pair| {
        (0..joints).all(|v| {
            let (low, high) = range(joints, v, &pair[0], &pair[1]);
            let first = nodes[0].position[v];
            low >= room[0][v].min(first) - TOLERANCE
                && high <= room[1][v].max(first) + TOLERANCE
                && limits.envelope.is_none_or(|e| e.is_kept_between(joints, v, &pair[0], &pair[1]))
        })
    })
}

#[cfg(test)]
mod tests {
    use super::super::spline::Spline;
    use super::super::testing::row;
    use super::super::trajectory::Builder;
    use super::super::{stop::stop, to_rest};
    use super::*;
    use crate::joint_map::JointMap;
    use crate::model::MAX_JOINTS;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(100))]
        #[test]
        fn blends_are_smooth_keep_the_limits_and_are_no_later_than_one_after_the_other(
            q in prop::collection::vec(-1.0..1.0f64, 3), speed in prop::collection::vec(-1.0..1.0f64, 3),
            gain in prop::collection::vec(-1.0..1.0f64, 3), corner in prop::collection::vec(-1.0..1.0f64, 3),
            goal in prop::collection::vec(-1.0..1.0f64, 3), at_stop in any::<bool>(),
            (a, j) in prop_oneof![Just((10.0, 5000.0)), Just((10.0, 300.0)), Just((5.0, 50.0))],
        ) {
            let limits = Limits::new(&[1.5; 3], &[a; 3], &[j; 3]).unwrap();
            let gain: Vec<f64> = gain.iter().map(|g| g * a.min((0.5 * j).sqrt())).collect();
            let room = |v: usize| 1.5 - 0.5 * gain[v] * gain[v] / j;
            prop_assume!((0..3).all(|v| room(v) > 0.0));
            let velocity: Vec<f64> = (0..3).map(|v| speed[v] * room(v)).collect();
            let (q, v, g) = (row(&q), row(&velocity), row(&gain));
            let lead = match at_stop {
                true => stop(&limits, &q, &v, &g),
                false => to_rest(&limits, &q, &v, &g, &row(&corner)),
            };
            let begin = lead[lead.len() - 1].position;
            let mut builder = Builder::new(limits, 0.7);
            let path = Spline::through(3, &[begin, row(&goal)], None);
            builder.push(&path, &[], &[0.0; MAX_JOINTS], None, &[]).unwrap();
            let along = builder.build(&JointMap::each(3, &q[..3]));
            let far = [&[-1e3; MAX_JOINTS], &[1e3; MAX_JOINTS]];
            let blend = Blend { lead: &lead, limits: &limits, room: far, earliest: 0.0 };
            let (motion, late) = blend.of(&along);
            let (plain, end) = blend.one_after_the_other(&along);
            prop_assert!(motion.end() <= plain.end() + 1e-12 && late <= end && motion.start() == 0.7);
            for trajectory in [&motion, &plain] {
                let steps = 3000;
                let h = (trajectory.end() - trajectory.start()) / f64::from(steps);
                let [p, w, c] = trajectory.moving_with_rates(0.7);
                for v in 0..3 {
                    prop_assert!((p[v] - q[v]).abs() < 1e-9 && (w[v] - velocity[v]).abs() < 1e-9, "{p:?} {w:?}");
                    prop_assert!((c[v] - gain[v]).abs() < 1e-6);
                }
                let mut before = trajectory.sample(0.7);
                for k in 1..=steps {
                    let now = trajectory.sample(0.7 + h * f64::from(k));
                    for v in 0..3 {
                        prop_assert!(now.velocity[v].abs() <= 1.5 * (1.0 + 1e-5));
                        prop_assert!(now.acceleration[v].abs() <= a * (1.0 + 1e-5), "{} {a}", now.acceleration[v]);
                        let jerk = (now.acceleration[v] - before.acceleration[v]).abs() / h;
                        prop_assert!(jerk <= j * (1.0 + 1e-5) + 1e-5 / h, "{jerk} {j}");
                        let way = now.position[v] - before.position[v];
                        prop_assert!((way - 0.5 * h * (now.velocity[v] + before.velocity[v])).abs() <= j * h * h * h + 1e-9);
                    }
                    before = now;
                }
                for v in 0..3 {
                    prop_assert!((before.position[v] - goal[v]).abs() < 1e-9 && before.velocity[v].abs() < 1e-9);
                }
            }
        }
    }

    #[test]
    fn an_even_motion_that_goes_on_is_not_slowed() {
        let limits = Limits::new(&[1.0], &[5.0], &[2000.0]).unwrap();
        let (q, v, still) = (row(&[0.0]), row(&[1.0]), row(&[0.0]));
        let lead = stop(&limits, &q, &v, &still);
        let begin = lead[lead.len() - 1].position;
        let mut builder = Builder::new(limits, 0.0);
        builder.push(&Spline::through(1, &[begin, row(&[2.0])], None), &[], &still, None, &[]).unwrap();
        let along = builder.build(&JointMap::each(1, &[0.0]));
        let far = [&[-1e3; MAX_JOINTS], &[1e3; MAX_JOINTS]];
        let (motion, _) = Blend { lead: &lead, limits: &limits, room: far, earliest: 0.0 }.of(&along);
        let best = to_rest(&limits, &q, &v, &still, &row(&[2.0]));
        assert!(motion.end() < best[best.len() - 1].time * 1.02, "{}", motion.end());
    }
}

//! Final collision check of the complete timed motion.

use super::attempt::Attempt;
use super::failure::Failure;
use super::planner::Planner;
use super::timed::{Stretch, TakeUp, Timed};
use crate::model::Row;
use crate::transit::{Breach, Carriage, Sweep};
use crate::world::{Compiled, Hit, Margins, State, TOUCH};
use crate::{Cancel, ObjectJoint, Trajectory};

/// Maximum deviation (rad or m) of a joint from the straight segment between two neighbouring samples.
pub(super) const OFF: f64 = 2e-5;
/// Number of times per waypoint at which the travel of the object's joint is computed.
const TIMES: usize = 4;
/// Minimum and maximum time (s) between samples. Both are larger in a long motion: the minimum gives at most
/// `MAX_SAMPLES` samples, the maximum at most `ENOUGH`.
const SHORTEST: f64 = 2e-3;
const LONGEST: f64 = 2e-2;
const MAX_SAMPLES: f64 = 2e4;
const ENOUGH: f64 = 1e3;

/// Samples of a motion, with the maximum deviation of each joint from the straight line to the next sample.
pub(super) struct Samples {
    times: Vec<f64>,
    pub waypoints: Vec<Row>,
    pub off: Vec<Row>,
}

impl Samples {
    /// Samples a motion of `joints` variables between two times (s). Between samples `h` apart, a joint with an
    /// acceleration of at most `a` deviates by at most `a h^2 / 8` from the straight line. The samples end early if
    /// planning is over.
    pub fn of(trajectory: &Trajectory, joints: usize, [begin, end]: [f64; 2], most: f64, over: &Cancel) -> Self {
        let mut time = begin;
        let wider = (most / OFF).sqrt();
        let shortest = wider * SHORTEST.max((end - begin) / MAX_SAMPLES);
        let longest = wider * LONGEST.max((end - begin) / ENOUGH);
        let [position, _, mut acceleration] = trajectory.moving_with_rates(time);
        let mut out = Self { times: vec![begin], waypoints: vec![position], off: Vec::new() };
        while time < end && !over.is_cancelled() {
            let hardest = acceleration[..joints].iter().fold(0.0_f64, |most, a| most.max(a.abs()));
            let mut step = (8.0 * most / hardest).sqrt().clamp(shortest, longest);
            loop {
                let next = if time + step >= end { end } else { time + step };
                let [off, _] = trajectory.deviations([time, next]);
                if step > shortest && off[..joints].iter().any(|o| *o > 2.0 * most) {
                    step = (0.5 * step).max(shortest);
                    continue;
                }
                let [position, _, after] = trajectory.moving_with_rates(next);
                out.times.push(next);
                out.waypoints.push(position);
                out.off.push(off);
                (time, acceleration) = (next, after);
                break;
            }
        }
        out
    }
}

/// Returns the movement of the object's joint between two times (s). The motion passes the waypoints of a segment one
/// after another.
fn carriage(
    joint: ObjectJoint,
    motion: &Trajectory,
    joints: usize,
    [begin, end]: [f64; 2],
    segment: &Stretch<'_>,
) -> Carriage {
    let (waypoints, travel) = (&segment.waypoints, &segment.travel);
    let is_still = travel.windows(2).all(|w| w[0].to_bits() == w[1].to_bits());
    if is_still || travel.len() != waypoints.len() {
        return Carriage { joint, times: vec![begin], travel: vec![travel.first().copied().unwrap_or(0.0)] };
    }
    let last = waypoints.len() - 2;
    let mut k = 0;
    let part = |k: usize, x: &Row| {
        let (mut along, mut whole) = (0.0, 0.0);
        for v in 0..joints {
            let way = waypoints[k + 1][v] - waypoints[k][v];
            along += way * (x[v] - waypoints[k][v]);
            whole += way * way;
        }
        if whole > 0.0 { along / whole } else { 1.0 }
    };
    let mut place = |x: &Row| {
        let mut share = part(k, x);
        while share >= 1.0 && k < last {
            k += 1;
            share = part(k, x);
        }
        travel[k] + share.clamp(0.0, 1.0) * (travel[k + 1] - travel[k])
    };
    let count = TIMES * waypoints.len();
    let times: Vec<f64> = (0..=count).map(|k| begin + (end - begin) * k as f64 / count as f64).collect();
    let travel = times.iter().map(|time| place(&motion.moving(*time))).collect();
    Carriage { joint, times, travel }
}

impl Planner<'_> {
    /// Times an attempt's motion and sweeps the result. After a collision, it first retries with a stop between
    /// segments, and then with a stop at every corner of the free motion as well.
    pub(super) fn emit(&mut self, attempt: &mut Attempt) -> Result<Timed, Failure> {
        let clock = self.clock.clone();
        let mut manner = TakeUp::GoesOn;
        let mut stops: Vec<bool> = Vec::new();
        loop {
            let mut segments = self.segments(attempt, clock.as_deref());
            stops.resize(segments.len(), false);
            for (segment, stop) in segments.iter_mut().zip(&stops) {
                segment.stops |= stop;
            }
            let (timed, taken) = self.timed(attempt, &segments, manner)?;
            let met = match self.problem.options.avoid_collisions {
                true => self.first_hit(&timed, &segments).or_else(|| self.comes_back(&timed, &segments)),
                false => None,
            };
            // A check that was cut short proves nothing.
            if self.world.unfinished {
                return Err(Failure::Unproven { keyframe: self.entry });
            }
            let Some((k, hit)) = met else { return Ok(timed) };
            if taken == TakeUp::GoesOn || (taken == TakeUp::Blended && k < attempt.approach.len().max(1)) {
                manner = if taken == TakeUp::GoesOn { TakeUp::Blended } else { TakeUp::Stopped };
                continue;
            }
            let toward = segments[k].toward;
            let free = k < attempt.approach.len();
            if free && attempt.is_sampled {
                return Err(Failure::Blocked { keyframe: toward, hit });
            }
            let joined: Vec<usize> = (k.saturating_sub(1)..=k).filter(|segment| !segments[*segment].stops).collect();
            if !joined.is_empty() {
                joined.into_iter().for_each(|segment| stops[segment] = true);
            } else if free && !attempt.corners.is_empty() {
                drop(segments);
                attempt.approach = std::mem::take(&mut attempt.corners);
                stops.clear();
            } else {
                return Err(Failure::Blocked { keyframe: toward, hit });
            }
        }
    }

    /// Finds the first segment of the approach in which separated bodies overlap again, and the pair. Needed only if no
    /// straight motion out of the overlap was found, since the margins then permit the overlap.
    fn comes_back(&mut self, timed: &Timed, segments: &[Stretch<'_>]) -> Option<(usize, Hit)> {
        if self.world.start_overlap <= TOUCH || self.exit != Some(None) || segments[0].toward != self.entry {
            return None;
        }
        let toward = segments[0].segment;
        let approach = segments.iter().zip(&timed.spans).take_while(|(segment, _)| segment.segment == toward);
        let start = self.start[0];
        let mut before = self.world.overlaps(State::still(&start), toward);
        for (k, (_, span)) in approach.enumerate() {
            for x in Samples::of(&timed.trajectory, self.model.n(), *span, OFF, &self.over).waypoints {
                if self.world.cut_short() {
                    return None;
                }
                let now = self.world.overlaps(State::still(&x), toward);
                if now.iter().any(|overlap| overlap.is_new(&before)) {
                    return self
                        .world
                        .hit_at(State::still(&x), toward, &Margins::plain(0.0).parted())
                        .map(|hit| (k, hit));
                }
                before = now;
            }
        }
        None
    }

    /// Returns the first segment of a timed motion in which two bodies come closer than permitted, and the pair.
    fn first_hit(&mut self, timed: &Timed, segments: &[Stretch<'_>]) -> Option<(usize, Hit)> {
        let parts = segments.iter().zip(&timed.spans).enumerate();
        for (k, (segment, span)) in parts {
            match self.breach(&timed.trajectory, segment, *span) {
                Ok(()) => {}
                Err(Breach::Near(hit)) => return Some((k, hit)),
                Err(Breach::Over) => {
                    self.world.unfinished = true;
                    return None;
                }
            }
        }
        None
    }

    /// Proves that a motion keeps the required distances of a segment between two times (s).
    fn breach(&mut self, motion: &Trajectory, segment: &Stretch<'_>, span: [f64; 2]) -> Result<(), Breach> {
        let (number, kept) = (segment.segment, segment.kept);
        let riders = self.world.riders(number);
        let changed = riders.map(|riders| Compiled::with_riders(&self.scene, &riders));
        let compiled = changed.as_ref().unwrap_or_else(|| self.scene.compiled());
        let needs = self.world.required(compiled, number, kept);
        let weights = self.model.mean_levers(&self.problem.robot);
        let mut sweep = Sweep::new((&self.scene, compiled), self.model, &needs, weights, &self.over);
        let mut outcome = sweep.breach(motion, span);
        let mut checks = sweep.checks;
        if let (true, Some(joint)) = (outcome.is_ok(), self.problem.joint)
            && let Some(needs) = self.world.required_from_moved(compiled, number, kept)
        {
            let mut beside = sweep.beside(carriage(joint, motion, self.model.n(), span, segment), &needs);
            outcome = beside.breach(motion, span);
            checks = beside.checks;
        }
        self.world.spend(checks);
        outcome
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::timing::{Limits, RetimeOptions, retime};

    #[test]
    fn between_samples_no_joint_is_further_off_than_they_say() {
        let limits = Limits::new(&[1.0, 1.5], &[5.0, 8.0], &[500.0, 900.0]).unwrap();
        let waypoints = [vec![0.0, 0.0], vec![0.5, 0.2], vec![0.3, 0.9], vec![-0.4, 0.8]];
        let motion = retime(&waypoints, &limits, &RetimeOptions::default()).unwrap().trajectory;
        let samples = Samples::of(&motion, 2, [motion.start(), motion.end()], OFF, &Cancel::new());
        assert_eq!(samples.off.len() + 1, samples.waypoints.len());
        assert!(samples.off.iter().all(|off| off[..2].iter().all(|o| *o <= 2.5 * OFF)));
        // Check whether all joints are close to `x` at one common position on the segment.
        let beside = |x: &Row, k: usize| {
            let (a, b) = (&samples.waypoints[k], &samples.waypoints[k + 1]);
            let (mut from, mut to) = (0.0_f64, 1.0_f64);
            for v in 0..2 {
                let (way, off) = (b[v] - a[v], samples.off[k][v] + 1e-9);
                let ends = [(x[v] - a[v] - off) / way, (x[v] - a[v] + off) / way];
                from = from.max(ends[0].min(ends[1]));
                to = to.min(ends[0].max(ends[1]));
            }
            from <= to
        };
        let count = 20_000;
        for k in 0..=count {
            let time = motion.start() + (motion.end() - motion.start()) * f64::from(k) / f64::from(count);
            let x = motion.moving_with_rates(time)[0];
            assert!((0..samples.off.len()).any(|segment| beside(&x, segment)), "at {time}");
        }
    }

    #[test]
    fn samples_end_when_planning_is_over() {
        let limits = Limits::new(&[1.0], &[1.0], &[100.0]).unwrap();
        let motion = retime(&[vec![0.0], vec![2.0]], &limits, &RetimeOptions::default()).unwrap().trajectory;
        let over = Cancel::new();
        let count = |over: &Cancel| Samples::of(&motion, 1, [motion.start(), motion.end()], OFF, over).waypoints.len();
        assert!(count(&over) > 50);
        over.cancel();
        assert_eq!(count(&over), 1);
    }

    #[test]
    fn long_motions_have_few_samples() {
        let limits = Limits::new(&[1e-3], &[1e-3], &[1e-2]).unwrap();
        let motion = retime(&[vec![0.0], vec![40.0]], &limits, &RetimeOptions::default()).unwrap().trajectory;
        assert!(motion.end() > 3e4);
        assert!(Samples::of(&motion, 1, [motion.start(), motion.end()], OFF, &Cancel::new()).waypoints.len() < 3_000);
    }
}

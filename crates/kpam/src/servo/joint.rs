//! Motion of one joint over the next step: constant jerk, then the fastest stop.

use crate::model::{MAX_JOINTS, Row};
use crate::timing::{Envelope, Node, Phase, State, go_on, stopping};

/// Tolerance (rad or m, and per second) for rounding.
const SLACK: f64 = 1e-9;
/// Maximum number of trials for the largest jerk that keeps the limits, of which the first are false positions and the
/// others bisections, and fraction of the jerk's range within which it is found.
const TRIALS: usize = 32;
const FALSE_POSITIONS: usize = 8;
const EXACT: f64 = 1e-7;
/// Maximum number of reversals of a joint in one step and one stop: two in each of the four phases.
const REVERSALS: usize = 8;

/// Phases of constant jerk, followed by rest.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Course {
    phases: [Phase; 4],
    /// State at the start of each phase, and the state of rest.
    states: [State; 5],
}

/// Times (s) at which a joint reverses, and the positions there.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Reversals {
    count: usize,
    at: [(f64, f64); REVERSALS],
}

impl Course {
    fn new(start: State, phases: [Phase; 4]) -> Self {
        let mut states = [start; 5];
        for (k, (duration, jerk)) in phases.iter().enumerate() {
            states[k + 1] = go_on(states[k], *jerk, *duration);
        }
        (states[4][1], states[4][2]) = (0.0, 0.0);
        Self { phases, states }
    }

    /// Returns the fastest stop from a state.
    pub fn stop(start: State, limits: &JointLimits) -> Self {
        let [a, b, c] = stopping(start[1], start[2], limits.acceleration, limits.jerk);
        Self::new(start, [(0.0, 0.0), a, b, c])
    }

    /// Returns one step of `dt` (s) with constant jerk, and then the fastest stop.
    pub fn step(start: State, jerk: f64, dt: f64, limits: &JointLimits) -> Self {
        let next = go_on(start, jerk, dt);
        let [a, b, c] = stopping(next[1], next[2], limits.acceleration, limits.jerk);
        Self::new(start, [(dt, jerk), a, b, c])
    }

    /// Returns the time (s) after which the joint rests.
    pub fn duration(&self) -> f64 {
        self.phases.iter().map(|(duration, _)| duration).sum()
    }

    /// Returns the state at time `t` (s).
    pub fn at(&self, t: f64) -> State {
        let mut left = t;
        for (state, (duration, jerk)) in self.states.iter().zip(&self.phases) {
            if left <= *duration {
                return go_on(*state, *jerk, left);
            }
            left -= duration;
        }
        self.states[4]
    }

    /// Returns the greatest absolute acceleration at the phases' ends between two times (s), which need not include the
    /// acceleration at these times.
    pub fn acceleration(&self, from: f64, to: f64) -> f64 {
        let (mut most, mut begun) = (0.0_f64, 0.0);
        for (state, (duration, _)) in self.states.iter().zip(&self.phases) {
            if begun >= from && begun <= to {
                most = most.max(state[2].abs());
            }
            begun += duration;
        }
        most
    }

    /// Visits the start of each phase, with its duration and jerk.
    fn each(&self, mut visit: impl FnMut(&State, Phase)) {
        for (state, phase) in self.states.iter().zip(self.phases).filter(|(_, (duration, _))| *duration > 0.0) {
            visit(state, phase);
        }
        visit(&self.states[4], (0.0, 0.0));
    }

    /// Returns the reversals of the joint.
    pub fn reversals(&self) -> Reversals {
        let (mut out, mut begun) = (Reversals::default(), 0.0);
        self.each(|state, (duration, jerk)| {
            let mut found = stills(*state, jerk);
            found.sort_by(f64::total_cmp);
            for t in found.into_iter().filter(|t| *t > 0.0 && *t < duration) {
                if let Some(place) = out.at.get_mut(out.count) {
                    *place = (begun + t, go_on(*state, jerk, t)[0]);
                    out.count += 1;
                }
            }
            begun += duration;
        });
        out
    }

    /// Returns the least and the greatest position.
    pub fn positions(&self, reversals: &Reversals) -> (f64, f64) {
        let [first, last] = [self.states[0][0], self.states[4][0]];
        let turned = reversals.at[..reversals.count].iter().map(|(_, position)| *position);
        turned.fold((first.min(last), first.max(last)), |(low, high), q| (low.min(q), high.max(q)))
    }
}

impl Reversals {
    /// Returns how far the joint moves in total (rad or m) between two times with the given positions.
    pub fn travel(&self, from: (f64, f64), to: (f64, f64)) -> f64 {
        let (mut last, mut sum) = (from.1, 0.0);
        for (_, position) in self.at[..self.count].iter().filter(|(t, _)| *t > from.0 && *t < to.0) {
            sum += (position - last).abs();
            last = *position;
        }
        sum + (to.1 - last).abs()
    }
}

/// Returns the times at which the velocity is zero; NaN if there is none.
fn stills([_, velocity, acceleration]: State, jerk: f64) -> [f64; 2] {
    // This form of the quadratic formula does not cancel if the jerk is tiny.
    let root = (acceleration * acceleration - 2.0 * jerk * velocity).sqrt();
    let sum = -(acceleration + acceleration.signum() * root);
    [sum / jerk, 2.0 * velocity / sum]
}

/// Limits of one joint.
#[derive(Debug, Clone, Copy)]
pub(super) struct JointLimits {
    /// Index among the planned variables.
    pub variable: usize,
    pub lower: f64,
    pub upper: f64,
    pub velocity: f64,
    pub acceleration: f64,
    pub jerk: f64,
    /// Velocity limits that depend on the position, if any.
    pub envelope: Option<Envelope>,
}

/// Range of the velocity to which a joint may settle after the next step (rad/s or m/s).
#[derive(Debug, Clone, Copy)]
pub(super) struct Settled {
    pub low: f64,
    pub high: f64,
    /// Range of the jerk in the next step; `None` if the joint must follow its stop.
    pub jerk: Option<[f64; 2]>,
    /// Whether the joint's range, rather than its acceleration and jerk, determines the lower and the upper end.
    pub by_range: [bool; 2],
}

impl JointLimits {
    /// Widens the range of the joint to that of a course.
    pub fn include(&mut self, course: &Course) {
        let (least, most) = course.positions(&course.reversals());
        (self.lower, self.upper) = (self.lower.min(least), self.upper.max(most));
    }

    /// Returns by how much a course exceeds the limits of position or velocity on one side (1 upper, -1 lower), at most;
    /// not positive if it keeps them.
    fn excess(&self, course: &Course, side: f64) -> f64 {
        let end = if side > 0.0 { self.upper } else { -self.lower };
        let mut most = f64::NEG_INFINITY;
        course.each(|state, (duration, jerk)| {
            let mut look = |[position, velocity, _]: State| {
                most = most.max(side * position - end).max(side * velocity - self.velocity);
            };
            look(*state);
            let inside = |t: &f64| *t > 0.0 && *t < duration;
            let peaks = std::iter::once(-state[2] / jerk).chain(stills(*state, jerk)).filter(inside);
            peaks.for_each(|t| look(go_on(*state, jerk, t)));
        });
        most - SLACK
    }

    /// Returns whether a course keeps the velocity limits that depend on the position.
    fn is_inside(&self, course: &Course, envelope: &Envelope) -> bool {
        let (mut last, mut begun, mut kept): (Option<Node>, f64, bool) = (None, 0.0, true);
        course.each(|state, (duration, _)| {
            let row = |value: f64| -> Row {
                let mut out = [0.0; MAX_JOINTS];
                out[self.variable] = value;
                out
            };
            // The acceleration changes linearly within a phase; the nodes at its ends determine the cubic.
            let acceleration = Some(row(state[2]));
            let node = Node { time: begun, position: row(state[0]), velocity: row(state[1]), acceleration };
            if let Some(last) = &last {
                kept &= envelope.is_kept_between(self.variable + 1, self.variable, last, &node);
            }
            last = Some(node);
            begun += duration;
        });
        kept
    }

    /// Returns the velocity to which a joint settles if its acceleration returns to zero, in steps of `dt` (s).
    pub fn settled(&self, [_, velocity, acceleration]: State, dt: f64) -> f64 {
        let size = acceleration.abs();
        velocity + acceleration.signum() * (0.5 * size * size / self.jerk).max(0.5 * size * dt)
    }

    /// Returns the range of the settled velocity after the next step. In this range the joint keeps its limits and can
    /// still stop within them.
    pub fn range(&self, start: State, dt: f64) -> Settled {
        let low = ((-self.acceleration - start[2]) / dt).max(-self.jerk);
        let high = ((self.acceleration - start[2]) / dt).min(self.jerk);
        let settles = |jerk: f64| self.settled(go_on(start, jerk, dt), dt);
        match (self.nearest(start, [high, low], -1.0, dt), self.nearest(start, [low, high], 1.0, dt)) {
            (Some(least), Some(most)) if least <= most => Settled {
                low: settles(least),
                high: settles(most),
                jerk: Some([least, most]),
                by_range: [least > low, most < high],
            },
            _ => {
                let only = self.settled(Course::stop(start, self).at(dt), dt);
                Settled { low: only, high: only, jerk: None, by_range: [true; 2] }
            }
        }
    }

    /// Returns the jerk nearest to `wanted` with which a step keeps the limits on one side, if that at `safe` does.
    ///
    /// The excess grows with the distance from `safe`; the false position method in its Illinois form finds its zero.
    fn nearest(&self, start: State, [safe, wanted]: [f64; 2], side: f64, dt: f64) -> Option<f64> {
        let excess = |jerk: f64| {
            let course = Course::step(start, jerk, dt, self);
            let excess = self.excess(&course, side);
            // The bounds that depend on the position are only tested, so their excess has no size.
            let kept = excess > 0.0 || self.envelope.is_none_or(|envelope| self.is_inside(&course, &envelope));
            if kept { excess } else { f64::NAN }
        };
        let (mut inside, mut outside) = ((safe, excess(safe)), (wanted, excess(wanted)));
        if outside.1 <= 0.0 {
            return Some(wanted);
        }
        if inside.1.is_nan() || inside.1 > 0.0 {
            return None;
        }
        let (width, mut last) = (EXACT * (wanted - safe).abs(), 0.0);
        for trial in 0..TRIALS {
            let left = (outside.0 - inside.0).abs();
            if left <= width {
                break;
            }
            let share = inside.1 / (inside.1 - outside.1);
            let share = if trial < FALSE_POSITIONS && share.is_finite() { share } else { 0.5 };
            // Next to an end, the trial lies so far inside that the zero is enclosed.
            let least = 0.5 * width / left;
            let jerk = inside.0 + share.max(least).min(1.0 - least) * (outside.0 - inside.0);
            let found = excess(jerk);
            let same = if found <= 0.0 { last < 0.0 } else { last > 0.0 };
            // An end that stays twice counts half, so that it moves too.
            if found <= 0.0 {
                inside = (jerk, found);
                outside.1 *= if same { 0.5 } else { 1.0 };
                last = -1.0;
            } else {
                outside = (jerk, found);
                inside.1 *= if same { 0.5 } else { 1.0 };
                last = 1.0;
            }
        }
        Some(inside.0)
    }

    /// Returns the course after which the joint settles to a velocity within its range.
    pub fn toward(&self, start: State, range: &Settled, settled: f64, dt: f64) -> Course {
        let Some([least, most]) = range.jerk else { return Course::stop(start, self) };
        let change = settled - start[1] - 0.5 * start[2] * dt;
        let size = change.abs();
        // Changes of one step end at the wanted velocity without ringing; longer changes use the whole jerk.
        let acceleration = if size <= self.jerk * dt * dt {
            size / dt
        } else {
            self.jerk * ((0.25 * dt * dt + 2.0 * size / self.jerk).sqrt() - 0.5 * dt)
        };
        let jerk = (acceleration * change.signum() - start[2]) / dt;
        Course::step(start, jerk.max(least).min(most), dt, self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const DT: f64 = 1e-3;

    fn limits(jerk: f64) -> JointLimits {
        JointLimits { variable: 0, lower: -0.4, upper: 0.3, velocity: 1.2, acceleration: 6.0, jerk, envelope: None }
    }

    #[test]
    fn reversals_are_found_at_any_jerk() {
        // With the jerk of a rounding error, the velocity is zero at the time of constant acceleration.
        for jerk in [0.0, 5e-14, -5e-14, 1e-3] {
            let [from, to] = stills([0.0, 0.74, -14.55], jerk);
            assert!([from, to].iter().any(|t| (t - 0.74 / 14.55).abs() < 1e-5), "{jerk} {from} {to}");
        }
        let mut found = stills([0.0, 1.0, -3.0], 4.0);
        found.sort_by(f64::total_cmp);
        assert_eq!(found, [0.5, 1.0]);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]
        #[test]
        fn limits_hold_whatever_is_wanted(
            jerk in 50.0..2e4f64,
            wanted in prop::collection::vec((-4.0..4.0f64, 1usize..400), 30),
        ) {
            let limits = limits(jerk);
            let mut state = [0.0; 3];
            let mut past: Vec<f64> = vec![0.0; 4];
            for (velocity, steps) in wanted {
                for _ in 0..steps {
                    let range = limits.range(state, DT);
                    prop_assert!(range.low <= range.high);
                    let course = limits.toward(state, &range, velocity.clamp(range.low, range.high), DT);
                    state = course.at(DT);
                    past.push(state[0]);
                    let p: &[f64; 4] = past[past.len() - 4..].try_into().unwrap();
                    prop_assert!(state[0] >= -0.4 - 1e-8 && state[0] <= 0.3 + 1e-8, "{state:?}");
                    prop_assert!(((p[3] - p[2]) / DT).abs() <= 1.2 * (1.0 + 1e-6), "{p:?}");
                    prop_assert!(((p[3] - 2.0 * p[2] + p[1]) / DT.powi(2)).abs() <= 6.0 * (1.0 + 1e-6), "{p:?}");
                    let change = (p[3] - 3.0 * p[2] + 3.0 * p[1] - p[0]) / DT.powi(3);
                    prop_assert!(change.abs() <= jerk * (1.0 + 1e-6) + 1e-5, "{change} {jerk}");
                }
            }
        }

        #[test]
        fn a_wanted_velocity_is_reached_without_ringing(jerk in 50.0..1e7f64, wanted in -1.0..1.0f64) {
            let limits = JointLimits { lower: -10.0, upper: 10.0, ..limits(jerk) };
            let mut state = [0.0; 3];
            for _ in 0..1500 {
                let range = limits.range(state, DT);
                let next = limits.toward(state, &range, wanted.clamp(range.low, range.high), DT).at(DT);
                prop_assert!(next[1].abs() <= wanted.abs() + 1e-9, "{next:?} {wanted}");
                state = next;
            }
            prop_assert!((state[1] - wanted).abs() < 1e-9 && state[2].abs() < 1e-6, "{state:?} {wanted}");
        }

        #[test]
        fn travel_is_the_length_of_the_way(v in -1.0..1.0f64, a in -5.0..5.0f64, u in -900.0..900.0f64) {
            let limits = limits(1000.0);
            let course = Course::step([0.1, v, a], u, DT, &limits);
            let (end, reversals) = (course.duration(), course.reversals());
            let steps = 4000;
            let at = |k: usize| course.at(end * k as f64 / steps as f64)[0];
            let length: f64 = (0..steps).map(|k| (at(k + 1) - at(k)).abs()).sum();
            let travel = reversals.travel((0.0, at(0)), (end, at(steps)));
            prop_assert!((travel - length).abs() < 1e-6 && travel >= length - 1e-12, "{travel} {length}");
            prop_assert_eq!(course.at(end + 1.0)[1], 0.0);
        }
    }
}

//! Motion of one joint over the next step: constant jerk, then the fastest stop.

use crate::model::{MAX_JOINTS, Row};
use crate::timing::{Envelope, Node, Phase, State, go_on, stopping};

/// Tolerance (rad or m, and per second) for rounding.
const SLACK: f64 = 1e-9;
/// Number of bisections for the largest jerk that keeps the limits.
const HALVINGS: usize = 24;
/// Maximum number of reversals of a joint in one step and one stop: two in each of the four phases.
const REVERSALS: usize = 8;

/// Phases of constant jerk from a state, followed by rest.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Course {
    start: State,
    phases: [Phase; 4],
}

/// Times (s) at which a joint reverses, and the positions there.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Reversals {
    count: usize,
    at: [(f64, f64); REVERSALS],
}

impl Course {
    /// Returns the fastest stop from a state.
    pub fn stop(start: State, limits: &JointLimits) -> Self {
        let [a, b, c] = stopping(start[1], start[2], limits.acceleration, limits.jerk);
        Self { start, phases: [(0.0, 0.0), a, b, c] }
    }

    /// Returns one step of `dt` (s) with constant jerk, and then the fastest stop.
    pub fn step(start: State, jerk: f64, dt: f64, limits: &JointLimits) -> Self {
        let next = go_on(start, jerk, dt);
        let [a, b, c] = stopping(next[1], next[2], limits.acceleration, limits.jerk);
        Self { start, phases: [(dt, jerk), a, b, c] }
    }

    /// Returns the time (s) after which the joint rests.
    pub fn duration(&self) -> f64 {
        self.phases.iter().map(|(duration, _)| duration).sum()
    }

    /// Returns the state at time `t` (s).
    pub fn at(&self, t: f64) -> State {
        let (mut state, mut left) = (self.start, t);
        for (duration, jerk) in &self.phases {
            if left <= *duration {
                return go_on(state, *jerk, left);
            }
            state = go_on(state, *jerk, *duration);
            left -= duration;
        }
        [state[0], 0.0, 0.0]
    }

    /// Visits the start of each phase, with its duration and jerk.
    fn each(&self, mut visit: impl FnMut(State, Phase)) {
        let mut state = self.start;
        for phase in self.phases.iter().filter(|(duration, _)| *duration > 0.0) {
            visit(state, *phase);
            state = go_on(state, phase.1, phase.0);
        }
        visit([state[0], 0.0, 0.0], (0.0, 0.0));
    }

    /// Returns the reversals of the joint.
    pub fn reversals(&self) -> Reversals {
        let (mut out, mut begun) = (Reversals::default(), 0.0);
        self.each(|state, (duration, jerk)| {
            for t in stills(state, jerk).into_iter().filter(|t| *t > 0.0 && *t < duration) {
                if let Some(place) = out.at.get_mut(out.count) {
                    *place = (begun + t, go_on(state, jerk, t)[0]);
                    out.count += 1;
                }
            }
            begun += duration;
        });
        out.at[..out.count].sort_by(|a, b| a.0.total_cmp(&b.0));
        out
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
    if jerk == 0.0 {
        return [-velocity / acceleration, f64::NAN];
    }
    let root = (acceleration * acceleration - 2.0 * jerk * velocity).sqrt();
    [(-acceleration - root) / jerk, (-acceleration + root) / jerk]
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
        let reversals = course.reversals();
        let turned = reversals.at[..reversals.count].iter().map(|(_, position)| *position);
        for position in [course.start[0], course.at(f64::INFINITY)[0]].into_iter().chain(turned) {
            (self.lower, self.upper) = (self.lower.min(position), self.upper.max(position));
        }
    }

    /// Returns whether a course keeps the limits of position and velocity on one side (1 upper, -1 lower).
    fn keeps(&self, course: &Course, side: f64) -> bool {
        let (end, mut kept) = (if side > 0.0 { self.upper } else { -self.lower }, true);
        course.each(|state, (duration, jerk)| {
            let within = |[position, velocity, _]: State| {
                side * position <= end + SLACK && side * velocity <= self.velocity + SLACK
            };
            let inside = |t: &f64| *t > 0.0 && *t < duration;
            let peaks = std::iter::once(-state[2] / jerk).chain(stills(state, jerk)).filter(inside);
            kept &= within(state) && peaks.map(|t| go_on(state, jerk, t)).all(within);
        });
        kept && self.envelope.is_none_or(|envelope| self.is_inside(course, &envelope))
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
        let keeps = |jerk: f64, side: f64| self.keeps(&Course::step(start, jerk, dt, self), side);
        // Returns the jerk nearest to `wanted` that keeps the limits on one side, if that at `safe` does.
        let nearest = |safe: f64, wanted: f64, side: f64| -> Option<f64> {
            if keeps(wanted, side) {
                return Some(wanted);
            }
            if !keeps(safe, side) {
                return None;
            }
            let (mut inside, mut outside) = (safe, wanted);
            for _ in 0..HALVINGS {
                let middle = 0.5 * (inside + outside);
                *(if keeps(middle, side) { &mut inside } else { &mut outside }) = middle;
            }
            Some(inside)
        };
        let settles = |jerk: f64| self.settled(go_on(start, jerk, dt), dt);
        match (nearest(high, low, -1.0), nearest(low, high, 1.0)) {
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

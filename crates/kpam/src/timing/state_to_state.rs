//! Fastest motion from a moving state to rest at a goal. Each joint moves independently within its velocity,
//! acceleration and jerk limits (Kröger, "On-Line Trajectory Generation in Robotic Systems", 2010; Berscheid and
//! Kröger, "Jerk-limited Real-time Trajectory Generation with Arbitrary Target States", 2021).
//!
//! The goal lies on one side of the position at which the joint would stop if it braked at once. The fastest motion
//! accelerates towards the goal, cruises if it reaches the maximum velocity, and stops. The longer it accelerates, the
//! further it gets.
//!
//! A joint that has more time than it needs cruises more slowly. Every duration above the minimum is possible, because
//! a joint at rest at the goal can wait there.

use super::limits::Limits;
use super::motion::Node;
use super::stop::{Phase, State, go_on, nodes, state_of, stopping};
use crate::model::Row;

/// Maximum number of iterations of a root search.
const ROUNDS: usize = 200;
/// A joint whose motion is shorter than required by less than this fraction waits at the goal.
const SAME: f64 = 1e-9;

/// Limits of a joint: maximum velocity, acceleration and jerk.
type Most = [f64; 3];

/// A sequence of phases with constant jerk.
type Phases = Vec<Phase>;

fn duration(phases: &[Phase]) -> f64 {
    phases.iter().map(|(time, _)| time).sum()
}

fn after(state: State, phases: &[Phase]) -> State {
    phases.iter().fold(state, |state, (time, jerk)| go_on(state, *jerk, *time))
}

/// Returns the state relative to the goal, mirrored so that the goal lies above the position at which the joint would
/// stop, and the side of the goal before mirroring (1 or -1); 0 if the joint would stop at the goal.
fn seen_from_goal(state: State, goal: f64, [_, acceleration, jerk]: Most) -> (State, f64) {
    let [position, velocity, gain] = [state[0] - goal, state[1], state[2]];
    let stopped = after([position, velocity, gain], &stopping(velocity, gain, acceleration, jerk))[0];
    let side = if stopped < 0.0 {
        1.0
    } else if stopped > 0.0 {
        -1.0
    } else {
        0.0
    };
    if side < 0.0 { ([-position, -velocity, -gain], side) } else { ([position, velocity, gain], side) }
}

/// Returns the phases in which a joint accelerates upwards as hard as possible for `time` (s).
fn accelerating(gain: f64, time: f64, [_, acceleration, jerk]: Most) -> [Phase; 2] {
    let ramp = ((acceleration - gain) / jerk).clamp(0.0, time);
    [(ramp, jerk), (time - ramp, 0.0)]
}

/// Returns the longest time (s) for which a joint can accelerate upwards without exceeding its velocity limit.
fn longest([_, velocity, gain]: State, [most, acceleration, jerk]: Most) -> f64 {
    let peak = (jerk * (most - velocity) + 0.5 * gain * gain).max(0.0).sqrt();
    if peak <= acceleration {
        return ((peak - gain) / jerk).max(0.0);
    }
    let ramp = ((acceleration - gain) / jerk).max(0.0);
    let gained = ramp * 0.5 * (acceleration + gain) + 0.5 * acceleration * acceleration / jerk;
    ramp + ((most - velocity - gained) / acceleration).max(0.0)
}

/// Returns the root of an increasing function between `low` and `high`, by false position with the Illinois
/// modification. Bisection replaces it if it converges slowly.
fn root(mut low: f64, mut high: f64, value: impl Fn(f64) -> f64) -> f64 {
    let (mut below, mut above) = (value(low), value(high));
    let mut side = 0;
    for round in 0..ROUNDS {
        if high - low <= 4.0 * f64::EPSILON * high.abs() || below == 0.0 {
            return low;
        }
        if above == 0.0 {
            return high;
        }
        let secant = (low * above - high * below) / (above - below);
        let middle = 0.5 * (low + high);
        let inside = secant > low && secant < high && round % 3 != 2;
        let at = if inside { secant } else { middle };
        if at <= low || at >= high {
            break;
        }
        let now = value(at);
        if now > 0.0 {
            (high, above) = (at, now);
            below *= if side == 1 { 0.5 } else { 1.0 };
            side = 1;
        } else {
            (low, below) = (at, now);
            above *= if side == -1 { 0.5 } else { 1.0 };
            side = -1;
        }
    }
    low
}

/// Returns the fastest motion of a joint to rest at zero. Zero lies above the position at which the joint would stop.
fn fastest_up(state: State, most: Most) -> Phases {
    let [limit, acceleration, jerk] = most;
    let whole = |time: f64| {
        let up = accelerating(state[2], time, most);
        let [_, velocity, gain] = after(state, &up);
        let mut out = up.to_vec();
        out.extend(stopping(velocity, gain, acceleration, jerk));
        out
    };
    let end = |time: f64| after(state, &whole(time))[0];
    let last = longest(state, most);
    if end(last) > 0.0 {
        return whole(root(0.0, last, end));
    }
    let mut out = accelerating(state[2], last, most).to_vec();
    let [_, _, gain] = after(state, &out);
    out.push((gain.max(0.0) / jerk, -jerk));
    let [position, velocity, _] = after(state, &out);
    let down = stopping(velocity, 0.0, acceleration, jerk);
    let left = -after([position, velocity, 0.0], &down)[0];
    out.push(((left / velocity.min(limit).max(f64::MIN_POSITIVE)).max(0.0), 0.0));
    out.extend(down);
    out
}

/// Returns the motion that cruises at the velocity `pace` above zero, and its length without the cruise.
fn at_pace(state: State, pace: f64, [_, acceleration, jerk]: Most) -> (Phases, f64) {
    let mut out = stopping(state[1] - pace, state[2], acceleration, jerk).to_vec();
    let [position, ..] = after(state, &out);
    let down = stopping(pace, 0.0, acceleration, jerk);
    let end = after([position, pace, 0.0], &down)[0];
    out.push(((-end / pace).max(0.0), 0.0));
    out.extend(down);
    (out, end)
}

/// Returns a motion of a joint that cruises slowly, so that it comes to rest at zero after `time` (s). Zero lies above
/// the position at which the joint would stop. Returns the fastest motion if no cruise takes that long.
fn lasting_up(state: State, most: Most, time: f64) -> Phases {
    let fastest = fastest_up(state, most);
    if duration(&fastest) >= time * (1.0 - SAME) {
        return fastest;
    }
    let greatest = if at_pace(state, most[0], most).1 <= 0.0 {
        most[0]
    } else {
        root(0.0, most[0], |pace| at_pace(state, pace.max(f64::MIN_POSITIVE), most).1)
    };
    let late = |pace: f64| time - duration(&at_pace(state, pace, most).0);
    // The joint waits at the goal if no motion takes exactly `time`. This happens between the duration of the fastest
    // motion and that of the fastest motion with a cruise.
    if greatest.is_nan() || greatest <= 0.0 || late(greatest) < 0.0 {
        return fastest;
    }
    let mut low = greatest;
    for _ in 0..ROUNDS {
        low *= 0.5;
        if late(low) <= 0.0 {
            return at_pace(state, root(low, greatest, late), most).0;
        }
    }
    fastest
}

/// Returns the constant-jerk phases that bring one joint from `state` to rest at `goal`. They take `time` (s), or the
/// minimum time if that is longer or no time is given.
fn phases(state: State, goal: f64, most: Most, time: Option<f64>) -> Phases {
    let (seen, side) = seen_from_goal(state, goal, most);
    let out = match time {
        _ if side == 0.0 => stopping(seen[1], seen[2], most[1], most[2]).to_vec(),
        None => fastest_up(seen, most),
        Some(time) => lasting_up(seen, most, time),
    };
    out.into_iter().map(|(time, jerk)| (time, if side < 0.0 { -jerk } else { jerk })).collect()
}

/// Returns the nodes of the fastest motion to rest at `goal` from a state from which the joints can stop within their
/// limits. All joints take as long as the slowest one; a joint that cannot move more slowly waits at the goal.
pub(crate) fn to_rest(limits: &Limits, position: &Row, velocity: &Row, acceleration: &Row, goal: &Row) -> Vec<Node> {
    let joints = 0..limits.joints();
    let most = |v: usize| [limits.velocity[v], limits.acceleration[v], limits.jerk[v]];
    let state = |v: usize| state_of(position, velocity, acceleration, v);
    let time = joints.clone().map(|v| duration(&phases(state(v), goal[v], most(v), None))).fold(0.0, f64::max);
    let list: Vec<Phases> = joints.clone().map(|v| phases(state(v), goal[v], most(v), Some(time))).collect();
    let states: Vec<State> = joints.clone().map(state).collect();
    let mut out = nodes(limits, &states, &list);
    if let (true, Some(last)) = (out.len() > 1, out.last_mut()) {
        for v in joints {
            (last.position[v], last.velocity[v]) = (goal[v], 0.0);
        }
        last.acceleration = last.acceleration.map(|row| row.map(|_| 0.0));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::super::testing::row;
    use super::*;
    use crate::model::MAX_JOINTS;
    use proptest::prelude::*;

    /// Computes the minimum time by brute force, from two acceleration phases and a stop on a grid of switching times.
    fn by_search(state: State, goal: f64, most: Most) -> f64 {
        let (seen, _) = seen_from_goal(state, goal, most);
        let mut best = f64::INFINITY;
        // For each peak acceleration, there is one motion to the goal, with or without a cruise.
        for k in 0..=400 {
            let peak = seen[2] + (most[1] - seen[2]) * f64::from(k) / 400.0;
            let ramp = ((peak - seen[2]) / most[2], most[2]);
            let total = |hold: f64| {
                let up = [ramp, (hold, 0.0)];
                let [_, v, a] = after(seen, &up);
                let fits = v.max(v + 0.5 * a * a.abs() / most[2]) <= most[0] * (1.0 + 1e-9);
                let mut all = up.to_vec();
                all.extend(stopping(v, a, most[1], most[2]));
                (after(seen, &all)[0], duration(&all), fits)
            };
            let (mut low, mut high) = (0.0, 50.0);
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if total(middle).0 > 0.0 { high = middle } else { low = middle }
            }
            let (end, time, fits) = total(low);
            if fits && end.abs() < 1e-6 {
                best = best.min(time);
            }
        }
        best
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]
        #[test]
        fn motions_end_at_rest_at_the_goal_within_the_limits_and_no_search_finds_a_faster_one(
            q in -2.0..2.0f64, goal in -2.0..2.0f64, speed in -1.0..1.0f64, gain in -1.0..1.0f64,
            (v, a, j) in (-1.0..1.0f64, -0.5..1.5f64, 0.5..4.0f64), longer in 1.0..3.0f64,
        ) {
            let most = [10f64.powf(v), 10f64.powf(a), 10f64.powf(j)];
            let a0 = gain * most[1];
            let room = most[0] - 0.5 * a0 * a0 / most[2];
            prop_assume!(room > 0.0);
            let state = [q, speed * room, a0];
            let least = duration(&phases(state, goal, most, None));
            for time in [None, Some(longer * least)] {
                let found = phases(state, goal, most, time);
                let mut now = state;
                for (t, jerk) in &found {
                    prop_assert!(*t >= 0.0 && jerk.abs() <= most[2]);
                    for k in 0..=20 {
                        let [_, v, a] = go_on(now, *jerk, t * f64::from(k) / 20.0);
                        prop_assert!(v.abs() <= most[0] * (1.0 + 1e-9) && a.abs() <= most[1] * (1.0 + 1e-9), "{v} {a}");
                    }
                    now = go_on(now, *jerk, *t);
                }
                prop_assert!((now[0] - goal).abs() < 1e-9 && now[1].abs() < 1e-7 && now[2].abs() < 1e-6, "{now:?}");
                let taken = duration(&found);
                prop_assert!(taken >= least * (1.0 - 1e-9) && taken <= time.unwrap_or(least) * (1.0 + 1e-6));
            }
            prop_assert!(by_search(state, goal, most) >= least * (1.0 - 1e-5), "{} {least}", by_search(state, goal, most));
        }
    }

    #[test]
    fn joints_arrive_together_and_one_that_stops_at_the_goal_waits() {
        let limits = Limits::new(&[1.0; 3], &[2.0; 3], &[20.0; 3]).unwrap();
        let (q, v, a) = (row(&[0.0, 0.0, 0.0]), row(&[0.5, -0.3, 0.4]), row(&[1.0, 0.0, 0.0]));
        let stopped = after([0.0, 0.4, 0.0], &stopping(0.4, 0.0, 2.0, 20.0))[0];
        let found = to_rest(&limits, &q, &v, &a, &row(&[1.5, 0.2, stopped]));
        let last = found[found.len() - 1];
        assert_eq!(last.position, row(&[1.5, 0.2, stopped]));
        assert_eq!((last.velocity, last.acceleration), ([0.0; MAX_JOINTS], Some([0.0; MAX_JOINTS])));
        // Shortly before the end, the second joint must still move and the third one must have stopped.
        let before = found.iter().rfind(|node| node.time < 0.999 * last.time).unwrap();
        assert!(before.velocity[1].abs() > 1e-6 && before.velocity[2].abs() < 1e-9);
    }
}

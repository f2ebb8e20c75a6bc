//! Computes a motion in time through given joint waypoints.

use super::blend::keeps;
use super::course::Course;
use super::limits::Limits;
use super::motion::Node;
use super::state_to_state::to_rest;
use super::stop::{CannotStop, can_stop, stop};
use super::trajectory::{Builder, Trajectory};
use crate::model::{JointMap, MAX_JOINTS};
use crate::{Cancel, ProblemError};

/// Options of [`retime`].
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct RetimeOptions {
    /// Indices of waypoints at which the motion stops; it always stops at the last one.
    pub stops: Vec<usize>,
    /// Minimum time (s) between each waypoint and the next one; an empty list sets no minimum.
    pub slowest: Vec<f64>,
    /// Velocity at the first waypoint (rad/s or m/s); zero if `None`.
    pub start_velocity: Option<Vec<f64>>,
    /// Acceleration at the first waypoint (rad/s^2 or m/s^2); zero if `None`.
    pub start_acceleration: Option<Vec<f64>>,
    /// Time of the first waypoint (s).
    pub start_time: f64,
    /// Lower and upper position limits (rad or m) within which a moving start must be able to stop.
    pub position_limits: Option<(Vec<f64>, Vec<f64>)>,
    /// Flag with which another thread ends the computation; `retime` then returns an error.
    pub cancel: Option<Cancel>,
}

/// A motion through waypoints.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Retimed {
    /// The motion, which begins at the start time.
    pub trajectory: Trajectory,
    /// Times (s) at which the motion passes each waypoint. A motion from a moving start first leaves the path, and
    /// joins it at or before the second waypoint.
    pub times: Vec<f64>,
}

/// Returns the fastest motion found along the cubic spline through joint waypoints, within velocity, acceleration and
/// jerk limits. It is at rest at the stops and at the end. A moving start with one further waypoint gives the fastest
/// possible motion to that waypoint, which follows no path. With several further waypoints, the motion leaves the path
/// at first, and joins it before the second waypoint.
///
/// The speed is time-optimal within the velocity and acceleration limits. A moving average then bounds the jerk, which
/// moves joints off the path and its waypoints by at most 1e-4 rad or m. If the deviation would be larger, jerk is
/// bounded along the path instead, and the motion stays on the path.
///
/// ```
/// use gensim2_kpam::{Limits, RetimeOptions, retime};
///
/// let limits = Limits::new(&[1.0, 1.0], &[2.0, 2.0], &[50.0, 50.0])?; // rad/s, rad/s^2, rad/s^3
/// let path = [vec![0.0, 0.0], vec![0.5, 0.2], vec![1.0, 0.0]];
/// let found = retime(&path, &limits, &RetimeOptions::default())?;
/// let end = found.trajectory.sample(found.trajectory.end());
/// assert!((end.position[0] - 1.0).abs() < 1e-9 && found.times.len() == 3);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// Waypoints, stops or start are invalid; the field is `start_velocity` if no motion from the start keeps the limits.
pub fn retime(waypoints: &[Vec<f64>], limits: &Limits, options: &RetimeOptions) -> Result<Retimed, ProblemError> {
    let joints = limits.joints();
    let row = |field: &str, list: &[f64]| {
        if list.len() != joints {
            return Err(ProblemError::new(field, format!("has {} entries, not {joints}", list.len())));
        }
        let mut out = [0.0; MAX_JOINTS];
        out[..joints].copy_from_slice(list);
        Ok(out)
    };
    let finite = |field: &str, list: &[f64]| match list.iter().find(|v| !(-1e6..=1e6).contains(*v)) {
        Some(v) => Err(ProblemError::new(field, format!("{v} is not a finite number within 1e6"))),
        None => row(field, list),
    };
    let mut points = Vec::with_capacity(waypoints.len());
    for (k, w) in waypoints.iter().enumerate() {
        points.push(finite(&format!("waypoints[{k}]"), w)?);
    }
    let Some(first) = points.first().copied() else {
        return Err(ProblemError::new("waypoints", "must contain at least one waypoint"));
    };
    let last = points.len() - 1;
    if let Some(stop) = options.stops.iter().find(|s| **s > last) {
        return Err(ProblemError::new("stops", format!("{stop} is not the index of a waypoint; the last is {last}")));
    }
    if !options.slowest.is_empty() && options.slowest.len() != last {
        let message = format!("has {} entries; there are {last} intervals between waypoints", options.slowest.len());
        return Err(ProblemError::new("slowest", message));
    }
    if let Some(time) = options.slowest.iter().find(|t| !(0.0..=1e6).contains(*t)) {
        return Err(ProblemError::new("slowest", format!("{time} is not a time from 0 to 1e6 s")));
    }
    if !(-1e6..=1e6).contains(&options.start_time) {
        let message = format!("{} is not a time within 1e6 s", options.start_time);
        return Err(ProblemError::new("start_time", message));
    }
    let optional =
        |field: &str, list: &Option<Vec<f64>>| list.as_ref().map_or(Ok([0.0; MAX_JOINTS]), |l| finite(field, l));
    let start = [
        first,
        optional("start_velocity", &options.start_velocity)?,
        optional("start_acceleration", &options.start_acceleration)?,
    ];
    let (lower, upper) = match &options.position_limits {
        Some((lower, upper)) => (row("position_limits[0]", lower)?, row("position_limits[1]", upper)?),
        None => ([f64::NEG_INFINITY; MAX_JOINTS], [f64::INFINITY; MAX_JOINTS]),
    };
    let mut builder = Builder::new(*limits, options.start_time).cancelled_by(options.cancel.clone());
    let mut stops = options.stops.clone();
    stops.push(last);
    stops.sort_unstable();
    stops.dedup();
    stops.retain(|s| *s > 0);
    let course = Course { points: &points, stops: &stops, slowest: &options.slowest };
    let moving = start.iter().skip(1).flatten().any(|v| *v != 0.0);
    if !moving {
        return course.driven_from_rest(builder, first);
    }
    let [position, velocity, acceleration] = &start;
    let check = |e: CannotStop| ProblemError::new(format!("start_velocity[{}]", e.joint), e.reason);
    can_stop(limits, &lower, &upper, position, velocity, acceleration).map_err(check)?;
    builder.admit(position, velocity, acceleration);
    let resting = stop(builder.limits(), position, velocity, acceleration);
    let whole = |mut builder: Builder, nodes: &[Node]| {
        builder.append_nodes(nodes);
        let trajectory = builder.build(&JointMap::each(joints, &start[0][..joints]));
        let times = if last > 0 { vec![trajectory.start(), trajectory.end()] } else { vec![trajectory.start()] };
        Ok(Retimed { trajectory, times })
    };
    match points.as_slice() {
        [_] => return whole(builder, &resting),
        // With a single goal, the motion need not follow a path.
        [_, goal] if options.slowest.is_empty() => {
            let nodes = to_rest(builder.limits(), position, velocity, acceleration, goal);
            if keeps(builder.limits(), [&lower, &upper], &nodes) {
                return whole(builder, &nodes);
            }
        }
        _ => {}
    }
    course.under_way(&builder, &start, [&lower, &upper], &resting)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Checks a motion on a fine time grid: its limits, and that velocities and accelerations match positions.
    fn check(trajectory: &Trajectory, limits: &Limits) -> Result<(), TestCaseError> {
        const STEPS: usize = 4000;
        let h = trajectory.end() / STEPS as f64;
        let joints = limits.joints();
        let mut previous = trajectory.sample(0.0);
        for k in 1..=STEPS {
            let now = trajectory.sample(h * k as f64);
            for j in 0..joints {
                let (most_v, most_a, most_j) = (limits.velocity[j], limits.acceleration[j], limits.jerk[j]);
                prop_assert!(now.velocity[j].abs() <= most_v * (1.0 + 1e-5), "velocity {} {most_v}", now.velocity[j]);
                prop_assert!(now.acceleration[j].abs() <= most_a * (1.0 + 1e-5), "{} {most_a}", now.acceleration[j]);
                let jerk = (now.acceleration[j] - previous.acceleration[j]).abs() / h;
                prop_assert!(jerk <= most_j * (1.0 + 1e-5) + 1e-5 / h, "jerk {jerk} {most_j} at {}", h * k as f64);
                let slope = (now.position[j] - previous.position[j]) / h;
                let between = 0.5 * (now.velocity[j] + previous.velocity[j]);
                prop_assert!((slope - between).abs() <= most_j * h * h + 1e-7, "{slope} {between}");
                let gain = (now.velocity[j] - previous.velocity[j]) / h;
                let between = 0.5 * (now.acceleration[j] + previous.acceleration[j]);
                prop_assert!((gain - between).abs() <= most_j * h + 1e-6, "{gain} {between}");
            }
            previous = now;
        }
        prop_assert!(previous.velocity.iter().chain(&previous.acceleration).all(|v| v.abs() < 1e-9));
        Ok(())
    }

    fn joint_lists(count: std::ops::Range<usize>) -> impl Strategy<Value = Vec<Vec<f64>>> {
        prop::collection::vec(prop::collection::vec(-2.0..2.0f64, 3), count)
    }

    fn limit_lists() -> impl Strategy<Value = (Vec<f64>, Vec<f64>, Vec<f64>)> {
        let exponent = |range: std::ops::Range<f64>| prop::collection::vec(range.prop_map(|e| 10f64.powf(e)), 3);
        (exponent(-1.0..0.7), exponent(0.0..1.3), exponent(1.0..4.0))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]
        #[test]
        fn limits_hold_everywhere(
            waypoints in joint_lists(2..8),
            (velocity, acceleration, jerk) in limit_lists(),
            stop in 0..6usize,
        ) {
            let limits = Limits::new(&velocity, &acceleration, &jerk).unwrap();
            let options = RetimeOptions { stops: vec![stop.min(waypoints.len() - 1)], ..RetimeOptions::default() };
            let out = retime(&waypoints, &limits, &options).unwrap();
            check(&out.trajectory, &limits)?;
            for (k, time) in out.times.iter().enumerate() {
                let sample = out.trajectory.sample(*time);
                let rests = k == 0 || k == waypoints.len() - 1 || options.stops.contains(&k);
                for j in 0..3 {
                    let off = (sample.position[j] - waypoints[k][j]).abs();
                    prop_assert!(off <= if rests { 1e-9 } else { 1.1e-4 }, "waypoint {k} missed by {off}");
                    prop_assert!(!rests || sample.velocity[j].abs() < 1e-9);
                }
            }
        }

        #[test]
        fn starts_under_way_are_taken_up(
            waypoints in joint_lists(2..6),
            (velocity, acceleration, jerk) in limit_lists(),
            speed in prop::collection::vec(-1.0..1.0f64, 3),
            gain in prop::collection::vec(-1.0..1.0f64, 3),
        ) {
            let limits = Limits::new(&velocity, &acceleration, &jerk).unwrap();
            let times = |share: &[f64], most: &[f64]| share.iter().zip(most).map(|(s, m)| s * m).collect::<Vec<f64>>();
            let (lower, upper) = (vec![-2.5; 3], vec![2.5; 3]);
            let options = RetimeOptions {
                start_velocity: Some(times(&speed, &velocity)),
                start_acceleration: Some(times(&gain, &acceleration)),
                position_limits: Some((lower.clone(), upper.clone())),
                ..RetimeOptions::default()
            };
            match retime(&waypoints, &limits, &options) {
                Ok(out) => {
                    check(&out.trajectory, &limits)?;
                    let first = out.trajectory.sample(0.0);
                    for j in 0..3 {
                        prop_assert!((first.position[j] - waypoints[0][j]).abs() < 1e-9);
                        prop_assert!((first.velocity[j] - speed[j] * velocity[j]).abs() < 1e-9);
                        prop_assert!((first.acceleration[j] - gain[j] * acceleration[j]).abs() < 1e-6);
                    }
                    let end = out.trajectory.sample(out.trajectory.end());
                    let last = &waypoints[waypoints.len() - 1];
                    prop_assert!(end.position.iter().zip(last).all(|(a, b)| (a - b).abs() < 1e-9));
                }
                Err(e) => {
                    // A start may be refused only if some joint cannot stop even at constant jerk and acceleration.
                    prop_assert!(e.to_string().contains("start_velocity"), "{e}");
                    let stuck = (0..3).any(|j| {
                        let (v, a) = (speed[j] * velocity[j], gain[j] * acceleration[j]);
                        let next = v + 0.5 * a * a.abs() / jerk[j];
                        let peak = next.abs().max(v.abs());
                        let far =
                            peak * peak / (2.0 * acceleration[j]) + peak * (acceleration[j] + a.abs()) / jerk[j];
                        peak > velocity[j] || waypoints[0][j].abs() + far > 2.5
                    });
                    prop_assert!(stuck, "{e}");
                }
            }
        }

        #[test]
        fn starts_at_the_limit_are_driven(
            waypoints in joint_lists(2..6),
            (velocity, acceleration, jerk) in limit_lists(),
            speed in prop::collection::vec(prop_oneof![-1.0..1.0f64, Just(1.0), Just(-1.0)], 3),
            rounding in prop_oneof![Just(1.0), Just(1.0 + 9e-7), Just(1.0 - 1e-9)],
            single in any::<bool>(),
            share in 0.0..0.9f64,
        ) {
            let limits = Limits::new(&velocity, &acceleration, &jerk).unwrap();
            let mut start: Vec<f64> = speed.iter().zip(&velocity).map(|(s, v)| s * v * rounding).collect();
            if single {
                start = start.iter().map(|v| f64::from(*v as f32)).collect();
            }
            let options = RetimeOptions { start_velocity: Some(start), ..RetimeOptions::default() };
            let out = retime(&waypoints, &limits, &options).map_err(|e| TestCaseError::fail(e.to_string()))?;
            check(&out.trajectory, &limits)?;
            // Start again in a state of the motion itself, with its remaining waypoints.
            let now = share * out.trajectory.end();
            let sample = out.trajectory.sample(now);
            let mut rest = vec![sample.position];
            rest.extend(waypoints.iter().zip(&out.times).filter(|(_, t)| **t > now).map(|(w, _)| w.clone()));
            let options = RetimeOptions {
                start_velocity: Some(sample.velocity),
                start_acceleration: Some(sample.acceleration),
                ..RetimeOptions::default()
            };
            let again = retime(&rest, &limits, &options).map_err(|e| TestCaseError::fail(e.to_string()))?;
            check(&again.trajectory, &limits)?;
        }

        #[test]
        fn no_acceleration_exceeds_its_limit_at_extreme_ratios(
            waypoints in joint_lists(2..6),
            exponents in prop::collection::vec((-3.0..3.0f64, -3.0..4.0f64, -2.0..7.0f64), 3),
            speed in prop::collection::vec(-1.0..1.0f64, 3),
            gain in prop::collection::vec(-1.0..1.0f64, 3),
        ) {
            let list = |pick: fn(&(f64, f64, f64)) -> f64| exponents.iter().map(|e| 10f64.powf(pick(e))).collect::<Vec<f64>>();
            let (v, a, j) = (list(|e| e.0), list(|e| e.1), list(|e| e.2));
            let limits = Limits::new(&v, &a, &j).unwrap();
            let room = |i: usize| v[i] - 0.5 * (gain[i] * a[i]).powi(2) / j[i];
            let start = |i: usize, value: f64| if room(i) > 0.0 { value } else { 0.0 };
            let options = RetimeOptions {
                start_velocity: Some((0..3).map(|i| start(i, speed[i] * room(i))).collect()),
                start_acceleration: Some((0..3).map(|i| start(i, gain[i] * a[i])).collect()),
                ..RetimeOptions::default()
            };
            let Ok(out) = retime(&waypoints, &limits, &options) else { return Ok(()) };
            let end = out.trajectory.end();
            let late = (0..=3000).map(|k| end * f64::from(k) / 3000.0);
            let early = (0..200).map(|k| end * 1e-9_f64.powf(f64::from(k) / 200.0));
            for t in late.chain(early).chain(out.trajectory.times().iter().copied()) {
                let now = out.trajectory.sample(t);
                for i in 0..3 {
                    let (is, most) = (now.acceleration[i].abs(), a[i]);
                    prop_assert!(is <= most * (1.0 + 1e-5), "joint {i} at {t}: {is} exceeds {most}");
                }
            }
        }
    }

    #[test]
    fn a_straight_line_takes_its_known_time() {
        // A motion of 2 m at 1 m/s with 4 m/s^2 and practically unlimited jerk takes 2 + 1 / 4 s.
        let limits = Limits::new(&[1.0], &[4.0], &[1e6]).unwrap();
        let out = retime(&[vec![0.0], vec![2.0]], &limits, &RetimeOptions::default()).unwrap();
        assert!((out.trajectory.end() - 2.25).abs() < 0.01, "{}", out.trajectory.end());
    }

    #[test]
    fn slow_intervals_are_slow_and_tiny_limits_make_few_waypoints() {
        let limits = Limits::new(&[1.0], &[4.0], &[1e4]).unwrap();
        let waypoints: Vec<Vec<f64>> = (0..5).map(|k| vec![0.1 * f64::from(k)]).collect();
        let options = RetimeOptions { slowest: vec![0.0, 1.0, 1.0, 0.0], ..RetimeOptions::default() };
        let out = retime(&waypoints, &limits, &options).unwrap();
        assert!(out.times[2] - out.times[1] > 0.999 && out.times[3] - out.times[2] > 0.999, "{:?}", out.times);
        let slow = Limits::new(&[1e-5], &[4.0], &[1e4]).unwrap();
        let out = retime(&waypoints, &slow, &RetimeOptions::default()).unwrap();
        assert!(out.trajectory.end() > 4e4 && out.trajectory.times().len() < 500);
    }

    #[test]
    fn a_start_on_its_way_is_not_braked() {
        let limits = Limits::new(&[1.0, 1.0], &[4.0, 4.0], &[1e4, 1e4]).unwrap();
        let time = |velocity: Vec<f64>| {
            let options = RetimeOptions { start_velocity: Some(velocity), ..RetimeOptions::default() };
            retime(&[vec![0.0, 0.0], vec![1.0, 0.2]], &limits, &options).unwrap().trajectory.end()
        };
        let rest = time(vec![0.0, 0.0]);
        assert!(time(vec![0.9, 0.18]) < rest - 0.08);
        assert!(time(vec![0.8, -0.3]) < rest);
        assert!(time(vec![-0.8, 0.0]) > rest);
    }

    #[test]
    fn a_motion_is_taken_up_again_on_its_way_through_several_waypoints() {
        for (a, j) in [(10.0, 5000.0), (8.0, 300.0), (5.0, 50.0)] {
            let limits = Limits::new(&[1.5; 2], &[a; 2], &[j; 2]).unwrap();
            let waypoints = vec![vec![0.0, 0.0], vec![0.8, 0.5], vec![1.5, -0.2], vec![2.0, 0.4]];
            let once = retime(&waypoints, &limits, &RetimeOptions::default()).unwrap();
            for share in [0.1, 0.3, 0.5, 0.7] {
                let now = share * once.times[1];
                let state = once.trajectory.sample(now);
                let mut rest = waypoints.clone();
                rest[0] = state.position;
                let options = RetimeOptions {
                    start_velocity: Some(state.velocity),
                    start_acceleration: Some(state.acceleration),
                    start_time: now,
                    ..RetimeOptions::default()
                };
                let found = retime(&rest, &limits, &options).unwrap();
                let left = once.trajectory.end() - now;
                let taken = found.trajectory.end() - now;
                assert!(taken <= 1.06 * left, "{taken} and not {left} from {share}, ({a}, {j})");
                for (time, waypoint) in found.times.iter().zip(&rest) {
                    let at = found.trajectory.sample(*time).position;
                    assert!((0..2).all(|v| (at[v] - waypoint[v]).abs() < 2e-4), "{at:?} {waypoint:?}");
                }
            }
        }
    }
}

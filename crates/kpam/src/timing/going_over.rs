//! Switches to a motion that is already in progress: finds the fastest motion from one state to a state of that motion.

use rsruckig::error::ThrowErrorHandler;
use rsruckig::input_parameter::InputParameter;
use rsruckig::ruckig::Ruckig;

use super::limits::{Limits, TOLERANCE};
use super::motion::{Node, Piece};
use super::stop::{Phase, State, nodes_to};
use super::trajectory::Trajectory;
use crate::model::Row;

/// Fraction by which rounding of sums may exceed a limit.
const ROUNDING: f64 = 1e-12;

/// Times closer than this (s) count as equal, and accelerations below this (rad/s^2 or m/s^2) as rounding errors.
const TOGETHER: f64 = 1e-7;
const ROUNDED: f64 = 1e-6;

/// Returns the nodes of the fastest motion between two states, each given as position, velocity and acceleration;
/// `None` if the limits allow none.
pub(crate) fn to_state(limits: &Limits, from: &[Row; 3], to: &[Row; 3]) -> Option<Vec<Node>> {
    let joints = limits.joints();
    let limits = &limits.admitting(&to[0], &to[1], &to[2]);
    let mut input = InputParameter::<0>::new(Some(joints));
    for v in 0..joints {
        (input.current_position[v], input.target_position[v]) = (from[0][v], to[0][v]);
        (input.current_velocity[v], input.target_velocity[v]) = (from[1][v], to[1][v]);
        (input.current_acceleration[v], input.target_acceleration[v]) = (from[2][v], to[2][v]);
        input.max_velocity[v] = limits.velocity[v] * (1.0 + ROUNDING);
        input.max_acceleration[v] = limits.acceleration[v] * (1.0 + ROUNDING);
        input.max_jerk[v] = limits.jerk[v];
    }
    let mut found = rsruckig::trajectory::Trajectory::<0>::new(Some(joints));
    Ruckig::<0, ThrowErrorHandler>::new(Some(joints), 1.0).calculate(&input, &mut found).ok()?;
    let profiles = found.get_profiles().first()?;
    let phases: Vec<Vec<Phase>> = profiles
        .iter()
        .map(|profile| {
            let brake = profile.brake.t.into_iter().zip(profile.brake.j);
            brake.chain(profile.t.into_iter().zip(profile.j)).filter(|(time, _)| *time > 0.0).collect()
        })
        .collect();
    let states: Vec<State> = (0..joints).map(|v| [from[0][v], from[1][v], from[2][v]]).collect();
    let mut out = nodes_to(limits, &states, &phases, false);
    let end = out.pop()?;
    // All joints end at the same time; last nodes that differ only by rounding are merged.
    while out.len() > 1 && end.time - out[out.len() - 1].time < TOGETHER {
        out.pop();
    }
    let near = |a: &Row, b: &Row| (0..joints).all(|v| (a[v] - b[v]).abs() <= TOLERANCE);
    let reached = near(&end.position, &to[0]) && near(&end.velocity, &to[1]) && near(&end.acceleration?, &to[2]);
    out.push(Node { time: end.time, position: to[0], velocity: to[1], acceleration: Some(to[2]) });
    let kept = out.windows(2).all(|pair| {
        let [Some(a), Some(b)] = [pair[0].acceleration, pair[1].acceleration] else { return false };
        let most = |v: usize| limits.jerk[v] * (pair[1].time - pair[0].time) * (1.0 + TOLERANCE) + ROUNDED;
        (0..joints).all(|v| (b[v] - a[v]).abs() <= most(v))
    });
    (reached && kept).then_some(out)
}

/// Returns a motion along `lead`, which begins at time 0 and ends in the state that `motion` has at `time`, and then
/// along the rest of `motion`. It has the start time of `motion`.
pub(crate) fn gone_over(limits: &Limits, lead: &[Node], motion: &Trajectory, time: f64) -> Trajectory {
    let first = Piece::plain(motion.start(), limits.joints(), lead);
    let late = first.end() - time;
    let mut times = vec![motion.start(), first.end()];
    times.extend(motion.times().iter().filter(|t| **t > time).map(|t| t + late));
    let mut pieces = vec![first];
    pieces.extend(motion.from(time).into_iter().map(|piece| piece.delayed(late)));
    motion.with(pieces, times, *limits)
}

#[cfg(test)]
mod tests {
    use super::super::testing::{row, wavy};
    use super::super::to_rest;
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]
        #[test]
        fn motions_to_rest_are_as_fast_as_ruckigs(
            q in prop::collection::vec(-2.0..2.0f64, 3), goal in prop::collection::vec(-2.0..2.0f64, 3),
            speed in prop::collection::vec(-1.0..1.0f64, 3), gain in prop::collection::vec(-1.0..1.0f64, 3),
            (a, j) in prop_oneof![Just((10.0, 5000.0)), Just((10.0, 300.0)), Just((5.0, 50.0)), Just((2.0, 10.0))],
        ) {
            let limits = Limits::new(&[1.5; 3], &[a; 3], &[j; 3]).unwrap();
            let gain: Vec<f64> = gain.iter().map(|g| g * a.min(0.9 * (1.5 * j).sqrt())).collect();
            let velocity: Vec<f64> = (0..3).map(|v| speed[v] * (1.5 - 0.5 * gain[v] * gain[v] / j)).collect();
            let [q, velocity, gain, goal] = [q, velocity, gain, goal].map(|list| row(&list));
            let own = to_rest(&limits, &q, &velocity, &gain, &goal);
            let still = row(&[0.0; 3]);
            let ruckig = to_state(&limits, &[q, velocity, gain], &[goal, still, still]).unwrap();
            let (own, ruckig) = (own[own.len() - 1].time, ruckig[ruckig.len() - 1].time);
            prop_assert!((own - ruckig).abs() < 1e-6 * ruckig, "{own} {ruckig}");
        }

        #[test]
        fn a_motion_that_is_gone_over_to_is_met_in_its_state_within_the_limits(
            q in prop::collection::vec(-1.0..2.0f64, 2), speed in prop::collection::vec(-1.0..1.0f64, 2),
            share in 0.05..1.0f64, (a, j) in prop_oneof![Just((10.0, 5000.0)), Just((10.0, 300.0)), Just((5.0, 50.0))],
        ) {
            let limits = Limits::new(&[1.5; 2], &[a; 2], &[j; 2]).unwrap();
            let along = wavy(&limits);
            let time = share * along.end();
            let from = [row(&q), row(&[1.5 * speed[0], 1.5 * speed[1]]), row(&[0.0; 2])];
            let lead = to_state(&limits, &from, &along.moving_with_rates(time)).unwrap();
            let motion = gone_over(&limits, &lead, &along, time);
            let steps = 4000;
            let h = motion.end() / f64::from(steps);
            let mut before = motion.moving_with_rates(0.0);
            for (k, row) in before.iter().enumerate() {
                prop_assert!((0..2).all(|v| (row[v] - from[k][v]).abs() < 1e-9));
            }
            for k in 1..=steps {
                let now = motion.moving_with_rates(h * f64::from(k));
                for v in 0..2 {
                    prop_assert!(now[1][v].abs() <= 1.5 * (1.0 + 1e-6), "{now:?}");
                    prop_assert!(now[2][v].abs() <= a * (1.0 + 1e-6), "{now:?}");
                    prop_assert!((now[2][v] - before[2][v]).abs() <= j * h * (1.0 + 1e-5) + 1e-5, "{now:?} {before:?}");
                    let way = now[0][v] - before[0][v];
                    prop_assert!((way - 0.5 * h * (now[1][v] + before[1][v])).abs() <= j * h * h * h + 1e-9);
                }
                before = now;
            }
            let end = along.moving(along.end());
            prop_assert!((0..2).all(|v| (before[0][v] - end[v]).abs() < 1e-9));
        }
    }
}

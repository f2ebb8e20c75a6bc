//! Finds the fastest way to stop a motion along its path.

use super::by_length::{LONGEST, Path, STILL, norm};
use super::limits::TOLERANCE;
use super::motion::{Node, Piece, peaks};
use super::smooth::along;
use super::stop::{State, go_on, stop, stopping};
use super::trajectory::Trajectory;
use crate::ProblemError;
use crate::model::Row;

/// Normal and maximum number of intervals between the nodes of a time-optimal stop.
const INTERVALS: [f64; 2] = [16.0, 48.0];
const MOST: usize = 1500;
/// Fractions of the acceleration and jerk limits along the path. They are tried in turn until all joint limits are
/// kept.
const SHARES: [f64; 9] = [1.0, 0.98, 0.95, 0.9, 0.8, 0.65, 0.5, 0.3, 0.15];
const SHARP: [f64; 3] = [1.0, 0.6, 0.3];
/// Number of bisections for the start of the last ramp, and fraction of an interval by which it may begin early.
const HALVINGS: usize = 40;
const SOON: f64 = 0.3;
/// Minimum fraction of an interval for a change of acceleration; a shorter change is spread over the whole interval.
const EVEN: f64 = 0.3;
/// Maximum distance in time between a node and the maximum of the speed, as a fraction of an interval.
const PEAK: f64 = 0.004;
/// Rounding error of a quintic's jerk times the cube of its duration (rad or m).
const ROUNDING: f64 = 3e-13;
/// If no stop along the path is found, the motion may run to its end instead. Its remaining time may be at most this
/// multiple of the time in which the joints could stop independently.
const PATIENCE: f64 = 20.0;

impl Trajectory {
    /// Returns a motion that starts at time `t` (s) in the state of this motion and comes to rest along the same path
    /// as soon as the limits allow. If this motion comes to rest earlier by itself, its remaining part is returned.
    ///
    /// The stop decelerates as hard as the velocity, acceleration and jerk limits allow, which may need more torque
    /// than this motion. If no stop along the path keeps the limits, for example right before the motion reverses,
    /// every joint stops independently as soon as it can. The robot may then leave the path.
    ///
    /// # Errors
    /// The time is not finite.
    pub fn brake(&self, t: f64) -> Result<Self, ProblemError> {
        let begin = self.nearest(t)?;
        let joints = self.limits().joints();
        let [position, velocity, acceleration] = self.moving_with_rates(begin);
        let speed = norm(self, &velocity);
        let resting = |time: f64| Piece::plain(time, joints, &[node_of(self.moving_with_rates(time))]);
        if begin >= self.end() || (speed < STILL && norm(self, &acceleration) < STILL) {
            return Ok(self.with(vec![resting(begin)], vec![begin], *self.limits()));
        }
        let path = Path::new(self, begin);
        let mut best: Option<Vec<Node>> = None;
        let time = |nodes: &[Node]| nodes[nodes.len() - 1].time;
        // At rest, or if the path is sampled too coarsely, the path has no direction.
        let tries = if speed < STILL || path.places.len() < 2 { &[][..] } else { &INTERVALS[..] };
        for intervals in tries {
            let along: f64 = (0..joints).map(|v| velocity[v] * acceleration[v]).sum::<f64>() / speed;
            let shares = SHARES.iter().flat_map(|share| SHARP.map(|sharp| [*share, sharp * share]));
            let stop = |shares: [f64; 2]| self.stopped(&path, [0.0, speed, along], shares, *intervals);
            let Some(nodes) = shares.into_iter().find_map(stop) else { continue };
            if best.as_ref().is_none_or(|best| time(&nodes) < time(best)) {
                best = Some(nodes);
            }
        }
        let own = stop(self.limits(), &position, &velocity, &acceleration);
        let rest = if path.rests { path.end() } else { self.end() };
        let patience = if path.rests { PATIENCE * time(&own) + LONGEST } else { time(&own) };
        let pieces = match best {
            // If the motion itself comes to rest as early as the stop, the motion is kept.
            Some(nodes) if time(&nodes) < rest - begin => vec![Piece::smooth(begin, joints, &nodes, &[])],
            None if patience < rest - begin => vec![Piece::plain(begin, joints, &own)],
            _ => {
                let mut pieces = self.from(begin);
                if rest < self.end() {
                    pieces.retain(|piece| piece.counts < rest);
                    pieces.push(resting(rest));
                }
                pieces
            }
        };
        let end = pieces.last().map_or(begin, Piece::end);
        let times = if end > begin { vec![begin, end] } else { vec![begin] };
        Ok(self.with(pieces, times, *self.limits()))
    }

    /// Returns the nodes of a stop along a path from the state `start`; `shares` are the usable fractions of the
    /// acceleration and jerk limits. `None` if a joint exceeds a limit or the path ends before the stop.
    fn stopped(&self, path: &Path<'_>, start: State, shares: [f64; 2], intervals: f64) -> Option<Vec<Node>> {
        let limits = self.limits();
        let tangent = path.at([0.0, 1.0, 0.0])[1];
        let most = along(limits, &tangent);
        let least: f64 =
            stopping(start[1], start[2], most.acceleration.max(-start[2]), most.jerk).iter().map(|p| p.0).sum();
        let step = least / intervals;
        let least_jerk = limits.jerk[..limits.joints()].iter().copied().fold(f64::INFINITY, f64::min);
        let (mut time, mut state) = (0.0, start);
        let mut nodes = vec![Node { time, ..node_of(self.moving_with_rates(path.places[0].0)) }];
        let mut push = |time: f64, state: State| {
            let rows = path.at(state);
            let node = Node { time, ..node_of(rows) };
            let rounding = ROUNDING / (least_jerk * (node.time - nodes[nodes.len() - 1].time).powi(3));
            let [fast, hard, sharp] = peaks(limits, &nodes[nodes.len() - 1], &node);
            let finite = rows.iter().flatten().all(|v| v.is_finite());
            let kept = finite && fast.max(hard) <= 1.0 + TOLERANCE && sharp <= 1.0 + TOLERANCE + rounding;
            nodes.push(node);
            kept.then_some(())
        };
        for _ in 0..MOST {
            let [length, speed, gain] = state;
            if length >= path.length() {
                return None;
            }
            let [_, tangent, bend] = path.at([length, 1.0, 0.0]);
            let jerk = shares[1] * along(limits, &tangent).jerk;
            // The path's curvature uses up a part of each joint's acceleration limit; the rest bounds the deceleration.
            let mut hardest = f64::NEG_INFINITY;
            for v in 0..limits.joints() {
                let (limit, taken) = (shares[0] * limits.acceleration[v], bend[v] * speed * speed);
                let room = if tangent[v] > 0.0 { limit + taken } else { limit - taken };
                hardest = hardest.max(-(room.max(0.0)) / tangent[v].abs());
            }
            let wanted = hardest.max(-(2.0 * jerk * speed).sqrt());
            // A large change of acceleration is made as fast as possible, a small one over the whole interval.
            let change = wanted - gain;
            let soon = (change.abs() / jerk).min(step);
            let whole = if soon > EVEN * step { soon } else { step };
            let rate = (change / whole).clamp(-jerk, jerk);
            // Place a node at the maximum of the speed, because the speed limit is checked at nodes only.
            let peak = -gain / rate;
            let whole = if peak > PEAK * step && peak < whole + PEAK * step { peak } else { whole };
            let ends = |t: f64| {
                let [_, speed, gain] = go_on(state, rate, t);
                gain < 0.0 && speed <= 0.5 * gain * gain / jerk
            };
            let mut late = whole;
            if ends(whole) {
                let mut low = 0.0;
                for _ in 0..HALVINGS {
                    let middle = 0.5 * (low + late);
                    if ends(middle) { late = middle } else { low = middle }
                }
            }
            // The last ramp has constant jerk and ends at rest.
            if gain < 0.0 && ends(late) && late < SOON * step {
                let (last, jerk) = (-2.0 * speed / gain, 0.5 * gain * gain / speed);
                let parts = (last / step).ceil().max(1.0);
                for k in 1..=parts as usize {
                    let late = last * k as f64 / parts;
                    let mut at = go_on(state, jerk, late);
                    if k as f64 == parts {
                        (at[1], at[2]) = (0.0, 0.0);
                    }
                    if at[0] >= path.length() {
                        return None;
                    }
                    push(time + late, at)?;
                }
                return Some(nodes);
            }
            (time, state) = (time + late, go_on(state, rate, late));
            push(time, state)?;
        }
        None
    }
}

/// Returns the node of a state at time 0.
fn node_of([position, velocity, acceleration]: [Row; 3]) -> Node {
    Node { time: 0.0, position, velocity, acceleration: Some(acceleration) }
}

#[cfg(test)]
mod tests {
    use super::super::limits::Limits;
    use super::super::{RetimeOptions, retime, testing};
    use super::*;

    #[test]
    fn a_stop_begins_in_the_state_of_the_motion_stays_on_its_path_and_keeps_the_limits() {
        for (a, j) in [(10.0, 5000.0), (5.0, 50.0)] {
            let limits = Limits::new(&[1.5; 2], &[a; 2], &[j; 2]).unwrap();
            let whole = testing::wavy(&limits);
            let path: Vec<_> = (0..=20_000).map(|k| whole.moving(whole.end() * f64::from(k) / 2e4)).collect();
            for k in 0..40 {
                let t = whole.end() * f64::from(k) / 40.0;
                let stop = whole.brake(t).unwrap();
                assert!(stop.end() <= whole.end() + 1e-12);
                let (before, after) = (whole.moving_with_rates(t), stop.moving_with_rates(t));
                for (was, is) in before.iter().zip(&after) {
                    assert!((0..2).all(|v| (was[v] - is[v]).abs() < 1e-9), "{was:?} {is:?}");
                }
                let steps = 800;
                let h = (stop.end() - t) / f64::from(steps);
                let mut last = stop.sample(t);
                for i in 1..=steps {
                    let now = stop.sample(t + h * f64::from(i));
                    for v in 0..2 {
                        assert!(now.velocity[v].abs() <= 1.5 * (1.0 + 1e-6));
                        assert!(now.acceleration[v].abs() <= a * (1.0 + 1e-6));
                        assert!((now.acceleration[v] - last.acceleration[v]).abs() <= j * h * (1.0 + 1e-5) + 1e-6);
                    }
                    if i % 40 == 0 {
                        let off = |x: &[f64; crate::model::MAX_JOINTS]| {
                            (x[0] - now.position[0]).hypot(x[1] - now.position[1])
                        };
                        let off = path.iter().map(off).fold(f64::INFINITY, f64::min);
                        assert!(off < 2e-4, "{off}");
                    }
                    last = now;
                }
                assert!(last.velocity.iter().chain(&last.acceleration).all(|v| v.abs() < 1e-8), "{last:?}");
                // In measurements, a stop along a curved path took up to five times as long as independent stops of the
                // joints.
                let [position, v, acceleration] = before;
                let own = shortest(&limits, &position, &v, &acceleration);
                assert!(
                    stop.end() - t <= (PATIENCE * own + 0.02).min(whole.end() - t + 1e-9),
                    "{} {own}",
                    stop.end() - t
                );
            }
        }
    }

    /// Returns the time (s) in which all joints can come to rest independently of each other.
    fn shortest(limits: &Limits, position: &Row, velocity: &Row, acceleration: &Row) -> f64 {
        crate::timing::stop(limits, position, velocity, acceleration).last().unwrap().time
    }

    #[test]
    fn on_a_straight_path_no_stop_is_shorter() {
        for (a, j) in [(10.0, 5000.0), (10.0, 300.0), (5.0, 50.0), (2.0, 10.0), (1.0, 2.0)] {
            let limits = Limits::new(&[1.5; 2], &[a; 2], &[j; 2]).unwrap();
            let line =
                retime(&[vec![0.0, 0.0], vec![3.0, -1.0]], &limits, &RetimeOptions::default()).unwrap().trajectory;
            for k in 1..40 {
                let t = line.end() * f64::from(k) / 40.0;
                let [position, velocity, acceleration] = line.moving_with_rates(t);
                let own = shortest(&limits, &position, &velocity, &acceleration);
                let stop = line.brake(t).unwrap().end() - t;
                assert!(stop <= 1.05 * own + 2e-3, "{stop} and not {own} at {t} of {}, ({a}, {j})", line.end());
            }
        }
    }

    /// Checks that the stop from time `t` on starts in the motion's state, keeps the motion's limits, ends at rest, and
    /// takes at most `most` times as long as independent stops of the joints.
    fn stops(motion: &Trajectory, t: f64, most: f64) {
        let limits = motion.limits();
        let stop = motion.brake(t).unwrap();
        let [position, velocity, acceleration] = motion.moving_with_rates(t);
        let own = shortest(limits, &position, &velocity, &acceleration);
        let time = stop.end() - t;
        assert!(time <= most * own + LONGEST, "{time} and not {own} at {t} of {}", motion.end());
        let (steps, h) = (1000, time / 1e3);
        let mut last = [position, velocity, acceleration];
        for i in 0..=steps {
            let now = stop.moving_with_rates(t + h * f64::from(i));
            for v in 0..limits.joints() {
                assert!(now[1][v].abs() <= limits.velocity[v] * (1.0 + 1e-6), "{now:?} at {t}");
                assert!(now[2][v].abs() <= limits.acceleration[v] * (1.0 + 1e-6), "{now:?} at {t}");
                let jerk = limits.jerk[v] * h * if i == 0 { 0.0 } else { 1.0 + 1e-5 };
                assert!((now[2][v] - last[2][v]).abs() <= jerk + 1e-5, "{now:?} {last:?} at {t}");
            }
            last = now;
        }
        assert!(last[1].iter().chain(&last[2]).all(|v| v.abs() < 1e-6), "{last:?} at {t}");
    }

    #[test]
    fn motions_whose_pieces_overlap_are_braked_on() {
        let limits = Limits::new(&[1.5; 2], &[10.0; 2], &[300.0; 2]).unwrap();
        let whole = testing::wavy(&limits);
        let t = 0.4 * whole.end();
        let next = testing::going_on(&whole, t, &[0.0, 1.0]);
        let spliced = whole.splice(&next, t).unwrap();
        for k in 1..30 {
            let begin = spliced.end() * f64::from(k) / 30.0;
            let path = Path::new(&spliced, begin);
            let ascending = |pair: &[(f64, f64)]| pair[0].0 < pair[1].0 && pair[0].1 <= pair[1].1;
            assert!(path.places.windows(2).all(ascending), "{:?}", path.places);
            stops(&spliced, begin, PATIENCE);
        }
    }

    #[test]
    fn late_motions_are_braked_at_their_end() {
        let limits = Limits::new(&[1.5; 2], &[10.0; 2], &[5000.0; 2]).unwrap();
        let mut moving = 0;
        for start_time in (0..50).map(|k| 2e3 + 37.3 * f64::from(k)).chain([1e5]) {
            let start_velocity = Some(vec![0.3, -0.2]);
            let options = RetimeOptions { start_time, start_velocity, ..RetimeOptions::default() };
            let late = retime(&[vec![0.0, 0.0], vec![0.8, 0.5]], &limits, &options).unwrap().trajectory;
            let [_, velocity, acceleration] = late.moving_with_rates(late.end());
            moving += usize::from(norm(&late, &velocity).max(norm(&late, &acceleration)) > STILL);
            for after in [0.0, 1.0] {
                let stop = late.brake(late.end() + after).unwrap();
                assert_eq!((stop.start(), stop.end()), (late.end(), late.end()));
            }
            for k in 1..20 {
                let stop = late.brake(late.end() - 10.0_f64.powi(-k)).unwrap();
                assert!(stop.end() <= late.end() + 1e-9);
                assert!(stop.moving_with_rates(stop.end())[1].iter().all(|v| v.abs() < 1e-6));
            }
        }
        // At least one tested motion must not be exactly at rest at its end because of rounding.
        assert!(moving > 0);
    }

    #[test]
    fn motions_that_turn_back_are_braked_before_and_after() {
        for (a, j) in [(10.0, 5000.0), (10.0, 300.0), (5.0, 50.0)] {
            for joints in [1, 2] {
                let limits = Limits::new(&vec![1.5; joints], &vec![a; joints], &vec![j; joints]).unwrap();
                let options = RetimeOptions { start_velocity: Some(vec![-0.6; joints]), ..RetimeOptions::default() };
                let waypoints = [vec![0.0; joints], vec![2.0; joints]];
                let away = retime(&waypoints, &limits, &options).unwrap().trajectory;
                for k in 0..50 {
                    stops(&away, away.end() * f64::from(k) / 50.0, 1.5);
                }
            }
        }
    }

    #[test]
    fn a_motion_that_rests_on_its_way_is_braked_until_there() {
        for j in [5000.0, 300.0] {
            let limits = Limits::new(&[1.5; 2], &[10.0; 2], &[j; 2]).unwrap();
            let options = RetimeOptions { stops: vec![1], ..RetimeOptions::default() };
            let waypoints = [vec![0.0, 0.0], vec![0.8, 0.5], vec![1.5, -0.2]];
            let found = retime(&waypoints, &limits, &options).unwrap();
            for k in 1..200 {
                let begin = found.times[1] * f64::from(k) / 200.0;
                stops(&found.trajectory, begin, PATIENCE);
                assert!(found.trajectory.brake(begin).unwrap().end() <= found.times[1] + 1e-6);
            }
        }
    }

    #[test]
    fn a_motion_that_only_begins_to_move_is_braked() {
        let limits = Limits::new(&[1.5; 2], &[10.0; 2], &[300.0; 2]).unwrap();
        let options = RetimeOptions {
            start_velocity: Some(vec![0.0; 2]),
            start_acceleration: Some(vec![4.0, -2.0]),
            ..RetimeOptions::default()
        };
        let begun = retime(&[vec![0.0, 0.0], vec![2.0, 1.0]], &limits, &options).unwrap().trajectory;
        stops(&begun, 0.0, 1.0);
        let speed = norm(&begun, &begun.moving_with_rates(1e-10)[1]);
        assert!(speed < STILL);
        stops(&begun, 1e-10, 1.0);
    }

    #[test]
    fn a_motion_that_takes_ages_is_braked_at_once() {
        let limits = Limits::new(&[1.5; 2], &[10.0; 2], &[300.0; 2]).unwrap();
        let row = |x: f64| std::array::from_fn(|v| if v < 2 { x } else { 0.0 });
        let node = |time: f64| Node { time, position: row(time), velocity: row(1.0), acceleration: Some(row(0.0)) };
        let short = testing::wavy(&limits);
        for duration in [1e3, 1e9, 1e15] {
            let piece = Piece::plain(0.0, 2, &[node(0.0), node(duration)]);
            let long = short.with(vec![piece], vec![0.0, duration], limits);
            stops(&long, 0.5, 1.05);
            // A stop that is shorter than the interval between the path's sampled times must end, too.
            let stop = long.brake(0.9 * duration).unwrap();
            assert!(stop.end() <= 0.9 * duration + 1.0);
        }
    }
}

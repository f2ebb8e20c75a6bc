//! Interface of motions to control loops: samples without allocation, the fastest stop along it, going over to another.

use super::limits::{Limits, TOLERANCE};
use super::motion::{Node, Piece, peaks};
use super::trajectory::Trajectory;
use crate::ProblemError;

/// Intervals between nodes of a stop: many follow the motion's jerk closely, few average what it has of that.
const INTERVALS: [usize; 3] = [8, 16, 48];
/// Shares of a stop in which its deceleration grows, and again falls: the shorter, the faster where jerk allows.
const EDGES: [f64; 3] = [0.05, 0.2, 0.5];
/// Durations tried, bisections of the first that stands, and the least one (s).
const TRIES: u32 = 20;
const HALVINGS: usize = 12;
const SHORTEST: f64 = 1e-3;

/// Clock of a motion that is slowed to a stop: its reading, rate and derivative of the rate.
struct Slowing {
    begin: f64,
    duration: f64,
    edge: f64,
}

impl Slowing {
    /// The rate falls from 1 to 0; its derivative is a trapezoid, so that nothing jumps.
    fn at(&self, t: f64) -> [f64; 3] {
        let (whole, edge) = (self.duration, self.edge * self.duration);
        let most = 1.0 / (whole - edge);
        let t = t.clamp(0.0, whole);
        // Integrals of the trapezoid: from the start where it grows, from the end where it falls.
        let grown = |t: f64| [most * t / edge, 0.5 * most * t * t / edge, most * t * t * t / (6.0 * edge)];
        if t <= edge {
            let [gain, lost, gone] = grown(t);
            [self.begin + t - gone, 1.0 - lost, -gain]
        } else if t <= whole - edge {
            let [_, lost, gone] = grown(edge);
            let over = t - edge;
            [self.begin + t - (gone + over * lost + 0.5 * most * over * over), 1.0 - lost - most * over, -most]
        } else {
            // The whole takes half its duration of the clock.
            let [gain, left, behind] = grown(whole - t);
            [self.begin + 0.5 * whole - behind, left, -gain]
        }
    }
}

impl Trajectory {
    /// Position, velocity and acceleration of all joints at time `t` (s) into slices of [`Trajectory::joints`] numbers,
    /// without allocation: for control loops. As [`Trajectory::sample`] otherwise.
    ///
    /// # Errors
    /// A slice of another length.
    pub fn sample_into(
        &self,
        t: f64,
        position: &mut [f64],
        velocity: &mut [f64],
        acceleration: &mut [f64],
    ) -> Result<(), ProblemError> {
        let n = self.joints();
        for (field, length) in
            [("position", position.len()), ("velocity", velocity.len()), ("acceleration", acceleration.len())]
        {
            if length != n {
                return Err(ProblemError::new(field, format!("has room for {length} numbers; there are {n} joints")));
            }
        }
        self.map().fill(&self.moving_with_rates(t), position, velocity, acceleration);
        Ok(())
    }

    /// The motion that comes to rest as soon as the limits allow from the state at time `t` (s) on, along the same path:
    /// its clock is slowed to a halt. It begins at `t`; where the motion ends before it could be slowed, it is the rest
    /// of the motion. Fastest among stops whose deceleration of the clock is a trapezoid. The limits are those of velocity,
    /// acceleration and jerk: a stop may ask for more torque than the motion did.
    ///
    /// # Errors
    /// A time that is not finite.
    pub fn brake(&self, t: f64) -> Result<Self, ProblemError> {
        let begin = self.nearest(t)?;
        let left = self.end() - begin;
        let mut best: Option<(f64, Vec<Node>)> = None;
        for (edge, count) in EDGES.iter().flat_map(|edge| INTERVALS.map(|count| (*edge, count))) {
            let stop = |duration: f64| {
                let nodes = self.slowed(&Slowing { begin, duration, edge }, count);
                self.within(&nodes).then_some(nodes)
            };
            // What is longer may exceed a limit that is kept before and after: the first that stands, and down from it.
            let most = best.as_ref().map_or(left, |(found, _)| *found);
            let mut durations = (0..TRIES).map(|k| SHORTEST * (most / SHORTEST).powf(f64::from(k) / f64::from(TRIES)));
            let mut low = SHORTEST;
            let found = durations.find_map(|duration| {
                let nodes = stop(duration);
                if nodes.is_none() {
                    low = duration;
                }
                nodes.map(|nodes| (duration, nodes))
            });
            let Some((mut high, mut nodes)) = found else { continue };
            for _ in 0..HALVINGS {
                let middle = 0.5 * (low + high);
                match stop(middle) {
                    Some(shorter) => (high, nodes) = (middle, shorter),
                    None => low = middle,
                }
            }
            best = Some((high, nodes));
        }
        let pieces = match best {
            // What would end no sooner is the rest of the motion.
            Some((duration, nodes)) if duration < left => {
                vec![Piece::smooth(begin, self.limits().joints(), &nodes, &[])]
            }
            _ => self.from(begin),
        };
        let end = pieces.last().map_or(begin, Piece::end);
        let times = if end > begin { vec![begin, end] } else { vec![begin] };
        Ok(self.with(pieces, times, *self.limits()))
    }

    /// The time (s) within the motion that is nearest to a finite one.
    fn nearest(&self, t: f64) -> Result<f64, ProblemError> {
        if !t.is_finite() {
            return Err(ProblemError::new("t", format!("{t} is not finite")));
        }
        Ok(t.clamp(self.start(), self.end()))
    }

    /// States of the motion on a slowing clock.
    fn slowed(&self, slowing: &Slowing, count: usize) -> Vec<Node> {
        let n = self.limits().joints();
        (0..=count)
            .map(|k| {
                let share = k as f64 / count as f64;
                // Nodes at the corners of the trapezoid, a quarter of them on each edge.
                let edge = slowing.edge;
                let at = match share {
                    s if s <= 0.25 => 4.0 * s * edge,
                    s if s >= 0.75 => 1.0 - 4.0 * (1.0 - s) * edge,
                    s => edge + 2.0 * (s - 0.25) * (1.0 - 2.0 * edge),
                };
                let time = at * slowing.duration;
                let [clock, rate, gain] = slowing.at(time);
                let [position, mut velocity, mut acceleration] = self.moving_with_rates(clock);
                for v in 0..n {
                    acceleration[v] = acceleration[v] * rate * rate + velocity[v] * gain;
                    velocity[v] *= rate;
                }
                Node { time, position, velocity, acceleration: Some(acceleration) }
            })
            .collect::<Vec<Node>>()
    }

    /// Whether quintics through nodes keep the limits.
    fn within(&self, nodes: &[Node]) -> bool {
        let apart = |pair: &[Node]| pair[1].time - pair[0].time > 1e-9;
        nodes
            .windows(2)
            .filter(|pair| apart(pair))
            .all(|pair| peaks(self.limits(), &pair[0], &pair[1]).into_iter().all(|share| share <= 1.0 + TOLERANCE))
    }

    /// This motion from time `t` (s) on: a stream that is spliced again and again forgets what lies behind it by this.
    ///
    /// # Errors
    /// A time that is not finite.
    pub fn since(&self, t: f64) -> Result<Self, ProblemError> {
        let t = self.nearest(t)?;
        let mut times = vec![t];
        times.extend(self.times().iter().filter(|time| **time > t));
        Ok(self.with(self.from(t), times, *self.limits()))
    }

    /// This motion until time `t` (s), and from there on `next`, which goes on from the state at `t`.
    ///
    /// # Errors
    /// `next` moves other joints, begins later than `t`, or differs there in position, velocity or acceleration by more
    /// than 1e-6 (rad, m, s). Joints that neither moves have to stand where they do, too.
    pub fn splice(&self, next: &Self, t: f64) -> Result<Self, ProblemError> {
        if next.joints() != self.joints() || next.map().driven() != self.map().driven() {
            return Err(ProblemError::new("next", "moves other joints"));
        }
        let stands = |joint: usize| self.map().driven().iter().all(|driven| driven.joint != joint);
        for joint in (0..self.joints()).filter(|joint| stands(*joint)) {
            let (was, is) = (self.map().rest()[joint], next.map().rest()[joint]);
            if (was - is).abs() > TOLERANCE {
                let message = format!("its joint {joint}, which does not move, stands at {is:.6} and not at {was:.6}");
                return Err(ProblemError::new("next", message));
            }
        }
        if !(t >= self.start() && t >= next.start() - TOLERANCE && t <= next.end()) {
            let message = format!("{t} lies outside the motions, [{:.4}, {:.4}]", next.start(), next.end());
            return Err(ProblemError::new("t", message));
        }
        let (before, after) = (self.moving_with_rates(t), next.moving_with_rates(t));
        for (name, (was, is)) in ["position", "velocity", "acceleration"].iter().zip(before.iter().zip(&after)) {
            for v in 0..self.limits().joints() {
                let apart = (was[v] - is[v]).abs();
                if apart.is_nan() || apart > TOLERANCE {
                    let joint = self.map().indices()[v];
                    let message = format!("its {name} of joint {joint} at {t:.6} s is off by {apart:.3e}");
                    return Err(ProblemError::new("next", message));
                }
            }
        }
        let mut pieces: Vec<Piece> = self.pieces().iter().filter(|p| p.counts < t).cloned().collect();
        pieces.extend(next.from(t));
        let mut times: Vec<f64> = self.times().iter().copied().filter(|time| *time < t).collect();
        times.push(t);
        times.extend(next.times().iter().filter(|time| **time > t));
        Ok(self.with(pieces, times, wider(self.limits(), next.limits())))
    }
}

/// The limits that are the wider of two.
fn wider(a: &Limits, b: &Limits) -> Limits {
    let mut out = *a;
    out.envelope = a.envelope.zip(b.envelope).map(|(a, b)| a.wider(&b));
    for v in 0..a.joints() {
        out.velocity[v] = out.velocity[v].max(b.velocity[v]);
        out.acceleration[v] = out.acceleration[v].max(b.acceleration[v]);
        out.jerk[v] = out.jerk[v].max(b.jerk[v]);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::super::{RetimeOptions, retime};
    use super::*;

    fn motion(limits: &Limits) -> Trajectory {
        let waypoints: Vec<Vec<f64>> = vec![vec![0.0, 0.0], vec![0.8, 0.5], vec![1.5, -0.2], vec![2.0, 0.4]];
        retime(&waypoints, limits, &RetimeOptions::default()).unwrap().trajectory
    }

    #[test]
    fn a_stop_begins_in_the_state_of_the_motion_stays_on_its_path_and_keeps_the_limits() {
        for (a, j) in [(10.0, 5000.0), (5.0, 50.0)] {
            let limits = Limits::new(&[1.5; 2], &[a; 2], &[j; 2]).unwrap();
            let whole = motion(&limits);
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
                // On its path with quintics a stop takes longer than joints by themselves, up to five times as seen.
                let [_, v, acceleration] = before;
                let own =
                    (0..2).map(|i| v[i].abs() / a + 2.0 * acceleration[i].abs() / j + 2.0 * a / j).fold(0.0, f64::max);
                assert!(stop.end() - t <= (5.5 * own + 0.05).min(whole.end() - t + 1e-9), "{} {own}", stop.end() - t);
            }
        }
    }

    #[test]
    fn motions_that_were_gone_over_to_before_stay_in_order() {
        let limits = Limits::new(&[1.5; 2], &[10.0; 2], &[5000.0; 2]).unwrap();
        let whole = motion(&limits);
        let twice = whole.splice(&whole, 0.8).unwrap().splice(&whole, 0.5).unwrap();
        assert!(twice.pieces().windows(2).all(|pair| pair[0].counts < pair[1].counts));
        for k in 0..=100 {
            let t = whole.end() * f64::from(k) / 100.0;
            assert_eq!(twice.moving(t), whole.moving(t));
        }
        let stored = serde_json::to_string(&twice).unwrap();
        assert!(serde_json::from_str::<Trajectory>(&stored).is_ok());
    }

    #[test]
    fn another_motion_is_gone_over_to_where_it_fits() {
        let limits = Limits::new(&[1.5; 2], &[10.0; 2], &[5000.0; 2]).unwrap();
        let whole = motion(&limits);
        let t = 0.4 * whole.end();
        let now = whole.sample(t);
        let options = RetimeOptions {
            start_velocity: Some(now.velocity),
            start_acceleration: Some(now.acceleration),
            start_time: t,
            ..RetimeOptions::default()
        };
        let next = retime(&[now.position, vec![0.0, 1.0]], &limits, &options).unwrap().trajectory;
        let spliced = whole.splice(&next, t).unwrap();
        assert_eq!((spliced.start(), spliced.end()), (whole.start(), next.end()));
        assert!(spliced.times().windows(2).all(|pair| pair[0] < pair[1]));
        for k in 0..=1000 {
            let time = spliced.end() * f64::from(k) / 1000.0;
            assert_eq!(spliced.sample(time), if time < t { whole.sample(time) } else { next.sample(time) });
        }
        let [mut q, mut v, mut a] = [[0.0; 2]; 3];
        spliced.sample_into(t, &mut q, &mut v, &mut a).unwrap();
        assert_eq!(spliced.sample(t).acceleration, a);
        assert!(spliced.sample_into(t, &mut q[..1], &mut v, &mut a).is_err());
        // Anywhere else it does not fit.
        assert!(whole.splice(&next, t + 0.05).is_err());
        // What has been is forgotten, and nothing else.
        let since = spliced.since(t - 0.1).unwrap();
        assert_eq!((since.start(), since.end()), (t - 0.1, spliced.end()));
        for k in 0..=1000 {
            let time = since.start() + (since.end() - since.start()) * f64::from(k) / 1000.0;
            assert_eq!(since.sample(time), spliced.sample(time));
        }
        let whole_again = spliced.since(-1.0).unwrap();
        assert_eq!(whole_again.sample(0.01), spliced.sample(0.01));
        assert!(since.since(f64::NAN).is_err());
        // A stop at the end takes no time.
        assert_eq!(spliced.brake(spliced.end()).unwrap().end(), spliced.end());
        // Twice, on the way of the second.
        let stop = next.brake(t + 0.1).unwrap();
        let twice = spliced.splice(&stop, t + 0.1).unwrap();
        assert!(twice.sample(twice.end()).velocity.iter().all(|v| v.abs() < 1e-8));
    }
}

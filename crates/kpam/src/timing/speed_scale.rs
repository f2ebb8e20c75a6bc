//! A motion whose speed is scaled while the robot moves: the path stays the same, and the limits are kept.
//!
//! The robot is at time `s` of the motion q(s), and `r = ds/dt` is the speed scale, 0 to 1. With `a = dr/dt`:
//!
//! ```text
//! velocity      q' r
//! acceleration  q'' r² + q' a
//! ```
//!
//! At a constant scale of at most 1 every limit is kept, because the motion itself keeps it. The scale may therefore
//! change only as long as `a` can be brought back to zero within the limits: each step is taken only after this change
//! back to a constant scale (the *settling*) has been computed step by step. Among the steps that pass, the one that
//! changes the scale most is taken, as long as the scale would not pass its target during the settling.

use super::trajectory::Trajectory;
use crate::ProblemError;
use crate::model::Row;

/// Relative tolerance of the limits, which covers rounding; that of the motion itself is half as large.
const ROUNDING: f64 = 2e-6;
/// Rounding error of an acceleration (rad/s² or m/s²).
const NOISE: f64 = 1e-9;
/// Maximum change of the scale in one step by its rate, and of the rate by its own, so that a change takes several steps.
const MOST: f64 = 0.25;
/// Number of bisections between a step that passes and one that does not.
const HALVINGS: usize = 12;
/// Fraction of the jerk limit that is not used, because the range of a step is computed to first order; and the maximum
/// number of corrections of this range.
const MARGIN: f64 = 1e-3;
const CORRECTIONS: usize = 4;
/// Maximum number of steps in which the scale must settle.
const LONGEST: usize = 5000;
/// A scale this close to its target is set to the target.
const REACHED: f64 = 1e-10;

/// Executes a motion at a speed scale that may change in every step.
///
/// Velocity, acceleration and jerk of every joint keep the limits of the motion in each step, also while the scale
/// changes. The jerk is the change of the acceleration from one step to the next, divided by the length of a step. The
/// path is exactly that of the motion. A step allocates no memory, and the same targets give the same steps.
///
/// ```
/// use gensim2_kpam::{Limits, RetimeOptions, SpeedScale, retime};
///
/// let limits = Limits::new(&[1.0], &[5.0], &[100.0])?;
/// let motion = retime(&[vec![0.0], vec![1.0]], &limits, &RetimeOptions::default())?.trajectory;
/// let mut scaled = SpeedScale::new(motion, 0.001)?;
/// let (mut q, mut v, mut a) = ([0.0], [0.0], [0.0]);
/// while !scaled.is_finished() {
///     let near = scaled.time() > 0.4 && scaled.time() < 0.6; // a person is near the robot
///     scaled.step(if near { 0.2 } else { 1.0 }, &mut q, &mut v, &mut a)?;
///     assert!(v[0] <= 1.0 + 1e-5 && a[0].abs() <= 5.0 + 1e-4);
/// }
/// assert!((q[0] - 1.0).abs() < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct SpeedScale {
    motion: Trajectory,
    /// Length of a step (s).
    dt: f64,
    now: State,
}

/// Time of the motion, scale, and rate of the scale, with the motion and the acceleration of the robot there.
#[derive(Debug, Clone, Copy)]
struct State {
    time: f64,
    scale: f64,
    rate: f64,
    /// Rate of change of the rate in the step that led here (1/s²), the guess for the next step.
    jerk: f64,
    /// Position, velocity and acceleration of the motion at `time`, before scaling.
    own: [Row; 3],
    acceleration: Row,
}

impl SpeedScale {
    /// Prepares a motion for steps of `dt` (s), at its start and at full speed.
    ///
    /// # Errors
    /// The length of a step is not 0.0001 to 0.1 s.
    pub fn new(motion: Trajectory, dt: f64) -> Result<Self, ProblemError> {
        if !(1e-4..=0.1).contains(&dt) {
            return Err(ProblemError::new("dt", format!("must lie in 0.0001 to 0.1 s, not {dt}")));
        }
        let time = motion.start();
        let own = motion.moving_with_rates(time);
        let now = State { time, scale: 1.0, rate: 0.0, jerk: 0.0, own, acceleration: own[2] };
        Ok(Self { motion, dt, now })
    }

    /// The motion at full speed.
    #[must_use]
    pub fn motion(&self) -> &Trajectory {
        &self.motion
    }

    /// Time of the motion (s) at which the robot is: with [`Trajectory::brake`] or [`Trajectory::sample`], it gives the
    /// place on the path. It advances by less than the real time while the scale is below 1.
    #[must_use]
    pub fn time(&self) -> f64 {
        self.now.time
    }

    /// Current speed scale, 0 to 1.
    #[must_use]
    pub fn scale(&self) -> f64 {
        // Rounding may take the scale out of the range by 1e-10.
        self.now.scale.clamp(0.0, 1.0)
    }

    /// Whether the robot has reached the end of the motion.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        self.now.time >= self.motion.end()
    }

    /// Advances by one step toward a speed scale, and writes position, velocity and acceleration of all joints after the
    /// step into slices of [`Trajectory::joints`] numbers. A target of 0 stops the robot on the path, and a later target
    /// continues the motion. The scale changes as fast as the limits of all joints allow.
    ///
    /// # Errors
    /// The target is not 0 to 1, or a slice has the wrong length; the robot then does not advance.
    pub fn step(
        &mut self,
        target: f64,
        position: &mut [f64],
        velocity: &mut [f64],
        acceleration: &mut [f64],
    ) -> Result<(), ProblemError> {
        if !(0.0..=1.0).contains(&target) {
            return Err(ProblemError::new("target", format!("must lie in 0 to 1, not {target}")));
        }
        self.motion.check_lengths(position, velocity, acceleration)?;
        self.now = self.next(target);
        let State { scale, own, acceleration: gain, .. } = self.now;
        let mut speed = own[1];
        speed.iter_mut().for_each(|v| *v *= scale);
        self.motion.map().fill(&[own[0], speed, gain], position, velocity, acceleration);
        Ok(())
    }

    fn next(&self, target: f64) -> State {
        let now = &self.now;
        if now.rate == 0.0 && (now.scale - target).abs() <= REACHED {
            return self.after(&State { scale: target, ..*now }, 0.0);
        }
        // The first step of the settling is the fallback: the rest of the settling was computed before the last step.
        let (fallback, settles_at) = self.settling(now).unwrap_or((-now.rate / self.dt, now.scale));
        let down = settles_at > target;
        let passes = |jerk: f64| {
            let next = self.after(now, jerk);
            let settled = self.keeps(now, &next).then(|| self.settling(&next)).flatten()?.1;
            let (from, to) = if down { (target, settles_at) } else { (settles_at, target) };
            (from - REACHED..=to + REACHED).contains(&settled).then_some(next)
        };
        // A small change takes two steps: the second one takes the rate of the first back.
        if now.rate == 0.0
            && let Some(next) = passes((target - now.scale) / (self.dt * self.dt))
        {
            return next;
        }
        let [low, high] = self.range(now, &self.after(now, fallback));
        let (mut good, mut bad) = (fallback, if down { low } else { high });
        if (down && bad >= good) || (!down && bad <= good) {
            return self.after(now, fallback);
        }
        let mut best = passes(bad);
        if best.is_none() {
            for _ in 0..HALVINGS {
                let middle = 0.5 * (good + bad);
                match passes(middle) {
                    Some(next) => (good, best) = (middle, Some(next)),
                    None => bad = middle,
                }
            }
        }
        best.unwrap_or_else(|| self.after(now, fallback))
    }

    /// Returns the state after a step in which the rate of the scale changes uniformly by `jerk` (1/s²).
    fn after(&self, now: &State, jerk: f64) -> State {
        let h = self.dt;
        let time = now.time + h * (now.scale + h * (0.5 * now.rate + h * jerk / 6.0));
        let time = time.clamp(now.time, self.motion.end());
        let scale = now.scale + h * (now.rate + 0.5 * h * jerk);
        let rate = if jerk == -now.rate / h { 0.0 } else { now.rate + h * jerk };
        let own = self.motion.moving_with_rates(time);
        let mut acceleration = [0.0; crate::model::MAX_JOINTS];
        for v in 0..self.motion.limits().joints() {
            acceleration[v] = own[2][v] * scale * scale + own[1][v] * rate;
        }
        State { time, scale, rate, jerk, own, acceleration }
    }

    /// Returns whether the acceleration at the end of a step and its change during the step keep the limits, and the scale
    /// stays between 0 and 1.
    fn keeps(&self, now: &State, next: &State) -> bool {
        let limits = self.motion.limits();
        let most = MOST / self.dt;
        next.rate.abs() <= most * (1.0 + ROUNDING)
            && (-REACHED..=1.0 + REACHED).contains(&next.scale)
            && (0..limits.joints()).all(|v| {
                let change = next.acceleration[v] - now.acceleration[v];
                next.acceleration[v].abs() <= limits.acceleration[v] * (1.0 + ROUNDING) + NOISE
                    && change.abs() <= limits.jerk[v] * self.dt * (1.0 + ROUNDING) + NOISE
            })
    }

    /// Returns the range of the jerk of the scale for which a step keeps the limits, to first order around `near`, a
    /// state after the step. The range is empty, with the lower end above the upper one, if no jerk does.
    fn range(&self, now: &State, near: &State) -> [f64; 2] {
        let (limits, h) = (self.motion.limits(), self.dt);
        let (most_rate, most) = (MOST / h, MOST / (h * h));
        let mut low = (-most).max((-most_rate - now.rate) / h);
        let mut high = most.min((most_rate - now.rate) / h);
        let (scale, rate) = (now.scale + h * now.rate, now.rate);
        for v in 0..limits.joints() {
            let (first, second) = (near.own[1][v], near.own[2][v]);
            let still = second * scale * scale + first * rate;
            let slope = first * h + second * scale * h * h;
            // The margin covers the error of first order.
            let (room, margin) = (limits.jerk[v] * h, MARGIN * limits.jerk[v] * h);
            let hardest = limits.acceleration[v] - margin;
            let least = (now.acceleration[v] - room + margin).max(-hardest) - still;
            let most = (now.acceleration[v] + room - margin).min(hardest) - still;
            if slope.abs() < 1e-12 {
                continue;
            }
            let (from, to) = if slope > 0.0 { (least / slope, most / slope) } else { (most / slope, least / slope) };
            (low, high) = (low.max(from), high.min(to));
        }
        [low, high]
    }

    /// Brings the rate of the scale to zero as fast as the limits allow. Returns the jerk of the first step and the final
    /// scale; `None` if a limit would be exceeded.
    fn settling(&self, from: &State) -> Option<(f64, f64)> {
        let (mut now, mut first) = (*from, None);
        for _ in 0..LONGEST {
            if now.rate == 0.0 {
                return Some((first.unwrap_or(0.0), now.scale));
            }
            let wanted = -now.rate / self.dt;
            let mut jerk = now.jerk;
            for _ in 0..CORRECTIONS {
                let [low, high] = self.range(&now, &self.after(&now, jerk));
                let better = wanted.clamp(low.min(high), high.max(low));
                let off = (better - jerk).abs() * self.dt * self.dt;
                jerk = better;
                if off <= MARGIN {
                    break;
                }
            }
            let next = self.after(&now, jerk);
            if !self.keeps(&now, &next) {
                return None;
            }
            first = first.or(Some(jerk));
            now = next;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Limits, RetimeOptions, retime};
    use super::*;
    use gensim2_geometry::Draws;

    fn random_motion(draws: &mut Draws, limits: &Limits) -> Trajectory {
        let count = 3 + (4.0 * draws.unit()) as usize;
        let path: Vec<Vec<f64>> =
            (0..count).map(|_| (0..limits.joints()).map(|_| 3.0 * draws.unit() - 1.5).collect()).collect();
        retime(&path, limits, &RetimeOptions::default()).unwrap().trajectory
    }

    /// Steps toward a target and returns position, velocity and acceleration.
    fn step(scaled: &mut SpeedScale, target: f64) -> [Vec<f64>; 3] {
        let mut out = [(); 3].map(|()| vec![0.0; scaled.motion().joints()]);
        let [q, v, a] = &mut out;
        scaled.step(target, q, v, a).unwrap();
        out
    }

    #[test]
    fn limits_and_path_are_kept_while_the_speed_changes() {
        for (case, (a, j)) in [(10.0, 5000.0), (5.0, 50.0), (2.0, 10.0)].into_iter().enumerate() {
            let mut draws = Draws::of(3, case);
            let limits = Limits::new(&[1.5, 2.0, 1.0], &[a; 3], &[j; 3]).unwrap();
            for _ in 0..5 {
                let motion = random_motion(&mut draws, &limits);
                let dt = 0.001 + 0.003 * draws.unit();
                let mut scaled = SpeedScale::new(motion.clone(), dt).unwrap();
                let (mut target, mut last, mut slow, mut fast) = (1.0, None::<[Vec<f64>; 3]>, 1.0_f64, 0.0_f64);
                for k in 0..2100 {
                    if k % 60 == 59 {
                        target = [0.0, 1.0, draws.unit()][(3.0 * draws.unit()) as usize];
                    }
                    let now = step(&mut scaled, target);
                    let on = motion.sample(scaled.time());
                    for v in 0..3 {
                        assert!((now[0][v] - on.position[v]).abs() < 1e-9);
                        assert!(now[1][v].abs() <= limits.velocity[v] * (1.0 + 1e-5), "{k} {now:?}");
                        assert!(now[2][v].abs() <= a * (1.0 + 1e-5), "{k} {now:?}");
                        if let Some(last) = &last {
                            let jerk = (now[2][v] - last[2][v]) / dt;
                            assert!(jerk.abs() <= j * (1.0 + 1e-5), "{k} {jerk} {a} {j}");
                            // Velocity and acceleration are the derivatives of the positions that are sent.
                            let mean = (now[0][v] - last[0][v]) / dt - 0.5 * (now[1][v] + last[1][v]);
                            assert!(mean.abs() <= j * dt * dt, "{k} {mean}");
                            let mean = (now[1][v] - last[1][v]) / dt - 0.5 * (now[2][v] + last[2][v]);
                            assert!(mean.abs() <= j * dt, "{k} {mean}");
                        }
                    }
                    (slow, fast) = (slow.min(scaled.now.scale), fast.max(scaled.now.scale));
                    last = Some(now);
                }
                assert!(slow >= -1e-9 && fast <= 1.0 + 1e-9, "{slow} {fast}");
            }
        }
    }

    #[test]
    fn a_stop_is_almost_as_short_as_the_fastest_stop_along_the_path() {
        let mut worst = 0.0_f64;
        for (case, (a, j)) in [(10.0, 5000.0), (5.0, 50.0)].into_iter().enumerate() {
            let mut draws = Draws::of(4, case);
            let limits = Limits::new(&[1.5, 2.0, 1.0], &[a; 3], &[j; 3]).unwrap();
            for _ in 0..12 {
                let motion = random_motion(&mut draws, &limits);
                let mut scaled = SpeedScale::new(motion.clone(), 0.001).unwrap();
                let begin = motion.end() * draws.unit();
                while scaled.time() < begin {
                    step(&mut scaled, 1.0);
                }
                let from = scaled.time();
                let shortest = motion.brake(from).unwrap().end() - from;
                let mut steps = 0;
                while scaled.scale() > 0.0 && !scaled.is_finished() {
                    step(&mut scaled, 0.0);
                    steps += 1;
                }
                let [_, v, acceleration] = step(&mut scaled, 0.0);
                assert!(v.iter().chain(&acceleration).all(|x| x.abs() < 1e-6), "{v:?} {acceleration:?}");
                worst = worst.max((0.001 * f64::from(steps) - 0.01) / shortest);
            }
        }
        assert!(worst < 1.5, "{worst}");
    }

    #[test]
    fn a_stopped_motion_goes_on_to_its_end() {
        let limits = Limits::new(&[1.5; 2], &[10.0; 2], &[300.0; 2]).unwrap();
        let motion = random_motion(&mut Draws::of(5, 0), &limits);
        let mut scaled = SpeedScale::new(motion.clone(), 0.002).unwrap();
        let mut last = Vec::new();
        for k in 0..5000 {
            if scaled.is_finished() {
                break;
            }
            [last, ..] = step(&mut scaled, if (100..400).contains(&k) { 0.0 } else { 1.0 });
            if k == 399 {
                assert_eq!(scaled.scale(), 0.0);
            }
        }
        assert!(scaled.is_finished());
        assert_eq!(last, motion.sample(motion.end()).position);
    }

    #[test]
    fn unusable_arguments_are_refused() {
        let limits = Limits::new(&[1.5; 2], &[10.0; 2], &[300.0; 2]).unwrap();
        let motion = random_motion(&mut Draws::of(5, 0), &limits);
        assert_eq!(SpeedScale::new(motion.clone(), f64::NAN).unwrap_err().field, "dt");
        let mut scaled = SpeedScale::new(motion, 0.001).unwrap();
        let [mut q, mut v, mut a] = [[0.0; 2]; 3];
        assert_eq!(scaled.step(1.5, &mut q, &mut v, &mut a).unwrap_err().field, "target");
        assert_eq!(scaled.step(f64::NAN, &mut q, &mut v, &mut a).unwrap_err().field, "target");
        assert_eq!(scaled.step(1.0, &mut q[..1], &mut v, &mut a).unwrap_err().field, "position");
        assert_eq!(scaled.time(), scaled.motion().start());
    }
}

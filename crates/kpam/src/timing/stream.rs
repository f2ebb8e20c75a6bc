//! Functions of motions for control loops: sampling without memory allocation, the remaining part of a motion, and
//! switching to another motion.

use super::limits::{Limits, TOLERANCE};
use super::motion::Piece;
use super::trajectory::Trajectory;
use crate::ProblemError;

impl Trajectory {
    /// Writes position, velocity and acceleration of all joints at time `t` (s) into slices of [`Trajectory::joints`]
    /// numbers. Suits control loops, because it allocates no memory. Apart from that, it equals [`Trajectory::sample`].
    ///
    /// # Errors
    /// A slice has the wrong length.
    pub fn sample_into(
        &self,
        t: f64,
        position: &mut [f64],
        velocity: &mut [f64],
        acceleration: &mut [f64],
    ) -> Result<(), ProblemError> {
        self.check_lengths(position, velocity, acceleration)?;
        self.map().fill(&self.moving_with_rates(t), position, velocity, acceleration);
        Ok(())
    }

    /// Refuses slices that do not have one entry for each joint.
    pub(super) fn check_lengths(
        &self,
        position: &[f64],
        velocity: &[f64],
        acceleration: &[f64],
    ) -> Result<(), ProblemError> {
        let n = self.joints();
        for (field, length) in
            [("position", position.len()), ("velocity", velocity.len()), ("acceleration", acceleration.len())]
        {
            if length != n {
                return Err(ProblemError::new(field, format!("has length {length}; the robot has {n} joints")));
            }
        }
        Ok(())
    }

    /// Returns the time (s) within the motion that is closest to `t`. Fails if `t` is not finite.
    pub(super) fn nearest(&self, t: f64) -> Result<f64, ProblemError> {
        if !t.is_finite() {
            return Err(ProblemError::new("t", format!("{t} is not finite")));
        }
        Ok(t.clamp(self.start(), self.end()))
    }

    /// Returns the part of this motion from time `t` (s) on, so that a repeatedly spliced motion does not grow.
    ///
    /// # Errors
    /// The time is not finite.
    pub fn since(&self, t: f64) -> Result<Self, ProblemError> {
        let t = self.nearest(t)?;
        let mut times = vec![t];
        times.extend(self.times().iter().filter(|time| **time > t));
        Ok(self.with(self.from(t), times, *self.limits()))
    }

    /// Returns a motion that follows this one until time `t` (s), and `next` from then on. At `t`, `next` must continue
    /// the state of this motion.
    ///
    /// # Errors
    /// `next` moves other joints, begins later than `t`, or differs at `t` in position, velocity or acceleration by
    /// more than 1e-6 (rad, m, s); or joints that neither motion moves have different values.
    pub fn splice(&self, next: &Self, t: f64) -> Result<Self, ProblemError> {
        if next.joints() != self.joints() || next.map().driven() != self.map().driven() {
            return Err(ProblemError::new("next", "moves other joints"));
        }
        let stands = |joint: usize| !self.map().moves(joint);
        for joint in (0..self.joints()).filter(|joint| stands(*joint)) {
            let (was, is) = (self.map().rest()[joint], next.map().rest()[joint]);
            if (was - is).abs() > TOLERANCE {
                let message = format!("its joint {joint}, which does not move, is at {is:.6} instead of {was:.6}");
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

/// Returns, for each joint, the wider of two limits.
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
    use super::super::testing;
    use super::*;

    #[test]
    fn motions_that_were_gone_over_to_before_stay_in_order() {
        let limits = Limits::new(&[1.5; 2], &[10.0; 2], &[5000.0; 2]).unwrap();
        let whole = testing::wavy(&limits);
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
        let whole = testing::wavy(&limits);
        let t = 0.4 * whole.end();
        let next = testing::going_on(&whole, t, &[0.0, 1.0]);
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
        // At another time, `next` does not continue the state of the motion.
        assert!(whole.splice(&next, t + 0.05).is_err());
        // `since` may drop only the part of the motion before its start.
        let since = spliced.since(t - 0.1).unwrap();
        assert_eq!((since.start(), since.end()), (t - 0.1, spliced.end()));
        for k in 0..=1000 {
            let time = since.start() + (since.end() - since.start()) * f64::from(k) / 1000.0;
            assert_eq!(since.sample(time), spliced.sample(time));
        }
        let whole_again = spliced.since(-1.0).unwrap();
        assert_eq!(whole_again.sample(0.01), spliced.sample(0.01));
        assert!(since.since(f64::NAN).is_err());
        // Braking at the end of the motion takes no time.
        assert_eq!(spliced.brake(spliced.end()).unwrap().end(), spliced.end());
        // Splice two motions, the second one while the first splice is still executed.
        let stop = next.brake(t + 0.1).unwrap();
        let twice = spliced.splice(&stop, t + 0.1).unwrap();
        assert!(twice.sample(twice.end()).velocity.iter().all(|v| v.abs() < 1e-8));
    }
}

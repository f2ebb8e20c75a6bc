//! Velocity, acceleration and jerk limits of the joints.

use serde::{Deserialize, Serialize};

use super::envelope::{Braking, Envelope};
use crate::default_limits::{braking, default_limits, greatest_velocity};
use crate::model::{MAX_JOINTS, Model, Row};
use crate::{KeypointProblem, ProblemError};

/// Larger limits are reduced to this value, so that every motion takes some time.
const GREATEST: f64 = 1e6;

/// Fraction by which a state may exceed a limit and still counts as keeping it; for positions, an absolute value (rad
/// or m). It covers rounding, also in single precision. Every check of a start or a motion uses it.
pub(crate) const TOLERANCE: f64 = 1e-6;

/// Maximum deviation (rad or m) of a joint from its path that the moving average may cause. The moving average bounds
/// the jerk.
const AVERAGING_DEVIATION: f64 = 1e-4;

/// Velocity, acceleration and jerk limits of the moving joints.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Limits {
    joints: usize,
    /// Velocity limits (rad/s or m/s).
    pub(crate) velocity: Row,
    /// Acceleration limits (rad/s^2 or m/s^2).
    pub(crate) acceleration: Row,
    /// Jerk limits (rad/s^3 or m/s^3).
    pub(crate) jerk: Row,
    /// Velocity limits that depend on the joint position, if there are any.
    pub(crate) envelope: Option<Envelope>,
}

impl Limits {
    /// Creates limits of up to [`MAX_JOINTS`] joints.
    ///
    /// # Errors
    /// The lists differ in length, there are no or too many joints, or a limit is not above 1e-9.
    pub fn new(velocity: &[f64], acceleration: &[f64], jerk: &[f64]) -> Result<Self, ProblemError> {
        let joints = velocity.len();
        if joints == 0 || joints > MAX_JOINTS {
            let message = format!("has {joints} entries; 1 to {MAX_JOINTS} joints can be timed");
            return Err(ProblemError::new("velocity_limits", message));
        }
        let row = |field: &str, list: &[f64]| {
            if list.len() != joints {
                return Err(ProblemError::new(field, format!("has {} entries, velocity_limits {joints}", list.len())));
            }
            let mut out = [1.0; MAX_JOINTS];
            for (j, value) in list.iter().enumerate() {
                if value.is_nan() || *value < 1e-9 {
                    return Err(ProblemError::new(
                        format!("{field}[{j}]"),
                        format!("must be at least 1e-9, not {value}"),
                    ));
                }
                out[j] = value.min(GREATEST);
            }
            Ok(out)
        };
        Ok(Self {
            joints,
            velocity: row("velocity_limits", velocity)?,
            acceleration: row("acceleration_limits", acceleration)?,
            jerk: row("jerk_limits", jerk)?,
            envelope: None,
        })
    }

    /// Adds position-dependent velocity limits, one entry for each joint.
    ///
    /// # Errors
    /// The list has the wrong length or invalid numbers; the error's field is `braking`.
    pub fn with_braking(self, list: &[Option<Braking>]) -> Result<Self, ProblemError> {
        Ok(Self { envelope: Some(Envelope::new(self.joints, list)?), ..self })
    }

    /// Returns the limits of the joints that planning moves in a problem, scaled by the problem's options.
    pub(crate) fn of(problem: &KeypointProblem, model: &Model) -> Self {
        Self::asked(model, &problem.options)
    }

    /// Returns the limits of the joints that planning moves on a robot, scaled by options.
    pub(crate) fn asked(model: &Model, o: &crate::Options) -> Self {
        let one = [1.0; MAX_JOINTS];
        let envelope = braking(o).map(|list| list.scaled(o.velocity_scale));
        let mut out = Self { joints: model.n(), velocity: one, acceleration: one, jerk: one, envelope };
        // A limit of a mimic joint bounds the variable that drives it.
        let given = |list: &Option<Vec<f64>>| list.as_ref().map(|l| model.map().least(|j| l[j]));
        let velocity = given(&o.velocity_limits).unwrap_or(model.velocity);
        let usual = default_limits(model, o);
        let velocity = greatest_velocity(o).map_or(velocity, |most| {
            let mut out = velocity;
            out.iter_mut().zip(most).for_each(|(own, most)| *own = own.min(most));
            out
        });
        let acceleration = given(&o.acceleration_limits).unwrap_or(usual.0);
        let jerk = given(&o.jerk_limits).unwrap_or(usual.1);
        for v in 0..model.n() {
            out.velocity[v] = (o.velocity_scale * velocity[v]).min(GREATEST);
            out.acceleration[v] = (o.acceleration_scale * acceleration[v]).min(GREATEST);
            out.jerk[v] = (o.acceleration_scale * jerk[v]).min(GREATEST);
        }
        out
    }

    /// Returns whether there are 1 to [`MAX_JOINTS`] joints and all limits are valid positive numbers.
    pub(crate) fn is_sound(&self) -> bool {
        let rows = [&self.velocity, &self.acceleration, &self.jerk];
        self.envelope.is_none_or(|e| e.is_sound())
            && (1..=MAX_JOINTS).contains(&self.joints)
            && rows.iter().all(|row| row.iter().all(|v| *v > 0.0 && v.is_finite()))
    }

    /// Returns the time per unit (s) that each joint takes at its highest speed, the weights of a path's length in time.
    pub(crate) fn pace(&self) -> Row {
        let mut out = [0.0; MAX_JOINTS];
        (0..self.joints).for_each(|v| out[v] = 1.0 / self.velocity[v].min(1e3));
        out
    }

    /// Returns the number of joints.
    #[must_use]
    pub fn joints(&self) -> usize {
        self.joints
    }

    /// Returns whether a value is within a limit, up to [`TOLERANCE`].
    pub(crate) fn keeps(value: f64, limit: f64) -> bool {
        value.abs() <= limit * (1.0 + TOLERANCE)
    }

    /// Returns the maximum speed of joint `v` if its acceleration is reduced to zero as fast as its jerk limit allows.
    pub(crate) fn settled_speed(&self, v: usize, velocity: f64, acceleration: f64) -> f64 {
        let next = velocity + 0.5 * acceleration * acceleration.abs() / self.jerk[v];
        velocity.abs().max(next.abs())
    }

    /// Returns limits that are wide enough for a start that exceeds these limits by at most [`TOLERANCE`], so that
    /// motions from this start keep the new limits exactly.
    pub(crate) fn admitting(&self, position: &Row, velocity: &Row, acceleration: &Row) -> Self {
        let mut out = *self;
        out.envelope = self.envelope.map(|e| e.admitting(position, velocity));
        for v in 0..self.joints {
            let (speed, gain) = (self.settled_speed(v, velocity[v], acceleration[v]), acceleration[v].abs());
            out.velocity[v] = out.velocity[v].max(speed);
            out.acceleration[v] = out.acceleration[v].max(gain);
        }
        out
    }

    /// Returns whether every motion that keeps the limits `other` keeps these limits, too, up to [`TOLERANCE`].
    pub(crate) fn admit(&self, other: &Self) -> bool {
        let within = |own: &Row, other: &Row| (0..self.joints).all(|v| other[v] <= own[v] * (1.0 + 2.0 * TOLERANCE));
        let bound = match (&self.envelope, &other.envelope) {
            (None, _) => true,
            (Some(own), Some(other)) => own.admits(other),
            (Some(_), None) => false,
        };
        self.joints == other.joints
            && bound
            && within(&self.velocity, &other.velocity)
            && within(&self.acceleration, &other.acceleration)
            && within(&self.jerk, &other.jerk)
    }

    /// Returns the width (s) of the moving average that bounds the jerk, and the limits that the motion must keep
    /// before averaging. `None` if averaging would move a joint further than [`AVERAGING_DEVIATION`] off its path.
    ///
    /// A moving average over `w` seconds keeps bounds on velocity and acceleration, turns an acceleration of at most
    /// `a` into one with a jerk of at most `2 a / w`, and moves a joint by at most `a w^2 / 24`.
    pub(crate) fn averaged(&self) -> Option<(f64, Self)> {
        self.averaged_within(AVERAGING_DEVIATION)
    }

    /// Does the same as `averaged`, with `most` as the maximum deviation (rad or m) of a joint from its path.
    pub(crate) fn averaged_within(&self, most: f64) -> Option<(f64, Self)> {
        let rows = 0..self.joints;
        let width = rows.clone().map(|v| 2.0 * self.acceleration[v] / self.jerk[v]).fold(0.0, f64::max);
        let deviation = rows.clone().map(|v| self.acceleration[v] * width * width / 24.0).fold(0.0, f64::max);
        if deviation > most {
            return None;
        }
        let mut out = *self;
        for v in rows {
            out.acceleration[v] = self.acceleration[v].min(0.5 * self.jerk[v] * width);
        }
        Some((width, out))
    }
}

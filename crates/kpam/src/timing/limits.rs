//! What the joints can do.

use crate::default_limits::default_limits;
use crate::model::{MOST_JOINTS, Model, Row};
use crate::{KeypointProblem, ProblemError};

/// Limits beyond this count as this much: a motion takes some time whatever the joints can do.
const GREATEST: f64 = 1e6;

/// Share by which a start under way, and so the motion from it, may exceed a limit: the rounding of what was measured or
/// stored in single precision. One figure for all who judge starts, or one would admit what another refuses.
pub(crate) const START_ROUNDING: f64 = 5e-7;

/// Most that the averaging which bounds jerk takes a joint off its path (rad or m), at the greatest acceleration.
const AVERAGING_DEVIATION: f64 = 1e-4;

/// Velocity, acceleration and jerk limits of the moving joints.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    joints: usize,
    /// rad/s or m/s.
    pub(crate) velocity: Row,
    /// rad/s^2 or m/s^2.
    pub(crate) acceleration: Row,
    /// rad/s^3 or m/s^3.
    pub(crate) jerk: Row,
}

impl Limits {
    /// Limits of up to [`MOST_JOINTS`] joints.
    ///
    /// # Errors
    /// A list of another length than `velocity`, none or too many joints, or a limit that is not above 1e-9.
    pub fn new(velocity: &[f64], acceleration: &[f64], jerk: &[f64]) -> Result<Self, ProblemError> {
        let joints = velocity.len();
        if joints == 0 || joints > MOST_JOINTS {
            let message = format!("has {joints} entries; 1 to {MOST_JOINTS} joints can be timed");
            return Err(ProblemError::new("velocity_limits", message));
        }
        let row = |field: &str, list: &[f64]| {
            if list.len() != joints {
                return Err(ProblemError::new(field, format!("has {} entries, velocity_limits {joints}", list.len())));
            }
            let mut out = [1.0; MOST_JOINTS];
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
        })
    }

    /// Those of the problem's moving joints, scaled as its options say.
    pub(crate) fn of(problem: &KeypointProblem, model: &Model) -> Self {
        let o = &problem.options;
        let one = [1.0; MOST_JOINTS];
        let mut out = Self { joints: model.n(), velocity: one, acceleration: one, jerk: one };
        // Limits of mimic joints bind the variables that drive them.
        let given = |list: &Option<Vec<f64>>| list.as_ref().map(|l| model.map().least(|j| l[j]));
        let velocity = given(&o.velocity_limits).unwrap_or(model.velocity);
        let usual = default_limits(o);
        let acceleration = given(&o.acceleration_limits).unwrap_or(usual.0);
        let jerk = given(&o.jerk_limits).unwrap_or(usual.1);
        for v in 0..model.n() {
            out.velocity[v] = (o.velocity_scale * velocity[v]).min(GREATEST);
            out.acceleration[v] = (o.acceleration_scale * acceleration[v]).min(GREATEST);
            out.jerk[v] = (o.acceleration_scale * jerk[v]).min(GREATEST);
        }
        out
    }

    /// Number of joints.
    #[must_use]
    pub fn joints(&self) -> usize {
        self.joints
    }

    /// Width (s) of the moving average that bounds jerk, and the limits that a motion keeps to before it is averaged.
    ///
    /// A moving average over `w` leaves bounds on velocity and acceleration as they are, and turns an acceleration within
    /// `a` into one whose rate is within `2 a / w`. It moves a joint by at most `a w^2 / 24`.
    pub(crate) fn averaged(&self) -> (f64, Self) {
        let rows = 0..self.joints;
        let wished = rows.clone().map(|v| 2.0 * self.acceleration[v] / self.jerk[v]).fold(0.0, f64::max);
        // Where a joint accelerates no more than jerk w / 2, it moves by at most jerk w^3 / 48.
        let most =
            rows.clone().map(|v| (48.0 * AVERAGING_DEVIATION / self.jerk[v]).cbrt()).fold(f64::INFINITY, f64::min);
        let width = wished.min(most);
        let mut out = *self;
        for v in rows {
            out.acceleration[v] = self.acceleration[v].min(0.5 * self.jerk[v] * width);
        }
        (width, out)
    }
}

//! Regions of joint values in which two bodies cannot come too close (Quinlan's bubbles).
//!
//! A point at distance r from a joint's axis moves at most r + d per radian while it stays within d of its position.
//! Therefore two bodies with the gap d keep apart while the joints between them move by less than the joint values whose
//! sum, weighted with r + d, is d.

use crate::model::{MAX_JOINTS, Row};

/// Factor on all weights for rounding errors.
const ROUNDED: f64 = 1.0005;

/// The joint values around a state at which a pair of bodies has a gap.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bubble {
    center: Row,
    /// Upper bound of the movement (m per rad or m) of the two bodies toward each other per unit of each variable.
    weights: Row,
    /// Gap (m) at the centre: distance minus required distance.
    gap: f64,
}

impl Bubble {
    /// A region that contains no state.
    pub const EMPTY: Self = Self { center: [0.0; MAX_JOINTS], weights: [0.0; MAX_JOINTS], gap: f64::NEG_INFINITY };

    /// Creates the region around a state. `levers` holds each variable that moves one of the two bodies relative to the
    /// other, with the factor and the lever (m) of the joint that it drives. A variable may occur more than once.
    pub fn new(center: &Row, gap: f64, levers: impl Iterator<Item = (usize, f64, f64)>) -> Self {
        let mut weights = [0.0; MAX_JOINTS];
        for (variable, factor, lever) in levers {
            weights[variable] += ROUNDED * factor * (lever + gap.max(0.0));
        }
        Self { center: *center, weights, gap }
    }

    /// Returns whether the two bodies keep the gap `rest` (m) wherever the variables lie between `lower` and `upper`.
    pub fn contains(&self, lower: &Row, upper: &Row, rest: f64) -> bool {
        let mut way = 0.0;
        for v in 0..MAX_JOINTS {
            way += (upper[v] - self.center[v]).max(self.center[v] - lower[v]) * self.weights[v];
        }
        way <= self.gap - rest
    }

    /// Returns a lower bound of the gap (m) at a state; negative if the state lies outside the region.
    pub fn gap_at(&self, x: &Row) -> f64 {
        let mut way = 0.0;
        for v in 0..MAX_JOINTS {
            way += (x[v] - self.center[v]).abs() * self.weights[v];
        }
        self.gap - way
    }

    /// Returns whether the two bodies, `room` (m) from a limit of their approach, need no bound on their approach while
    /// no variable is faster than `fastest`. The permitted speed is the room times `gain` (1/s), or less if the
    /// decelerations `braking` of the variables are not sufficient to stop in time.
    ///
    /// With weights w, speeds v and decelerations b, the speed of approach is at most `V = sum w v`, and the deceleration
    /// is `B = sum w b`. The permitted speed is `gain room`, or at least `sqrt(B room)` if that is less. By the inequality
    /// of Cauchy and Schwarz, `V^2 / B <= sum w v^2 / b`, also for smaller weights.
    pub fn is_slow(&self, fastest: &Row, braking: &Row, room: f64, gain: f64) -> bool {
        let (mut speed, mut way) = (0.0, 0.0);
        for v in 0..MAX_JOINTS {
            speed += self.weights[v] * fastest[v];
            way += if fastest[v] > 0.0 { self.weights[v] * fastest[v] * fastest[v] / braking[v] } else { 0.0 };
        }
        self.gap.is_finite() && speed <= gain * room && way <= room
    }
}

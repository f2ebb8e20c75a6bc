//! Position-dependent velocity limits: the closer a joint is to the end of its range, the slower it may move towards
//! this end. For its Research 3, Franka publishes limits `v <= -o + sqrt(k (u - q))`, the speed from which a joint can
//! still stop before the end.

use serde::{Deserialize, Serialize};

use super::limits::TOLERANCE;
use super::motion::{Node, curve};
use crate::ProblemError;
use crate::model::{MAX_JOINTS, Row};

/// Velocities towards the end of a range below this (rad/s or m/s) count as rounding errors.
const STILL: f64 = 1e-9;
/// Permitted excess of the squared velocity over its bound (rad^2/s^2 or m^2/s^2), for rounding errors.
const ROUNDING: f64 = 1e-9;

/// Velocity limit of a joint towards either end of its range, in addition to its constant limit: `-offset + sqrt(gain
/// (upper - q))` upwards and `offset - sqrt(gain (q - lower))` downwards.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Braking {
    /// Position at which the upper bound would be `-offset` (rad or m).
    pub upper: f64,
    /// Position at which the lower bound would be `offset` (rad or m).
    pub lower: f64,
    /// Twice the deceleration that the bound assumes (rad/s^2 or m/s^2), above 0.
    pub gain: f64,
    /// Speed subtracted from the bound (rad/s or m/s), at least 0.
    pub offset: f64,
}

impl Braking {
    /// Returns whether the numbers are finite and in their ranges.
    pub(crate) fn is_sound(&self) -> bool {
        let finite = [self.upper, self.lower, self.gain, self.offset].iter().all(|v| v.is_finite());
        finite && self.gain > 0.0 && self.offset >= 0.0 && self.lower < self.upper
    }

    /// Returns the distance to the end of the range on one side (1 upper, -1 lower), and the speed limit towards this
    /// end. The limit is negative if the joint may not move towards this end.
    fn most(&self, side: f64, q: f64) -> f64 {
        (self.gain * self.room(side, q)).max(0.0).sqrt() - self.offset
    }

    fn room(&self, side: f64, q: f64) -> f64 {
        if side > 0.0 { self.upper - q } else { q - self.lower }
    }
}

/// Position-dependent velocity limits of all joints; `None` for a joint with only its constant limit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Envelope([Option<Braking>; MAX_JOINTS]);

impl Envelope {
    pub fn new(joints: usize, list: &[Option<Braking>]) -> Result<Self, ProblemError> {
        if list.len() != joints {
            let message = format!("has {} entries, velocity_limits {joints}", list.len());
            return Err(ProblemError::new("braking", message));
        }
        let mut out = [None; MAX_JOINTS];
        for (j, braking) in list.iter().enumerate() {
            if braking.is_some_and(|b| !b.is_sound()) {
                let message = "needs finite numbers, a gain above 0, an offset of at least 0, and lower below upper";
                return Err(ProblemError::new(format!("braking[{j}]"), message));
            }
            out[j] = *braking;
        }
        Ok(Self(out))
    }

    pub fn is_sound(&self) -> bool {
        self.0.iter().flatten().all(Braking::is_sound)
    }

    /// Returns the velocity bounds multiplied by `share`.
    pub fn scaled(mut self, share: f64) -> Self {
        for braking in self.0.iter_mut().flatten() {
            braking.gain *= share * share;
            braking.offset *= share;
        }
        self
    }

    /// Returns, for each joint, the wider bounds of the two.
    pub fn wider(&self, other: &Self) -> Self {
        let mut out = *self;
        for (own, other) in out.0.iter_mut().zip(&other.0) {
            *own = own.zip(*other).map(|(a, b)| Braking {
                upper: a.upper.max(b.upper),
                lower: a.lower.min(b.lower),
                gain: a.gain.max(b.gain),
                offset: a.offset.min(b.offset),
            });
        }
        out
    }

    /// Returns whether all bounds in `other` are at least as strict as these, up to [`TOLERANCE`].
    pub fn admits(&self, other: &Self) -> bool {
        let near = |a: f64, b: f64| (a - b).abs() <= 10.0 * TOLERANCE;
        self.0.iter().zip(&other.0).all(|pair| match pair {
            (None, _) => true,
            (Some(own), Some(other)) => {
                near(own.upper, other.upper)
                    && near(own.lower, other.lower)
                    && other.gain <= own.gain * (1.0 + TOLERANCE)
                    && other.offset >= own.offset * (1.0 - TOLERANCE)
            }
            (Some(_), None) => false,
        })
    }

    /// Returns the maximum path speed ds/dt (1/s) at `position` (rad or m) of a path with `slope` = dq/ds.
    pub fn speed(&self, position: &Row, slope: &Row) -> f64 {
        let mut out = f64::INFINITY;
        for (v, braking) in self.0.iter().enumerate() {
            if let Some(braking) = braking
                && slope[v].abs() > STILL
            {
                out = out.min(braking.most(slope[v], position[v]).max(0.0) / slope[v].abs());
            }
        }
        out
    }

    /// Returns whether joint `v` keeps its bounds on the cubic between two nodes, up to [`TOLERANCE`].
    pub fn is_kept_between(&self, joints: usize, v: usize, a: &Node, b: &Node) -> bool {
        let (position, velocity) = curve(joints, v, a, b);
        let wider = self.scaled(1.0 + TOLERANCE);
        wider.share(v, &position, &velocity) <= 1.0
    }

    /// Returns the velocity bound that joint `v` exceeds by more than [`TOLERANCE`], if any.
    pub fn exceeded(&self, v: usize, q: f64, velocity: f64) -> Option<f64> {
        let most = self.0[v]?.most(velocity, q).max(0.0);
        (velocity.abs() > most * (1.0 + TOLERANCE) + TOLERANCE).then_some(most)
    }

    /// Returns the bounds, widened so that a state that exceeds them only by rounding keeps them.
    pub fn admitting(mut self, position: &Row, velocity: &Row) -> Self {
        for (v, braking) in self.0.iter_mut().enumerate() {
            let Some(braking) = braking else { continue };
            let room = (velocity[v].abs() + braking.offset).powi(2) / braking.gain;
            if velocity[v] > STILL {
                braking.upper = braking.upper.max(position[v] + room);
            } else if velocity[v] < -STILL {
                braking.lower = braking.lower.min(position[v] - room);
            }
        }
        self
    }

    /// Returns the largest fraction of its bounds that joint `v` uses along a motion, which is given by the Bernstein
    /// coefficients of position and velocity. The fraction is at most 1 if the motion keeps the bounds everywhere.
    ///
    /// With `c` the distance to the end times the gain, `v <= -o + sqrt(c)` is equivalent to `(v + o)^2 <= c` for
    /// motion towards the end. This polynomial inequality holds if all Bernstein coefficients are non-negative.
    pub fn share(&self, v: usize, position: &[f64], velocity: &[f64]) -> f64 {
        let Some(braking) = self.0[v] else { return 0.0 };
        let mut out = 0.0_f64;
        for side in [1.0, -1.0] {
            let fastest = velocity.iter().fold(f64::NEG_INFINITY, |m, x| m.max(side * x));
            if fastest <= STILL {
                continue;
            }
            let nearest = position.iter().map(|q| braking.room(side, *q)).fold(f64::INFINITY, f64::min);
            let slowest = (braking.gain * nearest).max(0.0).sqrt() - braking.offset;
            if fastest <= slowest {
                out = out.max(fastest / slowest);
                continue;
            }
            let mut shifted = [0.0; LONG];
            shifted.iter_mut().zip(velocity).for_each(|(s, x)| *s = side * x + braking.offset);
            let mut room = [0.0; LONG];
            room.iter_mut().zip(position).for_each(|(r, q)| *r = braking.gain * braking.room(side, *q));
            let degree = velocity.len() - 1;
            let square = product(&shifted[..=degree], &shifted[..=degree]);
            let raised = product(&room[..position.len()], &ONES[..=2 * degree + 1 - position.len()]);
            let kept = (0..=2 * degree).all(|i| raised[i] - square[i] >= -ROUNDING);
            out = out.max(if kept { 1.0 } else { (fastest / slowest.max(STILL)).max(1.0 + 1e-4) });
        }
        out
    }
}

/// Number of coefficients of the product with the highest degree, the square of a polynomial of degree 4.
const LONG: usize = 9;
const ONES: [f64; LONG] = [1.0; LONG];

/// Returns the Bernstein coefficients of the product of two polynomials in Bernstein form.
fn product(a: &[f64], b: &[f64]) -> [f64; LONG] {
    let (m, n) = (a.len() - 1, b.len() - 1);
    let mut out = [0.0; LONG];
    for (i, x) in a.iter().enumerate() {
        for (j, y) in b.iter().enumerate() {
            out[i + j] += choose(m, i) * choose(n, j) / choose(m + n, i + j) * x * y;
        }
    }
    out
}

fn choose(n: usize, k: usize) -> f64 {
    (0..k).fold(1.0, |c, i| c * (n - i) as f64 / (i + 1) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::timing::{Limits, RetimeOptions, Spline, retime};
    use proptest::prelude::*;

    fn value(coefficients: &[f64], t: f64) -> f64 {
        let n = coefficients.len() - 1;
        let term = |(i, c): (usize, &f64)| c * choose(n, i) * t.powi(i as i32) * (1.0 - t).powi((n - i) as i32);
        coefficients.iter().enumerate().map(term).sum()
    }

    proptest! {
        #[test]
        fn products_are_products(
            a in prop::collection::vec(-2.0..2.0f64, 5), b in prop::collection::vec(-2.0..2.0f64, 4), t in 0.0..1.0f64,
        ) {
            let both = product(&a, &b);
            prop_assert!((value(&both[..8], t) - value(&a, t) * value(&b, t)).abs() < 1e-9);
        }

        #[test]
        fn motions_keep_bounds_that_depend_on_where_they_are(
            waypoints in prop::collection::vec(prop::collection::vec(-1.9..1.9f64, 2), 2..7),
            (gain, offset) in (3.0..30.0f64, 0.0..0.4f64),
            (acceleration, jerk) in prop_oneof![Just((10.0, 5000.0)), Just((5.0, 50.0)), Just((10.0, 300.0))],
        ) {
            let braking = Braking { upper: 2.0, lower: -2.0, gain, offset };
            prop_assume!(braking.most(1.0, 1.9) > 0.02);
            let limits = Limits::new(&[2.5; 2], &[acceleration; 2], &[jerk; 2]).unwrap();
            let limits = limits.with_braking(&[Some(braking), None]).unwrap();
            let motion = match retime(&waypoints, &limits, &RetimeOptions::default()) {
                Ok(out) => out.trajectory,
                // The spline may overshoot to a position at which the velocity bound is nearly zero.
                Err(e) => {
                    prop_assert!(e.to_string().contains("waypoints"), "{e}");
                    let rows: Vec<Row> = waypoints
                        .iter()
                        .map(|w| std::array::from_fn(|v| w.get(v).copied().unwrap_or(0.0)))
                        .collect();
                    let path = Spline::through(2, &rows, None);
                    let furthest = (0..path.intervals())
                        .map(|i| path.range(0, i))
                        .fold(0.0_f64, |most, (low, high)| most.max(-low).max(high));
                    prop_assert!(braking.most(1.0, furthest) < 0.02, "{e}: it comes to {furthest}");
                    return Ok(());
                }
            };
            for k in 0..=4000 {
                let now = motion.sample(motion.end() * f64::from(k) / 4000.0);
                let (q, v) = (now.position[0], now.velocity[0]);
                let most = |room: f64| ((gain * room).max(0.0).sqrt() - offset).max(0.0);
                let (up, down) = (most(2.0 - q), most(q + 2.0));
                prop_assert!(v <= up * (1.0 + 1e-6) + 1e-8 && -v <= down * (1.0 + 1e-6) + 1e-8, "{v} {up} {down}");
                prop_assert!(now.velocity.iter().all(|v| v.abs() <= 2.5 * (1.0 + 1e-6)));
                prop_assert!(now.acceleration.iter().all(|a| a.abs() <= acceleration * (1.0 + 1e-6)));
            }
        }
    }

    #[test]
    fn bounds_cost_time_where_they_bind_and_nothing_elsewhere() {
        let plain = Limits::new(&[2.62], &[10.0], &[5000.0]).unwrap();
        let braking = Braking { upper: 2.7501, lower: -2.7501, gain: 12.0, offset: 0.3 };
        let bound = plain.with_braking(&[Some(braking)]).unwrap();
        let time = |limits: &Limits, from: f64, to: f64| {
            retime(&[vec![from], vec![to]], limits, &RetimeOptions::default()).unwrap().trajectory.end()
        };
        assert!((time(&bound, -1.0, 1.0) - time(&plain, -1.0, 1.0)).abs() < 1e-12);
        assert!(time(&bound, 1.0, 2.7) > 1.05 * time(&plain, 1.0, 2.7));
        // Far from the end of the range, the bound does not slow the motion.
        assert!((time(&bound, 2.7, 1.0) - time(&plain, 2.7, 1.0)).abs() < 2e-3);
        // Within a hundredth of the end of the range, the bound forbids motion towards the end, but not away from it.
        let line = |from: f64, to: f64| retime(&[vec![from], vec![to]], &bound, &RetimeOptions::default());
        assert!(line(2.0, 2.745).is_err());
        assert!(line(2.745, 2.0).is_ok());
    }

    #[test]
    fn a_start_faster_than_its_place_allows_is_refused() {
        let limits = Limits::new(&[2.62], &[10.0], &[5000.0]).unwrap();
        let braking = Braking { upper: 2.7501, lower: -2.7501, gain: 12.0, offset: 0.3 };
        let limits = limits.with_braking(&[Some(braking)]).unwrap();
        let from = |q: f64, v: f64| {
            let options = RetimeOptions { start_velocity: Some(vec![v]), ..RetimeOptions::default() };
            retime(&[vec![q], vec![0.0]], &limits, &options)
        };
        let most = braking.most(1.0, 2.5);
        assert!(from(2.5, most * 1.01).unwrap_err().to_string().contains("start_velocity"));
        assert!(from(2.5, 0.98 * most).is_ok());
        // A joint at its bound that is not braking yet exceeds the bound before its jerk limit lets it brake.
        assert!(from(2.5, most).unwrap_err().to_string().contains("braking"));
        assert!(from(2.5, -2.0).is_ok());
        assert!(limits.with_braking(&[Some(Braking { gain: 0.0, ..braking })]).is_err());
    }
}

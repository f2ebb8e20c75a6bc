//! Fastest motion along a straight line from a given speed to rest, within velocity, acceleration and jerk limits. The
//! motion is an S-curve, a sequence of phases with constant jerk.

/// State of a motion along a path at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Pace {
    /// Time (s).
    pub time: f64,
    /// Position s on the path, followed by its first and second time derivatives.
    pub s: f64,
    pub speed: f64,
    pub gain: f64,
}

/// Limits of the velocity, acceleration and jerk along a line.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Along {
    pub velocity: f64,
    pub acceleration: f64,
    pub jerk: f64,
}

/// Number of bisections of the maximum speed.
const HALVINGS: usize = 100;
/// Fraction of the length that rounding may change.
const ROUNDING: f64 = 1e-9;

impl Along {
    /// Returns the minimum time (s) to change the speed by `change`, with zero acceleration before and after.
    pub fn ramp_time(&self, change: f64) -> f64 {
        let most = self.acceleration * self.acceleration / self.jerk;
        if change >= most {
            change / self.acceleration + self.acceleration / self.jerk
        } else {
            2.0 * (change.max(0.0) / self.jerk).sqrt()
        }
    }

    /// Returns the durations (s) of the three phases of the fastest change of the speed by `change`.
    fn ramp(&self, change: f64) -> [f64; 3] {
        let time = self.ramp_time(change);
        let edge = (self.acceleration / self.jerk).min(0.5 * time);
        [edge, time - 2.0 * edge, edge]
    }

    /// Returns the fastest motion over `length` from `speed` to rest, with zero acceleration at both ends, as the
    /// states at which the jerk changes. `None` if `length` is too short for a stop.
    pub fn profile(&self, length: f64, speed: f64) -> Option<Vec<Pace>> {
        // A change of speed is symmetric in time, so it covers the mean of both speeds times its duration.
        let changes =
            |peak: f64| 0.5 * (speed + peak) * self.ramp_time(peak - speed) + 0.5 * peak * self.ramp_time(peak);
        if changes(speed) > length * (1.0 + ROUNDING) {
            return None;
        }
        let (mut low, mut high) = (speed, self.velocity.max(speed));
        if changes(high) <= length {
            low = high;
        }
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if middle <= low || middle >= high {
                break;
            }
            if changes(middle) <= length {
                low = middle;
            } else {
                high = middle;
            }
        }
        let cruise = if low > 0.0 { ((length - changes(low)) / low).max(0.0) } else { 0.0 };
        let (up, down) = (self.ramp(low - speed), self.ramp(low));
        let j = self.jerk;
        let phases =
            [(up[0], j), (up[1], 0.0), (up[2], -j), (cruise, 0.0), (down[0], -j), (down[1], 0.0), (down[2], j)];
        let mut out = vec![Pace { time: 0.0, s: 0.0, speed, gain: 0.0 }];
        let mut now = out[0];
        for (duration, jerk) in phases {
            if duration > 0.0 {
                now = now.after(duration, jerk);
                out.push(now);
            }
        }
        // Remove rounding errors of the final position and speed.
        if let Some(last) = out.last_mut() {
            (last.s, last.speed, last.gain) = (length, 0.0, 0.0);
        }
        Some(out)
    }
}

impl Pace {
    /// Returns the state after a time `t` (s) of constant jerk.
    pub fn after(&self, t: f64, jerk: f64) -> Self {
        Self {
            time: self.time + t,
            s: self.s + t * (self.speed + t * (0.5 * self.gain + t * jerk / 6.0)),
            speed: self.speed + t * (self.gain + 0.5 * t * jerk),
            gain: self.gain + t * jerk,
        }
    }
}

/// Returns the state of a profile at position `s`.
pub(crate) fn at_place(profile: &[Pace], s: f64) -> Pace {
    let last = profile[profile.len() - 1];
    let Some(next) = profile.iter().position(|p| p.s > s) else { return last };
    if next == 0 {
        return profile[0];
    }
    let (from, to) = (profile[next - 1], profile[next]);
    let jerk = (to.gain - from.gain) / (to.time - from.time);
    let (mut low, mut high) = (0.0, to.time - from.time);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if from.after(middle, jerk).s <= s {
            low = middle;
        } else {
            high = middle;
        }
    }
    from.after(0.5 * (low + high), jerk)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn known_times() {
        // Four phases of equal duration t with 2 j t^3 = d; the motion never reaches the maximum acceleration.
        let along = Along { velocity: 10.0, acceleration: 100.0, jerk: 2.0 };
        let short = along.profile(0.5, 0.0).unwrap();
        assert!((short[short.len() - 1].time - 4.0 * 0.125f64.cbrt()).abs() < 1e-9);
        // Duration: d / v + v / a + a / j.
        let along = Along { velocity: 1.0, acceleration: 2.0, jerk: 10.0 };
        let long = along.profile(5.0, 0.0).unwrap();
        assert!((long[long.len() - 1].time - 5.7).abs() < 1e-9);
        assert!(along.profile(0.01, 1.0).is_none());
    }

    proptest! {
        #[test]
        fn profiles_meet_their_ends(
            length in 1e-3..10.0f64, share in 0.0..1.0f64, v in 0.1..3.0f64, a in 0.1..20.0f64, j in 1.0..1e4f64,
        ) {
            let along = Along { velocity: v, acceleration: a, jerk: j };
            if let Some(profile) = along.profile(length, share * v) {
                for pair in profile.windows(2) {
                    let t = pair[1].time - pair[0].time;
                    let jerk = (pair[1].gain - pair[0].gain) / t;
                    prop_assert!(jerk.abs() <= j * (1.0 + 1e-6) + 1e-9 / t && pair[1].gain.abs() <= a * (1.0 + 1e-9));
                    prop_assert!(pair[1].speed <= v * (1.0 + 1e-9) && pair[1].speed >= -1e-9);
                    let next = pair[0].after(t, jerk);
                    prop_assert!((next.s - pair[1].s).abs() < 1e-7, "{} {}", next.s, pair[1].s);
                    prop_assert!((next.speed - pair[1].speed).abs() < 1e-7);
                }
            } else {
                // The length must be too short even for a stop that begins at once.
                prop_assert!(0.5 * share * v * along.ramp_time(share * v) > length);
            }
        }
    }
}

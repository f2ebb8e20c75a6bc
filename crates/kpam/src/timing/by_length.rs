//! The path of a motion as a function of its length.

use super::limits::TOLERANCE;
use super::stop::State;
use super::trajectory::Trajectory;
use crate::model::{MAX_JOINTS, Row};

/// Maximum time interval (s) over which one quadrature step integrates the length.
pub(super) const LONGEST: f64 = 0.02;
/// Maximum number of intervals.
const MAX_STEPS: usize = 20_000;
/// Speeds below this (rad/s or m/s) count as rest.
pub(super) const STILL: f64 = 1e-9;
/// Number of bisections of the time at which a motion reverses.
const HALVINGS: usize = 40;

/// The path of a motion from a given time on, as a function of its length.
pub(super) struct Path<'m> {
    motion: &'m Trajectory,
    /// Pairs of a time (s) and the length (rad or m) of the path up to this time.
    pub places: Vec<(f64, f64)>,
    /// Whether the motion is at rest at the end of the path.
    pub rests: bool,
}

impl<'m> Path<'m> {
    /// Returns the path from time `begin` (s) until the motion rests or reverses, or after [`MAX_STEPS`] intervals.
    pub fn new(motion: &'m Trajectory, begin: f64) -> Self {
        let mut places = vec![(begin, 0.0)];
        measure(motion, &mut places);
        let [_, velocity, acceleration] = motion.moving_with_rates(places[places.len() - 1].0);
        let rests = norm(motion, &velocity).max(norm(motion, &acceleration)) < TOLERANCE;
        Self { motion, places, rests }
    }

    pub fn end(&self) -> f64 {
        self.places[self.places.len() - 1].0
    }

    pub fn length(&self) -> f64 {
        self.places.last().map_or(0.0, |place| place.1)
    }

    /// Returns the time (s) at which the motion has covered this length.
    fn time(&self, length: f64) -> f64 {
        let k = self.places.partition_point(|place| place.1 <= length).clamp(1, self.places.len() - 1);
        let ((mut low, from), (mut high, to)) = (self.places[k - 1], self.places[k]);
        let speed = |t: f64| norm(self.motion, &self.motion.moving_with_rates(t)[1]);
        let begin = low;
        let mut at = low + (high - low) * ((length - from) / (to - from).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        for _ in 0..20 {
            let off = from + gone(&speed, begin, at) - length;
            if off > 0.0 {
                high = at
            } else {
                low = at
            }
            let change = off / speed(at);
            if change.abs() <= f64::EPSILON * at.abs().max(1.0) {
                break;
            }
            let next = at - change;
            at = if next > low && next < high { next } else { 0.5 * (low + high) };
        }
        at
    }

    /// Returns the joints' state at a length of the path, given the speed and acceleration along the path.
    pub fn at(&self, [length, speed, gain]: State) -> [Row; 3] {
        let joints = self.motion.limits().joints();
        let time = self.time(length);
        let [position, velocity, acceleration] = self.motion.moving_with_rates(time);
        let own = norm(self.motion, &velocity);
        let along: f64 = (0..joints).map(|v| velocity[v] * acceleration[v]).sum::<f64>() / (own * own);
        let [mut rate, mut change] = [[0.0; MAX_JOINTS]; 2];
        for v in 0..joints {
            let tangent = velocity[v] / own;
            let bend = (acceleration[v] - along * velocity[v]) / (own * own);
            rate[v] = tangent * speed;
            change[v] = tangent * gain + bend * speed * speed;
        }
        [position, rate, change]
    }
}

/// Appends times and lengths of the path that follow the first entry of `places`.
fn measure(motion: &Trajectory, places: &mut Vec<(f64, f64)>) {
    let speed = |t: f64| norm(motion, &motion.moving_with_rates(t)[1]);
    let (mut from, mut length) = places[0];
    // Between the times `corners`, the motion is one polynomial. Pieces may overlap in time, so the times at which the
    // trajectory switches to the next piece are included.
    let pieces = motion.from(from);
    let mut corners: Vec<f64> =
        pieces.iter().flat_map(|piece| [piece.corners(), vec![piece.counts]].concat()).collect();
    corners.push(motion.end());
    corners.retain(|t| *t > from && *t <= motion.end());
    corners.sort_by(f64::total_cmp);
    corners.dedup();
    let mut before = speed(from);
    let mut left = MAX_STEPS;
    for corner in corners {
        let parts = ((corner - from) / LONGEST).ceil().max(1.0);
        let step = (corner - from) / parts;
        for k in 0..parts as usize {
            if left == 0 {
                return;
            }
            left -= 1;
            let whole = if k as f64 + 1.0 < parts { from + step } else { corner };
            let turn = turn(motion, from, whole);
            let to = turn.unwrap_or(whole);
            length += gone(&speed, from, to);
            if to > from {
                places.push((to, length));
                from = to;
            }
            let now = speed(to);
            if turn.is_some() || (now < STILL && before > now) {
                return;
            }
            before = now;
        }
    }
}

/// Returns the time between two times at which the motion reverses on its path; `None` if it does not reverse.
fn turn(motion: &Trajectory, mut low: f64, mut high: f64) -> Option<f64> {
    let velocity = |t: f64| motion.moving_with_rates(t)[1];
    let first = velocity(low);
    let most = -STILL * norm(motion, &first);
    let back = |t: f64| first.iter().zip(velocity(t)).map(|(a, b)| a * b).sum::<f64>() < most;
    if !back(high) {
        return None;
    }
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if back(middle) { high = middle } else { low = middle }
    }
    // A motion reverses only where it comes to rest; at a sharp bend its speed is above zero.
    (norm(motion, &velocity(low)) < TOLERANCE).then_some(low)
}

/// Returns the length of the path between two times, by three-point Gauss-Legendre quadrature.
fn gone(speed: &impl Fn(f64) -> f64, from: f64, to: f64) -> f64 {
    let (middle, half) = (0.5 * (from + to), 0.5 * (to - from));
    let off = half * 0.6_f64.sqrt();
    half * (5.0 * speed(middle - off) + 8.0 * speed(middle) + 5.0 * speed(middle + off)) / 9.0
}

pub(super) fn norm(motion: &Trajectory, row: &Row) -> f64 {
    row[..motion.limits().joints()].iter().map(|v| v * v).sum::<f64>().sqrt()
}

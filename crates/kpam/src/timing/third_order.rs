//! Time-optimal speed along a path within velocity, acceleration and jerk limits; the motion stays exactly on the path.
//!
//! x(s) = (ds/dt)^2 is a quadratic spline over the stations with one coefficient c per cell. Therefore x and the second
//! derivative w = d²s/dt² = x'/2 are continuous and linear in c, and so is each joint's acceleration q' w + q'' x. Its
//! jerk is (q' w' + 3 q'' w + q''' x) sqrt(x). An interior-point method with a logarithmic barrier minimises the time.
//! Each row holds three neighbouring coefficients, so the matrices of the Newton steps have five diagonals. If the
//! motion starts or ends at rest, the jerk of s is constant in the first or last cell, which ties its coefficient to
//! the next one.

use super::barrier::Problem;
use super::limits::Limits;
use super::profile::{Along, Pace, at_place};
use super::torque::Torque;
use crate::Cancel;
use crate::model::Row;

/// A position on the path; `third` is the third derivative in the cell that follows.
#[derive(Debug, Clone)]
pub(crate) struct Station {
    pub s: f64,
    pub first: Row,
    pub second: Row,
    pub third: Row,
    /// Torques at the station, if torque limits are given.
    pub torque: Option<Torque>,
}

/// A path and the limits for which the fastest motion is computed.
pub(crate) struct PathProblem<'a> {
    pub limits: &'a Limits,
    pub stations: &'a [Station],
    /// Maximum ds/dt at each station that the caller requires, in addition to the joint limits.
    pub pace: &'a [f64],
    /// Maximum ds/dt in the middle of each cell.
    pub pace_inside: &'a [f64],
    /// Fractions of the joints' velocity, acceleration and jerk limits that may be used in each cell.
    pub shares: &'a [[f64; 3]],
    /// ds/dt at the start, where d²s/dt² is 0.
    pub begin: f64,
    /// Torque limits, and the usable fraction of the torque that gravity leaves.
    pub load: Option<(&'a Row, f64)>,
    pub cancel: Option<&'a Cancel>,
}

/// Permitted excess of the duration over the optimum, as a fraction. The actual excess is about a twentieth of it.
const GAP: f64 = 0.06;
/// Factor by which the weight of the time grows, and maximum number of Newton steps for one weight and in total.
const GROWTH: f64 = 12.0;
const STEPS: usize = 12;
const MAX_STEPS: usize = 120;
/// Points and weights of 8-point Gauss-Legendre quadrature on [0, 1].
const POINTS: [f64; 4] =
    [0.183_434_642_495_649_8, 0.525_532_409_916_329, 0.796_666_477_413_626_7, 0.960_289_856_497_536_3];
const WEIGHTS: [f64; 4] =
    [0.362_683_783_378_362, 0.313_706_645_877_887_3, 0.222_381_034_453_374_48, 0.101_228_536_290_376_26];

/// Returns the fastest motion along the path to rest at its last station, as the states at the stations. `None` if no
/// motion was found from the speed at the start.
pub(crate) fn fastest(path: &PathProblem<'_>) -> Option<Vec<Pace>> {
    let problem = Problem::new(path);
    let mut c = begin(&problem, path)?;
    let moving = path.begin > 0.0;
    let mut slack = if moving { 1.1 * worst(&problem, &c).max(1.0) } else { 1.0 };
    let count = (2 * problem.bounds.len() + problem.ceilings.len()) as f64;
    let time = |c: &[f64]| problem.times.iter().map(|(form, step)| step / form.value(c).sqrt()).sum::<f64>();
    let mut weight = 0.1 * count / time(&c);
    let mut left = MAX_STEPS;
    loop {
        for _ in 0..STEPS {
            if path.cancel.is_some_and(Cancel::is_cancelled) {
                return None;
            }
            // If rounding ends the descent, the current motion is still valid, because it is within the limits.
            let Some((step, decrement)) = problem.newton(&c, weight, slack) else {
                left = 0;
                break;
            };
            if decrement < 1e-2 || left == 0 {
                break;
            }
            left -= 1;
            let before = problem.merit(&c, weight, slack)?;
            let mut length = 1.0;
            let moved = loop {
                let mut next = c.clone();
                next[1..].iter_mut().zip(&step).for_each(|(c, d)| *c += length * d);
                problem.spread(&mut next);
                match problem.merit(&next, weight, slack) {
                    Some(after) if after <= before - 0.1 * length * decrement => break Some(next),
                    _ if length < 1e-4 => break None,
                    _ => length *= 0.5,
                }
            };
            match moved {
                Some(next) => c = next,
                None => break,
            }
        }
        if slack > 1.0 {
            // At first, a motion from a moving start may exceed the limits, which are widened by `slack`. They are
            // tightened as far as the motion stays strictly within them.
            let reached = worst(&problem, &c);
            if left == 0 || slack - reached < 1e-9 {
                return None;
            }
            slack = if reached < 1.0 { 1.0 } else { reached + 0.2 * (slack - reached) };
            continue;
        }
        if left == 0 || count / weight < GAP * time(&c) {
            return Some(paces(&problem, path, &c));
        }
        weight *= GROWTH;
    }
}

/// Returns the largest factor by which the motion exceeds a limit.
fn worst(problem: &Problem, c: &[f64]) -> f64 {
    problem.usage(c).into_iter().fold(0.0, f64::max)
}

/// Returns a slow motion as the initial solution: an S-curve whose limits are valid along the whole path.
fn begin(problem: &Problem, path: &PathProblem<'_>) -> Option<Vec<f64>> {
    let whole = path.stations.last()?.s;
    let limits = path.limits;
    let velocity = path.pace.iter().chain(path.pace_inside).copied().fold(f64::INFINITY, f64::min);
    let mut most = Along { velocity, acceleration: f64::INFINITY, jerk: f64::INFINITY };
    for station in path.stations {
        for v in 0..limits.joints() {
            let [first, second, third] = [station.first[v], station.second[v], station.third[v]].map(f64::abs);
            let (velocity, acceleration, jerk) = (limits.velocity[v], limits.acceleration[v], limits.jerk[v]);
            let speed = (velocity / first).min((0.5 * acceleration / second).sqrt()).min((0.3 * jerk / third).cbrt());
            most.velocity = most.velocity.min(speed);
            most.acceleration = most.acceleration.min(0.5 * acceleration / first);
            most.jerk = most.jerk.min(0.4 * jerk / first);
        }
    }
    let mut c: Vec<f64> = if path.begin > 0.0 {
        let end = |s: f64| (1.0 - s / whole).powf(4.0 / 3.0);
        path.stations.windows(2).map(|pair| problem.fixed * end(0.5 * (pair[0].s + pair[1].s))).collect()
    } else {
        let profile = most.profile(whole, 0.0)?;
        path.stations.windows(2).map(|pair| at_place(&profile, 0.5 * (pair[0].s + pair[1].s)).speed.powi(2)).collect()
    };
    problem.spread(&mut c);
    if path.begin > 0.0 {
        return Some(c);
    }
    let [velocity, acceleration, jerk] = problem.usage(&c);
    // For a range of torques around a value other than 0, use the part between 0 and the range's end closest to 0.
    let load = problem.bounds.iter().filter(|b| b.middle != 0.0);
    let load = load.map(|b| b.row.value(&c).abs() / (b.limit - b.middle.abs())).fold(0.0, f64::max);
    let factor = (0.7 / velocity).min(0.7 / acceleration).min((0.7 / jerk).powf(2.0 / 3.0)).min(0.7 / load);
    c.iter_mut().for_each(|c| *c *= factor);
    Some(c)
}

/// Returns the states of the motion at the stations.
fn paces(problem: &Problem, path: &PathProblem<'_>, c: &[f64]) -> Vec<Pace> {
    let last = problem.cells;
    let mut out = vec![Pace { time: 0.0, s: 0.0, speed: path.begin, gain: 0.0 }];
    for k in 1..=last {
        let (s, step) = (path.stations[k].s, problem.steps[k - 1]);
        let (mut x, mut w) = (0.0, 0.0);
        if k < last {
            (x, w) = (problem.x[k].value(c), problem.w[k].value(c));
        }
        let before = out[k - 1];
        let time = if k == last {
            3.0 * step / before.speed
        } else if before.speed == 0.0 {
            3.0 * step / x.sqrt()
        } else {
            let (from, middle) = (before.speed * before.speed, c[k - 1]);
            let slow = |u: f64| {
                let v = 1.0 - u;
                (v * v * from + 2.0 * u * v * middle + u * u * x).sqrt().recip()
            };
            let sum: f64 = POINTS
                .iter()
                .zip(WEIGHTS)
                .map(|(p, weight)| 0.5 * weight * (slow(0.5 - 0.5 * p) + slow(0.5 + 0.5 * p)))
                .sum();
            step * sum
        };
        out.push(Pace { time: before.time + time, s, speed: x.sqrt(), gain: w });
    }
    out
}

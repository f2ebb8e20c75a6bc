//! Pairs of bodies near each other, whose approach bounds a step.

use gensim2_geometry::{Contact, Other, Screen};

use super::arm::Arm;
use super::guard::{Guard, INFLUENCE, Neighbour, Surroundings};
use super::joint::{JointLimits, Settled};
use super::task::approach;
use crate::model::{MAX_JOINTS, Row};
use crate::timing::State;
use crate::world::TOUCH;

/// Distance (m) that the quadratic program keeps in addition to the margin, so that steps along obstacles are proven.
const BUFFER: f64 = 2e-3;
/// Ratio of the speed of approach to the remaining distance (1/s).
const DAMPER: f64 = 15.0;
/// Fraction of the joints' acceleration limits with which the approach of an obstacle is planned.
const BRAKING: f64 = 0.25;
/// Maximum number of pairs of bodies that bound a step.
const PAIRS: usize = 16;

/// Two bodies whose approach bounds a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pair {
    pub group: usize,
    pub other: Other,
    /// Gradient of the distance by the variables.
    pub gradient: Row,
    /// Largest permitted speed of approach (m/s).
    pub speed: f64,
}

/// State of the arm in which pairs are measured.
#[derive(Clone, Copy)]
pub(super) struct Present<'s> {
    pub arm: &'s Arm,
    pub limits: &'s [JointLimits],
    pub states: &'s [State],
    pub x: &'s Row,
    /// Velocities that the limits of the joints permit after the next step.
    pub ranges: &'s [Settled],
}

/// Measures the pairs near each other, with the largest speeds at which they may approach. Writes those that bound the
/// step most to `out`. Returns the smallest distance (m) of all pairs; infinite if no pair is near.
pub(super) fn near_pairs(around: Surroundings<'_>, guard: &mut Guard, now: &Present<'_>, out: &mut Vec<Pair>) -> f64 {
    let screen = &around.scene.compiled().screen;
    let [mut fastest, mut braking] = [[0.0; MAX_JOINTS]; 2];
    for (v, (limits, range)) in now.limits.iter().zip(now.ranges).enumerate() {
        (fastest[v], braking[v]) = (range.low.abs().max(range.high.abs()), BRAKING * limits.acceleration);
    }
    let mut least = f64::INFINITY;
    out.clear();
    guard.find_near(now.x);
    for at in 0..guard.near.len() {
        let (gap, k) = guard.near[at];
        let Neighbour { group, other, need, .. } = guard.neighbours[k];
        let buffer = BUFFER.min(0.5 * need.max(2.0 * TOUCH));
        // A pair that no permitted velocity can bring too close matters only if it is the nearest one.
        let is_safe = guard.neighbours[k].seen.is_slow(&fastest, &braking, gap - buffer, DAMPER);
        if is_safe && gap + need >= least {
            continue;
        }
        let Some(contact) = guard.contact(around, k, now.arm, now.x) else { continue };
        if contact.distance > need + INFLUENCE {
            continue;
        }
        least = least.min(contact.distance);
        if is_safe {
            continue;
        }
        let gradient = gradient(now.arm, screen, (group, other), &contact);
        // Deceleration of the approach if every joint brakes with a part of its limit.
        let braking = braking.iter().zip(&gradient).map(|(most, g)| most * g.abs()).sum();
        let speed = approach(contact.distance - need - buffer, braking, DAMPER);
        out.push(Pair { group, other, gradient, speed });
    }
    let nearest = |pair: &Pair| {
        // Pairs count as nearer the faster they approach.
        let approach: f64 = now.states.iter().zip(&pair.gradient).map(|(state, g)| -g * state[1]).sum();
        pair.speed - approach
    };
    out.sort_unstable_by(|a, b| nearest(a).total_cmp(&nearest(b)));
    out.truncate(PAIRS);
    least
}

/// Returns the gradient of the distance of two bodies by the variables.
pub(super) fn gradient(arm: &Arm, screen: &Screen, (group, other): (usize, Other), contact: &Contact) -> Row {
    let mut out = [0.0; MAX_JOINTS];
    // The normal points from the first body to the second: moving the first body along it reduces the distance.
    arm.add_gradient(group, &contact.on_first, &-contact.normal, &mut out);
    if let Other::Pair(pair) = other {
        arm.add_gradient(screen.pairs()[pair].1, &contact.on_second, &contact.normal, &mut out);
    }
    out
}

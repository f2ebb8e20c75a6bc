//! Axis constraints as linear bands of a hand direction.

use nalgebra::Vector3;

use crate::resolve::AxisBound;

/// Constraints are aimed at this fraction of their tolerance, so that rounding never leaves it.
pub(super) const INSIDE: f64 = 0.995;
/// Sides of the polygon inscribed in the cone of a parallel constraint: 2 % of the tolerance is given away.
const CONE_SIDES: usize = 16;

/// An axis constraint as bands `low <= u . m <= high` of the hand's direction `u`.
///
/// A band whose cone closes at the target (parallel constraints) becomes a polygon inscribed in the cone; an open band
/// becomes one band along the direction in which the angle changes.
pub(super) fn axis_bands(a: &AxisBound, u: &Vector3<f64>) -> impl Iterator<Item = (Vector3<f64>, f64, f64)> + use<> {
    let u = *u;
    let flipped = a.center > std::f64::consts::FRAC_PI_2;
    let target = if flipped { -a.target } else { a.target };
    let center = if flipped { std::f64::consts::PI - a.center } else { a.center };
    let t = INSIDE * a.tolerance;
    let closed = center - t <= 0.0;
    let (e1, e2) = across(&target);
    let cross = target.cross(&u);
    let sin = cross.norm();
    // Unit direction across the target in which u lies.
    let outward = if sin > 1e-9 { cross.cross(&target) / sin } else { e1 };
    let half_turn = std::f64::consts::PI;
    let wide = center + t >= std::f64::consts::FRAC_PI_2;
    (0..if closed && !wide { CONE_SIDES } else { 1 }).map(move |k| {
        if closed && !wide {
            let step = 2.0 * half_turn / CONE_SIDES as f64;
            let (s, c) = (step * k as f64).sin_cos();
            (e1 * c + e2 * s, f64::NEG_INFINITY, (center + t).sin() * (step / 2.0).cos())
        } else {
            // With u = cos(angle) target + sin(angle) outward, the angle is measured from the direction in the middle
            // of the band: its sine is u . m with m across that direction.
            let middle = target * center.cos() + outward * center.sin();
            let m = outward * center.cos() - target * center.sin();
            let along = u.dot(&middle);
            if along > 0.0 { (m, -(t.min(1.5)).sin(), (t.min(1.5)).sin()) } else { (m, -1.0, 1.0) }
        }
    })
}

pub(super) fn any_across(u: &Vector3<f64>) -> Vector3<f64> {
    across(u).0
}

fn across(u: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let least = u.iamin();
    let e1 = u.cross(&Vector3::ith(least, 1.0)).normalize();
    (e1, u.cross(&e1))
}

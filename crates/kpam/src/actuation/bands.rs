//! Approximates axis constraints by linear bounds on a direction that is fixed to the hand.

use std::f64::consts::PI;
use std::sync::LazyLock;

use nalgebra::Vector3;

use crate::resolve::AxisBound;

/// Fraction of the tolerance within which poses are searched, so that rounding never exceeds the tolerance.
pub(super) const INSIDE: f64 = 0.995;
/// Number of sides of the polygon inscribed in the cone of a parallel constraint; it excludes 2 % of the tolerance.
const CONE_SIDES: usize = 16;
/// Sine and cosine of the direction of each side of the polygon.
static SIDES: LazyLock<[(f64, f64); CONE_SIDES]> =
    LazyLock::new(|| std::array::from_fn(|k| (2.0 * PI / CONE_SIDES as f64 * k as f64).sin_cos()));

/// Yields bounds `low <= u . m <= high` on the hand's direction `u` that together approximate an axis constraint.
///
/// For parallel constraints, the permitted directions form a cone around the target, which is replaced by an inscribed
/// polygon. For other constraints, there is one bound along the direction in which the angle changes.
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
    // Unit vector perpendicular to the target, in the plane of the target and u.
    let outward = if sin > 1e-9 { cross.cross(&target) / sin } else { e1 };
    let is_polygon = closed && center + t < std::f64::consts::FRAC_PI_2;
    let apothem = if is_polygon { (center + t).sin() * (PI / CONE_SIDES as f64).cos() } else { 0.0 };
    let sides = &*SIDES;
    (0..if is_polygon { CONE_SIDES } else { 1 }).map(move |k| {
        if is_polygon {
            let (s, c) = sides[k];
            (e1 * c + e2 * s, f64::NEG_INFINITY, apothem)
        } else {
            // With u = cos(angle) target + sin(angle) outward, the angle is measured from the middle of the permitted
            // range: its sine is u . m, with m perpendicular to the middle direction.
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

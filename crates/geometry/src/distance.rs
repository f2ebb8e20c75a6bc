//! Distance or penetration depth of two hulls, computed with parry's GJK and EPA.

use nalgebra::{Isometry3, Point3, Unit, Vector3};
use parry3d_f64::query::epa::EPA;
use parry3d_f64::query::gjk::{self, CSOPoint, GJKResult, VoronoiSimplex};

use crate::Corners;
use crate::corners::FURTHEST;

/// The closest points of two shapes, or the deepest points of their overlap.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// Signed distance (m), negative if the shapes overlap.
    pub distance: f64,
    /// Closest or deepest point of the first shape.
    pub on_first: Point3<f64>,
    /// Closest or deepest point of the second shape.
    pub on_second: Point3<f64>,
    /// Unit direction from the first shape to the second; moving the first shape along it reduces the distance.
    pub normal: Vector3<f64>,
}

/// Returns the signed distance between two rounded hulls in a common frame; `None` if it exceeds `reach`.
///
/// Shapes that cannot be measured (no points, or a number beyond 1e100) count as touching with infinite depth, so that
/// they never pass as collision-free.
///
/// `toward` is a guess of the direction from the first to the second, and is replaced by the direction found. Passing
/// it again after a small motion often proves immediately that the shapes are out of reach. Any vector is valid: the
/// distance does not depend on the guess, while the depth of an overlap may depend on it slightly.
#[must_use]
pub fn signed_distance(
    first: (&Corners, f64),
    second: (&Corners, f64),
    toward: &mut Vector3<f64>,
    reach: f64,
) -> Option<Contact> {
    measured(first, second, toward, reach, Depth::Measured)
}

/// Required accuracy of a penetration depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Depth {
    Measured,
    /// A lower bound suffices: any depth between the requested depth and the true depth.
    AtLeast,
}

/// Like [`signed_distance`], but the reported depth may be smaller than the true depth.
pub(crate) fn measured(
    first: (&Corners, f64),
    second: (&Corners, f64),
    toward: &mut Vector3<f64>,
    reach: f64,
    depth: Depth,
) -> Option<Contact> {
    let (a, b) = (first.0, second.0);
    let rounding = first.1 + second.1;
    if !(a.are_measurable() && b.are_measurable() && rounding.abs() <= FURTHEST && !reach.is_nan()) {
        return Some(UNMEASURABLE);
    }
    let reach = reach.min(FURTHEST);
    let same = Isometry3::identity();
    let direction = Unit::try_new(*toward, 1e-12).unwrap_or(Vector3::x_axis());
    // The extreme points along a direction give a lower bound of the distance or an upper bound of the depth.
    let extreme = CSOPoint::from_shapes(&same, a, b, &direction);
    if -extreme.point.coords.dot(&direction) > reach + rounding {
        return None;
    }
    let least = -reach - rounding;
    let reach = reach.max(0.0);
    let mut simplex = VoronoiSimplex::new();
    simplex.reset(extreme);
    let found = match gjk::closest_points(&same, a, b, reach + rounding, true, &mut simplex) {
        GJKResult::ClosestPoints(p, q, n) => Some((p, q, n.into_inner(), (q - p).norm())),
        // GJK also returns this value when it runs out of iterations. Only a separating direction proves a distance.
        GJKResult::NoIntersection(n) if apart_along(a, b, &n) > reach + rounding => {
            *toward = n.into_inner();
            None
        }
        GJKResult::NoIntersection(_) => Some(undecided(a, b, &direction)).filter(|found| found.3 <= reach + rounding),
        GJKResult::Proximity(_) | GJKResult::Intersection => {
            let shown = if depth == Depth::AtLeast { depth_shown(&simplex) } else { 0.0 };
            if shown > least.max(0.0) {
                Some((a.furthest(&direction), b.furthest(&-direction.into_inner()), direction.into_inner(), -shown))
            } else {
                Some(deepest(a, b, &simplex, &direction))
            }
        }
    };
    let (p, q, normal, core) = found?;
    *toward = normal;
    Some(Contact {
        distance: core - rounding,
        on_first: p + normal * first.1,
        on_second: q - normal * second.1,
        normal,
    })
}

/// Contact returned for shapes that cannot be measured.
const UNMEASURABLE: Contact = Contact {
    distance: f64::NEG_INFINITY,
    on_first: Point3::new(0.0, 0.0, 0.0),
    on_second: Point3::new(0.0, 0.0, 0.0),
    normal: Vector3::new(1.0, 0.0, 0.0),
};

/// Result of a test whether two shapes are at least a requested distance apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Reach {
    /// The shapes are proven to be at least the requested distance apart.
    Beyond,
    /// The shapes are closer than the requested distance, or cannot be measured.
    Within,
}

/// Tests whether two rounded hulls in a common frame are at least `apart` (m) from each other, which is cheaper than
/// measuring their distance. `toward` is a guess of the direction from the first to the second, and is replaced by the
/// direction found.
pub(crate) fn keeps_apart(
    first: (&Corners, f64),
    second: (&Corners, f64),
    toward: &mut Vector3<f64>,
    apart: f64,
) -> Reach {
    let (a, b) = (first.0, second.0);
    let limit = apart + first.1 + second.1;
    if !(a.are_measurable() && b.are_measurable() && limit.abs() <= FURTHEST) {
        return Reach::Within;
    }
    let beyond = |keeps: bool| if keeps { Reach::Beyond } else { Reach::Within };
    if limit < 0.0 {
        let found = signed_distance(first, second, toward, 0.0);
        return beyond(found.is_none_or(|contact| contact.distance >= apart));
    }
    let same = Isometry3::identity();
    let direction = Unit::try_new(*toward, 1e-12).unwrap_or(Vector3::x_axis());
    let extreme = CSOPoint::from_shapes(&same, a, b, &direction);
    if -extreme.point.coords.dot(&direction) >= limit {
        *toward = direction.into_inner();
        return Reach::Beyond;
    }
    let mut simplex = VoronoiSimplex::new();
    simplex.reset(extreme);
    match gjk::closest_points(&same, a, b, limit, false, &mut simplex) {
        GJKResult::ClosestPoints(p, q, n) => {
            *toward = n.into_inner();
            beyond((q - p).norm() >= limit)
        }
        GJKResult::NoIntersection(n) if apart_along(a, b, &n) >= limit => {
            *toward = n.into_inner();
            Reach::Beyond
        }
        GJKResult::NoIntersection(_) => beyond(undecided(a, b, &direction).3 >= limit),
        GJKResult::Proximity(_) | GJKResult::Intersection => Reach::Within,
    }
}

/// Directions that rarely align with faces or edges of man-made objects.
const SKEW: [[f64; 3]; 3] = [[0.267, 0.535, 0.802], [-0.802, 0.267, 0.535], [0.535, -0.802, 0.267]];

/// Returns the separation of two hulls along a unit direction from the first to the second. It is a lower bound of
/// their distance.
fn apart_along(a: &Corners, b: &Corners, direction: &Vector3<f64>) -> f64 {
    (b.furthest(&-direction) - a.furthest(direction)).dot(direction)
}

/// Returns points, normal and signed distance of two hulls after a failed search. The search restarts from other
/// directions; if all of them fail, a proven separation is returned. The result never exceeds the true distance.
fn undecided(
    a: &Corners,
    b: &Corners,
    direction: &Unit<Vector3<f64>>,
) -> (Point3<f64>, Point3<f64>, Vector3<f64>, f64) {
    let same = Isometry3::identity();
    let mut widest = (direction.into_inner(), apart_along(a, b, direction));
    for skew in SKEW {
        let from = Unit::new_normalize(Vector3::from(skew));
        let mut simplex = VoronoiSimplex::new();
        simplex.reset(CSOPoint::from_shapes(&same, a, b, &from));
        match gjk::closest_points(&same, a, b, f64::INFINITY, true, &mut simplex) {
            GJKResult::ClosestPoints(p, q, n) => return (p, q, n.into_inner(), (q - p).norm()),
            GJKResult::Proximity(_) | GJKResult::Intersection => return deepest(a, b, &simplex, direction),
            GJKResult::NoIntersection(_) => {
                for n in [from.into_inner(), -from.into_inner()] {
                    let apart = apart_along(a, b, &n);
                    if apart > widest.1 {
                        widest = (n, apart);
                    }
                }
            }
        }
    }
    let (n, apart) = widest;
    (a.furthest(&n), b.furthest(&-n), n, apart)
}

/// Returns the radius of the sphere about the origin inside a tetrahedron of points of the hulls' Minkowski difference,
/// a lower bound of their depth; zero if the tetrahedron does not contain the origin.
fn depth_shown(simplex: &VoronoiSimplex) -> f64 {
    if simplex.dimension() != 3 {
        return 0.0;
    }
    let corners = [0, 1, 2, 3].map(|k| simplex.point(k).point.coords);
    let outward = |k: usize| {
        let [a, b, c] = [1, 2, 3].map(|i| corners[(k + i) % 4]);
        let normal = (b - a).cross(&(c - a)).try_normalize(0.0)?;
        let (face, apex) = (normal.dot(&a), normal.dot(&corners[k]));
        // If the tetrahedron is flat, its inner side is unknown.
        Some(if apex < face { face } else { -face }).filter(|_| (apex - face).abs() > 1e-9)
    };
    (0..4).map(|k| outward(k).unwrap_or(0.0)).fold(f64::INFINITY, f64::min).max(0.0)
}

/// Returns points, normal and depth (negative) of two overlapping hulls; `simplex` proves the overlap.
///
/// If the simplex is nearly flat, the expansion can end inside the Minkowski difference with too small a depth. A
/// correct depth along the normal separates the hulls when one of them moves by it. If they still overlap, the
/// expansion restarts from skewed directions. If all of these fail, the shortest separating translation found is used.
fn deepest(
    a: &Corners,
    b: &Corners,
    simplex: &VoronoiSimplex,
    direction: &Unit<Vector3<f64>>,
) -> (Point3<f64>, Point3<f64>, Vector3<f64>, f64) {
    const SLACK: f64 = 1e-7;
    let same = Isometry3::identity();
    let parting = |n: &Vector3<f64>| -apart_along(a, b, n);
    let fallback = (a.furthest(direction), b.furthest(&-direction.into_inner()), direction.into_inner());
    let mut best = (fallback, parting(direction));
    let mut look = |simplex: &VoronoiSimplex| {
        let Some((p, q, n)) = EPA::new().closest_points(&same, a, b, simplex) else { return false };
        let (n, way) = (n.into_inner(), parting(&n));
        if way < best.1 {
            best = ((p, q, n), way);
        }
        way <= (p - q).dot(&n) + SLACK
    };
    let mut found = look(simplex);
    for skew in SKEW {
        if found {
            break;
        }
        let mut other = VoronoiSimplex::new();
        other.reset(CSOPoint::from_shapes(&same, a, b, &Unit::new_normalize(Vector3::from(skew))));
        let shown = gjk::closest_points(&same, a, b, f64::INFINITY, true, &mut other);
        found = matches!(shown, GJKResult::Intersection) && look(&other);
    }
    let ((p, q, n), way) = best;
    (p, q, n, -way)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Convex, Pose};
    use proptest::prelude::*;

    fn between(a: &Convex, b: &Convex) -> Contact {
        let (p, q) = (Corners::of(a.points()), Corners::of(b.points()));
        signed_distance((&p, a.radius()), (&q, b.radius()), &mut (b.center() - a.center()), 10.0).unwrap()
    }

    fn cube(half: f64, at: [f64; 3]) -> Convex {
        Convex::cuboid([half; 3], &Pose::translation(at[0], at[1], at[2])).unwrap()
    }

    #[test]
    fn cubes_apart_touching_and_inside() {
        assert!((between(&cube(0.5, [0.0; 3]), &cube(0.5, [1.5, 0.2, 0.0])).distance - 0.5).abs() < 1e-9);
        let c = between(&cube(0.5, [0.0; 3]), &cube(0.5, [0.9, 0.05, 0.02]));
        assert!((c.distance + 0.1).abs() < 1e-6, "{c:?}");
        assert!(c.normal.x > 0.99);
    }

    proptest! {
        #[test]
        fn balls_measure_as_balls(c in prop::array::uniform3(-1.0..1.0f64), r in 0.05..0.5f64, s in 0.05..0.5f64) {
            let center = Point3::from(c);
            prop_assume!(center.coords.norm() > 1e-3);
            let a = Convex::ball(r, Point3::origin()).unwrap();
            let b = Convex::ball(s, center).unwrap();
            let d = between(&a, &b);
            prop_assert!((d.distance - (center.coords.norm() - r - s)).abs() < 1e-9);
        }

        #[test]
        fn distance_changes_along_the_normal(at in prop::array::uniform3(-0.8..0.8f64)) {
            let a = cube(0.2, [0.0; 3]);
            let b = cube(0.1, at);
            let d = between(&a, &b);
            let step = 1e-5;
            let shift = Pose::from(nalgebra::Translation3::from(d.normal * step));
            let e = between(&a.moved(&shift), &b);
            prop_assert!((d.distance - e.distance - step).abs() < 1e-7, "{d:?} {e:?}");
        }
    }

    proptest! {
        #[test]
        fn any_direction_will_do(at in prop::array::uniform3(-0.8..0.8f64), guess in prop::array::uniform3(-1.0..1.0f64)) {
            let (a, b) = (cube(0.2, [0.0; 3]), cube(0.1, at));
            let wanted = between(&a, &b);
            let (p, q) = (Corners::of(a.points()), Corners::of(b.points()));
            let mut toward = Vector3::from(guess);
            // The second round starts from the result of the first.
            for _ in 0..2 {
                let found = signed_distance((&p, 0.0), (&q, 0.0), &mut toward, 0.2);
                prop_assert_eq!(found.is_some(), wanted.distance <= 0.2);
                if let Some(contact) = found {
                    prop_assert!((contact.distance - wanted.distance).abs() < 1e-7, "{contact:?} {wanted:?}");
                }
            }
        }
    }

    proptest! {
        #[test]
        fn whether_two_overlap_deeper_than_this_is_told_without_their_depth(
            at in prop::array::uniform3(-0.4..0.4f64), guess in prop::array::uniform3(-1.0..1.0f64), asked in 0.0..0.3f64,
            round in 0.0..0.05f64,
        ) {
            let (a, b) = (cube(0.2, [0.0; 3]), cube(0.1, at));
            let wanted = between(&a, &b).distance - round;
            prop_assume!((wanted + asked).abs() > 1e-6);
            let (p, q) = (Corners::of(a.points()), Corners::of(b.points()));
            for depth in [Depth::Measured, Depth::AtLeast] {
                let found = measured((&p, round), (&q, 0.0), &mut Vector3::from(guess), -asked, depth);
                let deeper = found.filter(|contact| contact.distance < -asked);
                prop_assert_eq!(deeper.is_some(), wanted < -asked, "{} {:?}", wanted, found);
                prop_assert!(deeper.is_none_or(|contact| contact.distance >= wanted - 1e-7));
            }
        }
    }

    proptest! {
        #[test]
        fn crossing_cylinders_in_one_plane_overlap(
            turn in prop::array::uniform3(-1.5..1.5f64),
            across in 0.3..1.5f64,
            shift in -0.1..0.1f64,
            guess in prop::array::uniform3(-1.0..1.0f64),
        ) {
            // Centres and axes lie in one plane, so the simplex that proves the overlap is flat.
            let plane = Pose::from_parts(Vector3::zeros().into(), nalgebra::Rotation3::new(Vector3::from(turn)));
            let cylinder = |angle: f64, at: f64| {
                let turned = nalgebra::Rotation3::from_axis_angle(&Vector3::x_axis(), angle);
                let place = plane * Pose::from_parts(Vector3::new(0.0, at, 0.0).into(), turned);
                Convex::cylinder(0.03, 0.4, &place).unwrap()
            };
            let (a, b) = (cylinder(0.0, 0.0), cylinder(across, shift * 0.1));
            let (p, q) = (Corners::of(a.points()), Corners::of(b.points()));
            for mut toward in [b.center() - a.center(), Vector3::from(guess)] {
                let found = signed_distance((&p, 0.0), (&q, 0.0), &mut toward, 0.0).unwrap();
                prop_assert!(found.distance < -0.01, "{found:?}");
            }
        }
    }

    #[test]
    fn flat_hulls_are_measured() {
        let flat: Vec<_> = (0..12).map(|i| Point3::new(f64::from(i % 4), f64::from(i / 4), 0.0)).collect();
        let plate = Convex::hull(&flat).unwrap();
        let d = between(&plate, &Convex::ball(0.1, Point3::new(1.0, 1.0, 1.0)).unwrap());
        assert!((d.distance - 0.9).abs() < 1e-9);
    }

    proptest! {
        #[test]
        fn what_is_undecided_is_never_said_to_be_further(
            at in prop::array::uniform3(-0.6..0.6f64), guess in prop::array::uniform3(-1.0..1.0f64),
        ) {
            prop_assume!(Vector3::from(guess).norm() > 1e-3);
            let (a, b) = (cube(0.2, [0.0; 3]), cube(0.1, at));
            let wanted = between(&a, &b).distance;
            let (p, q) = (Corners::of(a.points()), Corners::of(b.points()));
            let (_, _, n, found) = undecided(&p, &q, &Unit::new_normalize(Vector3::from(guess)));
            prop_assert!((found - wanted).abs() < 1e-6, "{found} {wanted}");
            prop_assert!(apart_along(&p, &q, &n) <= wanted + 1e-9);
        }
    }

    #[test]
    fn shapes_that_cannot_be_measured_are_never_apart() {
        let near = Corners::of(cube(0.2, [0.0; 3]).points());
        let far = |x: f64| Corners::of(&[Point3::new(x, 0.0, 0.0), Point3::new(x, 1.0, 0.0), Point3::new(x, 0.0, 1.0)]);
        for other in [far(1e160), far(f64::NAN), far(f64::INFINITY), Corners::of(&[])] {
            let found = signed_distance((&near, 0.0), (&other, 0.0), &mut Vector3::x(), 0.1).unwrap();
            assert!(found.distance == f64::NEG_INFINITY);
            assert_eq!(keeps_apart((&near, 0.0), (&other, 0.0), &mut Vector3::x(), 0.005), Reach::Within);
        }
    }

    #[test]
    fn a_search_that_gives_up_does_not_mean_free() {
        // When the search runs out of iterations, it returns the x axis regardless of the hulls; these hulls overlap
        // along it.
        let (a, b) = (cube(0.2, [0.0; 3]), cube(0.2, [0.1, 0.1, 0.1]));
        let (p, q) = (Corners::of(a.points()), Corners::of(b.points()));
        assert!(apart_along(&p, &q, &Vector3::x()) < 0.0);
        let (.., found) = undecided(&p, &q, &Vector3::x_axis());
        assert!((found + 0.3).abs() < 1e-6, "{found}");
    }
}

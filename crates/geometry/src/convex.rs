//! One kind of shape: the convex hull of points, rounded by a radius.
//!
//! Boxes, spheres, capsules, hulls, triangles and cloud points are all that, so there is one distance query instead
//! of a table of pairs. Distances come from parry's GJK, depths from its EPA.

use nalgebra::{Isometry3, Point3, Unit, Vector3};
use parry3d_f64::query::epa::EPA;
use parry3d_f64::query::gjk::{self, CSOPoint, GJKResult, VoronoiSimplex};
use parry3d_f64::shape::SupportMap;
use serde::{Deserialize, Serialize};

use crate::{Aabb, Pose, ShapeError};

/// Sides of the prism that stands for a cylinder. It is drawn around the circle: 0.5 % wider at the corners, never
/// narrower.
const CYLINDER_SIDES: usize = 32;

/// Convex hull of points, grown by a radius.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Convex {
    points: Vec<Point3<f64>>,
    radius: f64,
    center: Point3<f64>,
    half: Vector3<f64>,
    bound: f64,
}

impl Convex {
    /// Hull of points (m), grown by `radius` (m, at least 0).
    ///
    /// # Errors
    /// No points, or a number that is not finite.
    pub fn rounded_hull(points: &[Point3<f64>], radius: f64) -> Result<Self, ShapeError> {
        if points.is_empty() {
            return Err(ShapeError::new("points", "a hull needs at least one point"));
        }
        if let Some(i) = points.iter().position(|p| p.iter().any(|c| !c.is_finite())) {
            return Err(ShapeError::new(format!("points[{i}]"), "is not finite"));
        }
        if !(radius.is_finite() && radius >= 0.0) {
            return Err(ShapeError::new("radius", format!("must be finite and not negative, not {radius}")));
        }
        let points = extreme_points(points);
        let low = points.iter().fold(points[0], |a, p| a.inf(p));
        let high = points.iter().fold(points[0], |a, p| a.sup(p));
        let center = nalgebra::center(&low, &high);
        let bound = points.iter().map(|p| (p - center).norm()).fold(0.0, f64::max) + radius;
        if !bound.is_finite() {
            return Err(ShapeError::new("points", "are too far apart to measure"));
        }
        Ok(Self { points, radius, center, half: (high - low) * 0.5, bound })
    }

    /// Hull of points (m).
    ///
    /// # Errors
    /// No points, or a number that is not finite.
    pub fn hull(points: &[Point3<f64>]) -> Result<Self, ShapeError> {
        Self::rounded_hull(points, 0.0)
    }

    /// Box with half extents (m) at a pose.
    ///
    /// # Errors
    /// A half extent that is not positive and finite.
    pub fn cuboid(half: [f64; 3], pose: &Pose) -> Result<Self, ShapeError> {
        positive("half_extents", &half)?;
        let corner = |i: usize| {
            let sign = |bit: usize| if i & bit == 0 { -1.0 } else { 1.0 };
            pose * Point3::new(sign(1) * half[0], sign(2) * half[1], sign(4) * half[2])
        };
        Self::hull(&(0..8).map(corner).collect::<Vec<_>>())
    }

    /// Ball.
    ///
    /// # Errors
    /// A radius that is not positive and finite.
    pub fn ball(radius: f64, center: Point3<f64>) -> Result<Self, ShapeError> {
        positive("radius", &[radius])?;
        Self::rounded_hull(&[center], radius)
    }

    /// Capsule along z of the pose, `length` between the centres of its caps.
    ///
    /// # Errors
    /// A radius or length that is not positive and finite.
    pub fn capsule(radius: f64, length: f64, pose: &Pose) -> Result<Self, ShapeError> {
        positive("radius and length", &[radius, length])?;
        let end = |z: f64| pose * Point3::new(0.0, 0.0, z);
        Self::rounded_hull(&[end(-length / 2.0), end(length / 2.0)], radius)
    }

    /// Cylinder along z of the pose, as a prism around it.
    ///
    /// # Errors
    /// A radius or length that is not positive and finite.
    pub fn cylinder(radius: f64, length: f64, pose: &Pose) -> Result<Self, ShapeError> {
        positive("radius and length", &[radius, length])?;
        let step = std::f64::consts::TAU / CYLINDER_SIDES as f64;
        let outer = radius / (step / 2.0).cos();
        let mut points = Vec::with_capacity(2 * CYLINDER_SIDES);
        for i in 0..CYLINDER_SIDES {
            let (s, c) = (step * i as f64).sin_cos();
            for z in [-length / 2.0, length / 2.0] {
                points.push(pose * Point3::new(outer * c, outer * s, z));
            }
        }
        Self::hull(&points)
    }

    /// Corners of the hull, in the shape's frame.
    #[must_use]
    pub fn points(&self) -> &[Point3<f64>] {
        &self.points
    }

    /// Rounding radius (m).
    #[must_use]
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// Centre of a ball around the shape.
    #[must_use]
    pub fn center(&self) -> &Point3<f64> {
        &self.center
    }

    /// Radius of that ball (m), rounding included.
    #[must_use]
    pub fn bound(&self) -> f64 {
        self.bound
    }

    /// Box around the shape moved by a pose, from the moved box of the shape.
    #[must_use]
    pub fn aabb_at(&self, pose: &Pose) -> Aabb {
        let center = pose * self.center;
        let reach = pose.rotation.matrix().abs() * self.half + Vector3::repeat(self.radius);
        Aabb { min: center - reach, max: center + reach }
    }

    /// The corners moved by a pose, written into `out`.
    pub fn corners_at(&self, pose: &Pose, out: &mut Corners) {
        out.place(&self.points, pose);
    }

    /// The shape moved by a pose.
    #[must_use]
    pub fn moved(&self, pose: &Pose) -> Self {
        let points: Vec<Point3<f64>> = self.points.iter().map(|p| pose * p).collect();
        let tight = Aabb::around(&points, 0.0);
        Self {
            center: pose * self.center,
            half: pose.rotation.matrix().abs() * self.half,
            bound: self.bound,
            radius: self.radius,
            points,
        }
        .with_box(&tight)
    }

    fn with_box(mut self, tight: &Aabb) -> Self {
        self.center = nalgebra::center(&tight.min, &tight.max);
        self.half = (tight.max - tight.min) * 0.5;
        self.bound = self.points.iter().map(|p| (p - self.center).norm()).fold(0.0, f64::max) + self.radius;
        self
    }
}

fn positive(field: &str, values: &[f64]) -> Result<(), ShapeError> {
    match values.iter().find(|v| !(v.is_finite() && **v > 0.0)) {
        Some(v) => Err(ShapeError::new(field, format!("must be positive and finite, not {v}"))),
        None => Ok(()),
    }
}

/// Drops what lies inside the hull. Flat sets keep all their points: a support map needs no volume.
fn extreme_points(points: &[Point3<f64>]) -> Vec<Point3<f64>> {
    let mut unique: Vec<Point3<f64>> = points.to_vec();
    unique.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z)));
    unique.dedup();
    if unique.len() <= 8 {
        return unique;
    }
    match parry3d_f64::transformation::try_convex_hull(&unique) {
        Ok((vertices, _)) if vertices.len() >= 4 => vertices,
        _ => unique,
    }
}

/// The nearest, or deepest, points of two shapes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// Signed distance (m): negative where the shapes overlap.
    pub distance: f64,
    /// Point on the first shape.
    pub on_first: Point3<f64>,
    /// Point on the second shape.
    pub on_second: Point3<f64>,
    /// Unit direction from the first shape to the second: moving the first along it shortens the distance.
    pub normal: Vector3<f64>,
}

/// Coordinates up to this can be squared and added up.
const FURTHEST: f64 = 1e100;

/// Corners that are looked at in one go.
const LANES: usize = 4;

/// Corners of a hull, coordinate by coordinate: looking for the furthest one is what most time goes into, and this way
/// the compiler can look at several at once.
#[derive(Debug, Clone, Default)]
pub struct Corners {
    /// Blocks of x, y and z; the last one is filled up with copies of its first corner.
    blocks: Vec<[[f64; LANES]; 3]>,
    /// Whether a coordinate is not finite, or so large that its square is not.
    unbounded: bool,
}

impl Corners {
    /// The corners of points.
    #[must_use]
    pub fn of(points: &[Point3<f64>]) -> Self {
        let mut corners = Self::default();
        corners.place(points, &Pose::identity());
        corners
    }

    /// Replaces the corners by points moved by a pose.
    pub fn place(&mut self, points: &[Point3<f64>], pose: &Pose) {
        self.blocks.clear();
        // A sum keeps what is not finite, and needs no branch.
        let mut total = [0.0; LANES];
        let (r, t) = (pose.rotation.matrix(), &pose.translation.vector);
        for chunk in points.chunks(LANES) {
            let mut block = [[0.0; LANES]; 3];
            for lane in 0..LANES {
                let p = chunk.get(lane).unwrap_or(&chunk[0]);
                let moved = r * p.coords + t;
                for k in 0..3 {
                    block[k][lane] = moved[k];
                }
            }
            for lane in 0..LANES {
                total[lane] += block[0][lane].abs() + block[1][lane].abs() + block[2][lane].abs();
            }
            self.blocks.push(block);
        }
        self.unbounded = total.iter().any(|t| t.is_nan() || *t > FURTHEST);
    }

    /// The corner furthest along `direction`; the first of several.
    fn furthest(&self, direction: &Vector3<f64>) -> Point3<f64> {
        let mut best = [f64::NEG_INFINITY; LANES];
        let mut at = [0usize; LANES];
        for (index, [x, y, z]) in self.blocks.iter().enumerate() {
            for lane in 0..LANES {
                let value = x[lane] * direction.x + y[lane] * direction.y + z[lane] * direction.z;
                let further = value > best[lane];
                best[lane] = if further { value } else { best[lane] };
                at[lane] = if further { index } else { at[lane] };
            }
        }
        let mut lane = 0;
        for other in 1..LANES {
            if best[other] > best[lane] || (best[other] == best[lane] && at[other] < at[lane]) {
                lane = other;
            }
        }
        let [x, y, z] = &self.blocks[at[lane]];
        Point3::new(x[lane], y[lane], z[lane])
    }
}

impl SupportMap for Corners {
    fn local_support_point(&self, dir: &Vector3<f64>) -> Point3<f64> {
        self.furthest(dir)
    }
}

/// Signed distance between two rounded hulls whose points are in one frame; `None` where it exceeds `reach`, or one
/// of them has no points, or a number beyond 1e100.
///
/// `toward` is a guess of the direction from the first to the second; it is replaced by what was found. Handed in again
/// after a small motion, it often shows at once that the two are out of reach. Any vector will do: whether and how far
/// the two are apart does not depend on it, the depth of an overlap may a little.
#[must_use]
pub fn signed_distance(
    first: (&Corners, f64),
    second: (&Corners, f64),
    toward: &mut Vector3<f64>,
    reach: f64,
) -> Option<Contact> {
    let (a, b) = (first.0, second.0);
    let rounding = first.1 + second.1;
    let measurable = |corners: &Corners| !corners.blocks.is_empty() && !corners.unbounded;
    if !(measurable(a) && measurable(b) && rounding.abs() <= FURTHEST && !reach.is_nan()) {
        return None;
    }
    let reach = reach.min(FURTHEST);
    let same = Isometry3::identity();
    let direction = Unit::try_new(*toward, 1e-12).unwrap_or(Vector3::x_axis());
    // Their ends along any direction tell how far apart they are at least.
    let extreme = CSOPoint::from_shapes(&same, a, b, &direction);
    if -extreme.point.coords.dot(&direction) > reach + rounding {
        return None;
    }
    let mut simplex = VoronoiSimplex::new();
    simplex.reset(extreme);
    let found = match gjk::closest_points(&same, a, b, reach + rounding, true, &mut simplex) {
        GJKResult::ClosestPoints(p, q, n) => Some((p, q, n.into_inner(), (q - p).norm())),
        // The search says the x axis where it ran out of rounds, which proves nothing.
        GJKResult::NoIntersection(n) if n != Vector3::x_axis() || apart_along(a, b, &n) > reach + rounding => {
            *toward = n.into_inner();
            None
        }
        GJKResult::NoIntersection(_) => Some(undecided(a, b, &direction)),
        GJKResult::Proximity(_) | GJKResult::Intersection => Some(deepest(a, b, &simplex, &direction)),
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

/// Directions along which nothing man-made lies.
const SKEW: [[f64; 3]; 3] = [[0.267, 0.535, 0.802], [-0.802, 0.267, 0.535], [0.535, -0.802, 0.267]];

/// How far two hulls are apart along a unit direction from the first to the second: never more than their distance.
fn apart_along(a: &Corners, b: &Corners, direction: &Vector3<f64>) -> f64 {
    (b.furthest(&-direction) - a.furthest(direction)).dot(direction)
}

/// Points, normal and signed distance of two hulls whose distance the search has not found: it is begun anew from other
/// directions, and failing all of them, what is known to part the hulls stands in for their distance. They are never
/// said to be further apart than they are.
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

/// Points, normal and depth (negative) of two overlapping hulls; `simplex` is what shows that they overlap.
///
/// Where that is flat or nearly so, the expansion can end inside, with too little depth or none. Moving one hull by the
/// depth along the normal must part them; where it does not, the expansion starts anew from directions along which
/// nothing man-made lies. Failing all, the shortest of those ways that part them is taken.
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
            // Twice: the second time from what the first has found.
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
        fn crossing_cylinders_in_one_plane_overlap(
            turn in prop::array::uniform3(-1.5..1.5f64),
            across in 0.3..1.5f64,
            shift in -0.1..0.1f64,
            guess in prop::array::uniform3(-1.0..1.0f64),
        ) {
            // Their centres and axes lie in one plane: what shows that they overlap is flat.
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
    fn degenerate_input_is_refused_or_measured() {
        assert!(Convex::hull(&[]).is_err());
        assert!(Convex::hull(&[Point3::new(f64::NAN, 0.0, 0.0)]).is_err());
        assert!(Convex::ball(0.0, Point3::origin()).is_err());
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
    fn a_search_that_gives_up_does_not_mean_free() {
        // What the search answers where it runs out of rounds is the x axis, whatever the hulls: along it these overlap.
        let (a, b) = (cube(0.2, [0.0; 3]), cube(0.2, [0.1, 0.1, 0.1]));
        let (p, q) = (Corners::of(a.points()), Corners::of(b.points()));
        assert!(apart_along(&p, &q, &Vector3::x()) < 0.0);
        let (.., found) = undecided(&p, &q, &Vector3::x_axis());
        assert!((found + 0.3).abs() < 1e-6, "{found}");
    }
}

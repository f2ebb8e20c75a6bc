//! The surface of a convex shape as triangles.

use nalgebra::{Point3, Vector3};

use crate::Convex;

/// Number of points on the rounding sphere of each vertex that approximate a rounded hull.
const ROUNDING: usize = 128;
/// Factor on the radius. With it, the polytope extends beyond the true surface as far as it lies inside.
const OUTWARDS: f64 = 1.01;
/// Thickness (m) below which a hull has no interior.
const FLAT: f64 = 1e-7;

impl Convex {
    /// Returns the triangles of the surface (m, shape frame), with vertices counter-clockwise seen from outside.
    ///
    /// A single triangle is returned as is, in no particular orientation; any other flat set has no interior and gives
    /// no triangles. A rounded hull is approximated by a polytope within 2 % of the radius.
    #[must_use]
    pub fn triangles(&self) -> Vec<[Point3<f64>; 3]> {
        if let ([a, b, c], true) = (self.points(), self.radius() <= 0.0) {
            return vec![[*a, *b, *c]];
        }
        if self.radius() > 0.0 {
            return Self::hull(&self.grown_corners()).map_or_else(|_| Vec::new(), |grown| grown.triangles());
        }
        let points = self.points();
        let middle = points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points.len() as f64;
        let mut out = Vec::new();
        for [a, b, c] in self.faces() {
            let Some(normal) = (b - a).cross(&(c - a)).try_normalize(1e-16) else { continue };
            let height = normal.dot(&(a.coords - middle));
            if height.abs() < FLAT {
                return Vec::new();
            }
            out.push(if height > 0.0 { [a, b, c] } else { [a, c, b] });
        }
        out
    }

    /// Like [`Convex::triangles`], but for display: a flat set gives its polygon seen from both sides; collinear points
    /// give nothing.
    #[must_use]
    pub fn surface(&self) -> Vec<[Point3<f64>; 3]> {
        let solid = self.triangles();
        if solid.is_empty() { flat(self.points()) } else { solid }
    }

    /// Returns points on the rounding sphere around each vertex.
    fn grown_corners(&self) -> Vec<Point3<f64>> {
        let golden = std::f64::consts::PI * (1.0 + 5f64.sqrt());
        let directions: Vec<Vector3<f64>> = (0..ROUNDING)
            .map(|i| {
                let step = i as f64 + 0.5;
                let z = 1.0 - 2.0 * step / ROUNDING as f64;
                let (sin, cos) = (golden * step).sin_cos();
                let r = (1.0 - z * z).sqrt();
                Vector3::new(r * cos, r * sin, z)
            })
            .collect();
        self.points().iter().flat_map(|p| directions.iter().map(move |d| p + d * (OUTWARDS * self.radius()))).collect()
    }
}

/// Returns triangles of the convex polygon around coplanar points; none if they are collinear.
fn flat(points: &[Point3<f64>]) -> Vec<[Point3<f64>; 3]> {
    let farthest = |from: &Point3<f64>| points.iter().max_by(|a, b| (*a - from).norm().total_cmp(&(*b - from).norm()));
    let Some(a) = points.first().and_then(farthest) else { return Vec::new() };
    let Some(along) = farthest(a).and_then(|b| (b - a).try_normalize(FLAT)) else { return Vec::new() };
    let off = |p: &Point3<f64>| (p - a) - along * along.dot(&(p - a));
    let widest = points.iter().map(off).max_by(|v, w| v.norm().total_cmp(&w.norm()));
    let Some(across) = widest.and_then(|w| w.try_normalize(FLAT)) else { return Vec::new() };
    // Andrew's monotone chain algorithm: first the lower side of the hull, then the upper side in reverse.
    let mut sorted: Vec<(f64, f64, Point3<f64>)> =
        points.iter().map(|p| (along.dot(&(p - a)), across.dot(&(p - a)), *p)).collect();
    sorted.sort_by(|p, q| p.0.total_cmp(&q.0).then(p.1.total_cmp(&q.1)));
    let mut ring: Vec<(f64, f64, Point3<f64>)> = Vec::with_capacity(points.len() + 1);
    for side in [sorted.iter().collect::<Vec<_>>(), sorted.iter().rev().collect()] {
        let start = ring.len();
        for p in side {
            while let [.., q, r] = &ring[start..]
                && (r.0 - q.0) * (p.1 - q.1) <= (r.1 - q.1) * (p.0 - q.0)
            {
                ring.pop();
            }
            ring.push(*p);
        }
        ring.pop();
    }
    let [first, rest @ ..] = ring.as_slice() else { return Vec::new() };
    rest.windows(2).map(|pair| [first.2, pair[0].2, pair[1].2]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Pose;

    fn area_and_volume(shape: &Convex) -> (f64, f64) {
        shape.triangles().iter().fold((0.0, 0.0), |(area, volume), [a, b, c]| {
            let cross = (b - a).cross(&(c - a));
            (area + 0.5 * cross.norm(), volume + a.coords.dot(&cross) / 6.0)
        })
    }

    #[test]
    fn triangles_close_the_surface_and_face_outwards() {
        let cuboid = Convex::cuboid([0.1, 0.2, 0.3], &Pose::translation(0.4, -0.1, 0.2)).unwrap();
        let (area, volume) = area_and_volume(&cuboid);
        assert!((area - 0.88).abs() < 1e-9 && (volume - 0.048).abs() < 1e-9, "{area} {volume}");
        let ball = Convex::ball(0.1, Point3::new(0.5, 0.0, 0.0)).unwrap();
        for [a, b, c] in ball.triangles() {
            let normal = (b - a).cross(&(c - a)).normalize();
            let height = normal.dot(&(a - ball.center()));
            assert!((0.098..0.1011).contains(&height), "{height}");
        }
        let (_, volume) = area_and_volume(&ball);
        let whole = 4.0 / 3.0 * std::f64::consts::PI * 1e-3;
        assert!((volume / whole - 1.0).abs() < 0.03, "{volume} {whole}");
    }

    #[test]
    fn flat_sets_give_their_polygon() {
        let tilt = Pose::rotation(Vector3::new(0.3, -0.2, 0.5));
        let grid = |n: i32| -> Vec<_> {
            (0..n * n).map(|i| tilt * Point3::new(0.2 * f64::from(i % n), 0.1 * f64::from(i / n), 0.0)).collect()
        };
        for n in [2, 3, 5] {
            let flat = Convex::hull(&grid(n)).unwrap();
            assert!(flat.triangles().is_empty());
            let area: f64 = flat.surface().iter().map(|[a, b, c]| 0.5 * (b - a).cross(&(c - a)).norm()).sum();
            let side = f64::from(n - 1);
            assert!((area - 0.02 * side * side).abs() < 1e-9, "{n}: {area}");
        }
        assert_eq!(Convex::hull(&grid(2)[..3]).unwrap().surface().len(), 1);
        let line: Vec<_> = (0..4).map(|i| Point3::new(f64::from(i), 2.0 * f64::from(i), 0.0)).collect();
        assert!(Convex::hull(&line).unwrap().surface().is_empty());
        assert!(Convex::hull(&line[..1]).unwrap().surface().is_empty());
    }
}

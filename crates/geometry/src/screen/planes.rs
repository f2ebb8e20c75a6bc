//! Lower bounds of distances from the gap between two parallel planes that separate two bodies.

use nalgebra::{Point3, Vector3};

use super::posing::Frames;
use super::solid::{Points, ROUNDING};
use super::{Batch, LANES, Other, Screen};
use crate::lanes::{F32x8, Wide, wide};

impl Screen {
    /// Returns the gap (m) between a group and another body along a direction, in each lane: a lower bound of their
    /// distance, negative if planes perpendicular to the direction do not separate them. `None` for point clouds, which
    /// are not convex.
    ///
    /// The unit vector `normal` points from the group to the other body. It is given in the frame of the link `frame`,
    /// or in the base frame if that is `None`.
    #[must_use]
    pub fn gap_along(
        &self,
        batch: &Batch,
        (group, other): (usize, Other),
        normal: &Vector3<f64>,
        frame: Option<usize>,
    ) -> Option<[f32; LANES]> {
        struct Work<'a> {
            screen: &'a Screen,
            batch: &'a Batch,
            group: usize,
            other: Other,
            normal: [f32; 3],
            frame: Option<usize>,
        }
        impl Wide for Work<'_> {
            type Output = [f32; LANES];
            #[inline(always)]
            fn run(self) -> [f32; LANES] {
                self.screen.apart_along(self.batch, self.group, self.other, &self.normal, self.frame).to_array()
            }
        }
        if matches!(other, Other::Cloud(_)) {
            return None;
        }
        let normal = [normal.x as f32, normal.y as f32, normal.z as f32];
        Some(wide(Work { screen: self, batch, group, other, normal, frame }))
    }

    #[inline(always)]
    fn apart_along(&self, batch: &Batch, group: usize, other: Other, normal: &[f32; 3], frame: Option<usize>) -> F32x8 {
        let along = match frame {
            Some(link) => batch.frames[link].direction(normal),
            None => [F32x8::splat(normal[0]), F32x8::splat(normal[1]), F32x8::splat(normal[2])],
        };
        let first = self.furthest(batch, group, &along) + F32x8::splat(self.slack);
        let back = [-along[0], -along[1], -along[2]];
        let second = match other {
            Other::Pair(pair) => self.furthest(batch, self.pairs[pair].1, &back) + F32x8::splat(self.slack),
            Other::Element(e) => {
                let (points, radius) = self.measure.element(e);
                let size = points.iter().map(|p| p.coords.amax()).fold(1.0, f64::max);
                support(points, radius + 10.0 * ROUNDING * size, &back)
            }
            Other::Cloud(_) => F32x8::splat(f32::MAX),
        };
        -first - second
    }

    /// Returns how far the shapes of a group reach along a direction of the base frame.
    #[inline(always)]
    fn furthest(&self, batch: &Batch, group: usize, along: &Points) -> F32x8 {
        let (link, shapes) = self.measure.shapes_of(group);
        let frame: &Frames = &batch.frames[link];
        let (r, t) = (&frame.r, &frame.t);
        let here = [
            r[0][0] * along[0] + r[1][0] * along[1] + r[2][0] * along[2],
            r[0][1] * along[0] + r[1][1] * along[1] + r[2][1] * along[2],
            r[0][2] * along[0] + r[1][2] * along[1] + r[2][2] * along[2],
        ];
        let mut most = F32x8::splat(f32::MIN);
        for (points, radius) in shapes {
            most = most.max(support(points, radius, &here));
        }
        most + t[0] * along[0] + t[1] * along[1] + t[2] * along[2]
    }
}

/// Returns how far a rounded hull reaches along eight directions.
#[inline(always)]
fn support(points: &[Point3<f64>], radius: f64, along: &Points) -> F32x8 {
    let mut most = F32x8::splat(f32::MIN);
    for p in points {
        most = most.max(along[0] * p.x as f32 + along[1] * p.y as f32 + along[2] * p.z as f32);
    }
    most + F32x8::splat(radius as f32)
}

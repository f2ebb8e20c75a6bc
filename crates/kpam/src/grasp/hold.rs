//! Contacts of two closing pads, found along a regular grid of lines from one pad's face to the other's.

use gensim2_geometry::Pose;
use nalgebra::{Point3, Vector3};

use super::surface::{Span, Surface};

/// Number of lines in the grid, across and along the fingers.
const LINES: [usize; 2] = [3, 11];
/// Material within this distance of the first contact (m) also counts as touched, because pads and objects are slightly
/// soft.
const GIVE: f64 = 5e-4;

/// Contact between one pad and the object.
#[derive(Debug, Clone, Copy)]
pub(super) struct Patch {
    /// Fraction of the pad's area in contact, 0..1.
    pub share: f64,
    /// Centre of the contact points, object frame (m).
    pub center: Point3<f64>,
    /// Mean outward normal of the object at the contact, object frame.
    pub normal: Vector3<f64>,
}

/// Contacts of an object between closed pads.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hold {
    /// Distance between the pads (m).
    pub width: f64,
    /// Midpoint between the pads as a position on the closing axis (m), measured from the grip frame's origin.
    pub offset: f64,
    /// Contact of the pad on the negative side of the closing axis, then of the pad on the positive side.
    pub patches: [Patch; 2],
    /// Unit direction (object frame) along which the pads press on each other through the object: the closing axis if
    /// the contacts are opposite each other, otherwise the line between the centres of both contacts.
    pub press: Vector3<f64>,
}

/// Travel of a pad until contact, the contact point, and the normal at this point.
type Touch = (f64, Point3<f64>, Vector3<f64>);

/// Buffers that are reused between grasps.
#[derive(Default)]
pub(super) struct Lines {
    spans: Vec<Span>,
    /// Contacts on the lines that meet material, for each of both pads.
    touched: [Vec<Touch>; 2],
}

impl Lines {
    /// Returns the contacts of pads with half extents `pad` that close from `opening` in the grip frame `grip` (object
    /// frame); `None` if nothing is between them, or if material overlaps the open pads.
    pub fn hold(&mut self, surface: &Surface, grip: &Pose, pad: [f64; 2], opening: f64) -> Option<Hold> {
        let half = 0.5 * opening;
        let direction = grip.rotation * Vector3::x();
        self.touched[0].clear();
        self.touched[1].clear();
        for i in 0..LINES[0] {
            for k in 0..LINES[1] {
                let at = |index: usize, count: usize| (2 * index + 1) as f64 / count as f64 - 1.0;
                let from = grip * Point3::new(0.0, pad[0] * at(i, LINES[0]), pad[1] * at(k, LINES[1]));
                surface.spans(&from, &direction, &mut self.spans);
                let inside = |s: &&Span| s.exit > -half && s.enter < half;
                let (Some(first), Some(last)) = (self.spans.iter().find(inside), self.spans.iter().rev().find(inside))
                else {
                    continue;
                };
                if first.enter <= -half || last.exit >= half {
                    return None;
                }
                self.touched[0].push((first.enter, from + direction * first.enter, first.enter_normal));
                self.touched[1].push((-last.exit, from + direction * last.exit, last.exit_normal));
            }
        }
        let low = self.touched[0].iter().map(|t| t.0).fold(f64::INFINITY, f64::min);
        let high = -self.touched[1].iter().map(|t| t.0).fold(f64::INFINITY, f64::min);
        if low >= high {
            return None;
        }
        let patches = [patch(&self.touched[0], low)?, patch(&self.touched[1], -high)?];
        let both = |(a, b): (&Touch, &Touch)| a.0 <= low + GIVE && b.0 <= -high + GIVE;
        let press = if self.touched[0].iter().zip(&self.touched[1]).any(both) {
            direction
        } else {
            (patches[1].center - patches[0].center).try_normalize(1e-9)?
        };
        Some(Hold { width: high - low, offset: 0.5 * (low + high), patches, press })
    }
}

fn patch(touched: &[Touch], first: f64) -> Option<Patch> {
    let (mut count, mut center, mut normal) = (0.0, Vector3::zeros(), Vector3::zeros());
    for (_, point, n) in touched.iter().filter(|t| t.0 <= first + GIVE) {
        count += 1.0;
        center += point.coords;
        normal += n;
    }
    let share = count / (LINES[0] * LINES[1]) as f64;
    Some(Patch { share, center: Point3::from(center / count), normal: normal.try_normalize(1e-9)? })
}

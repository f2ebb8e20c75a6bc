//! Contacts of two closing pads: seen by lines between them, spread evenly over their faces.

use gensim2_geometry::Pose;
use nalgebra::{Point3, Vector3};

use super::surface::{Span, Surface};

/// Lines across the fingers and along them.
const LINES: [usize; 2] = [3, 11];
/// Matter within this of the first touched counts as touched (m): pads and objects give a little.
const GIVE: f64 = 5e-4;

/// Contact of one pad.
#[derive(Debug, Clone, Copy)]
pub(super) struct Patch {
    /// Part of the pad that touches, 0..1.
    pub share: f64,
    /// Middle of the touched places, object frame (m).
    pub center: Point3<f64>,
    /// Mean outward normal of the object there, object frame.
    pub normal: Vector3<f64>,
}

/// Hold of an object between closed pads.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hold {
    /// Distance of the pads (m).
    pub width: f64,
    /// Middle between them, from the grip frame's origin along the closing axis (m).
    pub offset: f64,
    /// On the negative side of the closing axis, and on the positive one.
    pub patches: [Patch; 2],
    /// Unit direction along which the pads press on each other through the object, object frame: the closing axis where
    /// they touch opposite places, or else from the middle of the one patch to that of the other.
    pub press: Vector3<f64>,
}

/// Travel of a pad when it touches, the contact point, and the normal there.
type Touch = (f64, Point3<f64>, Vector3<f64>);

/// Memory reused between holds.
#[derive(Default)]
pub(super) struct Lines {
    spans: Vec<Span>,
    /// Of each line that meets matter, on both sides.
    touched: [Vec<Touch>; 2],
}

impl Lines {
    /// Contacts of pads of half extents `pad` that close from `opening` in the grip frame `grip` (object frame); `None`
    /// where there is nothing between them, or matter where they are when open.
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

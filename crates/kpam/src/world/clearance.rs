//! Clearances and their gradients, used by the optimization.

use gensim2_geometry::{JointKind, Proximity, Target};
use nalgebra::{Point3, Vector3};

use super::{Margins, MotionSegment, State, World};
use crate::model::{MAX_JOINTS, Row};

/// Distance of a checked pair minus its margin (m), and its gradient by each variable (m per rad or m).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Clearance {
    pub gap: f64,
    pub gradient: Row,
}

impl World<'_> {
    /// Appends to `out` the checked pairs whose distance is less than their margin plus `reach` (m).
    pub fn clearances(
        &mut self,
        state: State<'_>,
        segment: MotionSegment,
        margins: &Margins,
        reach: f64,
        out: &mut Vec<Clearance>,
    ) {
        let near = self.near(state, segment, |world, group, seen| world.asked(segment, margins, group, seen) + reach);
        for (seen, p) in near {
            let gap = p.contact.distance - self.asked(segment, margins, p.group, seen);
            // The normal points from the first body to the second: moving the first body along it reduces the distance.
            let mut gradient = [0.0; MAX_JOINTS];
            self.add_motion(segment, p.group, &p.contact.on_first, &-p.contact.normal, &mut gradient);
            if let Target::Group(other) = p.target {
                self.add_motion(segment, other, &p.contact.on_second, &p.contact.normal, &mut gradient);
            }
            out.push(Clearance { gap, gradient });
        }
    }

    /// Returns the largest amount (m) by which a checked pair violates its margin, or zero.
    pub fn lacking(&mut self, state: State<'_>, segment: MotionSegment, margins: &Margins) -> f64 {
        let near = self.near(state, segment, |world, group, seen| world.asked(segment, margins, group, seen));
        let lacks = |(seen, p): &(_, Proximity)| self.asked(segment, margins, p.group, *seen) - p.contact.distance;
        near.iter().map(lacks).fold(0.0, f64::max)
    }

    /// Adds the velocity of a group's point along `direction` per unit of each variable.
    fn add_motion(
        &self,
        segment: MotionSegment,
        group: usize,
        point: &Point3<f64>,
        direction: &Vector3<f64>,
        gradient: &mut Row,
    ) {
        let poses = self.scratch.poses();
        let robot = &self.problem.robot;
        for (joint, carries) in self.movers.iter().zip(self.table(segment).carried.row(group)) {
            if !carries {
                continue;
            }
            let frame = &poses[joint.link];
            let kind = &robot.joints()[joint.joint];
            let axis = frame.rotation * kind.axis();
            let velocity = match kind.kind() {
                JointKind::Prismatic => axis,
                JointKind::Revolute => axis.cross(&(point.coords - frame.translation.vector)),
            };
            gradient[joint.variable] += joint.factor * direction.dot(&velocity);
        }
    }
}

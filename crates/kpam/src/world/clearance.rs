//! Clearances and how they change with the joints: what an optimizer needs to know of the world.

use gensim2_geometry::{JointKind, Target};
use nalgebra::{Point3, Vector3};

use super::{EXACT, Margins, MotionSegment, State, World};
use crate::model::{MAX_JOINTS, Row};

/// Slack of a checked pair beyond its margin (m), and its gradient by each variable (m per rad or m).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Clearance {
    pub gap: f64,
    pub gradient: Row,
}

impl World<'_> {
    /// Checked pairs that have less than `reach` (m) left of what `margins` ask for, appended to `out`.
    pub fn clearances(
        &mut self,
        state: State<'_>,
        segment: MotionSegment,
        margins: &Margins,
        reach: f64,
        out: &mut Vec<Clearance>,
    ) {
        self.place(state, segment);
        let mut near = Vec::new();
        self.look(
            segment,
            EXACT,
            |world, group, seen| world.asked(segment, margins, group, seen) + reach,
            |world, seen, p| {
                near.push((p.contact.distance - world.asked(segment, margins, p.group, seen), *p));
                true
            },
        );
        for (gap, p) in near {
            // The normal points from the first to the second: moving the first along it shortens the distance.
            let mut gradient = [0.0; MAX_JOINTS];
            self.add_motion(segment, p.group, &p.contact.on_first, &-p.contact.normal, &mut gradient);
            if let Target::Group(other) = p.target {
                self.add_motion(segment, other, &p.contact.on_second, &p.contact.normal, &mut gradient);
            }
            out.push(Clearance { gap, gradient });
        }
    }

    /// The most that a checked pair lacks of what `margins` ask for (m), zero where none lacks anything.
    pub fn lacking(&mut self, state: State<'_>, segment: MotionSegment, margins: &Margins) -> f64 {
        self.place(state, segment);
        let mut most = 0.0f64;
        self.look(
            segment,
            EXACT,
            |world, group, seen| world.asked(segment, margins, group, seen),
            |world, seen, p| {
                most = most.max(world.asked(segment, margins, p.group, seen) - p.contact.distance);
                true
            },
        );
        most
    }

    /// Adds how a point of a group moves along `direction` with each variable.
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

//! The world of a motion: fixed bodies, attached bodies, bodies moved by the object's joint, and the permitted contacts
//! in each segment.

mod bodies;
mod bubble;
mod checker;
mod clearance;
mod compiled;
mod margins;
mod movers;
mod query;
mod required;
mod rules;
mod scene;
mod segment;
mod sweep;
mod travel;
mod way;

use std::time::Instant;

use gensim2_geometry::{Contact, MovingShapes, Obstacles, Pose, Proximity, Scratch, Target, screw_about};
use nalgebra::{Point3, Translation3};

use crate::model::{Model, Row};
use crate::transit::Ending;
use crate::{Cancel, KeypointProblem, ObjectJoint, ObjectJointKind, Role};

use bubble::Bubble;
use movers::Movers;
use rules::{Carrier, CollisionObjects, Compiler, Group, SegmentWorld};

pub use bodies::Bodies;
pub use checker::{Checker, Nearness};
pub(crate) use clearance::Clearance;
pub(crate) use compiled::{CONTACT, Close, Compiled, Rider};
use margins::Distances;
pub(crate) use margins::Margins;
pub(crate) use movers::is_below;
pub(crate) use query::Clearances;
pub(crate) use required::Required;
pub use scene::{Scene, SceneJoint};
pub(crate) use segment::{MotionSegment, Schedule};
pub(crate) use travel::{even, joint_steps, travel_along, travel_over};
pub(crate) use way::Way;

/// Value of the parameter `coarse` that requests exact distances.
const EXACT: f64 = f64::INFINITY;
/// Overlaps up to this depth (m) are rounding errors.
pub(crate) const TOUCH: f64 = 1e-4;

/// A pair of bodies with a forbidden overlap, or with a distance for a report.
#[derive(Debug, Clone)]
pub(crate) struct Hit {
    pub first: String,
    pub second: String,
    pub distance: f64,
    pub at: Point3<f64>,
}

/// Signed distances (m) of pairs that are too close at the start, or overlap when a body is picked. These pairs need not
/// move apart, but must not come closer.
#[derive(Debug, Default)]
pub(crate) struct Overlaps {
    start: Distances,
    picked: Distances,
}

/// A state of the motion: joint values of the arm, and travel of the object's joint from its initial value (rad or m).
#[derive(Debug, Clone, Copy)]
pub(crate) struct State<'x> {
    pub x: &'x Row,
    pub travel: f64,
}

impl<'x> State<'x> {
    /// Returns a state in which the object's joint has its initial value.
    pub fn still(x: &'x Row) -> Self {
        Self { x, travel: 0.0 }
    }
}

/// The world of one problem: its groups, and a table of rules for each segment. Names are resolved on construction.
pub(crate) struct World<'p> {
    pub problem: &'p KeypointProblem,
    model: &'p Model,
    objects: CollisionObjects<'p>,
    movers: Movers,
    shapes: MovingShapes<'p>,
    obstacles: &'p Obstacles,
    pub schedule: Schedule,
    segments: Vec<SegmentWorld>,
    /// Maximum distance (m) of any point of a group from the group's centre, and this centre in the group's frame.
    extents: Vec<f64>,
    middles: Vec<Point3<f64>>,
    /// Pose of each attached group in the hand frame, and of each released group in the base frame.
    grasps: Vec<Pose>,
    placed: Vec<Pose>,
    known: Overlaps,
    pub start_overlap: f64,
    /// The deepest overlap of a checked pair at the start.
    pub start_hit: Option<Hit>,
    scratch: Scratch,
    spare: Bubble,
    q: Vec<f64>,
    steps: Vec<f64>,
    /// Number of states checked so far, and its limit.
    checks: u64,
    max_checks: u64,
    cancel: Option<Cancel>,
    end: Option<Instant>,
    /// Whether a check was cut short because of the time limit or a cancellation, so that its path is not proven.
    pub unfinished: bool,
}

impl<'p> World<'p> {
    pub fn new(problem: &'p KeypointProblem, model: &'p Model) -> Self {
        let robot = &*problem.robot;
        let movers = Movers::new(model);
        let carrying: Vec<Vec<bool>> = (0..robot.links().len()).map(|l| movers.carrying(robot, l).collect()).collect();
        let picks = &problem.options.pick;
        let objects = CollisionObjects::new(
            robot,
            &problem.bodies,
            |b| problem.bodies[b].role == Role::Attached || picks.contains(&problem.bodies[b].name),
            |b| b.role == Role::MovingLink && problem.joint.is_some(),
            // Links that are moved by the same joints do not move relative to each other.
            |a, b| carrying[a] != carrying[b],
        );
        let shapes = MovingShapes::new(objects.groups.iter().map(|g| match g {
            Group::Link(l) => robot.links()[*l].shapes(),
            Group::Riding(b) | Group::Moved(b) => &problem.bodies[*b].shapes,
        }));
        let schedule = Schedule::of(&problem.config);
        let compiler = Compiler::new(problem, &objects, &movers, schedule);
        let segments: Vec<SegmentWorld> = schedule.segments().map(|segment| compiler.segment(segment)).collect();
        let middles: Vec<Point3<f64>> = (0..shapes.len()).map(|g| shapes.middle(g)).collect();
        let extents = (0..shapes.len()).map(|g| shapes.extent(g, &middles[g])).collect();
        let grasps = objects
            .groups
            .iter()
            .map(|g| match g {
                Group::Riding(b) if problem.bodies[*b].role == Role::Attached => problem.bodies[*b].pose,
                _ => Pose::identity(),
            })
            .collect();
        Self {
            problem,
            model,
            placed: vec![Pose::identity(); objects.groups.len()],
            known: Overlaps::default(),
            objects,
            movers,
            shapes,
            obstacles: problem.bodies.obstacles(),
            schedule,
            segments,
            extents,
            middles,
            grasps,
            start_overlap: 0.0,
            start_hit: None,
            scratch: Scratch::remembering(),
            spare: Bubble::default(),
            q: Vec::new(),
            steps: Vec::new(),
            checks: 0,
            max_checks: u64::MAX,
            cancel: None,
            end: None,
            unfinished: false,
        }
    }

    /// Makes planning end after `max_checks` more states, at the time `end`, or when the caller cancels.
    pub fn limit(&mut self, max_checks: Option<u64>, end: Option<Instant>, cancel: Option<Cancel>) {
        self.end = end;
        self.max_checks = max_checks.map_or(u64::MAX, |most| self.checks.saturating_add(most));
        self.cancel = cancel;
    }

    /// Whether planning must end because its checks are used up, it is late, or it was cancelled.
    pub fn is_over(&self) -> bool {
        self.is_spent() || self.is_late() || self.is_cancelled()
    }

    /// Returns whether the check under way must end because planning is late or was cancelled, and records it.
    pub fn cut_short(&mut self) -> bool {
        self.unfinished |= self.is_late() || self.is_cancelled();
        self.unfinished
    }

    /// Returns the limits that a search must keep in addition, and the number of checks that are left.
    pub fn ending(&self) -> Ending {
        let max_checks = (self.max_checks < u64::MAX).then(|| self.max_checks.saturating_sub(self.checks));
        Ending { cancel: self.cancel.clone(), deadline: self.end, max_checks }
    }

    /// Adds the checks of a search.
    pub fn spend(&mut self, checks: u64) {
        self.checks += checks;
    }

    /// Whether planning has a limit on checks or time.
    pub fn is_limited(&self) -> bool {
        self.end.is_some() || self.max_checks < u64::MAX
    }

    /// Whether the time limit has passed.
    pub fn is_late(&self) -> bool {
        self.end.is_some_and(|end| Instant::now() >= end)
    }

    /// Whether the checks are used up.
    pub fn is_spent(&self) -> bool {
        self.checks >= self.max_checks
    }

    /// Whether the caller has cancelled planning.
    pub fn is_cancelled(&self) -> bool {
        self.cancel.as_ref().is_some_and(Cancel::is_cancelled)
    }

    /// Sets whether queries only detect collisions. If so, they may return any colliding pair, with any depth.
    pub fn set_early_exit(&mut self, early_exit: bool) {
        self.scratch.set_early_exit(early_exit);
    }

    /// Clearance (m) required from the handled bodies before the actuation pose is reached.
    fn reach_clearance(&self) -> f64 {
        self.problem.options.reach_clearance.unwrap_or(0.0)
    }

    fn table(&self, segment: MotionSegment) -> &SegmentWorld {
        &self.segments[self.schedule.number(segment)]
    }

    /// Computes the poses of all groups of a segment.
    fn place(&mut self, state: State<'_>, segment: MotionSegment) {
        self.checks += 1;
        let robot = &*self.problem.robot;
        self.model.map().positions(state.x, &mut self.q);
        let table = &self.segments[self.schedule.number(segment)];
        let moved = self.problem.joint.map_or_else(Pose::identity, |j| joint_motion(&j, state.travel));
        self.shapes.place(&table.present, &mut self.scratch, |poses| {
            let posed = robot.link_poses(&self.q, poses);
            debug_assert!(posed.is_ok(), "joint vectors here have an entry for each joint");
            for group in poses.len()..self.objects.groups.len() {
                let pose = match (table.carriers[group], self.objects.groups[group]) {
                    (Carrier::Hand, _) => poses[robot.hand()] * self.grasps[group],
                    (Carrier::Placed, _) => self.placed[group],
                    (Carrier::Joint, Group::Moved(b)) => moved * self.problem.bodies[b].pose,
                    _ => Pose::identity(),
                };
                poses.push(pose);
            }
        });
    }

    /// Sets the actuation pose `x`. Picked bodies are attached to the hand with their relative pose at `x`. Released
    /// bodies stay at their pose at `x`. Bodies that are released later stay where the hand puts them when its pose is
    /// `letting_go`.
    pub fn act_at(&mut self, x: &Row, letting_go: Option<&Pose>) {
        let riding = self.objects.groups.iter().any(|g| matches!(g, Group::Riding(_)));
        if !riding {
            return;
        }
        let actuation = self.schedule.last_before_actuation();
        self.place(State::still(x), actuation);
        let hand = self.scratch.poses()[self.problem.robot.hand()];
        for (group, what) in self.objects.groups.iter().enumerate() {
            let Group::Riding(b) = what else { continue };
            let body = &self.problem.bodies[*b];
            if body.role != Role::Attached {
                self.grasps[group] = hand.inverse() * body.pose;
            }
            let released = self.problem.options.release.contains(&body.name);
            let left_at = letting_go.filter(|_| !released).unwrap_or(&hand);
            self.placed[group] = left_at * self.grasps[group];
        }
        self.measure_picked(x);
    }

    fn hit(&self, p: &Proximity) -> Hit {
        let second = match p.target {
            Target::Body(b) => &self.problem.bodies[b].name,
            Target::Group(g) => self.objects.name(g),
        };
        let Contact { distance, on_first, on_second, .. } = p.contact;
        let first = self.objects.name(p.group).to_owned();
        Hit { first, second: second.to_owned(), distance, at: nalgebra::center(&on_first, &on_second) }
    }
}

/// Returns the displacement of the bodies moved by a joint for a travel (rad or m).
pub(crate) fn joint_motion(joint: &ObjectJoint, travel: f64) -> Pose {
    match joint.kind {
        ObjectJointKind::Revolute => screw_about(&joint.origin, &joint.axis, travel),
        ObjectJointKind::Prismatic => {
            Pose::from_parts(Translation3::from(joint.axis * travel), nalgebra::Rotation3::identity())
        }
    }
}

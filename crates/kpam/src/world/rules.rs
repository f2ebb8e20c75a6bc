//! Contact rules of each segment, derived from the roles of bodies or from contact windows, and stored in a table.

use gensim2_geometry::{Robot, checked_pairs};

use super::bubble::Carried;
use super::movers::{Movers, is_below};
use super::segment::{MotionSegment, Schedule};
use super::travel::joint_steps;
use crate::{Body, KeypointProblem, Role};

/// A set of shapes that moves rigidly.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Group {
    /// A link of the robot.
    Link(usize),
    /// A body that the hand holds in some segment: attached from the start, picked, or released later.
    Riding(usize),
    /// A body that the object's joint moves.
    Moved(usize),
}

/// Source of a group's pose in a segment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Carrier {
    /// The robot's kinematics: the group is a link.
    Robot,
    /// The hand's pose: the group is attached to it.
    Hand,
    /// A fixed pose: the hand has released the group there.
    Placed,
    /// The travel of the object's joint.
    Joint,
    /// The group is not part of the segment; its body counts as a fixed obstacle.
    Absent,
}

/// Rule for a pair of bodies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Verdict {
    /// The pair may not overlap.
    Checked,
    /// The pair may overlap up to this depth (m).
    MayTouch(f64),
    /// The pair is not checked: the motion does not change the relative position of the two, one of them is absent or
    /// held by the other, or a position is unknown.
    Apart,
}

impl Verdict {
    /// Returns the rule that permits an overlap of `depth` (m), or of any depth.
    fn touching(depth: Option<f64>) -> Self {
        depth.map_or(Self::Apart, Self::MayTouch)
    }
}

/// Groups and contact rules in one segment.
pub(crate) struct SegmentWorld {
    /// Source of each group's pose.
    pub carriers: Vec<Carrier>,
    /// Groups that are part of the segment.
    pub present: Vec<usize>,
    /// Rule for each group and fixed body, one row for each group.
    pub bodies: Vec<Verdict>,
    /// For each body, whether the hand moves towards it in this segment but must still keep a clearance from it.
    pub reached: Vec<bool>,
    /// Indices of the pairs of groups that are checked.
    pub pairs: Vec<usize>,
    /// Permitted overlap (m) of each pair of groups, if any.
    pub depths: Vec<Option<f64>>,
    /// Whether each joint moves each group.
    pub carried: Carried,
    /// Whether the travel of the object's joint is only estimated.
    pub guessed: bool,
}

/// All moving groups of a problem, and the pairs of groups that are checked in any segment.
pub(crate) struct CollisionObjects<'p> {
    pub robot: &'p Robot,
    pub bodies: &'p [Body],
    pub groups: Vec<Group>,
    hand: Hand,
    pub pairs: Vec<(usize, usize)>,
}

impl<'p> CollisionObjects<'p> {
    /// Collects the robot's links, then bodies that are attached at some time, then bodies moved by the object's joint.
    /// `changes` returns whether one link can move relative to another.
    pub fn new(
        robot: &'p Robot,
        bodies: &'p [Body],
        rides: impl Fn(usize) -> bool,
        is_moved: impl Fn(&Body) -> bool,
        changes: impl Fn(usize, usize) -> bool,
    ) -> Self {
        let links = robot.links().len();
        let mut groups: Vec<Group> = (0..links).map(Group::Link).collect();
        groups.extend((0..bodies.len()).filter(|b| rides(*b)).map(Group::Riding));
        groups.extend((0..bodies.len()).filter(|b| is_moved(&bodies[*b])).map(Group::Moved));
        let mut pairs = checked_pairs(robot, changes);
        let bare = |g: usize| match groups[g] {
            Group::Link(l) => robot.links()[l].shapes().is_empty(),
            Group::Riding(b) | Group::Moved(b) => bodies[b].shapes.is_empty(),
        };
        for second in links..groups.len() {
            for first in 0..second {
                let meet = !matches!((groups[first], groups[second]), (Group::Moved(_), Group::Moved(_)));
                if meet && !bare(first) && !bare(second) {
                    pairs.push((first, second));
                }
            }
        }
        Self { robot, bodies, groups, hand: Hand::of(robot, robot.hand()), pairs }
    }

    /// Whether a group is a link of the hand or a finger, which may touch targets.
    pub fn touches(&self, group: usize) -> bool {
        matches!(self.groups[group], Group::Link(l) if self.hand.touches[l])
    }

    /// Whether a group is a link that holds the attached bodies.
    pub fn holds(&self, group: usize) -> bool {
        matches!(self.groups[group], Group::Link(l) if self.hand.holds[l])
    }

    /// Name of a group, which is the name of its link or body.
    pub fn name(&self, group: usize) -> &'p str {
        match self.groups[group] {
            Group::Link(l) => self.robot.links()[l].name(),
            Group::Riding(b) | Group::Moved(b) => &self.bodies[b].name,
        }
    }
}

/// The links of the hand. A hand link without shapes only marks a point on the link that carries it.
struct Hand {
    /// Links that hold the attached body: the hand's carrier and all links below it.
    holds: Vec<bool>,
    /// Links that may touch bodies: those in `holds`, unless the carrier is a link of the arm that a joint moves.
    touches: Vec<bool>,
}

/// Returns for each link whether it holds the bodies that are attached to the hand with link `hand`.
pub(crate) fn holders(robot: &Robot, hand: usize) -> Vec<bool> {
    Hand::of(robot, hand).holds
}

impl Hand {
    /// Collects the links of the hand with link `hand`.
    fn of(robot: &Robot, hand: usize) -> Self {
        let links = robot.links();
        let mut top = hand;
        while links[top].shapes().is_empty()
            && links[top].joint().is_none()
            && let Some(parent) = links[top].parent()
        {
            top = parent;
        }
        // If no shape is rigidly joined to the hand, the hand consists of the hand link only.
        if links[top].shapes().is_empty() {
            top = hand;
        }
        let tool = if links[top].joint().is_none() { top } else { hand };
        let below = |top: usize| (0..links.len()).map(|l| is_below(robot, l, top)).collect();
        Self { holds: below(top), touches: below(tool) }
    }
}

/// Derives the contact rules of a problem's segments.
pub(crate) struct Compiler<'c, 'p> {
    pub problem: &'p KeypointProblem,
    pub objects: &'c CollisionObjects<'p>,
    pub movers: &'c Movers,
    pub schedule: Schedule,
    windows: Option<Vec<Window>>,
}

/// A contact window with its names resolved: groups, bodies, and keyframes by index in time order.
struct Window {
    groups: Vec<bool>,
    bodies: Vec<bool>,
    from: usize,
    to: usize,
    depth: Option<f64>,
}

impl<'c, 'p> Compiler<'c, 'p> {
    pub fn new(
        problem: &'p KeypointProblem,
        objects: &'c CollisionObjects<'p>,
        movers: &'c Movers,
        schedule: Schedule,
    ) -> Self {
        let windows = problem.options.contacts.as_ref().map(|windows| {
            let resolve = |w: &crate::options::ContactWindow| {
                let named = |group: usize| w.links.iter().any(|l| l == objects.name(group));
                Some(Window {
                    groups: (0..objects.groups.len()).map(named).collect(),
                    bodies: problem.bodies.iter().map(|b| w.bodies.contains(&b.name)).collect(),
                    from: problem.window_index(&w.from)?,
                    to: problem.window_index(&w.to)?,
                    depth: w.depth.or(problem.options.contact_depth),
                })
            };
            // Validation has refused windows whose `from` or `to` is no keyframe.
            windows.iter().filter_map(resolve).collect()
        });
        Self { problem, objects, movers, schedule, windows }
    }

    /// Returns the groups and contact rules of a segment.
    pub fn segment(&self, segment: MotionSegment) -> SegmentWorld {
        let groups = self.objects.groups.len();
        let carriers: Vec<Carrier> = (0..groups).map(|g| self.carrier(g, segment)).collect();
        let present = (0..groups).filter(|g| carriers[*g] != Carrier::Absent).collect();
        let carried = self.carried(&carriers, segment);
        let bodies = (0..groups)
            .flat_map(|g| (0..self.objects.bodies.len()).map(move |b| (g, b)))
            .map(|(g, b)| self.against_body(g, b, segment, &carriers, &carried))
            .collect();
        let verdicts: Vec<Verdict> =
            self.objects.pairs.iter().map(|pair| self.between(*pair, segment, &carriers, &carried)).collect();
        let pairs = (0..verdicts.len()).filter(|pair| verdicts[*pair] != Verdict::Apart).collect();
        let depth = |verdict: &Verdict| if let Verdict::MayTouch(depth) = verdict { Some(*depth) } else { None };
        let depths = verdicts.iter().map(depth).collect();
        let steps = joint_steps(self.problem);
        let guessed = match segment {
            MotionSegment::Post(i) => steps[i].is_none(),
            // The joint stays where the previous motions left it. Its travel is estimated if one of theirs is.
            MotionSegment::LetGo => steps.contains(&None),
            MotionSegment::Approach | MotionSegment::Pre(_) | MotionSegment::ToActuation => false,
        };
        let reached = (0..self.objects.bodies.len()).map(|b| self.is_kept_from(b, segment)).collect();
        SegmentWorld { carriers, present, bodies, reached, pairs, depths, carried, guessed }
    }

    fn carrier(&self, group: usize, segment: MotionSegment) -> Carrier {
        let after = segment.is_after();
        match self.objects.groups[group] {
            Group::Link(_) => Carrier::Robot,
            Group::Moved(_) if after => Carrier::Joint,
            Group::Moved(_) => Carrier::Absent,
            Group::Riding(b) => match (self.objects.bodies[b].role == Role::Attached, after) {
                (_, true) if segment == MotionSegment::LetGo || self.is_released(b) => Carrier::Placed,
                (true, _) | (false, true) => Carrier::Hand,
                (false, false) => Carrier::Absent,
            },
        }
    }

    fn is_picked(&self, body: usize) -> bool {
        self.problem.options.pick.contains(&self.objects.bodies[body].name)
    }

    /// Whether the hand moves towards a body in a segment but may not touch it yet.
    fn is_kept_from(&self, body: usize, segment: MotionSegment) -> bool {
        let reached = matches!(self.objects.bodies[body].role, Role::MovingLink | Role::Target) || self.is_picked(body);
        self.problem.options.reach_clearance.is_some() && !segment.is_after() && reached
    }

    fn is_released(&self, body: usize) -> bool {
        self.problem.options.release.contains(&self.objects.bodies[body].name)
    }

    /// Returns whether each joint moves each group; the object's joint is last.
    fn carried(&self, carriers: &[Carrier], segment: MotionSegment) -> Carried {
        let (robot, hand) = (self.objects.robot, self.objects.robot.hand());
        let joints = self.movers.len() + 1;
        let mut flags = Vec::with_capacity(joints * carriers.len());
        for (group, carrier) in carriers.iter().enumerate() {
            match (carrier, self.objects.groups[group]) {
                (Carrier::Robot, Group::Link(l)) => flags.extend(self.movers.carrying(robot, l)),
                (Carrier::Hand, _) => flags.extend(self.movers.carrying(robot, hand)),
                _ => flags.extend((0..joints - 1).map(|_| false)),
            }
            flags.push(*carrier == Carrier::Joint && segment != MotionSegment::LetGo);
        }
        Carried { joints, flags }
    }

    /// Returns the rule that the contact windows define for a group and a body. A window from `start` covers the
    /// approach.
    fn through(&self, windows: &[Window], group: usize, body: usize, segment: MotionSegment) -> Verdict {
        // In contact windows, keyframe 0 is the start, so that keyframe k of the motion has index k + 1.
        let leads_to = self.schedule.number(segment) + 1;
        let open = |w: &&Window| w.groups[group] && w.bodies[body] && w.from < leads_to && leads_to <= w.to;
        let deepest = windows.iter().filter(open).map(|w| w.depth.unwrap_or(f64::INFINITY)).reduce(f64::max);
        deepest.map_or(Verdict::Checked, |depth| Verdict::touching(Some(depth).filter(|d| d.is_finite())))
    }

    fn against_body(
        &self,
        group: usize,
        body: usize,
        segment: MotionSegment,
        carriers: &[Carrier],
        carried: &Carried,
    ) -> Verdict {
        let what = &self.objects.bodies[body];
        let after = segment.is_after();
        let stands = match what.role {
            Role::Attached => false,
            Role::MovingLink => !(after && self.problem.joint.is_some()),
            _ => !(after && self.is_picked(body)),
        };
        if !stands || carriers[group] == Carrier::Absent || !carried.moves(group) || !self.meets(group) {
            return Verdict::Apart;
        }
        if let Some(windows) = &self.windows {
            return self.through(windows, group, body, segment);
        }
        if self.is_kept_from(body, segment) {
            return Verdict::Checked;
        }
        let gripper = self.objects.touches(group);
        let reaching = segment == self.schedule.last_before_actuation();
        let may = match what.role {
            Role::Target => gripper || carriers[group] == Carrier::Hand,
            // Without a joint, the motion of the moving link is unknown.
            Role::MovingLink if after => return Verdict::Apart,
            Role::MovingLink => gripper && reaching,
            Role::Table | Role::ObjectBody | Role::Rigid | Role::Attached => {
                gripper && reaching && self.is_picked(body)
            }
        };
        if may { Verdict::touching(self.problem.options.contact_depth) } else { Verdict::Checked }
    }

    /// Whether a group is checked at all: bodies moved by the object's joint are checked only against the robot.
    fn meets(&self, group: usize) -> bool {
        !matches!(self.objects.groups[group], Group::Moved(_))
    }

    fn between(
        &self,
        (a, b): (usize, usize),
        segment: MotionSegment,
        carriers: &[Carrier],
        carried: &Carried,
    ) -> Verdict {
        if carriers[a] == Carrier::Absent || carriers[b] == Carrier::Absent {
            return Verdict::Apart;
        }
        let verdict = match (self.objects.groups[a], self.objects.groups[b]) {
            (Group::Link(_), Group::Link(_)) => return Verdict::Checked,
            // An attached body does not move relative to the links around the hand, and may overlap one of them.
            (Group::Link(_), Group::Riding(_)) if carriers[b] == Carrier::Hand => Verdict::Checked,
            _ if carried.row(a) == carried.row(b) => return Verdict::Apart,
            _ => Verdict::Checked,
        };
        let body_of = |group: usize| match self.objects.groups[group] {
            Group::Link(_) => None,
            Group::Riding(body) | Group::Moved(body) => Some(body),
        };
        if let Some(windows) = &self.windows {
            let open = |g: usize, other: usize| {
                body_of(other).map(|o| self.through(windows, g, o, segment)).filter(|v| *v != Verdict::Checked)
            };
            if carriers[b] == Carrier::Hand && self.objects.holds(a) {
                return Verdict::Apart;
            }
            return open(a, b).or_else(|| open(b, a)).unwrap_or(verdict);
        }
        // Hand and fingers may touch attached and released bodies, and the moving link, which they push or pull.
        match self.objects.groups[b] {
            Group::Riding(_) if self.objects.holds(a) => Verdict::Apart,
            Group::Moved(_) if self.objects.touches(a) => Verdict::touching(self.problem.options.contact_depth),
            _ => verdict,
        }
    }
}

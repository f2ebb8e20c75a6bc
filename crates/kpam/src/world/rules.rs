//! Contact rules of each segment: roles, or contact windows, compiled once into a table.

use gensim2_geometry::{Robot, checked_pairs};

use super::bubble::Carried;
use super::movers::{Movers, is_below};
use super::segment::{MotionSegment, Schedule};
use super::travel::joint_steps;
use crate::{Body, KeypointProblem, Role};

/// Group that moves as one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Group {
    /// A link of the robot.
    Link(usize),
    /// A body that rides on the hand in some segment: attached, picked, or placed later.
    Riding(usize),
    /// A body that the object's joint moves.
    Moved(usize),
}

/// Source of a group's pose in a segment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Carrier {
    /// It is a link.
    Robot,
    /// The hand.
    Hand,
    /// Nothing: it stands where the hand has placed it.
    Placed,
    /// The object's joint.
    Joint,
    /// It is not there: it stands among the obstacles.
    Absent,
}

/// Whether two things are looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Verdict {
    /// They may not overlap.
    Checked,
    /// They may, as deep as this (m).
    MayTouch(f64),
    /// Nothing of what is planned moves one against the other, one of them is not there or held by the other, or it is
    /// not known where it is.
    Apart,
}

impl Verdict {
    /// One that lets two things overlap as deep as `depth` (m), or however deep.
    fn touching(depth: Option<f64>) -> Self {
        depth.map_or(Self::Apart, Self::MayTouch)
    }
}

/// The world in one segment.
pub(crate) struct SegmentWorld {
    /// Source of each group's pose.
    pub carriers: Vec<Carrier>,
    /// Groups that are there.
    pub present: Vec<usize>,
    /// Verdict on each group and standing body, one row a group.
    pub bodies: Vec<Verdict>,
    /// Whether each body is one that the hand reaches for and keeps a clearance from, yet.
    pub reached: Vec<bool>,
    /// Numbers of the pairs of groups that are looked at.
    pub pairs: Vec<usize>,
    /// Depth (m) by which each pair of groups may overlap, where it may.
    pub depths: Vec<Option<f64>>,
    /// Which joints carry which groups.
    pub carried: Carried,
    /// Whether how far the object's joint moves is a guess.
    pub guessed: bool,
}

/// Everything that moves in a problem, and which pairs of it are ever checked.
pub(crate) struct CollisionObjects<'p> {
    pub robot: &'p Robot,
    pub bodies: &'p [Body],
    pub groups: Vec<Group>,
    hand: Hand,
    pub pairs: Vec<(usize, usize)>,
}

impl<'p> CollisionObjects<'p> {
    /// The robot's links, then bodies that ride at some time, then bodies that the object's joint moves. `changes` says
    /// whether one link can move against another.
    pub fn new(
        robot: &'p Robot,
        bodies: &'p [Body],
        rides: impl Fn(&Body) -> bool,
        is_moved: impl Fn(&Body) -> bool,
        changes: impl Fn(usize, usize) -> bool,
    ) -> Self {
        let links = robot.links().len();
        let mut groups: Vec<Group> = (0..links).map(Group::Link).collect();
        groups.extend((0..bodies.len()).filter(|b| rides(&bodies[*b])).map(Group::Riding));
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
        Self { robot, bodies, groups, hand: Hand::of(robot), pairs }
    }

    /// Whether a group is hand or finger, which may touch what they reach for.
    pub fn touches(&self, group: usize) -> bool {
        matches!(self.groups[group], Group::Link(l) if self.hand.touches[l])
    }

    /// Whether a group holds what rides.
    pub fn holds(&self, group: usize) -> bool {
        matches!(self.groups[group], Group::Link(l) if self.hand.holds[l])
    }

    /// Name of a group: that of the link or body.
    pub fn name(&self, group: usize) -> &'p str {
        match self.groups[group] {
            Group::Link(l) => self.robot.links()[l].name(),
            Group::Riding(b) | Group::Moved(b) => &self.bodies[b].name,
        }
    }
}

/// The hand as a body. A hand link without shapes is a point of the link that carries it.
struct Hand {
    /// Links that hold the held body: that link and all that hangs on it.
    holds: Vec<bool>,
    /// Links that may touch: the same, unless that link is one of the arm's own, which a joint carries.
    touches: Vec<bool>,
}

impl Hand {
    fn of(robot: &Robot) -> Self {
        let links = robot.links();
        let mut top = robot.hand();
        while links[top].shapes().is_empty()
            && links[top].joint().is_none()
            && let Some(parent) = links[top].parent()
        {
            top = parent;
        }
        // Where no shape is joined to the hand rigidly, the hand itself is all there is.
        if links[top].shapes().is_empty() {
            top = robot.hand();
        }
        let tool = if links[top].joint().is_none() { top } else { robot.hand() };
        let below = |top: usize| (0..links.len()).map(|l| is_below(robot, l, top)).collect();
        Self { holds: below(top), touches: below(tool) }
    }
}

/// Compiles the rules of a problem.
pub(crate) struct Compiler<'c, 'p> {
    pub problem: &'p KeypointProblem,
    pub objects: &'c CollisionObjects<'p>,
    pub movers: &'c Movers,
    pub schedule: Schedule,
    windows: Option<Vec<Window>>,
}

/// A contact window with its names resolved: which groups and bodies it names, and its keyframes in time.
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
            // The problem's check has refused windows that name no keyframe.
            windows.iter().filter_map(resolve).collect()
        });
        Self { problem, objects, movers, schedule, windows }
    }

    /// The world of a segment.
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
            // It stands still, where the motions before have taken it.
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

    /// Whether the hand reaches for a body and may not touch it yet.
    fn is_kept_from(&self, body: usize, segment: MotionSegment) -> bool {
        let reached = matches!(self.objects.bodies[body].role, Role::MovingLink | Role::Target) || self.is_picked(body);
        self.problem.options.reach_clearance.is_some() && !segment.is_after() && reached
    }

    fn is_released(&self, body: usize) -> bool {
        self.problem.options.release.contains(&self.objects.bodies[body].name)
    }

    /// The joints that carry each group; the object's comes last.
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

    /// The verdict of the windows on a group and a body in a segment. A window from the start covers the approach.
    fn through(&self, windows: &[Window], group: usize, body: usize, segment: MotionSegment) -> Verdict {
        // Among windows the start is 0, and keyframe k of the motion k + 1.
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
            // Without a joint it is not known how it moves.
            Role::MovingLink if after => return Verdict::Apart,
            Role::MovingLink => gripper && reaching,
            Role::Table | Role::ObjectBody | Role::Rigid | Role::Attached => {
                gripper && reaching && self.is_picked(body)
            }
        };
        if may { Verdict::touching(self.problem.options.contact_depth) } else { Verdict::Checked }
    }

    /// Whether a group is ever checked: what the object's joint moves is, against the robot alone.
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
            // What is held keeps its place against the links about the hand, and may yet be inside one of them.
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
        // Hand and fingers hold what rides, leave what was placed, and push or pull what the joint moves.
        match self.objects.groups[b] {
            Group::Riding(_) if self.objects.holds(a) => Verdict::Apart,
            Group::Moved(_) if self.objects.touches(a) => Verdict::touching(self.problem.options.contact_depth),
            _ => verdict,
        }
    }
}

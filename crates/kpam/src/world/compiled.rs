//! A scene prepared for fast collision checks.

use gensim2_geometry::{Convex, Needs, Other, Pose, Riders, Screen};

use super::Scene;
use super::movers::is_below;
use super::rules::{CollisionObjects, Group};
use crate::Role;

/// A scene prepared for collision checks: the robot with its attached bodies, and the other bodies.
#[derive(Debug)]
pub(crate) struct Compiled {
    pub screen: Screen,
    /// Name of each group.
    pub names: Vec<String>,
    /// Joints that move each group, each with the index of the link that the joint moves.
    pub carriers: Vec<Vec<(usize, usize)>>,
    /// Whether collisions between a group and a body are checked: one row for each group, one column for each body.
    checked: Vec<bool>,
}

impl Compiled {
    pub fn new(scene: &Scene) -> Self {
        let robot = &**scene.robot();
        let links = robot.links();
        let moved: Vec<(usize, usize)> = (0..links.len()).filter_map(|l| Some((links[l].joint()?, l))).collect();
        let moves: Vec<bool> = (0..links.len()).map(|l| moved.iter().any(|(_, c)| is_below(robot, l, *c))).collect();
        let objects = CollisionObjects::new(
            robot,
            scene.bodies(),
            |b| b.role == Role::Attached,
            |_| false,
            |a, b| moves[a] || moves[b],
        );
        let link_of = |g: usize| match objects.groups[g] {
            Group::Link(l) => l,
            Group::Riding(_) | Group::Moved(_) => robot.hand(),
        };
        let groups: Vec<Riders<'_>> = (0..objects.groups.len())
            .map(|g| {
                let held = match objects.groups[g] {
                    Group::Link(_) => None,
                    Group::Riding(b) | Group::Moved(b) => {
                        let body = &scene.bodies()[b];
                        Some((body.shapes(), *body.pose()))
                    }
                };
                Riders { link: link_of(g), held }
            })
            .collect();
        let rides = |g: usize| matches!(objects.groups[g], Group::Riding(_));
        let pairs = objects.pairs.iter().copied().filter(|(a, b)| !(rides(*b) && objects.holds(*a))).collect();
        let bodies = scene.bodies().iter().map(|body| {
            let shapes: &[Convex] = if body.role == Role::Attached { &[] } else { body.shapes() };
            (shapes, body.pose())
        });
        let screen = Screen::new(robot, robot.cover(), &groups, pairs, bodies);
        let carriers = (0..objects.groups.len())
            .map(|g| moved.iter().copied().filter(|(_, link)| is_below(robot, link_of(g), *link)).collect())
            .collect();
        let stands = |b: usize| scene.bodies()[b].role != Role::Attached;
        let checked = (0..objects.groups.len())
            .flat_map(|g| (0..screen.bodies()).map(move |b| (g, b)))
            .map(|(g, b)| moves[link_of(g)] && stands(b))
            .collect();
        let names = (0..objects.groups.len()).map(|g| objects.name(g).to_owned()).collect();
        Self { screen, names, carriers, checked }
    }

    /// Returns required distances that are `margin` (m) for every checked pair.
    pub fn needs(&self, margin: f64) -> Needs {
        let need = |checked: &bool| if *checked { margin } else { f64::NEG_INFINITY };
        Needs { bodies: self.checked.iter().map(need).collect(), pairs: vec![margin; self.screen.pairs().len()] }
    }

    /// Excludes pairs whose relative position does not change, because no moving joint lies between them.
    pub fn leave_out_still(&self, needs: &mut Needs, moves: impl Fn(usize) -> bool) {
        let driving = |g: usize| self.carriers[g].iter().map(|(j, _)| *j).filter(|j| moves(*j)).collect::<Vec<_>>();
        let carried: Vec<Vec<usize>> = (0..self.carriers.len()).map(driving).collect();
        let bodies = self.screen.bodies().max(1);
        for (row, joints) in needs.bodies.chunks_mut(bodies).zip(&carried) {
            if joints.is_empty() {
                row.fill(f64::NEG_INFINITY);
            }
        }
        for (need, (a, b)) in needs.pairs.iter_mut().zip(self.screen.pairs()) {
            if carried[*a] == carried[*b] {
                *need = f64::NEG_INFINITY;
            }
        }
    }

    /// Returns the names of a group and of the body or group near it.
    pub fn named(&self, scene: &Scene, group: usize, other: Other) -> [String; 2] {
        let second = match (other, self.screen.body(other)) {
            (_, Some(body)) => scene.bodies()[body].name().to_owned(),
            (Other::Pair(pair), None) => self.names[self.screen.pairs()[pair].1].clone(),
            (_, None) => String::new(),
        };
        [self.names[group].clone(), second]
    }

    /// Computes the pose of every link at a full joint vector.
    pub fn poses(scene: &Scene, q: &[f64], out: &mut Vec<Pose>) {
        let posed = scene.robot().link_poses(q, out);
        debug_assert!(posed.is_ok(), "joint vectors here have an entry for each joint");
    }
}

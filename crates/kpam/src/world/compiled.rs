//! A scene prepared for fast collision checks.

use std::sync::Arc;

use gensim2_geometry::{Batch, Chains, Convex, LANES, Needs, Other, Pose, Riders, Robot, Screen};

use super::movers::is_below;
use super::rules::{CollisionObjects, holders};
use super::{Scene, TOUCH};
use crate::Role;
use crate::joint_map::JointMap;

/// Bodies in contact may appear to overlap by up to this depth (m) because of rounding.
pub(crate) const CONTACT: f64 = 1e-7;

/// Pairs of bodies that are close to each other in a configuration, as (group, other body, distance in m).
pub(crate) type Close = Vec<(usize, Other, f64)>;

/// A body that moves with a link, and its pose in the frame of this link.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rider {
    pub body: usize,
    pub link: usize,
    pub pose: Pose,
}

/// A scene prepared for collision checks: the robot with its attached bodies, and the other bodies.
#[derive(Debug)]
pub(crate) struct Compiled {
    pub screen: Screen,
    /// Name of each group.
    pub names: Vec<String>,
    /// Joints that move each group, each with the index of the link that the joint moves.
    pub carriers: Vec<Vec<(usize, usize)>>,
    /// Joints between the bodies of each checked pair.
    pub chains: Arc<Chains>,
    /// Index of the body of each group after the links.
    pub riders: Vec<usize>,
    /// Whether collisions between a group and a body are checked: one row for each group, one column for each body.
    checked: Vec<bool>,
}

impl Compiled {
    pub fn new(scene: &Scene) -> Self {
        let bodies = scene.bodies();
        let attached = (0..bodies.len()).filter(|b| bodies[*b].role == Role::Attached);
        let link = scene.robot().hand();
        Self::with_riders(
            scene,
            &attached.map(|body| Rider { body, link, pose: bodies[body].pose }).collect::<Vec<_>>(),
        )
    }

    /// Prepares a scene in which `riders`, in the order of their bodies, move with links in place of the attached bodies.
    pub fn with_riders(scene: &Scene, riders: &[Rider]) -> Self {
        let robot = &**scene.robot();
        let links = robot.links();
        let moved: Vec<(usize, usize)> = (0..links.len()).filter_map(|l| Some((links[l].joint()?, l))).collect();
        let moves: Vec<bool> = (0..links.len()).map(|l| moved.iter().any(|(_, c)| is_below(robot, l, *c))).collect();
        let objects = CollisionObjects::new(
            robot,
            scene.bodies(),
            |b| riders.iter().any(|rider| rider.body == b),
            |_| false,
            |a, b| moves[a] || moves[b],
        );
        let rider = |g: usize| g.checked_sub(links.len()).map(|k| &riders[k]);
        let link_of = |g: usize| rider(g).map_or(g, |rider| rider.link);
        let groups: Vec<Riders<'_>> = (0..objects.groups.len())
            .map(|g| {
                let held = rider(g).map(|rider| (scene.bodies()[rider.body].shapes(), rider.pose));
                Riders { link: link_of(g), held }
            })
            .collect();
        let rides = |g: usize| rider(g).is_some_and(|rider| rider.link == robot.hand());
        let pairs = objects.pairs.iter().copied().filter(|(a, b)| !(rides(*b) && objects.holds(*a))).collect();
        let stands = |b: usize| scene.bodies()[b].role != Role::Attached && riders.iter().all(|rider| rider.body != b);
        let bodies = scene.bodies().iter().enumerate().map(|(b, body)| {
            let shapes: &[Convex] = if stands(b) { body.shapes() } else { &[] };
            (shapes, body.pose())
        });
        let screen = Screen::new(robot, robot.cover(), &groups, pairs, bodies);
        let carriers: Vec<Vec<(usize, usize)>> = (0..objects.groups.len())
            .map(|g| moved.iter().copied().filter(|(_, link)| is_below(robot, link_of(g), *link)).collect())
            .collect();
        let checked = (0..objects.groups.len())
            .flat_map(|g| (0..screen.bodies()).map(move |b| (g, b)))
            .map(|(g, b)| moves[link_of(g)] && stands(b))
            .collect();
        let names = (0..objects.groups.len()).map(|g| objects.name(g).to_owned()).collect();
        let chains = Arc::new(Chains::new(robot, &screen, &carriers));
        let riders = riders.iter().map(|rider| rider.body).collect();
        Self { screen, names, carriers, chains, riders, checked }
    }

    /// Returns required distances that are `margin` (m) for every checked pair.
    pub fn needs(&self, margin: f64) -> Needs {
        let need = |checked: &bool| if *checked { margin } else { f64::NEG_INFINITY };
        Needs { bodies: self.checked.iter().map(need).collect(), pairs: vec![margin; self.screen.pairs().len()] }
    }

    /// Returns required distances that are `clearance` (m), except for pairs that are closer at some configuration
    /// (`close`): these must only keep that distance. Links whose shapes prevent the `margin` must only not collide.
    pub fn needs_beside<'c>(
        &self,
        robot: &Robot,
        close: impl IntoIterator<Item = &'c (usize, Other, f64)>,
        clearance: f64,
        margin: f64,
    ) -> Needs {
        let mut needs = self.needs(clearance);
        for (group, other, distance) in close {
            // The screening cannot bound the depth of an overlap, so the required distance is never below contact.
            let need = (distance - TOUCH).min(clearance).max(0.0);
            if let Some(place) = self.need_mut(&mut needs, *group, *other) {
                *place = place.min(need);
            }
        }
        for (need, pair) in needs.pairs.iter_mut().zip(self.screen.pairs()) {
            if robot.is_often_close(*pair, margin) {
                *need = 0.0;
            }
        }
        needs
    }

    /// Returns the required distance of a group from a body or from another group; `None` for a part of no body.
    pub fn need_mut<'n>(&self, needs: &'n mut Needs, group: usize, other: Other) -> Option<&'n mut f64> {
        match (self.screen.body(other), other) {
            (Some(body), _) => Some(&mut needs.bodies[group * self.screen.bodies() + body]),
            (None, Other::Pair(pair)) => Some(&mut needs.pairs[pair]),
            (None, Other::Element(_) | Other::Cloud(_)) => None,
        }
    }

    /// Returns all checked pairs closer than `reach` (m) at a full joint vector. Pairs whose relative pose no
    /// variable of `map` changes are omitted.
    pub fn close(&self, scene: &Scene, q: &[f64], reach: f64, map: &JointMap) -> Close {
        let mut needs = self.needs(0.0);
        self.leave_out_still(&mut needs, map);
        let (mut poses, mut batch) = (Vec::new(), Batch::default());
        (0..LANES).for_each(|lane| batch.set(&self.screen, lane, q));
        self.screen.place(&mut batch);
        let mut seen = Vec::new();
        self.screen.survey(&mut batch, &needs, reach as f32 + 1e-6, |s| {
            seen.push((s.group, s.other));
            true
        });
        Self::poses(scene, q, &mut poses);
        seen.into_iter()
            .filter_map(|(group, other)| {
                let distance = self.screen.distance(group, other, &poses, reach);
                (distance < reach).then_some((group, other, distance))
            })
            .collect()
    }

    /// Returns, for each group and then for each pair of groups, the joints that move it relative to the fixed bodies or
    /// to the other group, each with the group that it moves.
    pub fn movers(&self) -> Vec<Vec<(usize, usize)>> {
        let of = |group: usize| self.carriers[group].iter().map(move |(joint, _)| (*joint, group));
        let carries = |group: usize, joint: usize| self.carriers[group].iter().any(|(j, _)| *j == joint);
        let alone = |one: usize, two: usize| of(one).filter(move |(joint, _)| !carries(two, *joint));
        let pairs = self.screen.pairs().iter().map(|&(one, two)| alone(one, two).chain(alone(two, one)).collect());
        (0..self.screen.groups()).map(|group| of(group).collect()).chain(pairs).collect()
    }

    /// Returns the pairs of an attached body and a link that holds it together with the hand: a link of the hand with
    /// link `second`.
    pub fn held_by(&self, robot: &Robot, second: usize) -> Vec<usize> {
        let (links, holds) = (robot.links().len(), holders(robot, second));
        let held = |(a, b): (usize, usize)| a < links && holds[a] && b >= links;
        (0..self.screen.pairs().len()).filter(|pair| held(self.screen.pairs()[*pair])).collect()
    }

    /// Excludes pairs whose relative position does not change, because no joint that variables drive lies between
    /// them.
    pub fn leave_out_still(&self, needs: &mut Needs, map: &JointMap) {
        let driving = |g: usize| self.carriers[g].iter().map(|(j, _)| *j).filter(|j| map.moves(*j)).collect::<Vec<_>>();
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

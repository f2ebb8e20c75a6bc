//! A scene made ready for quick collision checks, once.

use gensim2_geometry::{Batch, Convex, LANES, Needs, Other, Pose, Riders, Screen};

use super::Scene;
use super::movers::is_below;
use super::rules::{Cast, Group};
use crate::Role;

/// Configurations over which levers are averaged.
const LOOKS: usize = 64;

/// The robot of a scene and what rides on its hand, among its bodies.
#[derive(Debug)]
pub(crate) struct Compiled {
    pub screen: Screen,
    /// Name of each group.
    pub names: Vec<String>,
    /// Joints that carry each group, each with the link that it moves.
    pub carriers: Vec<Vec<(usize, usize)>>,
    /// Whether a group and a body are judged, one row a group.
    judged: Vec<bool>,
    /// Mean over configurations of the furthest that any point of the robot is from each joint's axis (m), 1 for sliding
    /// joints.
    pub levers: Vec<f64>,
}

impl Compiled {
    pub fn new(scene: &Scene) -> Self {
        let robot = &**scene.robot();
        let links = robot.links();
        let moved: Vec<(usize, usize)> = (0..links.len()).filter_map(|l| Some((links[l].joint()?, l))).collect();
        let moves: Vec<bool> = (0..links.len()).map(|l| moved.iter().any(|(_, c)| is_below(robot, l, *c))).collect();
        let cast =
            Cast::new(robot, scene.bodies(), |b| b.role == Role::Attached, |_| false, |a, b| moves[a] || moves[b]);
        let link_of = |g: usize| match cast.groups[g] {
            Group::Link(l) => l,
            Group::Riding(_) | Group::Moved(_) => robot.hand(),
        };
        let groups: Vec<Riders<'_>> = (0..cast.groups.len())
            .map(|g| {
                let held = match cast.groups[g] {
                    Group::Link(_) => None,
                    Group::Riding(b) | Group::Moved(b) => {
                        let body = &scene.bodies()[b];
                        Some((body.shapes(), *body.pose()))
                    }
                };
                Riders { link: link_of(g), held }
            })
            .collect();
        let rides = |g: usize| matches!(cast.groups[g], Group::Riding(_));
        let pairs = cast.pairs.iter().copied().filter(|(a, b)| !(rides(*b) && cast.holds(*a))).collect();
        let bodies = scene.bodies().iter().map(|body| {
            let shapes: &[Convex] = if body.role == Role::Attached { &[] } else { body.shapes() };
            (shapes, body.pose())
        });
        let screen = Screen::new(robot, robot.cover(), &groups, pairs, bodies);
        let carriers = (0..cast.groups.len())
            .map(|g| moved.iter().copied().filter(|(_, link)| is_below(robot, link_of(g), *link)).collect())
            .collect();
        let stands = |b: usize| scene.bodies()[b].role != Role::Attached;
        let judged = (0..cast.groups.len())
            .flat_map(|g| (0..screen.bodies()).map(move |b| (g, b)))
            .map(|(g, b)| moves[link_of(g)] && stands(b))
            .collect();
        let names = (0..cast.groups.len()).map(|g| cast.name(g).to_owned()).collect();
        let mut out = Self { screen, names, carriers, judged, levers: Vec::new() };
        out.levers = out.mean_levers(scene);
        out
    }

    /// What has to be kept where every judged pair keeps `margin` (m).
    pub fn needs(&self, margin: f64) -> Needs {
        let need = |judged: &bool| if *judged { margin } else { f64::NEG_INFINITY };
        Needs { bodies: self.judged.iter().map(need).collect(), pairs: vec![margin; self.screen.pairs().len()] }
    }

    /// Names of a group and what it is near to.
    pub fn named(&self, scene: &Scene, group: usize, other: Other) -> [String; 2] {
        let second = match (other, self.screen.body(other)) {
            (_, Some(body)) => scene.bodies()[body].name().to_owned(),
            (Other::Pair(pair), None) => self.names[self.screen.pairs()[pair].1].clone(),
            (_, None) => String::new(),
        };
        [self.names[group].clone(), second]
    }

    fn mean_levers(&self, scene: &Scene) -> Vec<f64> {
        let robot = &**scene.robot();
        let joints = robot.joints();
        let mut sums = vec![0.0; joints.len()];
        let mut batch = Batch::default();
        let mut counter = 0_u32;
        for _ in 0..LOOKS / LANES {
            for lane in 0..LANES {
                let mut q: Vec<f64> = joints
                    .iter()
                    .map(|joint| {
                        // Golden ratio sequences: any even spread will do.
                        counter += 1;
                        let share = (f64::from(counter) * 0.618_033_988_749_894_9).fract();
                        let (low, high) = (joint.lower().max(-3.2), joint.upper().min(3.2));
                        low + (high - low) * share
                    })
                    .collect();
                robot.apply_mimic(&mut q);
                batch.set(&self.screen, lane, &q);
            }
            self.screen.place(&mut batch);
            let mut furthest = vec![[0.0_f32; LANES]; joints.len()];
            self.screen.levers(&batch, &self.carriers, robot, |_, joint, lever| {
                for (most, l) in furthest[joint].iter_mut().zip(lever) {
                    *most = most.max(l);
                }
            });
            for (sum, most) in sums.iter_mut().zip(&furthest) {
                *sum += most.iter().map(|m| f64::from(*m)).sum::<f64>();
            }
        }
        // A joint that carries nothing still moves something.
        sums.iter().map(|s| (s / LOOKS as f64).max(0.01)).collect()
    }

    /// Pose of every link at a full joint vector.
    pub fn poses(scene: &Scene, q: &[f64], out: &mut Vec<Pose>) {
        let posed = scene.robot().link_poses(q, out);
        debug_assert!(posed.is_ok(), "joint vectors here have an entry for each joint");
    }
}

//! Does the robot touch anything? The plain question, for many configurations, without contact rules.

use gensim2_geometry::{MovingShapes, Obstacles, Pose, Proximity, Scratch, Target};
use nalgebra::{Point3, center};

use super::movers::is_below;
use super::rules::{Cast, Group};
use super::{EXACT, Scene};
use crate::{ProblemError, Role};

/// Two bodies near each other, or overlapping.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Nearness {
    /// Link or attached body.
    pub first: String,
    /// Body, link or attached body.
    pub second: String,
    /// Signed distance (m).
    pub distance: f64,
    /// Where, in the base frame (m).
    pub point: Point3<f64>,
}

/// Checks configurations of a scene's robot: it and what rides on its hand against all bodies and against itself. Links
/// that no joint moves are left out, and so are pairs that the SRDF disables and what the hand holds against it.
pub struct Checker<'s> {
    cast: Cast<'s>,
    shapes: MovingShapes<'s>,
    obstacles: &'s Obstacles,
    /// Groups that joints move, and all of them.
    moving: Vec<usize>,
    all: Vec<usize>,
    pairs: Vec<usize>,
    grasps: Vec<Pose>,
    scratch: Scratch,
}

impl<'s> Checker<'s> {
    pub(super) fn new(scene: &'s Scene) -> Self {
        let robot = &**scene.robot();
        let links = robot.links();
        let carriers: Vec<usize> = (0..links.len()).filter(|l| links[*l].joint().is_some()).collect();
        let moves: Vec<bool> = (0..links.len()).map(|l| carriers.iter().any(|c| is_below(robot, l, *c))).collect();
        let cast =
            Cast::new(robot, scene.bodies(), |b| b.role == Role::Attached, |_| false, |a, b| moves[a] || moves[b]);
        let is_moving = |g: &usize| match cast.groups[*g] {
            Group::Link(l) => moves[l],
            Group::Riding(_) | Group::Moved(_) => moves[robot.hand()],
        };
        let shapes = MovingShapes::new(cast.groups.iter().map(|g| match g {
            Group::Link(l) => links[*l].shapes(),
            Group::Riding(b) | Group::Moved(b) => &scene.bodies()[*b].shapes,
        }));
        let judged = |pair: &usize| match cast.pairs[*pair] {
            (a, b) if matches!(cast.groups[b], Group::Riding(_)) => !cast.holds(a),
            _ => true,
        };
        let grasps = cast
            .groups
            .iter()
            .map(|g| match g {
                Group::Riding(b) => scene.bodies()[*b].pose,
                Group::Link(_) | Group::Moved(_) => Pose::identity(),
            })
            .collect();
        Self {
            moving: (0..cast.groups.len()).filter(is_moving).collect(),
            all: (0..cast.groups.len()).collect(),
            pairs: (0..cast.pairs.len()).filter(judged).collect(),
            cast,
            shapes,
            obstacles: scene.bodies().obstacles(),
            grasps,
            scratch: Scratch::remembering(),
        }
    }

    /// Visits what comes within `reach` (m) at `q`; `visit` says whether to go on.
    fn look(
        &mut self,
        q: &[f64],
        reach: f64,
        mut visit: impl FnMut(&Cast<'s>, &Proximity) -> bool,
    ) -> Result<bool, ProblemError> {
        let robot = self.cast.robot;
        let joints = robot.joints().len();
        if q.len() != joints {
            return Err(ProblemError::new("q", format!("has {} entries; the robot has {joints} joints", q.len())));
        }
        if let Some(i) = q.iter().position(|v| !v.is_finite()) {
            return Err(ProblemError::new(format!("q[{i}]"), format!("{} is not finite", q[i])));
        }
        self.shapes.place(&self.all, &mut self.scratch, |poses| {
            let posed = robot.link_poses(q, poses);
            debug_assert!(posed.is_ok(), "joint vectors here have an entry for each joint");
            for group in poses.len()..self.cast.groups.len() {
                poses.push(poses[robot.hand()] * self.grasps[group]);
            }
        });
        let cast = &self.cast;
        Ok(self.shapes.near_bodies(
            &self.moving,
            self.obstacles,
            &mut self.scratch,
            EXACT,
            |_, _| reach,
            |p| visit(cast, &p),
        ) && self.shapes.near_pairs(
            &cast.pairs,
            &self.pairs,
            &mut self.scratch,
            EXACT,
            |_| reach,
            |_, p| visit(cast, &p),
        ))
    }

    /// Whether anything overlaps at the full joint vector `q`.
    ///
    /// # Errors
    /// `q` has another number of entries than the robot has joints, or one that is not finite.
    pub fn hits(&mut self, q: &[f64]) -> Result<bool, ProblemError> {
        Ok(!self.look(q, 0.0, |_, _| false)?)
    }

    /// Everything that comes within `reach` (m) at `q`, nearest first; a pair once.
    ///
    /// # Errors
    /// As [`Checker::hits`].
    pub fn near(&mut self, q: &[f64], reach: f64) -> Result<Vec<Nearness>, ProblemError> {
        let mut out = Vec::new();
        self.look(q, reach, |cast, p| {
            let second = match p.target {
                Target::Body(b) => cast.bodies[b].name.as_str(),
                Target::Group(g) => cast.name(g),
            };
            out.push(Nearness {
                first: cast.name(p.group).to_owned(),
                second: second.to_owned(),
                distance: p.contact.distance,
                point: center(&p.contact.on_first, &p.contact.on_second),
            });
            true
        })?;
        out.sort_by(|a, b| a.distance.total_cmp(&b.distance));
        Ok(out)
    }

    /// Smallest signed distance (m) at `q`, `most` where nothing is nearer than that.
    ///
    /// # Errors
    /// As [`Checker::hits`].
    pub fn distance(&mut self, q: &[f64], most: f64) -> Result<f64, ProblemError> {
        let mut least = most;
        self.look(q, most, |_, p| {
            least = least.min(p.contact.distance);
            true
        })?;
        Ok(least)
    }
}

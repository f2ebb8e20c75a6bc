//! Collision checks of many configurations without contact rules.

use gensim2_geometry::{Batch, LANES, MovingShapes, Needs, Obstacles, Other, Pose, Scratch, Target};
use nalgebra::{Point3, center};

use super::compiled::Compiled;
use super::rules::{CollisionObjects, Group};
use super::{EXACT, Scene};
use crate::error::for_each_joint;
use crate::{ProblemError, Role};

/// Two bodies that are close to each other or overlap.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Nearness {
    /// Name of the first body: a link or an attached body.
    pub first: String,
    /// Name of the second body: a body of the scene, a link or an attached body.
    pub second: String,
    /// Signed distance between the two bodies (m).
    pub distance: f64,
    /// Midpoint between the closest points of the two bodies, base frame (m).
    pub point: Point3<f64>,
}

/// Checks configurations of a scene's robot: the robot and its attached bodies against all bodies and against itself.
/// Fixed links, pairs that the SRDF disables, and attached bodies against the hand are not checked.
pub struct Checker<'s> {
    scene: &'s Scene,
    world: &'s Compiled,
    needs: Needs,
    batch: Batch,
    suspects: Vec<(usize, Other)>,
    poses: Vec<Pose>,
    /// Shapes for exact queries that also return positions, created on first use.
    full: Option<Full<'s>>,
}

/// Shapes for exact queries that also return positions.
struct Full<'s> {
    objects: CollisionObjects<'s>,
    shapes: MovingShapes<'s>,
    obstacles: &'s Obstacles,
    all: Vec<usize>,
    moving: Vec<usize>,
    pairs: Vec<usize>,
    grasps: Vec<Pose>,
    scratch: Scratch,
}

impl<'s> Checker<'s> {
    pub(super) fn new(scene: &'s Scene) -> Self {
        let world = scene.compiled();
        Self {
            scene,
            world,
            needs: world.needs(0.0),
            batch: Batch::default(),
            suspects: Vec::new(),
            poses: Vec::new(),
            full: None,
        }
    }

    fn fits(&self, q: &[f64]) -> Result<(), ProblemError> {
        for_each_joint("q", q, self.scene.robot().joints().len())
    }

    /// Screens a configuration with fast bounds. Pairs that may be closer than `reach` (m) become suspects.
    fn place(&mut self, q: &[f64], reach: f64) -> Result<(), ProblemError> {
        self.fits(q)?;
        let screen = &self.world.screen;
        (0..LANES).for_each(|lane| self.batch.set(screen, lane, q));
        screen.place(&mut self.batch);
        self.suspects.clear();
        let suspects = &mut self.suspects;
        screen.survey(&mut self.batch, &self.needs, reach as f32 + 1e-6, |s| {
            suspects.push((s.group, s.other));
            true
        });
        if !self.suspects.is_empty() {
            Compiled::poses(self.scene, q, &mut self.poses);
        }
        Ok(())
    }

    /// Returns whether any pair overlaps at the full joint vector `q`.
    ///
    /// # Errors
    /// `q` has the wrong length, or an entry is not finite.
    pub fn hits(&mut self, q: &[f64]) -> Result<bool, ProblemError> {
        self.place(q, 0.0)?;
        Ok(!self.suspects.iter().all(|(group, other)| self.world.screen.keeps(*group, *other, &self.poses, 0.0)))
    }

    /// Returns whether any pair overlaps at each of up to [`LANES`] full joint vectors, which are screened together.
    ///
    /// # Errors
    /// As [`Checker::hits`], for the first invalid vector; or there are too many vectors.
    pub fn hits_each(&mut self, rows: &[&[f64]]) -> Result<Vec<bool>, ProblemError> {
        if rows.len() > LANES {
            return Err(ProblemError::new(
                "q",
                format!("has {} rows; at most {LANES} are checked at once", rows.len()),
            ));
        }
        for q in rows {
            self.fits(q)?;
        }
        let screen = &self.world.screen;
        for lane in 0..LANES {
            if let Some(q) = rows.get(lane).or(rows.first()) {
                self.batch.set(screen, lane, q);
            }
        }
        let mut hits = vec![false; rows.len()];
        if rows.is_empty() {
            return Ok(hits);
        }
        screen.place(&mut self.batch);
        let mut suspects = Vec::new();
        screen.survey(&mut self.batch, &self.needs, 0.0, |s| {
            suspects.push(*s);
            true
        });
        for (lane, hit) in hits.iter_mut().enumerate() {
            // A NaN must not count as collision-free.
            let near: Vec<_> = suspects.iter().filter(|s| s.gap[lane].is_nan() || s.gap[lane] < 0.0).collect();
            if near.is_empty() {
                continue;
            }
            Compiled::poses(self.scene, rows[lane], &mut self.poses);
            *hit = !near.iter().all(|s| screen.keeps(s.group, s.other, &self.poses, 0.0));
        }
        Ok(hits)
    }

    /// Returns the smallest signed distance (m) over all checked pairs at `q`, at most `max_distance`.
    ///
    /// # Errors
    /// As [`Checker::hits`].
    pub fn distance(&mut self, q: &[f64], max_distance: f64) -> Result<f64, ProblemError> {
        self.place(q, max_distance)?;
        let mut least = max_distance;
        for (group, other) in &self.suspects {
            least = least.min(self.world.screen.distance(*group, *other, &self.poses, least.max(0.0)));
        }
        Ok(least)
    }

    /// Returns all pairs closer than `reach` (m) at `q`, closest first, each pair once.
    ///
    /// # Errors
    /// As [`Checker::hits`].
    pub fn near(&mut self, q: &[f64], reach: f64) -> Result<Vec<Nearness>, ProblemError> {
        self.place(q, reach)?;
        if self.suspects.is_empty() {
            return Ok(Vec::new());
        }
        let (scene, world) = (self.scene, self.world);
        let full = self.full.get_or_insert_with(|| Full::new(scene, world));
        let mut out = full.near(&self.poses, reach);
        out.sort_by(|a, b| a.distance.total_cmp(&b.distance));
        Ok(out)
    }
}

impl<'s> Full<'s> {
    fn new(scene: &'s Scene, world: &'s Compiled) -> Self {
        let robot = &**scene.robot();
        let checked = world.screen.pairs();
        let objects =
            CollisionObjects::new(robot, scene.bodies(), |b| b.role == Role::Attached, |_| false, |_, _| true);
        let shapes = MovingShapes::new(objects.groups.iter().map(|g| match g {
            Group::Link(l) => robot.links()[*l].shapes(),
            Group::Riding(b) | Group::Moved(b) => &scene.bodies()[*b].shapes,
        }));
        let grasps = objects
            .groups
            .iter()
            .map(|g| match g {
                Group::Riding(b) => scene.bodies()[*b].pose,
                Group::Link(_) | Group::Moved(_) => Pose::identity(),
            })
            .collect();
        Self {
            all: (0..objects.groups.len()).collect(),
            moving: (0..objects.groups.len()).filter(|g| !world.carriers[*g].is_empty()).collect(),
            pairs: (0..objects.pairs.len()).filter(|p| checked.contains(&objects.pairs[*p])).collect(),
            objects,
            shapes,
            obstacles: scene.bodies().obstacles(),
            grasps,
            scratch: Scratch::remembering(),
        }
    }

    fn near(&mut self, links: &[Pose], reach: f64) -> Vec<Nearness> {
        let hand = links[self.objects.robot.hand()];
        self.shapes.place(&self.all, &mut self.scratch, |poses| {
            poses.clear();
            poses.extend_from_slice(links);
            for grasp in &self.grasps[links.len()..] {
                poses.push(hand * grasp);
            }
        });
        let mut out = Vec::new();
        let objects = &self.objects;
        let mut tell = |p: &gensim2_geometry::Proximity| {
            let second = match p.target {
                Target::Body(b) => objects.bodies[b].name.as_str(),
                Target::Group(g) => objects.name(g),
            };
            out.push(Nearness {
                first: objects.name(p.group).to_owned(),
                second: second.to_owned(),
                distance: p.contact.distance,
                point: center(&p.contact.on_first, &p.contact.on_second),
            });
            true
        };
        self.shapes.near_bodies(&self.moving, self.obstacles, &mut self.scratch, EXACT, |_, _| reach, |p| tell(&p));
        self.shapes.near_pairs(&objects.pairs, &self.pairs, &mut self.scratch, EXACT, |_| reach, |_, p| tell(&p));
        out
    }
}

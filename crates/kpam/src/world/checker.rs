//! Collision checks of many configurations without contact rules.

use std::collections::BTreeMap;

use gensim2_geometry::{Batch, Contact, LANES, Needs, Other, Pose};
use nalgebra::{Point3, Vector3, center};

use super::Scene;
use super::compiled::Compiled;
use crate::ProblemError;
use crate::error::for_each_joint;

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
    /// Groups and bodies that may be too close, each with a lower bound of their distance (m).
    suspects: Vec<(usize, Other, f32)>,
    poses: Vec<Pose>,
}

impl<'s> Checker<'s> {
    pub(super) fn new(scene: &'s Scene) -> Self {
        let world = scene.compiled();
        Self { scene, world, needs: world.needs(0.0), batch: Batch::default(), suspects: Vec::new(), poses: Vec::new() }
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
            suspects.push((s.group, s.other, s.gap[0]));
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
        Ok(!self
            .suspects
            .iter()
            .all(|(group, other, _)| self.world.screen.keeps(*group, *other, &self.poses, 0.0, &mut Vector3::zeros())))
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
            *hit = !near.iter().all(|s| screen.keeps(s.group, s.other, &self.poses, 0.0, &mut Vector3::zeros()));
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
        for (group, other, _) in &self.suspects {
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
        let screen = &self.world.screen;
        // The likely closest shapes of a body are measured first, and shapes that are certainly further away are skipped.
        self.suspects.sort_by(|a, b| a.2.total_cmp(&b.2));
        let mut found: BTreeMap<_, (Other, Contact)> = BTreeMap::new();
        for &(group, other, gap) in &self.suspects {
            let pair = if let Other::Pair(pair) = other { Some(pair) } else { None };
            let pair = (group, screen.body(other), pair);
            let least = found.get(&pair).map_or(reach, |(_, contact)| contact.distance);
            if f64::from(gap) > least {
                continue;
            }
            if let Some(contact) = screen.contact(group, other, &self.poses, least, None) {
                found.insert(pair, (other, contact));
            }
        }
        let near = found.into_iter().map(|((group, ..), (other, contact))| {
            let [first, second] = self.world.named(self.scene, group, other);
            let point = center(&contact.on_first, &contact.on_second);
            Nearness { first, second, distance: contact.distance, point }
        });
        let mut out: Vec<Nearness> = near.collect();
        out.sort_by(|a, b| a.distance.total_cmp(&b.distance));
        Ok(out)
    }
}

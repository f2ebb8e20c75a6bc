//! Where a robot is free: configurations and straight edges, eight configurations at a time, and in full where that
//! cannot tell.

use std::time::Instant;

use gensim2_geometry::{Batch, LANES, Needs, Pose, Suspect};

use crate::model::{MOST_JOINTS, Model, Row};
use crate::world::Compiled;
use crate::{Cancel, Scene};

/// Distances (weighted, m) between the configurations of an edge that are looked at.
pub(super) const RESOLUTION: f64 = 0.04;

/// When a search ends early.
#[derive(Debug, Clone, Default)]
pub(super) struct Ending {
    pub cancel: Option<Cancel>,
    pub deadline: Option<Instant>,
    pub max_checks: Option<u64>,
}

/// A scene as one search sees it.
pub(super) struct Field<'s> {
    pub scene: &'s Scene,
    pub world: &'s Compiled,
    pub model: &'s Model,
    /// What has to be kept.
    pub needs: Needs,
    /// How far the robot's furthest points move with each variable, in the mean (m): the metric of the search.
    pub weights: Row,
    pub resolution: f64,
    /// Configurations looked at.
    pub checks: u64,
    ending: Ending,
    batch: Batch,
    suspects: Vec<Suspect>,
    poses: Vec<Pose>,
    q: Vec<f64>,
    rows: [Row; LANES],
}

impl<'s> Field<'s> {
    pub fn new(scene: &'s Scene, model: &'s Model, needs: Needs, ending: Ending) -> Self {
        let world = scene.compiled();
        let mut weights = [0.0; MOST_JOINTS];
        for driven in model.map().driven() {
            weights[driven.variable] += driven.factor.abs() * world.levers[driven.joint];
        }
        Self {
            scene,
            world,
            model,
            needs,
            weights,
            resolution: RESOLUTION,
            checks: 0,
            ending,
            batch: Batch::default(),
            suspects: Vec::new(),
            poses: Vec::new(),
            q: Vec::new(),
            rows: [[0.0; MOST_JOINTS]; LANES],
        }
    }

    /// Whether the search has to end.
    pub fn is_over(&self) -> bool {
        self.ending.max_checks.is_some_and(|most| self.checks >= most) || self.is_cancelled() || self.is_late()
    }

    pub fn is_cancelled(&self) -> bool {
        self.ending.cancel.as_ref().is_some_and(Cancel::is_cancelled)
    }

    /// Whether the deadline has passed.
    pub fn is_late(&self) -> bool {
        self.ending.deadline.is_some_and(|end| Instant::now() >= end)
    }

    /// Weighted length (m) of a straight edge.
    pub fn length(&self, a: &Row, b: &Row) -> f64 {
        (0..self.model.n()).map(|v| (self.weights[v] * (b[v] - a[v])).powi(2)).sum::<f64>().sqrt()
    }

    /// Whether the first `count` rows are free, all of them.
    fn are_rows_free(&mut self, count: usize) -> bool {
        self.checks += count as u64;
        let world = self.world;
        for lane in 0..LANES {
            // Lanes that are left over look at what another looks at.
            self.model.map().positions(&self.rows[if lane < count { lane } else { 0 }], &mut self.q);
            self.batch.set(&world.screen, lane, &self.q);
        }
        world.screen.place(&mut self.batch);
        self.suspects.clear();
        let suspects = &mut self.suspects;
        world.screen.survey(&mut self.batch, &self.needs, 0.0, |s| {
            suspects.push(*s);
            true
        });
        if suspects.is_empty() {
            return true;
        }
        // What looks deepest is likeliest to hit.
        let deepest = |s: &Suspect| s.gap[..count].iter().copied().fold(f32::INFINITY, f32::min);
        suspects.sort_by(|a, b| deepest(a).total_cmp(&deepest(b)));
        let mut posed = usize::MAX;
        for s in suspects.iter() {
            let apart = world.screen.needed(&self.needs, s.group, s.other);
            for lane in 0..count {
                // What is no number is not clear.
                if s.gap[lane] >= 0.0 {
                    continue;
                }
                if posed != lane {
                    self.model.map().positions(&self.rows[lane], &mut self.q);
                    Compiled::poses(self.scene, &self.q, &mut self.poses);
                    posed = lane;
                }
                if !world.screen.keeps(s.group, s.other, &self.poses, apart) {
                    return false;
                }
            }
        }
        true
    }

    /// Whether configurations along the straight edge from `a`, which is free, to `b` are free, that included. They are
    /// spread over the whole edge first, then ever closer.
    pub fn is_edge_free(&mut self, a: &Row, b: &Row) -> bool {
        let steps = ((self.length(a, b) / self.resolution).ceil() as usize).max(1);
        let batches = steps.div_ceil(LANES);
        let n = self.model.n();
        for batch in 0..batches {
            let mut count = 0;
            // Every batch has members all along the edge, the last configuration among those of the first.
            let mut k = steps - batch;
            loop {
                let share = k as f64 / steps as f64;
                let row = &mut self.rows[count];
                *row = *b;
                if k < steps {
                    for v in 0..n {
                        row[v] = a[v] + (b[v] - a[v]) * share;
                    }
                }
                count += 1;
                if k <= batches || count == LANES {
                    break;
                }
                k -= batches;
            }
            if !self.are_rows_free(count) {
                return false;
            }
        }
        true
    }
}

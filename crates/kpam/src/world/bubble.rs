//! Collision-free neighbourhoods of collision-free states (Quinlan's bubbles).

use crate::model::{MAX_JOINTS, Row};

/// A group, the body near it, and the gap between both.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Near {
    pub gap: f64,
    pub group: usize,
    /// Second group of the pair, or `None` if the second body is fixed.
    pub other: Option<usize>,
}

/// Whether each joint moves each group: one row for each group; the object's joint is the last entry of a row.
#[derive(Debug, Clone, Default)]
pub(crate) struct Carried {
    pub joints: usize,
    pub flags: Vec<bool>,
}

impl Carried {
    pub fn row(&self, group: usize) -> &[bool] {
        &self.flags[group * self.joints..(group + 1) * self.joints]
    }

    /// Whether a planned motion moves a group.
    pub fn moves(&self, group: usize) -> bool {
        self.row(group).iter().any(|m| *m)
    }
}

/// A collision-free state and the surrounding states that are collision-free as well. A state consists of the arm's
/// joint values and the travel of the object's joint, which counts as the last joint here.
#[derive(Debug, Clone)]
pub(crate) struct Bubble {
    pub center: Row,
    pub travel: f64,
    /// Number of joints.
    pub joints: usize,
    /// Maximum distance of each group's points from each joint's axis (m), one row for each group.
    pub levers: Vec<f64>,
    pub pairs: Vec<Near>,
}

impl Default for Bubble {
    fn default() -> Self {
        Self { center: [0.0; MAX_JOINTS], travel: 0.0, joints: 0, levers: Vec::new(), pairs: Vec::new() }
    }
}

impl Bubble {
    /// Returns whether the state at offset `steps` from the centre is inside the bubble.
    pub fn holds(&self, carried: &Carried, steps: &[f64]) -> bool {
        self.pairs.iter().all(|p| self.used(carried, p, steps) <= p.gap)
    }

    /// Returns the largest factor by which `steps` can be multiplied without leaving the bubble.
    pub fn times(&self, carried: &Carried, steps: &[f64]) -> f64 {
        self.pairs.iter().map(|p| p.gap / self.used(carried, p, steps)).fold(f64::INFINITY, f64::min)
    }

    fn lever(&self, group: usize) -> &[f64] {
        &self.levers[group * self.joints..(group + 1) * self.joints]
    }

    /// Returns an upper bound on the fraction of a pair's gap that a step uses up. A point at distance r from a joint's
    /// axis moves at most r + d per radian while it stays within d of its position.
    fn used(&self, carried: &Carried, p: &Near, steps: &[f64]) -> f64 {
        let mut way = 0.0;
        let mut turn = 0.0;
        let mine = self.lever(p.group);
        match p.other {
            None => {
                for (step, lever) in steps.iter().zip(mine) {
                    way += step * lever;
                    turn += step;
                }
            }
            Some(other) => {
                let theirs = self.lever(other);
                let (carries, too) = (carried.row(p.group), carried.row(other));
                for (m, step) in steps.iter().enumerate() {
                    // A joint that moves both groups does not change their relative position.
                    if !(carries[m] && too[m]) {
                        way += step * mine[m].max(theirs[m]);
                        turn += step;
                    }
                }
            }
        }
        way + turn * p.gap
    }

    /// Returns the maximum displacement of any point over `steps`, to first order.
    pub fn fastest(&self, steps: &[f64]) -> f64 {
        self.levers
            .chunks_exact(self.joints.max(1))
            .map(|levers| levers.iter().zip(steps).map(|(l, s)| l * s).sum::<f64>())
            .fold(0.0, f64::max)
    }
}

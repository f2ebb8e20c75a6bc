//! Required distances of the checked pairs of a scene that is prepared for fast checks.

use gensim2_geometry::{Needs, Other, Screen};

use super::query::Seen;
use super::rules::{Group, Verdict};
use super::{Compiled, Margins, MotionSegment, World};
use crate::Role;

/// Required distance (m) of each checked pair of a scene, negative for a pair that may overlap; minus infinity for pairs
/// that are not checked.
#[derive(Debug, Clone)]
pub(crate) struct Required {
    exact: Needs,
    /// Required distances for the screening, which cannot bound the depth of an overlap: zero for pairs that may overlap.
    screened: Needs,
}

impl From<Needs> for Required {
    fn from(exact: Needs) -> Self {
        let mut screened = exact.clone();
        for need in screened.bodies.iter_mut().chain(&mut screened.pairs) {
            if *need > f64::NEG_INFINITY {
                *need = need.max(0.0);
            }
        }
        Self { exact, screened }
    }
}

impl Required {
    /// Distances at which pairs are screened.
    pub fn screened(&self) -> &Needs {
        &self.screened
    }

    /// Returns the required distance of a group and another body.
    pub fn of(&self, screen: &Screen, group: usize, other: Other) -> f64 {
        screen.needed(&self.exact, group, other)
    }
}

impl World<'_> {
    /// Returns the required distances in a segment before the actuation pose. `scene` is the prepared scene of the same
    /// problem, in which only attached bodies move with the robot.
    pub fn required(&self, scene: &Compiled, segment: MotionSegment, margins: &Margins) -> Required {
        let (links, bodies) = (self.problem.robot.links().len(), self.problem.bodies.len());
        let attached = (0..bodies).filter(|b| self.problem.bodies[*b].role == Role::Attached);
        let held = attached.filter_map(|b| self.objects.groups.iter().position(|group| *group == Group::Riding(b)));
        let groups: Vec<usize> = (0..links).chain(held).collect();
        let table = self.table(segment);
        let mut needs = scene.needs(0.0);
        for (row, group) in needs.bodies.chunks_mut(bodies.max(1)).zip(&groups) {
            for (body, need) in row.iter_mut().enumerate() {
                *need = match table.bodies[group * bodies + body] {
                    Verdict::Apart => f64::NEG_INFINITY,
                    Verdict::Checked | Verdict::MayTouch(_) => self.asked(segment, margins, *group, Seen::Body(body)),
                };
            }
        }
        for (need, (a, b)) in needs.pairs.iter_mut().zip(scene.screen.pairs()) {
            let same = |pair: &&usize| self.objects.pairs[**pair] == (groups[*a], groups[*b]);
            *need = match table.pairs.iter().find(same) {
                Some(pair) => self.asked(segment, margins, groups[*a], Seen::Pair(*pair)),
                None => f64::NEG_INFINITY,
            };
        }
        needs.into()
    }
}

//! Required distances of the checked pairs of a scene that is prepared for fast checks.

use std::collections::HashMap;

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
        let checked: HashMap<(usize, usize), usize> =
            table.pairs.iter().map(|pair| (self.objects.pairs[*pair], *pair)).collect();
        for (need, (a, b)) in needs.pairs.iter_mut().zip(scene.screen.pairs()) {
            *need = match checked.get(&(groups[*a], groups[*b])) {
                Some(pair) => self.asked(segment, margins, groups[*a], Seen::Pair(*pair)),
                None => f64::NEG_INFINITY,
            };
        }
        needs.into()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use gensim2_geometry::{Convex, Draws, Joint, Link, Pose, Robot};
    use nalgebra::Vector3;

    use super::*;
    use crate::config::{Constraint, Motion};
    use crate::model::{MAX_JOINTS, Model};
    use crate::transit::{Ending, Field};
    use crate::world::State;
    use crate::{Body, KeypointProblem, Options, SolverConfig};

    /// A problem of a pen on two slides beside its own frame, a wall, a cup that the pen reaches for, and a held box.
    fn problem(options: Options) -> KeypointProblem {
        let cube = |half: f64| Convex::cuboid([half; 3], &Pose::identity()).unwrap();
        let slide = |name: &str, axis| Joint::prismatic(name, axis).limits(-0.5, 0.5).velocity(1.0);
        let above = Convex::cuboid([0.02; 3], &Pose::translation(0.0, 0.0, 1.0)).unwrap();
        let frame = Convex::cuboid([0.1, 0.05, 0.1], &Pose::translation(0.4, 0.0, 0.0)).unwrap();
        let robot = Robot::builder("plotter")
            .link(Link::base("frame").shape(frame))
            .link(Link::below("frame", "bridge").moved_by(slide("x", Vector3::x())).shape(above))
            .link(Link::below("bridge", "pen").moved_by(slide("y", Vector3::y())).shape(cube(0.05)))
            .build("pen")
            .unwrap();
        let body = |name: &str, role, half, x, y| {
            let body = Body::builder(name, role).shape(cube(half)).pose(Pose::translation(x, y, 0.0));
            body.keypoint("middle", Vector3::zeros()).build().unwrap()
        };
        let bodies = vec![
            body("wall", Role::Rigid, 0.1, -0.1, -0.4),
            body("held", Role::Attached, 0.02, 0.0, 0.08),
            body("cup", Role::Target, 0.1, -0.3, 0.3),
        ];
        let config = SolverConfig::builder().constraint(Constraint::point("tip", "goal", 1e-3));
        let config = config.pre(Motion::Translate { axis: 1, distance: -0.1 }).build().unwrap();
        let builder = KeypointProblem::builder(Arc::new(robot), config, vec![0.0, 0.0]).object(Pose::identity());
        let builder = builder.tool_keypoint("tip", Vector3::zeros()).object_keypoint("goal", Vector3::zeros());
        builder.bodies(bodies).options(options).build().unwrap()
    }

    #[test]
    fn the_required_distances_are_kept_exactly_where_no_pair_violates_its_margin() {
        let deep = Options { contact_depth: Some(0.02), ..Options::default() };
        let apart = Options { reach_clearance: Some(0.03), ..Options::default() };
        let mut draws = Draws::of(5, 6);
        for options in [Options::default(), deep, apart] {
            let (problem, scene) = (problem(options.clone()), problem(options).scene());
            let model = Model::new(&problem.robot, &problem.q_start).unwrap();
            let mut world = World::new(&problem, &model);
            let mut row = || -> [f64; MAX_JOINTS] {
                let mut x = [0.0; MAX_JOINTS];
                x[..2].iter_mut().for_each(|value| *value = draws.unit() - 0.5);
                x
            };
            for segment in [MotionSegment::Approach, MotionSegment::ToActuation] {
                let start = row();
                world.measure_start(State::still(&start), segment);
                let near = world.margins_between([State::still(&start), State::still(&row())], segment, 0.05);
                for margins in [Margins::plain(0.0), Margins::plain(0.04), near.clone(), near.parted()] {
                    let required = world.required(scene.compiled(), segment, &margins);
                    let mut field = Field::new(&scene, &model, required, Ending::default());
                    let mut free = 0;
                    for _ in 0..300 {
                        let x = row();
                        let hit = world.hit_at(State::still(&x), segment, &margins);
                        assert_eq!(
                            field.blocked_at(&[x]).is_none(),
                            hit.is_none(),
                            "{segment:?} {margins:?} {x:?} {hit:?}"
                        );
                        free += u32::from(hit.is_none());
                    }
                    assert!((30..270).contains(&free), "{free}");
                }
            }
        }
    }
}

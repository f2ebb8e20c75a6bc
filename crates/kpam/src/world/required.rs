//! Required distances of the checked pairs of a scene that is prepared for fast checks.

use gensim2_geometry::{Needs, Other, Screen};

use super::query::Seen;
use super::rules::{Carrier, Group, Verdict};
use super::{Compiled, Margins, MotionSegment, Rider, World};
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

/// Pairs of groups that are checked in a segment.
struct Checked {
    groups: usize,
    /// Index of the pair of each two groups, in rows by the first group.
    pairs: Vec<Option<usize>>,
}

impl Checked {
    fn pair(&self, a: usize, b: usize) -> Option<usize> {
        self.pairs[a * self.groups + b]
    }
}

impl World<'_> {
    fn checked_pairs(&self, segment: MotionSegment) -> Checked {
        let groups = self.objects.groups.len();
        let mut pairs = vec![None; groups * groups];
        for pair in &self.table(segment).pairs {
            let (a, b) = self.objects.pairs[*pair];
            pairs[a * groups + b] = Some(*pair);
        }
        Checked { groups, pairs }
    }

    /// Returns the group of each group of a prepared scene.
    fn groups_of(&self, scene: &Compiled) -> Vec<usize> {
        let riding = |b: &usize| self.objects.groups.iter().position(|group| *group == Group::Riding(*b));
        (0..self.problem.robot.links().len()).chain(scene.riders.iter().filter_map(riding)).collect()
    }

    /// Returns the required distances in a segment, except those from bodies that the object's joint moves. `scene` is
    /// the prepared [scene of the segment](World::riders).
    pub fn required(&self, scene: &Compiled, segment: MotionSegment, margins: &Margins) -> Required {
        let (bodies, groups) = (self.problem.bodies.len(), self.groups_of(scene));
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
        let checked = self.checked_pairs(segment);
        for (need, (a, b)) in needs.pairs.iter_mut().zip(scene.screen.pairs()) {
            *need = match checked.pair(groups[*a], groups[*b]) {
                Some(pair) => self.asked(segment, margins, groups[*a], Seen::Pair(pair)),
                None => f64::NEG_INFINITY,
            };
        }
        needs.into()
    }

    /// Returns the required distances from the bodies that the object's joint moves in a segment; `None` if no distance
    /// is required.
    pub fn required_from_moved(&self, scene: &Compiled, segment: MotionSegment, margins: &Margins) -> Option<Required> {
        let groups = self.groups_of(scene);
        let (checked, bodies) = (self.checked_pairs(segment), self.problem.bodies.len());
        let moved = |(g, what): (usize, &Group)| if let Group::Moved(body) = what { Some((g, *body)) } else { None };
        let mut needs: Option<Needs> = None;
        for (other, body) in self.objects.groups.iter().enumerate().filter_map(moved) {
            for (row, group) in groups.iter().enumerate() {
                let Some(pair) = checked.pair(*group, other) else { continue };
                let needs = needs.get_or_insert_with(|| scene.needs(f64::NEG_INFINITY));
                needs.bodies[row * bodies + body] = self.asked(segment, margins, *group, Seen::Pair(pair));
            }
        }
        needs.map(Required::from)
    }

    /// Returns the bodies that move with the hand in a segment, or that the hand has put down, if they are not the
    /// attached bodies. The latter move with the base.
    pub fn riders(&self, segment: MotionSegment) -> Option<Vec<Rider>> {
        let (robot, carriers) = (&self.problem.robot, &self.table(segment).carriers);
        let (mut out, mut is_same) = (Vec::new(), true);
        for (group, what) in self.objects.groups.iter().enumerate() {
            let Group::Riding(body) = *what else { continue };
            let (link, pose) = match carriers[group] {
                Carrier::Hand => (robot.hand(), self.grasps[group]),
                Carrier::Placed => (0, self.placed[group]),
                Carrier::Robot | Carrier::Joint | Carrier::Absent => continue,
            };
            is_same &= carriers[group] == Carrier::Hand && self.problem.bodies[body].role == Role::Attached;
            out.push(Rider { body, link, pose });
        }
        (!is_same).then_some(out)
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
    use crate::timing::{Builder, Limits};
    use crate::transit::{Breach, Carriage, Ending, Field, Sweep};
    use crate::world::State;
    use crate::{Body, Cancel, KeypointProblem, ObjectJoint, ObjectJointKind, Options, SolverConfig};

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

    /// A pen on two slides beside a drawer, which moves along x after the actuation, and a fixed wall.
    fn beside_a_drawer(options: Options) -> KeypointProblem {
        let cube = |half: f64| Convex::cuboid([half; 3], &Pose::identity()).unwrap();
        let slide = |name: &str, axis| Joint::prismatic(name, axis).limits(-0.5, 0.5).velocity(1.0);
        let robot = Robot::builder("plotter")
            .link(Link::base("frame"))
            .link(Link::below("frame", "bridge").moved_by(slide("x", Vector3::x())))
            .link(Link::below("bridge", "pen").moved_by(slide("y", Vector3::y())).shape(cube(0.05)))
            .build("pen")
            .unwrap();
        let body = |name: &str, role, x, y| {
            Body::builder(name, role).shape(cube(0.1)).pose(Pose::translation(x, y, 0.0)).build().unwrap()
        };
        let mut bodies = vec![body("wall", Role::Rigid, 0.3, 0.3), body("drawer", Role::MovingLink, -0.2, -0.1)];
        let held = Body::builder("held", Role::Attached).shape(cube(0.03)).pose(Pose::translation(0.0, 0.09, 0.0));
        bodies.push(held.build().unwrap());
        let rail = ObjectJoint::new(ObjectJointKind::Prismatic, Vector3::zeros(), Vector3::x(), 0.0, [0.0, 0.4]);
        let config = SolverConfig::builder().constraint(Constraint::point("tip", "goal", 1e-3));
        let config = config.post(Motion::FollowJoint(0.3)).build().unwrap();
        let builder = KeypointProblem::builder(Arc::new(robot), config, vec![0.0, 0.0]).object(Pose::identity());
        let builder = builder.tool_keypoint("tip", Vector3::zeros()).object_keypoint("goal", Vector3::zeros());
        builder.bodies(bodies).joint(rail.unwrap()).options(options).build().unwrap()
    }

    #[test]
    fn a_proof_beside_a_moved_body_fails_exactly_where_a_pair_violates_its_margin() {
        let deep = Options { contact_depth: Some(0.02), ..Options::default() };
        let released = Options { release: vec!["held".to_owned()], ..Options::default() };
        let mut draws = Draws::of(8, 1);
        for options in [Options::default(), deep, released] {
            let problem = beside_a_drawer(options);
            let (scene, rest) = (problem.scene(), Model::new(&problem.robot, &[0.0, 0.0]).unwrap());
            let mut world = World::new(&problem, &rest);
            let segment = MotionSegment::Post(0);
            let mut free = 0;
            for _ in 0..400 {
                let q: Vec<f64> = (0..2).map(|_| draws.unit() - 0.5).collect();
                let (model, travel) = (Model::new(&problem.robot, &q).unwrap(), 0.4 * draws.unit());
                world.act_at(&[0.0; MAX_JOINTS], None);
                let margins = Margins::plain(0.03 * draws.unit());
                let hit = world.hit_at(State { x: &model.start(), travel }, segment, &margins);
                let changed = world.riders(segment).map(|riders| Compiled::with_riders(&scene, &riders));
                let compiled = changed.as_ref().unwrap_or_else(|| scene.compiled());
                let (needs, over) = (world.required(compiled, segment, &margins), Cancel::new());
                let still = Builder::new(Limits::of(&problem, &model), 0.0).build(model.map());
                let weights = model.mean_levers(&problem.robot);
                let mut sweep = Sweep::new((&scene, compiled), &model, &needs, weights, &over);
                let mut met = sweep.breach(&still, [0.0, 0.0]).err();
                let needs = world.required_from_moved(compiled, segment, &margins).unwrap();
                if met.is_none() {
                    let carriage = Carriage { joint: problem.joint.unwrap(), times: vec![0.0], travel: vec![travel] };
                    met = sweep.beside(carriage, &needs).breach(&still, [0.0, 0.0]).err();
                }
                assert_eq!(hit.is_some(), met.is_some(), "{q:?} {travel} {hit:?} {met:?}");
                if let (Some(hit), Some(Breach::Near(found))) = (&hit, &met) {
                    let names = [&found.first, &found.second];
                    let other = world.lacking(State { x: &model.start(), travel }, segment, &margins) > 0.0;
                    assert!(
                        other && (names != [&hit.first, &hit.second] || (hit.distance - found.distance).abs() < 1e-6)
                    );
                }
                free += u32::from(met.is_none());
            }
            assert!((100..390).contains(&free), "{free}");
        }
    }
}

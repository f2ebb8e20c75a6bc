//! Searches the free motion to the first keyframe, and the motion out of an overlap at the start.

use gensim2_geometry::Draws;

use super::planner::Planner;
use crate::Scene;
use crate::model::{MAX_JOINTS, Model, Row, between};
use crate::transit::{Field, Searches, effort_along};
use crate::world::{Hit, Margins, MotionSegment, State, TOUCH, Way, World};

/// Number of directions tried out of an overlap, with growing distance, and the maximum distance (m); each variable is
/// multiplied by its mean lever arm.
const EXITS: usize = 96;
const EXIT: f64 = 0.6;
/// Distance (m) between checks on the motion out of an overlap.
const EXIT_STEP: f64 = 0.005;
/// Number of paths that are searched. The quickest one that is proven collision-free is used.
const WAYS: usize = 3;
/// After this number of consecutive searches in which no sample could be connected to the start, the search for a free
/// motion is given up.
const BOXED_IN: usize = 3;

/// Reason why no collision-free motion was found.
#[derive(Debug, Clone)]
pub(super) enum NoWay {
    /// The robot collides at the start or at the goal.
    Blocked(Hit),
    /// The maximum number of samples was reached. This obstacle blocks the straight segment.
    NotFound(Hit),
    /// The maximum number of samples was reached, and no sample could be connected to the start.
    BoxedIn(Hit),
}

/// A search for a collision-free motion in one segment.
struct Search<'s> {
    scene: &'s Scene,
    model: &'s Model,
    segment: MotionSegment,
    margins: &'s Margins,
    /// Weight of each variable in the length of a path (seconds per unit).
    pace: Row,
    /// Maximum number of samples, and their seed.
    samples: usize,
    seed: usize,
    /// Whether paths are proven, and not only checked at samples.
    proves: bool,
}

impl Search<'_> {
    /// Returns the vertices of a collision-free joint path from `a` to `b`, including `a` and `b`, then those of slower
    /// paths, which must be proven before they are used.
    fn paths(&self, world: &mut World<'_>, a: &Row, b: &Row) -> Result<Vec<Vec<Row>>, NoWay> {
        for end in [b, a] {
            if let Some(hit) = world.hit_at(State::still(end), self.segment, self.margins) {
                return Err(NoWay::Blocked(hit));
            }
        }
        let Some(hit) = world.sweep(a, b, self.segment, self.margins) else { return Ok(vec![vec![*a, *b]]) };
        if self.samples == 0 {
            return Err(NoWay::NotFound(hit));
        }
        let needs = world.required(self.scene.compiled(), self.segment, self.margins);
        let mut field = Field::new(self.scene, self.model, needs, world.ending());
        let mut searches = Searches::new(self.samples, self.seed);
        let (mut is_boxed_in, mut found, mut is_spent, mut charged) = (false, None, false, 0);
        while found.is_none() && !is_spent {
            let mut ways: Vec<(f64, Vec<Row>)> = Vec::new();
            let mut has_missed = false;
            for _ in 0..WAYS {
                match searches.next(&mut field, a, &[*b], &self.pace) {
                    Some(Ok(paths)) => {
                        (is_boxed_in, has_missed) = (false, true);
                        // The straight segment is known to be blocked.
                        let bent = paths.into_iter().filter(|path| path.len() > 2);
                        ways.extend(bent.map(|path| (effort_along(self.model.n(), &self.pace, &path), path)));
                    }
                    Some(Err(unmet)) => is_boxed_in = unmet.is_boxed_in,
                    None => is_spent = true,
                }
            }
            ways.sort_by(|a, b| a.0.total_cmp(&b.0));
            // The search checks single configurations, so its paths are not proven yet.
            let proven = ways.iter().position(|(_, way)| {
                field.is_way_free(way)
                    && (!self.proves || world.sweep_along(Way::still(way), self.segment, self.margins).is_none())
                    && !world.cut_short()
            });
            found = proven.map(|first| ways.drain(first..).map(|(_, way)| way).collect());
            if found.is_none() && has_missed {
                field.refine();
            }
            world.spend(field.checks - charged);
            charged = field.checks;
            is_spent |= world.is_over();
        }
        found.ok_or(if is_boxed_in { NoWay::BoxedIn(hit) } else { NoWay::NotFound(hit) })
    }
}

impl Planner<'_> {
    /// Searches a collision-free path between two joint vectors that keeps `margins`, and returns its vertices, then those
    /// of slower paths, which must be proven before they are used. Unless `proves` is set, the first path is only checked
    /// at samples, too.
    pub(super) fn connect(
        &mut self,
        from: &Row,
        to: &Row,
        segment: MotionSegment,
        margins: &Margins,
        samples: usize,
        proves: bool,
    ) -> Result<Vec<Vec<Row>>, NoWay> {
        // After several poses without any sample connected to the start, searches for other poses would fail too.
        let samples = if self.boxed_in < BOXED_IN { samples } else { 0 };
        let pace = self.builder.limits().pace();
        let (scene, model, seed) = (&self.scene, self.model, self.problem.options.seed);
        let search = Search { scene, model, segment, margins, pace, samples, seed, proves };
        let found = search.paths(&mut self.world, from, to);
        match found {
            Err(NoWay::BoxedIn(_)) => self.boxed_in += 1,
            Err(NoWay::NotFound(_)) if samples > 0 => self.boxed_in = 0,
            Ok(_) | Err(_) => {}
        }
        found
    }
}

/// Returns a collision-free pose near a start at which the robot overlaps a body. Along the straight segment to this
/// pose, the overlap only decreases, and all other pairs of bodies keep the margins.
pub(super) fn way_out(
    world: &mut World<'_>,
    model: &Model,
    start: &Row,
    segment: MotionSegment,
    kept: &Margins,
    seed: usize,
) -> Option<Row> {
    let (n, weights) = (model.n(), model.mean_levers(&world.problem.robot));
    let mut draws = Draws::of(0x6578_6974, seed);
    let free = Margins::plain(2.0 * TOUCH).parted();
    for k in 0..EXITS {
        let length = EXIT * (k + 1) as f64 / EXITS as f64;
        let mut way = [0.0; MAX_JOINTS];
        for value in way.iter_mut().take(n) {
            *value = 2.0 * draws.unit() - 1.0;
        }
        let norm = way.iter().map(|w| w * w).sum::<f64>().sqrt();
        if norm < 1e-6 {
            continue;
        }
        let mut end = *start;
        for v in 0..n {
            end[v] = (start[v] + way[v] * length / (norm * weights[v])).clamp(model.lower[v], model.upper[v]);
        }
        if world.hit_at(State::still(&end), segment, &free).is_some() {
            continue;
        }
        let steps = (length / EXIT_STEP).ceil() as usize;
        // Each overlapping pair is tracked separately: once it is separated, it must stay separated.
        let mut before = world.overlaps(State::still(start), segment);
        let lessens = (1..=steps).all(|i| {
            let next = world.overlaps(State::still(&between(start, &end, i as f64 / steps as f64)), segment);
            let less = !world.cut_short() && next.iter().all(|overlap| overlap.lessens(&before));
            before = next;
            less
        });
        if lessens && world.sweep(start, &end, segment, kept).is_none() {
            return Some(end);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::sync::Arc;

    use gensim2_geometry::{Convex, Joint, Link, Pose, Robot};
    use nalgebra::Vector3;

    use super::*;
    use crate::config::Constraint;
    use crate::{Body, KeypointProblem, Role, SolverConfig};

    /// Searches a path for a cube of 2 cm on two slides, from the middle of a square chamber to a point outside. The
    /// inner half width is `room` (m). The right wall ends at `door` (m), and a screen stands behind the opening.
    fn out_of_a_chamber(room: f64, door: f64) -> Result<Vec<Row>, NoWay> {
        let slide = |name: &str, axis| Joint::prismatic(name, axis).limits(-1.0, 1.0).velocity(1.0);
        let pen = Convex::cuboid([0.01; 3], &Pose::identity()).unwrap();
        let robot = Robot::builder("plotter")
            .link(Link::base("base"))
            .link(Link::below("base", "bridge").moved_by(slide("x", Vector3::x())))
            .link(Link::below("bridge", "pen").moved_by(slide("y", Vector3::y())).shape(pen))
            .build("pen")
            .unwrap();
        let robot = Arc::new(robot);
        let wall = |name: &str, x: [f64; 2], y: [f64; 2]| {
            let half = [0.5 * (x[1] - x[0]), 0.5 * (y[1] - y[0]), 0.1];
            let shape = Convex::cuboid(half, &Pose::identity()).unwrap();
            let pose = Pose::translation(0.5 * (x[0] + x[1]), 0.5 * (y[0] + y[1]), 0.0);
            Body::builder(name, Role::Rigid).shape(shape).pose(pose).build().unwrap()
        };
        let walls = vec![
            wall("left", [-room - 0.02, -room], [-room, room]),
            wall("bottom", [-room - 0.02, room + 0.02], [-room - 0.02, -room]),
            wall("top", [-room - 0.02, room + 0.02], [room, room + 0.02]),
            wall("right", [room, room + 0.02], [-room, door]),
            wall("screen", [room + 0.08, room + 0.1], [-0.3, 0.3]),
        ];
        let config = SolverConfig::builder().constraint(Constraint::point("tip", "goal", 1e-3)).build().unwrap();
        let point = |name: &str| BTreeMap::from([(name.to_owned(), Vector3::zeros())]);
        let builder = KeypointProblem::builder(Arc::clone(&robot), config, vec![0.0, 0.0]).object(Pose::identity());
        let builder = builder.tool_keypoints(point("tip")).object_keypoints(point("goal")).bodies(walls);
        let problem = builder.build().unwrap();
        let model = Model::new(&robot, &[0.0, 0.0]).unwrap();
        let mut world = World::new(&problem, &model);
        let (start, mut goal) = ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS]);
        goal[0] = 0.8;
        let (scene, margins, pace) = (problem.scene(), Margins::plain(0.0), [1.0; MAX_JOINTS]);
        let segment = MotionSegment::Approach;
        let search = Search {
            scene: &scene,
            model: &model,
            segment,
            margins: &margins,
            pace,
            samples: 2000,
            seed: 0,
            proves: true,
        };
        Ok(search.paths(&mut world, &start, &goal)?.remove(0))
    }

    #[test]
    fn a_start_with_little_room_takes_short_edges() {
        // No edge of length 0.6 m leads from the middle of the chamber past the screen.
        let path = out_of_a_chamber(0.12, 0.06).unwrap();
        assert!(path.len() > 2, "{path:?}");
    }

    #[test]
    fn a_start_without_any_room_is_told_from_one_without_a_way() {
        assert!(matches!(out_of_a_chamber(0.12, 0.12), Err(NoWay::NotFound(_))));
        assert!(matches!(out_of_a_chamber(0.03, 0.03), Err(NoWay::BoxedIn(_))));
    }
}

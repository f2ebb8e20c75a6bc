//! Searches a collision-free motion between two joint vectors: the straight segment if possible, otherwise a path by
//! RRT-Connect (Kuffner and LaValle, 2000) with shortcuts. The same problem always gives the same path.

use gensim2_geometry::{Draws, Robot};

use crate::model::{MAX_JOINTS, Model, Row};
use crate::world::{Hit, Margins, MotionSegment, State, TOUCH, World};

/// Maximum lengths (m) of a tree's edge, measured by `Metric`. The shorter one applies after several blocked edges in a
/// row, because close to obstacles only short edges are collision-free.
const EDGE: f64 = 0.3;
const SHORT_EDGE: f64 = 0.05;
const STUCK: usize = 16;
/// Number of directions tried out of an overlap, with growing distance, and the maximum distance (m, by `Metric`).
const EXITS: usize = 96;
const EXIT: f64 = 0.6;
/// Distance (m, by `Metric`) between checks on the motion out of an overlap.
const EXIT_STEP: f64 = 0.005;
/// Number of shortcuts that are tried.
const SHORTCUTS: usize = 60;

struct Tree {
    nodes: Vec<(Row, usize)>,
    /// Number of long edges that were blocked since the last collision-free long edge.
    blocked: usize,
}

impl Tree {
    fn at(root: &Row) -> Self {
        Self { nodes: vec![(*root, 0)], blocked: 0 }
    }

    /// Returns whether the tree consists of its root only.
    fn is_bare(&self) -> bool {
        self.nodes.len() == 1
    }

    fn nearest(&self, metric: &Metric, x: &Row) -> usize {
        let mut best = (f64::INFINITY, 0);
        for (i, (node, _)) in self.nodes.iter().enumerate() {
            let d = metric.squared(node, x);
            if d < best.0 {
                best = (d, i);
            }
        }
        best.1
    }

    fn path_from_root(&self, mut at: usize) -> Vec<Row> {
        let mut out = vec![self.nodes[at].0];
        while at != 0 {
            at = self.nodes[at].1;
            out.push(self.nodes[at].0);
        }
        out.reverse();
        out
    }
}

/// Distance (m) between joint vectors. Each joint is weighted by the average distance (m) that the robot's furthest
/// points move per unit of the joint, so that sliding and rotating joints are comparable.
#[derive(Debug, Clone, Copy)]
struct Metric {
    n: usize,
    weights: Row,
}

impl Metric {
    fn of(robot: &Robot, model: &Model) -> Self {
        Self { n: model.n(), weights: model.mean_levers(robot) }
    }

    fn squared(&self, a: &Row, b: &Row) -> f64 {
        (0..self.n).map(|v| (self.weights[v] * (a[v] - b[v])).powi(2)).sum()
    }

    fn length(&self, a: &Row, b: &Row) -> f64 {
        self.squared(a, b).sqrt()
    }
}

fn between(n: usize, a: &Row, b: &Row, s: f64) -> Row {
    let mut out = *a;
    for v in 0..n {
        out[v] = a[v] + s * (b[v] - a[v]);
    }
    out
}

/// Reason why no collision-free motion was found.
#[derive(Debug, Clone)]
pub(crate) enum NoWay {
    /// The robot collides at the start or at the goal.
    Blocked(Hit),
    /// The maximum number of samples was reached. This obstacle blocks the straight segment.
    NotFound(Hit),
    /// The maximum number of samples was reached, and no sample could be connected to the start.
    BoxedIn(Hit),
}

/// Parameters of the random samples in a search for a collision-free motion.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sampling {
    /// Maximum number of samples of the search.
    pub max_samples: usize,
    /// Seed of the random samples.
    pub seed: usize,
}

/// Returns the vertices of a collision-free joint path from `a` to `b`, including `a` and `b`.
pub(crate) fn connect(
    world: &mut World<'_>,
    model: &Model,
    a: &Row,
    b: &Row,
    segment: MotionSegment,
    margins: &Margins,
    sampling: Sampling,
) -> Result<Vec<Row>, NoWay> {
    for end in [b, a] {
        if let Some(hit) = world.hit_at(State::still(end), segment, margins) {
            return Err(NoWay::Blocked(hit));
        }
    }
    let Some(hit) = world.sweep(a, b, segment, margins) else { return Ok(vec![*a, *b]) };
    let (n, metric) = (model.n(), Metric::of(&world.problem.robot, model));
    let mut draws = Draws::of(0x6b70_616d, sampling.seed);
    let mut trees = [Tree::at(a), Tree::at(b)];
    let mut active = 0;
    for _ in 0..sampling.max_samples {
        if world.is_over() {
            break;
        }
        let mut goal = [0.0; MAX_JOINTS];
        for (v, value) in goal.iter_mut().enumerate().take(n) {
            let (low, high) = model.range(v);
            *value = low + (high - low) * draws.unit();
        }
        if let Some(new) = grow(world, &metric, &mut trees[active], &goal, segment, margins) {
            let target = trees[active].nodes[new].0;
            let other = 1 - active;
            while let Some(reached) = grow(world, &metric, &mut trees[other], &target, segment, margins) {
                if metric.squared(&trees[other].nodes[reached].0, &target) < 1e-18 {
                    let mut path = trees[active].path_from_root(new);
                    let mut rest = trees[other].path_from_root(reached);
                    rest.pop();
                    rest.reverse();
                    path.extend(rest);
                    if active == 1 {
                        path.reverse();
                    }
                    shorten(world, &metric, &mut path, segment, margins, &mut draws);
                    return Ok(path);
                }
            }
        }
        active = 1 - active;
    }
    let is_boxed = trees[0].is_bare() && trees[0].blocked > 2 * STUCK;
    Err(if is_boxed { NoWay::BoxedIn(hit) } else { NoWay::NotFound(hit) })
}

/// Returns a collision-free pose near a start at which the robot overlaps a body. Along the straight segment to this
/// pose, the overlap only decreases, and all other pairs of bodies keep the margins.
pub(crate) fn way_out(
    world: &mut World<'_>,
    model: &Model,
    start: &Row,
    segment: MotionSegment,
    kept: &Margins,
    seed: usize,
) -> Option<Row> {
    let (n, metric) = (model.n(), Metric::of(&world.problem.robot, model));
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
            end[v] = (start[v] + way[v] * length / (norm * metric.weights[v])).clamp(model.lower[v], model.upper[v]);
        }
        if world.hit_at(State::still(&end), segment, &free).is_some() {
            continue;
        }
        let steps = (length / EXIT_STEP).ceil() as usize;
        // Each overlapping pair is tracked separately: once it is separated, it must stay separated.
        let mut before = world.overlaps(State::still(start), segment);
        let lessens = (1..=steps).all(|i| {
            let next = world.overlaps(State::still(&between(n, start, &end, i as f64 / steps as f64)), segment);
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

/// Returns whether the straight segment between two collision-free joint vectors is collision-free. First checks a few
/// joint vectors on the segment, which find most obstacles quickly.
fn is_free(world: &mut World<'_>, n: usize, a: &Row, b: &Row, segment: MotionSegment, margins: &Margins) -> bool {
    if world.cut_short() {
        return false;
    }
    let blocked = |s: &f64| world.hit_at(State::still(&between(n, a, b, *s)), segment, margins).is_some();
    ![0.5, 0.25, 0.75].iter().any(blocked) && world.sweep(a, b, segment, margins).is_none()
}

/// Adds one edge towards `goal` to the tree; returns the new node, or `None` if an obstacle blocks the edge.
fn grow(
    world: &mut World<'_>,
    metric: &Metric,
    tree: &mut Tree,
    goal: &Row,
    segment: MotionSegment,
    margins: &Margins,
) -> Option<usize> {
    let (n, from) = (metric.n, tree.nearest(metric, goal));
    let start = tree.nodes[from].0;
    let length = metric.length(&start, goal);
    if length == 0.0 {
        return None;
    }
    let mut free = |edge: f64| {
        let end = if length <= edge { *goal } else { between(n, &start, goal, edge / length) };
        let blocked = world.hit_at(State::still(&end), segment, margins).is_some();
        (!blocked && is_free(world, n, &start, &end, segment, margins)).then_some(end)
    };
    let long = free(EDGE);
    tree.blocked = if long.is_some() { 0 } else { tree.blocked + 1 };
    let is_stuck = tree.blocked > STUCK && length > SHORT_EDGE;
    let end = long.or_else(|| if is_stuck { free(SHORT_EDGE) } else { None })?;
    tree.nodes.push((end, from));
    Some(tree.nodes.len() - 1)
}

/// Shortens a path: first by skipping vertices, then by straight segments between random points on the path.
fn shorten(
    world: &mut World<'_>,
    metric: &Metric,
    path: &mut Vec<Row>,
    segment: MotionSegment,
    margins: &Margins,
    draws: &mut Draws,
) {
    let n = metric.n;
    let mut i = 0;
    while i + 2 < path.len() {
        let mut j = path.len() - 1;
        while j > i + 1 {
            if is_free(world, n, &path[i], &path[j], segment, margins) {
                path.drain(i + 1..j);
                break;
            }
            j -= 1;
        }
        i += 1;
    }
    for _ in 0..SHORTCUTS {
        if path.len() < 3 {
            return;
        }
        let place = |s: f64| {
            let at = s * (path.len() - 1) as f64;
            let k = (at as usize).min(path.len() - 2);
            (k, between(n, &path[k], &path[k + 1], at - k as f64))
        };
        let (s, t) = (draws.unit(), draws.unit());
        let ((i, a), (j, b)) = (place(s.min(t)), place(s.max(t)));
        if i == j {
            continue;
        }
        let along: f64 = metric.length(&a, &path[i + 1])
            + (i + 1..j).map(|k| metric.length(&path[k], &path[k + 1])).sum::<f64>()
            + metric.length(&path[j], &b);
        if metric.length(&a, &b) < 0.98 * along && is_free(world, n, &a, &b, segment, margins) {
            path.splice(i + 1..=j, [a, b]);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::sync::Arc;

    use gensim2_geometry::{Convex, Joint, Link, Pose};
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
        let sampling = Sampling { max_samples: 2000, seed: 0 };
        connect(&mut world, &model, &start, &goal, MotionSegment::Approach, &Margins::plain(0.0), sampling)
    }

    #[test]
    fn a_start_with_little_room_takes_short_edges() {
        // No edge of length 0.3 m leads from the middle of the chamber past the screen.
        let path = out_of_a_chamber(0.12, 0.06).unwrap();
        assert!(path.len() > 2, "{path:?}");
    }

    #[test]
    fn a_start_without_any_room_is_told_from_one_without_a_way() {
        assert!(matches!(out_of_a_chamber(0.12, 0.12), Err(NoWay::NotFound(_))));
        assert!(matches!(out_of_a_chamber(0.03, 0.03), Err(NoWay::BoxedIn(_))));
    }

    #[test]
    fn joints_count_by_how_far_they_move_the_arm() {
        // A carriage with an arm 2 m long: one radian of the arm counts as much as two metres of the carriage.
        let urdf = r#"<robot name="crane"><link name="base"/><link name="carriage"/>
            <link name="arm"><collision><origin xyz="1 0 0"/><geometry><box size="2 0.02 0.02"/></geometry></collision></link>
            <joint name="slide" type="prismatic"><parent link="base"/><child link="carriage"/><axis xyz="1 0 0"/>
            <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
            <joint name="turn" type="revolute"><parent link="carriage"/><child link="arm"/><axis xyz="0 0 1"/>
            <limit lower="-3" upper="3" effort="1" velocity="2"/></joint></robot>"#;
        let robot = Robot::from_urdf_str(urdf, "crane.urdf", None, "arm", None).unwrap();
        let model = Model::new(&robot, &[0.0, 0.0]).unwrap();
        let metric = Metric::of(&robot, &model);
        let at = |slide: f64, turn: f64| {
            let mut x = [0.0; MAX_JOINTS];
            (x[0], x[1]) = (slide, turn);
            x
        };
        let (slid, turned) = (metric.length(&at(0.0, 0.0), &at(1.0, 0.0)), metric.length(&at(0.0, 0.0), &at(0.0, 1.0)));
        assert!((slid - 1.0).abs() < 1e-12 && (turned - 2.0).abs() < 0.05, "{slid} {turned}");
    }
}

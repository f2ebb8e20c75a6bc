//! Goal of a motion, and inverse kinematics for a pose.

use gensim2_geometry::{Chain, ChainFrames, Pose, rotation_log};
use nalgebra::{Matrix6, Vector6};

use super::question::check_seed;
use super::{SLACK, TransitOptions, within_limits};
use crate::body::rigid;
use crate::error::{finite, for_each_joint};
use crate::model::{Model, Row};
use crate::{Cancel, ProblemError, Scene};
use gensim2_geometry::Draws;

/// Goal of a motion.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum Goal {
    /// The motion may end at any of these joint vectors. Each has one entry for each joint.
    Joints(Vec<Vec<f64>>),
    /// The motion ends with a link at this pose in the base frame.
    Pose {
        /// Target pose of the link.
        pose: Pose,
        /// Name of the link; the hand if `None`.
        link: Option<String>,
    },
}

/// Maximum number of inverse kinematics solutions that a caller may request for a pose.
pub const MAX_SOLUTIONS: usize = 256;
/// Number of inverse kinematics solutions that serve as goals for a pose.
const GOALS: usize = 16;
/// Number of start values for each requested solution, and minimum number of solutions to search for.
const SEEDS: usize = 8;
const LEAST: usize = 16;
/// Maximum number of Levenberg-Marquardt iterations from one start value.
const ROUNDS: usize = 60;
/// A pose counts as reached if its error is below this value (m and rad).
const MET: f64 = 1e-7;
/// Two solutions closer than this (rad or m) count as the same solution.
const SAME: f64 = 0.05;

impl Goal {
    /// Returns the joint vectors of the goals, reduced to the planned variables; empty if a goal pose is unreachable.
    pub(super) fn joints(
        &self,
        scene: &Scene,
        model: &Model,
        q_start: &[f64],
        options: &TransitOptions,
        over: &Cancel,
    ) -> Result<Vec<Row>, ProblemError> {
        match self {
            Self::Joints(list) => {
                if list.is_empty() {
                    return Err(ProblemError::new("goal", "must contain at least one joint vector"));
                }
                list.iter()
                    .enumerate()
                    .map(|(k, q)| {
                        let field = format!("goal[{k}]");
                        for_each_joint(&field, q, q_start.len())?;
                        check_others(scene, model, &field, q_start, q)?;
                        let x = model.unwound(&model.pick(q), &model.start());
                        within_limits(model, &field, &x).map(|()| x)
                    })
                    .collect()
            }
            Self::Pose { pose, link } => {
                // The motion may also end where the current motion ends.
                let last = options.warm_start.as_ref().filter(|motion| motion.joints() == q_start.len());
                let first: Vec<Row> =
                    last.map(|motion| model.pick(&motion.sample(motion.end()).position)).into_iter().collect();
                let ask =
                    Ask { pose, link: link.as_deref(), max_solutions: GOALS, seed: options.seed, first: &first, over };
                ask.rows(scene, model)
            }
        }
    }
}

/// Returns an error if `q` changes a joint that planning does not move. A mimic joint that planning does not move may keep
/// its value of `q_start`, because measured fingers differ a little.
pub(crate) fn check_others(
    scene: &Scene,
    model: &Model,
    field: &str,
    q_start: &[f64],
    q: &[f64],
) -> Result<(), ProblemError> {
    let (mut reached, joints) = (Vec::new(), scene.robot().joints());
    model.map().positions(&model.pick(q), &mut reached);
    let kept = |j: usize| joints[j].mimic().is_some() && !model.map().moves(j) && (q[j] - q_start[j]).abs() <= SLACK;
    let Some(j) = (0..q.len()).find(|j| (reached[*j] - q[*j]).abs() > SLACK && !kept(*j)) else { return Ok(()) };
    let why = match joints[j].mimic() {
        Some(mimic) => format!("follows {}", joints[mimic.source].name()),
        None => "does not move the hand and keeps its value in q_start".to_owned(),
    };
    let message = format!("{} cannot be reached: joint {} {why}; use {}", q[j], joints[j].name(), reached[j]);
    Err(ProblemError::new(format!("{field}[{j}]"), message))
}

/// Returns distinct joint vectors (one entry for each joint) that bring a link, by default the hand, to a pose in the
/// base frame: at most `max_solutions`, closest to `q_start` first. Joints that do not move the hand keep their values.
/// A redundant arm has infinitely many solutions, of which a sample is returned. Obstacles are ignored.
///
/// # Errors
/// The pose is not rigid, the link is unknown, the start is invalid, or the number of solutions is out of range.
pub fn solutions(
    scene: &Scene,
    pose: &Pose,
    link: Option<&str>,
    q_start: &[f64],
    max_solutions: usize,
    seed: usize,
) -> Result<Vec<Vec<f64>>, ProblemError> {
    if !(1..=MAX_SOLUTIONS).contains(&max_solutions) {
        return Err(ProblemError::new("max_solutions", format!("must be 1 to {MAX_SOLUTIONS}, not {max_solutions}")));
    }
    check_seed(seed)?;
    finite("q_start", q_start)?;
    let model = Model::new(scene.robot(), q_start)?;
    let ask = Ask { pose, link, max_solutions, seed, first: &[], over: &Cancel::new() };
    let found = ask.rows(scene, &model)?;
    Ok(found
        .iter()
        .map(|x| {
            let mut q = Vec::new();
            model.map().positions(x, &mut q);
            q
        })
        .collect())
}

/// Inverse kinematics problem of one link.
struct Ask<'a> {
    pose: &'a Pose,
    link: Option<&'a str>,
    max_solutions: usize,
    seed: usize,
    /// Start values that are tried first.
    first: &'a [Row],
    over: &'a Cancel,
}

impl Ask<'_> {
    fn rows(&self, scene: &Scene, model: &Model) -> Result<Vec<Row>, ProblemError> {
        rigid("pose", self.pose)?;
        let robot = &**scene.robot();
        let unknown = |name: &str| ProblemError::new("link", format!("{name:?} is not a link of {:?}", robot.name()));
        let link = match self.link {
            Some(name) => robot.link_index(name).ok_or_else(|| unknown(name))?,
            None => robot.hand(),
        };
        let chain = robot.chain_to(link).ok_or_else(|| unknown("?"))?;
        let mut search =
            Search { chain: &chain, model, goal: *self.pose, q: Vec::new(), frames: ChainFrames::default() };
        let mut draws = Draws::of(0x696b_696b, self.seed);
        let start = model.start();
        let drawn = (0..SEEDS * self.max_solutions.max(LEAST)).map(|k| {
            let mut x = start;
            if k > 0 {
                for (v, value) in x.iter_mut().enumerate().take(model.n()) {
                    let (low, high) = model.range(v);
                    *value = low + (high - low) * draws.unit();
                }
            }
            x
        });
        let mut found: Vec<Row> = Vec::new();
        for x in self.first.iter().copied().chain(drawn) {
            if self.over.is_cancelled() {
                break;
            }
            let Some(x) = search.from(&x) else { continue };
            let x = model.unwound(&x, &start);
            let apart = |other: &Row| (0..model.n()).map(|v| (other[v] - x[v]).abs()).fold(0.0, f64::max);
            if found.iter().all(|other| apart(other) > SAME) {
                found.push(x);
            }
            if found.len() == self.max_solutions {
                break;
            }
        }
        let way = |x: &Row| (0..model.n()).map(|v| (x[v] - start[v]).powi(2)).sum::<f64>();
        found.sort_by(|a, b| way(a).total_cmp(&way(b)));
        Ok(found)
    }
}

struct Search<'a> {
    chain: &'a Chain,
    model: &'a Model,
    goal: Pose,
    q: Vec<f64>,
    frames: ChainFrames,
}

impl Search<'_> {
    /// Returns the error of the link's pose at `x`: translation (m) and rotation (rad) in the base frame.
    fn left(&mut self, x: &Row) -> Vector6<f64> {
        self.model.forward_along(self.chain, x, &mut self.q, &mut self.frames);
        let tip = &self.frames.tip;
        let shift = self.goal.translation.vector - tip.translation.vector;
        let turn = rotation_log(&(self.goal.rotation * tip.rotation.inverse()));
        Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z)
    }

    /// Runs Levenberg-Marquardt from a start value, within the joint limits; `None` if it does not reach the goal pose.
    fn from(&mut self, x: &Row) -> Option<Row> {
        let n = self.model.n();
        let (mut x, mut damping) = (*x, 1e-2);
        for v in 0..n {
            x[v] = x[v].clamp(self.model.lower[v], self.model.upper[v]);
        }
        let mut left = self.left(&x);
        for _ in 0..ROUNDS {
            if left.amax() < MET {
                return Some(x);
            }
            let columns = self.model.twists(self.chain, &self.frames);
            // A joint that is at a limit, and that the step would move beyond the limit, stays fixed.
            let mut normal = Matrix6::identity() * (damping * left.norm_squared().min(1.0) + 1e-10);
            let pull = |v: usize, force: &Vector6<f64>| columns[v].dot(force);
            let free: Vec<bool> = (0..n)
                .map(|v| {
                    let way = pull(v, &left);
                    !((x[v] <= self.model.lower[v] && way < 0.0) || (x[v] >= self.model.upper[v] && way > 0.0))
                })
                .collect();
            for v in (0..n).filter(|v| free[*v]) {
                normal += columns[v] * columns[v].transpose();
            }
            let force = normal.cholesky()?.solve(&left);
            let mut next = x;
            for v in (0..n).filter(|v| free[*v]) {
                next[v] = (x[v] + pull(v, &force)).clamp(self.model.lower[v], self.model.upper[v]);
            }
            let then = self.left(&next);
            if then.norm() < left.norm() {
                (x, left) = (next, then);
                damping = (0.3 * damping).max(1e-9);
            } else {
                damping *= 10.0;
                if damping > 1e6 {
                    return None;
                }
                left = self.left(&x);
            }
        }
        None
    }
}

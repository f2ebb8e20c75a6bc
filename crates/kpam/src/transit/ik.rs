//! Inverse kinematics: joint vectors that bring a link to a pose, and the best of them by a secondary objective.

use gensim2_geometry::{Chain, ChainFrames, Draws, Pose, rotation_log};
use nalgebra::{Matrix6, SMatrix, SVector, Vector3, Vector6};

use super::field::{Ending, Field};
use super::question::check_seed;
use super::within_limits;
use crate::body::rigid;
use crate::error::{finite, for_each_joint};
use crate::model::{MAX_JOINTS, Model, Row};
use crate::{Cancel, ProblemError, Scene};

/// Maximum number of inverse kinematics solutions that a caller may request for a pose.
pub const MAX_SOLUTIONS: usize = 256;
/// Number of start values for each requested solution, and minimum number of solutions to search for.
const SEEDS: usize = 8;
const LEAST: usize = 16;
/// Maximum number of Levenberg-Marquardt iterations from one start value.
const ROUNDS: usize = 60;
/// A pose counts as reached if its error is below this value (m and rad).
const MET: f64 = 1e-7;
/// Maximum number of steps by which the secondary objective improves one solution, and their maximum length (rad or m).
const STEPS: usize = 60;
const LONGEST: f64 = 0.3;
/// A solution is optimal if a step is shorter than this (rad or m), or improves the objective by less than this fraction.
const SHORT: f64 = 1e-6;
const GAIN: f64 = 1e-9;
/// Largest weight of short steps relative to the objective; beyond it, no step improves a solution.
const STIFFEST: f64 = 1e8;

/// Options of inverse kinematics.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct IkOptions {
    /// Link that must reach the pose; the hand if `None`.
    pub link: Option<String>,
    /// A second link that must reach a pose in the base frame at the same time.
    pub other: Option<(String, Pose)>,
    /// Maximum number of solutions, 1 to [`MAX_SOLUTIONS`].
    pub max_solutions: usize,
    /// Two solutions differ by at least this (rad or m) in at least one joint.
    pub min_distance: f64,
    /// Seed of the start values.
    pub seed: usize,
    /// Preferred joint values (rad or m, one for each joint). The objective contains the squared distance from them.
    pub posture: Option<Vec<f64>>,
    /// Weight of each joint's squared distance from `posture` (1/rad^2 or 1/m^2); default: 1 each.
    pub posture_weights: Option<Vec<f64>>,
    /// Weight of the manipulability in the objective. Manipulability is the product of the singular values of the link's
    /// Jacobian (m and rad, by the joints that planning moves).
    pub manipulability: f64,
    /// Minimum distance (m) between the bodies of each checked pair at a solution. Links whose shapes [prevent
    /// the margin](gensim2_geometry::Robot::is_often_close) must only not collide. `None` ignores obstacles.
    pub margin: Option<f64>,
    /// Flag that ends the search from another thread; the solutions found so far are returned.
    pub cancel: Option<Cancel>,
}

impl Default for IkOptions {
    fn default() -> Self {
        Self {
            link: None,
            other: None,
            max_solutions: 16,
            min_distance: 0.05,
            seed: 0,
            posture: None,
            posture_weights: None,
            manipulability: 0.0,
            margin: None,
            cancel: None,
        }
    }
}

/// Returns distinct joint vectors (one entry for each joint) that bring a link, by default the hand, to a pose in the
/// base frame. Joints that are not planned, and joints of another arm, keep their values. The vectors that are closest to
/// `q_start` come first.
///
/// With a posture or a weight of the manipulability, every solution of a redundant arm is moved along the motions that
/// keep the pose to a local minimum of
///
/// ```text
/// sum of posture_weights (q - posture)^2 - manipulability sqrt(det(J J'))
/// ```
///
/// and the solutions with the smallest values come first. If the arm would come too close to an obstacle at the minimum,
/// the last collision-free solution on the way to it is returned.
///
/// A redundant arm has infinitely many solutions, of which a sample is returned.
///
/// # Errors
/// The pose is not rigid, the link is unknown, or the start or an option is invalid; names the field.
pub fn solutions(
    scene: &Scene,
    pose: &Pose,
    q_start: &[f64],
    options: &IkOptions,
) -> Result<Vec<Vec<f64>>, ProblemError> {
    finite("q_start", q_start)?;
    let model = Model::new(scene.robot(), q_start)?;
    let objective = options.check(&model)?;
    let over = options.cancel.clone().unwrap_or_default();
    let mut ask = Ask::new(pose, options.link.as_deref(), &over);
    ask.other = options.other.as_ref().map(|(link, pose)| (link.as_str(), pose));
    (ask.max_solutions, ask.min_distance, ask.seed) = (options.max_solutions, options.min_distance, options.seed);
    (ask.objective, ask.margin) = (objective, options.margin);
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

impl IkOptions {
    /// Validates the options, and returns the secondary objective, if there is one.
    fn check(&self, model: &Model) -> Result<Option<Objective>, ProblemError> {
        let fail = |field: &str, message: String| Err(ProblemError::new(field, message));
        if !(1..=MAX_SOLUTIONS).contains(&self.max_solutions) {
            return fail("max_solutions", format!("must be 1 to {MAX_SOLUTIONS}, not {}", self.max_solutions));
        }
        if !(1e-3..=10.0).contains(&self.min_distance) {
            return fail("min_distance", format!("must lie in 0.001 to 10 rad or m, not {}", self.min_distance));
        }
        check_seed(self.seed)?;
        if let Some(margin) = self.margin
            && !(0.0..=0.1).contains(&margin)
        {
            return fail("margin", format!("must lie in 0 to 0.1 m, not {margin}"));
        }
        if !(0.0..=1e6).contains(&self.manipulability) {
            return fail("manipulability", format!("must lie in 0 to 1e6, not {}", self.manipulability));
        }
        let joints = model.map().rest().len();
        let mut weights = [1.0; MAX_JOINTS];
        if let Some(list) = &self.posture_weights {
            if self.posture.is_none() {
                return fail("posture_weights", "needs the argument posture".to_owned());
            }
            for_each_joint("posture_weights", list, joints)?;
            if let Some(j) = list.iter().position(|w| !(0.0..=1e6).contains(w)) {
                return fail(&format!("posture_weights[{j}]"), format!("must lie in 0 to 1e6, not {}", list[j]));
            }
            weights = model.pick(list);
        }
        let posture = match &self.posture {
            None => None,
            Some(posture) => {
                for_each_joint("posture", posture, joints)?;
                let posture = model.pick(posture);
                within_limits(model, "posture", &posture)?;
                Some((posture, weights))
            }
        };
        let is_asked = posture.is_some() || self.manipulability > 0.0;
        Ok(is_asked.then_some(Objective { posture, manipulability: self.manipulability }))
    }
}

/// Secondary objective of inverse kinematics: weighted squared distances from a posture minus the weighted
/// manipulability.
#[derive(Debug, Clone)]
struct Objective {
    /// The posture and the weight of each variable.
    posture: Option<(Row, Row)>,
    manipulability: f64,
}

/// Inverse kinematics problem of one link, or of two links at the same time.
pub(super) struct Ask<'a> {
    pose: &'a Pose,
    link: Option<&'a str>,
    /// A second link and its pose.
    pub other: Option<(&'a str, &'a Pose)>,
    pub max_solutions: usize,
    min_distance: f64,
    pub seed: usize,
    /// Start values that are tried first.
    pub first: &'a [Row],
    objective: Option<Objective>,
    margin: Option<f64>,
    over: &'a Cancel,
}

impl<'a> Ask<'a> {
    pub fn new(pose: &'a Pose, link: Option<&'a str>, over: &'a Cancel) -> Self {
        let IkOptions { max_solutions, min_distance, seed, .. } = IkOptions::default();
        let (other, first, objective, margin) = (None, &[][..], None, None);
        Self { pose, link, other, max_solutions, min_distance, seed, first, objective, margin, over }
    }

    pub fn rows(&self, scene: &Scene, model: &Model) -> Result<Vec<Row>, ProblemError> {
        rigid("pose", self.pose)?;
        let one = Target { chain: chain_to(scene, self.link)?, goal: *self.pose };
        let Some((link, pose)) = self.other else { return Ok(self.search::<6>(scene, model, &[one])) };
        rigid("pose", pose)?;
        let two = Target { chain: chain_to(scene, Some(link))?, goal: *pose };
        if two.chain == one.chain {
            return Err(ProblemError::new("link", format!("{link:?} has two poses; give each link one")));
        }
        Ok(self.search::<12>(scene, model, &[one, two]))
    }

    /// Returns for each variable whether the search changes it: those that move a target's link. If all of them move the
    /// hand, too, the search changes all variables that move the hand.
    fn searched(scene: &Scene, model: &Model, targets: &[Target]) -> [bool; MAX_JOINTS] {
        let mut out = [false; MAX_JOINTS];
        for target in targets {
            let moves = model.moves(&target.chain);
            (0..model.n()).for_each(|v| out[v] |= moves[v]);
        }
        let hand = model.moves(scene.robot().chain());
        if (0..model.n()).all(|v| hand[v] || !out[v]) { hand } else { out }
    }

    /// Returns solutions, best first. `D` is 6 for each target.
    fn search<const D: usize>(&self, scene: &Scene, model: &Model, targets: &[Target]) -> Vec<Row> {
        let searched = Self::searched(scene, model, targets);
        let mut search = Search::<D>::new(targets, model, searched);
        let mut field = self.margin.map(|margin| {
            let mut needs = scene.compiled().needs_beside(scene.robot(), [], margin, margin);
            scene.compiled().leave_out_still(&mut needs, model.map());
            Field::new(scene, model, needs.into(), Ending::default())
        });
        let mut draws = Draws::of(0x696b_696b, self.seed);
        let start = model.start();
        let drawn = (0..SEEDS * self.max_solutions.max(LEAST)).map(|k| {
            let mut x = start;
            if k > 0 {
                for (v, value) in x.iter_mut().enumerate().take(model.n()).filter(|(v, _)| searched[*v]) {
                    let (low, high) = model.range(v);
                    *value = low + (high - low) * draws.unit();
                }
            }
            x
        });
        // Without an objective, the search ends once there are enough solutions. The best ones need all start values.
        let mut found: Vec<(f64, Row)> = Vec::new();
        let mut free = |x: &Row| field.as_mut().is_none_or(|field| field.blocked_at(&[*x]).is_none());
        for x in self.first.iter().copied().chain(drawn) {
            if self.over.is_cancelled() {
                break;
            }
            let Some(x) = search.from(&x) else { continue };
            let mut x = model.unwound(&x, &start);
            let cost = match &self.objective {
                None if !free(&x) => continue,
                None => (0..model.n()).map(|v| (x[v] - start[v]).powi(2)).sum::<f64>(),
                Some(objective) => {
                    let way = search.improve(objective, &x);
                    let Some((cost, best)) = way.into_iter().rev().find(|(_, x)| free(x)) else { continue };
                    x = best;
                    cost
                }
            };
            if self.objective.is_some() || found.iter().all(|(_, other)| self.are_distinct(model, other, &x)) {
                found.push((cost, x));
            }
            if self.objective.is_none() && found.len() == self.max_solutions {
                break;
            }
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut out: Vec<Row> = Vec::new();
        for (_, x) in found {
            if out.len() < self.max_solutions && out.iter().all(|other| self.are_distinct(model, other, &x)) {
                out.push(x);
            }
        }
        out
    }

    fn are_distinct(&self, model: &Model, one: &Row, other: &Row) -> bool {
        !model.are_near(one, other, self.min_distance)
    }
}

/// Returns the chain to a link of the robot, by default the hand.
pub(super) fn chain_to(scene: &Scene, link: Option<&str>) -> Result<Chain, ProblemError> {
    let robot = &**scene.robot();
    let unknown = |name: &str| ProblemError::new("link", format!("{name:?} is not a link of {:?}", robot.name()));
    let index = match link {
        Some(name) => robot.link_index(name).ok_or_else(|| unknown(name))?,
        None => robot.hand(),
    };
    robot.chain_to(index).ok_or_else(|| unknown("?"))
}

/// A pose that the tip of a chain must reach.
#[derive(Debug, Clone)]
struct Target {
    chain: Chain,
    goal: Pose,
}

/// Searches joint values that bring the tip of each target's chain to its pose. `D` is 6 for each target.
struct Search<'a, const D: usize> {
    targets: &'a [Target],
    model: &'a Model,
    /// For each variable, whether the search changes it.
    searched: [bool; MAX_JOINTS],
    q: Vec<f64>,
    frames: Vec<ChainFrames>,
}

impl<'a, const D: usize> Search<'a, D> {
    fn new(targets: &'a [Target], model: &'a Model, searched: [bool; MAX_JOINTS]) -> Self {
        Self { targets, model, searched, q: Vec::new(), frames: vec![ChainFrames::default(); targets.len()] }
    }

    fn place(&mut self, x: &Row) {
        for (target, frames) in self.targets.iter().zip(&mut self.frames) {
            self.model.forward_along(&target.chain, x, &mut self.q, frames);
        }
    }

    /// Returns the error of the links' poses at `x`: for each target, translation (m) and rotation (rad) in the base
    /// frame.
    fn left(&mut self, x: &Row) -> SVector<f64, D> {
        self.place(x);
        let mut out = SVector::<f64, D>::zeros();
        for (k, (target, frames)) in self.targets.iter().zip(&self.frames).enumerate() {
            let tip = &frames.tip;
            let shift = target.goal.translation.vector - tip.translation.vector;
            let turn = rotation_log(&(target.goal.rotation * tip.rotation.inverse()));
            out.fixed_rows_mut::<3>(6 * k).copy_from(&shift);
            out.fixed_rows_mut::<3>(6 * k + 3).copy_from(&turn);
        }
        out
    }

    /// Returns the Jacobian of all targets' links by columns, at the configuration that was placed last.
    fn columns(&self) -> [SVector<f64, D>; MAX_JOINTS] {
        let mut out = [SVector::<f64, D>::zeros(); MAX_JOINTS];
        for (k, (target, frames)) in self.targets.iter().zip(&self.frames).enumerate() {
            let twists = self.model.twists(&target.chain, frames);
            for (column, twist) in out.iter_mut().zip(&twists).take(self.model.n()) {
                column.fixed_rows_mut::<6>(6 * k).copy_from(twist);
            }
        }
        out
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
            let columns = self.columns();
            // A joint that is at a limit, and that the step would move beyond the limit, stays fixed.
            let mut normal = SMatrix::<f64, D, D>::identity() * (damping * left.norm_squared().min(1.0) + 1e-10);
            let pull = |v: usize, force: &SVector<f64, D>| columns[v].dot(force);
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

    /// Moves a solution to a local minimum of the objective. Returns the solutions on the way with their objective; the
    /// first is `x`, and each is better than the one before.
    fn improve(&mut self, objective: &Objective, x: &Row) -> Vec<(f64, Row)> {
        let n = self.model.n();
        let (mut x, mut stiffness) = (*x, 1e-2);
        let (mut cost, mut gradient) = self.cost(objective, &x);
        let mut way = vec![(cost, x)];
        for _ in 0..STEPS {
            let Some(step) = self.step(objective, &x, &gradient, stiffness) else { break };
            let length = step[..n].iter().fold(0.0, |m: f64, s| m.max(s.abs()));
            if length < SHORT || stiffness > STIFFEST {
                break;
            }
            let mut next = x;
            let shrink = (LONGEST / length).min(1.0);
            for v in 0..n {
                next[v] = (x[v] + shrink * step[v]).clamp(self.model.lower[v], self.model.upper[v]);
            }
            let better = self.from(&next).map(|next| (next, self.cost(objective, &next))).filter(|(_, c)| c.0 < cost);
            let Some((next, (less, slope))) = better else {
                stiffness *= 8.0;
                continue;
            };
            let is_last = cost - less < GAIN * (1.0 + cost.abs());
            (x, cost, gradient) = (next, less, slope);
            stiffness = (0.2 * stiffness).max(1e-6);
            way.push((cost, x));
            if is_last {
                break;
            }
        }
        way
    }

    /// Returns the step that reduces the quadratic model of the objective most without moving the link, to first order.
    /// `stiffness` weights the squared step in addition.
    fn step(&mut self, objective: &Objective, x: &Row, gradient: &Row, stiffness: f64) -> Option<Row> {
        let n = self.model.n();
        self.place(x);
        let columns = self.columns();
        let scale = objective.manipulability.max(1.0);
        let weight = |v: usize| objective.posture.as_ref().map_or(0.0, |(_, w)| 2.0 * w[v]) + stiffness * scale;
        let mut free = self.searched;
        loop {
            let (mut normal, mut pushed) = (SMatrix::<f64, D, D>::identity() * 1e-12, SVector::<f64, D>::zeros());
            for v in (0..n).filter(|v| free[*v]) {
                normal += columns[v] * columns[v].transpose() / weight(v);
                pushed += columns[v] * (gradient[v] / weight(v));
            }
            let force = normal.cholesky()?.solve(&pushed);
            let mut step = [0.0; MAX_JOINTS];
            for v in (0..n).filter(|v| free[*v]) {
                step[v] = (columns[v].dot(&force) - gradient[v]) / weight(v);
            }
            // A joint that is at a limit, and that the step would move beyond the limit, stays fixed.
            let out = |v: usize| {
                (x[v] <= self.model.lower[v] && step[v] < 0.0) || (x[v] >= self.model.upper[v] && step[v] > 0.0)
            };
            let outside: Vec<usize> = (0..n).filter(|v| free[*v] && out(*v)).collect();
            if outside.is_empty() {
                return Some(step);
            }
            outside.into_iter().for_each(|v| free[v] = false);
        }
    }

    /// Returns the objective at `x` and its gradient.
    fn cost(&mut self, objective: &Objective, x: &Row) -> (f64, Row) {
        let (mut cost, mut gradient) = (0.0, [0.0; MAX_JOINTS]);
        if let Some((posture, weights)) = &objective.posture {
            let goal = self.model.unwound(posture, x);
            for v in 0..self.model.n() {
                let off = x[v] - goal[v];
                cost += weights[v] * off * off;
                gradient[v] = 2.0 * weights[v] * off;
            }
        }
        if objective.manipulability > 0.0 {
            let (value, slope) = self.manipulability(x);
            cost -= objective.manipulability * value;
            (0..self.model.n()).for_each(|v| gradient[v] -= objective.manipulability * slope[v]);
        }
        (cost, gradient)
    }

    /// Returns the sum of the manipulabilities of the targets' links at `x`, and its gradient.
    fn manipulability(&mut self, x: &Row) -> (f64, Row) {
        self.place(x);
        let (mut sum, mut gradient) = (0.0, [0.0; MAX_JOINTS]);
        for (target, frames) in self.targets.iter().zip(&self.frames) {
            let (value, slope) = manipulability(self.model, &target.chain, frames);
            sum += value;
            (0..self.model.n()).for_each(|v| gradient[v] += slope[v]);
        }
        (sum, gradient)
    }
}

/// Returns the product of the singular values of the Jacobian of a chain's link, and its gradient; both are zero at a
/// singularity.
fn manipulability(model: &Model, chain: &Chain, frames: &ChainFrames) -> (f64, Row) {
    let columns = model.twists(chain, frames);
    let active: Vec<usize> = (0..model.n()).filter(|v| columns[*v] != Vector6::zeros()).collect();
    let few = active.len() < 6;
    let mut normal = if few { Matrix6::identity() } else { Matrix6::zeros() };
    if few {
        for (i, v) in active.iter().enumerate() {
            for (k, w) in active.iter().enumerate() {
                normal[(i, k)] = columns[*v].dot(&columns[*w]);
            }
        }
    } else {
        active.iter().for_each(|v| normal += columns[*v] * columns[*v].transpose());
    }
    let mut slope = [0.0; MAX_JOINTS];
    let Some(solved) = normal.cholesky() else { return (0.0, slope) };
    let value: f64 = solved.l_dirty().diagonal().product();
    // The gradient of the logarithm is the sum, over all columns, of the transposed pseudo-inverse times the
    // derivative of the column.
    let mut inverse = [Vector6::zeros(); MAX_JOINTS];
    for (i, v) in active.iter().enumerate() {
        inverse[*v] = if few {
            let row = solved.solve(&Vector6::ith(i, 1.0));
            active.iter().enumerate().fold(Vector6::zeros(), |sum, (k, w)| sum + columns[*w] * row[k])
        } else {
            solved.solve(&columns[*v])
        };
    }
    let driven = |joint: usize| model.map().driven().iter().find(|d| d.joint == joint);
    let tip = frames.tip.translation.vector;
    let joints: Vec<(usize, Vector3<f64>, Vector3<f64>)> = chain
        .joint_indices()
        .enumerate()
        .filter_map(|(i, joint)| {
            let driven = driven(joint)?;
            let (linear, angular) = (chain.linear(frames, i, &tip)?, chain.angular(frames, i)?);
            Some((driven.variable, linear * driven.factor, angular * driven.factor))
        })
        .collect();
    for (i, (moved, linear, angular)) in joints.iter().enumerate() {
        for (k, (mover, shift, turn)) in joints.iter().enumerate() {
            // A joint turns the axes of the joints after it, and moves the tip relative to the joints before it.
            let (one, two) = if k <= i {
                (turn.cross(linear), turn.cross(angular))
            } else {
                (angular.cross(shift), Vector3::zeros())
            };
            let row = &inverse[*moved];
            slope[*mover] += value * (row.fixed_rows::<3>(0).dot(&one) + row.fixed_rows::<3>(3).dot(&two));
        }
    }
    (value, slope)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use gensim2_geometry::{Joint, Link, Robot};

    use super::*;

    /// An arm with seven revolute joints, one of which also drives a mimic joint, and a sliding joint.
    fn arm() -> Arc<Robot> {
        let joint = |i: usize, kind: &str, axis: &str, xyz: &str, mimic: &str| {
            format!(
                r#"<joint name="j{i}" type="{kind}"><parent link="l{}"/><child link="l{i}"/><origin xyz="{xyz}"/>
                <axis xyz="{axis}"/><limit lower="-2.5" upper="2.5" effort="1" velocity="2"/>{mimic}</joint>"#,
                i - 1
            )
        };
        let links: String = (0..9).map(|i| format!(r#"<link name="l{i}"/>"#)).collect();
        let mimic = r#"<mimic joint="j2" multiplier="-0.5" offset="0.1"/>"#;
        let joints = [
            joint(1, "revolute", "0 0 1", "0 0 0.3", ""),
            joint(2, "revolute", "0 1 0", "0 0.02 0.1", ""),
            joint(3, "revolute", "0 0 1", "0 0 0.2", ""),
            joint(4, "revolute", "0 1 0", "0.08 0 0.2", mimic),
            joint(5, "prismatic", "0 0 1", "-0.08 0 0.2", ""),
            joint(6, "revolute", "0 0.6 0.8", "0 0 0.2", ""),
            joint(7, "revolute", "0 1 0", "0 0.05 0", ""),
            joint(8, "revolute", "0 0 1", "0.09 0 0.1", ""),
        ]
        .concat();
        let text = format!(r#"<robot name="arm">{links}{joints}</robot>"#);
        Arc::new(Robot::from_urdf_str(&text, "arm.urdf", None, "l8", None).unwrap())
    }

    #[test]
    fn the_gradients_are_those_of_the_manipulability_and_of_the_objective() {
        let robot = arm();
        let model = Model::new(&robot, &[0.0; 8]).unwrap();
        assert_eq!(model.n(), 7);
        let mut draws = Draws::of(3, 4);
        // Chains of seven, five and two variables.
        for link in ["l8", "l6", "l2"] {
            let chain = robot.chain_to(robot.link_index(link).unwrap()).unwrap();
            let targets = [Target { chain, goal: Pose::identity() }];
            let mut search = Search::<6>::new(&targets, &model, [true; MAX_JOINTS]);
            let objective = Objective {
                posture: Some(([0.2; MAX_JOINTS], std::array::from_fn(|v| 0.1 * v as f64))),
                manipulability: 30.0,
            };
            for _ in 0..20 {
                let mut x = [0.0; MAX_JOINTS];
                x.iter_mut().take(7).for_each(|v| *v = 2.4 * (2.0 * draws.unit() - 1.0));
                let (value, slope) = search.manipulability(&x);
                let (_, gradient) = search.cost(&objective, &x);
                assert!(value > 0.0);
                for v in 0..7 {
                    let (mut high, mut low) = (x, x);
                    high[v] += 1e-6;
                    low[v] -= 1e-6;
                    let measured = (search.manipulability(&high).0 - search.manipulability(&low).0) / 2e-6;
                    assert!((measured - slope[v]).abs() < 1e-7 * (1.0 + value), "{link} {v}: {measured} {}", slope[v]);
                    let measured = (search.cost(&objective, &high).0 - search.cost(&objective, &low).0) / 2e-6;
                    assert!((measured - gradient[v]).abs() < 1e-5, "{link} {v}: {measured} {}", gradient[v]);
                }
            }
        }
    }

    #[test]
    fn the_manipulability_of_a_planar_arm_has_a_closed_form() {
        let turn = |name: &str| Joint::revolute(name, Vector3::z()).limits(-3.0, 3.0).velocity(1.0);
        let robot = Robot::builder("planar")
            .link(Link::base("base"))
            .link(Link::below("base", "upper").moved_by(turn("shoulder")))
            .link(Link::below("upper", "fore").moved_by(turn("elbow")).at(Pose::translation(0.7, 0.0, 0.0)))
            .link(Link::below("fore", "hand").at(Pose::translation(0.4, 0.0, 0.0)))
            .build("hand")
            .unwrap();
        let model = Model::new(&robot, &[0.0; 2]).unwrap();
        let targets = [Target { chain: robot.chain().clone(), goal: Pose::identity() }];
        let mut search = Search::<6>::new(&targets, &model, [true; MAX_JOINTS]);
        for elbow in [0.3_f64, 1.2, -2.0] {
            let mut x = [0.0; MAX_JOINTS];
            (x[0], x[1]) = (0.4, elbow);
            // Columns (p1, 1) and (p2, 1) with p1 = a u1 + b u2 and p2 = b u2, turned by a right angle.
            let (a, b) = (0.7, 0.4);
            let (first, second) = (a * a + b * b + 2.0 * a * b * elbow.cos() + 1.0, b * b + 1.0);
            let mixed = b * b + a * b * elbow.cos() + 1.0;
            let expected = (first * second - mixed * mixed).sqrt();
            assert!((search.manipulability(&x).0 - expected).abs() < 1e-12);
        }
    }
}

//! Inverse kinematics: joint vectors that bring a link to a pose, and the best of them by a secondary objective.

mod objective;
mod search;

use gensim2_geometry::{Chain, Draws, Pose};

use super::field::{Ending, Field};
use super::question::check_seed;
use super::within_limits;
use crate::body::rigid;
use crate::error::{finite, for_each_joint};
use crate::model::{MAX_JOINTS, Model, Row};
use crate::{Cancel, ProblemError, Scene};
use objective::Objective;
use search::{Search, Target};

/// Maximum number of inverse kinematics solutions that a caller may request for a pose.
pub const MAX_SOLUTIONS: usize = 256;
/// Number of start values for each requested solution, and minimum number of solutions to search for.
const SEEDS: usize = 8;
const LEAST: usize = 16;

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

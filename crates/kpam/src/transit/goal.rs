//! Goal of a motion.

use gensim2_geometry::Pose;

use super::ik::Ask;
use super::{SLACK, TransitOptions, within_limits};
use crate::body::rigid;
use crate::error::for_each_joint;
use crate::model::{Model, Row};
use crate::{Cancel, ProblemError, Scene};

/// Goal of a motion.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum Goal {
    /// The motion may end at any of these joint vectors. Each has one entry for each joint.
    Joints(Vec<Vec<f64>>),
    /// The motion ends with a link at any of these poses.
    Poses {
        /// Target poses of the link in the base frame, 1 to 256.
        poses: Vec<Pose>,
        /// Name of the link; the hand if `None`.
        link: Option<String>,
    },
    /// The motion ends with two links at poses in the base frame, each given with its name.
    TwoPoses([(String, Pose); 2]),
}

/// Maximum number of poses.
const MAX_POSES: usize = 256;
/// Number of inverse kinematics solutions that serve as goals: for all poses together, and for each pose at least and at
/// most.
const GOALS: usize = 128;
const GOALS_PER_POSE: [usize; 2] = [2, 16];

impl Goal {
    /// Returns the joint vectors of the goals, reduced to the planned variables, each with the index of its goal; empty if
    /// no goal pose is reachable.
    pub(super) fn joints(
        &self,
        scene: &Scene,
        model: &Model,
        q_start: &[f64],
        options: &TransitOptions,
        over: &Cancel,
    ) -> Result<Vec<(usize, Row)>, ProblemError> {
        // The motion may also end where the current motion ends.
        let last = options.warm_start.as_ref().filter(|motion| motion.joints() == q_start.len());
        let first: Vec<Row> =
            last.map(|motion| model.pick(&motion.sample(motion.end()).position)).into_iter().collect();
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
                        within_limits(model, &field, &x).map(|()| (k, x))
                    })
                    .collect()
            }
            Self::Poses { poses, link } => {
                if !(1..=MAX_POSES).contains(&poses.len()) {
                    let message = format!("must contain 1 to {MAX_POSES} poses, not {}", poses.len());
                    return Err(ProblemError::new("goal", message));
                }
                poses.iter().enumerate().try_for_each(|(k, pose)| rigid(&format!("goal[{k}]"), pose))?;
                let [least, most] = GOALS_PER_POSE;
                let mut out = Vec::new();
                for (k, pose) in poses.iter().enumerate() {
                    let mut ask = Ask::new(pose, link.as_deref(), over);
                    ask.max_solutions = (GOALS / poses.len()).clamp(least, most);
                    (ask.seed, ask.first) = (options.seed, &first);
                    out.extend(ask.rows(scene, model)?.into_iter().map(|x| (k, x)));
                }
                Ok(out)
            }
            Self::TwoPoses([(link, pose), (other, place)]) => {
                let mut ask = Ask::new(pose, Some(link), over);
                ask.other = Some((other, place));
                (ask.max_solutions, ask.seed, ask.first) = (GOALS_PER_POSE[1], options.seed, &first);
                Ok(ask.rows(scene, model)?.into_iter().map(|x| (0, x)).collect())
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
        None => "is not planned and keeps its value in q_start".to_owned(),
    };
    let message = format!("{} cannot be reached: joint {} {why}; use {}", q[j], joints[j].name(), reached[j]);
    Err(ProblemError::new(format!("{field}[{j}]"), message))
}

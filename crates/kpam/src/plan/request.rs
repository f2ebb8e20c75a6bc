//! Options of planning in addition to the problem.

use super::Plan;
use crate::Cancel;

/// Options of planning in addition to the problem; all are optional.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct Request<'a> {
    /// Earlier plan of this or a similar problem, whose pose and path are tried first.
    pub warm_start: Option<&'a Plan>,
    /// Label of the first keyframe still to reach. Earlier parts of the motion have been executed: the problem's
    /// `q_start` and `start_velocity` are the current state, and everything else is as in the problem of the earlier
    /// plan. After the actuation pose, the earlier plan must contain that pose.
    pub resume: Option<&'a str>,
    /// Maximum number of states checked for collisions; planning ends at the first candidate after this number.
    pub max_checks: Option<u64>,
    /// Time limit in wall-clock time, after which the best result so far is returned. Without a limit, the result is
    /// reproducible.
    pub deadline: Option<std::time::Duration>,
    /// Flag that ends planning.
    pub cancel: Option<Cancel>,
    /// Whether to record the outcome of each tried pose in [`Plan::tried_poses`].
    pub explain: bool,
}

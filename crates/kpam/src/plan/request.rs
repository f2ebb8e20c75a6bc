//! Options of a planning call.

use super::Plan;
use crate::Cancel;

/// Options of a planning call in addition to the problem; all are optional.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct Request<'a> {
    /// Plan of this problem or of a similar one. Its actuation pose and its path are tried first.
    pub warm_start: Option<&'a Plan>,
    /// Label of the first keyframe that is still to be reached, for a motion that was executed in part. The problem's
    /// `q_start` and `start_velocity` are then the current state, and everything else is as in the problem of the
    /// earlier plan. After the actuation pose, `warm_start` must contain this pose.
    pub resume: Option<&'a str>,
    /// Maximum number of robot states that are checked for collisions. Planning ends with the pose that exceeds it.
    pub max_checks: Option<u64>,
    /// Maximum planning time in wall-clock time; afterwards the best motion so far is returned. Only results without a
    /// time limit are reproducible.
    pub deadline: Option<std::time::Duration>,
    /// Flag with which another thread ends planning.
    pub cancel: Option<Cancel>,
    /// Whether to record the result for each tried pose in [`Plan::tried_poses`].
    pub explain: bool,
}

//! Requests to planning beside the problem.

use super::Plan;
use crate::Cancel;

/// Requests to planning beside the problem; the default asks for nothing.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct Request<'a> {
    /// An earlier plan of this or a similar problem: its pose and its way are tried first.
    pub warm_start: Option<&'a Plan>,
    /// The keyframe (by its label) that the motion goes to first. What comes before it is taken for done: the problem's
    /// `q_start` and `start_velocity` are the present state, everything else is as before the motion. Past the
    /// actuation pose the earlier plan has to say where that was.
    pub resume: Option<&'a str>,
    /// Most states that are checked for collisions; planning ends at the first candidate past that.
    pub max_checks: Option<u64>,
    /// Ends planning after so long (wall time): what was found by then is the answer. Without one, the same question has
    /// the same answer.
    pub deadline: Option<std::time::Duration>,
    /// Ends planning when set.
    pub cancel: Option<Cancel>,
    /// Whether [`Plan::tried_poses`] holds the outcome of each pose that was tried.
    pub explain: bool,
}

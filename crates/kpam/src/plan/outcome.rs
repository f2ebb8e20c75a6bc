//! Status of a plan, with its motion.

use serde::{Deserialize, Serialize};

use crate::Trajectory;

/// Status of a plan. [`Outcome`] also holds the motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Status {
    /// The whole motion is reachable and collision-free.
    Solved,
    /// Only part of the motion was found, and the options permit a partial motion.
    Partial,
    /// No joint values meet all constraints.
    ActuationInfeasible,
    /// The hand cannot reach one of the keyframes from any tried actuation pose.
    Unreachable,
    /// An obstacle blocks the motion from every tried actuation pose.
    Collision,
    /// At the start, the robot overlaps a body by more than the problem allows.
    StartInCollision,
    /// The times in the config require a motion faster than the joint limits allow.
    TooFast,
    /// From the state at the start, no motion stays within the joint limits.
    CannotStop,
    /// A collision-free path was found, but no motion along it keeps the joint limits from the state at the start.
    Untimed,
    /// No collision-free motion was found with the permitted number of samples; one may exist.
    NotFound,
    /// The caller cancelled planning.
    Cancelled,
}

impl Status {
    /// Name of the status as used in reports, such as `solved`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Solved => "solved",
            Self::Partial => "partial",
            Self::ActuationInfeasible => "actuation_infeasible",
            Self::Unreachable => "unreachable",
            Self::Collision => "collision",
            Self::StartInCollision => "start_in_collision",
            Self::TooFast => "too_fast",
            Self::CannotStop => "cannot_stop",
            Self::Untimed => "untimed",
            Self::NotFound => "not_found",
            Self::Cancelled => "cancelled",
        }
    }
}

/// Reason why a plan has no complete motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Lack {
    /// See [`Status::ActuationInfeasible`].
    ActuationInfeasible,
    /// See [`Status::Unreachable`].
    Unreachable,
    /// See [`Status::Collision`].
    Collision,
    /// See [`Status::StartInCollision`].
    StartInCollision,
    /// See [`Status::TooFast`].
    TooFast,
    /// See [`Status::CannotStop`].
    CannotStop,
    /// See [`Status::Untimed`].
    Untimed,
    /// See [`Status::NotFound`].
    NotFound,
    /// See [`Status::Cancelled`].
    Cancelled,
}

impl From<Lack> for Status {
    fn from(lack: Lack) -> Self {
        match lack {
            Lack::ActuationInfeasible => Self::ActuationInfeasible,
            Lack::Unreachable => Self::Unreachable,
            Lack::Collision => Self::Collision,
            Lack::StartInCollision => Self::StartInCollision,
            Lack::TooFast => Self::TooFast,
            Lack::CannotStop => Self::CannotStop,
            Lack::Untimed => Self::Untimed,
            Lack::NotFound => Self::NotFound,
            Lack::Cancelled => Self::Cancelled,
        }
    }
}

/// Status of a plan; a complete or partial solution includes its motion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// The complete motion.
    Solved(Trajectory),
    /// The longest part of the motion that was found, and the reason why it is not complete.
    Partial(Trajectory, Lack),
    /// Planning found no motion, for this reason.
    Failed(Lack),
}

impl Outcome {
    /// Returns the status without the motion.
    #[must_use]
    pub fn status(&self) -> Status {
        match self {
            Self::Solved(_) => Status::Solved,
            Self::Partial(..) => Status::Partial,
            Self::Failed(lack) => (*lack).into(),
        }
    }

    /// Returns the motion, if there is one.
    #[must_use]
    pub fn trajectory(&self) -> Option<&Trajectory> {
        match self {
            Self::Solved(trajectory) | Self::Partial(trajectory, _) => Some(trajectory),
            Self::Failed(_) => None,
        }
    }
}

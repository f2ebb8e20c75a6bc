//! Outcome of planning, including its motion.

use serde::{Deserialize, Serialize};

use crate::Trajectory;

/// Status of planning; [`Outcome`] also holds the motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Status {
    /// The whole motion is reachable and collision-free.
    Solved,
    /// Only part of the motion was found, as the caller permitted.
    Partial,
    /// No joint values meet all constraints.
    ActuationInfeasible,
    /// A keyframe is out of reach from every tried actuation pose.
    Unreachable,
    /// An obstacle blocks the motion from every tried actuation pose.
    Collision,
    /// At the start, the robot overlaps a body by more than the problem allows.
    StartInCollision,
    /// The config's times require more than the joints' limits allow.
    TooFast,
    /// No motion from the start state stays within the joints' limits.
    CannotStop,
    /// A collision-free path was found, but no motion along it keeps the limits from the start state on.
    Untimed,
    /// The search used up its samples without a free motion; one may exist.
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

/// Reason why there is no complete motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Lack {
    /// [`Status::ActuationInfeasible`].
    ActuationInfeasible,
    /// [`Status::Unreachable`].
    Unreachable,
    /// [`Status::Collision`].
    Collision,
    /// [`Status::StartInCollision`].
    StartInCollision,
    /// [`Status::TooFast`].
    TooFast,
    /// [`Status::CannotStop`].
    CannotStop,
    /// [`Status::Untimed`].
    Untimed,
    /// [`Status::NotFound`].
    NotFound,
    /// [`Status::Cancelled`].
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

/// Outcome of planning; a complete or partial solution includes its motion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// The whole motion.
    Solved(Trajectory),
    /// The longest part of the motion, as the caller permitted, and the reason why it is not complete.
    Partial(Trajectory, Lack),
    /// No motion, and the reason.
    Failed(Lack),
}

impl Outcome {
    /// Status as an enumeration.
    #[must_use]
    pub fn status(&self) -> Status {
        match self {
            Self::Solved(_) => Status::Solved,
            Self::Partial(..) => Status::Partial,
            Self::Failed(lack) => (*lack).into(),
        }
    }

    /// The motion, if any.
    #[must_use]
    pub fn trajectory(&self) -> Option<&Trajectory> {
        match self {
            Self::Solved(trajectory) | Self::Partial(trajectory, _) => Some(trajectory),
            Self::Failed(_) => None,
        }
    }
}

//! Outcome of planning, with its motion.

use serde::{Deserialize, Serialize};

use crate::Trajectory;

/// Status of planning, as a word; [`Outcome`] holds the motion that belongs to it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Status {
    /// The whole motion is reachable and clear.
    Solved,
    /// A part of the motion that the caller allowed to take.
    Partial,
    /// No joint values meet the constraints.
    ActuationInfeasible,
    /// A keyframe is out of reach from every actuation pose tried.
    Unreachable,
    /// Something is in the way from every actuation pose tried.
    Collision,
    /// The robot is deeper inside something at the start than the problem allows.
    StartInCollision,
    /// The clock asks for more than the joints' limits give.
    TooFast,
    /// No motion from the state at the start stays within the joints' limits.
    CannotStop,
    /// A free path was found, and no motion along it that keeps the limits from the state at the start on.
    Untimed,
    /// The search for a free motion spent its samples and found none; there may be one.
    NotFound,
    /// The caller cancelled it.
    Cancelled,
}

impl Status {
    /// Name, as in reports.
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

/// Why there is no whole motion.
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

/// Outcome of planning: what is solved, whole or in part, owns its motion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// The whole motion.
    Solved(Trajectory),
    /// The longest part of it, which the caller allowed to take, and why it is not the whole.
    Partial(Trajectory, Lack),
    /// No motion, and why.
    Failed(Lack),
}

impl Outcome {
    /// Status as a word.
    #[must_use]
    pub fn status(&self) -> Status {
        match self {
            Self::Solved(_) => Status::Solved,
            Self::Partial(..) => Status::Partial,
            Self::Failed(lack) => (*lack).into(),
        }
    }

    /// The motion, where there is one.
    #[must_use]
    pub fn trajectory(&self) -> Option<&Trajectory> {
        match self {
            Self::Solved(trajectory) | Self::Partial(trajectory, _) => Some(trajectory),
            Self::Failed(_) => None,
        }
    }
}

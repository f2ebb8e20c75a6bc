//! Timing: computes, from joint waypoints, a motion in time that keeps velocity, acceleration and jerk limits
//! everywhere.
//!
//! A path is a spline through waypoints ([`spline`]); the speed along it is time-optimal ([`reachability`], or
//! [`conic`] on Clarabel); the motion in time is a chain of cubics whose peaks have a closed form ([`time_scaling`],
//! [`motion`]); a moving average over a short window bounds the jerk ([`limits`]). If jerk limits are too low for a
//! short window, jerk is bounded along the path ([`smooth`]): S-curves on straight ones ([`profile`]), a third-order
//! optimum on others ([`third_order`]). Velocity limits may depend on the position ([`envelope`]), and torques have
//! limits where the masses are known ([`torque`]). A moving start is brought to rest ([`state_to_state`], [`stop`]) or
//! switches to another motion ([`going_over`]).

mod barrier;
mod blend;
mod brake;
mod by_length;
mod conic;
mod course;
mod envelope;
mod going_over;
mod grid;
mod limits;
mod motion;
mod profile;
mod reachability;
mod retime;
mod smooth;
mod spline;
mod state_to_state;
mod stop;
mod stream;
#[cfg(test)]
pub(crate) mod testing;
mod third_order;
mod time_scaling;
mod torque;
mod trajectory;

pub(crate) use blend::{Blend, keeps};
pub use envelope::Braking;
pub(crate) use envelope::Envelope;
pub(crate) use going_over::{gone_over, to_state};
pub use limits::Limits;
pub(crate) use motion::Node;
pub use retime::{RetimeOptions, Retimed, retime};
pub(crate) use spline::{Spline, distance, length, rounded};
pub(crate) use state_to_state::to_rest;
pub use stop::CannotStop;
pub(crate) use stop::{can_stop, stop};
pub use time_scaling::Method;
pub(crate) use torque::Dynamics;
pub(crate) use trajectory::{Builder, Refusal};
pub use trajectory::{Sample, Trajectory};

//! Timing: turns joint waypoints into a motion in time that keeps velocity, acceleration and jerk limits everywhere.
//!
//! The path is a spline through the waypoints ([`spline`]), and the speed along it is time-optimal ([`reachability`]).
//! The motion in time consists of cubics whose maxima have closed forms ([`time_scaling`], [`motion`]). A moving average over a short time window bounds the jerk ([`limits`]). If the jerk
//! limits would need a long window, the jerk is bounded along the path instead ([`smooth`]): by S-curves on straight
//! paths ([`profile`]), by a third-order optimum on curved ones ([`third_order`]). Velocity limits may depend on the
//! joint position ([`envelope`]), and torques are limited for robots with known masses ([`torque`]). A robot that moves
//! at the start is brought to rest ([`state_to_state`], [`stop`]) or joins another motion ([`going_over`]). A finished
//! motion can be executed at a varying speed ([`speed_scale`]).

mod barrier;
mod blend;
mod brake;
mod by_length;
#[cfg(test)]
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
mod speed_scale;
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
pub use speed_scale::SpeedScale;
pub(crate) use spline::{Spline, distance, length, rounded};
pub(crate) use state_to_state::to_rest;
pub use stop::CannotStop;
pub(crate) use stop::{Phase, State, can_stop, go_on, stop, stopping};
pub(crate) use torque::Dynamics;
pub use torque::Overload;
pub(crate) use trajectory::{Builder, Refusal};
pub use trajectory::{Sample, Trajectory};

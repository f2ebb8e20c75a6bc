//! Joint motion in time.

use serde::{Deserialize, Serialize};

use super::limits::Limits;
use super::motion::{Node, Piece};
use super::smooth;
use super::spline::Spline;
use super::time_scaling::{drive, stretch};
use super::torque::{Dynamics, SAMPLED};
use crate::model::{JointMap, MAX_JOINTS, Row};
use crate::{Cancel, ProblemError};
use gensim2_geometry::checked_when_read;

/// A motion in time of all joints of the robot. It consists of cubics averaged over a short time window, or of quintics
/// if the jerk limits are low. Position, velocity, acceleration and jerk are known exactly at every time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(remote = "Self")]
pub struct Trajectory {
    pieces: Vec<Piece>,
    joints: JointMap,
    times: Vec<f64>,
    /// Limits of the moving joints, which the motion keeps.
    limits: Limits,
}

checked_when_read!(Trajectory);

/// Position, velocity and acceleration at one time, with one entry for each joint.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Sample {
    /// Positions (rad or m).
    pub position: Vec<f64>,
    /// Velocities (rad/s or m/s).
    pub velocity: Vec<f64>,
    /// Accelerations (rad/s^2 or m/s^2).
    pub acceleration: Vec<f64>,
}

/// Approximate time (s) between waypoints; it is longer where the nodes are further apart.
const WAYPOINT_STEP: f64 = 0.1;

/// Maximum number of rounds in which a motion that exceeds torque limits between stations is computed again with a
/// smaller fraction of the torque limits.
const ROUNDS: usize = 8;
const AIM: f64 = 0.999;

/// Maximum deviation (rad or m) from the path that the moving average may cause if the motion need not keep its path.
/// The moving average takes a tenth of the computing time that bounding the jerk on the path takes.
const OFF: f64 = 2e-3;

/// Reason why a path could not be appended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Refusal {
    /// The path bends too sharply to be followed from the velocity at its start.
    TooSharp,
    /// The motion takes at least this long (s).
    TooLong(f64),
    /// The caller has cancelled.
    Cancelled,
}

/// Builds a trajectory from motions that are appended one after another.
#[derive(Debug, Clone)]
pub(crate) struct Builder {
    limits: Limits,
    /// Width (s) of the moving average, and the limits before averaging. `None` if the jerk limits are too low for
    /// averaging; the appended motions then have continuous accelerations themselves.
    averaged: Option<(f64, Limits)>,
    cancel: Option<Cancel>,
    dynamics: Option<Dynamics>,
    /// Whether the motion built so far exceeds a torque limit.
    overloaded: bool,
    pieces: Vec<Piece>,
    now: f64,
}

impl Builder {
    pub fn new(limits: Limits, start: f64) -> Self {
        Self {
            limits,
            averaged: limits.averaged(),
            cancel: None,
            dynamics: None,
            overloaded: false,
            pieces: Vec::new(),
            now: start,
        }
    }

    /// Sets the flag with which another thread cancels the computation.
    pub fn cancelled_by(mut self, cancel: Option<Cancel>) -> Self {
        self.cancel = cancel;
        self
    }

    /// Adds torque limits.
    pub fn loaded(mut self, dynamics: Option<Dynamics>) -> Self {
        self.dynamics = dynamics;
        self
    }

    /// Lets the moving average deviate from paths by up to [`OFF`], for motions that need not keep their paths.
    pub fn off_path(mut self) -> Self {
        self.averaged = self.limits.averaged_within(OFF);
        self
    }

    fn refusal(&self) -> Refusal {
        if self.cancel.as_ref().is_some_and(Cancel::is_cancelled) { Refusal::Cancelled } else { Refusal::TooSharp }
    }

    /// Returns the end time (s) of the motion built so far.
    pub fn now(&self) -> f64 {
        self.now
    }

    /// Widens the limits so that a start that exceeds them only by rounding keeps them.
    pub fn admit(&mut self, position: &Row, velocity: &Row, acceleration: &Row) {
        self.limits = self.limits.admitting(position, velocity, acceleration);
        self.averaged = self.limits.averaged();
    }

    /// Returns the limits of the motion.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    fn append(&mut self, piece: Piece) {
        self.now = piece.end();
        self.pieces.push(piece);
    }

    /// Appends a motion given by nodes, whose first node is at time 0.
    pub fn append_nodes(&mut self, nodes: &[Node]) {
        if nodes.len() > 1 {
            let piece = Piece::plain(self.now, self.limits.joints(), nodes);
            self.overloaded |= self.dynamics.as_ref().is_some_and(|d| d.share(&piece) > SAMPLED);
            self.append(piece);
        }
    }

    /// Returns the width (s) of the moving average; 0 without averaging.
    fn width(&self) -> f64 {
        self.averaged.as_ref().map_or(0.0, |(width, _)| *width)
    }

    /// Appends a motion along a path that also keeps the torque limits. If it exceeds them between stations, the motion
    /// is computed again with a smaller fraction of the torque limits.
    pub fn push(
        &mut self,
        path: &Spline,
        slowest: &[f64],
        velocity: &Row,
        end: Option<f64>,
        marks: &[usize],
    ) -> Result<Vec<f64>, Refusal> {
        let Some(dynamics) = self.dynamics.take() else {
            return self.push_within(path, slowest, velocity, end, marks, 1.0);
        };
        let mut room = SAMPLED;
        let mut outcome = Err(Refusal::TooSharp);
        for _ in 0..if self.overloaded { 0 } else { ROUNDS } {
            let mut next = self.clone();
            next.dynamics = Some(dynamics.clone());
            outcome = next.push_within(path, slowest, velocity, end, marks, room);
            let Ok(_) = &outcome else { break };
            let share = next.pieces[self.pieces.len()..].iter().map(|piece| dynamics.share(piece)).fold(0.0, f64::max);
            if share <= SAMPLED {
                *self = next;
                return outcome;
            }
            outcome = Err(Refusal::TooSharp);
            room *= AIM * SAMPLED / share;
        }
        self.dynamics = Some(dynamics);
        outcome
    }

    /// Appends a motion along a path to rest, from the component of `velocity` along the tangent. It ends at time `end`
    /// (s) if given, otherwise as soon as possible. Returns the times at which it passes the waypoints in `marks`.
    fn push_within(
        &mut self,
        path: &Spline,
        slowest: &[f64],
        velocity: &Row,
        end: Option<f64>,
        marks: &[usize],
        room: f64,
    ) -> Result<Vec<f64>, Refusal> {
        let load = self.dynamics.as_ref().map(|dynamics| (dynamics, room));
        let (mut nodes, of_knot, cubic) = match &self.averaged {
            Some((_, before)) => {
                let (nodes, grid) =
                    drive(before, path, slowest, velocity, load, self.cancel.as_ref()).ok_or_else(|| self.refusal())?;
                (nodes, grid.station_of, false)
            }
            None => smooth::drive(&self.limits, path, slowest, velocity, load, self.cancel.as_ref())
                .ok_or_else(|| self.refusal())?,
        };
        let width = self.width();
        let least = nodes[nodes.len() - 1].time;
        let last = nodes.len() - 1;
        if let Some(end) = end {
            let allowed = end - self.now;
            if allowed < least + width {
                return Err(Refusal::TooLong(least + width));
            }
            let resting = velocity[..self.limits.joints()].iter().all(|v| *v == 0.0);
            if resting && least > 0.0 {
                stretch(&mut nodes, (allowed - width) / least);
            } else if let Some(mut last) = nodes.last().copied() {
                // A motion from a moving start cannot be slowed, so it waits at its end instead.
                last.time = allowed - width;
                nodes.push(last);
            }
        }
        let places: Vec<usize> = marks.iter().map(|w| of_knot[path.knot_of(*w)]).collect();
        if nodes.len() < 2 {
            return Ok(vec![self.now; marks.len()]);
        }
        let joints = self.limits.joints();
        let piece = match self.averaged {
            Some(_) => Piece::averaged(self.now, width, joints, &nodes, &places),
            None if cubic => Piece::smooth(self.now, joints, &nodes, &places).with_even_jerk(),
            None => Piece::smooth(self.now, joints, &nodes, &places),
        };
        let end = piece.end();
        // The motion is at rest at its last node, so it passes this node at its end.
        let passed = |node: usize| if node == last { end } else { self.now + nodes[node].time + 0.5 * width };
        let times = places.iter().map(|node| passed(*node)).collect();
        self.append(piece);
        Ok(times)
    }

    /// Returns whether a motion keeps the torque limits.
    pub fn bears(&self, motion: &Trajectory) -> bool {
        self.dynamics.as_ref().is_none_or(|d| motion.pieces().iter().all(|piece| d.share(piece) <= SAMPLED))
    }

    /// Returns the trajectory of all joints that the variables drive through the map `joints`.
    pub fn build(self, joints: &JointMap) -> Trajectory {
        let mut times = Vec::new();
        for piece in &self.pieces {
            let mut more = piece.landmarks(WAYPOINT_STEP);
            more.pop();
            times.append(&mut more);
        }
        times.push(self.now);
        Trajectory { pieces: self.pieces, joints: joints.clone(), times, limits: self.limits }
    }
}

impl Trajectory {
    /// Validates a deserialized motion; the times of waypoints and pieces must not decrease.
    fn check(&self) -> Result<(), ProblemError> {
        let fits = |piece: &Piece| piece.is_sound() && piece.joints() == self.joints.indices().len();
        let follow = self.pieces.windows(2).all(|pair| pair[0].counts <= pair[1].counts);
        let times = !self.times.is_empty()
            && self.times.iter().all(|t| t.is_finite())
            && self.times.windows(2).all(|pair| pair[0] <= pair[1]);
        let limits = self.limits.is_sound() && self.limits.joints() == self.joints.indices().len();
        if times && follow && limits && self.joints.is_sound() && self.pieces.iter().all(fits) {
            return Ok(());
        }
        Err(ProblemError::new("trajectory", "is damaged"))
    }

    /// Returns the times (s) of the waypoints, which include the times of all keyframes.
    #[must_use]
    pub fn times(&self) -> &[f64] {
        &self.times
    }

    /// Returns the time (s) of the first waypoint.
    #[must_use]
    pub fn start(&self) -> f64 {
        self.times[0]
    }

    /// Returns the time (s) of the last waypoint.
    #[must_use]
    pub fn end(&self) -> f64 {
        self.times[self.times.len() - 1]
    }

    /// Returns the number of joints, including mimic joints and fixed ones.
    #[must_use]
    pub fn joints(&self) -> usize {
        self.joints.joints()
    }

    /// Returns position, velocity and acceleration of all joints at time `t` (s). Before the start, it is the state at
    /// the start; after the end, the robot rests at the last position.
    #[must_use]
    pub fn sample(&self, t: f64) -> Sample {
        let [position, velocity, acceleration] = self.moving_with_rates(t);
        let mut out = Sample { position: Vec::new(), velocity: Vec::new(), acceleration: Vec::new() };
        self.joints.positions(&position, &mut out.position);
        self.joints.rates(&velocity, &mut out.velocity);
        self.joints.rates(&acceleration, &mut out.acceleration);
        out
    }

    /// Returns positions, velocities and accelerations of the moving joints at time `t` (s).
    pub(crate) fn moving_with_rates(&self, t: f64) -> [Row; 3] {
        let t = t.max(self.start());
        let at = self.pieces.partition_point(|p| p.counts <= t).saturating_sub(1);
        match self.pieces.get(at) {
            Some(piece) => piece.at(t),
            None => [self.joints.pick(self.joints.rest()), [0.0; MAX_JOINTS], [0.0; MAX_JOINTS]],
        }
    }

    /// Returns upper bounds of each moving joint's deviation (rad or m) between two times (s) from the straight line
    /// between its positions at these times, and of its distance from either position if the joint reverses in between.
    pub(crate) fn deviations(&self, [from, to]: [f64; 2]) -> [Row; 2] {
        let (mut most, mut total) = ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS]);
        let first = self.pieces.partition_point(|p| p.counts <= from).saturating_sub(1);
        for piece in self.pieces.get(first..).unwrap_or_default().iter().take_while(|p| p.counts <= to) {
            piece.widen_to_accelerations([from.max(piece.counts), to], &mut most, &mut total);
        }
        // In a time h, a curve deviates from its chord by at most h^2 / 8 times the largest second derivative, and by at
        // most h / 4 times the integral of the absolute second derivative.
        let h = to - from;
        let mut off = [0.0; MAX_JOINTS];
        for v in 0..self.limits.joints() {
            off[v] = (0.125 * h * h * most[v]).min(0.25 * h * total[v]);
            most[v] *= 0.5 * h * h;
        }
        [off, most]
    }

    /// Returns the positions of all joints at the waypoint times.
    #[must_use]
    pub fn positions(&self) -> Vec<Vec<f64>> {
        self.times.iter().map(|t| self.sample(*t).position).collect()
    }

    /// Returns the limits of the moving joints.
    pub(crate) fn limits(&self) -> &Limits {
        &self.limits
    }

    /// Returns the map from the moving joints to all joints.
    pub(crate) fn map(&self) -> &JointMap {
        &self.joints
    }

    pub(crate) fn pieces(&self) -> &[Piece] {
        &self.pieces
    }

    /// Returns whether this motion has the same moving joints as `map`, has at time `t` a state within `most` (rad or
    /// m, and rates) of `state`, and keeps all other joints where `map` does.
    pub(crate) fn goes_on_from(&self, map: &JointMap, t: f64, state: &[Row; 3], most: f64) -> bool {
        let near = |a: f64, b: f64| (a - b).abs() <= most;
        map.driven() == self.joints.driven()
            && map.joints() == self.joints()
            && (0..map.joints()).all(|j| map.moves(j) || near(map.rest()[j], self.joints.rest()[j]))
            && (self.start()..=self.end()).contains(&t)
            && self.moving_with_rates(t).iter().zip(state).all(|(a, b)| a.iter().zip(b).all(|(a, b)| near(*a, *b)))
    }

    /// Returns the pieces from time `t` (s) on; the first of them takes effect at `t`.
    pub(crate) fn from(&self, t: f64) -> Vec<Piece> {
        let first = self.pieces.partition_point(|p| p.counts <= t).saturating_sub(1);
        let mut out: Vec<Piece> = self.pieces.get(first..).unwrap_or_default().to_vec();
        if let Some(piece) = out.first_mut() {
            piece.counts = piece.counts.max(t);
        }
        out
    }

    /// Returns a motion of the same joints that consists of other pieces.
    pub(crate) fn with(&self, pieces: Vec<Piece>, times: Vec<f64>, limits: Limits) -> Self {
        Self { pieces, joints: self.joints.clone(), times, limits }
    }

    /// Returns the positions of the moving joints at time `t` (s), for collision checks.
    pub(crate) fn moving(&self, t: f64) -> Row {
        self.moving_with_rates(t)[0]
    }
}

//! Motions along hand poses: straight lines with uniform rotation between the poses, within a tolerance.

use std::time::Instant;

use gensim2_geometry::{Chain, Draws, Other, Pose};
use nalgebra::Vector3;

use super::field::Field;
use super::{Close, Motion, NoMotion, Stuck, Transit, TransitOptions};
use crate::body::rigid;
use crate::error::finite;
use crate::hand_path::{Follower, left};
use crate::model::{MAX_JOINTS, Model, Row};
use crate::motion::HandPath;
use crate::timing::Spline;
use crate::world::{CONTACT, Required, is_below};
use crate::{ProblemError, Scene, Trajectory};

/// Maximum number of poses.
const MAX_POSES: usize = 10_000;
/// Number of ways in which the redundant joints are moved before the search ends.
const TRIES: usize = 24;
/// Number of checked configurations of the timed motion between two waypoints, which are 10 mm or 0.05 rad apart.
const SAMPLES: usize = 5;
/// Fraction of the tolerance that the curve through the waypoints may use; the rest is reserved for the timed motion.
const CURVE: f64 = 0.5;
/// Seed of the random postures.
const SEED: usize = 0x706f_7365;

/// Tolerance of a motion along hand poses.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct PathTolerance {
    /// Maximum distance (m) of the hand's origin from the lines between the poses, 0.1 mm to 0.1 m.
    pub position: f64,
    /// Maximum angle (rad) between the hand's orientation and the one of the nearest pose of the line, 1 mrad to pi. With
    /// a free axis, the angle between the directions of this axis.
    pub rotation: f64,
    /// Axis of the hand frame about which the hand may rotate freely; default: none.
    pub free_axis: Option<Vector3<f64>>,
    /// Name of a second link that keeps its pose relative to the hand within the same tolerances, such as the other hand
    /// of a robot that carries one object with both; default: none.
    pub second_link: Option<String>,
}

impl Default for PathTolerance {
    fn default() -> Self {
        Self { position: 1e-3, rotation: 0.01, free_axis: None, second_link: None }
    }
}

impl PathTolerance {
    /// Validates the tolerance, and returns it with a free axis of unit length.
    fn checked(&self) -> Result<Self, ProblemError> {
        let fail = |field: &str, message: String| Err(ProblemError::new(field, message));
        if !(1e-4..=0.1).contains(&self.position) {
            return fail("position_tolerance", format!("must lie in 0.0001 to 0.1 m, not {}", self.position));
        }
        if !(1e-3..=std::f64::consts::PI).contains(&self.rotation) {
            return fail("rotation_tolerance", format!("must lie in 0.001 to pi rad, not {}", self.rotation));
        }
        if self.second_link.is_some() && self.free_axis.is_some() {
            return fail("free_axis", "must be omitted with a second link".to_owned());
        }
        let mut out = self.clone();
        if let Some(axis) = &mut out.free_axis {
            let largest = axis.amax();
            if !(largest > 0.0 && axis.iter().all(|c| c.is_finite())) {
                return fail("free_axis", "must be a finite vector that is not zero".to_owned());
            }
            *axis = (*axis / largest).normalize();
        }
        Ok(out)
    }
}

/// Plans a motion from rest at `q_start` that brings the hand to each of `poses` (base frame) in turn. The hand moves on
/// straight lines and rotates uniformly, from its pose at `q_start` to the first pose, and from each pose to the next. It
/// stops at a pose only if it could not keep the tolerance otherwise.
///
/// The joints move continuously. If the arm is redundant, other motions of the redundant joints are tried if the hand
/// cannot follow the lines, or an obstacle is in the way. Joints that move neither the hand nor the second link keep their
/// values. Collisions of attached bodies with the hand of the second link are not checked, because it holds them, too.
///
/// # Errors
/// Start, poses, tolerance or options are invalid, or the options ask for a moving start; names the field.
pub fn plan_along(
    scene: &Scene,
    q_start: &[f64],
    poses: &[Pose],
    tolerance: &PathTolerance,
    options: &TransitOptions,
) -> Result<Result<Motion, NoMotion>, ProblemError> {
    let begun = Instant::now();
    let tolerance = tolerance.checked()?;
    if poses.is_empty() || poses.len() > MAX_POSES {
        return Err(ProblemError::new("poses", format!("must contain 1 to {MAX_POSES} poses, not {}", poses.len())));
    }
    poses.iter().enumerate().try_for_each(|(k, pose)| rigid(&format!("poses[{k}]"), pose))?;
    if options.start_velocity.is_some() || options.start_acceleration.is_some() || options.warm_start.is_some() {
        return Err(ProblemError::new("start_velocity", "must be omitted: a motion along poses begins at rest"));
    }
    finite("q_start", q_start)?;
    let model = Model::new(scene.robot(), q_start)?;
    let transit = Transit::new(scene, &model, options, begun)?;
    let second = match tolerance.second_link.as_deref() {
        None => None,
        Some(name) => {
            let fail = |message: String| Err(ProblemError::new("second_link", message));
            let robot = scene.robot();
            let Some(link) = robot.link_index(name) else {
                return fail(format!("{name:?} is not a link of {:?}", robot.name()));
            };
            if is_below(robot, robot.hand(), link) {
                return fail(format!("{name:?} carries the hand; name a link of the other arm"));
            }
            let Some(chain) = robot.chain_to(link).filter(|chain| model.moves(chain) != model.moves(robot.chain()))
            else {
                return fail(format!("no planned joint moves {name:?} relative to the hand"));
            };
            Some(Second { chain, held: scene.compiled().held_by(robot, link) })
        }
    };
    Ok(transit.along_poses(poses, &tolerance, second.as_ref()))
}

/// The second link of a motion along poses.
struct Second {
    chain: Chain,
    /// Pairs of an attached body and a link that holds it together with the hand.
    held: Vec<usize>,
}

/// A waypoint on the lines between the poses.
#[derive(Clone, Copy)]
struct Station {
    x: Row,
    /// Index of the pose at the end of the line, and the position on the line, 0 to 1.
    pose: usize,
    share: f64,
}

/// Waypoints along all lines, in time order.
struct Stations {
    all: Vec<Station>,
    /// Index of the last waypoint of each line.
    ends: Vec<usize>,
}

impl Transit<'_> {
    fn along_poses(
        self,
        poses: &[Pose],
        tolerance: &PathTolerance,
        second: Option<&Second>,
    ) -> Result<Motion, NoMotion> {
        let start = self.state[0];
        let at_start = self.close_apart(&start, second);
        if let Some(hit) = at_start.iter().find(|c| c.2 < -CONTACT) {
            return Err(NoMotion::StartBlocked(self.approached(hit)));
        }
        self.is_held_at_start()?;
        let mut follower = self.follower(second);
        (follower.free_axis, follower.tolerance) =
            (tolerance.free_axis, [CURVE * tolerance.position, CURVE * tolerance.rotation]);
        let mut from = follower.hand(&start);
        let lines: Vec<HandPath> =
            poses.iter().map(|pose| HandPath::Line { from: std::mem::replace(&mut from, *pose), to: *pose }).collect();
        let held = if tolerance.free_axis.is_some() { 5 } else { 6 } * if second.is_some() { 2 } else { 1 };
        let tries = if follower.movers() > held { TRIES } else { 1 };
        let mut draws = Draws::of(SEED as u64, self.options.seed);
        let mut checks = 0;
        let mut furthest: Option<(usize, NoMotion)> = None;
        for attempt in 0..tries {
            if let Some(reason) = self.ending.reason() {
                return Err(reason);
            }
            follower.posture = (attempt > 0).then(|| self.posture(&mut draws));
            let found = self
                .stations(&mut follower, &lines, &start)
                .and_then(|stations| self.motion_through(&stations, &lines, tolerance, second, &at_start, &mut checks));
            match found {
                Ok(motion) => return Ok(motion),
                Err((place, why)) => {
                    if furthest.as_ref().is_none_or(|(other, _)| place > *other) {
                        furthest = Some((place, why));
                    }
                }
            }
            if self.options.max_checks.is_some_and(|most| checks >= most) {
                break;
            }
        }
        Err(self.ending.reason().or(furthest.map(|(_, why)| why)).unwrap_or(NoMotion::NotFound(None)))
    }

    /// Returns a follower of hand paths that takes the second link along.
    fn follower(&self, second: Option<&Second>) -> Follower<'_> {
        let follower = Follower::new(self.scene.robot(), self.model, self.over.clone());
        match second {
            None => follower,
            Some(second) => follower.with_second(second.chain.clone(), &self.state[0]),
        }
    }

    /// Returns all pairs closer than the margin at a configuration, except bodies that the second link holds.
    fn close_apart(&self, x: &Row, second: Option<&Second>) -> Close {
        let mut close = self.close(x);
        if let Some(second) = second {
            close.retain(|(_, other, _)| !matches!(other, Other::Pair(pair) if second.held.contains(pair)));
        }
        close
    }

    /// Returns random joint values, toward which the redundant joints move.
    fn posture(&self, draws: &mut Draws) -> Row {
        let mut out = [0.0; MAX_JOINTS];
        for (v, value) in out.iter_mut().enumerate().take(self.model.n()) {
            let (low, high) = self.model.range(v);
            *value = low + (high - low) * draws.unit();
        }
        out
    }

    /// Returns waypoints along all lines; if the hand cannot follow a line, the reason, with a number that grows with the
    /// part of the lines that the hand can follow.
    fn stations(
        &self,
        follower: &mut Follower<'_>,
        lines: &[HandPath],
        start: &Row,
    ) -> Result<Stations, (usize, NoMotion)> {
        let mut out = Stations { all: vec![Station { x: *start, pose: 0, share: 0.0 }], ends: Vec::new() };
        let mut at = *start;
        for (pose, line) in lines.iter().enumerate() {
            let followed = follower.follow(line, &at, false);
            let steps = followed.waypoints.len() - 1;
            for (k, x) in followed.waypoints.iter().enumerate().skip(1) {
                let share = followed.fraction * k as f64 / steps as f64;
                out.all.push(Station { x: *x, pose, share });
                at = *x;
            }
            if followed.fraction < 1.0 {
                let why = NoMotion::OffPath { pose, share: followed.fraction, limit: follower.limit_at(&at) };
                return Err((out.all.len(), why));
            }
            out.ends.push(out.all.len() - 1);
        }
        Ok(out)
    }

    /// Returns the timed motion through waypoints; otherwise the reason, with a number that grows with the collision-free
    /// part of the lines.
    fn motion_through(
        &self,
        stations: &Stations,
        lines: &[HandPath],
        tolerance: &PathTolerance,
        second: Option<&Second>,
        at_start: &Close,
        checks: &mut u64,
    ) -> Result<Motion, (usize, NoMotion)> {
        let rows: Vec<Row> = stations.all.iter().map(|station| station.x).collect();
        let last = rows.len() - 1;
        let margin = self.options.margin;
        let at_end = self.close_apart(&rows[last], second);
        let mut needs =
            self.scene.compiled().needs_beside(self.scene.robot(), at_start.iter().chain(&at_end), margin, margin);
        self.scene.compiled().leave_out_still(&mut needs, self.model.map());
        second.iter().flat_map(|s| &s.held).for_each(|pair| needs.pairs[*pair] = f64::NEG_INFINITY);
        let needs = Required::from(needs);
        let mut field = Field::new(self.scene, self.model, needs.clone(), self.ending.clone());
        let blocked = at_end.iter().any(|c| c.2 < -CONTACT).then_some(last);
        let first_blocked =
            |field: &mut Field<'_>| (0..rows.len()).find(|k| field.blocked_at(&rows[*k..=*k]).is_some());
        let is_blocked = field.blocked_at(&rows).is_some();
        if let Some(k) = if is_blocked { first_blocked(&mut field) } else { None }.or(blocked) {
            *checks += field.checks;
            return Err((k, self.blocked(stations.all[k].pose, &rows[k], &needs, second)));
        }
        let mut stops = vec![last];
        let mut sweep = self.sweep(&needs, &field);
        loop {
            let (trajectory, times) = self
                .timed_through(&rows, &stops)
                .map_err(|()| (last, self.strained(&rows).unwrap_or(NoMotion::Untimed)))?;
            let stray = self.stray(&trajectory, &times, stations, lines, tolerance, second);
            let Some(stray) = stray else {
                let outcome = self.proven(&mut field, &mut sweep, &trajectory);
                *checks += field.checks;
                return match outcome {
                    Ok(()) => {
                        Ok(self.motion(trajectory, &rows, lines.len() - 1, at_start.iter().chain(&at_end), *checks))
                    }
                    Err(Stuck::Near(near)) => Err((last, NoMotion::NotFound(Some(near)))),
                    Err(Stuck::Untimed) => Err((last, NoMotion::Untimed)),
                    Err(Stuck::Off | Stuck::Blocked | Stuck::Over) => Err((last, NoMotion::NotFound(None))),
                };
            };
            // A motion that leaves the lines near a pose stops there.
            let pose = stations.all[stray].pose;
            let before = pose.checked_sub(1).map(|p| stations.ends[p]);
            let corners = before.into_iter().chain([stations.ends[pose]]).filter(|end| !stops.contains(end));
            let Some(corner) = corners.min_by_key(|end| end.abs_diff(stray)) else {
                let why = NoMotion::OffTolerance { pose, share: stations.all[stray].share };
                return Err((stray, why));
            };
            stops.push(corner);
            stops.sort_unstable();
        }
    }

    /// Returns the fastest motion through waypoints that stops at `stops`, and the times at which it passes each.
    fn timed_through(&self, rows: &[Row], stops: &[usize]) -> Result<(Trajectory, Vec<f64>), ()> {
        let mut builder = self.builder();
        let mut times = vec![builder.now()];
        let mut first = 0;
        for stop in stops.iter().copied().filter(|stop| *stop > 0) {
            let part = &rows[first..=stop];
            let spline = Spline::through(self.model.n(), part, None);
            let marks: Vec<usize> = (1..part.len()).collect();
            let passed = builder.push(&spline, &[], &[0.0; MAX_JOINTS], None, &marks).map_err(|_| ())?;
            times.extend(passed);
            first = stop;
        }
        Ok((builder.build(self.model.map()), times))
    }

    /// Returns the first waypoint after which the motion exceeds the tolerance.
    fn stray(
        &self,
        trajectory: &Trajectory,
        times: &[f64],
        stations: &Stations,
        lines: &[HandPath],
        tolerance: &PathTolerance,
        second: Option<&Second>,
    ) -> Option<usize> {
        let mut follower = self.follower(second);
        (0..times.len() - 1).find(|&k| {
            let (from, to) = (stations.all[k], stations.all[k + 1]);
            // The first waypoint of a line is the last one of the line before.
            let begin = if from.pose == to.pose { from.share } else { 0.0 };
            (0..=SAMPLES).any(|s| {
                let t = times[k] + (times[k + 1] - times[k]) * s as f64 / SAMPLES as f64;
                let x = trajectory.moving(t);
                let kept = |[way, turn]: [f64; 2]| way <= tolerance.position && turn <= tolerance.rotation;
                let hand = follower.hand(&x);
                !(kept(deviation(&lines[to.pose], [begin, to.share], &hand, tolerance))
                    && kept(follower.second_off(&x)))
            })
        })
    }

    fn blocked(&self, pose: usize, x: &Row, needs: &Required, second: Option<&Second>) -> NoMotion {
        let close = self.close_apart(x, second);
        let spare = |c: &(usize, Other, f64)| c.2 - needs.of(&self.scene.compiled().screen, c.0, c.1);
        match close.iter().min_by(|a, b| spare(a).total_cmp(&spare(b))) {
            Some(near) => NoMotion::PathBlocked { pose, pair: self.approached(near) },
            None => NoMotion::NotFound(None),
        }
    }
}

/// Returns the distance (m) and angle (rad) of a hand pose from a part of a line, a little of which may lie beyond either
/// end of the part. The nearest pose of the line is one with a small distance and a small angle, both relative to the
/// tolerance.
fn deviation(line: &HandPath, [from, to]: [f64; 2], hand: &Pose, tolerance: &PathTolerance) -> [f64; 2] {
    let free_axis = tolerance.free_axis.as_ref();
    let more = 0.5 * (to - from);
    let (from, to) = ((from - more).max(0.0), (to + more).min(1.0));
    let (a, b) = (line.at(from), line.at(to));
    let ((way, turn), (gone, turned)) = (left(&b, &a, free_axis), left(hand, &a, free_axis));
    let excess = |[way, turn]: &[f64; 2]| (way / tolerance.position).max(turn / tolerance.rotation);
    // Weights of the squared distance and of the squared angle.
    let both = [tolerance.position.powi(-2), tolerance.rotation.powi(-2)];
    let mut best = [f64::INFINITY; 2];
    for [p, r] in [both, [1.0, 0.0], [0.0, 1.0]] {
        let length = p * way.norm_squared() + r * turn.norm_squared();
        let share = if length > 0.0 { (p * gone.dot(&way) + r * turned.dot(&turn)) / length } else { 0.0 };
        let (way, turn) = left(&line.at(from + (to - from) * share.clamp(0.0, 1.0)), hand, free_axis);
        let found = [way.norm(), turn.norm()];
        if excess(&found) < excess(&best) {
            best = found;
        }
    }
    best
}

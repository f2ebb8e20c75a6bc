//! Fastest stops, in which each joint brakes within its own limits. Planning needs a start from which all joints can
//! stop within the joint limits.

use serde::{Deserialize, Serialize};

use super::limits::{Limits, TOLERANCE};
use super::motion::{Node, range};
use crate::model::{MAX_JOINTS, Row};

/// A joint that exceeds its limits in every motion from the moving start.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct CannotStop {
    /// Index of the joint among the joints that planning moves.
    pub joint: usize,
    /// The limit that is exceeded, explained in one sentence.
    pub reason: String,
}

/// A phase of constant jerk: duration (s) and jerk (rad/s^3 or m/s^3).
pub(crate) type Phase = (f64, f64);

/// State of a joint: position, velocity, acceleration.
pub(crate) type State = [f64; 3];

pub(crate) fn go_on([position, velocity, acceleration]: State, jerk: f64, t: f64) -> State {
    [
        position + t * (velocity + t * (0.5 * acceleration + t * jerk / 6.0)),
        velocity + t * (acceleration + 0.5 * t * jerk),
        acceleration + t * jerk,
    ]
}

/// Returns the phases in which a joint's acceleration changes to zero.
fn settling(acceleration: f64, jerk: f64) -> [Phase; 3] {
    [(acceleration.abs() / jerk, -acceleration.signum() * jerk), (0.0, 0.0), (0.0, 0.0)]
}

/// Returns the phases that bring a joint to rest in the minimum time.
pub(crate) fn stopping(velocity: f64, acceleration: f64, most: f64, jerk: f64) -> [Phase; 3] {
    // Velocity that is left when the acceleration is zero; braking must remove it.
    let left = velocity + 0.5 * acceleration * acceleration.abs() / jerk;
    if left == 0.0 {
        return settling(acceleration, jerk);
    }
    // To brake, the acceleration along this velocity decreases to -peak, stays there, and returns to zero.
    let side = left.signum();
    let (velocity, acceleration) = (side * velocity, side * acceleration);
    let peak = (jerk * velocity + 0.5 * acceleration * acceleration).max(0.0).sqrt();
    let (peak, held) = if peak > most {
        (most, (velocity + (0.5 * acceleration * acceleration - most * most) / jerk) / most)
    } else {
        (peak, 0.0)
    };
    [((acceleration + peak).max(0.0) / jerk, -side * jerk), (held.max(0.0), 0.0), (peak / jerk, side * jerk)]
}

/// Returns the nodes of a motion to rest. `phases` holds the constant-jerk phases of each joint; there is a node
/// wherever a phase of any joint ends.
pub(super) fn nodes(limits: &Limits, start: &[State], phases: &[impl AsRef<[Phase]>]) -> Vec<Node> {
    nodes_to(limits, start, phases, true)
}

/// Like `nodes`, for a motion that may not end at rest. A joint whose phases end slightly earlier because of rounding
/// keeps its acceleration.
pub(super) fn nodes_to(limits: &Limits, start: &[State], phases: &[impl AsRef<[Phase]>], rests: bool) -> Vec<Node> {
    let mut times: Vec<f64> = vec![0.0];
    for joint in phases {
        let mut t = 0.0;
        for (duration, _) in joint.as_ref() {
            t += duration;
            times.push(t);
        }
    }
    times.sort_by(f64::total_cmp);
    times.dedup();
    times
        .iter()
        .map(|time| {
            let [mut position, mut velocity, mut acceleration] = [[0.0; MAX_JOINTS]; 3];
            for v in 0..limits.joints() {
                let (mut state, mut left, mut whole) = (start[v], *time, 0.0);
                for (duration, jerk) in phases[v].as_ref() {
                    let t = duration.min(left);
                    state = go_on(state, *jerk, t);
                    left -= t;
                    whole += duration;
                }
                if *time >= whole {
                    let gain = if rests { 0.0 } else { state[2] };
                    state = go_on([state[0], state[1], gain], 0.0, left);
                }
                [position[v], velocity[v], acceleration[v]] = state;
            }
            Node { time: *time, position, velocity, acceleration: Some(acceleration) }
        })
        .collect()
}

/// Returns position, velocity and acceleration of joint `v`.
pub(super) fn state_of(position: &Row, velocity: &Row, acceleration: &Row, v: usize) -> State {
    [position[v], velocity[v], acceleration[v]]
}

fn states(joints: usize, position: &Row, velocity: &Row, acceleration: &Row) -> Vec<State> {
    (0..joints).map(|v| state_of(position, velocity, acceleration, v)).collect()
}

/// Returns the nodes of the motion in which every joint comes to rest as soon as it can.
pub(crate) fn stop(limits: &Limits, position: &Row, velocity: &Row, acceleration: &Row) -> Vec<Node> {
    let phases: Vec<_> = (0..limits.joints())
        .map(|v| stopping(velocity[v], acceleration[v], limits.acceleration[v], limits.jerk[v]))
        .collect();
    let mut out = nodes(limits, &states(limits.joints(), position, velocity, acceleration), &phases);
    if let Some(last) = out.last_mut() {
        last.velocity = [0.0; MAX_JOINTS];
    }
    out
}

/// Checks whether every joint can stay within its limits from this state. The fastest stop moves a joint the least, so
/// if that stop exceeds a limit, every motion does.
///
/// # Errors
/// Returns the first joint that exceeds its limits.
pub(crate) fn can_stop(
    limits: &Limits,
    lower: &Row,
    upper: &Row,
    position: &Row,
    velocity: &Row,
    acceleration: &Row,
) -> Result<(), CannotStop> {
    let fail = |joint, reason| Err(CannotStop { joint, reason });
    for v in 0..limits.joints() {
        let gain = acceleration[v];
        let speed = limits.settled_speed(v, velocity[v], gain);
        if !Limits::keeps(speed, limits.velocity[v]) {
            return fail(
                v,
                format!("its velocity will reach {speed:.4} rad/s (or m/s), above its limit {:.4}", limits.velocity[v]),
            );
        }
        if let Some(most) = limits.envelope.and_then(|e| e.exceeded(v, position[v], velocity[v])) {
            let reason =
                format!("its velocity {:.4} rad/s (or m/s) is above {most:.4}, the limit at its position", velocity[v]);
            return fail(v, reason);
        }
        if !Limits::keeps(gain, limits.acceleration[v]) {
            let reason = format!(
                "its acceleration {gain:.4} rad/s^2 (or m/s^2) is above its limit {:.4}",
                limits.acceleration[v]
            );
            return fail(v, reason);
        }
    }
    let motion = stop(limits, position, velocity, acceleration);
    if let Some(envelope) = &limits.admitting(position, velocity, acceleration).envelope {
        for v in 0..limits.joints() {
            if motion.windows(2).any(|pair| !envelope.is_kept_between(limits.joints(), v, &pair[0], &pair[1])) {
                let reason = "even with maximum braking its velocity exceeds the limit at some position".to_owned();
                return fail(v, reason);
            }
        }
    }
    for v in 0..limits.joints() {
        // A joint that starts outside its limits may not move further outside.
        let (low, high) = (lower[v].min(position[v]), upper[v].max(position[v]));
        for pair in motion.windows(2) {
            let (least, most) = range(limits.joints(), v, &pair[0], &pair[1]);
            if least < low - TOLERANCE || most > high + TOLERANCE {
                let (past, end, limit) =
                    if least < low - TOLERANCE { (least, "lower", low) } else { (most, "upper", high) };
                let reason = format!(
                    "even with maximum braking it reaches {past:.4} rad (or m), beyond its {end} limit {limit:.4}"
                );
                return fail(v, reason);
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn stops_are_at_rest_and_within_limits(v in -1.0..1.0f64, a in -2.0..2.0f64, jerk in 1.0..1e4f64) {
            let limits = Limits::new(&[1.0], &[2.0], &[jerk]).unwrap();
            let mut state = [0.3, v, a];
            for (t, j) in stopping(v, a, 2.0, jerk) {
                prop_assert!(t >= 0.0 && j.abs() <= jerk + 1e-9);
                state = go_on(state, j, t);
                prop_assert!(state[2].abs() <= 2.0 + 1e-9, "{state:?}");
            }
            prop_assert!(state[1].abs() < 1e-9 && state[2].abs() < 1e-9, "{state:?}");
            let row = |x: f64| [x; MAX_JOINTS];
            let nodes = stop(&limits, &row(0.3), &row(v), &row(a));
            prop_assert!((nodes[nodes.len() - 1].position[0] - state[0]).abs() < 1e-9);
        }
    }

    #[test]
    fn no_room_to_stop_is_seen() {
        let limits = Limits::new(&[2.0], &[10.0], &[1e6]).unwrap();
        let row = |x: f64| [x; MAX_JOINTS];
        // Stopping distance: v^2 / 2a = 0.05 m.
        let judge = |q: f64, v: f64| can_stop(&limits, &row(-1.0), &row(1.0), &row(q), &row(v), &row(0.0));
        assert!(judge(0.94, 1.0).is_ok());
        assert!(judge(0.96, 1.0).is_err());
        assert!(judge(0.96, -1.0).is_ok());
        assert!(judge(0.0, 50.0).unwrap_err().reason.contains("limit"));
    }
}

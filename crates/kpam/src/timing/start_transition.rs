//! Transition of a motion that is under way onto a path: along the line on which it moves, and off it in a turn.

use super::motion::Node;
use super::spline::{Spline, distance};
use super::stop::{self, CannotStop};
use super::trajectory::Builder;
use crate::model::{MAX_JOINTS, Row};

/// Factor on the least braking time along the line.
const ROOM: f64 = 1.02;
/// Turns are tried about places this many braking times away.
const TURNS: [f64; 3] = [1.0, 1.6, 2.6];
/// Lines shorter than this (rad or m) are no paths.
const SHORTEST: f64 = 1e-8;
/// Waypoints of a turn.
const PARTS: usize = 8;

/// State of the moving joints.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Start {
    pub position: Row,
    pub velocity: Row,
    pub acceleration: Row,
}

/// First part of a motion, before the planned one.
#[derive(Debug, Clone)]
pub(crate) enum StartTransition {
    /// Nothing: it is at rest.
    Resting(Row),
    /// Once its acceleration is taken away it moves along a line, on which it could be at rest at `brake`.
    Line { begin: Row, velocity: Row, brake: Row },
    /// Every joint brakes as hard as it can.
    Stop { nodes: Vec<Node> },
}

impl StartTransition {
    /// State from which planning begins: one in which the motion can rest.
    pub fn rest(&self) -> Row {
        match self {
            Self::Resting(position) => *position,
            Self::Line { brake, .. } => *brake,
            Self::Stop { nodes } => nodes.last().map_or([0.0; MAX_JOINTS], |n| n.position),
        }
    }

    /// Velocity at the start of the first path.
    pub fn velocity(&self) -> Row {
        match self {
            Self::Line { velocity, .. } => *velocity,
            _ => [0.0; MAX_JOINTS],
        }
    }

    /// Starts of paths that leave the line in a turn towards `next`, widest last; none where there is no line.
    pub fn turns(&self, joints: usize, next: &Row) -> Vec<Vec<Row>> {
        let Self::Line { begin, brake, .. } = self else { return Vec::new() };
        TURNS
            .iter()
            .filter_map(|times| {
                let mut corner = *begin;
                for v in 0..joints {
                    corner[v] += times * (brake[v] - begin[v]);
                }
                // As far beyond the corner as before it, or halfway to the next one: a parabola, which is what a
                // constant acceleration drives.
                let (before, beyond) = (distance(joints, begin, &corner), distance(joints, &corner, next));
                let share = (before / beyond).min(0.5);
                if !(beyond > 0.0 && before > 0.0) {
                    return None;
                }
                let point = |t: f64| {
                    let mut x = *begin;
                    for v in 0..joints {
                        let end = corner[v] + share * (next[v] - corner[v]);
                        let (a, b) = (1.0 - t, t);
                        x[v] = a * a * begin[v] + 2.0 * a * b * corner[v] + b * b * end;
                    }
                    x
                };
                Some((0..=PARTS).map(|k| point(k as f64 / PARTS as f64)).collect())
            })
            .collect()
    }
}

/// The ways in which a motion can get from its start to where planning begins, within the joint limits, best first. The
/// limits of `builder` are widened to the start, where rounding has it exceed them.
///
/// # Errors
/// No motion from there stays within the limits.
pub(crate) fn start_transitions(
    builder: &mut Builder,
    start: &Start,
    lower: &Row,
    upper: &Row,
) -> Result<Vec<StartTransition>, CannotStop> {
    let limits = *builder.limits();
    let joints = limits.joints();
    let still = |row: &Row| row[..joints].iter().all(|v| *v == 0.0);
    if still(&start.velocity) && still(&start.acceleration) {
        return Ok(vec![StartTransition::Resting(start.position)]);
    }
    stop::can_stop(&limits, lower, upper, &start.position, &start.velocity, &start.acceleration)?;
    builder.admit(&start.position, &start.velocity, &start.acceleration);
    let limits = *builder.limits();
    let mut out = Vec::new();
    let nodes = stop::settle(&limits, &start.position, &start.velocity, &start.acceleration);
    if let Some(settled) = nodes.last() {
        let begin = builder.ahead(&settled.position, &settled.velocity);
        let time = ROOM * builder.braking_time(&settled.velocity);
        let mut brake = begin;
        for v in 0..joints {
            brake[v] += 0.5 * time * settled.velocity[v];
        }
        let within = |x: &Row| {
            (0..joints).all(|v| x[v] >= lower[v].min(start.position[v]) && x[v] <= upper[v].max(start.position[v]))
        };
        // A line too short to be a path is left to the stop.
        let long = still(&settled.velocity) || distance(joints, &begin, &brake) > SHORTEST;
        let slow = limits.envelope.is_none_or(|envelope| {
            let kept = |pair: &[Node]| (0..joints).all(|v| envelope.is_kept_between(joints, v, &pair[0], &pair[1]));
            nodes.windows(2).all(kept)
        });
        if long && slow && within(&settled.position) && within(&brake) {
            let transition = if still(&settled.velocity) {
                StartTransition::Resting(settled.position)
            } else {
                StartTransition::Line { begin, velocity: settled.velocity, brake }
            };
            out.push(transition);
        }
    }
    out.push(StartTransition::Stop {
        nodes: stop::stop(&limits, &start.position, &start.velocity, &start.acceleration),
    });
    Ok(out)
}

/// Appends what comes before the first path.
pub(crate) fn append(builder: &mut Builder, transition: &StartTransition, start: &Start) {
    match transition {
        StartTransition::Stop { nodes } => builder.append_nodes(nodes),
        StartTransition::Resting(_) | StartTransition::Line { .. } => {
            let _ = builder.settle(&start.position, &start.velocity, &start.acceleration);
        }
    }
}

/// A path off the line of a start transition, in a turn.
pub(crate) struct Turned {
    pub waypoints: Vec<Row>,
    /// Number of waypoints that belong to the turn.
    pub turn: usize,
}

/// The first turn from `transition` towards `next` that stays between `lower` and `upper` (or no further out than where it
/// begins), that the limits allow and `free` admits, with the waypoints that `rest` says follow its end.
pub(crate) fn turn(
    builder: &Builder,
    transition: &StartTransition,
    [lower, upper]: [&Row; 2],
    next: &Row,
    rest: impl Fn(&Row) -> Vec<Row>,
    mut free: impl FnMut(&Spline) -> bool,
) -> Option<Turned> {
    let joints = builder.limits().joints();
    let velocity = transition.velocity();
    transition.turns(joints, next).into_iter().find_map(|mut waypoints| {
        let turn = waypoints.len();
        let (begin, end) = (waypoints.first().copied()?, waypoints.last().copied()?);
        let stays = |x: &Row| (0..joints).all(|v| lower[v].min(begin[v]) <= x[v] && x[v] <= upper[v].max(begin[v]));
        if !waypoints.iter().all(stays) {
            return None;
        }
        waypoints.extend(rest(&end));
        let path = Spline::through(joints, &waypoints, Some(&unit(joints, &velocity)));
        let within = path.keeps_within(0..path.intervals(), lower, upper);
        let driven = within && builder.clone().push(&path, &[], &velocity, None, &[]).is_ok();
        (driven && free(&path)).then_some(Turned { waypoints, turn })
    })
}

/// Direction of a row.
pub(crate) fn unit(joints: usize, row: &Row) -> Row {
    let norm = distance(joints, row, &[0.0; MAX_JOINTS]);
    row.map(|v| v / norm)
}

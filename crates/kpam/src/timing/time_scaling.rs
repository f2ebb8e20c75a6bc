//! Timing of a path within velocity and acceleration limits.

use super::grid::Grid;
use super::limits::Limits;
use super::motion::{Node, shares};
use super::reachability;
use super::spline::Spline;
use super::torque::Load;
use crate::Cancel;
use crate::model::{MAX_JOINTS, Row};

/// Number of rounds in which cells that exceed a limit are computed again with a smaller fraction of this limit.
const ROUNDS: usize = 6;
/// Fraction of the acceleration limit that the motion aims for, so that most cells need no second round.
const AIM: f64 = 0.998;
/// No further round is needed if slowing the whole motion by at most this factor suffices.
const NEGLIGIBLE: f64 = 1.003;
/// A path is impassable if its motion would have to be slowed by this factor, since a joint may not move there.
pub(crate) const IMPASSABLE: f64 = 1.5;
/// Factor by which a cell exceeds a velocity limit in a place where a joint may not move at all.
pub(crate) const HOPELESS: f64 = 1e4;
/// Fraction of a limit that rounding may use up in a cell; it is far below [`super::limits::TOLERANCE`].
pub(crate) const ROUNDING: f64 = 1e-9;
/// Minimum duration of a cell (s).
const SHORTEST: f64 = 1e-7;

/// Returns the fastest motion along a path to rest, starting with the component of `velocity` along the tangent.
/// `slowest` holds the minimum times (s) between waypoints. There is a node at each station of the grid. `None` if the
/// path cannot be followed from that velocity, or if the caller has cancelled.
pub(crate) fn drive(
    limits: &Limits,
    path: &Spline,
    slowest: &[f64],
    velocity: &Row,
    load: Load<'_>,
    cancel: Option<&Cancel>,
) -> Option<(Vec<Node>, Grid)> {
    let joints = limits.joints();
    let mut grid = Grid::new(joints, path, slowest).loaded(load)?;
    if grid.cells() == 0 || path.length() == 0.0 {
        return (velocity[..joints].iter().all(|v| *v == 0.0)).then(|| (vec![resting(&grid)], grid));
    }
    let speed = path.start_speed(velocity);
    let under_way = speed > 0.0;
    let mut nodes = Vec::new();
    let mut worst = [1.0_f64; 2];
    for cell in &mut grid.shares {
        cell[1] = AIM;
    }
    for _ in 0..ROUNDS {
        if cancel.is_some_and(Cancel::is_cancelled) {
            return None;
        }
        let squares = reachability::fastest(&grid, limits, speed * speed)?;
        nodes = in_time(&grid, &squares, velocity)?;
        worst = [1.0; 2];
        let mut kept = true;
        for cell in 0..grid.cells() {
            let [fast, hard] = shares(limits, &nodes[cell], &nodes[cell + 1]);
            worst = [worst[0].max(fast), worst[1].max(hard)];
            // Slowing the motion does not help if a joint may not move at all.
            if limits.envelope.is_some() && fast > HOPELESS {
                return None;
            }
            if fast > 1.0 + ROUNDING {
                grid.shares[cell][0] *= 0.9999 / fast;
                kept = false;
            }
            if hard > 1.0 + ROUNDING {
                grid.shares[cell][1] *= AIM / hard;
                kept = false;
            }
        }
        if kept {
            return Some((nodes, grid));
        }
        if !under_way && worst[0].max(worst[1].sqrt()) < NEGLIGIBLE {
            break;
        }
    }
    if under_way {
        // The velocity of a moving start cannot be reduced.
        return None;
    }
    let factor = worst[0].max(worst[1].sqrt());
    if limits.envelope.is_some() && factor > IMPASSABLE {
        return None;
    }
    stretch(&mut nodes, factor);
    Some((nodes, grid))
}

/// Slows a motion that starts and ends at rest by a factor.
pub(crate) fn stretch(nodes: &mut [Node], factor: f64) {
    for node in nodes {
        node.time *= factor;
        node.velocity.iter_mut().for_each(|v| *v /= factor);
        node.acceleration.iter_mut().flatten().for_each(|a| *a /= factor * factor);
    }
}

fn resting(grid: &Grid) -> Node {
    Node { time: 0.0, position: grid.stations[0].position, velocity: [0.0; MAX_JOINTS], acceleration: None }
}

/// Returns nodes in time for given x at the stations; `None` if the motion stops before the end.
fn in_time(grid: &Grid, squares: &[f64], begin: &Row) -> Option<Vec<Node>> {
    let mut out: Vec<Node> = Vec::with_capacity(squares.len());
    let mut time = 0.0;
    for (k, station) in grid.stations.iter().enumerate() {
        let speed = squares[k].max(0.0).sqrt();
        if k > 0 {
            let sum = speed + squares[k - 1].max(0.0).sqrt();
            if sum <= 0.0 {
                return None;
            }
            time += (2.0 * grid.step(k - 1) / sum).max(SHORTEST);
        }
        let mut velocity = [0.0; MAX_JOINTS];
        for v in 0..grid.joints {
            velocity[v] = station.first[v] * speed;
        }
        out.push(Node { time, position: station.position, velocity, acceleration: None });
    }
    out[0].velocity = *begin;
    if let Some(last) = out.last_mut() {
        last.velocity = [0.0; MAX_JOINTS];
    }
    Some(out)
}

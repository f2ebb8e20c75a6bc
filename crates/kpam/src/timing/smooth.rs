//! From a path to a motion in time that lies on it exactly and keeps limits on velocity, acceleration and jerk: S-curves
//! along straight paths, a third-order optimum along others. For jerk limits too low for averaging.

use super::limits::Limits;
use super::motion::{Node, peaks};
use super::profile::{Along, Pace, at_place};
use super::spline::Spline;
use super::third_order::{PathProblem, Station, fastest};
use super::time_scaling::{IMPASSABLE, ROUNDING};
use super::torque::{Buffers, Load};
use crate::Cancel;
use crate::model::{MAX_JOINTS, Row};

/// Cells of a path of few waypoints, beside those near its ends; at least so many between two waypoints.
const CELLS: f64 = 72.0;
const LEAST: f64 = 3.0;
/// Parts of the first ramp of acceleration that the first cell is, in length, and growth of those that follow.
const RAMP: f64 = 8.0;
const GROWTH: f64 = 1.6;
/// Angle (rad) by which the path may turn on a cell, and the most parts that one which turns by more is cut into.
const TURN: f64 = 0.35;
const PARTS: f64 = 6.0;
/// Share of the limits aimed at, since they are imposed at stations and kept between them.
const AIM: f64 = 0.998;
/// Rounds in which cells that exceed a limit get less of it, and how much longer the whole may take instead.
const ROUNDS: usize = 5;
const NEGLIGIBLE: f64 = 1.004;
/// A path whose curve lies this near to a line (rad or m) is straight.
const STRAIGHT: f64 = 1e-10;

/// The fastest motion found along a path from `velocity` along its tangent, without acceleration there, to rest: nodes
/// joined by quintics, and the node at each knot. `None` where the path cannot be followed from that velocity.
pub(crate) fn drive(
    limits: &Limits,
    path: &Spline,
    slowest: &[f64],
    velocity: &Row,
    load: Load<'_>,
    cancel: Option<&Cancel>,
) -> Option<(Vec<Node>, Vec<usize>)> {
    let n = limits.joints();
    let knots = &path.knots;
    if path.length() == 0.0 {
        let still = velocity[..n].iter().all(|v| *v == 0.0);
        let node = Node { time: 0.0, position: path.at(0, 0.0), velocity: *velocity, acceleration: None };
        return still.then(|| (vec![node], vec![0; knots.len()]));
    }
    let tangent = path.derivatives(0, 0.0)[1];
    let square: f64 = tangent[..n].iter().map(|t| t * t).sum();
    let begin = (velocity[..n].iter().zip(&tangent).map(|(v, t)| v * t).sum::<f64>() / square).max(0.0);
    let paces = paces(path, slowest);
    let straight = path.bend() * path.length() * path.length() < 8.0 * STRAIGHT;
    if straight && load.is_none() && !slowed(limits, path) && paces.windows(2).all(|pair| pair[0] == pair[1]) {
        return along_line(limits, path, paces[0], begin);
    }
    curved(limits, path, &paces, begin, load, cancel)
}

/// Whether the position of some joint bounds the speed along a straight path: most at its end.
fn slowed(limits: &Limits, path: &Spline) -> bool {
    let slope = path.derivatives(0, 0.0)[1];
    let end = path.at(path.intervals() - 1, 1.0);
    limits.envelope.is_some_and(|e| e.speed(&end, &slope) < along(limits, &slope).velocity)
}

/// Greatest ds/dt on each interval between knots, by the least time that intervals between waypoints may take.
fn paces(path: &Spline, slowest: &[f64]) -> Vec<f64> {
    let mut least = vec![0.0_f64; path.intervals()];
    for (w, time) in slowest.iter().enumerate().take(path.waypoints().saturating_sub(1)) {
        if path.knot_of(w + 1) > path.knot_of(w) {
            least[path.knot_of(w)] += time;
        }
    }
    let pace =
        |(i, time): (usize, &f64)| if *time > 0.0 { (path.knots[i + 1] - path.knots[i]) / time } else { f64::INFINITY };
    least.iter().enumerate().map(pace).collect()
}

/// Limits of s where all joints move at their rates of `slope` to it.
pub(crate) fn along(limits: &Limits, slope: &Row) -> Along {
    let least = |row: &Row| (0..limits.joints()).map(|v| row[v] / slope[v].abs()).fold(f64::INFINITY, f64::min);
    Along { velocity: least(&limits.velocity), acceleration: least(&limits.acceleration), jerk: least(&limits.jerk) }
}

/// A motion along a straight path: an S-curve.
fn along_line(limits: &Limits, path: &Spline, pace: f64, begin: f64) -> Option<(Vec<Node>, Vec<usize>)> {
    let slope = path.derivatives(0, 0.0)[1];
    let mut most = along(limits, &slope);
    most.velocity = most.velocity.min(pace);
    let profile = most.profile(path.length(), begin)?;
    let mut states: Vec<Pace> = profile.clone();
    let inner = path.knots.len() - 1;
    states.extend(path.knots[1..inner].iter().map(|s| at_place(&profile, *s)));
    states.sort_by(|a, b| a.time.total_cmp(&b.time));
    states.dedup_by(|b, a| b.time - a.time < 1e-9);
    if let Some(last) = states.last_mut() {
        (last.s, last.speed, last.gain) = (path.length(), 0.0, 0.0);
    }
    let nodes: Vec<Node> =
        states.iter().map(|pace| node(limits.joints(), path, interval_of(path, pace.s), pace)).collect();
    let node_of =
        |s: f64| (0..states.len()).min_by(|a, b| (states[*a].s - s).abs().total_cmp(&(states[*b].s - s).abs()));
    let knots = path.knots.iter().filter_map(|s| node_of(*s)).collect();
    Some((nodes, knots))
}

fn interval_of(path: &Spline, s: f64) -> usize {
    path.knots.partition_point(|k| *k <= s).saturating_sub(1).min(path.intervals() - 1)
}

/// The motion at a state on the path.
fn node(joints: usize, path: &Spline, interval: usize, pace: &Pace) -> Node {
    let [position, first, second] = path.derivatives(interval, pace.s);
    let [mut velocity, mut acceleration] = [[0.0; MAX_JOINTS]; 2];
    for v in 0..joints {
        velocity[v] = first[v] * pace.speed;
        acceleration[v] = first[v] * pace.gain + second[v] * pace.speed * pace.speed;
    }
    Node { time: pace.time, position, velocity, acceleration: Some(acceleration) }
}

/// Places of stations, ever closer towards both ends, and the station of each knot.
fn stations(limits: &Limits, path: &Spline, load: Load<'_>) -> (Vec<(usize, f64)>, Vec<usize>) {
    let whole = path.length();
    let near = |interval: usize, s: f64| {
        let [position, first, second] = path.derivatives(interval, s);
        let mut most = along(limits, &first);
        if let Some((dynamics, room)) = load {
            let torque = dynamics.along(&position, &first, &second, &mut Buffers::default());
            most.acceleration = most.acceleration.min(dynamics.hardest(&torque, room));
        }
        let ramp = most.acceleration.powi(3) / (6.0 * most.jerk * most.jerk);
        let inside = path.knots[interval + 1] - path.knots[interval];
        (ramp.min(whole / 12.0) / RAMP).min(0.5 * (whole / CELLS).min(inside / LEAST))
    };
    let last = path.intervals() - 1;
    let ends = [near(0, 0.0), near(last, whole)];
    let mut places = Vec::new();
    let mut of_knot = Vec::with_capacity(path.knots.len());
    for i in 0..=last {
        of_knot.push(places.len());
        let (from, to) = (path.knots[i], path.knots[i + 1]);
        let largest = (whole / CELLS).min((to - from) / LEAST);
        let mut at = from;
        loop {
            places.push((i, at));
            // As large as the distance from both ends admits.
            let grown = |from_end: f64, first: f64| first + (GROWTH - 1.0) * from_end;
            let left = (whole - at - ends[1]).max(0.0);
            let wish = largest.min(grown(at, ends[0])).min(ends[1].max(left * (1.0 - 1.0 / GROWTH)));
            if to - at <= 1.3 * wish.max(1e-12 * whole) {
                break;
            }
            // The last cell of the path is as long as wished.
            at = if i == last && left <= wish {
                whole - ends[1]
            } else {
                (at + wish).min(if i == last { whole - ends[1] } else { to - 0.3 * wish })
            };
        }
    }
    of_knot.push(places.len());
    places.push((last, whole));
    cut_where_it_turns(limits.joints(), path, places, of_knot)
}

/// The same stations, and others on cells where the path turns by a large angle: acceleration changes fast there.
fn cut_where_it_turns(
    joints: usize,
    path: &Spline,
    places: Vec<(usize, f64)>,
    of_knot: Vec<usize>,
) -> (Vec<(usize, f64)>, Vec<usize>) {
    let mut out = Vec::with_capacity(places.len());
    let mut moved_to = Vec::with_capacity(places.len());
    for pair in places.windows(2) {
        let ((interval, from), to) = (pair[0], pair[1].1);
        moved_to.push(out.len());
        let [a, b] = [from, to].map(|s| path.derivatives(interval, s)[1]);
        let dot = |a: &Row, b: &Row| (0..joints).map(|v| a[v] * b[v]).sum::<f64>();
        let cosine = dot(&a, &b) / (dot(&a, &a) * dot(&b, &b)).sqrt();
        // A tangent of no length turns by any angle.
        let angle = if cosine.is_nan() { std::f64::consts::PI } else { cosine.clamp(-1.0, 1.0).acos() };
        let parts = (angle / TURN).ceil().clamp(1.0, PARTS);
        out.extend((0..parts as usize).map(|k| (interval, from + (to - from) * k as f64 / parts)));
    }
    moved_to.push(out.len());
    out.extend(places.last());
    (out, of_knot.into_iter().map(|k| moved_to[k]).collect())
}

/// A motion along a path that bends.
fn curved(
    limits: &Limits,
    path: &Spline,
    paces: &[f64],
    begin: f64,
    load: Load<'_>,
    cancel: Option<&Cancel>,
) -> Option<(Vec<Node>, Vec<usize>)> {
    let n = limits.joints();
    let (places, of_knot) = stations(limits, path, load);
    let mut buffers = Buffers::default();
    let list: Vec<Station> = places
        .iter()
        .map(|(i, s)| {
            let [position, first, second] = path.derivatives(*i, *s);
            let torque = load.map(|(dynamics, _)| dynamics.along(&position, &first, &second, &mut buffers));
            Station { s: *s, first, second, third: path.third(*i), torque }
        })
        .collect();
    if load.is_some_and(|(dynamics, _)| list.iter().filter_map(|s| s.torque.as_ref()).any(|t| !dynamics.holds(t))) {
        return None;
    }
    let load = load.map(|(dynamics, room)| (&dynamics.max_torque, room));
    // A start that is faster than the pace brakes to it.
    let slowing = 0.5 * along(limits, &list[0].first).acceleration;
    let mut pace: Vec<f64> = places
        .iter()
        .map(|(i, s)| {
            let before = if *s == path.knots[*i] && *i > 0 { paces[i - 1] } else { f64::INFINITY };
            paces[*i].min(before).max((begin * begin - 2.0 * slowing * s).max(0.0).sqrt())
        })
        .collect();
    if let Some(envelope) = &limits.envelope {
        for (k, (i, s)) in places.iter().enumerate().take(places.len() - 1) {
            pace[k] = pace[k].min(AIM * envelope.speed(&path.derivatives(*i, *s)[0], &list[k].first));
        }
        pace[0] = pace[0].max(begin);
        // There is no way past a place where a joint may not move on.
        if pace.iter().any(|p| *p <= 0.0) {
            return None;
        }
    }
    let mut shares = vec![[1.0, AIM, AIM]; list.len() - 1];
    let mut nodes = Vec::new();
    let mut factor = 1.0;
    for _ in 0..ROUNDS {
        let found =
            fastest(&PathProblem { limits, stations: &list, pace: &pace, shares: &shares, begin, load, cancel })?;
        nodes = places.iter().zip(&found).map(|((i, _), pace)| node(n, path, *i, pace)).collect::<Vec<Node>>();
        factor = 1.0_f64;
        let mut kept = true;
        for cell in 0..shares.len() {
            let taken = peaks(limits, &nodes[cell], &nodes[cell + 1]);
            let [fast, hard, sharp] = taken;
            factor = factor.max(fast).max(hard.sqrt()).max(sharp.cbrt());
            for (share, peak) in shares[cell].iter_mut().zip(taken) {
                if peak > 1.0 + ROUNDING {
                    *share *= 0.999 / peak;
                    kept = false;
                }
            }
        }
        if kept {
            return Some((nodes, of_knot));
        }
        if begin == 0.0 && factor < NEGLIGIBLE {
            break;
        }
    }
    if begin > 0.0 || (limits.envelope.is_some() && factor > IMPASSABLE) {
        return None;
    }
    super::time_scaling::stretch(&mut nodes, factor);
    Some((nodes, of_knot))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(values: [f64; 3]) -> Row {
        let mut out = [0.0; MAX_JOINTS];
        out[..3].copy_from_slice(&values);
        out
    }

    #[test]
    fn a_path_that_hardly_bends_takes_little_longer_than_a_straight_one() {
        for (acceleration, jerk) in [(10.0, 300.0), (5.0, 50.0), (2.0, 10.0)] {
            let limits = Limits::new(&[2.0; 3], &[acceleration; 3], &[jerk; 3]).unwrap();
            let time = |bend: f64| {
                let waypoints = [row([0.0; 3]), row([0.5, 0.25 + bend, -0.1]), row([1.0, 0.5, -0.2])];
                let path = Spline::through(3, &waypoints, None);
                let (nodes, _) = drive(&limits, &path, &[], &[0.0; MAX_JOINTS], None, None).unwrap();
                nodes[nodes.len() - 1].time
            };
            let (straight, bent) = (time(0.0), time(1e-4));
            assert!((bent / straight - 1.0).abs() < 0.02, "{bent} {straight} at ({acceleration}, {jerk})");
        }
    }
}

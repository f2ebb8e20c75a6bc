//! Timing of motions that stay exactly on their path within velocity, acceleration and jerk limits: S-curves along
//! straight paths, a third-order optimum along others. Used if the jerk limits are too low for a moving average.

use super::limits::Limits;
use super::motion::{Node, peaks};
use super::profile::{Along, Pace, at_place};
use super::spline::Spline;
use super::third_order::{PathProblem, Station, fastest};
use super::time_scaling::{HOPELESS, IMPASSABLE, ROUNDING};
use super::torque::{Buffers, Load};
use crate::Cancel;
use crate::model::{MAX_JOINTS, Row};

/// Number of cells of a path with few waypoints (not counting additional cells near its ends), and minimum number of
/// cells between two waypoints.
const CELLS: f64 = 72.0;
const LEAST: f64 = 3.0;
/// The first cell has this fraction (1 / `RAMP`) of the length of the first acceleration ramp. Each further cell may be
/// longer than the previous one by the factor `GROWTH`.
const RAMP: f64 = 8.0;
const GROWTH: f64 = 1.6;
/// Maximum angle (rad) by which the path may turn in a cell, maximum number of parts of a cell that turns by more, and
/// maximum number of cells. The parts have equal length, so a part that contains a cusp may turn by more.
const TURN: f64 = 0.35;
const PARTS: f64 = 6.0;
const MOST_CELLS: f64 = 3000.0;
/// Fraction of the acceleration, jerk and position-dependent velocity limits that the motion aims for. The limits are
/// imposed at stations, and the remainder covers the motion between stations.
const AIM: f64 = 0.998;
/// Factors that reduce the usable velocity, acceleration and jerk limits in a cell that exceeded a limit.
const LESS: [f64; 3] = [0.9999, 0.999, 0.999];
/// Number of rounds in which the limits are reduced in cells that exceed them, and the factor by which the whole motion
/// may be slowed instead.
const ROUNDS: usize = 5;
const NEGLIGIBLE: f64 = 1.004;
/// A path counts as straight if its curve deviates from a straight line by at most this distance (rad or m).
const STRAIGHT: f64 = 1e-10;

/// Returns the fastest motion found along a path to rest. It starts with the component of `velocity` along the tangent
/// and with zero acceleration. The result holds nodes, the node at each knot, and whether the jerk is constant between
/// nodes (otherwise they are connected by quintics). `None` if the path cannot be followed from that velocity.
pub(crate) fn drive(
    limits: &Limits,
    path: &Spline,
    slowest: &[f64],
    velocity: &Row,
    load: Load<'_>,
    cancel: Option<&Cancel>,
) -> Option<(Vec<Node>, Vec<usize>, bool)> {
    let n = limits.joints();
    let knots = &path.knots;
    if path.length() == 0.0 {
        let still = velocity[..n].iter().all(|v| *v == 0.0);
        let node = Node { time: 0.0, position: path.at(0, 0.0), velocity: *velocity, acceleration: None };
        return still.then(|| (vec![node], vec![0; knots.len()], false));
    }
    let begin = path.start_speed(velocity);
    let paces = path.paces(slowest);
    let straight = path.bend() * path.length() * path.length() < 8.0 * STRAIGHT;
    let one_pace = paces.windows(2).all(|pair| pair[0] == pair[1]) && begin <= paces[0];
    if straight && load.is_none() && !slowed(limits, path) && one_pace {
        // Quintics distort the accelerations of short phases, so a moving start uses phases of constant jerk instead.
        return along_line(limits, path, paces[0], begin).map(|(nodes, knots)| (nodes, knots, begin > 0.0));
    }
    curved(limits, path, &paces, begin, load, cancel).map(|(nodes, knots)| (nodes, knots, false))
}

/// Returns whether a position-dependent velocity limit bounds the speed at the end of a straight path.
fn slowed(limits: &Limits, path: &Spline) -> bool {
    let slope = path.derivatives(0, 0.0)[1];
    let end = path.at(path.intervals() - 1, 1.0);
    limits.envelope.is_some_and(|e| e.speed(&end, &slope) < along(limits, &slope).velocity)
}

/// Returns the limits of the path parameter s if every joint moves in proportion to `slope`.
pub(crate) fn along(limits: &Limits, slope: &Row) -> Along {
    let least = |row: &Row| (0..limits.joints()).map(|v| row[v] / slope[v].abs()).fold(f64::INFINITY, f64::min);
    Along { velocity: least(&limits.velocity), acceleration: least(&limits.acceleration), jerk: least(&limits.jerk) }
}

/// Returns the S-curve motion along a straight path.
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

/// Returns the joints' state for a state `pace` on the path.
fn node(joints: usize, path: &Spline, interval: usize, pace: &Pace) -> Node {
    let [position, first, second] = path.derivatives(interval, pace.s);
    let [mut velocity, mut acceleration] = [[0.0; MAX_JOINTS]; 2];
    for v in 0..joints {
        velocity[v] = first[v] * pace.speed;
        acceleration[v] = first[v] * pace.gain + second[v] * pace.speed * pace.speed;
    }
    Node { time: pace.time, position, velocity, acceleration: Some(acceleration) }
}

/// Returns the positions of the stations, which are closer together near both ends, and the station of each knot.
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
            // The permitted length of a cell grows with its distance from both ends.
            let grown = |from_end: f64, first: f64| first + (GROWTH - 1.0) * from_end;
            let left = (whole - at - ends[1]).max(0.0);
            let wish = largest.min(grown(at, ends[0])).min(ends[1].max(left * (1.0 - 1.0 / GROWTH)));
            if to - at <= 1.3 * wish.max(1e-12 * whole) {
                break;
            }
            // The last cell takes up the remaining length.
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

/// Adds stations in cells in which the path turns by a large angle, because the acceleration changes fast there.
fn cut_where_it_turns(
    joints: usize,
    path: &Spline,
    places: Vec<(usize, f64)>,
    of_knot: Vec<usize>,
) -> (Vec<(usize, f64)>, Vec<usize>) {
    let dot = |a: &Row, b: &Row| (0..joints).map(|v| a[v] * b[v]).sum::<f64>();
    let angle = |a: &Row, b: &Row| {
        let cosine = dot(a, b) / (dot(a, a) * dot(b, b)).sqrt();
        // A zero tangent has no direction, and counts as a reversal of the path.
        if cosine.is_nan() { std::f64::consts::PI } else { cosine.clamp(-1.0, 1.0).acos() }
    };
    let most_parts = (MOST_CELLS / places.len() as f64).floor().clamp(1.0, PARTS);
    let mut out = Vec::with_capacity(places.len());
    let mut moved_to = Vec::with_capacity(places.len());
    for pair in places.windows(2) {
        let ((interval, from), to) = (pair[0], pair[1].1);
        moved_to.push(out.len());
        let [a, b, c] = [from, 0.5 * (from + to), to].map(|s| path.derivatives(interval, s)[1]);
        let parts = ((angle(&a, &b) + angle(&b, &c)) / TURN).ceil().clamp(1.0, most_parts);
        out.extend((0..parts as usize).map(|k| (interval, from + (to - from) * k as f64 / parts)));
    }
    moved_to.push(out.len());
    out.extend(places.last());
    (out, of_knot.into_iter().map(|k| moved_to[k]).collect())
}

/// Returns a motion along a curved path.
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
    // A start faster than the required pace brakes with half of the acceleration and jerk limits.
    let most = along(limits, &list[0].first);
    let half = Along { velocity: begin, acceleration: 0.5 * most.acceleration, jerk: 0.5 * most.jerk };
    let braking = if begin > 0.0 { half.profile(0.5 * begin * half.ramp_time(begin), begin) } else { None };
    let slowing = |s: f64| braking.as_ref().map_or(0.0, |profile| at_place(profile, s).speed);
    let mut pace: Vec<f64> = places
        .iter()
        .map(|(i, s)| {
            let before = if *s == path.knots[*i] && *i > 0 { paces[i - 1] } else { f64::INFINITY };
            paces[*i].min(before).max(slowing(*s))
        })
        .collect();
    let inside = |pair: &[(usize, f64)]| {
        let ((i, from), to) = (pair[0], pair[1].1);
        let s = 0.5 * (from + to);
        let [position, first, _] = path.derivatives(i, s);
        let allowed = limits.envelope.map_or(f64::INFINITY, |e| AIM * e.speed(&position, &first));
        paces[i].max(slowing(s)).min(allowed)
    };
    let pace_inside: Vec<f64> = places.windows(2).map(inside).collect();
    if let Some(envelope) = &limits.envelope {
        for (k, (i, s)) in places.iter().enumerate().take(places.len() - 1) {
            pace[k] = pace[k].min(AIM * envelope.speed(&path.derivatives(*i, *s)[0], &list[k].first));
        }
        pace[0] = pace[0].max(begin);
        // The path cannot be followed if a joint may not move at all somewhere on it.
        if pace.iter().chain(&pace_inside[1..pace_inside.len() - 1]).any(|p| *p <= 0.0) {
            return None;
        }
    }
    let mut shares = vec![[1.0, AIM, AIM]; list.len() - 1];
    let mut nodes = Vec::new();
    let mut factor = 1.0;
    for _ in 0..ROUNDS {
        let (stations, pace, pace_inside) = (&list, &pace, &pace_inside);
        let found =
            fastest(&PathProblem { limits, stations, pace, pace_inside, shares: &shares, begin, load, cancel })?;
        nodes = places.iter().zip(&found).map(|((i, _), pace)| node(n, path, *i, pace)).collect::<Vec<Node>>();
        factor = 1.0_f64;
        let mut kept = true;
        for cell in 0..shares.len() {
            let taken = peaks(limits, &nodes[cell], &nodes[cell + 1]);
            let [fast, hard, sharp] = taken;
            factor = factor.max(fast).max(hard.sqrt()).max(sharp.cbrt());
            // Slowing the motion does not help if a joint may not move at all.
            if limits.envelope.is_some() && fast > HOPELESS {
                return None;
            }
            for ((share, peak), less) in shares[cell].iter_mut().zip(taken).zip(LESS) {
                if peak > 1.0 + ROUNDING {
                    *share *= less / peak;
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
    use super::super::testing::row;
    use super::*;

    fn bent() -> Spline {
        Spline::through(2, &[row(&[0.0, 0.0, 0.0]), row(&[1.0, 0.6, 0.0]), row(&[1.5, 1.8, 0.0])], None)
    }

    /// Returns a velocity along the path's tangent at its start, at a fraction of the limits there, and its ds/dt.
    fn start(limits: &Limits, path: &Spline, share: f64) -> (Row, f64) {
        let tangent = path.derivatives(0, 0.0)[1];
        let speed = share * along(limits, &tangent).velocity;
        (tangent.map(|t| t * speed), speed)
    }

    #[test]
    fn a_start_at_the_limit_goes_on_along_a_path_that_bends() {
        for (acceleration, jerk) in [(5.0, 50.0), (10.0, 300.0), (2.0, 10.0)] {
            let limits = Limits::new(&[1.0; 2], &[acceleration; 2], &[jerk; 2]).unwrap();
            let path = bent();
            for share in [0.5, 0.95, 0.98, 0.995, 0.9999] {
                let (velocity, _) = start(&limits, &path, share);
                let found = drive(&limits, &path, &[], &velocity, None, None);
                assert!(found.is_some(), "at {share} of the limit, ({acceleration}, {jerk})");
            }
        }
    }

    #[test]
    fn a_start_that_is_too_fast_brakes_to_the_pace() {
        let limits = Limits::new(&[1.0; 2], &[5.0; 2], &[50.0; 2]).unwrap();
        let line = Spline::through(2, &[row(&[0.0; 3]), row(&[1.0, 0.5, 0.0]), row(&[2.0, 1.0, 0.0])], None);
        for path in [bent(), line] {
            let (velocity, speed) = start(&limits, &path, 0.8);
            let slow = 0.3 * speed;
            let least: Vec<f64> = path.knots.windows(2).map(|k| (k[1] - k[0]) / slow).collect();
            let (nodes, of_knot, _) = drive(&limits, &path, &least, &velocity, None, None).unwrap();
            // The motion slows down within half of the first interval, and then continues at the required pace.
            let times: Vec<f64> = of_knot.iter().map(|k| nodes[*k].time).collect();
            assert!(times[1] > 0.5 * least[0] && times[1] < least[0], "{times:?} {least:?}");
            assert!(times[2] - times[1] >= least[1] * (1.0 - 1e-6), "{times:?} {least:?}");
        }
    }

    #[test]
    fn least_times_are_kept_between_stations_too() {
        let limits = Limits::new(&[2.0; 2], &[5.0; 2], &[50.0; 2]).unwrap();
        let path = bent();
        let least = [2.0, 3.0];
        let (nodes, of_knot, _) = drive(&limits, &path, &least, &[0.0; MAX_JOINTS], None, None).unwrap();
        let times: Vec<f64> = of_knot.iter().map(|k| nodes[*k].time).collect();
        assert!(times[1] - times[0] >= 2.0 - 1e-6 && times[2] - times[1] >= 3.0 - 1e-6, "{times:?}");
        assert!(times[2] < 5.6, "{times:?}");
    }

    #[test]
    fn a_path_that_hardly_bends_takes_little_longer_than_a_straight_one() {
        for (acceleration, jerk) in [(10.0, 300.0), (5.0, 50.0), (2.0, 10.0)] {
            let limits = Limits::new(&[2.0; 3], &[acceleration; 3], &[jerk; 3]).unwrap();
            let time = |bend: f64| {
                let waypoints = [row(&[0.0; 3]), row(&[0.5, 0.25 + bend, -0.1]), row(&[1.0, 0.5, -0.2])];
                let path = Spline::through(3, &waypoints, None);
                let (nodes, ..) = drive(&limits, &path, &[], &[0.0; MAX_JOINTS], None, None).unwrap();
                nodes[nodes.len() - 1].time
            };
            let (straight, bent) = (time(0.0), time(1e-4));
            assert!((bent / straight - 1.0).abs() < 0.02, "{bent} {straight} at ({acceleration}, {jerk})");
        }
    }
}

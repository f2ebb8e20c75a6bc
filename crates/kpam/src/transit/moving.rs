//! Motions of an arm that is already moving: the fastest motion to each goal, the rest of the current motion, and paths
//! around obstacles.

use super::field::Field;
use super::rounding::Rounding;
use super::sweep::Sweep;
use super::tree::{self, Manner};
use super::{Close, Stuck, Transit, shorten};
use crate::Trajectory;
use crate::model::{MAX_JOINTS, Row};
use crate::timing::{Blend, Builder, Node, Spline, distance, gone_over, keeps, to_rest, to_state};
use crate::world::Required;

/// Two states count as equal if no value or rate of a joint differs by more than this (rad or m; per second).
const SAME: f64 = 1e-6;
/// Another motion replaces the current motion only if it ends at least this much earlier (s).
const SAVES: f64 = 1e-6;
/// Maximum number of positions on the first edge of a path at which a motion from a moving start may enter the path.
const PLACES: usize = 4;
/// Number of searches for paths around an obstacle, samples of each search, and number of paths that are timed. A
/// single search would find a different path at each replanning, and a motion that keeps changing its path never
/// arrives.
const WAYS: usize = 8;
const SAMPLES: usize = 500;
const DRIVEN: usize = 3;
/// Number of checked configurations after which no further search for a path begins.
const CHECKS: u64 = 6000;
/// Number of instants of a motion at which another motion is tried to join it.
const STATES: usize = 40;
/// Number of configurations checked on the joining part of a motion before the whole motion is proven.
const LOOKS: usize = 16;
/// Maximum number of candidates for a joining motion that the planner tries to prove collision-free.
const PROOFS: usize = 6;

/// State of the moving joints: position, velocity and acceleration.
pub(super) type State = [Row; 3];

impl Transit<'_> {
    /// Returns the fastest motion from the start state that ends at rest at `goal`, ignoring obstacles; `None` if this
    /// motion exceeds the joint limits.
    fn straight_to(&self, goal: &Row) -> Option<Trajectory> {
        let mut builder = self.builder();
        builder.append_nodes(&self.lead(goal)?);
        let motion = builder.clone().build(self.model.map());
        builder.bears(&motion).then_some(motion)
    }

    /// Returns the rest of the current motion, if it passes the start at the start time and keeps the limits.
    fn going_on(&self) -> Option<Trajectory> {
        let motion = self.options.warm_start.as_ref()?;
        let time = self.options.start_time;
        let stands = motion.goes_on_from(self.model.map(), time, &self.state, SAME);
        let gentle = stands && self.limits.admit(motion.limits());
        let rest = if gentle && time < motion.end() { motion.since(time).ok()? } else { return None };
        self.builder().bears(&rest).then_some(rest)
    }

    /// Returns the collision-free motion that ends first among those that need no search, and the index of its goal
    /// among `open`; `None` if all of them collide.
    pub(super) fn at_once(
        &self,
        field: &mut Field<'_>,
        open: &[(usize, Row, Close)],
        needs: impl Fn(&Close) -> Required,
    ) -> Option<(Trajectory, usize)> {
        let mut found: Vec<(f64, Trajectory, usize)> = Vec::new();
        if let Some(rest) = self.going_on() {
            let end = rest.moving(rest.end());
            let is_there = |goal: &Row| (0..self.model.n()).all(|v| (goal[v] - end[v]).abs() <= SAME);
            if let Some(k) = open.iter().position(|(_, goal, _)| is_there(goal)) {
                found.push((rest.end() - SAVES, rest, k));
            }
        }
        if self.is_moving {
            let direct = |(k, goal): (usize, &(usize, Row, Close))| self.straight_to(&goal.1).map(|m| (m.end(), m, k));
            found.extend(open.iter().enumerate().take_while(|_| !field.is_over()).filter_map(direct));
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (_, motion, k) in found {
            if field.is_over() {
                return None;
            }
            let needs = needs(&open[k].2);
            if self.proven(field, &mut self.sweep(&needs, field), &motion).is_ok() {
                return Some((motion, k));
            }
        }
        None
    }

    /// Returns the motion around the obstacles from a moving start that ends first, with its corners. Several paths are
    /// searched from the start position, and the fastest few are timed and proven.
    pub(super) fn around(
        &self,
        field: &mut Field<'_>,
        goals: &[Row],
        pace: &Row,
        needs: impl Fn(&Row) -> Option<Required>,
    ) -> Option<(Trajectory, Vec<Row>)> {
        let mut ways: Vec<(f64, Vec<Row>)> = Vec::new();
        let first = field.checks;
        for attempt in 0..WAYS {
            if field.is_over() || (!ways.is_empty() && field.checks - first > CHECKS) {
                break;
            }
            let manner = if attempt == 0 { Manner::Plain } else { Manner::Thorough };
            let seed = self.options.seed + attempt;
            let samples = self.options.samples.min(SAMPLES);
            let Ok(mut way) = tree::search(field, &self.state[0], goals, samples, seed, manner) else { continue };
            shorten::shorten(field, &mut way, pace, seed);
            if let Some(taut) = shorten::tauten(field, &way, pace) {
                way = taut;
            }
            if field.is_way_free(&way) {
                ways.push((self.effort(pace, &way), way));
            }
        }
        ways.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut soonest: Option<(Trajectory, Vec<Row>)> = None;
        for (_, way) in ways.into_iter().take(DRIVEN) {
            let needs = way.last().and_then(&needs)?;
            if let Ok(motion) = self.going_over(field, &way, &needs)
                && soonest.as_ref().is_none_or(|(other, _)| motion.end() < other.end())
            {
                soonest = Some((motion, way));
            }
        }
        soonest
    }

    /// Estimates the duration of a path, including the time to turn the start velocity into its direction.
    fn effort(&self, pace: &Row, way: &[Row]) -> f64 {
        let n = self.model.n();
        let first = distance(n, &way[0], &way[1]).max(f64::MIN_POSITIVE);
        let along = |v: usize| (way[1][v] - way[0][v]) / first;
        let speed = (0..n).map(|v| self.state[1][v] * along(v)).sum::<f64>().max(0.0);
        let turn = |v: usize| (self.state[1][v] - speed * along(v)).abs() / self.limits.acceleration[v];
        shorten::effort_along(n, pace, way) + (0..n).map(turn).fold(0.0, f64::max)
    }

    /// Returns a collision-free motion that joins the motion along `corners`, which starts at rest, while that motion
    /// is in progress. The candidate that ends first is preferred.
    fn going_over(&self, field: &mut Field<'_>, corners: &[Row], needs: &Required) -> Result<Trajectory, Stuck> {
        let n = self.model.n();
        let mut sweep = self.sweep(needs, field);
        let mut stuck = Stuck::Untimed;
        let mut rounding = Rounding::new(corners);
        while let Some((path, ..)) = rounding.next(field, n, self.model) {
            let mut builder = self.builder().off_path();
            if builder.push(&path, &[], &[0.0; MAX_JOINTS], None, &[]).is_err() {
                break;
            }
            let along = builder.clone().build(self.model.map());
            match self.gone_over_to(field, &mut sweep, &builder, &along) {
                Ok(motion) => return Ok(motion),
                Err(Stuck::Over) => return Err(Stuck::Over),
                Err(breach) => stuck = breach,
            }
            if corners.len() < 3 {
                break;
            }
            rounding.tighten();
        }
        Err(stuck)
    }

    /// Returns the collision-free motion that joins the motion `along` before its end and ends first.
    fn gone_over_to(
        &self,
        field: &mut Field<'_>,
        sweep: &mut Sweep<'_>,
        builder: &Builder,
        along: &Trajectory,
    ) -> Result<Trajectory, Stuck> {
        let (start, whole) = (along.start(), along.end() - along.start());
        let mut found: Vec<(f64, Vec<Node>, f64)> = Vec::new();
        for k in 1..STATES {
            if field.is_over() {
                return Err(Stuck::Over);
            }
            let time = start + whole * k as f64 / STATES as f64;
            let Some(lead) = to_state(&self.limits, &self.state, &along.moving_with_rates(time)) else { continue };
            found.push((lead[lead.len() - 1].time + along.end() - time, lead, time));
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (mut stuck, mut proofs) = (Stuck::Untimed, 0);
        for (_, lead, time) in found {
            if field.is_over() {
                return Err(Stuck::Over);
            }
            if !keeps(&self.limits, [&self.model.lower, &self.model.upper], &lead) {
                continue;
            }
            let motion = gone_over(&self.limits, &lead, along, time);
            let part = lead[lead.len() - 1].time / LOOKS as f64;
            let looks: Vec<Row> = (1..=LOOKS).map(|k| motion.moving(start + part * k as f64)).collect();
            if field.blocked_at(&looks).is_some() || !builder.bears(&motion) {
                continue;
            }
            match self.proven(field, sweep, &motion) {
                Ok(()) => return Ok(motion),
                Err(breach) => stuck = breach,
            }
            proofs += 1;
            if proofs == PROOFS {
                break;
            }
        }
        Err(stuck)
    }

    /// Returns the motion from a moving start along corners: first to a position on the first edge, then along a
    /// rounded curve, which begins while the first motion still brakes. If no such motion is collision-free, the
    /// returned motion stops at every corner.
    pub(super) fn blended(
        &self,
        field: &mut Field<'_>,
        corners: &[Row],
        needs: &Required,
    ) -> Result<Trajectory, Stuck> {
        let n = self.model.n();
        let mut sweep = self.sweep(needs, field);
        let mut stuck = Stuck::Untimed;
        let mut rounding = Rounding::new(corners);
        while let Some((_, waypoints, first)) = rounding.next(field, n, self.model) {
            let places = first.min(waypoints.len() - 2);
            let mut found: Vec<Trajectory> = Vec::new();
            for part in 0..=places.min(PLACES) {
                let place = part * places / places.clamp(1, PLACES);
                found.extend(self.past(&waypoints[place..], place == 0));
            }
            found.sort_by(|a, b| a.end().total_cmp(&b.end()));
            for motion in found {
                match self.proven(field, &mut sweep, &motion) {
                    Ok(()) => return Ok(motion),
                    Err(breach) => stuck = breach,
                }
                if field.is_over() {
                    return Err(Stuck::Over);
                }
            }
            if corners.len() < 3 {
                break;
            }
            rounding.tighten();
        }
        if rounding.is_blocked(field) {
            return Err(Stuck::Blocked);
        }
        let Some(lead) = self.lead(&corners[0]) else { return Err(stuck) };
        let mut builder = self.builder();
        let rest = [0.0; MAX_JOINTS];
        if corners.windows(2).any(|e| builder.push(&Spline::through(n, e, None), &[], &rest, None, &[]).is_err()) {
            return Err(stuck);
        }
        let along = builder.clone().build(self.model.map());
        let motion = self.blend(&lead).one_after_the_other(&along).0;
        if !builder.bears(&motion) {
            return Err(Stuck::Untimed);
        }
        self.proven(field, &mut sweep, &motion).map(|()| motion)
    }

    /// Returns the nodes of the fastest motion from the start state that ends at rest at `place`, if it stays within
    /// the joint limits.
    fn lead(&self, place: &Row) -> Option<Vec<Node>> {
        let [position, velocity, acceleration] = &self.state;
        let nodes = to_rest(&self.limits, position, velocity, acceleration, place);
        keeps(&self.limits, [&self.model.lower, &self.model.upper], &nodes).then_some(nodes)
    }

    fn blend<'b>(&'b self, lead: &'b [Node]) -> Blend<'b> {
        Blend { lead, limits: &self.limits, room: [&self.model.lower, &self.model.upper], earliest: 0.0 }
    }

    /// Returns the motion to the first waypoint that joins the curve through the others as early as the limits allow.
    fn past(&self, waypoints: &[Row], is_checked: bool) -> Option<Trajectory> {
        let n = self.model.n();
        let lead = self.lead(&waypoints[0])?;
        let path = Spline::through(n, waypoints, None);
        if !is_checked && !path.keeps_within(0..path.intervals(), &self.model.lower, &self.model.upper) {
            return None;
        }
        let mut builder = self.builder();
        builder.push(&path, &[], &[0.0; MAX_JOINTS], None, &[]).ok()?;
        let along = builder.clone().build(self.model.map());
        let motion = self.blend(&lead).of(&along).0;
        builder.bears(&motion).then_some(motion)
    }
}

//! Motions from a start under way: the fastest one to each goal, the rest of the motion under way, and ways round what
//! is between.

use gensim2_geometry::Needs;

use super::field::Field;
use super::rounding::Rounding;
use super::{Close, Stuck, Transit};
use crate::Trajectory;
use crate::model::{MAX_JOINTS, Row};
use crate::timing::{Blend, Node, Spline, keeps, to_rest};

/// Difference of two states (rad or m, and their rates) that are the same.
const SAME: f64 = 1e-6;
/// The motion under way goes on unless another one saves this much time (s).
const SAVES: f64 = 1e-6;
/// Places of the first edge of a way that a motion goes to at the most.
const PLACES: usize = 4;

/// State of the moving joints: position, velocity and acceleration.
pub(super) type State = [Row; 3];

impl Transit<'_> {
    /// The fastest motion from the start to rest at a configuration, whatever is in the way; `None` where it would leave the
    /// joint limits.
    fn straight_to(&self, goal: &Row) -> Option<Trajectory> {
        let [position, velocity, acceleration] = &self.state;
        let nodes = to_rest(&self.limits, position, velocity, acceleration, goal);
        if !keeps(&self.limits, [&self.model.lower, &self.model.upper], &nodes) {
            return None;
        }
        let mut builder = self.builder();
        builder.append_nodes(&nodes);
        let motion = builder.clone().build(self.model.map());
        builder.bears(&motion).then_some(motion)
    }

    /// The rest of the motion under way, where it passes the start at the start time and keeps to the limits.
    fn going_on(&self) -> Option<Trajectory> {
        let motion = self.options.warm_start.as_ref()?;
        let time = self.options.start_time;
        let stands = motion.goes_on_from(self.model.map(), time, &self.state, SAME);
        let gentle = stands && self.limits.admit(motion.limits());
        let rest = if gentle && time < motion.end() { motion.since(time).ok()? } else { return None };
        self.builder().bears(&rest).then_some(rest)
    }

    /// The soonest of the motions that lead to a goal without a search and are free, with the number of that goal among
    /// `open`; `None` where there is none.
    pub(super) fn at_once(
        &self,
        field: &mut Field<'_>,
        open: &[(usize, Row, Close)],
        needs: impl Fn(&Close) -> Needs,
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

    /// The motion from a start under way along corners: to a place of the first edge, and from there on along a rounded curve,
    /// which begins while the first motion still brakes. Where none is free, it stops at every corner.
    pub(super) fn blended(&self, field: &mut Field<'_>, corners: &[Row], needs: &Needs) -> Result<Trajectory, Stuck> {
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

    /// Nodes of the fastest motion from the start to rest at a place, where it stays within the joint limits.
    fn lead(&self, place: &Row) -> Option<Vec<Node>> {
        let [position, velocity, acceleration] = &self.state;
        let nodes = to_rest(&self.limits, position, velocity, acceleration, place);
        keeps(&self.limits, [&self.model.lower, &self.model.upper], &nodes).then_some(nodes)
    }

    fn blend<'b>(&'b self, lead: &'b [Node]) -> Blend<'b> {
        Blend { lead, limits: &self.limits, room: [&self.model.lower, &self.model.upper], earliest: 0.0 }
    }

    /// The motion to the first of some waypoints and on along the curve through them, as soon as the limits allow.
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

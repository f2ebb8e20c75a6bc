//! The free motion from the start to the first keyframe.

use super::planner::{PAD, Planner};
use crate::free_space::{self, NoWay, Sampling};
use crate::model::{Model, Row};
use crate::timing::{Spline, rounded, turn};
use crate::world::{Hit, Leg, Margins, State, TOUCH, Way, World};

/// Free motions are searched for with this much more than the margin (m): a smooth curve may take it from its corners.
const CURVED: f64 = 1e-3;
/// Spacings of waypoints (rad or m) on the free approach, and that near its ends.
const SPACINGS: [f64; 3] = [WIDE, 0.2, 0.08];
pub(super) const WIDE: f64 = 0.5;
pub(super) const NEAR: f64 = 0.04;

/// A free motion to the first keyframe.
pub(super) struct Approach {
    /// Pieces end at rest, and begin there but for the first of a start under way.
    pub pieces: Vec<Vec<Row>>,
    /// The same motion with a stop wherever it turns.
    pub corners: Vec<Vec<Row>>,
    /// Margins that it keeps.
    pub kept: Margins,
    /// Hits, where hits do not count.
    pub hit: Option<Hit>,
}

impl Planner<'_> {
    /// Free motion from the start to the first keyframe.
    pub(super) fn approach(&mut self, goal: &Row, samples: usize) -> Result<Approach, NoWay> {
        let n = self.model.n();
        let leg = self.world.course.toward(self.entry);
        let braking = self.choose_lead(leg);
        if let (Some(hit), true) = (&braking, self.problem.options.avoid_collisions) {
            return Err(NoWay::Blocked(hit.clone()));
        }
        let lead = self.leads[self.lead].clone();
        let start = lead.rest();
        let straight = |corners: &[Row]| rounded(n, corners, WIDE, NEAR);
        if !self.problem.options.avoid_collisions {
            let hit = braking.or_else(|| self.world.sweep(&start, goal, leg, &Margins::plain(0.0)));
            let room = [&self.model.lower, &self.model.upper];
            let pieces =
                match turn(&self.builder, &lead, room, goal, |end| straight(&[*end, *goal])[1..].to_vec(), |_| true) {
                    Some(turned) => vec![turned.waypoints],
                    None => lead.line().into_iter().chain([straight(&[start, *goal])]).collect(),
                };
            return Ok(Approach { pieces, corners: Vec::new(), kept: Margins::plain(0.0), hit });
        }
        // What overlaps at the start comes apart first, and then stays apart.
        let out = self.way_out(&start, leg);
        let (begin, mut pieces) = out.map_or((start, Vec::new()), |exit| (exit, vec![vec![start, exit]]));
        pieces.splice(0..0, lead.line());
        let wide = self.margins(&begin, goal, leg, self.margin + CURVED, out.is_some());
        let curved = wide.with_clearance(self.margin + PAD);
        // On the way out of what it overlaps at the start the motion is still inside.
        let kept = Margins { forgiving: true, ..wide.with_clearance(self.margin) };
        if let Some(way) = self.former_way(&begin, goal, leg, &curved) {
            let along = |_: &Row, _: f64| way.clone();
            let corners: Vec<_> = pieces.iter().cloned().chain(way.windows(2).map(<[_]>::to_vec)).collect();
            if let Some(turned) = self.turned(&way, leg, &curved, along).filter(|_| out.is_none()) {
                return Ok(Approach { pieces: vec![turned], corners, kept, hit: None });
            }
            if curve_is_free(&mut self.world, self.model, &Spline::through(n, &way, None), leg, &curved) {
                pieces.push(way);
                return Ok(Approach { pieces, corners, kept, hit: None });
            }
        }
        let corners = match self.connect(&begin, goal, leg, &wide, samples) {
            // Straight from stop to stop no more than the margin is needed.
            Err(_) => self.connect(&begin, goal, leg, &curved, samples)?,
            Ok(corners) => corners,
        };
        let stops: Vec<_> = pieces.iter().cloned().chain(corners.windows(2).map(straight)).collect();
        let from = |end: &Row, spacing: f64| {
            let mut corners = corners.clone();
            corners[0] = *end;
            rounded(n, &corners, spacing, NEAR)
        };
        if let Some(turned) = self.turned(&corners, leg, &curved, from).filter(|_| out.is_none()) {
            return Ok(Approach { pieces: vec![turned], corners: stops, kept, hit: None });
        }
        if corners.len() == 2 {
            return Ok(Approach { pieces: stops, corners: Vec::new(), kept, hit: None });
        }
        match self.rounded(&corners, leg, &curved) {
            Some(curve) => pieces.push(curve),
            None => pieces.extend(corners.windows(2).map(straight)),
        }
        Ok(Approach { pieces, corners: stops, kept, hit: None })
    }

    /// One smooth curve near the corners, with knots ever closer to them, where one stays free.
    fn rounded(&mut self, corners: &[Row], leg: Leg, margins: &Margins) -> Option<Vec<Row>> {
        let n = self.model.n();
        SPACINGS
            .into_iter()
            .map(|spacing| rounded(n, corners, spacing, NEAR))
            .find(|curve| curve_is_free(&mut self.world, self.model, &Spline::through(n, curve, None), leg, margins))
    }

    /// The way along waypoints from a start under way, which leaves its line in a turn without coming to rest, where
    /// such a one is free. `from` gives the waypoints from the end of the turn on, that end first, for a spacing.
    fn turned(
        &mut self,
        way: &[Row],
        leg: Leg,
        margins: &Margins,
        from: impl Fn(&Row, f64) -> Vec<Row>,
    ) -> Option<Vec<Row>> {
        let lead = &self.leads[self.lead];
        let (builder, model, world) = (&self.builder, self.model, &mut self.world);
        SPACINGS.into_iter().find_map(|spacing| {
            let free = |path: &Spline| curve_is_free(world, model, path, leg, margins);
            turn(builder, lead, [&model.lower, &model.upper], way.get(1)?, |end| from(end, spacing)[1..].to_vec(), free)
                .map(|turned| turned.waypoints)
        })
    }

    /// Margins of the free motion between two poses; `parted` where what overlapped at the start has come apart.
    fn margins(&mut self, from: &Row, to: &Row, leg: Leg, clearance: f64, parted: bool) -> Margins {
        let margins = self.world.margins_between([State::still(from), State::still(to)], leg, clearance);
        if parted { margins.parted() } else { margins }
    }

    /// Chooses the first way from the start to rest that is free, where none was chosen yet; what is in the way where
    /// none is.
    fn choose_lead(&mut self, leg: Leg) -> Option<Hit> {
        if self.lead_judged.is_none() {
            let mut first = None;
            let clearance = if self.problem.options.avoid_collisions { self.margin } else { 0.0 };
            let start = self.start.position;
            let margins = self.margins(&start, &start, leg, clearance, false);
            for (k, lead) in self.leads.iter().enumerate() {
                let way = lead.way(&self.start);
                match self.world.sweep_along(Way::still(&way), leg, &margins) {
                    None => {
                        (self.lead, first) = (k, None);
                        break;
                    }
                    Some((_, hit)) => first = first.or(Some(hit)),
                }
            }
            self.lead_judged = Some(first);
        }
        self.lead_judged.clone().flatten()
    }

    /// Corners of a free motion that keeps to margins.
    fn connect(
        &mut self,
        from: &Row,
        to: &Row,
        leg: Leg,
        margins: &Margins,
        samples: usize,
    ) -> Result<Vec<Row>, NoWay> {
        let sampling = Sampling { most: samples, seed: self.problem.options.seed };
        free_space::connect(&mut self.world, self.model, from, to, leg, margins, sampling)
    }

    /// A free pose near the start, where that overlaps something and can get out of it.
    fn way_out(&mut self, start: &Row, leg: Leg) -> Option<Row> {
        if self.world.start_overlap <= TOUCH {
            return None;
        }
        if self.exit.is_none() {
            self.exit = Some(free_space::way_out(&mut self.world, self.model, start, leg, self.problem.options.seed));
        }
        self.exit.flatten()
    }
}

/// Whether a curve stays within the joint limits, or where its waypoints are, and off everything.
fn curve_is_free(world: &mut World<'_>, model: &Model, path: &Spline, leg: Leg, margins: &Margins) -> bool {
    let all = 0..path.intervals();
    path.keeps_within(all.clone(), &model.lower, &model.upper)
        && world.sweep_along(Way::still(&path.along(all, 0.05)), leg, margins).is_none()
}

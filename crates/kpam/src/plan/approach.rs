//! The collision-free motion from the start to the first keyframe.

use super::connect::{NoWay, way_out};
use super::emitted::{OFF, Samples};
use super::planner::{PAD, Planner};
use crate::model::{Model, Row};
use crate::timing::{Spline, rounded};
use crate::transit::{Field, Rounding};
use crate::world::{Hit, Margins, MotionSegment, State, TOUCH, Way, World};

/// Additional clearance (m) in the search for free motions, because rounding the corners may reduce it.
const CURVED: f64 = 1e-3;
/// Distances (rad or m) between waypoints of a straight free motion, and near the ends of a free motion.
const WIDE: f64 = 0.5;
const NEAR: f64 = 0.04;
/// Number of positions at which a straight free motion is checked before it is timed.
const LOOKS: usize = 8;

/// A free motion to the first keyframe.
pub(super) struct Approach {
    /// Waypoints of each segment. Segments end at rest, and begin at rest unless the robot moves at the start.
    pub pieces: Vec<Vec<Row>>,
    /// Waypoints of an alternative motion that stops at every corner.
    pub corners: Vec<Vec<Row>>,
    /// Minimum distances between bodies that the motion keeps.
    pub kept: Margins,
    /// A collision of the motion, if the options permit collisions.
    pub hit: Option<Hit>,
    /// Whether the motion was only checked at samples.
    pub is_sampled: bool,
}

impl Planner<'_> {
    /// Searches a collision-free motion from the start to the first keyframe. Unless `proves` is set, the motion is only
    /// checked at samples.
    pub(super) fn approach(&mut self, goal: &Row, samples: usize, proves: bool) -> Result<Approach, NoWay> {
        let n = self.model.n();
        let segment = self.world.schedule.toward(self.entry);
        let braking = self.stop_hit(segment);
        let start = self.rest();
        let straight = |corners: &[Row]| rounded(n, corners, WIDE, NEAR);
        if let Some(hit) = self.blocked_stop() {
            if self.stop.is_empty() || self.warm_start.is_none() || self.world.start_overlap > TOUCH {
                return Err(NoWay::Blocked(hit.clone()));
            }
            // If braking is blocked, only the motion under execution may be free; it is swept when it is resumed.
            let kept = self.margins(&start, goal, segment, self.margin, false);
            let pieces = vec![straight(&[start, *goal])];
            return Ok(Approach { pieces, corners: Vec::new(), kept, hit: None, is_sampled: false });
        }
        if !self.problem.options.avoid_collisions {
            let hit = braking.or_else(|| self.world.sweep(&start, goal, segment, &Margins::plain(0.0)));
            let pieces = vec![straight(&[start, *goal])];
            return Ok(Approach { pieces, corners: Vec::new(), kept: Margins::plain(0.0), hit, is_sampled: false });
        }
        // Bodies that overlap at the start are separated first, and then stay separated.
        let out = self.way_out(&start, segment);
        let (begin, mut pieces) = out.map_or((start, Vec::new()), |exit| (exit, vec![vec![start, exit]]));
        let mut wide = self.margins(&start, goal, segment, self.margin + CURVED, out.is_some());
        if out.is_some() {
            // A pair of bodies that has been separated keeps the distance at the separated pose; every other pair keeps
            // its distance at the start.
            let there = self.margins(&begin, &begin, segment, self.margin + CURVED, true);
            self.world.keep_apart(&mut wide, there);
        }
        let curved = wide.with_clearance(self.margin + PAD);
        // An overlap at the start is permitted until the motion has left it.
        let kept = Margins { forgiving: true, ..wide.with_clearance(self.margin) };
        if let Some(way) = self.warm_start_way(&begin, goal, segment, &curved) {
            let corners: Vec<_> = pieces.iter().cloned().chain(way.windows(2).map(<[_]>::to_vec)).collect();
            if curve_is_free(&mut self.world, self.model, &Spline::through(n, &way, None), segment, &curved) {
                pieces.push(way);
                return Ok(Approach { pieces, corners, kept, hit: None, is_sampled: false });
            }
        }
        let paths = match self.connect(&begin, goal, segment, &wide, samples, proves) {
            // A motion with stops at its corners needs no extra clearance.
            Err(_) => self.connect(&begin, goal, segment, &curved, samples, proves)?,
            Ok(paths) => paths,
        };
        let corners = &paths[0];
        let stops: Vec<_> = pieces.iter().cloned().chain(corners.windows(2).map(straight)).collect();
        if corners.len() == 2 {
            return Ok(Approach { pieces: stops, corners: Vec::new(), kept, hit: None, is_sampled: false });
        }
        match paths.iter().find_map(|path| self.rounded(path, segment, &curved, proves)) {
            Some(curve) => pieces.push(curve),
            None => pieces.extend(corners.windows(2).map(straight)),
        }
        Ok(Approach { pieces, corners: stops, kept, hit: None, is_sampled: !proves })
    }

    /// Returns the straight motion to the first keyframe without a proof that it is collision-free; `None` if one of a
    /// few positions is blocked.
    pub(super) fn straight_approach(&mut self, goal: &Row) -> Option<Approach> {
        let (segment, ends) = (self.world.schedule.toward(self.entry), [self.rest(), *goal]);
        let wide = self.margins(&ends[0], goal, segment, self.margin + CURVED, false);
        if self.world.is_hit_at(Way::still(&ends), segment, &wide, LOOKS) {
            return None;
        }
        let kept = Margins { forgiving: true, ..wide.with_clearance(self.margin) };
        Some(Approach {
            pieces: vec![rounded(self.model.n(), &ends, WIDE, NEAR)],
            corners: Vec::new(),
            kept,
            hit: None,
            is_sampled: false,
        })
    }

    /// Returns waypoints of a collision-free smooth curve near the corners, as wide as obstacles permit at each corner.
    /// Unless `proves` is set, the curve is only checked at samples.
    fn rounded(
        &mut self,
        corners: &[Row],
        segment: MotionSegment,
        margins: &Margins,
        proves: bool,
    ) -> Option<Vec<Row>> {
        let n = self.model.n();
        let needs = self.world.required(self.scene.compiled(), segment, margins);
        let mut field = Field::new(&self.scene, self.model, needs, self.world.ending());
        let mut rounding = Rounding::new(corners);
        let mut found = None;
        while let Some((_, waypoints, _)) = rounding.next(&mut field, n, self.model) {
            // The waypoints are closer to each other at both ends.
            let curve = rounded(n, &waypoints, f64::INFINITY, NEAR);
            let path = Spline::through(n, &curve, None);
            let is_free = match proves {
                true => curve_is_free(&mut self.world, self.model, &path, segment, margins),
                false => path.keeps_within(0..path.intervals(), &self.model.lower, &self.model.upper),
            };
            if is_free {
                found = Some(curve);
                break;
            }
            if self.world.is_over() {
                break;
            }
            rounding.tighten();
        }
        self.world.spend(field.checks);
        found
    }

    /// Returns the minimum distances between bodies for the free motion between two poses. `parted` tells whether
    /// bodies that overlapped at the start have been separated.
    fn margins(&mut self, from: &Row, to: &Row, segment: MotionSegment, clearance: f64, parted: bool) -> Margins {
        let margins = self.world.margins_between([State::still(from), State::still(to)], segment, clearance);
        if parted { margins.parted() } else { margins }
    }

    /// Returns the obstacle that blocks braking to rest from the start, if one is known and collisions are avoided.
    /// With such an obstacle, only the motion that the robot executes now can be collision-free.
    pub(super) fn blocked_stop(&self) -> Option<&Hit> {
        self.stop_checked.as_ref().and_then(Option::as_ref).filter(|_| self.problem.options.avoid_collisions)
    }

    /// Finds the obstacle that blocks braking to rest from the start. The result of an earlier call is reused.
    fn stop_hit(&mut self, segment: MotionSegment) -> Option<Hit> {
        if self.stop_checked.is_none() {
            let clearance = if self.problem.options.avoid_collisions { self.margin } else { 0.0 };
            let start = self.start[0];
            let margins = self.margins(&start, &start, segment, clearance, false);
            let way = self.stop_way();
            let way = Way { waypoints: &way.waypoints, travel: &[], off: &way.off };
            let hit = self.world.sweep_along(way, segment, &margins);
            self.stop_checked = Some(hit.map(|(_, hit)| hit));
        }
        self.stop_checked.clone().flatten()
    }

    /// Returns samples of the motion that brakes to rest from the start, or only the start if the robot is at rest.
    pub(super) fn stop_way(&self) -> Samples {
        let mut builder = self.builder.clone();
        builder.append_nodes(&self.stop);
        let stop = builder.build(self.model.map());
        Samples::of(&stop, self.model.n(), [stop.start(), stop.end()], OFF, &self.over)
    }

    /// Returns a nearby collision-free pose for a start at which the robot overlaps a body; `None` if no pose is found.
    fn way_out(&mut self, start: &Row, segment: MotionSegment) -> Option<Row> {
        if self.world.start_overlap <= TOUCH {
            return None;
        }
        if self.exit.is_none() {
            let kept = self.margins(start, start, segment, self.margin, false);
            let seed = self.problem.options.seed;
            self.exit = Some(way_out(&mut self.world, self.model, start, segment, &kept, seed));
        }
        self.exit.flatten()
    }
}

/// Returns whether a curve stays within the joint limits (or its waypoints' range) and collision-free.
fn curve_is_free(
    world: &mut World<'_>,
    model: &Model,
    path: &Spline,
    segment: MotionSegment,
    margins: &Margins,
) -> bool {
    let all = 0..path.intervals();
    path.keeps_within(all.clone(), &model.lower, &model.upper)
        && world.sweep_along(Way::still(&path.along(all, 0.05)), segment, margins).is_none()
}

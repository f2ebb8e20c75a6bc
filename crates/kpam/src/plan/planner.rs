//! State of the planning of one problem, and construction of the resulting plan.

use std::time::Instant;

use super::failure::{inside, meeting, millimetres};
use super::trials::Trials;
use super::{Collision, Lack, Plan, Request, refused};
use crate::actuation::Candidate;
use crate::cancel::end_of;
use crate::default_limits::{assumed_limits, links_may_touch, warnings};
use crate::hand_path::Follower;
use crate::model::{MAX_JOINTS, Model, Row};
use crate::options::Timing;
use crate::resolve::Resolved;
use crate::timing::{Builder, CannotStop, Dynamics, Limits, Node, can_stop, stop};
use crate::world::{Hit, State, World};
use crate::{Cancel, KeypointProblem, Scene};

pub(super) struct Planner<'p> {
    pub problem: &'p KeypointProblem,
    pub model: &'p Model,
    pub resolved: &'p Resolved,
    pub follower: Follower<'p>,
    /// Flag that ends planning, also when its time is up.
    pub over: Cancel,
    pub world: World<'p>,
    /// The scene of the problem, prepared for fast checks on first use.
    pub scene: Scene,
    /// Joint positions, velocities and accelerations at the start.
    pub start: [Row; 3],
    /// Nodes of the motion that brakes to rest from a moving start; planning begins where it ends. Empty at rest.
    pub stop: Vec<Node>,
    /// Clearance (m) that the motion keeps from bodies that it may not touch.
    pub margin: f64,
    /// Obstacle that blocks braking to rest; the outer `None` means that it was not checked yet.
    pub stop_checked: Option<Option<Hit>>,
    /// Builder that every trajectory of this problem starts from.
    pub builder: Builder,
    pub clock: Option<Vec<f64>>,
    /// Pose at which the robot has left its overlaps at the start; the outer `None` means not searched yet.
    pub exit: Option<Option<Row>>,
    /// Number of searches since a sample was last connected to the start.
    pub boxed_in: usize,
    /// Index of the first keyframe to reach; the robot has passed the earlier ones.
    pub entry: usize,
    pub warm_start: Option<&'p Plan>,
    pub explain: bool,
    /// Whether a motion that ends between the actuation pose and the last keyframe is acceptable.
    pub partial: bool,
    /// Actuation pose at which bodies were picked or released in the present state of the world.
    pub acting: Option<Row>,
}

/// Additional clearance (m) when paths are swept, because the timed motion deviates from its path.
pub(super) const PAD: f64 = 2e-4;

impl<'p> Planner<'p> {
    /// # Errors
    /// No motion from the start stays within the joint limits.
    pub(super) fn new(
        problem: &'p KeypointProblem,
        model: &'p Model,
        resolved: &'p Resolved,
        request: &Request<'p>,
        begun: Instant,
        entry: usize,
        over: Cancel,
    ) -> Result<Self, CannotStop> {
        let rates = |list: &Option<Vec<f64>>| list.as_ref().map_or([0.0; MAX_JOINTS], |v| model.pick(v));
        let options = &problem.options;
        let start = [model.start(), rates(&options.start_velocity), rates(&options.start_acceleration)];
        let mut builder = Builder::new(Limits::of(problem, model), options.start_time)
            .loaded(Dynamics::asked(&problem.robot, model, options))
            .cancelled_by(Some(over.clone()));
        let mut stopping = Vec::new();
        if start[1..].iter().flatten().any(|v| *v != 0.0) {
            let [position, velocity, acceleration] = &start;
            can_stop(builder.limits(), &model.lower, &model.upper, position, velocity, acceleration)?;
            builder.admit(position, velocity, acceleration);
            stopping = stop(builder.limits(), position, velocity, acceleration);
        }
        let mut world = World::new(problem, model);
        world.measure_start(State::still(&model.start()), world.schedule.toward(entry));
        let end = end_of(begun, request.deadline);
        world.limit(request.max_checks, end, request.cancel.clone());
        let timing =
            problem.options.timing.unwrap_or(if problem.config.has_times() { Timing::Config } else { Timing::Limits });
        let clock = match timing {
            Timing::Limits => None,
            // The config is valid, so only a start time after the first keyframe fails, which ends as `TooFast`.
            Timing::Config => problem.config.clock(f64::NEG_INFINITY).ok(),
        };
        Ok(Self {
            problem,
            model,
            resolved,
            follower: Follower::new(&problem.robot, model, over.clone()),
            over,
            world,
            scene: problem.scene(),
            start,
            stop: stopping,
            margin: options.margin,
            stop_checked: None,
            builder,
            clock,
            exit: None,
            boxed_in: 0,
            entry,
            warm_start: request.warm_start,
            explain: request.explain,
            partial: options.allow_partial,
            acting: None,
        })
    }

    /// Returns the joint positions at which planning begins: the end of the braking motion, or the current positions if
    /// an obstacle blocks braking.
    pub(super) fn rest(&self) -> Row {
        self.stop.last().filter(|_| self.blocked_stop().is_none()).map_or(self.start[0], |node| node.position)
    }

    pub(super) fn full(&self, x: &Row) -> Vec<f64> {
        let mut q = Vec::new();
        self.model.map().positions(x, &mut q);
        q
    }

    /// Returns the clearances (m) to try, the largest first.
    pub(super) fn margins_in_turn(&self) -> Vec<f64> {
        let options = &self.problem.options;
        let least = options.least_margin.filter(|least| *least < options.margin && options.avoid_collisions);
        std::iter::once(options.margin).chain(least).collect()
    }

    pub(super) fn set_margin(&mut self, margin: f64) {
        if self.margin.to_bits() != margin.to_bits() {
            (self.margin, self.stop_checked, self.exit, self.boxed_in) = (margin, None, None, 0);
        }
    }

    /// Returns the two bodies that overlap at the start more deeply than permitted, if there are any.
    pub(super) fn too_deep(&self) -> Option<Hit> {
        let options = &self.problem.options;
        let deep = options.avoid_collisions && self.world.start_overlap > options.start_depth;
        self.world.start_hit.clone().filter(|_| deep)
    }

    /// Returns the failed plan if the robot overlaps a body too deeply at the start.
    pub(super) fn too_deep_at_start(&self) -> Option<Plan> {
        // After the actuation, the positions of the picked bodies are not known at this point.
        let hit = self.too_deep().filter(|_| self.entry <= self.world.schedule.actuation())?;
        let depth = self.problem.options.start_depth;
        let hint = links_may_touch(&self.problem.robot, [&hit.first, &hit.second]);
        let reason = format!("{}; start_depth allows {}{hint}", inside(&hit), millimetres(depth));
        let mut out = refused(Lack::StartInCollision, reason);
        out.start_overlap = self.world.start_overlap;
        out.collisions = vec![Collision {
            bodies: [hit.first, hit.second],
            time: None,
            toward: self.world.schedule.label(self.entry),
            distance: hit.distance,
            point: [hit.at.x, hit.at.y, hit.at.z],
        }];
        Some(out)
    }

    /// Returns the plan for a planning run that was cancelled or reached a limit; `so_far` describes its progress.
    pub(super) fn ended(&self, so_far: &str) -> Plan {
        if self.world.is_cancelled() {
            return refused(Lack::Cancelled, "planning was cancelled".to_owned());
        }
        let spent = if self.world.is_spent() { "the limit of collision checks is used up" } else { "the time is up" };
        refused(Lack::NotFound, format!("{spent}; so far {so_far}"))
    }

    /// Returns the plan that results from the trials; `cheapest` is the cheapest pose that meets the constraints.
    pub(super) fn conclude(&mut self, trials: Trials, cheapest: &Candidate) -> Plan {
        let solved = trials.done();
        let Trials { best, tried, mut poses, .. } = trials;
        poses.sort_by_key(|pose| pose.rank);
        let mut out = match best {
            Some(attempt) => {
                self.act(&attempt);
                self.report(attempt)
            }
            None => refused(Lack::NotFound, "no actuation pose was tried".to_owned()),
        };
        if !solved && self.world.is_over() && (self.world.is_cancelled() || out.trajectory().is_none()) {
            let ended = self.ended(&out.reason);
            if self.world.is_cancelled() {
                // Keyframe times exist only with a trajectory.
                out.keyframes.iter_mut().for_each(|keyframe| keyframe.time = None);
            }
            (out.outcome, out.reason) = (ended.outcome, ended.reason);
        }
        out.tried = tried;
        out.tried_poses = poses;
        out.q_actuation = Some(self.full(&cheapest.x));
        out.cost = Some(cheapest.cost);
        out.start_overlap = self.world.start_overlap;
        out.assumed_limits = assumed_limits(self.model, &self.problem.options);
        out.warnings.extend(warnings(&self.problem.robot, self.model, &self.problem.options));
        if out.start_overlap > 0.0 {
            if let Some(hit) = self.world.start_hit.as_ref().filter(|_| solved) {
                out.reason.push_str(&format!("; at the start, {}", meeting(hit)));
            }
            out.warnings.push(format!("the robot overlaps a body by {} at the start", millimetres(out.start_overlap)));
        }
        out
    }
}

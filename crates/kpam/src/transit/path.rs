//! Path constraints of a motion to a goal: a direction of the tool keeps its angle to a direction of the base, as in a
//! config's axis constraints. For example, a carried glass stays upright.

use std::collections::BTreeMap;
use std::sync::Arc;

use gensim2_geometry::Robot;
use nalgebra::{Matrix3, Rotation3, Unit, Vector3};

use crate::config::{Constraint, Frame, TargetAxis};
use crate::model::{MAX_JOINTS, Model, Placed, Row};
use crate::{ProblemError, Scene, SolverConfig, Trajectory};

/// Fraction of the tolerance that a search may use; the rest is reserved for rounding the corners.
const SEARCHED: f64 = 0.85;
/// Fraction of the tolerance to which a correction reduces the error.
const PULLED: f64 = 0.6;
/// Maximum number of iterations of a correction, and the damping of each iteration.
const ROUNDS: usize = 12;
const DAMPING: f64 = 1e-6;
/// Violations of a tolerance (rad) below this are rounding errors.
const ROUNDING: f64 = 1e-6;

/// A tool direction that keeps its angle to a target direction.
#[derive(Debug, Clone)]
struct Axis {
    name: String,
    /// Unit direction of the tool in the hand frame.
    tool: Vector3<f64>,
    /// Unit target direction in the base frame.
    target: Vector3<f64>,
    /// Required angle between both directions, and its tolerance (rad).
    angle: f64,
    tolerance: f64,
}

/// Path constraints of a motion.
#[derive(Debug, Clone)]
pub(super) struct Along {
    axes: Vec<Axis>,
    robot: Arc<Robot>,
    placed: Placed,
}

impl Along {
    /// Reads the axis constraints of a config, which refer to tool keypoints and fixed directions of the base.
    pub fn of(
        config: Option<&SolverConfig>,
        scene: &Scene,
        given: &BTreeMap<String, Vector3<f64>>,
    ) -> Result<Option<Self>, ProblemError> {
        let Some(config) = config else { return Ok(None) };
        let mut keypoints = scene.tool_keypoints();
        keypoints.extend(given.iter().map(|(name, point)| (name.clone(), *point)));
        let mut axes = Vec::new();
        for (i, constraint) in config.constraints().iter().enumerate() {
            let fail = |message: String| Err(ProblemError::new(format!("path.constraint_list[{i}]"), message));
            let Constraint::Axis { from, to, target, inner, tolerance, .. } = constraint else {
                return fail(format!("{} cannot be kept along a path: only axis constraints can", constraint.name()));
            };
            let TargetAxis::Fixed { axis, frame: Frame::World } = target else {
                return fail("needs a target axis in the frame \"world\", which is the robot's base here".to_owned());
            };
            let mut ends = [Vector3::zeros(); 2];
            for (end, name) in ends.iter_mut().zip([from, to]) {
                match keypoints.get(name) {
                    Some(point) => *end = *point,
                    None => {
                        let known: Vec<&str> = keypoints.keys().map(String::as_str).collect();
                        return fail(format!("{name:?} is no keypoint of the tool; there are {known:?}"));
                    }
                }
            }
            let Some(tool) = (ends[1] - ends[0]).try_normalize(1e-9) else {
                return fail(format!("{from:?} and {to:?} are the same point"));
            };
            let (target, angle) = (axis.normalize(), inner.clamp(-1.0, 1.0).acos());
            axes.push(Axis { name: constraint.name(), tool, target, angle, tolerance: *tolerance });
        }
        let robot = Arc::clone(scene.robot());
        Ok((!axes.is_empty()).then(|| Self { axes, robot, placed: Placed::default() }))
    }

    /// Returns the largest error of an axis's angle as a fraction of its tolerance.
    fn share(&mut self, model: &Model, x: &Row) -> f64 {
        let Self { axes, robot, placed } = self;
        placed.place(robot, model, x);
        axes.iter().map(|a| a.off(&(placed.hand.rotation * a.tool)).abs() / a.tolerance).fold(0.0, f64::max)
    }

    /// Returns whether the errors at a configuration are within the fraction of the tolerances that a search may use.
    pub fn keeps(&mut self, model: &Model, x: &Row) -> bool {
        self.share(model, x) <= SEARCHED
    }

    /// Returns an error if a configuration violates a constraint.
    pub fn check(&mut self, model: &Model, field: &str, x: &Row) -> Result<(), ProblemError> {
        if self.share(model, x) <= SEARCHED {
            return Ok(());
        }
        let hand = self.placed.hand.rotation;
        let Some(axis) = self.axes.iter().find(|a| a.off(&(hand * a.tool)).abs() > SEARCHED * a.tolerance) else {
            return Ok(());
        };
        let off = axis.off(&(hand * axis.tool)).abs();
        let most = SEARCHED * axis.tolerance;
        let message = format!("violates {} by {off:.4} rad; start and goal must be within {most:.4} rad", axis.name);
        Err(ProblemError::new(field, message))
    }

    /// Moves a configuration so that the axes keep their angles within the joint limits; returns whether that
    /// succeeded. A valid configuration is unchanged.
    pub fn pull(&mut self, model: &Model, x: &mut Row) -> bool {
        for _ in 0..ROUNDS {
            if self.keeps(model, x) {
                return true;
            }
            for k in 0..self.axes.len() {
                let axis = &self.axes[k];
                self.placed.place(&self.robot, model, x);
                let now = self.placed.hand.rotation * axis.tool;
                let off = axis.off(&now);
                if off.abs() <= PULLED * axis.tolerance {
                    continue;
                }
                // A rotation by the error of the angle, about the common perpendicular of both directions.
                let about = now.cross(&axis.target);
                let square = Unit::try_new(about, 1e-9).unwrap_or_else(|| Unit::new_normalize(perpendicular(&now)));
                let turn = off - (PULLED * axis.tolerance).copysign(off);
                let wanted = Rotation3::from_axis_angle(&square, turn) * now;
                let left = wanted - now;
                let rows = [0, 1, 2].map(|e| self.placed.angular_row(&now.cross(&Vector3::ith(e, 1.0))));
                let mut normal = Matrix3::identity() * DAMPING;
                for (i, j) in (0..3).flat_map(|i| (0..3).map(move |j| (i, j))) {
                    normal[(i, j)] += (0..MAX_JOINTS).map(|v| rows[i][v] * rows[j][v]).sum::<f64>();
                }
                let Some(force) = normal.cholesky().map(|c| c.solve(&left)) else { return false };
                for v in 0..model.n() {
                    let step: f64 = (0..3).map(|e| rows[e][v] * force[e]).sum();
                    x[v] = (x[v] + step).clamp(model.lower[v], model.upper[v]);
                }
            }
        }
        self.keeps(model, x)
    }

    /// Returns whether a motion keeps the constraints throughout, given that the hand rotates no faster than the sum of
    /// the joints; false if planning ends before the proof.
    pub fn proves(&mut self, model: &Model, trajectory: &Trajectory, is_over: &impl Fn() -> bool) -> bool {
        let most: f64 =
            model.map().driven().iter().map(|d| d.factor.abs() * trajectory.limits().velocity[d.variable]).sum();
        let ends: Vec<f64> = trajectory.times().to_vec();
        ends.windows(2).all(|pair| self.proves_between(model, trajectory, [pair[0], pair[1]], most, is_over))
    }

    fn proves_between(
        &mut self,
        model: &Model,
        trajectory: &Trajectory,
        [from, to]: [f64; 2],
        most: f64,
        is_over: &impl Fn() -> bool,
    ) -> bool {
        if is_over() {
            return false;
        }
        let turn = 0.5 * most * (to - from);
        for t in [from, to] {
            let x = trajectory.moving(t);
            self.placed.place(&self.robot, model, &x);
            let hand = self.placed.hand.rotation;
            if self.axes.iter().any(|a| a.off(&(hand * a.tool)).abs() > a.tolerance + ROUNDING) {
                return false;
            }
        }
        let room = {
            let hand = self.placed.hand.rotation;
            self.axes.iter().map(|a| a.tolerance - a.off(&(hand * a.tool)).abs()).fold(f64::INFINITY, f64::min)
        };
        // The hand rotates by at most `2.0 * turn` in the interval; `room` is the remaining tolerance at its end.
        if 2.0 * turn <= room.max(ROUNDING) {
            return true;
        }
        let middle = 0.5 * (from + to);
        self.proves_between(model, trajectory, [from, middle], most, is_over)
            && self.proves_between(model, trajectory, [middle, to], most, is_over)
    }
}

impl Axis {
    /// Returns the angle between a tool direction and its target minus the required angle (rad).
    fn off(&self, now: &Vector3<f64>) -> f64 {
        now.cross(&self.target).norm().atan2(now.dot(&self.target)) - self.angle
    }
}

/// Returns a direction perpendicular to `to`.
fn perpendicular(to: &Vector3<f64>) -> Vector3<f64> {
    let least = to.iamin();
    to.cross(&Vector3::ith(least, 1.0))
}

//! The joints that planning moves, and the hand pose as a function of these joints.

use std::f64::consts::{PI, TAU};

use gensim2_geometry::{Chain, ChainFrames, JointKind, Pose, Robot};
use nalgebra::{Vector3, Vector6};

use crate::ProblemError;
pub(crate) use crate::joint_map::{DrivenJoint, JointMap};

/// Maximum number of joints that planning moves. Buffers of this length are allocated on the stack.
pub const MAX_JOINTS: usize = 16;

/// Positions, velocities or a Jacobian row of the joints that planning moves; unused entries at the end are zero.
pub type Row = [f64; MAX_JOINTS];

/// Returns the point on the straight line from `a` to `b` after a share of the line.
pub(crate) fn between(a: &Row, b: &Row, share: f64) -> Row {
    std::array::from_fn(|v| a[v] + (b[v] - a[v]) * share)
}

/// The joints that planning moves, as independent variables. Mimic joints are not variables: they follow the variables
/// through [`Model::map`], and their limits bound the variables that drive them.
#[derive(Debug, Clone)]
pub struct Model {
    map: JointMap,
    /// Lower position limits (rad or m), tightened by the limits of mimic joints.
    pub lower: Row,
    /// Upper position limits (rad or m), tightened by the limits of mimic joints.
    pub upper: Row,
    /// Velocity limits (rad/s or m/s), reduced by the limits of mimic joints.
    pub velocity: Row,
    /// Acceleration limits (rad/s^2 or m/s^2) in the URDF, reduced by those of mimic joints; infinity without a limit.
    pub acceleration: Row,
    /// Jerk limits (rad/s^3 or m/s^3) in the URDF, reduced by those of mimic joints; infinity without a limit.
    pub jerk: Row,
    /// Whether a full turn of each variable leaves all poses unchanged.
    endless: [bool; MAX_JOINTS],
    /// Half the width (rad or m) of the range in which variables without limits are sampled.
    reach: Row,
    /// Joints of the chain from base to hand that variables drive: index in the chain, variable, and mimic factor.
    columns: Vec<(usize, usize, f64)>,
}

impl Model {
    /// Creates the variables of `robot`: its planned joints. All other joints keep the values in `rest`, a joint vector
    /// of the whole robot.
    ///
    /// # Errors
    /// No joint is planned, more than [`MAX_JOINTS`] are, `rest` has the wrong length, or a variable's own limits
    /// contradict those of its mimic joints.
    pub fn new(robot: &Robot, rest: &[f64]) -> Result<Self, ProblemError> {
        let indices = robot.planned();
        if indices.is_empty() || indices.len() > MAX_JOINTS {
            let message = format!(
                "plans {} independent joints; 1 to {MAX_JOINTS} can be planned, which the argument joints names",
                indices.len()
            );
            return Err(ProblemError::new("robot", message));
        }
        Self::of_joints(robot, indices, rest)
    }

    /// Creates the variables of `robot` that move its hand, for a problem that only concerns the hand.
    ///
    /// # Errors
    /// As [`Model::new`]; none of the planned joints moves the hand.
    pub(crate) fn of_hand(robot: &Robot, rest: &[f64]) -> Result<Self, ProblemError> {
        let planned = robot.planned();
        let indices: Vec<usize> = robot.movers(robot.chain()).into_iter().filter(|j| planned.contains(j)).collect();
        if indices.is_empty() || indices.len() > MAX_JOINTS {
            let message =
                format!("has {} planned joints that move its hand; 1 to {MAX_JOINTS} can be planned", indices.len());
            return Err(ProblemError::new("robot", message));
        }
        Self::of_joints(robot, indices, rest)
    }

    fn of_joints(robot: &Robot, indices: Vec<usize>, rest: &[f64]) -> Result<Self, ProblemError> {
        let joints = robot.joints();
        if rest.len() != joints.len() {
            return Err(ProblemError::new("q_start", format!("has {} entries, not {}", rest.len(), joints.len())));
        }
        let map = JointMap::new(robot, indices, rest);
        let columns = columns(&map, robot.chain());
        let (mut lower, mut upper, mut reach) = ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS], [0.0; MAX_JOINTS]);
        let mut endless = [false; MAX_JOINTS];
        for (v, j) in map.indices().iter().enumerate() {
            (lower[v], upper[v]) = robot.range(*j).unwrap_or((joints[*j].lower(), joints[*j].upper()));
            if lower[v] > upper[v] {
                let message =
                    format!("no value of {} meets its limits and those of the joints that mimic it", joints[*j].name());
                return Err(ProblemError::new("robot", message));
            }
            reach[v] = if joints[*j].kind() == JointKind::Revolute { PI } else { 0.5 };
            // A variable is periodic if a full turn leaves the pose of every joint that it drives unchanged.
            endless[v] = map.driven().iter().filter(|d| d.variable == v).all(|d| {
                let joint = &joints[d.joint];
                let open = joint.lower() == f64::NEG_INFINITY && joint.upper() == f64::INFINITY;
                joint.kind() == JointKind::Revolute && open && d.factor.fract() == 0.0
            });
        }
        let velocity = map.least(|j| joints[j].velocity());
        let acceleration = map.least(|j| joints[j].acceleration());
        let jerk = map.least(|j| joints[j].jerk());
        Ok(Self { map, lower, upper, velocity, acceleration, jerk, endless, reach, columns })
    }

    /// Returns for each variable whether it moves the link of a chain.
    pub(crate) fn moves(&self, chain: &Chain) -> [bool; MAX_JOINTS] {
        let mut out = [false; MAX_JOINTS];
        self.columns_of(chain).iter().for_each(|(_, variable, _)| out[*variable] = true);
        out
    }

    /// Returns the joints of a chain that variables drive: index in the chain, variable, and mimic factor.
    pub(crate) fn columns_of(&self, chain: &Chain) -> Vec<(usize, usize, f64)> {
        columns(&self.map, chain)
    }

    /// Returns the map from variables to joint vectors of the whole robot.
    #[must_use]
    pub fn map(&self) -> &JointMap {
        &self.map
    }

    /// Returns, for each variable, the average distance (m per rad or m) that the robot's furthest points move per unit
    /// of the variable. The average is over the joints' ranges.
    #[must_use]
    pub fn mean_levers(&self, robot: &Robot) -> Row {
        let mut out = [0.0; MAX_JOINTS];
        for driven in self.map.driven() {
            out[driven.variable] += driven.factor.abs() * robot.cover().levers()[driven.joint];
        }
        out
    }

    /// Returns the chain's joints that variables drive: index in the chain, variable, and mimic factor.
    pub(crate) fn columns(&self) -> &[(usize, usize, f64)] {
        &self.columns
    }

    /// Returns for each variable whether a full turn leaves all poses unchanged.
    pub(crate) fn endless(&self) -> &[bool; MAX_JOINTS] {
        &self.endless
    }

    /// Returns the number of variables.
    #[must_use]
    pub fn n(&self) -> usize {
        self.map.indices().len()
    }

    /// Returns the variables of a joint vector of the whole robot.
    #[must_use]
    pub fn pick(&self, q: &[f64]) -> Row {
        self.map.pick(q)
    }

    /// Returns the variables at the start of the motion.
    #[must_use]
    pub fn start(&self) -> Row {
        self.map.pick(self.map.rest())
    }

    /// Computes the frames of any chain at the variables `x`.
    pub(crate) fn forward_along(&self, chain: &Chain, x: &Row, q: &mut Vec<f64>, frames: &mut ChainFrames) {
        self.map.positions(x, q);
        let placed = chain.forward(q, frames);
        debug_assert!(placed.is_ok(), "a model's map has an entry for each joint of its robot");
    }

    /// Returns the Jacobian of a chain's link by columns: linear velocity of the link's origin (m) and angular velocity
    /// (rad), base frame, per unit of each variable.
    pub(crate) fn twists(&self, chain: &Chain, frames: &ChainFrames) -> [Vector6<f64>; MAX_JOINTS] {
        let mut columns = [Vector6::zeros(); MAX_JOINTS];
        let tip = frames.tip.translation.vector;
        for (i, joint) in chain.joint_indices().enumerate() {
            let driven = self.map.driven().iter().find(|d| d.joint == joint);
            let (Some(driven), Some(linear), Some(angular)) =
                (driven, chain.linear(frames, i, &tip), chain.angular(frames, i))
            else {
                continue;
            };
            let column = &mut columns[driven.variable];
            for k in 0..3 {
                column[k] += driven.factor * linear[k];
                column[k + 3] += driven.factor * angular[k];
            }
        }
        columns
    }

    /// Returns the range (rad or m) in which a variable is sampled: its limits, or half a turn (half a metre) to either
    /// side of the start for a variable without limits.
    #[must_use]
    pub fn range(&self, v: usize) -> (f64, f64) {
        let (lower, upper) = (self.lower[v], self.upper[v]);
        if lower.is_finite() && upper.is_finite() {
            return (lower, upper);
        }
        let half = self.reach[v];
        let middle = self.start()[v].max(lower + half).min(upper - half);
        (middle - half, middle + half)
    }

    /// Returns whether two vectors of variables differ by less than `limit` (rad or m) in every variable. Whole turns
    /// of periodic variables do not count as a difference.
    #[must_use]
    pub fn are_near(&self, a: &Row, b: &Row, limit: f64) -> bool {
        (0..self.n()).all(|v| {
            let way = b[v] - a[v];
            let way = if self.endless[v] { way - TAU * (way / TAU).round() } else { way };
            way.abs() < limit
        })
    }

    /// Returns `x` with periodic variables shifted by whole turns to within half a turn of `center`. The pose of every
    /// link stays the same.
    #[must_use]
    pub fn unwound(&self, x: &Row, center: &Row) -> Row {
        let mut out = *x;
        for v in (0..self.n()).filter(|v| self.endless[*v]) {
            out[v] -= TAU * ((x[v] - center[v]) / TAU).round();
        }
        out
    }
}

/// Returns the joints of a chain that variables drive: index in the chain, variable, and mimic factor.
fn columns(map: &JointMap, chain: &Chain) -> Vec<(usize, usize, f64)> {
    let driven = |joint: usize| map.driven().iter().find(|d| d.joint == joint);
    chain.joint_indices().enumerate().filter_map(|(i, j)| driven(j).map(|d| (i, d.variable, d.factor))).collect()
}

/// A point or direction fixed to the hand, in the base frame, and the vector that weights its second derivatives.
pub(crate) type Weighed = (Vector3<f64>, Vector3<f64>);

/// The hand pose at a joint vector, with its derivatives with respect to the variables.
#[derive(Debug, Clone)]
pub struct Placed {
    /// The variables at which the hand was placed.
    pub x: Row,
    /// The hand pose in the base frame.
    pub hand: Pose,
    columns: Vec<Column>,
    q: Vec<f64>,
    frames: ChainFrames,
}

/// Motion of the hand per unit of one joint of the chain: angular velocity, and velocity of the hand point at the
/// base's origin.
#[derive(Debug, Clone, Copy)]
struct Column {
    variable: usize,
    turn: Vector3<f64>,
    shift: Vector3<f64>,
}

impl Default for Placed {
    fn default() -> Self {
        Self {
            x: [f64::NAN; MAX_JOINTS],
            hand: Pose::identity(),
            columns: Vec::new(),
            q: Vec::new(),
            frames: ChainFrames::default(),
        }
    }
}

impl Placed {
    /// Computes the hand pose and its derivatives at `x`, unless they were computed for `x` before.
    pub fn place(&mut self, robot: &Robot, model: &Model, x: &Row) {
        self.place_along(robot.chain(), &model.columns, model, x);
    }

    /// Computes the same for the link of any chain; `columns` are the variables that move it.
    pub fn place_along(&mut self, chain: &Chain, columns: &[(usize, usize, f64)], model: &Model, x: &Row) {
        if self.x == *x {
            return;
        }
        self.x = *x;
        model.forward_along(chain, x, &mut self.q, &mut self.frames);
        self.hand = self.frames.tip;
        self.columns.clear();
        for &(i, variable, factor) in columns {
            let axis = self.frames.axes[i] * factor;
            let (turn, shift) = match chain.kind(i) {
                Some(JointKind::Revolute) => (axis, self.frames.origins[i].cross(&axis)),
                Some(JointKind::Prismatic) | None => (Vector3::zeros(), axis),
            };
            self.columns.push(Column { variable, turn, shift });
        }
    }

    /// Returns the gradient of `direction . p` for a point `p` fixed to the hand and given in the base frame (m).
    #[must_use]
    pub fn linear_row(&self, point: &Vector3<f64>, direction: &Vector3<f64>) -> Row {
        let moment = point.cross(direction);
        let mut row = [0.0; MAX_JOINTS];
        for c in &self.columns {
            row[c.variable] += direction.dot(&c.shift) + moment.dot(&c.turn);
        }
        row
    }

    /// Returns the gradients of the three coordinates of a point fixed to the hand, given in the base frame (m).
    #[must_use]
    pub fn point_rows(&self, point: &Vector3<f64>) -> [Row; 3] {
        let mut rows = [[0.0; MAX_JOINTS]; 3];
        for c in &self.columns {
            let velocity = c.shift + c.turn.cross(point);
            for k in 0..3 {
                rows[k][c.variable] += velocity[k];
            }
        }
        rows
    }

    /// Returns the gradient of the hand's rotation angle about `direction`.
    #[must_use]
    pub fn angular_row(&self, direction: &Vector3<f64>) -> Row {
        let mut row = [0.0; MAX_JOINTS];
        for c in &self.columns {
            row[c.variable] += direction.dot(&c.turn);
        }
        row
    }

    /// Adds to `h` the second derivatives of `sum f . p + sum m . a`. The points `p` and directions `a` are fixed to
    /// the hand, and given as (point, f) and (direction, m) in the base frame.
    ///
    /// For joints i before j, d²p/dq_i dq_j = z_i × (dp/dq_j); the same holds for directions.
    pub(crate) fn second_derivatives(&self, points: &[Weighed], axes: &[Weighed], h: &mut [Row; MAX_JOINTS]) {
        for (j, moving) in self.columns.iter().enumerate() {
            let mut w = Vector3::zeros();
            for (p, force) in points {
                w += (moving.shift + moving.turn.cross(p)).cross(force);
            }
            for (a, pull) in axes {
                w += moving.turn.cross(a).cross(pull);
            }
            for (i, before) in self.columns.iter().enumerate().take(j + 1) {
                let value = before.turn.dot(&w);
                h[before.variable][moving.variable] += value;
                if i != j {
                    h[moving.variable][before.variable] += value;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use gensim2_geometry::Robot;

    use super::*;

    #[test]
    fn joints_count_by_how_far_they_move_the_arm() {
        // A carriage with an arm 2 m long: one radian of the arm counts as much as two metres of the carriage.
        let urdf = r#"<robot name="crane"><link name="base"/><link name="carriage"/>
            <link name="arm"><collision><origin xyz="1 0 0"/><geometry><box size="2 0.02 0.02"/></geometry></collision></link>
            <joint name="slide" type="prismatic"><parent link="base"/><child link="carriage"/><axis xyz="1 0 0"/>
            <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
            <joint name="turn" type="revolute"><parent link="carriage"/><child link="arm"/><axis xyz="0 0 1"/>
            <limit lower="-3" upper="3" effort="1" velocity="2"/></joint></robot>"#;
        let robot = Robot::from_urdf_str(urdf, "crane.urdf", None, "arm", None).unwrap();
        let model = Model::new(&robot, &[0.0, 0.0]).unwrap();
        let [slid, turned, ..] = model.mean_levers(&robot);
        assert!((slid - 1.0).abs() < 1e-12 && (turned - 2.0).abs() < 0.05, "{slid} {turned}");
    }
}

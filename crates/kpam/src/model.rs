//! The joints that planning moves, and the hand as a function of them.

use gensim2_geometry::{ChainFrames, JointKind, Pose, Robot};
use nalgebra::Vector3;

/// Most joints that planning moves at once; buffers of this length live on the stack.
pub const MOST_JOINTS: usize = 12;

/// Joint values, velocities or a Jacobian row of the moving joints; entries past their number are zero.
pub type Row = [f64; MOST_JOINTS];

/// The joints between base and hand, as independent variables.
#[derive(Debug, Clone)]
pub struct Model {
    /// Place in the full joint vector of each variable.
    pub indices: Vec<usize>,
    /// Lower limits (rad or m).
    pub lower: Row,
    /// Upper limits (rad or m).
    pub upper: Row,
    /// Full joint vector that holds still whatever is not a variable.
    pub rest: Vec<f64>,
    /// For each chain joint: its variable and factor (1 but for mimic joints).
    columns: Vec<(usize, f64)>,
}

impl Model {
    /// Variables of `robot`; joints off the chain stay as in `rest`. `None` where the chain has too many joints or a
    /// mimic joint whose source is off the chain.
    #[must_use]
    pub fn new(robot: &Robot, rest: &[f64]) -> Option<Self> {
        let joints = robot.joints();
        let on_chain: Vec<usize> = robot.chain().joint_indices().collect();
        let indices: Vec<usize> = on_chain.iter().copied().filter(|j| joints[*j].mimic.is_none()).collect();
        if indices.is_empty() || indices.len() > MOST_JOINTS {
            return None;
        }
        let columns = on_chain
            .iter()
            .map(|j| {
                let (source, factor) = joints[*j].mimic.map_or((*j, 1.0), |m| (m.source, m.multiplier));
                indices.iter().position(|i| *i == source).map(|v| (v, factor))
            })
            .collect::<Option<Vec<_>>>()?;
        let mut lower = [0.0; MOST_JOINTS];
        let mut upper = [0.0; MOST_JOINTS];
        for (v, j) in indices.iter().enumerate() {
            (lower[v], upper[v]) = (joints[*j].lower, joints[*j].upper);
        }
        Some(Self { indices, lower, upper, rest: rest.to_vec(), columns })
    }

    /// Number of variables.
    #[must_use]
    pub fn n(&self) -> usize {
        self.indices.len()
    }

    /// Variables of a full joint vector.
    #[must_use]
    pub fn pick(&self, q: &[f64]) -> Row {
        let mut x = [0.0; MOST_JOINTS];
        for (v, j) in self.indices.iter().enumerate() {
            x[v] = q[*j];
        }
        x
    }

    /// Writes the full joint vector of variables `x` into `q`.
    pub fn fill(&self, robot: &Robot, x: &Row, q: &mut Vec<f64>) {
        q.clear();
        q.extend_from_slice(&self.rest);
        for (v, j) in self.indices.iter().enumerate() {
            q[*j] = x[v];
        }
        robot.apply_mimic(q, &self.indices);
    }

    /// Hand frames at `x`.
    pub fn forward(&self, robot: &Robot, x: &Row, q: &mut Vec<f64>, frames: &mut ChainFrames) {
        self.fill(robot, x, q);
        robot.chain().forward(q, frames);
    }

    /// Whether a variable turns without limits, so that it may be counted modulo one turn.
    #[must_use]
    pub fn endless(&self, robot: &Robot, v: usize) -> bool {
        robot.joints()[self.indices[v]].kind == JointKind::Revolute && self.lower[v] == f64::NEG_INFINITY
    }

    /// Range of a variable to draw start values from.
    #[must_use]
    pub fn range(&self, v: usize) -> (f64, f64) {
        let low = if self.lower[v].is_finite() { self.lower[v] } else { -std::f64::consts::PI };
        let high = if self.upper[v].is_finite() { self.upper[v] } else { std::f64::consts::PI };
        (low, high)
    }
}

/// The hand at a joint vector, and how it moves with each joint.
#[derive(Debug, Clone)]
pub struct Placed {
    /// The joint vector.
    pub x: Row,
    /// The hand in the base frame.
    pub hand: Pose,
    columns: Vec<Column>,
    q: Vec<f64>,
    frames: ChainFrames,
}

/// Motion of the hand as one chain joint moves: angular velocity, and velocity of the point of the hand at the base origin.
#[derive(Debug, Clone, Copy)]
struct Column {
    variable: usize,
    turn: Vector3<f64>,
    shift: Vector3<f64>,
}

impl Default for Placed {
    fn default() -> Self {
        Self {
            x: [f64::NAN; MOST_JOINTS],
            hand: Pose::identity(),
            columns: Vec::new(),
            q: Vec::new(),
            frames: ChainFrames::default(),
        }
    }
}

impl Placed {
    /// Moves the hand to `x`; nothing is computed where it is there already.
    pub fn place(&mut self, robot: &Robot, model: &Model, x: &Row) {
        if self.x == *x {
            return;
        }
        self.x = *x;
        model.forward(robot, x, &mut self.q, &mut self.frames);
        self.hand = self.frames.tip;
        self.columns.clear();
        let chain = robot.chain();
        for (i, (variable, factor)) in model.columns.iter().enumerate() {
            let axis = self.frames.axes[i] * *factor;
            let (turn, shift) = match chain.kind(i) {
                JointKind::Revolute => (axis, self.frames.origins[i].cross(&axis)),
                JointKind::Prismatic => (Vector3::zeros(), axis),
            };
            self.columns.push(Column { variable: *variable, turn, shift });
        }
    }

    /// Gradient of `direction . p` for a point `p` fixed to the hand, given in the base frame (m).
    #[must_use]
    pub fn linear_row(&self, point: &Vector3<f64>, direction: &Vector3<f64>) -> Row {
        let moment = point.cross(direction);
        let mut row = [0.0; MOST_JOINTS];
        for c in &self.columns {
            row[c.variable] += direction.dot(&c.shift) + moment.dot(&c.turn);
        }
        row
    }

    /// Gradients of the three coordinates of a point fixed to the hand, given in the base frame (m).
    #[must_use]
    pub fn point_rows(&self, point: &Vector3<f64>) -> [Row; 3] {
        let mut rows = [[0.0; MOST_JOINTS]; 3];
        for c in &self.columns {
            let velocity = c.shift + c.turn.cross(point);
            for k in 0..3 {
                rows[k][c.variable] += velocity[k];
            }
        }
        rows
    }

    /// Gradient of the angle turned about `direction` by the hand.
    #[must_use]
    pub fn angular_row(&self, direction: &Vector3<f64>) -> Row {
        let mut row = [0.0; MOST_JOINTS];
        for c in &self.columns {
            row[c.variable] += direction.dot(&c.turn);
        }
        row
    }

    /// Adds to `h` the second derivatives of `sum f . p + sum m . a` over points `p` and directions `a` fixed to the
    /// hand, given as (point, f) and (direction, m) in the base frame.
    ///
    /// For joints i before j, d²p/dq_i dq_j = z_i × (dp/dq_j), and likewise for directions.
    pub(crate) fn second_derivatives(
        &self,
        points: &[(Vector3<f64>, Vector3<f64>)],
        axes: &[(Vector3<f64>, Vector3<f64>)],
        h: &mut [Row; MOST_JOINTS],
    ) {
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

//! Forward kinematics of eight joint vectors at a time, in single precision.

use crate::lanes::{F32x8, Wide, wide};
use nalgebra::{Matrix3, Vector3};

use super::solid::Points;
use crate::{JointKind, Pose, Robot};

/// Eight rigid transforms, one in each lane: rotation by rows, and translation.
#[derive(Debug, Clone, Copy)]
pub struct Frames {
    /// Rotation, row by row.
    pub r: [[F32x8; 3]; 3],
    /// Translation (m).
    pub t: Points,
}

impl Frames {
    #[inline(always)]
    pub(super) fn of(pose: &Pose) -> Self {
        let m = pose.rotation.matrix();
        let splat = |v: f64| F32x8::splat(v as f32);
        Self {
            r: [0, 1, 2].map(|i| [0, 1, 2].map(|j| splat(m[(i, j)]))),
            t: [0, 1, 2].map(|i| splat(pose.translation.vector[i])),
        }
    }

    /// Position (m) in base coordinates of a point given in the frame.
    #[inline(always)]
    #[must_use]
    pub fn point(&self, p: &[f32; 3]) -> Points {
        let [x, y, z] = self.direction(p);
        [x + self.t[0], y + self.t[1], z + self.t[2]]
    }

    /// Direction in base axes of a direction given in the frame.
    #[inline(always)]
    #[must_use]
    pub fn direction(&self, p: &[f32; 3]) -> Points {
        let [x, y, z] = [F32x8::splat(p[0]), F32x8::splat(p[1]), F32x8::splat(p[2])];
        let r = &self.r;
        [
            r[0][0] * x + r[0][1] * y + r[0][2] * z,
            r[1][0] * x + r[1][1] * y + r[1][2] * z,
            r[2][0] * x + r[2][1] * y + r[2][2] * z,
        ]
    }

    /// Returns the middle between this transform and another one, and half of their difference. Neither is rigid, but
    /// both map a point to the middle of, and to half of the way between, its two positions.
    #[inline(always)]
    pub(super) fn halfway(&self, other: &Self) -> (Self, Self) {
        let (mut middle, mut half) = (*self, *self);
        for i in 0..3 {
            for j in 0..3 {
                half.r[i][j] = (other.r[i][j] - self.r[i][j]) * 0.5;
                middle.r[i][j] = self.r[i][j] + half.r[i][j];
            }
            half.t[i] = (other.t[i] - self.t[i]) * 0.5;
            middle.t[i] = self.t[i] + half.t[i];
        }
        (middle, half)
    }

    /// Sets the transform in one lane.
    pub(super) fn set(&mut self, lane: usize, pose: &Pose) {
        let m = pose.rotation.matrix();
        for i in 0..3 {
            for j in 0..3 {
                self.r[i][j].set(lane, m[(i, j)] as f32);
            }
            self.t[i].set(lane, pose.translation.vector[i] as f32);
        }
    }

    /// Returns the transform that applies another transform and then this one.
    #[inline(always)]
    pub(super) fn after(&self, other: &Self) -> Self {
        let mut out = *self;
        for i in 0..3 {
            let row = self.r[i];
            for j in 0..3 {
                out.r[i][j] = row[0] * other.r[0][j] + row[1] * other.r[1][j] + row[2] * other.r[2][j];
            }
            out.t[i] = row[0] * other.t[0] + row[1] * other.t[1] + row[2] * other.t[2] + self.t[i];
        }
        out
    }

    /// Returns another transform relative to this one.
    #[inline(always)]
    pub(super) fn inverse_then(&self, other: &Self) -> Self {
        let mut out = *other;
        let way = [other.t[0] - self.t[0], other.t[1] - self.t[1], other.t[2] - self.t[2]];
        for i in 0..3 {
            let column = [self.r[0][i], self.r[1][i], self.r[2][i]];
            for j in 0..3 {
                out.r[i][j] = column[0] * other.r[0][j] + column[1] * other.r[1][j] + column[2] * other.r[2][j];
            }
            out.t[i] = column[0] * way[0] + column[1] * way[1] + column[2] * way[2];
        }
        out
    }

    #[inline(always)]
    fn then(&self, fixed: &Fixed) -> Self {
        let mut r = self.r;
        match &fixed.turn {
            Turn::None => {}
            Turn::Quarter { sign } => {
                for i in 0..3 {
                    (r[i][1], r[i][2]) = (self.r[i][2] * *sign, self.r[i][1] * -*sign);
                }
            }
            Turn::Any(turn) => {
                for i in 0..3 {
                    for j in 0..3 {
                        r[i][j] = self.r[i][0] * turn[0][j] + self.r[i][1] * turn[1][j] + self.r[i][2] * turn[2][j];
                    }
                }
            }
        }
        Self { r, t: self.point(&fixed.t) }
    }
}

#[derive(Debug, Clone, Copy)]
struct Fixed {
    turn: Turn,
    t: [f32; 3],
}

/// A constant rotation, stored in a form that is fast to apply.
#[derive(Debug, Clone, Copy)]
enum Turn {
    None,
    /// A quarter turn about x in either direction, the most frequent rotation between joints of arms.
    Quarter {
        sign: f32,
    },
    Any([[f32; 3]; 3]),
}

impl Turn {
    /// Classifies a rotation; it counts as a quarter turn if single precision cannot tell the difference.
    fn of(rotation: &Matrix3<f64>) -> Self {
        const SAME: f64 = 6e-8;
        let quarter = |sign: f64| Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, -sign, 0.0, sign, 0.0);
        let is = |other: Matrix3<f64>| (rotation - other).amax() < SAME;
        match () {
            () if is(Matrix3::identity()) => Self::None,
            () if is(quarter(1.0)) => Self::Quarter { sign: 1.0 },
            () if is(quarter(-1.0)) => Self::Quarter { sign: -1.0 },
            () => Self::Any(rows(rotation)),
        }
    }
}

/// Rotation of a joint's child link as a function of the joint angle: `A + sin B + cos C`.
#[derive(Debug, Clone)]
enum Motion {
    None,
    /// Rotation about the frame's own z axis in either direction, as in most URDF arms.
    Spin {
        joint: usize,
        sign: f32,
    },
    Revolute {
        joint: usize,
        a: [[f32; 3]; 3],
        b: [[f32; 3]; 3],
        c: [[f32; 3]; 3],
    },
    Prismatic {
        joint: usize,
        axis: [f32; 3],
    },
}

#[derive(Debug, Clone)]
struct Step {
    parent: Option<usize>,
    origin: Fixed,
    motion: Motion,
}

/// The kinematic tree of a robot in single precision.
#[derive(Debug, Clone)]
pub struct Posing {
    steps: Vec<Step>,
    /// Whether the pose of each link is computed.
    wanted: Vec<bool>,
}

fn rows(m: &Matrix3<f64>) -> [[f32; 3]; 3] {
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| m[(i, j)] as f32))
}

impl Posing {
    /// Prepares a robot. Poses are computed only for `needed` links and their ancestors.
    pub fn new(robot: &Robot, needed: impl Fn(usize) -> bool) -> Self {
        let links = robot.links();
        let mut wanted: Vec<bool> = (0..links.len()).map(needed).collect();
        for l in (0..links.len()).rev() {
            if let (true, Some(p)) = (wanted[l], links[l].parent()) {
                wanted[p] = true;
            }
        }
        let steps = links.iter().map(|link| {
            let origin = Fixed {
                turn: Turn::of(link.origin().rotation.matrix()),
                t: [0, 1, 2].map(|i| link.origin().translation.vector[i] as f32),
            };
            let motion = link.joint().map_or(Motion::None, |joint| {
                let axis: Vector3<f64> = *robot.joints()[joint].axis();
                match robot.joints()[joint].kind() {
                    JointKind::Prismatic => Motion::Prismatic { joint, axis: [0, 1, 2].map(|i| axis[i] as f32) },
                    JointKind::Revolute if axis.x == 0.0 && axis.y == 0.0 => {
                        Motion::Spin { joint, sign: axis.z as f32 }
                    }
                    JointKind::Revolute => {
                        let outer = axis * axis.transpose();
                        Motion::Revolute {
                            joint,
                            a: rows(&outer),
                            b: rows(&axis.cross_matrix()),
                            c: rows(&(Matrix3::identity() - outer)),
                        }
                    }
                }
            });
            Step { parent: link.parent(), origin, motion }
        });
        Self { steps: steps.collect(), wanted }
    }

    /// Writes the pose of every needed link in each lane; `q` has one entry for each joint.
    pub fn place(&self, q: &[F32x8], out: &mut Vec<Frames>) {
        struct Work<'a>(&'a Posing, &'a [F32x8], &'a mut Vec<Frames>);
        impl Wide for Work<'_> {
            type Output = ();
            #[inline(always)]
            fn run(self) {
                self.0.placed(self.1, self.2);
            }
        }
        wide(Work(self, q, out));
    }

    #[inline(always)]
    fn placed(&self, q: &[F32x8], out: &mut Vec<Frames>) {
        out.clear();
        let base = Frames::of(&Pose::identity());
        for (step, wanted) in self.steps.iter().zip(&self.wanted) {
            if !wanted {
                out.push(base);
                continue;
            }
            // No closure is used here: closures may not be inlined, and then are not compiled for wide vectors.
            let frame = match step.parent {
                Some(p) => out[p].then(&step.origin),
                None => base,
            };
            out.push(match &step.motion {
                Motion::None => frame,
                Motion::Prismatic { joint, axis } => {
                    let way = frame.direction(axis);
                    let value = q[*joint];
                    let t = frame.t;
                    Frames { r: frame.r, t: [t[0] + way[0] * value, t[1] + way[1] * value, t[2] + way[2] * value] }
                }
                Motion::Spin { joint, sign } => {
                    let (sin, cos) = (q[*joint] * *sign).sin_cos();
                    let mut r = frame.r;
                    for i in 0..3 {
                        let (x, y) = (frame.r[i][0], frame.r[i][1]);
                        r[i][0] = x * cos + y * sin;
                        r[i][1] = y * cos - x * sin;
                    }
                    Frames { r, t: frame.t }
                }
                Motion::Revolute { joint, a, b, c } => {
                    let (sin, cos) = q[*joint].sin_cos();
                    let mut turn = [[F32x8::ZERO; 3]; 3];
                    for i in 0..3 {
                        for j in 0..3 {
                            turn[i][j] = F32x8::splat(a[i][j]) + sin * b[i][j] + cos * c[i][j];
                        }
                    }
                    let mut r = [[F32x8::ZERO; 3]; 3];
                    for i in 0..3 {
                        for j in 0..3 {
                            r[i][j] =
                                frame.r[i][0] * turn[0][j] + frame.r[i][1] * turn[1][j] + frame.r[i][2] * turn[2][j];
                        }
                    }
                    Frames { r, t: frame.t }
                }
            });
        }
    }

    /// Upper bound on the distance (m) of link origins from the base; `reach` is a prismatic joint's travel (m).
    pub fn size(&self, reach: impl Fn(usize) -> f64) -> f64 {
        self.steps
            .iter()
            .map(|step| {
                let t = step.origin.t;
                let slide = match step.motion {
                    Motion::Prismatic { joint, .. } => reach(joint),
                    _ => 0.0,
                };
                f64::from(t[0].hypot(t[1]).hypot(t[2])) + slide
            })
            .sum()
    }
}

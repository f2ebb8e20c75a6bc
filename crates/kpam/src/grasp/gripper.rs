//! A parallel gripper: its pads, their stroke, and its collision shapes.

use gensim2_geometry::{Convex, JointKind, Pose, Robot, checked_when_read, is_rigid};
use nalgebra::{Matrix3, Point3, Rotation3, Translation3, Vector3};
use serde::{Deserialize, Serialize};

use crate::ProblemError;

/// Minimum cosine between a finger's sliding direction and the closing axis.
const ALONG: f64 = 0.99;
/// Vertices of a finger belong to its pad if they lie within this distance (m) of the innermost vertex.
const PAD_DEPTH: f64 = 1e-3;

/// Keypoints of a gripper in the hand frame (m).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct GripperKeypoints {
    /// Midpoint between the fingertips.
    pub head: Vector3<f64>,
    /// Midpoint between the finger bases. The fingers point from `tail` to `head`.
    pub tail: Vector3<f64>,
    /// Point next to `head`, in the opening direction of one finger.
    pub side: Vector3<f64>,
}

/// A gripper with two flat pads that move symmetrically.
///
/// Its grip frame has x along the closing axis, z along the fingers, and its origin midway between the centres of the
/// pads.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(remote = "Self")]
pub struct ParallelGripper {
    grip: Pose,
    pad: [f64; 2],
    stroke: [f64; 2],
    palm: Vec<Convex>,
    fingers: [Vec<Convex>; 2],
    joints: Vec<FingerJoint>,
}

checked_when_read!(ParallelGripper);

/// A joint that opens a finger.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct FingerJoint {
    /// Index in the robot's joint vector.
    index: usize,
    /// Joint value (m) at the smallest opening.
    closed: f64,
    /// Change of the joint value per change of the opening.
    slope: f64,
}

impl ParallelGripper {
    /// Creates a gripper from its dimensions.
    ///
    /// `grip` is the grip frame in the hand frame; `pad` are the half extents of a pad (m), across and along the
    /// fingers; `stroke` is the minimum and maximum opening (m). `palm` are the fixed shapes in the hand frame.
    /// `fingers` are the finger on the negative side of the closing axis and the one on the positive side, in the hand
    /// frame at opening zero.
    ///
    /// # Errors
    /// Extents are not positive, or the stroke is empty.
    pub fn new(
        grip: Pose,
        pad: [f64; 2],
        stroke: [f64; 2],
        palm: Vec<Convex>,
        fingers: [Vec<Convex>; 2],
    ) -> Result<Self, ProblemError> {
        let gripper = Self { grip, pad, stroke, palm, fingers, joints: Vec::new() };
        gripper.check().map(|()| gripper)
    }

    fn check(&self) -> Result<(), ProblemError> {
        let Self { grip, pad, stroke, joints, .. } = self;
        if !pad.iter().all(|half| (1e-4..=1.0).contains(half)) {
            return Err(ProblemError::new("pad", format!("half extents must lie in 1e-4 to 1 m, not {pad:?}")));
        }
        if !(stroke[0] >= 0.0 && stroke[0] < stroke[1] && stroke[1] <= 10.0) {
            let message = format!("must be a smaller and a larger opening from 0 to 10 m, not {stroke:?}");
            return Err(ProblemError::new("stroke", message));
        }
        if !(is_rigid(grip) && grip.translation.vector.iter().all(|v| v.abs() <= 10.0)) {
            return Err(ProblemError::new("grip", "must be a rigid transform within 10 m of the hand frame"));
        }
        if !joints.iter().all(|j| j.closed.is_finite() && j.slope.is_finite()) {
            return Err(ProblemError::new("joints", "must have finite values"));
        }
        Ok(())
    }

    /// Returns the grip frame of keypoints: x from head to side, made orthogonal to z from tail to head.
    ///
    /// # Errors
    /// Keypoints coincide or are collinear.
    pub fn frame(keypoints: &GripperKeypoints) -> Result<Pose, ProblemError> {
        let fail = || ProblemError::new("tool_keypoints", "head, tail and side must not lie on one line");
        let z = (keypoints.head - keypoints.tail).try_normalize(1e-6).ok_or_else(fail)?;
        let across = keypoints.side - keypoints.head;
        let x = (across - z * across.dot(&z)).try_normalize(1e-6).ok_or_else(fail)?;
        let axes = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, z.cross(&x), z]));
        Ok(Pose::from_parts(Translation3::from(keypoints.head), axes))
    }

    /// Derives the gripper of a robot. Its fingers are the links below the hand that slide along the closing axis, one
    /// to each side. Pads and stroke follow from the fingers' shapes and joint limits.
    ///
    /// # Errors
    /// The keypoints are collinear, or the hand has no two such fingers with shapes and limits.
    pub fn of_robot(robot: &Robot, keypoints: &GripperKeypoints) -> Result<Self, ProblemError> {
        let mut grip = Self::frame(keypoints)?;
        let axis = grip.rotation * Vector3::x();
        let mut q: Vec<f64> = robot.joints().iter().map(|j| 0.0f64.clamp(j.lower(), j.upper())).collect();
        let mut sides: [Option<usize>; 2] = [None, None];
        let mut joints = Vec::new();
        let mut range = f64::INFINITY;
        let mut poses = Vec::new();
        let place = |q: &[f64], poses: &mut Vec<Pose>| {
            robot.link_poses(q, poses).map_err(|e| ProblemError::new("robot", e.to_string()))
        };
        place(&q, &mut poses)?;
        for (index, link) in robot.links().iter().enumerate() {
            let Some(joint) = link.joint().filter(|_| below(robot, index, robot.hand())) else { continue };
            let slide = &robot.joints()[joint];
            let direction = poses[robot.hand()].rotation.inverse() * poses[index].rotation * slide.axis();
            let along = direction.dot(&axis);
            if slide.kind() != JointKind::Prismatic
                || along.abs() < ALONG
                || !(slide.upper() - slide.lower()).is_finite()
            {
                continue;
            }
            let hand_from_link = poses[robot.hand()].inverse() * poses[index];
            let Some(middle) = middle(robot, index, &hand_from_link) else { continue };
            let side = usize::from((middle - keypoints.head).dot(&axis) > 0.0);
            let outwards = if side == 1 { along } else { -along };
            // In the closed gripper, each finger is as far inwards as its joint can slide.
            q[joint] = if outwards > 0.0 { slide.lower() } else { slide.upper() };
            joints.push(FingerJoint { index: joint, closed: q[joint], slope: 0.5 * outwards.signum() });
            range = range.min(slide.upper() - slide.lower());
            if sides[side].replace(index).is_some() {
                return Err(ProblemError::new("robot", "has both fingers on the same side of tool_head"));
            }
        }
        let [Some(left), Some(right)] = sides else {
            let message = "has no two fingers below the hand that slide along the axis from tool_head to tool_side; \
                           give the gripper by its numbers";
            return Err(ProblemError::new("robot", message));
        };
        place(&q, &mut poses)?;
        let grip_from_hand = grip.inverse();
        let placed = |finger: usize| -> Vec<Convex> {
            let hand_from_link = |l: usize| poses[robot.hand()].inverse() * poses[l];
            let rides = (0..robot.links().len()).filter(|l| *l == finger || below(robot, *l, finger));
            rides
                .flat_map(|l| {
                    robot.links()[l].shapes().iter().map(move |s| s.moved(&(grip_from_hand * hand_from_link(l))))
                })
                .collect()
        };
        let fingers = [placed(left), placed(right)];
        let (low, high) = (inner_face(&fingers[0], -1.0), inner_face(&fingers[1], 1.0));
        // Half extents of the region in which both pads overlap, across and along the fingers.
        let overlap = |k: usize| (low.lower[k].max(high.lower[k]), low.upper[k].min(high.upper[k]));
        let ((y0, y1), (z0, z1)) = (overlap(1), overlap(2));
        let shift = Vector3::new(0.5 * (high.lower.x + low.upper.x), 0.5 * (y0 + y1), 0.5 * (z0 + z1));
        let gap = (high.lower.x - low.upper.x).max(0.0);
        grip *= Translation3::from(shift);
        // The shapes at opening zero, in the hand frame.
        let at_zero = |shapes: &[Convex], inner: f64| -> Vec<Convex> {
            let to_hand = grip * Translation3::from(Vector3::new(-inner, -shift.y, -shift.z));
            shapes.iter().map(|s| s.moved(&to_hand)).collect()
        };
        let fingers = [at_zero(&fingers[0], low.upper.x), at_zero(&fingers[1], high.lower.x)];
        let palm = (0..robot.links().len())
            .filter(|l| *l == robot.hand() || below(robot, *l, robot.hand()))
            .filter(|l| ![left, right].iter().any(|f| l == f || below(robot, *l, *f)))
            .flat_map(|l| {
                let pose = poses[robot.hand()].inverse() * poses[l];
                robot.links()[l].shapes().iter().map(move |s| s.moved(&pose))
            })
            .collect();
        let gripper = Self::new(grip, [0.5 * (y1 - y0), 0.5 * (z1 - z0)], [gap, gap + 2.0 * range], palm, fingers)?;
        Ok(Self { joints, ..gripper })
    }

    /// Grip frame in the hand frame.
    #[must_use]
    pub fn grip(&self) -> &Pose {
        &self.grip
    }

    /// Half extents of a pad (m), across and along the fingers.
    #[must_use]
    pub fn pad(&self) -> [f64; 2] {
        self.pad
    }

    /// Minimum and maximum opening (m).
    #[must_use]
    pub fn stroke(&self) -> [f64; 2] {
        self.stroke
    }

    /// Sets the finger joints of a full joint vector to an opening (m), clipped to the stroke. Does nothing for a
    /// gripper that was created from dimensions.
    pub fn set_opening(&self, q: &mut [f64], opening: f64) {
        let beyond = opening.clamp(self.stroke[0], self.stroke[1]) - self.stroke[0];
        for joint in &self.joints {
            if let Some(value) = q.get_mut(joint.index) {
                *value = joint.closed + joint.slope * beyond;
            }
        }
    }

    /// Shapes that do not move with the fingers, hand frame.
    #[must_use]
    pub fn palm(&self) -> &[Convex] {
        &self.palm
    }

    /// The fingers on the negative and the positive side of the closing axis, hand frame, at opening zero.
    #[must_use]
    pub fn fingers(&self) -> &[Vec<Convex>; 2] {
        &self.fingers
    }
}

/// Whether a link is a descendant of another link.
fn below(robot: &Robot, mut link: usize, above: usize) -> bool {
    while let Some(parent) = robot.links()[link].parent() {
        if parent == above {
            return true;
        }
        link = parent;
    }
    false
}

fn middle(robot: &Robot, link: usize, pose: &Pose) -> Option<Vector3<f64>> {
    let shapes = &robot.links()[link].shapes();
    let sum: Vector3<f64> = shapes.iter().map(|s| (pose * s.center()).coords).sum();
    (!shapes.is_empty()).then(|| sum / shapes.len() as f64)
}

struct Face {
    lower: Point3<f64>,
    upper: Point3<f64>,
}

/// Returns the box around the innermost vertices of a finger on the given side of the closing axis, grip frame.
fn inner_face(finger: &[Convex], side: f64) -> Face {
    let corners = || finger.iter().flat_map(|s| s.points().iter().map(move |p| (p, s.radius())));
    let inward = |(p, radius): (&Point3<f64>, f64)| side * p.x - radius;
    let innermost = corners().map(inward).fold(f64::INFINITY, f64::min);
    let far = Point3::new(f64::INFINITY, f64::INFINITY, f64::INFINITY);
    let mut face = Face { lower: far, upper: -far };
    for corner in corners().filter(|c| inward(*c) <= innermost + PAD_DEPTH) {
        face.lower = face.lower.inf(corner.0);
        face.upper = face.upper.sup(corner.0);
    }
    (face.lower.x, face.upper.x) = (side * innermost, side * innermost);
    face
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A hand whose pads are 20 mm wide and 30 mm long, with 60 mm of stroke.
    fn hand(limits: [&str; 2], axes: [&str; 2]) -> Robot {
        let finger = |name: &str, y: f64| {
            format!(
                r#"<link name="{name}"><collision><origin xyz="0 {y} 0.035"/><geometry><box size="0.02 0.01 0.03"/>
                </geometry></collision></link>"#
            )
        };
        let joint = |name: &str, limit: &str, axis: &str| {
            format!(
                r#"<joint name="slide_{name}" type="prismatic"><parent link="hand"/><child link="{name}"/>
                <origin xyz="0 0 0.05"/><axis xyz="{axis}"/><limit {limit} effort="1" velocity="1"/></joint>"#
            )
        };
        let text = format!(
            r#"<robot name="r"><link name="base"/><link name="hand"><collision><geometry><box size="0.06 0.2 0.06"/>
            </geometry></collision></link><joint name="j" type="revolute"><parent link="base"/><child link="hand"/>
            <axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>{}{}{}{}</robot>"#,
            finger("left", 0.006),
            finger("right", -0.006),
            joint("left", limits[0], axes[0]),
            joint("right", limits[1], axes[1]),
        );
        Robot::from_urdf_str(&text, "r.urdf", None, "hand", None).unwrap()
    }

    fn keypoints() -> GripperKeypoints {
        GripperKeypoints {
            head: Vector3::new(0.0, 0.0, 0.09),
            tail: Vector3::new(0.0, 0.0, 0.05),
            side: Vector3::new(0.0, 0.05, 0.09),
        }
    }

    #[test]
    fn pads_and_stroke_are_read_off_the_fingers() {
        let both = r#"lower="0" upper="0.03""#;
        // Fingers can slide outwards or inwards with increasing joint values.
        let inwards = r#"lower="-0.03" upper="0""#;
        for robot in [hand([both, both], ["0 1 0", "0 -1 0"]), hand([both, inwards], ["0 1 0", "0 1 0"])] {
            let gripper = ParallelGripper::of_robot(&robot, &keypoints()).unwrap();
            assert!((gripper.pad()[0] - 0.01).abs() < 1e-9 && (gripper.pad()[1] - 0.015).abs() < 1e-9);
            assert!((gripper.stroke()[0] - 0.002).abs() < 1e-9 && (gripper.stroke()[1] - 0.062).abs() < 1e-9);
            let origin = gripper.grip().translation.vector;
            assert!((origin - Vector3::new(0.0, 0.0, 0.085)).norm() < 1e-9, "{origin}");
            assert!((gripper.grip().rotation * Vector3::x() - Vector3::y()).norm() < 1e-9);
            assert_eq!((gripper.palm().len(), gripper.fingers()[0].len(), gripper.fingers()[1].len()), (1, 1, 1));
            let mut q = vec![0.0; 3];
            gripper.set_opening(&mut q, 0.022);
            assert!((q[1].abs() - 0.01).abs() < 1e-9 && (q[2].abs() - 0.01).abs() < 1e-9, "{q:?}");
            // At opening zero the pads meet in the middle.
            let face = |shape: &Convex, side: f64| shape.points().iter().map(|p| side * p.y).fold(9.0, f64::min);
            assert!(face(&gripper.fingers()[0][0], -1.0).abs() < 1e-9);
            assert!(face(&gripper.fingers()[1][0], 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn what_is_no_parallel_gripper_is_refused() {
        let both = r#"lower="0" upper="0.03""#;
        let sideways = hand([both, both], ["1 0 0", "1 0 0"]);
        assert_eq!(ParallelGripper::of_robot(&sideways, &keypoints()).unwrap_err().field, "robot");
        let line = GripperKeypoints { side: Vector3::new(0.0, 0.0, 0.2), ..keypoints() };
        assert_eq!(ParallelGripper::frame(&line).unwrap_err().field, "tool_keypoints");
        let grip = Pose::identity();
        assert!(ParallelGripper::new(grip, [0.01, 0.0], [0.0, 0.1], vec![], [vec![], vec![]]).is_err());
        assert!(ParallelGripper::new(grip, [0.01, 0.01], [0.1, 0.1], vec![], [vec![], vec![]]).is_err());
        assert!(ParallelGripper::new(grip, [0.01, f64::NAN], [0.0, 0.1], vec![], [vec![], vec![]]).is_err());
    }
}

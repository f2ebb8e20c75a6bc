//! The joints between the base and a link: forward kinematics and Jacobian.

use nalgebra::{Matrix3, Rotation3, Translation3, Vector3};
use serde::{Deserialize, Serialize};

use crate::checked_when_read;
use crate::pose::{product, rotated, turned};
use crate::{Joint, JointCountError, JointKind, Link, Pose, RobotError};

/// A moving joint of a chain. Its origin includes the transforms of the fixed joints just before it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct ChainJoint {
    joint: usize,
    kind: JointKind,
    axis: Vector3<f64>,
    origin: Pose,
}

/// The moving joints between the base and one link.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(remote = "Self")]
pub struct Chain {
    joints: Vec<ChainJoint>,
    tail: Pose,
    link: usize,
    /// Length of a joint vector.
    entries: usize,
}

/// Result of forward kinematics along a chain, sufficient for the Jacobian of any point on its last link.
#[derive(Debug, Clone)]
pub struct ChainFrames {
    /// Unit axis of each chain joint, base frame.
    pub axes: Vec<Vector3<f64>>,
    /// A point on each axis, base frame (m).
    pub origins: Vec<Vector3<f64>>,
    /// Pose of the chain's link in the base frame.
    pub tip: Pose,
}

impl Default for ChainFrames {
    fn default() -> Self {
        Self { axes: Vec::new(), origins: Vec::new(), tip: Pose::identity() }
    }
}

checked_when_read!(Chain);

impl Chain {
    /// Validates a deserialized chain: the index of each joint must be within joint vectors.
    fn check(&self) -> Result<(), RobotError> {
        match self.joints.iter().find(|j| j.joint >= self.entries) {
            Some(j) => Err(RobotError::new("chain", format!("names joint {} of {}", j.joint, self.entries))),
            None => Ok(()),
        }
    }

    pub(crate) fn new(links: &[Link], joints: &[Joint], link: usize) -> Self {
        let mut path = vec![link];
        while let Some(parent) = links[path[path.len() - 1]].parent {
            path.push(parent);
        }
        path.reverse();
        let mut chain = Self { joints: Vec::new(), tail: Pose::identity(), link, entries: joints.len() };
        for &l in path.iter().skip(1) {
            chain.tail *= links[l].origin;
            if let Some(j) = links[l].joint {
                let joint = &joints[j];
                chain.joints.push(ChainJoint { joint: j, kind: joint.kind, axis: joint.axis, origin: chain.tail });
                chain.tail = Pose::identity();
            }
        }
        chain
    }

    /// Number of moving joints.
    #[must_use]
    pub fn len(&self) -> usize {
        self.joints.len()
    }

    /// Whether the chain has no moving joint.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.joints.is_empty()
    }

    /// Index in the joint vector of each chain joint.
    pub fn joint_indices(&self) -> impl Iterator<Item = usize> + '_ {
        self.joints.iter().map(|j| j.joint)
    }

    /// Motion type of chain joint `i`; `None` if the chain has fewer joints.
    #[must_use]
    pub fn kind(&self, i: usize) -> Option<JointKind> {
        self.joints.get(i).map(|j| j.kind)
    }

    /// Computes forward kinematics at the full joint vector `q`.
    ///
    /// # Errors
    /// `q` has the wrong length; `out` is then unchanged.
    pub fn forward(&self, q: &[f64], out: &mut ChainFrames) -> Result<(), JointCountError> {
        JointCountError::check(self.entries, q)?;
        out.axes.clear();
        out.origins.clear();
        let mut r = Matrix3::identity();
        let mut p = Vector3::zeros();
        for joint in &self.joints {
            p += rotated(&r, &joint.origin.translation.vector);
            r = product(&r, joint.origin.rotation.matrix());
            let axis = rotated(&r, &joint.axis);
            out.axes.push(axis);
            out.origins.push(p);
            let value = q[joint.joint];
            match joint.kind {
                JointKind::Revolute => r = turned(&r, &joint.axis, value),
                JointKind::Prismatic => p += axis * value,
            }
        }
        p += rotated(&r, &self.tail.translation.vector);
        r = product(&r, self.tail.rotation.matrix());
        out.tip = Pose::from_parts(Translation3::from(p), Rotation3::from_matrix_unchecked(r));
        Ok(())
    }

    /// Column of the linear Jacobian for joint `i` of the chain: the velocity of a point fixed to the chain's link
    /// while this joint moves at unit speed. `None` if the chain or `frames` has no joint `i`.
    #[must_use]
    pub fn linear(&self, frames: &ChainFrames, i: usize, point: &Vector3<f64>) -> Option<Vector3<f64>> {
        let (axis, origin) = (frames.axes.get(i)?, frames.origins.get(i)?);
        Some(match self.kind(i)? {
            JointKind::Revolute => axis.cross(&(point - origin)),
            JointKind::Prismatic => *axis,
        })
    }

    /// Angular velocity of the chain's link while chain joint `i` moves at unit speed; `None` as for [`Chain::linear`].
    #[must_use]
    pub fn angular(&self, frames: &ChainFrames, i: usize) -> Option<Vector3<f64>> {
        let axis = frames.axes.get(i)?;
        Some(match self.kind(i)? {
            JointKind::Revolute => *axis,
            JointKind::Prismatic => Vector3::zeros(),
        })
    }
}

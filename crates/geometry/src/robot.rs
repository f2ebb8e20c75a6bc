//! The kinematic tree: poses of links, the chain to the hand, and its Jacobian.

use std::path::Path;

use nalgebra::{Rotation3, Translation3, Vector3};
use serde::{Deserialize, Serialize};

use crate::{Convex, JointCountError, Pose, UrdfError, file, rotation_about, urdf};

/// How a joint moves its child.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum JointKind {
    /// Turns about its axis (rad); a continuous joint is one without limits.
    Revolute,
    /// Slides along its axis (m).
    Prismatic,
}

/// A joint that follows another: `value = multiplier * source + offset`. The source follows none: what a URDF writes as
/// a mimic of a mimic is composed when it is read.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Mimic {
    /// Index of the source in the joint vector; it has no mimic itself.
    pub source: usize,
    /// Factor.
    pub multiplier: f64,
    /// Summand, rad or m.
    pub offset: f64,
}

/// A moving joint. Its place in [`Robot::joints`] is its place in joint vectors.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Joint {
    /// Name in the URDF.
    pub name: String,
    /// How it moves.
    pub kind: JointKind,
    /// Unit axis in the joint frame.
    pub axis: Vector3<f64>,
    /// Lower limit (rad or m), minus infinity for a continuous joint.
    pub lower: f64,
    /// Upper limit (rad or m), infinity for a continuous joint.
    pub upper: f64,
    /// Velocity limit (rad/s or m/s), infinity where the URDF gives none.
    pub velocity: f64,
    /// The joint that it follows, if any.
    pub mimic: Option<Mimic>,
}

impl Joint {
    /// Transform of the child relative to the joint frame at value `q`.
    #[must_use]
    pub fn motion(&self, q: f64) -> Pose {
        match self.kind {
            JointKind::Revolute => Pose::from_parts(Translation3::identity(), rotation_about(&self.axis, q)),
            JointKind::Prismatic => Pose::from_parts(Translation3::from(self.axis * q), Rotation3::identity()),
        }
    }
}

/// A link. Links stand in an order in which parents come first; the base is link 0.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Link {
    /// Name in the URDF.
    pub name: String,
    /// Parent link; `None` for the base.
    pub parent: Option<usize>,
    /// Joint frame in the parent link.
    pub origin: Pose,
    /// Moving joint between parent and this link; `None` where it is fixed.
    pub joint: Option<usize>,
    /// Collision shapes in the link frame.
    pub shapes: Vec<Convex>,
}

/// A robot arm.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Robot {
    name: String,
    links: Vec<Link>,
    joints: Vec<Joint>,
    hand: usize,
    chain: Chain,
    /// Pairs of links (lower index first) that are never judged, sorted.
    allowed: Vec<(usize, usize)>,
}

impl Robot {
    /// Reads a URDF with its collision meshes, and the pairs that an SRDF disables.
    ///
    /// Mesh paths are taken relative to the URDF's folder (`package://` is stripped). Without an SRDF, neighbouring
    /// links are not judged against each other, nor pairs that overlap at the middle of all joint ranges.
    ///
    /// # Errors
    /// An unreadable or malformed file, an unknown link, a loop, inverted limits, a zero axis, or a missing mesh.
    pub fn from_urdf(
        path: impl AsRef<Path>,
        srdf: Option<&Path>,
        hand_link: &str,
        base_link: Option<&str>,
    ) -> Result<Self, UrdfError> {
        let path = path.as_ref();
        let mut robot = urdf::parse(&read_text(path)?, path, hand_link, base_link)?;
        if let Some(srdf) = srdf {
            robot.allowed = urdf::disabled_pairs(&read_text(srdf)?, srdf, &robot.links)?;
        }
        robot.allow_neighbours(srdf.is_none());
        Ok(robot)
    }

    /// The same from text; `file` names it in errors and is where relative mesh paths begin. `srdf` is text too.
    ///
    /// # Errors
    /// As [`Robot::from_urdf`].
    pub fn from_urdf_str(
        text: &str,
        file: impl AsRef<Path>,
        srdf: Option<&str>,
        hand_link: &str,
        base_link: Option<&str>,
    ) -> Result<Self, UrdfError> {
        let mut robot = urdf::parse(text, file.as_ref(), hand_link, base_link)?;
        if let Some(srdf) = srdf {
            robot.allowed = urdf::disabled_pairs(srdf, Path::new("SRDF"), &robot.links)?;
        }
        robot.allow_neighbours(srdf.is_none());
        Ok(robot)
    }

    pub(crate) fn assemble(name: String, links: Vec<Link>, joints: Vec<Joint>, hand: usize) -> Self {
        let chain = Chain::new(&links, &joints, hand);
        Self { name, links, joints, hand, chain, allowed: Vec::new() }
    }

    /// Neighbours share a joint and so touch by construction.
    fn allow_neighbours(&mut self, and_overlapping: bool) {
        for (i, link) in self.links.iter().enumerate() {
            // Links without shapes stand between two that touch just the same.
            let mut above = link.parent;
            while let Some(p) = above {
                self.allowed.push((p, i));
                if !self.links[p].shapes.is_empty() {
                    break;
                }
                above = self.links[p].parent;
            }
        }
        if and_overlapping {
            let mut middle: Vec<f64> = (0..self.joints.len()).map(|j| self.middle_of_range(j)).collect();
            self.apply_mimic(&mut middle);
            let mut poses = Vec::new();
            self.place_links(&middle, &mut poses);
            let overlapping = crate::collision::overlapping_pairs(self, poses);
            self.allowed.extend(overlapping);
        }
        self.allowed.sort_unstable();
        self.allowed.dedup();
    }

    /// Middle of an independent joint's range; the value nearest to zero where an end is open.
    fn middle_of_range(&self, j: usize) -> f64 {
        let joint = &self.joints[j];
        let (lower, upper) = match self.range(j) {
            Some((lower, upper)) if lower <= upper => (lower, upper),
            _ => (joint.lower, joint.upper),
        };
        if lower.is_finite() && upper.is_finite() { 0.5 * (lower + upper) } else { 0.0_f64.max(lower).min(upper) }
    }

    /// Name in the URDF.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Links, parents first; link 0 is the base.
    #[must_use]
    pub fn links(&self) -> &[Link] {
        &self.links
    }

    /// Moving joints, in the order of joint vectors (that of the URDF).
    #[must_use]
    pub fn joints(&self) -> &[Joint] {
        &self.joints
    }

    /// Index of the hand link.
    #[must_use]
    pub fn hand(&self) -> usize {
        self.hand
    }

    /// The chain from base to hand.
    #[must_use]
    pub fn chain(&self) -> &Chain {
        &self.chain
    }

    /// The chain from base to any link; `None` where there is no such link.
    #[must_use]
    pub fn chain_to(&self, link: usize) -> Option<Chain> {
        (link < self.links.len()).then(|| Chain::new(&self.links, &self.joints, link))
    }

    /// Pairs of links that are never judged against each other.
    #[must_use]
    pub fn allowed_pairs(&self) -> &[(usize, usize)] {
        &self.allowed
    }

    /// Index of a link by name.
    #[must_use]
    pub fn link_index(&self, name: &str) -> Option<usize> {
        self.links.iter().position(|l| l.name == name)
    }

    /// The independent joint that moves joint `j`, with factor and summand: `value = factor * source + offset`;
    /// `None` where there is no such joint.
    #[must_use]
    pub fn drive(&self, j: usize) -> Option<Mimic> {
        let joint = self.joints.get(j)?;
        Some(joint.mimic.unwrap_or(Mimic { source: j, multiplier: 1.0, offset: 0.0 }))
    }

    /// Sets mimic joints to what their sources make of them; entries of independent joints stay, and so do those of
    /// mimics whose source `q` does not reach.
    pub fn apply_mimic(&self, q: &mut [f64]) {
        for (i, joint) in self.joints.iter().enumerate().take(q.len()) {
            if let Some(m) = joint.mimic
                && let Some(source) = q.get(m.source)
            {
                q[i] = m.multiplier * source + m.offset;
            }
        }
    }

    /// Range (rad or m) in which an independent joint keeps its own limits and those of all joints that follow it. It
    /// is empty (lower above upper) where they contradict each other, and `None` where there is no such joint.
    #[must_use]
    pub fn range(&self, source: usize) -> Option<(f64, f64)> {
        let own = self.joints.get(source)?;
        let (mut lower, mut upper) = (own.lower, own.upper);
        for joint in &self.joints {
            let Some(m) = joint.mimic.filter(|m| m.source == source && m.multiplier != 0.0) else { continue };
            let ends = [joint.lower, joint.upper].map(|limit| (limit - m.offset) / m.multiplier);
            lower = lower.max(ends[0].min(ends[1]));
            upper = upper.min(ends[0].max(ends[1]));
        }
        Some((lower, upper))
    }

    /// Pose of every link in the base frame, written into `out`; `q` has one entry a joint.
    ///
    /// # Errors
    /// `q` has another length; `out` is as it was then.
    pub fn link_poses(&self, q: &[f64], out: &mut Vec<Pose>) -> Result<(), JointCountError> {
        JointCountError::check(self.joints.len(), q)?;
        self.place_links(q, out);
        Ok(())
    }

    fn place_links(&self, q: &[f64], out: &mut Vec<Pose>) {
        out.clear();
        for link in &self.links {
            let pose = match link.parent {
                None => Pose::identity(),
                Some(p) => {
                    let frame = out[p] * link.origin;
                    match link.joint {
                        Some(j) => frame * self.joints[j].motion(q[j]),
                        None => frame,
                    }
                }
            };
            out.push(pose);
        }
    }

    /// Pose of one link in the base frame; `q` has one entry a joint. `None` where it has another length, or where there
    /// is no such link.
    #[must_use]
    pub fn link_pose(&self, q: &[f64], link: usize) -> Option<Pose> {
        let mut frames = ChainFrames::default();
        let moved = if link == self.hand {
            self.chain.forward(q, &mut frames)
        } else {
            self.chain_to(link)?.forward(q, &mut frames)
        };
        moved.ok().map(|()| frames.tip)
    }
}

fn read_text(path: &Path) -> Result<String, UrdfError> {
    file::read_text(path).map_err(|e| UrdfError::new(&path.display().to_string(), "file", e))
}

/// One moving joint of a chain, with the fixed transforms before it folded in.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct ChainJoint {
    joint: usize,
    kind: JointKind,
    axis: Vector3<f64>,
    origin: Pose,
}

/// The moving joints between the base and one link.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Chain {
    joints: Vec<ChainJoint>,
    tail: Pose,
    link: usize,
    /// Entries of a joint vector.
    entries: usize,
}

/// What a forward pass along a chain leaves behind: enough for the Jacobian of any point on its last link.
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

impl Chain {
    fn new(links: &[Link], joints: &[Joint], link: usize) -> Self {
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

    /// Whether nothing on the chain moves.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.joints.is_empty()
    }

    /// Place in the joint vector of each chain joint.
    pub fn joint_indices(&self) -> impl Iterator<Item = usize> + '_ {
        self.joints.iter().map(|j| j.joint)
    }

    /// Kind of chain joint `i`; `None` where the chain is shorter.
    #[must_use]
    pub fn kind(&self, i: usize) -> Option<JointKind> {
        self.joints.get(i).map(|j| j.kind)
    }

    /// Forward pass at the full joint vector `q`.
    ///
    /// # Errors
    /// `q` has another length than the robot's joint vectors; `out` is as it was then.
    pub fn forward(&self, q: &[f64], out: &mut ChainFrames) -> Result<(), JointCountError> {
        JointCountError::check(self.entries, q)?;
        out.axes.clear();
        out.origins.clear();
        let mut r = Rotation3::identity();
        let mut p = Vector3::zeros();
        for joint in &self.joints {
            p += r * joint.origin.translation.vector;
            r *= joint.origin.rotation;
            let axis = r * joint.axis;
            out.axes.push(axis);
            out.origins.push(p);
            let value = q[joint.joint];
            match joint.kind {
                JointKind::Revolute => r *= turn(&joint.axis, value),
                JointKind::Prismatic => p += axis * value,
            }
        }
        p += r * self.tail.translation.vector;
        r *= self.tail.rotation;
        out.tip = Pose::from_parts(Translation3::from(p), r);
        Ok(())
    }

    /// Linear velocity of a point fixed to the chain's link per unit of chain joint `i`; `None` where the chain, or what
    /// a forward pass left in `frames`, is shorter.
    #[must_use]
    pub fn linear(&self, frames: &ChainFrames, i: usize, point: &Vector3<f64>) -> Option<Vector3<f64>> {
        let (axis, origin) = (frames.axes.get(i)?, frames.origins.get(i)?);
        Some(match self.kind(i)? {
            JointKind::Revolute => axis.cross(&(point - origin)),
            JointKind::Prismatic => *axis,
        })
    }

    /// Angular velocity of the chain's link per unit of chain joint `i`; `None` as for [`Chain::linear`].
    #[must_use]
    pub fn angular(&self, frames: &ChainFrames, i: usize) -> Option<Vector3<f64>> {
        let axis = frames.axes.get(i)?;
        Some(match self.kind(i)? {
            JointKind::Revolute => *axis,
            JointKind::Prismatic => Vector3::zeros(),
        })
    }
}

/// Rotation about a unit axis; about z, as nearly every URDF arm writes it, without the general product.
fn turn(axis: &Vector3<f64>, angle: f64) -> Rotation3<f64> {
    if axis.x == 0.0 && axis.y == 0.0 {
        let (s, c) = (angle * axis.z).sin_cos();
        return Rotation3::from_matrix_unchecked(nalgebra::Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0));
    }
    rotation_about(axis, angle)
}

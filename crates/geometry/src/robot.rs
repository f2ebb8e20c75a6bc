//! The kinematic tree: poses of links, and the pairs of links that are checked for collision.

use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use nalgebra::{Rotation3, Translation3};
use serde::{Deserialize, Serialize};

use crate::checked_when_read;
use crate::pose::{product, rotated, turned};
use crate::self_collisions::CloseLinks;
use crate::{
    Chain, ChainFrames, Cover, Description, Inertia, Joint, JointCountError, JointKind, Link, Mimic, Pose,
    RobotBuilder, RobotError, UrdfError, checked_pairs, file, srdf, urdf, xml,
};

/// A robot arm: a tree of links and joints.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(remote = "Self")]
pub struct Robot {
    name: String,
    links: Vec<Link>,
    joints: Vec<Joint>,
    hand: usize,
    chain: Chain,
    /// The joints that planning moves; `None` stands for those of the chain.
    #[serde(default)]
    planned: Option<Vec<usize>>,
    /// Sorted pairs of links (lower index first) that are never checked for collision.
    allowed: Vec<(usize, usize)>,
    /// The pairs of `allowed` that are unchecked only because they overlap in almost all configurations.
    #[serde(default)]
    unchecked: Vec<(usize, usize)>,
    /// Mass properties of the object that the hand carries, in the frame of the hand's link.
    #[serde(default)]
    payload: Option<Inertia>,
    /// Spheres around the links.
    #[serde(skip)]
    cover: Computed<Arc<Cover>>,
    /// Checked pairs of links that are often or always close.
    #[serde(skip)]
    pub(crate) close: Computed<Vec<CloseLinks>>,
}

/// A value that is computed on first use and ignored in comparisons.
#[derive(Debug, Clone)]
pub(crate) struct Computed<T>(pub OnceLock<T>);

impl<T> Default for Computed<T> {
    fn default() -> Self {
        Self(OnceLock::new())
    }
}

impl<T> PartialEq for Computed<T> {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

checked_when_read!(Robot);

impl Robot {
    /// Reads a URDF with its collision meshes, and the pairs of links that an SRDF disables.
    ///
    /// Mesh paths are relative to the URDF's folder. Files of packages (`package://`) are searched in `package_dirs`,
    /// which are folders of packages or packages themselves, in the folders that the environment variables
    /// `ROS_PACKAGE_PATH` and `AMENT_PREFIX_PATH` list, and in the folders above the URDF.
    /// Without an SRDF, neighbouring links and links that overlap in almost all configurations
    /// ([`Robot::self_collisions`]) are not checked against each other.
    ///
    /// Each mesh becomes its convex hull. With `mesh_tolerance` (m), a mesh whose hull has points farther than this from
    /// the mesh and its interior becomes up to 16 convex parts, which together contain the mesh and its interior.
    ///
    /// # Errors
    /// `mesh_tolerance` is not positive, a file is unreadable or malformed, a link is unknown, the links form a loop, limits are missing or inverted, an
    /// axis is zero, or a mesh is missing.
    pub fn from_urdf(
        path: impl AsRef<Path>,
        srdf: Option<&Path>,
        hand_link: &str,
        base_link: Option<&str>,
        package_dirs: &[PathBuf],
        mesh_tolerance: Option<f64>,
    ) -> Result<Self, UrdfError> {
        let path = path.as_ref();
        if let Some(tolerance) = mesh_tolerance.filter(|t| !(t.is_finite() && *t > 0.0)) {
            let message = format!("must be a positive distance in metres, not {tolerance}");
            return Err(UrdfError::new(&path.display().to_string(), "mesh_tolerance", message));
        }
        let text = read_text(path)?;
        let srdf = srdf.map(|srdf| Ok((read_text(srdf)?, srdf.display().to_string()))).transpose()?;
        Self::of_texts(
            &text,
            path,
            srdf.as_ref().map(|(text, file)| (text.as_str(), file.as_str())),
            hand_link,
            base_link,
            package_dirs,
            mesh_tolerance,
        )
    }

    /// Reads a robot from the text of a URDF and of an SRDF. `file` is the name in errors, and relative mesh paths
    /// start at its folder.
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
        Self::of_texts(text, file.as_ref(), srdf.map(|text| (text, "SRDF")), hand_link, base_link, &[], None)
    }

    /// Creates the robot from the text of a URDF, and from the text and file name of an SRDF.
    fn of_texts(
        text: &str,
        path: &Path,
        srdf: Option<(&str, &str)>,
        hand_link: &str,
        base_link: Option<&str>,
        package_dirs: &[PathBuf],
        mesh_tolerance: Option<f64>,
    ) -> Result<Self, UrdfError> {
        let description = Description::parse(text, &path.display().to_string())?;
        let mut robot = urdf::build(&description, path, hand_link, base_link, package_dirs, mesh_tolerance)?;
        if let Some((text, file)) = srdf {
            let known = description.links.iter().map(|l| l.name.as_str()).collect();
            robot.allowed = srdf::disabled_pairs(text, file, &known, &robot.links)?;
        }
        robot.allow_neighbours(srdf.is_none());
        Ok(robot)
    }

    /// Returns a builder for a robot defined in code; links are added with the base first.
    ///
    /// ```
    /// use gensim2_geometry::{Joint, Link, Pose, Robot};
    /// use nalgebra::Vector3;
    ///
    /// let hinge = Joint::revolute("hinge", Vector3::y()).limits(-3.0, 3.0).velocity(2.0);
    /// let robot = Robot::builder("pendulum")
    ///     .link(Link::base("base"))
    ///     .link(Link::below("base", "bob").at(Pose::translation(0.0, 0.0, 1.0)).moved_by(hinge))
    ///     .build("bob")?;
    /// assert_eq!(robot.joints()[0].upper(), 3.0);
    /// # Ok::<(), gensim2_geometry::RobotError>(())
    /// ```
    pub fn builder(name: impl Into<String>) -> RobotBuilder {
        RobotBuilder::new(name.into())
    }

    /// Creates a robot from valid links and joints.
    pub(crate) fn assemble(name: String, links: Vec<Link>, joints: Vec<Joint>, hand: usize) -> Self {
        let chain = Chain::new(&links, &joints, hand);
        let (allowed, unchecked) = (Vec::new(), Vec::new());
        let (cover, close) = (Computed::default(), Computed::default());
        Self { name, links, joints, hand, chain, planned: None, allowed, unchecked, payload: None, cover, close }
    }

    /// Creates a robot from parts that are not validated. Links are never checked against each other if they are a pair
    /// of `allowed`, are neighbours, or overlap in almost all configurations.
    pub(crate) fn of_parts(
        name: String,
        links: Vec<Link>,
        joints: Vec<Joint>,
        hand: usize,
        allowed: Vec<(usize, usize)>,
    ) -> Result<Self, RobotError> {
        // The chain is empty until the tree has been validated.
        let (chain, unchecked) = (Chain::default(), Vec::new());
        let (cover, close) = (Computed::default(), Computed::default());
        let mut robot =
            Self { name, links, joints, hand, chain, planned: None, allowed, unchecked, payload: None, cover, close };
        robot.check_tree()?;
        robot.chain = Chain::new(&robot.links, &robot.joints, hand);
        robot.allow_neighbours(true);
        robot.check().map(|()| robot)
    }

    /// Validates that the links form a tree with parents first, and that each joint moves a link.
    fn check_tree(&self) -> Result<(), RobotError> {
        let fail = |field: &str, message: String| Err(RobotError::new(field, message));
        let unique = |names: &mut Vec<&str>| {
            names.sort_unstable();
            names.windows(2).find(|pair| pair[0] == pair[1]).map(|pair| pair[0].to_owned())
        };
        if let Some(name) = unique(&mut self.links.iter().map(Link::name).collect()) {
            return fail(&format!("link {name}"), "is used twice; names must be unique".to_owned());
        }
        if let Some(name) = unique(&mut self.joints.iter().map(Joint::name).collect()) {
            return fail(&format!("joint {name}"), "is used twice; names must be unique".to_owned());
        }
        let mut moved = vec![false; self.joints.len()];
        for (l, link) in self.links.iter().enumerate() {
            link.check()?;
            let field = format!("link {}", link.name);
            if (l == 0) != link.parent.is_none() || link.parent.is_some_and(|p| p >= l) {
                return fail(&field, "must come after its parent, and the base first".to_owned());
            }
            if let Some(j) = link.joint
                && (l == 0 || j >= moved.len() || std::mem::replace(&mut moved[j], true))
            {
                return fail(&field, "must have its own parent joint".to_owned());
            }
        }
        for (joint, moves) in self.joints.iter().zip(moved) {
            joint.check()?;
            let follows_one = |m: Mimic| self.joints.get(m.source).is_some_and(|source| source.mimic.is_none());
            if !moves || joint.mimic.is_some_and(|m| !follows_one(m)) {
                let message = "must move a link; a joint that it mimics must not itself mimic another".to_owned();
                return fail(&format!("joint {}", joint.name), message);
            }
        }
        if self.hand >= self.links.len() {
            return fail("hand", format!("is link {} of {}", self.hand, self.links.len()));
        }
        Ok(())
    }

    /// Validates all parts.
    fn check(&self) -> Result<(), RobotError> {
        self.check_tree()?;
        let fail = |field: &str, message: &str| Err(RobotError::new(field, message));
        if self.chain != Chain::new(&self.links, &self.joints, self.hand) {
            return fail("chain", "is not that of the links");
        }
        if let Some(planned) = &self.planned {
            self.check_planned(planned)?;
        }
        if self.unchecked.iter().any(|pair| self.allowed.binary_search(pair).is_err()) {
            return fail("unchecked pairs", "must be among the allowed pairs");
        }
        let in_order = self.allowed.windows(2).all(|pair| pair[0] < pair[1]);
        if !in_order || self.allowed.iter().any(|(a, b)| a > b || *b >= self.links.len()) {
            return fail("allowed pairs", "must be pairs of links, in order");
        }
        self.payload.iter().try_for_each(Inertia::check_payload)
    }

    /// Validates a list of joints that planning moves.
    fn check_planned(&self, planned: &[usize]) -> Result<(), RobotError> {
        let fail = |message: String| Err(RobotError::new("joints", message));
        if planned.is_empty() {
            return fail("must name at least one joint".to_owned());
        }
        for (k, j) in planned.iter().enumerate() {
            let Some(joint) = self.joints.get(*j) else {
                return fail(format!("names joint {j} of {}", self.joints.len()));
            };
            if planned[..k].contains(j) {
                return fail(format!("names {} twice", joint.name));
            }
            if let Some(mimic) = joint.mimic {
                let source = &self.joints[mimic.source].name;
                return fail(format!("{} follows {source}; name {source} instead", joint.name));
            }
        }
        Ok(())
    }

    /// Disables checks between neighbours, which touch by construction. With `and_overlapping`, also disables those
    /// between links that overlap in almost all configurations.
    pub(crate) fn allow_neighbours(&mut self, and_overlapping: bool) {
        self.allowed.extend(self.neighbours());
        self.allowed.sort_unstable();
        self.allowed.dedup();
        if and_overlapping {
            self.unchecked = self.always_overlapping(&checked_pairs(self, |_, _| true));
            self.allowed.extend_from_slice(&self.unchecked);
            self.allowed.sort_unstable();
        }
    }

    /// Returns the pairs of links (lower index first) that a joint connects, or that only links without shapes separate.
    pub(crate) fn neighbours(&self) -> Vec<(usize, usize)> {
        let mut out = Vec::new();
        for (i, link) in self.links.iter().enumerate() {
            let mut above = link.parent;
            while let Some(p) = above {
                out.push((p, i));
                if !self.links[p].shapes.is_empty() {
                    break;
                }
                above = self.links[p].parent;
            }
        }
        out
    }

    /// Name of the robot in the URDF.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Links, parents first; link 0 is the base.
    #[must_use]
    pub fn links(&self) -> &[Link] {
        &self.links
    }

    /// Moving joints, in the order of joint vectors, which is the order in the URDF.
    #[must_use]
    pub fn joints(&self) -> &[Joint] {
        &self.joints
    }

    /// Returns the robot with an object in its hand, which replaces an earlier payload; `None` removes the payload. Only
    /// the dynamics change: the shape of the object is a body of the scene.
    ///
    /// # Errors
    /// A number is not finite, the mass is negative, the centre of mass is more than 1,000 m away, or the tensor is not
    /// symmetric and positive semidefinite.
    pub fn with_payload(&self, payload: Option<Inertia>) -> Result<Self, RobotError> {
        payload.iter().try_for_each(Inertia::check_payload)?;
        Ok(Self { payload, ..self.clone() })
    }

    /// Mass properties of the object that the hand carries, in the frame of the hand's link.
    #[must_use]
    pub fn payload(&self) -> Option<&Inertia> {
        self.payload.as_ref()
    }

    /// Index of the hand's link.
    #[must_use]
    pub fn hand(&self) -> usize {
        self.hand
    }

    /// The chain of joints from the base to the hand.
    #[must_use]
    pub fn chain(&self) -> &Chain {
        &self.chain
    }

    /// Returns the robot with the joints that planning moves, such as those of both arms. By default, planning moves the
    /// joints of the chain from the base to the hand. All other joints keep their values during a motion.
    ///
    /// ```
    /// use gensim2_geometry::{Joint, Link, Robot};
    /// use nalgebra::Vector3;
    ///
    /// let hinge = |name: &str| Joint::revolute(name, Vector3::z()).limits(-1.0, 1.0).velocity(1.0);
    /// let robot = Robot::builder("two arms")
    ///     .link(Link::base("base"))
    ///     .link(Link::below("base", "left").moved_by(hinge("one")))
    ///     .link(Link::below("base", "right").moved_by(hinge("two")))
    ///     .build("left")?;
    /// assert_eq!(robot.planned(), [0]);
    /// assert_eq!(robot.clone().planning(&["two", "one"])?.planned(), [1, 0]);
    /// assert!(robot.planning(&["three"]).is_err());
    /// # Ok::<(), gensim2_geometry::RobotError>(())
    /// ```
    ///
    /// # Errors
    /// The list is empty, or a name is unknown, is used twice, or belongs to a mimic joint.
    pub fn planning<S: AsRef<str>>(mut self, joints: &[S]) -> Result<Self, RobotError> {
        let index = |name: &S| {
            let name = name.as_ref();
            self.joints.iter().position(|joint| joint.name == name).ok_or_else(|| {
                let known: Vec<&str> = self.joints.iter().map(Joint::name).collect();
                RobotError::new("joints", format!("{name:?} is not a moving joint; joints: {}", known.join(", ")))
            })
        };
        let planned = joints.iter().map(index).collect::<Result<Vec<usize>, _>>()?;
        self.check_planned(&planned)?;
        self.planned = Some(planned);
        Ok(self)
    }

    /// Indices of the independent joints that planning moves, in the order of their variables.
    #[must_use]
    pub fn planned(&self) -> Vec<usize> {
        self.planned.clone().unwrap_or_else(|| self.movers(&self.chain))
    }

    /// Indices of the independent joints that move the link of a chain of this robot, from the base to the link.
    #[must_use]
    pub fn movers(&self, chain: &Chain) -> Vec<usize> {
        let mut out = Vec::new();
        for drive in chain.joint_indices().filter_map(|j| self.drive(j)).filter(|d| d.multiplier != 0.0) {
            if !out.contains(&drive.source) {
                out.push(drive.source);
            }
        }
        out
    }

    /// The chain of joints from the base to a link; `None` if the link does not exist.
    #[must_use]
    pub fn chain_to(&self, link: usize) -> Option<Chain> {
        (link < self.links.len()).then(|| Chain::new(&self.links, &self.joints, link))
    }

    /// Pairs of links (lower index first) that are not checked only because they overlap in almost all configurations;
    /// an SRDF would tell whether they may touch.
    #[must_use]
    pub fn unchecked_pairs(&self) -> &[(usize, usize)] {
        &self.unchecked
    }

    /// Pairs of links that are never checked against each other.
    #[must_use]
    pub fn allowed_pairs(&self) -> &[(usize, usize)] {
        &self.allowed
    }

    /// Spheres around the links, computed on first use.
    #[must_use]
    pub fn cover(&self) -> &Cover {
        self.cover.0.get_or_init(|| Arc::new(Cover::of(self)))
    }

    /// Index of a link by name.
    #[must_use]
    pub fn link_index(&self, name: &str) -> Option<usize> {
        self.links.iter().position(|l| l.name == name)
    }

    /// Relation of joint `j` to the independent joint that moves it: `value = factor * source + offset`; `None` if
    /// joint `j` does not exist.
    #[must_use]
    pub fn drive(&self, j: usize) -> Option<Mimic> {
        let joint = self.joints.get(j)?;
        Some(joint.mimic.unwrap_or(Mimic { source: j, multiplier: 1.0, offset: 0.0 }))
    }

    /// Sets mimic joints to the values that follow from their sources. Independent joints are unchanged, and so are
    /// mimic joints whose source lies beyond the end of `q`.
    pub fn apply_mimic(&self, q: &mut [f64]) {
        for (i, joint) in self.joints.iter().enumerate().take(q.len()) {
            if let Some(m) = joint.mimic
                && let Some(source) = q.get(m.source)
            {
                q[i] = m.multiplier * source + m.offset;
            }
        }
    }

    /// Range (rad or m) in which an independent joint keeps its own limits and those of all joints that follow it. The
    /// range is empty (lower above upper) if they contradict each other, and `None` if there is no such joint.
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

    /// Writes the pose of every link in the base frame into `out`; `q` has one entry for each joint.
    ///
    /// # Errors
    /// `q` has the wrong length; `out` is then unchanged.
    pub fn link_poses(&self, q: &[f64], out: &mut Vec<Pose>) -> Result<(), JointCountError> {
        JointCountError::check(self.joints.len(), q)?;
        self.place_links(q, out);
        Ok(())
    }

    pub(crate) fn place_links(&self, q: &[f64], out: &mut Vec<Pose>) {
        out.clear();
        for link in &self.links {
            let pose = match link.parent {
                None => Pose::identity(),
                Some(p) => {
                    let above = out[p].rotation.matrix();
                    let mut at = rotated(above, &link.origin.translation.vector) + out[p].translation.vector;
                    let mut r = product(above, link.origin.rotation.matrix());
                    if let Some(j) = link.joint {
                        let axis = &self.joints[j].axis;
                        match self.joints[j].kind {
                            JointKind::Revolute => r = turned(&r, axis, q[j]),
                            JointKind::Prismatic => at += rotated(&r, &(axis * q[j])),
                        }
                    }
                    Pose::from_parts(Translation3::from(at), Rotation3::from_matrix_unchecked(r))
                }
            };
            out.push(pose);
        }
    }

    /// Returns the pose of a link in the base frame; `q` has one entry for each joint. `None` if `q` has the wrong
    /// length or the link does not exist.
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

    /// Returns the Jacobian of a chain's link by joints, at the frames that [`Chain::forward`] computed: the linear
    /// velocity of the link's origin and its angular velocity (base frame) while a joint moves at unit speed. The motion
    /// of mimic joints belongs to their sources; their own columns are zero.
    #[must_use]
    pub fn jacobian(&self, chain: &Chain, frames: &ChainFrames) -> Vec<[f64; 6]> {
        let mut columns = vec![[0.0; 6]; self.joints.len()];
        let tip = frames.tip.translation.vector;
        for (i, j) in chain.joint_indices().enumerate() {
            let (Some(linear), Some(angular)) = (chain.linear(frames, i, &tip), chain.angular(frames, i)) else {
                continue;
            };
            let Some(drive) = self.drive(j) else { continue };
            for (entry, speed) in columns[drive.source].iter_mut().zip(linear.iter().chain(&angular)) {
                *entry += drive.multiplier * speed;
            }
        }
        columns
    }
}

fn read_text(path: &Path) -> Result<String, UrdfError> {
    let name = path.display().to_string();
    let content = file::read(path, file::MAX_XML).map_err(|e| UrdfError::new(&name, "file", e))?;
    xml::decode(&content, &name)
}

//! Surroundings of a robot: bodies, and the joints of objects that move them. Scenes are immutable and share their
//! data, so that derived scenes are cheap.

use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

use gensim2_geometry::{Inertia, Pose, Robot, checked_when_read, points_within};
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::compiled::Compiled;
use super::{Bodies, Checker, joint_motion};
use crate::{Body, KeypointProblem, KeypointProblemBuilder, ObjectJoint, ProblemError, Role, SolverConfig};

/// A joint of an object, and the names of the bodies that it moves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SceneJoint {
    pub(crate) name: String,
    pub(crate) joint: ObjectJoint,
    pub(crate) moves: Vec<String>,
}

impl SceneJoint {
    /// Creates a joint that moves the named bodies.
    #[must_use]
    pub fn new(name: impl Into<String>, joint: ObjectJoint, moves: Vec<String>) -> Self {
        Self { name: name.into(), joint, moves }
    }

    /// Unique name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Axis, current value and range of the joint.
    #[must_use]
    pub fn joint(&self) -> &ObjectJoint {
        &self.joint
    }

    /// Names of the bodies that the joint moves.
    #[must_use]
    pub fn moves(&self) -> &[String] {
        &self.moves
    }
}

/// A robot and its surroundings. Clones share everything; methods that change a scene return a new one.
///
/// ```
/// use std::sync::Arc;
///
/// use gensim2_geometry::{Convex, Joint, Link, Pose, Robot};
/// use gensim2_kpam::{Body, ObjectJoint, ObjectJointKind, Role, Scene, SceneJoint};
/// use nalgebra::Vector3;
///
/// let cube = || Convex::cuboid([0.05; 3], &Pose::identity());
/// let slide = Joint::prismatic("x", Vector3::x()).limits(-2.0, 2.0).velocity(1.0);
/// let robot = Robot::builder("cart")
///     .link(Link::base("rail"))
///     .link(Link::below("rail", "cart").moved_by(slide).shape(cube()?))
///     .build("cart")?;
/// let drawer = Body::builder("drawer", Role::Rigid).shape(cube()?).pose(Pose::translation(1.0, 0.0, 0.0)).build()?;
/// let rail = ObjectJoint::new(ObjectJointKind::Prismatic, Vector3::zeros(), Vector3::x(), 0.0, [0.0, 0.5])?;
/// let scene = Scene::new(Arc::new(robot), vec![drawer], vec![SceneJoint::new("rail", rail, vec!["drawer".into()])])?;
/// assert!(scene.checker().hits(&[0.95])?);
/// assert!(!scene.with_joint("rail", 0.3)?.checker().hits(&[0.95])?);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(remote = "Self")]
pub struct Scene {
    robot: Arc<Robot>,
    bodies: Bodies,
    joints: Arc<[SceneJoint]>,
    #[serde(skip)]
    compiled: Arc<OnceLock<Compiled>>,
}

checked_when_read!(Scene);

impl Scene {
    /// Creates a scene.
    ///
    /// # Errors
    /// A name is repeated, or a joint moves an unknown body or one that another joint moves.
    pub fn new(robot: Arc<Robot>, bodies: Vec<Body>, joints: Vec<SceneJoint>) -> Result<Self, ProblemError> {
        let scene = Self::of_parts(robot, bodies.into(), joints.into());
        scene.check().map(|()| scene)
    }

    fn of_parts(robot: Arc<Robot>, bodies: Bodies, joints: Arc<[SceneJoint]>) -> Self {
        Self { robot, bodies, joints, compiled: Arc::default() }
    }

    /// The scene prepared for fast collision checks; created on first use, and shared by clones.
    pub(crate) fn compiled(&self) -> &Compiled {
        self.compiled.get_or_init(|| Compiled::new(self))
    }

    /// Whether collision checks start immediately. The first check prepares the scene, which takes seconds for bodies
    /// with millions of triangles.
    #[must_use]
    pub fn is_ready(&self) -> bool {
        self.compiled.get().is_some()
    }

    fn check(&self) -> Result<(), ProblemError> {
        let (bodies, joints) = (&self.bodies, &self.joints);
        bodies.check_names(&self.robot)?;
        for (i, joint) in joints.iter().enumerate() {
            if joints[..i].iter().any(|j| j.name == joint.name) {
                let message = format!("{:?} is used already; names must be unique", joint.name);
                return Err(ProblemError::new(format!("joints[{i}].name"), message));
            }
            for name in &joint.moves {
                if !bodies.iter().any(|b| b.name == *name) {
                    return Err(ProblemError::new(format!("joints[{i}].moves"), format!("{name:?} is not a body")));
                }
                if joints[..i].iter().any(|j| j.moves.contains(name)) {
                    let message = format!("{name:?} is already moved by another joint");
                    return Err(ProblemError::new(format!("joints[{i}].moves"), message));
                }
            }
        }
        Ok(())
    }

    /// Returns the scene of a problem; its bodies are shared, and its joint is named `joint`.
    pub(crate) fn of(problem: &KeypointProblem) -> Self {
        let moves = problem.bodies.iter().filter(|b| b.role == Role::MovingLink).map(|b| b.name.clone());
        let joint = problem.joint.map(|joint| SceneJoint { name: "joint".to_owned(), joint, moves: moves.collect() });
        let scene = Self::of_parts(Arc::clone(&problem.robot), problem.bodies.clone(), joint.into_iter().collect());
        Self { compiled: Arc::clone(&problem.compiled), ..scene }
    }

    /// The robot.
    #[must_use]
    pub fn robot(&self) -> &Arc<Robot> {
        &self.robot
    }

    /// Marks points (base frame, m) that lie within `clearance` of the robot at joints `q` or of its attached bodies,
    /// and are therefore no obstacle in a camera's point cloud.
    ///
    /// # Errors
    /// `q` does not have one entry for each joint.
    pub fn own_points(&self, q: &[f64], points: &[Point3<f64>], clearance: f64) -> Result<Vec<bool>, ProblemError> {
        let mut poses = Vec::new();
        self.robot.link_poses(q, &mut poses).map_err(|e| ProblemError::new("q", e.to_string()))?;
        let links = self.robot.links().iter().zip(&poses);
        let hand = poses[self.robot.hand()];
        let held = self.bodies.iter().filter(|b| b.role == Role::Attached);
        let shapes = links
            .flat_map(|(link, pose)| link.shapes().iter().map(|s| (*pose, s)))
            .chain(held.flat_map(|body| body.shapes().iter().map(move |s| (hand * body.pose(), s))));
        Ok(points_within(points, shapes, clearance))
    }

    /// The bodies.
    #[must_use]
    pub fn bodies(&self) -> &Bodies {
        &self.bodies
    }

    /// The joints.
    #[must_use]
    pub fn joints(&self) -> &[SceneJoint] {
        &self.joints
    }

    /// Returns a body by name.
    ///
    /// # Errors
    /// The body does not exist.
    pub fn body(&self, name: &str) -> Result<&Body, ProblemError> {
        self.bodies.iter().find(|b| b.name == name).ok_or_else(|| {
            let known: Vec<&str> = self.bodies.iter().map(|b| b.name.as_str()).take(30).collect();
            ProblemError::new("body", format!("{name:?} is not a body; bodies: {}", known.join(", ")))
        })
    }

    /// Returns a joint by name.
    ///
    /// # Errors
    /// The joint does not exist.
    pub fn joint(&self, name: &str) -> Result<&SceneJoint, ProblemError> {
        self.joints.iter().find(|j| j.name == name).ok_or_else(|| {
            let known: Vec<&str> = self.joints.iter().map(|j| j.name.as_str()).take(30).collect();
            ProblemError::new("joint", format!("{name:?} is not a joint; joints: {}", known.join(", ")))
        })
    }

    /// Returns the bodies for a problem whose config moves a joint: the bodies moved by this joint are moving links.
    pub fn bodies_about(&self, joint: Option<&str>) -> Result<Bodies, ProblemError> {
        let Some(joint) = joint else { return Ok(self.bodies.clone()) };
        let moves = &self.joint(joint)?.moves;
        let named = |body: &Body| moves.contains(&body.name) && body.role != Role::Attached;
        if self.bodies.iter().all(|body| named(body) == (body.role == Role::MovingLink)) {
            return Ok(self.bodies.clone());
        }
        self.with_bodies(named, Role::MovingLink, |pose| *pose)
    }

    /// Returns a builder for a problem on this scene with its robot, bodies and keypoints, and the joint that the
    /// config moves, if any; the bodies moved by the joint are the moving link.
    ///
    /// # Errors
    /// The joint does not exist.
    pub fn problem(
        &self,
        config: SolverConfig,
        q_start: Vec<f64>,
        joint: Option<&str>,
    ) -> Result<KeypointProblemBuilder, ProblemError> {
        let problem = KeypointProblem::builder(Arc::clone(&self.robot), config, q_start)
            .bodies_of(self.bodies_about(joint)?, &self.compiled)
            .tool_keypoints(self.tool_keypoints())
            .object_keypoints(self.object_keypoints());
        Ok(match joint {
            Some(name) => problem.joint(self.joint(name)?.joint),
            None => problem,
        })
    }

    /// Returns the bodies of the scene; `which` selects those that get a role and are moved from their poses.
    pub(crate) fn with_bodies(
        &self,
        which: impl Fn(&Body) -> bool,
        role: impl Into<Option<Role>>,
        moved: impl Fn(&Pose) -> Pose,
    ) -> Result<Bodies, ProblemError> {
        let role = role.into();
        let change = |body: &Body| {
            if which(body) { body.placed(role.unwrap_or(body.role), moved(&body.pose)) } else { Ok(body.clone()) }
        };
        Ok(self.bodies.iter().map(change).collect::<Result<Vec<_>, _>>()?.into())
    }

    /// Returns the scene with a joint at another value (rad or m); the bodies of this joint move with it.
    pub fn with_joint(&self, name: &str, value: f64) -> Result<Self, ProblemError> {
        let found = self.joint(name)?.clone();
        let ObjectJoint { lower, upper, value: old, .. } = found.joint;
        if !(value >= lower.min(old) && value <= upper.max(old)) {
            let message = format!("{value} is outside the range [{lower}, {upper}] of {name:?}");
            return Err(ProblemError::new("value", message));
        }
        let motion = joint_motion(&found.joint, value - old);
        let bodies = self.with_bodies(|body| found.moves.contains(&body.name), None, |pose| motion * pose)?;
        let joints = self.joints.iter().map(|j| {
            let mut joint = j.clone();
            if joint.name == name {
                joint.joint.value = value;
            }
            joint
        });
        Ok(Self::of_parts(Arc::clone(&self.robot), bodies, joints.collect()))
    }

    /// Returns the scene with another body, which replaces the body of the same name, if there is one; object joints
    /// that move the former body move the new one.
    ///
    /// The scene shares all other bodies with this one, so that a sensed map can be replaced in every cycle.
    ///
    /// # Errors
    /// The name is that of a link.
    pub fn with_body(&self, body: Body) -> Result<Self, ProblemError> {
        let mut bodies: Vec<Body> = self.bodies.to_vec();
        match bodies.iter_mut().find(|b| b.name == body.name) {
            Some(former) => *former = body,
            None => bodies.push(body),
        }
        let scene = Self::of_parts(Arc::clone(&self.robot), bodies.into(), Arc::clone(&self.joints));
        scene.check().map(|()| scene)
    }

    /// Returns the scene without a body; object joints that moved the body no longer do.
    ///
    /// # Errors
    /// The body does not exist.
    pub fn without_body(&self, name: &str) -> Result<Self, ProblemError> {
        self.body(name)?;
        let bodies: Vec<Body> = self.bodies.iter().filter(|b| b.name != name).cloned().collect();
        Ok(Self::of_parts(Arc::clone(&self.robot), bodies.into(), self.carrying(name, None)))
    }

    /// Returns the scene with a body at another pose in the base frame, or in the hand frame if it is attached.
    ///
    /// # Errors
    /// The body does not exist.
    pub fn with_pose(&self, name: &str, pose: &Pose) -> Result<Self, ProblemError> {
        self.body(name)?;
        let bodies = self.with_bodies(|body| body.name == name, None, |_| *pose)?;
        Ok(Self::of_parts(Arc::clone(&self.robot), bodies, Arc::clone(&self.joints)))
    }

    /// Returns the scene with a robot whose hand carries these mass properties, given in the frame of the hand's link;
    /// they replace an earlier payload, and `None` removes it. Torque limits of motions include the payload. Its shape is
    /// an attached body.
    ///
    /// # Errors
    /// The mass properties are invalid, see [`Robot::with_payload`].
    pub fn with_payload(&self, payload: Option<Inertia>) -> Result<Self, ProblemError> {
        let robot = self.robot.with_payload(payload).map_err(|e| ProblemError::new(e.field, e.message))?;
        // The shapes are the same, so the prepared collision checks stay valid.
        Ok(Self { robot: Arc::new(robot), ..self.clone() })
    }

    /// Returns the scene with a body attached to the hand at pose `hand` (base frame); object joints no longer move
    /// this body.
    ///
    /// # Errors
    /// The body does not exist, or is attached already.
    pub fn attached(&self, name: &str, hand: &Pose) -> Result<Self, ProblemError> {
        if self.body(name)?.role == Role::Attached {
            return Err(ProblemError::new("body", format!("{name:?} is already attached")));
        }
        let bodies = self.with_bodies(|body| body.name == name, Role::Attached, |pose| hand.inverse() * pose)?;
        Ok(Self::of_parts(Arc::clone(&self.robot), bodies, self.carrying(name, None)))
    }

    /// Returns the scene with an attached body released at the hand's pose `hand` (base frame): the body becomes a
    /// rigid obstacle; the joint `on`, if given, moves it.
    ///
    /// # Errors
    /// The body does not exist or is not attached, or the joint does not exist.
    pub fn detached(&self, name: &str, hand: &Pose, on: Option<&str>) -> Result<Self, ProblemError> {
        if self.body(name)?.role != Role::Attached {
            return Err(ProblemError::new("body", format!("{name:?} is not attached")));
        }
        on.map_or(Ok(()), |joint| self.joint(joint).map(|_| ()))?;
        let bodies = self.with_bodies(|body| body.name == name, Role::Rigid, |pose| hand * pose)?;
        Ok(Self::of_parts(Arc::clone(&self.robot), bodies, self.carrying(name, on)))
    }

    /// Returns a copy of the scene's joints in which only `joint` moves the body; no joint does if it is `None`.
    fn carrying(&self, body: &str, joint: Option<&str>) -> Arc<[SceneJoint]> {
        let joints = self.joints.iter().map(|j| {
            let mut out = j.clone();
            out.moves.retain(|name| name != body);
            if joint == Some(out.name.as_str()) {
                out.moves.push(body.to_owned());
            }
            out
        });
        joints.collect()
    }

    /// Keypoints of the attached bodies in the hand frame (m), named `body/keypoint`.
    #[must_use]
    pub fn tool_keypoints(&self) -> BTreeMap<String, Vector3<f64>> {
        self.keypoints(true)
    }

    /// Keypoints of all other bodies in the base frame (m), named `body/keypoint`.
    #[must_use]
    pub fn object_keypoints(&self) -> BTreeMap<String, Vector3<f64>> {
        self.keypoints(false)
    }

    fn keypoints(&self, attached: bool) -> BTreeMap<String, Vector3<f64>> {
        let wanted = self.bodies.iter().filter(|b| (b.role == Role::Attached) == attached);
        wanted
            .flat_map(|body| {
                let place = |p: &Vector3<f64>| (body.pose * Point3::from(*p)).coords;
                body.keypoints.iter().map(move |(name, p)| (format!("{}/{name}", body.name), place(p)))
            })
            .collect()
    }

    /// Returns a collision checker for this scene.
    #[must_use]
    pub fn checker(&self) -> Checker<'_> {
        Checker::new(self)
    }
}

#[cfg(test)]
mod tests {
    use gensim2_geometry::{Convex, Joint, Link};

    use super::*;
    use crate::ObjectJointKind;
    use crate::config::Constraint;

    #[test]
    fn a_problem_shares_what_its_scene_has_prepared_until_its_bodies_change() {
        let cube = || Convex::cuboid([0.05; 3], &Pose::identity()).unwrap();
        let slide = Joint::prismatic("x", Vector3::x()).limits(-2.0, 2.0).velocity(1.0);
        let robot = Robot::builder("cart")
            .link(Link::base("rail"))
            .link(Link::below("rail", "cart").moved_by(slide).shape(cube()))
            .build("cart")
            .unwrap();
        let drawer = Body::builder("drawer", Role::Rigid).shape(cube()).keypoint("knob", Vector3::zeros());
        let drawer = drawer.pose(Pose::translation(1.0, 0.0, 0.0)).build().unwrap();
        let axis =
            ObjectJoint::new(ObjectJointKind::Prismatic, Vector3::zeros(), Vector3::x(), 0.0, [0.0, 0.5]).unwrap();
        let joint = SceneJoint::new("slide", axis, vec!["drawer".to_owned()]);
        let scene = Scene::new(Arc::new(robot), vec![drawer.clone()], vec![joint]).unwrap();
        let config = SolverConfig::builder().constraint(Constraint::point("tip", "drawer/knob", 1e-3)).build().unwrap();
        // The moved body has another role in the problem, but the same shapes in the same places.
        let problem = scene.problem(config, vec![0.0], Some("slide")).unwrap();
        let problem = problem.tool_keypoint("tip", Vector3::zeros()).build().unwrap();
        assert!(problem.bodies()[0].role() == Role::MovingLink && !problem.scene().is_ready());
        assert!(!problem.scene().checker().hits(&[0.0]).unwrap());
        let later = problem.with_start(vec![0.1], None, None, 0.0).unwrap();
        assert!(scene.is_ready() && later.scene().is_ready());
        let near = drawer.placed(Role::MovingLink, Pose::translation(0.05, 0.0, 0.0)).unwrap();
        let changed = problem.changed().bodies(vec![near]).build().unwrap();
        assert!(!changed.scene().is_ready() && changed.scene().checker().hits(&[0.0]).unwrap());
    }
}

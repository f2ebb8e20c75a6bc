//! Robots and the bodies around them.

use std::ffi::{CString, c_char};
use std::path::Path;
use std::sync::Arc;

use gensim2_geometry::{Pose, Robot};
use gensim2_kpam::{Body, ProblemError, Role, Scene, SceneJoint};

use crate::guard::{
    Fault, array, changed, filled, freed, giving, guarded, held, kpam_status, listed, optional_pose, optional_text,
    put_pose, text, zero_terminated,
};
use crate::shape::kpam_shape;

/// A robot and the bodies around it. Functions that take a `const kpam_scene *` may run on several threads at once;
/// functions that change a scene need it for themselves. To plan in one thread while another thread updates the bodies,
/// give each thread its own copy (`kpam_scene_copy`).
pub struct kpam_scene {
    pub(crate) scene: Scene,
    joints: Vec<CString>,
    links: Vec<CString>,
    bodies: Vec<CString>,
}

/// Role of a body in the scene.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum kpam_role {
    /// An obstacle at a pose in the base frame.
    KPAM_ROLE_RIGID = 0,
    /// A part of the tool or a grasped object: it moves with the hand, and its pose is in the frame of the hand link.
    /// It is not checked against this link and the links below it, but against other attached bodies.
    KPAM_ROLE_ATTACHED = 1,
}

impl kpam_scene {
    fn new(scene: Scene) -> Self {
        let robot = scene.robot();
        let joints = robot.joints().iter().map(|joint| zero_terminated(joint.name())).collect();
        let links = robot.links().iter().map(|link| zero_terminated(link.name())).collect();
        let bodies = body_names(&scene);
        Self { scene, joints, links, bodies }
    }

    /// Replaces the scene, whose robot stays the same.
    fn set(&mut self, scene: Scene) {
        self.bodies = body_names(&scene);
        self.scene = scene;
    }

    /// Returns the number of entries of a joint vector.
    pub(crate) fn width(&self) -> usize {
        self.scene.robot().joints().len()
    }

    /// Returns joint vectors of an argument. Mimic joints get the values that follow from their sources.
    ///
    /// # Safety
    /// `q` is null or points to `count` joint vectors.
    pub(crate) unsafe fn rows(&self, q: *const f64, count: usize, name: &str) -> Result<Vec<Vec<f64>>, Fault> {
        let n = self.width();
        // SAFETY: guaranteed by the caller.
        let numbers = unsafe { array(q, count, n, name) }?;
        if let Some(k) = numbers.iter().position(|value| !value.is_finite()) {
            return Err(Fault::invalid(format!("{name}[{k}]: {} is not finite", numbers[k])));
        }
        let row = |k: usize| {
            let mut q = numbers[k * n..(k + 1) * n].to_vec();
            self.scene.robot().apply_mimic(&mut q);
            q
        };
        Ok((0..count).map(row).collect())
    }

    /// Returns the joint vector of an argument, as [`kpam_scene::rows`].
    ///
    /// # Safety
    /// `q` is null or points to a joint vector.
    pub(crate) unsafe fn row(&self, q: *const f64, name: &str) -> Result<Vec<f64>, Fault> {
        // SAFETY: guaranteed by the caller.
        unsafe { self.rows(q, 1, name) }?.pop().ok_or_else(|| Fault::invalid(format!("{name} is empty")))
    }

    /// Returns the index of a link; `None` is the hand.
    pub(crate) fn link(&self, name: Option<&str>) -> Result<usize, Fault> {
        let robot = self.scene.robot();
        let Some(name) = name else { return Ok(robot.hand()) };
        robot.link_index(name).ok_or_else(|| {
            let known: Vec<&str> = robot.links().iter().map(|link| link.name()).collect();
            Fault::invalid(format!("link: {name:?} is not a link; links: {}", known.join(", ")))
        })
    }

    /// Returns the pose of the hand at a joint vector.
    fn hand(&self, q: &[f64]) -> Result<Pose, Fault> {
        let robot = self.scene.robot();
        robot.link_pose(q, robot.hand()).ok_or_else(|| Fault::invalid("q does not fit the robot"))
    }
}

fn body_names(scene: &Scene) -> Vec<CString> {
    scene.bodies().iter().map(|body| zero_terminated(body.name())).collect()
}

/// Loads a robot from a URDF file. Each of its collision meshes becomes its convex hull. `hand_link` is the link that
/// carries the tool: poses of the hand are poses of its frame, and the joints between the base and this link are
/// planned. `srdf` is a file that disables collision checks between pairs of links; with null, neighbouring links and
/// links that overlap in at least 95 % of random configurations are not checked. `base_link` is the link of the base
/// frame; null stands for the only link without a parent. Packages that `package://` paths name are searched in
/// `ROS_PACKAGE_PATH`, in `AMENT_PREFIX_PATH` and in the folders above the URDF.
///
/// # Safety
/// The texts are null or zero-terminated strings; `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_scene_load(
    urdf: *const c_char,
    srdf: *const c_char,
    hand_link: *const c_char,
    base_link: *const c_char,
    out: *mut *mut kpam_scene,
) -> kpam_status {
    let read = || {
        // SAFETY: guaranteed by the caller.
        let (urdf, hand) = unsafe { (text(urdf, "urdf")?, text(hand_link, "hand_link")?) };
        // SAFETY: guaranteed by the caller.
        let (srdf, base) = unsafe { (optional_text(srdf, "srdf")?, optional_text(base_link, "base_link")?) };
        let robot = Robot::from_urdf(urdf, srdf.map(Path::new), hand, base, &[], None)
            .map_err(|e| Fault(kpam_status::KPAM_FILE, e.to_string()))?;
        if robot.joints().is_empty() {
            return Err(Fault(kpam_status::KPAM_FILE, format!("{urdf}: the robot has no moving joint")));
        }
        Scene::new(Arc::new(robot), Vec::new(), Vec::new()).map(kpam_scene::new).map_err(Fault::invalid)
    };
    // SAFETY: guaranteed by the caller.
    unsafe { giving(out, read) }
}

/// Creates a copy of a scene. The copy shares the robot and the shapes, so that it costs little memory and time;
/// changes of one scene do not affect the other.
///
/// # Safety
/// `scene` is null or a scene that was not freed; `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_scene_copy(scene: *const kpam_scene, out: *mut *mut kpam_scene) -> kpam_status {
    // SAFETY: guaranteed by the caller.
    unsafe { giving(out, || Ok(kpam_scene::new(held(scene, "scene")?.scene.clone()))) }
}

/// Returns the number of entries of a joint vector: the moving joints of the URDF, also those of the fingers; 0 if
/// `scene` is null.
///
/// # Safety
/// `scene` is null or a scene that was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_scene_joints(scene: *const kpam_scene) -> usize {
    // SAFETY: guaranteed by the caller.
    unsafe { scene.as_ref() }.map_or(0, kpam_scene::width)
}

/// Returns the name of the joint at this index of joint vectors; null if `scene` is null or the index is too large. The
/// text is valid until the scene is freed.
///
/// # Safety
/// `scene` is null or a scene that was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_scene_joint_name(scene: *const kpam_scene, index: usize) -> *const c_char {
    // SAFETY: guaranteed by the caller.
    unsafe { scene.as_ref() }.map_or(std::ptr::null(), |s| listed(&s.joints, index))
}

/// Returns the name of a link; null if `scene` is null or the index is too large. The text is valid until the scene is
/// freed.
///
/// # Safety
/// `scene` is null or a scene that was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_scene_link_name(scene: *const kpam_scene, index: usize) -> *const c_char {
    // SAFETY: guaranteed by the caller.
    unsafe { scene.as_ref() }.map_or(std::ptr::null(), |s| listed(&s.links, index))
}

/// Writes the limits in the URDF, `kpam_scene_joints` numbers each: position (rad or m), velocity (rad/s or m/s),
/// acceleration, jerk, and effort (N m; N for sliding joints). A pointer that is null is skipped. Limits that the URDF
/// does not give are infinite. `KPAM_LIMITS_ASSUMED` tells which limits motions keep then.
///
/// # Safety
/// `scene` is null or a scene that was not freed; the other pointers are null or have room for `kpam_scene_joints`
/// numbers each.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_scene_joint_limits(
    scene: *const kpam_scene,
    lower: *mut f64,
    upper: *mut f64,
    velocity: *mut f64,
    acceleration: *mut f64,
    jerk: *mut f64,
    effort: *mut f64,
) -> kpam_status {
    guarded(|| {
        // SAFETY: guaranteed by the caller.
        let scene = unsafe { held(scene, "scene") }?;
        for (k, joint) in scene.scene.robot().joints().iter().enumerate() {
            let limits = [
                (lower, joint.lower(), "lower"),
                (upper, joint.upper(), "upper"),
                (velocity, joint.velocity(), "velocity"),
                (acceleration, joint.acceleration(), "acceleration"),
                (jerk, joint.jerk(), "jerk"),
                (effort, joint.effort(), "effort"),
            ];
            for (list, limit, name) in limits {
                if !list.is_null() {
                    // SAFETY: guaranteed by the caller.
                    unsafe { filled(list.wrapping_add(k), 1, 1, name) }?[0] = limit;
                }
            }
        }
        Ok(())
    })
}

/// Changes the scene behind a handle; if `change` fails, the scene stays as it was.
unsafe fn change(scene: *mut kpam_scene, change: impl FnOnce(&kpam_scene) -> Result<Scene, Fault>) -> kpam_status {
    guarded(|| {
        // SAFETY: guaranteed by the caller.
        let scene = unsafe { changed(scene, "scene") }?;
        let next = change(scene)?;
        scene.set(next);
        Ok(())
    })
}

fn of_bodies(scene: &Scene, bodies: Vec<Body>) -> Result<Scene, ProblemError> {
    let joints: Vec<SceneJoint> = scene.joints().to_vec();
    Scene::new(Arc::clone(scene.robot()), bodies, joints)
}

/// Adds a body that consists of `count` shapes. Its name must differ from all other bodies and links. `role` is a
/// member of `kpam_role`. `pose` is in the base frame, or in the frame of the hand link for an attached body; null is
/// the identity. The body keeps its own copy of the shapes.
///
/// # Safety
/// `scene` is null or a scene that was not freed and that no other thread uses now; `name` is null or a zero-terminated
/// string; `shapes` is null or points to `count` handles, each of them null or a shape that was not freed; `pose` is
/// null or points to 16 numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_scene_add_body(
    scene: *mut kpam_scene,
    name: *const c_char,
    role: u32,
    shapes: *const *const kpam_shape,
    count: usize,
    pose: *const f64,
) -> kpam_status {
    let add = |scene: &kpam_scene| {
        // SAFETY: guaranteed by the caller.
        let (name, pose) = unsafe { (text(name, "name")?, optional_pose(pose, "pose")?) };
        let role = match role {
            x if x == kpam_role::KPAM_ROLE_RIGID as u32 => Role::Rigid,
            x if x == kpam_role::KPAM_ROLE_ATTACHED as u32 => Role::Attached,
            x => return Err(Fault::invalid(format!("role: {x} is no member of kpam_role"))),
        };
        // SAFETY: guaranteed by the caller.
        let shapes = unsafe { array(shapes, count, 1, "shapes") }?;
        let mut body = Body::builder(name, role).pose(pose);
        for (k, shape) in shapes.iter().enumerate() {
            // SAFETY: guaranteed by the caller.
            body = body.shapes(unsafe { held(*shape, &format!("shapes[{k}]")) }?.0.iter().cloned());
        }
        let mut bodies = scene.scene.bodies().to_vec();
        bodies.push(body.build().map_err(Fault::invalid)?);
        of_bodies(&scene.scene, bodies).map_err(Fault::invalid)
    };
    // SAFETY: guaranteed by the caller.
    unsafe { change(scene, add) }
}

/// Removes a body.
///
/// # Safety
/// `scene` is null or a scene that was not freed and that no other thread uses now; `name` is null or a zero-terminated
/// string.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_scene_remove_body(scene: *mut kpam_scene, name: *const c_char) -> kpam_status {
    let remove = |scene: &kpam_scene| {
        // SAFETY: guaranteed by the caller.
        let name = unsafe { text(name, "name") }?;
        scene.scene.body(name).map_err(Fault::invalid)?;
        let kept = scene.scene.bodies().iter().filter(|body| body.name() != name).cloned().collect();
        of_bodies(&scene.scene, kept).map_err(Fault::invalid)
    };
    // SAFETY: guaranteed by the caller.
    unsafe { change(scene, remove) }
}

/// Moves a body to another pose in the base frame, or in the frame of the hand link if the body is attached.
///
/// # Safety
/// `scene` is null or a scene that was not freed and that no other thread uses now; `name` is null or a zero-terminated
/// string; `pose` is null or points to 16 numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_scene_move_body(
    scene: *mut kpam_scene,
    name: *const c_char,
    pose: *const f64,
) -> kpam_status {
    let shift = |scene: &kpam_scene| {
        // SAFETY: guaranteed by the caller.
        let (name, pose) = unsafe { (text(name, "name")?, crate::guard::pose(pose, "pose")?) };
        scene.scene.with_pose(name, &pose).map_err(Fault::invalid)
    };
    // SAFETY: guaranteed by the caller.
    unsafe { change(scene, shift) }
}

/// Attaches a body to the hand link, where the body is while the arm is at joints `q`; its role is then
/// `KPAM_ROLE_ATTACHED`. If it overlaps another attached body, such as the tool, no motion can start.
///
/// # Safety
/// `scene` is null or a scene that was not freed and that no other thread uses now; `name` is null or a zero-terminated
/// string; `q` is null or points to `kpam_scene_joints` numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_scene_attach(scene: *mut kpam_scene, name: *const c_char, q: *const f64) -> kpam_status {
    let attach = |scene: &kpam_scene| {
        // SAFETY: guaranteed by the caller.
        let (name, q) = unsafe { (text(name, "name")?, scene.row(q, "q")?) };
        scene.scene.attached(name, &scene.hand(&q)?).map_err(Fault::invalid)
    };
    // SAFETY: guaranteed by the caller.
    unsafe { change(scene, attach) }
}

/// Releases an attached body where it is while the arm is at joints `q`. It becomes an obstacle with the role
/// `KPAM_ROLE_RIGID`.
///
/// # Safety
/// As for `kpam_scene_attach`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_scene_detach(scene: *mut kpam_scene, name: *const c_char, q: *const f64) -> kpam_status {
    let detach = |scene: &kpam_scene| {
        // SAFETY: guaranteed by the caller.
        let (name, q) = unsafe { (text(name, "name")?, scene.row(q, "q")?) };
        scene.scene.detached(name, &scene.hand(&q)?, None).map_err(Fault::invalid)
    };
    // SAFETY: guaranteed by the caller.
    unsafe { change(scene, detach) }
}

/// Returns the name of a body; null if `scene` is null or the index is too large. The text is valid until the scene is
/// changed or freed.
///
/// # Safety
/// `scene` is null or a scene that was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_scene_body_name(scene: *const kpam_scene, index: usize) -> *const c_char {
    // SAFETY: guaranteed by the caller.
    unsafe { scene.as_ref() }.map_or(std::ptr::null(), |s| listed(&s.bodies, index))
}

/// Writes the pose of a body: 16 numbers, in the base frame, or in the frame of the hand link if the body is attached.
///
/// # Safety
/// `scene` is null or a scene that was not freed; `name` is null or a zero-terminated string; `pose` is null or has
/// room for 16 numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_scene_body_pose(
    scene: *const kpam_scene,
    name: *const c_char,
    pose: *mut f64,
) -> kpam_status {
    guarded(|| {
        // SAFETY: guaranteed by the caller.
        let (scene, name) = unsafe { (held(scene, "scene")?, text(name, "name")?) };
        let body = scene.scene.body(name).map_err(Fault::invalid)?;
        // SAFETY: guaranteed by the caller.
        unsafe { put_pose(pose, body.pose(), "pose") }
    })
}

/// Marks the points of a camera's cloud (`count` x 3 numbers, m, base frame) that lie within `clearance` (m, 0 to 10)
/// of the robot at joints `q` or of its attached bodies. Remove these points before the cloud becomes an obstacle.
///
/// # Safety
/// `scene` is null or a scene that was not freed; `q` is null or points to `kpam_scene_joints` numbers; `points` is
/// null or points to `count` x 3 numbers; `is_own` is null or has room for `count` values.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_scene_own_points(
    scene: *const kpam_scene,
    q: *const f64,
    points: *const f64,
    count: usize,
    clearance: f64,
    is_own: *mut bool,
) -> kpam_status {
    guarded(|| {
        // SAFETY: guaranteed by the caller.
        let scene = unsafe { held(scene, "scene") }?;
        if !(0.0..=10.0).contains(&clearance) {
            return Err(Fault::invalid(format!("clearance: must lie in 0 to 10 m, not {clearance}")));
        }
        // SAFETY: guaranteed by the caller.
        let (q, points) = unsafe { (scene.row(q, "q")?, crate::shape::points(points, count, "points")?) };
        let marks: Vec<bool> = scene.scene.own_points(&q, &points, clearance).map_err(Fault::invalid)?;
        // SAFETY: guaranteed by the caller.
        unsafe { filled(is_own, count, 1, "is_own") }?.copy_from_slice(&marks);
        Ok(())
    })
}

/// Frees a scene; null is ignored.
///
/// # Safety
/// `scene` is null or a scene that was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_scene_free(scene: *mut kpam_scene) {
    // SAFETY: guaranteed by the caller.
    unsafe { freed(scene) }
}

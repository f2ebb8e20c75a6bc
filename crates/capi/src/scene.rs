//! Robots, their surroundings, and motions between joint vectors.

use std::ffi::c_char;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use gensim2_geometry::{Convex, Robot, pose_from_matrix};
use gensim2_kpam::options::LimitSet;
use gensim2_kpam::{Body, Goal, Role, Scene, TransitOptions, plan_to};
use nalgebra::Matrix4;

use crate::guard::{Fault, giving, guarded, held, kpam_status, numbers, text};
use crate::trajectory::kpam_trajectory;

/// A robot and its surroundings.
pub struct kpam_scene(Scene);

/// Acceleration and jerk limits for arms whose URDF lacks them.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum kpam_limit_set {
    /// Default: 10 rad/s^2 and 5,000 rad/s^3 for every joint.
    KPAM_LIMITS_PLAIN = 0,
    /// Limits published by Franka for the Panda.
    KPAM_LIMITS_PANDA = 1,
    /// Limits published by Franka for the Research 3, with velocity limits that depend on the position.
    KPAM_LIMITS_FR3 = 2,
}

/// Options of planning a motion; `kpam_options_default` returns the defaults.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct kpam_options {
    /// Minimum distance (m) between the robot and all obstacles along the motion, 0 to 0.1.
    pub margin: f64,
    /// Fraction of the velocity limits that the motion may use, above 0, at most 1.
    pub velocity_scale: f64,
    /// Fraction of the acceleration and jerk limits that the motion may use, above 0, at most 1.
    pub acceleration_scale: f64,
    /// Wall-clock limit of the search (ms); 0 for no limit.
    pub deadline_ms: f64,
    /// Seed of the planner's random samples.
    pub seed: u64,
    /// Acceleration and jerk limits: a member of `kpam_limit_set`.
    pub limits: u32,
}

/// Returns the default options: a margin of 5 mm, scales of 1, no time limit, seed 0, `KPAM_LIMITS_PLAIN`.
#[unsafe(no_mangle)]
pub extern "C" fn kpam_options_default() -> kpam_options {
    kpam_options {
        margin: 0.005,
        velocity_scale: 1.0,
        acceleration_scale: 1.0,
        deadline_ms: 0.0,
        seed: 0,
        limits: kpam_limit_set::KPAM_LIMITS_PLAIN as u32,
    }
}

impl kpam_options {
    fn transit(&self) -> Result<TransitOptions, Fault> {
        let mut out = TransitOptions::default();
        (out.margin, out.velocity_scale) = (self.margin, self.velocity_scale);
        out.acceleration_scale = self.acceleration_scale;
        out.seed = usize::try_from(self.seed).map_err(Fault::invalid)?;
        if !(0.0..=1e9).contains(&self.deadline_ms) {
            return Err(Fault::invalid(format!("deadline_ms: {} lies outside 0 to 1e9", self.deadline_ms)));
        }
        out.deadline = (self.deadline_ms > 0.0).then(|| Duration::from_secs_f64(1e-3 * self.deadline_ms));
        out.limits = match self.limits {
            x if x == kpam_limit_set::KPAM_LIMITS_PLAIN as u32 => Some(LimitSet::Plain),
            x if x == kpam_limit_set::KPAM_LIMITS_PANDA as u32 => Some(LimitSet::Panda),
            x if x == kpam_limit_set::KPAM_LIMITS_FR3 as u32 => Some(LimitSet::Fr3),
            x => return Err(Fault::invalid(format!("limits: {x} is no member of kpam_limit_set"))),
        };
        Ok(out)
    }
}

/// Loads a robot. `urdf` is its file, `srdf` a file that disables pairs of links (null for none), and `hand_link` the
/// link that carries the tool.
///
/// # Safety
/// `urdf`, `srdf` and `hand_link` are null or zero-terminated strings; `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_scene_load(
    urdf: *const c_char,
    srdf: *const c_char,
    hand_link: *const c_char,
    out: *mut *mut kpam_scene,
) -> kpam_status {
    let read = || {
        // SAFETY: guaranteed by the caller.
        let (urdf, hand) = unsafe { (text(urdf, "urdf")?, text(hand_link, "hand_link")?) };
        // SAFETY: guaranteed by the caller.
        let srdf = if srdf.is_null() { None } else { Some(unsafe { text(srdf, "srdf") }?) };
        let robot = Robot::from_urdf(urdf, srdf.map(Path::new), hand, None, &[])
            .map_err(|e| Fault(kpam_status::KPAM_FILE, e.to_string()))?;
        Scene::new(Arc::new(robot), Vec::new(), Vec::new()).map(kpam_scene).map_err(Fault::invalid)
    };
    // SAFETY: guaranteed by the caller.
    unsafe { giving(out, read) }
}

/// Returns the number of entries of a joint vector; 0 if `scene` is null.
///
/// # Safety
/// `scene` is null or a scene that was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_scene_joints(scene: *const kpam_scene) -> usize {
    // SAFETY: guaranteed by the caller.
    unsafe { scene.as_ref() }.map_or(0, |s| s.0.robot().joints().len())
}

/// Adds a fixed box to the scene: half extents (3 numbers, m) and pose (16 numbers, row-major, base frame).
///
/// # Safety
/// `scene` is null or a scene that was not freed and that no other thread uses now; `name` is null or a zero-terminated
/// string; `half_extents` is null or points to 3 numbers, `pose` is null or points to 16.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_scene_add_box(
    scene: *mut kpam_scene,
    name: *const c_char,
    half_extents: *const f64,
    pose: *const f64,
) -> kpam_status {
    guarded(|| {
        // SAFETY: guaranteed by the caller.
        let name = unsafe { text(name, "name") }?;
        // SAFETY: guaranteed by the caller.
        let (half, rows) = unsafe { (numbers(half_extents, 3, "half_extents")?, numbers(pose, 16, "pose")?) };
        // SAFETY: guaranteed by the caller.
        let scene = unsafe { scene.as_mut() }.ok_or_else(|| Fault::invalid("scene is null"))?;
        let matrix = Matrix4::from_row_slice(rows);
        let pose = pose_from_matrix(&matrix, 1e-6).ok_or_else(|| Fault::invalid("pose: is not a rigid transform"))?;
        let shape = Convex::cuboid([half[0], half[1], half[2]], &pose).map_err(Fault::invalid)?;
        let body = Body::builder(name, Role::Rigid).shape(shape).build().map_err(Fault::invalid)?;
        let mut bodies = scene.0.bodies().to_vec();
        bodies.push(body);
        scene.0 = Scene::new(Arc::clone(scene.0.robot()), bodies, Vec::new()).map_err(Fault::invalid)?;
        Ok(())
    })
}

/// Plans a timed motion from rest at `q_start` to rest at `q_goal` that keeps the margin from all obstacles. Each
/// vector has `kpam_scene_joints` entries; `options` may be null.
///
/// # Safety
/// `scene` is null or a scene that was not freed; `q_start` and `q_goal` are null or point to `kpam_scene_joints`
/// numbers each; `options` is null or can be read; `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_plan_joints(
    scene: *const kpam_scene,
    q_start: *const f64,
    q_goal: *const f64,
    options: *const kpam_options,
    out: *mut *mut kpam_trajectory,
) -> kpam_status {
    let find = || {
        // SAFETY: guaranteed by the caller.
        let scene = &unsafe { held(scene, "scene") }?.0;
        let n = scene.robot().joints().len();
        // SAFETY: guaranteed by the caller.
        let (start, goal) = unsafe { (numbers(q_start, n, "q_start")?, numbers(q_goal, n, "q_goal")?) };
        // SAFETY: guaranteed by the caller.
        let options = unsafe { options.as_ref() }.copied().unwrap_or_else(|| kpam_options_default()).transit()?;
        let found = plan_to(scene, start, &Goal::Joints(vec![goal.to_vec()]), &options).map_err(Fault::invalid)?;
        let motion = found.map_err(|why| Fault(kpam_status::KPAM_NO_MOTION, why.to_string()))?;
        Ok(kpam_trajectory(motion.trajectory))
    };
    // SAFETY: guaranteed by the caller.
    unsafe { giving(out, find) }
}

/// Frees a scene; null is ignored.
///
/// # Safety
/// `scene` is null or a scene that was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_scene_free(scene: *mut kpam_scene) {
    if !scene.is_null() {
        // SAFETY: guaranteed by the caller.
        drop(unsafe { Box::from_raw(scene) });
    }
}

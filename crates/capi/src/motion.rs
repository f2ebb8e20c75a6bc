//! Motions to joint values, to poses of a link, and along poses of the hand.

use std::ffi::{CString, c_char};
use std::time::Duration;

use gensim2_kpam::options::LimitSet;
use gensim2_kpam::{Goal, Motion, NoMotion, PathTolerance, ProblemError, TransitOptions, plan_along, plan_to};
use nalgebra::Vector3;

use crate::cancel::kpam_cancel;
use crate::guard::{
    Fault, OptionStruct, array, freed, giving, held, init, kpam_status, listed, numbers, optional_numbers,
    optional_text, options, poses, zero_terminated,
};
use crate::scene::kpam_scene;
use crate::trajectory::kpam_trajectory;

/// A planned motion: its trajectory, the goal that it reaches, and warnings.
pub struct kpam_motion {
    motion: Motion,
    assumed_limits: Vec<CString>,
    warnings: Vec<CString>,
}

/// Acceleration and jerk limits for arms whose URDF lacks them.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum kpam_limit_set {
    /// Default: the limits in the URDF. If the URDF has none, those of `KPAM_LIMITS_PLAIN`; the motion then has a
    /// warning.
    KPAM_LIMITS_ASSUMED = 0,
    /// 10 rad/s^2 and 5,000 rad/s^3 (m/s^2 and m/s^3) for every joint whose URDF gives none.
    KPAM_LIMITS_PLAIN = 1,
    /// Limits published by Franka for the Panda; for 7 joints.
    KPAM_LIMITS_PANDA = 2,
    /// Limits published by Franka for the Research 3, with velocity limits that depend on the position; for 7 joints.
    KPAM_LIMITS_FR3 = 3,
}

/// Options of planning a motion. Initialize them with `kpam_options_init`, then set fields. Arrays have
/// `kpam_scene_joints` numbers each; they are read during the call, and not afterwards.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct kpam_options {
    /// Size of this struct in bytes, which `kpam_options_init` sets.
    pub size: usize,
    /// Minimum distance (m) from obstacles and between links along the motion, 0 to 0.1; default 0.005. Pairs that are
    /// closer at the start or the goal keep that smaller distance.
    pub margin: f64,
    /// Fraction of the velocity limits that the motion may use, 0.001 to 1; default 1.
    pub velocity_scale: f64,
    /// Fraction of the acceleration and jerk limits that the motion may use, 0.001 to 1; default 1.
    pub acceleration_scale: f64,
    /// Wall-clock limit of the search (ms), up to 1e9; 0, the default, for none. A search without a time limit gives
    /// the same motion every time.
    pub deadline_ms: f64,
    /// Seed of the planner's random samples, 0 to 1,000,000; default 0.
    pub seed: u64,
    /// Maximum number of random samples of the search; default 100,000. `kpam_plan_along` ignores it.
    pub samples: u64,
    /// Maximum number of configurations that are checked for collisions; 0, the default, for no limit.
    pub max_checks: u64,
    /// Flag that ends the search from another thread; null for none.
    pub cancel: *const kpam_cancel,
    /// Acceleration and jerk limits: a member of `kpam_limit_set`.
    pub limits: u32,
    /// Velocity limits (rad/s or m/s); null for those of the URDF. Required if the URDF has none.
    pub velocity_limits: *const f64,
    /// Acceleration limits (rad/s^2 or m/s^2); null for those of the URDF and of `limits`.
    pub acceleration_limits: *const f64,
    /// Jerk limits (rad/s^3 or m/s^3); null for those of the URDF and of `limits`.
    pub jerk_limits: *const f64,
    /// Torque limits (N m; N for sliding joints); null for no limits.
    pub torque_limits: *const f64,
    /// Velocity at the start (rad/s or m/s); null for rest.
    pub start_velocity: *const f64,
    /// Acceleration at the start (rad/s^2 or m/s^2); null for zero.
    pub start_acceleration: *const f64,
    /// Time at which the motion starts (s); default 0.
    pub start_time: f64,
    /// Trajectory that the arm follows now; null for none. If it passes `q_start` at `start_time`, ends at a goal and
    /// is still collision-free, it is continued unless another motion ends earlier.
    pub warm_start: *const kpam_trajectory,
}

// SAFETY: the first field is the size, and the others are numbers and pointers.
unsafe impl OptionStruct for kpam_options {
    const NAME: &'static str = "options";

    fn defaults() -> Self {
        let TransitOptions { margin, samples, velocity_scale, acceleration_scale, .. } = TransitOptions::default();
        let none = std::ptr::null();
        Self {
            size: size_of::<Self>(),
            margin,
            velocity_scale,
            acceleration_scale,
            deadline_ms: 0.0,
            seed: 0,
            samples: samples as u64,
            max_checks: 0,
            cancel: std::ptr::null(),
            limits: kpam_limit_set::KPAM_LIMITS_ASSUMED as u32,
            velocity_limits: none,
            acceleration_limits: none,
            jerk_limits: none,
            torque_limits: none,
            start_velocity: none,
            start_acceleration: none,
            start_time: 0.0,
            warm_start: std::ptr::null(),
        }
    }
}

impl kpam_options {
    /// Returns the options of the solver.
    ///
    /// # Safety
    /// The pointers are null or point to data of the documented size.
    unsafe fn read(&self, joints: usize) -> Result<TransitOptions, Fault> {
        let mut out = TransitOptions::default();
        (out.margin, out.velocity_scale) = (self.margin, self.velocity_scale);
        (out.acceleration_scale, out.start_time) = (self.acceleration_scale, self.start_time);
        let whole = |value: u64, name: &str| {
            usize::try_from(value).map_err(|_| Fault::invalid(format!("{name}: {value} is too large")))
        };
        (out.seed, out.samples) = (whole(self.seed, "seed")?, whole(self.samples, "samples")?);
        out.max_checks = (self.max_checks > 0).then_some(self.max_checks);
        if !(0.0..=1e9).contains(&self.deadline_ms) {
            return Err(Fault::invalid(format!("deadline_ms: must lie in 0 to 1e9 ms, not {}", self.deadline_ms)));
        }
        out.deadline = (self.deadline_ms > 0.0).then(|| Duration::from_secs_f64(1e-3 * self.deadline_ms));
        out.limits = match self.limits {
            x if x == kpam_limit_set::KPAM_LIMITS_ASSUMED as u32 => None,
            x if x == kpam_limit_set::KPAM_LIMITS_PLAIN as u32 => Some(LimitSet::Plain),
            x if x == kpam_limit_set::KPAM_LIMITS_PANDA as u32 => Some(LimitSet::Panda),
            x if x == kpam_limit_set::KPAM_LIMITS_FR3 as u32 => Some(LimitSet::Fr3),
            x => return Err(Fault::invalid(format!("limits: {x} is no member of kpam_limit_set"))),
        };
        // SAFETY: guaranteed by the caller.
        let list = |data, name| unsafe { optional_numbers(data, joints, name) };
        out.velocity_limits = list(self.velocity_limits, "velocity_limits")?;
        out.acceleration_limits = list(self.acceleration_limits, "acceleration_limits")?;
        out.jerk_limits = list(self.jerk_limits, "jerk_limits")?;
        out.torque_limits = list(self.torque_limits, "torque_limits")?;
        out.start_velocity = list(self.start_velocity, "start_velocity")?;
        out.start_acceleration = list(self.start_acceleration, "start_acceleration")?;
        // SAFETY: guaranteed by the caller.
        unsafe {
            out.cancel = if self.cancel.is_null() { None } else { Some(held(self.cancel, "cancel")?.0.clone()) };
            if !self.warm_start.is_null() {
                out.warm_start = Some(held(self.warm_start, "warm_start")?.0.clone());
            }
        }
        Ok(out)
    }
}

/// Writes the default options. Call it with the size of the struct: `kpam_options_init(&options, sizeof options)`.
///
/// # Safety
/// `options` is null or has room for `size` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_options_init(options: *mut kpam_options, size: usize) -> kpam_status {
    // SAFETY: guaranteed by the caller.
    unsafe { init(options, size) }
}

/// Tolerance of a motion along poses. Initialize it with `kpam_path_tolerance_init`, then set fields.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct kpam_path_tolerance {
    /// Size of this struct in bytes, which `kpam_path_tolerance_init` sets.
    pub size: usize,
    /// Maximum distance (m) of the hand's origin from the lines, 0.0001 to 0.1; default 0.001.
    pub position: f64,
    /// Maximum angle (rad) between the hand's orientation and that of the nearest pose of the line, 0.001 to pi;
    /// default 0.01. With a free axis, the angle between the directions of this axis.
    pub rotation: f64,
    /// Axis of the hand frame (3 numbers) about which the hand may rotate freely, as for a drill; null for none.
    pub free_axis: *const f64,
}

// SAFETY: the first field is the size, and the others are numbers and pointers.
unsafe impl OptionStruct for kpam_path_tolerance {
    const NAME: &'static str = "tolerance";

    fn defaults() -> Self {
        let PathTolerance { position, rotation, .. } = PathTolerance::default();
        Self { size: size_of::<Self>(), position, rotation, free_axis: std::ptr::null() }
    }
}

/// Writes the default tolerance. Call it with the size of the struct, as `kpam_options_init`.
///
/// # Safety
/// `tolerance` is null or has room for `size` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_path_tolerance_init(tolerance: *mut kpam_path_tolerance, size: usize) -> kpam_status {
    // SAFETY: guaranteed by the caller.
    unsafe { init(tolerance, size) }
}

/// Returns the fault of an invalid argument by the name that it has in C.
fn refused(error: &ProblemError) -> Fault {
    match error.field.strip_prefix("goal") {
        Some(place) => Fault::invalid(format!("goals{place}: {}", error.message)),
        None => Fault::invalid(error),
    }
}

/// Reads start and options, and creates the motion that `find` plans with them.
unsafe fn planned(
    scene: *const kpam_scene,
    q_start: *const f64,
    given: *const kpam_options,
    out: *mut *mut kpam_motion,
    find: impl FnOnce(&kpam_scene, &[f64], &TransitOptions) -> Result<Result<Motion, NoMotion>, Fault>,
) -> kpam_status {
    let make = || {
        // SAFETY: guaranteed by the caller.
        let scene = unsafe { held(scene, "scene") }?;
        let n = scene.width();
        // SAFETY: guaranteed by the caller.
        let (start, options) = unsafe { (numbers(q_start, n, "q_start")?, options(given)?.read(n)?) };
        let motion = find(scene, start, &options)?.map_err(|why| Fault::no_motion(&why))?;
        let texts = |list: &[String]| list.iter().map(|text| zero_terminated(text)).collect();
        let (assumed_limits, warnings) = (texts(&motion.assumed_limits), texts(&motion.warnings));
        Ok(kpam_motion { motion, assumed_limits, warnings })
    };
    // SAFETY: guaranteed by the caller.
    unsafe { giving(out, make) }
}

/// Plans a timed motion from `q_start` to rest at one of `count` joint vectors (one after another in `goals`),
/// whichever is easiest to reach. Joints that do not move the hand keep their values, which the goals must contain.
///
/// The motion begins at rest, or with `start_velocity` and `start_acceleration` in the options: `q_start` and these two
/// are then the state of the moving arm at `start_time`. Each configuration of the motion keeps the margin.
///
/// # Safety
/// `scene` is null or a scene that was not freed; `q_start` is null or points to `kpam_scene_joints` numbers, and
/// `goals` is null or points to `count` times as many; `options` is null or points to initialized options, whose
/// pointers are valid; `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_plan_to_joints(
    scene: *const kpam_scene,
    q_start: *const f64,
    goals: *const f64,
    count: usize,
    options: *const kpam_options,
    out: *mut *mut kpam_motion,
) -> kpam_status {
    let find = |scene: &kpam_scene, start: &[f64], options: &TransitOptions| {
        let n = scene.width();
        // SAFETY: guaranteed by the caller.
        let rows = unsafe { array(goals, count, n, "goals") }?;
        let goal = Goal::Joints((0..count).map(|k| rows[k * n..(k + 1) * n].to_vec()).collect());
        plan_to(&scene.scene, start, &goal, options).map_err(|e| refused(&e))
    };
    // SAFETY: guaranteed by the caller.
    unsafe { planned(scene, q_start, options, out, find) }
}

/// Plans a timed motion from `q_start` to rest with a link at one of `count` poses (1 to 256, 16 numbers each, base
/// frame), whichever is easiest to reach. A null `link` is the hand. Start and options are those of
/// `kpam_plan_to_joints`.
///
/// # Safety
/// As for `kpam_plan_to_joints`, but `goals` is null or points to `count` x 16 numbers; `link` is null or a
/// zero-terminated string.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_plan_to_poses(
    scene: *const kpam_scene,
    q_start: *const f64,
    goals: *const f64,
    count: usize,
    link: *const c_char,
    options: *const kpam_options,
    out: *mut *mut kpam_motion,
) -> kpam_status {
    let find = |scene: &kpam_scene, start: &[f64], options: &TransitOptions| {
        // SAFETY: guaranteed by the caller.
        let (poses, link) = unsafe { (poses(goals, count, "goals")?, optional_text(link, "link")?) };
        let goal = Goal::Poses { poses, link: link.map(str::to_owned) };
        plan_to(&scene.scene, start, &goal, options).map_err(|e| refused(&e))
    };
    // SAFETY: guaranteed by the caller.
    unsafe { planned(scene, q_start, options, out, find) }
}

/// Plans a timed motion from rest at `q_start` that brings the hand to each of `count` poses (up to 10,000, 16 numbers
/// each, base frame) in turn. The hand moves on straight lines and rotates uniformly, from its pose at `q_start` to the
/// first pose and from each pose to the next, within the tolerance (null for 1 mm and 0.01 rad). It stops at a pose
/// only if it could not keep the tolerance otherwise. `start_velocity`, `start_acceleration` and `warm_start` must be
/// null.
///
/// # Safety
/// As for `kpam_plan_to_joints`; `poses` is null or points to `count` x 16 numbers; `tolerance` is null or points to an
/// initialized tolerance, whose pointers are valid.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_plan_along(
    scene: *const kpam_scene,
    q_start: *const f64,
    poses: *const f64,
    count: usize,
    tolerance: *const kpam_path_tolerance,
    options: *const kpam_options,
    out: *mut *mut kpam_motion,
) -> kpam_status {
    let find = |scene: &kpam_scene, start: &[f64], options: &TransitOptions| {
        // SAFETY: guaranteed by the caller.
        let (poses, given) = unsafe { (crate::guard::poses(poses, count, "poses")?, self::options(tolerance)?) };
        let mut tolerance = PathTolerance::default();
        (tolerance.position, tolerance.rotation) = (given.position, given.rotation);
        // SAFETY: guaranteed by the caller.
        let axis = unsafe { optional_numbers(given.free_axis, 3, "free_axis") }?;
        tolerance.free_axis = axis.map(|axis| Vector3::new(axis[0], axis[1], axis[2]));
        plan_along(&scene.scene, start, &poses, &tolerance, options).map_err(|e| refused(&e))
    };
    // SAFETY: guaranteed by the caller.
    unsafe { planned(scene, q_start, options, out, find) }
}

/// Creates the trajectory of a motion, which stays valid after the motion is freed.
///
/// # Safety
/// `motion` is null or a motion that was not freed; `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_motion_trajectory(
    motion: *const kpam_motion,
    out: *mut *mut kpam_trajectory,
) -> kpam_status {
    // SAFETY: guaranteed by the caller.
    unsafe { giving(out, || Ok(kpam_trajectory(held(motion, "motion")?.motion.trajectory.clone()))) }
}

/// Returns the index of the goal at which a motion ends, among the joint vectors or poses that were given; `SIZE_MAX`
/// if `motion` is null.
///
/// # Safety
/// `motion` is null or a motion that was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_motion_goal(motion: *const kpam_motion) -> usize {
    // SAFETY: guaranteed by the caller.
    unsafe { motion.as_ref() }.map_or(usize::MAX, |m| m.motion.goal)
}

/// Returns a warning about a motion, counted from 0: assumed limits with their joints, and links that are never checked
/// for collisions. Null if there are no more, or `motion` is null. The text is valid until the motion is freed.
///
/// # Safety
/// `motion` is null or a motion that was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_motion_warning(motion: *const kpam_motion, index: usize) -> *const c_char {
    // SAFETY: guaranteed by the caller.
    unsafe { motion.as_ref() }.map_or(std::ptr::null(), |m| listed(&m.warnings, index))
}

/// Returns the name of a limit, counted from 0, for which defaults are assumed because neither the options nor the URDF
/// give it: "acceleration" or "jerk". Null if there are no more, or `motion` is null. The text is valid until the
/// motion is freed.
///
/// # Safety
/// `motion` is null or a motion that was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_motion_assumed_limit(motion: *const kpam_motion, index: usize) -> *const c_char {
    // SAFETY: guaranteed by the caller.
    unsafe { motion.as_ref() }.map_or(std::ptr::null(), |m| listed(&m.assumed_limits, index))
}

/// Frees a motion; null is ignored.
///
/// # Safety
/// `motion` is null or a motion that was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_motion_free(motion: *mut kpam_motion) {
    // SAFETY: guaranteed by the caller.
    unsafe { freed(motion) }
}

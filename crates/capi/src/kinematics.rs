//! Forward and inverse kinematics.

use std::ffi::c_char;

use gensim2_geometry::ChainFrames;
use gensim2_kpam::{IkOptions, MAX_SOLUTIONS};

use crate::cancel::kpam_cancel;
use crate::guard::{
    Fault, OptionStruct, filled, guarded, held, init, kpam_status, numbers, optional_numbers, optional_text, put,
    put_pose,
};
use crate::scene::kpam_scene;

/// Writes the pose of a link in the base frame at joints `q`: 16 numbers, row-major. A null `link` is the hand. The
/// entries of mimic joints in `q` are ignored: these joints follow their sources.
///
/// # Safety
/// `scene` is null or a scene that was not freed; `q` is null or points to `kpam_scene_joints` numbers; `link` is null
/// or a zero-terminated string; `pose` is null or has room for 16 numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_scene_forward_kinematics(
    scene: *const kpam_scene,
    q: *const f64,
    link: *const c_char,
    pose: *mut f64,
) -> kpam_status {
    guarded(|| {
        // SAFETY: guaranteed by the caller.
        let scene = unsafe { held(scene, "scene") }?;
        // SAFETY: guaranteed by the caller.
        let (q, link) = unsafe { (scene.row(q, "q")?, optional_text(link, "link")?) };
        let at = scene.scene.robot().link_pose(&q, scene.link(link)?);
        let at = at.ok_or_else(|| Fault::invalid("q does not fit the robot"))?;
        // SAFETY: guaranteed by the caller.
        unsafe { put_pose(pose, &at, "pose") }
    })
}

/// Writes the Jacobian of a link at joints `q`: 6 rows of `kpam_scene_joints` numbers, row-major, in base axes. The
/// first three rows are the linear velocity of the link's origin, the others its angular velocity (m or rad per rad or
/// m). A null `link` is the hand. The motion of mimic joints belongs to the columns of their sources; their own columns
/// are zero.
///
/// # Safety
/// As for `kpam_scene_forward_kinematics`; `jacobian` is null or has room for 6 x `kpam_scene_joints` numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_scene_jacobian(
    scene: *const kpam_scene,
    q: *const f64,
    link: *const c_char,
    jacobian: *mut f64,
) -> kpam_status {
    guarded(|| {
        // SAFETY: guaranteed by the caller.
        let scene = unsafe { held(scene, "scene") }?;
        // SAFETY: guaranteed by the caller.
        let (q, link) = unsafe { (scene.row(q, "q")?, optional_text(link, "link")?) };
        let (robot, n) = (scene.scene.robot(), scene.width());
        let chain = robot.chain_to(scene.link(link)?).ok_or_else(|| Fault::invalid("link: is not a link"))?;
        let mut frames = ChainFrames::default();
        chain.forward(&q, &mut frames).map_err(Fault::invalid)?;
        // SAFETY: guaranteed by the caller.
        let out = unsafe { filled(jacobian, 6, n, "jacobian") }?;
        for (j, column) in robot.jacobian(&chain, &frames).iter().enumerate() {
            (0..6).for_each(|k| out[k * n + j] = column[k]);
        }
        Ok(())
    })
}

/// Options of inverse kinematics. Initialize them with `kpam_ik_options_init`, then set fields.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct kpam_ik_options {
    /// Size of this struct in bytes, which `kpam_ik_options_init` sets.
    pub size: usize,
    /// Link that must reach the pose; null for the hand.
    pub link: *const c_char,
    /// Seed of the start values, 0 to 1,000,000; default 0. The same seed gives the same solutions.
    pub seed: u64,
    /// Two solutions differ by at least this (rad or m) in at least one joint, 0.001 to 10; default 0.05.
    pub min_distance: f64,
    /// Minimum distance (m) from obstacles and between links at a solution, 0 to 0.1. A negative number, the default,
    /// ignores collisions.
    pub margin: f64,
    /// Preferred joint values (rad or m), `kpam_scene_joints` numbers; null for none. A redundant arm is moved toward
    /// them without moving the link.
    pub posture: *const f64,
    /// Weight of each joint's squared distance from `posture`, `kpam_scene_joints` numbers, 0 to 1e6; null for 1 each.
    pub posture_weights: *const f64,
    /// Weight of the manipulability, 0 to 1e6; default 0. A redundant arm is moved away from singularities.
    pub manipulability: f64,
    /// Flag that ends the search from another thread; null for none. The solutions found until then are returned.
    pub cancel: *const kpam_cancel,
}

// SAFETY: the first field is the size, and the others are numbers and pointers.
unsafe impl OptionStruct for kpam_ik_options {
    const NAME: &'static str = "options";

    fn defaults() -> Self {
        let IkOptions { min_distance, manipulability, .. } = IkOptions::default();
        Self {
            size: size_of::<Self>(),
            link: std::ptr::null(),
            seed: 0,
            min_distance,
            margin: -1.0,
            posture: std::ptr::null(),
            posture_weights: std::ptr::null(),
            manipulability,
            cancel: std::ptr::null(),
        }
    }
}

impl kpam_ik_options {
    /// Returns the options of the solver.
    ///
    /// # Safety
    /// The pointers are null or point to data of the documented size.
    unsafe fn read(&self, joints: usize, max_solutions: usize) -> Result<IkOptions, Fault> {
        let mut out = IkOptions::default();
        out.max_solutions = max_solutions;
        out.seed = usize::try_from(self.seed).map_err(|e| Fault::invalid(format!("seed: {e}")))?;
        (out.min_distance, out.manipulability) = (self.min_distance, self.manipulability);
        out.margin = if self.margin < 0.0 { None } else { Some(self.margin) };
        // SAFETY: guaranteed by the caller.
        unsafe {
            out.link = optional_text(self.link, "link")?.map(str::to_owned);
            out.posture = optional_numbers(self.posture, joints, "posture")?;
            out.posture_weights = optional_numbers(self.posture_weights, joints, "posture_weights")?;
            out.cancel = if self.cancel.is_null() { None } else { Some(held(self.cancel, "cancel")?.0.clone()) };
        }
        Ok(out)
    }
}

/// Writes the default options. Call it with the size of the struct: `kpam_ik_options_init(&options, sizeof options)`.
///
/// # Safety
/// `options` is null or has room for `size` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_ik_options_init(options: *mut kpam_ik_options, size: usize) -> kpam_status {
    // SAFETY: guaranteed by the caller.
    unsafe { init(options, size) }
}

/// Writes up to `max_solutions` (1 to 256) joint vectors that bring the hand, or the link in the options, to a pose in
/// the base frame, and the number of the vectors to `count`. The number is 0 if none was found, which is no error: the
/// function returns `KPAM_OK`, and `solutions` does not contain a solution.
///
/// The vectors are distinct, one after another in `solutions`, best first: closest to `q_start`, or by the objective of
/// `posture` and `manipulability` in the options. Joints that do not move the hand keep their values of `q_start`. With
/// 256, an arm of six joints gets all solutions, unless joint ranges above a turn multiply their number; a redundant
/// arm gets a sample of its solutions.
///
/// # Safety
/// `scene` is null or a scene that was not freed; `pose` is null or points to 16 numbers; `q_start` is null or points
/// to `kpam_scene_joints` numbers; `options` is null or points to initialized options, whose pointers are valid;
/// `solutions` is null or has room for `max_solutions` x `kpam_scene_joints` numbers; `count` is null or can be
/// written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_scene_ik(
    scene: *const kpam_scene,
    pose: *const f64,
    q_start: *const f64,
    options: *const kpam_ik_options,
    max_solutions: usize,
    solutions: *mut f64,
    count: *mut usize,
) -> kpam_status {
    guarded(|| {
        // SAFETY: guaranteed by the caller.
        unsafe { put(count, 0, "count") }?;
        // SAFETY: guaranteed by the caller.
        let scene = unsafe { held(scene, "scene") }?;
        let n = scene.width();
        // SAFETY: guaranteed by the caller.
        let (goal, start) = unsafe { (crate::guard::pose(pose, "pose")?, numbers(q_start, n, "q_start")?) };
        if !(1..=MAX_SOLUTIONS).contains(&max_solutions) {
            let message = format!("max_solutions: must be 1 to {MAX_SOLUTIONS}, not {max_solutions}");
            return Err(Fault::invalid(message));
        }
        // SAFETY: guaranteed by the caller.
        let options = unsafe { crate::guard::options(options)?.read(n, max_solutions) }?;
        let found = gensim2_kpam::solutions(&scene.scene, &goal, start, &options).map_err(Fault::invalid)?;
        // SAFETY: guaranteed by the caller.
        let out = unsafe { filled(solutions, max_solutions, n, "solutions") }?;
        for (row, q) in out.chunks_exact_mut(n).zip(&found) {
            row.copy_from_slice(q);
        }
        // SAFETY: guaranteed by the caller.
        unsafe { put(count, found.len(), "count") }
    })
}

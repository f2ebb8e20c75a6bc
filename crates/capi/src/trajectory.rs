//! Trajectories: samples for control loops, the fastest stop, and the switch to another trajectory.

use gensim2_kpam::{Limits, RetimeOptions, Trajectory, retime};

use crate::guard::{Fault, array, filled, freed, giving, guarded, held, kpam_status, numbers, optional_numbers};

/// A trajectory: position, velocity and acceleration of all joints as functions of time. It does not change, so several
/// threads may use it at once.
pub struct kpam_trajectory(pub(crate) Trajectory);

/// Returns the start time of a trajectory (s); NaN if `trajectory` is null.
///
/// # Safety
/// `trajectory` is null or a trajectory that was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_trajectory_start(trajectory: *const kpam_trajectory) -> f64 {
    // SAFETY: guaranteed by the caller.
    unsafe { trajectory.as_ref() }.map_or(f64::NAN, |t| t.0.start())
}

/// Returns the end time of a trajectory (s); NaN if `trajectory` is null.
///
/// # Safety
/// `trajectory` is null or a trajectory that was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_trajectory_end(trajectory: *const kpam_trajectory) -> f64 {
    // SAFETY: guaranteed by the caller.
    unsafe { trajectory.as_ref() }.map_or(f64::NAN, |t| t.0.end())
}

/// Returns the number of entries of a joint vector; 0 if `trajectory` is null.
///
/// # Safety
/// `trajectory` is null or a trajectory that was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_trajectory_joints(trajectory: *const kpam_trajectory) -> usize {
    // SAFETY: guaranteed by the caller.
    unsafe { trajectory.as_ref() }.map_or(0, |t| t.0.joints())
}

/// Writes position, velocity and acceleration at time `t` (s), `kpam_trajectory_joints` numbers each. Times before the
/// start give the state at the start; after the end, the arm is at rest. The function takes no lock, and allocates
/// no memory if it returns `KPAM_OK`.
///
/// # Safety
/// `trajectory` is null or a trajectory that was not freed; the other pointers are null or have room for
/// `kpam_trajectory_joints` numbers each, and do not overlap.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_trajectory_sample_into(
    trajectory: *const kpam_trajectory,
    t: f64,
    position: *mut f64,
    velocity: *mut f64,
    acceleration: *mut f64,
) -> kpam_status {
    guarded(|| {
        // SAFETY: guaranteed by the caller.
        let motion = &unsafe { held(trajectory, "trajectory") }?.0;
        if !t.is_finite() {
            return Err(Fault::invalid(format!("t: {t} is not finite")));
        }
        let n = motion.joints();
        // SAFETY: guaranteed by the caller.
        let room = |data, name| unsafe { filled(data, n, 1, name) };
        let (position, velocity) = (room(position, "position")?, room(velocity, "velocity")?);
        motion.sample_into(t, position, velocity, room(acceleration, "acceleration")?).map_err(Fault::invalid)
    })
}

/// Creates a trajectory from another one by calling `make`.
unsafe fn made_of(
    trajectory: *const kpam_trajectory,
    out: *mut *mut kpam_trajectory,
    make: impl FnOnce(&Trajectory) -> Result<Trajectory, Fault>,
) -> kpam_status {
    // SAFETY: guaranteed by the caller.
    let motion = || Ok(&unsafe { held(trajectory, "trajectory") }?.0);
    // SAFETY: guaranteed by the caller.
    unsafe { giving(out, || make(motion()?).map(kpam_trajectory)) }
}

/// Creates a stop that begins at time `t` (s) in the state of the trajectory and brakes along its path as hard as the
/// limits of velocity, acceleration and jerk allow. If no stop along the path keeps the limits, for example just before
/// the path reverses, every joint stops independently as fast as it can, and the arm may leave the path. The stop may
/// need more torque than the trajectory, and is not checked for collisions off the path.
///
/// # Safety
/// `trajectory` is null or a trajectory that was not freed; `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_trajectory_brake(
    trajectory: *const kpam_trajectory,
    t: f64,
    out: *mut *mut kpam_trajectory,
) -> kpam_status {
    // SAFETY: guaranteed by the caller.
    unsafe { made_of(trajectory, out, |motion| motion.brake(t).map_err(Fault::invalid)) }
}

/// Creates the part of a trajectory from time `t` (s) on. Use it to keep a repeatedly spliced trajectory short.
///
/// # Safety
/// `trajectory` is null or a trajectory that was not freed; `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_trajectory_since(
    trajectory: *const kpam_trajectory,
    t: f64,
    out: *mut *mut kpam_trajectory,
) -> kpam_status {
    // SAFETY: guaranteed by the caller.
    unsafe { made_of(trajectory, out, |motion| motion.since(t).map_err(Fault::invalid)) }
}

/// Creates the trajectory that follows `trajectory` until time `t` (s) and `next` from then on. Both must have the same
/// state at `t` (within 1e-6 in position, velocity and acceleration), and the same values of joints that neither of
/// them moves.
///
/// # Safety
/// `trajectory` and `next` are null or trajectories that were not freed; `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_trajectory_splice(
    trajectory: *const kpam_trajectory,
    next: *const kpam_trajectory,
    t: f64,
    out: *mut *mut kpam_trajectory,
) -> kpam_status {
    // SAFETY: guaranteed by the caller.
    let next = || Ok(&unsafe { held(next, "next") }?.0);
    // SAFETY: guaranteed by the caller.
    unsafe { made_of(trajectory, out, |motion| motion.splice(next()?, t).map_err(Fault::invalid)) }
}

/// Creates the fastest trajectory found through waypoints (`count` rows of `joints` numbers) within velocity,
/// acceleration and jerk limits (`joints` numbers each). It begins at `start_time` with `start_velocity` and
/// `start_acceleration`; null means at rest.
///
/// # Safety
/// All pointers except `out` are null or point to arrays of the sizes above; `out` can be written.
#[unsafe(no_mangle)]
#[allow(clippy::too_many_arguments, reason = "an interface in C has no other way to name them")]
pub unsafe extern "C" fn kpam_retime(
    waypoints: *const f64,
    count: usize,
    joints: usize,
    velocity_limits: *const f64,
    acceleration_limits: *const f64,
    jerk_limits: *const f64,
    start_velocity: *const f64,
    start_acceleration: *const f64,
    start_time: f64,
    out: *mut *mut kpam_trajectory,
) -> kpam_status {
    let make = || {
        if !(1..=1_000_000).contains(&count) || !(1..=gensim2_kpam::MAX_JOINTS).contains(&joints) {
            return Err(Fault::invalid(format!("count, joints: {count} waypoints of {joints} joints cannot be timed")));
        }
        // SAFETY: guaranteed by the caller.
        let list = |data, name| unsafe { numbers(data, joints, name) };
        // SAFETY: guaranteed by the caller.
        let rows = unsafe { array(waypoints, count, joints, "waypoints") }?;
        let limits = Limits::new(
            list(velocity_limits, "velocity_limits")?,
            list(acceleration_limits, "acceleration_limits")?,
            list(jerk_limits, "jerk_limits")?,
        )
        .map_err(Fault::invalid)?;
        // SAFETY: guaranteed by the caller.
        let optional = |data, name| unsafe { optional_numbers(data, joints, name) };
        let mut options = RetimeOptions::default();
        options.start_velocity = optional(start_velocity, "start_velocity")?;
        options.start_acceleration = optional(start_acceleration, "start_acceleration")?;
        options.start_time = start_time;
        let rows: Vec<Vec<f64>> = rows.chunks_exact(joints).map(<[f64]>::to_vec).collect();
        retime(&rows, &limits, &options).map(|r| kpam_trajectory(r.trajectory)).map_err(Fault::invalid)
    };
    // SAFETY: guaranteed by the caller.
    unsafe { giving(out, make) }
}

/// Frees a trajectory; null is ignored.
///
/// # Safety
/// `trajectory` is null or a trajectory that was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_trajectory_free(trajectory: *mut kpam_trajectory) {
    // SAFETY: guaranteed by the caller.
    unsafe { freed(trajectory) }
}

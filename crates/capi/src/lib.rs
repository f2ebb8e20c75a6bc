//! The solver for C and languages that can call C: load a robot, plan, sample in a control loop, brake, switch to
//! another motion.
//!
//! Functions return a [`kpam_status`] and store their result through a pointer, or null if they fail;
//! [`kpam_last_error`] returns the error message. A panic does not cross the interface but is returned as
//! [`kpam_status::KPAM_PANIC`].
//!
//! Metres, radians, seconds; joint vectors are in the order of the URDF; poses are 4 x 4 row-major in the base frame.
//! Several threads may read a handle at once; free each handle once.
#![allow(non_camel_case_types, reason = "names are those of the C interface")]

mod guard;
mod scene;
mod trajectory;

pub use guard::{kpam_last_error, kpam_status};
pub use scene::{
    kpam_limit_set, kpam_options, kpam_options_default, kpam_plan_joints, kpam_scene, kpam_scene_add_box,
    kpam_scene_free, kpam_scene_joints, kpam_scene_load,
};
pub use trajectory::{
    kpam_retime, kpam_trajectory, kpam_trajectory_brake, kpam_trajectory_end, kpam_trajectory_free,
    kpam_trajectory_joints, kpam_trajectory_sample_into, kpam_trajectory_since, kpam_trajectory_splice,
    kpam_trajectory_start,
};

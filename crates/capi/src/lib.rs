//! The solver for C and what can call C: load a robot, plan, sample in a control loop, brake, go over to another motion.
//!
//! Functions return a [`kpam_status`] and write what they make through a pointer, null where they make nothing;
//! [`kpam_last_error`] has the sentence.
//! Nothing panics across the border: a panic comes back as [`kpam_status::KPAM_PANIC`]. Metres, radians, seconds; joint
//! vectors are in the order of the URDF; poses are 4 x 4 row-major in the base frame. Handles may be read from several
//! threads at once and are freed once.
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

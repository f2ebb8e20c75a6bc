//! The motion solver for C and languages that can call C: load a robot, describe its surroundings, solve kinematics, plan
//! motions, and sample, stop and join them in a control loop.
//!
//! Functions return a [`kpam_status`] and store their result through a pointer, or null if they fail;
//! [`kpam_last_error`] returns the error message. A panic does not cross the interface but is returned as
//! [`kpam_status::KPAM_PANIC`]. The comment at the beginning of the header (`cbindgen.toml`) describes units, ownership,
//! threads and versions.
#![allow(non_camel_case_types, reason = "names are those of the C interface")]

// The header lists the functions in the order of these modules; blank lines keep it.
mod guard;

mod version;

mod scene;

mod shape;

mod kinematics;

mod collision;

mod motion;

mod trajectory;

mod cancel;

pub use cancel::{kpam_cancel, kpam_cancel_create, kpam_cancel_free, kpam_cancel_is_set, kpam_cancel_set};
pub use collision::{
    kpam_pair, kpam_pairs, kpam_pairs_at, kpam_pairs_free, kpam_scene_check, kpam_scene_distance,
    kpam_scene_in_collision,
};
pub use guard::{kpam_last_error, kpam_status};
pub use kinematics::{
    kpam_ik_options, kpam_ik_options_init, kpam_scene_forward_kinematics, kpam_scene_ik, kpam_scene_jacobian,
};
pub use motion::{
    kpam_limit_set, kpam_motion, kpam_motion_assumed_limit, kpam_motion_free, kpam_motion_goal, kpam_motion_trajectory,
    kpam_motion_warning, kpam_options, kpam_options_init, kpam_path_tolerance, kpam_path_tolerance_init,
    kpam_plan_along, kpam_plan_to_joints, kpam_plan_to_poses,
};
pub use scene::{
    kpam_role, kpam_scene, kpam_scene_add_body, kpam_scene_attach, kpam_scene_body_name, kpam_scene_body_pose,
    kpam_scene_copy, kpam_scene_detach, kpam_scene_free, kpam_scene_joint_limits, kpam_scene_joint_name,
    kpam_scene_joints, kpam_scene_link_name, kpam_scene_load, kpam_scene_move_body, kpam_scene_own_points,
    kpam_scene_remove_body,
};
pub use shape::{
    kpam_shape, kpam_shape_box, kpam_shape_capsule, kpam_shape_convex_hull, kpam_shape_cylinder, kpam_shape_free,
    kpam_shape_hull_of_file, kpam_shape_mesh, kpam_shape_point_cloud, kpam_shape_sphere,
};
pub use trajectory::{
    kpam_retime, kpam_trajectory, kpam_trajectory_brake, kpam_trajectory_end, kpam_trajectory_free,
    kpam_trajectory_joints, kpam_trajectory_sample_into, kpam_trajectory_since, kpam_trajectory_splice,
    kpam_trajectory_start,
};
pub use version::{KPAM_ABI_VERSION, kpam_abi_version, kpam_version};

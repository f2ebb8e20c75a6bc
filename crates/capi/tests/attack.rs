//! Invalid arguments, handles freed in any documented order, and calls from several threads: every failure is a status
//! and a message. `address_sanitizer.sh` in the crate's folder runs these tests under AddressSanitizer.
#![allow(clippy::unwrap_used)]

use std::ffi::{CStr, CString, c_char};
use std::ptr::{dangling_mut, null, null_mut};

use gensim2_capi::*;

const URDF: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/robots/ur5e.urdf");
const RACK: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/robots/rack_gripper.urdf");
const START: [f64; 6] = [0.0, -1.2, 1.5, -1.9, -1.6, 0.0];
const GOAL: [f64; 6] = [0.8, -1.2, 1.5, -1.9, -1.6, 0.0];
const UNIT: [f64; 16] = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
const ODD: [f64; 9] = [0.0, -1.0, 1e-300, 1e300, -1e300, f64::MAX, f64::INFINITY, f64::NEG_INFINITY, f64::NAN];
/// Counts of values that no memory can hold.
const VAST: [usize; 3] = [usize::MAX, usize::MAX / 16, 1 << 60];

fn last() -> String {
    // SAFETY: the function always returns a string.
    unsafe { CStr::from_ptr(kpam_last_error()) }.to_string_lossy().into_owned()
}

fn text(at: *const c_char) -> Option<String> {
    // SAFETY: the interface returns null or a string.
    (!at.is_null()).then(|| unsafe { CStr::from_ptr(at) }.to_string_lossy().into_owned())
}

fn load(urdf: &str, hand: &str) -> (kpam_status, *mut kpam_scene) {
    let (urdf, hand, mut out) = (CString::new(urdf).unwrap(), CString::new(hand).unwrap(), dangling_mut());
    // SAFETY: both strings end with a zero.
    let status = unsafe { kpam_scene_load(urdf.as_ptr(), null(), hand.as_ptr(), null(), &raw mut out) };
    (status, out)
}

fn plan(scene: *const kpam_scene, start: &[f64], goal: &[f64]) -> (kpam_status, *mut kpam_motion) {
    // SAFETY: both vectors have one entry for each joint of the robot.
    call(|out| unsafe { kpam_plan_to_joints(scene, start.as_ptr(), goal.as_ptr(), 1, null(), out) })
}

fn call<T>(work: impl FnOnce(*mut *mut T) -> kpam_status) -> (kpam_status, *mut T) {
    let mut out = dangling_mut();
    (work(&raw mut out), out)
}

/// Returns the result of a call that must succeed.
fn made<T>((status, out): (kpam_status, *mut T)) -> *mut T {
    assert_eq!(status, kpam_status::KPAM_OK, "{}", last());
    out
}

fn works(status: kpam_status) {
    assert_eq!(status, kpam_status::KPAM_OK, "{}", last());
}

/// Asserts that a call failed without a panic, stored null and left a message.
fn refused<T>((status, out): (kpam_status, *mut T)) {
    assert_ne!(status, kpam_status::KPAM_OK);
    assert_ne!(status, kpam_status::KPAM_PANIC, "{}", last());
    assert!(out.is_null() && !last().is_empty());
}

/// Asserts that a call failed because of an argument.
fn invalid(status: kpam_status) {
    assert_eq!(status, kpam_status::KPAM_INVALID);
    assert!(!last().is_empty());
}

fn no_panic(status: kpam_status) {
    assert_ne!(status, kpam_status::KPAM_PANIC, "{}", last());
}

/// Returns the trajectory of a motion, and frees the motion.
unsafe fn trajectory(motion: *mut kpam_motion) -> *mut kpam_trajectory {
    // SAFETY: guaranteed by the caller.
    unsafe {
        let out = made(call(|out| kpam_motion_trajectory(motion, out)));
        kpam_motion_free(motion);
        out
    }
}

#[test]
fn nulls_are_refused() {
    let (_, scene) = load(URDF, "flange");
    let (q, word) = (START.as_ptr(), c"x".as_ptr());
    // SAFETY: each pointer is null or points to memory of the documented size.
    unsafe {
        let (s, t): (*mut kpam_scene, *const kpam_trajectory) = (null_mut(), null());
        let (mut many, mut count, mut flag) = ([0.0; 64], 7, false);
        let room = many.as_mut_ptr();
        refused(call(|out| kpam_scene_load(null(), null(), word, null(), out)));
        refused(call(|out| kpam_scene_load(word, null(), null(), null(), out)));
        refused(call(|out| kpam_scene_copy(s, out)));
        refused(call(|out| kpam_plan_to_joints(s, q, q, 1, null(), out)));
        refused(call(|out| kpam_plan_to_joints(scene, null(), q, 1, null(), out)));
        refused(call(|out| kpam_plan_to_joints(scene, q, null(), 1, null(), out)));
        refused(call(|out| kpam_plan_to_joints(scene, q, null(), 0, null(), out)));
        refused(call(|out| kpam_plan_to_poses(scene, q, null(), 1, null(), null(), out)));
        refused(call(|out| kpam_plan_to_poses(scene, q, null(), 0, null(), null(), out)));
        refused(call(|out| kpam_plan_along(scene, q, null(), 1, null(), null(), out)));
        refused(call(|out| kpam_plan_along(scene, q, null(), 0, null(), null(), out)));
        refused(call(|out| kpam_motion_trajectory(null(), out)));
        refused(call(|out| kpam_scene_check(s, q, 0.1, out)));
        refused(call(|out| kpam_scene_check(scene, null(), 0.1, out)));
        refused(call(|out| kpam_trajectory_brake(t, 0.0, out)));
        refused(call(|out| kpam_trajectory_since(t, 0.0, out)));
        refused(call(|out| kpam_trajectory_splice(t, t, 0.0, out)));
        refused(call(|out| kpam_retime(null(), 2, 2, q, q, q, null(), null(), 0.0, out)));
        refused(call(|out| kpam_retime(q, 2, 2, null(), q, q, null(), null(), 0.0, out)));
        refused(call(|out| kpam_shape_box(null(), null(), out)));
        refused(call(|out| kpam_shape_convex_hull(null(), 3, out)));
        refused(call(|out| kpam_shape_convex_hull(null(), 0, out)));
        refused(call(|out| kpam_shape_hull_of_file(null(), null(), out)));
        refused(call(|out| kpam_shape_mesh(null(), 3, null(), 1, out)));
        refused(call(|out| kpam_shape_mesh(q, 1, null(), 1, out)));
        refused(call(|out| kpam_shape_mesh(q, 1, null(), 0, out)));
        refused(call(|out| kpam_shape_point_cloud(null(), 3, 0.1, out)));
        // Without a place for the result.
        invalid(kpam_scene_load(word, null(), word, null(), null_mut()));
        invalid(kpam_plan_to_joints(scene, q, q, 1, null(), null_mut()));
        invalid(kpam_trajectory_brake(t, 0.0, null_mut()));
        invalid(kpam_cancel_create(null_mut()));
        invalid(kpam_shape_sphere(0.1, null(), null_mut()));
        invalid(kpam_options_init(null_mut(), size_of::<kpam_options>()));
        invalid(kpam_scene_add_body(s, word, 0, null(), 0, null()));
        invalid(kpam_scene_add_body(scene, null(), 0, null(), 0, null()));
        invalid(kpam_scene_add_body(scene, word, 0, null(), 1, null()));
        invalid(kpam_scene_add_body(scene, word, 0, [null()].as_ptr(), 1, null()));
        invalid(kpam_scene_add_body(scene, word, 2, null(), 0, null()));
        invalid(kpam_scene_remove_body(scene, word));
        invalid(kpam_scene_move_body(scene, word, UNIT.as_ptr()));
        invalid(kpam_scene_move_body(scene, word, null()));
        invalid(kpam_scene_attach(scene, word, q));
        invalid(kpam_scene_detach(scene, word, null()));
        invalid(kpam_scene_body_pose(scene, word, room));
        invalid(kpam_scene_forward_kinematics(s, q, null(), room));
        invalid(kpam_scene_forward_kinematics(scene, null(), null(), room));
        invalid(kpam_scene_forward_kinematics(scene, q, word, room));
        invalid(kpam_scene_forward_kinematics(scene, q, null(), null_mut()));
        invalid(kpam_scene_jacobian(scene, q, null(), null_mut()));
        invalid(kpam_scene_joint_limits(s, room, room, room, room, room, room));
        invalid(kpam_scene_in_collision(scene, q, 1, null_mut()));
        invalid(kpam_scene_in_collision(scene, null(), 1, &raw mut flag));
        invalid(kpam_scene_distance(scene, q, 1, 1.0, null_mut()));
        invalid(kpam_scene_own_points(scene, q, null(), 1, 0.1, &raw mut flag));
        invalid(kpam_scene_ik(scene, UNIT.as_ptr(), q, null(), 1, room, null_mut()));
        invalid(kpam_scene_ik(scene, UNIT.as_ptr(), q, null(), 1, null_mut(), &raw mut count));
        assert_eq!(count, 0);
        invalid(kpam_scene_ik(scene, null(), q, null(), 1, room, &raw mut count));
        invalid(kpam_scene_ik(scene, UNIT.as_ptr(), q, null(), 0, room, &raw mut count));
        invalid(kpam_scene_ik(scene, UNIT.as_ptr(), q, null(), 257, room, &raw mut count));
        // Nothing to do is no error.
        works(kpam_scene_in_collision(scene, null(), 0, null_mut()));
        works(kpam_scene_distance(scene, null(), 0, 1.0, null_mut()));
        works(kpam_scene_joint_limits(scene, null_mut(), null_mut(), null_mut(), null_mut(), null_mut(), null_mut()));
        assert_eq!((kpam_scene_joints(s), kpam_trajectory_joints(t)), (0, 0));
        assert!(kpam_trajectory_start(t).is_nan() && kpam_trajectory_end(t).is_nan());
        assert_eq!(kpam_motion_goal(null()), usize::MAX);
        assert!(!kpam_cancel_is_set(null()));
        kpam_cancel_set(null());
        let words = [kpam_scene_joint_name(s, 0), kpam_scene_link_name(s, 0), kpam_scene_body_name(scene, 0)];
        assert!(words.iter().all(|word| word.is_null()));
        assert!(kpam_motion_warning(null(), 0).is_null() && kpam_motion_assumed_limit(null(), 0).is_null());
        assert!(kpam_pairs_at(null(), 0).is_null());
        assert!(kpam_scene_joint_name(scene, 6).is_null() && kpam_scene_joint_name(scene, usize::MAX).is_null());
        kpam_scene_free(s);
        kpam_motion_free(null_mut());
        kpam_pairs_free(null_mut());
        kpam_shape_free(null_mut());
        kpam_cancel_free(null_mut());
        kpam_trajectory_free(null_mut());
        kpam_scene_free(scene);
    }
}

#[test]
fn pointers_and_counts_that_cannot_be_are_refused() {
    let (_, scene) = load(URDF, "flange");
    let mut numbers = [0.0; 65];
    // Inside the array, but not at the begin of a number.
    let crooked = numbers.as_mut_ptr().cast::<u8>().wrapping_add(4).cast::<f64>();
    let q = START.as_ptr();
    let mut count = 0;
    // SAFETY: the interface refuses these pointers and counts before it reads or writes there.
    unsafe {
        invalid(kpam_scene_forward_kinematics(scene, crooked, null(), numbers.as_mut_ptr()));
        assert!(last().contains("q is not aligned"), "{}", last());
        invalid(kpam_scene_forward_kinematics(scene, q, null(), crooked));
        invalid(kpam_scene_ik(scene, UNIT.as_ptr(), q, null(), 1, crooked, &raw mut count));
        refused(call(|out| kpam_shape_point_cloud(crooked, 2, 0.1, out)));
        refused(call(|out| kpam_plan_to_joints(crooked.cast::<kpam_scene>(), q, q, 1, null(), out)));
        refused(call(|out| kpam_plan_to_joints(scene, q, q, 1, crooked.cast::<kpam_options>(), out)));
        invalid(kpam_cancel_create(crooked.cast()));
        for vast in VAST {
            let somewhere = numbers.as_mut_ptr();
            refused(call(|out| kpam_shape_point_cloud(somewhere, vast, 0.1, out)));
            refused(call(|out| kpam_shape_convex_hull(somewhere, vast, out)));
            refused(call(|out| kpam_shape_mesh(somewhere, 3, somewhere.cast(), vast, out)));
            refused(call(|out| kpam_plan_to_joints(scene, q, somewhere, vast, null(), out)));
            refused(call(|out| kpam_plan_to_poses(scene, q, somewhere, vast, null(), null(), out)));
            refused(call(|out| kpam_plan_along(scene, q, somewhere, vast, null(), null(), out)));
            invalid(kpam_scene_in_collision(scene, somewhere, vast, null_mut()));
            invalid(kpam_scene_distance(scene, somewhere, vast, 1.0, somewhere));
            invalid(kpam_scene_own_points(scene, q, somewhere, vast, 0.1, null_mut()));
            invalid(kpam_scene_add_body(scene, c"x".as_ptr(), 0, somewhere.cast(), vast, null()));
            let limits = START.as_ptr();
            for (rows, joints) in [(vast, 2), (2, vast), (vast, vast), (0, 2), (2, 0)] {
                refused(call(|out| {
                    kpam_retime(somewhere, rows, joints, limits, limits, limits, null(), null(), 0.0, out)
                }));
            }
        }
        kpam_scene_free(scene);
    }
}

#[test]
fn options_of_another_size_are_refused() {
    let (_, scene) = load(URDF, "flange");
    // SAFETY: all pointers are valid.
    unsafe {
        let mut options = std::mem::zeroed::<kpam_options>();
        let mut ik = std::mem::zeroed::<kpam_ik_options>();
        let mut tolerance = std::mem::zeroed::<kpam_path_tolerance>();
        // Options that were not initialized.
        refused(call(|out| kpam_plan_to_joints(scene, START.as_ptr(), GOAL.as_ptr(), 1, &raw const options, out)));
        assert!(last().contains("options.size: 0"), "{}", last());
        for size in [0, 8, size_of::<kpam_options>() - 8, size_of::<kpam_options>() + 8, usize::MAX] {
            invalid(kpam_options_init(&raw mut options, size));
            options.size = size;
            refused(call(|out| kpam_plan_to_joints(scene, START.as_ptr(), GOAL.as_ptr(), 1, &raw const options, out)));
        }
        invalid(kpam_path_tolerance_init(&raw mut tolerance, 0));
        refused(call(|out| {
            kpam_plan_along(scene, START.as_ptr(), UNIT.as_ptr(), 1, &raw const tolerance, null(), out)
        }));
        let (mut found, mut count) = ([0.0; 6], 0);
        invalid(kpam_scene_ik(
            scene,
            UNIT.as_ptr(),
            START.as_ptr(),
            &raw const ik,
            1,
            found.as_mut_ptr(),
            &raw mut count,
        ));
        works(kpam_ik_options_init(&raw mut ik, size_of::<kpam_ik_options>()));
        assert_eq!((ik.size, ik.min_distance), (size_of::<kpam_ik_options>(), 0.05));
        kpam_scene_free(scene);
    }
}

/// Calls with odd numbers in the options; each must be refused, or work.
unsafe fn with_odd_options(scene: *const kpam_scene, odd: f64, list: &[f64; 6]) {
    let (q, goal) = (START.as_ptr(), GOAL.as_ptr());
    // SAFETY: guaranteed by the caller.
    unsafe {
        let mut plain = std::mem::zeroed::<kpam_options>();
        works(kpam_options_init(&raw mut plain, size_of::<kpam_options>()));
        // Limits of a microsecond: most of these searches need not end.
        plain.max_checks = 2000;
        let changes: [fn(&mut kpam_options, f64, *const f64); 12] = [
            |o, odd, _| o.margin = odd,
            |o, odd, _| o.velocity_scale = odd,
            |o, odd, _| o.acceleration_scale = odd,
            |o, odd, _| o.deadline_ms = odd,
            |o, odd, _| o.start_time = odd,
            |o, odd, _| o.seed = odd as u64,
            |o, _, list| o.velocity_limits = list,
            |o, _, list| o.acceleration_limits = list,
            |o, _, list| o.jerk_limits = list,
            |o, _, list| o.torque_limits = list,
            |o, _, list| o.start_velocity = list,
            |o, _, list| o.start_acceleration = list,
        ];
        for change in changes {
            let mut options = plain;
            change(&mut options, odd, list.as_ptr());
            let (status, motion) = call(|out| kpam_plan_to_joints(scene, q, goal, 1, &raw const options, out));
            no_panic(status);
            assert_eq!(motion.is_null(), status != kpam_status::KPAM_OK);
            kpam_motion_free(motion);
        }
        let (mut ik, mut found, mut count) = (std::mem::zeroed::<kpam_ik_options>(), [0.0; 12], 0);
        let mut pose = [0.0; 16];
        works(kpam_scene_forward_kinematics(scene, goal, null(), pose.as_mut_ptr()));
        let changes: [fn(&mut kpam_ik_options, f64, *const f64); 6] = [
            |o, odd, _| o.min_distance = odd,
            |o, odd, _| o.margin = odd,
            |o, odd, _| o.manipulability = odd,
            |o, odd, _| o.seed = odd as u64,
            |o, _, list| o.posture = list,
            |o, _, list| (o.posture, o.posture_weights) = (START.as_ptr(), list),
        ];
        for change in changes {
            works(kpam_ik_options_init(&raw mut ik, size_of::<kpam_ik_options>()));
            change(&mut ik, odd, list.as_ptr());
            let (at, out) = (pose.as_ptr(), found.as_mut_ptr());
            no_panic(kpam_scene_ik(scene, at, q, &raw const ik, 2, out, &raw mut count));
            assert!(count <= 2);
        }
    }
}

#[test]
fn odd_numbers_are_refused_or_served() {
    let (status, scene) = load(URDF, "flange");
    works(status);
    for odd in ODD {
        for place in [0, 5] {
            let mut q = START;
            q[place] = odd;
            for (start, goal) in [(&q, &GOAL), (&START, &q)] {
                let (status, motion) = plan(scene, start, goal);
                no_panic(status);
                assert_eq!(motion.is_null(), status != kpam_status::KPAM_OK);
                // SAFETY: `motion` is null or was created in this test, and is freed once.
                unsafe { kpam_motion_free(motion) };
            }
            let (mut pose, mut jacobian, mut flag, mut distance) = ([0.0; 16], [0.0; 36], false, 0.0);
            // SAFETY: all pointers are valid.
            unsafe {
                with_odd_options(scene, odd, &q);
                let q = q.as_ptr();
                no_panic(kpam_scene_forward_kinematics(scene, q, null(), pose.as_mut_ptr()));
                no_panic(kpam_scene_jacobian(scene, q, null(), jacobian.as_mut_ptr()));
                no_panic(kpam_scene_in_collision(scene, q, 1, &raw mut flag));
                no_panic(kpam_scene_distance(scene, q, 1, odd, &raw mut distance));
                no_panic(kpam_scene_own_points(scene, q, q, 2, odd, [false; 2].as_mut_ptr()));
                let (status, pairs) = call(|out| kpam_scene_check(scene, q, odd, out));
                no_panic(status);
                kpam_pairs_free(pairs);
            }
        }
        // SAFETY: all pointers are valid.
        unsafe {
            let (list, mut bent) = ([odd; 16], UNIT);
            bent[3] = odd;
            let shapes = [
                call(|out| kpam_shape_box(list.as_ptr(), null(), out)),
                call(|out| kpam_shape_box([0.1; 3].as_ptr(), bent.as_ptr(), out)),
                call(|out| kpam_shape_sphere(odd, null(), out)),
                call(|out| kpam_shape_sphere(0.1, list.as_ptr(), out)),
                call(|out| kpam_shape_capsule(odd, odd, null(), out)),
                call(|out| kpam_shape_cylinder(odd, 0.1, bent.as_ptr(), out)),
                call(|out| kpam_shape_convex_hull(list.as_ptr(), 5, out)),
                call(|out| kpam_shape_mesh(list.as_ptr(), 3, [0, 1, 2].as_ptr(), 1, out)),
                call(|out| kpam_shape_point_cloud(list.as_ptr(), 5, 0.1, out)),
                call(|out| kpam_shape_point_cloud(list.as_ptr(), 0, odd, out)),
            ];
            for (status, shape) in shapes {
                no_panic(status);
                assert_eq!(shape.is_null(), status != kpam_status::KPAM_OK);
                if !shape.is_null() {
                    let list = [shape.cast_const()];
                    let status = kpam_scene_add_body(scene, c"odd".as_ptr(), 0, list.as_ptr(), 1, bent.as_ptr());
                    no_panic(status);
                    if status == kpam_status::KPAM_OK {
                        no_panic(kpam_scene_move_body(scene, c"odd".as_ptr(), bent.as_ptr()));
                        works(kpam_scene_remove_body(scene, c"odd".as_ptr()));
                    }
                }
                kpam_shape_free(shape);
            }
            invalid(kpam_scene_add_body(scene, c"b".as_ptr(), 0, null(), 0, list.as_ptr()));
            let rows = [0.0, 0.1, 0.2, odd];
            let limits = [1.0; 2];
            let (status, timed) = call(|out| {
                let limits = limits.as_ptr();
                kpam_retime(rows.as_ptr(), 2, 2, limits, limits, limits, null(), null(), 0.0, out)
            });
            no_panic(status);
            kpam_trajectory_free(timed);
        }
    }
    // SAFETY: the scene is freed once.
    unsafe { kpam_scene_free(scene) };
}

#[test]
fn deadlines_and_seeds_of_any_size_do_not_panic() {
    let (_, scene) = load(URDF, "flange");
    // SAFETY: all pointers are valid.
    unsafe {
        let mut options = std::mem::zeroed::<kpam_options>();
        for (deadline, works) in [(1e9, true), (1e-9, false), (1.1e9, false), (f64::MAX, false), (f64::INFINITY, false)]
        {
            kpam_options_init(&raw mut options, size_of::<kpam_options>());
            options.deadline_ms = deadline;
            let (status, motion) =
                call(|out| kpam_plan_to_joints(scene, START.as_ptr(), GOAL.as_ptr(), 1, &raw const options, out));
            no_panic(status);
            assert_eq!(status == kpam_status::KPAM_OK, works, "{deadline}: {}", last());
            kpam_motion_free(motion);
        }
        for (seed, limits) in [(u64::MAX, 0), (1 << 40, 0), (0, 4), (0, u32::MAX)] {
            kpam_options_init(&raw mut options, size_of::<kpam_options>());
            (options.seed, options.limits) = (seed, limits);
            refused(call(|out| kpam_plan_to_joints(scene, START.as_ptr(), GOAL.as_ptr(), 1, &raw const options, out)));
        }
        kpam_scene_free(scene);
    }
}

#[test]
fn files_that_are_none_are_refused() {
    for (urdf, hand) in [("", ""), ("no.urdf", "flange"), ("/dev/zero", "x"), ("/", "x"), (URDF, "no"), (URDF, "a\nb")]
    {
        refused(load(urdf, hand));
    }
    // SAFETY: the strings end with a zero; the first is not UTF-8.
    unsafe {
        refused(call(|out| kpam_scene_load(c"\xff\xfe".as_ptr(), null(), c"x".as_ptr(), null(), out)));
        let urdf = CString::new(URDF).unwrap();
        refused(call(|out| kpam_scene_load(urdf.as_ptr(), c"no.srdf".as_ptr(), c"flange".as_ptr(), null(), out)));
        refused(call(|out| kpam_scene_load(urdf.as_ptr(), null(), c"flange".as_ptr(), c"no".as_ptr(), out)));
        for path in [c"no.stl", c"/dev/zero", c"/", c"", c"no.xyz"] {
            let (status, shape) = call(|out| kpam_shape_hull_of_file(path.as_ptr(), null(), out));
            assert_eq!(status, kpam_status::KPAM_FILE);
            assert!(shape.is_null() && !last().is_empty());
        }
        refused(call(|out| kpam_shape_hull_of_file(c"no.stl".as_ptr(), [1.0, 0.0, 1.0].as_ptr(), out)));
    }
}

#[test]
fn a_failed_change_leaves_the_scene_as_it_was() {
    let (_, scene) = load(URDF, "flange");
    // SAFETY: all pointers are valid, and each handle is freed once.
    unsafe {
        let ball = made(call(|out| kpam_shape_sphere(0.1, null(), out)));
        let list = [ball.cast_const()];
        let mut pose = UNIT;
        pose[3] = 0.9;
        for _ in 0..2 {
            // The second time, the name is used already.
            let status = kpam_scene_add_body(scene, c"ball".as_ptr(), 0, list.as_ptr(), 1, pose.as_ptr());
            assert_eq!(status == kpam_status::KPAM_OK, last().is_empty());
        }
        assert!(last().contains("\"ball\" is used already"), "{}", last());
        invalid(kpam_scene_add_body(scene, c"forearm_link".as_ptr(), 0, list.as_ptr(), 1, null()));
        invalid(kpam_scene_detach(scene, c"ball".as_ptr(), START.as_ptr()));
        pose[3] = 2e3;
        invalid(kpam_scene_move_body(scene, c"ball".as_ptr(), pose.as_ptr()));
        kpam_shape_free(ball);
        assert_eq!(text(kpam_scene_body_name(scene, 0)).as_deref(), Some("ball"));
        assert_eq!(text(kpam_scene_body_name(scene, 1)), None);
        works(kpam_scene_body_pose(scene, c"ball".as_ptr(), pose.as_mut_ptr()));
        assert_eq!(pose[3], 0.9);
        works(kpam_scene_attach(scene, c"ball".as_ptr(), START.as_ptr()));
        invalid(kpam_scene_attach(scene, c"ball".as_ptr(), START.as_ptr()));
        kpam_scene_free(scene);
    }
}

#[test]
fn mimic_joints_follow_their_sources() {
    let (status, scene) = load(RACK, "left_pad");
    works(status);
    // SAFETY: all pointers are valid, and the scene is freed once.
    unsafe {
        let n = kpam_scene_joints(scene);
        let names: Vec<String> = (0..n).map(|k| text(kpam_scene_joint_name(scene, k)).unwrap()).collect();
        let pinion = names.iter().position(|name| name == "pinion_joint").unwrap();
        let (mut poses, mut jacobian) = ([[0.0; 16]; 2], vec![0.0; 6 * n]);
        for (turn, pose) in [1.0, 1.5].into_iter().zip(&mut poses) {
            let mut q = vec![0.0; n];
            q[pinion] = turn;
            works(kpam_scene_forward_kinematics(scene, q.as_ptr(), null(), pose.as_mut_ptr()));
            works(kpam_scene_jacobian(scene, q.as_ptr(), null(), jacobian.as_mut_ptr()));
        }
        for (row, place) in [3, 7, 11].into_iter().enumerate() {
            let speed = (poses[1][place] - poses[0][place]) / 0.5;
            assert!((jacobian[row * n + pinion] - speed).abs() < 1e-12);
        }
        let length = (0..3).map(|row| jacobian[row * n + pinion].powi(2)).sum::<f64>().sqrt();
        assert!((length - 0.02).abs() < 1e-12, "{length}");
        assert!((0..6 * n).all(|k| k % n == pinion || jacobian[k] == 0.0));
        kpam_scene_free(scene);
    }
}

#[test]
fn handles_outlive_what_they_were_made_of() {
    let (_, scene) = load(URDF, "flange");
    // SAFETY: each handle is freed once and not used afterwards.
    unsafe {
        let motion = made(plan(scene, &START, &GOAL));
        let pairs = made(call(|out| kpam_scene_check(scene, START.as_ptr(), 0.1, out)));
        let copy = made(call(|out| kpam_scene_copy(scene, out)));
        kpam_scene_free(scene);
        let pair = &*kpam_pairs_at(pairs, 0);
        assert!(text(pair.first).is_some() && text(pair.second).is_some() && pair.distance < 0.1);
        kpam_pairs_free(pairs);
        kpam_motion_free(made(plan(copy, &START, &GOAL)));
        kpam_scene_free(copy);
        let warnings: Vec<String> = (0..).map_while(|k| text(kpam_motion_warning(motion, k))).collect();
        let assumed: Vec<String> = (0..).map_while(|k| text(kpam_motion_assumed_limit(motion, k))).collect();
        assert!(warnings.len() == 2 && warnings[0].contains("shoulder_pan_joint"), "{warnings:?}");
        assert_eq!(assumed, ["acceleration", "jerk"]);
        let motion = trajectory(motion);
        let end = kpam_trajectory_end(motion);
        let stop = made(call(|out| kpam_trajectory_brake(motion, 0.4 * end, out)));
        let whole = made(call(|out| kpam_trajectory_splice(motion, stop, 0.4 * end, out)));
        kpam_trajectory_free(motion);
        kpam_trajectory_free(stop);
        let rest = made(call(|out| kpam_trajectory_since(whole, 0.2 * end, out)));
        kpam_trajectory_free(whole);
        let [mut q, mut v, mut a] = [[0.0; 6]; 3];
        for odd in ODD {
            no_panic(kpam_trajectory_sample_into(rest, odd, q.as_mut_ptr(), v.as_mut_ptr(), a.as_mut_ptr()));
            for (status, made) in [
                call(|out| kpam_trajectory_brake(rest, odd, out)),
                call(|out| kpam_trajectory_since(rest, odd, out)),
                call(|out| kpam_trajectory_splice(rest, rest, odd, out)),
            ] {
                no_panic(status);
                assert_eq!(made.is_null(), status != kpam_status::KPAM_OK);
                kpam_trajectory_free(made);
            }
        }
        kpam_trajectory_free(rest);
    }
}

#[test]
fn threads_share_a_scene_and_a_motion_and_have_sentences_of_their_own() {
    let (_, scene) = load(URDF, "flange");
    // SAFETY: the motion was created here.
    let motion = unsafe { trajectory(made(plan(scene, &START, &GOAL))) };
    let (shared, moving) = (scene as usize, motion as usize);
    let work = move |number: usize| {
        let (scene, motion) = (shared as *const kpam_scene, moving as *const kpam_trajectory);
        for round in 0..20 {
            if (number + round).is_multiple_of(2) {
                refused(load(&format!("no{number}.urdf"), "flange"));
                assert!(last().contains(&format!("no{number}.urdf")));
            }
            let found = made(plan(scene, &START, &GOAL));
            let ([mut q, mut v, mut a], mut distance) = ([[0.0; 6]; 3], 0.0);
            // SAFETY: scene and motion outlive all threads; each new handle is freed once.
            unsafe {
                works(kpam_trajectory_sample_into(motion, 0.1, q.as_mut_ptr(), v.as_mut_ptr(), a.as_mut_ptr()));
                works(kpam_scene_distance(scene, q.as_ptr(), 1, 1.0, &raw mut distance));
                // Each thread changes its own copy of the scene.
                let copy = made(call(|out| kpam_scene_copy(scene, out)));
                works(kpam_scene_add_body(copy, c"empty".as_ptr(), 0, null(), 0, null()));
                kpam_scene_free(copy);
                kpam_motion_free(found);
            }
        }
    };
    let threads: Vec<_> = (0..4).map(|number| std::thread::spawn(move || work(number))).collect();
    threads.into_iter().for_each(|thread| thread.join().unwrap());
    // SAFETY: all threads that used the handles have ended.
    unsafe {
        assert!(kpam_scene_body_name(scene, 0).is_null());
        kpam_trajectory_free(motion);
        kpam_scene_free(scene);
    }
}

//! Invalid arguments, handles freed in any documented order, and calls from several threads: every failure is a status
//! and a message. `address_sanitizer.sh` in the crate's folder runs these tests under AddressSanitizer.
#![allow(clippy::unwrap_used)]

use std::ffi::{CStr, CString};
use std::ptr::{dangling_mut, null, null_mut};

use gensim2_capi::*;

const URDF: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/robots/ur5.urdf");
const START: [f64; 6] = [0.0, -1.2, 1.5, -1.9, -1.6, 0.0];
const GOAL: [f64; 6] = [0.8, -1.2, 1.5, -1.9, -1.6, 0.0];
const ODD: [f64; 9] = [0.0, -1.0, 1e-300, 1e300, -1e300, f64::MAX, f64::INFINITY, f64::NEG_INFINITY, f64::NAN];

fn last() -> String {
    // SAFETY: the function always returns a string.
    unsafe { CStr::from_ptr(kpam_last_error()) }.to_string_lossy().into_owned()
}

fn load(urdf: &str, hand: &str) -> (kpam_status, *mut kpam_scene) {
    let (urdf, hand, mut out) = (CString::new(urdf).unwrap(), CString::new(hand).unwrap(), dangling_mut());
    // SAFETY: both strings end with a zero.
    let status = unsafe { kpam_scene_load(urdf.as_ptr(), null(), hand.as_ptr(), &raw mut out) };
    (status, out)
}

fn plan(scene: *const kpam_scene, start: &[f64], goal: &[f64]) -> (kpam_status, *mut kpam_trajectory) {
    let mut out = dangling_mut();
    // SAFETY: both vectors have one entry for each joint of the robot.
    let status = unsafe { kpam_plan_joints(scene, start.as_ptr(), goal.as_ptr(), null(), &raw mut out) };
    (status, out)
}

/// Asserts that a call failed without a panic, stored null and left a message.
fn refused<T>((status, out): (kpam_status, *mut T)) {
    assert_ne!(status, kpam_status::KPAM_OK);
    assert_ne!(status, kpam_status::KPAM_PANIC, "{}", last());
    assert!(out.is_null() && !last().is_empty());
}

#[test]
fn nulls_are_refused() {
    let (_, scene) = load(URDF, "flange");
    let (q, word) = (START.as_ptr(), c"x".as_ptr());
    // SAFETY: each pointer is null or points to memory of the documented size.
    unsafe {
        let (s, t) = (null_mut(), null());
        refused(call(|out| kpam_scene_load(null(), null(), word, out)));
        refused(call(|out| kpam_scene_load(word, null(), null(), out)));
        refused(call(|out| kpam_plan_joints(s, q, q, null(), out)));
        refused(call(|out| kpam_plan_joints(scene, null(), q, null(), out)));
        refused(call(|out| kpam_plan_joints(scene, q, null(), null(), out)));
        refused(call(|out| kpam_trajectory_brake(t, 0.0, out)));
        refused(call(|out| kpam_trajectory_since(t, 0.0, out)));
        refused(call(|out| kpam_trajectory_splice(t, t, 0.0, out)));
        refused(call(|out| kpam_retime(null(), 2, 2, q, q, q, null(), null(), 0.0, out)));
        refused(call(|out| kpam_retime(q, 2, 2, null(), q, q, null(), null(), 0.0, out)));
        assert_eq!(kpam_scene_load(word, null(), word, null_mut()), kpam_status::KPAM_INVALID);
        assert_eq!(kpam_plan_joints(scene, q, q, null(), null_mut()), kpam_status::KPAM_INVALID);
        assert_eq!(kpam_trajectory_brake(t, 0.0, null_mut()), kpam_status::KPAM_INVALID);
        assert_eq!(kpam_scene_add_box(s, word, q, q), kpam_status::KPAM_INVALID);
        assert_eq!(kpam_scene_add_box(scene, null(), q, q), kpam_status::KPAM_INVALID);
        assert_eq!(kpam_scene_add_box(scene, word, null(), null()), kpam_status::KPAM_INVALID);
        assert_eq!((kpam_scene_joints(s), kpam_trajectory_joints(t)), (0, 0));
        assert!(kpam_trajectory_start(t).is_nan() && kpam_trajectory_end(t).is_nan());
        kpam_scene_free(s);
        kpam_trajectory_free(null_mut());
        kpam_scene_free(scene);
    }
}

fn call<T>(work: impl FnOnce(*mut *mut T) -> kpam_status) -> (kpam_status, *mut T) {
    let mut out = dangling_mut();
    (work(&raw mut out), out)
}

#[test]
fn odd_numbers_and_counts_are_refused_or_served() {
    let (status, scene) = load(URDF, "flange");
    assert_eq!(status, kpam_status::KPAM_OK, "{}", last());
    for odd in ODD {
        for place in 0..6 {
            let mut q = START;
            q[place] = odd;
            for (start, goal) in [(&q, &GOAL), (&START, &q)] {
                let (status, motion) = plan(scene, start, goal);
                assert_ne!(status, kpam_status::KPAM_PANIC, "{}", last());
                assert_eq!(motion.is_null(), status != kpam_status::KPAM_OK);
                // SAFETY: `motion` is null or was created in this test, and is freed once.
                unsafe { kpam_trajectory_free(motion) };
            }
        }
        let mut options = kpam_options_default();
        (options.margin, options.deadline_ms, options.velocity_scale) = (odd, odd, odd);
        // SAFETY: all pointers are valid.
        unsafe {
            let (q, goal) = (START.as_ptr(), GOAL.as_ptr());
            let (status, motion) = call(|out| kpam_plan_joints(scene, q, goal, &raw const options, out));
            assert_ne!(status, kpam_status::KPAM_PANIC, "{}", last());
            kpam_trajectory_free(motion);
            let (half, mut pose) = ([odd; 3], [0.0; 16]);
            (0..4).for_each(|k| pose[5 * k] = 1.0);
            assert_eq!(
                kpam_scene_add_box(scene, c"b".as_ptr(), half.as_ptr(), [odd; 16].as_ptr()),
                kpam_status::KPAM_INVALID
            );
            let status = kpam_scene_add_box(scene, c"b".as_ptr(), half.as_ptr(), pose.as_ptr());
            assert_ne!(status, kpam_status::KPAM_PANIC, "{}", last());
        }
    }
    let mut options = kpam_options_default();
    options.limits = u32::MAX;
    let rows = [0.0, 0.1, 0.2, odd_last()];
    // SAFETY: all pointers are valid; invalid counts are rejected before anything is read.
    unsafe {
        refused(call(|out| kpam_plan_joints(scene, START.as_ptr(), GOAL.as_ptr(), &raw const options, out)));
        for (count, joints) in
            [(usize::MAX, 2), (2, usize::MAX), (usize::MAX, usize::MAX), (0, 2), (2, 0), (1 << 40, 1)]
        {
            let limits = START.as_ptr();
            refused(call(|out| {
                kpam_retime(rows.as_ptr(), count, joints, limits, limits, limits, null(), null(), 0.0, out)
            }));
        }
        let limits = [1.0; 2];
        let limits = limits.as_ptr();
        refused(call(|out| kpam_retime(rows.as_ptr(), 2, 2, limits, limits, limits, null(), null(), 0.0, out)));
        kpam_scene_free(scene);
    }
}

fn odd_last() -> f64 {
    ODD[8]
}

#[test]
fn files_that_are_none_are_refused() {
    for (urdf, hand) in [("", ""), ("no.urdf", "flange"), ("/dev/zero", "x"), ("/", "x"), (URDF, "no"), (URDF, "a\nb")]
    {
        refused(load(urdf, hand));
    }
    // SAFETY: the string ends with a zero, but is not UTF-8.
    refused(unsafe { call(|out| kpam_scene_load(c"\xff\xfe".as_ptr(), null(), c"x".as_ptr(), out)) });
}

#[test]
fn handles_outlive_what_they_were_made_of() {
    let (_, scene) = load(URDF, "flange");
    let (status, motion) = plan(scene, &START, &GOAL);
    assert_eq!(status, kpam_status::KPAM_OK, "{}", last());
    // SAFETY: each handle is freed once and not used afterwards.
    unsafe {
        kpam_scene_free(scene);
        let end = kpam_trajectory_end(motion);
        let (status, stop) = call(|out| kpam_trajectory_brake(motion, 0.4 * end, out));
        assert_eq!(status, kpam_status::KPAM_OK, "{}", last());
        let (status, whole) = call(|out| kpam_trajectory_splice(motion, stop, 0.4 * end, out));
        assert_eq!(status, kpam_status::KPAM_OK, "{}", last());
        kpam_trajectory_free(motion);
        kpam_trajectory_free(stop);
        let (status, rest) = call(|out| kpam_trajectory_since(whole, 0.2 * end, out));
        assert_eq!(status, kpam_status::KPAM_OK, "{}", last());
        kpam_trajectory_free(whole);
        let [mut q, mut v, mut a] = [[0.0; 6]; 3];
        for odd in ODD {
            let status = kpam_trajectory_sample_into(rest, odd, q.as_mut_ptr(), v.as_mut_ptr(), a.as_mut_ptr());
            assert_ne!(status, kpam_status::KPAM_PANIC, "{}", last());
            for (status, made) in [
                call(|out| kpam_trajectory_brake(rest, odd, out)),
                call(|out| kpam_trajectory_since(rest, odd, out)),
                call(|out| kpam_trajectory_splice(rest, rest, odd, out)),
            ] {
                assert_ne!(status, kpam_status::KPAM_PANIC, "{}", last());
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
    let (status, motion) = plan(scene, &START, &GOAL);
    assert_eq!(status, kpam_status::KPAM_OK, "{}", last());
    let (shared, moving) = (scene as usize, motion as usize);
    let work = move |number: usize| {
        let (scene, motion) = (shared as *const kpam_scene, moving as *const kpam_trajectory);
        for round in 0..20 {
            if (number + round).is_multiple_of(2) {
                refused(load(&format!("no{number}.urdf"), "flange"));
                assert!(last().contains(&format!("no{number}.urdf")));
            }
            let (status, made) = plan(scene, &START, &GOAL);
            assert_eq!(status, kpam_status::KPAM_OK, "{}", last());
            let [mut q, mut v, mut a] = [[0.0; 6]; 3];
            // SAFETY: scene and motion outlive all threads; each new handle is freed once.
            unsafe {
                kpam_trajectory_sample_into(motion, 0.1, q.as_mut_ptr(), v.as_mut_ptr(), a.as_mut_ptr());
                kpam_trajectory_free(made);
            }
        }
    };
    let threads: Vec<_> = (0..4).map(|number| std::thread::spawn(move || work(number))).collect();
    threads.into_iter().for_each(|thread| thread.join().unwrap());
    // SAFETY: all threads that used the handles have ended.
    unsafe {
        kpam_trajectory_free(motion);
        kpam_scene_free(scene);
    }
}

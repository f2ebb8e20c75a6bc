//! The header is current, a C program runs a motion with the interface, and sampling allocates no memory.
#![allow(clippy::unwrap_used)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::path::Path;
use std::process::Command;

use gensim2_capi::{kpam_retime, kpam_status, kpam_trajectory_end, kpam_trajectory_free, kpam_trajectory_sample_into};

mod compiled;

use compiled::{built, compile, root, run, ur5e};

/// The system's allocator, which also counts the allocations of this thread.
struct Counting;

thread_local! {
    static COUNT: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: every call is forwarded to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.with(|c| c.set(c.get() + 1));
        // SAFETY: guaranteed by the caller.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        // SAFETY: guaranteed by the caller.
        unsafe { System.dealloc(at, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn the_header_is_current() {
    let config = cbindgen::Config::from_file(root().join("cbindgen.toml")).expect("a configuration");
    let made = cbindgen::generate_with_config(root(), config).expect("a header");
    let mut text = Vec::new();
    made.write(&mut text);
    let header = root().join("include/gensim2_kpam.h");
    if std::env::var_os("GENSIM2_WRITE_HEADER").is_some() {
        std::fs::write(&header, &text).expect("the header is written");
    }
    let there = std::fs::read(&header).unwrap_or_default();
    assert!(there == text, "include/gensim2_kpam.h is not current: run this test with GENSIM2_WRITE_HEADER=1");
}

#[test]
fn sampling_allocates_nothing() {
    let (velocity, acceleration, jerk) = ([1.0; 2], [5.0; 2], [500.0; 2]);
    let waypoints = [0.0, 0.0, 1.0, 0.4, 0.2, 1.0];
    let mut motion = std::ptr::null_mut();
    let still = std::ptr::null();
    // SAFETY: the arrays have the stated lengths.
    let status = unsafe {
        let limits = [velocity.as_ptr(), acceleration.as_ptr(), jerk.as_ptr()];
        kpam_retime(waypoints.as_ptr(), 3, 2, limits[0], limits[1], limits[2], still, still, 0.0, &raw mut motion)
    };
    assert_eq!(status, kpam_status::KPAM_OK);
    // SAFETY: the motion has not been freed.
    let end = unsafe { kpam_trajectory_end(motion) };
    let [mut q, mut v, mut a] = [[0.0; 2]; 3];
    let before = COUNT.with(Cell::get);
    for k in 0..=1000 {
        let t = end * f64::from(k) / 1000.0;
        // SAFETY: guaranteed by the caller.
        let status = unsafe { kpam_trajectory_sample_into(motion, t, q.as_mut_ptr(), v.as_mut_ptr(), a.as_mut_ptr()) };
        assert_eq!(status, kpam_status::KPAM_OK);
    }
    assert_eq!(COUNT.with(Cell::get), before);
    assert!((q[0] - 0.2).abs() < 1e-9 && (q[1] - 1.0).abs() < 1e-9, "{q:?}");
    // SAFETY: the motion is freed once.
    unsafe { kpam_trajectory_free(motion) };
}

#[test]
fn a_program_in_c_drives_a_motion_at_1_khz() {
    let program = compile("examples/servo.c");
    let said = run(&program, &[&ur5e(), Path::new("flange")]);
    assert!(said.contains("refused: q_start is null"), "{said}");
    let missing = Command::new(&program).args(["no.urdf", "flange"]).output().expect("the program runs");
    assert!(String::from_utf8_lossy(&missing.stderr).contains("no.urdf"));
}

#[test]
fn a_program_in_c_picks_and_places_a_part() {
    let said = run(&compile("examples/pick.c"), &[&ur5e()]);
    for part in ["4 postures above the part", "warning: limits on acceleration", "new goal: ", "planning was cancelled"]
    {
        assert!(said.contains(part), "{part:?} is missing in {said}");
    }
}

#[test]
fn the_header_is_valid_c_plus_plus() {
    let source = built().join("gensim2_header.cpp");
    std::fs::write(
        &source,
        "#include \"gensim2_kpam.h\"\nint main() { return kpam_abi_version() != KPAM_ABI_VERSION; }\n",
    )
    .unwrap();
    let compiled = Command::new("c++")
        .args(["-std=c++11", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-fsyntax-only"])
        .arg(format!("-I{}", root().join("include").display()))
        .arg(&source)
        .output()
        .expect("c++ is needed to test the header");
    assert!(compiled.status.success(), "{}", String::from_utf8_lossy(&compiled.stderr));
}

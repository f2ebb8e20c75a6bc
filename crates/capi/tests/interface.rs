//! The header is current, a C program runs a motion with the interface, and sampling allocates no memory.
#![allow(clippy::unwrap_used)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::process::Command;

use gensim2_capi::{kpam_retime, kpam_status, kpam_trajectory_end, kpam_trajectory_free, kpam_trajectory_sample_into};

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

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

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

/// Returns the folder with the library that was built together with this test.
fn built() -> PathBuf {
    let program = std::env::current_exe().unwrap();
    let above: Vec<&Path> = program.ancestors().skip(1).take(2).collect();
    above.iter().find(|folder| folder.join("libgensim2_capi.so").is_file()).unwrap().to_path_buf()
}

#[test]
fn a_program_in_c_drives_a_motion_at_1_khz() {
    let folder = built();
    let program = folder.join("gensim2_servo");
    let compiled = Command::new("cc")
        .args(["-std=c11", "-Wall", "-Wextra", "-Werror", "-O1"])
        .arg(format!("-I{}", root().join("include").display()))
        .arg(root().join("examples/servo.c"))
        .arg(format!("-L{}", folder.display()))
        .arg(format!("-Wl,-rpath,{}", folder.display()))
        .args(["-lgensim2_capi", "-lm", "-o"])
        .arg(&program)
        .output()
        .expect("cc is needed to test the interface");
    assert!(compiled.status.success(), "{}", String::from_utf8_lossy(&compiled.stderr));
    let urdf: &Path = &root().join("../../examples/robots/ur5.urdf");
    let run = Command::new(&program).arg(urdf).arg("flange").output().expect("the program runs");
    let (said, complained) = (String::from_utf8_lossy(&run.stdout), String::from_utf8_lossy(&run.stderr));
    assert!(run.status.success(), "{said}{complained}");
    assert!(said.contains("refused: q_start is null"), "{said}");
    let missing = Command::new(&program).args(["no.urdf", "flange"]).output().expect("the program runs");
    assert!(String::from_utf8_lossy(&missing.stderr).contains("no.urdf"));
}

//! Any text as a URDF, and its own text as an SRDF: an error or a robot that can be posed, never a panic.
#![no_main]

use gensim2_geometry::{ChainFrames, Robot};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let Ok(text) = std::str::from_utf8(data) else { return };
    for srdf in [None, Some(text)] {
        if let Ok(robot) = Robot::from_urdf_str(text, "fuzz.urdf", srdf, "hand", None) {
            let q = vec![0.1; robot.joints().len()];
            let mut poses = Vec::new();
            robot.link_poses(&q, &mut poses).unwrap();
            robot.chain().forward(&q, &mut ChainFrames::default()).unwrap();
        }
    }
});

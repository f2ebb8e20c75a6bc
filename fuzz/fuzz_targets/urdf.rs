//! Any bytes as a URDF and as an OBJ file, any text as a robot with its own text as an SRDF: an error, or a robot that can
//! be posed; never a panic.
#![no_main]

use gensim2_geometry::{ChainFrames, Description, Obj, Robot};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let _ = (Description::read(data, "fuzz.urdf"), Obj::read(data));
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

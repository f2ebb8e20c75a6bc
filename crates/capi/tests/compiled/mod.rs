//! Compiles C programs with the interface and runs them.
#![allow(clippy::expect_used, clippy::unwrap_used)]

use std::path::{Path, PathBuf};
use std::process::Command;

/// The crate's folder.
pub fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// The description of a UR5e.
pub fn ur5e() -> PathBuf {
    root().join("../../examples/robots/ur5e.urdf")
}

/// Returns the folder with the library that was built together with this test.
pub fn built() -> PathBuf {
    let program = std::env::current_exe().unwrap();
    let above: Vec<&Path> = program.ancestors().skip(1).take(2).collect();
    above.iter().find(|folder| folder.join("libgensim2_capi.so").is_file()).unwrap().to_path_buf()
}

/// Compiles a program, relative to the crate's folder, without warnings, and returns its path.
pub fn compile(source: &str) -> PathBuf {
    let folder = built();
    let name = Path::new(source).file_stem().unwrap().to_str().unwrap();
    let program = folder.join(format!("gensim2_{name}"));
    let compiled = Command::new("cc")
        .args(["-std=c11", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O1"])
        .arg(format!("-I{}", root().join("include").display()))
        .arg(root().join(source))
        .arg(format!("-L{}", folder.display()))
        .arg(format!("-Wl,-rpath,{}", folder.display()))
        .args(["-lgensim2_capi", "-lm", "-lpthread", "-o"])
        .arg(&program)
        .output()
        .expect("cc is needed to test the interface");
    assert!(compiled.status.success(), "{}", String::from_utf8_lossy(&compiled.stderr));
    program
}

/// Runs a program, which must succeed, and returns its output.
pub fn run(program: &Path, arguments: &[&Path]) -> String {
    let run = Command::new(program).args(arguments).output().expect("the program runs");
    let (said, complained) = (String::from_utf8_lossy(&run.stdout), String::from_utf8_lossy(&run.stderr));
    assert!(run.status.success(), "{said}{complained}");
    said.into_owned()
}

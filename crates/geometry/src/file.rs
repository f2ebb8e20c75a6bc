//! Reads files named by the user. Only regular files of bounded size are opened, never pipes, devices or folders.

use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Maximum size of a URDF or SRDF file (bytes).
pub(crate) const MAX_XML: u64 = 16 << 20;
/// Maximum size of a mesh file (bytes).
pub(crate) const MAX_MESH: u64 = 256 << 20;

/// Returns the content of a file, or the reason why it cannot be read.
pub(crate) fn read(path: &Path, max_bytes: u64) -> Result<Vec<u8>, String> {
    let unreadable = |e: std::io::Error| format!("cannot be read: {e}");
    if !std::fs::metadata(path).map_err(unreadable)?.is_file() {
        return Err("is not a regular file".to_owned());
    }
    let mut content = Vec::new();
    File::open(path).and_then(|file| file.take(max_bytes + 1).read_to_end(&mut content)).map_err(unreadable)?;
    if content.len() as u64 > max_bytes {
        return Err(format!("is larger than {} MiB", max_bytes >> 20));
    }
    Ok(content)
}

#[cfg(test)]
mod tests {
    use crate::Robot;

    fn refusal(mesh: &str, scale: &str) -> String {
        let text = format!(
            r#"<robot name="a"><link name="l"><collision><geometry><mesh filename="{mesh}" scale="{scale}"/>
            </geometry></collision></link></robot>"#
        );
        Robot::from_urdf_str(&text, "a.urdf", None, "l", None).unwrap_err().to_string()
    }

    #[test]
    fn devices_and_folders_are_never_read() {
        assert!(refusal("/dev/zero", "1 1 1").contains("mesh /dev/zero is not a regular file"));
        assert!(refusal("/", "1 1 1").contains("is not a regular file"));
        assert!(
            Robot::from_urdf("/dev/zero", None, "l", None, &[], None)
                .unwrap_err()
                .to_string()
                .contains("is not a regular")
        );
    }

    #[test]
    fn a_scale_of_zero_is_named() {
        assert!(refusal("flat.obj", "1 0 1").contains("mesh.scale: a factor is 0"));
    }

    #[test]
    fn links_of_one_name_are_refused() {
        let text = r#"<robot name="a"><link name="l"/><link name="l"/></robot>"#;
        let refused = Robot::from_urdf_str(text, "a.urdf", None, "l", None).unwrap_err().to_string();
        assert!(refused.contains("link l"), "{refused}");
    }
}

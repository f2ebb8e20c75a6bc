//! Finds the mesh files that a URDF names, also by the name of a ROS package.

use std::path::{Path, PathBuf};

/// Maximum depth of a package below a folder of the search path.
const DEEPEST: usize = 3;
/// Environment variables that list folders of packages: ROS 1, and ROS 2, whose packages are in the subfolder `share`.
const PATHS: [(&str, &str); 2] = [("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share")];

/// Returns candidate paths of a mesh relative to the URDF's folder: as written; a URI without its scheme and package;
/// with URI escapes decoded; with slashes in place of backslashes.
pub(crate) fn candidates(filename: &str) -> Vec<String> {
    let (scheme, inside) = filename.split_once("://").map_or(("", filename), |(s, rest)| (s, rest));
    let mut out = match scheme.to_ascii_lowercase().as_str() {
        "package" | "model" => {
            let package = inside.trim_start_matches('/');
            let rest = package.split_once(['/', '\\']).map(|(_, rest)| rest.to_owned());
            std::iter::once(package.to_owned()).chain(rest).collect()
        }
        "file" => vec![inside.strip_prefix("localhost/").map_or(inside.to_owned(), |path| format!("/{path}"))],
        _ => vec![filename.to_owned()],
    };
    if !scheme.is_empty() {
        out.extend(out.clone().iter().filter(|p| p.contains('%')).map(|p| unescaped(p)));
    }
    out.extend(out.clone().iter().filter(|p| p.contains('\\')).map(|p| p.replace('\\', "/")));
    out
}

/// Decodes the escapes of a URI, such as `%20`.
pub(crate) fn unescaped(text: &str) -> String {
    let (bytes, mut out) = (text.as_bytes(), Vec::with_capacity(text.len()));
    let mut i = 0;
    while i < bytes.len() {
        let code = text.get(i + 1..i + 3).filter(|_| bytes[i] == b'%').and_then(|hex| u8::from_str_radix(hex, 16).ok());
        out.push(code.unwrap_or(bytes[i]));
        i += if code.is_some() { 3 } else { 1 };
    }
    String::from_utf8_lossy(&out).into_owned()
}

/// Returns the file of a mesh. `paths` are its [`candidates`], `folder` is the URDF's folder, and `package_dirs` are
/// folders of packages, or packages themselves.
///
/// A file of a package is searched in `package_dirs`, in the folders that `ROS_PACKAGE_PATH` and `AMENT_PREFIX_PATH`
/// name, and in the folders above the URDF. If no folder has the package's name, the file may lie in any folder above the
/// URDF that is not another package.
pub(crate) fn resolve(
    filename: &str,
    paths: &[String],
    folder: &Path,
    package_dirs: &[PathBuf],
) -> Result<PathBuf, String> {
    let is_package = ["package://", "model://"]
        .iter()
        .any(|scheme| filename.get(..scheme.len()).is_some_and(|start| start.eq_ignore_ascii_case(scheme)));
    if !is_package {
        let at = |path: &String| folder.join(path);
        let found = paths.iter().map(at).find(|path| path.is_file());
        return Ok(found.or_else(|| paths.first().map(at)).unwrap_or_default());
    }
    // The first part of a candidate is the package, or the candidate has no package.
    let inside = paths.first().map_or("", String::as_str);
    let package = inside.split(['/', '\\']).next().unwrap_or_default();
    let (named, plain): (Vec<&String>, Vec<&String>) =
        paths.iter().partition(|path| path.split(['/', '\\']).next() == Some(package));
    let within = |path: &String| path.split_once(['/', '\\']).map(|(_, rest)| rest.to_owned());
    let rests: Vec<String> = named.iter().filter_map(|path| within(path)).collect();
    let in_package = |root: &Path| rests.iter().map(|rest| root.join(rest)).find(|path| path.is_file());
    let listed = PATHS.iter().flat_map(|(variable, below)| {
        let value = std::env::var_os(variable).unwrap_or_default();
        std::env::split_paths(&value).filter(|p| !p.as_os_str().is_empty()).map(|p| p.join(below)).collect::<Vec<_>>()
    });
    for place in package_dirs.iter().cloned().chain(listed) {
        if let Some(found) = find_package(&place, package, DEEPEST).and_then(|root| in_package(&root)) {
            return Ok(found);
        }
    }
    let above = || folder.ancestors().filter(|place| !place.as_os_str().is_empty() || *place == folder);
    let by_name = above().flat_map(|place| {
        let itself = is_named(place, package).then(|| place.to_owned());
        itself.into_iter().chain([place.join(package)])
    });
    if let Some(found) = by_name.into_iter().find_map(|root| in_package(&root)) {
        return Ok(found);
    }
    let other = |place: &Path| package_name(place).is_some_and(|name| name != package);
    let anywhere = above().filter(|place| !other(place));
    if let Some(found) = anywhere
        .into_iter()
        .flat_map(|place| plain.iter().map(move |path| place.join(path)))
        .find(|path| path.is_file())
    {
        return Ok(found);
    }
    let why = "no such file in package_dirs, ROS_PACKAGE_PATH, AMENT_PREFIX_PATH or the folders above the URDF";
    Err(format!("{filename} was not found: {why}; pass package_dirs=[\"FOLDER\"], the folder that contains {package}"))
}

/// Returns the folder of a package: `place` itself or a folder at most `depth` levels below it.
fn find_package(place: &Path, package: &str, depth: usize) -> Option<PathBuf> {
    if is_named(place, package) {
        return Some(place.to_owned());
    }
    let inside = place.join(package);
    if inside.is_dir() {
        return Some(inside);
    }
    // As in ROS, packages do not contain packages.
    if depth == 0 || place.join("package.xml").is_file() {
        return None;
    }
    let mut folders: Vec<PathBuf> = std::fs::read_dir(place).ok()?.flatten().map(|entry| entry.path()).collect();
    folders.retain(|path| path.is_dir());
    folders.sort();
    folders.iter().find_map(|below| find_package(below, package, depth - 1))
}

/// Whether a folder is a package: by the name in its `package.xml`, or without this file by its own name.
fn is_named(folder: &Path, package: &str) -> bool {
    match package_name(folder) {
        Some(name) => name == package,
        None => folder.file_name().is_some_and(|name| name == package),
    }
}

/// Returns the name in the `package.xml` of a folder, if there is one.
fn package_name(folder: &Path) -> Option<String> {
    let content = crate::file::read(&folder.join("package.xml"), crate::file::MAX_XML).ok()?;
    let text = String::from_utf8_lossy(&content).into_owned();
    let start = text.find("<name>")? + "<name>".len();
    Some(text[start..].split('<').next()?.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::candidates;

    #[test]
    fn mesh_names_are_paths_and_uris() {
        assert_eq!(candidates("a/b.stl"), ["a/b.stl"]);
        assert_eq!(candidates("package://arm/m/b.stl"), ["arm/m/b.stl", "m/b.stl"]);
        assert_eq!(candidates("file:///m/a%20b.stl"), ["/m/a%20b.stl", "/m/a b.stl"]);
        assert_eq!(candidates("FILE://localhost/b.stl"), ["/b.stl"]);
        assert_eq!(candidates("m\\b.stl"), ["m\\b.stl", "m/b.stl"]);
        let mixed = ["arm\\m\\b.stl", "m\\b.stl", "arm/m/b.stl", "m/b.stl"];
        assert_eq!(candidates("package://arm\\m\\b.stl"), mixed);
    }
}

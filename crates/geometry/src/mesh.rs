//! Vertices and triangles of STL (binary and text) and OBJ files.

use std::path::Path;

use nalgebra::Point3;

/// A triangle soup.
pub(crate) struct Mesh {
    pub vertices: Vec<Point3<f64>>,
}

/// Reads a mesh, or says why not.
pub(crate) fn read(path: &Path) -> Result<Mesh, String> {
    let bytes = std::fs::read(path).map_err(|e| format!("cannot read mesh {}: {e}", path.display()))?;
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
    let vertices = match extension.as_str() {
        "stl" => stl(&bytes),
        "obj" => obj(&bytes),
        _ => Err(format!("collision meshes are read from .stl and .obj, not .{extension}; convert it")),
    }
    .map_err(|e| format!("mesh {}: {e}", path.display()))?;
    if vertices.is_empty() {
        return Err(format!("mesh {} has no vertices", path.display()));
    }
    if vertices.iter().any(|v| v.iter().any(|c| !c.is_finite())) {
        return Err(format!("mesh {} has a vertex that is not finite", path.display()));
    }
    Ok(Mesh { vertices })
}

fn stl(bytes: &[u8]) -> Result<Vec<Point3<f64>>, String> {
    // A text file may claim to be binary by its length alone, and binary headers may begin with "solid": only the
    // exact length of a binary file decides.
    let count = bytes.get(80..84).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize);
    match count {
        Some(n) if n.checked_mul(50).and_then(|b| b.checked_add(84)) == Some(bytes.len()) => Ok(binary_stl(bytes, n)),
        _ => text_stl(bytes),
    }
}

fn binary_stl(bytes: &[u8], triangles: usize) -> Vec<Point3<f64>> {
    let float = |at: usize| f64::from(f32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]));
    let mut out = Vec::with_capacity(triangles * 3);
    for t in 0..triangles {
        let start = 84 + 50 * t + 12;
        for v in 0..3 {
            let at = start + 12 * v;
            out.push(Point3::new(float(at), float(at + 4), float(at + 8)));
        }
    }
    out
}

fn text_stl(bytes: &[u8]) -> Result<Vec<Point3<f64>>, String> {
    let text =
        std::str::from_utf8(bytes).map_err(|_| "neither a binary STL of the right length nor text".to_owned())?;
    let mut out = Vec::new();
    for (number, line) in text.lines().enumerate() {
        if let Some(rest) = line.trim_start().strip_prefix("vertex") {
            out.push(three_numbers(rest, number)?);
        }
    }
    Ok(out)
}

fn obj(bytes: &[u8]) -> Result<Vec<Point3<f64>>, String> {
    let text = String::from_utf8_lossy(bytes);
    let mut out = Vec::new();
    for (number, line) in text.lines().enumerate() {
        if let Some(rest) = line.trim_start().strip_prefix("v ") {
            out.push(three_numbers(rest, number)?);
        }
    }
    Ok(out)
}

fn three_numbers(text: &str, line: usize) -> Result<Point3<f64>, String> {
    let mut words = text.split_whitespace().map(str::parse::<f64>);
    match (words.next(), words.next(), words.next()) {
        (Some(Ok(x)), Some(Ok(y)), Some(Ok(z))) => Ok(Point3::new(x, y, z)),
        _ => Err(format!("line {}: expected three numbers", line + 1)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_both_kinds_of_stl() {
        let text = b"solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 2.5 0\nendloop\nendfacet\nendsolid";
        assert_eq!(stl(text).unwrap()[2], Point3::new(0.0, 2.5, 0.0));
        let mut binary = vec![0u8; 80];
        binary.extend(1u32.to_le_bytes());
        for v in [0.0f32, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 2.5, 0.0] {
            binary.extend(v.to_le_bytes());
        }
        binary.extend([0, 0]);
        assert_eq!(stl(&binary).unwrap()[2], Point3::new(0.0, 2.5, 0.0));
    }

    #[test]
    fn a_broken_line_is_named() {
        assert!(text_stl(b"solid\nvertex 1 2\n").unwrap_err().contains("line 2"));
        assert!(obj(b"v 1 2 x\n").unwrap_err().contains("line 1"));
    }
}

//! Vertices of STL (binary and text), PLY (binary and text) and OBJ files.

use std::path::Path;

use nalgebra::Point3;

use crate::file;

/// Reads the vertices of a mesh, or says why not.
pub(crate) fn read(path: &Path) -> Result<Vec<Point3<f64>>, String> {
    let bytes = file::read(path, file::MAX_MESH).map_err(|e| format!("mesh {} {e}", path.display()))?;
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
    let vertices = match extension.as_str() {
        "stl" => stl(&bytes),
        "obj" => obj(&bytes),
        "ply" => ply(&bytes),
        _ => Err(format!("collision meshes are read from .stl, .ply and .obj, not .{extension}; convert it")),
    }
    .map_err(|e| format!("mesh {}: {e}", path.display()))?;
    if vertices.is_empty() {
        return Err(format!("mesh {} has no vertices", path.display()));
    }
    if vertices.iter().any(|v| v.iter().any(|c| !c.is_finite())) {
        return Err(format!("mesh {} has a vertex that is not finite", path.display()));
    }
    Ok(vertices)
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

/// Vertices of a PLY file; faces do not matter for a hull.
fn ply(bytes: &[u8]) -> Result<Vec<Point3<f64>>, String> {
    const END: &[u8] = b"end_header";
    let end = bytes.windows(END.len()).position(|w| w == END).ok_or("PLY header has no end_header")?;
    let header = std::str::from_utf8(&bytes[..end]).map_err(|_| "PLY header is not text")?;
    let body_start = end + bytes[end..].iter().position(|b| *b == b'\n').ok_or("PLY has no body")? + 1;
    let body = &bytes[body_start..];
    let (mut format, mut count, mut inside) = ("", None, false);
    // Name, kind and byte offset of each vertex property.
    let (mut properties, mut stride) = (Vec::new(), 0_usize);
    for line in header.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words.as_slice() {
            ["format", kind, ..] => format = kind,
            ["element", "vertex", n] => {
                if !properties.is_empty() || count.is_some() {
                    return Err("PLY names its vertices twice".to_owned());
                }
                count = Some(n.parse::<usize>().map_err(|_| format!("{n} vertices"))?);
                inside = true;
            }
            ["element", ..] => {
                if count.is_none() {
                    return Err("PLY does not begin with its vertices".to_owned());
                }
                inside = false;
            }
            ["property", "list", ..] if inside => return Err("PLY vertices hold a list".to_owned()),
            ["property", kind, name] if inside => {
                let size = match *kind {
                    "char" | "uchar" | "int8" | "uint8" => 1,
                    "short" | "ushort" | "int16" | "uint16" => 2,
                    "int" | "uint" | "int32" | "uint32" | "float" | "float32" => 4,
                    "double" | "float64" => 8,
                    other => return Err(format!("PLY property type {other}")),
                };
                properties.push((*name, *kind, stride));
                stride += size;
            }
            _ => {}
        }
    }
    let count = count.ok_or("PLY has no vertices")?;
    let place = |name: &str| properties.iter().position(|(n, _, _)| *n == name).ok_or(format!("PLY lacks {name}"));
    let columns = [place("x")?, place("y")?, place("z")?];
    let big = match format {
        "ascii" => {
            let text = std::str::from_utf8(body).map_err(|_| "PLY body is not text")?;
            let row = |(i, line): (usize, &str)| {
                let words: Vec<&str> = line.split_whitespace().collect();
                let numbers: Vec<&str> = columns.iter().filter_map(|c| words.get(*c).copied()).collect();
                three_numbers(&numbers.join(" "), i)
            };
            let out = text.lines().take(count).enumerate().map(row).collect::<Result<Vec<_>, _>>()?;
            return if out.len() == count { Ok(out) } else { Err("PLY is cut short".to_owned()) };
        }
        "binary_little_endian" => false,
        "binary_big_endian" => true,
        other => return Err(format!("PLY format {other:?}")),
    };
    let vertices = stride.checked_mul(count).and_then(|n| body.get(..n)).ok_or("PLY is cut short")?;
    let number = |row: &[u8], column: usize| {
        let (_, kind, at) = properties[column];
        let mut word = [0u8; 8];
        match kind {
            "float" | "float32" => {
                word[..4].copy_from_slice(&row[at..at + 4]);
                if big {
                    word[..4].reverse();
                }
                Ok(f64::from(f32::from_le_bytes([word[0], word[1], word[2], word[3]])))
            }
            "double" | "float64" => {
                word.copy_from_slice(&row[at..at + 8]);
                if big {
                    word.reverse();
                }
                Ok(f64::from_le_bytes(word))
            }
            other => Err(format!("PLY coordinates of type {other}")),
        }
    };
    vertices
        .chunks_exact(stride.max(1))
        .map(|row| Ok(Point3::new(number(row, columns[0])?, number(row, columns[1])?, number(row, columns[2])?)))
        .collect()
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
    fn reads_ply() {
        let header = |format: &str| {
            format!(
                "ply\nformat {format} 1.0\nelement vertex 1\nproperty uchar r\nproperty float x\n\
                     property float y\nproperty double z\nelement face 0\nproperty list uchar int i\nend_header\n"
            )
        };
        let mut binary = header("binary_little_endian").into_bytes();
        binary.push(7);
        binary.extend(1.5f32.to_le_bytes());
        binary.extend(2.5f32.to_le_bytes());
        binary.extend(3.5f64.to_le_bytes());
        assert_eq!(ply(&binary).unwrap(), [Point3::new(1.5, 2.5, 3.5)]);
        let text = header("ascii") + "7 1.5 2.5 3.5\n";
        assert_eq!(ply(text.as_bytes()).unwrap(), [Point3::new(1.5, 2.5, 3.5)]);
        assert!(ply(&binary[..binary.len() - 1]).is_err());
        assert!(ply(b"ply\nend_header").is_err());
    }

    #[test]
    fn a_broken_line_is_named() {
        assert!(text_stl(b"solid\nvertex 1 2\n").unwrap_err().contains("line 2"));
        assert!(obj(b"v 1 2 x\n").unwrap_err().contains("line 1"));
    }
}

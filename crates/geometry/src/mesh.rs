//! Reads surfaces from STL and PLY (binary and text), OBJ, COLLADA and glTF files.

use std::path::Path;

use nalgebra::Point3;

use crate::obj::Obj;
use crate::{dae, file, gltf, ply};

/// A surface (m) that was read from a file.
#[derive(Debug, Default, Clone)]
pub(crate) struct Surface {
    /// Vertices of the faces. Vertices that no face uses are dropped.
    pub vertices: Vec<Point3<f64>>,
    /// The faces, as triangles.
    pub triangles: Vec<[Point3<f64>; 3]>,
}

impl Surface {
    /// Creates a surface from all vertices of a file, and the vertices of each triangle.
    fn new<'f>(vertices: &[[f64; 3]], faces: impl Iterator<Item = &'f [u32; 3]> + Clone) -> Self {
        let triangles = faces.clone().map(|face| face.map(|v| Point3::from(vertices[v as usize]))).collect();
        Self { vertices: used(vertices, faces), triangles }
    }

    /// Creates a surface from the vertices of triangles, three for each.
    fn of_corners(vertices: Vec<Point3<f64>>) -> Self {
        let triangles = vertices.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect();
        Self { vertices, triangles }
    }
}

/// Returns the surface in a mesh file, or the reason why it cannot be read.
pub(crate) fn read(path: &Path) -> Result<Surface, String> {
    let bytes = file::read(path, file::MAX_MESH).map_err(|e| format!("{} {e}", path.display()))?;
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
    let surface = match extension.as_str() {
        "stl" => stl(&bytes).map(Surface::of_corners),
        "obj" => {
            Obj::read(&bytes).map(|obj| Surface::new(&obj.vertices, obj.groups.iter().flat_map(|(_, faces)| faces)))
        }
        "ply" => ply::read(&bytes).map(|(vertices, faces)| Surface::new(&vertices, faces.iter())),
        "dae" => dae::read(&bytes),
        "glb" | "gltf" => gltf::read(&bytes, path),
        _ => Err(format!(
            "collision meshes are read from .stl, .ply, .obj, .dae, .glb and .gltf, not .{extension}; convert it"
        )),
    }
    .map_err(|e| format!("{}: {e}", path.display()))?;
    if surface.vertices.is_empty() {
        return Err(format!("{} has no faces", path.display()));
    }
    if surface.vertices.iter().any(|v| v.iter().any(|c| !c.is_finite())) {
        return Err(format!("{} has a vertex that is not finite", path.display()));
    }
    Ok(surface)
}

/// Limit of a reader's work on a scene. A node of a scene may refer to meshes and to other nodes, so a small file can
/// describe a scene without end. Each visit of a node or vertex counts.
#[derive(Default)]
pub(crate) struct Visited(usize);

impl Visited {
    /// Maximum depth of nodes, which may refer to each other.
    const DEEPEST: usize = 64;
    /// Maximum count.
    const MOST: usize = 20_000_000;
    /// Number of vertices that a node counts for.
    const NODE: usize = 100;

    /// Counts a node at a depth below the scene.
    pub fn node(&mut self, depth: usize) -> Result<(), String> {
        if depth > Self::DEEPEST {
            return Err(format!("has nodes nested more than {} levels deep", Self::DEEPEST));
        }
        self.vertices(Self::NODE)
    }

    /// Counts vertices, or entries of faces.
    pub fn vertices(&mut self, count: usize) -> Result<(), String> {
        self.0 += count;
        if self.0 > Self::MOST {
            return Err(format!("has more than {} nodes and vertices, with repetitions", Self::MOST));
        }
        Ok(())
    }
}

/// Returns only the vertices that belong to a face.
fn used<'f>(vertices: &[[f64; 3]], faces: impl IntoIterator<Item = &'f [u32; 3]>) -> Vec<Point3<f64>> {
    let mut in_use = vec![false; vertices.len()];
    faces.into_iter().flatten().for_each(|v| in_use[*v as usize] = true);
    vertices.iter().zip(in_use).filter(|(_, used)| *used).map(|(v, _)| Point3::from(*v)).collect()
}

/// Returns the lines of a text, with any kind of line ending.
pub(crate) fn lines(text: &str) -> impl Iterator<Item = &str> {
    text.split('\n').flat_map(|line| line.strip_suffix('\r').unwrap_or(line).split('\r'))
}

pub(crate) fn three_numbers<'w>(words: impl Iterator<Item = &'w str>, line: usize) -> Result<[f64; 3], String> {
    let mut numbers = words.map(str::parse::<f64>);
    match (numbers.next(), numbers.next(), numbers.next()) {
        (Some(Ok(x)), Some(Ok(y)), Some(Ok(z))) => Ok([x, y, z]),
        (Some(_), Some(_), Some(_)) => Err(format!("line {}: a vertex is not three numbers", line + 1)),
        _ => Err(format!("line {}: a vertex has fewer than three numbers", line + 1)),
    }
}

fn stl(bytes: &[u8]) -> Result<Vec<Point3<f64>>, String> {
    // Binary files may also begin with "solid", so only the exact length of the file shows that it is binary.
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
    for (number, line) in lines(text).enumerate() {
        let mut words = line.split_whitespace();
        if words.next().is_some_and(|word| word.eq_ignore_ascii_case("vertex")) {
            out.push(Point3::from(three_numbers(words, number)?));
        }
    }
    if out.len() % 3 == 0 { Ok(out) } else { Err("is cut short: a facet lacks vertices".to_owned()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_both_kinds_of_stl() {
        let text = "solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n\tVERTEX\t0 2.5 0\nendloop";
        for ends in ["\n", "\r\n", "\r"] {
            let text = text.replace('\n', ends);
            assert_eq!(stl(text.as_bytes()).unwrap()[2], Point3::new(0.0, 2.5, 0.0));
            assert_eq!(stl(text.to_uppercase().as_bytes()).unwrap().len(), 3);
        }
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
        assert!(text_stl(b"solid\nvertex 1 2 3\n").unwrap_err().contains("cut short"));
    }
}

//! Reads surfaces from glTF 2.0 files (.glb and .gltf).

use std::borrow::Cow;
use std::path::Path;

use nalgebra::{Matrix4, Point3, Quaternion, UnitQuaternion, Vector3};
use serde::Deserialize;

use crate::file;
use crate::mesh::{Surface, Visited};
use crate::mesh_path::unescaped;

/// Component types of accessors.
const U8: u32 = 5121;
const U16: u32 = 5123;
const U32: u32 = 5125;
const FLOAT: u32 = 5126;
/// Modes of primitives that consist of triangles: triangles, strips and fans.
const TRIANGLES: [u32; 3] = [4, 5, 6];

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Document {
    scene: Option<usize>,
    #[serde(default)]
    scenes: Vec<Scene>,
    #[serde(default)]
    nodes: Vec<Node>,
    #[serde(default)]
    meshes: Vec<Mesh>,
    #[serde(default)]
    accessors: Vec<Accessor>,
    #[serde(default)]
    buffer_views: Vec<View>,
    #[serde(default)]
    buffers: Vec<Buffer>,
    #[serde(default)]
    extensions_required: Vec<String>,
}

#[derive(Deserialize)]
struct Scene {
    #[serde(default)]
    nodes: Vec<usize>,
}

#[derive(Deserialize)]
struct Node {
    #[serde(default)]
    children: Vec<usize>,
    mesh: Option<usize>,
    matrix: Option<[f64; 16]>,
    translation: Option<[f64; 3]>,
    rotation: Option<[f64; 4]>,
    scale: Option<[f64; 3]>,
}

#[derive(Deserialize)]
struct Mesh {
    primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
struct Primitive {
    attributes: Attributes,
    indices: Option<usize>,
    mode: Option<u32>,
}

#[derive(Deserialize)]
struct Attributes {
    #[serde(rename = "POSITION")]
    position: Option<usize>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Accessor {
    buffer_view: Option<usize>,
    #[serde(default)]
    byte_offset: usize,
    component_type: u32,
    count: usize,
    #[serde(rename = "type")]
    kind: String,
    sparse: Option<serde_json::Value>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct View {
    buffer: usize,
    #[serde(default)]
    byte_offset: usize,
    byte_length: usize,
    byte_stride: Option<usize>,
}

#[derive(Deserialize)]
struct Buffer {
    uri: Option<String>,
}

/// Returns all faces (m) in the scene of a glTF file with the given content and path. The file may name
/// further files with vertices; their names are relative to the folder of `path`. glTF defines y as the up axis, but the
/// vertices are returned without a rotation.
pub(crate) fn read(content: &[u8], path: &Path) -> Result<Surface, String> {
    let (json, binary) = match content.strip_prefix(b"glTF") {
        Some(_) => chunks(content)?,
        None => (content, None),
    };
    let document: Document = serde_json::from_slice(json).map_err(|e| format!("is not glTF 2.0: {e}"))?;
    if let Some(extension) = document.extensions_required.iter().find(|e| *e != "KHR_materials_unlit") {
        return Err(format!("needs the extension {extension}; export it without compression and extensions"));
    }
    let mut buffers = Vec::with_capacity(document.buffers.len());
    let mut left = file::MAX_MESH;
    for (number, buffer) in document.buffers.iter().enumerate() {
        let found = match &buffer.uri {
            None if number == 0 => Cow::Borrowed(binary.unwrap_or_default()),
            None => return Err(format!("buffer {number} has no file; only the first buffer may lie in the .glb file")),
            Some(uri) if uri.starts_with("data:") => {
                return Err("contains its buffers as text (data:); save it as .glb".to_owned());
            }
            Some(uri) => {
                let beside = path.parent().map(|folder| folder.join(unescaped(uri))).unwrap_or_default();
                let content = file::read(&beside, left).map_err(|e| format!("buffer {}: {e}", beside.display()))?;
                left -= content.len() as u64;
                Cow::Owned(content)
            }
        };
        buffers.push(found);
    }
    let scene = document.scenes.get(document.scene.unwrap_or(0)).ok_or("has no scene; export the file again")?;
    let mut reader = Reader { document: &document, buffers, out: Surface::default(), visited: Visited::default() };
    for node in &scene.nodes {
        reader.walk(*node, &Matrix4::identity(), 0)?;
    }
    Ok(reader.out)
}

/// Splits a .glb file into its JSON and its binary buffer.
fn chunks(content: &[u8]) -> Result<(&[u8], Option<&[u8]>), String> {
    let cut = || "is cut short".to_owned();
    let word = |at: usize| {
        let bytes = content.get(at..at + 4).and_then(|b| <[u8; 4]>::try_from(b).ok()).ok_or_else(cut)?;
        Ok::<usize, String>(u32::from_le_bytes(bytes) as usize)
    };
    if word(4)? != 2 {
        return Err(format!("is glTF version {}; export it as version 2", word(4)?));
    }
    let length = word(12)?;
    let json = content.get(20..20_usize.saturating_add(length)).ok_or_else(cut)?;
    let next = 20 + length;
    if content.len() < next + 8 {
        return Ok((json, None));
    }
    let binary = content.get(next + 8..(next + 8).saturating_add(word(next)?)).ok_or_else(cut)?;
    Ok((json, Some(binary)))
}

struct Reader<'d> {
    document: &'d Document,
    buffers: Vec<Cow<'d, [u8]>>,
    out: Surface,
    visited: Visited,
}

impl Reader<'_> {
    fn walk(&mut self, node: usize, above: &Matrix4<f64>, depth: usize) -> Result<(), String> {
        let document = self.document;
        let node = document.nodes.get(node).ok_or_else(|| format!("names the node {node}, which does not exist"))?;
        self.visited.node(depth)?;
        let turn = node.rotation.map_or(UnitQuaternion::identity(), |[x, y, z, w]| {
            UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 1e-12).unwrap_or_else(UnitQuaternion::identity)
        });
        let here = above
            * match node.matrix {
                Some(matrix) => Matrix4::from_column_slice(&matrix),
                None => {
                    Matrix4::new_translation(&Vector3::from(node.translation.unwrap_or_default()))
                        * turn.to_homogeneous()
                        * Matrix4::new_nonuniform_scaling(&Vector3::from(node.scale.unwrap_or([1.0; 3])))
                }
            };
        if let Some(mesh) = node.mesh {
            let mesh =
                document.meshes.get(mesh).ok_or_else(|| format!("names the mesh {mesh}, which does not exist"))?;
            for primitive in mesh.primitives.iter().filter(|p| TRIANGLES.contains(&p.mode.unwrap_or(4))) {
                let Some(position) = primitive.attributes.position else { continue };
                let points = self.points(position)?;
                self.visited.vertices(points.len())?;
                let mut used = vec![primitive.indices.is_none(); points.len()];
                let indices = primitive.indices.map(|i| self.indices(i)).transpose()?.unwrap_or_default();
                self.visited.vertices(indices.len())?;
                for &index in &indices {
                    let place = used.get_mut(index);
                    *place.ok_or_else(|| format!("a face names the vertex {index}, which does not exist"))? = true;
                }
                let faces = points.iter().zip(used).filter(|(_, used)| *used);
                self.out.vertices.extend(faces.map(|(p, _)| here.transform_point(p)));
                let corners = if primitive.indices.is_none() { (0..points.len()).collect() } else { indices };
                let place = |v: usize| here.transform_point(&points[v]);
                self.out.triangles.extend(triangles(primitive.mode.unwrap_or(4), &corners).map(|t| t.map(place)));
            }
        }
        for below in &node.children {
            self.walk(*below, &here, depth + 1)?;
        }
        Ok(())
    }

    fn points(&self, accessor: usize) -> Result<Vec<Point3<f64>>, String> {
        let items = self.items(accessor, "VEC3", &[(FLOAT, 12)])?;
        let float = |b: &[u8]| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
        Ok(items.map(|b| Point3::new(float(b), float(&b[4..]), float(&b[8..]))).collect())
    }

    fn indices(&self, accessor: usize) -> Result<Vec<usize>, String> {
        let items = self.items(accessor, "SCALAR", &[(U8, 1), (U16, 2), (U32, 4)])?;
        Ok(items.map(|b| b.iter().rev().fold(0, |value, byte| value << 8 | usize::from(*byte))).collect())
    }

    /// Returns the bytes of each item of an accessor, which must have the type `kind` and one of the component types in
    /// `sizes`, each with the size (bytes) of an item.
    fn items(
        &self,
        accessor: usize,
        kind: &str,
        sizes: &[(u32, usize)],
    ) -> Result<impl Iterator<Item = &[u8]>, String> {
        let fail = |message: &str| format!("accessor {accessor}: {message}");
        let found = self.document.accessors.get(accessor).ok_or_else(|| fail("does not exist"))?;
        let size = sizes.iter().find(|(component, _)| *component == found.component_type && found.kind == kind);
        let Some((_, size)) = size.filter(|_| found.sparse.is_none()) else {
            return Err(fail("has a type that is not supported; export the mesh with plain positions and indices"));
        };
        let view =
            found.buffer_view.and_then(|v| self.document.buffer_views.get(v)).ok_or_else(|| fail("has no data"))?;
        let buffer = self.buffers.get(view.buffer).ok_or_else(|| fail("has no buffer"))?;
        let end = view.byte_offset.checked_add(view.byte_length);
        let data = end.and_then(|end| buffer.get(view.byte_offset..end)).and_then(|d| d.get(found.byte_offset..));
        let (data, stride) = (data.ok_or_else(|| fail("ends after the buffer"))?, view.byte_stride.unwrap_or(*size));
        let last = found.count.saturating_sub(1).checked_mul(stride).and_then(|start| start.checked_add(*size));
        if stride < *size || last.is_none_or(|end| found.count > 0 && end > data.len()) {
            return Err(fail("ends after the buffer"));
        }
        Ok((0..found.count).map(move |i| &data[i * stride..i * stride + size]))
    }
}

/// Returns the triangles of a primitive with one of the modes [`TRIANGLES`], from the sequence of its vertices.
fn triangles(mode: u32, corners: &[usize]) -> impl Iterator<Item = [usize; 3]> {
    let count = if mode == 4 { corners.len() / 3 } else { corners.len().saturating_sub(2) };
    (0..count).map(move |t| match mode {
        4 => [corners[3 * t], corners[3 * t + 1], corners[3 * t + 2]],
        // Every other triangle of a strip has the opposite orientation.
        5 => [corners[t], corners[t + 1 + t % 2], corners[t + 2 - t % 2]],
        _ => [corners[0], corners[t + 1], corners[t + 2]],
    })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use nalgebra::Point3;

    use super::read;

    /// Returns a .glb of one triangle and an unused vertex, shown by two nodes.
    fn file(change: impl Fn(&str) -> String) -> Vec<u8> {
        let json = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],
            "nodes":[{"translation":[0,0,1],"rotation":[0,0,0.7071067811865476,0.7071067811865476],"mesh":0,"children":[1]},
                     {"matrix":[2,0,0,0,0,2,0,0,0,0,2,0,5,0,0,1],"mesh":0}],
            "meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1},{"attributes":{},"mode":1}]}],
            "accessors":[{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3"},
                         {"bufferView":1,"componentType":5123,"count":3,"type":"SCALAR"}],
            "bufferViews":[{"buffer":0,"byteLength":48},{"buffer":0,"byteOffset":48,"byteLength":6}],
            "buffers":[{"byteLength":54}]}"#;
        let mut json = change(json).into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let mut binary = Vec::new();
        for value in [9.0_f32, 9.0, 9.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 2.0, 0.0] {
            binary.extend(value.to_le_bytes());
        }
        binary.extend([1_u16, 2, 3].iter().flat_map(|i| i.to_le_bytes()));
        let mut out = b"glTF".to_vec();
        let length = 28 + json.len() + binary.len();
        for word in [2, length as u32, json.len() as u32, 0x4E4F_534A] {
            out.extend(word.to_le_bytes());
        }
        out.extend(&json);
        out.extend((binary.len() as u32).to_le_bytes());
        out.extend(b"BIN\0");
        out.extend(&binary);
        out
    }

    #[test]
    fn every_node_places_its_mesh() {
        let surface = read(&file(str::to_owned), Path::new("a.glb")).unwrap();
        let points = surface.vertices;
        let wanted =
            [[0.0, 0.0, 1.0], [0.0, 1.0, 1.0], [-2.0, 0.0, 1.0], [0.0, 5.0, 1.0], [0.0, 7.0, 1.0], [-4.0, 5.0, 1.0]];
        assert_eq!(points.len(), wanted.len());
        for (found, wanted) in points.iter().zip(wanted) {
            assert!((found - Point3::from(wanted)).norm() < 1e-12, "{found} {wanted:?}");
        }
        assert_eq!(surface.triangles.len(), 2);
        assert!(points.iter().all(|p| surface.triangles.iter().flatten().any(|corner| corner == p)));
    }

    #[test]
    fn strips_and_fans_become_triangles_of_one_orientation() {
        let of_mode = |mode| super::triangles(mode, &[0, 1, 2, 3, 4, 5]).collect::<Vec<_>>();
        assert_eq!(of_mode(4), [[0, 1, 2], [3, 4, 5]]);
        assert_eq!(of_mode(5), [[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]]);
        assert_eq!(of_mode(6), [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]);
    }

    #[test]
    fn faults_are_named_and_no_file_panics() {
        for (from, to, named) in [
            ("\"count\":3", "\"count\":4", "ends after the buffer"),
            ("\"byteOffset\":48", "\"byteOffset\":18446744073709551615", "ends after the buffer"),
            ("\"componentType\":5126", "\"componentType\":5122", "not supported"),
            ("\"indices\":1", "\"indices\":7", "accessor 7: does not exist"),
            ("\"children\":[1]", "\"children\":[0]", "levels deep"),
            ("[{\"byteLength\":54}]", "[{\"byteLength\":54},{\"byteLength\":54}]", "buffer 1 has no file"),
            ("\"mesh\":0,\"ch", "\"mesh\":3,\"ch", "names the mesh 3"),
            ("\"scene\":0", "\"scene\":4", "has no scene"),
            ("\"scene\":0", "\"extensionsRequired\":[\"KHR_draco_mesh_compression\"]", "KHR_draco_mesh_compression"),
            ("\"byteLength\":54", "\"uri\":\"data:text,a\"", "save it as .glb"),
            ("\"byteLength\":54", "\"uri\":\"missing.bin\"", "missing.bin"),
            ("{\"asset\"", "{asset", "is not glTF 2.0"),
        ] {
            let found = read(&file(|json| json.replacen(from, to, 1)), Path::new("a.glb")).unwrap_err();
            assert!(found.contains(named), "{named}: {found}");
        }
        // Each of 60 nodes shows the next one twice.
        let pairs = |json: &str| {
            let (start, end) = (json.find("\"nodes\":[{").unwrap(), json.find("\"meshes\"").unwrap());
            let nodes: Vec<_> = (1..61).map(|i| format!("{{\"children\":[{i},{i}]}}")).collect();
            format!("{}\"nodes\":[{},{{}}],{}", &json[..start], nodes.join(","), &json[end..])
        };
        assert!(read(&file(pairs), Path::new("a.glb")).unwrap_err().contains("with repetitions"));
        let whole = file(str::to_owned);
        for end in 0..whole.len() {
            assert!(read(&whole[..end], Path::new("a.glb")).is_err(), "{end}");
        }
    }
}

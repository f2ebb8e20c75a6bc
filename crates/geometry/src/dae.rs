//! Reads surfaces from COLLADA files (.dae).

use std::collections::HashMap;

use nalgebra::{Matrix4, Point3, Rotation3, Unit, Vector3};
use roxmltree::{Document, Node};

use crate::mesh::{Surface, Visited};
use crate::xml;

const SURFACES: [&str; 5] = ["triangles", "polylist", "polygons", "trifans", "tristrips"];

/// Returns all faces (m) in the scene of a file: each geometry at the place of each node that shows it,
/// in the file's unit of length. The file's up axis is ignored, as in other readers of URDFs.
pub(crate) fn read(content: &[u8]) -> Result<Surface, String> {
    let text = xml::decode(content, "").map_err(|e| e.message)?;
    xml::check_size(&text)?;
    let document = Document::parse(&text).map_err(|e| format!("not XML: {e}"))?;
    let root = document.root_element();
    if root.tag_name().name() != "COLLADA" {
        return Err(format!("the first element is <{}>; expected <COLLADA>", root.tag_name().name()));
    }
    let ids = root.descendants().filter_map(|n| Some((n.attribute("id")?, n))).collect();
    let unit = child(root, "asset").and_then(|asset| child(asset, "unit")).and_then(|unit| unit.attribute("meter"));
    let unit: f64 = unit.map_or(Ok(1.0), str::parse).map_err(|_| "unit: meter is not a number".to_owned())?;
    if !(unit.is_finite() && unit > 0.0) {
        return Err(format!("unit: meter must be positive, not {unit}"));
    }
    let mut reader = Reader { ids, places: HashMap::new(), out: Surface::default(), visited: Visited::default() };
    let shown = child(root, "scene").and_then(|scene| child(scene, "instance_visual_scene"));
    let scene = match shown {
        Some(shown) => reader.target(shown, "url")?,
        None => root
            .descendants()
            .find(|n| n.has_tag_name((root.tag_name().namespace().unwrap_or(""), "visual_scene")))
            .ok_or("has no <visual_scene>, so no geometry has a place; export the file again")?,
    };
    reader.walk(scene, &Matrix4::new_scaling(unit), 0)?;
    Ok(reader.out)
}

struct Reader<'d> {
    ids: HashMap<&'d str, Node<'d, 'd>>,
    /// Faces of each geometry read so far, by its id.
    places: HashMap<&'d str, Surface>,
    out: Surface,
    visited: Visited,
}

impl<'d> Reader<'d> {
    /// Returns the element that an attribute such as `url="#part"` refers to.
    fn target(&self, node: Node<'d, 'd>, attribute: &str) -> Result<Node<'d, 'd>, String> {
        let name = node.tag_name().name();
        let link = node.attribute(attribute).ok_or_else(|| format!("<{name}> has no {attribute}"))?;
        let id = link.strip_prefix('#').unwrap_or(link);
        self.ids.get(id).copied().ok_or_else(|| format!("<{name} {attribute}={link:?}>: no element has this id"))
    }

    /// Adds the geometries of a node and of the nodes below it.
    fn walk(&mut self, node: Node<'d, 'd>, above: &Matrix4<f64>, depth: usize) -> Result<(), String> {
        self.visited.node(depth)?;
        let mut here = *above;
        for part in node.children().filter(Node::is_element) {
            match part.tag_name().name() {
                "matrix" => here *= Matrix4::from_row_slice(&numbers::<16>(part)?),
                "translate" => here *= Matrix4::new_translation(&Vector3::from(numbers::<3>(part)?)),
                "scale" => here *= Matrix4::new_nonuniform_scaling(&Vector3::from(numbers::<3>(part)?)),
                "rotate" => {
                    let [x, y, z, degrees] = numbers::<4>(part)?;
                    if let Some(axis) = Unit::try_new(Vector3::new(x, y, z), 1e-12) {
                        here *= Rotation3::from_axis_angle(&axis, degrees.to_radians()).to_homogeneous();
                    }
                }
                name @ ("lookat" | "skew" | "instance_controller") => {
                    return Err(format!(
                        "<{name}> is not supported; apply all transforms and modifiers, and export again"
                    ));
                }
                _ => {}
            }
        }
        for part in node.children().filter(Node::is_element) {
            match part.tag_name().name() {
                "node" => self.walk(part, &here, depth + 1)?,
                "instance_node" => self.walk(self.target(part, "url")?, &here, depth + 1)?,
                "instance_geometry" => {
                    let geometry = self.target(part, "url")?;
                    let id = geometry.attribute("id").unwrap_or_default();
                    if !self.places.contains_key(id) {
                        let surface = self.surface(geometry)?;
                        self.places.insert(id, surface);
                    }
                    let surface = &self.places[id];
                    self.visited.vertices(surface.vertices.len() + surface.triangles.len())?;
                    self.out.vertices.extend(surface.vertices.iter().map(|p| here.transform_point(p)));
                    self.out.triangles.extend(surface.triangles.iter().map(|t| t.map(|p| here.transform_point(&p))));
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// Returns the faces of a geometry.
    fn surface(&mut self, geometry: Node<'d, 'd>) -> Result<Surface, String> {
        let name = geometry.attribute("id").unwrap_or_default();
        let fail = |message: &str| format!("geometry {name:?}: {message}");
        let mesh = child(geometry, "mesh").ok_or_else(|| fail("has no <mesh>; export it as triangles"))?;
        let (mut points, mut used, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
        for surface in mesh.children().filter(|n| SURFACES.contains(&n.tag_name().name())) {
            let inputs: Vec<_> = surface.children().filter(|n| n.tag_name().name() == "input").collect();
            let offset = |n: &Node<'_, '_>| n.attribute("offset").and_then(|o| o.parse::<usize>().ok()).unwrap_or(0);
            let Some(vertex) = inputs.iter().find(|n| n.attribute("semantic") == Some("VERTEX")) else {
                return Err(fail("faces have no input VERTEX"));
            };
            let stride = inputs.iter().map(offset).max().unwrap_or(0).saturating_add(1);
            let vertices = self.target(*vertex, "source")?;
            let position = vertices
                .children()
                .find(|n| n.attribute("semantic") == Some("POSITION"))
                .ok_or_else(|| fail("<vertices> has no input POSITION"))?;
            points = self.positions(self.target(position, "source")?).map_err(|e| fail(&e))?;
            // Each surface reads the positions again.
            self.visited.vertices(points.len())?;
            used.resize(points.len(), false);
            for list in surface.descendants().filter(|n| matches!(n.tag_name().name(), "p" | "h")) {
                let mut corners: Vec<Point3<f64>> = Vec::new();
                for index in words(list).skip(offset(vertex)).step_by(stride) {
                    let known = index.parse::<usize>().ok().filter(|i| *i < points.len());
                    let known = known
                        .ok_or_else(|| fail(&format!("a face names the vertex {index:?}, which does not exist")))?;
                    used[known] = true;
                    corners.push(points[known]);
                }
                // A hole of a polygon is not read: the outline is filled.
                if list.tag_name().name() == "p" {
                    add_triangles(surface, &corners, &mut triangles).map_err(|e| fail(&e))?;
                }
            }
        }
        let vertices = points.into_iter().zip(used).filter(|(_, used)| *used).map(|(point, _)| point).collect();
        Ok(Surface { vertices, triangles })
    }

    /// Returns the points of a `<source>`.
    fn positions(&self, source: Node<'d, 'd>) -> Result<Vec<Point3<f64>>, String> {
        let accessor = child(source, "technique_common").and_then(|t| child(t, "accessor"));
        let entry = |name: &str, default: usize| match accessor.and_then(|a| a.attribute(name)) {
            None => Ok(default),
            Some(text) => text.parse::<usize>().map_err(|_| format!("accessor: {name} {text:?} is not a number")),
        };
        let (stride, offset) = (entry("stride", 3)?, entry("offset", 0)?);
        if stride < 3 {
            return Err("positions have fewer than three coordinates".to_owned());
        }
        let array = match accessor.filter(|a| a.has_attribute("source")) {
            Some(accessor) => self.target(accessor, "source")?,
            None => child(source, "float_array").ok_or("positions have no <float_array>")?,
        };
        let values: Vec<f64> =
            words(array).map(str::parse).collect::<Result<_, _>>().map_err(|_| "a position is not a number")?;
        let values = values.get(offset..).unwrap_or_default();
        Ok(values.chunks(stride).filter(|c| c.len() >= 3).map(|c| Point3::new(c[0], c[1], c[2])).collect())
    }
}

/// Adds the triangles of a list `<p>` of vertices in an element of [`SURFACES`].
fn add_triangles(
    surface: Node<'_, '_>,
    corners: &[Point3<f64>],
    out: &mut Vec<[Point3<f64>; 3]>,
) -> Result<(), String> {
    let mut fan = |polygon: &[Point3<f64>]| {
        out.extend((2..polygon.len()).map(|k| [polygon[0], polygon[k - 1], polygon[k]]));
    };
    match surface.tag_name().name() {
        "triangles" if !corners.len().is_multiple_of(3) => {
            return Err("<triangles> has a triangle with fewer vertices".to_owned());
        }
        "triangles" => corners.chunks_exact(3).for_each(fan),
        "tristrips" => {
            out.extend((2..corners.len()).map(|k| [corners[k - 2 + k % 2], corners[k - 1 - k % 2], corners[k]]))
        }
        "polylist" => {
            let mut rest = corners;
            for count in child(surface, "vcount").into_iter().flat_map(words) {
                let polygon = count.parse().ok().and_then(|count| rest.split_at_checked(count));
                let (polygon, others) = polygon.ok_or("<vcount> does not fit the vertices of <p>")?;
                fan(polygon);
                rest = others;
            }
            if !rest.is_empty() {
                return Err("<vcount> does not fit the vertices of <p>".to_owned());
            }
        }
        _ => fan(corners),
    }
    Ok(())
}

fn child<'d>(node: Node<'d, 'd>, name: &str) -> Option<Node<'d, 'd>> {
    node.children().find(|n| n.tag_name().name() == name)
}

fn words<'d>(node: Node<'d, 'd>) -> impl Iterator<Item = &'d str> {
    node.children().filter_map(|n| n.is_text().then(|| n.text()).flatten()).flat_map(str::split_whitespace)
}

fn numbers<const N: usize>(node: Node<'_, '_>) -> Result<[f64; N], String> {
    let name = node.tag_name().name();
    let found: Vec<f64> = node.text().unwrap_or("").split_whitespace().filter_map(|w| w.parse().ok()).collect();
    match <[f64; N]>::try_from(found) {
        Ok(numbers) if numbers.iter().all(|v| v.is_finite()) => Ok(numbers),
        _ => Err(format!("<{name}> must contain {N} finite numbers")),
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::read;

    fn file(unit: &str, scene: &str) -> String {
        format!(
            r##"<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
            <asset>{unit}<up_axis>Y_UP</up_axis></asset>
            <library_geometries><geometry id="tri"><mesh>
              <source id="pos"><float_array id="arr" count="12">0 0 0 1 0 0 0 2 0 9 9 9</float_array>
                <technique_common><accessor source="#arr" count="4" stride="3"/></technique_common></source>
              <vertices id="v"><input semantic="POSITION" source="#pos"/></vertices>
              <polylist count="1"><input semantic="NORMAL" source="#pos" offset="0"/>
                <input semantic="VERTEX" source="#v" offset="1"/><vcount>3</vcount><p>3 0 3 1 3 2</p></polylist>
            </mesh></geometry></library_geometries>
            <library_nodes><node id="twice"><scale>2 2 2</scale><instance_geometry url="#tri"/></node></library_nodes>
            <library_visual_scenes><visual_scene id="s">{scene}</visual_scene></library_visual_scenes>
            <scene><instance_visual_scene url="#s"/></scene></COLLADA>"##
        )
    }

    #[test]
    fn every_node_places_its_geometry_in_metres() {
        let scene = r##"<node><translate>0 0 1</translate><rotate>0 0 1 90</rotate><instance_geometry url="#tri"/>
            <node><matrix>1 0 0 5 0 1 0 0 0 0 1 0 0 0 0 1</matrix><instance_node url="#twice"/></node></node>"##;
        let surface = read(file(r#"<unit meter="0.01" name="cm"/>"#, scene).as_bytes()).unwrap();
        let points = surface.vertices;
        // The unused vertex (9, 9, 9) is dropped, and the up axis does not rotate the mesh.
        let wanted =
            [[0.0, 0.0, 1.0], [0.0, 1.0, 1.0], [-2.0, 0.0, 1.0], [0.0, 5.0, 1.0], [0.0, 7.0, 1.0], [-4.0, 5.0, 1.0]];
        assert_eq!(points.len(), wanted.len());
        for (found, wanted) in points.iter().zip(wanted) {
            assert!((found - Point3::from(wanted) * 0.01).norm() < 1e-12, "{found} {wanted:?}");
        }
        assert_eq!(surface.triangles.as_flattened(), points);
    }

    #[test]
    fn faults_are_named() {
        let node = r##"<node><instance_geometry url="#tri"/></node>"##;
        let whole = file("", node);
        assert_eq!(read(whole.as_bytes()).unwrap().vertices.len(), 3);
        for (from, to, named) in [
            ("<p>3 0", "<p>3 7", "names the vertex \"7\""),
            ("url=\"#tri\"/></node></visual", "url=\"#no\"/></node></visual", "no element has this id"),
            ("0 0 0 1 0 0", "0 0 x 1 0 0", "not a number"),
            ("<COLLADA", "<COLADA", "not XML"),
            (
                "<node><instance_geometry",
                "<node><skew>0 0 0 0 0 0 0</skew><instance_geometry",
                "<skew> is not supported",
            ),
            ("3 0 3 1 3 2</p>", "3 0 3 1 3 2 3 0</p>", "<vcount> does not fit"),
            ("<vcount>", "<input/><vcount>", ""),
        ] {
            let found = read(whole.replacen(from, to, if from.starts_with("<node>") { 9 } else { 1 }).as_bytes());
            match named {
                "" => assert!(found.is_ok()),
                named => assert!(found.clone().unwrap_err().contains(named), "{named}: {found:?}"),
            }
        }
        let itself = file("", r##"<node id="n"><instance_node url="#n"/></node>"##);
        assert!(read(itself.as_bytes()).unwrap_err().contains("levels deep"));
        // Each of 60 nodes shows the next one twice.
        let pair = |i: usize| {
            format!("<node id=\"n{i}\">{}</node>", format!("<instance_node url=\"#n{}\"/>", i + 1).repeat(2))
        };
        let pairs: String = (0..60).map(pair).chain(["<node id=\"n60\"/>".to_owned()]).collect();
        assert!(read(file("", &pairs).as_bytes()).unwrap_err().contains("with repetitions"));
    }
}

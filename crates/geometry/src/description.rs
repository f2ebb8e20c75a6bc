//! Content of a URDF as written in the file: links, joints and shapes, with every number validated. Only URDF's own
//! defaults are added: a zero origin, the axis (1, 0, 0), a scale of 1, a mimic multiplier of 1.

use std::collections::{HashMap, HashSet};

use serde::Serialize;

use crate::xml::{self, Element};
use crate::{Pose, UrdfError, mesh_path, pose_from_xyz_rpy};

/// Maximum number of links of a robot; a file with more counts as damaged.
const MAX_LINKS: usize = 10_000;

const ROBOT: [&str; 3] = ["link", "joint", "material"];
const LINK: [&str; 3] = ["visual", "collision", "inertial"];
const SHAPES: [&str; 5] = ["box", "cylinder", "sphere", "capsule", "mesh"];
const JOINT: [&str; 9] =
    ["parent", "child", "origin", "axis", "limit", "mimic", "dynamics", "calibration", "safety_controller"];
const LIMIT: [&str; 7] = ["lower", "upper", "effort", "velocity", "acceleration", "deceleration", "jerk"];
const SAFETY: [&str; 4] = ["soft_lower_limit", "soft_upper_limit", "k_position", "k_velocity"];

/// Content of a URDF as written in the file.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct Description {
    /// Name of the robot; may be empty.
    pub name: String,
    /// Links with unique names, in the order of the file.
    pub links: Vec<LinkDescription>,
    /// Joints with unique names and unique child links, in the order of the file.
    pub joints: Vec<JointDescription>,
    /// Names and colours (red, green, blue, alpha) of the robot's materials.
    pub materials: Vec<(String, [f64; 4])>,
}

/// A link.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct LinkDescription {
    /// Name of the link.
    pub name: String,
    /// Visual elements.
    pub visuals: Vec<ShapeDescription>,
    /// Collision elements.
    pub collisions: Vec<ShapeDescription>,
    /// Mass properties, if the file gives them.
    pub inertial: Option<InertialDescription>,
}

/// A visual or collision element.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct ShapeDescription {
    /// Description of this visual or collision element for error messages.
    pub field: String,
    /// Name of the element.
    pub name: Option<String>,
    /// Pose of the element in the link frame.
    pub origin: Origin,
    /// Shape of the element.
    pub geometry: Geometry,
    /// Name of the element's material.
    pub material: Option<String>,
    /// Colour (red, green, blue, alpha), if the element itself defines its material.
    pub rgba: Option<[f64; 4]>,
}

/// A shape (m).
#[derive(Debug, Clone, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Geometry {
    /// Box with its three side lengths.
    Box([f64; 3]),
    /// Sphere with its radius.
    Sphere(f64),
    /// Radius, and length along z.
    Cylinder([f64; 2]),
    /// Radius, and length along z between the centres of the caps.
    Capsule([f64; 2]),
    /// A mesh file.
    Mesh {
        /// Mesh file as written in the URDF.
        filename: String,
        /// Candidate paths of the mesh file relative to the URDF's folder, the likeliest first.
        paths: Vec<String>,
        /// Scale factors of the mesh's x, y and z coordinates.
        scale: [f64; 3],
    },
}

/// A rigid transform as written in the file.
#[derive(Debug, Clone, Copy, Serialize)]
#[non_exhaustive]
pub struct Origin {
    /// Translation (m).
    pub xyz: [f64; 3],
    /// Roll, pitch and yaw (rad).
    pub rpy: [f64; 3],
    /// Unit quaternion (x, y, z, w), if given instead of `rpy`.
    pub quat_xyzw: Option<[f64; 4]>,
}

/// Mass properties of a link.
#[derive(Debug, Clone, Copy, Serialize)]
#[non_exhaustive]
pub struct InertialDescription {
    /// Pose of the inertial frame, whose origin is the centre of mass, in the link frame.
    pub origin: Origin,
    /// Mass (kg), not negative.
    pub mass: f64,
    /// Inertia tensor about the centre of mass: ixx, ixy, ixz, iyy, iyz, izz (kg m^2).
    pub inertia: [f64; 6],
}

/// A joint.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct JointDescription {
    /// Name of the joint.
    pub name: String,
    /// Type of the joint, such as `revolute`; empty if the file gives none.
    pub kind: String,
    /// Name of the parent link.
    pub parent: String,
    /// Name of the child link.
    pub child: String,
    /// Pose of the joint frame in the parent link.
    pub origin: Origin,
    /// Direction of the axis in the joint frame, of any length.
    pub axis: [f64; 3],
    /// Limits, if given.
    pub limit: Option<LimitDescription>,
    /// Mimic element, if this joint follows another joint.
    pub mimic: Option<MimicDescription>,
}

/// Limits of a joint. A limit is `None` if the file gives none, and may be infinite.
#[derive(Debug, Clone, Copy, Default, Serialize)]
#[non_exhaustive]
pub struct LimitDescription {
    /// Lower limit (rad or m).
    pub lower: Option<f64>,
    /// Upper limit (rad or m).
    pub upper: Option<f64>,
    /// Velocity limit (rad/s or m/s), not negative.
    pub velocity: Option<f64>,
    /// Torque limit (N m; N for a sliding joint), not negative.
    pub effort: Option<f64>,
    /// Acceleration limit (rad/s^2 or m/s^2), positive.
    pub acceleration: Option<f64>,
    /// Deceleration limit (rad/s^2 or m/s^2), positive.
    pub deceleration: Option<f64>,
    /// Jerk limit (rad/s^3 or m/s^3), positive.
    pub jerk: Option<f64>,
}

/// Mimic element of a joint: `value = multiplier * source + offset`.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct MimicDescription {
    /// Name of the followed joint.
    pub joint: String,
    /// Factor applied to the value of the followed joint.
    pub multiplier: f64,
    /// Offset added after the multiplication (rad or m).
    pub offset: f64,
}

impl Description {
    /// Reads a URDF; `file` is its name in error messages.
    ///
    /// # Errors
    /// Encoding or XML cannot be read; the file contains xacro macros; a name is missing, repeated or misspelt; or a
    /// number is invalid or out of range. The error names the link or joint, the attribute and the remedy.
    pub fn read(content: &[u8], file: &str) -> Result<Self, UrdfError> {
        Self::parse(&xml::decode(content, file)?, file)
    }

    /// Reads the text of a URDF.
    ///
    /// # Errors
    /// As [`Description::read`].
    pub fn parse(text: &str, file: &str) -> Result<Self, UrdfError> {
        let document = xml::parse(text, file)?;
        let root = Element::root(&document, file);
        root.check_spelling(&ROBOT, &["name"])?;
        let (mut links, mut joints, mut materials) = (Vec::new(), Vec::new(), Vec::new());
        for element in root.children()? {
            match element.name() {
                "link" => links.push(link(&element)?),
                "joint" => joints.push(joint(&element)?),
                "material" => materials.extend(rgba(&element)?.map(|c| (named(&element).unwrap_or_default(), c))),
                _ => {}
            }
        }
        if links.is_empty() || links.len() > MAX_LINKS {
            return Err(root.fail(format!("has {} links; expected 1 to {MAX_LINKS}", links.len())));
        }
        once(file, "link", links.iter().map(|l| l.name.as_str()))?;
        once(file, "joint", joints.iter().map(|j| j.name.as_str()))?;
        let known: HashSet<&str> = links.iter().map(|l| l.name.as_str()).collect();
        let mut carried = HashMap::new();
        for joint in &joints {
            let fail = |message: String| Err(UrdfError::new(file, format!("joint {}", joint.name), message));
            if let Some(link) = [&joint.parent, &joint.child].into_iter().find(|l| !known.contains(l.as_str())) {
                return fail(format!("no link '{link}'"));
            }
            if let Some(other) = carried.insert(&joint.child, &joint.name) {
                return fail(format!("link {} is already the child of {other}", joint.child));
            }
        }
        Ok(Self { name: named(&root).unwrap_or_default(), links, joints, materials })
    }
}

/// Returns an error if a name is repeated.
fn once<'n>(file: &str, kind: &str, mut names: impl Iterator<Item = &'n str>) -> Result<(), UrdfError> {
    let mut seen = HashSet::new();
    match names.find(|name| !seen.insert(*name)) {
        None => Ok(()),
        Some(twice) => {
            Err(UrdfError::new(file, format!("{kind} {twice}"), format!("two {kind}s have this name; rename one")))
        }
    }
}

fn own_name(element: &Element<'_>) -> Result<String, UrdfError> {
    match named(element) {
        Some(name) if !name.is_empty() => Ok(name),
        _ => Err(element.called(element.name().to_owned()).fail("'' is no name; write name=\"...\"")),
    }
}

fn named(element: &Element<'_>) -> Option<String> {
    element.text("name").ok().flatten().map(str::to_owned)
}

fn link(element: &Element<'_>) -> Result<LinkDescription, UrdfError> {
    let name = own_name(element)?;
    let element = element.called(format!("link {name}"));
    element.check_spelling(&LINK, &["name"])?;
    let (mut visuals, mut collisions) = (Vec::new(), Vec::new());
    for part in element.children()? {
        let list = match part.name() {
            "visual" => &mut visuals,
            "collision" => &mut collisions,
            _ => continue,
        };
        let number = if list.is_empty() { String::new() } else { format!(" {}", list.len() + 1) };
        list.push(shape(&part.called(format!("{}{number}", part.field)))?);
    }
    let inertial = element.child("inertial")?.map(|e| inertial(&e)).transpose()?;
    Ok(LinkDescription { name, visuals, collisions, inertial })
}

fn shape(element: &Element<'_>) -> Result<ShapeDescription, UrdfError> {
    element.check_spelling(&["origin", "geometry", "material"], &["name"])?;
    let geometry = element.child("geometry")?;
    let geometry = geometry.ok_or_else(|| element.fail("has no <geometry>; add it, or remove the element"))?;
    geometry.check_spelling(&SHAPES, &[])?;
    let mut shapes = geometry.children()?.into_iter().filter(|c| SHAPES.contains(&c.name()));
    let (Some(shape), None) = (shapes.next(), shapes.next()) else {
        return Err(geometry.fail("must hold one of <box>, <cylinder>, <sphere>, <capsule> and <mesh>"));
    };
    let material = element.child("material")?;
    Ok(ShapeDescription {
        field: element.field.clone(),
        name: named(element),
        origin: origin(element)?,
        geometry: self::geometry(&shape.called(format!("{}: {}", element.field, shape.name())))?,
        rgba: material.as_ref().map(rgba).transpose()?.flatten(),
        material: material.as_ref().and_then(named),
    })
}

fn geometry(shape: &Element<'_>) -> Result<Geometry, UrdfError> {
    shape.check_spelling(&[], &["size", "radius", "length", "filename", "scale"])?;
    let one = |name: &str| shape.positive::<1>(name).map(|[value]| value);
    Ok(match shape.name() {
        "box" => Geometry::Box(shape.positive("size")?),
        "sphere" => Geometry::Sphere(one("radius")?),
        "cylinder" => Geometry::Cylinder([one("radius")?, one("length")?]),
        "capsule" => Geometry::Capsule([one("radius")?, one("length")?]),
        _ => {
            let filename = shape.required("filename")?.to_owned();
            let scale = shape.numbers("scale")?.unwrap_or([1.0; 3]);
            Geometry::Mesh { paths: mesh_path::candidates(&filename), filename, scale }
        }
    })
}

fn rgba(material: &Element<'_>) -> Result<Option<[f64; 4]>, UrdfError> {
    material.check_spelling(&["color", "texture"], &["name"])?;
    let Some(color) = material.child("color")? else { return Ok(None) };
    let _ = color.required("rgba")?;
    color.numbers("rgba")
}

fn origin(element: &Element<'_>) -> Result<Origin, UrdfError> {
    let mut out = Origin { xyz: [0.0; 3], rpy: [0.0; 3], quat_xyzw: None };
    let Some(written) = element.child("origin")? else { return Ok(out) };
    if let Some(odd) = written.attributes().find(|name| !["xyz", "rpy", "quat_xyzw"].contains(name)) {
        return Err(written.wrong(odd, "is not known; write xyz with rpy or quat_xyzw"));
    }
    out.xyz = written.numbers("xyz")?.unwrap_or(out.xyz);
    let (rpy, quaternion) = (written.numbers("rpy")?, written.numbers::<4>("quat_xyzw")?);
    if rpy.is_some() && quaternion.is_some() {
        return Err(written.fail("has both rpy and quat_xyzw; keep one"));
    }
    out.rpy = rpy.unwrap_or(out.rpy);
    if let Some(q) = quaternion {
        let length = q.iter().map(|v| v * v).sum::<f64>().sqrt();
        if !(length.is_finite() && length > 1e-9) {
            return Err(written.wrong("quat_xyzw", "must have a length"));
        }
        out.quat_xyzw = Some(q.map(|v| v / length));
    }
    Ok(out)
}

/// Negative moments of inertia (kg m²) that are rounding errors of the program that wrote the file.
const ROUNDED_INERTIA: f64 = 1e-12;

fn inertial(element: &Element<'_>) -> Result<InertialDescription, UrdfError> {
    const TENSOR: [&str; 6] = ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"];
    element.check_spelling(&["origin", "mass", "inertia"], &[])?;
    let part = |name: &str| {
        let message = format!("has no <{name}>; add it, or remove <inertial>");
        element.child(name)?.ok_or_else(|| element.fail(message))
    };
    let mass = part("mass")?;
    let _ = mass.required("value")?;
    let value = mass.number("value")?.unwrap_or_default();
    if value < 0.0 {
        return Err(mass.wrong("value", format!("must not be negative, is {value}")));
    }
    let (tensor, mut inertia) = (part("inertia")?, [0.0; 6]);
    for (name, place) in TENSOR.iter().zip(&mut inertia) {
        let _ = tensor.required(name)?;
        *place = tensor.number(name)?.unwrap_or_default();
        if name.as_bytes()[1] == name.as_bytes()[2] && *place < 0.0 {
            if *place < -ROUNDED_INERTIA {
                return Err(tensor.wrong(name, format!("must not be negative, is {place}")));
            }
            *place = 0.0;
        }
    }
    Ok(InertialDescription { origin: origin(element)?, mass: value, inertia })
}

fn joint(element: &Element<'_>) -> Result<JointDescription, UrdfError> {
    let name = own_name(element)?;
    let element = element.called(format!("joint {name}"));
    element.check_spelling(&JOINT, &["name", "type"])?;
    let (Some(parent), Some(child)) = (element.child("parent")?, element.child("child")?) else {
        return Err(
            element.fail("a joint needs a parent and a child; write <parent link=\"...\"/><child link=\"...\"/>")
        );
    };
    let (parent, child) = (parent.required("link")?.to_owned(), child.required("link")?.to_owned());
    let axis = match element.child("axis")? {
        None => None,
        Some(axis) => {
            axis.check_spelling(&[], &["xyz"])?;
            axis.numbers("xyz")?
        }
    };
    if let Some(safety) = element.child("safety_controller")? {
        safety.check_spelling(&[], &SAFETY)?;
        for name in SAFETY {
            safety.number(name)?;
        }
    }
    let mimic = match element.child("mimic")? {
        None => None,
        Some(mimic) => {
            mimic.check_spelling(&[], &["joint", "multiplier", "offset"])?;
            Some(MimicDescription {
                joint: mimic.required("joint")?.to_owned(),
                multiplier: mimic.number("multiplier")?.unwrap_or(1.0),
                offset: mimic.number("offset")?.unwrap_or(0.0),
            })
        }
    };
    Ok(JointDescription {
        kind: element.text("type")?.unwrap_or_default().trim().to_owned(),
        origin: origin(&element)?,
        axis: axis.unwrap_or([1.0, 0.0, 0.0]),
        limit: element.child("limit")?.map(|e| limit(&e)).transpose()?,
        name,
        parent,
        child,
        mimic,
    })
}

fn limit(element: &Element<'_>) -> Result<LimitDescription, UrdfError> {
    element.check_spelling(&[], &LIMIT)?;
    let number = |name: &str| Ok(element.open::<1>(name)?.map(|[value]| value));
    let rate = |name: &str, may_be_zero: bool| match number(name)? {
        Some(v) if v < 0.0 => Err(element.wrong(name, format!("must not be negative, is {v}"))),
        Some(0.0) if !may_be_zero => Err(element.wrong(name, "must not be 0; leave it out if it is unknown")),
        value => Ok(value),
    };
    Ok(LimitDescription {
        lower: number("lower")?,
        upper: number("upper")?,
        velocity: rate("velocity", true)?,
        effort: rate("effort", true)?,
        acceleration: rate("acceleration", false)?,
        deceleration: rate("deceleration", false)?,
        jerk: rate("jerk", false)?,
    })
}

impl Origin {
    /// Returns the transform as a pose.
    #[must_use]
    pub fn pose(&self) -> Pose {
        let Some([x, y, z, w]) = self.quat_xyzw else { return pose_from_xyz_rpy(self.xyz, self.rpy) };
        let turn = nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z));
        Pose::from_parts(self.xyz.into(), turn.to_rotation_matrix())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(link: &str, joint: &str) -> UrdfError {
        let text = format!(
            r#"<robot name="a"><link name="l0"/><link name="l1">{link}</link>
            <joint name="j" type="revolute"><parent link="l0"/><child link="l1"/>{joint}</joint></robot>"#
        );
        Description::parse(&text, "a.urdf").unwrap_err()
    }

    #[test]
    fn every_refusal_names_link_or_joint_and_attribute() {
        let mesh =
            |rest: &str| format!(r#"<collision><geometry><mesh filename="m.stl" {rest}/></geometry></collision>"#);
        let solid = |shape: &str| format!("<collision><geometry>{shape}</geometry></collision>");
        let inertial = |parts: &str| format!("<inertial>{parts}</inertial>");
        let tensor = r#"<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>"#;
        let links = [
            (mesh(r#"scale="0.001""#), "link l1: collision: mesh.scale", "three finite numbers"),
            (mesh(r#"scal="1 1 1""#), "link l1: collision: mesh", "write scale"),
            (solid(r#"<box size="1 1 -1"/>"#), "link l1: collision: box.size", "positive"),
            (solid(r#"<sphere radius="nan"/>"#), "link l1: collision: sphere.radius", "number"),
            (solid("<sphere/>"), "link l1: collision: sphere.radius", "missing"),
            (solid("<cone/>"), "link l1: collision: geometry", "<box>"),
            ("<visual><material name='x'/></visual>".into(), "link l1: visual", "<geometry>"),
            ("<colision/>".into(), "link l1", "write <collision>"),
            (inertial("<mass value='1'/>"), "link l1: inertial", "<inertia>"),
            (inertial(&format!("<mass value='-1'/>{tensor}")), "link l1: inertial: mass.value", "negative"),
            (
                inertial(&format!("<mass value='1'/>{}", tensor.replace(r#"ixx="1""#, r#"ixx="-2e-12""#))),
                "link l1: inertial: inertia.ixx",
                "negative",
            ),
            (inertial(&format!("<mass/>{tensor}")), "link l1: inertial: mass.value", "missing"),
        ];
        for (link, field, message) in links {
            let error = refused(&link, "");
            assert!(error.field == field && error.message.contains(message), "{error} instead of {field}: {message}");
        }
        let joints = [
            (r#"<limit lower="-${pi}"/>"#, "joint j: limit.lower", "xacro a.urdf"),
            (r#"<limit velocity="-1"/>"#, "joint j: limit.velocity", "negative"),
            (r#"<limit acceleration="0"/>"#, "joint j: limit.acceleration", "leave it out"),
            (r#"<limit uper="1"/>"#, "joint j: limit", "write upper"),
            ("<limit/><limit/>", "joint j", "two <limit>"),
            (r#"<origin xyz="0 0"/>"#, "joint j: origin.xyz", "three finite numbers"),
            (r#"<origin quat_wxyz="1 0 0 0"/>"#, "joint j: origin.quat_wxyz", "quat_xyzw"),
            (r#"<origin rpy="0 0 0" quat_xyzw="0 0 0 1"/>"#, "joint j: origin", "both"),
            (r#"<origin quat_xyzw="0 0 0 0"/>"#, "joint j: origin.quat_xyzw", "length"),
            (r#"<mimic multiplier="2"/>"#, "joint j: mimic.joint", "missing"),
            (r#"<mimic joint="k" multiplier="inf"/>"#, "joint j: mimic.multiplier", "finite"),
        ];
        for (joint, field, message) in joints {
            let error = refused("", joint);
            assert!(error.field == field && error.message.contains(message), "{error} instead of {field}: {message}");
        }
    }

    #[test]
    fn macros_of_xacro_are_refused_and_other_extensions_left_out() {
        let with = |inside: &str| {
            let text = format!(
                r#"<robot xmlns:xacro="http://www.ros.org/wiki/xacro" xmlns:x="y"><link name="l"/>{inside}</robot>"#
            );
            Description::parse(&text, "a.urdf")
        };
        assert!(with(r#"<xacro:include filename="b"/>"#).unwrap_err().message.contains("<xacro:include>"));
        assert_eq!(with("<x:link/><gazebo/>").unwrap().links.len(), 1);
        assert!(Description::parse("<sdf/>", "a.urdf").unwrap_err().message.contains("<robot>"));
    }

    #[test]
    fn a_negative_moment_of_inertia_that_is_a_rounding_error_is_zero() {
        let text = r#"<robot name="a"><link name="l"><inertial><mass value="0"/>
            <inertia ixx="-5e-20" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link></robot>"#;
        let links = Description::parse(text, "a.urdf").unwrap().links;
        assert_eq!(links[0].inertial.as_ref().unwrap().inertia, [0.0, 0.0, 0.0, 1.0, 0.0, 1.0]);
    }

    #[test]
    fn a_quaternion_turns_like_roll_pitch_and_yaw() {
        let half = 0.5;
        let one = Origin { xyz: [1.0, 2.0, 3.0], rpy: [0.0; 3], quat_xyzw: Some([half, -half, -half, half]) };
        let quarter = std::f64::consts::FRAC_PI_2;
        let other = Origin { rpy: [quarter, 0.0, -quarter], quat_xyzw: None, ..one };
        let apart = one.pose().to_homogeneous() - other.pose().to_homogeneous();
        assert!(apart.amax() < 1e-12, "{apart}");
    }
}

//! URDF and SRDF text to a [`Robot`].

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use nalgebra::{Matrix3, Point3, Vector3};
use urdf_rs::{Geometry, JointType};

use crate::link::FURTHEST;
use crate::{
    Convex, Inertia, Joint, JointKind, Link, Mimic, Pose, Robot, UrdfError, mesh, mimic, pose_from_xyz_rpy, xml,
};

/// Links per robot: beyond this a file is taken for damaged.
const MAX_LINKS: usize = 10_000;

pub(crate) fn parse(text: &str, path: &Path, hand: &str, base: Option<&str>) -> Result<Robot, UrdfError> {
    let file = path.display().to_string();
    let file = file.as_str();
    let fail = |field: &str, message: String| UrdfError::new(file, field, message);
    let plain = xml::plain(&xml::parse(text, file)?);
    let model = urdf_rs::read_from_string(&plain).map_err(|e| fail("XML", format!("is not a URDF: {e}")))?;
    if model.links.is_empty() || model.links.len() > MAX_LINKS {
        return Err(fail("robot", format!("has {} links; expected 1 to {MAX_LINKS}", model.links.len())));
    }
    let mut names = HashSet::new();
    if let Some(twice) = model.links.iter().find(|l| !names.insert(l.name.as_str())) {
        return Err(fail(&format!("link {}", twice.name), "stands twice; names are unique".to_owned()));
    }
    let index_of = |name: &str| model.links.iter().position(|l| l.name == name);
    let mut parent_joint: Vec<Option<usize>> = vec![None; model.links.len()];
    let mut children: Vec<Vec<usize>> = vec![Vec::new(); model.links.len()];
    for (j, joint) in model.joints.iter().enumerate() {
        let field = format!("joint {}", joint.name);
        let named = |which: &str, link: &str| {
            index_of(link).ok_or_else(|| fail(&field, format!("{which} link {link:?} does not exist")))
        };
        let parent = named("parent", &joint.parent.link)?;
        let child = named("child", &joint.child.link)?;
        if parent_joint[child].replace(j).is_some() {
            return Err(fail(&field, format!("link {:?} already has a parent joint", joint.child.link)));
        }
        children[parent].push(j);
    }
    let root = match base {
        Some(name) => index_of(name).ok_or_else(|| fail("base_link", format!("{name:?} is not a link")))?,
        None => {
            let mut roots = (0..model.links.len()).filter(|l| parent_joint[*l].is_none());
            match (roots.next(), roots.next()) {
                (Some(root), None) => root,
                (None, _) => return Err(fail("robot", "its links form a loop".to_owned())),
                (Some(a), Some(b)) => {
                    let (a, b) = (&model.links[a].name, &model.links[b].name);
                    return Err(fail("robot", format!("has two roots, {a:?} and {b:?}; join them or give base_link")));
                }
            }
        }
    };

    // Depth first from the base: parents before children, loops cannot recur because a link has one parent joint.
    let mut place: Vec<Option<usize>> = vec![None; model.links.len()];
    let mut order = Vec::new();
    let mut stack = vec![root];
    while let Some(link) = stack.pop() {
        if place[link].is_some() {
            return Err(fail("robot", "its links form a loop".to_owned()));
        }
        place[link] = Some(order.len());
        order.push(link);
        for &j in children[link].iter().rev() {
            if let Some(child) = index_of(&model.joints[j].child.link) {
                stack.push(child);
            }
        }
    }

    let mut slot: Vec<Option<usize>> = vec![None; model.joints.len()];
    let mut joints = Vec::new();
    for (j, joint) in model.joints.iter().enumerate() {
        let inside = index_of(&joint.child.link).is_some_and(|l| place[l].is_some() && l != root);
        if inside && let Some(built) = moving_joint(joint, file)? {
            slot[j] = Some(joints.len());
            joints.push(built);
        }
    }
    let mut names: Vec<&str> = model.joints.iter().map(|j| j.name.as_str()).collect();
    names.sort_unstable();
    if let Some(pair) = names.windows(2).find(|pair| pair[0] == pair[1]) {
        return Err(fail(&format!("joint {}", pair[0]), "stands twice; names are unique".to_owned()));
    }
    for (j, joint) in model.joints.iter().enumerate() {
        if let (Some(at), Some(mimic)) = (slot[j], &joint.mimic) {
            let field = format!("joint {}: mimic", joint.name);
            let source = model
                .joints
                .iter()
                .position(|other| other.name == mimic.joint)
                .and_then(|s| slot[s])
                .filter(|s| *s != at)
                .ok_or_else(|| fail(&field, format!("{:?} is not another moving joint", mimic.joint)))?;
            let (multiplier, offset) = (mimic.multiplier.unwrap_or(1.0), mimic.offset.unwrap_or(0.0));
            finite(file, &field, &[multiplier, offset])?;
            joints[at].mimic = Some(Mimic { source, multiplier, offset });
        }
    }
    mimic::compose(&mut joints).map_err(|e| fail(&e.field, e.message))?;

    let folder = path.parent().map(Path::to_path_buf).unwrap_or_default();
    let mut links = Vec::with_capacity(order.len());
    for &l in &order {
        let link = &model.links[l];
        let joint = if l == root { None } else { parent_joint[l] };
        let (parent, origin) = match joint {
            None => (None, Pose::identity()),
            Some(j) => {
                let spec = &model.joints[j];
                let parent = index_of(&spec.parent.link).and_then(|p| place[p]);
                (parent, origin(file, &format!("joint {}: origin", spec.name), &spec.origin)?)
            }
        };
        let mut shapes = Vec::new();
        for (i, collision) in link.collision.iter().enumerate() {
            let field = format!("link {}: collision {i}", link.name);
            let pose = self::origin(file, &field, &collision.origin)?;
            shapes.push(shape(&collision.geometry, &pose, &folder, file, &field)?);
        }
        let inertia = inertia(&link.inertial, &link.name, file)?;
        links.push(Link {
            name: link.name.clone(),
            parent,
            origin,
            joint: joint.and_then(|j| slot[j]),
            shapes,
            inertia,
        });
    }
    let hand_index = links.iter().position(|l| l.name == hand).ok_or_else(|| {
        fail("hand_link", format!("{hand:?} is not a link below the base; links: {}", listed(&links)))
    })?;
    Ok(Robot::assemble(model.name.clone(), links, joints, hand_index))
}

fn listed(links: &[Link]) -> String {
    let mut all: Vec<&str> = links.iter().map(|l| l.name.as_str()).collect();
    let more = all.len().saturating_sub(30);
    all.truncate(30);
    let listed = all.join(", ");
    if more == 0 { listed } else { format!("{listed} and {more} more") }
}

fn moving_joint(joint: &urdf_rs::Joint, file: &str) -> Result<Option<Joint>, UrdfError> {
    let field = format!("joint {}", joint.name);
    let fail = |part: &str, message: String| UrdfError::new(file, format!("{field}: {part}"), message);
    let (kind, limited) = match joint.joint_type {
        JointType::Fixed => return Ok(None),
        JointType::Revolute => (JointKind::Revolute, true),
        JointType::Continuous => (JointKind::Revolute, false),
        JointType::Prismatic => (JointKind::Prismatic, true),
        JointType::Floating | JointType::Planar | JointType::Spherical => {
            return Err(fail(
                "type",
                "floating, planar and spherical joints are not supported; fix or split it".into(),
            ));
        }
    };
    let axis = Vector3::from(joint.axis.xyz.0);
    let length = axis.norm();
    if !(length.is_finite() && length > 1e-9) {
        return Err(fail("axis", format!("must be a finite direction, not {:?}", joint.axis.xyz.0)));
    }
    let (lower, upper) =
        if limited { (joint.limit.lower, joint.limit.upper) } else { (f64::NEG_INFINITY, f64::INFINITY) };
    if lower.is_nan() || upper.is_nan() || lower > upper {
        return Err(fail("limit", format!("lower {lower} must not exceed upper {upper}")));
    }
    let velocity = joint.limit.velocity;
    if velocity.is_nan() || velocity < 0.0 {
        return Err(fail("limit", format!("velocity {velocity} must be positive")));
    }
    // URDF writers put 0 where they know no limit; nothing could move under a true limit of 0.
    let velocity = if velocity == 0.0 { f64::INFINITY } else { velocity };
    let effort = joint.limit.effort;
    if effort.is_nan() {
        return Err(fail("limit", "effort is not a number".to_owned()));
    }
    // Likewise: 0 and less stand for what is not known.
    let effort = if effort <= 0.0 { f64::INFINITY } else { effort };
    let (name, axis) = (joint.name.clone(), axis / length);
    Ok(Some(Joint { name, kind, axis, lower, upper, velocity, effort, mimic: None }))
}

/// The mass of a link; none where the file says nothing of it.
fn inertia(spec: &urdf_rs::Inertial, link: &str, file: &str) -> Result<Option<Inertia>, UrdfError> {
    let urdf_rs::Inertia { ixx, ixy, ixz, iyy, iyz, izz } = spec.inertia;
    if spec.mass.value == 0.0 && [ixx, ixy, ixz, iyy, iyz, izz].iter().all(|v| *v == 0.0) {
        return Ok(None);
    }
    let pose = origin(file, &format!("link {link}: inertial: origin"), &spec.origin)?;
    let turn = pose.rotation.matrix();
    let tensor = Matrix3::new(ixx, ixy, ixz, ixy, iyy, iyz, ixz, iyz, izz);
    let turned = turn * tensor * turn.transpose();
    // Rounding of the turn.
    let tensor = 0.5 * (turned + turned.transpose());
    let out = Inertia { mass: spec.mass.value, center: pose.translation.vector, tensor };
    out.check(link).map_err(|e| UrdfError::new(file, e.field, e.message))?;
    Ok(Some(out))
}

fn finite(file: &str, field: &str, values: &[f64]) -> Result<(), UrdfError> {
    match values.iter().find(|v| !v.is_finite()) {
        Some(v) => Err(UrdfError::new(file, field, format!("{v} is not a finite number"))),
        None => Ok(()),
    }
}

fn origin(file: &str, field: &str, pose: &urdf_rs::Pose) -> Result<Pose, UrdfError> {
    finite(file, field, &pose.xyz.0)?;
    finite(file, field, &pose.rpy.0)?;
    if let Some(v) = pose.xyz.0.iter().find(|v| v.abs() > FURTHEST) {
        return Err(UrdfError::new(file, field, format!("{v} is not within {FURTHEST} m")));
    }
    Ok(pose_from_xyz_rpy(pose.xyz.0, pose.rpy.0))
}

fn shape(geometry: &Geometry, pose: &Pose, folder: &Path, file: &str, field: &str) -> Result<Convex, UrdfError> {
    let fail = |message: String| UrdfError::new(file, field, message);
    let built = match geometry {
        Geometry::Box { size } => Convex::cuboid([size[0] / 2.0, size[1] / 2.0, size[2] / 2.0], pose),
        Geometry::Sphere { radius } => Convex::ball(*radius, Point3::from(pose.translation.vector)),
        Geometry::Cylinder { radius, length } => Convex::cylinder(*radius, *length, pose),
        Geometry::Capsule { radius, length } => Convex::capsule(*radius, *length, pose),
        Geometry::Mesh { filename, scale } => {
            let scale = scale.map_or([1.0; 3], |s| s.0);
            finite(file, field, &scale)?;
            if scale.contains(&0.0) {
                return Err(fail("scale: a factor is 0; it must not be".to_owned()));
            }
            let vertices = mesh::read(&resolve(filename, folder)).map_err(fail)?;
            let points: Vec<_> =
                vertices.iter().map(|v| pose * Point3::new(v.x * scale[0], v.y * scale[1], v.z * scale[2])).collect();
            Convex::hull(&points)
        }
    };
    built.map_err(|e| fail(e.to_string()))
}

/// `package://name/rest` is looked for as `name/rest` and as `rest` beside the URDF and in the folders above it.
fn resolve(filename: &str, folder: &Path) -> PathBuf {
    let plain = filename.strip_prefix("file://").unwrap_or(filename);
    let Some(inside) = plain.strip_prefix("package://") else {
        return folder.join(plain);
    };
    let rest = inside.split_once('/').map_or(inside, |(_, rest)| rest);
    folder
        .ancestors()
        .flat_map(|a| [a.join(inside), a.join(rest)])
        .find(|candidate| candidate.is_file())
        .unwrap_or_else(|| folder.join(inside))
}

pub(crate) fn disabled_pairs(text: &str, path: &Path, links: &[Link]) -> Result<Vec<(usize, usize)>, UrdfError> {
    let file = path.display().to_string();
    let file = file.as_str();
    let document = xml::parse(text, file)?;
    let mut pairs = Vec::new();
    for node in document.descendants().filter(|n| n.has_tag_name("disable_collisions")) {
        let link = |attribute: &str| {
            node.attribute(attribute)
                .ok_or_else(|| UrdfError::new(file, "disable_collisions", format!("lacks {attribute}")))
        };
        let (a, b) = (link("link1")?, link("link2")?);
        let at = |name: &str| links.iter().position(|l| l.name == name);
        // An SRDF may speak of links above the chosen base; those cannot collide with anything here.
        if let (Some(a), Some(b)) = (at(a), at(b)) {
            pairs.push((a.min(b), a.max(b)));
        }
    }
    Ok(pairs)
}

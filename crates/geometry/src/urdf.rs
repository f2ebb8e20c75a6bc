//! Conversion of a URDF to a [`Robot`].

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use nalgebra::{Matrix3, Point3, Vector3};

use crate::decompose::decompose;
use crate::description::{Description, Geometry, InertialDescription, JointDescription, Origin, ShapeDescription};
use crate::link::FURTHEST;
use crate::{Convex, Inertia, Joint, JointKind, Link, Mimic, Pose, Robot, UrdfError, mesh, mesh_path, mimic};

/// Builds the robot from the links below `base`, by default the root. `package_dirs` are folders of ROS packages. Meshes
/// whose hull is farther than `mesh_tolerance` (m) from the mesh are decomposed.
pub(crate) fn build(
    model: &Description,
    path: &Path,
    hand: &str,
    base: Option<&str>,
    package_dirs: &[PathBuf],
    mesh_tolerance: Option<f64>,
) -> Result<Robot, UrdfError> {
    let file = path.display().to_string();
    let file = file.as_str();
    let fail = |field: &str, message: String| UrdfError::new(file, field, message);
    let numbered: HashMap<&str, usize> = model.links.iter().enumerate().map(|(i, l)| (l.name.as_str(), i)).collect();
    let index_of = |name: &str| numbered.get(name).copied();
    let mut parent_joint: Vec<Option<usize>> = vec![None; model.links.len()];
    let mut children: Vec<Vec<usize>> = vec![Vec::new(); model.links.len()];
    for (j, joint) in model.joints.iter().enumerate() {
        if let (Some(parent), Some(child)) = (index_of(&joint.parent), index_of(&joint.child)) {
            parent_joint[child] = Some(j);
            children[parent].push(j);
        }
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

    // Depth first from the base, so that parents precede children. Each link has one parent joint, so there are no
    // loops.
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
            if let Some(child) = index_of(&model.joints[j].child) {
                stack.push(child);
            }
        }
    }

    let mut slot: Vec<Option<usize>> = vec![None; model.joints.len()];
    let mut joints = Vec::new();
    for (j, joint) in model.joints.iter().enumerate() {
        let inside = index_of(&joint.child).is_some_and(|l| place[l].is_some() && l != root);
        if inside && let Some(built) = moving_joint(joint, file)? {
            slot[j] = Some(joints.len());
            joints.push(built);
        }
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
            joints[at].mimic = Some(Mimic { source, multiplier: mimic.multiplier, offset: mimic.offset });
        }
    }
    mimic::compose(&mut joints).map_err(|e| fail(&e.field, e.message))?;
    for (j, spec) in model.joints.iter().enumerate() {
        if let Some(at) = slot[j].filter(|_| spec.kind != "continuous") {
            joints[at] = bounded_by_source(&joints, &joints[at]);
        }
    }

    let folder = path.parent().map(Path::to_path_buf).unwrap_or_default();
    let mut links = Vec::with_capacity(order.len());
    for &l in &order {
        let link = &model.links[l];
        let joint = if l == root { None } else { parent_joint[l] };
        let (parent, origin) = match joint {
            None => (None, Pose::identity()),
            Some(j) => {
                let spec = &model.joints[j];
                let parent = index_of(&spec.parent).and_then(|p| place[p]);
                (parent, origin(file, &format!("joint {}: origin", spec.name), &spec.origin)?)
            }
        };
        let mut shapes = Vec::with_capacity(link.collisions.len());
        for spec in &link.collisions {
            shapes.extend(convex_shapes(spec, &folder, package_dirs, mesh_tolerance, file)?);
        }
        let inertia = link.inertial.as_ref().map(|spec| inertia(spec, &link.name, file)).transpose()?.flatten();
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

fn moving_joint(joint: &JointDescription, file: &str) -> Result<Option<Joint>, UrdfError> {
    let fail = |part: &str, message: String| UrdfError::new(file, format!("joint {}: {part}", joint.name), message);
    let (kind, endless) = match joint.kind.as_str() {
        "fixed" => return Ok(None),
        "revolute" => (JointKind::Revolute, false),
        "continuous" => (JointKind::Revolute, true),
        "prismatic" => (JointKind::Prismatic, false),
        "floating" | "planar" | "spherical" => {
            return Err(fail(
                "type",
                "floating, planar and spherical joints are not supported; fix or split it".into(),
            ));
        }
        other => {
            return Err(fail(
                "type",
                format!("joint type '{other}' is not known; write revolute, prismatic, continuous or fixed"),
            ));
        }
    };
    let axis = Vector3::from(joint.axis);
    let length = axis.norm();
    if !(length.is_finite() && length > 1e-9) {
        return Err(fail("axis", format!("must be a finite direction, not {:?}", joint.axis)));
    }
    // A mimic joint without limits takes those of its source, and a continuous joint needs none.
    let free = endless || joint.mimic.is_some();
    if joint.limit.is_none() && !free {
        let message = "is missing; add <limit lower upper velocity effort>, or make the joint continuous";
        return Err(fail("limit", message.to_owned()));
    }
    let limit = joint.limit.unwrap_or_default();
    let needed = |name: &str, value: Option<f64>, unless: bool, open: f64| match value {
        Some(value) => Ok(value),
        None if unless => Ok(open),
        None => Err(fail("limit", format!("{name} is missing; write {name}=\"...\""))),
    };
    let mut lower = needed("lower", limit.lower, free, f64::NEG_INFINITY)?;
    let mut upper = needed("upper", limit.upper, free, f64::INFINITY)?;
    let unlimited = joint.mimic.is_some() || joint.limit.is_none();
    let mut velocity = needed("velocity", limit.velocity, unlimited, f64::INFINITY)?;
    if endless {
        (lower, upper) = (f64::NEG_INFINITY, f64::INFINITY);
    }
    if lower > upper || lower == f64::INFINITY || upper == f64::NEG_INFINITY {
        return Err(fail("limit", format!("lower {lower} must not exceed upper {upper}")));
    }
    // URDF authors write 0 for an unknown limit; a true limit of 0 would prevent any motion. Planning then requires the
    // velocity limit as an option.
    if velocity == 0.0 {
        velocity = f64::INFINITY;
    }
    let effort = limit.effort.filter(|e| *e > 0.0).unwrap_or(f64::INFINITY);
    // Acceleration and deceleration share one limit here: the smaller of both.
    let acceleration = [limit.acceleration, limit.deceleration].into_iter().flatten().fold(f64::INFINITY, f64::min);
    let jerk = limit.jerk.unwrap_or(f64::INFINITY);
    let (name, axis) = (joint.name.clone(), axis / length);
    Ok(Some(Joint { name, kind, axis, lower, upper, velocity, effort, acceleration, jerk, mimic: None }))
}

/// Returns a mimic joint whose missing limits are derived from the limits of its source.
fn bounded_by_source(joints: &[Joint], joint: &Joint) -> Joint {
    let mut out = joint.clone();
    if let Some(m) = joint.mimic {
        let ends = [joints[m.source].lower, joints[m.source].upper].map(|limit| m.multiplier * limit + m.offset);
        let (lower, upper) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        if out.lower.is_infinite() && lower <= out.upper {
            out.lower = lower;
        }
        if out.upper.is_infinite() && upper >= out.lower {
            out.upper = upper;
        }
    }
    out
}

/// Returns the mass properties of a link; `None` if the file gives no mass.
fn inertia(spec: &InertialDescription, link: &str, file: &str) -> Result<Option<Inertia>, UrdfError> {
    let [ixx, ixy, ixz, iyy, iyz, izz] = spec.inertia;
    if spec.mass == 0.0 && spec.inertia == [0.0; 6] {
        return Ok(None);
    }
    let pose = origin(file, &format!("link {link}: inertial: origin"), &spec.origin)?;
    let turn = pose.rotation.matrix();
    let tensor = Matrix3::new(ixx, ixy, ixz, ixy, iyy, iyz, ixz, iyz, izz);
    let turned = turn * tensor * turn.transpose();
    // Averaging removes the asymmetry that the rotation causes by rounding.
    let tensor = 0.5 * (turned + turned.transpose());
    let out = Inertia { mass: spec.mass, center: pose.translation.vector, tensor };
    out.check(link).map_err(|e| UrdfError::new(file, e.field, e.message))?;
    Ok(Some(out))
}

fn origin(file: &str, field: &str, origin: &Origin) -> Result<Pose, UrdfError> {
    if let Some(v) = origin.xyz.iter().find(|v| v.abs() > FURTHEST) {
        return Err(UrdfError::new(file, field, format!("{v} is not within {FURTHEST} m")));
    }
    Ok(origin.pose())
}

/// Returns the convex shapes of a collision element: one, or several for a mesh that is decomposed.
fn convex_shapes(
    spec: &ShapeDescription,
    folder: &Path,
    package_dirs: &[PathBuf],
    mesh_tolerance: Option<f64>,
    file: &str,
) -> Result<Vec<Convex>, UrdfError> {
    let fail = |message: String| UrdfError::new(file, &spec.field, message);
    let pose = &origin(file, &format!("{}: origin", spec.field), &spec.origin)?;
    let built = match &spec.geometry {
        Geometry::Box(size) => Convex::cuboid(size.map(|side| side / 2.0), pose),
        Geometry::Sphere(radius) => Convex::ball(*radius, Point3::from(pose.translation.vector)),
        Geometry::Cylinder([radius, length]) => Convex::cylinder(*radius, *length, pose),
        Geometry::Capsule([radius, length]) => Convex::capsule(*radius, *length, pose),
        Geometry::Mesh { filename, paths, scale } => {
            if scale.contains(&0.0) {
                return Err(UrdfError::new(
                    file,
                    format!("{}: mesh.scale", spec.field),
                    "a factor is 0; use factors other than 0",
                ));
            }
            let surface = mesh_path::resolve(filename, paths, folder, package_dirs)
                .and_then(|path| mesh::read(&path))
                .map_err(|why| fail(format!("mesh {why}")))?;
            let scaled = |v: &Point3<f64>| Point3::new(v.x * scale[0], v.y * scale[1], v.z * scale[2]);
            let parts = mesh_tolerance.and_then(|tolerance| {
                let triangles: Vec<_> = surface.triangles.iter().map(|t| t.each_ref().map(scaled)).collect();
                decompose(&triangles, tolerance)
            });
            let parts = parts.unwrap_or_else(|| vec![surface.vertices.iter().map(scaled).collect()]);
            let hull = |part: &Vec<Point3<f64>>| Convex::hull(&part.iter().map(|p| pose * p).collect::<Vec<_>>());
            return parts.iter().map(hull).collect::<Result<_, _>>().map_err(|e| fail(e.to_string()));
        }
    };
    Ok(vec![built.map_err(|e| fail(e.to_string()))?])
}

#[cfg(test)]
mod tests {
    use crate::{Robot, UrdfError};

    /// Returns an arm with one joint `j`, and a joint `k` that follows it.
    fn arm(j: &str, k: &str) -> Result<Robot, UrdfError> {
        let joint = |name: &str, parent: &str, child: &str, rest: &str| {
            format!(r#"<joint name="{name}" {rest}<parent link="{parent}"/><child link="{child}"/></joint>"#)
        };
        let text = format!(
            r#"<robot name="a"><link name="l0"/><link name="l1"/><link name="l2"/>{}{}</robot>"#,
            joint("j", "l0", "l1", j),
            joint("k", "l1", "l2", k)
        );
        Robot::from_urdf_str(&text, "a.urdf", None, "l2", None)
    }

    const FIXED: &str = r#"type="fixed">"#;
    const FOLLOWS: &str = r#"type="revolute"><mimic joint="j"/>"#;

    #[test]
    fn a_limit_that_is_missing_is_named() {
        for (limit, named) in [
            ("", "joint j: limit: is missing"),
            (r#"<limit effort="1" velocity="1"/>"#, "joint j: limit: lower is missing"),
            (r#"<limit lower="0" effort="1" velocity="1"/>"#, "joint j: limit: upper is missing"),
            (r#"<limit upper="1" effort="1" velocity="1"/>"#, "joint j: limit: lower is missing"),
            (r#"<limit lower="0" upper="1" effort="1"/>"#, "joint j: limit: velocity is missing"),
            (r#"<limit lower="1" upper="0" velocity="1"/>"#, "joint j: limit: lower 1 must not exceed upper 0"),
            (r#"<limit lower="inf" upper="inf" velocity="1"/>"#, "joint j: limit: lower inf must not exceed"),
        ] {
            for kind in ["revolute", "prismatic"] {
                let error = arm(&format!(r#"type="{kind}">{limit}"#), FIXED).unwrap_err().to_string();
                assert!(error.contains(named), "{error}");
            }
        }
        let endless = arm(r#"type="continuous">"#, FIXED).unwrap();
        assert_eq!((endless.joints()[0].lower(), endless.joints()[0].velocity()), (f64::NEG_INFINITY, f64::INFINITY));
        let odd = arm(r#"type="hinge">"#, FIXED).unwrap_err();
        assert!(odd.to_string().contains("joint j: type: joint type 'hinge' is not known"), "{odd}");
    }

    #[test]
    fn a_follower_without_limits_restricts_nothing() {
        let lead = r#"type="revolute"><limit lower="-1" upper="2" effort="1" velocity="1"/>"#;
        for limit in ["", r#"<limit effort="1"/>"#] {
            let robot = arm(lead, &format!("{FOLLOWS}{limit}")).unwrap();
            assert_eq!(robot.range(0), Some((-1.0, 2.0)));
        }
        let back = arm(lead, r#"type="prismatic"><mimic joint="j" multiplier="-0.5" offset="1"/>"#).unwrap();
        assert_eq!((back.range(0), back.joints()[1].lower(), back.joints()[1].upper()), (Some((-1.0, 2.0)), 0.0, 1.5));
        let still = arm(r#"type="continuous">"#, r#"type="revolute"><mimic joint="j" multiplier="0"/>"#).unwrap();
        assert_eq!(still.range(0), Some((f64::NEG_INFINITY, f64::INFINITY)));
        let robot = arm(lead, &format!(r#"{FOLLOWS}<limit upper="1"/>"#)).unwrap();
        assert_eq!(robot.range(0), Some((-1.0, 1.0)));
    }

    #[test]
    fn limits_of_acceleration_and_jerk_are_read() {
        let limit = |rest: &str| {
            let text = format!(r#"type="revolute"><limit lower="-1" upper="2" effort="0" velocity="0" {rest}/>"#);
            let joint = arm(&text, FIXED).unwrap().joints()[0].clone();
            [joint.velocity(), joint.effort(), joint.acceleration(), joint.jerk()]
        };
        let open = f64::INFINITY;
        assert_eq!(limit(""), [open; 4]);
        assert_eq!(limit(r#"acceleration="3" deceleration="2" jerk="5""#), [open, open, 2.0, 5.0]);
        assert_eq!(limit(r#"deceleration="2""#)[2], 2.0);
    }
}

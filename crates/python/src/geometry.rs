//! Python classes of robots, shapes, bodies and object joints.

use std::path::PathBuf;
use std::sync::Arc;

use gensim2_geometry::{ALWAYS, Chain, ChainFrames, Convex, DynamicsScratch, Pose, Robot, SAMPLES, ShapeError};
use gensim2_kpam::{Body, Cancel, ObjectJoint, ObjectJointKind, Role};
use nalgebra::{Point3, Vector3};
use numpy::{PyArray2, PyArray3, PyArrayDyn, ndarray};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyList};

use crate::convert::{self, JointRows};
use crate::errors::{from_problem, from_shape, from_urdf, problem_error};
use crate::interrupt::interruptible;

/// Shapes with at least this many parts are created in pieces; signals are handled before each piece.
pub(crate) const LONG: usize = 8192;

/// Maximum number of random configurations of a robot.
const MAX_SAMPLES: usize = 1_000_000;

/// Converts triangles (M, 3, 3) and spheres (K, 4) of shapes to NumPy arrays.
fn surface<'py>(py: Python<'py>, shapes: &[Convex]) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
    let is_ball = |s: &&Convex| s.points().len() == 1 && s.radius() > 0.0;
    let balls: Vec<Vec<f64>> =
        shapes.iter().filter(is_ball).map(|s| vec![s.center().x, s.center().y, s.center().z, s.radius()]).collect();
    let corners: Vec<f64> = shapes
        .iter()
        .filter(|s| !is_ball(s))
        .flat_map(Convex::surface)
        .flatten()
        .flat_map(|p| [p.x, p.y, p.z])
        .collect();
    let triangles = ndarray::Array3::from_shape_vec((corners.len() / 9, 3, 3), corners);
    let triangles = triangles.map_err(|e| problem_error("surface", e))?;
    Ok((PyArray3::from_owned_array(py, triangles).into_any(), convert::array2(py, &balls, 4).into_any()))
}

/// A robot arm that was read from a URDF. Instances can be pickled.
#[pyclass(name = "Robot", module = "gensim2_kpam", frozen)]
pub(crate) struct PyRobot(pub Arc<Robot>);

#[pymethods]
impl PyRobot {
    /// Reads a URDF and its collision meshes: `Robot.from_urdf("ur5e.urdf", hand_link="flange")`. `hand_link` carries
    /// the tool; `srdf` names pairs of links that may touch; `base_link` is the base frame (default: the only root);
    /// `package_dirs` are folders of packages named by `package://` paths; `joints` names the joints that planning moves
    /// (default: those between the base and the hand); `mesh_tolerance` (m) decomposes meshes whose hull is farther than
    /// this from the mesh. An unusable file raises a `UrdfError` that names the link or
    /// joint.
    #[staticmethod]
    #[pyo3(
        name = "from_urdf",
        signature = (
            path, *, hand_link, srdf = None, base_link = None, package_dirs = Vec::new(), joints = None,
            mesh_tolerance = None
        )
    )]
    #[allow(clippy::too_many_arguments)]
    fn read_urdf(
        py: Python<'_>,
        path: PathBuf,
        hand_link: &str,
        srdf: Option<PathBuf>,
        base_link: Option<&str>,
        package_dirs: Vec<PathBuf>,
        joints: Option<Vec<String>>,
        mesh_tolerance: Option<f64>,
    ) -> PyResult<Self> {
        let robot = py
            .detach(|| Robot::from_urdf(path, srdf.as_deref(), hand_link, base_link, &package_dirs, mesh_tolerance))
            .map_err(|e| from_urdf(&e))?;
        let robot = match joints {
            None => robot,
            Some(joints) => robot.planning(&joints).map_err(|e| problem_error(&e.field, &e.message))?,
        };
        Ok(Self(Arc::new(robot)))
    }

    /// Names of the joints that planning moves.
    #[getter]
    fn planned_joints(&self) -> Vec<String> {
        self.0.planned().into_iter().map(|j| self.0.joints()[j].name().to_owned()).collect()
    }

    /// Lists all pairs of links with shapes, and how often they overlap in random configurations: dicts `links`,
    /// `relation` ("adjacent", "always", "sometimes", "never"), `fraction`, `checked`. With `srdf`, the pairs that are
    /// not checked are written to this SRDF file.
    #[pyo3(signature = (*, samples = SAMPLES, seed = 0, always = ALWAYS, srdf = None))]
    fn self_collisions<'py>(
        &self,
        py: Python<'py>,
        samples: usize,
        seed: usize,
        always: f64,
        srdf: Option<PathBuf>,
    ) -> PyResult<Bound<'py, PyList>> {
        if !(1..=MAX_SAMPLES).contains(&samples) {
            return Err(problem_error("samples", format!("must be 1 to {MAX_SAMPLES}, not {samples}")));
        }
        if !(always > 0.0 && always <= 1.0) {
            return Err(problem_error("always", format!("must be above 0 and at most 1, not {always}")));
        }
        let pairs = py.detach(|| self.0.self_collisions(samples, seed, always));
        if let Some(path) = srdf {
            std::fs::write(&path, self.0.srdf(&pairs))
                .map_err(|e| problem_error("srdf", format!("{} cannot be written: {e}", path.display())))?;
        }
        let name = |link: usize| self.0.links()[link].name();
        convert::dicts(py, &pairs, |d, pair| {
            d.set_item("links", (name(pair.links.0), name(pair.links.1)))?;
            d.set_item("relation", pair.relation.name())?;
            d.set_item("fraction", pair.fraction)?;
            d.set_item("checked", pair.checked)
        })
    }

    /// Returns joints (n,) or (N, n) in which every mimic joint has the value that follows from its source.
    fn apply_mimic<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let q = JointRows::of_robot(q, &self.0)?;
        let rows: Vec<Vec<f64>> = q.rows().map(<[f64]>::to_vec).collect();
        match q.count {
            None => Ok(convert::array1(py, &rows[0]).into_any()),
            Some(_) => Ok(convert::array2(py, &rows, self.0.joints().len()).into_any()),
        }
    }

    #[getter]
    fn name(&self) -> &str {
        self.0.name()
    }

    #[getter]
    fn joint_names(&self) -> Vec<String> {
        self.0.joints().iter().map(|j| j.name().to_owned()).collect()
    }

    /// Pairs of links that are not checked because they overlap in almost all configurations, if no SRDF was given.
    #[getter]
    fn unchecked_pairs(&self) -> Vec<(String, String)> {
        let name = |link: usize| self.0.links()[link].name().to_owned();
        self.0.unchecked_pairs().iter().map(|(a, b)| (name(*a), name(*b))).collect()
    }

    #[getter]
    fn link_names(&self) -> Vec<String> {
        self.0.links().iter().map(|l| l.name().to_owned()).collect()
    }

    #[getter]
    fn lower<'py>(&self, py: Python<'py>) -> Bound<'py, PyAny> {
        convert::array1(py, &self.0.joints().iter().map(|j| j.lower()).collect::<Vec<_>>()).into_any()
    }

    #[getter]
    fn upper<'py>(&self, py: Python<'py>) -> Bound<'py, PyAny> {
        convert::array1(py, &self.0.joints().iter().map(|j| j.upper()).collect::<Vec<_>>()).into_any()
    }

    #[getter]
    fn velocity<'py>(&self, py: Python<'py>) -> Bound<'py, PyAny> {
        convert::array1(py, &self.0.joints().iter().map(|j| j.velocity()).collect::<Vec<_>>()).into_any()
    }

    /// Triangles (M, 3, 3) of a link's collision shapes, and its spheres (K, 4): centre and radius. All are in the link
    /// frame (m).
    fn surface<'py>(&self, py: Python<'py>, link: &str) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let named = self.0.links().iter().find(|l| l.name() == link);
        let link = named.ok_or_else(|| problem_error("link", format!("{link:?} is not a link of the robot")))?;
        surface(py, link.shapes())
    }

    #[getter]
    fn acceleration<'py>(&self, py: Python<'py>) -> Bound<'py, PyAny> {
        convert::array1(py, &self.0.joints().iter().map(|j| j.acceleration()).collect::<Vec<_>>()).into_any()
    }

    #[getter]
    fn jerk<'py>(&self, py: Python<'py>) -> Bound<'py, PyAny> {
        convert::array1(py, &self.0.joints().iter().map(|j| j.jerk()).collect::<Vec<_>>()).into_any()
    }

    #[getter]
    fn effort<'py>(&self, py: Python<'py>) -> Bound<'py, PyAny> {
        convert::array1(py, &self.0.joints().iter().map(|j| j.effort()).collect::<Vec<_>>()).into_any()
    }

    /// Total mass of all links (kg).
    #[getter]
    fn mass(&self) -> f64 {
        self.0.mass()
    }

    /// Joint torques (N m; N for sliding joints) under gravity, (n,) or (N, n) like the arguments.
    #[pyo3(signature = (q, velocity, acceleration, *, gravity = None), text_signature = "($self, q, velocity, acceleration, *, gravity=(0.0, 0.0, -9.81))")]
    fn inverse_dynamics<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        velocity: &Bound<'py, PyAny>,
        acceleration: &Bound<'py, PyAny>,
        gravity: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let n = self.0.joints().len();
        let q = JointRows::of(q, n)?;
        let (velocity, acceleration) = (JointRows::of(velocity, n)?, JointRows::of(acceleration, n)?);
        if velocity.count != q.count || acceleration.count != q.count {
            return Err(problem_error("velocity, acceleration", "must have the shape of q"));
        }
        let standard = || Ok(Vector3::new(0.0, 0.0, -9.81));
        let down = gravity.map_or_else(standard, |g| convert::vector3(g, "gravity"))?;
        let (mut scratch, mut one) = (DynamicsScratch::default(), Vec::new());
        let mut rows = Vec::with_capacity(q.rows().len());
        for ((q, v), a) in q.rows().zip(velocity.rows()).zip(acceleration.rows()) {
            self.0.inverse_dynamics([q, v, a], &down, &mut scratch, &mut one).map_err(|e| problem_error("q", e))?;
            if !one.iter().all(|torque| torque.is_finite()) {
                return Err(problem_error("velocity, acceleration", "are too large: a torque is not finite"));
            }
            rows.push(one.clone());
        }
        match q.count {
            None => Ok(convert::array1(py, &one).into_any()),
            Some(_) => Ok(convert::array2(py, &rows, n).into_any()),
        }
    }

    /// Pose of `link` (default: the hand) in the base frame: (4, 4) for joints (n,), (N, 4, 4) for joints (N, n).
    #[pyo3(signature = (q, link = None))]
    fn forward_kinematics<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        link: Option<&str>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let q = JointRows::of_robot(q, &self.0)?;
        let chain = self.chain(link)?;
        let mut frames = ChainFrames::default();
        let mut out = Vec::with_capacity(q.rows().len() * 16);
        for row in q.rows() {
            chain.forward(row, &mut frames).map_err(|e| problem_error("q", e))?;
            push_rows(&frames.tip, &mut out);
        }
        let Some(count) = q.count else { return Ok(convert::pose_array(py, &frames.tip).into_any()) };
        let array = ndarray::Array3::from_shape_vec((count, 4, 4), out).map_err(|e| problem_error("q", e))?;
        Ok(PyArray3::from_owned_array(py, array).into_any())
    }

    /// Jacobian (6, n) or (N, 6, n) of `link` (default: the hand) in base axes: linear, then angular velocity.
    #[pyo3(signature = (q, link = None))]
    fn jacobian<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>, link: Option<&str>) -> PyResult<Bound<'py, PyAny>> {
        let n = self.0.joints().len();
        let q = JointRows::of_robot(q, &self.0)?;
        let chain = self.chain(link)?;
        let mut frames = ChainFrames::default();
        let count = q.rows().len();
        let mut out = vec![0.0; count * 6 * n];
        for (r, row) in q.rows().enumerate() {
            chain.forward(row, &mut frames).map_err(|e| problem_error("q", e))?;
            let block = &mut out[r * 6 * n..(r + 1) * 6 * n];
            for (j, column) in self.0.jacobian(&chain, &frames).iter().enumerate() {
                (0..6).for_each(|k| block[k * n + j] = column[k]);
            }
        }
        if q.count.is_none() {
            let array = ndarray::Array2::from_shape_vec((6, n), out).map_err(|e| problem_error("q", e))?;
            return Ok(PyArray2::from_owned_array(py, array).into_any());
        }
        let array = ndarray::Array3::from_shape_vec((count, 6, n), out).map_err(|e| problem_error("q", e))?;
        Ok(PyArray3::from_owned_array(py, array).into_any())
    }

    #[staticmethod]
    fn _thaw(bytes: &[u8]) -> PyResult<Self> {
        convert::thaw::<Robot>(bytes).map(|r| Self(Arc::new(r)))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        let bytes = convert::freeze(self.0.as_ref())?;
        Ok((py.get_type::<Self>().getattr("_thaw")?, (PyBytes::new(py, &bytes),)))
    }

    fn __repr__(&self) -> String {
        format!("Robot({:?}, {} joints)", self.0.name(), self.0.joints().len())
    }
}

impl PyRobot {
    fn chain(&self, link: Option<&str>) -> PyResult<Chain> {
        self.0.chain_to(self.link(link)?).ok_or_else(|| problem_error("link", "is not a link"))
    }

    fn link(&self, name: Option<&str>) -> PyResult<usize> {
        let Some(name) = name else { return Ok(self.0.hand()) };
        self.0.link_index(name).ok_or_else(|| {
            let known: Vec<&str> = self.0.links().iter().map(|l| l.name()).collect();
            problem_error("link", format!("{name:?} is not a link; links: {}", known.join(", ")))
        })
    }
}

fn push_rows(pose: &Pose, out: &mut Vec<f64>) {
    let (r, t) = (pose.rotation.matrix(), pose.translation.vector);
    for k in 0..3 {
        out.extend([r[(k, 0)], r[(k, 1)], r[(k, 2)], t[k]]);
    }
    out.extend([0.0, 0.0, 0.0, 1.0]);
}

/// A collision shape in the body frame; a mesh is a surface of triangles, not a solid.
#[pyclass(name = "Shape", module = "gensim2_kpam", frozen)]
pub(crate) struct PyShape(pub Vec<Convex>);

#[pymethods]
impl PyShape {
    /// Returns a box with half extents (3,), m, along the axes of `pose` (4, 4); default: the body frame. For example,
    /// `Shape.box([0.2, 0.1, 0.05])` is 0.4 m x 0.2 m x 0.1 m large.
    #[staticmethod]
    #[pyo3(name = "box", signature = (half_extents, pose = None))]
    fn cuboid(half_extents: &Bound<'_, PyAny>, pose: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let half = convert::vector3(half_extents, "half_extents")?;
        let pose = convert::optional_pose(pose, "pose")?;
        one(Convex::cuboid([half.x, half.y, half.z], &pose))
    }

    /// Returns a sphere with `radius` (m) around `center` (3,), m; default: the origin of the body frame. For example,
    /// `Shape.sphere(0.05)` has a diameter of 0.1 m.
    #[staticmethod]
    #[pyo3(signature = (radius, center = None))]
    fn sphere(radius: f64, center: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let center = center.map_or(Ok(Vector3::zeros()), |c| convert::vector3(c, "center"))?;
        one(Convex::ball(radius, Point3::from(center)))
    }

    /// Returns a capsule with `radius` (m) along the z axis of `pose` (4, 4); default: the body frame. `length` (m) is
    /// the distance between the centres of the caps: `Shape.capsule(0.05, 0.6)` is 0.7 m long.
    #[staticmethod]
    #[pyo3(signature = (radius, length, pose = None))]
    fn capsule(radius: f64, length: f64, pose: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        one(Convex::capsule(radius, length, &convert::optional_pose(pose, "pose")?))
    }

    /// Returns a cylinder with `radius` and `length` (m) along the z axis of `pose` (4, 4); default: the body frame. It
    /// is approximated by a circumscribed prism of 32 sides. For example, `Shape.cylinder(0.05, 0.6)` is 0.6 m long.
    #[staticmethod]
    #[pyo3(signature = (radius, length, pose = None))]
    fn cylinder(radius: f64, length: f64, pose: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        one(Convex::cylinder(radius, length, &convert::optional_pose(pose, "pose")?))
    }

    /// Returns the convex hull of (N, 3) points (m, body frame).
    #[staticmethod]
    fn convex_hull(py: Python<'_>, points: &Bound<'_, PyAny>) -> PyResult<Self> {
        let points = convert::points(points, "points")?;
        if points.len() < LONG {
            return one(Convex::hull(&points));
        }
        one(interruptible(py, Cancel::new(), move |_| Convex::hull(&points))?)
    }

    /// Returns a surface of triangles (M, 3), indices from 0, over vertices (N, 3), m. A body entirely inside does not
    /// collide with the surface.
    #[staticmethod]
    fn mesh(py: Python<'_>, vertices: &Bound<'_, PyAny>, triangles: &Bound<'_, PyAny>) -> PyResult<Self> {
        let vertices = convert::points(vertices, "vertices")?;
        let (indices, shape) = convert::numbers(triangles, "triangles")?;
        if shape.len() != 2 || shape[1] != 3 {
            return Err(problem_error("triangles", format!("must have shape (M, 3), not {shape:?}")));
        }
        let mut out = Vec::with_capacity(shape[0]);
        for (t, corner) in indices.chunks_exact(3).enumerate() {
            if t % LONG == 0 {
                py.check_signals()?;
            }
            let mut points = Vec::with_capacity(3);
            for c in corner {
                if c.fract() != 0.0 || !(0.0..vertices.len() as f64).contains(c) {
                    let message = format!("names vertex {c} of {}; give whole numbers from 0", vertices.len());
                    return Err(problem_error(&format!("triangles[{t}]"), message));
                }
                points.push(vertices[*c as usize]);
            }
            out.push(Convex::hull(&points).map_err(|e| from_shape(&e))?);
        }
        if out.is_empty() {
            return Err(problem_error("triangles", "is empty"));
        }
        Ok(Self(out))
    }

    /// Returns a point cloud (N, 3), m, in which each point is a sphere of `radius` (m). An empty cloud is no obstacle.
    #[staticmethod]
    fn point_cloud(py: Python<'_>, points: &Bound<'_, PyAny>, radius: f64) -> PyResult<Self> {
        let points = convert::points(points, "points")?;
        // Validates the radius even if the cloud is empty.
        Convex::ball(radius, Point3::origin()).map_err(|e| from_shape(&e))?;
        let mut out = Vec::with_capacity(points.len());
        for (k, point) in points.into_iter().enumerate() {
            if k % LONG == 0 {
                py.check_signals()?;
            }
            out.push(Convex::ball(radius, point).map_err(|e| from_shape(&e))?);
        }
        Ok(Self(out))
    }

    /// Returns the occupied voxels of a grid (nx, ny, nz) of bool as solid cubes with edges of `voxel_size` (m). Voxel
    /// [0, 0, 0] begins at `origin` (3,), m, and extends along the axes of the body frame.
    #[staticmethod]
    #[pyo3(signature = (occupied, voxel_size, origin = None))]
    fn voxels(
        py: Python<'_>,
        occupied: &Bound<'_, PyAny>,
        voxel_size: f64,
        origin: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        // NumPy allows any byte in an array of bool, Rust only 0 and 1, so the bytes are read.
        let array = occupied.py().import("numpy")?.call_method1("asanyarray", (occupied,))?;
        if array.cast::<PyArrayDyn<bool>>().is_err() {
            return Err(problem_error("occupied", "must be a NumPy array of bool; convert it with astype"));
        }
        let bytes = array.call_method1("view", ("uint8",))?;
        let (occupied, grid) = convert::grid(&bytes, "occupied", voxel_size, origin, |v: &u8| *v != 0)?;
        solids(py, move || grid.solids(&occupied))
    }

    /// Returns solid cubes with edges of `sizes` (N,), m, or of one size, around `centers` (N, 3), m: the occupied leaves
    /// of an octree.
    #[staticmethod]
    fn octree(py: Python<'_>, centers: &Bound<'_, PyAny>, sizes: &Bound<'_, PyAny>) -> PyResult<Self> {
        let centers = convert::points(centers, "centers")?;
        let (sizes, shape) = convert::numbers(sizes, "sizes")?;
        let sizes = match shape.as_slice() {
            [] => vec![sizes[0]; centers.len()],
            [_] => sizes,
            _ => return Err(problem_error("sizes", format!("must be a number or have shape (N,), not {shape:?}"))),
        };
        solids(py, move || gensim2_geometry::cubes(&centers, &sizes))
    }

    /// Returns the obstacles of a signed distance field as solid cubes: each voxel whose distance is at most `threshold`
    /// (default: half a voxel's diagonal), and each `unknown` voxel, whose distance is NaN.
    #[staticmethod]
    #[pyo3(
        signature = (distances, voxel_size, origin = None, *, threshold = None, unknown = "occupied"),
        text_signature = "(distances, voxel_size, origin=None, *, threshold=None, unknown='occupied')"
    )]
    fn sdf(
        py: Python<'_>,
        distances: &Bound<'_, PyAny>,
        voxel_size: f64,
        origin: Option<&Bound<'_, PyAny>>,
        threshold: Option<f64>,
        unknown: &str,
    ) -> PyResult<Self> {
        let unknown = match unknown {
            "occupied" => true,
            "free" => false,
            other => return Err(problem_error("unknown", format!("must be \"occupied\" or \"free\", not {other:?}"))),
        };
        let (distances, grid) = if distances.cast::<PyArrayDyn<f32>>().is_ok() {
            convert::grid(distances, "distances", voxel_size, origin, |v: &f32| f64::from(*v))?
        } else {
            convert::grid(distances, "distances", voxel_size, origin, |v: &f64| *v)?
        };
        let threshold = threshold.unwrap_or_else(|| grid.half_diagonal());
        solids(py, move || grid.occupied(&distances, threshold, unknown).and_then(|occupied| grid.solids(&occupied)))
    }

    #[staticmethod]
    fn _thaw(bytes: &[u8]) -> PyResult<Self> {
        convert::thaw(bytes).map(Self)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        Ok((py.get_type::<Self>().getattr("_thaw")?, (PyBytes::new(py, &convert::freeze(&self.0)?),)))
    }
}

/// Computes the cubes of a grid, without the GIL.
fn solids(py: Python<'_>, work: impl FnOnce() -> Result<Vec<Convex>, ShapeError> + Send) -> PyResult<PyShape> {
    py.detach(work).map(PyShape).map_err(|e| from_shape(&e))
}

fn one(shape: Result<Convex, ShapeError>) -> PyResult<PyShape> {
    shape.map(|s| PyShape(vec![s])).map_err(|e| from_shape(&e))
}

/// A body: `role` is "table", "object_body", "moving_link", "rigid", "target" (the hand may touch it) or "attached" (it
/// moves with the hand). `pose` (4, 4) is in the robot base frame, or in the hand frame for an attached body.
#[pyclass(name = "Body", module = "gensim2_kpam", frozen)]
pub(crate) struct PyBody(pub Body);

#[pymethods]
impl PyBody {
    #[new]
    #[pyo3(signature = (name, role, shapes, pose, *, keypoints = None))]
    fn new(
        name: String,
        role: &str,
        shapes: Vec<PyRef<'_, PyShape>>,
        pose: &Bound<'_, PyAny>,
        keypoints: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let role = match role {
            "table" => Role::Table,
            "object_body" => Role::ObjectBody,
            "moving_link" => Role::MovingLink,
            "rigid" => Role::Rigid,
            "target" => Role::Target,
            "attached" => Role::Attached,
            other => {
                let message =
                    format!("{other:?} is unknown; use table, object_body, moving_link, rigid, target or attached");
                return Err(problem_error("role", message));
            }
        };
        let pose = convert::pose(pose, "pose")?;
        let body = Body::builder(name, role).shapes(shapes.iter().flat_map(|s| s.0.iter().cloned())).pose(pose);
        let keypoints = match keypoints {
            None => std::collections::BTreeMap::new(),
            Some(map) => crate::problem::keypoints(map, "keypoints")?,
        };
        let body = keypoints.into_iter().fold(body, |body, (name, point)| body.keypoint(name, point));
        body.build().map(Self).map_err(|e| from_problem(&e))
    }

    /// Role of the body.
    #[getter]
    fn role(&self) -> &'static str {
        self.0.role().name()
    }

    /// Triangles (M, 3, 3) of the surface, and spheres (K, 4): centre and radius. All are in the body frame (m).
    fn surface<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        surface(py, self.0.shapes())
    }

    /// Pose (4, 4) in the base frame, or in the hand frame for an attached body.
    #[getter]
    fn pose<'py>(&self, py: Python<'py>) -> Bound<'py, PyAny> {
        convert::pose_array(py, self.0.pose()).into_any()
    }

    #[getter]
    fn name(&self) -> &str {
        self.0.name()
    }

    #[staticmethod]
    fn _thaw(bytes: &[u8]) -> PyResult<Self> {
        convert::thaw(bytes).map(Self)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        Ok((py.get_type::<Self>().getattr("_thaw")?, (PyBytes::new(py, &convert::freeze(&self.0)?),)))
    }
}

/// The joint with which an object moves; `origin` and `axis` are (3,) in the robot base frame.
#[pyclass(name = "Joint", module = "gensim2_kpam", frozen)]
pub(crate) struct PyJoint(pub ObjectJoint);

#[pymethods]
impl PyJoint {
    #[new]
    fn new(
        kind: &str,
        origin: &Bound<'_, PyAny>,
        axis: &Bound<'_, PyAny>,
        value: f64,
        lower: f64,
        upper: f64,
    ) -> PyResult<Self> {
        let kind = match kind {
            "revolute" => ObjectJointKind::Revolute,
            "prismatic" => ObjectJointKind::Prismatic,
            other => return Err(problem_error("kind", format!("{other:?} is unknown; use revolute or prismatic"))),
        };
        let (origin, axis) = (convert::vector3(origin, "origin")?, convert::vector3(axis, "axis")?);
        ObjectJoint::new(kind, origin, axis, value, [lower, upper]).map(Self).map_err(|e| from_problem(&e))
    }

    #[staticmethod]
    fn _thaw(bytes: &[u8]) -> PyResult<Self> {
        convert::thaw(bytes).map(Self)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        Ok((py.get_type::<Self>().getattr("_thaw")?, (PyBytes::new(py, &convert::freeze(&self.0)?),)))
    }
}

//! Scenes: a robot and its surroundings.

use std::sync::Arc;

use gensim2_geometry::{ChainFrames, Inertia, LANES, Pose};
use gensim2_kpam::{Cancel, Checker, GraspTask, IkOptions, Nearness, PathTolerance, ProblemError, Scene, SceneJoint};
use nalgebra::{Matrix3, Vector3};
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList};

use crate::convert::{self, JointRows};
use crate::errors::{from_problem, problem_error};
use crate::geometry::{LONG, PyBody, PyJoint, PyRobot};
use crate::grasps::{PyGrasp, PyGraspPlan, PyParallelGripper};
use crate::interrupt::interruptible;
use crate::problem::{PyKeypointProblem, PySolverConfig, Question, bodies_listed, read_options};
use crate::renamed;
use crate::transit::{Arguments, PyMotion, two_poses};

/// Maximum number of configurations that are checked on the calling thread.
const FEW: usize = 256;

/// A joint of an object and the names of the bodies that it moves. Instances can be pickled.
#[pyclass(name = "SceneJoint", module = "gensim2_kpam", frozen)]
pub(crate) struct PySceneJoint(SceneJoint);

#[pymethods]
impl PySceneJoint {
    #[new]
    fn new(name: String, joint: &Bound<'_, PyJoint>, moves: Vec<String>) -> Self {
        Self(SceneJoint::new(name, joint.get().0, moves))
    }

    #[getter]
    fn name(&self) -> &str {
        self.0.name()
    }

    /// Current value of the joint (rad or m).
    #[getter]
    fn value(&self) -> f64 {
        self.0.joint().value()
    }

    #[getter]
    fn moves(&self) -> Vec<String> {
        self.0.moves().to_vec()
    }

    #[staticmethod]
    fn _thaw(bytes: &[u8]) -> PyResult<Self> {
        convert::thaw(bytes).map(Self)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        Ok((py.get_type::<Self>().getattr("_thaw")?, (PyBytes::new(py, &convert::freeze(&self.0)?),)))
    }
}

/// A robot and its surroundings, shared by all problems created from the scene. Instances can be pickled.
#[pyclass(name = "Scene", module = "gensim2_kpam", frozen)]
pub(crate) struct PyScene(pub Scene);

#[pymethods]
impl PyScene {
    #[new]
    #[pyo3(signature = (robot, bodies = Vec::new(), joints = Vec::new()))]
    fn new(
        robot: &Bound<'_, PyRobot>,
        bodies: Vec<PyRef<'_, PyBody>>,
        joints: Vec<PyRef<'_, PySceneJoint>>,
    ) -> PyResult<Self> {
        let bodies = bodies.iter().map(|b| b.0.clone()).collect();
        let joints = joints.iter().map(|j| j.0.clone()).collect();
        Scene::new(Arc::clone(&robot.get().0), bodies, joints).map(Self).map_err(|e| from_problem(&e))
    }

    /// Returns (N,) bool: whether each of the points (N, 3) lies within `clearance` (m) of the robot at joints `q` (n,)
    /// or of its attached bodies.
    #[pyo3(signature = (q, points, clearance = 0.02))]
    fn own_points<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        points: &Bound<'py, PyAny>,
        clearance: f64,
    ) -> PyResult<Bound<'py, PyAny>> {
        is_reach(clearance, "clearance")?;
        let q = JointRows::one(q, self.0.robot())?;
        let points = convert::points(points, "points")?;
        let marks = py.detach(|| self.0.own_points(&q, &points, clearance)).map_err(|e| from_problem(&e))?;
        Ok(PyArray1::from_vec(py, marks).into_any())
    }

    #[getter]
    fn robot(&self) -> PyRobot {
        PyRobot(Arc::clone(self.0.robot()))
    }

    #[getter]
    fn bodies(&self) -> Vec<PyBody> {
        self.0.bodies().iter().cloned().map(PyBody).collect()
    }

    #[getter]
    fn joints(&self) -> Vec<PySceneJoint> {
        self.0.joints().iter().cloned().map(PySceneJoint).collect()
    }

    /// Keypoints of the attached bodies in the hand frame, named "body/keypoint".
    #[getter]
    fn tool_keypoints<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        points(py, self.0.tool_keypoints())
    }

    /// Keypoints of all other bodies in the base frame, named "body/keypoint".
    #[getter]
    fn object_keypoints<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        points(py, self.0.object_keypoints())
    }

    /// Returns the scene with a joint at another value; the bodies of this joint move with it.
    fn with_joint(&self, name: &str, value: f64) -> PyResult<Self> {
        self.0.with_joint(name, value).map(Self).map_err(|e| from_problem(&e))
    }

    /// Returns the scene with a body at another pose in the base frame, or in the hand frame if the body is attached.
    fn with_pose(&self, body: &str, pose: &Bound<'_, PyAny>) -> PyResult<Self> {
        self.0.with_pose(body, &convert::pose(pose, "pose")?).map(Self).map_err(|e| from_problem(&e))
    }

    /// Returns the scene with another body, which replaces the body of the same name, if there is one.
    fn with_body(&self, body: &Bound<'_, PyBody>) -> PyResult<Self> {
        self.0.with_body(body.get().0.clone()).map(Self).map_err(|e| from_problem(&e))
    }

    /// Returns the scene without a body.
    fn without_body(&self, body: &str) -> PyResult<Self> {
        self.0.without_body(body).map(Self).map_err(|e| from_problem(&e))
    }

    /// Returns the scene with a payload in the hand: its mass (kg), centre of mass (3,), m, and inertia (3, 3), kg m²,
    /// about the centre of mass, in the frame of the hand's link. It replaces an earlier payload.
    #[pyo3(
        signature = (mass, center_of_mass = None, inertia = None),
        text_signature = "($self, mass, center_of_mass=(0.0, 0.0, 0.0), inertia=None)"
    )]
    fn with_payload(
        &self,
        mass: f64,
        center_of_mass: Option<&Bound<'_, PyAny>>,
        inertia: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let center = center_of_mass.map_or(Ok(Vector3::zeros()), |c| convert::vector3(c, "center_of_mass"))?;
        let tensor = match inertia {
            None => Matrix3::zeros(),
            Some(inertia) => match convert::numbers(inertia, "inertia")? {
                (data, shape) if shape == [3, 3] => Matrix3::from_row_slice(&data),
                (_, shape) => return Err(problem_error("inertia", format!("must have shape (3, 3), not {shape:?}"))),
            },
        };
        let payload = (mass != 0.0).then_some(Inertia { mass, center, tensor });
        self.0.with_payload(payload).map(Self).map_err(|e| from_problem(&e))
    }

    /// Returns the scene with a body attached to the hand at joints `q`; object joints no longer move this body.
    fn attached(&self, body: &str, q: &Bound<'_, PyAny>) -> PyResult<Self> {
        self.0.attached(body, &self.hand(q)?).map(Self).map_err(|e| from_problem(&e))
    }

    /// Returns the scene with an attached body released at the hand's pose for joints `q`. The body becomes a rigid
    /// obstacle; the joint `on`, if given, moves it.
    #[pyo3(signature = (body, q, on = None))]
    fn detached(&self, body: &str, q: &Bound<'_, PyAny>, on: Option<&str>) -> PyResult<Self> {
        self.0.detached(body, &self.hand(q)?, on).map(Self).map_err(|e| from_problem(&e))
    }

    /// Returns a problem on this scene, with the given keypoints and those of the scene's bodies. `joint` names the
    /// joint that the config moves; the bodies moved by this joint are the moving link.
    #[pyo3(signature = (
        config, q_start, *, tool_keypoints = None, object_keypoints = None, T_base_object = None, joint = None,
        object_axis = "y", object_yaw = 0.0, T_base_world = None, options = None
    ))]
    #[allow(non_snake_case, clippy::too_many_arguments)]
    fn problem(
        &self,
        config: &Bound<'_, PySolverConfig>,
        q_start: &Bound<'_, PyAny>,
        tool_keypoints: Option<&Bound<'_, PyAny>>,
        object_keypoints: Option<&Bound<'_, PyAny>>,
        T_base_object: Option<&Bound<'_, PyAny>>,
        joint: Option<&str>,
        object_axis: &str,
        object_yaw: f64,
        T_base_world: Option<&Bound<'_, PyAny>>,
        options: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<PyKeypointProblem> {
        let question = Question {
            config,
            q_start,
            tool_keypoints,
            object_keypoints,
            T_base_object,
            object_axis,
            object_yaw,
            T_base_world,
            options,
        };
        let builder = self.0.problem(question.config(), question.q_start()?, joint).map_err(|e| from_problem(&e))?;
        question.asked_of(builder)
    }

    /// Returns grasps of a body, best first, at which the hand does not collide with the other bodies.
    #[pyo3(signature = (body, gripper, center_of_mass = None, options = None))]
    fn grasps(
        &self,
        py: Python<'_>,
        body: &str,
        gripper: &Bound<'_, PyParallelGripper>,
        center_of_mass: Option<&Bound<'_, PyAny>>,
        options: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Vec<PyGrasp>> {
        self.grasps_of(py, body, gripper, center_of_mass, options)
    }

    /// Plans a pick and its placements with the first of `grasps` that allows all motions.
    #[pyo3(signature = (body, gripper, q_start, grasps, *, targets = Vec::new(), approach = 0.1, lift = None, options = None))]
    #[allow(clippy::too_many_arguments)]
    fn plan_grasp(
        &self,
        py: Python<'_>,
        body: String,
        gripper: &Bound<'_, PyParallelGripper>,
        q_start: &Bound<'_, PyAny>,
        grasps: Vec<PyRef<'_, PyGrasp>>,
        targets: Vec<(Bound<'_, PyAny>, Option<Bound<'_, PyAny>>)>,
        approach: f64,
        lift: Option<&Bound<'_, PyAny>>,
        options: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Option<PyGraspPlan>> {
        let q_start = convert::vector(q_start, "q_start", None)?;
        let mut task =
            GraspTask::new(body, gripper.get().0.clone(), q_start).approach(approach).options(read_options(options)?);
        if let Some(lift) = lift {
            task = task.lift(convert::vector3(lift, "lift")?);
        }
        self.plan_grasp_with(py, task, &grasps, &targets)
    }

    /// Plans a timed motion from `q_start` to rest at one of the goals that keeps `margin` (m) from all obstacles:
    /// `goal` is (n,), or alternatives (K, n), or the pose (4, 4) of `link` (default: the hand) in the base frame, or a
    /// dict of two links and their poses.
    #[pyo3(
        signature = (q_start, goal, **options),
        text_signature = "($self, q_start, goal, *, link=None, margin=0.005, samples=100_000, seed=0, velocity_scale=1.0, acceleration_scale=1.0, limits=None, velocity_limits=None, acceleration_limits=None, jerk_limits=None, torque_limits=None, path=None, tool_keypoints=None, start_velocity=None, start_acceleration=None, start_time=0.0, warm_start=None, max_checks=None, deadline_ms=None, cancel=None)"
    )]
    fn plan_to(
        &self,
        py: Python<'_>,
        q_start: &Bound<'_, PyAny>,
        goal: &Bound<'_, PyAny>,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<PyMotion> {
        let arguments = Arguments::read(options, self.0.robot().joints().len(), &[])?;
        self.motion_to(py, q_start, goal, arguments)
    }

    /// Plans a motion for each pair of `q_starts` and `goals` on `threads` threads, 1 to 256 (default: number of cores).
    /// The other arguments are those of `plan_to`, and the results are the same.
    #[pyo3(
        signature = (q_starts, goals, *, threads = None, **options),
        text_signature = "($self, q_starts, goals, *, threads=None, **options)"
    )]
    fn plan_to_many(
        &self,
        py: Python<'_>,
        q_starts: Vec<Bound<'_, PyAny>>,
        goals: Vec<Bound<'_, PyAny>>,
        threads: Option<usize>,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Vec<PyMotion>> {
        let arguments = Arguments::read(options, self.0.robot().joints().len(), &[])?;
        self.motions_to(py, &q_starts, &goals, threads, arguments)
    }

    /// Plans a timed motion from rest at `q_start` along straight lines of the hand through `poses`, each (4, 4) in the
    /// base frame, within a tolerance. The hand may rotate about `free_axis` (3,), a direction of the hand frame, or
    /// `second_link` keeps its pose relative to the hand.
    #[pyo3(
        signature = (q_start, poses, *, position_tolerance = 0.001, rotation_tolerance = 0.01, free_axis = None, second_link = None, **options),
        text_signature = "($self, q_start, poses, *, position_tolerance=0.001, rotation_tolerance=0.01, free_axis=None, second_link=None, margin=0.005, seed=0, velocity_scale=1.0, acceleration_scale=1.0, limits=None, velocity_limits=None, acceleration_limits=None, jerk_limits=None, torque_limits=None, start_time=0.0, max_checks=None, deadline_ms=None, cancel=None)"
    )]
    #[allow(clippy::too_many_arguments)]
    fn plan_along(
        &self,
        py: Python<'_>,
        q_start: &Bound<'_, PyAny>,
        poses: Vec<Bound<'_, PyAny>>,
        position_tolerance: f64,
        rotation_tolerance: f64,
        free_axis: Option<&Bound<'_, PyAny>>,
        second_link: Option<String>,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<PyMotion> {
        let unknown =
            ["link", "samples", "path", "tool_keypoints", "start_velocity", "start_acceleration", "warm_start"];
        let arguments = Arguments::read(options, self.0.robot().joints().len(), &unknown)?;
        let mut tolerance = PathTolerance::default();
        (tolerance.position, tolerance.rotation) = (position_tolerance, rotation_tolerance);
        tolerance.free_axis = free_axis.map(|axis| convert::vector3(axis, "free_axis")).transpose()?;
        tolerance.second_link = second_link;
        self.motion_along(py, q_start, poses, tolerance, arguments)
    }

    /// Returns at most `max_solutions` distinct joint vectors (K, n) that bring `link` (default: the hand) to a pose
    /// (4, 4) in the base frame, or two links to the poses of a dict, best first: closest to `q_start`, or by the objective of `posture` and `manipulability`.
    /// With a `margin` (m), only solutions that keep this distance from obstacles are returned.
    #[allow(clippy::too_many_arguments)]
    #[pyo3(
        signature = (
            pose, q_start, *, link = None, max_solutions = None, seed = 0, min_distance = 0.05, posture = None,
            posture_weights = None, manipulability = 0.0, margin = None, **others
        ),
        text_signature = "($self, pose, q_start, *, link=None, max_solutions=16, seed=0, min_distance=0.05, posture=None, posture_weights=None, manipulability=0.0, margin=None)"
    )]
    fn ik<'py>(
        &self,
        py: Python<'py>,
        pose: &Bound<'py, PyAny>,
        q_start: &Bound<'py, PyAny>,
        link: Option<String>,
        max_solutions: Option<usize>,
        seed: usize,
        min_distance: f64,
        posture: Option<&Bound<'py, PyAny>>,
        posture_weights: Option<&Bound<'py, PyAny>>,
        manipulability: f64,
        margin: Option<f64>,
        others: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let joints = self.0.robot().joints().len();
        let listed = |list: Option<&Bound<'_, PyAny>>, field: &str| {
            list.map(|list| convert::vector(list, field, Some(joints))).transpose()
        };
        let mut options = IkOptions::default();
        let max_solutions = renamed::keyword(py, max_solutions, others, ("most", "max_solutions"))?;
        options.max_solutions = max_solutions.unwrap_or(options.max_solutions);
        (options.link, options.seed, options.min_distance) = (link, seed, min_distance);
        let pose = match pose.cast::<PyDict>() {
            Err(_) => convert::pose(pose, "pose")?,
            Ok(poses) => {
                if options.link.is_some() {
                    return Err(problem_error("link", "must be omitted: the poses name their links"));
                }
                let [(link, pose), other] = two_poses(poses, "pose")?;
                (options.link, options.other) = (Some(link), Some(other));
                pose
            }
        };
        options.posture = listed(posture, "posture")?;
        options.posture_weights = listed(posture_weights, "posture_weights")?;
        (options.manipulability, options.margin) = (manipulability, margin);
        let q_start = convert::vector(q_start, "q_start", Some(joints))?;
        // Starting an interruptible thread takes longer than a plain search.
        let plain = options.posture.is_none() && manipulability == 0.0 && margin.is_none();
        let found = if plain {
            py.detach(|| gensim2_kpam::solutions(&self.0, &pose, &q_start, &options))
        } else {
            let (scene, cancel) = (self.0.clone(), Cancel::new());
            options.cancel = Some(cancel.clone());
            interruptible(py, cancel, move |_| gensim2_kpam::solutions(&scene, &pose, &q_start, &options))?
        };
        Ok(convert::array2(py, &found.map_err(|e| from_problem(&e))?, joints).into_any())
    }

    /// Returns whether the robot overlaps a body or itself at each configuration: (n,) -> bool, (N, n) -> (N,) bool.
    fn in_collision<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let q = self.rows(q)?;
        let single = q.count.is_none();
        let hits = self.hits(py, q)?;
        if single {
            return Ok(hits[0].into_pyobject(py)?.to_owned().into_any());
        }
        Ok(PyArray1::from_vec(py, hits).into_any())
    }

    /// Returns the smallest signed distance (m) between the robot and a body or another part of the robot, at most
    /// `max_distance`: (n,) -> float, (N, n) -> (N,).
    #[pyo3(signature = (q, max_distance = None, **others), text_signature = "($self, q, max_distance=1.0)")]
    fn distance<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        max_distance: Option<f64>,
        others: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let max_distance = renamed::keyword(py, max_distance, others, ("most", "max_distance"))?.unwrap_or(1.0);
        is_reach(max_distance, "max_distance")?;
        let q = self.rows(q)?;
        let single = q.count.is_none();
        let found: Vec<f64> = self.each(py, q, move |checker, row| checker.distance(row, max_distance))?;
        if single {
            return Ok(found[0].into_pyobject(py)?.into_any());
        }
        Ok(convert::array1(py, &found).into_any())
    }

    /// Lists the pairs within `reach` (m) of each other, closest first: for (n,) a list of dicts `bodies`, `distance`
    /// (m, negative if they overlap), `point` (3,); for (N, n) a list of such lists.
    #[pyo3(signature = (q, reach = 0.0))]
    fn check<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>, reach: f64) -> PyResult<Bound<'py, PyList>> {
        is_reach(reach, "reach")?;
        let q = self.rows(q)?;
        let single = q.count.is_none();
        let found: Vec<Vec<Nearness>> = self.each(py, q, move |checker, row| checker.near(row, reach))?;
        if single {
            return listed(py, &found[0]);
        }
        let out = PyList::empty(py);
        for near in &found {
            out.append(listed(py, near)?)?;
        }
        Ok(out)
    }

    #[staticmethod]
    fn _thaw(bytes: &[u8]) -> PyResult<Self> {
        convert::thaw(bytes).map(Self)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        Ok((py.get_type::<Self>().getattr("_thaw")?, (PyBytes::new(py, &convert::freeze(&self.0)?),)))
    }

    fn __repr__(&self) -> String {
        let joints: Vec<String> =
            self.0.joints().iter().map(|j| format!("{} at {:.3}", j.name(), j.joint().value())).collect();
        format!(
            "Scene({:?} with {} joints; bodies: {}; joints: {})",
            self.0.robot().name(),
            self.0.robot().joints().len(),
            bodies_listed(self.0.bodies()),
            if joints.is_empty() { "none".to_owned() } else { joints.join(", ") }
        )
    }
}

impl PyScene {
    /// Pose of the hand in the base frame at joints `q` (n,).
    fn hand(&self, q: &Bound<'_, PyAny>) -> PyResult<Pose> {
        let robot = self.0.robot();
        let q = JointRows::one(q, robot)?;
        let mut frames = ChainFrames::default();
        robot.chain().forward(&q, &mut frames).map_err(|e| problem_error("q", e))?;
        Ok(frames.tip)
    }

    fn rows(&self, q: &Bound<'_, PyAny>) -> PyResult<JointRows> {
        JointRows::of_robot(q, self.0.robot())
    }

    /// Whether a check is faster than starting an interruptible thread: there are few configurations, and the scene is
    /// prepared or small.
    fn is_quick(&self, q: &JointRows) -> bool {
        let shapes = || self.0.bodies().iter().map(|b| b.shapes().len()).sum::<usize>();
        q.rows().len() <= FEW && (self.0.is_ready() || shapes() < LONG)
    }

    /// Returns whether any pair overlaps, for each row of joints.
    fn hits(&self, py: Python<'_>, q: JointRows) -> PyResult<Vec<bool>> {
        let (scene, quick) = (self.0.clone(), self.is_quick(&q));
        let look = move |cancel: &Cancel| {
            let mut checker = scene.checker();
            let rows: Vec<&[f64]> = q.rows().collect();
            let mut out = Vec::with_capacity(rows.len());
            for some in rows.chunks(LANES).take_while(|_| !cancel.is_cancelled()) {
                out.extend(checker.hits_each(some)?);
            }
            Ok::<_, ProblemError>(out)
        };
        let found =
            if quick { py.detach(move || look(&Cancel::new())) } else { interruptible(py, Cancel::new(), look)? };
        found.map_err(|e| from_problem(&e))
    }

    /// Computes `ask` for each row of joints.
    fn each<T: Send + 'static>(
        &self,
        py: Python<'_>,
        q: JointRows,
        ask: impl Fn(&mut Checker<'_>, &[f64]) -> Result<T, ProblemError> + Send + 'static,
    ) -> PyResult<Vec<T>> {
        let (scene, quick) = (self.0.clone(), self.is_quick(&q));
        let look = move |cancel: &Cancel| {
            let mut checker = scene.checker();
            q.rows()
                .take_while(|_| !cancel.is_cancelled())
                .map(|row| ask(&mut checker, row))
                .collect::<Result<Vec<T>, _>>()
        };
        let found =
            if quick { py.detach(move || look(&Cancel::new())) } else { interruptible(py, Cancel::new(), look)? };
        found.map_err(|e| from_problem(&e))
    }
}

fn listed<'py>(py: Python<'py>, near: &[Nearness]) -> PyResult<Bound<'py, PyList>> {
    convert::dicts(py, near, |d, n| {
        d.set_item("bodies", (&n.first, &n.second))?;
        d.set_item("distance", n.distance)?;
        d.set_item("point", convert::array1(py, n.point.coords.as_slice()))
    })
}

fn is_reach(value: f64, field: &str) -> PyResult<()> {
    if (0.0..=10.0).contains(&value) {
        return Ok(());
    }
    Err(problem_error(field, format!("must lie in 0 to 10 m, not {value}")))
}

fn points(py: Python<'_>, map: std::collections::BTreeMap<String, Vector3<f64>>) -> PyResult<Bound<'_, PyDict>> {
    let out = PyDict::new(py);
    for (name, p) in map {
        out.set_item(name, convert::array1(py, p.as_slice()))?;
    }
    Ok(out)
}

/// Flag that ends planning from another thread: pass the flag to `plan` and call `cancel`.
#[pyclass(name = "Cancel", module = "gensim2_kpam", frozen)]
pub(crate) struct PyCancel(pub Cancel);

#[pymethods]
impl PyCancel {
    #[new]
    fn new() -> Self {
        Self(Cancel::new())
    }

    /// Requests the end of planning. The plan then has the status "cancelled".
    fn cancel(&self) {
        self.0.cancel();
    }

    #[getter]
    fn is_cancelled(&self) -> bool {
        self.0.is_cancelled()
    }
}

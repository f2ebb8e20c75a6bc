//! Grippers and grasps.

use gensim2_kpam::grasp::{Grasp, GraspPlan, GraspTask, GripperKeypoints, ParallelGripper, Target};
use gensim2_kpam::{Cancel, StageTimes};
use nalgebra::Point3;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::convert;
use crate::errors::from_problem;
use crate::geometry::{PyRobot, PyShape};
use crate::interrupt::interruptible;
use crate::plan::PyPlan;
use crate::problem::read_options;
use crate::scene::PyScene;

pub(crate) fn keypoints(
    head: &Bound<'_, PyAny>,
    tail: &Bound<'_, PyAny>,
    side: &Bound<'_, PyAny>,
) -> PyResult<GripperKeypoints> {
    Ok(GripperKeypoints {
        head: convert::vector3(head, "tool_head")?,
        tail: convert::vector3(tail, "tool_tail")?,
        side: convert::vector3(side, "tool_side")?,
    })
}

/// A gripper with two flat pads that move symmetrically. Instances can be pickled.
#[pyclass(name = "ParallelGripper", module = "gensim2_kpam", frozen)]
pub(crate) struct PyParallelGripper(pub ParallelGripper);

#[pymethods]
impl PyParallelGripper {
    #[new]
    #[pyo3(signature = (tool_head, tool_tail, tool_side, *, pad, stroke, palm = Vec::new(), fingers = (Vec::new(), Vec::new())))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        tool_head: &Bound<'_, PyAny>,
        tool_tail: &Bound<'_, PyAny>,
        tool_side: &Bound<'_, PyAny>,
        pad: &Bound<'_, PyAny>,
        stroke: &Bound<'_, PyAny>,
        palm: Vec<PyRef<'_, PyShape>>,
        fingers: (Vec<PyRef<'_, PyShape>>, Vec<PyRef<'_, PyShape>>),
    ) -> PyResult<Self> {
        let two = |value, field| convert::vector(value, field, Some(2)).map(|v| [v[0], v[1]]);
        let pad = two(pad, "pad")?.map(|whole| 0.5 * whole);
        let stroke = two(stroke, "stroke")?;
        let shapes = |list: &[PyRef<'_, PyShape>]| list.iter().flat_map(|s| s.0.iter().cloned()).collect::<Vec<_>>();
        let fingers = [shapes(&fingers.0), shapes(&fingers.1)];
        ParallelGripper::frame(&keypoints(tool_head, tool_tail, tool_side)?)
            .and_then(|grip| ParallelGripper::new(grip, pad, stroke, shapes(&palm), fingers))
            .map(Self)
            .map_err(|e| from_problem(&e))
    }

    #[staticmethod]
    fn of_robot(
        robot: &Bound<'_, PyRobot>,
        tool_head: &Bound<'_, PyAny>,
        tool_tail: &Bound<'_, PyAny>,
        tool_side: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        ParallelGripper::of_robot(&robot.get().0, &keypoints(tool_head, tool_tail, tool_side)?)
            .map(Self)
            .map_err(|e| from_problem(&e))
    }

    #[getter]
    #[allow(non_snake_case)]
    fn T_hand_grip<'py>(&self, py: Python<'py>) -> Bound<'py, PyAny> {
        convert::pose_array(py, self.0.grip()).into_any()
    }

    #[getter]
    fn pad(&self) -> (f64, f64) {
        let [across, along] = self.0.pad();
        (2.0 * across, 2.0 * along)
    }

    #[getter]
    fn stroke(&self) -> (f64, f64) {
        self.0.stroke().into()
    }

    #[staticmethod]
    fn _thaw(bytes: &[u8]) -> PyResult<Self> {
        convert::thaw(bytes).map(Self)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        Ok((py.get_type::<Self>().getattr("_thaw")?, (PyBytes::new(py, &convert::freeze(&self.0)?),)))
    }

    fn __repr__(&self) -> String {
        let ([across, along], [least, most]) = (self.0.pad(), self.0.stroke());
        let mm = |m: f64| 1e3 * m;
        format!(
            "ParallelGripper(pads {:.1} x {:.1} mm, opens {:.1} to {:.1} mm)",
            mm(2.0 * across),
            mm(2.0 * along),
            mm(least),
            mm(most)
        )
    }
}

/// A grasp of an object. Instances can be pickled.
#[pyclass(name = "Grasp", module = "gensim2_kpam", frozen)]
pub(crate) struct PyGrasp(pub Grasp);

#[pymethods]
impl PyGrasp {
    #[getter]
    #[allow(non_snake_case)]
    fn T_object_hand<'py>(&self, py: Python<'py>) -> Bound<'py, PyAny> {
        convert::pose_array(py, &self.0.object_hand).into_any()
    }

    #[getter]
    #[allow(non_snake_case)]
    fn T_base_hand<'py>(&self, py: Python<'py>) -> Bound<'py, PyAny> {
        convert::pose_array(py, &self.0.base_hand).into_any()
    }

    #[getter]
    fn approach<'py>(&self, py: Python<'py>) -> Bound<'py, PyAny> {
        convert::array1(py, self.0.approach.as_slice()).into_any()
    }

    #[getter]
    fn width(&self) -> f64 {
        self.0.width
    }

    #[getter]
    fn opening(&self) -> f64 {
        self.0.opening
    }

    #[getter]
    fn score(&self) -> f64 {
        self.0.score
    }

    #[getter]
    fn quality<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let (q, out) = (&self.0.quality, PyDict::new(py));
        out.set_item("friction_margin", q.friction_margin)?;
        out.set_item("contact", q.contact)?;
        out.set_item("lever", q.lever)?;
        out.set_item("clearance", q.clearance)?;
        out.set_item("tilt", q.tilt)?;
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
        format!("Grasp(score {:.2}, width {:.1} mm)", self.0.score, 1e3 * self.0.width)
    }
}

/// A grasp with the planned motions of the pick and its placements.
#[pyclass(name = "GraspPlan", module = "gensim2_kpam", frozen)]
pub(crate) struct PyGraspPlan(GraspPlan);

#[pymethods]
impl PyGraspPlan {
    #[getter]
    fn index(&self) -> usize {
        self.0.index
    }

    #[getter]
    #[allow(non_snake_case)]
    fn T_object_hand<'py>(&self, py: Python<'py>) -> Bound<'py, PyAny> {
        convert::pose_array(py, &self.0.object_hand).into_any()
    }

    #[getter]
    fn pick(&self) -> PyPlan {
        PyPlan(self.0.pick.clone(), StageTimes::default())
    }

    #[getter]
    fn carries(&self) -> Vec<PyPlan> {
        self.0.carries.iter().map(|p| PyPlan(p.clone(), StageTimes::default())).collect()
    }
}

impl PyScene {
    /// Calls [`Scene::grasps`] without the GIL; Ctrl-C interrupts the search.
    pub(crate) fn grasps_of(
        &self,
        py: Python<'_>,
        body: &str,
        gripper: &Bound<'_, PyParallelGripper>,
        center_of_mass: Option<&Bound<'_, PyAny>>,
        options: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Vec<PyGrasp>> {
        let options = read_options(options)?;
        let center = center_of_mass.map(|c| convert::vector3(c, "center_of_mass").map(Point3::from)).transpose()?;
        let (scene, body, gripper) = (self.0.clone(), body.to_owned(), gripper.get().0.clone());
        interruptible(py, Cancel::new(), move |_| scene.grasps(&body, &gripper, center, &options))?
            .map(|found| found.into_iter().map(PyGrasp).collect())
            .map_err(|e| from_problem(&e))
    }

    /// Calls [`Scene::plan_grasp`] without the GIL; Ctrl-C interrupts planning.
    pub(crate) fn plan_grasp_with(
        &self,
        py: Python<'_>,
        task: GraspTask,
        grasps: &[PyRef<'_, PyGrasp>],
        targets: &[(Bound<'_, PyAny>, Option<Bound<'_, PyAny>>)],
    ) -> PyResult<Option<PyGraspPlan>> {
        let target = |(i, (pose, axis)): (usize, &(Bound<'_, PyAny>, Option<Bound<'_, PyAny>>))| -> PyResult<Target> {
            let free_axis =
                axis.as_ref().map(|a| convert::vector3(a, &format!("targets[{i}]: free axis"))).transpose()?;
            Ok(Target { object: convert::pose(pose, &format!("targets[{i}]: T_base_object"))?, free_axis })
        };
        let targets: Vec<Target> = targets.iter().enumerate().map(target).collect::<PyResult<_>>()?;
        let task = targets.into_iter().fold(task, GraspTask::target);
        let grasps: Vec<Grasp> = grasps.iter().map(|g| g.0).collect();
        let scene = self.0.clone();
        let cancel = Cancel::new();
        let task = task.cancel(cancel.clone());
        interruptible(py, cancel, move |_| scene.plan_grasp(&task, &grasps))?
            .map(|found| found.map(PyGraspPlan))
            .map_err(|e| from_problem(&e))
    }
}

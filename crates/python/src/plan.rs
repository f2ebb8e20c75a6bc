//! Python class of a plan.

use gensim2_kpam::{Plan, StageTimes};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList};

use crate::KpamError;
use crate::convert;
use crate::timing::PyTrajectory;

/// Result of planning: motion, residuals of the constraints, reason of a failure. Instances can be pickled.
#[pyclass(name = "Plan", module = "gensim2_kpam", frozen)]
pub(crate) struct PyPlan(pub(crate) Plan, pub(crate) StageTimes);

fn optional<'py>(py: Python<'py>, q: Option<&Vec<f64>>) -> Option<Bound<'py, PyAny>> {
    q.map(|q| convert::array1(py, q).into_any())
}

#[pymethods]
impl PyPlan {
    /// Result of planning as a member of `Status`, which is a string.
    #[getter]
    fn status<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        convert::member(py, "Status", self.0.status().name())
    }

    #[getter]
    fn reason(&self) -> &str {
        &self.0.reason
    }

    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.0.warnings.clone()
    }

    /// Clearance (m) that the motion keeps from bodies that it may not touch, except the pairs in `tight`.
    #[getter]
    fn margin(&self) -> f64 {
        self.0.margin
    }

    /// Limits ("acceleration", "jerk") for which default values are assumed because none were given.
    #[getter]
    fn assumed_limits(&self) -> Vec<String> {
        self.0.assumed_limits.clone()
    }

    /// Pairs closer than the margin at the start or at a keyframe: dicts `bodies`, `at`, `distance`.
    #[getter]
    fn tight<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        convert::dicts(py, &self.0.tight, |d, t| {
            d.set_item("bodies", (&t.bodies[0], &t.bodies[1]))?;
            d.set_item("at", &t.at)?;
            d.set_item("distance", t.distance)
        })
    }

    /// Permitted overlaps at keyframes: dicts `bodies`, `at`, `depth`.
    #[getter]
    fn touches<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        convert::dicts(py, &self.0.touches, |d, t| {
            d.set_item("bodies", (&t.bodies[0], &t.bodies[1]))?;
            d.set_item("at", &t.at)?;
            d.set_item("depth", t.depth)
        })
    }

    /// Motions that move the object's joint by an estimated amount: dicts `toward`, `travel`, `depth`.
    #[getter]
    fn guesses<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        convert::dicts(py, &self.0.guesses, |d, g| {
            d.set_item("toward", &g.toward)?;
            d.set_item("travel", g.travel)?;
            d.set_item("depth", g.depth)
        })
    }

    #[getter]
    fn q_actuation<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyAny>> {
        optional(py, self.0.q_actuation.as_ref())
    }

    #[getter]
    fn q_plan<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyAny>> {
        optional(py, self.0.q_plan.as_ref())
    }

    #[getter]
    fn q_best_effort<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyAny>> {
        optional(py, self.0.q_best_effort.as_ref())
    }

    #[getter]
    fn cost(&self) -> Option<f64> {
        self.0.cost
    }

    /// Thread CPU time (ms) of planning: `setup`, `actuation`, `trajectory`, `total`. Not preserved by pickling.
    #[getter]
    fn cpu_ms<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let out = PyDict::new(py);
        out.set_item("setup", 1e3 * self.1.setup)?;
        out.set_item("actuation", 1e3 * self.1.actuation)?;
        out.set_item("trajectory", 1e3 * self.1.trajectory)?;
        out.set_item("total", 1e3 * (self.1.setup + self.1.actuation + self.1.trajectory))?;
        Ok(out)
    }

    /// Number of actuation poses for which the planner attempted to find a motion.
    #[getter]
    fn tried(&self) -> usize {
        self.0.tried
    }

    /// Result for each actuation pose that was tried, if `explain` was set: dicts `q`, `rank`, `status`, `reason`.
    #[getter]
    fn tried_poses<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        convert::dicts(py, &self.0.tried_poses, |d, pose| {
            d.set_item("q", convert::array1(py, &pose.q))?;
            d.set_item("rank", pose.rank)?;
            d.set_item("status", convert::member(py, "Status", pose.status.name())?)?;
            d.set_item("reason", &pose.reason)
        })
    }

    #[getter]
    fn reached_fraction(&self) -> f64 {
        self.0.reached_fraction
    }

    #[getter]
    fn start_overlap(&self) -> f64 {
        self.0.start_overlap
    }

    #[getter]
    fn residuals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        convert::dicts(py, &self.0.residuals, |d, r| {
            d.set_item("name", &r.name)?;
            d.set_item("residual", r.residual)?;
            d.set_item("tolerance", r.tolerance)?;
            d.set_item("satisfied", r.satisfied)
        })
    }

    #[getter]
    fn keyframes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        convert::dicts(py, &self.0.keyframes, |d, k| {
            d.set_item("label", &k.label)?;
            d.set_item("time", k.time)?;
            let rows: Vec<Vec<f64>> = k.hand.iter().map(|r| r.to_vec()).collect();
            d.set_item("T_base_hand", convert::array2(py, &rows, 4))?;
            d.set_item("reached", k.reached)
        })
    }

    #[getter]
    fn collisions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        convert::dicts(py, &self.0.collisions, |d, c| {
            d.set_item("bodies", (&c.bodies[0], &c.bodies[1]))?;
            d.set_item("time", c.time)?;
            d.set_item("toward", &c.toward)?;
            d.set_item("distance", c.distance)?;
            d.set_item("point", convert::array1(py, &c.point))
        })
    }

    #[getter]
    fn trajectory(&self) -> Option<PyTrajectory> {
        self.0.trajectory().cloned().map(PyTrajectory)
    }

    /// Returns JSON-compatible data of the plan, including `times` and `positions` of the trajectory.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let mut value = serde_json::to_value(&self.0).map_err(|e| KpamError::new_err(e.to_string()))?;
        if let Some(map) = value.as_object_mut() {
            map.remove("outcome");
            let motion =
                self.0.trajectory().map(|t| serde_json::json!({"times": t.times(), "positions": t.positions()}));
            map.insert("status".to_owned(), self.0.status().name().into());
            map.insert("trajectory".to_owned(), motion.into());
        }
        convert::python(py, &value)
    }

    #[staticmethod]
    fn _thaw(bytes: &[u8]) -> PyResult<Self> {
        convert::thaw(bytes).map(|plan| Self(plan, StageTimes::default()))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        Ok((py.get_type::<Self>().getattr("_thaw")?, (PyBytes::new(py, &convert::freeze(&self.0)?),)))
    }

    fn __repr__(&self) -> String {
        let plan = &self.0;
        let motion = plan.trajectory().map_or_else(
            || "no motion".to_owned(),
            |t| {
                let met = plan.keyframes.iter().filter(|k| k.time.is_some()).map(|k| k.label.as_str());
                format!("{:.2} s by {}", t.end() - t.start(), met.collect::<Vec<_>>().join(", "))
            },
        );
        format!("Plan({}: {}; {motion})", plan.status().name(), plan.reason)
    }
}

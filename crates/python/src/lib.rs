//! The Python face: conversions, errors, and nothing else. The GIL is released while planning.

mod convert;
mod geometry;
mod grasps;
mod planning;

use pyo3::create_exception;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;

create_exception!(
    gensim2_kpam,
    KpamError,
    PyException,
    "Base class. Its subclasses name the file or field and the remedy."
);
create_exception!(gensim2_kpam, UrdfError, KpamError, "A robot description that cannot be used: file, field, remedy.");
create_exception!(gensim2_kpam, ConfigError, KpamError, "A solver config that cannot be used: field, remedy.");
create_exception!(gensim2_kpam, ProblemError, KpamError, "A problem whose parts do not fit each other: field, remedy.");

#[pymodule]
fn _native(m: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = m.py();
    m.add("__version__", env!("CARGO_PKG_VERSION"))?;
    m.add("KpamError", py.get_type::<KpamError>())?;
    m.add("UrdfError", py.get_type::<UrdfError>())?;
    m.add("ConfigError", py.get_type::<ConfigError>())?;
    m.add("ProblemError", py.get_type::<ProblemError>())?;
    m.add_class::<geometry::PyRobot>()?;
    m.add_class::<geometry::PyShape>()?;
    m.add_class::<geometry::PyBody>()?;
    m.add_class::<geometry::PyJoint>()?;
    m.add_class::<grasps::PyParallelGripper>()?;
    m.add_class::<grasps::PyGrasp>()?;
    m.add_class::<grasps::PyGraspPlan>()?;
    m.add_class::<planning::PySolverConfig>()?;
    m.add_class::<planning::PyKeypointProblem>()?;
    m.add_class::<planning::PyTrajectory>()?;
    m.add_class::<planning::PyPlan>()?;
    m.add_function(wrap_pyfunction!(grasps::grasps, m)?)?;
    m.add_function(wrap_pyfunction!(grasps::plan_grasp, m)?)?;
    m.add_function(wrap_pyfunction!(planning::plan, m)?)?;
    m.add_function(wrap_pyfunction!(planning::plan_batch, m)?)?;
    m.add_function(wrap_pyfunction!(planning::in_collision, m)?)?;
    m.add_function(wrap_pyfunction!(planning::min_clearance, m)?)?;
    Ok(())
}

//! Python bindings of the solver. They only convert values and errors. The GIL is released while planning.

mod convert;
mod errors;
mod files;
mod geometry;
mod grasps;
mod interrupt;
mod plan;
mod planning;
mod problem;
mod renamed;
mod scene;
mod servo;
mod timing;
mod transit;

use pyo3::prelude::*;

use errors::KpamError;

#[pymodule]
fn _native(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add("__version__", env!("CARGO_PKG_VERSION"))?;
    errors::register(m)?;
    m.add_class::<geometry::PyRobot>()?;
    m.add_class::<geometry::PyShape>()?;
    m.add_class::<geometry::PyBody>()?;
    m.add_class::<geometry::PyJoint>()?;
    m.add_class::<scene::PySceneJoint>()?;
    m.add_class::<scene::PyScene>()?;
    m.add_class::<scene::PyCancel>()?;
    m.add_class::<grasps::PyParallelGripper>()?;
    m.add_class::<grasps::PyGrasp>()?;
    m.add_class::<grasps::PyGraspPlan>()?;
    m.add_class::<problem::PySolverConfig>()?;
    m.add_class::<problem::PyKeypointProblem>()?;
    m.add_class::<timing::PyTrajectory>()?;
    m.add_class::<timing::PySpeedScale>()?;
    m.add_class::<plan::PyPlan>()?;
    m.add_class::<transit::PyMotion>()?;
    m.add_class::<servo::PyServo>()?;
    m.add_class::<servo::PyServoStep>()?;
    m.add_function(wrap_pyfunction!(files::read_urdf, m)?)?;
    m.add_function(wrap_pyfunction!(files::read_obj, m)?)?;
    m.add_function(wrap_pyfunction!(planning::plan, m)?)?;
    m.add_function(wrap_pyfunction!(planning::plan_batch, m)?)?;
    m.add_function(wrap_pyfunction!(planning::ik, m)?)?;
    m.add_function(wrap_pyfunction!(planning::joint_travel, m)?)?;
    m.add_function(wrap_pyfunction!(planning::min_clearance, m)?)?;
    m.add_function(wrap_pyfunction!(timing::retime, m)?)?;
    m.add_function(wrap_pyfunction!(timing::refine, m)?)?;
    Ok(())
}

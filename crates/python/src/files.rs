//! Parsers of URDF and OBJ files for purposes other than loading a robot.

use gensim2_geometry::{Description, Obj};
use numpy::{PyArray2, ndarray};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyList;

use crate::errors::{from_urdf, problem_error};

/// Parses a URDF into dicts, lists, strings and numbers; missing or infinite values become None.
#[pyfunction]
pub(crate) fn read_urdf<'py>(py: Python<'py>, content: &[u8], file: &str) -> PyResult<Bound<'py, PyAny>> {
    let description = py.detach(|| Description::read(content, file)).map_err(|e| from_urdf(&e))?;
    let text = serde_json::to_string(&description).map_err(|e| problem_error("content", e))?;
    py.import("json")?.call_method1("loads", (text,))
}

/// Parses an OBJ file: vertices (N, 3), name and triangles (M, 3) of each material, names of the material files.
#[pyfunction]
pub(crate) fn read_obj<'py>(
    py: Python<'py>,
    content: &[u8],
) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyList>, Vec<String>)> {
    let obj = py.detach(|| Obj::read(content)).map_err(PyValueError::new_err)?;
    let rows = obj.vertices.len();
    let vertices = obj.vertices.into_iter().flatten().collect();
    let vertices = ndarray::Array2::from_shape_vec((rows, 3), vertices).map_err(|e| problem_error("vertices", e))?;
    let groups = PyList::empty(py);
    for (material, faces) in obj.groups {
        let (rows, flat) = (faces.len(), faces.into_iter().flatten().map(i64::from).collect());
        let faces = ndarray::Array2::<i64>::from_shape_vec((rows, 3), flat).map_err(|e| problem_error("faces", e))?;
        groups.append((material, PyArray2::from_owned_array(py, faces)))?;
    }
    Ok((PyArray2::from_owned_array(py, vertices).into_any(), groups, obj.libraries))
}

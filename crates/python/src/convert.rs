//! Conversion between Python and Rust values, with errors that name the argument.

use gensim2_geometry::{Pose, Robot, VoxelGrid, pose_from_matrix, pose_to_matrix};
use nalgebra::{Matrix4, Point3, Vector3};
use numpy::{Element, PyArray, PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods, ndarray};
use pyo3::IntoPyObjectExt;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyBytes, PyDict, PyFloat, PyInt, PyList, PyMapping, PySequence, PyString};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Number, Value};

use crate::KpamError;
use crate::errors::{from_shape, problem_error};

/// Tolerance for rigid transforms: simulators write poses in single precision.
const RIGID: f64 = 1e-3;

/// Returns the member with value `value` of an enumeration in `gensim2_kpam.results`.
pub(crate) fn member<'py>(py: Python<'py>, class: &str, value: &str) -> PyResult<Bound<'py, PyAny>> {
    py.import("gensim2_kpam.results")?.getattr(class)?.call1((value,))
}

/// Returns the numbers of an array-like as a flat list, with their shape. Returns an error for complex numbers, dates,
/// text, structured arrays and masked entries, because NumPy would silently convert some of them.
pub(crate) fn numbers(value: &Bound<'_, PyAny>, field: &str) -> PyResult<(Vec<f64>, Vec<usize>)> {
    let array = match value.cast_exact::<PyArrayDyn<f64>>() {
        Ok(array) if is_aligned(array) => array.clone(),
        _ => converted(value)
            .map_err(|_| problem_error(field, "must be an array of numbers (numpy array, list or tuple)"))?,
    };
    let array = array.try_readonly().map_err(|e| problem_error(field, format!("cannot be read: {e}")))?;
    let (view, mut data) = (array.as_array(), Vec::new());
    if data.try_reserve_exact(view.len()).is_err() {
        return Err(problem_error(field, format!("has {} numbers, too many for the available memory", view.len())));
    }
    data.extend(view.iter());
    Ok((data, view.shape().to_vec()))
}

/// Returns whether the numbers of an array are aligned in memory for direct access.
pub(crate) fn is_aligned<D: ndarray::Dimension>(array: &Bound<'_, PyArray<f64, D>>) -> bool {
    array.data().is_aligned() && array.strides().iter().all(|step| step % 8 == 0)
}

/// Converts an array of another type or layout, or a sequence, to a new array of numbers.
fn converted<'py>(value: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let no_number = || PyTypeError::new_err("no numbers");
    let numpy = value.py().import("numpy")?;
    if numpy.getattr("ma")?.call_method1("is_masked", (value,))?.extract()? {
        return Err(no_number());
    }
    let array = numpy.call_method1("asarray", (value,))?;
    match array.getattr("dtype")?.getattr("kind")?.extract::<String>()?.as_str() {
        "b" | "i" | "u" | "f" => {}
        "O" => {
            for entry in array.call_method0("ravel")?.try_iter()? {
                let entry = entry?;
                if entry.is_none() || entry.is_instance_of::<PyString>() || entry.is_instance_of::<PyBytes>() {
                    return Err(no_number());
                }
            }
        }
        _ => return Err(no_number()),
    }
    Ok(array.call_method1("astype", ("float64",))?.cast_into()?)
}

/// Reads joint limits (n,): a list of any length, whose numbers may be infinite.
pub(crate) fn list(value: &Bound<'_, PyAny>, field: &str) -> PyResult<Vec<f64>> {
    let (data, shape) = numbers(value, field)?;
    if shape.len() == 1 { Ok(data) } else { Err(problem_error(field, format!("must have shape (n,), not {shape:?}"))) }
}

pub(crate) fn vector(value: &Bound<'_, PyAny>, field: &str, length: Option<usize>) -> PyResult<Vec<f64>> {
    let (data, shape) = numbers(value, field)?;
    let fits = shape.len() == 1 && length.is_none_or(|n| n == shape[0]);
    if !fits {
        let wanted = length.map_or("(n,)".to_owned(), |n| format!("({n},)"));
        return Err(problem_error(field, format!("must have shape {wanted}, not {shape:?}")));
    }
    if let Some(i) = data.iter().position(|v| !v.is_finite()) {
        return Err(problem_error(&format!("{field}[{i}]"), format!("{} is not finite", data[i])));
    }
    Ok(data)
}

pub(crate) fn vector3(value: &Bound<'_, PyAny>, field: &str) -> PyResult<Vector3<f64>> {
    vector(value, field, Some(3)).map(|v| Vector3::new(v[0], v[1], v[2]))
}

pub(crate) fn points(value: &Bound<'_, PyAny>, field: &str) -> PyResult<Vec<Point3<f64>>> {
    let (data, shape) = numbers(value, field)?;
    if shape.len() != 2 || shape[1] != 3 {
        return Err(problem_error(field, format!("must have shape (N, 3), not {shape:?}")));
    }
    Ok(data.chunks_exact(3).map(|c| Point3::new(c[0], c[1], c[2])).collect())
}

/// Reads an array (nx, ny, nz) with the type `T`, whose entries `read` converts, and the grid of its voxels.
pub(crate) fn grid<T: Element, U>(
    value: &Bound<'_, PyAny>,
    field: &str,
    voxel_size: f64,
    origin: Option<&Bound<'_, PyAny>>,
    read: impl Fn(&T) -> U,
) -> PyResult<(Vec<U>, VoxelGrid)> {
    let origin = origin.map_or(Ok(Vector3::zeros()), |o| vector3(o, "origin"))?;
    let numpy = value.py().import("numpy")?;
    if numpy.getattr("ma")?.call_method1("is_masked", (value,))?.extract()? {
        return Err(problem_error(field, "has masked entries; fill them"));
    }
    let array = numpy.call_method1("require", (value, value.py().None(), ["C", "A"]))?;
    let array = array
        .cast::<PyArrayDyn<T>>()
        .map_err(|_| problem_error(field, "must be a NumPy array of float32 or float64; convert it with astype"))?;
    let array = array.try_readonly().map_err(|e| problem_error(field, format!("cannot be read: {e}")))?;
    let view = array.as_array();
    let &[nx, ny, nz] = view.shape() else {
        return Err(problem_error(field, format!("must have shape (nx, ny, nz), not {:?}", view.shape())));
    };
    let grid = VoxelGrid::new([nx, ny, nz], voxel_size, Point3::from(origin)).map_err(|e| from_shape(&e))?;
    Ok((view.iter().map(read).collect(), grid))
}

pub(crate) fn pose(value: &Bound<'_, PyAny>, field: &str) -> PyResult<Pose> {
    let (data, shape) = numbers(value, field)?;
    if shape != [4, 4] {
        return Err(problem_error(field, format!("must be a (4, 4) pose, not of shape {shape:?}")));
    }
    rigid(&data, field)
}

/// Reads poses (K, 4, 4).
pub(crate) fn poses(value: &Bound<'_, PyAny>, field: &str) -> PyResult<Vec<Pose>> {
    let (data, shape) = numbers(value, field)?;
    if shape.len() != 3 || shape[1..] != [4, 4] {
        return Err(problem_error(field, format!("must be (K, 4, 4) poses, not of shape {shape:?}")));
    }
    data.chunks_exact(16).enumerate().map(|(k, rows)| rigid(rows, &format!("{field}[{k}]"))).collect()
}

fn rigid(rows: &[f64], field: &str) -> PyResult<Pose> {
    pose_from_matrix(&Matrix4::from_row_slice(rows), RIGID)
        .ok_or_else(|| problem_error(field, "is not a finite rigid transform (rotation orthonormal, last row 0 0 0 1)"))
}

pub(crate) fn optional_pose(value: Option<&Bound<'_, PyAny>>, field: &str) -> PyResult<Pose> {
    value.map_or(Ok(Pose::identity()), |v| pose(v, field))
}

pub(crate) fn pose_array<'py>(py: Python<'py>, p: &Pose) -> Bound<'py, PyArray2<f64>> {
    let m = pose_to_matrix(p);
    PyArray2::from_owned_array(py, ndarray::Array2::from_shape_fn((4, 4), |(r, c)| m[(r, c)]))
}

pub(crate) fn array1<'py>(py: Python<'py>, values: &[f64]) -> Bound<'py, PyArray1<f64>> {
    PyArray1::from_slice(py, values)
}

pub(crate) fn array2<'py>(py: Python<'py>, rows: &[Vec<f64>], columns: usize) -> Bound<'py, PyArray2<f64>> {
    PyArray2::from_owned_array(py, ndarray::Array2::from_shape_fn((rows.len(), columns), |(r, c)| rows[r][c]))
}

/// Converts a config or options mapping to JSON; `field` is the path of the value, for error messages; `error` creates
/// the exception from a field and a message.
pub(crate) fn json(
    value: &Bound<'_, PyAny>,
    field: &str,
    depth: usize,
    error: fn(&str, String) -> PyErr,
) -> PyResult<Value> {
    let fail = |message: String| {
        let at = if field.is_empty() { "config" } else { field };
        Err(error(at, message))
    };
    if depth > 20 {
        return fail("is nested too deeply".to_owned());
    }
    if value.is_none() {
        return Ok(Value::Null);
    }
    if value.is_instance_of::<PyBool>() {
        return Ok(Value::Bool(value.extract()?));
    }
    if value.is_instance_of::<PyString>() {
        return value.extract().map(Value::String).or_else(|_| fail("is no valid Unicode text".to_owned()));
    }
    if value.is_instance_of::<PyInt>()
        && let Ok(i) = value.extract::<i64>()
    {
        return Ok(Value::Number(i.into()));
    }
    // Recognize NumPy scalars by their dtype, because NumPy integers are not instances of Python's int.
    if value.hasattr("dtype")? && value.getattr("shape")?.len()? == 0 {
        return json(&value.call_method0("item")?, field, depth + 1, error);
    }
    if let Ok(mapping) = value.cast::<PyMapping>() {
        let mut out = Map::new();
        for item in mapping.items()?.iter() {
            let (key, entry): (Bound<'_, PyAny>, Bound<'_, PyAny>) = item.extract()?;
            let Ok(key) = key.extract::<String>() else { return fail(format!("key {key} must be text")) };
            let path = if field.is_empty() { key.clone() } else { format!("{field}.{key}") };
            out.insert(key, json(&entry, &path, depth + 1, error)?);
        }
        return Ok(Value::Object(out));
    }
    if value.is_instance_of::<PyFloat>() || value.hasattr("__float__")? && !value.hasattr("__len__")? {
        let Ok(v) = value.extract::<f64>() else { return fail("does not fit into 64 bits".to_owned()) };
        return match Number::from_f64(v) {
            Some(n) => Ok(Value::Number(n)),
            None => fail(format!("{v} is not finite")),
        };
    }
    let listed = if value.hasattr("tolist")? { value.call_method0("tolist")? } else { value.clone() };
    if let Ok(sequence) = listed.cast::<PySequence>() {
        let mut out = Vec::new();
        for i in 0..sequence.len()? {
            out.push(json(&sequence.get_item(i)?, &format!("{field}[{i}]"), depth + 1, error)?);
        }
        return Ok(Value::Array(out));
    }
    fail(format!("{} is not a mapping, list, text or number", value.get_type().name()?))
}

/// Returns a list with a dict for each item, to which `fill` adds the entries.
pub(crate) fn dicts<'py, T>(
    py: Python<'py>,
    items: impl IntoIterator<Item = T>,
    fill: impl Fn(&Bound<'py, PyDict>, T) -> PyResult<()>,
) -> PyResult<Bound<'py, PyList>> {
    let out = PyList::empty(py);
    for item in items {
        let dict = PyDict::new(py);
        fill(&dict, item)?;
        out.append(dict)?;
    }
    Ok(out)
}

/// Converts JSON to dicts, lists, strings and numbers of Python.
pub(crate) fn python<'py>(py: Python<'py>, value: &Value) -> PyResult<Bound<'py, PyAny>> {
    match value {
        Value::Null => Ok(py.None().into_bound(py)),
        Value::Bool(b) => b.into_bound_py_any(py),
        Value::Number(n) => match n.as_i64() {
            Some(i) => i.into_bound_py_any(py),
            None => n.as_f64().into_bound_py_any(py),
        },
        Value::String(s) => s.into_bound_py_any(py),
        Value::Array(entries) => {
            let list = PyList::empty(py);
            for e in entries {
                list.append(python(py, e)?)?;
            }
            Ok(list.into_any())
        }
        Value::Object(map) => {
            let dict = PyDict::new(py);
            for (k, v) in map {
                dict.set_item(k, python(py, v)?)?;
            }
            Ok(dict.into_any())
        }
    }
}

/// Header of pickled data with the version of their layout. Increment it whenever a pickled type changes.
const TAG: &[u8; 4] = b"kpam";
const LAYOUT: u8 = 4;

/// Serializes a value for pickling.
pub(crate) fn freeze<T: Serialize>(value: &T) -> PyResult<Vec<u8>> {
    let mut out = TAG.to_vec();
    out.push(LAYOUT);
    postcard::to_extend(value, out).map_err(|e| KpamError::new_err(format!("pickle: {e}")))
}

/// Restores a value from the bytes of [`freeze`].
pub(crate) fn thaw<T: DeserializeOwned>(bytes: &[u8]) -> PyResult<T> {
    let fail = |message: String| Err(KpamError::new_err(format!("pickle: {message}")));
    let Some((layout, value)) = bytes.strip_prefix(TAG.as_slice()).and_then(<[u8]>::split_first) else {
        return fail("has no version; it was written before 0.2 or is damaged; create it again".to_owned());
    };
    if *layout != LAYOUT {
        let version = env!("CARGO_PKG_VERSION");
        return fail(format!("is of layout {layout}; gensim2_kpam {version} reads layout {LAYOUT}; create it again"));
    }
    match postcard::from_bytes(value) {
        Ok(value) => Ok(value),
        Err(e) => fail(format!("is damaged ({e})")),
    }
}

/// Joint vectors from an (n,) or (N, n) array.
pub(crate) struct JointRows {
    data: Vec<f64>,
    n: usize,
    /// Number of rows; `None` for a single vector.
    pub count: Option<usize>,
}

impl JointRows {
    pub fn of(value: &Bound<'_, PyAny>, n: usize) -> PyResult<Self> {
        let (data, shape) = numbers(value, "q")?;
        let count = match shape.as_slice() {
            [m] if *m == n => None,
            [count, m] if *m == n => Some(*count),
            _ => return Err(problem_error("q", format!("must have shape ({n},) or (N, {n}), not {shape:?}"))),
        };
        if data.iter().any(|v| !v.is_finite()) {
            return Err(problem_error("q", "has an entry that is not finite"));
        }
        Ok(Self { data, n, count })
    }

    /// Reads one joint vector of a robot; mimic joints get the values that follow from their sources.
    pub fn one(value: &Bound<'_, PyAny>, robot: &Robot) -> PyResult<Vec<f64>> {
        let mut q = vector(value, "q", Some(robot.joints().len()))?;
        robot.apply_mimic(&mut q);
        Ok(q)
    }

    /// Reads joint vectors of a robot; mimic joints get the values that follow from their sources.
    pub fn of_robot(value: &Bound<'_, PyAny>, robot: &Robot) -> PyResult<Self> {
        let mut out = Self::of(value, robot.joints().len())?;
        if out.n > 0 {
            out.data.chunks_mut(out.n).for_each(|q| robot.apply_mimic(q));
        }
        Ok(out)
    }

    /// The joint vectors; no rows if the robot has no joints.
    pub fn rows(&self) -> impl ExactSizeIterator<Item = &[f64]> {
        (0..self.count.unwrap_or(1)).map(|r| &self.data[r * self.n..(r + 1) * self.n])
    }
}

//! Names of the previous release. This release still accepts them, with a `FutureWarning` that gives the current name.

use std::ffi::CString;

use pyo3::exceptions::{PyFutureWarning, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::Value;

use crate::errors::problem_error;

/// Former and current names of options. Files of users may still contain the former names.
const OPTIONS: [(&str, &str); 3] =
    [("starts", "num_seeds"), ("descents", "num_refinements"), ("harvest", "extra_seeds")];

/// Replaces former option names by current ones.
pub(crate) fn options(py: Python<'_>, options: &mut Value) -> PyResult<()> {
    let Some(options) = options.as_object_mut() else { return Ok(()) };
    for (former, today) in OPTIONS {
        let Some(value) = options.remove(former) else { continue };
        if options.insert(today.to_owned(), value).is_some() {
            return Err(problem_error(
                &format!("options.{former}"),
                format!("is the old name of {today}, which is given too"),
            ));
        }
        warn(py, &format!("options.{former}"), &format!("options.{today}"))?;
    }
    Ok(())
}

/// Returns the keyword argument `today`, which may also be given under its former name; any other keyword is an error.
pub(crate) fn keyword<'py, T>(
    py: Python<'py>,
    given: Option<T>,
    others: Option<&Bound<'py, PyDict>>,
    (former, today): (&str, &str),
) -> PyResult<Option<T>>
where
    T: FromPyObjectOwned<'py>,
{
    let mut value = given;
    for (key, other) in others.into_iter().flatten() {
        let key: String = key.extract()?;
        if key != former {
            return Err(PyTypeError::new_err(format!("got an unexpected keyword argument '{key}'")));
        }
        if value.is_some() {
            return Err(PyTypeError::new_err(format!("'{former}' is the old name of '{today}', which is given too")));
        }
        warn(py, former, today)?;
        value = if other.is_none() { None } else { Some(other.extract::<T>().map_err(Into::into)?) };
    }
    Ok(value)
}

fn warn(py: Python<'_>, former: &str, today: &str) -> PyResult<()> {
    let message = format!("{former} is now called {today}; the next release removes the old name");
    PyErr::warn(py, &py.get_type::<PyFutureWarning>(), &CString::new(message)?, 1)
}

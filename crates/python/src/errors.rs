//! Exceptions that name the file or field and the remedy, both in their message and as attributes.

use gensim2_geometry::{ShapeError, UrdfError as GeometryUrdfError};
use gensim2_kpam::{ConfigError as KpamConfigError, ProblemError as KpamProblemError};
use pyo3::exceptions::PyException;
use pyo3::prelude::*;
use pyo3::{PyTypeInfo, create_exception};

create_exception!(
    gensim2_kpam,
    KpamError,
    PyException,
    "Base class. Its subclasses name the file or field and the remedy."
);
create_exception!(gensim2_kpam, UrdfError, KpamError, "A robot description that cannot be used: file, field, remedy.");
create_exception!(gensim2_kpam, ConfigError, KpamError, "A solver config that cannot be used: field, remedy.");
create_exception!(gensim2_kpam, ProblemError, KpamError, "A problem whose parts do not fit each other: field, remedy.");

/// Adds the exception classes to the module. Attributes that do not apply to an exception are None.
pub(crate) fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = m.py();
    let base = py.get_type::<KpamError>();
    base.setattr("file", py.None())?;
    base.setattr("field", py.None())?;
    base.setattr("message", py.None())?;
    m.add("KpamError", base)?;
    m.add("UrdfError", py.get_type::<UrdfError>())?;
    m.add("ConfigError", py.get_type::<ConfigError>())?;
    m.add("ProblemError", py.get_type::<ProblemError>())
}

/// Maximum number of characters of an error message; the middle of a longer message is omitted.
const LONGEST_LINE: usize = 1500;

/// Returns a message as one line of at most `LONGEST_LINE` characters. Non-printing characters are escaped, because the
/// message may contain names from files or from the caller.
fn one_line(text: &str) -> String {
    let printed = |c: char| c.escape_debug().len() == 1 || matches!(c, '"' | '\'' | '\\');
    let shown: String =
        text.chars().map(|c| if printed(c) { c.to_string() } else { c.escape_debug().to_string() }).collect();
    let length = shown.chars().count();
    if length <= LONGEST_LINE {
        return shown;
    }
    let (begin, end): (String, String) =
        (shown.chars().take(LONGEST_LINE / 2).collect(), shown.chars().skip(length - LONGEST_LINE / 4).collect());
    format!("{begin} ... {end} ({length} characters)")
}

fn located<T: PyTypeInfo>(file: Option<&str>, field: &str, message: &str) -> PyErr {
    Python::attach(|py| {
        let text = one_line(&match file {
            Some(file) => format!("{file}: {field}: {message}"),
            None => format!("{field}: {message}"),
        });
        let error = PyErr::new::<T, _>(text);
        let value = error.value(py);
        let named = value.setattr("file", file).and_then(|()| value.setattr("field", field));
        match named.and_then(|()| value.setattr("message", one_line(message))) {
            Ok(()) => error,
            Err(other) => other,
        }
    })
}

pub(crate) fn problem_error(field: &str, message: impl std::fmt::Display) -> PyErr {
    located::<ProblemError>(None, field, &message.to_string())
}

pub(crate) fn config_error(field: &str, message: impl std::fmt::Display) -> PyErr {
    located::<ConfigError>(None, field, &message.to_string())
}

pub(crate) fn from_urdf(e: &GeometryUrdfError) -> PyErr {
    located::<UrdfError>(Some(&e.file), &e.field, &e.message)
}

pub(crate) fn from_shape(e: &ShapeError) -> PyErr {
    problem_error(&e.field, &e.message)
}

pub(crate) fn from_config(e: &KpamConfigError) -> PyErr {
    config_error(&e.field, &e.message)
}

pub(crate) fn from_problem(e: &KpamProblemError) -> PyErr {
    problem_error(&e.field, &e.message)
}

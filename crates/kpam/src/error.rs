//! Errors that name a field and say how to correct it.

use gensim2_geometry::field_error;

field_error!(
    /// A solver config is invalid.
    ConfigError
);
field_error!(
    /// A problem is invalid, or its parts do not fit each other.
    ProblemError
);

/// Returns an error if a list of numbers is not finite.
pub(crate) fn finite(field: &str, list: &[f64]) -> Result<(), ProblemError> {
    match list.iter().position(|v| !v.is_finite()) {
        Some(i) => Err(ProblemError::new(format!("{field}[{i}]"), format!("{} is not finite", list[i]))),
        None => Ok(()),
    }
}

/// Returns an error if a list does not have one finite entry for each of the robot's joints.
pub(crate) fn for_each_joint(field: &str, list: &[f64], joints: usize) -> Result<(), ProblemError> {
    if list.len() != joints {
        return Err(ProblemError::new(field, format!("has {} entries; the robot has {joints} joints", list.len())));
    }
    finite(field, list)
}

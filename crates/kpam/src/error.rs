//! Errors that name a field and say how to correct it.

use std::fmt;

macro_rules! field_error {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq, Eq)]
        #[non_exhaustive]
        pub struct $name {
            /// Path of the invalid field, for example `constraint_list[2].tolerance`.
            pub field: String,
            /// What is wrong, and how to correct it.
            pub message: String,
        }

        impl $name {
            /// Creates an error about the field `field`.
            pub fn new(field: impl Into<String>, message: impl Into<String>) -> Self {
                Self { field: field.into(), message: message.into() }
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "{}: {}", self.field, self.message)
            }
        }

        impl std::error::Error for $name {}
    };
}

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

//! Errors that name the file or value, the field in it, and the remedy.

use std::fmt;

/// Error for a robot description that cannot be used.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct UrdfError {
    /// Path of the file as the caller gave it.
    pub file: String,
    /// Element or attribute at fault, e.g. `joint panda_joint1: limit`.
    pub field: String,
    /// Description of the fault and its remedy.
    pub message: String,
}

impl UrdfError {
    pub(crate) fn new(file: &str, field: impl Into<String>, message: impl Into<String>) -> Self {
        Self { file: file.to_owned(), field: field.into(), message: message.into() }
    }
}

impl fmt::Display for UrdfError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}: {}", self.file, self.field, self.message)
    }
}

impl std::error::Error for UrdfError {}

/// Defines an error about one field.
#[doc(hidden)]
#[macro_export]
macro_rules! field_error {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq, Eq)]
        #[non_exhaustive]
        pub struct $name {
            /// Path of the invalid field or part, for example `constraint_list[2].tolerance` or `joint elbow: limit`.
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

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                write!(f, "{}: {}", self.field, self.message)
            }
        }

        impl std::error::Error for $name {}
    };
}

field_error!(
    /// Parts of a robot do not fit each other.
    RobotError
);
field_error!(
    /// A shape has no extent or no points, or a number is not finite.
    ShapeError
);

/// Error for a joint vector of the wrong length.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct JointCountError {
    /// Number of joints of the robot.
    pub joints: usize,
    /// Length of the joint vector.
    pub entries: usize,
}

impl JointCountError {
    pub(crate) fn check(joints: usize, q: &[f64]) -> Result<(), Self> {
        if q.len() == joints { Ok(()) } else { Err(Self { joints, entries: q.len() }) }
    }
}

impl fmt::Display for JointCountError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the joint vector has {} entries; the robot has {} joints", self.entries, self.joints)
    }
}

impl std::error::Error for JointCountError {}

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

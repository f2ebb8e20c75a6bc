//! Errors that name the field and the remedy.

use std::fmt;

macro_rules! field_error {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq, Eq)]
        #[non_exhaustive]
        pub struct $name {
            /// Path of the field, e.g. `constraint_list[2].tolerance`.
            pub field: String,
            /// Fault and remedy.
            pub message: String,
        }

        impl $name {
            /// Creates an error about `field`.
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
    /// A solver config cannot be used.
    ConfigError
);
field_error!(
    /// Parts of a problem do not fit each other.
    ProblemError
);

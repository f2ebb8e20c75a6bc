//! Validation of deserialized values by the same checks as for values created in code.

/// Implements serde's traits for a type whose derives carry `#[serde(remote = "Self")]`: it is serialized unchanged,
/// and deserialized only if its `check` passes.
#[doc(hidden)]
#[macro_export]
macro_rules! checked_when_read {
    ($($name:ty),+) => {$(
        impl serde::Serialize for $name {
            fn serialize<S: serde::Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
                <$name>::serialize(self, serializer)
            }
        }

        impl<'de> serde::Deserialize<'de> for $name {
            fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
                let value = <$name>::deserialize(deserializer)?;
                value.check().map_err(serde::de::Error::custom)?;
                Ok(value)
            }
        }
    )+};
}

/// Serializes numbers; infinite numbers become null because JSON has no infinity.
macro_rules! open_ended {
    ($name:ident, $end:expr) => {
        pub(crate) mod $name {
            use serde::{Deserialize, Deserializer, Serialize, Serializer};

            pub fn serialize<S: Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
                (*value != $end).then_some(*value).serialize(serializer)
            }

            pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
                Ok(Option::deserialize(deserializer)?.unwrap_or($end))
            }
        }
    };
}

open_ended!(open_above, f64::INFINITY);
open_ended!(open_below, f64::NEG_INFINITY);

//! Applies the same checks to deserialized values as to values created in code.

/// Implements serde's traits for a type whose derives have `#[serde(remote = "Self")]`. A value is serialized as usual,
/// but deserialized only if its method `check` succeeds.
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

pub(crate) use checked_when_read;

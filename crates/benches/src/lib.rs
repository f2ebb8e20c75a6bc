//! This library is empty. The benchmarks are in the folder `benches/` of this crate.

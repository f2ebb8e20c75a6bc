//! Version of the library and of its binary interface.

use std::ffi::{CStr, c_char};

/// Version of the binary interface that this header describes. It increases if a program must be compiled again.
pub const KPAM_ABI_VERSION: u32 = 2;

/// Returns the version of the binary interface of the loaded library. A program that was compiled with another
/// `KPAM_ABI_VERSION` must not call any other function.
#[unsafe(no_mangle)]
pub extern "C" fn kpam_abi_version() -> u32 {
    KPAM_ABI_VERSION
}

/// Version of the library, with its zero.
const VERSION: &CStr = match CStr::from_bytes_with_nul(concat!(env!("CARGO_PKG_VERSION"), "\0").as_bytes()) {
    Ok(version) => version,
    Err(_) => c"",
};

/// Returns the version of the loaded library, such as "0.3.0".
#[unsafe(no_mangle)]
pub extern "C" fn kpam_version() -> *const c_char {
    VERSION.as_ptr()
}

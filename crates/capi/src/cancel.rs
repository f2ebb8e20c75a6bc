//! Flags that end a search from another thread.

use gensim2_kpam::Cancel;

use crate::guard::{freed, giving, kpam_status};

/// A flag that ends a search from another thread. It cannot be cleared: create a new flag for the next search, or share
/// one among all searches that end together.
pub struct kpam_cancel(pub(crate) Cancel);

/// Creates a flag that is not set.
///
/// # Safety
/// `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_cancel_create(out: *mut *mut kpam_cancel) -> kpam_status {
    // SAFETY: guaranteed by the caller.
    unsafe { giving(out, || Ok(kpam_cancel(Cancel::new()))) }
}

/// Sets the flag. A search that uses it ends soon with `KPAM_CANCELLED`. Any thread may call this function at any time,
/// also a signal handler. Null is ignored.
///
/// # Safety
/// `cancel` is null or a flag that was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_cancel_set(cancel: *const kpam_cancel) {
    // SAFETY: guaranteed by the caller.
    if let Some(flag) = unsafe { cancel.as_ref() } {
        flag.0.cancel();
    }
}

/// Returns whether the flag is set; false if `cancel` is null.
///
/// # Safety
/// `cancel` is null or a flag that was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_cancel_is_set(cancel: *const kpam_cancel) -> bool {
    // SAFETY: guaranteed by the caller.
    unsafe { cancel.as_ref() }.is_some_and(|flag| flag.0.is_cancelled())
}

/// Frees a flag; null is ignored. Free it after the searches that use it have returned, and after the last
/// `kpam_cancel_set`.
///
/// # Safety
/// `cancel` is null or a flag that was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_cancel_free(cancel: *mut kpam_cancel) {
    // SAFETY: guaranteed by the caller.
    unsafe { freed(cancel) }
}

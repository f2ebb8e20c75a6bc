//! Layer between C and the solver. It validates pointers, stops panics, and turns errors into a status and a message.

use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Status that a function returns.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum kpam_status {
    /// Success.
    KPAM_OK = 0,
    /// No motion was found, or none exists; the message gives the reason.
    KPAM_NO_MOTION = 1,
    /// An argument is invalid; the message names it.
    KPAM_INVALID = 2,
    /// A file cannot be used; the message names the file and the field in it.
    KPAM_FILE = 3,
    /// The solver failed because of a bug, which should be reported; nothing was written.
    KPAM_PANIC = 4,
}

thread_local! {
    static LAST: RefCell<CString> = RefCell::new(CString::default());
}

/// Returns the message of the last call on this thread that did not return `KPAM_OK`; empty if every call returned it.
/// The text is valid until the next failing call on this thread.
#[unsafe(no_mangle)]
pub extern "C" fn kpam_last_error() -> *const c_char {
    LAST.with(|last| last.borrow().as_ptr())
}

/// Status and message of a failed call, which the C caller receives.
pub(crate) struct Fault(pub kpam_status, pub String);

impl Fault {
    pub fn invalid(message: impl ToString) -> Self {
        Self(kpam_status::KPAM_INVALID, message.to_string())
    }
}

/// Runs the body of an interface function, and turns errors and panics into a status and a message.
pub(crate) fn guarded(work: impl FnOnce() -> Result<(), Fault>) -> kpam_status {
    let Fault(status, sentence) = match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(())) => return kpam_status::KPAM_OK,
        Ok(Err(fault)) => fault,
        Err(cause) => {
            let said = cause.downcast_ref::<&str>().map(|s| (*s).to_owned());
            let said = said.or_else(|| cause.downcast_ref::<String>().cloned()).unwrap_or_default();
            Fault(kpam_status::KPAM_PANIC, format!("the solver failed: {said}"))
        }
    };
    // The message may contain a file name with a zero byte, which would end the C string.
    let sentence = CString::new(sentence.replace('\0', " ")).unwrap_or_default();
    LAST.with(|last| *last.borrow_mut() = sentence);
    status
}

/// Returns the text of an argument.
///
/// # Safety
/// `text` is null or a zero-terminated string.
pub(crate) unsafe fn text<'a>(text: *const c_char, name: &str) -> Result<&'a str, Fault> {
    if text.is_null() {
        return Err(Fault::invalid(format!("{name} is null")));
    }
    // SAFETY: guaranteed by the caller.
    unsafe { CStr::from_ptr(text) }.to_str().map_err(|_| Fault::invalid(format!("{name} is not UTF-8")))
}

/// Returns the numbers of an argument.
///
/// # Safety
/// `data` is null or points to `length` numbers.
pub(crate) unsafe fn numbers<'a>(data: *const f64, length: usize, name: &str) -> Result<&'a [f64], Fault> {
    if data.is_null() {
        return Err(Fault::invalid(format!("{name} is null")));
    }
    // SAFETY: guaranteed by the caller.
    Ok(unsafe { std::slice::from_raw_parts(data, length) })
}

/// Returns the value behind a handle.
///
/// # Safety
/// `handle` is null, or a handle created by this library and not freed.
pub(crate) unsafe fn held<'a, T>(handle: *const T, name: &str) -> Result<&'a T, Fault> {
    // SAFETY: guaranteed by the caller.
    unsafe { handle.as_ref() }.ok_or_else(|| Fault::invalid(format!("{name} is null")))
}

/// Runs the body of an interface function and stores the result through a pointer, or null if the body fails.
///
/// # Safety
/// `out` is null or can be written.
pub(crate) unsafe fn giving<T>(out: *mut *mut T, make: impl FnOnce() -> Result<T, Fault>) -> kpam_status {
    if out.is_null() {
        return guarded(|| Err(Fault::invalid("out is null")));
    }
    // SAFETY: guaranteed by the caller.
    unsafe { *out = std::ptr::null_mut() };
    guarded(|| {
        let value = Box::into_raw(Box::new(make()?));
        // SAFETY: guaranteed by the caller.
        unsafe { *out = value };
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn last() -> String {
        // SAFETY: the function always returns a string.
        unsafe { CStr::from_ptr(kpam_last_error()) }.to_string_lossy().into_owned()
    }

    #[test]
    #[allow(clippy::panic, reason = "what is tested")]
    fn panics_end_here() {
        assert_eq!(guarded(|| panic!("oh {}", 7)), kpam_status::KPAM_PANIC);
        assert!(last().contains("oh 7"));
        assert_eq!(guarded(|| Err(Fault::invalid("a\0b"))), kpam_status::KPAM_INVALID);
        assert_eq!(last(), "a b");
        assert_eq!(guarded(|| Ok(())), kpam_status::KPAM_OK);
    }
}

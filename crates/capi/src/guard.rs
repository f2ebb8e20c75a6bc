//! Layer between C and the solver. It validates pointers, stops panics, and turns errors into a status and a message.

use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

use gensim2_geometry::{Pose, pose_from_matrix, pose_to_matrix};
use gensim2_kpam::NoMotion;
use nalgebra::Matrix4;

/// Status that a function returns.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum kpam_status {
    /// Success.
    KPAM_OK = 0,
    /// The search used up its samples or checks, or the tolerance of a hand path is too small. A motion may exist.
    KPAM_NOT_FOUND = 1,
    /// An argument is invalid; the message names it.
    KPAM_INVALID = 2,
    /// A file cannot be used; the message names the file and the field in it.
    KPAM_FILE = 3,
    /// The solver failed because of a bug, which should be reported; nothing was written.
    KPAM_PANIC = 4,
    /// Bodies overlap at the start; the message names them.
    KPAM_START_BLOCKED = 5,
    /// Bodies overlap at every goal; the message names those of the first goal.
    KPAM_GOALS_BLOCKED = 6,
    /// No joint values within the limits bring the link to a goal pose, or the hand cannot follow a line.
    KPAM_UNREACHABLE = 7,
    /// A free path was found, but no motion along it within the limits of velocity, acceleration, jerk and torque.
    KPAM_UNTIMED = 8,
    /// No motion from the start state stays within a joint's limits; the message names the joint.
    KPAM_CANNOT_STOP = 9,
    /// The deadline passed before a motion was found.
    KPAM_LATE = 10,
    /// The caller cancelled planning.
    KPAM_CANCELLED = 11,
    /// Bodies are too close to the robot on a line of a hand path; the message names them and the pose.
    KPAM_PATH_BLOCKED = 12,
    /// A joint cannot hold the arm and its load at rest within the torque limits; the message names the joint.
    KPAM_OVERLOADED = 13,
}

thread_local! {
    static LAST: RefCell<CString> = RefCell::new(CString::default());
}

/// Returns the message of the last call on this thread that did not return `KPAM_OK`; empty if every call returned it.
/// The message is one line of UTF-8. It belongs to the library and is valid until the next failing call on this thread.
#[unsafe(no_mangle)]
pub extern "C" fn kpam_last_error() -> *const c_char {
    // The message is gone if the thread is ending.
    LAST.try_with(|last| last.borrow().as_ptr()).unwrap_or(c"".as_ptr())
}

/// Status and message of a failed call, which the C caller receives.
pub(crate) struct Fault(pub kpam_status, pub String);

impl Fault {
    pub fn invalid(message: impl ToString) -> Self {
        Self(kpam_status::KPAM_INVALID, message.to_string())
    }

    /// Returns the status and the message of a search without a result.
    pub fn no_motion(why: &NoMotion) -> Self {
        let status = match why {
            NoMotion::StartBlocked(_) => kpam_status::KPAM_START_BLOCKED,
            NoMotion::GoalsBlocked(_) => kpam_status::KPAM_GOALS_BLOCKED,
            NoMotion::Unreachable | NoMotion::OffPath { .. } => kpam_status::KPAM_UNREACHABLE,
            NoMotion::Untimed => kpam_status::KPAM_UNTIMED,
            NoMotion::CannotStop(..) => kpam_status::KPAM_CANNOT_STOP,
            NoMotion::Late => kpam_status::KPAM_LATE,
            NoMotion::Cancelled => kpam_status::KPAM_CANCELLED,
            NoMotion::PathBlocked { .. } => kpam_status::KPAM_PATH_BLOCKED,
            NoMotion::Overloaded(..) => kpam_status::KPAM_OVERLOADED,
            _ => kpam_status::KPAM_NOT_FOUND,
        };
        Self(status, why.to_string())
    }
}

/// Returns a text without zero bytes, which would end the C string; file names and messages may contain them.
pub(crate) fn zero_terminated(text: &str) -> CString {
    CString::new(text.replace('\0', " ")).unwrap_or_default()
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
    let message = zero_terminated(&sentence.lines().collect::<Vec<_>>().join(" "));
    // A thread that is ending has no place for the message; the status tells enough.
    let _ = LAST.try_with(|last| *last.borrow_mut() = message);
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

/// Returns the text of an argument that may be null.
///
/// # Safety
/// `data` is null or a zero-terminated string.
pub(crate) unsafe fn optional_text<'a>(data: *const c_char, name: &str) -> Result<Option<&'a str>, Fault> {
    // SAFETY: guaranteed by the caller.
    if data.is_null() { Ok(None) } else { unsafe { text(data, name) }.map(Some) }
}

/// Checks an array of `rows` x `columns` values: the pointer is not null and is aligned, and the size is possible.
fn room<T>(data: *const T, rows: usize, columns: usize, name: &str) -> Result<usize, Fault> {
    if data.is_null() {
        return Err(Fault::invalid(format!("{name} is null")));
    }
    if !data.is_aligned() {
        return Err(Fault::invalid(format!("{name} is not aligned to {} bytes", align_of::<T>())));
    }
    let most = isize::MAX as usize / size_of::<T>().max(1);
    rows.checked_mul(columns).filter(|length| *length <= most).ok_or_else(|| {
        Fault::invalid(format!("{name}: {rows} x {columns} values are more than memory can hold; check the count"))
    })
}

/// Returns an array of an argument: `rows` x `columns` values.
///
/// # Safety
/// `data` is null or points to that many values, which no other thread writes.
pub(crate) unsafe fn array<'a, T>(data: *const T, rows: usize, columns: usize, name: &str) -> Result<&'a [T], Fault> {
    if rows == 0 {
        return Ok(&[]);
    }
    let length = room(data, rows, columns, name)?;
    // SAFETY: guaranteed by the caller; pointer and size were checked.
    Ok(unsafe { std::slice::from_raw_parts(data, length) })
}

/// Returns the array that an argument tells a function to fill. It may contain uninitialized values, so it may only be
/// written.
///
/// # Safety
/// `data` is null or has room for `rows` x `columns` values, which no other thread uses.
pub(crate) unsafe fn filled<'a, T: Copy + Default>(
    data: *mut T,
    rows: usize,
    columns: usize,
    name: &str,
) -> Result<&'a mut [T], Fault> {
    if rows == 0 {
        return Ok(&mut []);
    }
    let length = room(data, rows, columns, name)?;
    (0..length).for_each(|k| {
        // SAFETY: guaranteed by the caller; pointer and size were checked.
        unsafe { data.add(k).write(T::default()) };
    });
    // SAFETY: as above, and all values are initialized now.
    Ok(unsafe { std::slice::from_raw_parts_mut(data, length) })
}

/// Writes a result through a pointer.
///
/// # Safety
/// `out` is null or can be written.
pub(crate) unsafe fn put<T: Copy + Default>(out: *mut T, value: T, name: &str) -> Result<(), Fault> {
    // SAFETY: guaranteed by the caller.
    unsafe { filled(out, 1, 1, name) }?[0] = value;
    Ok(())
}

/// Returns the numbers of an argument.
///
/// # Safety
/// `data` is null or points to `length` numbers.
pub(crate) unsafe fn numbers<'a>(data: *const f64, length: usize, name: &str) -> Result<&'a [f64], Fault> {
    // SAFETY: guaranteed by the caller.
    unsafe { array(data, length, 1, name) }
}

/// Returns the numbers of an argument that may be null.
///
/// # Safety
/// `data` is null or points to `length` numbers.
pub(crate) unsafe fn optional_numbers(data: *const f64, length: usize, name: &str) -> Result<Option<Vec<f64>>, Fault> {
    // SAFETY: guaranteed by the caller.
    if data.is_null() { Ok(None) } else { unsafe { numbers(data, length, name) }.map(|list| Some(list.to_vec())) }
}

/// Greatest deviation of a pose matrix from a rigid transform, as in the Python binding.
const RIGID: f64 = 1e-6;

/// Returns poses of an argument: `count` matrices of 16 numbers.
///
/// # Safety
/// `data` is null or points to 16 numbers for each pose.
pub(crate) unsafe fn poses(data: *const f64, count: usize, name: &str) -> Result<Vec<Pose>, Fault> {
    // SAFETY: guaranteed by the caller.
    let rows = unsafe { array(data, count, 16, name) }?;
    let read = |(k, rows): (usize, &[f64])| {
        let place = if count == 1 { name.to_owned() } else { format!("{name}[{k}]") };
        pose_from_matrix(&Matrix4::from_row_slice(rows), RIGID).ok_or_else(|| {
            let message = "is not a finite rigid transform (row-major, rotation orthonormal, last row 0 0 0 1)";
            Fault::invalid(format!("{place}: {message}"))
        })
    };
    rows.chunks_exact(16).enumerate().map(read).collect()
}

/// Returns the pose of an argument.
///
/// # Safety
/// `data` is null or points to 16 numbers.
pub(crate) unsafe fn pose(data: *const f64, name: &str) -> Result<Pose, Fault> {
    // SAFETY: guaranteed by the caller.
    unsafe { poses(data, 1, name) }.map(|list| list[0])
}

/// Returns the pose of an argument; null is the identity.
///
/// # Safety
/// `data` is null or points to 16 numbers.
pub(crate) unsafe fn optional_pose(data: *const f64, name: &str) -> Result<Pose, Fault> {
    // SAFETY: guaranteed by the caller.
    if data.is_null() { Ok(Pose::identity()) } else { unsafe { pose(data, name) } }
}

/// Writes a pose as 16 numbers, row-major.
///
/// # Safety
/// `out` is null or has room for 16 numbers.
pub(crate) unsafe fn put_pose(out: *mut f64, value: &Pose, name: &str) -> Result<(), Fault> {
    // nalgebra stores columns, so the transposed matrix has the rows in order.
    let rows = pose_to_matrix(value).transpose();
    // SAFETY: guaranteed by the caller.
    unsafe { filled(out, 16, 1, name) }?.copy_from_slice(rows.as_slice());
    Ok(())
}

/// Returns the value behind a handle.
///
/// # Safety
/// `handle` is null, or a handle created by this library and not freed.
pub(crate) unsafe fn held<'a, T>(handle: *const T, name: &str) -> Result<&'a T, Fault> {
    // SAFETY: guaranteed by the caller.
    unsafe { array(handle, 1, 1, name) }.map(|one| &one[0])
}

/// Returns the value behind a handle, to be changed.
///
/// # Safety
/// `handle` is null, or a handle created by this library and not freed, which no other thread uses now.
pub(crate) unsafe fn changed<'a, T>(handle: *mut T, name: &str) -> Result<&'a mut T, Fault> {
    room(handle, 1, 1, name)?;
    // SAFETY: guaranteed by the caller; the pointer was checked.
    Ok(unsafe { &mut *handle })
}

/// Runs the body of an interface function and stores the result through a pointer, or null if the body fails.
///
/// # Safety
/// `out` is null or can be written.
pub(crate) unsafe fn giving<T>(out: *mut *mut T, make: impl FnOnce() -> Result<T, Fault>) -> kpam_status {
    if let Err(fault) = room(out, 1, 1, "out") {
        return guarded(|| Err(fault));
    }
    // SAFETY: guaranteed by the caller; the pointer was checked.
    unsafe { *out = std::ptr::null_mut() };
    guarded(|| {
        let value = Box::into_raw(Box::new(make()?));
        // SAFETY: guaranteed by the caller; the pointer was checked.
        unsafe { *out = value };
        Ok(())
    })
}

/// Frees the value behind a handle; null is ignored.
///
/// # Safety
/// `handle` is null, or a handle created by this library and not freed.
pub(crate) unsafe fn freed<T>(handle: *mut T) {
    if !handle.is_null() {
        // SAFETY: guaranteed by the caller.
        drop(unsafe { Box::from_raw(handle) });
    }
}

/// Returns text `index` of a list, or null beyond its end.
pub(crate) fn listed(list: &[CString], index: usize) -> *const c_char {
    list.get(index).map_or(std::ptr::null(), |text| text.as_ptr())
}

/// A struct of options. Its first field is its size, so that later versions can add fields at its end. Every bit
/// pattern of its fields is valid.
///
/// # Safety
/// The type is `repr(C)` with a `size_t` as its first field, and numbers and pointers as its other fields.
pub(crate) unsafe trait OptionStruct: Copy {
    /// Name of the argument in messages.
    const NAME: &'static str;

    /// Returns the defaults, with the size of the whole struct.
    fn defaults() -> Self;
}

/// Writes the defaults of options into a struct of `size` bytes.
///
/// # Safety
/// `options` is null or has room for `size` bytes.
pub(crate) unsafe fn init<T: OptionStruct>(options: *mut T, size: usize) -> kpam_status {
    guarded(|| {
        room(options, 1, 1, T::NAME)?;
        fits::<T>(size)?;
        // SAFETY: guaranteed by the caller; the size is that of this version.
        unsafe { options.write(T::defaults()) };
        Ok(())
    })
}

fn fits<T>(size: usize) -> Result<(), Fault> {
    // Later versions accept the sizes of earlier versions, too, and use the defaults of the missing fields.
    if size == size_of::<T>() {
        return Ok(());
    }
    Err(Fault::invalid(format!(
        "size: {size} is not the size of this struct, {} bytes; initialize it with its _init function, and compile with \
         the header of version {}",
        size_of::<T>(),
        env!("CARGO_PKG_VERSION")
    )))
}

/// Returns the options of an argument; the defaults if it is null.
///
/// # Safety
/// `options` is null or points to a struct whose first field is the number of bytes that can be read.
pub(crate) unsafe fn options<T: OptionStruct>(options: *const T) -> Result<T, Fault> {
    if options.is_null() {
        return Ok(T::defaults());
    }
    room(options, 1, 1, T::NAME)?;
    // SAFETY: guaranteed by the caller; the size is the first field.
    let size = unsafe { *options.cast::<usize>() };
    fits::<T>(size).map_err(|Fault(status, why)| Fault(status, format!("{}.{why}", T::NAME)))?;
    // SAFETY: guaranteed by the caller; the size was checked.
    Ok(unsafe { *options })
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
        let mut out = std::ptr::dangling_mut::<u8>();
        // SAFETY: `out` can be written.
        assert_eq!(unsafe { giving(&raw mut out, || panic!("oh")) }, kpam_status::KPAM_PANIC);
        assert!(out.is_null());
    }
}

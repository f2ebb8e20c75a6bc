//! Collision checks and distances.

use std::ffi::{CString, c_char};

use gensim2_geometry::LANES;

use crate::guard::{Fault, filled, freed, giving, guarded, held, kpam_status, zero_terminated};
use crate::scene::kpam_scene;

/// A pair of bodies that are close to each other or overlap.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct kpam_pair {
    /// Name of the first body: a link or an attached body.
    pub first: *const c_char,
    /// Name of the second body: a body of the scene, or another link or attached body.
    pub second: *const c_char,
    /// Signed distance (m): negative if they overlap.
    pub distance: f64,
    /// Midpoint between the closest points of the two bodies, base frame (m).
    pub point: [f64; 3],
}

/// A list of pairs, closest first.
pub struct kpam_pairs {
    pairs: Vec<kpam_pair>,
    /// Texts to which the pairs point.
    _names: Vec<CString>,
}

/// Writes for each of `count` joint vectors (one after another in `q`) whether the robot overlaps a body or itself.
///
/// Fixed links, pairs that the SRDF disables, and attached bodies against the hand link are not checked. The first
/// check after a change of the scene prepares it, which takes seconds for bodies with millions of points or triangles.
///
/// # Safety
/// `scene` is null or a scene that was not freed; `q` is null or points to `count` x `kpam_scene_joints` numbers;
/// `hits` is null or has room for `count` values.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_scene_in_collision(
    scene: *const kpam_scene,
    q: *const f64,
    count: usize,
    hits: *mut bool,
) -> kpam_status {
    guarded(|| {
        // SAFETY: guaranteed by the caller.
        let scene = unsafe { held(scene, "scene") }?;
        // SAFETY: guaranteed by the caller.
        let rows = unsafe { scene.rows(q, count, "q") }?;
        let mut checker = scene.scene.checker();
        let mut found = Vec::with_capacity(count);
        for some in rows.chunks(LANES) {
            let some: Vec<&[f64]> = some.iter().map(Vec::as_slice).collect();
            found.extend(checker.hits_each(&some).map_err(Fault::invalid)?);
        }
        // SAFETY: guaranteed by the caller.
        unsafe { filled(hits, count, 1, "hits") }?.copy_from_slice(&found);
        Ok(())
    })
}

/// Writes for each of `count` joint vectors the smallest signed distance (m) over the pairs that
/// `kpam_scene_in_collision` checks: negative if they overlap, and at most `max_distance` (m, 0 to 10).
/// `kpam_scene_check` also names the pairs.
///
/// # Safety
/// `scene` is null or a scene that was not freed; `q` is null or points to `count` x `kpam_scene_joints` numbers;
/// `distances` is null or has room for `count` numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_scene_distance(
    scene: *const kpam_scene,
    q: *const f64,
    count: usize,
    max_distance: f64,
    distances: *mut f64,
) -> kpam_status {
    guarded(|| {
        // SAFETY: guaranteed by the caller.
        let scene = unsafe { held(scene, "scene") }?;
        is_reach(max_distance, "max_distance")?;
        // SAFETY: guaranteed by the caller.
        let rows = unsafe { scene.rows(q, count, "q") }?;
        let mut checker = scene.scene.checker();
        let found = rows.iter().map(|q| checker.distance(q, max_distance)).collect::<Result<Vec<f64>, _>>();
        // SAFETY: guaranteed by the caller.
        unsafe { filled(distances, count, 1, "distances") }?.copy_from_slice(&found.map_err(Fault::invalid)?);
        Ok(())
    })
}

/// Creates the list of the pairs that are closer than `reach` (m, 0 to 10) at joints `q`, closest first; with 0, the
/// pairs that overlap. The list may be empty.
///
/// # Safety
/// `scene` is null or a scene that was not freed; `q` is null or points to `kpam_scene_joints` numbers; `out` can be
/// written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_scene_check(
    scene: *const kpam_scene,
    q: *const f64,
    reach: f64,
    out: *mut *mut kpam_pairs,
) -> kpam_status {
    let look = || {
        // SAFETY: guaranteed by the caller.
        let scene = unsafe { held(scene, "scene") }?;
        is_reach(reach, "reach")?;
        // SAFETY: guaranteed by the caller.
        let q = unsafe { scene.row(q, "q") }?;
        let near = scene.scene.checker().near(&q, reach).map_err(Fault::invalid)?;
        let (mut pairs, mut names) = (Vec::with_capacity(near.len()), Vec::with_capacity(2 * near.len()));
        for each in near {
            let [first, second] = [zero_terminated(&each.first), zero_terminated(&each.second)];
            let point = each.point.coords.into();
            // The text of a CString stays at its place when the CString itself is moved.
            pairs.push(kpam_pair { first: first.as_ptr(), second: second.as_ptr(), distance: each.distance, point });
            names.extend([first, second]);
        }
        Ok(kpam_pairs { pairs, _names: names })
    };
    // SAFETY: guaranteed by the caller.
    unsafe { giving(out, look) }
}

fn is_reach(value: f64, name: &str) -> Result<(), Fault> {
    if (0.0..=10.0).contains(&value) {
        return Ok(());
    }
    Err(Fault::invalid(format!("{name}: must lie in 0 to 10 m, not {value}")))
}

/// Returns a pair of a list; null if `pairs` is null or the index is too large. The pair and its names are valid until
/// the list is freed.
///
/// # Safety
/// `pairs` is null or a list that was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_pairs_at(pairs: *const kpam_pairs, index: usize) -> *const kpam_pair {
    // SAFETY: guaranteed by the caller.
    unsafe { pairs.as_ref() }.and_then(|list| list.pairs.get(index)).map_or(std::ptr::null(), std::ptr::from_ref)
}

/// Frees a list of pairs; null is ignored.
///
/// # Safety
/// `pairs` is null or a list that was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kpam_pairs_free(pairs: *mut kpam_pairs) {
    // SAFETY: guaranteed by the caller.
    unsafe { freed(pairs) }
}

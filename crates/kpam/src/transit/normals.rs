//! Normals of the planes that separated pairs of bodies last. The same plane often separates a pair again.

use gensim2_geometry::Other;
use nalgebra::Vector3;

/// Normals by pair: a group and another body.
#[derive(Default)]
pub(super) struct Normals(Vec<((usize, Other), Vector3<f64>)>);

impl Normals {
    /// Returns the normal of a pair, zero at first.
    pub fn of(&mut self, group: usize, other: Other) -> &mut Vector3<f64> {
        let at = self.0.iter().position(|(pair, _)| *pair == (group, other)).unwrap_or_else(|| {
            self.0.push(((group, other), Vector3::zeros()));
            self.0.len() - 1
        });
        &mut self.0[at].1
    }
}

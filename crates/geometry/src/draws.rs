//! Random numbers that depend on the seed only.

/// The random number generator SplitMix64.
///
/// ```
/// use gensim2_geometry::Draws;
///
/// let (mut one, mut same) = (Draws::of(7, 0), Draws::of(7, 0));
/// assert_eq!(one.unit(), same.unit());
/// ```
#[derive(Debug, Clone)]
pub struct Draws(u64);

impl Draws {
    /// Creates the generator for one use (`purpose`) of random numbers, with the user's seed.
    #[must_use]
    pub fn of(purpose: u64, seed: usize) -> Self {
        Self(purpose ^ ((seed as u64) << 32))
    }

    /// Returns a random number uniformly distributed in 0..1.
    pub fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^= z >> 31;
        (z >> 11) as f64 / (1u64 << 53) as f64
    }
}

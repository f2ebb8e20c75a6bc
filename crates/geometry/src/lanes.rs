//! Arithmetic on eight single-precision numbers at a time. The type is a plain array, from which the compiler makes
//! vector instructions of the width of the [machine](wide). No fused multiply-add is used, so every machine gives the
//! same bits.

use std::ops::{Add, Div, Mul, Neg, Sub};
use std::sync::OnceLock;

use pulp::{Arch, Simd, WithSimd};

/// Number of lanes, i.e. of numbers processed at once.
pub const WIDTH: usize = 8;

/// Eight single-precision numbers, one in each lane.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(32))]
pub struct F32x8([f32; WIDTH]);

impl Default for F32x8 {
    fn default() -> Self {
        Self::ZERO
    }
}

#[inline(always)]
fn each(f: impl Fn(usize) -> f32) -> F32x8 {
    let mut out = [0.0; WIDTH];
    for (i, value) in out.iter_mut().enumerate() {
        *value = f(i);
    }
    F32x8(out)
}

impl F32x8 {
    /// Eight zeros.
    pub const ZERO: Self = Self([0.0; WIDTH]);
    /// Eight ones.
    pub const ONE: Self = Self([1.0; WIDTH]);

    /// Creates a vector from eight numbers.
    #[inline(always)]
    #[must_use]
    pub fn new(values: [f32; WIDTH]) -> Self {
        Self(values)
    }

    /// Creates a vector of eight equal numbers.
    #[inline(always)]
    #[must_use]
    pub fn splat(value: f32) -> Self {
        Self([value; WIDTH])
    }

    /// Returns the eight numbers.
    #[inline(always)]
    #[must_use]
    pub fn to_array(self) -> [f32; WIDTH] {
        self.0
    }

    /// Sets one lane; an index out of range is ignored.
    #[inline(always)]
    pub fn set(&mut self, lane: usize, value: f32) {
        if let Some(place) = self.0.get_mut(lane) {
            *place = value;
        }
    }

    /// Returns the maximum in each lane, or the number of `other` if either number is NaN.
    #[inline(always)]
    #[must_use]
    pub fn max(self, other: Self) -> Self {
        each(|i| if self.0[i] > other.0[i] { self.0[i] } else { other.0[i] })
    }

    /// Returns the minimum in each lane, or the number of `other` if either number is NaN.
    #[inline(always)]
    #[must_use]
    pub fn min(self, other: Self) -> Self {
        each(|i| if self.0[i] < other.0[i] { self.0[i] } else { other.0[i] })
    }

    /// Returns the absolute values.
    #[inline(always)]
    #[must_use]
    pub fn abs(self) -> Self {
        each(|i| self.0[i].abs())
    }

    /// Returns the square roots.
    #[inline(always)]
    #[must_use]
    pub fn sqrt(self) -> Self {
        each(|i| self.0[i].sqrt())
    }

    /// Returns whether the number in every lane is at least the number in the same lane of `other`; false for NaN.
    #[inline(always)]
    #[must_use]
    pub fn all_at_least(self, other: Self) -> bool {
        let mut all = true;
        for i in 0..WIDTH {
            all &= self.0[i] >= other.0[i];
        }
        all
    }

    /// Returns `yes` in the lanes where the number is below `limit`, and `no` in all others, including NaN.
    #[inline(always)]
    #[must_use]
    pub fn below(self, limit: Self, yes: Self, no: Self) -> Self {
        each(|i| if self.0[i] < limit.0[i] { yes.0[i] } else { no.0[i] })
    }

    /// Returns the angle in 0..pi whose sine (not negative) and cosine are given, both scaled by any positive factor.
    /// The angle is reduced to an eighth of a turn, then to a sixteenth, and computed by Cephes' polynomial.
    #[inline(always)]
    #[must_use]
    pub fn angle(sin: Self, cos: Self) -> Self {
        use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI};
        let along = cos.abs();
        let z = sin.min(along) / sin.max(along).max(Self::splat(1e-30));
        let low = Self::splat(0.414_213_56);
        let y = low.below(z, (z - Self::ONE) / (z + Self::ONE), z);
        let begin = low.below(z, Self::splat(FRAC_PI_4), Self::ZERO);
        let s = y * y;
        let series = ((s * 8.053_744_5e-2 - Self::splat(1.387_768_6e-1)) * s + Self::splat(1.997_771_1e-1)) * s
            - Self::splat(3.333_295e-1);
        let part = begin + series * s * y + y;
        let part = along.below(sin, Self::splat(FRAC_PI_2) - part, part);
        cos.below(Self::ZERO, Self::splat(PI) - part, part)
    }

    /// Returns sine and cosine, computed from sums and products only. The angle is reduced to an eighth of a turn in
    /// three steps (Cody and Waite), then Cephes' polynomials follow.
    #[inline(always)]
    #[must_use]
    pub fn sin_cos(self) -> (Self, Self) {
        // Numbers of this size have no fraction, so adding this one rounds, and the last bits of the sum are the number
        // of the quarter turn.
        const ROUNDER: f32 = 12_582_912.0;
        let shifted = self * std::f32::consts::FRAC_2_PI + Self::splat(ROUNDER);
        let turns = shifted - Self::splat(ROUNDER);
        let y = ((self - turns * 1.570_312_5) - turns * 4.837_513e-4) - turns * 7.549_79e-8;
        let z = y * y;
        let sin = y + y * z * (Self::splat(-1.666_665_5e-1) + z * (Self::splat(8.332_161e-3) - z * 1.951_529_6e-4));
        let cos = Self::ONE - z * 0.5
            + z * z * (Self::splat(4.166_664_6e-2) + z * (Self::splat(-1.388_731_6e-3) + z * 2.443_315_7e-5));
        // The number of the quarter turn determines which result is the sine, and the signs. No branch is used.
        let odd = each(|i| (shifted.0[i].to_bits() & 1) as f32);
        let late = Self::ONE - each(|i| ((shifted.0[i].to_bits() >> 1) & 1) as f32) * 2.0;
        let even = Self::ONE - odd;
        // Sine and cosine by quarter turn: 0: (s, c), 1: (c, -s), 2: (-s, -c), 3: (-c, s).
        ((sin * even + cos * odd) * late, (cos * even - sin * odd) * late)
    }
}

impl Add for F32x8 {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        each(|i| self.0[i] + other.0[i])
    }
}

impl Sub for F32x8 {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        each(|i| self.0[i] - other.0[i])
    }
}

impl Mul for F32x8 {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        each(|i| self.0[i] * other.0[i])
    }
}

impl Div for F32x8 {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        each(|i| self.0[i] / other.0[i])
    }
}

impl Mul<f32> for F32x8 {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: f32) -> Self {
        each(|i| self.0[i] * other)
    }
}

impl Neg for F32x8 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        each(|i| -self.0[i])
    }
}

/// Computation on lanes. A trait is used instead of a closure because a closure that is not inlined would be compiled
/// for the oldest supported machine.
pub trait Wide {
    /// Result of the computation.
    type Output;
    /// Runs the computation. Implementations must be inlined, together with everything that they call.
    fn run(self) -> Self::Output;
}

/// Runs a computation compiled for the widest vector instructions of this machine.
#[inline(always)]
pub fn wide<W: Wide>(work: W) -> W::Output {
    struct Dispatched<W>(W);
    impl<W: Wide> WithSimd for Dispatched<W> {
        type Output = W::Output;
        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) -> W::Output {
            self.0.run()
        }
    }
    // Detecting the instruction set takes longer than many of these computations.
    static ARCH: OnceLock<Arch> = OnceLock::new();
    ARCH.get_or_init(Arch::new).dispatch(Dispatched(work))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sine_and_cosine_are_those_of_the_library() {
        for k in -4000..4000 {
            let x = k as f32 * 0.004_7;
            let (s, c) = F32x8::splat(x).sin_cos();
            let (ws, wc) = f64::from(x).sin_cos();
            assert!((f64::from(s.to_array()[3]) - ws).abs() < 3e-7, "{x}");
            assert!((f64::from(c.to_array()[5]) - wc).abs() < 3e-7, "{x}");
        }
    }

    #[test]
    fn angles_are_those_of_the_library() {
        for k in 0..2000 {
            let angle = f64::from(k) * std::f64::consts::PI / 1999.0;
            let (s, c) = angle.sin_cos();
            let found = F32x8::angle(F32x8::splat(s as f32), F32x8::splat(c as f32)).to_array()[1];
            assert!((f64::from(found) - angle).abs() < 1e-6, "{angle} {found}");
        }
    }

    #[test]
    fn what_is_no_number_is_at_least_nothing() {
        let mut a = F32x8::ONE;
        assert!(a.all_at_least(F32x8::ONE));
        a.set(6, f32::NAN);
        assert!(!a.all_at_least(F32x8::ZERO));
        assert!(a.sin_cos().0.to_array()[6].is_nan());
    }

    #[test]
    fn every_width_gives_the_same_bits() {
        let x = F32x8::new([0.1, -2.7, 3.3, 1e-3, -9.9, 0.77, 2.2, -0.4]);
        struct Work(F32x8);
        impl Wide for Work {
            type Output = [u32; WIDTH];
            #[inline(always)]
            fn run(self) -> Self::Output {
                let (s, c) = self.0.sin_cos();
                let angle = F32x8::angle(s.abs(), c);
                (s * self.0 + c * 0.3 - angle).abs().sqrt().max(s - c).to_array().map(f32::to_bits)
            }
        }
        assert_eq!(wide(Work(x)), Work(x).run());
    }
}

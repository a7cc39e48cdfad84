//! Float and memory helpers: the only file in which the two targets differ.

use crate::interface::Counter;
use glam::{Vec2, Vec3, Vec4};
#[cfg(target_arch = "spirv")]
use spirv_std::num_traits::Float;

/// Unit roundoff of `f32`: half the distance from 1 to the next float.
pub const UNIT_ROUNDOFF: f32 = f32::EPSILON * 0.5;

/// Bound on the relative error of `n` roundings in sequence: n u / (1 - n u), u the unit roundoff (Higham, *Accuracy
/// and Stability of Numerical Algorithms*, 2nd ed., lemma 3.1).
#[inline]
pub const fn gamma(n: u32) -> f32 {
    let nu = n as f32 * UNIT_ROUNDOFF;
    nu / (1.0 - nu)
}

/// `a * b + c`, rounded once where the device fuses. On SPIR-V the explicit `Fma` instruction: a driver may compute it
/// as a product and a sum, but not one way here and another there, which is what two triangles at an edge rely on. On
/// the CPU the product is exact in `f64` and the sum is rounded to `f64`, then to `f32`, which needs no FMA unit and
/// differs from a fused operation only where the `f64` sum lies on a tie of `f32`.
#[inline]
pub fn fma(a: f32, b: f32, c: f32) -> f32 {
    #[cfg(not(target_arch = "spirv"))]
    {
        (f64::from(a) * f64::from(b) + f64::from(c)) as f32
    }
    #[cfg(target_arch = "spirv")]
    {
        Float::mul_add(a, b, c)
    }
}

/// `a * b + c` per component, `a` a scalar: see [`fma`].
#[inline]
pub fn fma3(a: f32, b: Vec3, c: Vec3) -> Vec3 {
    Vec3::new(fma(a, b.x, c.x), fma(a, b.y, c.y), fma(a, b.z, c.z))
}

/// `a * b - c * d`, with the sign of the exact value, and `-difference_of_products(c, d, a, b)` to the bit or to
/// the rounding of its last place. On SPIR-V by Kahan's method (error at most 1.5 ulp: Jeannerod, Louvet and
/// Muller, *Math. Comp.* 82, 2013); where a driver does not fuse `Fma` it degrades to the plain difference, whose
/// sign is still antisymmetric, so that an edge keeps one sign for both its triangles. On the CPU both products
/// are exact in `f64`.
#[inline]
pub fn difference_of_products(a: f32, b: f32, c: f32, d: f32) -> f32 {
    #[cfg(not(target_arch = "spirv"))]
    {
        (f64::from(a) * f64::from(b) - f64::from(c) * f64::from(d)) as f32
    }
    #[cfg(target_arch = "spirv")]
    {
        let cd = c * d;
        let error = fma(-c, d, cd);
        fma(a, b, -cd) + error
    }
}

/// `a * b + c` per component, `b` and `c` scalars, rounded once or twice: for bounds that have room for both.
#[inline]
pub fn mul_add4(a: Vec4, b: f32, c: f32) -> Vec4 {
    #[cfg(not(target_arch = "spirv"))]
    {
        a * b + c
    }
    #[cfg(target_arch = "spirv")]
    {
        Vec4::new(fma(a.x, b, c), fma(a.y, b, c), fma(a.z, b, c), fma(a.w, b, c))
    }
}

/// Cross product with each component within 1.5 ulp of the exact one, however much cancels.
#[inline]
pub fn cross(a: Vec3, b: Vec3) -> Vec3 {
    Vec3::new(
        difference_of_products(a.y, b.z, a.z, b.y),
        difference_of_products(a.z, b.x, a.x, b.z),
        difference_of_products(a.x, b.y, a.y, b.x),
    )
}

/// Dot product in a fixed order of fused operations: the same bits in every copy of the code.
#[inline]
pub fn dot(a: Vec3, b: Vec3) -> f32 {
    fma(a.z, b.z, fma(a.y, b.y, a.x * b.x))
}

/// What [`Sum`] adds in.
#[cfg(not(target_arch = "spirv"))]
type Wide = f64;
#[cfg(target_arch = "spirv")]
type Wide = f32;

/// A sum of floats: in `f64` on the CPU, in `f32` on SPIR-V, where not every device has more.
#[derive(Clone, Copy)]
pub struct Sum(Wide);

impl Sum {
    /// Of nothing.
    pub const ZERO: Sum = Sum(0.0);

    /// With one more summand.
    #[inline]
    pub fn plus(self, x: f32) -> Sum {
        Sum(self.0 + x as Wide)
    }

    /// Divided by the number of its summands, at least 1.
    #[inline]
    pub fn mean(self, count: u32) -> f32 {
        (self.0 / count as Wide) as f32
    }

    /// Bound on the error of a mean of `count` numbers, in unit roundoffs of the greatest of them: the last rounding on
    /// the CPU; on SPIR-V one a sum, and 2.5 ulp (5 roundoffs) for the division.
    #[inline]
    pub fn mean_roundings(count: u32) -> u32 {
        if cfg!(target_arch = "spirv") { count + 4 } else { 1 }
    }
}

/// Square root; NaN below zero.
#[inline]
pub fn sqrt(x: f32) -> f32 {
    x.sqrt()
}

/// Binary logarithm of a positive `x`.
#[inline]
pub fn log2(x: f32) -> f32 {
    x.log2()
}

/// The greatest integer not above `x`.
#[inline]
pub fn floor(x: f32) -> f32 {
    x.floor()
}

/// Minimum and maximum as one instruction each. Of a number and NaN the `f32` is the number, as IEEE 754-2008's minNum
/// has it, while a component of a vector may be either.
///
/// rust-gpu compiles [`f32::min`] to a test for NaN, a branch and a comparison, and [`Vec3::min`] to a comparison and a
/// choice. Of the branches in the bound of a quadtree's node these were 32 of 74.
pub trait MinMax {
    /// The smaller one, of each component.
    fn min_num(self, other: Self) -> Self;
    /// The greater one, of each component.
    fn max_num(self, other: Self) -> Self;
}

impl MinMax for f32 {
    #[inline]
    fn min_num(self, other: f32) -> f32 {
        #[cfg(not(target_arch = "spirv"))]
        {
            self.min(other)
        }
        #[cfg(target_arch = "spirv")]
        {
            nmin(self, other)
        }
    }

    #[inline]
    fn max_num(self, other: f32) -> f32 {
        #[cfg(not(target_arch = "spirv"))]
        {
            self.max(other)
        }
        #[cfg(target_arch = "spirv")]
        {
            nmax(self, other)
        }
    }
}

/// Declares an instruction of two floats out of the extended set for graphics, by its number there.
#[cfg(target_arch = "spirv")]
macro_rules! instruction_of_floats {
    ($name:ident, $instruction:literal) => {
        #[inline]
        #[expect(unsafe_code, reason = "the compiler has no function for this instruction")]
        fn $name(a: f32, b: f32) -> f32 {
            let result;
            // SAFETY: the instruction takes two floats and has no effect but its result, a float.
            unsafe {
                core::arch::asm!(
                    "%glsl = OpExtInstImport \"GLSL.std.450\"",
                    "%float = OpTypeFloat 32",
                    concat!("{result} = OpExtInst %float %glsl ", $instruction, " {a} {b}"),
                    a = in(reg) a,
                    b = in(reg) b,
                    result = out(reg) result,
                );
            }
            result
        }
    };
}

#[cfg(target_arch = "spirv")]
instruction_of_floats!(nmin, "79");
#[cfg(target_arch = "spirv")]
instruction_of_floats!(nmax, "80");

/// Implements [`MinMax`] for a vector.
macro_rules! min_max_of_vector {
    ($vector:ident: $($component:ident),*) => {
        impl MinMax for $vector {
            #[inline]
            fn min_num(self, other: $vector) -> $vector {
                #[cfg(not(target_arch = "spirv"))]
                {
                    self.min(other)
                }
                #[cfg(target_arch = "spirv")]
                {
                    $vector::new($(self.$component.min_num(other.$component)),*)
                }
            }

            #[inline]
            fn max_num(self, other: $vector) -> $vector {
                #[cfg(not(target_arch = "spirv"))]
                {
                    self.max(other)
                }
                #[cfg(target_arch = "spirv")]
                {
                    $vector::new($(self.$component.max_num(other.$component)),*)
                }
            }
        }
    };
}

min_max_of_vector!(Vec2: x, y);
min_max_of_vector!(Vec3: x, y, z);
min_max_of_vector!(Vec4: x, y, z, w);

/// The integer part of `x`, which the caller guarantees to be at least 0 and below 2^24. A cast would also tell what is
/// beyond, in six instructions on a GPU.
#[inline]
pub fn to_u32(x: f32) -> u32 {
    #[cfg(not(target_arch = "spirv"))]
    {
        debug_assert!((0.0..16_777_216.0).contains(&x), "{x}");
        x as u32
    }
    #[cfg(target_arch = "spirv")]
    #[expect(unsafe_code, reason = "an unchecked cast is one instruction")]
    // SAFETY: callers guarantee the range, and the CPU build of the same source asserts it in debug builds.
    unsafe {
        x.to_int_unchecked()
    }
}

/// Greatest absolute component.
#[inline]
pub fn max_abs(v: Vec3) -> f32 {
    v.x.abs().max_num(v.y.abs()).max_num(v.z.abs())
}

/// `v` as a unit vector, whatever its length: brought to size first, since the square of an area may be more or less
/// than a float can hold. NaN where `v` is zero or not finite.
#[inline]
pub fn unit(v: Vec3) -> Vec3 {
    (v / max_abs(v)).normalize()
}

/// Sum of absolute components.
#[inline]
pub fn sum_abs(v: Vec3) -> f32 {
    v.x.abs() + v.y.abs() + v.z.abs()
}

/// The next float above a finite `x`.
#[inline]
pub fn next_up(x: f32) -> f32 {
    let bits = x.to_bits();
    if x == 0.0 {
        f32::from_bits(1)
    } else if bits >> 31 == 0 {
        f32::from_bits(bits + 1)
    } else {
        f32::from_bits(bits - 1)
    }
}

/// The next float below a finite `x`.
#[inline]
pub fn next_down(x: f32) -> f32 {
    -next_up(-x)
}

/// `buffer[i]`. The caller guarantees `i < buffer.len()`: CPU builds check it, the SPIR-V build does not, since a
/// bounds check on every load costs a quarter of a ray tracer's time and a failed one would end the invocation
/// without a word.
#[inline]
pub fn at<T: Copy>(buffer: &[T], i: u32) -> T {
    #[cfg(not(target_arch = "spirv"))]
    {
        buffer[i as usize]
    }
    #[cfg(target_arch = "spirv")]
    #[expect(unsafe_code, reason = "unchecked load; the CPU build of the same source checks the index")]
    // SAFETY: indices come from buffers whose contents the host checks before it uploads them (`SceneBuffers::check`),
    // or from invocation ids that entry points compare with the film's or the batch's size. The CPU build of the same
    // source checks each one.
    unsafe {
        *spirv_std::arch::IndexUnchecked::index_unchecked(buffer, i as usize)
    }
}

/// `buffer[i] = value`, checked like [`at`].
#[inline]
pub fn put<T: Copy>(buffer: &mut [T], i: u32, value: T) {
    #[cfg(not(target_arch = "spirv"))]
    {
        buffer[i as usize] = value;
    }
    #[cfg(target_arch = "spirv")]
    #[expect(unsafe_code, reason = "unchecked store; the CPU build of the same source checks the index")]
    // SAFETY: as in `at`.
    unsafe {
        *spirv_std::arch::IndexUnchecked::index_unchecked_mut(buffer, i as usize) = value;
    }
}

/// Adds `value` to a 64-bit counter that others add to as well: atomically on SPIR-V, where the upper word counts the
/// lower one's overflows. On the CPU the caller holds it alone.
#[inline]
pub fn add_to_counter(counter: &mut Counter, value: Counter) {
    let old = add_atomically(&mut counter.low, value.low);
    let carry = (old.wrapping_add(value.low) < old) as u32;
    if carry + value.high != 0 {
        add_atomically(&mut counter.high, carry + value.high);
    }
}

/// An array that the caller writes before it reads: of zeros on the CPU, of anything on SPIR-V, where a kilobyte of
/// zeros for each ray's stack takes as long as all else of a ray that hits nothing.
#[inline]
pub fn scratch<T: Copy + Default, const N: usize>() -> [T; N] {
    #[cfg(not(target_arch = "spirv"))]
    {
        [T::default(); N]
    }
    #[cfg(target_arch = "spirv")]
    #[expect(unsafe_code, reason = "the compiler has no value that is left undefined")]
    {
        // SAFETY: callers write each item before they read it.
        unsafe { core::mem::MaybeUninit::<[T; N]>::uninit().assume_init() }
    }
}

/// Waits until every invocation of the workgroup is here and sees what the others wrote to its shared memory. On
/// the CPU phases are run one after the other by the caller: nothing to wait for.
#[inline]
pub fn workgroup_barrier() {
    #[cfg(target_arch = "spirv")]
    spirv_std::arch::workgroup_memory_barrier_with_group_sync();
}

/// Adds to a word, returns its old value.
#[inline]
fn add_atomically(word: &mut u32, value: u32) -> u32 {
    #[cfg(not(target_arch = "spirv"))]
    {
        let old = *word;
        *word = old.wrapping_add(value);
        old
    }
    #[cfg(target_arch = "spirv")]
    #[expect(unsafe_code, reason = "atomics are unsafe in spirv-std")]
    // SAFETY: every access to the counters goes through this function.
    unsafe {
        use spirv_std::memory::{Scope, Semantics};
        spirv_std::arch::atomic_i_add::<u32, { Scope::QueueFamily as u32 }, { Semantics::NONE.bits() }>(
            word, value,
        )
    }
}

/// The least l with 2^l >= x, for x > 0.
#[inline]
pub fn ceil_log2(x: u32) -> u32 {
    if x <= 1 { 0 } else { 32 - (x - 1).leading_zeros() }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::sampler::{pcg4d, unit_float};
    use glam::UVec4;

    /// Seeded random numbers for tests.
    pub(crate) struct Numbers(UVec4);

    impl Numbers {
        pub(crate) fn new(seed: u32) -> Self {
            Numbers(UVec4::new(seed, 0, 0, 0))
        }

        /// Uniform in [0,1).
        pub(crate) fn unit(&mut self) -> f32 {
            self.0.y = self.0.y.wrapping_add(1);
            unit_float(pcg4d(self.0).x)
        }

        /// Uniform in [-1,1)³.
        pub(crate) fn vec3(&mut self) -> Vec3 {
            Vec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - Vec3::ONE
        }

        /// A number of random sign and of magnitude 2^-40 to 2^40.
        pub(crate) fn wide(&mut self) -> f32 {
            (self.unit() * 2.0 - 1.0) * (self.unit() * 80.0 - 40.0).exp2()
        }
    }

    #[test]
    fn gamma_bounds_a_product_of_roundings() {
        assert_eq!(gamma(1), UNIT_ROUNDOFF / (1.0 - UNIT_ROUNDOFF));
        assert!(gamma(3) > 3.0 * UNIT_ROUNDOFF);
    }

    #[test]
    fn difference_of_products_has_the_exact_sign_and_is_antisymmetric() {
        let mut numbers = Numbers::new(7);
        for _ in 0..100_000 {
            let (a, b) = (numbers.wide(), numbers.wide());
            // c d nearly equal to a b: the case in which the plain difference rounds to anything.
            let c = a * (1.0 + numbers.unit() * 1e-6);
            let d = b * (1.0 - numbers.unit() * 1e-6);
            let exact = f64::from(a) * f64::from(b) - f64::from(c) * f64::from(d);
            let got = difference_of_products(a, b, c, d);
            assert_eq!(got.partial_cmp(&0.0), exact.partial_cmp(&0.0));
            assert!((f64::from(got) - exact).abs() <= exact.abs() * f64::from(f32::EPSILON));
            assert_eq!(got, -difference_of_products(c, d, a, b));
        }
    }

    #[test]
    fn fma_keeps_what_a_rounded_product_loses() {
        let x = 1.0 + f32::EPSILON;
        assert_eq!(fma(x, x, -(1.0 + 2.0 * f32::EPSILON)), f32::EPSILON * f32::EPSILON);
    }

    #[test]
    fn next_up_and_down_are_the_neighbours() {
        for x in [0.0, -0.0, 1.0, -1.0, f32::MIN_POSITIVE, -1e-45, 1e30, -1e30] {
            assert_eq!(next_up(x), f32::next_up(x));
            assert_eq!(next_down(x), f32::next_down(x));
        }
    }

    #[test]
    fn counter_carries_into_its_upper_word() {
        let mut counter = Counter { low: u32::MAX - 1, high: 2 };
        add_to_counter(&mut counter, Counter { low: 3, high: 0 });
        assert_eq!(counter, Counter { low: 1, high: 3 });
        add_to_counter(&mut counter, Counter { low: u32::MAX, high: 4 });
        assert_eq!(counter.value(), (8 << 32));
    }
}

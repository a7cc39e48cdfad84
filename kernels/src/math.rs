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

/// `a * b + c`, rounded once where the device fuses. On SPIR-V the explicit `Fma` instruction, which Vulkan allows to
/// be computed as a product and a sum (lavapipe does); a device does the one or the other throughout, which `emboss
/// devices --check` measures. No other product and sum are ever fused: the build decorates them with `NoContraction`.
/// On a CPU without an FMA unit, for all that the build knows, the product is exact in `f64` and the sum is rounded to
/// `f64`, then to `f32`, which differs from a fused operation only where the `f64` sum lies on a tie of `f32`.
#[inline]
pub fn fma(a: f32, b: f32, c: f32) -> f32 {
    #[cfg(all(not(target_arch = "spirv"), not(target_feature = "fma")))]
    {
        (f64::from(a) * f64::from(b) + f64::from(c)) as f32
    }
    #[cfg(all(not(target_arch = "spirv"), target_feature = "fma"))]
    {
        a.mul_add(b, c)
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

/// `a * b - c * d`. Its sign is that of the exact value or, where both products round to the same float, it may be 0:
/// it is never the opposite one. `-difference_of_products(c, d, a, b)` is equal to it or to the rounding of its last
/// place, and has exactly the opposite sign.
///
/// On SPIR-V by Kahan's method, with an error of at most 1.5 ulp (Jeannerod, Louvet and Muller, *Math. Comp.* 82, 2013)
/// where `Fma` rounds once. Where it rounds twice this is the plain difference, whose error is at most
/// u (|a b| + |c d|) and a rounding, u the unit roundoff; the sign holds since rounding is monotonic. On the CPU both
/// products are exact in `f64`.
///
/// Holds where each product is 0 or from 2^-80 to 2^127 in magnitude: devices may take what is below 2^-126 for 0, and
/// what a product of 2^-80 loses to rounding is a multiple of that. Below, the sign is right where the exact value is
/// above 2^-100, and antisymmetric anyhow.
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
    #[cfg(all(not(target_arch = "spirv"), not(target_feature = "fma")))]
    {
        a * b + c
    }
    #[cfg(any(target_arch = "spirv", target_feature = "fma"))]
    {
        Vec4::new(fma(a.x, b, c), fma(a.y, b, c), fma(a.z, b, c), fma(a.w, b, c))
    }
}

/// What rounding takes from a product: `a * b` less the nearest float, exactly; the same for `b * a` to the bit.
///
/// Dekker, "A Floating-Point Technique for Extending the Available Precision", *Numer. Math.* 18, 1971, with Veltkamp's
/// splitting of factors into halves whose products fit a float. Needs no fused operation, and would be wrong with one:
/// see [`fma`]. For magnitudes below 2^115 and a product that is 0 or above 2^-80, so that nothing is denormal.
#[inline]
pub fn rounding_of_product(a: f32, b: f32) -> f32 {
    let product = a * b;
    let (ah, bh) = (upper_half(a), upper_half(b));
    let (al, bl) = (a - ah, b - bh);
    // The halves have 12 and 11 bits (and a sign), so that each operation here is exact.
    ((ah * bh - product) + (ah * bl + al * bh)) + al * bl
}

/// The nearest number to `x` that 12 bits hold.
#[inline]
fn upper_half(x: f32) -> f32 {
    let shifted = 4097.0 * x;
    shifted - (shifted - x)
}

/// `a * b - c * d`, which [`difference_of_products`] found to be `difference`, with the exact sign on every device:
/// where that is 0, what rounding took from the products tells. For the same range.
#[inline]
pub fn resolve_sign(difference: f32, a: f32, b: f32, c: f32, d: f32) -> f32 {
    if difference == 0.0 { rounding_of_product(a, b) - rounding_of_product(c, d) } else { difference }
}

/// Cross product; the errors of its components are those of [`difference_of_products`]: within 1.5 ulp however much
/// cancels where `Fma` rounds once, else 2 u |a| |b| and a rounding, u the unit roundoff, so that little is left of it
/// where `a` and `b` are all but parallel.
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

/// Square root; NaN below zero. Its error counts as 9 u wherever errors are bounded, u the unit roundoff: Vulkan takes
/// it for 1 / inversesqrt(x), of which it allows 2 ulp and 2.5 ulp (Vulkan 1.3, "Precision and Operation of SPIR-V
/// Instructions"). A length has half of a dot product's 3 u besides.
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
/// has it, while a component of a vector may be either on the CPU. That holds of a single operation: a driver may take
/// the minimum of a maximum with constants together, and give another bound for NaN ([`clamp`] does not leave it that).
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

/// `x` from `low` to `high`, and `low` for NaN: on every device, where `f32::clamp` and a minimum of a maximum give NaN
/// or either bound. Comparisons with NaN are false everywhere, so that the first one is negated.
#[inline]
pub fn clamp(x: f32, low: f32, high: f32) -> f32 {
    if !(x > low) {
        low
    } else if x < high {
        x
    } else {
        high
    }
}

/// 2^k for k from -126 to 127.
#[inline]
fn power_of_two(k: i32) -> f32 {
    f32::from_bits(((127 + k) as u32) << 23)
}

/// `x * 2^k` for k from -252 to 254: exactly, unless the result is beyond what a float holds, or denormal, which
/// devices may take for 0. A denormal `x` is not taken for it.
#[inline]
pub fn times_power_of_two(x: f32, k: i32) -> f32 {
    let bits = x.to_bits();
    // A denormal number is so many times 2^-149. How far below all floats a result lies does not matter.
    let is_denormal = bits & 0x7f80_0000 == 0;
    let k = if is_denormal { (k - 149).max(-252) } else { k };
    let count = (bits & 0x7f_ffff) as f32;
    let x = if !is_denormal {
        x
    } else if bits >> 31 == 0 {
        count
    } else {
        -count
    };
    // In two steps, since 2^k itself may be more than a float holds.
    (x * power_of_two(k >> 1)) * power_of_two(k - (k >> 1))
}

/// `v` times 2^-k, and k, such that its greatest component is from 1 to 2 in magnitude: whatever its length, so that
/// neither its square nor a quotient by its length is out of a float's range. By the bits, since devices may take
/// denormal components for 0. Zero as it is; of a vector that is not finite nothing is promised.
#[inline]
pub fn to_size(v: Vec3) -> (Vec3, i32) {
    let magnitude = |x: f32| x.to_bits() & 0x7fff_ffff;
    let greatest = magnitude(v.x).max(magnitude(v.y)).max(magnitude(v.z));
    let k = if greatest >> 23 != 0 {
        ((greatest >> 23) as i32 - 127).min(127)
    } else if greatest != 0 {
        31 - 149 - greatest.leading_zeros() as i32
    } else {
        0
    };
    let scaled =
        Vec3::new(times_power_of_two(v.x, -k), times_power_of_two(v.y, -k), times_power_of_two(v.z, -k));
    (scaled, k)
}

/// `v` as a unit vector, whatever its length: brought [to size](to_size) first. NaN where `v` is zero or not finite.
#[inline]
pub fn unit(v: Vec3) -> Vec3 {
    to_size(v).0.normalize()
}

/// Sum of absolute components.
#[inline]
pub fn sum_abs(v: Vec3) -> f32 {
    v.x.abs() + v.y.abs() + v.z.abs()
}

/// The least number above a finite `x` that is 0 or not denormal: since devices may take denormal numbers for 0, a
/// denormal `x` counts as 0, and what is next to 0 is 2^-126. The next float of all others.
#[inline]
pub fn next_up(x: f32) -> f32 {
    let bits = x.to_bits();
    let magnitude = bits & 0x7fff_ffff;
    let least = f32::MIN_POSITIVE.to_bits();
    let next = if magnitude < least {
        least
    } else if bits >> 31 == 0 {
        bits + 1
    } else if magnitude == least {
        0
    } else {
        bits - 1
    };
    f32::from_bits(next)
}

/// The greatest number below a finite `x`, in the same way.
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

    /// Factors a, b, c, d with c d nearly equal to a b: the case in which the plain difference rounds to anything.
    fn nearly_equal_products(numbers: &mut Numbers) -> [f32; 4] {
        let (a, b) = (numbers.wide(), numbers.wide());
        [a, b, a * (1.0 + numbers.unit() * 1e-6), b * (1.0 - numbers.unit() * 1e-6)]
    }

    #[test]
    fn difference_of_products_has_the_exact_sign_and_is_antisymmetric() {
        let mut numbers = Numbers::new(7);
        for _ in 0..100_000 {
            let [a, b, c, d] = nearly_equal_products(&mut numbers);
            let exact = f64::from(a) * f64::from(b) - f64::from(c) * f64::from(d);
            let got = difference_of_products(a, b, c, d);
            assert_eq!(got.partial_cmp(&0.0), exact.partial_cmp(&0.0));
            assert!((f64::from(got) - exact).abs() <= exact.abs() * f64::from(f32::EPSILON));
            assert_eq!(got, -difference_of_products(c, d, a, b));
        }
    }

    /// As a device has it whose `Fma` rounds twice: the plain difference, resolved where it is 0.
    #[test]
    fn a_plain_difference_resolved_has_the_exact_sign() {
        let mut numbers = Numbers::new(9);
        let mut resolved = 0;
        for _ in 0..100_000 {
            let [a, b, c, d] = nearly_equal_products(&mut numbers);
            let exact = f64::from(a) * f64::from(b) - f64::from(c) * f64::from(d);
            let plain = a * b - c * d;
            assert!(plain == 0.0 || (plain > 0.0) == (exact > 0.0), "{plain} {exact}");
            let got = resolve_sign(plain, a, b, c, d);
            assert_eq!(got.partial_cmp(&0.0), exact.partial_cmp(&0.0));
            // Both triangles at an edge: factors and products change places.
            assert_eq!(got, -resolve_sign(d * c - b * a, d, c, b, a));
            resolved += u32::from(plain == 0.0 && exact != 0.0);
        }
        assert!(resolved > 1000, "{resolved}");
    }

    #[test]
    fn what_rounding_takes_from_a_product_is_exact() {
        let mut numbers = Numbers::new(10);
        for _ in 0..200_000 {
            // Down to products of 2^-80.
            let (a, b) = (numbers.wide(), numbers.wide());
            let taken = f64::from(a) * f64::from(b) - f64::from(a * b);
            assert_eq!(f64::from(rounding_of_product(a, b)), taken, "{a:e} {b:e}");
            assert_eq!(rounding_of_product(a, b).to_bits(), rounding_of_product(b, a).to_bits());
        }
    }

    #[test]
    fn clamped_nan_is_the_lower_bound() {
        let clamped = [f32::NAN, -f32::NAN, -1.0, 0.0, 0.25, 1.0, f32::INFINITY].map(|x| clamp(x, 0.0, 1.0));
        assert_eq!(clamped, [0.0, 0.0, 0.0, 0.0, 0.25, 1.0, 1.0]);
    }

    #[test]
    fn powers_of_two_leave_all_digits() {
        let mut numbers = Numbers::new(12);
        for k in -252..=254 {
            for x in [1.0, f32::MAX, f32::MIN_POSITIVE, 1e-40, -1e-45, 0.0, numbers.wide()] {
                let exact = f64::from(x) * 2.0_f64.powi(k);
                let got = f64::from(times_power_of_two(x, k));
                let is_held = exact == 0.0 || exact.abs() >= f64::from(f32::MIN_POSITIVE);
                if is_held && exact.abs() <= f64::from(f32::MAX) {
                    assert_eq!(got, exact, "{x:e} 2^{k}");
                } else {
                    let bound = f64::from(f32::MIN_POSITIVE);
                    assert!(
                        if is_held { got.is_infinite() } else { got.abs() <= bound },
                        "{x:e} 2^{k}: {got:e}"
                    );
                }
            }
        }
    }

    /// Components of all sizes, by the least and greatest floats too: the direction is that in f64.
    #[test]
    fn unit_vectors_keep_their_direction_whatever_their_length() {
        let mut numbers = Numbers::new(13);
        for exponent in -149..=127 {
            let longest = (exponent as f32).exp2();
            for _ in 0..20 {
                let v = numbers.vec3() * longest;
                if v == Vec3::ZERO {
                    continue;
                }
                let (scaled, k) = to_size(v);
                assert!((1.0..2.0).contains(&max_abs(scaled)), "{v:?}: {scaled}");
                assert_eq!(scaled.as_dvec3() * 2.0_f64.powi(k), v.as_dvec3());
                let off = (unit(v).as_dvec3() - v.as_dvec3().normalize()).length();
                assert!(off < 4.0 * f64::from(f32::EPSILON), "{v:?}: {off:e}");
            }
        }
        let extremes = Vec3::new(f32::MAX, -f32::MAX, 1e-45);
        assert!((unit(extremes) - Vec3::new(1.0, -1.0, 0.0).normalize()).length() < 1e-6);
        assert!(unit(Vec3::ZERO).is_nan());
    }

    #[test]
    fn fma_keeps_what_a_rounded_product_loses() {
        let x = 1.0 + f32::EPSILON;
        assert_eq!(fma(x, x, -(1.0 + 2.0 * f32::EPSILON)), f32::EPSILON * f32::EPSILON);
    }

    #[test]
    fn next_up_and_down_are_the_neighbours_that_all_devices_have() {
        let least = f32::MIN_POSITIVE;
        for x in [1.0, -1.0, 1e30, -1e30, least] {
            assert_eq!(next_up(x), f32::next_up(x));
            assert_eq!(next_down(-x), f32::next_down(-x));
        }
        for denormal in [0.0, -0.0, 1e-45, -1e-45, 1e-38, -1e-38] {
            assert_eq!((next_up(denormal), next_down(denormal)), (least, -least));
        }
        assert_eq!((next_up(-least), next_down(least)), (0.0, 0.0));
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

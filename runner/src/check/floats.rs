//! Floats and loops, operation by operation, against `f64`.

use super::items::{Numbers, Output, Prober, run, run_words};
use super::{Finding, Verdict};
use crate::backend::{Backend, BackendError};
use emboss_kernels::math::UNIT_ROUNDOFF;
use emboss_kernels::probe;
use glam::{DVec3, Vec3};

/// Operands of each kind.
const ITEMS: usize = 1 << 16;
/// The error in ulp that Vulkan allows a quotient, and that bounds on errors count.
const MOST_OF_QUOTIENT: f64 = 2.5;
/// The same of a root: 1 / inversesqrt.
const MOST_OF_ROOT: f64 = 4.5;
/// Turns of loops that a ray must be able to take.
const TURNS: u32 = 1 << 20;

pub(super) fn findings(backend: &mut dyn Backend) -> Result<Vec<Finding>, BackendError> {
    let mut findings = of_arithmetic(backend)?;
    // The CPU checks indices.
    if backend.device().backend != "cpu" {
        findings.push(beyond(backend)?);
    }
    Ok(findings)
}

fn of_arithmetic(prober: &mut (impl Prober + ?Sized)) -> Result<Vec<Finding>, BackendError> {
    let mut findings = vec![contraction(prober)?, fma(prober)?, signs(prober)?];
    findings.extend(operations(prober)?);
    findings.extend([denormals(prober)?, directions(prober)?, nan(prober)?, loops(prober)?]);
    Ok(findings)
}

fn float(output: &Output, i: usize) -> f32 {
    f32::from_bits(output[i])
}

/// `a * b + c` with one rounding. (In `f64` the product is exact and the sum is rounded once more, which tells but
/// where that lies on a tie of `f32`: one sum in 2^29.)
#[expect(clippy::cast_possible_truncation, reason = "rounded to the nearest f32")]
fn fused(a: f32, b: f32, c: f32) -> f32 {
    (f64::from(a) * f64::from(b) + f64::from(c)) as f32
}

/// How sums of products came out, of those that one rounding and two make different.
#[derive(Default)]
struct Sums {
    once: usize,
    twice: usize,
    neither: usize,
}

impl Sums {
    /// Takes the sum of `a` `b` and `c` as a device computed it.
    fn add(&mut self, [a, b, c]: [f32; 3], found: f32) {
        let (once, twice) = (fused(a, b, c), a * b + c);
        if once != twice {
            let count = if found == once {
                &mut self.once
            } else if found == twice {
                &mut self.twice
            } else {
                &mut self.neither
            };
            *count += 1;
        }
    }

    fn all(&self) -> usize {
        self.once + self.twice + self.neither
    }

    /// The sums of plain products on a device.
    fn plain(prober: &mut (impl Prober + ?Sized)) -> Result<Sums, BackendError> {
        let mut numbers = Numbers::new(1);
        let items: Vec<[f32; 4]> = (0..ITEMS).map(|_| [(); 4].map(|()| numbers.wide(8.0))).collect();
        let mut sums = Sums::default();
        for ([a, b, c, d], output) in items.iter().zip(run(prober, probe::CONTRACTION, &items)?) {
            sums.add([*a, *b, *c], float(&output, 0));
            sums.add([-a, *c, *d], float(&output, 1));
        }
        Ok(sums)
    }
}

/// Whether products are fused with sums that do not ask for it.
fn contraction(prober: &mut (impl Prober + ?Sized)) -> Result<Finding, BackendError> {
    let sums = Sums::plain(prober)?;
    prober.let_contract(true);
    let free = Sums::plain(prober);
    prober.let_contract(false);
    let free = free?;
    let all = sums.all();
    let found = format!(
        "{} of {all} sums of products are fused{}; {} if the driver may",
        sums.once,
        if sums.neither > 0 {
            format!(", {} are neither right nor fused", sums.neither)
        } else {
            String::new()
        },
        free.once,
    );
    Ok(Finding::test("contraction", found, sums.twice == all))
}

/// How often `Fma` rounds.
fn fma(prober: &mut (impl Prober + ?Sized)) -> Result<Finding, BackendError> {
    let mut numbers = Numbers::new(2);
    let items: Vec<[f32; 4]> = (0..ITEMS).map(|_| [(); 4].map(|()| numbers.wide(8.0))).collect();
    let mut sums = Sums::default();
    for ([a, b, c, _], output) in items.iter().zip(run(prober, probe::ARITHMETIC, &items)?) {
        sums.add([*a, *b, *c], float(&output, 0));
    }
    let all = sums.all();
    let found = match [sums.once, sums.twice] {
        [once, 0] if once == all => "rounds once".to_owned(),
        [0, twice] if twice == all => "rounds twice".to_owned(),
        [once, twice] => format!("rounds once {once} times of {all}, twice {twice} times"),
    };
    Ok(Finding::test("fma", found, sums.once == all || sums.twice == all))
}

/// Differences of products that all but cancel: the sign decides what a ray hits, and its opposite what it hits beyond
/// the edge.
fn signs(prober: &mut (impl Prober + ?Sized)) -> Result<Finding, BackendError> {
    let mut numbers = Numbers::new(3);
    let mut items = Vec::with_capacity(2 * ITEMS);
    for _ in 0..ITEMS {
        let (a, b) = (numbers.wide(19.0), numbers.wide(19.0));
        let (c, d) = (a * (1.0 + numbers.unit() * 1e-6), b * (1.0 - numbers.unit() * 1e-6));
        items.extend([[a, b, c, d], [d, c, b, a]]);
    }
    let outputs = run(prober, probe::ARITHMETIC, &items)?;
    let sign = |x: f64| x.partial_cmp(&0.0);
    let (mut wrong, mut left_open) = (0, 0);
    for (pair, outputs) in items.chunks(2).zip(outputs.chunks(2)) {
        let [a, b, c, d] = pair[0].map(f64::from);
        let exact = sign(a * b - c * d);
        let found = [0, 1].map(|i| sign(float(&outputs[i], 2).into()));
        wrong += usize::from([exact, exact.map(std::cmp::Ordering::reverse)] != found);
        left_open += usize::from(sign(float(&outputs[0], 1).into()) != exact);
    }
    let found = format!(
        "{wrong} of {ITEMS} differences of products have a wrong sign; {left_open} had to be resolved"
    );
    Ok(Finding::test("signs", found, wrong == 0))
}

/// The distance from the exact result, in units of its last place.
fn ulps(found: f32, exact: f64) -> f64 {
    let place = (exact.abs().log2().floor() - 23.0).exp2();
    (f64::from(found) - exact).abs() / place
}

/// Sums, products, quotients and roots.
fn operations(prober: &mut (impl Prober + ?Sized)) -> Result<[Finding; 3], BackendError> {
    let mut numbers = Numbers::new(4);
    let items: Vec<[f32; 2]> = (0..ITEMS)
        .map(|i| match i % 4 {
            // Whole numbers, whose quotient is whole.
            0 => {
                let divisor = 1.0 + (numbers.unit() * 4096.0).floor();
                [divisor * (1.0 + (numbers.unit() * 4096.0).floor()), divisor]
            }
            // Near to each other, for sums.
            1 => {
                let a = numbers.wide(19.0);
                [a, -a * (1.0 + numbers.unit() * 1e-6)]
            }
            _ => [numbers.wide(19.0), numbers.wide(19.0)],
        })
        .collect();
    let (mut unequal, mut quotient, mut root, mut not_whole) = (0, 0.0_f64, 0.0_f64, 0);
    for (i, (&[a, b], output)) in items.iter().zip(run(prober, probe::OPERATIONS, &items)?).enumerate() {
        let (wide_a, wide_b) = (f64::from(a), f64::from(b));
        let taken = wide_a * wide_b - f64::from(a * b);
        let [sum, product, _, _, rounding, floor] = [0, 1, 2, 3, 4, 5].map(|i| float(&output, i));
        let right = sum == a + b && product == a * b && f64::from(rounding) == taken && floor == a.floor();
        unequal += usize::from(!right);
        quotient = quotient.max(ulps(float(&output, 2), wide_a / wide_b));
        root = root.max(ulps(float(&output, 3), wide_a.abs().sqrt()));
        not_whole += usize::from(i % 4 == 0 && float(&output, 2).fract() != 0.0);
    }
    let within = |error: f64, most: f64| format!("off by {error:.2} ulp at most, where {most} are counted");
    Ok([
        Finding::test(
            "operations",
            format!("{unequal} of {ITEMS} sums, products and their roundings are not the nearest floats"),
            unequal == 0,
        ),
        Finding::test(
            "division",
            format!(
                "{}; {not_whole} of {} whole quotients are not",
                within(quotient, MOST_OF_QUOTIENT),
                ITEMS.div_ceil(4)
            ),
            quotient <= MOST_OF_QUOTIENT,
        ),
        Finding::test("root", within(root, MOST_OF_ROOT), root <= MOST_OF_ROOT),
    ])
}

/// Whether numbers below 2^-126 are any.
fn denormals(prober: &mut (impl Prober + ?Sized)) -> Result<Finding, BackendError> {
    let (x, a, b) = (1e-40_f32, 1e-30_f32, 1e-15_f32);
    let [output] = run(prober, probe::DENORMALS, &[[x, 1.0, a, b]])?[..] else {
        return Ok(no_output("denormals"));
    };
    let kept = [
        output[0] == x.to_bits(),
        output[1] == (x + x).to_bits(),
        output[2] == (a * b).to_bits(),
        output[3] == 1,
    ];
    let found = match kept.iter().filter(|&&kept| kept).count() {
        4 => "are kept",
        0 => "count as 0",
        _ => "are kept by some operations and count as 0 in others",
    };
    // Loads and stores are no arithmetic.
    let verdict =
        if output[4] == x.to_bits() { Verdict::Noted } else { Verdict::Fails(super::RENDER_ON_THE_CPU) };
    Ok(Finding::new("denormals", found, verdict))
}

/// Directions from the least lengths to the greatest.
fn directions(prober: &mut (impl Prober + ?Sized)) -> Result<Finding, BackendError> {
    let mut numbers = Numbers::new(5);
    let items: Vec<[f32; 4]> = (-149_i16..=127)
        .flat_map(|exponent| [f32::from(exponent); 8])
        .map(|exponent| {
            let v = numbers.in_cube() * exponent.exp2();
            // Few have a component of 0 or a single digit; none is zero.
            let v = if v == Vec3::ZERO { Vec3::X * f32::from_bits(1) } else { v };
            [v.x, v.y, v.z, 1.0]
        })
        .chain([[f32::MAX, -f32::MAX, 1e-45, 1.0], [-1e-45, 1e-45, 0.0, 1.0]])
        .collect();
    let by_ray = run(prober, probe::DIRECTION, &items)?;
    let by_unit = run(prober, probe::UNIT, &items)?;
    let mut wrong = 0;
    for (item, (ray, unit)) in items.iter().zip(by_ray.iter().zip(&by_unit)) {
        let v = DVec3::new(item[0].into(), item[1].into(), item[2].into());
        let is_right = |output: &Output, bound: f64| {
            let found = [0, 1, 2].map(|i| f64::from(float(output, i)));
            // Component by component, since the greatest of some numbers and NaN is a number.
            (DVec3::from_array(found) - v.normalize()).abs().cmple(DVec3::splat(bound)).all()
        };
        // A product or a quotient (5 u) by a length: half of a dot product (1.5 u), a root (9 u), a reciprocal (5 u).
        let bound = 20.0 * f64::from(UNIT_ROUNDOFF);
        wrong += usize::from(!is_right(ray, bound) || !is_right(unit, bound));
    }
    let found = format!("{wrong} of {} of lengths from 2^-149 to 2^128 are wrong", items.len());
    Ok(Finding::test("directions", found, wrong == 0))
}

/// Whether what kernels do with NaN is what they are written for.
fn nan(prober: &mut (impl Prober + ?Sized)) -> Result<Finding, BackendError> {
    let items: Vec<[f32; 3]> =
        [f32::NAN, -f32::NAN, f32::from_bits(0x7f80_0001)].map(|x| [x, 0.25, 0.75]).to_vec();
    let outputs = run(prober, probe::NAN, &items)?;
    let is_right = |output: &Output| {
        let expected = [0.75, 0.75, 0.25, 0.25, 0.25, 0.0].map(f32::to_bits);
        // Not below, not above or equal, and not greater, but NaN.
        output[..6] == expected && output[6] == 0b1100
    };
    let wrong = outputs.iter().filter(|output| !is_right(output)).count();
    let found = match outputs.iter().find(|output| !is_right(output)) {
        None => "is no minimum, maximum or bound, and no comparison with it is true".to_owned(),
        Some(output) => format!("gives {:x?}", output),
    };
    Ok(Finding::test("NaN", found, wrong == 0))
}

/// Whether `turns` turns of a loop are all taken.
fn takes(prober: &mut (impl Prober + ?Sized), turns: u32) -> Result<bool, BackendError> {
    let seed = 1;
    let expected = (0..turns).fold(seed, |word, _| probe::turned(word));
    let outputs = run_words(prober, probe::LOOP, &[[turns, seed]])?;
    Ok(outputs.first().is_some_and(|output| output[0] == expected))
}

/// Whether loops end before they should.
fn loops(prober: &mut (impl Prober + ?Sized)) -> Result<Finding, BackendError> {
    if takes(prober, TURNS)? {
        return Ok(Finding::new("loops", format!("take {TURNS} turns and more"), Verdict::Holds));
    }
    // As many are taken, as many are not.
    let (mut taken, mut not) = (0, TURNS);
    while not - taken > 1 {
        let middle = taken + (not - taken) / 2;
        if takes(prober, middle)? { taken = middle } else { not = middle }
    }
    let remedy =
        "rays that need more miss what they should hit: render with --backend cpu, or with a small N";
    Ok(Finding::new("loops", format!("end after {taken} turns"), Verdict::Fails(remedy)))
}

/// The word that is read beyond a buffer. Kernels never do it.
fn beyond(prober: &mut (impl Prober + ?Sized)) -> Result<Finding, BackendError> {
    // Behind the only item.
    let outputs = run_words(prober, probe::BEYOND, &[[probe::IN_STRIDE + 4]])?;
    let found = match outputs.first().map(|output| output[0]) {
        Some(0) => "give 0".to_owned(),
        word => format!("give {word:x?}"),
    };
    Ok(Finding::new("reads beyond", found, Verdict::Noted))
}

/// A kernel that wrote nothing.
fn no_output(matter: &'static str) -> Finding {
    Finding::test(matter, "nothing came back", false)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A fault that a device has, or might have.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    enum Fault {
        None,
        FlushesDenormals,
        FusesProducts,
        FusesFmaAtTimes,
        LosesSigns,
        TurnsSigns,
        RoundsSums,
        DividesCoarsely,
        RootsAreCoarse,
        LosesDirections,
        KeepsNan,
        EndsLoops,
    }

    /// The CPU with a fault.
    struct Faulty(Fault);

    impl Prober for Faulty {
        fn probe(&mut self, kernel: u32, input: &[u32], count: u32) -> Result<Vec<u32>, BackendError> {
            let mut output = vec![0; count as usize * probe::OUT_STRIDE as usize];
            (0..count).for_each(|i| probe::run(kernel, input, &mut output, i));
            let items = input.chunks_exact(probe::IN_STRIDE as usize);
            let outputs = output.chunks_exact_mut(probe::OUT_STRIDE as usize);
            for (i, (item, output)) in items.zip(outputs).enumerate() {
                let [a, b, c] = [0, 1, 2].map(|i| f32::from_bits(item[i]));
                match (self.0, kernel) {
                    (Fault::FlushesDenormals, probe::DENORMALS) => output[..4].fill(0),
                    (Fault::FusesProducts, probe::CONTRACTION) => output[0] = fused(a, b, c).to_bits(),
                    (Fault::FusesFmaAtTimes, probe::ARITHMETIC) if i % 100 == 0 => {
                        output[0] = (a * b + c).to_bits();
                    }
                    (Fault::LosesSigns, probe::ARITHMETIC) if i % 100 == 0 => output[2] = 0,
                    // The sign of an edge alone, not of its other triangle's.
                    (Fault::TurnsSigns, probe::ARITHMETIC) if i == 2 => output[2] ^= 1 << 31,
                    (Fault::RoundsSums, probe::OPERATIONS) if i == 5 => output[0] ^= 1,
                    (Fault::DividesCoarsely, probe::OPERATIONS) if i == 6 => output[2] += 4,
                    (Fault::RootsAreCoarse, probe::OPERATIONS) if i == 7 => output[3] += 6,
                    (Fault::LosesDirections, probe::DIRECTION) if a.is_subnormal() => {
                        output[0] = f32::NAN.to_bits();
                    }
                    (Fault::KeepsNan, probe::NAN) => output[5] = f32::NAN.to_bits(),
                    (Fault::EndsLoops, probe::LOOP) if item[0] > 1000 => output[0] = 0,
                    _ => {}
                }
            }
            Ok(output)
        }

        fn let_contract(&mut self, _contracts: bool) {}
    }

    #[test]
    fn each_fault_is_seen_and_nothing_else() {
        let cases = [
            (Fault::None, None),
            (Fault::FlushesDenormals, None),
            (Fault::FusesProducts, Some("contraction")),
            (Fault::FusesFmaAtTimes, Some("fma")),
            (Fault::LosesSigns, Some("signs")),
            (Fault::TurnsSigns, Some("signs")),
            (Fault::RoundsSums, Some("operations")),
            (Fault::DividesCoarsely, Some("division")),
            (Fault::RootsAreCoarse, Some("root")),
            (Fault::LosesDirections, Some("directions")),
            (Fault::KeepsNan, Some("NaN")),
            (Fault::EndsLoops, Some("loops")),
        ];
        for (fault, matter) in cases {
            let findings = of_arithmetic(&mut Faulty(fault)).expect("the CPU does not fail");
            let failing: Vec<&str> = findings.iter().filter(|f| f.fails()).map(|f| f.matter).collect();
            assert_eq!(failing, Vec::from_iter(matter), "{fault:?}: {findings:?}");
            let found = |matter| findings.iter().find(|f| f.matter == matter).map(|f| f.found.as_str());
            let denormals = if fault == Fault::FlushesDenormals { "count as 0" } else { "are kept" };
            assert_eq!(found("denormals"), Some(denormals));
            if fault == Fault::EndsLoops {
                assert_eq!(found("loops"), Some("end after 1000 turns"));
            }
        }
    }
}

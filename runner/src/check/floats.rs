//! Floats and loops, operation by operation, against `f64`.

use super::items::{Numbers, Output, run, run_words};
use super::{Finding, Verdict};
use crate::backend::{Backend, BackendError};
use emboss_kernels::math::UNIT_ROUNDOFF;
use emboss_kernels::probe;
use glam::{DVec3, Vec3};

/// Operands of each kind.
const ITEMS: usize = 1 << 16;
/// What Vulkan allows a quotient, in ulp, and what bounds on errors count.
const MOST_OF_QUOTIENT: f64 = 2.5;
/// The same of a root: 1 / inversesqrt.
const MOST_OF_ROOT: f64 = 4.5;
/// Turns of loops that a ray must be able to take.
const TURNS: u32 = 1 << 20;

pub(super) fn findings(backend: &mut dyn Backend) -> Result<Vec<Finding>, BackendError> {
    let mut findings = vec![contraction(backend)?, fma(backend)?, signs(backend)?];
    findings.extend(operations(backend)?);
    findings.extend([denormals(backend)?, directions(backend)?, nan(backend)?, loops(backend)?]);
    // The CPU checks indices.
    if backend.device().backend != "cpu" {
        findings.push(beyond(backend)?);
    }
    Ok(findings)
}

fn float(output: &Output, i: usize) -> f32 {
    f32::from_bits(output[i])
}

/// `a * b + c` with one rounding. (In `f64` the product is exact and the sum is rounded once more, which tells but where
/// that lies on a tie of `f32`: one sum in 2^29.)
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

    /// Of sums of plain products on a device.
    fn plain(backend: &mut dyn Backend) -> Result<Sums, BackendError> {
        let mut numbers = Numbers::new(1);
        let items: Vec<[f32; 4]> = (0..ITEMS).map(|_| [(); 4].map(|()| numbers.wide(8.0))).collect();
        let mut sums = Sums::default();
        for ([a, b, c, d], output) in items.iter().zip(run(backend, probe::CONTRACTION, &items)?) {
            sums.add([*a, *b, *c], float(&output, 0));
            sums.add([-a, *c, *d], float(&output, 1));
        }
        Ok(sums)
    }
}

/// Whether products are fused with sums that do not ask for it.
fn contraction(backend: &mut dyn Backend) -> Result<Finding, BackendError> {
    let sums = Sums::plain(backend)?;
    backend.let_contract(true);
    let free = Sums::plain(backend);
    backend.let_contract(false);
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
fn fma(backend: &mut dyn Backend) -> Result<Finding, BackendError> {
    let mut numbers = Numbers::new(2);
    let items: Vec<[f32; 4]> = (0..ITEMS).map(|_| [(); 4].map(|()| numbers.wide(8.0))).collect();
    let mut sums = Sums::default();
    for ([a, b, c, _], output) in items.iter().zip(run(backend, probe::ARITHMETIC, &items)?) {
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

/// Differences of products that all but cancel: the sign decides what a ray hits, and its opposite what it hits beyond the
/// edge.
fn signs(backend: &mut dyn Backend) -> Result<Finding, BackendError> {
    let mut numbers = Numbers::new(3);
    let mut items = Vec::with_capacity(2 * ITEMS);
    for _ in 0..ITEMS {
        let (a, b) = (numbers.wide(19.0), numbers.wide(19.0));
        let (c, d) = (a * (1.0 + numbers.unit() * 1e-6), b * (1.0 - numbers.unit() * 1e-6));
        items.extend([[a, b, c, d], [d, c, b, a]]);
    }
    let outputs = run(backend, probe::ARITHMETIC, &items)?;
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
fn operations(backend: &mut dyn Backend) -> Result<[Finding; 3], BackendError> {
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
    for (i, (&[a, b], output)) in items.iter().zip(run(backend, probe::OPERATIONS, &items)?).enumerate() {
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
fn denormals(backend: &mut dyn Backend) -> Result<Finding, BackendError> {
    let (x, a, b) = (1e-40_f32, 1e-30_f32, 1e-15_f32);
    let [output] = run(backend, probe::DENORMALS, &[[x, 1.0, a, b]])?[..] else {
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
fn directions(backend: &mut dyn Backend) -> Result<Finding, BackendError> {
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
    let by_ray = run(backend, probe::DIRECTION, &items)?;
    let by_unit = run(backend, probe::UNIT, &items)?;
    let mut wrong = 0;
    for (item, (ray, unit)) in items.iter().zip(by_ray.iter().zip(&by_unit)) {
        let v = DVec3::new(item[0].into(), item[1].into(), item[2].into());
        let off = |output: &Output| {
            let found = [0, 1, 2].map(|i| f64::from(float(output, i)));
            (DVec3::from_array(found) - v.normalize()).abs().max_element()
        };
        // A product or a quotient (5 u) by a length: half of a dot product (1.5 u), a root (9 u), a reciprocal (5 u).
        let bound = 20.0 * f64::from(UNIT_ROUNDOFF);
        wrong += usize::from(!(off(ray) <= bound && off(unit) <= bound));
    }
    let found = format!("{wrong} of {} of lengths from 2^-149 to 2^128 are wrong", items.len());
    Ok(Finding::test("directions", found, wrong == 0))
}

/// Whether what kernels do with NaN is what they are written for.
fn nan(backend: &mut dyn Backend) -> Result<Finding, BackendError> {
    let items: Vec<[f32; 3]> =
        [f32::NAN, -f32::NAN, f32::from_bits(0x7f80_0001)].map(|x| [x, 0.25, 0.75]).to_vec();
    let outputs = run(backend, probe::NAN, &items)?;
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
fn takes(backend: &mut dyn Backend, turns: u32) -> Result<bool, BackendError> {
    let seed = 1;
    let expected = (0..turns).fold(seed, |word, _| probe::turned(word));
    let outputs = run_words(backend, probe::LOOP, &[[turns, seed]])?;
    Ok(outputs.first().is_some_and(|output| output[0] == expected))
}

/// Whether loops end before they should.
fn loops(backend: &mut dyn Backend) -> Result<Finding, BackendError> {
    if takes(backend, TURNS)? {
        return Ok(Finding::new("loops", format!("take {TURNS} turns and more"), Verdict::Holds));
    }
    // As many are taken, as many are not.
    let (mut taken, mut not) = (0, TURNS);
    while not - taken > 1 {
        let middle = taken + (not - taken) / 2;
        if takes(backend, middle)? { taken = middle } else { not = middle }
    }
    let remedy =
        "rays that need more miss what they should hit: render with --backend cpu, or with a small N";
    Ok(Finding::new("loops", format!("end after {taken} turns"), Verdict::Fails(remedy)))
}

/// What is read beyond a buffer. Kernels never do it.
fn beyond(backend: &mut dyn Backend) -> Result<Finding, BackendError> {
    // Behind the only item.
    let outputs = run_words(backend, probe::BEYOND, &[[probe::IN_STRIDE + 4]])?;
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

//! The elementary kernels one by one, on seeded inputs, on lavapipe and on the CPU. Integers agree bit for bit. Floats
//! are compared with the same value computed in `f64`, within a bound that is derived beside each test; so what
//! agrees is right, too. u is the unit roundoff, 2^-24. On Vulkan division is off by 2.5 ulp (5 u) at most, the square
//! root by 4.5 ulp (9 u), and `Fma` may round twice (Vulkan 1.3, "Precision and Operation of SPIR-V Instructions").
//! Other operations round once.

use emboss::backend::Backend;
use emboss::backend::cpu::CpuBackend;
use emboss_kernels::displacement::cell::Cell;
use emboss_kernels::math::{UNIT_ROUNDOFF, gamma};
use emboss_kernels::probe;
use emboss_tests::{Numbers, finish, lavapipe};
use glam::{DVec2, DVec3, Vec3};

const ITEMS: usize = 20_000;
const U: f64 = UNIT_ROUNDOFF as f64;
const IN: usize = probe::IN_STRIDE as usize;
const OUT: usize = probe::OUT_STRIDE as usize;

/// Inputs of the items one after the other, each padded to its stride.
#[derive(Default)]
struct Items(Vec<u32>);

impl Items {
    fn push(&mut self, words: &[u32]) {
        self.0.extend_from_slice(words);
        self.0.resize(self.0.len().next_multiple_of(IN), 0);
    }

    fn push_floats(&mut self, floats: &[f32]) {
        let words: Vec<u32> = floats.iter().map(|x| x.to_bits()).collect();
        self.push(&words);
    }

    fn push_vectors(&mut self, vectors: &[Vec3]) {
        let floats: Vec<f32> = vectors.iter().flat_map(|v| v.to_array()).collect();
        self.push_floats(&floats);
    }

    /// What the kernel makes of each item, on the device and on the CPU.
    fn run(&self, kernel: u32) -> Vec<[[u32; OUT]; 2]> {
        let count = u32::try_from(self.0.len() / IN).unwrap();
        let mut backend = lavapipe();
        let device = backend.probe(kernel, &self.0, count).unwrap();
        let cpu = CpuBackend::new().probe(kernel, &self.0, count).unwrap();
        finish(backend);
        let outputs = |words: &[u32]| -> Vec<[u32; OUT]> {
            words.chunks_exact(OUT).map(|item| item.try_into().unwrap()).collect()
        };
        outputs(&device).into_iter().zip(outputs(&cpu)).map(|(device, cpu)| [device, cpu]).collect()
    }
}

fn float(words: &[u32], i: usize) -> f64 {
    f64::from(f32::from_bits(words[i]))
}

fn dvec3(words: &[u32], i: usize) -> DVec3 {
    DVec3::new(float(words, i), float(words, i + 1), float(words, i + 2))
}

/// Asserts that a float is within `bound` of the truth.
fn assert_near(value: f64, truth: f64, bound: f64, what: &dyn std::fmt::Debug) {
    assert!((value - truth).abs() <= bound, "{value} is not within {bound:e} of {truth}: {what:?}");
}

#[test]
fn pcg4d_is_the_same_to_the_bit() {
    let mut numbers = Numbers::new(1);
    let mut items = Items::default();
    let edges = [0, 1, 0x7fff_ffff, 0x8000_0000, u32::MAX];
    for i in 0..ITEMS {
        let mut word = || if i < 625 { edges[(numbers.word() % 5) as usize] } else { numbers.word() };
        items.push(&[word(), word(), word(), word()]);
    }
    for (item, [device, cpu]) in items.run(probe::PCG4D).iter().enumerate() {
        assert_eq!(device, cpu, "item {item}");
    }
}

/// The jitter of a pixel's rays.
#[test]
fn samples_are_the_same_to_the_bit() {
    let mut numbers = Numbers::new(2);
    let mut items = Items::default();
    for _ in 0..ITEMS {
        items.push(&[numbers.word() >> 20, numbers.word() >> 20, numbers.word() >> 24, numbers.word()]);
    }
    let mut sum = DVec2::ZERO;
    for (item, [device, cpu]) in items.run(probe::SAMPLE_2D).iter().enumerate() {
        assert_eq!(device, cpu, "item {item}");
        let sample = DVec2::new(float(device, 0), float(device, 1));
        assert!(sample.min_element() >= 0.0 && sample.max_element() < 1.0, "{sample}");
        sum += sample;
    }
    // The mean of n uniform numbers has the standard deviation 1 / sqrt(12 n): six of them.
    let bound = 6.0 / (12.0 * ITEMS as f64).sqrt();
    assert!((sum / ITEMS as f64 - 0.5).abs().max_element() < bound, "{sum}");
}

/// The sum of three terms is off by gamma(4) of their absolute values (`2 x - 1` rounds once, and is not relative to
/// its result near zero). Its length takes a dot product (gamma(7), halved by the root), a root (9 u), a reciprocal
/// (5 u) and a product: 17 u, which with second-order terms is below 20 u.
#[test]
fn camera_rays_agree() {
    let mut numbers = Numbers::new(3);
    let mut items = Items::default();
    for _ in 0..ITEMS {
        let forward = numbers.direction();
        let (right, up) = forward.any_orthonormal_pair();
        let (width, height) = (numbers.unit() * 2.0 + 0.01, numbers.unit() * 2.0 + 0.01);
        let vectors = [right * width, up * height, forward, Vec3::new(numbers.unit(), numbers.unit(), 0.0)];
        items.push_vectors(&vectors);
    }
    for (input, outputs) in items.0.chunks(IN).zip(items.run(probe::CAMERA)) {
        let (right, up, forward) = (dvec3(input, 0), dvec3(input, 3), dvec3(input, 6));
        let (x, y) = (float(input, 9), float(input, 10));
        let sum = forward + right * (2.0 * x - 1.0) + up * (1.0 - 2.0 * y);
        let magnitude = forward.abs() + right.abs() + up.abs();
        let bound = magnitude.length() / sum.length() * f64::from(gamma(4)) + 20.0 * U;
        for output in outputs {
            let direction = dvec3(&output, 0);
            assert!((direction - sum.normalize()).abs().max_element() <= bound, "{direction} {sum} {bound}");
        }
    }
}

/// Entry and exit of the exact ray; `None` where it misses. Zero components of the direction bound nothing, or all.
fn exact_slabs(origin: DVec3, direction: DVec3, min: DVec3, max: DVec3) -> Option<(f64, f64)> {
    let (mut near, mut far) = (0f64, f64::INFINITY);
    for axis in 0..3 {
        let (o, d) = (origin[axis], direction[axis]);
        if d == 0.0 {
            if o < min[axis] || o > max[axis] {
                return None;
            }
        } else {
            let (a, b) = ((min[axis] - o) / d, (max[axis] - o) / d);
            near = near.max(a.min(b));
            far = far.min(a.max(b));
        }
    }
    Some((near, far))
}

/// A distance takes a difference, a reciprocal (5 u) and a product: gamma(7), relative. Boxes that the exact ray
/// touches must be hit; those missed by more than twice that beyond the enlargement of 2 gamma(7) must be missed.
#[test]
fn box_distances_agree() {
    let mut numbers = Numbers::new(4);
    let mut items = Items::default();
    for i in 0..ITEMS {
        let (a, b) = (numbers.in_cube(), numbers.in_cube());
        let (min, max) = (a.min(b), a.max(b));
        let mut origin = numbers.in_cube() * 4.0;
        let target = min + (max - min) * ((numbers.in_cube() + Vec3::ONE) * 0.6);
        let mut direction = (target - origin).normalize();
        let axis = i % 3;
        match i % 7 {
            // Along an axis or in a plane of two, as often from beside the box as from within its slabs.
            0 => direction = Vec3::AXES[axis],
            1 => direction = direction.with_component(axis, 0.0).normalize(),
            // Along a face: zero times infinity.
            2 => {
                origin[axis] = if numbers.unit() < 0.5 { min[axis] } else { max[axis] };
                direction = direction.with_component(axis, 0.0).normalize();
            }
            _ => {}
        }
        items.push_vectors(&[origin, direction, min, max]);
    }
    let (mut hits, mut misses) = (0, 0);
    let relative = f64::from(gamma(7));
    for (input, outputs) in items.0.chunks(IN).zip(items.run(probe::AABB)) {
        let [origin, direction, min, max] = [0, 3, 6, 9].map(|i| dvec3(input, i));
        let exact = exact_slabs(origin, direction, min, max);
        let touched = exact.filter(|(near, far)| near <= far);
        let missed = exact.is_none_or(|(near, far)| {
            near > far.max(0.0) * (1.0 + 2.0 * f64::from(gamma(7)) + 4.0 * relative)
        });
        hits += usize::from(touched.is_some());
        misses += usize::from(missed);
        for output in outputs {
            let t = float(&output, 0);
            if let Some((near, _)) = touched {
                assert_near(t, near, relative * near, &(origin, direction, min, max));
            }
            assert!(!missed || t == f64::INFINITY, "{t}: {origin} {direction} {min} {max} {exact:?}");
        }
    }
    assert!(hits > ITEMS / 4 && misses > ITEMS / 10, "{hits} hits, {misses} misses");
}

trait WithComponent {
    fn with_component(self, axis: usize, value: f32) -> Self;
}

impl WithComponent for Vec3 {
    fn with_component(mut self, axis: usize, value: f32) -> Self {
        self[axis] = value;
        self
    }
}

/// The edge functions and depths of a triangle as the kernel has them, exactly (to `f64`): determinants of the vertices
/// in the plane across the ray, sheared along the axis on which its direction is longest.
fn exact_edges(origin: DVec3, direction: DVec3, p: [DVec3; 3]) -> ([f64; 3], [f64; 3]) {
    let a = direction.abs();
    let axis = if a.x > a.y && a.x > a.z {
        0
    } else if a.y > a.z && a.y >= a.x {
        1
    } else {
        2
    };
    let permute = |v: DVec3| DVec3::new(v[(axis + 1) % 3], v[(axis + 2) % 3], v[axis]);
    let d = permute(direction);
    let [a, b, c] = p.map(|p| {
        let p = permute(p - origin);
        DVec3::new(p.x - d.x / d.z * p.z, p.y - d.y / d.z * p.z, p.z / d.z)
    });
    let edge = |p: DVec3, q: DVec3| p.x * q.y - p.y * q.x;
    ([edge(c, b), edge(a, c), edge(b, a)], [a.z, b.z, c.z])
}

/// With L the greatest component of a vertex relative to the origin: a sheared coordinate is at most 2 L and off by
/// u L (difference) + 7 u L (shear's division, the depth's difference, an unfused product) + 2 u L (sum) = 10 u L; a
/// determinant by 2 x 2 x 2 L x 10 u L for its coordinates and 8 u L² for its own operations: 88 u L². Where every
/// edge function is farther from zero than this, hit or miss is decided. Depths are at most 1.8 L (the major component
/// of a unit vector is above 0.57), so that t is off by 3 x 88 u L² x 3.6 L / |det| and some 12 u L more, and a
/// barycentric coordinate by 4 x 88 u L² / |det| and some 12 u.
#[test]
fn triangle_hits_agree() {
    let mut numbers = Numbers::new(5);
    let mut items = Items::default();
    for i in 0..ITEMS {
        let scale = (numbers.unit() * 10.0 - 5.0).exp2();
        let p = [numbers.in_cube() * scale, numbers.in_cube() * scale, numbers.in_cube() * scale];
        let origin = numbers.in_cube() * 4.0 * scale;
        let (mut b1, mut b2) = (numbers.unit() * 1.4 - 0.2, numbers.unit() * 1.4 - 0.2);
        match i % 8 {
            0 => (b1, b2) = (0.0, 0.0),
            1 => b1 = 0.0,
            2 => b2 = 1.0 - b1,
            _ => {}
        }
        let target = p[0] + (p[1] - p[0]) * b1 + (p[2] - p[0]) * b2;
        let towards = if i % 16 == 15 { origin - target } else { target - origin };
        items.push_vectors(&[origin, towards.normalize(), p[0], p[1], p[2]]);
    }
    let (mut hits, mut misses, mut differing) = (0, 0, 0);
    for (input, outputs) in items.0.chunks(IN).zip(items.run(probe::TRIANGLE)) {
        let [origin, direction, p0, p1, p2] = [0, 3, 6, 9, 12].map(|i| dvec3(input, i));
        let (edges, depths) = exact_edges(origin, direction, [p0, p1, p2]);
        let det: f64 = edges.iter().sum();
        let size = [p0, p1, p2].map(|p| (p - origin).abs().max_element()).into_iter().fold(0.0, f64::max);
        let edge_bound = 88.0 * U * size * size;
        let t: f64 = edges.iter().zip(depths).map(|(e, z)| e * z).sum::<f64>() / det;
        let t_bound = 3.0 * edge_bound * 3.6 * size / det.abs() + 12.0 * U * 1.8 * size;
        let b_bound = 4.0 * edge_bound / det.abs() + 12.0 * U;
        let (low, high) = (edges.iter().any(|&e| e < -edge_bound), edges.iter().any(|&e| e > edge_bound));
        let inside = edges.iter().all(|&e| e > edge_bound) || edges.iter().all(|&e| e < -edge_bound);
        let hit = inside && t > t_bound;
        let missed = low && high || inside && t < -t_bound;
        hits += usize::from(hit);
        misses += usize::from(missed);
        for output in &outputs {
            let (got_t, b1, b2) = (float(output, 0), float(output, 1), float(output, 2));
            let what = (origin, direction, p0, p1, p2);
            assert!(!missed || got_t == f64::INFINITY, "{got_t}, but the triangle is missed: {what:?}");
            if hit {
                assert_near(got_t, t, t_bound, &what);
                assert_near(b1, edges[1] / det, b_bound, &what);
                assert_near(b2, edges[2] / det, b_bound, &what);
            }
        }
        let found = outputs.map(|output| float(&output, 0).is_finite());
        differing += usize::from(found[0] != found[1]);
    }
    assert!(hits > ITEMS / 8 && misses > ITEMS / 4, "{hits} hits, {misses} misses");
    // Three of eight rays aim at an edge, half of them within it: only of those should rounding decide, mostly alike.
    assert!(differing * 8 <= ITEMS, "{differing} rays differ");
}

/// A line and a patch, exactly: the quadratic for u, and what follows from a u.
struct ExactPatch {
    direction: DVec3,
    q00: DVec3,
    q10: DVec3,
    e00: DVec3,
    e11: DVec3,
}

impl ExactPatch {
    fn new(input: &[u32]) -> ExactPatch {
        let [origin, direction, q00, q10, q01, q11] = [0, 3, 6, 9, 12, 15].map(|i| dvec3(input, i));
        ExactPatch { direction, q00: q00 - origin, q10: q10 - origin, e00: q01 - q00, e11: q11 - q10 }
    }

    /// a, b and c of a + b u + c u².
    fn coefficients(&self) -> [f64; 3] {
        let m0 = self.direction.cross(self.e00);
        let dm = self.direction.cross(self.e11) - m0;
        let along = self.q10 - self.q00;
        [m0.dot(self.q00), m0.dot(along) + dm.dot(self.q00), dm.dot(along)]
    }

    /// The greatest magnitude of a term of a coefficient.
    fn size(&self) -> f64 {
        let longest = |a: DVec3, b: DVec3| a.length().max(b.length());
        self.direction.length() * longest(self.e00, self.e11) * longest(self.q00, self.q10)
    }

    /// t and v at u, and bounds on their errors: each is a quotient of a dot product by n² for n the cross product of
    /// direction and ruling, whose components are off by some 8 u of |d| |r|; some 8 u more for all else.
    fn on_ruling(&self, u: f64) -> ([f64; 2], [f64; 2]) {
        let start = self.q00 * (1.0 - u) + self.q10 * u;
        let ruling = self.e00 * (1.0 - u) + self.e11 * u;
        let n = self.direction.cross(ruling);
        let n2 = n.length_squared();
        let quotient = |v: DVec3| -n.cross(v).dot(start) / n2;
        // The start and the ruling are themselves rounded relative to the corners.
        let starts = self.q00.length() + self.q10.length();
        let rulings = self.e00.length() + self.e11.length();
        let d = self.direction.length();
        let skewness = 1.0 + d * rulings / n2.sqrt();
        let bound = |v: f64| 32.0 * U * v * starts / n2.sqrt() * skewness;
        ([quotient(ruling), quotient(self.direction)], [bound(rulings), bound(d)])
    }
}

/// Roots are judged by what they leave of the quadratic (their backward error), whatever its condition. Its
/// coefficients are sums of at most four determinants of size S, each off by 8 u S (an unfused cross product, a dot
/// product), and the polynomial of u in [0,1] by their sum; solving it adds the root's 9 u and the division's 5 u of
/// the coefficients: 160 u S in all. Roots of the exact quadratic that are farther than that from 0, 1 and each other
/// must be found.
#[test]
fn patch_hits_agree() {
    let mut numbers = Numbers::new(6);
    let mut items = Items::default();
    for i in 0..ITEMS {
        let mut corners = [numbers.in_cube(), numbers.in_cube(), numbers.in_cube(), numbers.in_cube()];
        if i % 2 == 0 {
            // Like the wall of a prism: almost a rectangle.
            corners[2] = corners[0] + Vec3::Y + numbers.in_cube() * 0.1;
            corners[3] = corners[1] + Vec3::Y + numbers.in_cube() * 0.1;
        }
        let origin = numbers.in_cube() * 3.0;
        let (u, v) = (numbers.unit(), numbers.unit());
        let target = corners[0].lerp(corners[1], u).lerp(corners[2].lerp(corners[3], u), v);
        let direction = (target - origin).normalize();
        items.push_vectors(&[origin, direction, corners[0], corners[1], corners[2], corners[3]]);
    }
    let (mut decided, mut counts_differ) = (0, 0);
    for (input, outputs) in items.0.chunks(IN).zip(items.run(probe::BILINEAR_PATCH)) {
        let patch = ExactPatch::new(input);
        let [a, b, c] = patch.coefficients();
        let residue_bound = 160.0 * U * patch.size();
        let hits = outputs.map(|output| {
            let hit = |i: usize| (output[i + 3] != 0).then(|| dvec3(&output, i));
            [hit(0), hit(4)].into_iter().flatten().collect::<Vec<DVec3>>()
        });
        for &hit in hits.iter().flatten() {
            let (t, u, v) = (hit.x, hit.y, hit.z);
            assert!((0.0..=1.0).contains(&u), "{u}");
            assert_near(a + u * (b + u * c), 0.0, residue_bound, &(a, b, c, u));
            let ([exact_t, exact_v], [t_bound, v_bound]) = patch.on_ruling(u);
            assert_near(t, exact_t, t_bound, &(u, input));
            assert_near(v, exact_v, v_bound, &(u, input));
        }
        let discriminant = b * b - 4.0 * a * c;
        if discriminant > 0.0 {
            // Near a root the quadratic is as steep as the root of its discriminant: so far can the root be off.
            let slope = discriminant.sqrt();
            let margin = 4.0 * residue_bound / slope;
            let q = -0.5 * (b + slope.copysign(b));
            for root in [q / c, a / q] {
                let apart = slope / c.abs() > 4.0 * margin;
                if apart && root > margin && root < 1.0 - margin {
                    decided += 1;
                    for hits in &hits {
                        let found = hits.iter().any(|hit| (hit.y - root).abs() <= margin);
                        assert!(found, "no hit at {root} +- {margin:e}: {hits:?}");
                    }
                }
            }
        }
        counts_differ += usize::from(hits[0].len() != hits[1].len());
    }
    assert!(decided > ITEMS / 2, "only {decided} roots are decided");
    assert!(counts_differ * 1000 < ITEMS, "{counts_differ} patches are met differently often");
}

/// A coordinate times N rounds once, and so does the sum that tells upper from lower cells: 2 u N. Where the point is
/// farther from its cell's border, the cell is decided. A grid weight is one division: 5 u.
#[test]
fn cells_agree() {
    let mut numbers = Numbers::new(7);
    let mut items = Items::default();
    for i in 0..ITEMS {
        let n = 1 + numbers.word() % if i % 2 == 0 { 16 } else { 4096 };
        let (mut beta, mut gamma) = (numbers.unit(), numbers.unit());
        if beta + gamma > 1.0 {
            (beta, gamma) = (1.0 - beta, 1.0 - gamma);
        }
        match i % 8 {
            // Grid points and beyond the triangle: brought to a cell at its border.
            0 => (beta, gamma) = ((numbers.word() % (n + 1)) as f32 / n as f32, 0.0),
            1 => (beta, gamma) = (numbers.unit() * 3.0 - 1.0, numbers.unit() * 3.0 - 1.0),
            _ => {}
        }
        items.push(&[beta.to_bits(), gamma.to_bits(), n]);
    }
    let mut differing = 0;
    for (input, [device, cpu]) in items.0.chunks(IN).zip(items.run(probe::CELL)) {
        let n = input[2];
        let bound = 2.0 * U * f64::from(n);
        let (x, y) = (float(input, 0) * f64::from(n), float(input, 1) * f64::from(n));
        let off_grid = |x: f64| (x - x.round()).abs() > bound;
        let decided = off_grid(x) && off_grid(y) && off_grid(x + y);
        assert!(device[0] == cpu[0] || !decided, "{x} {y} of {n}: {device:?} {cpu:?}");
        differing += usize::from(device[0] != cpu[0]);
        for output in [device, cpu] {
            let cell = Cell::unpack(output[0]);
            assert!(cell.j + cell.k + u32::from(cell.upper) < n, "{cell:?} is not in the grid of {n}");
            if decided && x > 0.0 && y > 0.0 && x + y < f64::from(n) {
                let exact = (x.floor(), y.floor(), x.fract() + y.fract() > 1.0);
                assert_eq!((f64::from(cell.j), f64::from(cell.k), cell.upper), exact, "{x} {y} of {n}");
            }
            let (j, k) = cell.vertex(0);
            for (i, m) in [n - j - k, j, k].into_iter().enumerate() {
                let (weight, truth) = (float(&output, i + 1), f64::from(m) / f64::from(n));
                assert_near(weight, truth, if m == 0 || m == n { 0.0 } else { 5.0 * U * truth }, &(m, n));
            }
        }
    }
    assert!(differing * 100 < ITEMS, "{differing} cells differ");
}

/// `Fma` rounds once or twice. The difference of products is within 1.5 ulp where it is fused, and otherwise off by a
/// rounding of each product and of the result; its sign is what triangles at an edge share: it must be opposite when
/// the products are exchanged.
#[test]
fn arithmetic_agrees_and_keeps_its_sign() {
    let mut numbers = Numbers::new(8);
    let mut items = Items::default();
    for i in 0..ITEMS {
        let (a, b) = (numbers.wide(), numbers.wide());
        let (c, d) = if i % 2 == 0 {
            (numbers.wide(), numbers.wide())
        } else {
            // Nearly equal products: only their sign is left.
            (a * (1.0 + numbers.unit() * 1e-6), b * (1.0 - numbers.unit() * 1e-6))
        };
        items.push_floats(&[a, b, c, d]);
        items.push_floats(&[c, d, a, b]);
    }
    let outputs = items.run(probe::ARITHMETIC);
    for (input, outputs) in items.0.chunks(IN).zip(&outputs) {
        let [a, b, c, d] = [0, 1, 2, 3].map(|i| float(input, i));
        let (sum, difference) = (a * b + c, a * b - c * d);
        for output in outputs {
            let sum_bound = U * ((a * b).abs() + sum.abs()) * (1.0 + U);
            assert_near(float(output, 0), sum, sum_bound, &input);
            let bound = U * ((a * b).abs() + (c * d).abs() + difference.abs()) * (1.0 + 2.0 * U);
            assert_near(float(output, 1), difference, bound, &input);
        }
    }
    for pair in outputs.chunks(2) {
        for (there, back) in pair[0].iter().zip(&pair[1]) {
            let (there, back) = (float(there, 1), float(back, 1));
            assert_eq!(there.partial_cmp(&0.0), 0.0.partial_cmp(&back), "{there} and {back}");
        }
    }
}

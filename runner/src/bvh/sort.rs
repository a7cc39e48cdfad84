//! stub until the sort lands
use emboss_kernels::parallel::{Word, Workgroup};
use emboss_kernels::bvh::scan as kernel;
pub(crate) fn sort_pairs(keys: &[Word], values: &[Word], limbs: u32, count: u32, _bits: u32) {
    let n = count as usize;
    let mut v: Vec<(u64, u32)> = (0..n).map(|i| ((if limbs == 2 { u64::from(keys[n + i].get()) << 32 } else { 0 }) | u64::from(keys[i].get()), values[i].get())).collect();
    v.sort_by_key(|p| p.0);
    for (i, (k, p)) in v.into_iter().enumerate() { keys[i].set(k as u32); if limbs == 2 { keys[n + i].set((k >> 32) as u32); } values[i].set(p); }
}
pub(crate) fn scan(values: &[Word], count: u32) {
    let mut shared = [0; 2 * kernel::GROUP_SIZE as usize];
    kernel::scan_serially(Workgroup::new(0), &mut shared, values, count);
}

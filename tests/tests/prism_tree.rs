//! The stored form of the exact method on the CPU: it finds what the quadtree finds that stores nothing.

use emboss::backend::cpu::CpuBackend;
use emboss_tests::bounds::assert_stored_bounds_do_not_show;

#[test]
fn stored_bounds_do_not_show() {
    let ns = [1, 2, 3, 4, 5, 7, 8, 9, 16, 17, 33, 64];
    assert_stored_bounds_do_not_show(&mut CpuBackend::new(), &ns, 300);
}

//! The same as `prism_tree.rs` on lavapipe.

use emboss_tests::bounds::assert_stored_bounds_do_not_show;
use emboss_tests::long::on_device;

#[test]
fn stored_bounds_do_not_show() {
    on_device(|backend| assert_stored_bounds_do_not_show(backend, &[4, 17], 60));
}

//! What is said of pictures that show nothing of what was meant, on lavapipe.

use emboss_tests::long::on_device;
use emboss_tests::reports;

#[test]
fn useless_pictures_are_found() {
    on_device(|backend| {
        reports::assert_empty_pictures_are_found(backend);
        reports::assert_cameras_in_relief_are_found(backend);
    });
}

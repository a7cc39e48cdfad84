//! `emboss devices --check` on lavapipe, and on whatever device the [long mode](emboss_tests::long) names.

use emboss::check::{Finding, Verdict, check};
use emboss_tests::long::{is_long, on_device};

/// Lavapipe has one fault, its loops; a card has none that this project knows.
#[test]
fn what_devices_do_is_what_error_bounds_assume() {
    on_device(|backend| {
        let findings = check(backend).expect("the device answers");
        let text: Vec<String> = findings.iter().map(Finding::to_string).collect();
        let text = text.join("\n");
        let failures: Vec<&str> = findings.iter().filter(|f| f.fails()).map(|f| f.matter).collect();
        let known: &[&str] = if is_long() { &[] } else { &["loops"] };
        assert_eq!(failures, known, "\n{text}");
        let found = |matter| findings.iter().find(|finding| finding.matter == matter).expect("is looked at");
        assert_eq!(found("denormals").verdict, Verdict::Noted);
        if !is_long() {
            assert_eq!(found("fma").found, "rounds twice");
            assert_eq!(found("loops").found, "end after 65535 turns");
            // Signs that a plain difference of products leaves open: 5 % of such products.
            let resolved = found("signs").found.rsplit(' ').nth(4).expect("a number").parse::<u32>();
            assert!(resolved.is_ok_and(|resolved| resolved > 1000), "{text}");
        }
    });
}

//! The accuracy test of the paper on a real scan.

use crate::common;

#[test]
fn a_real_scan_gives_the_papers_accuracy_and_three_scales_a_third_of_the_error() {
    let Some(data) = common::shared_data() else { return };
    let model = cfreg::io::read(data.join("stanford_bunny/bun000.ply")).unwrap().into();
    let settings = cfreg_paper::accuracy::AccuracySettings { trials: 30, ..Default::default() };
    let mean = |name: &str| {
        let method: cfreg::method::Method = name.parse().unwrap();
        let report = cfreg_paper::accuracy::run(&model, &method, settings, |_| {}).unwrap();
        assert_eq!(report.failures(), 0, "{name}");
        report.statistics(|error| error.rotation_frobenius).0
    };
    let (paper, three) = (mean("cf"), mean("cf-multiscale"));
    // Table II, bunny, large rotation: 0.18 ± 0.14.
    assert!(paper < 0.18 + 0.14, "{paper}");
    assert!(three < paper / 3.0, "{three} {paper}");
}

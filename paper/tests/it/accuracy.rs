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

#[test]
fn a_command_without_an_answer_exits_with_2_and_names_the_cause() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, points: usize| {
        let line = |i: usize| format!("{} {} 5\n", i % 30, i / 30);
        let text: String = (0..points).map(line).collect();
        std::fs::write(folder.path().join(name), text).unwrap();
    };
    write("two.xyz", 2);
    write("plane.xyz", 900);
    for (line, cause) in [
        ("accuracy two.xyz", "500"),
        ("accuracy plane.xyz --trials 0", "trials"),
        ("accuracy plane.xyz --points 2", "points"),
        ("accuracy plane.xyz --set neighbors", "NAME=VALUE"),
        ("accuracy missing.xyz", "missing.xyz"),
    ] {
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_cfreg-paper"))
            .current_dir(folder.path())
            .args(line.split_whitespace())
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{line}: {said}");
        assert!(said.contains(cause), "{line}: {said}");
    }
}

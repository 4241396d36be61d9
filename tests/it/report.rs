//! Pages of registrations, as the command line writes them.

use std::fs;
use std::path::Path;
use std::process::Output;

use serde_json::Value;
use std::process::Command;
use tempfile::TempDir;

fn cfreg(folder: &Path, words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_cfreg")).current_dir(folder).args(words).output().unwrap()
}

fn line(folder: &Path, line: &str) -> Output {
    cfreg(folder, &line.split_whitespace().collect::<Vec<_>>())
}

fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

/// A folder with the demo's clouds in `pair`.
fn demo() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let output = line(folder.path(), "demo --write pair");
    assert!(output.status.success(), "{}", stderr(&output));
    folder
}

/// A page; slashes as they are meant.
fn read(folder: &Path, file: &str) -> String {
    fs::read_to_string(folder.join(file)).unwrap().replace("&#x2f;", "/")
}

/// What the scripts of a page are given.
fn data(page: &str) -> Value {
    let (_, rest) = page.split_once("<script type=\"application/json\" id=\"data\">").unwrap();
    serde_json::from_str(rest.split_once("</script>").unwrap().0).unwrap()
}

#[test]
fn a_page_says_what_was_found_and_needs_no_network() {
    let folder = demo();
    let register = "register pair/source.pcd pair/target.pcd --voxel 0.05 --json --report out.html";
    let output = line(folder.path(), register);
    assert!(output.status.success(), "{}", stderr(&output));
    let answer: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(answer["command"], format!("cfreg {register}"));
    let page = read(folder.path(), "out.html");
    for words in ["Take this pose", "Right with a probability of", "source.pcd", register] {
        assert!(page.contains(words), "{words}");
    }
    // Every number of the pose, to its last digit.
    for number in answer["transform"].as_array().unwrap().iter().flat_map(|r| r.as_array().unwrap())
    {
        assert!(page.contains(&format!("{:?}", number.as_f64().unwrap() + 0.0)), "{number}");
    }
    for reason in answer["verdict"]["reasons"].as_array().unwrap() {
        let reason = reason.as_str().unwrap();
        assert!(page.contains(&reason[1..]), "{reason}");
    }
    assert!(!page.contains("src=\"http") && !page.contains("href=\"http"));
    let (head, _) = page.split_once("<script type=\"application/json\"").unwrap();
    assert!(head.contains("default-src 'none'"));
    // Of 321 kB no more than 41 are scripts.
    assert!(page.len() < 400_000, "{}", page.len());
    let view = data(&page);
    assert_eq!(view["source"]["shown"], answer["points"]["source"]["used"]);
    assert!(view["weights"]["right"].as_u64().unwrap() > 20);
    assert_eq!(view["stands"][1]["name"], "after");
    // The same again, but for the times.
    let again = line(folder.path(), &register.replace("out.html", "again.html"));
    assert!(again.status.success());
    assert_eq!(data(&read(folder.path(), "again.html")), view);
}

#[test]
fn names_with_markup_do_no_harm() {
    let folder = demo();
    // A folder `<` and a file within: together they close a script.
    fs::create_dir(folder.path().join("<")).unwrap();
    let name = "</script><img src=x onerror=\"document.title='harmed'\">'.pcd";
    fs::copy(folder.path().join("pair/source.pcd"), folder.path().join(name)).unwrap();
    let words =
        ["register", name, "pair/target.pcd", "--voxel", "0.05", "--report", "out.html", "--json"];
    let output = cfreg(folder.path(), &words);
    assert!(output.status.success(), "{}", stderr(&output));
    let page = read(folder.path(), "out.html");
    assert!(!page.contains("<img src=x"), "the name is markup");
    assert!(page.contains("&lt;img src&#x3d;x") || page.contains("&lt;img src=x"));
    // Two scripts end: data and code.
    assert_eq!(page.matches("</script>").count(), 2);
    fs::write(
        folder.path().join("list.csv"),
        format!(
            "source,target\n\"{}\",pair/target.pcd\nnone<b>.ply,pair/target.pcd\n",
            name.replace('"', "\"\"")
        ),
    )
    .unwrap();
    let output = line(folder.path(), "batch list.csv -o rows.csv --voxel 0.05");
    assert!(output.status.success(), "{}", stderr(&output));
    let output = line(folder.path(), "report rows.csv");
    assert!(output.status.success(), "{}", stderr(&output));
    let index = read(folder.path(), "rows-report/index.html");
    assert!(!index.contains("<img src=x") && !index.contains("<b>"));
    assert_eq!(index.matches("</script>").count(), 1);
}

#[test]
fn a_kept_result_is_shown_while_its_clouds_are_there() {
    let folder = demo();
    let output = line(
        folder.path(),
        "register pair/source.pcd pair/target.pcd --method cf --sample 700 --seed 3 --json --report at-once.html",
    );
    fs::write(folder.path().join("kept.json"), &output.stdout).unwrap();
    let output = line(folder.path(), "report kept.json --figure kept.svg");
    assert!(output.status.success(), "{}", stderr(&output));
    let (kept, once) = (read(folder.path(), "kept.html"), read(folder.path(), "at-once.html"));
    assert_eq!(data(&kept), data(&once));
    assert_eq!(data(&kept)["source"]["shown"], 700);
    assert!(read(folder.path(), "kept.svg").starts_with("<svg"));
    // From elsewhere it finds them beside the result.
    let elsewhere = tempfile::tempdir().unwrap();
    let path = folder.path().join("kept.json");
    let output = cfreg(elsewhere.path(), &["report", path.to_str().unwrap(), "-o", "here.html"]);
    assert!(output.status.success(), "{}", stderr(&output));

    let failed = |words: &str, cause: &str| {
        let output = line(folder.path(), words);
        assert_eq!(output.status.code(), Some(2), "{words}");
        assert!(stderr(&output).contains(cause), "{words}: {}", stderr(&output));
    };
    failed("report kept.json -o pair/source.pcd", "overwrite");
    failed("report kept.json --figure kept.gif", "must end in .png or .svg");
    failed("report none.json", "none.json");
    fs::write(folder.path().join("other.json"), "{\n\"transform\": 3}").unwrap();
    failed("report other.json", "other.json, line 2: is not what `cfreg register --json` prints");
    fs::copy(folder.path().join("pair/target.pcd"), folder.path().join("target")).unwrap();
    let output = line(folder.path(), "convert target pair/target.pcd --sample 600");
    assert!(output.status.success(), "{}", stderr(&output));
    failed("report kept.json", "has the file changed?");
    fs::remove_file(folder.path().join("pair/target.pcd")).unwrap();
    failed("report kept.json", "names the cloud pair/target.pcd, which is neither at that path");
    failed("register target pair/source.pcd --report no/out.html", "does not exist");
    failed("register target pair/source.pcd --figure out.jpeg", "must end in .png or .svg");
    failed("register target pair/source.pcd --report target", "overwrite");
}

#[test]
fn a_wrong_pose_and_other_methods_have_pages_too() {
    let folder = demo();
    fs::write(folder.path().join("line.xyz"), {
        let point = |k: u32| format!("{} {} {}\n", k % 40, k / 40, (k * k) % 7);
        (0..1600).map(point).collect::<String>()
    })
    .unwrap();
    let output =
        line(folder.path(), "register pair/source.pcd line.xyz --voxel 0.5 --report a.html");
    assert_ne!(output.status.code(), Some(0));
    if output.status.code() == Some(1) {
        assert!(read(folder.path(), "a.html").contains("Do not take this pose"));
    }
    for (method, words) in [
        ("icp", "connects points by where the pose puts them"),
        ("cf-spectral", "Weights by descriptors (left), and by the connections"),
        ("cfk", "Every point with every point"),
        ("teaser", "points that look most alike"),
        ("cf --refine icp", "Every point with every point"),
    ] {
        let register =
            format!("register pair/source.pcd pair/target.pcd --sample 900 --method {method}");
        let output = line(folder.path(), &format!("{register} --report b.html --figure b.png"));
        assert_ne!(output.status.code(), Some(2), "{method}: {}", stderr(&output));
        assert!(read(folder.path(), "b.html").contains(words), "{method}");
        assert!(fs::read(folder.path().join("b.png")).unwrap().starts_with(b"\x89PNG"));
    }
}

#[test]
fn lists_are_tables_with_the_worst_first() {
    let folder = demo();
    let list = "source,target\npair/source.pcd,pair/target.pcd\npair/source.pcd,none.pcd\n";
    fs::write(folder.path().join("list.csv"), list).unwrap();
    for end in ["csv", "jsonl", "parquet"] {
        let output = line(folder.path(), &format!("batch list.csv -o rows.{end} --voxel 0.05"));
        assert!(output.status.success(), "{}", stderr(&output));
        let output = line(folder.path(), &format!("report rows.{end} -o {end}"));
        assert!(output.status.success(), "{}", stderr(&output));
        let index = read(folder.path(), &format!("{end}/index.html"));
        let (wrong, right) = (index.find("no answer").unwrap(), index.find(">accept<").unwrap());
        assert!(wrong < right && index.contains("none.pcd"), "{end}");
        assert!(index.contains("href=\"pairs/00000.html\"") && !index.contains("00001.html"));
        assert!(index.contains("2 pairs: 1 poses to use, 0 with warnings, 1 without a pose."));
        let page = read(folder.path(), &format!("{end}/pairs/00000.html"));
        assert!(page.contains("Take this pose"));
    }
    let truth = cfreg::io::read_transform(folder.path().join("pair/truth.txt")).unwrap().matrix();
    let numbers: Vec<String> = truth.as_flattened().iter().map(f64::to_string).collect();
    let titles: Vec<String> = (0..16).map(|k| format!("t{}{}", k / 4, k % 4)).collect();
    let list = format!(
        "dataset,source,target,{}\ndemo,pair/source.pcd,pair/target.pcd,{}\n",
        titles.join(","),
        numbers.join(",")
    );
    fs::write(folder.path().join("known.csv"), list).unwrap();
    let benchmark = "benchmark known.csv --method icp --method consensus --report pages";
    let output = line(folder.path(), benchmark);
    assert!(output.status.success(), "{}", stderr(&output));
    let index = read(folder.path(), "pages/index.html");
    // From a random motion icp is wrong.
    assert!(index.find(">wrong<").unwrap() < index.find(">right<").unwrap());
    assert!(index.contains("Probabilities told") && index.contains("<svg"));
    let page = read(folder.path(), "pages/pairs/00001.html");
    assert!(page.contains("The true pose"));
    let places = data(&page)["stands"].as_array().unwrap().clone();
    let place = |name: &str| {
        let stand = places.iter().find(|stand| stand["name"] == name).unwrap();
        stand["matrix"][0][0].as_f64().unwrap()
    };
    assert!((place("truth") - place("after")).abs() < 0.05);
}

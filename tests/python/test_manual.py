"""The manual and the README: their examples run, their options and links exist."""

import contextlib
import importlib.util
import io
import os
import re
import tempfile
import unittest
from pathlib import Path

import cfreg
import numpy as np
from shapes import terrain, turned

REPOSITORY = Path(__file__).resolve().parents[2]
README = REPOSITORY / "README.md"
PAGES = sorted((REPOSITORY / "docs").rglob("*.md"))
COMMANDS = REPOSITORY / "docs/reference/command_line.md"
FENCED = re.compile(r"^```(\S*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
OPTION = re.compile(r"(?<![\w-])(-[a-z]|--[a-z][a-z-]*)(?![\w-])")


def blocks(page, language):
    """The fenced blocks of a page in a language."""
    found = FENCED.findall(page.read_text(encoding="utf-8"))
    return [text for kind, text in found if kind.split(",")[0] == language]


def documented_options():
    """The options of every command, by its name: `pairs sequence`."""
    sections = re.split(r"^## cfreg ?", COMMANDS.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    return {section.split("\n", 1)[0].strip(): set(OPTION.findall(section)) for section in sections}


class Examples(unittest.TestCase):
    def run_page(self, page):
        """Runs the Python blocks of a page, in order and with the same names; gives what they print."""
        source, (target, matrix) = terrain(700, seed=1), turned(terrain(700))
        names = {"source": source, "target": target}
        before = os.getcwd()
        with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()) as shown:
            os.chdir(folder)
            try:
                os.makedirs("data/scans")
                for name, cloud in [("source", source), ("target", target), ("data/scans/bun000", source), ("data/scans/bun045", target)]:
                    cfreg.write(f"{name}.ply", cloud)
                for code in blocks(page, "python"):
                    if "matplotlib" in code:
                        if not importlib.util.find_spec("matplotlib"):
                            continue
                        os.environ["MPLBACKEND"] = "Agg"
                        own = {}
                        exec(compile(code, page.name, "exec"), own)
                        self.assertGreater(Path("aligned.png").stat().st_size, 1000)
                        self.assertLess(np.linalg.norm(own["found"].transform - matrix), 0.5)
                    else:
                        exec(compile(code, page.name, "exec"), names)
            finally:
                os.chdir(before)
        if "found" in names:
            self.assertLess(np.linalg.norm(names["found"].transform - matrix), 0.5)
        return names, shown.getvalue()

    def test_the_blocks_of_the_manual_run(self):
        run = 0
        for page in PAGES:
            with self.subTest(page.name):
                run += len(blocks(page, "python"))
                self.run_page(page)
        self.assertGreaterEqual(run, 9)

    def test_the_tour_gives_the_pose_and_the_moved_cloud(self):
        names, shown = self.run_page(REPOSITORY / "docs/quick_start.md")
        _, (_, matrix) = terrain(700, seed=1), turned(terrain(700))
        self.assertIn("accept, probability", shown)
        self.assertLess(np.linalg.norm(names["pose"] - matrix), 0.5)
        self.assertEqual(names["aligned"].shape, (700, 3))

    def test_the_readmes_block_runs(self):
        [block] = blocks(README, "python")
        self.assertLessEqual(len([line for line in block.splitlines() if line.strip()]), 5)
        names, shown = self.run_page(README)
        self.assertIn("accept, probability", shown)
        self.assertEqual(len(names["aligned"]), 700)

    def test_a_picture_takes_ten_lines(self):
        [lines, *_] = blocks(REPOSITORY / "docs/from_open3d.md", "python")
        self.assertLessEqual(len(lines.strip().splitlines()), 10)


class Options(unittest.TestCase):
    def test_the_reference_has_the_commands(self):
        options = documented_options()
        self.assertLessEqual({"register", "evaluate", "batch", "pairs near", "graph"}, set(options))
        self.assertLessEqual({"--voxel", "--verdict-model", "--json"}, options["register"])

    def test_options_in_shell_blocks_exist(self):
        options, lines = documented_options(), 0
        for page in [README, *PAGES]:
            for block in blocks(page, "sh"):
                for line in block.splitlines():
                    if not line.startswith("cfreg "):
                        continue
                    words = line.split("#")[0].split()[1:]
                    command = next(name for name in (" ".join(words[:2]), words[0]) if name in options)
                    unknown = set(OPTION.findall(line.split("#")[0])) - options[command]
                    self.assertFalse(unknown, f"{page.name}: {line}")
                    lines += 1
        self.assertGreater(lines, 25)

    def test_options_in_sentences_exist(self):
        known = set().union(*documented_options().values())
        for page in [README, *PAGES]:
            text = FENCED.sub("", page.read_text(encoding="utf-8"))
            for code in re.findall(r"`((?:cfreg |-)[^`\n]*)`", text):
                unknown = set(OPTION.findall(code)) - known
                self.assertFalse(unknown, f"{page.name}: {code}")


class Pages(unittest.TestCase):
    def test_every_block_has_a_language(self):
        """A block without one would be taken for Rust by the documentation of the crate."""
        for page in [README, *PAGES]:
            for kind, text in FENCED.findall(page.read_text(encoding="utf-8")):
                self.assertTrue(kind, f"{page.name}: {text}")

    def test_blocks_of_rust_are_tested(self):
        """A page with Rust is named in src/lib.rs."""
        library = (REPOSITORY / "src/lib.rs").read_text(encoding="utf-8")
        for page in [README, *PAGES]:
            if blocks(page, "rust"):
                self.assertIn(f'include_str!("../{page.relative_to(REPOSITORY).as_posix()}")', library)

    def test_links_of_the_readme_lead_somewhere(self):
        text = README.read_text(encoding="utf-8")
        for link in re.findall(r"\]\(([^)#]+)[^)]*\)", text):
            self.assertTrue((REPOSITORY / link).exists(), link)
        self.assertLessEqual(len(text.splitlines()), 120)

    def test_files_named_in_the_manual_exist(self):
        """Paths of the repository in code: `python-ref/verdict/verdict.sh`."""
        roots = "benches|data|docs|fuzz|paper|python|python-ref|src|tests"
        for page in [README, *PAGES]:
            text = page.read_text(encoding="utf-8")
            for path in re.findall(rf"(?<![\w./-])((?:{roots})/[\w./-]*\w\.(?:md|py|sh|rs|json|csv|pdf|png))", text):
                if not path.startswith("data/scans/"):
                    self.assertTrue((REPOSITORY / path).exists(), f"{page.name}: {path}")


if __name__ == "__main__":
    unittest.main()

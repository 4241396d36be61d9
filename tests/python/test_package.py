"""The package as a whole: examples in docstrings, types, what importing costs."""

import dataclasses
import doctest
import importlib.util
import inspect
import subprocess
import sys
import unittest
from pathlib import Path

import cfreg
from cfreg import _native, batch_results, methods, pairs, results, weights

HERE = Path(cfreg.__file__).parent


def documented():
    """Every public class and function, by name."""
    for name in cfreg.__all__:
        thing = getattr(cfreg, name)
        if not name.startswith("_") and (inspect.isclass(thing) or callable(thing)):
            yield name, thing
    for name in weights.__all__:
        if callable(getattr(weights, name)):
            yield f"weights.{name}", getattr(weights, name)


class Documentation(unittest.TestCase):
    def test_examples_run(self):
        finder, runner = doctest.DocTestFinder(), doctest.DocTestRunner(verbose=False)
        examples = 0
        modules = {"cfreg": cfreg, "weights": weights, "methods": methods, "results": results, "pairs": pairs}
        modules |= {"batch_results": batch_results, "register_batch": cfreg.register_batch}
        compiled = {name: getattr(_native, name) for name in dir(_native)}
        for name, thing in (modules | compiled).items():
            for test in finder.find(thing, name, globs={}):
                examples += runner.run(test).attempted
        self.assertEqual(runner.summarize().failed, 0)
        self.assertGreater(examples, 50)

    def test_everything_public_is_documented(self):
        for name, thing in documented():
            with self.subTest(name):
                self.assertGreater(len(inspect.getdoc(thing) or ""), 10)
                if isinstance(thing, type) and not issubclass(thing, Exception):
                    for member, value in vars(thing).items():
                        if not member.startswith("_") and (callable(value) or isinstance(value, property)):
                            self.assertTrue(inspect.getdoc(value), f"{name}.{member}")

    def test_fields_of_methods_are_explained(self):
        for name, make in cfreg.METHODS.items():
            kind = type(make())
            told = " ".join(inspect.getdoc(base) or "" for base in kind.__mro__)
            for field in (field.name for field in dataclasses.fields(kind)):
                # What threads mean is said once, for all.
                if field != "threads":
                    self.assertIn(field, told, f"{kind.__name__}.{field}")


@unittest.skipUnless(importlib.util.find_spec("mypy"), "mypy is not installed")
class Types(unittest.TestCase):
    def run_mypy(self, *arguments):
        done = subprocess.run([sys.executable, "-m", *arguments], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)

    def test_the_stub_is_the_module(self):
        self.run_mypy("mypy.stubtest", "cfreg")

    def test_the_package_is_typed_throughout(self):
        self.assertTrue((HERE / "py.typed").exists())
        self.run_mypy("mypy", "--strict", "--package", "cfreg")


class Importing(unittest.TestCase):
    def test_it_costs_little(self):
        """Less than a tenth of a second beyond numpy, the best of five."""
        program = (
            "import numpy, time; begun = time.perf_counter(); import cfreg;"
            "print(time.perf_counter() - begun)"
        )
        runs = [subprocess.check_output([sys.executable, "-c", program]) for _ in range(5)]
        self.assertLess(min(map(float, runs)), 0.1)

    def test_it_needs_nothing_but_numpy(self):
        program = (
            "import sys, numpy; before = set(sys.modules); import cfreg;"
            "new = {name.split('.')[0] for name in set(sys.modules) - before};"
            "print(*new - set(sys.stdlib_module_names))"
        )
        found = subprocess.check_output([sys.executable, "-c", program], text=True)
        self.assertEqual(found.split(), ["cfreg"])


if __name__ == "__main__":
    unittest.main()

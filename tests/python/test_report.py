"""Pages and pictures of results."""

import pickle
import tempfile
import unittest
from pathlib import Path

import cfreg
import numpy as np
from shapes import terrain, turned


class Report(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.source, (cls.target, _) = terrain(800, seed=1), turned(terrain(800, seed=2))
        cls.found = cfreg.register(cls.source, cls.target)

    def page(self, found, *clouds):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "out.html"
            found.report(path, *clouds)
            return path.read_text(encoding="utf-8")

    def test_a_page_has_the_verdict(self):
        page = self.page(self.found)
        self.assertTrue(page.startswith("<!doctype html>"))
        self.assertIn("Take this pose", page)
        self.assertIn(self.found.verdict.reasons[0][1:], page)

    def test_clouds_are_given_where_they_are_not_known(self):
        again = pickle.loads(pickle.dumps(self.found))
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "never.html"
            for found, clouds in ((again, ()), (self.found, (self.source,))):
                with self.assertRaisesRegex(cfreg.SettingError, "give both"):
                    found.report(path, *clouds)
                self.assertFalse(path.exists())
        self.assertEqual(self.page(again, self.source, self.target), self.page(self.found))

    def test_own_weights_are_not_made_up(self):
        own = cfreg.register(self.source, self.target, "cf", weights=lambda d2: 1 / (1 + d2))
        page = self.page(own)
        self.assertNotIn("Every point with every point", page)

    def test_notebooks_show_the_clouds_where_they_are_known(self):
        self.assertIn("data:image/png;base64,", self.found._repr_html_())
        self.assertNotIn("<img", pickle.loads(pickle.dumps(self.found))._repr_html_())

    def test_arrays_that_were_spoilt_leave_the_table(self):
        source = self.source.copy()
        found = cfreg.register(source, self.target)
        source[:] = np.nan
        self.assertIn("<table>", found._repr_html_())


if __name__ == "__main__":
    unittest.main()

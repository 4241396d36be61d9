"""Pages of registrations, as a person sees them: pixels, not only what stands in the file."""

import unittest

import numpy as np
from pages import Browser, Folder, needed, run

ORANGE, BLUE = np.array([230, 159, 0]), np.array([0, 114, 178])


def share(pixels, colour):
    """Share of the pixels of a colour, lit or in shade."""
    length = np.linalg.norm(pixels, axis=2)
    along = pixels @ (colour / np.linalg.norm(colour))
    return float(np.mean((length > 40) & (along > 0.985 * length)))


def changed(before, after):
    """Share of the pixels that differ."""
    return float(np.mean(np.abs(before - after).max(axis=2) > 40))


class Page(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        needed()
        cls.folder = Folder()
        cls.addClassCleanup(cls.folder.remove)
        source, target = cls.folder.scans()
        run(cls.folder.path, "register", source, target, "--report", "right.html")
        cls.browser = Browser()
        cls.addClassCleanup(cls.browser.quit)

    def setUp(self):
        self.browser.size(1200, 900)
        self.browser.prefer(prefers_color_scheme="light", prefers_reduced_motion="no-preference")

    def open(self, name="right.html"):
        self.browser.open(self.folder.path / name)

    def quiet(self):
        console, asked = self.browser.logs()
        self.assertEqual((console, asked), ([], []))

    def text(self, selector):
        return self.browser.driver.find_element("css selector", selector).text

    def test_it_draws_both_clouds_and_moves_the_source(self):
        self.open()
        self.assertEqual(self.text("#decision"), "Take this pose")
        self.assertIn("probability of more than 99", self.text(".verdict"))
        after = self.browser.pixels()
        for colour in (ORANGE, BLUE):
            self.assertGreater(share(after, colour), 0.02)
        self.browser.click("input[name=stand][value='0']")
        before = self.browser.pixels()
        self.assertGreater(changed(after, before), 0.05)
        # Apart, each is seen alone: more of the source than where the target covers it.
        self.assertGreater(share(before, ORANGE), 0.02)
        self.browser.press("a")
        self.assertLess(changed(after, self.browser.pixels()), 0.005)
        self.quiet()

    def test_colours_keys_and_connections(self):
        self.open()
        plain = self.browser.pixels()
        self.browser.press("c")
        self.assertIn("on the other", self.text("#legend"))
        residuals = self.browser.pixels()
        self.assertGreater(changed(plain, residuals), 0.05)
        self.assertLess(share(residuals, ORANGE), 0.2 * share(plain, ORANGE))
        self.browser.press("c")
        self.assertGreater(changed(residuals, self.browser.pixels()), 0.02)
        self.browser.press("c")
        self.browser.press("b")
        apart = self.browser.pixels()
        self.browser.press("l")
        self.assertGreater(changed(apart, self.browser.pixels()), 0.005)
        self.browser.press("l")
        self.browser.press("t")
        self.assertLess(share(self.browser.pixels(), BLUE), 0.001)
        self.browser.driver.find_element("css selector", "#canvas").send_keys("\ue014\ue014\ue014+")
        self.assertGreater(changed(apart, self.browser.pixels()), 0.05)
        self.quiet()

    def test_matrix_heat_map_and_copies(self):
        self.open()
        heat = self.browser.pixels("#heat")
        self.browser.click("input[name=order][value=looks]")
        self.assertGreater(changed(heat, self.browser.pixels("#heat")), 0.001)
        diagonal = [heat[k * heat.shape[0] // 100, k * heat.shape[1] // 100].sum() for k in range(1, 100)]
        self.assertGreater(np.mean(diagonal), 1.1 * heat.sum(axis=2).mean())
        rows = self.text(".matrix").splitlines()
        self.assertEqual((len(rows), len(rows[0].split())), (4, 4))
        copied = self.browser.script("document.querySelector('.poses [data-copy]').dataset.copy")
        self.assertAlmostEqual(float(copied.split()[0]), float(rows[0].split()[0]), places=3)
        self.browser.click(".poses [data-copy]")
        self.browser.until("document.querySelector('.poses [data-copy]').textContent === 'copied'")
        self.quiet()

    def test_dark_and_on_a_phone(self):
        self.open()
        light = self.browser.pixels()[5, 5]
        self.browser.prefer(prefers_color_scheme="dark", prefers_reduced_motion="reduce")
        dark = self.browser.pixels()
        self.assertGreater(light.sum(), 700)
        self.assertLess(dark[5, 5].sum(), 100)
        self.assertGreater(share(dark, ORANGE), 0.02)
        self.browser.size(390, 800)
        self.assertGreater(share(self.browser.pixels(), ORANGE), 0.02)
        self.assertLessEqual(self.browser.script("document.documentElement.scrollWidth"), 390)
        self.quiet()

    def test_what_is_wrong_or_ambiguous_says_so(self):
        rng = np.random.default_rng(1)

        def tube(name, n):
            angle, z = rng.uniform(0, 2 * np.pi, n), rng.uniform(-1, 1, n)
            points = np.column_stack([0.5 * np.cos(angle), 0.5 * np.sin(angle), z])
            np.savetxt(self.folder.path / name, points)

        tube("a.xyz", 6000)
        tube("b.xyz", 6000)
        np.savetxt(self.folder.path / "c.xyz", rng.random((3000, 3)) ** 2)
        for target, words in (("b.xyz", "Not held in every direction"), ("c.xyz", "Do not take this pose")):
            run(self.folder.path, "register", "a.xyz", target, "--report", "doubted.html", codes=(1,))
            self.open("doubted.html")
            self.assertEqual(self.text("#decision"), words)
            if target == "b.xyz":
                arrows = self.browser.pixels()
                self.browser.click("#arrows")
                self.assertGreater(changed(arrows, self.browser.pixels()), 0.002)
            self.quiet()

    def test_a_name_with_markup_is_text(self):
        folder = self.folder.path
        run(folder, "demo", "--write", "pair")
        (folder / "<").mkdir()
        name = "</script><img src=x onerror=\"document.title='harmed'\">.pcd"
        (folder / name).write_bytes((folder / "pair/source.pcd").read_bytes())
        run(folder, "register", name, "pair/target.pcd", "--report", "harm.html")
        self.open("harm.html")
        self.assertIn("<img src=x onerror", self.text(".verdict .pair"))
        self.assertEqual(self.browser.script("document.querySelectorAll('img').length"), 1)
        self.assertIn("Take this pose", self.browser.driver.title)
        self.quiet()

    def test_a_table_sorts_and_opens_pages(self):
        folder = self.folder.path
        run(folder, "demo", "--write", "listed")
        rows = ["source,target", "listed/source.pcd,listed/target.pcd", "listed/target.pcd,listed/source.pcd", "a,b"]
        (folder / "list.csv").write_text("\n".join(rows) + "\n")
        run(folder, "batch", "list.csv", "-o", "rows.csv")
        run(folder, "report", "rows.csv", "-o", "table")
        self.browser.open(folder / "table/index.html", live=False)
        first = lambda: self.browser.script("document.querySelector('tbody tr').cells[1].textContent")
        self.assertEqual(first(), "2")
        self.browser.click("thead th:nth-child(2) button")
        self.assertEqual(first(), "0")
        self.browser.click("thead th:nth-child(2) button")
        self.assertEqual(first(), "2")
        picture = self.browser.pixels("tbody img")
        self.assertGreater(share(picture, ORANGE) + share(picture, BLUE), 0.03)
        self.browser.click("tbody a")
        self.browser.until("document.documentElement.dataset.ready === 'yes'")
        self.assertEqual(self.text("#decision"), "Take this pose")
        self.quiet()


class WithoutWebGl(unittest.TestCase):
    def test_a_still_picture_is_shown(self):
        needed()
        folder = Folder()
        self.addCleanup(folder.remove)
        run(folder.path, "demo", "--write", "pair")
        run(folder.path, "register", "pair/source.pcd", "pair/target.pcd", "--report", "right.html")
        browser = Browser(webgl=False)
        self.addCleanup(browser.quit)
        browser.open(folder.path / "right.html", live=False)
        still = browser.pixels(".still")
        for colour in (ORANGE, BLUE):
            self.assertGreater(share(still, colour), 0.01)
        self.assertEqual(browser.script("getComputedStyle(document.getElementById('canvas')).display"), "none")
        self.assertIn("still picture", browser.driver.find_element("css selector", "#note").text)
        self.assertEqual(browser.driver.find_element("css selector", "#decision").text, "Take this pose")
        self.assertEqual(browser.logs(), ([], []))


if __name__ == "__main__":
    unittest.main()

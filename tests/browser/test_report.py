"""Pages of registrations, as a person sees them: pixels, not only what stands in the file."""

import json
import unittest

import numpy as np
from pages import Browser, Folder, needed, run

ORANGE, BLUE = np.array([230, 159, 0]), np.array([0, 114, 178])


def share(pixels, colour):
    """Share of the pixels of a colour, lit or in shade."""
    length = np.linalg.norm(pixels, axis=2)
    along = pixels @ (colour / np.linalg.norm(colour))
    return float(np.mean((length > 40) & (along > 0.985 * length)))


def middle(pixels, colour):
    """Where the middle of the pixels of a colour is: shares of width and height."""
    length = np.linalg.norm(pixels, axis=2)
    rows, columns = np.nonzero((length > 40) & (pixels @ (colour / np.linalg.norm(colour)) > 0.985 * length))
    return columns.mean() / pixels.shape[1], rows.mean() / pixels.shape[0]


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

    def test_mouse_and_wheel(self):
        self.open()
        self.browser.click("#target")
        first = self.browser.pixels()
        x, y = middle(first, ORANGE)
        self.browser.mouse((0.5, 0.5), (0.55, 0.5), (0.6, 0.45))
        turned = self.browser.pixels()
        self.assertGreater(changed(first, turned), 0.05)
        self.browser.mouse((0.1, 0.1), clicks=2)
        self.assertLess(changed(first, self.browser.pixels()), 0.002)
        # The right button moves, as the left one does with a key held down.
        for held in ({"button": "right"}, {"modifiers": 8}):
            self.browser.mouse((0.5, 0.5), (0.55, 0.5), (0.6, 0.6), **held)
            moved = middle(self.browser.pixels(), ORANGE)
            self.assertAlmostEqual(moved[0] - x, 0.1, delta=0.02)
            self.assertAlmostEqual(moved[1] - y, 0.1, delta=0.02)
            self.browser.press("r")
        # The point under the pointer stays there.
        self.browser.wheel(0.1, 0.5, 200)
        far = self.browser.pixels()
        self.assertLess(share(far, ORANGE), 0.7 * share(first, ORANGE))
        shrunk = np.exp(-0.0015 * 200)
        self.assertAlmostEqual(middle(far, ORANGE)[0], 0.1 + shrunk * (x - 0.1), delta=0.02)
        self.assertEqual(self.browser.script("scrollY"), 0)
        self.browser.click("#reset")
        self.assertLess(changed(first, self.browser.pixels()), 0.002)
        self.quiet()

    def test_fingers_turn_pinch_and_move(self):
        self.browser.size(390, 800)
        self.open()
        self.browser.click("#target")
        first = self.browser.pixels()
        x, y = middle(first, ORANGE)
        self.browser.fingers([(0.4, 0.5)], [(0.5, 0.5)], [(0.6, 0.5)])
        self.assertGreater(changed(first, self.browser.pixels()), 0.05)
        self.browser.click("#reset")
        # Apart, so that all is half as large again.
        self.browser.fingers([(0.45, y), (0.55, y)], [(0.425, y), (0.575, y)])
        self.assertGreater(share(self.browser.pixels(), ORANGE), 1.5 * share(first, ORANGE))
        self.browser.click("#reset")
        self.browser.fingers([(0.2, 0.3), (0.8, 0.7)], [(0.35, 0.4), (0.65, 0.6)])
        self.assertLess(share(self.browser.pixels(), ORANGE), 0.5 * share(first, ORANGE))
        self.browser.click("#reset")
        self.browser.fingers([(0.4, 0.5), (0.6, 0.5)], [(0.5, 0.5), (0.7, 0.5)], [(0.5, 0.6), (0.7, 0.6)])
        moved = middle(self.browser.pixels(), ORANGE)
        self.assertAlmostEqual(moved[0] - x, 0.1, delta=0.03)
        self.assertAlmostEqual(moved[1] - y, 0.1, delta=0.03)
        self.quiet()

    def test_a_lost_context_comes_back(self):
        self.open()
        self.browser.press("c")
        self.browser.click("input[name=stand][value='0']")
        before = self.browser.pixels()
        lose = "window.lose = document.querySelector('#canvas').getContext('webgl2').getExtension('WEBGL_lose_context')"
        self.browser.script(f"({lose}).loseContext()")
        self.browser.until("!document.documentElement.classList.contains('live')")
        self.assertGreater(share(self.browser.pixels(".still"), BLUE), 0.01)
        self.assertIn("graphics card", self.text("#note"))
        # Nothing that is pressed meanwhile does harm, or is lost.
        self.browser.press("t")
        self.browser.script("window.lose.restoreContext()")
        self.browser.until("document.documentElement.classList.contains('live')")
        self.browser.press("t")
        self.assertLess(changed(before, self.browser.pixels()), 0.002)
        self.assertFalse(self.browser.script("document.querySelector('#note').checkVisibility()"))
        self.quiet()

    def test_another_size_and_another_density(self):
        self.open()
        self.browser.click("#target")
        heights = []
        for width, density in ((1200, 1), (700, 2)):
            self.browser.size(width, 900, density)
            self.browser.until(f"devicePixelRatio === {density}")
            seen = self.browser.pixels()
            box = self.browser.script("document.querySelector('#canvas').getBoundingClientRect().toJSON()")
            size = self.browser.script("[document.querySelector('#canvas').width, document.querySelector('#canvas').height]")
            self.assertEqual(size, [round(density * box["width"]), round(density * box["height"])])
            rows = np.nonzero((np.abs(seen - seen[5, 5]).max(axis=2) > 60)[: int(0.9 * len(seen))].sum(axis=1) > 2)[0]
            heights.append((rows[-1] - rows[0]) / len(seen))
        # The clouds fill as much of the height.
        self.assertAlmostEqual(heights[0], heights[1], delta=0.03)
        self.quiet()

    def test_odd_clouds(self):
        """The view of clouds that no method would register."""
        folder = self.folder.path
        rng = np.random.default_rng(3)
        lump = rng.normal(size=(2000, 3))
        lump *= np.array([1.2, 1.0, 0.8]) / np.linalg.norm(lump, axis=1)[:, None]
        strays = np.vstack([lump, [[1e5, 3e4, 0], [-1e5, 0, 0]]])
        far = np.round(0.05 * lump, 3) + [1e6, 5.6e6, 300]
        unread = lump.copy()
        unread[::3] = np.nan
        right = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
        cases = {
            "one": (lump[:1], lump[:1] + [0.5, 0, 0]),
            "two": (right[:2], right[:2] + [0, 0.2, 0]),
            "three": (right, right + [0, 0, 0.3]),
            "heap": (np.tile([[1.8, 0, 0]], (500, 1)), lump),
            "line": (np.outer(rng.random(300), [1, 2, 3]), np.outer(rng.random(300), [3, 2, 1])),
            "strays": (strays, lump + [0.3, 0, 0]),
            "far": (far, far + [0.02, 0, 0]),
            "tiny": (1e-9 * lump, 1e-9 * lump + [3e-10, 0, 0]),
            "huge": (1e9 * lump, 1e9 * lump + [3e8, 0, 0]),
            "unread": (unread, lump + [0.3, 0, 0]),
            "apart": (lump, lump + [4000, 0, 0]),
        }
        pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
        words = ["register", *self.folder.scans(), "--method", "icp", "--verdict=off", "--json"]
        made = json.loads(run(folder, *words, codes=(0, 1)).stdout)
        made |= {"transform": pose, "thinning": {"voxel": None, "sample": None}}
        for name, clouds in cases.items():
            with self.subTest(name):
                files = [f"{name}-{end}.xyz" for end in "st"]
                for file, points in zip(files, clouds):
                    np.savetxt(folder / file, points, fmt="%.17g")
                dropped = int(np.isnan(clouds[0]).any(axis=1).sum())
                used, none = [len(cloud) for cloud in clouds], {"dropped": 0, "no_returns": 0}
                ends = [none | {"used": used[0] - dropped, "dropped": dropped}, none | {"used": used[1]}]
                points = {end: made["points"][end] | own for end, own in zip(["source", "target"], ends)}
                result = made | {"points": points, "source": files[0], "target": files[1]}
                (folder / f"{name}.json").write_text(json.dumps(result))
                run(folder, "report", f"{name}.json")
                self.open(f"{name}.html")
                # Its dots have the colours, too.
                self.browser.script("document.querySelector('#legend').remove()")
                seen = self.browser.pixels()
                for colour in (ORANGE, BLUE):
                    self.assertGreater(share(seen, colour), 3e-5)
                # All of it: nothing touches the edge.
                edge = np.concatenate([seen[0], seen[-1], seen[:, 0], seen[:, -1]])
                self.assertLess(np.ptp(edge, axis=0).max(), 30)
                if name == "strays":
                    self.assertIn("Not shown: 2 points of the source", self.text(".view"))
                    # The source is where it is, and as large as the target.
                    self.assertAlmostEqual(share(seen, ORANGE) / share(seen, BLUE), 1, delta=0.5)
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
        for target, words in (("b.xyz", "Uncertain"), ("c.xyz", "Do not take this pose")):
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

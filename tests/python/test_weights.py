"""Kernels, what is put together of them, and functions of one's own."""

import pickle
import unittest

import cfreg
import numpy as np
from cfreg import weights as w
from shapes import terrain, turned

FORMULAS = {
    w.Gaussian(7.0): lambda d2: np.exp(-d2 / 7.0),
    w.Laplacian(7.0): lambda d2: np.exp(-np.sqrt(d2 / 7.0)),
    w.Cauchy(7.0): lambda d2: 1.0 / (1.0 + d2 / 7.0),
    w.GemanMcClure(7.0): lambda d2: (1.0 + d2 / 7.0) ** -2.0,
    w.Truncated(7.0): lambda d2: (d2 <= 7.0).astype(float),
    w.StudentT(7.0, nu=3.0): lambda d2: (1.0 + d2 / 21.0) ** -2.0,
    w.Tukey(7.0): lambda d2: np.maximum(1.0 - d2 / 7.0, 0.0) ** 2,
    w.Uniform(): np.ones_like,
}


class Kernels(unittest.TestCase):
    def test_they_are_their_formulas(self):
        d2 = np.linspace(0.0, 40.0, 300).reshape(3, 100)
        for kernel, formula in FORMULAS.items():
            with self.subTest(repr(kernel)):
                found = kernel(d2)
                self.assertEqual((found.shape, found.dtype), (d2.shape, np.float32))
                np.testing.assert_allclose(found, formula(d2), atol=2e-6)
                self.assertEqual(pickle.loads(pickle.dumps(kernel)), kernel)
                self.assertEqual(eval(repr(kernel), vars(w)), kernel)

    def test_they_add_and_multiply(self):
        d2 = np.linspace(0.0, 900.0, 500)
        a, b = w.Gaussian(50), w.Cauchy(200)

        def mine(d2):
            return np.sqrt(1.0 / (1.0 + d2))

        for kernel, expected in {
            a + b: a(d2) + b(d2),
            a * b: a(d2) * b(d2),
            0.3 * a + b * 2: 0.3 * a(d2) + 2.0 * b(d2),
            (a + b) * a: (a(d2) + b(d2)) * a(d2),
            sum([a, b, a]): 2.0 * a(d2) + b(d2),
            np.float64(0.5) * a: 0.5 * a(d2),
            a * mine: a(d2) * mine(d2),
            mine + 0.5 * a: mine(d2) + 0.5 * a(d2),
        }.items():
            with self.subTest(repr(kernel)):
                np.testing.assert_allclose(kernel(d2), expected, atol=3e-6)
        self.assertEqual(repr((a + b) * mine), "(Gaussian(beta=50) + Cauchy(beta=200)) * mine")

    def test_what_cannot_weigh_is_refused_when_it_is_made(self):
        def nested():
            kernel = w.Uniform()
            for _ in range(20):
                kernel = w.Uniform() * (w.Uniform() + kernel)

        for make in (
            lambda: w.Gaussian(0.0),
            lambda: w.Gaussian(np.nan),
            lambda: w.Gaussian("wide"),
            lambda: w.Gaussian("auto:0"),
            lambda: w.StudentT(1.0, nu=0.0),
            lambda: w.sinkhorn(0),
            lambda: w.sinkhorn(2.5),
            lambda: -1.0 * w.Uniform(),
            lambda: np.inf * w.Uniform(),
            nested,
        ):
            with self.assertRaises(cfreg.SettingError):
                make()
        for wrong in (None, [1], True):
            with self.assertRaisesRegex(TypeError, "^beta: a number or a word"):
                w.Gaussian(wrong)
        with self.assertRaisesRegex(cfreg.SettingError, '^beta = "wide": must be a number, auto'):
            w.Gaussian("wide")
        for wrong in ("cauchy", 1):
            with self.assertRaisesRegex(TypeError, "^weights: a kernel or a function is needed"):
                w.Gaussian(1.0) + wrong
        with self.assertRaisesRegex(cfreg.SettingError, "beta = auto"):
            w.Gaussian("auto")([1.0])


class Weighing(unittest.TestCase):
    """Moments and registrations by such weights."""

    def setUp(self):
        self.source = terrain(700, seed=1)
        self.target, self.truth = turned(terrain(700, seed=2))
        self.features = [cfreg.fpfh(points) for points in (self.source, self.target)]

    def weigh(self, weights, **settings):
        return cfreg.moments(self.source, self.target, *self.features, weights=weights, **settings)

    def same(self, one, other, tolerance):
        scale = max(abs(one.weight), 1.0)
        self.assertLess(abs(one.weight - other.weight) / scale, tolerance)
        self.assertLess(np.abs(one.cross - other.cross).max() / scale, tolerance)

    def test_a_kernel_is_its_name_and_its_function(self):
        for kernel, name in ((w.Gaussian(60), "gaussian"), (w.StudentT(60, 3), "student-t:3")):
            for normalize in (w.NONE, w.SOURCE, w.TARGET, w.BOTH, w.sinkhorn(3)):
                with self.subTest(f"{name}, {normalize}"):
                    named = self.weigh(name, beta=60, normalize=normalize)
                    self.same(self.weigh(kernel, normalize=normalize), named, 1e-9)
                    by_python = self.weigh(lambda d2: kernel(d2), normalize=normalize)
                    self.same(by_python, named, 1e-9)

    def test_a_function_sees_every_pair_once_and_in_parts(self):
        seen = []

        def count(d2):
            self.assertEqual((d2.dtype, d2.ndim), (np.float32, 2))
            self.assertGreaterEqual(d2.min(), 0.0)
            seen.append(d2.shape)
            return np.ones(d2.shape)

        self.assertEqual(round(self.weigh(count).weight), 700 * 700)
        self.assertEqual(sum(rows * columns for rows, columns in seen), 700 * 700)
        self.assertLess(len(seen), 40)

    def test_masks_and_wholes_are_weights_too(self):
        least = self.weigh(lambda d2: d2 < 50)
        self.same(least, self.weigh(w.Truncated(50)), 1e-3)
        self.assertEqual(self.weigh(lambda d2: np.full(d2.shape, 2)).weight, 2 * 700 * 700)
        # What is masked is no connection.
        self.same(self.weigh(lambda d2: np.ma.masked_array(d2 * 0 + 1, mask=d2 >= 50)), least, 1e-12)

    def test_a_kernel_of_ones_own_is_its_call(self):
        class Steep(w.Kernel):
            def __call__(self, d2):
                return (np.asarray(d2) < 50).astype(np.float32)

        class Twice(w.Gaussian):
            def __call__(self, d2):
                return 2 * super().__call__(d2)

        class Empty(w.Kernel):
            pass

        self.same(self.weigh(Steep()), self.weigh(lambda d2: d2 < 50), 1e-12)
        self.assertEqual(repr(Steep() + w.Uniform()), "Steep() + Uniform()")
        once = w.Gaussian(50)([0.0, 50.0])
        np.testing.assert_array_equal(Twice(50)([0.0, 50.0]), 2 * once)
        np.testing.assert_array_equal((Twice(50) + w.Gaussian(50))([0.0, 50.0]), 3 * once)
        self.same(self.weigh(Twice(50)), self.weigh(2 * w.Gaussian(50)), 1e-6)
        with self.assertRaisesRegex(TypeError, "^Empty: .*__call__"):
            self.weigh(Empty())

    def test_any_number_of_kernels_are_one_sum(self):
        many = sum(w.Gaussian(beta) for beta in range(1, 301))
        expected = np.exp(-3.0 / np.arange(1, 301)).sum()
        self.assertAlmostEqual(float(many([3.0])[0]), expected, delta=1e-4 * expected)
        self.assertGreater(self.weigh(many).weight, self.weigh(w.Gaussian(300)).weight)
        shrunk = w.Gaussian(50)
        for _ in range(2000):
            shrunk = 0.999 * shrunk
        self.assertEqual(repr(shrunk), "0.1352 * Gaussian(beta=50)")
        deep = w.Gaussian(1)
        with self.assertRaisesRegex(cfreg.SettingError, "^kernel: recursion limit"):
            for _ in range(200):
                deep = deep * w.Gaussian(2) + w.Gaussian(3)

    def test_automatic_bandwidths_are_found_within(self):
        beta = cfreg.register(self.source, self.target, "cf", beta="auto").beta
        self.same(self.weigh(0.5 * w.Gaussian("auto")), self.weigh(0.5 * w.Gaussian(beta)), 1e-6)

    def test_what_a_function_raises_comes_out(self):
        class Mine(Exception):
            pass

        def fail(d2):
            raise Mine("at once")

        for call in (
            lambda: self.weigh(fail),
            lambda: cfreg.register(self.source, self.target, "cf", weights=fail),
            lambda: cfreg.CFK(weights=fail).register(self.source, self.target),
        ):
            with self.assertRaisesRegex(Mine, "at once"):
                call()
        for wrong, error in (
            (lambda d2: -d2, "not negative"),
            (lambda d2: np.full(d2.shape, np.nan), "finite"),
            (lambda d2: d2[:1], "returned shape"),
            (lambda d2: 1.0, "returned shape"),
        ):
            with self.assertRaisesRegex(ValueError, f"^weights: .*{error}"):
                self.weigh(wrong)
        for wrong, error in (
            (3, "^weights must be a name, a kernel"),
            (w.Gaussian, r"^weights: Gaussian is a class: .*Gaussian\(...\)"),
            (lambda d2: d2 + 1j, "^weights: the function returned complex64"),
            (lambda d2: None, "^weights: the function returned object"),
        ):
            with self.assertRaisesRegex(TypeError, error):
                self.weigh(wrong)

    def test_a_function_may_call_on_the_package_itself(self):
        """From every thread at once, each of which then waits."""
        few = terrain(200)

        def nested(d2):
            cfreg.fpfh(few, neighbors=20)
            return np.ones(d2.shape)

        self.assertEqual(round(self.weigh(nested).weight), 700 * 700)

    def test_registrations_take_them(self):
        def steep(d2):
            return 1.0 / (1.0 + (d2 / 60.0) ** 2)

        for weights in (w.Gaussian(60) + 0.1 * w.Cauchy(200), steep, steep * w.Gaussian(200)):
            for method in (cfreg.CF, cfreg.CFK):
                with self.subTest(f"{method.name}, {weights!r}"):
                    if method is cfreg.CFK and weights is not steep:
                        continue
                    found = method(weights=weights, normalize="both").register(self.source, self.target)
                    self.assertEqual(found.config["normalization"], "both")
                    shown = "steep" if weights is steep else repr(weights)
                    self.assertEqual(found.config["weights"], shown)
                    if method is cfreg.CF:
                        np.testing.assert_allclose(found.transform, self.truth, atol=0.15)
        found = cfreg.register(self.source, self.target, "cf", weights=w.Cauchy(50))
        self.assertEqual((found.config["weights"], found.config["beta"]), ("cauchy", 50.0))
        named = cfreg.register(self.source, self.target, "cf", weights="cauchy", beta=50)
        np.testing.assert_array_equal(found.transform, named.transform)

    def test_a_bandwidth_beside_a_kernel_contradicts_it(self):
        for call in (
            lambda: self.weigh(w.Gaussian(60), beta=50),
            lambda: cfreg.CF(weights=w.Gaussian(60), beta=50),
            lambda: cfreg.CF(weights=lambda d2: d2, beta=50),
            lambda: cfreg.CF(weights=w.Gaussian(60), beta=0.0),
        ):
            with self.assertRaisesRegex(cfreg.SettingError, "^beta"):
                call()
        with self.assertRaisesRegex(cfreg.SettingError, "^tolerance"):
            cfreg.CF(weights=lambda d2: d2, tolerance=0.1)


if __name__ == "__main__":
    unittest.main()

"""What is known of a pose holds in what comes out."""

import json
import unittest

import numpy as np

import cfreg


def turn(axis, angle):
    """Rodrigues."""
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


class Priors(unittest.TestCase):
    def setUp(self):
        rng = np.random.default_rng(1)
        self.source = rng.random((400, 3))
        self.target = self.source @ turn((0.1, 0, 1), 0.3).T + 0.01 * rng.random((400, 3))

    def test_the_best_turn_about_an_axis(self):
        rows = np.arange(400)
        moments = cfreg.moments_of_pairs(self.source, self.target, np.stack([rows, rows], 1))
        found = cfreg.solve(moments, prior=cfreg.Prior(direction=(0, 0, 1)))
        np.testing.assert_allclose(found[:3, 2], (0, 0, 1), atol=1e-12)
        p, q = self.source - self.source.mean(0), self.target - self.target.mean(0)
        errors = [np.sum((p @ turn((0, 0, 1), a).T - q) ** 2) for a in np.linspace(0, 0.6, 601)]
        angle = np.arctan2(found[1, 0], found[0, 0])
        self.assertAlmostEqual(angle, np.argmin(errors) * 1e-3, delta=1e-3)

    def test_directions_of_two_frames_and_a_bound(self):
        prior = cfreg.Prior(direction=((0, 0, 1), turn((0.1, 0, 1), 0.3) @ (0, 0, 1)))
        found = cfreg.ICP(prior=prior).register(self.source, self.target).transform
        np.testing.assert_allclose(found[:3, :3], turn((0.1, 0, 1), 0.3), atol=0.02)
        near = cfreg.Prior(rotation=(0, 0, 0.1), within_deg=2)
        found = cfreg.ICP(prior=near).register(self.source, self.target).transform
        off = found[:3, :3] @ turn((0, 0, 1), 0.1).T
        self.assertLess(np.degrees(np.arccos((np.trace(off) - 1) / 2)), 2 + 1e-6)
        self.assertEqual(
            json.loads(json.dumps(cfreg.ICP(prior=near).settings()["prior"]))["rotation"],
            {"vector": [0, 0, 0.1], "within_deg": 2},
        )

    def test_a_rotation_may_be_a_matrix(self):
        by = [cfreg.Prior(rotation=r) for r in ((0, 0, 0.3), turn((0, 0, 1), 0.3), turn((0, 0, 1), 0.3).tolist())]
        found = [cfreg.ICP(prior=prior).register(self.source, self.target).transform for prior in by]
        np.testing.assert_allclose(found[0][:3, :3], turn((0, 0, 1), 0.3), atol=1e-12)
        for other in found[1:]:
            np.testing.assert_allclose(other, found[0], atol=1e-12)
        for bad in (np.eye(4), 2 * np.eye(3), -np.eye(3), np.full((3, 3), np.nan), "x", [[1, 2], [3]], 7):
            with self.assertRaisesRegex(cfreg.Error, "rotation"):
                cfreg.ICP(prior=cfreg.Prior(rotation=bad))
        for field in ("direction", "scale"):
            with self.assertRaisesRegex(cfreg.Error, f"prior.{field} = .*must be"):
                cfreg.CF(prior=cfreg.Prior(**{field: (1, 2, 3, 4)}))

    def test_a_rotation_is_rounded_to_the_nearest(self):
        exact = turn((0.3, -1, 0.2), 0.7)
        printed = np.array([[float(f"{x:.5f}") for x in row] for row in exact])
        for given, most in (
            (exact, 1e-15),
            (1.0000013 * exact, 2.3e-6),
            (exact.astype(np.float32), 3e-7),
            (printed, 3e-5),
            (exact + 2e-5 * np.ones((3, 3)), 6.1e-5),
        ):
            prior = cfreg.Prior(rotation=given)
            self.assertLess(prior.rotation_error, most)
            found = cfreg.ICP(prior=prior).register(self.source, self.target).transform[:3, :3]
            u, _, vt = np.linalg.svd(given.astype(float))
            np.testing.assert_allclose(found, u @ vt, atol=1e-12)
        self.assertEqual(cfreg.Prior(rotation=(0, 0, 0.1)).rotation_error, 0.0)
        self.assertEqual(cfreg.Prior().rotation_error, 0.0)

    def test_a_refusal_of_a_rotation_says_how_far_it_is_off(self):
        exact = turn((0.3, -1, 0.2), 0.7)
        for given, said in (
            (1.001 * exact, r"1\.732e-3 away from the nearest rotation.*divide a scale out"),
            (exact * (1, 1, -1), r"a reflection, of determinant -1\.000000"),
            (np.zeros((3, 3)), "not independent"),
            (np.full((3, 3), np.nan), "must be finite"),
        ):
            with self.assertRaisesRegex(cfreg.SettingError, f"^prior.rotation = .*{said}"):
                cfreg.ICP(prior=cfreg.Prior(rotation=given))

    def test_what_is_no_prior_is_refused(self):
        for bad in (
            cfreg.Prior(direction=(0, 0, 0)),
            cfreg.Prior(direction=(0, 0, float("nan"))),
            cfreg.Prior(rotation=(0, 0, 1), within_deg=-1),
            cfreg.Prior(scale=(1, 2)),
        ):
            with self.assertRaises(cfreg.SettingError):
                cfreg.ICP(prior=bad)
        moments = cfreg.moments_of_pairs(self.source, self.target, np.array([[0, 0], [1, 1]]))
        with self.assertRaises(TypeError):
            cfreg.solve(moments, prior=(0, 0, 1))

    def test_a_covariance_comes_with_a_verdict(self):
        rng = np.random.default_rng(2)
        x, y = rng.uniform(-3, 3, (2, 8000))
        ground = np.stack([x, y, np.sin(1.3 * x) * np.cos(y) + 0.4 * np.sin(x * y)], 1)
        ground += 0.01 * rng.standard_normal(ground.shape)
        covariance = cfreg.register(ground[::2], ground[1::2]).verdict.covariance
        self.assertEqual((covariance.matrix.shape, covariance.center.shape), ((6, 6), (3,)))
        self.assertEqual(covariance.undetermined.shape, (0, 6))
        self.assertTrue(np.all(np.linalg.eigvalsh(covariance.matrix) > 0))
        flat = ground * (1, 1, 0) + 0.01 * rng.standard_normal(ground.shape)
        sliding = cfreg.register(flat[::2], flat[1::2]).verdict.covariance
        self.assertEqual(sliding.undetermined.shape, (3, 6))


if __name__ == "__main__":
    unittest.main()

"""The TEASER reference beside plain enumeration, and on a problem whose answer is known."""

import itertools
import unittest

import numpy as np

from reference.teaser import adaptive_voting, largest_clique, teaser
from reference.rotations import random_rotation


class Teaser(unittest.TestCase):
    def setUp(self):
        self.rng = np.random.default_rng(5)

    def test_voting_finds_what_a_fine_grid_finds(self):
        for _ in range(20):
            x, bounds = self.rng.uniform(-3, 3, 9), self.rng.uniform(0.1, 1.0, 9)
            cost = lambda y: np.minimum(((x - y) / bounds) ** 2, 1.0).sum()
            best = min(map(cost, np.linspace(-4, 4, 8001)))
            self.assertLessEqual(cost(adaptive_voting(x, bounds)), best + 1e-12)

    def test_the_clique_is_as_large_as_any_subset(self):
        for _ in range(20):
            upper = np.triu(self.rng.random((9, 9)) < 0.5, 1)
            joined = upper | upper.T
            whole = lambda members: all(joined[i, j] for i, j in itertools.combinations(members, 2))
            subsets = itertools.chain.from_iterable(
                itertools.combinations(range(9), size) for size in range(10)
            )
            cliques = [members for members in subsets if whole(members)]
            size = max(map(len, cliques))
            largest = [list(members) for members in cliques if len(members) == size]
            self.assertEqual(largest_clique(joined), largest[0] if len(largest) == 1 else None)

    def test_a_moved_copy_is_found_among_wrong_matches(self):
        turn, shift = random_rotation(self.rng), np.array([1.0, -2.0, 3.0])
        source = self.rng.uniform(-1, 1, (30, 3))
        target = 1.3 * source @ turn.T + shift
        target[:18] = self.rng.permutation(target[:18])
        found = teaser(source, target, 1e-3, estimate_scale=True)
        last = found.rounds[-1]
        self.assertAlmostEqual(found.scale, 1.3, delta=1e-9)
        np.testing.assert_allclose(last.rotation, turn, atol=1e-9)
        np.testing.assert_allclose(last.translation, shift, atol=1e-9)
        self.assertTrue(set(range(18, 30)) <= set(found.inliers))


if __name__ == "__main__":
    unittest.main()

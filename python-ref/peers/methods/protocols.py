"""Pairs of clouds on which methods and peers are compared: real scans at their true pose
plus a small known error, and the paper's protocols (section IV).

Without real scans (`scans.data_folder()`) there are none, and a line says so.
"""

from dataclasses import dataclass

import numpy as np

from peers.programs import open3d
from reference import scans
from reference.rotations import about, direction, from_vector
from reference.surfaces import as_f32

MESHES = {"bunny": "stanford_meshes/bun_zipper.ply", "dragon": "stanford_meshes/dragon_vrip_res2.ply"}


@dataclass(frozen=True)
class StartedPair:
    name: str
    kind: str
    """The data set, or the protocol."""
    source: np.ndarray
    """(N, 3), f32 numbers in f64."""
    target: np.ndarray
    truth: np.ndarray
    """(4, 4) from source to target."""
    initial: np.ndarray
    """(4, 4), the pose that local methods start from."""

    def size(self):
        """Diagonal of the source's bounding box."""
        return float(np.linalg.norm(np.ptp(self.source, axis=0)))


def real(step, points=None, degrees=4.0, share=0.01, least_overlap=0.5, sets=None):
    """Every `step`-th pair of each data set, of at least `least_overlap`; both clouds
    thinned to `points` at random; started `degrees` off about a random axis and `share`
    of the size off in a random direction."""
    folder = scans.data_folder()
    if folder is None:
        print("left out: real pairs (CFREG_DATA and ../shared/data are absent)")
        return
    listed = scans.read_pairs(folder / "pairs.csv")
    rows = [row for row in listed if float(row["overlap"]) >= least_overlap]
    seen = {}
    for number, row in enumerate(rows):
        seen[row["dataset"]] = seen.get(row["dataset"], -1) + 1
        if seen[row["dataset"]] % step or (sets and row["dataset"] not in sets):
            continue
        rng = np.random.default_rng(number)
        clouds = [scans.scan(row[side]) for side in ("source", "target")]
        if points:
            clouds = [scans.sample(cloud, points, rng) for cloud in clouds]
        size = np.linalg.norm(np.ptp(clouds[0], axis=0))
        error = about(from_vector(direction(rng) * np.radians(degrees)), clouds[1].mean(axis=0))
        error[:3, 3] += share * size * direction(rng)
        names = [row[side].split("/")[-1].removesuffix(".ply") for side in ("source", "target")]
        name = f"{row['dataset']} {' '.join(names)}"
        yield StartedPair(name, row["dataset"], *clouds, row["truth"], error @ row["truth"])


def accuracy(model, trials, large, points=500, seed=0):
    """The paper's accuracy test (section IV-D): two independent samples of a mesh by area,
    the second moved: a small rotation about its centroid, or a large one about the origin.
    Normals look at the origin in both, as PCL's do."""
    for trial in range(trials):
        rng = np.random.default_rng((seed, trial, large))
        source, target = (by_area(model, points, rng) for _ in range(2))
        yield moved("accuracy", model, trial, large, source, target, rng)


def robustness(model, trials, large, points=500, outliers=100, radius=0.1, seed=0):
    """The paper's robustness test (section IV-C): the same points twice, `outliers` more
    drawn evenly from a ball about the target's centroid. Only a ball of
    that *diameter* gives the figures printed for "radius 0.2"."""
    for trial in range(trials):
        rng = np.random.default_rng((seed, trial, large))
        source = by_area(model, points, rng)
        ball = np.array([direction(rng) * rng.random() ** (1 / 3) for _ in range(outliers)])
        target = np.vstack([source, source.mean(axis=0) + radius * ball])
        yield moved("robustness", model, trial, large, source, target, rng)


def moved(kind, model, trial, large, source, target, rng):
    limit = np.pi / 2 if large else np.pi / 8
    center = np.zeros(3) if large else target.mean(axis=0)
    truth = about(from_vector(rng.uniform(-limit, limit, 3)), center)
    target = as_f32(target @ truth[:3, :3].T + truth[:3, 3])
    name = f"{kind} {model} {'large' if large else 'small'} {trial}"
    return StartedPair(name, kind, as_f32(source), target, truth, np.eye(4))


_meshes = {}


def by_area(model, count, rng):
    """`count` points drawn evenly from the faces of a mesh."""
    if model not in _meshes:
        vertices, triangles = open3d.read_mesh(scans.data_folder() / MESHES[model])
        corners = vertices[triangles]
        edges = corners[:, 1:] - corners[:, :1]
        area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
        _meshes[model] = corners, area / area.sum()
    corners, share = _meshes[model]
    a, b, c = np.moveaxis(corners[rng.choice(len(corners), count, p=share)], 1, 0)
    u, v = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
    return (1 - u) * a + u * (1 - v) * b + u * v * c

"""Pairs of clouds on which methods and peers are compared: real scans at their true pose
plus a small known error, and the paper's protocols (section IV).

Without real scans (`scans.data_folder()`) there are none, and a line says so.
"""

import csv
from dataclasses import dataclass

import numpy as np

import scans
from surfaces import as_f32

MESHES = {"bunny": "stanford_meshes/bun_zipper.ply", "dragon": "stanford_meshes/dragon_vrip_res2.ply"}


@dataclass(frozen=True)
class Pair:
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
    with open(folder / "pairs.csv", newline="") as file:
        rows = [row for row in csv.DictReader(file) if float(row["overlap"]) >= least_overlap]
    seen = {}
    for number, row in enumerate(rows):
        seen[row["dataset"]] = seen.get(row["dataset"], -1) + 1
        if seen[row["dataset"]] % step or (sets and row["dataset"] not in sets):
            continue
        rng = np.random.default_rng(number)
        clouds = [scans.scan(row[side]) for side in ("source", "target")]
        if points:
            clouds = [scans.sample(cloud, points, rng) for cloud in clouds]
        truth = np.array([[float(row[f"t{i}{j}"]) for j in range(4)] for i in range(4)])
        size = np.linalg.norm(np.ptp(clouds[0], axis=0))
        error = about(rotation(direction(rng) * np.radians(degrees)), clouds[1].mean(axis=0))
        error[:3, 3] += share * size * direction(rng)
        names = [row[side].split("/")[-1].removesuffix(".ply") for side in ("source", "target")]
        name = f"{row['dataset']} {' '.join(names)}"
        yield Pair(name, row["dataset"], *clouds, truth, error @ truth)


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
    drawn evenly from a ball about the target's centroid. Of the printed "radius 0.2" only
    a ball of that *diameter* gives the printed figures."""
    for trial in range(trials):
        rng = np.random.default_rng((seed, trial, large))
        source = by_area(model, points, rng)
        ball = np.array([direction(rng) * rng.random() ** (1 / 3) for _ in range(outliers)])
        target = np.vstack([source, source.mean(axis=0) + radius * ball])
        yield moved("robustness", model, trial, large, source, target, rng)


def moved(kind, model, trial, large, source, target, rng):
    limit = np.pi / 2 if large else np.pi / 8
    center = np.zeros(3) if large else target.mean(axis=0)
    truth = about(rotation(rng.uniform(-limit, limit, 3)), center)
    target = as_f32(target @ truth[:3, :3].T + truth[:3, 3])
    name = f"{kind} {model} {'large' if large else 'small'} {trial}"
    return Pair(name, kind, as_f32(source), target, truth, np.eye(4))


_meshes = {}


def by_area(model, count, rng):
    """`count` points drawn evenly from the faces of a mesh."""
    if model not in _meshes:
        o3d = scans.import_open3d()
        mesh = o3d.io.read_triangle_mesh(str(scans.data_folder() / MESHES[model]))
        corners = np.asarray(mesh.vertices)[np.asarray(mesh.triangles)]
        edges = corners[:, 1:] - corners[:, :1]
        area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
        _meshes[model] = corners, area / area.sum()
    corners, share = _meshes[model]
    a, b, c = np.moveaxis(corners[rng.choice(len(corners), count, p=share)], 1, 0)
    u, v = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
    return (1 - u) * a + u * (1 - v) * b + u * v * c


def direction(rng):
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


def rotation(vector):
    """The (3, 3) rotation about `vector` by its length (Rodrigues)."""
    angle = np.linalg.norm(vector)
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def about(turn, center):
    """(4, 4): a rotation about a place."""
    pose = np.eye(4)
    pose[:3, :3] = turn
    pose[:3, 3] = center - turn @ center
    return pose

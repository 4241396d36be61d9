"""Writes made pairs whose poses are known, for the fit of the verdict: scenes that repeat, symmetric
parts, few planes, mirrored and scaled clouds, clouds of different scenes, and, beside them, ordinary
scenes.

    python -m verdict.made_pairs FOLDER [--each 10] [--seed 1]

FOLDER gets `views.csv`, pairs of simulated scans with the sensor at the zero of each file,
`wholes.csv`, pairs of samples of surfaces without a sensor, and a folder of PLY files for each kind.
A kind is a source: one that is left out of the fit has no pair of its kind in the fit. Scans are
cast by Open3D.
"""

import argparse
import csv
from pathlib import Path

import numpy as np
import open3d
from scipy.spatial.transform import Rotation

from verdict import made_shapes as shapes
from verdict.made_shapes import Mesh

COLUMNS = ["dataset", "source", "target", *(f"t{k // 4}{k % 4}" for k in range(16)), "overlap", "units"]


def mesh_of(mesh):
    vertices, triangles = mesh.arrays()
    return open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(vertices), open3d.utility.Vector3iVector(triangles)
    )


def sampled(mesh, rng, count, noise=0.0):
    """Points uniform on the surface."""
    open3d.utility.random.seed(int(rng.integers(2**31)))
    points = np.asarray(mesh_of(mesh).sample_points_uniformly(count).points)
    return points + rng.normal(scale=noise, size=points.shape) if noise else points


def cast(mesh, directions, sensor, rng, noise, most=np.inf):
    """Points, in the frame of `sensor` (4, 4), that rays of these unit directions hit."""
    vertices, triangles = mesh.arrays()
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(vertices.astype(np.float32), triangles.astype(np.uint32))
    origins = np.broadcast_to(sensor[:3, 3], directions.shape)
    rays = np.concatenate([origins, directions @ sensor[:3, :3].T], axis=1).astype(np.float32)
    distance = scene.cast_rays(open3d.core.Tensor(rays))["t_hit"].numpy().astype(float)
    hit = np.isfinite(distance) & (distance < most)
    distance = distance[hit] + rng.normal(size=hit.sum()) * noise(distance[hit])
    return directions[hit] * distance[:, None]


def camera(mesh, sensor, rng, noise, field=1.0):
    """A depth image: noise grows with the square of the distance."""
    u, v = np.meshgrid(np.linspace(-field, field, 200) / 2, np.linspace(-field, field, 150) * 0.375)
    directions = np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return cast(mesh, directions, sensor, rng, lambda distance: noise * distance**2)


def sweep(mesh, sensor, rng, noise, most):
    """A rotating scanner of 32 or 64 rings."""
    rings = int(rng.choice([32, 64]))
    up, around = np.meshgrid(np.radians(np.linspace(-30, 25, rings)), np.linspace(-np.pi, np.pi, 720, endpoint=False))
    up, around = up.ravel(), around.ravel()
    directions = np.column_stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)])
    return cast(mesh, directions, sensor, rng, lambda distance: np.full_like(distance, noise), most)


def looking(at, towards, rng, roll=0.1):
    """The pose of a camera at one place that looks at another."""
    forward = np.asarray(towards, float) - at
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    turned = np.column_stack([right, np.cross(forward, right), forward])
    pose = np.eye(4)
    pose[:3, :3] = turned @ Rotation.from_rotvec([0, 0, rng.normal() * roll]).as_matrix()
    pose[:3, 3] = at
    return pose


def standing(at, rng):
    """The pose of an upright scanner, turned at random and tilted a little."""
    pose = np.eye(4)
    tilt = Rotation.from_rotvec([*rng.normal(size=2) * 0.01, rng.uniform(-np.pi, np.pi)])
    pose[:3, :3], pose[:3, 3] = tilt.as_matrix(), at
    return pose


class Writer:
    """Writes the clouds and the rows of a list."""

    def __init__(self, folder):
        self.folder, self.rows = folder, []

    def pair(self, kind, unit, source, target, truth):
        """A pair of this kind; the pose from source to target is None for different scenes."""
        if min(len(source), len(target)) < 200:  # A camera may look past the scene.
            return
        number = sum(row[1].startswith(f"{kind}/") for row in self.rows)
        names = [f"{kind}/{number:03d}-{side}.ply" for side in ("source", "target")]
        (self.folder / kind).mkdir(parents=True, exist_ok=True)
        for name, points in zip(names, (source, target)):
            cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
            open3d.io.write_point_cloud(str(self.folder / name), cloud)
        pose = [""] * 16 if truth is None else [f"{value:.9g}" for value in truth.ravel()]
        dataset = f"unrelated made {kind}" if truth is None else f"made {kind}"
        self.rows.append([dataset, *names, *pose, 0 if truth is None else shared(source, target, truth), unit])

    def finish(self, name):
        with open(self.folder / name, "w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([COLUMNS, *self.rows])


def shared(source, target, truth):
    """Share of the source with a point of the target within three of its median distances."""
    tree = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(target))
    spacing = np.median(tree.compute_nearest_neighbor_distance())
    moved = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(source @ truth[:3, :3].T + truth[:3, 3]))
    near = np.asarray(moved.compute_point_cloud_distance(tree)) < 3 * spacing
    return f"{max(np.mean(near), 0.001):.3f}"


def relative(source, target):
    """The pose from the frame of one sensor to that of another."""
    return np.linalg.inv(target) @ source


MIRROR = np.diag([-1.0, 1.0, 1.0])


def around(rng, angle):
    """Two places of cameras around an object of one unit, `angle` apart."""
    first, height = rng.uniform(0, 2 * np.pi), rng.uniform(0.3, 1.2, 2)
    distance = rng.uniform(1.8, 2.6, 2)
    turns = [first, first + angle]
    return [[d * np.cos(t), d * np.sin(t), h] for d, t, h in zip(distance, turns, height)]


def views_of_object(writer, rng, kind, mesh, other=None, angles=(0.2, 1.6), change=np.eye(3)):
    """Two views of an object, or of two objects; the second cloud is changed by a matrix."""
    places = around(rng, rng.uniform(*angles) * rng.choice([-1, 1]))
    noise = rng.choice([0.0005, 0.001, 0.002])
    poses = [looking(place, rng.normal(size=3) * 0.05, rng) for place in places]
    scans = [camera(scene, pose, rng, noise) for scene, pose in zip((mesh, other or mesh), poses)]
    related = other is None and np.allclose(change, np.eye(3))
    writer.pair(kind, "cm", scans[0], scans[1] @ change.T, relative(*poses) if related else None)


def views_of_room(writer, rng, kind, mesh, size, other=None, change=np.eye(3)):
    """Two depth images of a room with `size`, or of two rooms."""
    place = lambda: np.append(rng.uniform(0.15, 0.85, 2) * size[:2], rng.uniform(1.0, 1.8))
    first, aim = place(), np.append(rng.uniform(0.2, 0.8, 2) * size[:2], 0.5)
    while np.linalg.norm(first - aim) < 1.5:
        first, aim = place(), np.append(rng.uniform(0.1, 0.9, 2) * size[:2], 0.5)
    second = np.clip(first + rng.normal(size=3) * [0.7, 0.7, 0.1], 0.3, np.append(size[:2] - 0.3, 1.9))
    poses = [looking(at, aim + rng.normal(size=3) * 0.4, rng) for at in (first, second)]
    noise = rng.choice([0.001, 0.002, 0.004])
    scans = [camera(scene, pose, rng, noise, field=1.2) for scene, pose in zip((mesh, other or mesh), poses)]
    related = other is None and np.allclose(change, np.eye(3))
    writer.pair(kind, "m", scans[0], scans[1] @ change.T, relative(*poses) if related else None)


def sweeps(writer, rng, kind, scenes, places, most=60.0):
    """Two sweeps of one scene, or of two, from two places."""
    poses = [standing(place, rng) for place in places]
    noise = rng.choice([0.005, 0.01, 0.02])
    scans = [sweep(scene, pose, rng, noise, most) for scene, pose in zip(scenes, poses)]
    writer.pair(kind, "m", *scans, relative(*poses) if scenes[0] is scenes[1] else None)


def write_views(writer, rng, each):
    for _ in range(each):
        room, size = shapes.furnished_room(rng)
        views_of_room(writer, rng, "furnished_rooms", room, size)
        different, _ = shapes.furnished_room(rng)
        views_of_room(writer, rng, "furnished_rooms", room, size, other=different)
        views_of_room(writer, rng, "mirrored_rooms", room, size, change=MIRROR)
        views_of_room(writer, rng, "scaled_rooms", room, size, change=np.eye(3) * rng.choice([0.9, 0.95, 1.06, 1.12]))
        fixed = shapes.furniture(Mesh().room(size), rng, 5, [0.5, 0.5], size[:2] - 0.5)
        now = [
            shapes.furniture(Mesh().join(fixed), np.random.default_rng(rng.integers(2**31)), 2, [1, 1], size[:2] - 1)
            for _ in range(2)
        ]
        place = np.append(rng.uniform(0.2, 0.8, 2) * size[:2], 1.5)
        poses = [standing(place + rng.normal(size=3) * 0.1, rng) for _ in range(2)]
        scans = [sweep(scene, pose, rng, 0.005, 30) for scene, pose in zip(now, poses)]
        writer.pair("moved_furniture", "m", *scans, relative(*poses))
        sizes = rng.uniform([3, 3, 2.3], [8, 6, 3], (2, 3))
        bare = [Mesh().room(extent, ceiling=True) for extent in sizes]
        at = lambda extent: np.append(rng.uniform(0.2, 0.8, 2) * extent[:2], 1.4)
        sweeps(writer, rng, "bare_rooms", [bare[0], bare[0]], [at(sizes[0]), at(sizes[0])])
        sweeps(writer, rng, "bare_rooms", bare, [at(sizes[0]), at(sizes[1])])
        hall, length, period = shapes.corridor(rng)
        start = rng.uniform(2, 0.4 * length)
        end = min(start + period * rng.integers(1, 4) + rng.normal() * 0.5, length - 1)
        sweeps(writer, rng, "corridors", [hall, hall], [[start, 0.8, 1.2], [end, 0.9, 1.2]], most=15)
        store, extent = shapes.racks(rng)
        spots = np.column_stack([rng.uniform(0.1, 0.9, (2, 2)) * extent, [3.3, 3.3]])
        sweeps(writer, rng, "racks", [store, store], spots, most=20)
        road, length, width = shapes.street(rng)
        x = rng.uniform(10, length - 30)
        lane = rng.uniform(4, width - 4, 2)
        sweeps(writer, rng, "streets", [road, road], [[x, lane[0], 1.8], [x + rng.uniform(2, 20), lane[1], 1.8]])
        different, length, width = shapes.street(rng)
        sweeps(writer, rng, "streets", [road, different], [[x, lane[0], 1.8], [length / 2, width / 2, 1.8]])
        trees = shapes.forest(rng)
        spot = rng.uniform(10, 30, 2)
        sweeps(writer, rng, "forests", [trees, trees], [[*spot, 1.5], [*(spot + rng.normal(size=2) * 4), 1.5]])
        body = shapes.figure(rng)
        views_of_object(writer, rng, "figures", body)
        views_of_object(writer, rng, "figures", body, other=shapes.figure(rng))
        views_of_object(writer, rng, "mirrored_figures", body, angles=(0.0, 0.3), change=MIRROR)
        views_of_object(writer, rng, "scaled_figures", body, change=np.eye(3) * rng.choice([0.9, 0.95, 1.06, 1.12]))
        views_of_object(writer, rng, "pedestals", shapes.pedestal(rng).scaled([0.7] * 3), angles=(0.4, 2.0))
        symmetric = shapes.gear(rng) if rng.random() < 0.5 else shapes.prism(rng).scaled([0.7] * 3)
        views_of_object(writer, rng, "symmetric_views", symmetric, angles=(0.3, 1.2))


def window(points, axis, low, high):
    return points[(points[:, axis] >= low) & (points[:, axis] < high)]


def write_wholes(writer, rng, each):
    identity = np.eye(4)

    def parts(kind, mesh, axis, extent, unit="m", count=9000):
        """Two parts of one scene that overlap along an axis."""
        share, points = rng.uniform(0.55, 0.75), [sampled(mesh, rng, count) for _ in range(2)]
        source, target = window(points[0], axis, -1, share * extent), window(points[1], axis, (1 - share) * extent, 1e9)
        writer.pair(kind, unit, source, target, identity)

    def both(kind, mesh, unit="cm", count=4000, noise=0.0):
        writer.pair(kind, unit, sampled(mesh, rng, count, noise), sampled(mesh, rng, count, noise), identity)

    for _ in range(each):
        both("symmetric_parts", shapes.gear(rng))
        both("symmetric_parts", shapes.prism(rng))
        both("whole_figures", shapes.figure(rng), noise=rng.choice([0.0, 0.005, 0.02]))
        size = rng.uniform([3, 3, 2.3], [7, 6, 3])
        both("whole_rooms", Mesh().room(size), unit="m", count=3000)
        both("whole_furnished_rooms", shapes.furnished_room(rng)[0], unit="m", count=8000)
        hall, length, _ = shapes.corridor(rng)
        parts("corridor_parts", hall, 0, length)
        store, extent = shapes.racks(rng)
        parts("rack_parts", store, 0, extent[0])
        climb, height = shapes.stairs(rng)
        parts("stair_parts", climb, 2, height)
        wall, length = shapes.brick_wall(rng)
        parts("brick_walls", wall, 0, length)
        grid, many = shapes.lattice(rng)
        parts("lattices", grid, 0, many - 1, count=12000)
        ground = shapes.terrain(rng)
        parts("terrains", ground, 0, 120, count=20000)
        first, second = (sampled(mesh, rng, 9000) for mesh in (ground, shapes.terrain(rng)))
        writer.pair("terrains", "m", first, second, None)
        statue = shapes.pedestal(rng)
        front = sampled(statue, rng, 8000)
        back = sampled(statue, rng, 8000)
        cut = rng.normal(size=2)
        keep = lambda points, sign: points[sign * points[:, :2] @ cut > -0.35 * np.linalg.norm(cut)]
        writer.pair("pedestal_parts", "cm", keep(front, 1), keep(back, rng.choice([-1, 1])), identity)
        body = shapes.figure(rng)
        whole = sampled(body, rng, 3000)
        writer.pair("mirrored_parts", "cm", whole, sampled(body, rng, 3000) @ MIRROR.T, None)
        scale = rng.choice([0.9, 0.95, 0.97, 1.05, 1.1])
        writer.pair("scaled_parts", "cm", whole, scale * sampled(body, rng, 3000), None)
        turned = sampled(body, rng, 3000) @ Rotation.random(random_state=int(rng.integers(2**31))).as_matrix().T
        heap = np.concatenate([sampled(body, rng, 3000), turned + [1.6, 0.2, 0.1]])
        writer.pair("two_instances", "cm", whole, heap, identity)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--each", type=int, default=10, help="scenes of each kind")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    for name, write, seed in (("views.csv", write_views, 0), ("wholes.csv", write_wholes, 1)):
        writer = Writer(asked.folder)
        write(writer, np.random.default_rng([asked.seed, seed]), asked.each)
        writer.finish(name)
        print(f"{name}: {len(writer.rows)} pairs")


if __name__ == "__main__":
    main()

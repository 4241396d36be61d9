"""Meshes of made scenes: rooms, corridors, streets, objects, and shapes that repeat."""

from dataclasses import dataclass, field

import numpy as np

BOX_FACES = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]]


@dataclass
class Mesh:
    """Vertices (N, 3) and triangles (M, 3), as lists of arrays that are joined when they are used."""

    parts: list = field(default_factory=list)

    def add(self, vertices, triangles):
        self.parts.append((np.asarray(vertices, float), np.asarray(triangles, int)))
        return self

    def quads(self, vertices, quads):
        quads = np.asarray(quads)
        return self.add(vertices, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))

    def rectangle(self, corner, along, across):
        """A rectangle from its corner and two edges."""
        corner, along, across = (np.asarray(value, float) for value in (corner, along, across))
        return self.quads([corner, corner + along, corner + along + across, corner + across], [[0, 1, 2, 3]])

    def box(self, low, high, angle=0.0):
        """A box between two corners, turned about the vertical axis through its centre."""
        low, high = np.asarray(low, float), np.asarray(high, float)
        corners = np.array([[(low, high)[k >> axis & 1][axis] for axis in range(3)] for k in range(8)])
        center = (low + high) / 2
        return self.quads((corners - center) @ turn_z(angle).T + center, BOX_FACES)

    def room(self, size, ceiling=False):
        """Floor and four walls from the origin to `size`."""
        x, y, z = size
        self.rectangle([0, 0, 0], [x, 0, 0], [0, y, 0])
        self.rectangle([0, 0, 0], [x, 0, 0], [0, 0, z]).rectangle([0, y, 0], [x, 0, 0], [0, 0, z])
        self.rectangle([0, 0, 0], [0, y, 0], [0, 0, z]).rectangle([x, 0, 0], [0, y, 0], [0, 0, z])
        return self.rectangle([0, 0, z], [x, 0, 0], [0, y, 0]) if ceiling else self

    def revolved(self, profile, steps, factor=lambda angle: 1.0, center=(0.0, 0.0, 0.0)):
        """A surface of revolution about the vertical axis through `center`: radii and heights of the
        profile, radii multiplied by a factor of the angle."""
        profile = np.asarray(profile, float)
        angles = 2 * np.pi * np.arange(steps) / steps
        radii = np.array([factor(angle) for angle in angles])[:, None] * profile[:, 0]
        vertices = np.stack(
            [radii * np.cos(angles)[:, None], radii * np.sin(angles)[:, None], np.tile(profile[:, 1], (steps, 1))], 2
        )
        return self.grid(np.concatenate([vertices, vertices[:1]]) + np.asarray(center))

    def grid(self, points):
        """A surface through a grid (I, J, 3) of points."""
        rows, columns = points.shape[:2]
        first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
        quads = np.column_stack([first, first + columns, first + columns + 1, first + 1])
        return self.quads(points.reshape(-1, 3), quads)

    def join(self, other, rotation=np.eye(3), translation=(0.0, 0.0, 0.0)):
        for vertices, triangles in other.parts:
            self.add(vertices @ np.asarray(rotation).T + np.asarray(translation), triangles)
        return self

    def scaled(self, factors):
        """The mesh with each axis multiplied by its factor."""
        return Mesh([(vertices * factors, triangles) for vertices, triangles in self.parts])

    def arrays(self):
        offsets = np.cumsum([0] + [len(vertices) for vertices, _ in self.parts])
        triangles = [part[1] + offset for part, offset in zip(self.parts, offsets)]
        return np.concatenate([part[0] for part in self.parts]), np.concatenate(triangles)


def turn_z(angle):
    """A rotation about the vertical axis."""
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def furniture(mesh, rng, count, low, high):
    """Boxes, tables and round pieces on the floor between two corners."""
    for _ in range(count):
        kind, angle = rng.integers(4), rng.uniform(0, np.pi)
        at = np.append(rng.uniform(low, high), 0.0)
        if kind == 0:
            height = rng.uniform(0.3, 1.8)
            mesh.revolved([[rng.uniform(0.1, 0.3), 0], [rng.uniform(0.1, 0.4), height], [0, height]], 24, center=at)
        elif kind == 1:
            half = rng.uniform([0.4, 0.3], [0.9, 0.5])
            top = rng.uniform(0.5, 1.0)
            mesh.box(at + [*-half, top - 0.04], at + [*half, top], angle)
            foot = turn_z(angle)[:2, :2] @ np.column_stack([half * 0.9, half * [0.9, -0.9]])
            for x, y in np.concatenate([foot.T, -foot.T]):
                mesh.box(at + [x - 0.03, y - 0.03, 0], at + [x + 0.03, y + 0.03, top - 0.04], angle)
        else:
            half = np.append(rng.uniform(0.15, 0.6, 2), rng.uniform(0.2, 1.0))
            mesh.box(at - [half[0], half[1], 0], at + half, angle)
    return mesh


def furnished_room(rng):
    """A room with furniture, and its size."""
    size = rng.uniform([3.0, 3.0, 2.3], [7.0, 6.0, 3.0])
    return furniture(Mesh().room(size), rng, rng.integers(4, 11), [0.5, 0.5], size[:2] - 0.5), size


def figure(rng):
    """An irregular object of about one unit: a bumpy body with parts that stick out."""
    waves = rng.normal(size=(7, 3)) * 2.2
    phase, height = rng.uniform(0, 2 * np.pi, 7), rng.uniform(0.02, 0.09, 7)

    def surface(direction):
        bumps = sum(h * np.sin(direction @ wave + p) for wave, p, h in zip(waves, phase, height))
        return direction * (0.5 + bumps)[..., None]

    polar, around = np.meshgrid(np.linspace(0, np.pi, 40), np.linspace(0, 2 * np.pi, 80), indexing="ij")
    sphere = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], 2)
    mesh = Mesh().grid(surface(sphere) * rng.uniform(0.7, 1.3, 3))
    for _ in range(rng.integers(0, 4)):
        at = rng.normal(size=3)
        at *= 0.5 / np.linalg.norm(at)
        half = rng.uniform(0.05, 0.2, 3)
        mesh.box(at - half, at + half, rng.uniform(0, np.pi))
    return mesh


def gear(rng):
    """A wheel of equal teeth."""
    teeth, inner, height = rng.integers(6, 25), rng.uniform(0.2, 0.5), rng.uniform(0.15, 0.6)
    depth = rng.uniform(0.08, 0.2)
    profile = [[inner, 0], [1, 0], [1, height], [inner, height], [inner, 0]]
    return Mesh().revolved(profile, 8 * teeth, lambda angle: 1 - depth * (np.sin(teeth * angle) > 0))


def prism(rng):
    """A box or a regular prism of few sides."""
    if rng.random() < 0.5:
        return Mesh().box([0, 0, 0], rng.uniform(0.5, 2.0, 3))
    sides = int(rng.integers(3, 9))
    return Mesh().revolved([[0, 0], [1, 0], [1, rng.uniform(0.3, 2)], [0, rng.uniform(2, 2.5)]], sides)


def pedestal(rng):
    """A regular pedestal, on it a figure that tells its sides apart."""
    sides = int(rng.choice([4, 6, 8, 12, 48]))
    profile = [[1.0, 0.0], [1.0, 0.4], [0.9, 0.45], [0.9, 0.7], [0.75, 0.8], [0.0, 0.8]]
    mesh = Mesh().revolved(profile, sides)
    return mesh.join(figure(rng).scaled(rng.uniform(0.4, 0.9)), translation=[0, 0, 1.1])


def corridor(rng):
    """A corridor of equal doors, its length, and the distance of doors."""
    length, width, period = rng.uniform(20, 40), rng.uniform(1.6, 3.0), rng.uniform(2.0, 4.0)
    mesh = Mesh().rectangle([0, 0, 0], [length, 0, 0], [0, width, 0])
    for y in (0.0, width):
        mesh.rectangle([0, y, 0], [length, 0, 0], [0, 0, 2.5])
    for x in np.arange(1.0, length - 1.2, period):
        mesh.box([x, -0.3, 0.0], [x + 1.0, 0.12, 2.1])
        if rng.random() < 0.5:
            mesh.box([x + 0.4, width - 0.12, 0.0], [x + 1.3, width + 0.3, 2.1])
    return mesh, length, period


def racks(rng):
    """A hall of equal racks, and its extent."""
    step, many = rng.uniform([2.0, 1.8], [4.0, 3.0]), rng.integers(4, 8, 2)
    extent = step * many
    mesh = Mesh().rectangle([0, 0, 0], [extent[0], 0, 0], [0, extent[1], 0])
    size, height = step * rng.uniform(0.3, 0.6, 2), rng.uniform(1.2, 3)
    for i in range(many[0]):
        for j in range(many[1]):
            corner = step * [i, j] + 0.2 * step
            mesh.box([*corner, 0.0], [*(corner + size), height])
    return mesh, extent


def street(rng):
    """A street between two rows of houses with windows, and cars; and its length."""
    length, width = rng.uniform(60, 100), rng.uniform(10, 18)
    mesh = Mesh().rectangle([0, 0, 0], [length, 0, 0], [0, width, 0])
    for y, out in ((0.0, -1.0), (width, 1.0)):
        x = 0.0
        while x < length:
            front, height = rng.uniform(8, 20), rng.uniform(6, 14)
            set_back = out * rng.choice([0.0, 0.0, 1.5])
            mesh.rectangle([x, y + set_back, 0], [front, 0, 0], [0, 0, height])
            for window in np.arange(x + 1, x + front - 1.5, 3.0):
                mesh.box([window, y + set_back - 0.15, 1.0], [window + 1.3, y + set_back + 0.15, 2.6])
            x += front
    for _ in range(rng.integers(3, 14)):
        at = np.array([rng.uniform(2, length - 6), rng.choice([0.6, width - 2.4]), 0.0])
        mesh.box(at, at + [4.2, 1.8, 0.9]).box(at + [0.9, 0.1, 0.9], at + [3.4, 1.7, 1.5])
    return mesh, length, width


def stairs(rng):
    """Spiral stairs about a column, and their height."""
    steps, turn, rise = int(rng.integers(16, 40)), rng.uniform(0.2, 0.5), rng.uniform(0.12, 0.22)
    mesh = Mesh().revolved([[0.3, -0.2], [0.3, steps * rise]], 24)
    for k in range(steps):
        center = np.array([1.2 * np.cos(turn * k), 1.2 * np.sin(turn * k), rise * k])
        mesh.box(center - [0.6, 0.18, 0.03], center + [0.6, 0.18, 0.03], turn * k)
    return mesh, steps * rise


def terrain(rng):
    """A hilly ground of 120 units with some buildings."""
    x, y = np.meshgrid(np.linspace(0, 120, 241), np.linspace(0, 120, 241), indexing="ij")
    height = np.zeros_like(x)
    for _ in range(14):
        wave = rng.normal(size=2) * 0.12
        height += rng.uniform(0.2, 1.0) / (0.3 + 8 * np.linalg.norm(wave)) * np.sin(
            wave[0] * x + wave[1] * y + rng.uniform(0, 2 * np.pi)
        )
    mesh = Mesh().grid(np.stack([x, y, height], 2))
    for _ in range(rng.integers(3, 16)):
        at = np.append(rng.uniform(5, 110, 2), -3.0)
        mesh.box(at, at + [*rng.uniform(5, 14, 2), rng.uniform(7, 14)], rng.uniform(0, np.pi))
    return mesh


def forest(rng):
    """Trunks on a flat ground of 40 units."""
    mesh = Mesh().rectangle([0, 0, 0], [40, 0, 0], [0, 40, 0])
    for at in rng.uniform(1, 39, (rng.integers(60, 160), 2)):
        radius = rng.uniform(0.08, 0.3)
        mesh.revolved([[radius, 0], [0.7 * radius, rng.uniform(4, 12)]], 12, center=[*at, 0.0])
    return mesh


def brick_wall(rng):
    """A wall of equal bricks with joints, and its length."""
    many, rows, size = int(rng.integers(14, 26)), int(rng.integers(8, 14)), np.array([0.5, 0.25])
    mesh = Mesh().rectangle([0, 0, 0], [many * size[0], 0, 0], [0, 0, rows * size[1]])
    for row in range(rows):
        for k in range(many):
            corner = size * [k + 0.5 * (row % 2), row]
            mesh.box([corner[0], -0.06, corner[1]], [corner[0] + 0.44, 0.0, corner[1] + 0.19])
    return mesh, many * size[0]


def lattice(rng):
    """Equal balls on a grid, and the number of balls along an edge."""
    many, radius = int(rng.integers(4, 6)), rng.uniform(0.2, 0.4)
    profile = [[radius * np.sin(t), -radius * np.cos(t)] for t in np.linspace(0, np.pi, 9)]
    mesh = Mesh()
    for at in np.ndindex(many, many, 2):
        mesh.revolved(profile, 14, center=np.array(at, float))
    return mesh, many

"""From two files to an aligned picture, and a table of weights: a lesson in cfreg.

    python -m peers.tutorial SOURCE TARGET [--truth T.txt] [--output FOLDER] [--points N]

Without files it takes two scans of the Stanford bunny, seen 45 degrees apart (of CFREG_DATA,
else ../shared/data beside the repository), or draws two reliefs where there are none. The
folder gets aligned.ply, aligned.png, kernels.png, weights.csv and weights.png.

There is no voxel size here, no search radius, no distance threshold. `with_open3d.py` does the
same with Open3D's API, and has to choose them; its answer has no verdict.
"""

import argparse
import csv
from pathlib import Path

import cfreg
import numpy as np
from cfreg.weights import (
    BOTH,
    NONE,
    SOURCE,
    TARGET,
    Cauchy,
    Gaussian,
    GemanMcClure,
    Laplacian,
    StudentT,
    Truncated,
    Tukey,
    Uniform,
    sinkhorn,
)

from peers.tutorial import pictures
from reference import scans

COLUMNS = ("effective connections", "agreement", "trusted", "rotation off, deg", "seconds")


def steep(d2):
    """A weight of one's own: any function of the squared distances."""
    return 1.0 / (1.0 + (d2 / 60.0) ** 2)


SCHEMES = (
    (Uniform(), NONE),  # the control: every pair alike, so that the descriptors say nothing
    (Gaussian(100), NONE),  # the paper's
    (Gaussian(30), NONE),
    (Gaussian("auto"), NONE),
    (Laplacian(30), NONE),
    (Cauchy(30), NONE),
    (GemanMcClure(30), NONE),
    (StudentT(30, nu=3), NONE),
    (Truncated(30), NONE),
    (Tukey(100), NONE),
    (Gaussian(30) * Tukey(200), NONE),
    (0.9 * Gaussian(20) + 0.1 * Cauchy(100), NONE),
    (steep, NONE),
    (steep, SOURCE),  # every source point speaks with one voice
    (steep, TARGET),
    (steep, BOTH),  # dual softmax: what both sides prefer
    (steep, sinkhorn(10)),
    (Gaussian("auto"), BOTH),
)


def main():
    options = arguments()
    folder = Path(options.output)
    folder.mkdir(parents=True, exist_ok=True)

    # 1. Read. A cloud tells what it is; it keeps f32 points about an f64 origin, so that map
    # coordinates lose nothing, and drops and counts what is not finite.
    source_file, target_file, truth = files(options, folder)
    source, target = cfreg.read(source_file), cfreg.read(target_file)
    print(f"source {source}\ntarget {target}\n")

    # 2. Register. Thousands of points tell a pose as well as hundred thousands.
    a, b = source.sample(options.points), target.sample(options.points, seed=1)
    plain = cfreg.register(a, b, "cf")
    print(plain)

    # 3. Read the verdict: `plain.trusted` and `plain.doubts`. These clouds share but a part,
    # which pulls the pose of one step away. Descriptors at three scales and a refinement help.
    best = cfreg.register(a, b, "cf-multiscale", refine="gicp")
    print(f"{best}\n")
    if truth is not None:
        error = cfreg.evaluate(a, b, best.transform, truth=truth).truth
        print(f"off by {error.rotation_deg:.2f} deg and, in the clouds' unit, {error.translation:.2g}\n")

    # 4. Use the pose: on the whole cloud, in files, in pictures.
    cfreg.write(folder / "aligned.ply", best.apply(source))
    pictures.clouds(source, target, best, folder / "aligned.png")

    # 5. Take it apart. `register` describes every point, weighs every pair by how alike its two
    # descriptors are, sums, and solves once. Each stage takes what one brings instead.
    features = [cfreg.fpfh(cloud) for cloud in (a, b)]
    moments = cfreg.moments(a, b, *features, weights=Gaussian(100))
    by_hand = cfreg.solve(moments)
    pairs = f"{moments.effective_connections:,.0f} of {len(a) * len(b):,} pairs count"
    print(f"by hand the pose differs by {abs(by_hand - plain.transform).max():.0e}; {pairs}\n")

    # 6. Try weights: how far is the pose off the true one, or else off the refined one?
    right = best.transform if truth is None else truth
    drawn = (Gaussian(100), Laplacian(100), Cauchy(100), StudentT(100, nu=3), Tukey(400), steep)
    pictures.kernels(drawn, a, b, features, right, folder / "kernels.png")
    rows = [row(a, b, weights, normalize, right) for weights, normalize in SCHEMES]
    print_table(rows)
    with open(folder / "weights.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    pictures.table(rows, folder / "weights.png", "the refined pose" if truth is None else "the truth")
    print(f"\nwrote aligned.ply, three pictures and weights.csv to {folder}")


def row(source, target, weights, normalize, right):
    """The pose that one step finds with these weights, and on how many pairs it rests."""
    scheme = {"weights": getattr(weights, "__name__", str(weights)), "normalize": normalize}
    try:
        found = cfreg.register(source, target, "cf", weights=weights, normalize=normalize)
    except cfreg.RegistrationError as error:  # such as weights that are all alike
        return scheme | dict.fromkeys(COLUMNS, "") | {"trusted": type(error).__name__}
    error = cfreg.evaluate(source, target, found.transform, truth=right).truth
    values = (
        round(found.effective_connections),
        round(found.evaluation.agreement, 3),
        found.trusted,
        round(error.rotation_deg, 2),
        round(found.seconds["total"], 3),
    )
    return scheme | dict(zip(COLUMNS, values))


def print_table(rows):
    widths = {name: max(len(name), *(len(str(row[name])) for row in rows)) for name in rows[0]}
    for cells in ({name: name for name in widths}, *rows):
        print("  ".join(str(cells[name]).ljust(width) for name, width in widths.items()).rstrip())


def files(options, folder):
    """Paths of source and target, and the true pose if it is known."""
    if options.source:
        truth = None if options.truth is None else np.loadtxt(options.truth)
        return options.source, options.target, truth
    data = scans.data_folder()
    if data is not None:
        names = "stanford_bunny/bun000.ply", "stanford_bunny/bun045.ply"
        pairs = scans.read_pairs(data / "pairs.csv")
        pair = next(row for row in pairs if (row["source"], row["target"]) == names)
        return data / names[0], data / names[1], pair["truth"]
    print("no scans (CFREG_DATA and ../shared/data are absent): two reliefs instead")
    pair = scans.relief_pair(4000, seed=0)
    truth = np.eye(4)
    truth[:3, :3], truth[:3, 3] = pair.rotation, pair.translation
    for name, points, seen_from in (
        ("source", pair.source, pair.source_viewpoint),
        ("target", pair.target, pair.target_viewpoint),
    ):
        cfreg.write(folder / f"{name}.pcd", cfreg.PointCloud(points, viewpoint=seen_from))
    return folder / "source.pcd", folder / "target.pcd", truth


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("source", nargs="?", help="cloud that is moved")
    parser.add_argument("target", nargs="?", help="cloud that stays")
    parser.add_argument("--truth", help="true pose, 4 lines of 4 numbers")
    parser.add_argument("--output", default="tutorial", help="folder for what is made")
    parser.add_argument("--points", type=int, default=4000, help="of each cloud that are registered")
    options = parser.parse_args()
    if options.source and not options.target:
        parser.error("a SOURCE needs its TARGET")
    return options


if __name__ == "__main__":
    main()

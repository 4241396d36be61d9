"""From two files to an aligned picture, and a table of weights: a lesson in cfreg.

    python tutorial.py SOURCE TARGET [--truth T.txt] [--output FOLDER] [--points N]

Without files it takes two scans of the Stanford bunny, seen 45 degrees apart (of CFREG_DATA,
else ../shared/data beside the repository), or draws two reliefs where there are none. The
folder gets aligned.ply, aligned.png, weights.csv and weights.png.

What is not here: a voxel size, a search radius, a distance threshold. `tutorial_open3d.py`
does the same with Open3D's API, and has to choose them.
"""

import argparse
import csv
import time
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import cfreg
import matplotlib.pyplot as plt
import numpy as np
from cfreg.weights import BOTH, NONE, Cauchy, Gaussian, Tukey

import scans

BLUE, ORANGE = "#2f6f9f", "#e07b39"


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
    plain = cfreg.register(a, b)
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
    draw_clouds(source, target, best, folder / "aligned.png")

    # 5. Try weights. The descriptors stay, only W changes: moments, then a closed form.
    rows = table_of_weights(a, b, best.transform if truth is None else truth)
    print_table(rows)
    with open(folder / "weights.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    draw_table(rows, folder / "weights.png", "the refined pose" if truth is None else "the truth")
    print(f"\nwrote aligned.ply, aligned.png, weights.csv and weights.png to {folder}")


def table_of_weights(source, target, truth):
    """One row a scheme: how far its pose is from `truth`, and on how many pairs it rests."""

    def steep(d2):
        """A weight of one's own: any function of the squared distances."""
        return 1.0 / (1.0 + (d2 / 60.0) ** 2)

    schemes = [
        ("gaussian", NONE),  # the paper's, with beta = 100
        (Gaussian(30), NONE),
        (Gaussian("auto"), NONE),
        (Cauchy(30), NONE),
        (Gaussian(30) * Tukey(200), NONE),
        (0.9 * Gaussian(20) + 0.1 * Cauchy(100), NONE),
        (steep, NONE),
        ("gaussian", BOTH),  # dual softmax: what both sides prefer
        (Gaussian("auto"), BOTH),
        (steep, BOTH),
    ]
    features = [cfreg.fpfh(cloud) for cloud in (source, target)]
    rows = []
    for weights, normalize in schemes:
        begun = time.perf_counter()
        moments = cfreg.moments(source, target, *features, weights=weights, normalize=normalize)
        pose = cfreg.solve(moments)
        seconds = time.perf_counter() - begun
        judged = cfreg.evaluate(source, target, pose, truth=truth)
        rows.append(
            {
                "weights": getattr(weights, "__name__", str(weights)),
                "normalize": normalize,
                "effective connections": round(moments.effective_connections),
                "agreement": round(judged.agreement, 3),
                "rotation off, deg": round(judged.truth.rotation_deg, 2),
                "seconds": round(seconds, 3),
            }
        )
    return rows


def draw_clouds(source, target, found, path):
    """Before and after, as the target's sensor sees it, and from above."""
    figure, axes = plt.subplots(2, 2, figsize=(9, 8), layout="constrained")
    verdict = "trusted" if found.trusted else "not to be trusted"
    pictures = (("as they are", source), (f"{found.method}: {verdict}", found.apply(source)))
    for column, (title, moved) in zip(axes.T, pictures):
        for axis, (x, y) in zip(column, ((0, 1), (0, 2))):
            for cloud, colour in ((target, BLUE), (moved, ORANGE)):
                points = cloud.sample(8000).points
                axis.scatter(points[:, x], points[:, y], s=0.6, color=colour, linewidths=0)
            axis.set(aspect="equal", xlabel="xyz"[x], ylabel="xyz"[y])
            axis.locator_params(nbins=5)
        column[0].set_title(title)
    names, marks = ["target", "source"], axes[0, 0].collections
    figure.legend(marks, names, markerscale=10, ncols=2, frameon=False, loc="outside upper center")
    figure.savefig(path, dpi=120)
    plt.close(figure)


def draw_table(rows, path, against):
    """How far each scheme's pose is off, dual softmax in another colour."""
    figure, axis = plt.subplots(figsize=(9, 4.5), layout="constrained")
    names = [f"{row['weights']}, {row['normalize']}" for row in rows]
    off = [row["rotation off, deg"] for row in rows]
    colours = [ORANGE if row["normalize"] == BOTH else BLUE for row in rows]
    bars = axis.barh(names, off, color=colours)
    axis.bar_label(bars, fmt="%.1f", padding=3)
    axis.invert_yaxis()
    axis.margins(x=0.1)
    axis.spines[["top", "right"]].set_visible(False)
    axis.set(xlabel=f"rotation off {against}, degrees", title="One step, other weights")
    figure.savefig(path, dpi=120)
    plt.close(figure)


def print_table(rows):
    widths = {name: max(len(name), *(len(str(row[name])) for row in rows)) for name in rows[0]}
    for cells in ({name: name for name in widths}, *rows):
        print("  ".join(str(cells[name]).ljust(width) for name, width in widths.items()).rstrip())


def files(options, folder):
    """Paths of source and target, and the true pose if it is known."""
    if options.source and options.target:
        truth = None if options.truth is None else np.loadtxt(options.truth)
        return options.source, options.target, truth
    data = scans.data_folder()
    if data is not None:
        names = "stanford_bunny/bun000.ply", "stanford_bunny/bun045.ply"
        with open(data / "pairs.csv") as file:
            pair = next(row for row in csv.DictReader(file) if (row["source"], row["target"]) == names)
        truth = [[float(pair[f"t{i}{j}"]) for j in range(4)] for i in range(4)]
        return data / names[0], data / names[1], np.array(truth)
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
    return parser.parse_args()


if __name__ == "__main__":
    main()

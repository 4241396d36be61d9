"""The pictures of the tutorial, by matplotlib, into files."""

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

BLUE, ORANGE, GREY = "#2f6f9f", "#e07b39", "#9a9a9a"


def clouds(source, target, found, path):
    """Before and after, as the target's sensor sees it, and from above."""
    figure, axes = plt.subplots(2, 2, figsize=(9, 8), layout="constrained")
    verdict = "no warning" if found.trusted else "has warnings"
    turns = (("as they are", source), (f"{found.method}: {verdict}", found.apply(source)))
    for column, (title, moved) in zip(axes.T, turns):
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


def kernels(schemes, source, target, features, right, path):
    """Kernels over the squared distance of descriptors, and how far apart those of right pairs
    (nearest under the right pose) and of any pairs are: a kernel has to tell them apart."""
    some = np.linspace(0, len(source) - 1, 300).astype(int)
    points = source.points[some] @ right[:3, :3].T + right[:3, 3]
    nearest = ((points[:, None] - target.points[None]) ** 2).sum(axis=2).argmin(axis=1)
    any_target = np.roll(nearest, 100)
    d2 = np.geomspace(1.0, 1e5, 500)
    figure, (above, below) = plt.subplots(
        2, 1, figsize=(9, 6), sharex=True, height_ratios=(3, 1), layout="constrained"
    )
    for weights in schemes:
        above.plot(d2, weights(d2), label=getattr(weights, "__name__", str(weights)))
    above.set(xscale="log", ylabel="weight", title="Weight of a pair, by how unlike its descriptors are")
    above.legend(frameon=False)
    for partners, colour, name in ((any_target, GREY, "any pairs"), (nearest, ORANGE, "right pairs")):
        apart = ((features[0][some] - features[1][partners]) ** 2).sum(axis=1)
        below.hist(apart, bins=d2[::10], color=colour, alpha=0.7, label=name)
    below.set(xlabel="squared distance of the descriptors, d\u00b2", ylabel="pairs")
    below.legend(frameon=False, loc="upper left")
    figure.savefig(path, dpi=120)
    plt.close(figure)


def table(rows, path, against):
    """How far each scheme's pose is off, normalised ones in another colour, and its verdict."""
    rows = [row for row in rows if row["rotation off, deg"] != ""]
    figure, axis = plt.subplots(figsize=(9, 6), layout="constrained")
    names = [f"{row['weights']}, {row['normalize']}" for row in rows]
    off = [row["rotation off, deg"] for row in rows]
    colours = [BLUE if row["normalize"] == "none" else ORANGE for row in rows]
    verdicts = [f"{row['rotation off, deg']:.1f}{', trusted' if row['trusted'] else ''}" for row in rows]
    axis.bar_label(axis.barh(names, off, color=colours), labels=verdicts, padding=3)
    axis.invert_yaxis()
    axis.margins(x=0.25, y=0.01)
    axis.spines[["top", "right"]].set_visible(False)
    axis.set(xlabel=f"rotation off {against}, degrees", title="One step, other weights")
    figure.savefig(path, dpi=120)
    plt.close(figure)

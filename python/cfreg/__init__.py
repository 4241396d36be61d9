"""Rigid point-cloud registration without correspondences and without an initial guess.

>>> import cfreg, numpy as np
>>> x, y = np.random.default_rng(0).uniform(-1, 1, (2, 1000))
>>> source = np.column_stack([x, y, 0.4 * np.sin(3 * x + y) + 0.2 * x * x - 2])
>>> target = source @ np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
>>> found = cfreg.register(source, target)
>>> found.trusted, round(found.angle_deg), found.transform.shape
(True, 90, (4, 4))

`register` does everything, `register_batch` for many pairs; `Consensus`, `CF`, `CFSpectral`, `CFK`, `TEASER`,
`ICP`, `KC`, `CPD` and `DARE` are its methods as objects. `read`, `write` and `PointCloud` hold
clouds, `apply` moves whole files; `evaluate` measures a pose, `verify` tells whether it is right.
`estimate_normals`, `keypoints`, `fpfh`, `moments` and `solve` are the stages, and `weights` the
kernels, for those who bring descriptors or weights of their own.

Points are numbers (N, 3) in any unit, points in rows: numpy arrays of float32 or float64 with any
strides, arrays of other numbers and lists of rows, which become float64, or clouds of Open3D,
trimesh, pyvista and small_gicp. `source` is moved onto `target`: a pose is the 4x4 matrix
T_target_source. Results are the same bits for any number of threads. No function holds the
interpreter while it computes; Ctrl-C ends it.

Errors: an Error, which is a ValueError, naming the argument: ShapeError, NonFiniteError,
SettingError, FileFormatError, ExtentError, or Error itself for what is no array of numbers;
RegistrationError where the clouds do not determine an answer: TooFewPointsError, NoWeightError,
DegenerateError; InternalError for a bug. TypeError for what is no method, kernel or setting at all,
OSError for files that cannot be read or written.
"""

from . import pairs, weights
from ._native import (
    DegenerateError,
    Error,
    ExtentError,
    FileFormatError,
    InternalError,
    Moments,
    NonFiniteError,
    NoWeightError,
    PointCloud,
    RegistrationError,
    SettingError,
    ShapeError,
    TooFewPointsError,
    __version__,
    apply,
    estimate_normals,
    fpfh,
    keypoints,
    moments,
    moments_of_pairs,
    read,
    solve,
    write,
)
from .batch import register_batch
from .batch_results import BatchResult, BatchSummary, read_batch
from .methods import (
    CF,
    CFK,
    CPD,
    DARE,
    ICP,
    KC,
    METHODS,
    TEASER,
    CFSpectral,
    Consensus,
    Method,
    method,
    register,
    verify,
)
from .prior import Prior
from .results import (
    Evaluation,
    EvaluationReport,
    PoseCovariance,
    PoseError,
    PoseWarning,
    Registration,
    RunnerUp,
    Verdict,
    evaluate,
)

__all__ = [
    "BatchResult",
    "BatchSummary",
    "CF",
    "CFK",
    "CFSpectral",
    "CPD",
    "Consensus",
    "DARE",
    "DegenerateError",
    "Error",
    "Evaluation",
    "EvaluationReport",
    "ExtentError",
    "FileFormatError",
    "ICP",
    "InternalError",
    "KC",
    "METHODS",
    "Method",
    "Moments",
    "NoWeightError",
    "NonFiniteError",
    "PointCloud",
    "PoseCovariance",
    "PoseError",
    "PoseWarning",
    "Prior",
    "Registration",
    "RegistrationError",
    "RunnerUp",
    "SettingError",
    "ShapeError",
    "TEASER",
    "TooFewPointsError",
    "Verdict",
    "__version__",
    "apply",
    "estimate_normals",
    "evaluate",
    "fpfh",
    "keypoints",
    "method",
    "moments",
    "moments_of_pairs",
    "pairs",
    "read",
    "read_batch",
    "register",
    "register_batch",
    "solve",
    "verify",
    "weights",
    "write",
]

_OLD_NAMES = {
    "Doubt": "PoseWarning",
    "Judgement": "EvaluationReport",
    "TruthError": "PoseError",
    "judge": "verify",
}


def __getattr__(name: str) -> object:
    """Names of an earlier release, with a warning."""
    if name in _OLD_NAMES:
        import warnings

        new = _OLD_NAMES[name]
        warnings.warn(f"cfreg.{name} is now cfreg.{new}", DeprecationWarning, stacklevel=2)
        return globals()[new]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

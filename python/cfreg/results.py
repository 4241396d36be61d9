"""What registrations return."""

from __future__ import annotations

import base64
import copy
import json
import math
import os
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _interop, _native

if TYPE_CHECKING:
    import numpy.typing as npt

__all__ = ["PoseWarning", "Evaluation", "PoseCovariance", "Registration", "RunnerUp", "PoseError", "Verdict", "evaluate"]


@dataclass(frozen=True)
class Evaluation:
    """How the clouds lie on each other under a pose.

    fitness : share of *source* points that have a target point within max_distance, 0 to 1
    target_fitness : share of *target* points that have a source point within it
    inlier_rmse : root mean square distance of the pairs in fitness, in the target's unit;
        NaN where there is none
    max_distance : largest distance that counts, in the target's unit
    chance : fitness of wrong rotations of the same clouds
    agreement : fitness beyond chance, (fitness - chance)/(1 - chance): comparable between
        clouds of different density and shape, where fitness is not
    """

    fitness: float
    target_fitness: float
    inlier_rmse: float
    max_distance: float
    chance: float
    agreement: float

    @classmethod
    def _of(cls, facts: dict[str, Any]) -> Evaluation:
        return cls(**{name: math.nan if value is None else value for name, value in facts.items()})


@dataclass(frozen=True)
class PoseError:
    """How far a pose is from the true one.

    rotation_deg : angle between the rotations, degrees
    rotation_frobenius : ||I - R Rgt^T||_F, the paper's accuracy, 0 to 2.83
    translation : distance at the source's centroid, in the target's unit
    """

    rotation_deg: float
    rotation_frobenius: float
    translation: float


@dataclass(frozen=True)
class EvaluationReport(Evaluation):
    """An Evaluation, and the error against the truth where that was given.

    truth : PoseError, or None
    """

    truth: PoseError | None = None


def evaluate(
    source: Any,
    target: Any,
    transform: npt.ArrayLike,
    max_distance: float | None = None,
    truth: npt.ArrayLike | None = None,
) -> EvaluationReport:
    """Look at the clouds under a pose, whoever found it.

    Parameters
    ----------
    source, target : see `cfreg.register`
    transform : (4, 4), maps source points into the frame of the target; or a Registration
    max_distance : largest distance that counts, in the target's unit. None: twice the
        resolution of the coarser cloud
    truth : (4, 4), the true pose, if known

    Returns
    -------
    EvaluationReport : fitness, inlier_rmse and more; `truth` has the errors of the pose

    Raises
    ------
    TooFewPointsError : an empty cloud
    SettingError : no rigid matrix, or a max_distance that is negative or not finite

    Examples
    --------
    >>> import cfreg, numpy as np
    >>> points = np.random.default_rng(0).random((200, 3))
    >>> cfreg.evaluate(points, points, np.eye(4)).fitness
    1.0
    """
    found = json.loads(_native.evaluate(source, target, transform, max_distance, truth))
    error = found.pop("truth")
    evaluation = Evaluation._of(found)
    return EvaluationReport(**vars(evaluation), truth=None if error is None else PoseError(**error))


@dataclass(frozen=True)
class PoseWarning:
    """A ground to doubt a pose.

    ground : its name: "low-agreement", "weak-rotation", "not-converged" and others
    message : what it says
    facts : the numbers it rests on, such as found and needed
    """

    ground: str
    message: str
    facts: dict[str, float]

    @classmethod
    def _of(cls, facts: dict[str, Any]) -> PoseWarning:
        rest = {name: fact for name, fact in facts.items() if name not in ("ground", "message")}
        return cls(facts["ground"], facts["message"], rest)

    def __str__(self) -> str:
        return self.message


@dataclass(frozen=True, eq=False)
class RunnerUp:
    """Another pose that would do.

    transform : (4, 4) float64, as that of a Registration
    probability : that it is the right one
    """

    transform: npt.NDArray[np.float64]
    probability: float


@dataclass(frozen=True, eq=False)
class PoseCovariance:
    """How far a pose may be off, if it is the right one.

    With c the center and T the pose, the true pose maps p to exp(w) (T p - c) + c + t.

    matrix : (6, 6) float64, covariance of (w, t): rotation vector in radians, then shift in
        the target's unit
    center : (3,) what turns are about, in the target's frame
    undetermined : (K, 6) motions (w, t) along which nothing holds the pose, K from 0 to 6; along
        them the matrix has the size of the overlap, in place of infinity
    """

    matrix: npt.NDArray[np.float64]
    center: npt.NDArray[np.float64]
    undetermined: npt.NDArray[np.float64]

    @classmethod
    def _of(cls, facts: dict[str, Any]) -> PoseCovariance:
        motions = [motion["rotation"] + motion["translation"] for motion in facts["undetermined"]]
        undetermined = np.array(motions, dtype=float).reshape(-1, 6)
        return cls(np.array(facts["matrix"]), np.array(facts["center"]), undetermined)


@dataclass(frozen=True, eq=False)
class Verdict:
    """Whether to take a pose, and why.

    decision : "accept"; "ambiguous" (an alternative pose is possible, or a motion is
        unconstrained); "uncertain" (neither accepted nor improbable); or "reject" (probably wrong)
    probability : that the pose is right, 0 to 1
    reasons : what speaks for and against it, in words
    overlap : share of a surface that lies on the other and faces alike, the larger of both
    evidence : measurements for and against it by name, as in JSON: overlap, surface_conflict,
        residual_std, surface_patches, descriptor_distinctiveness, inlier_score,
        free_space_violation (None without known viewpoints)
    runner_up : RunnerUp, the best pose that is another, or None
    covariance : PoseCovariance, or None where too few points lie on each other to tell; of a
        refinement, that of the pose before
    other_scale : the scale of the source, if that is another than it has, at which clearly more
        of it would lie on the target, or None
    mirrored : whether the mirror image of the source fits the target better
    model : version of the model that gave probability and decision
    """

    decision: str
    probability: float
    reasons: tuple[str, ...]
    overlap: float
    runner_up: RunnerUp | None
    covariance: PoseCovariance | None
    other_scale: float | None = None
    model: str = ""
    evidence: dict[str, float | None] = field(default_factory=dict)
    mirrored: bool = False

    @classmethod
    def _of(cls, facts: dict[str, Any]) -> Verdict:
        other = facts["runner_up"]
        runner_up = None
        if other is not None:
            runner_up = RunnerUp(np.array(other["transform"]), other["probability"])
        return cls(
            facts["decision"],
            facts["probability"],
            tuple(facts["reasons"]),
            facts["overlap"],
            runner_up,
            None if facts["covariance"] is None else PoseCovariance._of(facts["covariance"]),
            facts["other_scale"],
            facts["model"],
            facts["evidence"] or {},
            facts["mirrored"],
        )


class Registration:
    """A pose, what it rests on, and what speaks against it.

    transform : (4, 4) float64, read-only, T_target_source: maps source points into the
        target's frame, in the unit of the target
    method : name of the method
    trusted : whether there is no warning
    warnings : PoseWarning each, empty for a pose that may be trusted; `doubts` in JSON
    verdict : Verdict on the pose that is returned; None where it was left out (verdict=False) or
        could not be had
    evaluation : Evaluation of the clouds under the pose
    weighted_rms : root mean square of the weighted connections, in the target's unit; of the
        size of the cloud on a full connection, whatever the pose
    beta : squared bandwidth in force, for methods that weigh by descriptors
    eigenvalue_ratio : of "cf-spectral": near 1, another pose has about as much support
    connections, effective_connections : pairs that were weighed, and (sum w)^2 / sum w^2
    singular_values : three, of the weighted cross-covariance, relative to the clouds' spread
    iterations, stop : how often weights were made and solved, and what ended it
    points : of "source" and "target" the points dropped, used and described
    seconds : of each stage by name, and "total"
    config : every setting that was in force
    trace : every iteration, where `trace` was set
    certificate : of "teaser", where `certify` was set
    refined_from : the Registration that this one refined, or None

    It cannot be changed, equals another in all but the seconds, pickles, and tells itself in a
    line (repr), in a table with a picture (notebooks), on a page (report) and in full (to_dict).
    It refers to the clouds until it is pickled.
    """

    transform: npt.NDArray[np.float64]
    method: str
    trusted: bool
    warnings: tuple[PoseWarning, ...]
    verdict: Verdict | None
    evaluation: Evaluation
    weighted_rms: float
    beta: float | None
    eigenvalue_ratio: float | None
    connections: int
    effective_connections: float
    singular_values: tuple[float, float, float]
    iterations: int
    stop: str
    points: dict[str, dict[str, Any]]
    seconds: dict[str, float]
    config: dict[str, Any]
    trace: list[dict[str, Any]]
    certificate: dict[str, Any] | None
    refined_from: Registration | None
    _facts: dict[str, Any]
    _clouds: tuple[Any, Any] | None

    def __init__(self, facts: dict[str, Any], clouds: tuple[Any, Any] | None = None) -> None:
        own, facts = facts, copy.deepcopy(facts)  # what it shows may be written to
        try:
            self._take(own, facts, clouds)
        except (LookupError, TypeError, ValueError, AttributeError) as error:
            rule = "must be what to_dict() or `cfreg register --json` gives"
            why = _interop.ends(f"{type(error).__name__}: {error}")
            raise _native.SettingError(f"facts: {rule} ({why})") from None

    def _take(self, own: dict[str, Any], facts: dict[str, Any], clouds: tuple[Any, Any] | None) -> None:
        transform = np.array(facts["transform"], dtype=np.float64)
        transform.setflags(write=False)
        before = facts.get("refined_from")
        same = (
            "method",
            "trusted",
            "weighted_rms",
            "connections",
            "effective_connections",
            "iterations",
            "stop",
            "points",
            "config",
        )
        vars(self).update(
            {name: facts[name] for name in same},
            transform=transform,
            warnings=tuple(PoseWarning._of(warning) for warning in facts["doubts"]),
            verdict=Verdict._of(facts["verdict"]) if facts.get("verdict") else None,
            evaluation=Evaluation._of(facts["evaluation"]),
            beta=facts.get("beta"),
            eigenvalue_ratio=facts.get("eigenvalue_ratio"),
            singular_values=tuple(facts["singular_values"]),
            seconds=facts["time_s"],
            trace=facts.get("trace", []),
            certificate=facts.get("certificate"),
            refined_from=None if before is None else Registration(before),
            _facts=own,
            _clouds=clouds,
        )

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"{name}: a registration cannot be changed")

    @property
    def doubts(self) -> tuple[PoseWarning, ...]:
        """The warnings, by their name in JSON."""
        return self.warnings

    @property
    def transformation(self) -> npt.NDArray[np.float64]:
        """The transform, by its name in Open3D."""
        return self.transform

    @property
    def fitness(self) -> float:
        """Share of the source points with a target point within `evaluation.max_distance`."""
        return self.evaluation.fitness

    @property
    def inlier_rmse(self) -> float:
        """Root mean square distance of the pairs in `fitness`, in the target's unit."""
        return self.evaluation.inlier_rmse

    @property
    def probability(self) -> float | None:
        """Probability that the pose is right; None without a verdict."""
        return None if self.verdict is None else self.verdict.probability

    def inverse(self) -> npt.NDArray[np.float64]:
        """(4, 4), maps target points into the frame of the source."""
        return np.asarray(np.linalg.inv(self.transform), dtype=np.float64)

    @property
    def scale(self) -> float:
        """Scale of the transform; 1 unless one was asked for."""
        return float(np.cbrt(np.linalg.det(self.transform[:3, :3])))

    @property
    def rotation(self) -> npt.NDArray[np.float64]:
        """(3, 3) rotation."""
        rotation: npt.NDArray[np.float64] = self.transform[:3, :3] / self.scale
        return rotation

    @property
    def translation(self) -> npt.NDArray[np.float64]:
        """(3,) translation, in the target's unit."""
        return self.transform[:3, 3]

    @property
    def angle_deg(self) -> float:
        """Angle of the rotation, 0 to 180 degrees."""
        r = self.rotation
        sine = [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]
        return math.degrees(math.atan2(float(np.linalg.norm(sine)), float(np.trace(r)) - 1.0))

    def apply(self, cloud: Any) -> Any:
        """`cloud`, of any kind that register takes, moved by the pose: the same kind again, but a
        PointCloud of the path of a file."""
        return _interop.moved(cloud, self.transform)

    def to_dict(self) -> dict[str, Any]:
        """All of it as `cfreg register --json` prints it: only JSON's own types."""
        return copy.deepcopy(self._facts)

    def to_json(self, indent: int | None = None) -> str:
        """The same as text."""
        return json.dumps(self._facts, indent=indent)

    def report(self, path: str | os.PathLike[str], source: Any = None, target: Any = None) -> None:
        """Write a page that shows the clouds before and after, whether to trust the pose and why.

        It is one file that needs no network, as `cfreg register --report` writes it.

        path : file to write
        source, target : the clouds that were registered; those that this came from if they are
            None, which results from pickles and of lists do not know any more

        Raises SettingError where the clouds are not known.
        """
        given = self._known(source, target)
        if given is None:
            raise _native.SettingError("source, target: not known of this result any more: give both")
        path = os.fspath(path)  # numbers are files that are open to `open`
        page = _native.report(self.to_json(), *given)
        with open(path, "w", encoding="utf-8") as file:
            file.write(page)

    def _known(self, source: Any = None, target: Any = None) -> tuple[Any, Any] | None:
        """The clouds: those given, else those that were registered."""
        if source is None and target is None:
            return self._clouds
        return None if source is None or target is None else (source, target)

    def _weighed_by(self, weights: str, normalize: str) -> Registration:
        """The same with weights, of no name, named in the configuration."""
        facts = self.to_dict()
        first = facts
        while first.get("refined_from"):
            first = first["refined_from"]
        first["config"].update(weights=weights, normalization=normalize)
        return Registration(facts, self._clouds)

    def __reduce__(self) -> tuple[Any, ...]:
        return Registration, (self._facts,)

    @property
    def is_usable(self) -> bool:
        """Whether the pose may be used: trusted, accepted where there is a verdict, finite and
        a proper rotation. Graphs and the exit status of the command line go by the same."""
        decision = None if self.verdict is None else self.verdict.decision
        return _native.is_usable(self.transform.tolist(), self.trusted, decision)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Registration) and _timeless(self._facts) == _timeless(other._facts)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        grounds = ", ".join(warning.ground for warning in self.warnings)
        verdict = "trusted" if self.trusted else f"not trusted: {grounds}"
        if self.verdict is not None:
            verdict = f"{self.verdict.decision}, probability {self.verdict.probability:.3f}"
            verdict += "" if self.trusted else f", not trusted: {grounds}"
        t = ", ".join(f"{x:.4g}" for x in self.translation)
        return (
            f"Registration({verdict}, {self.method}, rotation {self.angle_deg:.2f} deg, "
            f"translation [{t}], fitness {self.evaluation.fitness:.3f}, "
            f"{self.seconds['total']:.3g} s)"
        )

    def __str__(self) -> str:
        lines = [repr(self), *(f"  {warning}" for warning in self.warnings)]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        """The table that notebooks show."""
        import html

        evaluation, counts = self.evaluation, self.points
        matrix = "".join(
            "<tr>" + "".join(f"<td>{x:.6g}</td>" for x in row) + "</tr>" for row in self.transform
        )
        described = [counts[side]["described"] for side in ("source", "target")]
        rows = {
            "method": self.method,
            "verdict": _told(self.verdict, self.trusted),
            **{f"warning: {warning.ground}": str(warning) for warning in self.warnings},
            "rotation": f"{self.angle_deg:.3f} deg",
            "fitness": f"{evaluation.fitness:.3f} of the source, {evaluation.target_fitness:.3f} "
            f"of the target within {evaluation.max_distance:.4g}",
            "agreement": f"{evaluation.agreement:.3f} beyond chance",
            "inlier RMSE": f"{evaluation.inlier_rmse:.4g}",
            "points": f"{described[0]} + {described[1]}",
            "connections": f"{self.connections:,}, {self.effective_connections:.3g} effective",
            "time": f"{self.seconds['total']:.3g} s",
        }
        colour = "#2a7" if self.trusted else "#c33"
        table = "".join(
            f"<tr><th style='text-align:left'>{html.escape(name)}</th>"
            f"<td style='text-align:left'>{html.escape(text)}</td></tr>"
            for name, text in rows.items()
        )
        return (
            f"<div style='border-left:4px solid {colour};padding-left:8px'>"
            f"{self._picture()}<table>{table}</table><table>{matrix}</table></div>"
        )

    def _picture(self) -> str:
        """The aligned clouds as an image, where they are known."""
        if self._clouds is None:
            return ""
        try:
            png = _native.thumbnail(self.to_json(), *self._clouds, (420, 320))
        except (_native.Error, TypeError):  # arrays that were changed since
            return ""
        data = base64.b64encode(png).decode()
        told = "source (orange) and target (blue), aligned"
        return f"<img alt='{told}' title='{told}' src='data:image/png;base64,{data}'/>"


def _told(verdict: Verdict | None, trusted: bool) -> str:
    """The verdict in a few words."""
    if verdict is None:
        return "no warning" if trusted else "has warnings"
    return f"{verdict.decision}, right with probability {verdict.probability:.3f}"


def _timeless(facts: dict[str, Any]) -> dict[str, Any]:
    """All but how long it took."""
    rest = {name: fact for name, fact in facts.items() if name != "time_s"}
    if rest.get("refined_from"):
        rest["refined_from"] = _timeless(rest["refined_from"])
    return rest

"""Weights of connections: kernels of the squared distance between descriptors.

A kernel can be called on an array of squared distances, added to another, multiplied with
another or by a number, and handed to `cfreg.moments`, `cfreg.CF` and `cfreg.CFK` as
`weights`. There any function will do that is given an array (sources, targets) of squared
distances, part by part, and returns as many weights; kernels of this module and what is put
together of them run without Python, which is much faster.

>>> from cfreg.weights import Gaussian, Tukey
>>> Gaussian(beta=50)([0.0, 50.0]).round(4)
array([1.    , 0.3679], dtype=float32)
>>> Gaussian(50) * Tukey(400) + 0.1 * Gaussian("auto")
Gaussian(beta=50) * Tukey(beta=400) + 0.1 * Gaussian(beta='auto')

Normalisations of the full connection, `normalize`: NONE, SOURCE (every source point speaks
with one voice), TARGET, BOTH (dual softmax), sinkhorn(rounds).
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Union

import numpy as np

from . import _native

if TYPE_CHECKING:  # takes as long as all the rest
    import numpy.typing as npt

__all__ = [
    "BOTH",
    "Cauchy",
    "Gaussian",
    "GemanMcClure",
    "Kernel",
    "Laplacian",
    "NONE",
    "SOURCE",
    "StudentT",
    "TARGET",
    "Truncated",
    "Tukey",
    "Uniform",
    "sinkhorn",
]

NONE = "none"
SOURCE = "source"
TARGET = "target"
BOTH = "both"

Weights = Callable[["npt.NDArray[np.float32]"], "npt.ArrayLike"]
"""A function from squared distances (sources, targets) to as many weights."""


def sinkhorn(rounds: int) -> str:
    """The normalisation by `rounds` of Sinkhorn-Knopp, 1 to 1000; two passes each."""
    name = f"sinkhorn:{rounds}"
    _native.settings("cf", json.dumps({"normalize": name}))
    return name


class Kernel:
    """A weight for every squared distance: what all kernels here are."""

    def __call__(self, squared_distances: npt.ArrayLike) -> npt.NDArray[np.float32]:
        """Weights of an array of squared distances, of the same shape, as the connection
        computes them.

        Raises SettingError for a bandwidth "auto", which only descriptors tell."""
        d2 = np.asarray(squared_distances, dtype=np.float32)
        return _native.kernel_weights(self, d2.ravel()).reshape(d2.shape)

    def __add__(self, other: Union[Kernel, Weights]) -> Kernel:
        return _Sum(self, _kernel(other))

    def __radd__(self, other: Union[Weights, float]) -> Kernel:
        # sum() begins with 0.
        return self if _is_number(other) and other == 0 else _Sum(_kernel(other), self)

    def __mul__(self, other: Union[Kernel, Weights, float]) -> Kernel:
        return _Times(_number(other), self) if _is_number(other) else _Product(self, _kernel(other))

    def __rmul__(self, other: Union[Weights, float]) -> Kernel:
        return _Times(_number(other), self) if _is_number(other) else _Product(_kernel(other), self)

    def _spec(self) -> Any:
        """The kernel as the compiled part knows it; None where a Python function is in it."""
        raise NotImplementedError

    def _json(self) -> str | None:
        spec = self._spec()
        return None if spec is None else json.dumps(spec)

    def _check(self) -> None:
        if self._spec() is not None:
            _native.check_kernel(self)


@dataclass(frozen=True)
class _Catalogued(Kernel):
    beta: float | str = 100.0

    def __post_init__(self) -> None:
        if isinstance(self.beta, bool) or not isinstance(self.beta, (str, float, int, np.number)):
            raise TypeError(f"beta: a number or a word is needed, not {self.beta!r}")
        spec = self._spec()
        _native.settings("cf", json.dumps({"weights": spec["kernel"], "beta": spec["beta"]}))

    def _name(self) -> str:
        raise NotImplementedError

    def _spec(self) -> Any:
        beta = self.beta if isinstance(self.beta, str) else float(self.beta)
        # What is not finite is refused as a word.
        beta = str(beta) if isinstance(beta, float) and not np.isfinite(beta) else beta
        return {"kernel": self._name(), "beta": beta}


class Gaussian(_Catalogued):
    """exp(-d^2/beta): the paper's weight.

    beta : squared bandwidth, 1e-12 to 1e12, in squared units of the descriptors, or "auto",
        or "auto:SHARE", see `cfreg.moments`. The same for all kernels
    """

    def _name(self) -> str:
        return "gaussian"


class Laplacian(_Catalogued):
    """exp(-d/sqrt(beta)): longer tails than the Gaussian, sharper at zero."""

    def _name(self) -> str:
        return "laplacian"


class Cauchy(_Catalogued):
    """1/(1 + d^2/beta)."""

    def _name(self) -> str:
        return "cauchy"


class GemanMcClure(_Catalogued):
    """1/(1 + d^2/beta)^2."""

    def _name(self) -> str:
        return "geman-mcclure"


class Truncated(_Catalogued):
    """1 up to d^2 = beta, 0 beyond."""

    def _name(self) -> str:
        return "truncated"


@dataclass(frozen=True)
class StudentT(_Catalogued):
    """(1 + d^2/(nu beta))^(-(nu + 1)/2).

    nu : degrees of freedom, above 0 to 1000: Cauchy at 1, towards exp(-d^2/(2 beta)) for many
    """

    nu: float = 5.0

    def _name(self) -> str:
        return f"student-t:{self.nu}"


class Tukey(_Catalogued):
    """(1 - d^2/beta)^2 up to d^2 = beta, 0 beyond: the biweight."""

    def _name(self) -> str:
        return "tukey"


@dataclass(frozen=True)
class Uniform(Kernel):
    """1 for every connection: the control of a study."""

    def _spec(self) -> Any:
        return {"kernel": "uniform", "beta": 1.0}


@dataclass(frozen=True)
class _Function(Kernel):
    function: Weights

    def __call__(self, squared_distances: npt.ArrayLike) -> npt.NDArray[np.float32]:
        d2 = np.asarray(squared_distances, dtype=np.float32)
        return np.asarray(self.function(d2), dtype=np.float32)

    def _spec(self) -> Any:
        return None

    def __repr__(self) -> str:
        return getattr(self.function, "__name__", repr(self.function))


@dataclass(frozen=True)
class _Joined(Kernel):
    left: Kernel
    right: Kernel

    def __post_init__(self) -> None:
        self._check()

    def _parts(self) -> list[Any] | None:
        specs = [self.left._spec(), self.right._spec()]
        return None if None in specs else specs


class _Sum(_Joined):
    def __call__(self, squared_distances: npt.ArrayLike) -> npt.NDArray[np.float32]:
        if self._spec() is not None:
            return super().__call__(squared_distances)
        return self.left(squared_distances) + self.right(squared_distances)

    def _spec(self) -> Any:
        specs = self._parts()
        return None if specs is None else {"sum": specs}

    def __repr__(self) -> str:
        return f"{self.left!r} + {self.right!r}"


class _Product(_Joined):
    def __call__(self, squared_distances: npt.ArrayLike) -> npt.NDArray[np.float32]:
        if self._spec() is not None:
            return super().__call__(squared_distances)
        return self.left(squared_distances) * self.right(squared_distances)

    def _spec(self) -> Any:
        specs = self._parts()
        return None if specs is None else {"product": specs}

    def __repr__(self) -> str:
        factors = (f"({part!r})" if isinstance(part, _Sum) else repr(part) for part in (self.left, self.right))
        return " * ".join(factors)


@dataclass(frozen=True)
class _Times(Kernel):
    factor: float
    kernel: Kernel

    def __post_init__(self) -> None:
        if not (np.isfinite(self.factor) and self.factor >= 0.0):
            raise _native.SettingError(f"factor = {self.factor}: must be finite and not negative")
        self._check()

    def __call__(self, squared_distances: npt.ArrayLike) -> npt.NDArray[np.float32]:
        if self._spec() is not None:
            return super().__call__(squared_distances)
        return np.float32(self.factor) * self.kernel(squared_distances)

    def _spec(self) -> Any:
        spec = self.kernel._spec()
        return None if spec is None else {"times": [self.factor, spec]}

    def __repr__(self) -> str:
        kernel = f"({self.kernel!r})" if isinstance(self.kernel, _Sum) else repr(self.kernel)
        return f"{self.factor:g} * {kernel}"


def _kernel(weights: Any) -> Kernel:
    if isinstance(weights, Kernel):
        return weights
    if callable(weights):
        return _Function(weights)
    raise TypeError(f"a kernel or a function is needed, not {weights!r} (numbers only multiply)")


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float, np.number)) and not isinstance(value, bool)


def _number(value: Any) -> float:
    return float(value)

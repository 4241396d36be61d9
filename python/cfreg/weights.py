"""Weights of connections: kernels of the squared distance between descriptors.

A kernel can be called on an array of squared distances, added to another, multiplied with
another or by a number, and handed to `cfreg.moments`, `cfreg.CF` and `cfreg.CFK` as
`weights`. There any function will do that is given an array (sources, targets) of squared
distances, part by part, and returns as many weights (where they are masked: 0); kernels of
this module and what is put together of them run without Python, which is much faster. Functions
are called in threads of their own, several at once: locks that the caller holds, its context
variables and its numpy.errstate are not theirs.

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
from typing import TYPE_CHECKING, Any, ClassVar, Union

import numpy as np

from . import _interop, _native

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
    if not isinstance(rounds, (int, np.integer)):
        rule = "must be a whole number, 1 to 1000"
        raise _native.SettingError(f"rounds = {_interop.shown(rounds)}: {rule}")
    name = f"sinkhorn:{_interop.shown(rounds)}"
    _native.settings("cf", json.dumps({"normalize": name}))
    return name


class Kernel:
    """A weight for every squared distance: what all kernels here are.

    A kernel of one's own is a subclass with its own `__call__`.
    """

    def __call__(self, squared_distances: npt.ArrayLike) -> npt.NDArray[np.float32]:
        """Weights of an array of squared distances, of the same shape, as the connection
        computes them.

        Raises SettingError for a bandwidth "auto", which only descriptors tell."""
        d2: Any = np.asarray(squared_distances)
        if d2.dtype.kind not in "biuf":
            raise _native.Error(f"squared_distances must be numbers, not {d2.dtype}")
        d2 = d2.astype(np.float32)
        spec = self._compiled()
        if spec is None:
            return self._in_python(d2)
        return _native.kernel_weights(json.dumps(spec), d2.ravel()).reshape(d2.shape)

    def __add__(self, other: Union[Kernel, Weights]) -> Kernel:
        return _Sum.of(self, other)

    def __radd__(self, other: Union[Weights, float]) -> Kernel:
        # sum() begins with 0.
        return self if _is_number(other) and other == 0 else _Sum.of(other, self)

    def __mul__(self, other: Union[Kernel, Weights, float]) -> Kernel:
        return _Times.of(other, self) if _is_number(other) else _Product.of(self, other)

    def __rmul__(self, other: Union[Weights, float]) -> Kernel:
        return _Times.of(other, self) if _is_number(other) else _Product.of(other, self)

    def __repr__(self) -> str:
        return f"{type(self).__name__}()"

    def _spec(self) -> Any:
        """The kernel as the compiled part knows it; None where only Python does."""
        return self._compiled() if type(self).__call__ is Kernel.__call__ else None

    def _compiled(self) -> Any:
        return None

    def _in_python(self, d2: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        raise TypeError(f"{type(self).__name__}: a kernel of one's own needs a __call__")

    def _json(self) -> str | None:
        spec = self._spec()
        return None if spec is None else json.dumps(spec)

    def _check(self) -> None:
        spec = self._compiled()
        if spec is not None:
            _native.check_kernel(json.dumps(spec))


@dataclass(frozen=True)
class _Catalogued(Kernel):
    _name: ClassVar[str]
    beta: float | str = 100.0

    def __post_init__(self) -> None:
        if isinstance(self.beta, bool) or not isinstance(self.beta, (str, float, int, np.number)):
            raise TypeError(f"beta: a number or a word is needed, not {_interop.shown(self.beta)}")
        kernel = self._compiled()
        given = {"weights": kernel["kernel"], "beta": kernel["beta"]}
        _native.settings("cf", _interop.to_json(given))

    def _compiled(self) -> Any:
        beta = self.beta if isinstance(self.beta, str) else _float(self.beta)
        return {"kernel": self._name, "beta": beta}


class Gaussian(_Catalogued):
    """exp(-d^2/beta): the paper's weight.

    beta : squared bandwidth, 1e-12 to 1e12, in squared units of the descriptors, or "auto",
        or "auto:SHARE", see `cfreg.moments`. The same for all kernels
    """

    _name = "gaussian"


class Laplacian(_Catalogued):
    """exp(-d/sqrt(beta)): longer tails than the Gaussian, sharper at zero."""

    _name = "laplacian"


class Cauchy(_Catalogued):
    """1/(1 + d^2/beta)."""

    _name = "cauchy"


class GemanMcClure(_Catalogued):
    """1/(1 + d^2/beta)^2."""

    _name = "geman-mcclure"


class Truncated(_Catalogued):
    """1 up to d^2 = beta, 0 beyond."""

    _name = "truncated"


@dataclass(frozen=True)
class StudentT(_Catalogued):
    """(1 + d^2/(nu beta))^(-(nu + 1)/2).

    nu : degrees of freedom, above 0 to 1000: Cauchy at 1, towards exp(-d^2/(2 beta)) for many
    """

    _name = "student-t"
    nu: float = 5.0

    def _compiled(self) -> Any:
        if not isinstance(self.nu, (int, float, np.number)):
            raise TypeError(f"nu: a number is needed, not {_interop.shown(self.nu)}")
        return {**super()._compiled(), "kernel": f"student-t:{_interop.shown(self.nu)}"}


class Tukey(_Catalogued):
    """(1 - d^2/beta)^2 up to d^2 = beta, 0 beyond: the biweight."""

    _name = "tukey"


@dataclass(frozen=True)
class Uniform(Kernel):
    """1 for every connection: the control of a study."""

    def _compiled(self) -> Any:
        return {"kernel": "uniform", "beta": 1.0}


@dataclass(frozen=True)
class _Function(Kernel):
    function: Weights

    def _in_python(self, d2: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        return np.asarray(_interop.weights(self.function(d2)), dtype=np.float32)

    def __repr__(self) -> str:
        return getattr(self.function, "__name__", repr(self.function))


@dataclass(frozen=True)
class _Joined(Kernel):
    """Two or more kernels, none of them of the same kind: a + b + c is one sum."""

    _operation: ClassVar[str]
    _sign: ClassVar[str]
    _join: ClassVar[Any]
    parts: tuple[Kernel, ...]

    @classmethod
    def of(cls, *kernels: Any) -> Kernel:
        parts: list[Kernel] = []
        for kernel in map(_kernel, kernels):
            parts.extend(kernel.parts if isinstance(kernel, cls) else [kernel])
        return cls(tuple(parts))

    def __post_init__(self) -> None:
        self._check()

    def _compiled(self) -> Any:
        specs = [part._spec() for part in self.parts]
        return None if None in specs else {self._operation: specs}

    def _in_python(self, d2: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        joined: npt.NDArray[np.float32] = self._join.reduce([part(d2) for part in self.parts])
        return joined

    def __repr__(self) -> str:
        return self._sign.join(map(_factor if self._sign == " * " else repr, self.parts))


class _Sum(_Joined):
    _operation, _sign, _join = "sum", " + ", np.add


class _Product(_Joined):
    _operation, _sign, _join = "product", " * ", np.multiply


@dataclass(frozen=True)
class _Times(Kernel):
    factor: float
    kernel: Kernel

    @classmethod
    def of(cls, factor: Any, kernel: Kernel) -> Kernel:
        if isinstance(kernel, cls):
            return cls(_float(factor) * kernel.factor, kernel.kernel)
        return cls(_float(factor), kernel)

    def __post_init__(self) -> None:
        if not (np.isfinite(self.factor) and self.factor >= 0.0):
            given = _interop.shown(self.factor)
            raise _native.SettingError(f"factor = {given}: must be finite and not negative")
        self._check()

    def _compiled(self) -> Any:
        spec = self.kernel._spec()
        return None if spec is None else {"times": [self.factor, spec]}

    def _in_python(self, d2: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        return np.float32(self.factor) * self.kernel(d2)

    def __repr__(self) -> str:
        return f"{self.factor:g} * {_factor(self.kernel)}"


def _kernel(weights: Any) -> Kernel:
    if isinstance(weights, Kernel):
        return weights
    if isinstance(weights, type):
        name = weights.__name__
        raise TypeError(f"weights: {name} is a class: make a kernel of it first, {name}(...)")
    if callable(weights):
        return _Function(weights)
    rule = "a kernel or a function is needed; numbers only multiply"
    raise TypeError(f"weights: {rule}, not {_interop.shown(weights)}")


def _factor(kernel: Kernel) -> str:
    return f"({kernel!r})" if isinstance(kernel, _Sum) else repr(kernel)


def _float(value: Any) -> float:
    """A number, infinite where it is beyond all floats."""
    try:
        return float(value)
    except OverflowError:
        return float("inf") if value > 0 else float("-inf")


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float, np.number)) and not isinstance(value, bool)

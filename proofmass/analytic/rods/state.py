"""A state of an assembly: what its rods carry, where its platform is, inputs and load."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from proofmass.analytic.numerics import Array, Complex
from proofmass.analytic.rods.assembly import Assembly
from proofmass.analytic.rods.flow import flow

Columns = NDArray[np.int_]


@dataclass(frozen=True)
class State:
    """States (...) of one assembly of k rods whose platform has p freedoms.

    Attributes
    ----------
    assembly : Assembly
    vector : ndarray (..., 4 k + 2 p)
        m0, n_x, n_y of each rod, pose, inputs, load.
    """

    assembly: Assembly
    vector: Array

    def __getitem__(self, which: int | Columns | NDArray[np.bool_]) -> "State":
        """One of a batch, or some."""
        return State(self.assembly, np.array(self.vector[which]))

    def part(self, name: str) -> Array:
        """Columns of `vector`: "rods", "pose", "inputs" or "load"."""
        return self.vector[..., columns(self.assembly, name)]

    def replaced(self, **parts: ArrayLike) -> "State":
        """The same with other parts: pose, inputs or load."""
        vector = self.vector
        for name, value in parts.items():
            where = columns(self.assembly, name)
            given = _rows(name, value, where.size)
            vector = np.broadcast_to(vector, (*np.broadcast_shapes(
                given.shape[:-1], vector.shape[:-1]), vector.shape[-1])).copy()
            vector[..., where] = given
        return State(self.assembly, vector)

    @property
    def moment(self) -> Array:
        """Moments at the clamps [N m], (..., k)."""
        return self.part("rods")[..., 0::3]

    @property
    def force(self) -> Array:
        """Forces of the platform on the tips [N], (..., k, 2)."""
        rods = self.part("rods")
        return np.stack([rods[..., 1::3], rods[..., 2::3]], axis=-1)

    @property
    def pose(self) -> Array:
        """x, y [m] of the platform's origin, and its angle phi [rad] if it is no pin, (..., p)."""
        return self.part("pose")

    @property
    def inputs(self) -> Array:
        """What motors add to the clamps' angles [rad], or places on the guides [m], (..., k)."""
        return self.part("inputs")

    @property
    def load(self) -> Array:
        """Dead force [N] on the platform at its origin, and moment [N m] if it is no pin."""
        return self.part("load")

    @property
    def energy(self) -> Array:
        r"""Bending energy of each rod [J], (..., k).

        With m^2/(2 EI) + n . t = H along the rod, U = integral m^2/(2 EI) ds = H L - n . (p(L) -
        p(0)).  The document's program lacks the factor 1/2 and errs in its Simpson rule.
        """
        a = self.assembly
        theta, _, n = clamps(self)
        z = flow(theta, self.moment, n, a.length, a.stiffness)[0][0]
        head = self.moment**2 / (2.0 * a.stiffness) + (n.conj() * np.exp(1j * theta)).real
        return np.asarray(head * a.length - (n.conj() * z).real)

    def shape(self, fraction: ArrayLike) -> tuple[Array, Array, Array, Array]:
        """x, y [m], theta [rad] and moment [N m] at fractions (m,) of the lengths, (..., k, m)."""
        a = self.assembly
        at = np.asarray(fraction, float)
        theta, clamp, n = (value[..., None] for value in clamps(self))
        m0, length, stiffness = self.moment[..., None], a.length[:, None] * at, a.stiffness[:, None]
        z, turn = flow(theta, m0, n, length, stiffness)
        point = clamp + z[0]
        return point.real, point.imag, turn[0], m0 + (n.conj() * z[0]).imag


def columns(a: Assembly, *names: str) -> Columns:
    """Where parts of a state are in its vector, in the order of the names."""
    k, p = a.rods, a.freedoms
    every = np.split(np.arange(4 * k + 2 * p), np.cumsum([3 * k, p, k]))
    parts = dict(zip(("rods", "pose", "inputs", "load"), every, strict=True))
    return np.concatenate([parts[name] for name in names])


def state(a: Assembly, *, inputs: ArrayLike = 0.0, pose: ArrayLike = 0.0, load: ArrayLike = 0.0,
          moment: ArrayLike = 0.0, force: ArrayLike = 0.0) -> State:
    """A state, or a first guess of one, from its parts; all may be batches (...).

    Parameters
    ----------
    a : Assembly of k rods, p freedoms
    inputs : (..., k) [rad or m]
    pose, load : (..., p) [m, rad], [N, N m]
    moment : m0 of each rod, (..., k) [N m]
    force : n of each rod, (..., k, 2) [N]
    """
    k, p = a.rods, a.freedoms
    given = {"inputs": (inputs, k), "pose": (pose, p), "load": (load, p), "moment": (moment, k)}
    parts = {name: _rows(name, value, width) for name, (value, width) in given.items()}
    n = np.asarray(force, float)
    n = np.zeros((k, 2)) if n.ndim == 0 else n
    if n.shape[-2:] != (k, 2):
        raise ValueError(f"force must hold x, y of {k} rods, (..., {k}, 2), got {n.shape}")
    shape = np.broadcast_shapes(n.shape[:-2], *(part.shape[:-1] for part in parts.values()))
    rods = np.concatenate([np.broadcast_to(parts["moment"], (*shape, k))[..., None],
                           np.broadcast_to(n, (*shape, k, 2))], axis=-1).reshape(*shape, 3 * k)
    rest = [np.broadcast_to(parts[name], (*shape, given[name][1])) for name in
            ("pose", "inputs", "load")]
    return State(a, np.concatenate([rods, *rest], axis=-1))


def _rows(name: str, value: ArrayLike, width: int) -> Array:
    given = np.asarray(value, float)
    given = np.full(width, given) if given.ndim == 0 else given
    if given.shape[-1] != width or not np.isfinite(given).all():
        raise ValueError(f"{name} must be finite, (..., {width}), got {value!r}")
    return given


def clamps(s: State) -> tuple[Array, Complex, Complex]:
    """Tangents theta_i [rad] and places [m] of the clamps, forces on the tips [N], (..., k)."""
    a, q = s.assembly, s.inputs
    n = s.force @ np.array([1.0, 1.0j])
    if a.guide is None:
        return a.angle + q, np.broadcast_to(a.clamp, q.shape), n
    return np.broadcast_to(a.angle, q.shape), a.clamp + q * a.guide, n

"""Curves of a reference, and curves of a solver with those that they were compared with."""

from dataclasses import dataclass, field
from typing import Self

from proofmass.base.arrays import Array
from proofmass.sim.protocol.curves import Curves


@dataclass(frozen=True)
class ReferenceCurves(Curves):
    """Curves of the reference in the run of a case.

    Attributes
    ----------
    shown : dict of str to ndarray (n,)
        Quantities of the reference that views of the run show, by their own names [SI].
    """

    shown: dict[str, Array] = field(default_factory=dict)


@dataclass(frozen=True)
class ComparedCurves(Curves):
    """Curves of a solver, with the reference curves with which they were compared.

    Attributes
    ----------
    reference : dict of str to ndarray (n,)
        Reference curves by channel [SI].
    shown : dict of str to ndarray (n,)
        Quantities of the reference that views of the run show, see `ReferenceCurves` [SI].
    properties : dict of str to str, optional
        The `properties` of the case; None if they were not asked for.
    """

    reference: dict[str, Array] = field(default_factory=dict)
    shown: dict[str, Array] = field(default_factory=dict)
    properties: dict[str, str] | None = None

    @classmethod
    def of(
        cls, curves: Curves, reference: Curves, properties: dict[str, str] | None = None
    ) -> Self:
        """Join curves and the reference with which they are compared."""
        shown = reference.shown if isinstance(reference, ReferenceCurves) else {}
        return cls(**vars(curves), reference=reference.channels, shown=shown, properties=properties)

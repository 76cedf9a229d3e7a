"""A sidecar that is proposed for a model: its runs, settings, tolerances and comments."""

import json
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

from proofmass.base.errors import InputError
from proofmass.base.files import write_atomically
from proofmass.base.strict import Kind
from proofmass.batch.check import read_isolated
from proofmass.case.case import Case, Tolerance
from proofmass.commands.proposal.inspection import ModelSummary

REFERENCE_COMMENTS = {
    "planar": "reads the numbers of the model: a wrong one is wrong in both",
    "spatial": "reads the numbers of the model: a wrong one is wrong in both",
    "refined": "the model's own equations, solved closely: it judges the time stepping alone",
}


@dataclass
class Proposal:
    """A sidecar that is being written.

    Attributes
    ----------
    name, model : str
        The name of the case, and the name of the file of its model.
    look : ModelSummary
    runs : dict of Kind to list of str
        The solvers of each run.
    messages : list of str
        Comments at its top.
    tolerances : list of Tolerance
    steps : dict of str to float
        Time steps of solvers that do not take the model's [s].
    step_comments : dict of str to str
        Why a solver takes another step.
    turned_by : str
        Name of the number whose change turned a check last; it is changed first for the next run.
    """

    name: str
    model: str
    look: ModelSummary
    runs: dict[Kind, list[str]]
    messages: list[str] = field(default_factory=list)
    tolerances: list[Tolerance] = field(default_factory=list)
    steps: dict[str, float] = field(default_factory=dict)
    step_comments: dict[str, str] = field(default_factory=dict)
    turned_by: str = ""

    def leave_out(self, kind: Kind, solver: str) -> None:
        """Leave a solver out of a run, and the run if no solver is left."""
        self.runs[kind] = [one for one in self.runs[kind] if one != solver]
        if not self.runs[kind]:
            del self.runs[kind]

    def add_variant(self, kind: Kind, solver: str, variant: str, step: float, why: str) -> None:
        """Add a variant of a solver with another step [s], after the solver."""
        self.runs[kind].insert(self.runs[kind].index(solver) + 1, variant)
        self.steps[variant], self.step_comments[variant] = step, why

    def text(self) -> str:
        """The text of the sidecar."""
        return "\n".join(self.lines()) + "\n"

    def lines(self) -> Iterator[str]:
        """The lines of the sidecar."""
        yield f"# Proposed for {self.model} by `proofmass new`; docs/sidecar.md has every key."
        yield from (f"# {line}" for line in self.messages)
        yield f"title = {toml_text(self.name)}"
        yield 'source = "where the lengths, masses and springs come from"'
        yield f'reference = "{self.look.reference}"  # {REFERENCE_COMMENTS[self.look.reference]}'
        if self.model != f"{self.name}.xml":
            yield f"model = {toml_text(self.model)}"
        if self.look.start not in ("", "start"):
            yield f"start = {toml_text(self.look.start)}"
        if drive := self.look.drive:
            begin, end = drive.way
            yield ""
            yield "[drive]"
            yield f"joint = {toml_text(drive.joint)}"
            yield f"from = {begin!r}"
            yield f"to = {end!r}"
            yield f"rate = {1.0 if end > begin else -1.0}"
        for kind, solvers in self.runs.items():
            yield ""
            yield f"[run.{kind}]"
            if not self.look.drive:
                yield f"until = {self.look.until}"
                yield f"n = {self.look.samples}  # whole time steps of the model lead to each"
            yield f"solvers = {toml_list(solvers)}"
        for solver, step in self.steps.items():
            yield ""
            name = f'"{solver}"' if ":" in solver else solver
            yield f"[settings.{name}]  # {self.step_comments[solver]}"
            yield f"timestep = {step!r}"
        for one in self.tolerances:
            yield from tolerance_lines(one)

    def read(self, sidecar: Path) -> Case:
        """The case of the sidecar as it is now, which is not written yet.

        It is read from another folder, where its model is named by its absolute path.
        """
        model = sidecar.with_name(self.model).absolute()
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / sidecar.name
            write_atomically(file, replace(self, model=str(model)).text())
            try:
                case = read_isolated(file)
            except InputError as error:
                raise InputError(sidecar, error.key, error.wrong) from None
        return case.model_copy(update={"file": sidecar, "model": self.model})


def toml_text(text: str) -> str:
    """A text in TOML, whose basic strings have the escapes of JSON.

    >>> print(toml_text('a "b"'))
    "a \\"b\\""
    """
    return json.dumps(text, ensure_ascii=False)


def tolerance_lines(one: Tolerance) -> Iterator[str]:
    """The lines of a tolerance in a sidecar."""
    yield ""
    yield "[[tolerance]]"
    yield f'run = "{one.run}"'
    yield f"solver = {toml_names(one.solver)}"
    yield f"unit = {toml_names(one.unit)}"
    if one.channels != ("*",):
        yield f"channels = {toml_list(one.channels)}"
    if one.abs is not None:
        yield f"abs = {one.abs!r}"
    else:
        yield f"relative_to_range = {one.relative_to_range!r}"
    yield f"why = {toml_text(one.why)}"


def toml_names(names: tuple[str, ...]) -> str:
    """A name, or a list of names, in TOML.

    >>> toml_names(("mujoco",)), toml_names(("a", "b"))
    ('"mujoco"', '["a", "b"]')
    """
    return toml_text(names[0]) if len(names) == 1 else toml_list(names)


def toml_list(names: Iterable[str]) -> str:
    """A list of names in TOML."""
    return f"[{', '.join(map(toml_text, names))}]"

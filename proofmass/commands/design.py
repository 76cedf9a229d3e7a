"""``proofmass design``: find a mechanism, write it as a case, and check the case."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import typer
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from proofmass.analytic.balancer.measures import (
    TARGETS,
    Target,
    chain_of,
    joints_without_springs,
    target_from_table,
    weight_target,
)
from proofmass.analytic.balancer.synthesis import Synthesis, Variant
from proofmass.base.arrays import Array
from proofmass.base.errors import InputError
from proofmass.base.files import make_folder, protect, write_output
from proofmass.base.recorded import RecordedColumn, read_table
from proofmass.base.units import si_unit
from proofmass.commands.command import error_console, exit_on_error
from proofmass.commands.design_common import check_cases, parse_bounds
from proofmass.commands.survey import survey_balancers
from proofmass.commands.tolerances import ask_tolerances
from proofmass.design.search import Effort, SavedSearch, SearchProgress
from proofmass.design.springs import (
    CATALOGUE,
    SpringStrip,
    describe_design,
    design_figures,
    fit_catalogue,
    read_catalogue,
    read_strips,
)
from proofmass.design.stock import SpringOption, catalogue_options, search_stock, strip_options
from proofmass.design.template import write_case
from proofmass.run.sidecar import load_case

OPTIONS_OF_ONE_KIND = {
    "preload": "--preload",
    "preload_joint": "--preload-joint",
    "free_angle": "--free-angle",
    "contact": "--contact",
    "relaxed": "--relaxed",
    "elbow_down": "--elbow-down",
    "power": "--power",
    "pareto": "--pareto",
    "catalogue": "--catalogue",
    "strips": "--strips",
}
"""Options by their parameters that a search over all kinds does not take."""


@dataclass(frozen=True)
class AllKinds:
    """A search over all kinds is asked for.

    Attributes
    ----------
    within : float
        Error as a share of the largest wanted moment up to which a curve counts as reached [1].
    given : frozenset of str
        Parameters whose options were given.
    """

    within: float
    given: frozenset[str]

    def check(self) -> None:
        """Raise ValueError for an option that chooses one kind."""
        for name, option in OPTIONS_OF_ONE_KIND.items():
            if name in self.given:
                raise ValueError(
                    f"{option}: --all searches kinds with and without it; leave out one of the two"
                    if name in ("preload", "preload_joint", "free_angle", "contact", "relaxed")
                    else f"{option}: is of one kind of balancer; leave out --all, or this option"
                )


BOUND_EXAMPLE = ", such as length1=0.2:0.4"
"""How a message on a wrong --bound ends."""


def design_balancer(
    every: AllKinds | None,
    target: str,
    table: Path | None,
    segments: int,
    springs: str,
    preload: tuple[int, ...],
    free_angle: bool,
    contact: bool,
    relaxed: bool,
    elbow_down: bool,
    bound: list[str] | None,
    power: float,
    seed: int,
    effort: float,
    output: Path,
    pareto: bool,
    catalogue: Path | None,
    extension: str | None,
    strips: Path | None,
    moment: float | None,
    beside: list[Path] | None,
    tolerances: tuple[list[str] | None, int, float],
) -> None:
    """Run ``proofmass design balancer``; `proofmass.commands.cli` describes the parameters."""
    with exit_on_error(f"{output} keeps the state"):
        grows = parse_extension(extension) if extension else (0.0, 0.0)
        if extension and (table or target != "sine"):
            raise ValueError(
                "--extension: the target is the weight on a pendulum that extends; give no other"
            )
        wanted = read_target(table) if table else find_target(target)
        wanted = weight_target(*grows) if extension else wanted
        others = read_balancers(beside or [])
        tolerance_check = ask_tolerances(tolerances[0], tolerances[1], seed, tolerances[2])
        if every:
            every.check()
            protect(filter(None, (table, *(beside or []))))
            survey_balancers(
                wanted,
                segments if "segments" in every.given else None,
                springs if "springs" in every.given else None,
                grows,
                parse_bounds(bound or [], BOUND_EXAMPLE),
                seed,
                effort,
                every.within,
                others,
                tolerance_check,
                make_folder(output),
            )
        stock = read_catalogue(catalogue) if catalogue else CATALOGUE
        sections = read_strips(strips) if strips else []
        check_stock(catalogue, strips, springs)
        variant = Variant(
            wanted.name,
            segments,
            springs,
            preload,
            free_angle,
            contact,
            relaxed,
            -1 if elbow_down else 1,
            grows,
            parse_bounds(bound or [], BOUND_EXAMPLE),
        )
        task = Synthesis(variant, wanted, power=power)
        protect(filter(None, (table, catalogue, strips, *(beside or []))))
        make_folder(output)
        found = search_designs(task, scale_effort(effort, seed), output / "search.npz")
        record: dict[str, Any] = {"seed": seed}
        if catalogue or sections:
            options = strip_options(sections) if sections else catalogue_options(stock)
            balanced = moment or (1.0 if sections else None)
            record |= describe_stock(task, found, options, balanced, stock, sections, output)
        else:
            record |= describe_design(task, found, stock)
        print_design(record)
        write_output(output / "design.json", json.dumps(record, indent=1))
        for line in tolerance_check.run(record["parameters"], wanted, 1.0, output / "tolerances")[
            :1
        ]:
            print(line)
        if pareto:
            write_pareto_front(task, found, output)
        code = check_design(record, others, output)
        raise typer.Exit(code or int(cannot_be_built(record)))


def check_stock(catalogue: Path | None, strips: Path | None, springs: str) -> None:
    """Raise ValueError for two stocks, or for a stock of linear springs where others are wanted."""
    if catalogue and strips:
        raise ValueError("--catalogue, --strips: give one stock, of springs or of strips")
    for option, words in (("--catalogue", "its springs"), ("--strips", "clock springs")):
        given = catalogue if option == "--catalogue" else strips
        if given and springs != "linear":
            raise ValueError(f"{option}: {words} are linear, and --springs is {springs}")


def describe_stock(
    task: Synthesis,
    found: Array,
    options: list[SpringOption],
    moment: float | None,
    catalogue: dict[str, float],
    strips: list[SpringStrip],
    folder: Path,
) -> dict[str, Any]:
    """Search the best design with springs of the stock; its record, and that of the one without."""
    with search_bar("searching springs of the stock") as advance:
        best = search_stock(task, found, options, moment, folder, advance)
    free = design_figures(task, found[0])
    if best is None:
        record = describe_design(task, found, {}, strips, moment or 1.0)
        reason = "no combination of springs of the stock can be built and balances anything"
        return record | {"without_stock": free, "stock": {"why": reason}}
    designs = np.concatenate([best.vector[None], found])
    record = describe_design(task, designs, {}, strips, best.moment)
    if not strips:
        rounded = fit_catalogue(task, found, catalogue)
        record["selection"] = {
            "springs": best.springs,
            "stiffness": best.stiffness,
            "moment": best.moment,
            "rounded_rmse": rounded.get("rmse"),
            **design_figures(task, best.vector),
        }
    counts = {
        "combinations": best.combinations,
        "tried": best.tried,
        "evaluations": best.evaluations,
        "moment": best.moment,
    }
    return record | {"without_stock": free, "stock": counts}


def find_target(name: str) -> Target:
    """The target of the thesis with a given name."""
    if name not in TARGETS:
        raise ValueError(
            f"--target {name}: no such target; there are {', '.join(TARGETS)}, or "
            f"--table FILE for one of your own"
        )
    return TARGETS[name]


def read_target(file: Path) -> Target:
    """A target from a table of wanted moments.

    Its angles must rise from at most 1 degree to at least 90 degrees.
    """
    table = read_table(file)
    columns = [RecordedColumn(column=name) for name in table.units]
    try:
        units = [si_unit(table.unit_of(column))[0] for column in columns]
    except ValueError as error:
        raise InputError(file, "line 1", str(error)) from None
    if units != ["rad", "1"]:
        raise InputError(
            file,
            "line 1",
            "the columns must be 'angle [deg]' and 'moment [1]', the wanted moment over m g r",
        )
    angle, moment = table.monotonic(columns[0]), table.curve(columns[1])
    if angle[0] > np.pi / 180 or angle[-1] < np.pi / 2 * (1 - 1e-12):
        raise InputError(
            file,
            "",
            f"the angles must cover 1 to 90 degrees, they go from "
            f"{np.degrees(angle[0]):g} to {np.degrees(angle[-1]):g}",
        )
    if not np.trapezoid(moment, angle) > 0:
        raise InputError(file, "", "the wanted moment must do positive work")
    return target_from_table(angle, moment, file.stem)


def read_balancers(files: list[Path]) -> dict[str, dict[str, Any]]:
    """Parameters of the balancers in sidecars, by the titles of their cases."""
    cases = [load_case(file) for file in files]
    for case in cases:
        if case.reference != "balancer":
            raise case.error(
                "reference",
                f"{case.reference!r} is no balancer; --beside takes cases of reference 'balancer'",
            )
    return {case.title: case.parameters for case in cases}


def parse_extension(text: str) -> tuple[float, float]:
    """The two coefficients of an extension written as E1:E2.

    The length of the pendulum must be positive up to 90 degrees.
    """
    try:
        first, second = map(float, text.split(":"))
    except ValueError:
        raise ValueError(
            f"--extension {text}: write it as E1:E2, for r/r0 = 1 + E1 alpha + E2 alpha^2, such as "
            f"0:0.05"
        ) from None
    alpha = np.linspace(0.0, np.pi / 2, 91)
    if not (1.0 + alpha * (first + alpha * second) > 0).all():
        raise ValueError(f"--extension {text}: the pendulum's length must stay positive to 90 deg")
    return first, second


def scale_effort(effort: float, seed: int) -> Effort:
    """The usual effort of a search with `effort` times as many descents, 4 in a heat at least."""
    return Effort().scaled(effort, seed, least=4)


def search_designs(task: Synthesis, effort: Effort, file: Path) -> Array:
    """Search for designs (B, d), best first, with a progress bar on standard error."""
    with search_bar("searching") as advance:
        search = SavedSearch(task, effort, file)
        search.run(advance)
    return search.found


@contextmanager
def search_bar(words: str) -> Iterator[SearchProgress]:
    """Show a progress bar on standard error; yields the function that a search calls."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.fields[best]}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=error_console, transient=True) as bar:
        line = bar.add_task(words, total=1, best="")

        def advance(step: int, steps: int, value: float) -> None:
            bar.update(line, completed=step, total=steps, best=f"error {value:.5f}")

        yield advance


def print_design(record: dict[str, Any]) -> None:
    """Print the design on standard output."""
    print(
        f"rmse {record['rmse']:.6f}, work reduction {record['work_reduction']:.3f} %, spread of "
        f"energy {record['spread']:.3f}"
    )
    for name, value in record["parameters"].items():
        print(f"  {name:<12}{value: .6f}")
    if free := joints_without_springs(chain_of(record["parameters"])):
        print(f"no spring needed in {' and '.join(f'joint {joint}' for joint in free)}")
    if stock := record.get("stock"):
        print(stock.get("why") or tell_stock(record))
    if chosen := record.get("selection"):
        joints = " | ".join(" + ".join(pair) or "none" for pair in chosen["springs"])
        print(
            f"springs {joints} for m g r = {chosen['moment']:.5f} N m: rmse "
            f"{chosen['rmse']:.6f}, work reduction {chosen['work_reduction']:.3f} %"
        )
    for joint in record.get("clock_springs", []):
        if "strip" in joint:
            print(
                f"joint {joint['joint']}: {joint['count']} x {joint['strip']}, "
                f"{1e3 * joint['length']:.1f} mm, for {joint['stiffness']:.5g} N m/rad; "
                f"{1e-6 * joint['stress']:.0f} MPa at {joint['moment']:.4g} N m"
            )
        else:
            print(f"joint {joint['joint']}: {joint.get('why', 'no spring')}")


def tell_stock(record: dict[str, Any]) -> str:
    """What the search over the stock did, and what the stock costs."""
    stock, rounded = record["stock"], record.get("selection", {}).get("rounded_rmse")
    after = f", {rounded:.6f} with springs rounded after the search" if rounded else ""
    return (
        f"springs of the stock for m g r = {stock['moment']:.5f} N m: {stock['tried']:,} of "
        f"{stock['combinations']:,} combinations improved, {stock['evaluations']:,} designs "
        f"evaluated; rmse {record['without_stock']['rmse']:.6f} without regard to the stock{after}"
    )


def cannot_be_built(record: dict[str, Any]) -> bool:
    """Whether a joint needs a spring that no strip gives, or no combination of springs works."""
    joints = record.get("clock_springs", [])
    return "why" in record.get("stock", {}) or any("why" in joint for joint in joints)


def write_pareto_front(task: Synthesis, found: Array, folder: Path) -> None:
    """Find and write the Pareto front, and print the names of its files on standard output."""
    from proofmass.design.pareto import find_front, write_front  # matplotlib is slow to load

    with error_console.status("searching the Pareto front of error and spread of energy"):
        trades = find_front(task, found, folder)
    for file in write_front(trades, list(task.variant.usual), folder / "pareto"):
        print(file)


def check_design(record: dict[str, Any], others: dict[str, dict[str, Any]], folder: Path) -> int:
    """Write the case, check it in the engines, write a report, and return the exit code."""
    sidecar = write_case(
        folder,
        f"balancer_{record['target']}",
        parameters=record["parameters"],
        title=f"Balancer found for the target {record['target']}",
        source=f"proofmass design balancer, seed {record['seed']}: work reduction "
        f"{record['work_reduction']:.3f} %, rmse {record['rmse']:.6f}",
        target=record["target"] if record["target"] in {*TARGETS, "weight"} else None,
        beside=others,
    )
    return check_cases([sidecar], folder)

"""Limits of engines: small models compared with theory, and extreme parameters of cases.

    python -m benchmarks.stress [folder] [--only CASE ...] [--parameter TEXT ...] [--quick]

Writes docs/stress.md and docs/stress.png.  Runs are kept in the folder (reports/stress), so that a
call continues where another was interrupted.  With --only the limits of these cases are searched
again, with --parameter only those whose parameter and solver contain a text, such as "time step,
mujoco"; all other rows of docs/stress.md are kept.  --only theory makes the table and the figure of
the small models again.
"""

from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from textwrap import fill

from matplotlib import rc_context

from benchmarks import ROOT, command, folders, replacing_pages
from proofmass.base.wording import number
from proofmass.report.figures import save
from proofmass.report.style import RC
from proofmass.run.sidecar import load_case
from proofmass.studies.store import Store
from proofmass.studies.stress.boundary import Boundary, BoundaryKind, write_boundaries
from proofmass.studies.stress.extremes import list_extremes
from proofmass.studies.stress.limit_search import LimitSearch
from proofmass.studies.stress.page import THEORY_TOLERANCE, stress_figure
from proofmass.studies.stress.problems import list_problems
from proofmass.studies.stress.stress import find_boundaries, store_trials
from proofmass.studies.study import Study

CASES = (
    "fourbar",
    "slider_crank",
    "double_rocker",
    "change_point",
    "fivebar",
    "pendulum",
    "fourbar_released",
    "balancer_sine",
    "rod_cantilever",
    "rod_snap",
)
HEAD = """# Where it breaks

`python -m benchmarks.stress` made this page. `proofmass stress` makes the first table, and
`proofmass stress CASE` makes the table of any case. One parameter at a time is increased or
decreased until the run fails, and each boundary is located to 1 % by bisection. A run fails if the
engine reports a failure, if its curves are not finite, if the constraint violation reaches a tenth
of the size of the mechanism, or if a position or a holding moment has an error of a tenth of its
range. *In silence* means that the engine itself does not report the failure. The kinds of limits
are:

{limits}

Two values, such as *2 to 2.5*, are the first and the last of several boundaries. A run fails at the
first value, and holds 2 % before it. A run holds at the last value, and fails 2 % beyond it.
Between the two some values hold and others fail. To find such boundaries, values that differ by
factors of 1.01 to 1.4 from each boundary that bisection found are tried before and beyond it. Where
one before it fails, or one beyond it holds, the first and the last boundary are searched.
Boundaries that lie between all these values are not found.

There are two causes of several boundaries. The first is an error that rises and falls with the
parameter, so that it passes a tenth of the range several times: the error of `fivebar` in RK4 is
0.147 of the range with steps of 0.445 s, 0.033 with 0.453 s, and 0.144 with 0.46 s. The second is
the pose of `change_point` in which its bars are in line. At each pass through this pose the
mechanism continues, fails or takes the other assembly mode, depending on where the steps are. With
Euler it holds with steps of 0.06971 s, and fails with 0.069715 s. Rounding does not decide there:
changes of the step by 1e-9 change nothing. In pymunk rounding decides: with a last body 62 times as
heavy `change_point` holds, with 62.00000006 times it fails, and with 62.00000025 times it holds;
`fivebar` fails with 0.0072 of the length to spare, and holds with 0.0072000000144. Therefore these
limits depend on the machine: the same version found 60.39 to 65.79 times on one machine, and 62.06
to 66.89 times on another.

If nothing is known beyond a value, the table has the last value that held. This value depends on
the machine if the run beyond it exceeded its 60 s.

Where the time step is varied, the engine takes exactly the step that is tried. As many whole steps
as fit between two samples of the case lead from one sample to the next, and the end of the run is
moved to the nearest sample. With a drive at constant speed that makes no whole turns, or with a
motion profile, the run ends at the last sample before its end. Faster drives and longer runs are
stepped in the same way, down to four steps for the whole run. Where another parameter is varied,
the samples are those of the sidecar, and the step is the largest one up to the step of the model of
which a whole number fits between two samples. The step that the engine took is a column of
`stress.csv`.

`tests/studies/stress/test_stress_bare.py` confirms 40 of these boundaries within 2 % with scripts
in `tests/studies/stress/bare/` that import an engine and NumPy and nothing of proofmass. These are
limits of time steps of the pendulum and of four-bars, gravity, springs, drive speed, energy, and
small models.

`python -m benchmarks.limits` confirms the limits of cases in dynamics runs by programs in bare
engines: [Limits in bare engines](limits.md). Limits of sweeps are those of proofmass and an engine
together, because proofmass searches for the poses with what the engine computes.

The limits of pymunk are those of Chipmunk with the settings of proofmass. Pins close in one step.
There are as many iterations as the poses need, up to 3000. A link on the ground that is nearly a
point mass is built as a body of twice its mass at half its distance, which swings in the same way.
With this body the pendulum takes steps of up to 0.0547 s; built as a point mass it takes steps of
up to 0.0475 s.

The parameters of cases are:

- *Stable time step*: the same for stability alone, of free motions in MuJoCo; theory is the limit
  of the [first screen](first_screen.md).
- *Length to spare where bars come in line*: the last link of the last loop is shortened until the
  mechanism can only just make its whole way, according to its reference. There bars come in line
  and two assembly modes meet: a four-bar has a change point, and the couplers of a five-bar lie one
  on the other. The boundary is the additional length that an engine needs to stay in its mode, as a
  share of that length. *Where an arm is stretched*: the same for both links that the last loop
  connects, which come in line end to end. A constraint violation, as a share of the size, rotates
  the links by this share divided by the square root of the length to spare
  (`tests/studies/stress/test_stress_singular.py`).
- *Drive's way*: the drive moves as far as the limit position of the reference, which is the theory,
  and of the engine. *Until a rod snaps*: the drive moves until the positions on the way back
  differ; the boundary of the chain is compared with the fold of the rod.
- *Spring in a joint*: the stiffness is increased from one swing in the run to 1e12 times as much.
  Chipmunk's bodies move straight ahead during a step, so that there only small swings have a
  theory.
- *All lengths*: gravity is scaled with the lengths; masses and times stay the same. By dimensional
  analysis the errors, as shares of the range, are those of the mechanism's own size; the run fails
  if they are ten times as large. MuJoCo compiles a point less than 1e-6 m from its body's origin as
  the origin (`kFrameEps`), and refuses inertias up to 1e-15 kg m² (`mjMINVAL`). These two limits
  are the theory for MuJoCo. MuJoCo also compiles the model for pymunk, so that nothing is known of
  pymunk below them.
- *Steps*: the same motion is repeated, to and fro if it is not closed. *Until the energy is off*:
  the free motion continues, whatever its reference.
"""
KNOWN = """## Comparison with theory

A spring and a damper on one coordinate have ω² = k/I and ζ = c/(2 I ω). With z = dt ω, a step of
each integrator is a matrix (`proofmass/studies/stress/theory.py`);
`tests/studies/stress/test_stress_theory.py` confirms that the engines' own steps agree with this
matrix to 1e-12. The limit is the value at which an eigenvalue leaves the unit circle. {near} of
{all} boundaries are within {within:.0%} of theory; the largest deviation is a ratio of {furthest}.

![Boundaries as bars, theory as ticks, and the ratios](stress.png)

- MuJoCo's Euler, implicit and implicitfast are implicit in the damper, but not in the spring: they
  are stable for z < 2 (ζ + √(1 + ζ²)). With `eulerdamp="disable"` they are stable for
  z < 2 (√(1 + ζ²) − ζ), so that damping lowers the limit.
- RK4 is explicit in both, and stable up to z = 2 √2 without damping. `discrete` is implicit in
  both.
- Chipmunk applies damping exactly, after the spring has acted: it is stable for
  z² < 2 (1 + exp 2ζz), which is always satisfied from ζ = 0.246 on. proofmass's dampers in pymunk
  follow the midpoint rule: they are of second order, and stable for z < 2 with any damping.
- A `solref` is an explicit spring with critical damping. `refsafe` keeps its time constant at 2 dt
  or more. Without `refsafe` the limit is 1.21 dt with Euler, and 0.36 dt with RK4.
- A velocity servo is an explicit damper in Euler and RK4, but not in the implicit integrators.
- Flat cylinders that hang above a floor, at rest and without gravity, are moved by contacts that
  should not exist: [Contacts and friction](contacts.md#a-flat-cylinder-that-hangs-above-a-floor).
"""
THEORY = "theory"
"""Value of --only that stands for the small models."""


def main(argv: Sequence[str] | None = None) -> None:
    parser = command(__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT / "reports" / "stress")
    parser.add_argument("--only", nargs="+", metavar="CASE", help="names of cases")
    parser.add_argument("--parameter", nargs="+", metavar="TEXT", default=[""])
    given = parser.parse_args(argv)
    if given.only:
        renew(given.only, given.parameter, given.folder)
        return
    max_searches = 1 if given.quick else None  # of the small models, and of each case
    with folders(given.quick, given.folder) as (folder, docs):
        study = Study(Store(folder / "runs"))
        with study.working() as working:
            known = find_boundaries(small_models(study.store, max_searches), working)
            cases = {
                name: list_extremes(load_case(next((ROOT / "models").rglob(f"{name}.toml"))), study)
                for name in (("pendulum",) if given.quick else CASES)
            }
            found = find_boundaries(
                [one for searches, _ in cases.values() for one in searches[:max_searches]], working
            )
        write_boundaries([*known, *found], folder / "stress.csv")
        draw(known, docs)
        lines = [HEAD.format(limits=kinds()), *theory_section(known)]
        for name, (_, skipped) in cases.items():
            lines += case_section(name, [one for one in found if one.what == name], skipped)
        (docs / "stress.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


def small_models(store: Store, count: int | None = None) -> list[LimitSearch]:
    """The searches of the first `count` small models, or of all, with their trials stored."""
    return [store_trials(one, store) for one in islice(list_problems(), count)]


def draw(known: Sequence[Boundary], docs: Path) -> None:
    """Write the figure of the small models."""
    with rc_context(RC), replacing_pages():
        save(stress_figure(known), docs / "stress")
    (docs / "stress.svg").unlink()


def renew(names: Sequence[str], parameters: Sequence[str], folder: Path) -> None:
    """Search limits of some cases again, and write their rows into docs/stress.md."""
    file, study = ROOT / "docs" / "stress.md", Study(Store(folder / "runs"))
    for name in names:
        _, title, rest = file.read_text(encoding="utf-8").partition("\n## Comparison with theory")
        head = HEAD.format(limits=kinds())
        if name == THEORY:
            with study.working() as working:
                known = find_boundaries(small_models(study.store), working)
            draw(known, file.parent)
            cases = rest[rest.index("\n\n## ") :]
            section = "\n".join(theory_section(known))
            file.write_text(f"{head}\n{section}{cases}", encoding="utf-8")
            continue
        searches, _ = list_extremes(load_case(next((ROOT / "models").rglob(f"{name}.toml"))), study)
        asked = [
            one
            for one in searches
            if any(text in f"{one.parameter}, {one.engine}, {one.setting}" for text in parameters)
        ]
        with study.working() as working:
            found = find_boundaries(asked, working)
        file.write_text(head + title + with_rows(rest, name, found), encoding="utf-8")


def with_rows(text: str, name: str, found: Sequence[Boundary]) -> str:
    """The document with new rows of a case.

    Raises
    ------
    SystemExit
        The document has no such row.
    """
    fresh = {key_of_row(row): row for row in map(row_of, found)}
    case, lines = "", text.split("\n")
    for k, line in enumerate(lines):
        case = line.removeprefix("## ") if line.startswith("## ") else case
        if case == name and line.startswith("|"):
            lines[k] = fresh.pop(key_of_row(line), line)
    if fresh:
        raise SystemExit(f"docs/stress.md has no row of {name} for {', '.join(map(str, fresh))}")
    return "\n".join(lines)


def key_of_row(row: str) -> tuple[str, ...]:
    """Parameter and solver of a row of a case."""
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    return cells[0], *cells[2:3]


def kinds() -> str:
    """A list of the kinds of limits, with a sentence for each."""
    return "\n".join(
        fill(f"- *{kind}*: {kind.sentence}.", 99, subsequent_indent="  ") for kind in BoundaryKind
    )


def theory_section(known: Sequence[Boundary]) -> Iterator[str]:
    """The section with the small models whose limits theory predicts."""
    furthest = max(known, key=lambda one: abs(one.ratio - 1) if one.ratio == one.ratio else 9e9)
    yield KNOWN.format(
        near=sum(abs(one.ratio - 1) <= THEORY_TOLERANCE for one in known),
        all=len(known),
        within=THEORY_TOLERANCE,
        furthest=number(furthest.ratio, 4),
    )
    yield "| model | solver | parameter | measured | kind | theory | ratio | formula |"
    yield "|---|---|---|---|---|---|---|---|"
    for one in known:
        yield (
            f"| {one.what} | {one.setting} | {one.parameter} | {one.describe(one.unit)} | "
            f"{one.limit} | {number(one.theory, 4)} | {number(one.ratio, 4)} | "
            f"{one.law.replace('|', '¦')} |"
        )


def case_section(name: str, found: Sequence[Boundary], skipped: Sequence[str]) -> Iterator[str]:
    """The section of a case: its boundaries, and the parameters that were not varied."""
    yield f"\n## {name}\n"
    yield "| parameter | from | solver | boundary | theory | how it breaks |"
    yield "|---|---|---|---|---|---|"
    yield from map(row_of, found)
    yield f"\nNot varied: {'; '.join(skipped)}."


def row_of(one: Boundary) -> str:
    """A row of the table of a case."""
    theory = number(one.theory) if one.theory == one.theory else ""
    return (
        f"| {one.parameter} | {number(one.start)} | {one.engine}, {one.setting} | "
        f"{one.describe(one.unit)} | {theory} | {one.ending.replace('|', '¦')} |"
    )


if __name__ == "__main__":
    main()

"""Where engines break: small models beside the limits that theory knows, and extremes of cases.

    python -m benchmarks.stress [folder] [--only CASE ...] [--parameter TEXT ...] [--quick]

Writes docs/stress.md and docs/stress.png.  Runs are kept in the folder (reports/stress), so that a
call goes on where another was interrupted.  With --only the limits of these cases are searched
again, with --parameter those whose parameter and solver contain a text, such as "time step,
mujoco", and all other rows of docs/stress.md stay as they are.  --only theory makes the table and
the figure of the small models again.
"""

from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from textwrap import fill

from matplotlib import rc_context

from benchmarks import ROOT, command, folders
from proofmass.report.figures import save
from proofmass.report.style import RC
from proofmass.sidecar import load_case
from proofmass.studies.run import pool
from proofmass.studies.store import Store
from proofmass.studies.stress.boundary import Boundary, BoundaryKind, write_boundaries
from proofmass.studies.stress.extremes import extremes
from proofmass.studies.stress.limit_search import LimitSearch
from proofmass.studies.stress.page import NEAR, stress_figure
from proofmass.studies.stress.problems import list_problems
from proofmass.studies.stress.stress import cache_trials, reached, stress
from proofmass.wording import number

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

`python -m benchmarks.stress` made this; `proofmass stress` and `proofmass stress CASE` do the same
for the first table and for any case. It increases or decreases one parameter at a time until the
run fails, and locates each boundary to 1 % by bisection. A run fails when the engine says so, when
it is not finite, when a loop comes open by a tenth of the mechanism, or when a position or a
holding moment is off by a tenth of its range. *In silence* means that the engine itself says
nothing of it. The kinds of limits are:

{limits}

Two values, such as *2 to 2.5*, are the first and the last of several boundaries. At the first a run
fails, and 2 % before it none does; the last holds, and 2 % beyond it none does; between them some
values hold and others fail. Beside each boundary that bisection found, values are tried that are
1.01 to 1.4 times away, to both sides: where one before it fails, or one beyond it holds, the first
and the last are looked for. Boundaries that all these values miss are not seen. There are two
causes. An error goes up and down with the parameter, and passes a tenth several times: that of
`fivebar` in RK4 is 0.147 of the range in steps of 0.445 s, 0.033 in 0.453 s, 0.144 in 0.46 s. And
`change_point` goes on, fails or takes the other way at each pass through the pose in which its
bars are in line, by where its steps fall there: with Euler it holds in steps of 0.06971 s, and is
failed in 0.069715 s; rounding does not decide there, changes of the step by 1e-9 change nothing. In
pymunk it decides: with a last body 62 times as heavy `change_point` holds, with 62.00000006 times
it fails, and with 62.00000025 times it holds; `fivebar` fails with 0.0072 of the length to spare,
and holds with 0.0072000000144. So these limits are of a machine: the same version found 60.39 to
65.79 times on one, and 62.06 to 66.89 times on another.

Where nothing is known beyond, the last value that held is given. It depends on the machine where
time ran out: a run has 60 s.

The time step that is asked for is the one that is taken. Whole steps lead from sample to sample, as
many as fit between two samples of the case, and the end of the run is moved to the nearest sample;
a drive at constant speed that makes no whole turns, or one by a law, ends at the last sample before
its end. Faster drives and longer runs are stepped in the same way, down to four steps for the whole
run. Where another parameter is varied, the samples are those of the sidecar, and the step is the
longest whole part of a sample up to the step that the model asks for. The step that the engine took
is a column of `stress.csv`.

`tests/studies/stress/test_stress_bare.py` confirms 40 of these boundaries within 2 %, by scripts in
`tests/studies/stress/bare/` that import an engine and NumPy and nothing of proofmass: time steps of
the pendulum and of four-bars, gravity, springs, drive speed, energy, and small models.

`python -m benchmarks.limits` confirms the limits of cases in dynamics runs by programs in bare
engines: [Limits in bare engines](limits.md). Limits of sweeps are those of proofmass and an engine
together: proofmass searches for the poses, with what the engine computes of them.

What is said of pymunk holds of Chipmunk as proofmass sets it: pins that close in one step; as many
iterations as the poses need, up to 3000; a link on the ground that is nearly a point mass as a body
of twice its mass at half its distance, which swings in the same way. So the pendulum takes steps of
up to 0.0547 s; built as a point mass, of up to 0.0475 s.

The parameters of cases:

- *Length to spare where bars come in line*: the last link of the last loop is shortened until the
  mechanism only just makes its way, by its reference. There bars come in line and two assembly
  modes meet: a change point of a four-bar, the couplers of a five-bar one on the other. Given is
  the share of that length that an engine needs beyond it to stay in its mode. *Where an arm is
  stretched*: the same for both links that the last loop holds together, in line end to end. An
  open loop turns them by its gap over the root of that share
  (`tests/studies/stress/test_stress_singular.py`).
- *Drive's way*: to a limit position, of the reference and of the engine. *Until a rod snaps*: until
  positions differ on the way back; of chains, beside the fold of the rod.
- *Spring in a joint*: from one swing in the run to 1e12 times as stiff. Chipmunk's bodies go
  straight ahead during a step, so that there only small swings have a theory.
- *All lengths*: gravity goes with them, masses and times stay. By dimensional analysis errors are
  those of the mechanism's own size; where they are ten times as large the run fails. MuJoCo
  compiles what is less than 1e-6 m from its body's origin as the origin (`kFrameEps`), and refuses
  inertias up to 1e-15 kg m² (`mjMINVAL`): that is the theory for MuJoCo. It compiles the model for
  pymunk as well, of which nothing is known below.
- *Steps*: the same motion on and on, to and fro where it does not close; *until the energy is off*:
  of the free motion, whatever its reference.
"""
KNOWN = """## Beside theory

A spring and a damper on one coordinate have ω² = k/I and ζ = c/(2 I ω). With z = dt ω, a step of
each integrator is a matrix (`proofmass/studies/stress/theory.py`);
`tests/studies/stress/test_stress_theory.py` holds the engines' own steps to it, to 1e-12. The limit
is where an eigenvalue leaves the unit circle. {near} of {all} boundaries are within {within:.0%} of
theory, the furthest at a ratio of {furthest}.

![Boundaries as bars, theory as ticks, and the ratios](stress.png)

- MuJoCo's Euler, implicit and implicitfast are implicit in the damper, not in the spring:
  z < 2 (ζ + √(1 + ζ²)); with `eulerdamp="disable"` z < 2 (√(1 + ζ²) − ζ), where damping costs.
- RK4 is explicit in both, and goes to 2 √2 undamped; `discrete` is implicit in both.
- Chipmunk takes damping out exactly, after the spring has acted: z² < 2 (1 + exp 2ζz), which always
  holds from ζ = 0.246 on.
- A `solref` is an explicit spring with critical damping: `refsafe` keeps it from 2 dt upwards;
  without, 1.21 dt is the edge with Euler, and 0.36 dt with RK4.
- A velocity servo is an explicit damper to Euler and RK4, and none to the implicit integrators.
- Flat cylinders that hang above a floor, at rest and without weight, are moved by contacts that are
  not there: [Contacts and friction](contacts.md#a-flat-cylinder-that-hangs-above-a-floor).
"""
THEORY = "theory"
"""With --only: the small models, in place of a case."""


def main(argv: Sequence[str] | None = None) -> None:
    parser = command(__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT / "reports" / "stress")
    parser.add_argument("--only", nargs="+", metavar="CASE", help="names of cases")
    parser.add_argument("--parameter", nargs="+", metavar="TEXT", default=[""])
    given = parser.parse_args(argv)
    if given.only:
        renew(given.only, given.parameter, given.folder)
        return
    most = 1 if given.quick else None  # boundaries, of small models and of each case
    with folders(given.quick, given.folder) as (folder, docs):
        store = Store(folder / "runs")
        with pool() as workers:
            known = stress(small_models(store, most), workers)
            cases = {
                name: extremes(load_case(next((ROOT / "models").rglob(f"{name}.toml"))), store)
                for name in (("pendulum",) if given.quick else CASES)
            }
            turned = stress(
                [one for searches, _ in cases.values() for one in searches[:most]], workers
            )
        write_boundaries([*known, *turned], folder / "stress.csv")
        draw(known, docs)
        lines = [HEAD.format(limits=kinds()), *beside(known)]
        for name, (_, skipped) in cases.items():
            lines += of_case(name, [one for one in turned if one.what == name], skipped)
        (docs / "stress.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


def small_models(store: Store, most: int | None = None) -> list[LimitSearch]:
    """The first of the small models, all if not told how many, with their trials stored."""
    return [cache_trials(one, store) for one in islice(list_problems(), most)]


def draw(known: Sequence[Boundary], docs: Path) -> None:
    """The figure of the small models."""
    with rc_context(RC):
        save(stress_figure(known), docs / "stress")
    (docs / "stress.svg").unlink()


def renew(names: Sequence[str], parameters: Sequence[str], folder: Path) -> None:
    """Search limits of some cases again, and write their rows into docs/stress.md."""
    file, store = ROOT / "docs" / "stress.md", Store(folder / "runs")
    for name in names:
        _, title, rest = file.read_text(encoding="utf-8").partition("\n## Beside theory")
        head = HEAD.format(limits=kinds())
        if name == THEORY:
            with pool() as workers:
                known = stress(small_models(store), workers)
            draw(known, file.parent)
            cases = rest[rest.index("\n\n## ") :]
            file.write_text(head + "\n" + "\n".join(beside(known)) + cases, encoding="utf-8")
            continue
        searches, _ = extremes(load_case(next((ROOT / "models").rglob(f"{name}.toml"))), store)
        asked = [
            one
            for one in searches
            if any(text in f"{one.parameter}, {one.engine}, {one.setting}" for text in parameters)
        ]
        with pool() as workers:
            found = stress(asked, workers)
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
    """What the kinds of limits are, as a list."""
    return "\n".join(
        fill(f"- *{kind}*: {kind.sentence}.", 99, subsequent_indent="  ") for kind in BoundaryKind
    )


def beside(known: Sequence[Boundary]) -> Iterator[str]:
    """The table of what theory knows."""
    furthest = max(known, key=lambda one: abs(one.ratio - 1) if one.ratio == one.ratio else 9e9)
    yield KNOWN.format(
        near=sum(abs(one.ratio - 1) <= NEAR for one in known),
        all=len(known),
        within=NEAR,
        furthest=number(furthest.ratio, 4),
    )
    yield "| model | solver | parameter | measured | kind | theory | ratio | law |"
    yield "|---|---|---|---|---|---|---|---|"
    for one in known:
        yield (
            f"| {one.what} | {one.setting} | {one.parameter} | {reached(one)} | {one.limit} | "
            f"{number(one.theory, 4)} | {number(one.ratio, 4)} | {one.law.replace('|', '¦')} |"
        )


def of_case(name: str, found: Sequence[Boundary], skipped: Sequence[str]) -> Iterator[str]:
    """The table of a case."""
    yield f"\n## {name}\n"
    yield "| parameter | from | solver | boundary | theory | how it breaks |"
    yield "|---|---|---|---|---|---|"
    yield from map(row_of, found)
    yield f"\nNot turned: {'; '.join(skipped)}."


def row_of(one: Boundary) -> str:
    """A row of the table of a case."""
    theory = number(one.theory) if one.theory == one.theory else ""
    return (
        f"| {one.parameter} | {number(one.start)} | {one.engine}, {one.setting} | "
        f"{reached(one)} | {theory} | {one.ending.replace('|', '¦')} |"
    )


if __name__ == "__main__":
    main()

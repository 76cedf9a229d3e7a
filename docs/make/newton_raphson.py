"""Newton-Raphson as two documents teach it: iterations, and one system of nine or three of three.

    python -m docs.make.newton_raphson [-o docs/newton_raphson.md] [--quick]

The work is counted.  Times are CPU seconds of this process, of all forms in turn, so that other
loads of the machine affect all of them.  Each pose of a sweep starts from the pose before it.
"""

import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks import command
from proofmass.analytic.linkages import hacksaw
from proofmass.analytic.newton_raphson import newton_raphson
from teaching.natural_coordinates import EXAMPLES, assemble, sweep
from teaching.newton_log import format_log

Array = NDArray[np.float64]
LINK = {"crank": 0.075, "coupler": 0.170, "offset": 0.045}
POSES, ROUNDS = 1000, 9

PAGE = """# Newton-Raphson as taught

`python -m docs.make.newton_raphson -o docs/newton_raphson.md` made this page. Two of the source
documents solve their mechanisms by Newton-Raphson. B. Díaz Lozano solves four linkages in natural
coordinates. The power hacksaw report solves its offset slider-crank for position, velocity and
acceleration, one after the other or all at once. Both methods are implemented here so that they can
be read, printed and drawn. They are no references of engines; the closed forms are, and tests
compare the closed forms with these methods. Notebooks explain them:
[Slider-crank](notebooks/slider_crank.md),
[Inverted slider-crank](notebooks/inverted_slider_crank.md) and
[Power hacksaw](notebooks/hacksaw.md).

## The log

`teaching.natural_coordinates` has the constraints, one function a row, and the four linkages.
`format_log` writes q, Phi, J, rank and error of each iteration, as the document's notebooks do:

```python
from teaching.natural_coordinates import assemble, slider_crank
from teaching.newton_log import format_log

linkage = slider_crank(1.0, 2.0, guide=((2.0, 0.0), (3.0, 0.0)))
log = assemble(linkage, (0.1, 0.2, 1.0, 0.2, 0.5))     # X1, Y1, X2, Y2, theta
print(format_log(log))
```

```
{log}
```

`log.root` is the last q; `log.steps`, `log.residuals`, `jacobian_ranks(log)` and
`condition_numbers(log)` are arrays over the iterations; `log.iterates`, `log.values` and
`log.jacobians` are q, Phi and J of every iteration. For a linkage that cannot be assembled,
`NotConverged` is raised, which has the `log` as well. `velocities` and `accelerations` solve one
linear system each, and `sweep` solves many poses.

| linkage | iterations from the document's guess | poses per second |
|---|---|---|
{linkages}

## Constraints

| row | equation | figure of the document |
|---|---|---|
| `distance` | a rigid bar: \\|12\\|² = L² | 39 |
| `collinear` | a slider on a bar: 13 × 12 = 0 | 41 |
| `constant_angle` | a slider that does not rotate on its bar: 12 · 3D = k | 41 |
| `relative_angle` | an angle between links: 12 · 13 = L L' cos φ, 12 × 13 = L L' sin φ | 42 |
| `ground_angle` | an angle to the ground: 13 = L' (cos φ, sin φ) | 43 |

`relative_angle` has both rows, as the document advises. `ground_angle` has both rows, or one of
them if it is given a threshold, as in the document's programs. With one row a second pose fulfils
the constraints (`tests/teaching/test_natural_coordinates.py`).

## Convergence

The page of `models/linkages/hacksaw` has the report's figures as charts: the unknowns and their
errors over the iterations, the last step of each pose of a sweep, and the nine errors against the
closed form. From the report's first guess the positions take {position} iterations, the rates and
the accelerations {rate} each, and all nine unknowns at once {whole}.

## One system of nine, or three of three

The table is for {poses} poses of the report's motor, with a last step of at most 1e-6. The report
finds that the simultaneous form takes 12 % less time, in MATLAB with symbolic substitution; its
text has neither the times nor the machine.

| form | systems solved | equations evaluated | entries of Jacobians | \
multiplications of the solutions | CPU s | share of the first |
|---|---|---|---|---|---|---|
{forms}

CPU times are the shortest of {rounds} rounds, in which the forms take turns, in one thread on a
machine that others used as well. Shares are medians over the rounds, with the smallest and the
largest. Systems, equations and entries are counted; multiplications are estimated from the sizes of
the systems. The sequential form has less to compute in all of these, but more systems: those of
rates and of accelerations are linear, and take one step and another to confirm it, while the
simultaneous form solves both in the steps that the positions need. Here the calls of an iteration
cost more than its arithmetic, so that the form with fewer systems is a little cheaper, or as cheap.
A sequential form that evaluates all nine equations and uses three of them, as a program must that
has only the nine, costs twice as much. Therefore such a share is no property of the method: it
shows what an iteration costs in a language.

## Functions

::: proofmass.analytic.newton_raphson.newton_raphson

::: proofmass.analytic.newton_raphson.NewtonLog

::: teaching.newton_log.format_log

::: teaching.natural_coordinates.assemble

::: teaching.natural_coordinates.NaturalLinkage

::: teaching.natural_coordinates.relative_angle

::: teaching.natural_coordinates.constant_angle

::: proofmass.analytic.linkages.hacksaw.newton_pose

::: proofmass.analytic.linkages.hacksaw.newton_sweep
"""


def linkages(poses: int) -> list[str]:
    """A row for each linkage in natural coordinates, with its iterations and its speed."""
    rows = []
    for name, (linkage, start) in EXAMPLES.items():
        found = assemble(linkage, start)
        angles = found.root[-linkage.inputs :] + np.linspace(0.0, 0.1, poses)[:, None]
        began = time.process_time()
        sweep(linkage, found.root, angles, (1.0,) * linkage.inputs, (0.0,) * linkage.inputs)
        speed = poses / (time.process_time() - began)
        rows.append(f"| {name} | {found.iterations} | {speed:,.0f} |")
    return rows


def whole_blocks(law: tuple[Array, ...]) -> dict[str, Array]:
    """The sequential sweep of a program that evaluates all nine equations to use three of them."""
    x, count = np.array(hacksaw.SWEEP_GUESS), []
    for pose in np.transpose(law):
        solved = 0
        for first in (0, 3, 6):
            part = slice(first, first + 3)

            def block(q: Array, pose: Array = pose, part: slice = part) -> tuple[Array, Array]:
                x[part] = q
                gap, slope = hacksaw.newton_system(x, pose, *LINK.values())
                return gap[part], slope[part, part]

            log = newton_raphson(block, x[part], tolerance=1e-6, max_iterations=50)
            x[part], solved = log.root, solved + log.iterations
        count.append(solved)
    return {"iterations": np.array(count)}


def time_in_turn(works: Sequence[Callable[[], object]], rounds: int) -> Array:
    """CPU times of some functions [s] (rounds, works), each round in another order."""
    times = np.empty((rounds, len(works)))
    for k in range(rounds):
        for i in np.roll(np.arange(len(works)), k):
            began = time.process_time()
            works[i]()
            times[k, i] = time.process_time() - began
    return times


def forms(poses: int, rounds: int) -> list[str]:
    """A row for each form, with its counts and its CPU time."""
    law = hacksaw.motor(np.linspace(0.0, 2.0 * hacksaw.turn_time(), poses))
    works = {
        "sequential, three of its equations at a time": (
            partial(hacksaw.newton_sweep, *law, **LINK, simultaneous=False),
            (3, 3),
        ),
        "sequential, three of all nine taken": (partial(whole_blocks, law), (9, 3)),
        "simultaneous": (partial(hacksaw.newton_sweep, *law, **LINK), (9, 9)),
    }
    taken = time_in_turn([work for work, _ in works.values()], rounds)
    rows = []
    for k, (name, (work, (evaluated, size))) in enumerate(works.items()):
        systems = int(np.sum(work()["iterations"]))
        products = size**3 // 3 + size**2  # of an elimination and a substitution
        share = taken[:, k] / taken[:, 0]
        rows.append(
            f"| {name} | {systems:,} | {systems * evaluated:,} | {systems * evaluated**2:,} | "
            f"{systems * products:,} | {taken[:, k].min():.2f} | {np.median(share):.2f} "
            f"({share.min():.2f} to {share.max():.2f}) |"
        )
    return rows


def main(argv: Sequence[str] | None = None) -> None:
    parser = command(__doc__)
    parser.add_argument("-o", "--output", type=Path, default=None)
    given = parser.parse_args(argv)
    poses, rounds = (50, 1) if given.quick else (POSES, ROUNDS)
    rest, guess = (0.0, 0.0, 0.0), hacksaw.FIRST_GUESS
    _, (position, rate, _) = hacksaw.newton_pose(rest, guess, **LINK, simultaneous=False)
    _, (whole,) = hacksaw.newton_pose(rest, guess, **LINK)
    linkage, start = EXAMPLES["slider-crank"]
    log = format_log(assemble(linkage, start)).splitlines()
    text = PAGE.format(
        log="\n".join([*log[:14], "...", *log[-8:]]),
        linkages="\n".join(linkages(poses)),
        position=position.iterations,
        rate=rate.iterations,
        whole=whole.iterations,
        forms="\n".join(forms(poses, rounds)),
        poses=poses,
        rounds=rounds,
    )
    if given.output:
        given.output.write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()

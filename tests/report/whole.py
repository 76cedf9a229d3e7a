"""Results of cases with curves of all their solvers.

The curves are made from the references, so that no engine runs.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from proofmass.batch.check import Result
from proofmass.case.case import Case
from proofmass.evidence.diagnosis import Diagnosis
from proofmass.reference.evaluate import evaluate
from proofmass.report import case_figures
from proofmass.run.solve import plan_run
from proofmass.sim.protocol.curves import Curves
from proofmass.verdict.compare import compare
from proofmass.verdict.comparison import Comparison


@contextmanager
def without_figures(*kept: str) -> Iterator[None]:
    """Leave the static figures out of pages that are written in this context.

    Cases with views and the cases named in `kept` keep their figures.
    """
    isolated = case_figures.call_isolated

    def left_out(function, case, *args, **limits):
        if function is case_figures.draw_figures and not case.view and case.name not in kept:
            return {}
        return isolated(function, case, *args, **limits)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(case_figures, "call_isolated", left_out)
        yield


def result_from_references(*cases: Case, off: float = 1e-13, detectable: bool = False) -> Result:
    """A result whose curves differ from their references by waves.

    The amplitude of the waves is the share `off` of each curve's range.  Each solver has a wave of
    its own, so that signs and places of the largest errors differ.  With `detectable` the smallest
    detectable changes are computed for the first solver of each run.
    """
    result = Result(cases=list(cases))
    for case in cases:
        for kind, run in case.run.items():
            planned = plan_run(case, kind, "mujoco")
            state = planned.motion(planned.x) if planned.drives else None
            reference = evaluate(case, kind, planned.x, state).channels
            for number, solver in enumerate(run.solvers):
                wave = np.cos((3 + number) * np.linspace(0, 2, len(planned.x)) + number)
                curves = Curves(
                    planned.x,
                    {
                        name: reference[name] + off * (np.ptp(reference[name]) or 1.0) * wave
                        for name in case.channels_of(kind)
                    },
                    drive=state,
                    seconds=0.1,
                    steps=len(planned.x),
                    settings={"timestep": 1e-3},
                )
                rows = compare(case, kind, solver, curves, detectable=detectable and number == 0)
                result.curves[case.name, kind, solver] = curves
                result.comparisons.extend(replace(c, seconds=0.1) for c in rows)
    return result


def with_failed_dynamics(case: Case, result: Result, *solvers: str, samples: int = 100) -> Result:
    """The result with failed dynamics of these solvers, whose curves end after `samples` samples.

    The other curves stay as they are.
    """
    keys = {(case.name, "dynamics", solver) for solver in solvers}
    failed_curves = {}
    for key in keys:
        whole = result.curves[key]
        failed_curves[key] = replace(
            whole,
            x=whole.x[:samples],
            channels={name: curve[:samples] for name, curve in whole.channels.items()},
            drive=tuple(part[:, :samples] for part in whole.drive or ()),
        )
    return replace(
        result,
        curves={key: c for key, c in result.curves.items() if key not in keys},
        failed=failed_curves,
        comparisons=[
            Comparison(c.case, c.solver, c.run, c.channel, c.unit, outcome="diverged", message="!")
            if (c.case, c.run, c.solver) in keys
            else c
            for c in result.comparisons
        ],
        diagnoses={
            key: Diagnosis(*key, remarks=("pin.x left the tolerance first",), failed=True)
            for key in sorted(keys)
        },
    )

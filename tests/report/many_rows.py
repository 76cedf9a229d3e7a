"""A result of many cases, copies of those of `index_rows`, made without running an engine."""

from dataclasses import replace

from proofmass.batch.check import Result
from tests.report.index_rows import result_for_index

STUDY = "a study of a parameter, variant {}"


def result_of_many(count: int) -> Result:
    """A result of `count` cases: copies of the five cases of `result_for_index`, in turn.

    Their names end in a number.  The errors of a copy are the larger the larger its number is, by
    up to 2 %, so that no two have the same key of the order.
    """
    few = result_for_index()
    whole = Result(paths=few.paths)
    for k in range(count):
        case = few.cases[k % len(few.cases)]
        name = f"{case.name}_{k:04d}"
        whole.cases.append(case.model_copy(update={"called": name, "title": STUDY.format(k)}))
        whole.comparisons.extend(
            replace(c, case=name, error_max=c.error_max * (1 + 0.02 * k / count))
            for c in few.comparisons
            if c.case == case.name
        )
    return whole

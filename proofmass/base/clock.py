"""The clock by which runs are timed."""

import time

IS_FINE = time.get_clock_info("thread_time").resolution < 1e-5
"""Whether the processor time of a thread resolves runs of milliseconds; on Windows it does not."""


def processor_time() -> float:
    """Processor time of this thread [s], or wall time where that is not fine enough.

    Engines and references run in one thread.  The time of the whole process is not fine: Linux
    counts it in ticks of milliseconds as long as a limit of it is set, as in each worker.
    """
    return time.thread_time() if IS_FINE else time.perf_counter()

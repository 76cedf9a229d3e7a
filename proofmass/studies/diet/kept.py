"""What was tried in a diet, a file each, so that one that was stopped goes on."""

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco

from proofmass.studies.store import digest, once, saved, sources, versions


class Kept:
    """What came of models in runs.

    Parameters
    ----------
    folder : Path, optional
        Made if it is not there; without one nothing is kept.
    """

    def __init__(self, folder: Path | None = None):
        self.folder = folder
        if folder:
            folder.mkdir(parents=True, exist_ok=True)

    def once(self, models: list[mujoco.MjModel], runs: Any, make: Callable[[], Any]) -> Any:
        """What came of models in runs, made if it is not kept; of lists and numbers, as in JSON.

        Parameters
        ----------
        models : list of MjModel
        runs : object
            All else that it depends on, such that it pickles.
        make : callable
        """
        if not self.folder:
            return make()
        key = [*map(saved, models), pickle.dumps(runs), repr(versions("mujoco")).encode(),
               sources().encode()]
        return once(self.folder / f"{digest(b''.join(key))}.json", make)

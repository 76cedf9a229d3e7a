"""What was tried in a diet, a file each, so that one that was stopped goes on."""

import json
import pickle
from pathlib import Path
from typing import Any

import mujoco

from proofmass.study.scene import Watch
from proofmass.study.store import digest, saved, sources, versions, write


class Kept:
    """Outcomes of models in the runs of a scene.

    Parameters
    ----------
    folder : Path, optional
        Made if it is not there; without one nothing is kept.
    """

    def __init__(self, folder: Path | None = None):
        self.folder = folder
        if folder:
            folder.mkdir(parents=True, exist_ok=True)

    def get(self, models: list[mujoco.MjModel], watches: tuple[Watch, ...]) -> Any:
        """What came of models, one for each run; None if they were not tried."""
        file = self.file(models, watches)
        return json.loads(file.read_text(encoding="utf-8")) if file and file.is_file() else None

    def put(self, models: list[mujoco.MjModel], watches: tuple[Watch, ...], found: Any) -> None:
        """Keep what came of models."""
        if file := self.file(models, watches):
            write(file, json.dumps(found))

    def file(self, models: list[mujoco.MjModel], watches: tuple[Watch, ...]) -> Path | None:
        """Where that is: named by all that it depends on."""
        if not self.folder:
            return None
        told = [(w.name, pickle.dumps(w.run), w.allowed,
                 {n: v.tobytes() for n, v in w.before.channels.items()}) for w in watches]
        key = [*map(saved, models), pickle.dumps(told), repr(versions("mujoco")).encode(),
               sources().encode()]
        return self.folder / f"{digest(b''.join(key))}.json"

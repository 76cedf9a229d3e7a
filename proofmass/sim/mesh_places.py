"""Where the mesh files are that a URDF names: beside and above its file, and nowhere else.

A mesh is named by a path, relative to the URDF, or by ``package://NAME/REST``, where a package is a
folder of that name.  Folders are searched from that of the URDF upwards, up to the folder that a
user named, or `FOLDERS_ABOVE` folders if a user named the URDF itself.  A file outside the topmost
of them is never opened, also not by a link or by ``..``.
"""

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

FOLDERS_ABOVE = 5
"""Folders above a URDF that are searched if it was named itself.  In ROS a package is a folder
above the file or beside one, as in ``share/NAME/robots/ARM/urdf/arm.urdf``."""
SCHEME = re.compile(r"(?P<kind>[A-Za-z]+)://(?P<rest>.*)", re.DOTALL)
PACKAGE_SCHEMES = "package", "model"
READ_ENDINGS = ".stl", ".obj", ".msh"
"""Endings of the mesh files that MuJoCo reads."""


class NoMesh(Exception):
    """A mesh cannot be used; the message says why."""


@dataclass(frozen=True)
class MeshPlaces:
    """The folders in which the meshes of a URDF are looked for.

    Attributes
    ----------
    file : Path
        The URDF.
    within : Path or None
        The folder that a user named, in which the URDF was found; None if its file was named.
    meshdir : str
        The folder of meshes that the URDF names for MuJoCo; empty if none.
    """

    file: Path
    within: Path | None = None
    meshdir: str = ""

    @property
    def folders(self) -> list[Path]:
        """The folder of the URDF and those above it that may be searched, the lowest first."""
        own = Path(os.path.abspath(self.file)).parent
        above = [own, *own.parents]
        if self.within is not None and (top := Path(os.path.abspath(self.within))) in above:
            return above[: above.index(top) + 1]
        return above[: FOLDERS_ABOVE + 1]

    def find(self, name: str) -> Path:
        """The file of a mesh that MuJoCo reads.

        Raises
        ------
        NoMesh
            It is not there, lies outside the folders, or has a format that MuJoCo does not read.
        """
        top = Path(os.path.realpath(self.folders[-1]))
        outside = False
        for place in self.candidates(name):
            if not os.path.isfile(place):
                continue
            if Path(os.path.realpath(place)).is_relative_to(top):
                return require_format(place)
            outside = True
        if outside:
            raise NoMesh(f"lies outside {top}")
        raise NoMesh(f"not found {self.described(name)}")

    def candidates(self, name: str) -> Iterator[Path]:
        """The places where a mesh may be, the likeliest first."""
        own, *above = self.folders
        url = SCHEME.fullmatch(name)
        if url and url["kind"] in PACKAGE_SCHEMES:
            package, _, rest = url["rest"].partition("/")
            for folder in (own, *above):
                if folder.name == package:
                    yield folder / rest
                yield folder / package / rest
            return
        path = url["rest"] if url and url["kind"] == "file" else name
        yield own / path
        if self.meshdir:
            yield own / self.meshdir / path

    def described(self, name: str) -> str:
        """Where a mesh was looked for."""
        url = SCHEME.fullmatch(name)
        if not (url and url["kind"] in PACKAGE_SCHEMES):
            return f"beside {self.file.name}"
        package = url["rest"].partition("/")[0]
        return f"in a folder {package!r} beside or above {self.file.name}"


def require_format(file: Path) -> Path:
    """The file itself; `NoMesh` if MuJoCo does not read its format."""
    if file.suffix.lower() not in READ_ENDINGS:
        raise NoMesh(f"MuJoCo does not read {file.suffix or 'files without an ending'}")
    return file

"""An equilibrium of an assembly as a case: an MJCF of the platform, and a sidecar with the rods.

The reference `rod_assembly` solves the equilibrium again from a guess; the tolerances are the
errors of chains of as many links, which `assembly_chain` finds without an engine.
"""

import json
import re
import tomllib
from dataclasses import dataclass
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from jinja2 import Environment

from proofmass.analytic.numerics import TURN
from proofmass.analytic.rods.assembly import Assembly
from proofmass.analytic.rods.assembly_chain import bending_energy, chain_equilibria, chain_shapes
from proofmass.analytic.rods.assembly_newton import RodGuess
from proofmass.analytic.rods.assembly_search import RodEquilibria, rod_path
from proofmass.analytic.rods.rod_assembly import MAX_NUMBERED_RODS, RodAssembly, rod_curves_at
from proofmass.base.arrays import Array
from proofmass.base.errors import InputError
from proofmass.base.files import write_output
from proofmass.base.templates import template_environment
from proofmass.case.case import RodTable
from proofmass.sim.engines import default_engines
from proofmass.sim.protocol.failures import BadRod
from proofmass.sim.rods import compile_with_rods
from proofmass.studies.equilibria.rod_input import RodInput

LINKS = 20
"""Links of a rod, at least: as many as the shipped rods have."""
LINKS_PER_ALPHA = 2.5
"""Links for each unit of alpha, the load of the most loaded rod: 16 to a wave of its curvature."""
TOLERANCE_RATIO = 1.2
"""Tolerance over the error of a chain: an engine is at rest within 1e-6 of its chain."""
AWAY_RATIO = 5.0
"""Distance of the start of a case from its equilibrium, over the tolerances."""
START_SHARES = 1.0, 0.5, 0.25, 0.1
"""Shares of that distance that are tried, until the rods reach from clamps to platform."""
START_WAVE = 5e-4
"""[rad] of half of the wave in which the rods of an engine start, so that none begins at rest."""
LEAST_TOLERANCE = 1e-8
"""Tolerance over a size of the rods where chains have no error, as straight rods."""
GUESS_DIGITS = 6
"""Digits of the guess: with three, rods under tension of alpha = 12 lead to other equilibria."""
SHAPE_DIGITS, POSE_DIGITS = 4, 6
"""Digits of a start behind the decimal point [rad; m or rad]: it only chooses an equilibrium."""
PLATFORM_JOINTS = {
    "x": ("along", 'type="slide" axis="1 0 0"'),
    "y": ("across", 'type="slide" axis="0 1 0"'),
    "phi": ("platform", 'type="hinge" axis="0 0 1"'),
}
"""Bodies that carry the platform, and their joints, by coordinate."""
PLAIN_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")
TAKEN_NAME = re.compile(r"(world|centre|platform|along|across|load|energy|phi|x|y|(clamp|pin)\d+)")
"""Names that the written model uses itself."""


@dataclass(frozen=True)
class ChainsInCase:
    """Equilibria with their chains of links, for cases in which engines take these.

    Attributes
    ----------
    own : RodInput
    found : RodEquilibria (n,)
    """

    own: RodInput
    found: RodEquilibria

    @property
    def assembly(self) -> Assembly:
        """The assembly."""
        return self.found.problem.assembly

    @cached_property
    def links(self) -> int:
        """Links of each rod, a multiple of 4."""
        wanted = max(LINKS, LINKS_PER_ALPHA * float(self.found.alpha.max(initial=0.0)))
        return int(4 * np.ceil(wanted / 4))

    @cached_property
    def chains(self) -> RodGuess:
        """The equilibria of the chains; NaN where there is none."""
        return chain_equilibria(self.found, self.links)

    @cached_property
    def names(self) -> list[str]:
        """Names of the rods in a model: their own, where these can be."""
        return [
            name if PLAIN_NAME.fullmatch(name) and not TAKEN_NAME.fullmatch(name) else f"rod{i + 1}"
            for i, name in enumerate(self.own.names)
        ]

    @cached_property
    def joints(self) -> list[str]:
        """Free coordinates of the platform."""
        return [("x", "y", "phi")[c] for c in self.assembly.free]

    def errors(self, n: int, arc: Array) -> dict[str, float]:
        """Largest errors of the chains in equilibrium n at arc lengths [m], by unit [SI]."""
        one, problem = self.found.only(n), self.found.problem
        worst = dict.fromkeys(("m", "rad", "N m", "J"), 0.0)
        energy = 0.0
        for i in range(self.assembly.rods):
            shapes = chain_shapes(problem, self.chains[np.array([n])], i, self.links)
            rod = rod_curves_at(problem, one.state, i, arc)
            for name, unit in zip("xytm", ("m", "m", "rad", "N m"), strict=True):
                off = np.abs(shapes.at(arc)[name][:, 0] - rod[f"{name}{i + 1}"]).max()
                worst[unit] = max(worst[unit], float(off))
            energy += float(bending_energy(problem, i, shapes)[0])
        apart = np.abs(self.chains.pose[n] - one.state.pose[0])
        worst["m"] = max(worst["m"], float(apart[:2].max()))
        worst["rad"] = max(worst["rad"], float(apart[2]))
        worst["J"] = abs(energy - float(one.energy[0]))
        return worst

    def text(self, n: int, name: str) -> dict[str, str]:
        """The texts of the case of equilibrium n, by the ending of the file.

        Its start is `AWAY_RATIO` tolerances away, or less where its rods would be too short, so
        that no curve of an engine that does nothing agrees.
        """
        words = self.case_words(n, name) | {"solvers": default_engines()}
        off = {unit: AWAY_RATIO * float(allowed) for unit, allowed, _ in words["tolerances"]}
        for share in START_SHARES:
            found = render(self.moved(words, share * off["m"], share * off["rad"]))
            if is_closed(found):
                return found
        return render(self.moved(words, 0.0, 0.0))

    def start_text(self, n: int, engine: str) -> dict[str, str]:
        """The texts of a case of one engine that starts a little off equilibrium n."""
        words = self.case_words(n, "start") | {"solvers": [engine]}
        return render(self.moved(words, 0.0, START_WAVE))

    def moved(self, words: dict[str, Any], shift: float, wave: float) -> dict[str, Any]:
        """The words with a platform that starts nearer to the clamps, and rods with a wave.

        The platform is shifted along x and y by `shift` [m] and, if at all, turned by `wave` [rad].
        """
        pose = np.array(words["pose"])
        centre = self.found.problem.clamp.mean()
        for k, c in enumerate(self.assembly.free):
            to = (centre.real, centre.imag, 0.0)[c]
            pose[k] += np.sign(to - pose[k]) * (shift if c < 2 else wave * bool(shift))
        bend = 2.0 * wave * np.sin(TURN * np.linspace(0.0, 1.0, self.links + 1)[1:])
        rods = [
            {**rod, "shape": np.round(rod["shape"] + bend * (-1.0) ** k, SHAPE_DIGITS).tolist()}
            for k, rod in enumerate(words["rods"])
        ]
        return words | {"pose": np.round(pose, POSE_DIGITS).tolist(), "rods": rods}

    def case_words(self, n: int, name: str) -> dict[str, Any]:
        """What the templates say."""
        a, problem, pose = self.assembly, self.found.problem, self.found.state.pose[n]
        length = float(a.length.mean())
        load = np.append(problem.load[: a.dof], 0.0)[:3]
        stable = "stable" if self.found.index[n] == 0 else f"index {self.found.index[n]}"
        return {
            "name": name,
            "title": f"{self.own.title}: equilibrium {n + 1} of {len(self.found)}, {stable}",
            "source": f"proofmass equilibria {self.own.file.name}",
            "parameters": self.parameters(n),
            "rods": [self.rod_words(n, i) for i in range(a.rods)],
            "bodies": list(self.body_words()),
            "joints": self.joints,
            "pose": [float(pose[c]) for c in a.free],
            "load": load.tolist() if load.any() else [],
            "radius": 0.01 * length,
            "inertia": [1e-3 * length**2] * 3,
            "segments": self.links,
            "tolerances": list(self.tolerances(n)),
        }

    def body_words(self) -> Any:
        """Bodies that carry the platform, each with its joint or its fixed place."""
        held = np.nan_to_num(self.assembly.held)
        for c, (key, (name, kind)) in enumerate(PLATFORM_JOINTS.items()):
            is_free = key in self.joints
            at = [0.0, 0.0]
            if c < 2 and not is_free:
                at[c] = float(held[c])
            turn = float(held[2]) if c == 2 and not is_free else 0.0
            yield {
                "name": name,
                "pos": at,
                "turn": turn,
                "joint": key if is_free else "",
                "kind": kind,
            }

    def rod_words(self, n: int, i: int) -> dict[str, Any]:
        """What the templates say of a rod."""
        a, problem = self.assembly, self.found.problem
        path = rod_path(problem, self.found.state[np.array([n])], i, self.links + 1)
        angle = path.angle[::-1, 0]
        return {
            "name": self.names[i],
            "clamp": [float(problem.clamp[i].real), float(problem.clamp[i].imag)],
            "angle": within_half_turn(float(problem.angle[i])),
            "length": float(a.length[i]),
            "stiffness": float(a.stiffness[i]),
            "clamped": bool(a.clamped[i]),
            "at": [float(a.arm[i].real), float(a.arm[i].imag)],
            "is_drawn": bool(a.arm[i]),
            "tip_angle": float(a.tip_angle[i]) if a.clamped[i] else 0.0,
            "curvature": float(a.curvature[i]),
            "couple": float(a.couple[i]),
            "load": [float(a.weight[i].real), float(a.weight[i].imag)],
            "shape": angle[1:] - angle[0],
        }

    def parameters(self, n: int) -> dict[str, float | str]:
        """Parameters of the reference: the assembly, and the guess that chooses equilibrium n."""
        a, problem, state = self.assembly, self.found.problem, self.found.state
        given: dict[str, float | str] = dict(
            zip(("force_x", "force_y", "moment"), map(float, problem.load), strict=True)
        )
        given |= {
            f"held_{key}": float(value)
            for key, value in zip(("x", "y", "phi"), a.held, strict=True)
            if np.isfinite(value)
        }
        for i in range(a.rods):
            rod = self.rod_words(n, i)
            own: dict[str, float | str] = {
                "clamp_x": rod["clamp"][0],
                "clamp_y": rod["clamp"][1],
                "angle": rod["angle"],
                "length": rod["length"],
                "stiffness": rod["stiffness"],
                "end": "clamped" if rod["clamped"] else "pinned",
                "at_x": rod["at"][0],
                "at_y": rod["at"][1],
                "tip_angle": rod["tip_angle"],
                "curvature": rod["curvature"],
                "couple": rod["couple"],
                "load_x": rod["load"][0],
                "load_y": rod["load"][1],
            }
            given |= {f"{key}{i + 1}": value for key, value in own.items()}
        for c, key in enumerate(("x", "y", "phi")[: a.dof]):
            given[f"guess_{key}"] = guessed(state.pose[n, c])
        for i in range(a.rods):
            given[f"guess_force_x{i + 1}"] = guessed(state.own[n, i, 0])
            given[f"guess_force_y{i + 1}"] = guessed(state.own[n, i, 1])
            third = "moment" if a.clamped[i] else "angle"
            given[f"guess_{third}{i + 1}"] = guessed(state.own[n, i, 2])
        defaults = RodAssembly.parameters
        return {key: value for key, value in given.items() if value != defaults[key].default}

    def tolerances(self, n: int) -> Any:
        """Units with the allowed error and the error of the chains, as texts."""
        a = self.assembly
        arc = np.linspace(0.0, float(a.length.min()), self.links + 1)
        length, force, moment = a.scale
        sizes = {"m": length, "rad": 1.0, "N m": moment, "J": force * length}
        for unit, error in self.errors(n, arc).items():
            allowed = max(TOLERANCE_RATIO * error, LEAST_TOLERANCE * sizes[unit])
            yield unit, f"{allowed:.2g}", f"{error:.2g}"


def guessed(value: float) -> float:
    """A number of a guess."""
    return float(f"{value:.{GUESS_DIGITS}g}")


def within_half_turn(angle: float) -> float:
    """An angle [rad] plus whole turns, from -pi to pi, as engines read directions."""
    return angle - TURN * round(angle / TURN)


def format_digits(values: list[float]) -> str:
    """Numbers with all their digits, for an attribute of MJCF."""
    return " ".join(repr(value).removesuffix(".0") for value in values)


def render(words: dict[str, Any]) -> dict[str, str]:
    """The texts of a case by the ending of the file."""
    return {
        ending: assembly_templates().get_template(f"assembly.{ending}.jinja").render(words)
        for ending in ("xml", "toml")
    }


def is_closed(text: dict[str, str]) -> bool:
    """Whether the rods of a case reach from their clamps to the platform at its start."""
    tables = tomllib.loads(text["toml"])["rod"].items()
    rods = [RodTable(**table).built(name) for name, table in tables]
    try:
        compile_with_rods(mujoco.MjSpec.from_string(text["xml"]), rods)
    except BadRod:
        return False
    return True


@cache
def assembly_templates() -> Environment:
    """The templates of cases of assemblies, with their filters."""
    found = template_environment("proofmass.studies.equilibria")
    found.filters["digits"] = format_digits
    found.filters["toml"] = partial(json.dumps, ensure_ascii=False)
    found.filters["comment"] = lambda text: re.sub("--+", "-", text).rstrip("-.")
    return found


def require_writable(chains: ChainsInCase, which: list[int]) -> None:
    """Raise InputError for an assembly or for equilibria (from 0) that no case can have."""
    own, found = chains.own, chains.found
    if found.problem.assembly.rods > MAX_NUMBERED_RODS:
        raise InputError(
            own.file, "rod", f"{found.problem.assembly.rods} rods; cases have {MAX_NUMBERED_RODS}"
        )
    stable = ", ".join(str(n + 1) for n in np.flatnonzero(found.index == 0)) or "none"
    for n in which:
        if not 0 <= n < len(found):
            raise InputError(own.file, "", f"no equilibrium {n + 1}; there are 1 to {len(found)}")
        if found.index[n]:
            raise InputError(
                own.file,
                "",
                f"equilibrium {n + 1} is unstable, and no engine comes to rest in it; stable ones "
                f"are {stable}",
            )
        if np.isnan(chains.chains.pose[n, 0]):
            raise InputError(
                own.file,
                "",
                f"equilibrium {n + 1} has no counterpart of chains of {chains.links} links, whose "
                "links are too long for its loops",
            )


def write_cases(chains: ChainsInCase, which: list[int], folder: Path) -> list[Path]:
    """Write ``equilibriumN.xml`` and ``.toml`` for stable equilibria, numbered from 0.

    Raises
    ------
    InputError
        See `require_writable`; or a file is there that proofmass did not write.
    """
    require_writable(chains, which)
    written = []
    for n in which:
        name = f"equilibrium{n + 1}"
        for ending, text in chains.text(n, name).items():
            write_output(folder / f"{name}.{ending}", text)
        written.append(folder / f"{name}.toml")
    return written

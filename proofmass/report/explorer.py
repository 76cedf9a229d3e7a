"""A mechanism with sliders, for notebooks: sliders evaluate the reference, a button runs engines.

The panel is one SVG that is rewritten at each move of a slider: the mechanism at one pose with the
paths of its points, and curves over the run. Figures of matplotlib would be too slow for a slider.
"""

import re
from base64 import b64encode
from collections.abc import Callable, Mapping, Sequence
from html import escape
from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from proofmass.base.arrays import Array
from proofmass.base.errors import InputError, suggest_names
from proofmass.base.grouping import group_by
from proofmass.base.strict import Kind
from proofmass.base.wording import format_unit
from proofmass.case.case import Case
from proofmass.reference.evaluate import properties, reference_channels, reference_quantities
from proofmass.reference.find import assembly_modes, parameter_unit
from proofmass.report.data import displayed_unit, run_parameter
from proofmass.report.mechanism import PATH_COLOUR, format_pose
from proofmass.report.reprs import as_html
from proofmass.report.style import INK, MUTED_COLOURS
from proofmass.report.svg_picture import svg_as_png
from proofmass.run.solve import prescribed_run, solve
from proofmass.sim.engines import engine_names, format_solver
from proofmass.sim.protocol.curves import Curves
from proofmass.verdict.compare import compare
from proofmass.verdict.comparison import Comparison

Quantities = Mapping[str, Array]
Parameters = Mapping[str, Any]
LinkCorners = Callable[[Quantities, Parameters], Mapping[str, Any]]
"""Function of quantities (n,) and parameters that returns the corners of each link, by its name.

Corners are places in the complex plane [m]: a list of numbers and arrays (n,), of which one pose is
drawn; or an array, which is drawn as a line."""
Build = Callable[..., Case]
"""Function of parameters by name that returns the case with a model that has them."""
EXPLORER_SAMPLES = 121
# [px] width and height of the panel, width of the mechanism, and margin of the axes
EXPLORER_WIDTH, EXPLORER_HEIGHT, EXPLORED_WIDTH, AXES_MARGIN = 880, 420, 380, 62
PROPERTY_LETTERS = 66
"""Letters in a line below the mechanism: 5.7 px each on average, in 380 px."""
COLOURS = (*("#0072B2", "#D55E00", "#009E73", "#CC79A7"), *MUTED_COLOURS)
MISSING_IPYWIDGETS = "sliders need ipywidgets: pip install 'proofmass[notebooks]'"


class Explorer:
    """Sliders for the parameters of a case's reference, with its mechanism, curves and properties.

    Parameters
    ----------
    case : Case
        The sidecar.
    sliders : mapping of str to tuple of float
        Parameters and their least and greatest values [SI]. Buttons choose the assembly mode, where
        the reference has a parameter ``mode``.
    curves : sequence of sequence of str
        Channels and quantities of the reference, panel by panel; the first of a panel is a channel,
        and the others have its unit.
    links : function, optional
        ``links(quantities, parameters)`` returns the corners of links as complex numbers [m].
    model : function, optional
        ``model(**parameters)`` returns the case with a model that has them; a button runs it.
    run : "sweep", "dynamics" or "equilibrium", optional
        Run of the case; the first one, if not given.
    samples : int
        Largest number of samples of the run that are evaluated [1].
    properties : bool
        Whether properties of the mechanism are shown, such as the Grashof class.
    labels : mapping of str to str, optional
        Words that sliders and drawing show in place of their own, such as the names of parameters
        and channels: ``{"rocker": "balancín"}``. Messages and the table of engines are unchanged.

    Raises
    ------
    InputError
        The reference is a recorded curve, or has no such parameter; a channel does not exist.
    ValueError
        The bounds of a slider do not rise, or do not contain the value of the parameter.
    ImportError
        ipywidgets is not installed.
    """

    def __init__(
        self,
        case: Case,
        sliders: Mapping[str, tuple[float, float]],
        curves: Sequence[Sequence[str]],
        links: LinkCorners | None = None,
        *,
        model: Build | None = None,
        run: Kind | None = None,
        samples: int = EXPLORER_SAMPLES,
        properties: bool = True,
        labels: Mapping[str, str] | None = None,
    ) -> None:
        try:
            import ipywidgets
        except ImportError:
            raise ImportError(MISSING_IPYWIDGETS) from None
        require_sliders(case, sliders, curves)
        self.labels = dict(labels or {})
        self.case, self.curves, self.links, self.model = case, curves, links, model
        self.properties, self.property_texts = properties, dict[str, str]()
        self.kind: Kind = next(iter(case.run)) if run is None else run
        planned = prescribed_run(case, self.kind)
        few = np.linspace(0, len(planned.x) - 1, min(samples, len(planned.x))).round().astype(int)
        self.x = planned.x[few]
        self.state = planned.motion(self.x) if planned.drives else None
        self.scale = run_parameter(case, self.kind)
        self.found: dict[str, Curves] = {}
        self.rows: list[Comparison] = []
        self.known: dict[str, Array] = {}
        self.reference: dict[str, Array] = {}
        self.wrong = ""
        self.sliders = {
            name: ipywidgets.FloatSlider(
                value=float(case.parameters[name]),
                min=low,
                max=high,
                step=(high - low) / 200,
                description=self.label(name)
                + f" [{format_unit(parameter_unit(case, name)) or '1'}]",
                style={"description_width": "initial"},
                readout_format=".3g",
            )
            for name, (low, high) in sliders.items()
        }
        if "mode" in case.parameters and assembly_modes(case):
            self.sliders["mode"] = ipywidgets.ToggleButtons(
                options=assembly_modes(case),
                value=int(float(case.parameters["mode"])),
                description=self.label("mode"),
                style={"button_width": "auto"},
            )
        self.place = ipywidgets.IntSlider(
            value=len(self.x) // 6,
            max=len(self.x) - 1,
            description=self.label("pose"),
            readout=False,
        )
        self.play = ipywidgets.Play(
            value=self.place.value, max=len(self.x) - 1, interval=60, show_repeat=True
        )
        ipywidgets.jslink((self.play, "value"), (self.place, "value"))
        self.button = ipywidgets.Button(
            description=self.label("run in the engines"), layout={"width": "auto"}
        )
        self.panel, self.table = ipywidgets.HTML(), ipywidgets.HTML()
        controls = [ipywidgets.HBox([self.play, self.place]), *self.sliders.values()]
        if model is not None:
            controls.append(self.button)
        self.box = ipywidgets.VBox(
            [
                ipywidgets.Box(controls, layout={"flex_flow": "row wrap", "align_items": "center"}),
                self.panel,
                self.table,
            ]
        )
        for slider in self.sliders.values():
            slider.observe(self.change, "value")
        self.place.observe(self.move, "value")
        self.button.on_click(self.run_engines)
        self.change()

    def label(self, text: str) -> str:
        """Return a text with the words of `labels`, whole words and the longest ones first."""
        words = sorted(self.labels, key=len, reverse=True)
        if not words:
            return text
        pattern = r"(?<![\w.])(?:" + "|".join(map(re.escape, words)) + r")(?![\w.])"
        return re.sub(pattern, lambda found: self.labels[found[0]], text)

    def require_curves(self) -> None:
        """Raise InputError for a curve that is neither a channel nor a quantity."""
        there = [*self.case.channels, *self.known]
        for name in (name for names in self.curves for name in names):
            if name not in there:
                raise self.case.error(f"channels.{name}", suggest_names(name, there))

    @property
    def parameters(self) -> dict[str, Any]:
        """The parameters of the case with the values of the sliders [SI]."""
        return {
            **self.case.parameters,
            **{name: float(slider.value) for name, slider in self.sliders.items()},
        }

    def change(self, _: object = None) -> None:
        """Evaluate the reference again, draw it, and drop the engines' curves, now out of date."""
        self.found, self.rows, self.table.value = {}, [], ""
        try:
            known = reference_quantities(self.case, self.kind, self.x, self.state, self.parameters)
            self.reference = reference_channels(self.case, self.x, known)
            driven = self.state[0] if self.state else ()
            joints = {d.joint: v for d, v in zip(self.case.drive, driven, strict=True)}
            self.known, self.wrong = {**joints, **known}, ""
            changed = self.case.model_copy(update={"parameters": self.parameters})
            self.property_texts = properties(changed) if self.properties else {}
            self.require_curves()
        except InputError as error:
            if error.key.startswith("channels."):
                raise
            self.wrong = error.wrong
        self.move()

    def move(self, _: object = None) -> None:
        """Draw the pose of the slider."""
        self.panel.value = self.svg()

    def run_engines(self, _: object = None) -> None:
        """Run the model with these parameters in every engine of the run, and compare."""
        if self.model is None or self.wrong:
            return
        self.table.value = self.label("running …")
        self.found, self.rows = {}, []
        try:
            case = self.model(**self.parameters)
            for solver in engine_names():
                if solver in case.run[self.kind].solvers:
                    self.found[solver] = solve(case, self.kind, solver)
                    self.rows += compare(
                        case, self.kind, solver, self.found[solver], detectable=False
                    )
            self.table.value = as_html(worst_comparisons(self.rows))
        except Exception as error:  # errors of a notebook's model are shown below the panel
            self.table.value = f"<p>{escape(str(error))}</p>"
        self.move()

    def svg(self) -> str:
        """Return the whole panel as SVG."""
        words = escape(f"{self.case.name}: {self.caption()}")
        parts = [
            f'<svg xmlns="http://www.w3.org/2000/svg" '
            f'viewBox="0 0 {EXPLORER_WIDTH} {EXPLORER_HEIGHT}" width="100%" '
            f'style="max-width:{EXPLORER_WIDTH}px" role="img" '
            f'aria-label="{words}" font-family="sans-serif" font-size="11">'
            f'<rect width="{EXPLORER_WIDTH}" height="{EXPLORER_HEIGHT}" fill="#fff"/>'
        ]
        if self.wrong:
            parts.append(f'<text x="12" y="30" fill="#a00">{escape(self.wrong)}</text>')
        else:
            parts += [self.mechanism(), self.words()]
            high = EXPLORER_HEIGHT / max(len(self.curves), 1)
            parts += [self.chart(row, k * high, high) for k, row in enumerate(self.curves)]
        return "".join([*parts, "</svg>"])

    def caption(self) -> str:
        """Return the pose in words."""
        k = self.place.value
        name, unit, scale = self.scale
        if self.state is None:
            return self.label(f"{name} {self.x[k] * scale:.3g} {unit}")
        pose = format_pose(self.case, float(self.x[k]), self.state[0][:, k])
        return self.label(pose.replace("\n", " "))

    def mechanism(self) -> str:
        """Return the links at the pose, and the paths of points whose x and y are channels."""
        k = self.place.value
        drawn = self.links(self.known, self.parameters) if self.links else {}
        lines = {
            name: [np.broadcast_to(np.asarray(c, complex), self.x.shape) for c in corners]
            if isinstance(corners, list | tuple)
            else np.asarray(corners, complex)
            for name, corners in drawn.items()
        }
        paths = [
            self.reference[name] + 1j * self.reference[f"{name[:-1]}y"]
            for name in self.reference
            if name.endswith(".x")
            and f"{name[:-1]}y" in self.reference
            and self.case.channels[name].si_unit == "m"
            and np.ptp(self.reference[name]) + np.ptp(self.reference[f"{name[:-1]}y"]) > 0
        ]
        cloud = np.concatenate([*paths, *(np.ravel(line) for line in lines.values())] or [self.x])
        cloud = cloud[np.isfinite(cloud)]
        low, high = (f(cloud.real) + 1j * f(cloud.imag) for f in (np.min, np.max))
        top = 24 + 14 * len(self.property_lines())
        across, up = EXPLORED_WIDTH - 40, EXPLORER_HEIGHT - top - 24
        scale = min(across / max((high - low).real, 1e-9), up / max((high - low).imag, 1e-9))
        middle, centre = (
            (low + high) / 2,
            EXPLORED_WIDTH / 2 + 1j * (EXPLORER_HEIGHT - top) / 2 + 12j,
        )

        def paper(places: Any) -> Array:
            return np.asarray(np.conj(np.asarray(places) - middle) * scale + centre)

        parts = [f'<text x="12" y="16" font-weight="bold">{escape(self.caption())}</text>']
        if self.found:
            text = "curves: pale reference, solid " + ", dashed ".join(
                map(format_solver, self.found)
            )
            parts.append(f'<text x="12" y="31">{escape(self.label(text))}</text>')
        for path in paths:
            parts.append(svg_line(paper(path), PATH_COLOUR, 1, "4 3"))
        for j, line in enumerate(lines.values()):
            colour = COLOURS[j % len(COLOURS)]
            corners = np.array([c[k] for c in line]) if isinstance(line, list) else line
            parts.append(svg_line(paper(corners), colour, 3))
            if isinstance(line, list) or len(line) == len(self.x):
                ends = corners if isinstance(line, list) else corners[[k]]
                parts += [
                    f'<circle cx="{end.real:.1f}" cy="{end.imag:.1f}" r="4" fill="#fff" '
                    f'stroke="{INK}" stroke-width="1.5"/>'
                    for end in paper(ends)
                    if np.isfinite(end)
                ]
        return "".join(parts)

    def property_lines(self) -> list[str]:
        """Return the properties of the mechanism as lines that end before the curves."""
        rows = (self.label(f"{name}: {words}") for name, words in self.property_texts.items())
        return [line for row in rows for line in wrap(row, PROPERTY_LETTERS)]

    def words(self) -> str:
        """Return the properties of the mechanism as lines of text below it."""
        lines = self.property_lines()
        return "".join(
            f'<text x="12" y="{EXPLORER_HEIGHT - 8 - 14 * (len(lines) - 1 - k)}">'
            f"{escape(line)}</text>"
            for k, line in enumerate(lines)
        )

    def chart(self, names: Sequence[str], top: float, high: float) -> str:
        """Return a panel of curves over the run: the reference pale, the engines as lines."""
        unit, factor = displayed_unit(self.case.channels[names[0]].si_unit)
        own = [{**self.known, **self.reference}[name] * factor for name in names]
        finite = np.concatenate(own)
        finite = finite[np.isfinite(finite)]
        low, most = (finite.min(), finite.max()) if finite.size else (0.0, 1.0)
        pad = 0.05 * ((most - low) or 1.0)
        low, most = low - pad, most + pad
        first, last = self.x[[0, -1]]
        left, right, above, below = (
            EXPLORED_WIDTH + AXES_MARGIN,
            EXPLORER_WIDTH - 12,
            top + 20,
            top + high - 30,
        )

        def paper(x: Array, y: Array | float) -> Array:
            share = (x - first) / ((last - first) or 1.0)
            return (
                left
                + share * (right - left)
                + 1j * (below - (y - low) / (most - low) * (below - above))
            )

        parts = []
        for y in MaxNLocator(4).tick_values(low, most):
            if low <= y <= most:
                at = paper(self.x[:1], y)[0].imag
                parts.append(
                    f'<path d="M{left} {at:.1f}H{right}" stroke="#e4e4e4"/>'
                    f'<text x="{left - 5}" y="{at + 4:.1f}" text-anchor="end">{y:.4g}</text>'
                )
        name, x_unit, scale = self.scale
        for x in MaxNLocator(6).tick_values(min(first, last) * scale, max(first, last) * scale):
            if min(first, last) * scale <= x <= max(first, last) * scale:
                at = paper(np.array([x / scale]), 0.0)[0].real
                parts.append(
                    f'<text x="{at:.1f}" y="{below + 13}" text-anchor="middle">{x:.4g}</text>'
                )
        axis = escape(self.label(f"{name} [{x_unit}]"))
        parts.append(
            f'<text x="{right}" y="{below + 25}" text-anchor="end">{axis}'
            f'</text><text x="{left - 45}" y="{top + 14}">[{format_unit(unit) or "1"}]</text>'
        )
        words, place = [], float(left)
        for j, (channel, values) in enumerate(zip(names, own, strict=True)):
            colour = COLOURS[j % len(COLOURS)]
            parts.append(
                svg_line(
                    paper(self.x, values),
                    colour,
                    5 if self.found else 2,
                    "",
                    0.35 if self.found else 1,
                )
            )
            for number, curves in enumerate(self.found.values()):
                if channel in curves.channels:
                    there = paper(curves.x, curves.channels[channel] * factor)
                    parts.append(svg_line(there, colour, 1.4, "5 4" if number else ""))
            text = self.label(channel)
            words.append(
                f'<text x="{place:.0f}" y="{top + 14}" fill="{colour}">{escape(text)}</text>'
            )
            place += 7 * len(text) + 14
        at = paper(self.x[[self.place.value]], low)[0].real
        parts.append(f'<path d="M{at:.1f} {above}V{below}" stroke="{INK}"/>')
        return "".join([*parts, *words])

    def _repr_mimebundle_(self, **_: Any) -> dict[str, Any]:
        """Return the sliders, and for where nothing runs HTML and a PNG of the drawing.

        The HTML has the drawing as an image, since some readers remove SVG from HTML.
        """
        bundle = self.box._repr_mimebundle_()
        shown = ", ".join(f"{s.description} {s.value:.4g}" for s in self.sliders.values())
        svg = b64encode(self.panel.value.encode()).decode()
        words = escape(f"{self.case.name}: {self.caption()}")
        return {
            **(bundle or {}),
            "text/html": f"<div><p>{escape(shown)}</p>"
            f'<img src="data:image/svg+xml;base64,{svg}" alt="{words}" width="{EXPLORER_WIDTH}" '
            f'style="max-width:100%">{self.table.value}</div>',
            "image/png": b64encode(svg_as_png(self.panel.value)).decode(),
            "text/plain": f"{self.case.name}: {self.caption()}, {shown}",
        }


def require_sliders(
    case: Case, sliders: Mapping[str, tuple[float, float]], curves: Sequence[Sequence[str]]
) -> None:
    """Raise InputError or ValueError for sliders or curves that do not fit a case."""
    if case.recorded:
        raise case.error("reference", "a recorded curve has nothing to slide")
    numbers = [k for k, v in case.parameters.items() if k != "mode" and not isinstance(v, str)]
    for name, (low, high) in sliders.items():
        if name not in numbers:
            raise case.error(f"parameters.{name}", f"no slider: {suggest_names(name, numbers)}")
        if not low < high or not low <= float(case.parameters[name]) <= high:
            raise ValueError(
                f"slider {name}: the bounds {low:g}, {high:g} must rise, with the case's "
                f"{float(case.parameters[name]):g} between them"
            )
    for names in curves:
        if not names or names[0] not in case.channels:
            name = names[0] if names else ""
            raise case.error(f"channels.{name}", suggest_names(name, case.channels))


def svg_line(points: Array, colour: str, width: float, dash: str = "", opacity: float = 1.0) -> str:
    """Return a line through places, complex numbers with y down [px], as SVG; NaN breaks it.

    >>> svg_line(np.array([1 + 2j, 3 + 4j, np.nan, 5 + 6j, 7 + 8j]), "#000", 1).split('"')[1]
    'M1.0 2.0 3.0 4.0M5.0 6.0 7.0 8.0'
    """
    parts = np.ma.clump_unmasked(np.ma.masked_invalid(points))
    steps = [
        "M" + " ".join(f"{x:.1f} {y:.1f}" for x, y in zip(p.real, p.imag, strict=True))
        for p in (points[part] for part in parts)
    ]
    look = f' stroke-dasharray="{dash}"' if dash else ""
    look += f' opacity="{opacity:g}"' if opacity < 1 else ""
    return (
        f'<path d="{"".join(steps)}" fill="none" stroke="{colour}" stroke-width="{width:g}" '
        f'stroke-linejoin="round" stroke-linecap="round"{look}/>'
    )


def worst_comparisons(rows: Sequence[Comparison]) -> list[Comparison]:
    """Return for each solver and outcome the comparison with the largest share of its tolerance."""
    groups = group_by(rows, lambda row: (row.solver, row.outcome))
    return [max(group, key=lambda row: row.share_of_allowed) for group in groups.values()]

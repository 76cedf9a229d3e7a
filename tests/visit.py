"""A page that is opened in a browser, for the tests of pages."""

from collections.abc import Callable
from importlib.metadata import distribution
from pathlib import Path
from typing import Any, ClassVar

DESKTOP, PHONE = {"width": 1440, "height": 900}, {"width": 390, "height": 844}


class Visit:
    """A visit to a page: it records messages of the console, errors, and requested addresses.

    Successive visits use the same tab, with the window size, colour scheme and reduced motion that
    each visit asks for; visits with other options of a browser context use a tab of their own.
    Opening a tab takes twice as long as a test in it.  The pages store nothing in the browser.
    """

    tabs: ClassVar[dict[str, Any]] = {}

    def __init__(
        self,
        browser: Any,
        file: Path,
        address: str = "",
        viewport: dict[str, int] = DESKTOP,
        color_scheme: str = "light",
        reduced_motion: str = "no-preference",
        **options: Any,
    ) -> None:
        tab_key = repr((id(browser), sorted(options.items())))
        if tab_key not in self.tabs or self.tabs[tab_key].is_closed():
            self.tabs[tab_key] = browser.new_context(**options).new_page()
        self.page = self.tabs[tab_key]
        self.page.set_viewport_size(viewport)
        self.page.emulate_media(
            media="null", color_scheme=color_scheme, reduced_motion=reduced_motion
        )
        self.said: list[str] = []
        self.asked: list[str] = []
        self.listeners: dict[str, Callable[[Any], None]] = {
            "console": lambda message: self.said.append(message.text),
            "pageerror": lambda error: self.said.append(str(error)),
            "request": lambda request: self.asked.append(request.url),
        }
        for event, listener in self.listeners.items():
            self.page.on(event, listener)
        self.page.goto(file.as_uri() + address)
        self.page.wait_for_load_state()

    def __enter__(self) -> "Visit":
        return self

    def __exit__(self, *_: object) -> None:
        for event, listener in self.listeners.items():
            self.page.remove_listener(event, listener)
        self.page.mouse.move(0, 0)
        self.page.goto("about:blank")

    def run(self, script: str) -> Any:
        return self.page.evaluate(script)

    def axe(self, within: str = "", options: str = "{}") -> tuple[list[tuple[str, str]], int]:
        """Violations that axe finds in the page or a part of it, and the number of rules passed.

        For a rule that passes, axe reports one element only, which takes a fraction of the time.
        """
        script = distribution("axe-core-python").locate_file("axe_core_python/axe.min.js")
        self.run(Path(str(script)).read_text(encoding="utf-8"))
        quick = f"{{resultTypes: ['violations'], ...{options}}}"
        found = self.run(f"axe.run({repr(within) if within else 'document'}, {quick})")
        wrong = [(one["id"], one["nodes"][0]["html"][:200]) for one in found["violations"]]
        return wrong, len(found["passes"])

    def small_text(self, within: str, shown: str = "true") -> list[str]:
        """Elements in a part of the page that have text in letters smaller than 12 px.

        `shown` is a condition in JavaScript on the element `one`; other elements are ignored.
        """
        found: list[str] = self.run(
            f"findAll({within + ' *'!r}).filter((one) => {shown})"
            ".filter((one) => [...one.childNodes].some((node) =>"
            " node.nodeType === 3 && node.data.trim())"
            " && parseFloat(getComputedStyle(one).fontSize) < 12)"
            ".map((one) => one.outerHTML.slice(0, 80))"
        )
        return found

    @property
    def address(self) -> str:
        return str(self.run("decodeURIComponent(location.hash)"))

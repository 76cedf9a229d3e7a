"""The Jinja environment of the packages that write models, sidecars and programs from templates."""

from jinja2 import Environment, PackageLoader, StrictUndefined


def template_environment(package: str, folder: str = "templates") -> Environment:
    """Return the environment of the templates in a folder of a package.

    An unknown name is an error, lines with nothing but a tag vanish, and a text ends as its
    template does.
    """
    return Environment(
        loader=PackageLoader(package, folder),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )

"""Text between two marks of a page, which a maker of pages writes anew."""


def write_between(text: str, begin: str, end: str, content: str) -> str:
    """The text of a page with other content between two marks.

    >>> write_between("a (x) b", "(", ")", "new")
    'a (\\n\\nnew\\n\\n) b'
    """
    before, rest = text.split(begin)
    _, after = rest.split(end)
    return f"{before}{begin}\n\n{content}\n\n{end}{after}"

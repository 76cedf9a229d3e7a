"""Grouping of items by a key."""

from collections.abc import Callable, Hashable, Iterable
from typing import TypeVar

Member = TypeVar("Member")
GroupKey = TypeVar("GroupKey", bound=Hashable)


def group_by(
    items: Iterable[Member], key: Callable[[Member], GroupKey]
) -> dict[GroupKey, list[Member]]:
    """Return the items by their key; a key has the place of its first item.

    >>> group_by(["bar", "arm", "base"], lambda word: word[0])
    {'b': ['bar', 'base'], 'a': ['arm']}
    """
    groups: dict[GroupKey, list[Member]] = {}
    for item in items:
        groups.setdefault(key(item), []).append(item)
    return groups

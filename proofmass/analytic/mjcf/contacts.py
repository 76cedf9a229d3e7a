"""Pairs of bodies of a compiled model between which MuJoCo looks for contacts."""

from typing import Any

import numpy as np

from proofmass.analytic.mjcf.options import CONTACT_FLAGS, DISABLE, is_disabled
from proofmass.base.arrays import Array


def may_touch(model: Any) -> bool:
    """Whether MuJoCo looks for contacts: of geoms, of a pair, or of a flex."""
    off = is_disabled(model, CONTACT_FLAGS)
    return not off and bool(touching_bodies(model).size or model.npair)


def touching_bodies(model: Any) -> Array:
    """The bodies (n, 2) of all pairs of geoms between which MuJoCo looks for contacts.

    Left out are the pairs that it filters out: by ``contype`` and ``conaffinity``, of one rigid
    group, of a group and its parent other than the ground, and of ``<exclude>``.
    """
    rigid = model.body_weldid
    parent = rigid[model.body_parentid[rigid]]
    matches = model.geom_contype[:, None] & model.geom_conaffinity != 0
    pairs = model.geom_bodyid[np.argwhere(np.triu(matches | matches.T, 1))]
    first, second = np.sort(pairs, axis=1).T
    one, two = rigid[first], rigid[second]
    # MuJoCo packs the two bodies of an <exclude> into one number
    filtered = (one == two) | np.isin((first << 16) + second, model.exclude_signature)
    if not is_disabled(model, DISABLE.mjDSBL_FILTERPARENT):
        filtered |= (one > 0) & (two > 0) & ((one == parent[two]) | (two == parent[one]))
    return np.stack([first, second], axis=1)[~filtered]

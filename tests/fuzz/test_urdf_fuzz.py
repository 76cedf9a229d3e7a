"""Whatever stands in a URDF, it is read, or refused in one line; nothing else is raised."""

import random
import re

import pytest

from proofmass.sim.protocol.failures import BadModel
from proofmass.sim.urdf import mjcf_of_urdf, read_urdf
from tests.sim.test_urdf import BASE, ELBOW, LOWER, MESH, SHOULDER, UPPER, link

TOKENS = 'nan inf -1 0 1e400 abc &amp; <link/> " package://a/b.stl .. floating fixed planar 1e-300'
TOKENS += " ${x} <joint/> <xacro:a/> &x; \x7f"
SEEDS = 100
BOX = '<collision><geometry><box size="1 1 1"/></geometry></collision>'
LID = '<joint name="lid" type="fixed"><parent link="lower"/><child link="box"/></joint>'
PARTS = BASE, UPPER, LOWER, SHOULDER, ELBOW, link("box", 1, 0, (1, 1, 1), BOX + MESH), LID
ARM = f'<?xml version="1.0" encoding="utf-8"?><robot name="arm">{"".join(PARTS)}</robot>'
BOMB = "".join(f'<!ENTITY a{k} "{10 * f"&a{k - 1};"}">' for k in range(1, 12))
BOMB = f'<!DOCTYPE r [<!ENTITY a0 "x">{BOMB}]>'


def mutated(seed: int) -> bytes:
    """The arm with one to four changes: of a value, of an element, or anywhere."""
    chance, text = random.Random(seed), ARM
    for _ in range(chance.randint(1, 4)):
        kind = chance.random()
        pattern = r'"([^"]*)"' if kind < 0.6 else r"(<[^>]*/>)" if kind < 0.85 else r"(.)"
        spans = [found.span(1) for found in re.finditer(pattern, text)]
        first, last = chance.choice(spans)
        new = chance.choice([*TOKENS.split(), "", 2 * text[first:last]])
        text = text[:first] + new + text[last:]
    return text.encode()


def test_mutated_urdfs_are_read_or_refused_in_one_line(tmp_path):
    file, outcomes = tmp_path / "arm.urdf", set()
    for seed in range(SEEDS):
        file.write_bytes(mutated(seed))
        try:
            read_urdf(file)
            assert mjcf_of_urdf(file)[0].startswith("<!--")
            outcomes.add("read")
        except BadModel as error:
            words = str(error)
            outcomes.add("refused" if words.startswith("arm.urdf: ") else words)
            outcomes.add(words if "\n" in words else "refused")
    assert outcomes == {"read", "refused"}


@pytest.mark.parametrize("head", [BOMB, '<!DOCTYPE r [<!ENTITY a11 SYSTEM "b.xml">]>'])
def test_entities_neither_grow_nor_read_files(tmp_path, head):
    (tmp_path / "b.xml").write_text(BASE)
    file = tmp_path / "arm.urdf"
    file.write_text(f"{head}<robot>{BASE}&a11;</robot>")
    with pytest.raises(BadModel, match=r"^arm\.urdf: no valid XML: "):
        read_urdf(file)

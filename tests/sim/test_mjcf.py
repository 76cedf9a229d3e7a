"""Tests of reading MJCF: files that MuJoCo accepts are read, and invalid numbers are refused."""

import os

import pytest

from proofmass.sim.mjcf import compile_model, read_tree
from proofmass.sim.protocol.failures import BadModel

MODEL = """<mujoco>%s<worldbody><body><joint name="j"/><geom name="g" size="1" %s/></body>
</worldbody></mujoco>"""
INVALID_NUMBERS = {
    "pos='nan 0 0'": "<geom name='g'>: pos='nan 0 0' is not a number",
    'pos="0 -NaN(12) 0"': "<geom name='g'>: pos='0 -NaN(12) 0' is not a number",
    'density="nan"': "<geom name='g'>: density='nan' is not a number",
    'mass="inf"': "<geom name='g'>: mass='inf' is not finite",
    'pos="0 0 -Infinity"': "<geom name='g'>: pos='0 0 -Infinity' is not finite",
    'pos="0 1e308 0"': "<geom name='g'>: pos='0 1e308 0' is too large; numbers may be up to 1e+40",
    'mass="1e41"': "<geom name='g'>: mass='1e41' is too large; numbers may be up to 1e+40",
}


@pytest.fixture
def compiled(tmp_path):
    def of(text):
        file = tmp_path / "m.xml"
        file.write_bytes(text if isinstance(text, bytes) else text.encode())
        return compile_model(file)

    return of


@pytest.mark.parametrize(
    "before",
    [
        "<!-- ---- bars ---- -->",
        '<!-- pos="nan 0 0" -->',
        '<custom><text name="nan" data="nan"/></custom>',
    ],
)
def test_comments_and_texts_that_mujoco_accepts_are_read(compiled, before):
    assert compiled(MODEL % (before, "")).nbody == 2


def test_a_byte_order_mark_and_latin_1_in_a_comment_are_read(compiled):
    assert compiled(b"\xef\xbb\xbf" + (MODEL % ("", "")).encode()).nbody == 2
    assert compiled((MODEL % ("<!-- 5° -->", "")).encode("latin-1")).nbody == 2


def test_a_name_in_latin_1_is_refused(compiled):
    with pytest.raises(BadModel, match="the byte 0xb0 of a name is not UTF-8"):
        compiled((MODEL % ("", "")).replace('"g"', '"°"').encode("latin-1"))


def test_limits_may_be_infinite(compiled):
    assert compiled((MODEL % ("", "")).replace('"j"', '"j" range="-inf inf"')).njnt == 1


@pytest.mark.parametrize("attribute", INVALID_NUMBERS)
def test_invalid_numbers_are_refused_without_a_log_file(compiled, attribute, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(BadModel) as wrong:
        compiled(MODEL % ("<!-- ---- bars ---- -->", attribute))
    assert str(wrong.value) == f"m.xml: {INVALID_NUMBERS[attribute]}"
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()


def test_a_number_that_grows_too_large_when_compiled_is_refused(compiled):
    """The moment of inertia is 0.4 times the mass times the radius squared."""
    text = (MODEL % ("", 'mass="1e38"')).replace('size="1"', 'size="100"')
    with pytest.raises(BadModel, match=r"body_inertia has the number 4e\+41, which is too large"):
        compiled(text)


def test_a_nan_in_an_included_file_is_found(compiled, tmp_path):
    (tmp_path / "part.xml").write_text('<mujoco><option gravity="nan 0 0"/></mujoco>')
    with pytest.raises(BadModel, match="a file that it includes, is not a number"):
        compiled(MODEL % ('<include file="part.xml"/>', ""))


def test_a_named_pipe_is_refused_without_waiting(tmp_path):
    os.mkfifo(tmp_path / "m.xml")
    with pytest.raises(BadModel, match="no regular file"):
        compile_model(tmp_path / "m.xml")


def test_elements_are_read_despite_comments_with_dashes(tmp_path):
    file = tmp_path / "m.xml"
    file.write_text(MODEL % ("<!-- ---- bars ---- -->", ""))
    assert [geom.get("name") for geom in read_tree(file).iter("geom")] == ["g"]


def test_malformed_xml_compiles_but_cannot_be_changed(compiled, tmp_path):
    assert compiled((MODEL % ("°", "")).encode("latin-1")).nbody == 2
    with pytest.raises(BadModel, match=r"m\.xml: to be changed it must be well-formed"):
        read_tree(tmp_path / "m.xml")

"""The pytest plugin in repositories of other people: it collects sidecars and nothing else."""

from pathlib import Path
from textwrap import dedent

import pytest

from proofmass.case.inputs import is_sidecar

PENDULUM = Path("models/linkages/pendulum.toml").absolute()
NOT_SIDECARS = {
    "a word in a comment": "[tool]\nname = 'x'\n# \nreference = 'the manual'\n",
    "a reference and no model": 'title = "x"\nreference = "manual"\n',
    "a reference in a table": '[docs]\nreference = "manual"\n',
    "a reference that is a table": "[reference]\nmanual = 1\n",
    "no TOML": "reference = \nreference: manual\n",
    "a template": 'reference = "{{ cookiecutter.name }}\n{% endif %}',
    "no text": "\x00\x01reference\xff",
}
MODELS_OF_OTHERS = {
    "no model": None,
    "XML that is no MJCF": "<project><modelVersion/></project>",
}
FOREIGN_TEST = "def test_of_their_own():\n    assert True\n"


def write_case(folder: Path, name: str = "pendulum", wrong: str = "") -> Path:
    """A shipped case as a folder's own, with lines of nonsense at its end if given."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}.xml").write_bytes(PENDULUM.with_suffix(".xml").read_bytes())
    sidecar = folder / f"{name}.toml"
    sidecar.write_text(PENDULUM.read_text(encoding="utf-8") + wrong, encoding="utf-8")
    return sidecar


def run_pytest(pytester: pytest.Pytester, *arguments: object) -> pytest.RunResult:
    return pytester.runpytest_inprocess(*arguments, "-p", "no:cacheprovider", "-n", "0")


@pytest.mark.parametrize("model", MODELS_OF_OTHERS.values(), ids=MODELS_OF_OTHERS)
@pytest.mark.parametrize("text", NOT_SIDECARS.values(), ids=NOT_SIDECARS)
def test_a_file_of_somebody_else_is_no_sidecar(tmp_path, text, model):
    (tmp_path / "config.toml").write_bytes(text.encode("latin-1"))
    if model is not None:
        (tmp_path / "config.xml").write_text(model)
    assert not is_sidecar(tmp_path / "config.toml")


def test_a_sidecar_is_one_wherever_its_model_lies(tmp_path):
    sidecar = write_case(tmp_path / "cases")
    assert is_sidecar(sidecar)
    (tmp_path / "robots").mkdir()
    sidecar.with_suffix(".xml").rename(tmp_path / "robots" / "arm.xml")
    assert not is_sidecar(sidecar)
    text = sidecar.read_text(encoding="utf-8")
    sidecar.write_text('model = "../robots/arm.xml"\n' + text, encoding="utf-8-sig")
    assert is_sidecar(sidecar)


def test_files_of_somebody_else_do_not_touch_a_run(pytester):
    for k, text in enumerate(NOT_SIDECARS.values()):
        (pytester.path / f"config{k}.toml").write_bytes(text.encode("latin-1"))
        (pytester.path / f"config{k}.xml").write_text("<project/>")
    pytester.makepyfile(test_foreign=FOREIGN_TEST)
    result = run_pytest(pytester)
    result.assert_outcomes(passed=1)
    assert "toml" not in result.stdout.str()


def test_the_plugin_loads_nothing_where_there_is_no_sidecar(pytester):
    """Of proofmass only what tells files apart: no engine, no NumPy of its own."""
    (pytester.path / "config.toml").write_text('reference = "manual"\n')
    pytester.makepyfile(test_foreign=FOREIGN_TEST)
    pytester.makeconftest(
        dedent("""
        import sys
        def pytest_unconfigure():
            print("LOADED", *sorted(m for m in sys.modules if m.split(".")[0] in
                ("proofmass", "mujoco", "pymunk", "scipy", "pydantic")))
        """)
    )
    result = pytester.runpytest_subprocess("-s", "-n", "0", "-p", "no:hypothesispytest")
    result.assert_outcomes(passed=1)
    result.stdout.fnmatch_lines(
        [
            "LOADED proofmass proofmass.base proofmass.base.display proofmass.base.errors "
            "proofmass.base.files proofmass.base.installation proofmass.base.lines "
            "proofmass.case proofmass.case.inputs *plugin"
        ]
    )


def test_a_faulty_sidecar_costs_itself_only(pytester):
    write_case(pytester.path, "faulty", 'unknown_key = "x"\n')
    pytester.makepyfile(test_foreign=FOREIGN_TEST)
    result = run_pytest(pytester)
    result.assert_outcomes(passed=1, failed=1)
    result.stdout.fnmatch_lines(["*faulty.toml: *unknown_key*"])
    assert "Traceback" not in result.stdout.str()


def test_a_faulty_sidecar_that_was_named_is_an_error(pytester):
    faulty = write_case(pytester.path, "faulty", 'unknown_key = "x"\n')
    result = run_pytest(pytester, f"{faulty}::mujoco")
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines(["*faulty.toml: *unknown_key*"])


@pytest.mark.parametrize("below", [False, True])
def test_what_is_below_the_paths_of_the_option_must_be_a_sidecar(pytester, below):
    (pytester.path / "cases").mkdir()
    (pytester.path / "cases" / "broken.toml").write_text("title = \n")
    (pytester.path / "other.toml").write_text("title = \n")
    pytester.makeini("[pytest]\nproofmass_paths = cases\n" if below else "[pytest]\n")
    result = run_pytest(pytester)
    result.assert_outcomes(failed=int(below))
    if below:
        result.stdout.fnmatch_lines(["*broken.toml: not TOML*"])
    assert "other.toml" not in result.stdout.str()


def test_a_file_that_was_named_is_taken_for_a_sidecar(pytester):
    (pytester.path / "config.toml").write_text("[tool]\nname = 'x'\n")
    result = run_pytest(pytester, "config.toml")
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines(["*config.toml: *"])

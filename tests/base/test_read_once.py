"""What was read of files is read again if their content changes, and forgotten on request."""

import os

import pytest

from proofmass.base.read_once import KEPT_INPUTS, forget_inputs, read_once, serve_model


@pytest.fixture
def reader():
    """A function that reads a file, and the list of what it read."""
    read = []

    @read_once()
    def letters(file, sign=""):
        read.append(file.read_text())
        return read[-1] + sign

    return letters, read


def test_a_file_is_read_again_only_if_its_content_changes(reader, tmp_path):
    """Neither its times nor its size say so, and another path is another file."""
    letters, read = reader
    one, two = tmp_path / "one", tmp_path / "two"
    one.write_text("ab")
    two.write_text("ab")
    assert [letters(one), letters(one), letters(one, "!"), letters(two)] == [
        "ab",
        "ab",
        "ab!",
        "ab",
    ]
    assert len(read) == 3
    times = one.stat().st_mtime_ns
    one.write_text("cd")
    os.utime(one, ns=(times, times))
    assert letters(one) == "cd"
    one.write_text("ab")
    assert letters(one) == "ab"
    assert read == ["ab", "ab", "ab", "cd"]


def test_an_error_is_not_kept(reader, tmp_path):
    letters, _ = reader
    with pytest.raises(FileNotFoundError):
        letters(tmp_path / "late")
    (tmp_path / "late").write_text("ab")
    assert letters(tmp_path / "late") == "ab"


def test_what_was_read_is_forgotten_on_request_and_for_another_model(reader, tmp_path):
    letters, read = reader
    file, other = tmp_path / "one", tmp_path / "two"
    file.write_text("ab")
    for forget in (
        forget_inputs,
        lambda: serve_model(file),
        lambda: serve_model(other),
    ):
        letters(file)
        count = len(read)
        letters(file)
        assert len(read) == count
        forget()
        letters(file)
        assert len(read) == count + 1
    serve_model(other)
    letters(file)
    assert len(read) == count + 1, "the next run of the same model finds it"


def test_inputs_that_were_not_used_for_the_longest_time_are_dropped_first():
    asked = []

    @read_once(None)
    def number(k):
        asked.append(k)
        return k

    forget_inputs()
    for k in range(KEPT_INPUTS):
        number(k)
    number(0)
    number(KEPT_INPUTS)
    asked.clear()
    number(0)
    number(1)
    assert asked == [1]

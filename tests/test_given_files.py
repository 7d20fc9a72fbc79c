"""Files that callers name."""

import os

import pytest

import impactlab as il
from impactlab.given_files import DIGITS, NESTED, bounded, bytes_in, file_of, text_in


def test_regular_files_only(tmp_path):
    (tmp_path / "text").write_text("text")
    assert text_in(tmp_path / "text") == text_in(str(tmp_path / "text")) == "text"
    (tmp_path / "empty").touch()
    (tmp_path / "latin").write_bytes(b"\xe9")
    refused = {
        tmp_path / "missing": "There is no file", "a" * 5000: "There is no file aaa", "a\0b": "There is no file",
        tmp_path: "is a folder", tmp_path / "empty": "is empty", tmp_path / "latin": "no text in UTF-8",
        3: "Give the path",
        b"text": "Give the path",
    }  # fmt: skip
    for path, message in refused.items():
        with pytest.raises(il.InvalidInput, match=message):
            text_in(path)
    with pytest.raises(il.InvalidInput, match="MB of text are read at most"):
        file_of(tmp_path / "text", most=3)


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such files")
def test_what_has_no_end(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", "/dev/zero"):
        with pytest.raises(il.InvalidInput, match="is a device or a pipe"):
            bytes_in(path)
        for read in (il.load, il.read_time_series, il.Network.from_toml, il.rerun, il.run_study):
            with pytest.raises(il.InvalidInput, match=r"is a device or a pipe|There is no study"):
                read(str(path))


def test_bounds_of_data():
    deep = []
    for _ in range(NESTED - 1):
        deep = [deep]
    bounded(deep)
    bounded({"a": [10**DIGITS - 1, 1.0, "x" * 1000]})
    with pytest.raises(ValueError, match="nested"):
        bounded([[deep]])
    with pytest.raises(ValueError, match="digits"):
        bounded({"a": [-(10**DIGITS)]})
    for text in (f"x = {'[' * 200}{']' * 200}", "x = " + "[" * 5000, "x = " + "1" * 5000, f"x = {10**DIGITS}"):
        with pytest.raises(il.InvalidInput, match="cannot be read as TOML"):
            il.Network.from_toml(f"\n{text}\n")

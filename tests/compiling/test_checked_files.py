"""Files of compiled code: damaged ones are as good as absent."""

import pickle

import numpy as np
import pytest

from impactlab.compiling.numba_private import _CheckedFiles


@pytest.mark.parametrize("kind", ["nbi", "nbc"])
def test_damage_is_noticed_and_replaced(kind, tmp_path):
    files, data = _CheckedFiles(str(tmp_path), "loop", "stamp"), {"code": bytes(range(256))}
    files.save("signature", data)
    assert files.load("signature") == data
    assert _CheckedFiles(str(tmp_path), "loop", "other").load("signature") is None
    (path,) = tmp_path.glob(f"*.{kind}")
    whole, generator = path.read_bytes(), np.random.default_rng(1)
    damaged = [whole[: int(length)] for length in generator.integers(len(whole), size=20)] + [b"", b"\0" * len(whole)]
    for _ in range(200):
        place, bit = int(generator.integers(len(whole))), int(generator.integers(8))
        damaged.append(whole[:place] + bytes([whole[place] ^ (1 << bit)]) + whole[place + 1 :])
    for content in damaged:
        path.write_bytes(content)
        assert files.load("signature") is None
    files.save("signature", data)
    assert files.load("signature") == data
    assert path.read_bytes() == whole


def test_nothing_is_unpickled_before_the_digest(tmp_path, monkeypatch):
    files = _CheckedFiles(str(tmp_path), "loop", "stamp")
    files.save("signature", 5)
    (path,) = tmp_path.glob("*.nbc")
    path.write_bytes(pickle.dumps(6))
    monkeypatch.setattr(pickle, "loads", None)
    assert files._load_data(path.name) is None

"""What random work leaves in a process: no file, no thread."""

import sys
from pathlib import Path

import pytest
from long_lived import main


@pytest.mark.campaign
@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="counts open files as Linux tells them")
def test_random_work_leaves_no_file_and_no_thread(capsys):
    early, late = main(20.0)
    assert late == early
    assert "end: " in capsys.readouterr().out
    assert not any(name.startswith("law_") for name in sys.modules)

"""Outputs are written whole or not at all, also when the disk refuses."""

from __future__ import annotations

import resource
import subprocess
import sys
from pathlib import Path

import pytest

from omnimirror.errors import OmnimirrorError
from omnimirror.files import replacing, write_text


def test_a_file_appears_whole_or_not_at_all(tmp_path):
    path = tmp_path / "new" / "table.csv"
    write_text(path, "first")

    def stop_half_way():
        with replacing(path) as temporary:
            temporary.write_text("sec")
            raise RuntimeError("half way")

    with pytest.raises(RuntimeError, match="half way"):
        stop_half_way()
    assert path.read_text() == "first"
    assert [p.name for p in path.parent.iterdir()] == ["table.csv"]


def test_permissions_are_those_of_any_new_file(tmp_path):
    write_text(tmp_path / "a.txt", "a")
    (tmp_path / "b.txt").write_text("b")
    assert (tmp_path / "a.txt").stat().st_mode == (tmp_path / "b.txt").stat().st_mode


def test_a_folder_is_not_a_file_name(tmp_path):
    with pytest.raises(OmnimirrorError, match="it is a folder, and a file name is needed"):
        write_text(tmp_path, "x")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "args",
    [
        ["evaluate", "paper-spherical", "--csv", "out.csv"],
        ["evaluate", "paper-spherical", "--json", "out.csv"],
        ["init", "out.csv", "--force"],
    ],
    ids=["csv", "json", "init"],
)
def test_a_full_disk_is_one_sentence_and_loses_nothing(args, tmp_path):
    (tmp_path / "out.csv").write_text("precious")
    run = subprocess.run(
        [Path(sys.executable).with_name("omnimirror"), *args],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000)),
    )
    assert run.returncode != 0
    assert run.stderr.startswith("omnimirror: cannot write out.csv")
    assert len(run.stderr.splitlines()) == 1
    assert (tmp_path / "out.csv").read_text() == "precious"
    assert [p.name for p in tmp_path.iterdir()] == ["out.csv"]

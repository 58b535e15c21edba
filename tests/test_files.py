"""Outputs are written whole or not at all, also when the disk refuses."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from omnimirror.errors import OmnimirrorError
from omnimirror.files import LARGEST_TEXT, read_bytes, read_text, replacing, write_text


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


def test_what_is_read_is_an_ordinary_file_of_a_bounded_size(tmp_path):
    """A pipe would keep the reader waiting, a device never ends, and a hole can be larger than the memory."""
    os.mkfifo(tmp_path / "pipe")
    with open(tmp_path / "huge", "wb") as file:
        file.truncate(1 << 40)
    (tmp_path / "fits").write_bytes(b"12345")
    assert read_bytes(tmp_path / "fits", 5) == b"12345"
    for name, most, reason in [
        (tmp_path / "pipe", 5, "pipe or a device"),
        ("/dev/zero", 5, "pipe or a device"),
        (tmp_path / "huge", LARGEST_TEXT, "larger than 64 MB"),
        (tmp_path / "fits", 4, "larger"),
        (tmp_path, 5, "it is a folder"),
        ("a\0b", 5, "no file can have that name"),
    ]:
        with pytest.raises(OSError, match=reason):
            read_bytes(name, most)


def test_text_is_read_as_it_was_meant(tmp_path):
    (tmp_path / "dos.txt").write_bytes(b"\xef\xbb\xbfone\r\ntwo\r")
    assert read_text(tmp_path / "dos.txt", "table") == "one\ntwo\n"
    (tmp_path / "latin.txt").write_bytes(b"caf\xe9")
    with pytest.raises(OmnimirrorError, match=r"cannot read the table .*latin\.txt: it is not a text file"):
        read_text(tmp_path / "latin.txt", "table")
    with pytest.raises(OmnimirrorError, match=r"cannot read the table .*none\.txt: No such file"):
        read_text(tmp_path / "none.txt", "table")


@pytest.mark.parametrize("kind", ["pipe", "zero"])
def test_no_command_waits_for_a_pipe_or_reads_without_end(kind, tmp_path):
    """Every file that a command line can name, and every file that such a file can name."""
    from click.testing import CliRunner

    from omnimirror.cli import app
    from omnimirror.media import write_image

    endless = "/dev/zero" if kind == "zero" else str(tmp_path / "pipe")
    if kind == "pipe":
        os.mkfifo(endless)
    (tmp_path / "s.toml").write_text(f'[mirror]\nkind = "sampled"\nprofile_csv = "{endless}"\n[lens]\n[imager]\n')
    (tmp_path / "w.toml").write_text(
        f'[field]\nomega_max_deg = 90\n[mirror]\nmapping_csv = "{endless}"\nrim_radius_mm = 40\n'
        "[lens]\ntheta_max_deg = 12\n"
    )
    picture, out = str(tmp_path / "a.png"), str(tmp_path / "b.png")
    write_image(picture, np.zeros((8, 8, 3), np.uint8))
    for words in (
        ["evaluate", endless],
        ["evaluate", str(tmp_path / "s.toml")],
        ["design", endless],
        ["design", str(tmp_path / "w.toml")],
        ["design", "--like", endless],
        ["parts", "paper-spherical", endless],
        ["dewarp", picture, "--ocam", endless, "-o", out],
        ["dewarp", endless, "--sensor", "paper-spherical", "-o", out],
    ):
        run = CliRunner().invoke(app, words)
        assert run.exit_code != 0, words
        assert "a pipe or a device" in str(run.exception), (words, run.output, run.exception)

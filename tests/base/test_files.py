"""Atomic output files, also on disk errors."""

from __future__ import annotations

import os
import resource
import signal
import stat
import subprocess
import sys
import threading
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest

from omnimirror.base import files
from omnimirror.base.errors import OmnimirrorError, SpecError
from omnimirror.base.files import (
    MAX_TEXT_BYTES,
    atomic_output,
    check_file,
    compose_yaml,
    decompress,
    parse_json,
    parse_toml,
    read_bytes,
    read_text,
    write_text,
)


def test_atomic_output_is_complete_or_absent(tmp_path):
    path = tmp_path / "new" / "table.csv"
    write_text(path, "first")

    def stop_half_way():
        with atomic_output(path) as temporary:
            temporary.write_text("sec")
            raise RuntimeError("half way")

    with pytest.raises(RuntimeError, match="half way"):
        stop_half_way()
    assert path.read_text() == "first"
    assert [p.name for p in path.parent.iterdir()] == ["table.csv"]


class _Stop:
    """Tracer that raises at the n-th line executed in the files package, like a signal handler."""

    def __init__(self, moment: int) -> None:
        self.left = moment

    def __call__(self, frame, event, _):
        if frame.f_code.co_filename != files.__file__:
            return None
        if event == "line":
            self.left -= 1
            if self.left == 0:
                raise KeyboardInterrupt
        return self


def test_signal_leaves_one_complete_file(tmp_path):
    path = tmp_path / "table.csv"
    moments = []
    for moment in range(1, 1000):
        path.write_text("first")
        stop, before = _Stop(moment), sys.gettrace()
        sys.settrace(stop)
        try:
            write_text(path, "second")
        except KeyboardInterrupt:
            moments.append(path.read_text())
        finally:
            sys.settrace(before)
        assert [p.name for p in tmp_path.iterdir()] == ["table.csv"]
        if stop.left > 0:
            break
    assert path.read_text() == "second"
    assert len(moments) > 30
    assert set(moments) == {"first", "second"}  # before and after the replacement


def test_new_file_permissions_follow_umask(tmp_path):
    write_text(tmp_path / "a.txt", "a")
    (tmp_path / "b.txt").write_text("b")
    assert (tmp_path / "a.txt").stat().st_mode == (tmp_path / "b.txt").stat().st_mode


def test_folder_as_output_raises(tmp_path):
    with pytest.raises(OmnimirrorError, match="the name must be that of a file; got a folder"):
        write_text(tmp_path, "x")
    assert list(tmp_path.iterdir()) == []


def test_json_is_readable_utf_8(tmp_path):
    files.write_json(tmp_path / "a.json", {"unit": "µm", "range": (1.0, np.inf)})
    assert (tmp_path / "a.json").read_text(encoding="utf-8") == (
        '{\n "unit": "µm",\n "range": [\n  1.0,\n  "inf"\n ]\n}\n'
    )


@pytest.mark.parametrize("digits", [str(2**63), str(-(2**63) - 1), "9" * 4400])
def test_toml_integers_have_64_bits(digits):
    """Also reject thousands of digits, which Python does not convert."""
    with pytest.raises(SpecError, match=r"a\.toml: integers must have at most 64 bits"):
        files.parse_toml(f"a = [{{b = {digits}}}]", "a.toml")
    for valid in (2**63 - 1, -(2**63)):
        assert files.parse_toml(f"a = {valid}", "a.toml") == {"a": valid}


@pytest.mark.parametrize(
    "args",
    [
        ["evaluate", "paper-spherical", "--csv", "out.csv"],
        pytest.param(["evaluate", "paper-spherical", "--json", "out.csv"], marks=pytest.mark.full),
        pytest.param(["init", "-o", "out.csv"], marks=pytest.mark.full),
    ],
    ids=["csv", "json", "init"],
)
def test_full_disk_is_reported_and_preserves_files(args, tmp_path):
    (tmp_path / "out.csv").write_text("precious")
    run = subprocess.run(
        [Path(sys.executable).with_name("omnimirror"), *args],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},  # it would be truncated too
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000)),
    )
    assert run.returncode != 0
    assert run.stderr.startswith("omnimirror: cannot write out.csv")
    assert len(run.stderr.splitlines()) == 1
    assert (tmp_path / "out.csv").read_text() == "precious"
    assert [p.name for p in tmp_path.iterdir()] == ["out.csv"]


def test_only_regular_files_of_limited_size_are_read(tmp_path):
    """A pipe blocks the reader, a device is endless, and a sparse file can exceed the memory."""
    os.mkfifo(tmp_path / "pipe")
    with open(tmp_path / "huge", "wb") as file:
        file.truncate(1 << 40)
    (tmp_path / "fits").write_bytes(b"12345")
    assert read_bytes(tmp_path / "fits", 5) == b"12345"
    for name, most, reason in [
        (tmp_path / "pipe", 5, "pipe or a device"),
        ("/dev/zero", 5, "pipe or a device"),
        (tmp_path / "huge", MAX_TEXT_BYTES, "the file must be at most 64 MB"),
        (tmp_path / "fits", 4, "the file must be at most 4 bytes"),
        (tmp_path, 5, "must be a file; got a folder"),
        ("a\0b", 5, "the name must not contain null characters"),
    ]:
        with pytest.raises(OSError, match=reason):
            read_bytes(name, most)


def test_text_encodings_and_line_ends(tmp_path):
    (tmp_path / "dos.txt").write_bytes(b"\xef\xbb\xbfone\r\ntwo\r")
    assert read_text(tmp_path / "dos.txt", "table") == "one\ntwo\n"
    (tmp_path / "latin.txt").write_bytes(b"caf\xe9")
    with pytest.raises(OmnimirrorError, match=r"the file must be text in UTF-8"):
        read_text(tmp_path / "latin.txt", "table")
    with pytest.raises(OmnimirrorError, match=r"cannot read the table .*none\.txt: No such file"):
        read_text(tmp_path / "none.txt", "table")


def test_files_without_nominal_size_are_limited():
    with open("/proc/self/status", "rb") as file:
        content = file.read()
    assert read_bytes("/proc/self/status", 1 << 20).splitlines()[0] == content.splitlines()[0]
    with pytest.raises(OSError, match="the file must be at most 9 bytes; reduce or split it"):
        read_bytes("/proc/self/status", 9)


def test_file_replaced_by_pipe_during_open_is_rejected(tmp_path, monkeypatch):
    path = tmp_path / "a"
    path.write_bytes(b"1")
    before = os.stat(path)
    path.unlink()
    os.mkfifo(path)
    monkeypatch.setattr(os, "stat", lambda name: before)
    with pytest.raises(OSError, match="pipe or a device"):
        read_bytes(path, 5)


def test_archive_content_is_limited(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.x3p", "w", zipfile.ZIP_DEFLATED) as archive:
        for name in ("one", "two"):
            archive.writestr(name, bytes(1 << 20))
    check_file(tmp_path / "a.x3p", 1 << 14, 2 << 20)
    with pytest.raises(OSError, match="the content must be at most 1 MB"):
        check_file(tmp_path / "a.x3p", 1 << 14, (2 << 20) - 1)
    data = bytearray((tmp_path / "a.x3p").read_bytes())
    data[data.index(b"PK\x01\x02")] = 0
    (tmp_path / "a.x3p").write_bytes(data)
    with pytest.raises(
        OSError, match=r"damaged archive \(Bad magic number for central directory\)"
    ):
        check_file(tmp_path / "a.x3p", 1 << 14, 2 << 20)


def test_compressed_data_is_limited():
    packed = zlib.compress(bytes(1000))
    assert decompress(packed, 1000) == bytes(1000)
    for data, most, reason in [
        (packed, 999, "the content must be at most 999 bytes; reduce or split it"),
        (packed[:-5], 1000, "truncated data"),
        (b"x" + packed, 1000, "damaged data"),
    ]:
        with pytest.raises(ValueError, match=reason):
            decompress(data, most)


NESTED = {
    "lists.toml": lambda n: "a = " + "[" * (n - 1) + "1" + "]" * (n - 1),
    "keys.toml": lambda n: ".".join("a" * n) + " = 1",
    "quoted.toml": lambda n: " . ".join(['"a b"'] * n) + " = 1",
    "inline.toml": lambda n: "a = " + "{a = " * (n - 1) + "1" + "}" * (n - 1),
    "lists.json": lambda n: "[" * n + "]" * n,
    "tables.json": lambda n: '{"a":' * n + "1" + "}" * n,
    "flow.yaml": lambda n: "[" * n + "]" * n,
    "block.yaml": lambda n: "- " * n + "1",
}
"""Texts with n nested tables and lists, including the document itself."""
PARSERS = {
    "toml": lambda text: parse_toml(text, "a"),
    "json": parse_json,
    "yaml": lambda text: compose_yaml(text, "a"),
}


@pytest.mark.parametrize("kind", NESTED)
def test_nesting_is_limited_to_32_levels(kind):
    parse = PARSERS[kind.rpartition(".")[2]]
    assert parse(NESTED[kind](32)) is not None
    for levels in (33, 34, 3_000, 100_000):
        with pytest.raises(
            ValueError, match="tables and lists must be nested at most 32 levels deep"
        ):
            parse(NESTED[kind](levels))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            "a: &x [1, 2]\nb: *x\n",
            r"a\.yaml line 2: aliases \(\*x\) are not supported; repeat the value",
        ),
        (
            "[" + "1," * 100_000 + "1]",
            r"a\.yaml must contain at most 100000 values; got more up to line 1",
        ),
        ("a: " + "x" * (5 << 20), r"a\.yaml must be at most 4 MB"),
        ("a: [1, 2\n", r"a\.yaml line 2 must be valid YAML: did not find expected ',' or '\]'"),
        (
            "a: \x01\n",
            r"a\.yaml must be valid YAML: unacceptable character #x0001: control characters are not allow",
        ),
    ],
)
def test_yaml_has_limits(text, sentence):
    with pytest.raises(SpecError, match=sentence):
        compose_yaml(text, "a.yaml")


def test_yaml_within_limits_is_parsed():
    node = compose_yaml("[" + "1," * 99_998 + "]", "a.yaml")
    assert len(node.value) == 99_998
    assert compose_yaml("", "a.yaml") is None


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("a = [" + "1," * (3 << 20) + "]", r"a\.toml must be at most 4 MB"),
        ("a = 9223372036854775808", r"a\.toml: integers must have at most 64 bits"),
        ("a = [[-9223372036854775809]]", r"a\.toml: integers must have at most 64 bits"),
        ("a = " + "9" * 5000, r"a\.toml: integers must have at most 64 bits"),
        ("a = ", r"a\.toml must be valid TOML: Invalid value \(at end of document\)"),
    ],
)
def test_toml_has_limits(text, sentence):
    with pytest.raises(SpecError, match=sentence):
        parse_toml(text, "a.toml")


def test_toml_within_limits_is_parsed():
    text = (
        "a = [-9223372036854775808, 9223372036854775807]\nb = '" + "c." * 99 + "'\n# " + "d." * 99
    )
    assert parse_toml(text, "a.toml") == {"a": [-(2**63), 2**63 - 1], "b": "c." * 99}


@pytest.mark.parametrize("kind", ["pipe", "zero"])
def test_commands_reject_pipes_and_devices(kind, tmp_path):
    """Every file that a command line can name, and every file that such a file can name."""
    from click.testing import CliRunner

    from omnimirror.apps.cli import app
    from omnimirror.io import write_image

    endless = "/dev/zero" if kind == "zero" else str(tmp_path / "pipe")
    if kind == "pipe":
        os.mkfifo(endless)

    def named(suffix: str) -> str:
        """Return a link to the file with a suffix of a format."""
        link = tmp_path / f"endless{suffix}"
        if not link.is_symlink():
            link.symlink_to(endless)
        return str(link)

    (tmp_path / "s.toml").write_text(
        f'[mirror]\nkind = "sampled"\nprofile_csv = "{endless}"\n[lens]\n[imager]\n'
    )
    (tmp_path / "w.toml").write_text(
        f'[field]\nomega_max_deg = 90\n[mirror]\nmapping_csv = "{endless}"\nrim_radius_mm '
        "= 40\n[lens]\ntheta_max_deg = 12\n"
    )
    (tmp_path / "m.toml").write_text(f'[[measured]]\nname = "a"\nfile = "{named(".x3p")}"\n')
    (tmp_path / "p.toml").write_text(f'[[lens]]\nname = "a"\nfile = "{named(".zmx")}"\n')
    (tmp_path / "a.obj").write_text(f"mtllib {endless}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    picture, out = str(tmp_path / "a.png"), str(tmp_path / "b.png")
    write_image(picture, np.zeros((8, 8, 3), np.uint8))
    for words in (
        ["evaluate", endless],
        ["evaluate", str(tmp_path / "s.toml")],
        ["evaluate", "paper-spherical", "--lens", named(".zmx")],
        ["design", endless],
        ["design", str(tmp_path / "w.toml")],
        ["design", "--like", endless],
        ["parts", "paper-spherical", endless],
        ["parts", "paper-spherical", str(tmp_path / "p.toml")],
        ["check", endless, "paper-spherical"],
        ["tolerance", "paper-spherical", endless],
        ["tolerance", "paper-spherical", str(tmp_path / "m.toml")],
        ["form", "paper-spherical", named(".dat")],
        ["form", "paper-spherical", named(".x3p")],
        ["form", "paper-spherical", named(".csv")],
        ["convert", endless, "-o", str(tmp_path / "b.toml")],
        ["uncertainty", endless],
        ["calibrate", "--points", endless, "--image-size", "64x64"],
        ["lines", "--lines", endless, "--image-size", "64x64"],
        ["colmap", "paper-spherical", picture, "--poses", endless, "-o", out],
        ["dewarp", picture, "--ocam", endless, "-o", out],
        ["dewarp", endless, "--sensor", "paper-spherical", "-o", out],
        ["dewarp", named(".mp4"), "--ball", "4,4,3,300", "-o", str(tmp_path / "b.mp4")],
        ["dewarp", named(".mcap"), "--ball", "4,4,3,300", "-o", str(tmp_path / "b.mcap")],
        ["simulate", "paper-spherical", "--scene", named(".png"), "-o", out],
        ["simulate", "paper-spherical", "--scene", named(".obj"), "-o", out],
        ["simulate", "paper-spherical", "--scene", str(tmp_path / "a.obj"), "-o", out],
        ["rim", endless],
    ):
        run = CliRunner().invoke(app, words)
        assert run.exit_code != 0, words
        assert "a pipe or a device" in str(run.exception), (words, run.output, run.exception)


def test_symbolic_link_is_kept_and_target_replaced(tmp_path):
    (tmp_path / "far").mkdir()
    target = tmp_path / "far" / "table.csv"
    target.write_text("old")
    target.chmod(0o640)
    first, second = tmp_path / "first", tmp_path / "second.csv"
    first.symlink_to("far/table.csv")
    second.symlink_to(first)
    before = target.stat().st_ino
    write_text(second, "new")
    assert second.is_symlink()
    assert first.is_symlink()
    assert target.read_text() == "new"
    assert target.stat().st_ino != before  # replaced atomically, never partially written
    assert stat.S_IMODE(target.stat().st_mode) == 0o640
    dangling = tmp_path / "dangling"
    dangling.symlink_to(tmp_path / "far" / "made.csv")
    write_text(dangling, "made")
    assert (tmp_path / "far" / "made.csv").read_text() == "made"
    assert sorted(p.name for p in (tmp_path / "far").iterdir()) == ["made.csv", "table.csv"]


def test_circular_link_raises(tmp_path):
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    with pytest.raises(OmnimirrorError, match="symbolic links"):
        write_text(tmp_path / "a", "x")


def test_pipes_and_devices_are_written_directly(tmp_path):
    pipe = tmp_path / "pipe.csv"
    os.mkfifo(pipe)
    got = []
    reader = threading.Thread(target=lambda: got.append(pipe.read_text()))
    reader.start()
    write_text(pipe, "rows")
    reader.join()
    assert got == ["rows"]
    assert stat.S_ISFIFO(pipe.lstat().st_mode)
    device = os.stat(os.devnull).st_rdev
    write_text(os.devnull, "nothing")
    assert os.stat(os.devnull).st_rdev == device
    (tmp_path / "null").symlink_to(os.devnull)
    write_text(tmp_path / "null", "nothing")
    assert (tmp_path / "null").is_symlink()


@pytest.mark.parametrize("name", ["-", "/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"])
def test_standard_output_continues_at_its_position(name, tmp_path):
    script = (
        f"from omnimirror.base.files import write_text; print('before'); write_text({name!r}, "
        "'rows'); print('after')"
    )
    with (tmp_path / "log").open("w") as log:
        log.write("earlier ")
        log.flush()
        subprocess.run([sys.executable, "-c", script], stdout=log, check=True)
    assert (tmp_path / "log").read_text() == "earlier before\nrowsafter\n"


KILLED = """
import os, signal, sys
from omnimirror.base.files import atomic_output
with atomic_output(sys.argv[1]) as temporary:
    temporary.write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_leftovers_of_killed_runs_only_are_removed(tmp_path):
    output = tmp_path / "out.mp4"
    for name in (output, tmp_path / "other.mp4"):
        run = subprocess.run([sys.executable, "-c", KILLED, name], check=False)
        assert run.returncode == -signal.SIGKILL
    left = {p.name for p in tmp_path.iterdir()}
    assert len(left) == 2
    theirs = [
        ".out-abcdefgh.mp4",
        ".out.omnimirror-abcdefgh.mp4.bak",
        ".out.omnimirror-abcdefgh.mov",
        "out.mov",
    ]
    for name in theirs:
        (tmp_path / name).write_text("precious")
    with atomic_output(output) as living:
        living.write_text("mine")
        write_text(output, "theirs")  # another run with the same output
        assert living.read_text() == "mine"
    assert output.read_text() == "mine"
    others = {name for name in left if name.startswith(".other.")}
    assert {p.name for p in tmp_path.iterdir()} == {"out.mp4", *others, *theirs}


def test_leftovers_of_other_owners_are_kept(tmp_path, monkeypatch):
    output = tmp_path / "out.mp4"
    assert (
        subprocess.run([sys.executable, "-c", KILLED, output], check=False).returncode
        == -signal.SIGKILL
    )
    (left,) = tmp_path.iterdir()
    user = os.geteuid()
    with monkeypatch.context() as patch:
        patch.setattr(os, "geteuid", lambda: user + 1)
        write_text(output, "mine")
    assert left.read_text() == "half"
    write_text(output, "mine")
    assert not left.exists()


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("<a>\n<b>\n         </c>\n</a>", 3),
        ("             <a", 1),
        ("<a>\n<b>\n\n", 2),
        ("<a>\n<b>&x;\n</b></a>", 2),
        ("<a/>\n<b/>\n\n\n", 2),
    ],
)
def test_xml_errors_contain_line(text, line):
    with pytest.raises(SpecError, match=f"^file line {line} must be valid XML: "):
        files.parse_xml(text, "file")

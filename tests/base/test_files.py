"""Atomic output files, also on disk errors."""

from __future__ import annotations

import gzip
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
    is_stream,
    json_plain,
    open_file,
    parse_json,
    parse_toml,
    read_bytes,
    read_tables,
    read_text,
    write_text,
)


def test_atomic_output_is_complete_or_absent(tmp_path):
    path = tmp_path / "new" / "folders" / "table.csv"
    write_text(path, "first")

    def interrupt():
        with atomic_output(path) as temporary:
            temporary.write_text("sec")
            raise RuntimeError("half way")

    with pytest.raises(RuntimeError, match="half way"):
        interrupt()
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
    with atomic_output(tmp_path / "a.txt") as temporary:
        assert stat.S_IMODE(temporary.stat().st_mode) == 0o600  # until it is complete
        temporary.write_text("a")
    (tmp_path / "b.txt").write_text("b")
    assert (tmp_path / "a.txt").stat().st_mode == (tmp_path / "b.txt").stat().st_mode


def test_folder_as_output_raises(tmp_path):
    with pytest.raises(
        OmnimirrorError, match=r"^cannot write \S+: the name must be that of a file; got a folder$"
    ):
        write_text(tmp_path, "x")
    assert list(tmp_path.iterdir()) == []


def test_errors_without_a_number_are_named(tmp_path, monkeypatch):
    with (
        pytest.raises(OmnimirrorError, match=r"^cannot write \S+: no device$"),
        atomic_output(tmp_path / "a"),
    ):
        raise OSError("no device")
    monkeypatch.setattr(files, "read_bytes", lambda *_: (_ for _ in ()).throw(OSError("no device")))
    with pytest.raises(OmnimirrorError, match=r"^cannot read the table a: no device$"):
        read_text("a", "table")


@pytest.mark.parametrize("path", ["a\0b", 3, None])
def test_other_outputs_than_names_raise(path):
    with pytest.raises(OmnimirrorError, match="path must be a file name; got "):
        write_text(path, "x")


def test_names_of_files_and_streams():
    """Names that precede and follow "-" are files; the same file has several names."""
    names = ["-", "-.png", "!x.png", "+.png", ".png", "x", "a/-", "!/-", "/-"]
    assert [files.is_standard_output(name) for name in names] == [True] * 2 + [False] * 7
    assert files.display_name("-.png") == "standard output"
    assert files.display_name("a/-") == "a/-"
    assert files.is_same_file("a/../b", Path("b"))
    assert not files.is_same_file("a", "b")
    assert not files.is_same_file("b", "a")


def test_json_values_are_plain():
    """NaN is null, infinity a word; integers, booleans and text are unchanged."""
    data = {"a": np.array([[1.5, np.nan], [np.inf, -np.inf]]), "b": (1, True, None, "x", [2.0])}
    plain = json_plain(data)
    assert plain == {"a": [[1.5, None], ["inf", "-inf"]], "b": [1, True, None, "x", [2.0]]}
    assert plain["b"][1] is True
    assert json_plain(np.float64(2.5)) == 2.5


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
    with open_file(tmp_path / "fits") as file:
        assert file.read() == b"12345"
    check_file(tmp_path / "fits", 5, 1)  # no archive
    for name, limit, reason in [
        (tmp_path / "pipe", 5, "pipe or a device"),
        ("/dev/zero", 5, "pipe or a device"),
        (tmp_path / "huge", MAX_TEXT_BYTES, "the file must be at most 64 MB; got 1048576 MB"),
        (tmp_path / "huge", 1 << 20, "the file must be at most 1 MB; got 1048576 MB"),
        (tmp_path / "huge", (1 << 20) - 1, f"at most 1048575 bytes; got {1 << 40} bytes"),
        (tmp_path / "fits", 4, "the file must be at most 4 bytes; got 5 bytes"),
        (tmp_path, 5, "must be a file; got a folder"),
        ("a\0b", 5, "the name must not contain null characters"),
    ]:
        with pytest.raises(OSError, match=reason):
            read_bytes(name, limit)


def test_generated_files_are_limited_to_1_mb(tmp_path, monkeypatch):
    """A file with a nominal size of 0, as in /proc; other files may grow up to their nominal size."""
    path, measured = tmp_path / "grown", os.fstat
    path.write_bytes(bytes((2 << 20) + 1))
    for nominal, limit in ((0, 1 << 20), ((1 << 20) + 5, (1 << 20) + 5), (2 << 20, 2 << 20)):
        as_if = os.stat_result([*measured(0)[:6], nominal, 0, 0, 0])

        def fstat(number, status=as_if):
            return os.stat_result((stat.S_IFREG, *status[1:]))

        with monkeypatch.context() as patch:
            patch.setattr(os, "fstat", fstat)
            with pytest.raises(OSError, match=f"at most {limit >> 20} MB; reduce or split it"):
                read_bytes(path, 1 << 22)
        os.truncate(path, limit)
        with monkeypatch.context() as patch:
            patch.setattr(os, "fstat", fstat)
            assert len(read_bytes(path, 1 << 22)) == limit
        path.write_bytes(bytes((2 << 20) + 1))


def test_text_encodings_and_line_ends(tmp_path):
    (tmp_path / "dos.txt").write_bytes(b"\xef\xbb\xbfone\r\ntwo\r")
    assert read_text(tmp_path / "dos.txt", "table") == "one\ntwo\n"
    (tmp_path / "latin.txt").write_bytes(b"caf\xe9")
    with pytest.raises(OmnimirrorError, match=r"the file must be text in UTF-8"):
        read_text(tmp_path / "latin.txt", "table")
    with pytest.raises(OmnimirrorError, match=r"cannot read the table .*none\.txt: No such file"):
        read_text(tmp_path / "none.txt", "table")
    with pytest.raises(SpecError, match=r"^there is none$"):
        read_text(tmp_path / "none.txt", "table", SpecError, "there is none")
    with pytest.raises(
        SpecError, match=r"cannot read the table .*: it must be a file; got a folder"
    ):
        read_text(tmp_path, "table", SpecError, "there is none")


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
    assert decompress(packed, 2000) == bytes(1000)
    assert decompress(packed, 1000) == decompress(gzip.compress(bytes(1000)), 1000) == bytes(1000)
    parts = gzip.compress(b"a" * 600) + gzip.compress(b"b" * 400)
    assert decompress(parts, 1000) == decompress(parts + bytes(9), 1000) == 600 * b"a" + 400 * b"b"
    with pytest.raises(ValueError, match="the content must be"):
        decompress(parts, 999)
    with pytest.raises(ValueError, match="at most 1000 gzip streams"):
        decompress(gzip.compress(b"") * 1001, 1000)
    for data, limit, reason in [
        (packed, 999, "the content must be at most 999 bytes; reduce or split it"),
        (packed[:-5], 1000, "truncated data"),
        (b"x" + packed, 1000, "damaged data"),
    ]:
        with pytest.raises(ValueError, match=reason):
            decompress(data, limit)


NESTED = {
    "lists.toml": lambda n: "a = " + "[" * (n - 1) + "1" + "]" * (n - 1),
    "keys.toml": lambda n: ".".join("a" * n) + " = 1",
    "quoted.toml": lambda n: " . ".join(['"a b"'] * n) + " = 1",
    "inline.toml": lambda n: "a = " + "{a = " * (n - 1) + "1" + "}" * (n - 1),
    "lists.json": lambda n: "[" * n + "]" * n,
    "tables.json": lambda n: '{"a":' * n + "1" + "}" * n,
    "flow.yaml": lambda n: "[" * n + "]" * n,
    "block.yaml": lambda n: "- " * n + "1",
    "tags.xml": lambda n: "<a>" * n + "</a>" * n,
}
"""Texts with n nested tables and lists, including the document itself."""
PARSERS = {
    "toml": lambda text: parse_toml(text, "a"),
    "json": parse_json,
    "yaml": lambda text: compose_yaml(text, "a"),
    "xml": lambda text: files.parse_xml(text, "a"),
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
    ("text", "message"),
    [
        (
            "a: &x [1, 2]\nb: *x\n",
            r"a\.yaml line 2: aliases \(\*x\) are not supported; repeat the value",
        ),
        (
            "- 1\n" * 100_000,
            r"a\.yaml must contain at most 100000 values; got more up to line 100000",
        ),
        ("#" + "x" * (4 << 20), r"a\.yaml must be at most 4 MB; got 5 MB"),
        ("a: [1, 2\n", r"a\.yaml line 2 must be valid YAML: did not find expected ',' or '\]'"),
        ("a: [1, 2", r"a\.yaml line 1 must be valid YAML: did not find expected ',' or '\]'"),
        ("a: 1\nb: [1, }\nc: 3\n", r"a\.yaml line 2 must be valid YAML: did not find expected"),
        (
            "a: \x01\n",
            r"a\.yaml must be valid YAML: unacceptable character #x0001: control .*, position 3$",
        ),
    ],
)
def test_yaml_has_limits(text, message):
    with pytest.raises(SpecError, match=message):
        compose_yaml(text, "a.yaml")


def test_yaml_within_limits_is_parsed():
    node = compose_yaml("- 1\n" * 99_999, "a.yaml")
    assert len(node.value) == 99_999
    assert compose_yaml("#" + "x" * ((4 << 20) - 1), "a.yaml") is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "#" + "x" * (4 << 20),
            r"a\.toml must be at most 4 MB; got 5 MB; reduce or split it; store tables of numbers as CSV",
        ),
        ("a = 9223372036854775808", r"a\.toml: integers must have at most 64 bits"),
        ("a = [[-9223372036854775809]]", r"a\.toml: integers must have at most 64 bits"),
        ("a = " + "9" * 5000, r"a\.toml: integers must have at most 64 bits"),
        ("a = ", r"a\.toml must be valid TOML: Invalid value \(at end of document\)"),
    ],
)
def test_toml_has_limits(text, message):
    with pytest.raises(SpecError, match=message):
        parse_toml(text, "a.toml")


def test_toml_within_limits_is_parsed():
    text = (
        "a = [-9223372036854775808, 9223372036854775807]\nb = '" + "c." * 99 + "'\n# " + "d." * 99
    )
    assert parse_toml(text, "a.toml") == {"a": [-(2**63), 2**63 - 1], "b": "c." * 99}
    assert parse_toml("#" + "x" * ((4 << 20) - 1), "a.toml") == {}


def test_tables_of_a_file_are_counted(tmp_path):
    path = tmp_path / "views.toml"
    for count in (1, 3):
        path.write_text("".join(f"[v{i}]\nx = {i}\n" for i in range(count)))
        assert read_tables(path, "view", "views", 3) == {f"v{i}": {"x": i} for i in range(count)}
    for text, message in [
        ("", r"views\.toml must contain 1 to 3 views; got 0"),
        ("[a]\n[b]\n[c]\n[d]\n", r"views\.toml must contain 1 to 3 views; got 4"),
        ("[a]\n[b]\n[c]\n[a.d]\n", None),
        ("b = 3\n[a]\n", r"views\.toml: the view b must be a table \[b\]; got 3"),
    ]:
        path.write_text(text)
        if message is None:
            assert read_tables(path, "view", "views", 3)["a"] == {"d": {}}
            continue
        with pytest.raises(SpecError, match=message):
            read_tables(path, "view", "views", 3)
    with pytest.raises(SpecError, match=r"path must be an existing file of views; got '.*none'"):
        read_tables(tmp_path / "none", "view", "views", 3)


@pytest.mark.parametrize("kind", ["pipe", "zero"])
def test_commands_reject_pipes_and_devices(kind, tmp_path):
    """Every file that a command line can name, and every file that such a file can name."""
    from click.testing import CliRunner

    from omnimirror.apps.cli import app
    from omnimirror.io import write_image

    pipe = "/dev/zero" if kind == "zero" else str(tmp_path / "pipe")
    if kind == "pipe":
        os.mkfifo(pipe)

    def named(suffix: str) -> str:
        """Return a link to the file with a suffix of a format."""
        link = tmp_path / f"endless{suffix}"
        if not link.is_symlink():
            link.symlink_to(pipe)
        return str(link)

    (tmp_path / "s.toml").write_text(
        f'[mirror]\nkind = "sampled"\nprofile_csv = "{pipe}"\n[lens]\n[imager]\n'
    )
    (tmp_path / "w.toml").write_text(
        f'[field]\nomega_max_deg = 90\n[mirror]\nmapping_csv = "{pipe}"\nrim_radius_mm '
        "= 40\n[lens]\ntheta_max_deg = 12\n"
    )
    (tmp_path / "m.toml").write_text(f'[[measured]]\nname = "a"\nfile = "{named(".x3p")}"\n')
    (tmp_path / "p.toml").write_text(f'[[lens]]\nname = "a"\nfile = "{named(".zmx")}"\n')
    (tmp_path / "a.obj").write_text(f"mtllib {pipe}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    image, out = str(tmp_path / "a.png"), str(tmp_path / "b.png")
    write_image(image, np.zeros((8, 8, 3), np.uint8))
    for arguments in (
        ["evaluate", pipe],
        ["evaluate", str(tmp_path / "s.toml")],
        ["evaluate", "paper-spherical", "--lens", named(".zmx")],
        ["design", pipe],
        ["design", str(tmp_path / "w.toml")],
        ["design", "--like", pipe],
        ["parts", "paper-spherical", pipe],
        ["parts", "paper-spherical", str(tmp_path / "p.toml")],
        ["check", pipe, "paper-spherical"],
        ["tolerance", "paper-spherical", pipe],
        ["tolerance", "paper-spherical", str(tmp_path / "m.toml")],
        ["form", "paper-spherical", named(".dat")],
        ["form", "paper-spherical", named(".x3p")],
        ["form", "paper-spherical", named(".csv")],
        ["convert", pipe, "-o", str(tmp_path / "b.toml")],
        ["uncertainty", pipe],
        ["calibrate", "--points", pipe, "--image-size", "64x64"],
        ["lines", "--lines", pipe, "--image-size", "64x64"],
        ["colmap", "paper-spherical", image, "--poses", pipe, "-o", out],
        ["dewarp", image, "--sensor", pipe, "-o", out],
        ["dewarp", pipe, "--sensor", "paper-spherical", "-o", out],
        ["dewarp", named(".mp4"), "--ball", "4,4,3,300", "-o", str(tmp_path / "b.mp4")],
        ["dewarp", named(".mcap"), "--ball", "4,4,3,300", "-o", str(tmp_path / "b.mcap")],
        ["simulate", "paper-spherical", "--scene", named(".png"), "-o", out],
        ["simulate", "paper-spherical", "--scene", named(".obj"), "-o", out],
        ["simulate", "paper-spherical", "--scene", str(tmp_path / "a.obj"), "-o", out],
        ["rim", pipe],
    ):
        run = CliRunner().invoke(app, arguments)
        assert run.exit_code != 0, arguments
        assert "a pipe or a device" in str(run.exception), (arguments, run.output, run.exception)


def test_symbolic_link_remains_and_its_target_is_replaced(tmp_path):
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
    broken_link = tmp_path / "dangling"
    broken_link.symlink_to(tmp_path / "far" / "made.csv")
    write_text(broken_link, "made")
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
    texts = []
    reader = threading.Thread(target=lambda: texts.append(pipe.read_text()))
    reader.start()
    write_text(pipe, "rows")
    reader.join()
    assert texts == ["rows"]
    assert stat.S_ISFIFO(pipe.lstat().st_mode)
    device = os.stat(os.devnull).st_rdev
    write_text(os.devnull, "nothing")
    assert os.stat(os.devnull).st_rdev == device
    (tmp_path / "null").symlink_to(os.devnull)
    write_text(tmp_path / "null", "nothing")
    assert (tmp_path / "null").is_symlink()
    assert not is_stream(tmp_path)
    with pytest.raises(OSError, match="the name must not contain null characters"):
        is_stream("a\0b")


def test_open_descriptors_are_written_at_their_position(tmp_path):
    """By all names of a descriptor of this process, which remains open; not of other processes."""
    number = os.open(tmp_path / "log", os.O_RDWR | os.O_CREAT)
    try:
        os.write(number, b"a")
        names = [f"/dev/fd/{number}", f"/proc/self/fd/{number}", f"/proc/{os.getpid()}/fd/{number}"]
        (tmp_path / "link").symlink_to(names[0])
        for name in (*names, str(tmp_path / "link")):
            write_text(name, "b")
        os.write(number, b"c")
    finally:
        os.close(number)
    assert (tmp_path / "log").read_text() == "abbbbc"
    assert files._descriptor_of(f"/proc/{os.getpid() + 1}/fd/{number}") is None
    chain = [tmp_path / f"chain{i}" for i in range(9)]
    for link, target in zip(chain, ["/dev/fd/3", *chain], strict=False):
        link.symlink_to(target)
    assert [files._descriptor_of(link) for link in chain[5:]] == [3, 3, None, None]


def test_outputs_to_block_devices_and_closed_pipes_raise(tmp_path, monkeypatch):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    monkeypatch.setattr(files.shutil, "copyfileobj", lambda *_: closed())
    with pytest.raises(OmnimirrorError, match=r"cannot write .*pipe: Broken pipe"):
        write_text(pipe, "x")
    with pytest.raises(BrokenPipeError):  # for commands such as head
        write_text("-", "x")
    os.close(reader)
    monkeypatch.setattr(stat, "S_ISBLK", stat.S_ISFIFO)
    with pytest.raises(OmnimirrorError, match="must be that of a file; got a block device"):
        write_text(pipe, "x")


def closed():
    """Raise the error of writing to a pipe without a reader."""
    raise BrokenPipeError(32, "Broken pipe")


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
    leftovers = {p.name for p in tmp_path.iterdir()}
    assert len(leftovers) == 2
    foreign_files = [
        ".out-abcdefgh.mp4",
        ".out.omnimirror-abcdefg.mp4",
        ".out.omnimirror-abcdefghi.mp4",
        ".out.omnimirror-abcdefgh.mp4.bak",
        ".out.omnimirror-abcdefgh.mov",
        "out.mov",
    ]
    for name in foreign_files:
        (tmp_path / name).write_text("precious")
    (tmp_path / ".out.omnimirror-pointing.mp4").symlink_to("out.mov")  # of this user, but no file
    os.mkfifo(tmp_path / ".out.omnimirror-pipeline.mp4")
    foreign_files += [".out.omnimirror-pointing.mp4", ".out.omnimirror-pipeline.mp4"]
    with atomic_output(output) as temporary:
        temporary.write_text("mine")
        write_text(output, "theirs")  # another run with the same output
        assert temporary.read_text() == "mine"
    assert output.read_text() == "mine"
    others = {name for name in leftovers if name.startswith(".other.")}
    assert {p.name for p in tmp_path.iterdir()} == {"out.mp4", *others, *foreign_files}


def test_leftovers_are_renamed_on_request(tmp_path):
    """The renamed file has the permissions of a new file or of the replaced file."""
    output, recovered = tmp_path / ("x" * 70 + "ü.mp4"), tmp_path / "recovered.mp4"
    (tmp_path / "new").write_text("")
    for mode in (stat.S_IMODE((tmp_path / "new").stat().st_mode), 0o640):
        with atomic_output(output) as temporary:
            pass
        assert temporary.name.startswith("." + "x" * 60 + ".omnimirror-")
        temporary.write_text("half")
        paths: list[Path] = []

        def rescue(path, paths=paths):
            paths.append(path)
            return recovered

        with atomic_output(output, rescue) as temporary_output:
            temporary_output.write_text("whole")
        assert paths == [temporary]
        assert (recovered.read_text(), output.read_text()) == ("half", "whole")
        assert stat.S_IMODE(recovered.stat().st_mode) == mode
        recovered.chmod(0o640)


def test_leftovers_of_other_owners_are_not_removed(tmp_path, monkeypatch):
    output = tmp_path / "out.mp4"
    assert (
        subprocess.run([sys.executable, "-c", KILLED, output], check=False).returncode
        == -signal.SIGKILL
    )
    (leftover,) = tmp_path.iterdir()
    user = os.geteuid()
    with monkeypatch.context() as patch:
        patch.setattr(os, "geteuid", lambda: user + 1)
        write_text(output, "mine")
    assert leftover.read_text() == "half"
    write_text(output, "mine")
    assert not leftover.exists()


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


def test_xml_within_limits_is_parsed():
    """Returns the root; a text of 4 MB is the longest one."""
    root = files.parse_xml("<a><b/><c>1</c></a>", "file")
    assert [root.tag, *(child.tag for child in root)] == ["a", "b", "c"]
    space = (4 << 20) - len("<a></a>")
    assert files.parse_xml(f"<a>{' ' * space}</a>", "file").tag == "a"
    for text, message in [
        (f"<a>{' ' * (space + 1)}</a>", "file must be at most 4 MB; got 5 MB"),
        ("<!DOCTYPE a><a/>", "must not declare a document type or entities; remove <!DOCTYPE"),
        ("<!ENTITY b 'c'><a/>", "must not declare a document type or entities; remove <!DOCTYPE"),
        ("<a>\ud800</a>", "^file must be valid XML: "),
    ]:
        with pytest.raises(SpecError, match=message):
            files.parse_xml(text, "file")

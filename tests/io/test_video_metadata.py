"""Chapters, subtitles, languages and start time, as read by FFmpeg from the output."""

from __future__ import annotations

import struct
import sys
from dataclasses import replace
from fractions import Fraction

import av
import numpy as np
import pytest
from av.sidedata.sidedata import Type as SideData

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.io.video_metadata import MasteringDisplay, dynamic_hdr_names
from omnimirror.io.video_processing import process
from omnimirror.io.video_reader import VideoReader
from omnimirror.io.video_writer import VideoWriter
from tests.commands import omnimirror
from tests.io.synthetic import SIZE, tone

# -- Chapters, subtitles, languages and start time, as read by FFmpeg from the output --------------

HEADER = b"""[Script Info]
ScriptType: v4.00+

[V4+ Styles]
Format: Name, Fontname, Fontsize, PrimaryColour, SecondaryColour, OutlineColour, BackColour, Bold, Italic, Underline, \
StrikeOut, ScaleX, ScaleY, Spacing, Angle, BorderStyle, Outline, Shadow, Alignment, MarginL, MarginR, MarginV, Encoding
Style: Default,Arial,16,&Hffffff,&Hffffff,&H0,&H0,0,0,0,0,100,100,0,0,1,1,0,2,10,10,10,1

[Events]
Format: Layer, Start, End, Style, Name, MarginL, MarginR, MarginV, Effect, Text
"""
MS = Fraction(1, 1000)
TEXTS = [(200, 700, "Hello there"), (1000, 500, "Second\nline")]
CHAPTERS = [(0, 1000, "First"), (1000, 2000, "Second")]
BALL = om.MirrorBall(centre_px=(31.5, 23.5), rim_radius_px=22.0, field_deg=300.0, image_size=SIZE)


def write_film(path, start_ms=0, seconds=2, languages=("deu", "eng"), subtitles=True, text_tick=MS):
    """Write frames, two audio tracks, text subtitles and chapters, all delayed by begins_ms."""
    with av.open(str(path), "w") as container:
        video = container.add_stream("libx264", rate=25, options={"preset": "ultrafast", "bf": "0"})
        video.width, video.height, video.pix_fmt = *SIZE, "yuv420p"
        sounds = [container.add_stream("ac3", rate=48000, layout="mono") for _ in languages]
        for sound, language in zip(sounds, languages, strict=True):
            sound.metadata["language"] = language
        sounds[-1].metadata["title"] = "Comment"
        kind = "mov_text" if path.suffix in (".mp4", ".mov") else "subrip"
        subtitle = container.add_stream(kind) if subtitles else None
        if subtitle:
            subtitle.codec_context.subtitle_header, subtitle.codec_context.time_base = HEADER, MS
            subtitle.time_base, subtitle.metadata["language"] = text_tick, "fra"
        container.set_chapters(
            [
                {
                    "id": i,
                    "start": a + start_ms,
                    "end": b + start_ms,
                    "time_base": MS,
                    "metadata": {"title": title},
                }
                for i, (a, b, title) in enumerate(CHAPTERS, 1)
            ]
        )
        for number in range(25 * seconds):
            frame = av.VideoFrame.from_ndarray(
                np.full((SIZE[1], SIZE[0], 3), 5 * number % 250, np.uint8), "rgb24"
            )
            frame.pts, frame.time_base = number * 40 + start_ms, MS
            container.mux(video.encode(frame))
        container.mux(video.encode(None))
        for start, duration, text in TEXTS if subtitle else ():
            data = text.encode()
            packet = av.Packet(struct.pack(">H", len(data)) + data if kind == "mov_text" else data)
            packet.stream, packet.time_base = subtitle, MS
            packet.pts = packet.dts = start + start_ms
            packet.duration = duration
            container.mux(packet)
        for sound in sounds:
            for sample in range(0, 48000 * seconds, 1536):
                frame = tone(sample, 1536)
                frame.pts = sample + start_ms * 48
                container.mux(sound.encode(frame))
            container.mux(sound.encode(None))
    return path


def process_file(source, path, **cut):
    with VideoReader(source, **cut) as reader:
        writer = VideoWriter.from_source(reader, path)
        process(reader.items(), writer, lambda frame, time_s: frame, "frame")
        return [*reader.notes, *writer.notes]


def tracks_of(path):
    """Return chapters (s), languages, titles, and texts with their times, as FFmpeg reads them."""
    with av.open(str(path)) as container:
        chapters = [
            (
                float(c["start"] * c["time_base"]),
                float(c["end"] * c["time_base"]),
                c["metadata"]["title"],
            )
            for c in container.chapters()
        ]
        languages = [stream.language for stream in container.streams.audio]
        titles = [
            stream.metadata.get("title", stream.metadata.get("name"))
            for stream in container.streams.audio
        ]
        texts = []
        for stream in container.streams.subtitles:
            assert stream.language == "fra"
            for packet in container.demux(stream):
                for text in stream.codec_context.decode2(packet) or () if packet.size else ():
                    subtitle = (
                        text.dialogue.decode()
                        if isinstance(text.dialogue, bytes)
                        else text.dialogue
                    )
                    if subtitle:
                        time_s = float(packet.pts * packet.time_base)
                        texts.append(
                            (time_s, float(packet.duration * packet.time_base), subtitle.strip())
                        )
        return chapters, languages, titles, texts


@pytest.mark.parametrize("target", [".mkv", ".mp4", ".m4v", ".mov"])
@pytest.mark.parametrize("source", [".mkv", ".mp4"])
def test_tracks_are_preserved(tmp_path, source, target):
    write_film(tmp_path / f"a{source}")
    notes = process_file(tmp_path / f"a{source}", tmp_path / f"b{target}")
    assert len(notes) == (target == ".m4v")
    before, after = tracks_of(tmp_path / f"a{source}"), tracks_of(tmp_path / f"b{target}")
    assert before[0] == [(0, 1, "First"), (1, 2, "Second")]
    np.testing.assert_allclose([c[:2] for c in after[0]], [c[:2] for c in before[0]], atol=1e-3)
    assert [c[2] for c in after[0]] == ["First", "Second"]
    assert after[1] == (["ger", "eng"] if target == ".mov" else ["deu", "eng"])
    if target == ".m4v":
        assert "b.m4v: dropped the titles of tracks; .mkv supports them" in notes[0]
    else:
        assert after[2] == [None, "Comment"]
    assert [text for *_, text in after[3]] == ["Hello there", "Second\nline"]
    # Matroska starts with the priming of AC-3, 5.3 ms, which MP4 counts as negative.
    np.testing.assert_allclose([t[:2] for t in after[3]], [(0.2, 0.7), (1.0, 0.5)], atol=0.006)


@pytest.mark.parametrize("text_tick", [MS, Fraction(1, 1_000_000)])
@pytest.mark.parametrize("start_ms", [0, 1200])
def test_pauses_between_subtitles_are_kept(tmp_path, monkeypatch, start_ms, text_tick):
    """MP4 has samples without text in pauses; a copy of those delayed the texts after them.

    FFmpeg converts SubRip to texts in microseconds.
    """
    texts = [(120, 900, "First"), (1500, 300, "Second"), (2600, 300, "Third")]
    monkeypatch.setattr(sys.modules[__name__], "TEXTS", texts)
    write_film(tmp_path / "a.mp4", start_ms, seconds=3, text_tick=text_tick)
    process_file(tmp_path / "a.mp4", tmp_path / "b.mp4")
    times = [((time_s + start_ms) / 1000, duration / 1000) for time_s, duration, _ in texts]
    subtitles = tracks_of(tmp_path / "b.mp4")[3]
    assert [text for *_, text in subtitles] == ["First", "Second", "Third"]
    np.testing.assert_allclose([text[:2] for text in subtitles], times, atol=2e-3)


GPMF = [b"DEVC\0\0\0\4" + bytes([second] * 4) for second in range(2)]


def write_with_data(source, path, codec):
    """Write a copy of the video and audio of a file with a data track of two packets."""
    with av.open(str(source)) as old, av.open(str(path), "w") as new:
        streams = {
            s.index: new.add_stream_from_template(s)
            for s in (*old.streams.video, *old.streams.audio)
        }
        data = new.add_data_stream(codec)
        data.time_base, data.metadata["handler_name"] = MS, "GoPro MET"
        packets = [
            packet
            for packet in old.demux(list(old.streams.video) + list(old.streams.audio))
            if packet.size
        ]
        for packet in packets:
            packet.stream = streams[packet.stream_index]
            new.mux(packet)
        for second, payload in enumerate(GPMF):
            packet = av.Packet(payload)
            packet.stream, packet.time_base, packet.duration = data, MS, 1000
            packet.pts = packet.dts = 1000 * second
            new.mux(packet)
    return path


def data_of(path):
    """Return codec, handler and packets (s, bytes) of the data tracks, as FFmpeg reads them."""
    with av.open(str(path)) as container:
        start_s = float(container.start_time / av.time_base) if path.suffix == ".ts" else 0.0
        packets = {stream.index: [] for stream in container.streams.data}
        for packet in container.demux():
            if packet.size and packet.stream_index in packets:
                packets[packet.stream_index].append(
                    (float(packet.pts * packet.time_base) - start_s, bytes(packet))
                )
        return [
            (stream.name, stream.metadata.get("handler_name"), packets[stream.index])
            for stream in container.streams.data
        ]


@pytest.mark.parametrize(
    ("suffix", "codec", "target", "message"),
    [
        (".mp4", "bin_data", ".mp4", ""),
        (
            ".mp4",
            "bin_data",
            ".mkv",
            "b.mkv: dropped data track 2 (GoPro MET); .mp4 supports GPMF telemetry",
        ),
        (".mp4", "bin_data", ".mov", "b.mov: dropped data track 2 (GoPro MET)"),
        (".mp4", "bin_data", ".ts", "b.ts: dropped data track 2 (GoPro MET)"),
        (".ts", "klv", ".ts", ""),
        (".ts", "timed_id3", ".ts", ""),
        (
            ".ts",
            "klv",
            ".mp4",
            "b.mp4: dropped data track 2 (klv); .mp4 supports GPMF telemetry, .ts supports KLV",
        ),
        (".ts", "bin_data", ".mp4", "a.ts: dropped data track 2 (bin_data)"),
        (".ts", "bin_data", ".ts", "a.ts: dropped data track 2 (bin_data)"),
    ],
)
def test_lost_data_tracks_are_reported(tmp_path, suffix, codec, target, message):
    write_film(tmp_path / f"film{suffix}", languages=("eng",), subtitles=False)
    source = write_with_data(tmp_path / f"film{suffix}", tmp_path / f"a{suffix}", codec)
    (before,) = data_of(source)
    assert (before[0], len(before[2])) == (codec, 2)
    notes = process_file(source, tmp_path / f"b{target}")
    after = data_of(tmp_path / f"b{target}")
    if message:
        assert sum(message in note for note in notes) == 1
        assert not after
        return
    assert not notes
    assert after[0][:2] == before[:2]
    assert [payload for _, payload in after[0][2]] == GPMF
    # The start of an MPEG-TS file is that of its audio, which AC-3 priming shifts by 5.3 ms.
    np.testing.assert_allclose([t for t, _ in after[0][2]], [t for t, _ in before[2]], atol=0.006)
    if suffix == ".mp4":
        process_file(source, tmp_path / "cut.mp4", start_s=0.5)
        assert data_of(tmp_path / "cut.mp4")[0][2] == [(0.5, GPMF[1])]


def test_data_tracks_of_unknown_kinds_are_named(tmp_path):
    """Timed metadata of phones (mebx), which FFmpeg can read and not write."""
    write_film(tmp_path / "film.mp4", languages=("eng",), subtitles=False)
    source = write_with_data(tmp_path / "film.mp4", tmp_path / "a.mp4", "bin_data")
    data = source.read_bytes()
    assert data.count(b"gpmd") == 2
    source.write_bytes(data.replace(b"gpmd", b"mebx"))
    notes = process_file(source, tmp_path / "b.mp4")
    assert [note.split(": ", 1)[1] for note in notes] == ["dropped data track 2 (GoPro MET)"]
    assert not data_of(tmp_path / "b.mp4")


@pytest.mark.parametrize("target", [".mkv", ".mp4", ".mov"])
@pytest.mark.parametrize("start_ms", [1200, 40])
def test_start_time_is_preserved(tmp_path, start_ms, target):
    write_film(tmp_path / "a.mkv", start_ms)
    process_file(tmp_path / "a.mkv", tmp_path / f"b{target}")
    with av.open(str(tmp_path / "a.mkv")) as before, av.open(str(tmp_path / f"b{target}")) as after:
        assert before.start_time == start_ms * 1000
        for a, b in zip(before.streams.video + before.streams.audio, after.streams, strict=False):
            primed = (
                0 if a.type == "video" else Fraction(256, 48000)
            )  # AC-3 starts earlier, which MP4 counts
            assert abs(b.start_time * b.time_base - a.start_time * a.time_base) <= primed + MS
        times = [float(frame.time) for frame in after.decode(video=0)]
    np.testing.assert_allclose(times, 0.04 * np.arange(50) + start_ms / 1000, atol=1e-3)
    chapters, *_, texts = tracks_of(tmp_path / f"b{target}")
    assert chapters[1][0] == pytest.approx(1 + start_ms / 1000)
    np.testing.assert_allclose(
        [t[0] for t in texts], [0.2 + start_ms / 1000, 1.0 + start_ms / 1000], atol=2e-3
    )


def test_part_starts_at_zero_with_chapters_and_subtitles(tmp_path):
    write_film(tmp_path / "a.mkv", 1200)
    process_file(tmp_path / "a.mkv", tmp_path / "b.mkv", start_s=0.8, duration_s=1.0)
    chapters, _, _, texts = tracks_of(tmp_path / "b.mkv")
    np.testing.assert_allclose([c[:2] for c in chapters], [(0, 0.2), (0.2, 1.0)], atol=1e-3)
    np.testing.assert_allclose([t[0] for t in texts], [0.2], atol=1e-3)
    with av.open(str(tmp_path / "b.mkv")) as container:
        assert container.start_time < 2000


def test_dewarping_keeps_tracks(tmp_path):
    write_film(tmp_path / "a.mkv", 1200)
    om.dewarp_video(
        tmp_path / "a.mkv",
        tmp_path / "b.mp4",
        camera=BALL,
        view=om.screens.Cylinder((64, 32), -40.0, 20.0),
    )
    chapters, languages, _, texts = tracks_of(tmp_path / "b.mp4")
    assert ([c[2] for c in chapters], languages) == (["First", "Second"], ["deu", "eng"])
    assert [text for *_, text in texts] == ["Hello there", "Second\nline"]


def test_video_of_another_size_is_rejected_before_decoding(tmp_path):
    write_film(tmp_path / "a.mkv")
    camera = replace(BALL, image_size=(SIZE[1], SIZE[0]))
    size = f"{SIZE[0]} x {SIZE[1]}"
    with pytest.raises(InvalidParameter, match=f"the video must have the .*; got {size} px"):
        om.dewarp_video(
            tmp_path / "a.mkv",
            tmp_path / "b.mkv",
            camera=camera,
            view=om.screens.Cylinder((64, 32), -40.0, 20.0),
        )
    assert not (tmp_path / "b.mkv").exists()


def test_losses_are_reported(tmp_path):
    write_film(tmp_path / "a.mkv", languages=("deu", "gsw"))
    (note,) = process_file(tmp_path / "a.mkv", tmp_path / "b.ts")
    assert (
        "b.ts: dropped the titles of tracks and 2 chapters and 1 subtitle track; .mkv supports them"
        in note
    )
    (note,) = process_file(tmp_path / "a.mkv", tmp_path / "b.mov")
    assert "dropped the language 'gsw'" in note
    assert process_file(tmp_path / "a.mkv", tmp_path / "b.mp4") == []


def test_dropped_tracks_are_reported(tmp_path):
    write_film(tmp_path / "a.mkv", subtitles=False)
    with av.open(str(tmp_path / "a.mkv")) as film, av.open(str(tmp_path / "b.mkv"), "w") as out:
        source = film.streams.video[0]
        copies = [out.add_stream_from_template(source) for _ in range(3)]
        out.add_attachment("font.ttf", "font/ttf", b"no font")
        for packet in film.demux(source):
            for copy in copies if packet.size else ():
                own = av.Packet(bytes(packet))
                own.pts, own.dts, own.time_base = packet.pts, packet.dts, packet.time_base
                own.stream, own.is_keyframe = copy, packet.is_keyframe
                out.mux(own)
    (note,) = process_file(tmp_path / "b.mkv", tmp_path / "c.mkv")
    assert "b.mkv: dropped 1 attachment and 2 further video tracks" in note


# -- Mastering-display metadata of HDR videos ------------------------------------------------------

GRADED = "master-display=G(13250,34500)B(7500,3000)R(34000,16000)WP(15635,16450)L(10000000,1):max-cll=1000,400"
P3 = [0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.3127, 0.329]
"""Red, green, blue and white of DCI-P3 with D65."""


@pytest.fixture
def graded(tmp_path):
    with av.open(str(tmp_path / "in.mp4"), "w") as container:
        stream = container.add_stream(
            "libx265", rate=25, options={"x265-params": f"{GRADED}:log-level=none"}
        )
        stream.width, stream.height, stream.pix_fmt = 128, 96, "yuv420p10le"
        context = stream.codec_context
        context.color_range, context.colorspace, context.color_primaries, context.color_trc = (
            1,
            9,
            9,
            16,
        )
        for i in range(3):
            frame = av.VideoFrame(128, 96, "yuv420p10le")
            for plane in frame.planes:
                np.frombuffer(plane, np.uint16)[:] = 400
            frame.pts = i
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return tmp_path / "in.mp4"


def write_copy(source, out, codec):
    with VideoReader(source) as reader:
        assert not reader.notes
        writer = VideoWriter.from_source(reader, out, codec=codec)
        process(reader.items(), writer, lambda frame, time_s: frame, "frame")
    return writer.notes


@pytest.mark.parametrize("codec", ["libx265", "libx264", "libsvtav1"])
def test_mastering_display_is_preserved(graded, tmp_path, codec):
    assert not write_copy(graded, tmp_path / "out.mp4", codec)
    with av.open(str(tmp_path / "out.mp4")) as container:
        beside = next(container.decode(video=0)).side_data
        mastering = struct.unpack("22i", bytes(beside.get(SideData.MASTERING_DISPLAY_METADATA)))
        light = struct.unpack("2I", bytes(beside.get(SideData.CONTENT_LIGHT_LEVEL)))
    values = np.array(mastering[:20:2]) / np.array(mastering[1:20:2])
    np.testing.assert_allclose(values[:8], P3, atol=2e-5)
    np.testing.assert_allclose(
        values[8:], [1e-4, 1000], rtol=0.3
    )  # AV1 stores the minimum in units of 1/16384
    assert light == (1000, 400)


def test_lost_mastering_display_is_reported(graded, tmp_path):
    assert (
        "out.mkv: HDR metadata of the mastering display are lost; use --set video.codec=ffv1 with"
        in write_copy(graded, tmp_path / "out.mkv", "ffv1")[0]
    )
    ball = ["--ball", "63.5,47.5,40,260", "--view", "perspective", "--size", "64x48"]
    run = omnimirror("dewarp", graded, *ball, "-o", tmp_path / "%d.png")
    assert "%d.png: HDR metadata of the mastering display are lost" in run.stderr
    beside = {
        SideData.DYNAMIC_HDR_PLUS: object(),
        SideData.DOVI_METADATA: object(),
        SideData.DOVI_RPU_BUFFER: 1,
    }
    assert dynamic_hdr_names(beside) == "HDR10+ and Dolby Vision"
    assert not dynamic_hdr_names({SideData.CONTENT_LIGHT_LEVEL: object()})


@pytest.mark.parametrize("pixel_format", [None, "yuv420p10le"])
def test_stream_keeps_colour_coding_and_display(graded, tmp_path, pixel_format):
    """A file given by its URL is read as a stream."""
    notes = []
    om.dewarp_video(
        graded.as_uri(),
        tmp_path / "out.mp4",
        camera=om.MirrorBall(
            centre_px=(63.5, 47.5), rim_radius_px=40.0, field_deg=260.0, image_size=(128, 96)
        ),
        view=om.screens.Plane((64, 48), tilt_deg=-30.0),
        on_warning=notes.append,
        settings=om.VideoSettings(duration_s=0.01, pixel_format=pixel_format),
    )
    with av.open(str(tmp_path / "out.mp4")) as container:
        frame = next(container.decode(video=0))
    assert (frame.color_trc, frame.color_primaries, frame.colorspace) == (16, 9, 9)
    assert struct.unpack("2I", bytes(frame.side_data.get(SideData.CONTENT_LIGHT_LEVEL))) == (
        1000,
        400,
    )
    assert any("HDR with 8 bits causes banding" in note for note in notes) == (pixel_format is None)


def test_partial_mastering_display_is_written_if_supported():
    assert MasteringDisplay(light=(1000, 400)).options("libx264") == "cll=1000,400"
    assert MasteringDisplay(primaries=(Fraction(1, 3),) * 8).options("libx265") is None
    assert MasteringDisplay().options("libx265") == ""

"""Chapters, subtitles, languages and start time, as read by FFmpeg from the output."""

import struct
from fractions import Fraction

import av
import numpy as np
import pytest

import omnimirror as om
from omnimirror.io.processing import process
from omnimirror.io.video.reader import VideoReader
from omnimirror.io.video.writer import VideoWriter
from tests.io.synthetic import SIZE, tone

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


def make_film(path, begins_ms=0, seconds=2, languages=("deu", "eng"), subtitles=True):
    """Write frames, two audio tracks, text subtitles and chapters, all delayed by begins_ms."""
    with av.open(str(path), "w") as container:
        video = container.add_stream("libx264", rate=25, options={"preset": "ultrafast", "bf": "0"})
        video.width, video.height, video.pix_fmt = *SIZE, "yuv420p"
        sounds = [container.add_stream("ac3", rate=48000, layout="mono") for _ in languages]
        for sound, language in zip(sounds, languages, strict=True):
            sound.metadata["language"] = language
        sounds[-1].metadata["title"] = "Comment"
        kind = "mov_text" if path.suffix in (".mp4", ".mov") else "subrip"
        words = container.add_stream(kind) if subtitles else None
        if words:
            words.codec_context.subtitle_header, words.codec_context.time_base = HEADER, MS
            words.time_base, words.metadata["language"] = MS, "fra"
        container.set_chapters([
            {"id": i, "start": a + begins_ms, "end": b + begins_ms, "time_base": MS, "metadata": {"title": title}}
            for i, (a, b, title) in enumerate(CHAPTERS, 1)
        ])  # fmt: skip
        for number in range(25 * seconds):
            frame = av.VideoFrame.from_ndarray(np.full((SIZE[1], SIZE[0], 3), 5 * number % 250, np.uint8), "rgb24")
            frame.pts, frame.time_base = number * 40 + begins_ms, MS
            container.mux(video.encode(frame))
        container.mux(video.encode(None))
        for start, duration, text in TEXTS if words else ():
            data = text.encode()
            packet = av.Packet(struct.pack(">H", len(data)) + data if kind == "mov_text" else data)
            packet.stream, packet.time_base = words, MS
            packet.pts = packet.dts = start + begins_ms
            packet.duration = duration
            container.mux(packet)
        for sound in sounds:
            for sample in range(0, 48000 * seconds, 1536):
                frame = tone(sample, 1536)
                frame.pts = sample + begins_ms * 48
                container.mux(sound.encode(frame))
            container.mux(sound.encode(None))
    return path


def through(source, path, **cut):
    with VideoReader(source, **cut) as reader:
        writer = VideoWriter.like(reader, path)
        process(reader.items(), writer, lambda frame, time_s: frame, "frame")
        return [*reader.notes, *writer.notes]


def tracks_of(path):
    """Return chapters (s), languages, titles, and texts with their times, as FFmpeg reads them."""
    with av.open(str(path)) as container:
        chapters = [
            (float(c["start"] * c["time_base"]), float(c["end"] * c["time_base"]), c["metadata"]["title"])
            for c in container.chapters()
        ]
        languages = [stream.language for stream in container.streams.audio]
        titles = [stream.metadata.get("title", stream.metadata.get("name")) for stream in container.streams.audio]
        texts = []
        for stream in container.streams.subtitles:
            assert stream.language == "fra"
            for packet in container.demux(stream):
                for text in stream.codec_context.decode2(packet) or () if packet.size else ():
                    words = text.dialogue.decode() if isinstance(text.dialogue, bytes) else text.dialogue
                    if words:
                        at = float(packet.pts * packet.time_base)
                        texts.append((at, float(packet.duration * packet.time_base), words.strip()))
        return chapters, languages, titles, texts


@pytest.mark.parametrize("target", [".mkv", ".mp4", ".m4v", ".mov"])
@pytest.mark.parametrize("source", [".mkv", ".mp4"])
def test_tracks_are_kept(tmp_path, source, target):
    make_film(tmp_path / f"a{source}")
    notes = through(tmp_path / f"a{source}", tmp_path / f"b{target}")
    assert len(notes) == (target == ".m4v")
    before, after = tracks_of(tmp_path / f"a{source}"), tracks_of(tmp_path / f"b{target}")
    assert before[0] == [(0, 1, "First"), (1, 2, "Second")]
    np.testing.assert_allclose([c[:2] for c in after[0]], [c[:2] for c in before[0]], atol=1e-3)
    assert [c[2] for c in after[0]] == ["First", "Second"]
    assert after[1] == (["ger", "eng"] if target == ".mov" else ["deu", "eng"])
    if target == ".m4v":
        assert "not kept are the titles of tracks" in notes[0]
    else:
        assert after[2] == [None, "Comment"]
    assert [text for *_, text in after[3]] == ["Hello there", "Second\nline"]
    # Matroska starts with the priming of AC-3, 5.3 ms, which MP4 counts as negative.
    np.testing.assert_allclose([t[:2] for t in after[3]], [(0.2, 0.7), (1.0, 0.5)], atol=0.006)


@pytest.mark.parametrize("target", [".mkv", ".mp4", ".mov"])
@pytest.mark.parametrize("begins_ms", [1200, 40])
def test_the_time_of_the_beginning_is_kept(tmp_path, begins_ms, target):
    make_film(tmp_path / "a.mkv", begins_ms)
    through(tmp_path / "a.mkv", tmp_path / f"b{target}")
    with av.open(str(tmp_path / "a.mkv")) as before, av.open(str(tmp_path / f"b{target}")) as after:
        assert before.start_time == begins_ms * 1000
        for a, b in zip(before.streams.video + before.streams.audio, after.streams, strict=False):
            primed = 0 if a.type == "video" else Fraction(256, 48000)  # AC-3 starts earlier, which MP4 counts
            assert abs(b.start_time * b.time_base - a.start_time * a.time_base) <= primed + MS
        times = [float(frame.time) for frame in after.decode(video=0)]
    np.testing.assert_allclose(times, 0.04 * np.arange(50) + begins_ms / 1000, atol=1e-3)
    chapters, *_, texts = tracks_of(tmp_path / f"b{target}")
    assert chapters[1][0] == pytest.approx(1 + begins_ms / 1000)
    np.testing.assert_allclose([t[0] for t in texts], [0.2 + begins_ms / 1000, 1.0 + begins_ms / 1000], atol=2e-3)


def test_a_part_begins_at_zero_with_its_chapters_and_texts(tmp_path):
    make_film(tmp_path / "a.mkv", 1200)
    through(tmp_path / "a.mkv", tmp_path / "b.mkv", start_s=0.8, duration_s=1.0)
    chapters, _, _, texts = tracks_of(tmp_path / "b.mkv")
    np.testing.assert_allclose([c[:2] for c in chapters], [(0, 0.2), (0.2, 1.0)], atol=1e-3)
    np.testing.assert_allclose([t[0] for t in texts], [0.2], atol=1e-3)
    with av.open(str(tmp_path / "b.mkv")) as container:
        assert container.start_time < 2000


def test_dewarping_keeps_them(tmp_path):
    make_film(tmp_path / "a.mkv", 1200)
    om.dewarp_video(
        tmp_path / "a.mkv", tmp_path / "b.mp4", camera=BALL, view=om.screens.Cylinder((64, 32), -40.0, 20.0)
    )
    chapters, languages, _, texts = tracks_of(tmp_path / "b.mp4")
    assert ([c[2] for c in chapters], languages) == (["First", "Second"], ["deu", "eng"])
    assert [text for *_, text in texts] == ["Hello there", "Second\nline"]


def test_losses_are_reported(tmp_path):
    make_film(tmp_path / "a.mkv", languages=("deu", "gsw"))
    (note,) = through(tmp_path / "a.mkv", tmp_path / "b.ts")
    assert "not kept are the titles of tracks and 2 chapters and 1 subtitle track; .mkv keeps them" in note
    (note,) = through(tmp_path / "a.mkv", tmp_path / "b.mov")
    assert "not kept are the language 'gsw'" in note
    assert through(tmp_path / "a.mkv", tmp_path / "b.mp4") == []


def test_tracks_that_nothing_keeps_are_named(tmp_path):
    make_film(tmp_path / "a.mkv", subtitles=False)
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
    (note,) = through(tmp_path / "b.mkv", tmp_path / "c.mkv")
    assert "not kept are 1 attachment and 2 further video tracks" in note

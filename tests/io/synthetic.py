"""Test videos: images that encode their number, and a tone."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av
import numpy as np

SIZE = (64, 48)
RATE = 25
SOUND_RATE = 48000


def grey_of(number: int) -> int:
    """Return the luma of a frame, distinguishable from that of its neighbours after coding."""
    return 20 + 23 * (number % 9)


def make_video(
    path: Path,
    frames: int = 50,
    rotation_deg: int = 0,
    colour_range: int = 1,
    colour_space: int = 1,
    times: list[int] | None = None,
    with_audio: bool = True,
    gop: int = 12,
    **metadata: str,
) -> Path:
    """Write H.264 at 25 frames/s (or ``times`` in 1/25 s), BT.709, with a 440 Hz sine in AAC."""
    with av.open(str(path), "w") as container:
        container.metadata.update(metadata)
        video = container.add_stream(
            "libx264", rate=RATE, options={"g": str(gop), "preset": "ultrafast"}
        )
        video.width, video.height, video.pix_fmt = *SIZE, "yuv420p"
        context = video.codec_context
        context.color_range, context.colorspace = colour_range, colour_space
        context.color_primaries = context.color_trc = 1
        if rotation_deg:
            video.set_display_rotation(rotation_deg)
        sound = container.add_stream("aac", rate=SOUND_RATE, layout="mono") if with_audio else None
        samples = 0
        for i, time in enumerate(times or range(frames)):
            container.mux(video.encode(_frame(i, time, colour_range, colour_space)))
            while sound and samples * RATE < (time + 1) * SOUND_RATE:
                container.mux(sound.encode(tone(samples)))
                samples += 1024
        container.mux(video.encode(None))
        if sound:
            container.mux(sound.encode(None))
    return path


def _frame(number: int, time: int, colour_range: int, colour_space: int) -> av.VideoFrame:
    frame = av.VideoFrame(*SIZE, "yuv420p")
    for plane, value in zip(frame.planes, (grey_of(number), 110, 150), strict=True):
        np.frombuffer(plane, np.uint8)[:] = value
    frame.pts, frame.time_base = time, Fraction(1, RATE)
    frame.color_range, frame.colorspace = colour_range, colour_space
    return frame


def tone(first: int, samples: int = 1024) -> av.AudioFrame:
    wave = 0.5 * np.sin(2 * np.pi * 440 * (first + np.arange(samples)) / SOUND_RATE)
    frame = av.AudioFrame.from_ndarray(wave.astype(np.float32)[None], "fltp", "mono")
    frame.sample_rate, frame.pts, frame.time_base = SOUND_RATE, first, Fraction(1, SOUND_RATE)
    return frame


def sound_of(path: Path) -> list[tuple[Fraction, bytes]]:
    """Return times (s) and bytes of the audio packets, by PyAV only."""
    with av.open(str(path)) as container:
        return [(p.pts * p.time_base, bytes(p)) for p in container.demux(audio=0) if p.size]


def images_of(path: Path) -> list[av.VideoFrame]:
    """Return the frames, by PyAV only."""
    with av.open(str(path)) as container:
        return list(container.decode(video=0))


def number_of(frame: av.VideoFrame) -> int:
    """Return the frame number, modulo 9, from the luma."""
    return round((np.frombuffer(frame.planes[0], np.uint8)[0] - 20) / 23)


def luma_of(frame: av.VideoFrame) -> int:
    return int(np.frombuffer(frame.planes[0], np.uint8)[0])

"""Encoding of a recording as an H.264 video, with optional overlays."""

import itertools
import os
import statistics
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np

from pilot.arrays import Frame
from pilot.data.frames import UnreadableImage, read_frame_as_is
from pilot.data.log_format import LOG_NAME, RANGES, LogLine, read_log, time_of
from pilot.files import move_when_done
from pilot.progress import ProgressBar, no_bar
from pilot.video.overlays import draw_path, draw_speed, draw_wheel

DEFAULT_FPS = 15.0  # if the frames' names contain no time stamps
SCALE_TO = 640  # pixels, minimum size at which overlays are legible
GROUP = 16  # frames that a thread decorates at a time
LARGEST = 16384  # pixels, the most that H.264 takes


class NoFramesError(ValueError):
    """There are no readable frames; the message contains the folder and what to do."""


@dataclass(frozen=True)
class LogEntry:
    """Steering (-1..1) and speed (mph) of a frame in the driving log; None where the log has no plausible value."""

    steering: float | None = None
    speed: float | None = None


@dataclass(frozen=True)
class Overlays:
    """Overlays to be drawn on the frames.

    Attributes:
        wheel: a steering wheel.
        speed: the speed in mph.
        path: the path on the road that results from the steering.
        saliency: function that returns frames with the network's saliency drawn into them; None: no saliency. It is
            called in several threads at the same time.
    """

    wheel: bool = False
    speed: bool = False
    path: bool = False
    saliency: Callable[[Sequence[Frame]], list[Frame]] | None = None

    @property
    def logged(self) -> bool:
        """Whether there is any overlay that shows values of the log."""
        return self.wheel or self.speed or self.path

    @property
    def any(self) -> bool:
        """Whether there is any overlay."""
        return self.logged or self.saliency is not None


@dataclass
class ClipResult:
    """Number of frames in a clip and of unreadable frames left out; duration of the clip in s."""

    frames: int = 0
    unreadable: int = 0
    seconds: float = 0.0


def find_frames(folder: Path) -> list[Path]:
    """Return the images of a recording, sorted by name: those in the folder, else those of the centre camera in IMG/.

    Raises:
        NoFramesError: the folder does not exist or contains no images.
    """
    if not folder.is_dir():
        raise NoFramesError(f"{folder}: no such folder. Record a drive first: python drive.py model.pt {folder}")
    pictures = [path for path in folder.iterdir() if path.suffix.lower() in (".jpg", ".jpeg", ".png")]
    if not pictures and (folder / "IMG").is_dir():
        pictures = [path for path in (folder / "IMG").iterdir() if path.name.startswith("center")]
    if not pictures:
        raise NoFramesError(f"{folder}: no frames (*.jpg) in it. Record one first: python drive.py model.pt {folder}")
    return sorted(pictures, key=lambda path: path.name)


def frame_rate(frames: list[Path]) -> float:
    """Return the frames per second (at most 60), from the median interval of the time stamps in the names."""
    times = [time_of(path.name) for path in frames]
    gaps = [after - before for before, after in itertools.pairwise(times) if 0 < after - before < 1]
    return min(round(1 / statistics.median(gaps), 2), 60.0) if gaps else DEFAULT_FPS


def read_log_entries(folder: Path) -> dict[str, LogEntry]:
    """Return the values in the recording's log by the name of the centre image; empty without a log.

    Raises:
        ValueError: the log cannot be parsed, or its header has no steering column.
    """
    log = folder / LOG_NAME
    if not log.is_file():
        return {}
    try:
        lines = list(read_log(log))
    except ValueError as error:
        raise ValueError(f"{log}: {error}. Mend it, or leave out --wheel, --speed and --path") from error
    return {
        line.images["center"]: LogEntry(_value(line, "steering"), _value(line, "speed"))
        for line in lines
        if "center" in line.images
    }


def _value(line: LogLine, name: str) -> float | None:
    try:
        value = float(line.values[name])
    except (KeyError, ValueError):
        return None
    low, high = RANGES[name]
    return value if low <= value <= high else None  # a NaN is nowhere between


def make_clip(
    folder: Path,
    target: Path,
    *,
    fps: float | None = None,
    overlays: Overlays | None = None,
    progress: ProgressBar[Path] = no_bar,
) -> ClipResult:
    """Encode a recording as a video; unreadable frames are left out and counted.

    The clip is written under a temporary name and renamed at the end. All frames are scaled to the size of the first,
    which is enlarged to at least 640 pixels if there are overlays.

    Args:
        folder: of the recording.
        target: video file to write (mp4).
        fps: frames per second; None: from the time stamps.
        overlays: None: no overlays.
        progress: progress bar for the frames.

    Raises:
        NoFramesError: the folder does not exist, or contains no readable frames.
        ValueError: `target` is no .mp4; the overlays need the log, and it cannot be parsed.
        OSError: the video cannot be written.
    """
    if target.suffix.lower() != ".mp4":  # it would replace a frame, a log or a model
        raise ValueError(f"--out {target}: a clip is an .mp4 file; give it a name that ends in .mp4")
    frames, result = find_frames(folder), ClipResult()
    rate, overlays = fps or frame_rate(frames), overlays or Overlays()
    log_entries = read_log_entries(folder) if overlays.logged else {}
    pictures = _pictures(progress(frames, len(frames), "encoding"), result, log_entries, overlays)
    first = next(pictures, None)
    if first is None:
        raise NoFramesError(f"{folder}: none of its {len(frames)} images can be read; record the drive again")
    with move_when_done(target) as temporary, av.open(str(temporary), "w", format="mp4") as container:
        _encode(container, rate, first, pictures)
    result.seconds = result.frames / rate
    return result


def _pictures(
    frames: Iterable[Path], result: ClipResult, log_entries: dict[str, LogEntry], overlays: Overlays
) -> Iterator[Frame]:
    """Yield the decorated frames in order; several threads work ahead, a group of frames each."""
    cores = os.cpu_count() or 1
    with ThreadPoolExecutor(cores) as executor:
        waiting: deque[Future[list[Frame | None]]] = deque()
        for group in _grouped(frames):
            waiting.append(executor.submit(_decorate_group, group, log_entries, overlays))
            if len(waiting) > cores:
                yield from _finished(waiting.popleft(), result)
        while waiting:
            yield from _finished(waiting.popleft(), result)


def _grouped(frames: Iterable[Path]) -> Iterator[list[Path]]:
    iterator = iter(frames)
    while group := list(itertools.islice(iterator, GROUP)):
        yield group


def _finished(group: "Future[list[Frame | None]]", result: ClipResult) -> Iterator[Frame]:
    for frame in group.result():
        if frame is None:
            result.unreadable += 1
        else:
            result.frames += 1
            yield frame


def _decorate_group(paths: list[Path], log_entries: dict[str, LogEntry], overlays: Overlays) -> list[Frame | None]:
    """Return frames with overlays; None for those that cannot be read."""
    read = [_read_or_none(path) for path in paths]
    frames = [frame for frame in read if frame is not None]
    if overlays.saliency and frames:
        frames = overlays.saliency(frames)
    remaining = iter(frames)
    return [
        None if frame is None else decorate(next(remaining), log_entries.get(path.name, LogEntry()), overlays)
        for path, frame in zip(paths, read, strict=True)
    ]


def _read_or_none(path: Path) -> Frame | None:
    try:
        return _read_frame(path)
    except UnreadableImage:
        return None


def _read_frame(path: Path) -> Frame:
    frame = read_frame_as_is(path)
    if max(frame.shape[:2]) > LARGEST:
        raise UnreadableImage(path, "image too large")
    return frame


def decorate(frame: Frame, log_entry: LogEntry, overlays: Overlays) -> Frame:
    """Return a frame with the overlays of the log, enlarged so that they are legible; unchanged without overlays."""
    if not overlays.any:
        return frame
    scale = max(SCALE_TO / max(frame.shape[:2]), 1)
    picture = _resize(frame, round(frame.shape[1] * scale), round(frame.shape[0] * scale))
    if overlays.path and log_entry.steering is not None:
        draw_path(picture, log_entry.steering)
    if overlays.wheel and log_entry.steering is not None:
        draw_wheel(picture, log_entry.steering)
    return draw_speed(picture, log_entry.speed) if overlays.speed and log_entry.speed is not None else picture


def _encode(container: av.container.OutputContainer, rate: float, first: Frame, rest: Iterator[Frame]) -> None:
    """Encode frames as H.264 with 4:2:0 chroma subsampling, which all browsers can play."""
    stream = container.add_stream("libx264", rate=Fraction(rate).limit_denominator(1000))
    height, width = (size - size % 2 for size in first.shape[:2])  # 4:2:0 needs even sizes
    stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
    stream.options = {"crf": "20", "preset": "fast"}
    for picture in itertools.chain([first], rest):
        fitting = _resize(picture, first.shape[1], first.shape[0])[:height, :width]
        image = av.VideoFrame.from_ndarray(np.ascontiguousarray(fitting), format="rgb24")
        container.mux(stream.encode(image))
    container.mux(stream.encode())


def _resize(frame: Frame, width: int, height: int) -> Frame:
    if frame.shape[:2] == (height, width):
        return frame
    method = cv2.INTER_CUBIC if width > frame.shape[1] else cv2.INTER_AREA
    return np.asarray(cv2.resize(frame, (width, height), interpolation=method), np.uint8)

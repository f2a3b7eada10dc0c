"""Clips of recordings: python video.py run1 (see --help)."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from pilot import cli, process_settings
from pilot.terminal import show

if TYPE_CHECKING:
    from pilot.video.clip import Overlays

PROGRAM = cli.program("video.py")


@dataclass(frozen=True)
class ClipConfig:
    """Make an H.264 video of a folder of frames; that of run1 is run1.mp4."""

    run: tyro.conf.Positional[Path]
    """Folder with the frames, as recorded by drive.py or by Udacity's original drive.py."""
    out: Path | None = None
    """Video file to write. Default: the folder's name with .mp4."""
    fps: float | None = None
    """Frames per second, up to 240. Default: according to the time stamps in the frames' names."""
    wheel: bool = False
    """Draw a steering wheel with the recorded steering."""
    speed: bool = False
    """Write the speed in mph."""
    path: bool = False
    """Draw the path on the road that results from the steering."""
    saliency: Path | None = None
    """Model file whose saliency to draw: the image regions that activate its network."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Make a clip with the options in `arguments` (default: sys.argv), and return the exit code."""
    return cli.run(PROGRAM, lambda: make(tyro.cli(ClipConfig, prog=PROGRAM, args=arguments)))


def make(config: ClipConfig) -> None:
    """Make the clip, and print its path, length and the number of unreadable images.

    Raises:
        ValueError, OSError: the clip cannot be made; the message says why and what to do.
        KeyboardInterrupt: on Ctrl-C; no clip is written.
    """
    from pilot.progress import terminal_bar
    from pilot.video.clip import make_clip, read_log_entries

    process_settings.for_images()
    if config.fps is not None and not 0.01 <= config.fps <= 240:
        raise ValueError(f"--fps {config.fps:g}: must lie between 0.01 and 240")
    target = config.out or config.run.resolve().with_name(config.run.resolve().name + ".mp4")
    drawn = overlays(config)
    if drawn.logged and config.run.is_dir() and not read_log_entries(config.run):
        show(f"{config.run}: there is no driving_log.csv with it, so wheel, speed and path cannot be drawn")
    try:
        result = make_clip(config.run, target, fps=config.fps, overlays=drawn, progress=terminal_bar)
    except KeyboardInterrupt:
        raise KeyboardInterrupt("no clip was written") from None
    left_out = f"; {result.unreadable} pictures could not be read and were left out" if result.unreadable else ""
    show(f"{target}: {result.frames} frames, {result.seconds:.1f} s{left_out}")


def overlays(config: ClipConfig) -> "Overlays":
    """Return the overlays that the options select.

    Raises:
        UnusableModel: the model file is missing, damaged, or not a model of this program.
    """
    from pilot.video.clip import Overlays

    glow = None
    if config.saliency:
        from pilot.model.checkpoint import load_model
        from pilot.video.glow import Glow

        process_settings.for_driving()
        glow = Glow(load_model(config.saliency).network)
    return Overlays(config.wheel, config.speed, config.path, glow)

"""Make a clip of a recorded drive: python video.py run1 (see --help)."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from pilot import cli, process_settings

if TYPE_CHECKING:
    from pilot.video.clip import Overlays

PROGRAM = cli.program("video.py")


@dataclass(frozen=True)
class ClipConfig:
    """Make a video (H.264) of a folder of frames; run1 becomes run1.mp4."""

    run: tyro.conf.Positional[Path]
    """The folder with the frames, as drive.py (or the simulator's original server) recorded it."""
    out: Path | None = None
    """The video to write; without it, the folder's name with .mp4."""
    fps: float | None = None
    """Frames a second; without it, as the time stamps of the frames have it."""
    wheel: bool = False
    """Draw a steering wheel."""
    speed: bool = False
    """Write the speed."""
    path: bool = False
    """Draw the path that the steering drives, on the road."""
    saliency: Path | None = None
    """Show what the network of this model file looks at."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the clip that the options (by default the command line's) ask for; returns the exit code."""
    config = tyro.cli(ClipConfig, prog=PROGRAM, args=arguments)
    return cli.run(PROGRAM, lambda: make(config))


def make(config: ClipConfig) -> None:
    """Make the clip and say what became of it.

    Raises:
        ValueError, OSError: with the cure in the message.
    """
    from pilot.progress import terminal_bar
    from pilot.video.clip import make_clip, read_log_entries

    process_settings.for_images()
    if config.fps is not None and not 0 < config.fps <= 240:
        raise ValueError(f"--fps {config.fps:g}: must lie between 0 and 240")
    target = config.out or config.run.resolve().with_name(config.run.resolve().name + ".mp4")
    if (config.wheel or config.speed or config.path) and config.run.is_dir() and not read_log_entries(config.run):
        print(f"{config.run}: there is no driving_log.csv with it, so wheel, speed and path cannot be drawn")
    try:
        result = make_clip(config.run, target, fps=config.fps, overlays=overlays(config), progress=terminal_bar)
    except KeyboardInterrupt:
        raise KeyboardInterrupt("no clip was written") from None
    left_out = f"; {result.unreadable} pictures could not be read and were left out" if result.unreadable else ""
    print(f"{target}: {result.frames} frames, {result.seconds:.1f} s{left_out}")


def overlays(config: ClipConfig) -> "Overlays":
    """What the options ask to be drawn."""
    from pilot.video.clip import Overlays

    glow = None
    if config.saliency:
        from pilot.model.checkpoint import load_model
        from pilot.model.saliency import overlay, saliency

        network = load_model(config.saliency).network
        glow = lambda frame: overlay(frame, saliency(network, frame))  # noqa: E731
    return Overlays(config.wheel, config.speed, config.path, glow)

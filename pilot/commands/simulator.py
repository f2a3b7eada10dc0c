"""The built-in simulator: driven by hand in a window, by the expert, or by drive.py (see --help)."""

import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NoReturn

import tyro
from tqdm import tqdm

from pilot import cli, process_settings
from pilot.simulator.demonstration import DemonstrationConfig
from pilot.terminal import show
from pilot.vehicle import CAMERAS

if TYPE_CHECKING:
    from pilot.simulator.episode import CarState
    from pilot.simulator.simulator import Simulator
    from pilot.simulator.wire.client import Client

PROGRAM = cli.program("simulator.py")


@dataclass(frozen=True)
class RoadConfig:
    """Track, direction and light."""

    track: str = "lake"
    """lake, jungle, mountain, or random:SEED with any whole number."""
    reverse: bool = False
    """Drive in the other direction."""
    light: Literal["noon", "clear", "evening", "overcast"] | None = None
    """Light. Default: the track's own."""

    @property
    def name(self) -> str:
        """Name of the track with its direction, such as lake reversed."""
        return self.track + (" reversed" if self.reverse else "")


@dataclass(frozen=True)
class WindowConfig:
    """Drive by hand in a window with keyboard, mouse or gamepad; the key R records.

    Other commands: simulator.py record --help and simulator.py connect --help.
    """

    out: Path = Path("data/by_hand")
    """Folder in which the key R records."""
    road: tyro.conf.OmitArgPrefixes[RoadConfig] = field(default_factory=RoadConfig)


@dataclass(frozen=True)
class RecordConfig:
    """Let the expert drive, and record it in the format of the Unity simulator."""

    out: Path
    """Folder of the recording; an existing recording is continued."""
    road: tyro.conf.OmitArgPrefixes[RoadConfig] = field(default_factory=RoadConfig)
    demonstration: tyro.conf.OmitArgPrefixes[DemonstrationConfig] = field(default_factory=DemonstrationConfig)


@dataclass(frozen=True)
class ConnectConfig:
    """Let drive.py drive, as with the Unity simulator; start `python drive.py model.pt` before or after."""

    headless: bool = False
    """Run without a window."""
    fast: bool = False
    """Run as fast as possible instead of in real time; needs --headless, and drive.py --frame-seconds 0.04."""
    corrections: Path | None = Path("data/corrections")
    """Folder for recordings of what you steer in the window in place of drive.py; None: they are not recorded."""
    laps: float | None = None
    """Number of laps after which to stop. Default: stop on Ctrl-C."""
    host: str = "127.0.0.1"
    """Address of drive.py."""
    port: int = 4567
    """Port of drive.py."""
    road: tyro.conf.OmitArgPrefixes[RoadConfig] = field(default_factory=RoadConfig)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command in `arguments` (default: sys.argv), and return the exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    command = words.pop(0) if words and words[0] in COMMANDS else ""
    config, action = COMMANDS[command]

    def parse_and_act() -> None:
        options = tyro.cli(config, prog=f"{PROGRAM} {command}".strip(), args=words)
        process_settings.for_images()
        action(options)

    return cli.run(PROGRAM, parse_and_act, verbose=True)


def record(config: RecordConfig) -> None:
    """Record the expert driving, with a progress bar."""
    from pilot.simulator.catalogue import load_track
    from pilot.simulator.demonstrations import record as record_expert

    load_track(config.road.name)  # an unknown one is refused before the bar is drawn
    with tqdm(total=100, desc=config.road.name, unit="%", bar_format="{desc}: {percentage:3.0f}%|{bar}|") as bar:
        rows = record_expert(
            config.road.name,
            config.demonstration,
            config.out,
            light=config.road.light,
            on_progress=lambda done: bar.update(round(100 * done) - bar.n),
        )
    show(f"{rows} rows in {config.out}. To learn from them: python model.py --data {config.out}")


def drive_by_hand(config: WindowConfig) -> None:
    """Open the window for driving by hand."""
    from pilot.simulator.window.window import drive_manually

    drive_manually(config.road.name, config.road.light, config.out)


def connect(config: ConnectConfig) -> None:
    """Let drive.py drive, with or without a window, and print a summary.

    Raises:
        ValueError: an option is invalid, or there is no such track.
    """
    from pilot.simulator.referee import WHEN_LOST, Referee
    from pilot.simulator.simulator import Simulator
    from pilot.simulator.wire.client import Client

    if config.fast and not config.headless:
        raise ValueError("--fast: a window shows real time; add --headless")
    cli.check_address(config.host, config.port)
    if config.laps is not None and not 0 < config.laps < math.inf:
        raise ValueError(f"--laps {config.laps:g}: must be greater than 0, and finite")
    seen = CAMERAS if config.corrections and not config.headless else CAMERAS[:1]
    with Simulator(seen) as simulator, tqdm(total=config.laps, unit=" laps", disable=config.laps is None) as bar:
        simulator.reset(config.road.name, light=config.road.light)
        client = Client(
            simulator.episode,
            lambda _: simulator.look(only="center")["center"],
            host=config.host,
            port=config.port,
            realtime=not config.fast,
            referee=Referee(simulator.episode, laps=config.laps, rule=WHEN_LOST),
            on_tick=lambda _: show_laps(bar, simulator.episode.laps),
        )
        try:
            client.run() if config.headless else run_in_window(simulator, client, config)
        finally:
            show(f"{config.road.name}: {client.summary}")


def run_in_window(simulator: "Simulator", client: "Client", config: ConnectConfig) -> None:
    """Run the client in a window that shows its episode, and in which a person can take over."""
    from pilot.simulator.window.takeover import CorrectionCapture, Takeover
    from pilot.simulator.window.window import Window

    corrections = CorrectionCapture(config.corrections, simulator.look) if config.corrections else None
    show_progress = client.on_tick

    def on_tick(state: "CarState") -> None:
        if show_progress:
            show_progress(state)
        if corrections:
            corrections.add(state, "person" if client.manual else "model")

    client.on_tick = on_tick
    try:
        with Window(simulator.episode, simulator.renderer.scene, title=config.road.name) as window:
            window.run(Takeover(client, window.controls))
    finally:
        client.close()
        if corrections:
            corrections.close()
            if corrections.folder:
                plural = "" if corrections.number == 1 else "s"
                show(f"{corrections.number} correction{plural} ({corrections.rows} rows) in {corrections.folder}")


def show_laps(bar: "tqdm[NoReturn]", laps: float) -> None:
    """Update a progress bar of laps, in steps of at least 0.01 laps."""
    if laps - bar.n >= 0.01:
        bar.n = min(round(laps, 2), bar.total or laps)
        bar.refresh()


COMMANDS: dict[str, tuple[type[Any], Callable[[Any], None]]] = {
    "": (WindowConfig, drive_by_hand),
    "record": (RecordConfig, record),
    "connect": (ConnectConfig, connect),
    "drive": (ConnectConfig, connect),  # the former name of connect
}

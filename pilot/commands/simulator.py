"""The built-in simulator: by hand in a window, recorded, or driven by drive.py (see --help)."""

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NoReturn

import tyro
from tqdm import tqdm

from pilot import cli, process_settings
from pilot.simulator.demonstration import DemonstrationConfig

if TYPE_CHECKING:
    from pilot.simulator.simulator import Simulator
    from pilot.simulator.wire.client import Client

PROGRAM = cli.program("simulator.py")


@dataclass(frozen=True)
class RoadConfig:
    """Where to drive."""

    track: str = "lake"
    """lake, jungle, mountain, or random:SEED with any number."""
    reverse: bool = False
    """The other way round."""
    light: Literal["noon", "evening", "overcast"] | None = None
    """Light; without it the track's own."""

    @property
    def name(self) -> str:
        """The track with its direction."""
        return self.track + (" reversed" if self.reverse else "")


@dataclass(frozen=True)
class WindowConfig:
    """Drive by hand in a window: keys, mouse or gamepad; R records.

    Other commands: simulator.py record --help and simulator.py connect --help.
    """

    out: Path = Path("data/by_hand")
    """Where R records to."""
    road: tyro.conf.OmitArgPrefixes[RoadConfig] = field(default_factory=RoadConfig)


@dataclass(frozen=True)
class RecordConfig:
    """Have the expert drive, and record it as the real simulator does."""

    out: Path
    """Where the recording goes; one that is there already goes on."""
    road: tyro.conf.OmitArgPrefixes[RoadConfig] = field(default_factory=RoadConfig)
    demonstration: tyro.conf.OmitArgPrefixes[DemonstrationConfig] = field(default_factory=DemonstrationConfig)


@dataclass(frozen=True)
class ConnectConfig:
    """Be driven by drive.py, as the real simulator is: start `python drive.py model.pt` before or after."""

    headless: bool = False
    """Without a window."""
    fast: bool = False
    """As fast as it goes instead of in real time; headless only. Start drive.py with --frame-seconds 0.04."""
    laps: float | None = None
    """End after so many laps; without it Ctrl-C ends."""
    host: str = "127.0.0.1"
    """Address of drive.py."""
    port: int = 4567
    """Port of drive.py."""
    road: tyro.conf.OmitArgPrefixes[RoadConfig] = field(default_factory=RoadConfig)


def main(arguments: Sequence[str] | None = None) -> int:
    """Do as the options (by default the command line's) say; returns the exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    command = words.pop(0) if words and words[0] in COMMANDS else ""
    config, action = COMMANDS[command]
    options = tyro.cli(config, prog=f"{PROGRAM} {command}".strip(), args=words)
    process_settings.for_images()
    return cli.run(PROGRAM, lambda: action(options), verbose=True)


def record(config: RecordConfig) -> None:
    """Record the expert."""
    from pilot.simulator.demonstrations import record as record_expert

    with tqdm(total=100, desc=config.road.name, unit="%", bar_format="{desc}: {percentage:3.0f}%|{bar}|") as bar:
        rows = record_expert(
            config.road.name,
            config.demonstration,
            config.out,
            light=config.road.light,
            on_progress=lambda done: bar.update(round(100 * done) - bar.n),
        )
    print(f"{rows} moments in {config.out}. To learn from them: python model.py --data {config.out}")


def drive_by_hand(config: WindowConfig) -> None:
    """Open the window."""
    from pilot.simulator.window.window import drive_manually

    drive_manually(config.road.name, config.road.light, config.out)


def connect(config: ConnectConfig) -> None:
    """Be driven, in a window or without."""
    from pilot.simulator.referee import WHEN_LOST, Referee
    from pilot.simulator.simulator import Simulator
    from pilot.simulator.wire.client import Client

    if config.fast and not config.headless:
        raise ValueError("--fast: a window shows real time; add --headless")
    with Simulator() as simulator, tqdm(total=config.laps, unit=" laps", disable=config.laps is None) as bar:
        simulator.reset(config.road.name, light=config.road.light)
        client = Client(
            simulator.episode,
            lambda _: simulator.look()["center"],
            host=config.host,
            port=config.port,
            realtime=not config.fast,
            referee=Referee(simulator.episode, laps=config.laps, rule=WHEN_LOST),
            on_tick=lambda _: show_laps(bar, simulator.episode.laps),
        )
        try:
            client.run() if config.headless else show(simulator, client, config.road.name)
        finally:
            print(f"{config.road.name}: {client.summary}")


def show(simulator: "Simulator", client: "Client", title: str) -> None:
    """Let a window look on."""
    from pilot.simulator.window.window import Window

    try:
        with Window(simulator.episode, simulator.renderer.scene, title=title) as window:
            window.run(client)
    finally:
        client.close()


def show_laps(bar: "tqdm[NoReturn]", laps: float) -> None:
    """Move a bar on, in hundredths of a lap."""
    if laps - bar.n >= 0.01:
        bar.n = min(round(laps, 2), bar.total or laps)
        bar.refresh()


COMMANDS: dict[str, tuple[type[Any], Callable[[Any], None]]] = {
    "": (WindowConfig, drive_by_hand),
    "record": (RecordConfig, record),
    "connect": (ConnectConfig, connect),
    "drive": (ConnectConfig, connect),  # its former name
}

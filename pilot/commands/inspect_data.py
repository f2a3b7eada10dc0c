"""Page that shows recordings: python inspect_data.py data/ (see --help)."""

import logging
import sys
import webbrowser
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import tyro

from pilot import cli, process_settings
from pilot.terminal import show

PROGRAM = cli.program("inspect_data.py")


@dataclass(frozen=True)
class InspectConfig:
    """Show recordings in the browser: what they contain, which moments are suspicious; leave ranges out.

    Other commands: inspect_data.py export --help and inspect_data.py import --help, for the formats of other
    projects.
    """

    data: tyro.conf.Positional[tuple[Path, ...]] = (Path("data"),)
    """Recordings, or folders of recordings."""
    model: Path | None = None
    """Model whose steering is shown beside the label."""
    networks: bool = True
    """Also train two networks on the halves of each recording, which takes a minute: where they contradict the label,
    the moment is suspicious."""
    host: str = "127.0.0.1"
    """Address to listen on."""
    port: int = 4568
    """Port to listen on."""
    browser: bool = True
    """Open the page in the browser."""


@dataclass(frozen=True)
class ExportConfig:
    """Write a recording in the format of another project."""

    recording: tyro.conf.Positional[Path]
    """Folder of the recording."""
    out: tyro.conf.Positional[Path]
    """Folder to write."""
    format: Literal["tub", "lerobot"] = "tub"
    """tub: donkeycar's tub v2; lerobot: LeRobot's data set v3 (Parquet and videos; needs pyarrow)."""


@dataclass(frozen=True)
class ImportConfig:
    """Write a data set of donkeycar (tub v2) or LeRobot (v3, needs pyarrow) as a recording."""

    dataset: tyro.conf.Positional[Path]
    """Folder of the data set, with manifest.json (tub) or meta/info.json (LeRobot)."""
    recording: tyro.conf.Positional[Path]
    """Folder to write."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command in `arguments` (default: sys.argv), and return the exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    command = words.pop(0) if words and words[0] in COMMANDS else ""
    config, action = COMMANDS[command]
    name = f"{PROGRAM} {command}".strip()
    return cli.run(PROGRAM, lambda: action(tyro.cli(config, prog=name, args=words)), verbose=True)


def export_recording(config: ExportConfig) -> None:
    """Write a recording in the format of another project."""
    from pilot.data.driving_log import read_driving_logs
    from pilot.exchange.lerobot import write_dataset
    from pilot.exchange.tub import write_tub
    from pilot.progress import terminal_bar

    log = read_driving_logs([config.recording], terminal_bar, annotated=False)
    if len(log.recordings) > 1:
        raise ValueError(f"{config.recording}: holds {len(log.recordings)} recordings; name one of them")
    write = write_dataset if config.format == "lerobot" else write_tub
    write(log.rows, log.recordings[0], config.out, terminal_bar)
    show(f"{len(log.rows)} rows in {config.out}")


def import_recording(config: ImportConfig) -> None:
    """Write the data set of another project as a recording."""
    from pilot.exchange.lerobot import INFO, import_dataset
    from pilot.exchange.tub import import_tub, read_tub
    from pilot.progress import terminal_bar

    if (config.dataset / INFO).exists():
        rows = import_dataset(config.dataset, config.recording, terminal_bar)
    else:
        rows = import_tub(read_tub(config.dataset), config.recording, terminal_bar)
    show(f"{rows} rows in {config.recording}. To look at them: python inspect_data.py {config.recording}")


def serve(config: InspectConfig) -> None:
    """Read the recordings, examine them in the background, and serve the page until Ctrl-C.

    Raises:
        NoUsableData: there are no recordings, or none can be used.
        UnusableModel: the model cannot be used.
        OSError: the port is in use.
    """
    process_settings.for_serving()
    cli.check_address(config.host, config.port)
    # imported here, so that --help and invalid options do not wait for PyTorch
    from pilot.data.driving_log import find_recordings
    from pilot.driving.driver import Driver
    from pilot.driving.gate import Gate
    from pilot.inspection.app import create_app
    from pilot.inspection.examiner import Examiner
    from pilot.inspection.inspected import InspectedRecording
    from pilot.inspection.web import listening, serve_until_interrupted
    from pilot.progress import terminal_bar

    process_settings.for_training()
    driver = Driver.load(config.model) if config.model else None
    logs = find_recordings(config.data)
    recordings = [InspectedRecording(log.parent) for log in terminal_bar(logs, len(logs), "reading")]
    app = create_app(recordings, config.model.name if config.model else "")
    warn = logging.getLogger("pilot").warning
    server = listening(config.host, config.port, Gate(app, config.host, lambda kind, what: warn("%s: %s", kind, what)))
    Examiner(recordings, driver, networks=config.networks).start()
    address = f"http://{config.host}:{config.port}/"
    show(f"{len(recordings)} recordings at {address} (Ctrl-C ends)")
    if config.browser:
        webbrowser.open(address)
    serve_until_interrupted(server)


COMMANDS: dict[str, tuple[type[Any], Callable[[Any], None]]] = {
    "": (InspectConfig, serve),
    "export": (ExportConfig, export_recording),
    "import": (ImportConfig, import_recording),
}


if __name__ == "__main__":
    sys.exit(main())

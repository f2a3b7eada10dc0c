"""Page that shows recordings: python inspect_data.py data/ (see --help)."""

import logging
import sys
import webbrowser
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from pilot import cli, process_settings
from pilot.terminal import show

PROGRAM = cli.program("inspect_data.py")


@dataclass(frozen=True)
class InspectConfig:
    """Show recordings in the browser: what they contain, which moments are suspicious; leave ranges out.

    Other commands: inspect_data.py export --help and inspect_data.py import --help, for donkeycar's data sets.
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
    """Write a recording as a data set of donkeycar (tub v2): centre camera, steering, throttle and speed."""

    recording: tyro.conf.Positional[Path]
    """Folder of the recording."""
    tub: tyro.conf.Positional[Path]
    """Folder to write."""


@dataclass(frozen=True)
class ImportConfig:
    """Write a data set of donkeycar (tub v2) as a recording."""

    tub: tyro.conf.Positional[Path]
    """Folder of the tub, with its manifest.json."""
    recording: tyro.conf.Positional[Path]
    """Folder to write."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command in `arguments` (default: sys.argv), and return the exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    command = words.pop(0) if words and words[0] in COMMANDS else ""
    config, action = COMMANDS[command]
    options = tyro.cli(config, prog=f"{PROGRAM} {command}".strip(), args=words)
    return cli.run(PROGRAM, lambda: action(options), verbose=True)


def export_tub(config: ExportConfig) -> None:
    """Write a recording as a tub."""
    from pilot.data.driving_log import read_driving_logs
    from pilot.data.tub import write_tub
    from pilot.progress import terminal_bar

    log = read_driving_logs([config.recording], terminal_bar, annotated=False)
    if len(log.recordings) > 1:
        raise ValueError(f"{config.recording}: holds {len(log.recordings)} recordings; name one of them")
    write_tub(log.rows, log.recordings[0], config.tub, terminal_bar)
    show(f"{len(log.rows)} records in {config.tub}")


def import_tub(config: ImportConfig) -> None:
    """Write a tub as a recording."""
    from pilot.data import tub
    from pilot.progress import terminal_bar

    rows = tub.import_tub(tub.read_tub(config.tub), config.recording, terminal_bar)
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
    "export": (ExportConfig, export_tub),
    "import": (ImportConfig, import_tub),
}


if __name__ == "__main__":
    sys.exit(main())

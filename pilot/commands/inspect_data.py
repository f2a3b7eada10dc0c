"""Page that shows recordings: python inspect_data.py data/ (see --help)."""

import logging
import sys
import webbrowser
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import tyro

from pilot import cli, process_settings
from pilot.terminal import show

PROGRAM = cli.program("inspect_data.py")


@dataclass(frozen=True)
class InspectConfig:
    """Show recordings in the browser: what they contain, which moments are suspicious; leave ranges out."""

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


def main(arguments: Sequence[str] | None = None) -> int:
    """Serve until Ctrl-C, with the options in `arguments` (default: sys.argv), and return the exit code."""
    config = tyro.cli(InspectConfig, prog=PROGRAM, args=arguments)

    def inspect() -> None:
        cli.check_address(config.host, config.port)
        serve(config)

    return cli.run(PROGRAM, inspect, verbose=True)


def serve(config: InspectConfig) -> None:
    """Read the recordings, examine them in the background, and serve the page until Ctrl-C.

    Raises:
        NoUsableData: there are no recordings, or none can be used.
        UnusableModel: the model cannot be used.
        OSError: the port is in use.
    """
    process_settings.for_serving()
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


if __name__ == "__main__":
    sys.exit(main())

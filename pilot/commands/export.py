"""Export of models as ONNX files: python export.py model.pt (see --help)."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from operator import methodcaller
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from pilot import cli, process_settings
from pilot.files import write_atomically
from pilot.terminal import show

if TYPE_CHECKING:
    from pilot.arrays import Frame
    from pilot.portable.comparison import Measured

PROGRAM = cli.program("export.py")
FRAMES = 300  # to compare and to quantise with
TRACKS = ("lake", "jungle", "random:20000")


@dataclass(frozen=True)
class ExportConfig:
    """Write a model as one ONNX file that drive.py, evaluate.py and other programs can run.

    Takes a model of this program (.pt), a Keras network (.h5 or .keras, without Keras and TensorFlow), or the ONNX
    network of another project, of which --preprocessing says how it prepares frames.
    """

    model: tyro.conf.Positional[Path]
    """Model file: .pt, .h5, .hdf5, .keras or .onnx."""
    out: Path | None = None
    """ONNX file to write. Default: the model's name with .onnx."""
    preprocessing: Path | None = None
    """JSON file that describes how a network of another project prepares frames (docs/models.md)."""
    int8: bool = False
    """Also write a quantised model, NAME.int8.onnx: 8-bit integers instead of 32-bit numbers."""
    data: tuple[Path, ...] = ()
    """Recordings whose frames are used to quantise and to compare. Default: frames of the built-in simulator."""

    @property
    def target(self) -> Path:
        """Path of the ONNX file to write."""
        return self.out or self.model.with_suffix(".onnx")

    @property
    def quantised(self) -> Path:
        """Path of the quantised model."""
        return self.target.with_suffix(".int8.onnx")

    def check(self) -> None:
        """Check the values.

        Raises:
            ValueError: a value is invalid; the message names the option, its value and the cure.
        """
        from pilot.portable.keras_file import SUFFIXES

        if self.model.suffix not in (".pt", ".onnx", *SUFFIXES):
            raise ValueError(f"{self.model}: must be a .pt, {', '.join(SUFFIXES)} or .onnx file")
        if self.model.suffix == ".pt" and self.preprocessing:
            raise ValueError("--preprocessing: a model of this program contains its own; leave it out")
        if self.target.suffix != ".onnx":
            raise ValueError(f"--out {self.target}: must end with .onnx")
        if self.target.resolve() == self.model.resolve():
            raise ValueError(f"{self.model}: would be overwritten; name another file with --out")


def main(arguments: Sequence[str] | None = None) -> int:
    """Export with the options in `arguments` (default: sys.argv), and return the exit code."""

    def check_and_export() -> None:
        config = tyro.cli(ExportConfig, prog=PROGRAM, args=arguments)
        config.check()
        export(config)

    return cli.run(PROGRAM, check_and_export)


def export(config: ExportConfig) -> None:
    """Convert, check, write and compare.

    Raises:
        UnusableModel: the model, or its description, cannot be used.
        NoUsableData: there are no frames in `config.data`.
        OSError: a file cannot be written.
    """
    process_settings.for_driving()
    # imported here, so that --help and invalid options do not wait for PyTorch
    from pilot.driving.driver import Driver
    from pilot.portable.comparison import compare, inputs_of
    from pilot.portable.conversion import convert
    from pilot.portable.onnx_model import onnx_model
    from pilot.progress import terminal_bar

    conversion = convert(config.model, config.preprocessing)
    files = {config.target: conversion.model.SerializeToString()}
    model = onnx_model(config.target, files[config.target])
    frames = inputs_of(example_frames(config.data), model.signature)
    forms = {"PyTorch": conversion.original} if conversion.original else {}
    if config.model.suffix == ".pt":
        forms["PyTorch, frozen by drive.py"] = Driver.load(config.model).predict
    forms[config.target.name] = model.predict
    if config.int8:
        from pilot.portable.quantisation import quantise

        files[config.quantised] = quantise(conversion.model, [model.prepare(frame) for frame in frames[::3]])
        forms[config.quantised.name] = onnx_model(config.quantised, files[config.quantised]).predict
    measured = compare(forms, frames, terminal_bar)
    check_agreement(measured, config.target.name)
    for path, content in files.items():
        write_atomically(path, methodcaller("write", content))
    show(describe(measured, files))


def example_frames(recordings: Sequence[Path]) -> "list[Frame]":
    """Return frames of recordings or, without any, of the built-in simulator's tracks: 160x320x3, uint8 RGB each.

    Raises:
        NoUsableData: there are no frames in the recordings.
    """
    if recordings:
        from pilot.data.driving_log import read_driving_logs
        from pilot.data.frames import read_frame

        paths = read_driving_logs(recordings).rows["center"].tolist()
        return [read_frame(path) for path in paths[:: max(len(paths) // FRAMES, 1)]]
    from pilot.simulator.simulator import Simulator

    frames = []
    with Simulator() as simulator:
        for track in TRACKS:
            simulator.reset(track)
            for place in range(FRAMES // len(TRACKS)):
                simulator.episode.place(place * len(TRACKS) / FRAMES * simulator.episode.track.length)
                frames.append(simulator.look()["center"])
    return frames


def check_agreement(measured: "Sequence[Measured]", name: str) -> None:
    """Check that an ONNX file steers as its original.

    Raises:
        RuntimeError: it does not.
    """
    from pilot.portable.onnx_export import TOLERANCE

    difference = next(form.largest_difference for form in measured if form.form == name)
    if difference > TOLERANCE:
        raise RuntimeError(f"{name}: steers up to {difference:.2g} differently from the original; it was not written")


def describe(measured: "Sequence[Measured]", files: dict[Path, bytes]) -> str:
    """Return the comparison as text."""
    sizes = {path.name: f"{len(content) / 1e6:.2f} MB" for path, content in files.items()}
    lines = [f"{'frame to steering':28} {'median':>9} {'99 %':>9} {'largest difference':>19} {'mean':>8} {'size':>9}"]
    lines += [
        f"{form.form:28} {form.median_ms:6.2f} ms {form.percentile_99_ms:6.2f} ms {form.largest_difference:19.1e} "
        f"{form.mean_difference:8.1e} {sizes.get(form.form, ''):>9}"
        for form in measured
    ]
    return "\n".join([*lines, "written: " + ", ".join(map(str, files))])


if __name__ == "__main__":
    sys.exit(main())

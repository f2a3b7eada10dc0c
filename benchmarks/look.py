"""Comparison of recorded and rendered frames at the same places; used by fidelity.py."""

from collections import defaultdict
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from pilot.arrays import Floats, Frame
from pilot.camera import ground_to_pixel
from pilot.data.frames import read_frame
from pilot.model.checkpoint import load_model
from pilot.simulator.catalogue import load_course, load_track
from pilot.simulator.episode import Episode
from pilot.simulator.rendering.renderer import Renderer
from pilot.simulator.rendering.scene import Scene
from pilot.simulator.track import REVERSED
from pilot.vehicle import BONNET_ROW, CAMERA_AHEAD_OF_REAR_AXLE, COLUMNS, ROWS

Place = tuple[str, str, float]  # image file, track, progress in metres
COMPARED = 400  # places per track
REGIONS = {  # distance from the centre line relative to the road's half width, metres
    "road": (-9.0, -2.0),
    "edge": (-1.6, 1.6),
    "ground": (3.0, 12.0),
}
FARTHEST = 30.0  # metres ahead
SKY_ROWS = 25  # rows of a frame that show sky and distant ground
SMALLEST = 50  # pixels of a region that are compared
STATISTICS = ("red", "green", "blue", "p5", "p50", "p95", "detail", "spread")


def compare_looks(places: list[Place], model: Path | None, sheet: Path | None) -> None:
    """Print the statistics of recorded and rendered frames, and the distance of a network's features.

    Args:
        places: where recorded frames were taken.
        model: a model trained on recordings only; None: no distance.
        sheet: picture of recorded above rendered frames to write; None: none.
    """
    print(f"{'look':<24}" + "".join(f"{name:>8}" for name in STATISTICS))
    columns = []
    for name in sorted({track.removesuffix(REVERSED) for _, track, _ in places}):
        chosen = [place for place in places if place[1].removesuffix(REVERSED) == name]
        chosen = [chosen[index] for index in np.linspace(0, len(chosen) - 1, COMPARED).astype(int)]
        recorded = [read_frame(path) for path, _, _ in chosen]
        rendered, masks = _render(name, chosen)
        for region in (*REGIONS, "sky"):
            for kind, frames in (("recorded", recorded), ("rendered", rendered)):
                seen = [(frame, mask[region]) for frame, mask in zip(frames, masks, strict=True)]
                values = [_statistics(frame, mask) for frame, mask in seen if mask.sum() >= SMALLEST]
                print(f"{name + ' ' + region:<14}{kind:<10}" + "".join(f"{v:8.0f}" for v in np.mean(values, axis=0)))
        if model:
            print(
                f"{name}: distance of the features of {model.name}: {feature_distance(model, recorded, rendered):.2f}"
            )
        columns += [np.vstack([recorded[index], rendered[index]]) for index in range(0, COMPARED, COMPARED // 6)]
    if sheet:
        rows = [np.hstack(columns[start : start + 6]) for start in range(0, len(columns) - 5, 6)]
        cv2.imwrite(str(sheet), np.vstack(rows)[..., ::-1])


def _render(course: str, places: list[Place]) -> tuple[list[Frame], list[dict[str, NDArray[np.bool_]]]]:
    """Return the frames of a car on the centre line at places, and the pixels of each region."""
    renderer = Renderer(Scene(load_course(course)))
    frames, masks = [], []
    for _, name, progress in places:
        track = load_track(name)
        episode = Episode(track, progress)
        episode.place(progress, -track.lane)
        frames.append(renderer.render_episode(episode)["center"])
        masks.append(_regions(episode))
    renderer.close()
    return frames, masks


def _regions(episode: Episode) -> dict[str, NDArray[np.bool_]]:
    """Return the pixels (160 x 320) that show each region, as if the ground were flat."""
    column, row = np.meshgrid(np.arange(COLUMNS) + 0.5, np.arange(ROWS) + 0.5)
    ground = np.stack([column, row, np.ones_like(row)], -1) @ np.linalg.inv(ground_to_pixel()).T
    right, ahead = ground[..., 0] / ground[..., 2], ground[..., 1] / ground[..., 2]
    seen = (ahead > 0) & (ahead < FARTHEST) & (row < BONNET_ROW)
    car = episode.car
    sine, cosine = np.sin(car.heading), np.cos(car.heading)
    along = ahead + CAMERA_AHEAD_OF_REAR_AXLE
    x, y = car.x + right * cosine + along * sine, car.y - right * sine + along * cosine
    beyond = np.full(seen.shape, np.inf)
    beyond[seen] = episode.track.tree.query(np.stack([x[seen], y[seen]], -1))[0] - episode.where.half_width
    regions = {name: (beyond >= low) & (beyond < high) for name, (low, high) in REGIONS.items()}
    return {**regions, "sky": row < SKY_ROWS}


def _statistics(frame: Frame, mask: NDArray[np.bool_]) -> Floats:
    """Return the STATISTICS of the pixels in a mask."""
    grey = frame.astype(np.float32).mean(2)
    detail = grey - cv2.GaussianBlur(grey, (0, 0), 2)
    brightness = grey[mask]
    percentiles = np.percentile(brightness, [5, 50, 95])
    return np.array([*frame[mask].mean(0), *percentiles, detail[mask].std(), brightness.std()])


def feature_distance(model: Path, recorded: list[Frame], rendered: list[Frame]) -> float:
    """Return the mean distance of two sets of frames in a network's activations, relative to the recorded spread."""
    first, second = _activations(model, recorded), _activations(model, rendered)
    distances = []
    for layer, one in first.items():
        other, spread = second[layer], one.std(0)
        used = spread > 1e-4  # dead channels
        means, spreads = one.mean(0) - other.mean(0), spread - other.std(0)
        distances.append(float(np.sqrt(((means**2 + spreads**2)[used] / spread[used] ** 2).mean())))
    return float(np.mean(distances))


def _activations(model: Path, frames: list[Frame]) -> dict[int, Floats]:
    """Return the mean activation of each channel (frames x channels) after each ReLU of a network."""
    network = load_model(model).network
    values: dict[int, list[Floats]] = defaultdict(list)
    for module in network.layers.modules():
        if isinstance(module, nn.ReLU):
            module.register_forward_hook(
                lambda layer, _, out: values[id(layer)].append(
                    np.asarray(out.detach().flatten(2).mean(2) if out.ndim == 4 else out.detach()).copy()
                )
            )
    with torch.inference_mode():
        for start in range(0, len(frames), 64):
            network(torch.from_numpy(np.stack(frames[start : start + 64])))
    return {index: np.concatenate(parts) for index, parts in enumerate(values.values())}

"""Software rendering of the car's cameras, without display or GPU."""

import functools
import math

import numpy as np
from panda3d.core import (
    Camera,
    DisplayRegion,
    FrameBufferProperties,
    GraphicsEngine,
    GraphicsOutput,
    GraphicsPipe,
    GraphicsPipeSelection,
    LMatrix4f,
    NodePath,
    PerspectiveLens,
    Texture,
    WindowProperties,
    load_prc_file_data,
)

from pilot.arrays import Floats, Frame, Matrix
from pilot.camera import camera_rotation
from pilot.simulator.camera_variation import STANDARD, CameraVariation
from pilot.simulator.episode import Episode
from pilot.simulator.rendering.bonnet import add_bonnet
from pilot.simulator.rendering.row_mask import RowMask
from pilot.simulator.rendering.scene import Scene
from pilot.vehicle import (
    CAMERA_AHEAD_OF_REAR_AXLE,
    CAMERA_HEIGHT,
    CAMERA_OFFSETS,
    COLUMNS,
    FOCAL_LENGTH,
    ROWS,
    WHOLE_FRAME,
    Rows,
)

CAMERA_ROTATION = camera_rotation()
NEAR, FAR = 0.4, 1200.0  # clipping distances, metres
SETTINGS = """
    audio-library-name null
    sync-video 0
    notify-level-device fatal
    garbage-collect-states 0
"""


@functools.cache
def _engine() -> tuple[GraphicsEngine, GraphicsPipe]:
    load_prc_file_data("", SETTINGS)  # before the engine is created, which reads them
    pipe = GraphicsPipeSelection.get_global_ptr().make_pipe("TinyOffscreenGraphicsPipe", "p3tinydisplay")
    return GraphicsEngine.get_global_ptr(), pipe


class Renderer:
    """Renders the frames of a car's cameras.

    Attributes:
        scene: the rendered scene.
        cameras: names of the cameras: any of left, center and right.
    """

    def __init__(self, scene: Scene, cameras: tuple[str, ...] = ("center",)) -> None:
        self.scene, self.cameras = scene, cameras
        self._engine, pipe = _engine()
        size = WindowProperties.size(COLUMNS * len(cameras), ROWS)
        depth = FrameBufferProperties()
        depth.set_rgb_color(True)
        depth.set_depth_bits(24)
        self._output: GraphicsOutput = self._engine.make_output(
            pipe, "cameras", 0, depth, size, GraphicsPipe.BF_refuse_window
        )
        self._output.set_clear_color((*(value / 255 for value in scene.light.sky), 1))
        self._output.set_active(False)  # except in `render`: the engine is shared, and draws all active outputs
        self._picture = Texture("cameras")
        self._output.add_render_texture(self._picture, GraphicsOutput.RTM_copy_ram)
        self._regions: list[DisplayRegion] = []
        self._nodes = [self._add_camera(number) for number in range(len(cameras))]
        self._masks = [RowMask(node, number) for number, node in enumerate(self._nodes)]

    def _add_camera(self, number: int) -> NodePath:
        lens = PerspectiveLens()
        lens.set_film_size(COLUMNS, ROWS)
        lens.set_focal_length(FOCAL_LENGTH)
        lens.set_near_far(NEAR, FAR)
        camera = Camera(self.cameras[number], lens)
        node = self.scene.root.attach_new_node(camera)
        width = 1 / len(self.cameras)
        region = self._output.make_display_region(number * width, (number + 1) * width, 0, 1)
        region.set_camera(node)
        self._regions.append(region)
        return node

    def render(
        self,
        x: float,
        y: float,
        z: float,
        heading: float,
        slope: float = 0.0,
        *,
        variation: CameraVariation = STANDARD,
        only: str | None = None,
        rows: Rows = WHOLE_FRAME,
    ) -> dict[str, Frame]:
        """Render the cameras' frames, by camera name: 160x320x3 uint8 RGB each.

        Args:
            x, y, z: middle of the car's rear axle, on the ground, metres.
            heading: compass heading of the car, radians.
            slope: of the ground in the direction of the heading, rise over run.
            variation: of the cameras.
            only: name of the only camera to render, which takes less time; None: all.
            rows: the only rows to render, which takes less time; the others are black.
        """
        for name, node, region, mask in zip(self.cameras, self._nodes, self._regions, self._masks, strict=True):
            mask.uncover(rows)
            region.set_active(only in (None, name))
            pose = camera_pose(x, y, z, heading, slope, offset=CAMERA_OFFSETS[name], variation=variation)
            node.set_mat(LMatrix4f(*pose.ravel()))
        self.scene.sky.set_pos(x, y, z + CAMERA_HEIGHT)
        self._output.set_active(True)
        self._engine.render_frame()
        self._output.set_active(False)
        image = np.frombuffer(memoryview(self._picture.get_ram_image_as("RGB")), np.uint8)
        strip = image.reshape(ROWS, COLUMNS * len(self.cameras), 3)[::-1]
        frames = {}
        for number, name in enumerate(self.cameras):
            if only not in (None, name):
                continue
            frame = add_bonnet(
                _only(rows, strip[:, number * COLUMNS : (number + 1) * COLUMNS]), name, self.scene.light, rows[1]
            )
            frames[name] = frame if variation is STANDARD else variation.developed(frame)
        return frames

    def render_episode(
        self,
        episode: Episode,
        variation: CameraVariation = STANDARD,
        only: str | None = None,
        rows: Rows = WHOLE_FRAME,
    ) -> dict[str, Frame]:
        """Render the cameras' frames in an episode's current state, as `render` does."""
        car = episode.car
        ground = self.scene.ground(episode)
        return self.render(car.x, car.y, ground, car.heading, episode.slope, variation=variation, only=only, rows=rows)

    def close(self) -> None:
        """Release the off-screen buffer."""
        self._engine.remove_window(self._output)


def _only(rows: Rows, picture: Frame) -> Frame:
    """Return a copy of a picture in which all rows but `rows` are black."""
    frame = np.zeros((ROWS, COLUMNS, 3), np.uint8)
    frame[slice(*rows)] = picture[slice(*rows)]
    return frame


def camera_pose(
    x: float, y: float, z: float, heading: float, slope: float, *, offset: float, variation: CameraVariation = STANDARD
) -> Matrix:
    """Return a camera's pose in Panda3D's convention: 4x4, whose rows are its right, forward and up axes and position.

    Args:
        x, y, z, heading, slope: of the car, as for `Renderer.render`.
        offset: of the camera to the right of the car's middle, metres.
        variation: of the camera's height, pitch and roll.
    """
    pitch = math.atan(slope) - variation.pitch
    forward = np.array([math.sin(heading) * math.cos(pitch), math.cos(heading) * math.cos(pitch), math.sin(pitch)])
    level = np.array([math.cos(heading), -math.sin(heading), 0.0])
    right = math.cos(variation.roll) * level - math.sin(variation.roll) * _cross(level, forward)
    up = _cross(right, forward)
    axes = CAMERA_ROTATION @ np.stack([right, -up, forward])  # right, down and forward of the tilted camera
    pose = np.eye(4)
    pose[0, :3], pose[1, :3], pose[2, :3] = axes[0], axes[2], -axes[1]
    pose[3, :3] = (
        np.array([x, y, z])
        + CAMERA_AHEAD_OF_REAR_AXLE * forward
        + (CAMERA_HEIGHT + variation.height) * up
        + offset * right
    )
    return pose


def _cross(first: Floats, second: Floats) -> Floats:
    """Return the cross product of two vectors of length 3; NumPy's takes ten times as long."""
    (a, b, c), (d, e, f) = first.tolist(), second.tolist()
    return np.array([b * f - c * e, c * d - a * f, a * e - b * d])

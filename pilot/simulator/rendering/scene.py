"""A course as a Panda3D scene. Its software renderer has no shaders, so the light is precomputed."""

import functools
from typing import get_args

import cv2
import numpy as np
from numpy.typing import NDArray
from panda3d.core import (
    BoundingBox,
    BoundingVolume,
    CullBinManager,
    Geom,
    GeomNode,
    GeomTriangles,
    GeomVertexArrayFormat,
    GeomVertexData,
    GeomVertexFormat,
    InternalName,
    LPoint3,
    NodePath,
    SamplerState,
    Texture,
    TextureStage,
    TransparencyAttrib,
)

from pilot.simulator.course import LIGHTS, Course, Light, Plant
from pilot.simulator.episode import Episode
from pilot.simulator.rendering.ground import ground_meshes
from pilot.simulator.rendering.lightmap import LightMap, bake_light, light_above_ground
from pilot.simulator.rendering.mesh import Mesh, join
from pilot.simulator.rendering.plants import grow_plants, plant_mesh
from pilot.simulator.rendering.road import road_meshes
from pilot.simulator.rendering.signs import sign_meshes
from pilot.simulator.rendering.terrain import LEVEL_BESIDE, Terrain, make_terrain
from pilot.simulator.rendering.textures import panorama, plant, surface

SKY_RADIUS = 600.0  # metres
SKY_TOP, SKY_BOTTOM = 35.0, -35.0 / 3  # degrees above the horizon

WADING, FAR_FROM_ROAD = 0.6, 40.0  # metres: depth of the water, and distance from the road's edge, of a lost car


class Scene:
    """Scene graph of a course.

    Attributes:
        light: of the scene.
        terrain: around the road.
        root: node of the whole scene.
        sky: node of the sky, to be moved with the camera.
    """

    def __init__(self, course: Course, light: str | None = None) -> None:
        """Build the scene.

        Args:
            course: the track and its surroundings.
            light: a key of LIGHTS; None: the course's default.
        """
        self.light: Light = LIGHTS[light or course.light]
        self.terrain: Terrain = make_terrain(course)
        self.water = course.water
        on_ground, on_bridges = road_meshes(course, self.light)
        plants = grow_plants(course, self.terrain)
        shine = bake_light(self.terrain, plants, on_bridges, self.light)
        self.root = NodePath("course")
        self.root.set_bin(_near_first(), 0)
        solid = _lit(self.root.attach_new_node("solid"), shine)
        for mesh in join([*ground_meshes(course, self.terrain), *on_ground]):
            _attach(solid, mesh, shine)
        bridges = self.root.attach_new_node("bridges")
        for mesh in join(on_bridges):
            _attach(bridges, mesh.multiplied(light_above_ground(self.terrain, mesh.corners, self.light)), None)
        upright = self.root.attach_new_node("upright")
        upright.set_transparency(TransparencyAttrib.M_binary)
        upright.set_two_sided(True)
        for group in plants:
            _attach(upright, plant_mesh(group, shine.light_at(group.points)), None)
        for mesh in join(sign_meshes(course, self.light)):
            _attach(upright, mesh, None)
        self.sky = _sky(self.light, course)
        self.sky.reparent_to(self.root)

    def is_lost(self, episode: Episode) -> bool:
        """Return whether a car is in the lake, or so far from the road that it will not find back."""
        beyond = abs(episode.where.lateral_offset) - episode.where.half_width
        in_water = self.water is not None and self.ground(episode) < self.water - WADING
        return in_water or beyond > FAR_FROM_ROAD

    def ground(self, episode: Episode) -> float:
        """Return the height (metres) of the surface under a car: the road, or the terrain some metres beside it."""
        beside = abs(episode.where.lateral_offset) - episode.where.half_width - LEVEL_BESIDE
        if beside <= 0:
            return episode.where.height
        land = float(self.terrain.sample(self.terrain.heights, np.array([[episode.car.x, episode.car.y]]))[0])
        return episode.where.height + (land - episode.where.height) * min(beside / 2.0, 1.0)


@functools.cache
def _near_first() -> str:
    """Return the name of a bin in which near meshes are drawn first: what they hide costs less time.

    Without a fixed order, memory addresses would decide which of two pixels at equal depth is visible.
    """
    CullBinManager.get_global_ptr().add_bin("near first", CullBinManager.BT_front_to_back, 15)
    return "near first"


def _lit(node: NodePath, shine: LightMap) -> NodePath:
    """Multiply the colours of everything below a node by the light map; returns the node."""
    stage = TextureStage("light")
    stage.set_mode(TextureStage.M_modulate)
    stage.set_sort(10)
    stage.set_texcoord_name("light")
    node.set_texture(stage, _clamped(_to_texture("light", shine.picture)))
    return node


@functools.cache
def _texture(name: str) -> Texture:
    """Return the texture of a surface or plant, shared by all scenes."""
    if name in get_args(Plant):
        texture = _clamped(_to_texture(name, plant(name)[::-1]))
        texture.set_minfilter(SamplerState.FT_linear)  # no mipmaps: they would blur a plant into a column
        return texture
    return _to_texture(name, surface(name))


def _clamped(texture: Texture) -> Texture:
    """Clamp a texture at its borders instead of repeating it; returns the texture."""
    texture.set_wrap_u(SamplerState.WM_clamp)
    texture.set_wrap_v(SamplerState.WM_clamp)
    return texture


def _to_texture(name: str, picture: NDArray[np.uint8]) -> Texture:
    """Create a texture from an RGB or RGBA image whose first row is the bottom one."""
    height, width, channels = picture.shape
    texture = Texture(name)
    texture.setup_2d_texture(width, height, Texture.T_unsigned_byte, Texture.F_rgb if channels == 3 else Texture.F_rgba)
    # Panda3D's internal order; its own conversion takes ten times as long
    texture.set_ram_image(cv2.cvtColor(picture, cv2.COLOR_RGB2BGR if channels == 3 else cv2.COLOR_RGBA2BGRA))
    texture.set_minfilter(SamplerState.FT_linear_mipmap_linear)
    texture.set_magfilter(SamplerState.FT_linear)
    return texture


# Geometry


def _vertex_format(*, lit: bool) -> GeomVertexFormat:
    """Return the format in which the renderer reads vertices fastest: positions and colours as points of four floats.

    It converts any other to this for each vertex in view of each frame, which takes 6 % of the time.
    """
    array = GeomVertexArrayFormat()
    array.add_column(InternalName.get_vertex(), 4, Geom.NT_float32, Geom.C_point)
    array.add_column(InternalName.get_color(), 4, Geom.NT_float32, Geom.C_point)
    array.add_column(InternalName.get_texcoord(), 2, Geom.NT_float32, Geom.C_texcoord)
    if lit:
        array.add_column(InternalName.get_texcoord_name("light"), 2, Geom.NT_float32, Geom.C_texcoord)
    vertices = GeomVertexFormat()
    vertices.add_array(array)
    return GeomVertexFormat.register_format(vertices)


def _attach(parent: NodePath, mesh: Mesh, shine: LightMap | None) -> None:
    """Add a mesh below a node, in chunks; lit by `shine`, if any."""
    texture = _texture(mesh.texture)
    for chunk in mesh.chunks():
        node = GeomNode(mesh.texture)
        node.add_geom(to_geom(chunk, shine))
        _bound(node, chunk)
        path = parent.attach_new_node(node)
        path.set_texture(texture)


def _bound(node: GeomNode, mesh: Mesh) -> None:
    """Bound a node by a box; by default, it is a sphere, which is hardly ever out of view if the mesh is flat."""
    corners = mesh.corners.reshape(-1, 3)
    node.set_bounds_type(BoundingVolume.BT_box)
    node.set_bounds(BoundingBox(LPoint3(*corners.min(0)), LPoint3(*corners.max(0))))


def to_geom(mesh: Mesh, shine: LightMap | None) -> Geom:
    """Convert a mesh to Panda3D's format; `shine`, if any, adds texture coordinates of the light map."""
    columns = [("vertex", 4), ("color", 4), ("texcoord", 2), *([("light", 2)] if shine else [])]
    corners = mesh.corners.reshape(-1, 3)
    vertices = np.ones(len(corners), [(name, np.float32, number) for name, number in columns])
    vertices["vertex"][:, :3] = corners
    vertices["color"][:, :3] = mesh.colours.reshape(-1, 3).clip(0, 255).astype(np.uint8) * np.float32(1 / 255)
    # shifted close to zero, because large texture coordinates lose precision
    texels = mesh.texels - np.floor(mesh.texels.min(axis=(0, 1)))
    vertices["texcoord"] = texels.reshape(-1, 2)
    if shine:
        vertices["light"] = shine.texels(corners)
    # shared corners are merged, so that the renderer transforms each once
    _, kept, numbers = np.unique(vertices.view(f"V{vertices.itemsize}"), return_index=True, return_inverse=True)
    data = GeomVertexData("mesh", _vertex_format(lit=shine is not None), Geom.UH_static)
    data.unclean_set_num_rows(len(kept))
    data.modify_array_handle(0).copy_data_from(vertices[kept].tobytes())
    indices = numbers.reshape(-1, 4)[:, [0, 1, 2, 0, 2, 3]].astype(np.uint32)
    triangles = GeomTriangles(Geom.UH_static)
    triangles.set_index_type(Geom.NT_uint32)
    array = triangles.modify_vertices()
    array.unclean_set_num_rows(indices.size)
    array.modify_handle().copy_data_from(indices.tobytes())
    geom = Geom(data)
    geom.add_primitive(triangles)
    return geom


# Sky


def _sky(light: Light, course: Course) -> NodePath:
    """Create a cylinder around the camera with the sky and distant hills."""
    angles = np.linspace(0, 2 * np.pi, 49)
    ring = SKY_RADIUS * np.column_stack([np.sin(angles), np.cos(angles)])
    low, high = SKY_RADIUS * np.tan(np.radians(SKY_BOTTOM)), SKY_RADIUS * np.tan(np.radians(SKY_TOP))
    bottom = np.column_stack([ring, np.full(49, low)])
    top = np.column_stack([ring, np.full(49, high)])
    corners = np.stack([bottom[:-1], bottom[1:], top[1:], top[:-1]], axis=1)
    part = angles / (2 * np.pi)
    across = np.stack([part[:-1], part[1:], part[1:], part[:-1]], axis=1)
    texels = np.stack([across, np.broadcast_to([0.0, 0, 1, 1], across.shape)], axis=2)
    mesh = Mesh("sky", corners, np.full(corners.shape, 255.0), texels)
    node = GeomNode("sky")
    node.add_geom(to_geom(mesh, None))
    sky = NodePath(node)
    picture = panorama(light, course.look.grass, course.seed)[::-1]
    texture = _to_texture("sky", picture)
    texture.set_wrap_v(SamplerState.WM_clamp)
    sky.set_texture(texture)
    sky.set_two_sided(True)
    sky.set_bin("background", 0)
    sky.set_depth_write(False)  # drawn first, so that only a mask of rows hides it
    return sky

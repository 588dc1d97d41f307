"""Renders images of a scene of simple shapes with Blender: the program of a process of its own.

    python blender_scene.py < job.json

It needs bpy and what bpy brings along, and nothing of tcrdata, whose process never imports bpy.
`blender_job` says what a job holds. Every image goes to a temporary file and from there to its
path, and then the line `tcrdata: <number of the image>` to stdout, where Blender writes, too.
"""

from __future__ import annotations

import json
import math
import os
import struct
import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Vector

# Round shapes are polyhedra of so many sides: none is off by more than 7e-4 of its radius.
SIDES = 128
LOOKS = {
    "rubber": {"Metallic": 0.0, "Roughness": 0.7, "Specular IOR Level": 0.25},
    "metal": {"Metallic": 1.0, "Roughness": 0.22},
    "ground": {"Metallic": 0.0, "Roughness": 0.9, "Specular IOR Level": 0.1},
}
GEOMETRY_FILTER_PX = 0.01


def main() -> None:
    """Render the images of the job on stdin; with --version, say which bpy this is."""
    if "--version" in sys.argv:
        tell(bpy.app.version_string)
        return
    job = json.load(sys.stdin)
    things = set_up(job)
    # A process that goes on for a moment after its parent was killed has a file of its own.
    part = Path(job["part_path"].format(os.getpid()))
    for number, image in enumerate(job["images"]):
        pose(things, job, image)
        path = Path(image["path"])
        path.parent.mkdir(parents=True, exist_ok=True)
        write = write_geometry if image["kind"] == "geometry" else write_rgb
        write(part, job)
        part.replace(path)
        tell(str(number))


def tell(text: str) -> None:
    """Tell the parent; Blender may be in the middle of a line."""
    sys.stdout.write(f"\ntcrdata: {text}\n")
    sys.stdout.flush()


def set_up(job: dict[str, Any]) -> list[Any]:
    """Build the scene; return Blender's objects of the job's things, in their order."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.camera = link(bpy.data.objects.new("camera", bpy.data.cameras.new("camera")))
    scene.world = bpy.data.worlds.new("world")
    for number, light in enumerate(job["lights"]):
        add_light(f"light {number}", light)
    things = []
    for number, thing in enumerate(job["things"]):
        mesh = unit_mesh(thing["shape"])
        mesh.materials.append(look(thing))
        placed = link(bpy.data.objects.new(f"thing {number}", mesh))
        placed.pass_index = number + 1
        things.append(placed)
    settings = scene.render
    settings.engine = "CYCLES"
    settings.resolution_x, settings.resolution_y = job["width_px"], job["height_px"]
    settings.resolution_percentage = 100
    settings.threads_mode, settings.threads = "FIXED", job["threads"]
    settings.dither_intensity = 0.0
    settings.use_file_extension = False
    scene.view_settings.view_transform = "Standard"
    scene.cycles.device = "CPU"
    scene.cycles.seed = job["seed"]
    scene.cycles.use_adaptive_sampling = False
    return things


def link(thing: Any) -> Any:
    """Put an object into the scene; return it."""
    bpy.context.scene.collection.objects.link(thing)
    return thing


def add_light(name: str, light: dict[str, Any]) -> None:
    """Put down a square lamp that shines at a place, itself seen in reflections alone."""
    lamp = bpy.data.lights.new(name, "AREA")
    lamp.energy, lamp.size = light["watts"], light["size_m"]
    placed = link(bpy.data.objects.new(name, lamp))
    place = Vector(light["place_m"])
    towards = Vector(light["target_m"]) - place
    placed.location = place
    placed.rotation_euler = towards.to_track_quat("-Z", "Y").to_euler()
    placed.visible_camera = False


def look(thing: dict[str, Any]) -> Any:
    """Return the material of a thing."""
    material = bpy.data.materials.new(thing["look"])
    shader = material.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*thing["colour"], 1.0)
    for name, value in LOOKS[thing["look"]].items():
        shader.inputs[name].default_value = value
    return material


def unit_mesh(shape: str) -> Any:
    """Return the mesh of a shape within +-1: a round one has its corners on its surface."""
    shapes = {"plane": plane, "box": box, "sphere": sphere, "cylinder": cylinder, "cone": cone}
    corners, faces = shapes[shape]()
    mesh = bpy.data.meshes.new(shape)
    mesh.from_pydata(corners, [], faces)
    if shape == "sphere":
        mesh.polygons.foreach_set("use_smooth", np.ones(len(mesh.polygons), dtype=bool))
    mesh.update()
    return mesh


Polyhedron = tuple[list[tuple[float, float, float]], list[tuple[int, ...]]]


def plane() -> Polyhedron:
    """Return the square z = 0, seen from above."""
    return [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [(0, 1, 2, 3)]


def box() -> Polyhedron:
    """Return the cube."""
    corners = [(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)]
    faces: list[tuple[int, ...]] = [
        (0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3),
    ]  # fmt: skip
    return corners, faces


def ring(radius: float, height: float) -> list[tuple[float, float, float]]:
    """Return the corners of a regular polygon about the z axis."""
    angles = [2 * math.pi * n / SIDES for n in range(SIDES)]
    return [(radius * math.cos(a), radius * math.sin(a), height) for a in angles]


def between(lower: int, upper: int) -> list[tuple[int, ...]]:
    """Return the faces between two rings that begin at the corners of these numbers."""
    return [
        (lower + n, lower + (n + 1) % SIDES, upper + (n + 1) % SIDES, upper + n)
        for n in range(SIDES)
    ]


def fan(first: int, apex: int, *, up: bool) -> list[tuple[int, ...]]:
    """Return the faces between a ring and one corner above or below it."""
    pairs = [(first + n, first + (n + 1) % SIDES) for n in range(SIDES)]
    return [(a, b, apex) if up else (b, a, apex) for a, b in pairs]


def cylinder() -> Polyhedron:
    """Return the prism for x^2 + y^2 = 1, |z| <= 1."""
    corners = ring(1.0, -1.0) + ring(1.0, 1.0)
    ends = [tuple(reversed(range(SIDES))), tuple(range(SIDES, 2 * SIDES))]
    return corners, [*between(0, SIDES), *ends]


def cone() -> Polyhedron:
    """Return the pyramid with its apex at z = 1 and its base at z = -1."""
    corners = [*ring(1.0, -1.0), (0.0, 0.0, 1.0)]
    return corners, [*fan(0, SIDES, up=True), tuple(reversed(range(SIDES)))]


def sphere() -> Polyhedron:
    """Return the globe: rings from below, then the poles."""
    rings = SIDES // 2
    slopes = [math.pi * (n / rings - 0.5) for n in range(1, rings)]
    corners = [corner for s in slopes for corner in ring(math.cos(s), math.sin(s))]
    last = len(corners)
    corners += [(0.0, 0.0, -1.0), (0.0, 0.0, 1.0)]
    faces = [face for n in range(rings - 2) for face in between(n * SIDES, (n + 1) * SIDES)]
    faces += fan(0, last, up=False) + fan(last - SIDES, last + 1, up=True)
    return corners, faces


def pose(things: list[Any], job: dict[str, Any], image: dict[str, Any]) -> None:
    """Put everything where it is in an image's frame, and the camera where it looks from."""
    poses = job["poses"][str(image["frame"])]
    for placed, thing, world_T_thing in zip(things, job["things"], poses, strict=True):
        scale = Matrix.Diagonal((*thing["half_size_m"], 1.0))
        placed.matrix_world = Matrix(world_T_thing) @ scale
    view = job["cameras"][image["camera"]]
    camera = bpy.context.scene.camera
    # Blender's cameras look along -z with y up; tcrdata's along z with y down.
    camera.matrix_world = Matrix(view["world_T_camera"]) @ Matrix.Diagonal((1, -1, -1, 1))
    focal_px, _, centre_x, centre_y = view["intrinsics_px"]
    width, height = job["width_px"], job["height_px"]
    lens = camera.data
    lens.sensor_fit, lens.sensor_width = "HORIZONTAL", 36.0
    lens.lens = focal_px * lens.sensor_width / width
    # A pixel's centre has whole coordinates; the image ends half a pixel beyond.
    lens.shift_x = (0.5 * (width - 1) - centre_x) / width
    lens.shift_y = (centre_y - 0.5 * (height - 1)) / width
    lens.clip_start, lens.clip_end = 0.01, 1000.0


def write_rgb(path: Path, job: dict[str, Any]) -> None:
    """Render the image with its light into an 8-bit PNG."""
    scene = bpy.context.scene
    scene.view_layers[0].material_override = None
    set_background(scene.world, job["ambient"])
    cycles = scene.cycles
    cycles.samples, cycles.use_denoising = job["samples"], job["denoise"]
    cycles.pixel_filter_type, cycles.filter_width = "BLACKMAN_HARRIS", 1.5
    cycles.max_bounces = 8
    render(path, "PNG", "8")
    path.write_bytes(pixels_alone(path.read_bytes()))


def pixels_alone(png: bytes) -> bytes:
    """Return a PNG without dates and durations: an image's bytes are the same every time.

    A PNG is a signature of 8 bytes and chunks of length, kind, content and checksum.
    """
    kept, place = [png[:8]], 8
    while place < len(png):
        length, kind = struct.unpack_from(">I4s", png, place)
        end = place + 12 + length
        if kind in (b"IHDR", b"IDAT", b"IEND"):
            kept.append(png[place:end])
        place = end
    return b"".join(kept)


def write_geometry(path: Path, job: dict[str, Any]) -> None:
    """Render what the middle of each pixel sees into a .npy file.

    It is (2, H, W) float32: depth (m) and the number of the thing, 0 and -1 where nothing is.
    """
    scene = bpy.context.scene
    scene.view_layers[0].material_override = geometry_material()
    set_background(scene.world, [0.0, 0.0, 0.0])
    cycles = scene.cycles
    cycles.samples, cycles.use_denoising, cycles.max_bounces = 1, False, 0
    cycles.pixel_filter_type, cycles.filter_width = "BOX", GEOMETRY_FILTER_PX
    render(path, "OPEN_EXR", "32")
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.name = "Non-Color"
    pixels = np.empty(4 * job["width_px"] * job["height_px"], dtype=np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    rows = pixels.reshape(job["height_px"], job["width_px"], 4)[::-1]
    found = np.stack([rows[..., 0], np.rint(rows[..., 1]) - 1])
    with path.open("wb") as file:
        np.save(file, found)


def geometry_material() -> Any:
    """Return a material whose light is (depth, number of the object, 0)."""
    found = bpy.data.materials.get("geometry")
    if found:
        return found
    material = bpy.data.materials.new("geometry")
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    numbers = nodes.new("ShaderNodeCombineColor")
    links.new(nodes.new("ShaderNodeCameraData").outputs["View Z Depth"], numbers.inputs[0])
    links.new(nodes.new("ShaderNodeObjectInfo").outputs["Object Index"], numbers.inputs[1])
    light = nodes.new("ShaderNodeEmission")
    links.new(numbers.outputs["Color"], light.inputs["Color"])
    ends = nodes.new("ShaderNodeOutputMaterial")
    links.new(light.outputs["Emission"], ends.inputs["Surface"])
    return material


def set_background(world: Any, colour: list[float]) -> None:
    """Let a linear colour shine from all around."""
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (*colour, 1.0)


def render(path: Path, file_format: str, bits: str) -> None:
    """Render into a file."""
    settings = bpy.context.scene.render
    output = settings.image_settings
    output.file_format, output.color_mode, output.color_depth = file_format, "RGB", bits
    settings.filepath = str(path)
    bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    main()

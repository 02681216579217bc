# SPDX-License-Identifier: GPL-3.0-or-later
"""The images of the materials in a GLB or glTF description."""

from __future__ import annotations

import base64
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

from ....errors import ShockError
from ...side_files import find
from ...staging import within
from .gltf_tree import INSIDE, Tree
from .maps import COLOR, NORMALS, MapImage

_PARTS = {
    "baseColorTexture": COLOR,
    "diffuseTexture": COLOR,
    "normalTexture": NORMALS,
    "metallicRoughnessTexture": "metal and roughness",
    "specularGlossinessTexture": "gloss",
    "occlusionTexture": "occlusion",
    "emissiveTexture": "emission",
}
_ENDINGS = {"image/png": ".png", "image/jpeg": ".jpg", "image/webp": ".webp"}
_STARTS = {b"\x89PNG": ".png", b"\xff\xd8": ".jpg", b"RIFF": ".webp"}
_GLOSS = "KHR_materials_pbrSpecularGlossiness"
_TRANSFORM = "KHR_texture_transform"
_IN_EXTENSIONS = ("EXT_texture_webp",)
_ERRORS = (AttributeError, IndexError, KeyError, TypeError, ValueError)


def material_images(
    path: Path, tree: Tree, buffers: list[bytearray], number: int, refused: Mapping[int, str]
) -> tuple[list[MapImage], list[str]]:
    """Read the images of a material, but for refused ones; sentences about those left out.

    Raises
    ------
    ShockError
        If the description names things that are not there.
    """
    images: list[MapImage] = []
    notes: list[str] = []
    material = tree["materials"][number]
    for part, texture in _textures_of(material):
        try:
            image = _image(path, tree, buffers, part, texture, refused)
            shown = part == COLOR and material.get("alphaMode", "OPAQUE") != "OPAQUE"
            images.append(image._replace(is_cut_out=shown))
        except _Unreadable as reason:
            notes.append(f"{part} of {_name(material, number)}: {reason}")
        except _ERRORS as error:
            raise ShockError(
                f"{path}: {part} of materials[{number}] names a texture that is not there, or in"
                " another way than glTF does; repair the file, or export it again."
            ) from error
    return images, notes


def refused_images(tree: Tree) -> dict[int, str]:
    """Return the images that cannot be changed for one use alone, and why.

    These are shown by other coordinates in some material, or share their data.
    """
    refused: dict[int, str] = {}
    for material in tree.get("materials", []):
        for _, texture in _textures_of(material):
            try:
                reason, number = _moved(texture), _number_of(tree, texture)
            except _ERRORS:  # said where it is read
                continue
            if reason and number is not None:
                refused[number] = f"in a material, {reason}"
    images = tree.get("images", [])
    views = [image.get("bufferView") for image in images]
    for number, view in enumerate(views):
        if view is None:
            continue
        if views.count(view) > 1:
            refused[number] = "another image shares its data; export the model again"
        elif "extensions" in tree["bufferViews"][_index(view)]:
            refused[number] = "its data are compressed; export the model without compression"
    return refused


def moved_color(material: Tree) -> str:
    """Why the first texture coordinates do not show a material's color; empty if they do."""
    colors = (_moved(texture) for part, texture in _textures_of(material) if part == COLOR)
    return next(filter(None, colors), "")


def replace_image(tree: Tree, buffers: list[bytearray], number: int, data: bytes) -> None:
    """Put a PNG file in the place of an image that is stored inside the model."""
    image = tree["images"][number]
    image["mimeType"] = "image/png"
    if "bufferView" not in image:
        image["uri"] = f"{INSIDE}image/png;base64,{base64.b64encode(data).decode()}"
        return
    _replace_view(tree, buffers, image["bufferView"], data)


def write_beside(tree: Tree, number: int, data: bytes, path: Path) -> str:
    """Write a PNG file beside a model that names its images; return its name."""
    name = f"{path.name}.{number}.png"
    within(path.parent, name).write_bytes(data)
    image = tree["images"][number]
    image["uri"] = quote(name)
    for key in ("mimeType", "bufferView"):
        image.pop(key, None)
    return name


def is_beside(tree: Tree, image: Tree) -> bool:
    """Whether an image is a file beside the model, or in one that others may use, too."""
    uri = image.get("uri", INSIDE)
    if "bufferView" in image:
        uri = tree["buffers"][tree["bufferViews"][image["bufferView"]]["buffer"]].get("uri", INSIDE)
    return not uri.startswith(INSIDE)


def use_png(tree: Tree, replaced: Collection[int]) -> None:
    """Let textures name images that are PNG files now in the common way."""
    for texture in tree.get("textures", []):
        for name in _IN_EXTENSIONS:
            source = texture.get("extensions", {}).get(name, {}).get("source")
            if source in replaced:
                texture["source"] = source
                del texture["extensions"][name]


class _Unreadable(Exception):
    pass


def _textures_of(material: Tree) -> Iterator[tuple[str, Any]]:
    places = [
        material.get("pbrMetallicRoughness", {}),
        material.get("extensions", {}).get(_GLOSS, {}),
        material,
    ]
    for place in places:
        for key, part in _PARTS.items():
            if key in place:
                yield part, place[key]


def _moved(texture: Any) -> str:
    # Why the first texture coordinates do not show where a texture is; empty if they do.
    transform = texture.get("extensions", {}).get(_TRANSFORM, {})
    if transform.get("texCoord", texture.get("texCoord", 0)) != 0:
        return "it is shown by other texture coordinates than the first ones"
    turn = [*transform.get("offset", (0, 0)), transform.get("rotation", 0)]
    if any(turn) or [*transform.get("scale", (1, 1))] != [1, 1]:
        return "its texture coordinates are transformed"
    return ""


def _number_of(tree: Tree, texture: Any) -> int | None:
    # The image of a texture.
    entry = tree["textures"][_index(texture["index"])]
    number = entry.get("source")
    for name in _IN_EXTENSIONS:
        number = entry.get("extensions", {}).get(name, {}).get("source", number)
    return None if number is None else _index(number)


def _image(
    path: Path,
    tree: Tree,
    buffers: list[bytearray],
    part: str,
    texture: Any,
    refused: Mapping[int, str],
) -> MapImage:
    reason = _moved(texture)
    if reason:
        raise _Unreadable(reason)
    number = _number_of(tree, texture)
    if number is None:
        raise _Unreadable("it is compressed for graphics cards (KTX); export it as PNG or JPEG")
    if number in refused:
        raise _Unreadable(refused[number])
    image = tree["images"][number]
    data = _data_of(path, tree, buffers, image)
    ending = next((end for start, end in _STARTS.items() if data.startswith(start)), "")
    ending = ending or _ENDINGS.get(image.get("mimeType", ""), "")
    if not ending:
        raise _Unreadable("it is neither a PNG, a JPEG nor a WebP file")
    name = image.get("name") or unquote(image.get("uri", ""))[:60] or f"image {number}"
    return MapImage(number, str(name), part, ending, data)


def _index(number: Any) -> int:
    if type(number) is not int or number < 0:
        raise ValueError(number)
    return number


def _data_of(path: Path, tree: Tree, buffers: list[bytearray], image: Tree) -> bytes:
    if "bufferView" in image:
        view = tree["bufferViews"][_index(image["bufferView"])]
        start = view.get("byteOffset", 0)
        return bytes(buffers[view["buffer"]][start : start + view["byteLength"]])
    uri = image["uri"]
    if uri.startswith(INSIDE):
        return base64.b64decode(uri.partition(",")[2])
    found = find(path.parent, unquote(uri))
    if found is None:
        raise _Unreadable(f"the file {unquote(uri)} is not beside the model")
    return found.read_bytes()


def _name(entry: Tree, number: int) -> str:
    return f"the material {entry.get('name') or number}"


def _replace_view(tree: Tree, buffers: list[bytearray], number: int, data: bytes) -> None:
    # Lays out the buffer anew, so that the old image takes no space.
    changed = tree["bufferViews"][number]
    place = changed["buffer"]
    old = buffers[place]
    packed = bytearray()
    for view in tree["bufferViews"]:
        if view["buffer"] != place:
            continue
        start = view.get("byteOffset", 0)
        part = data if view is changed else old[start : start + view["byteLength"]]
        packed += bytes(-len(packed) % 4)
        view["byteOffset"], view["byteLength"] = len(packed), len(part)
        packed += part
    buffers[place] = packed
    tree["buffers"][place]["byteLength"] = len(packed)

# SPDX-License-Identifier: GPL-3.0-or-later
"""The images of the materials in a GLB or glTF description."""

from __future__ import annotations

import base64
from collections.abc import Collection, Iterator
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


def material_images(
    path: Path, tree: Tree, buffers: list[bytearray], number: int
) -> tuple[list[MapImage], list[str]]:
    """Read the images of a material; sentences about those that cannot be read.

    Raises
    ------
    ShockError
        If the description names things that are not there.
    """
    images: list[MapImage] = []
    notes: list[str] = []
    for part, texture in _textures_of(tree["materials"][number]):
        try:
            images.append(_image(path, tree, buffers, part, texture))
        except _Unreadable as reason:
            notes.append(f"{part} of {_name(tree['materials'][number], number)}: {reason}")
        except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
            raise ShockError(
                f"{path}: materials[{number}] names a texture that cannot be read ({error!r});"
                " repair the file, or export it again."
            ) from error
    return images, notes


def replace_image(tree: Tree, buffers: list[bytearray], number: int, data: bytes) -> None:
    """Put a PNG file in the place of an image that is stored inside the model."""
    image = tree["images"][number]
    image["mimeType"] = "image/png"
    if "bufferView" not in image:
        image["uri"] = f"{INSIDE}image/png;base64,{base64.b64encode(data).decode()}"
        return
    view = tree["bufferViews"][image["bufferView"]]
    shared = [each for each in tree["images"] if each.get("bufferView") == image["bufferView"]]
    if len(shared) > 1 or "extensions" in view:
        raise ShockError("Two images share their data; export the model again.")
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


def _image(path: Path, tree: Tree, buffers: list[bytearray], part: str, texture: Any) -> MapImage:
    if texture.get("texCoord", 0) != 0:
        raise _Unreadable("it is shown by other texture coordinates than the first ones")
    if _TRANSFORM in texture.get("extensions", {}):
        raise _Unreadable("its texture coordinates are transformed")
    entry = tree["textures"][_index(texture["index"])]
    number = entry.get("source")
    for name in _IN_EXTENSIONS:
        number = entry.get("extensions", {}).get(name, {}).get("source", number)
    if number is None:
        raise _Unreadable("it is compressed for graphics cards (KTX); export it as PNG or JPEG")
    image = tree["images"][_index(number)]
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

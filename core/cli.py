# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line, shared by ``shock-filter`` and Blender.

A backend reads, sharpens and writes one file; all else (flags, several inputs, progress, messages,
exit codes) is here. Numerics and file formats are imported when the first file is at hand.
"""

from __future__ import annotations

import argparse
import glob
import math
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, Protocol

from .. import __version__
from .errors import InvalidSettings, ShockError
from .settings import (
    BeltramiGeometrySettings,
    BeltramiMeshSettings,
    BeltramiSettings,
    DilateSettings,
    GeometrySettings,
    ImageSettings,
    Setting,
    ShockSettings,
    TextureSettings,
    describe,
)

if TYPE_CHECKING:
    from .files.output import Outcome

DONE, FAILED, INTERRUPTED = 0, 1, 130

_EPILOG = """\
exit codes:
  0    every input was filtered and written
  1    some inputs failed; the others were written
  2    the command line is wrong; nothing was done
  130  interrupted; the file at hand was not written

examples:
  {prog} sharpen-geometry scan.ply sharp.ply
  {prog} sharpen-geometry --time inf --smoothing-passes 3 scans/*.obj sharp/
  {prog} denoise-geometry scan.ply clean.ply --then-sharpen
  {prog} sharpen-colors painted.ply crisp.ply
  {prog} sharpen-image --time 64 photos/*.png sharp/
  {prog} sharpen-texture --time 64 model.obj wood.png metal.png sharp/
  {prog} texture-mask model.obj charts.png --kind chart --like wood.png
"""


@dataclass(frozen=True)
class Command:
    """One subcommand.

    Attributes
    ----------
    name : str
        What people type.
    settings : type or None
        The settings class whose fields become flags.
    inputs : str
        What IN stands for.
    what : str
        What it does.
    on_mesh : bool
        Whether a mesh file, whose surface shows the images, stands before IN.
    then : type or None
        The settings class of the sharpening that may follow in the same run.
    """

    name: str
    settings: type | None
    inputs: str
    what: str
    on_mesh: bool = False
    then: type | None = None


GEOMETRY = Command(
    "sharpen-geometry", GeometrySettings, "mesh files", "sharpen the creases of meshes"
)
COLORS = Command(
    "sharpen-colors", ShockSettings, "mesh files", "sharpen the vertex colors of meshes"
)
IMAGE = Command("sharpen-image", ImageSettings, "image files", "sharpen images")
TEXTURE = Command(
    "sharpen-texture",
    TextureSettings,
    "image files that the mesh shows",
    "sharpen textures on the surface of a mesh, across seams",
    on_mesh=True,
)
DILATE = Command(
    "dilate-texture",
    DilateSettings,
    "image files that the mesh shows",
    "fill the texels around the charts of textures with what lies across the seams",
    on_mesh=True,
)
TEXTURE_MASK = Command(
    "texture-mask", None, "mesh file", "draw what each texel of a mesh's texture is"
)
DENOISE_GEOMETRY = Command(
    "denoise-geometry",
    BeltramiGeometrySettings,
    "mesh files",
    "remove noise from meshes; creases stay",
    then=GeometrySettings,
)
DENOISE_COLORS = Command(
    "denoise-colors",
    BeltramiMeshSettings,
    "mesh files",
    "remove noise from the vertex colors of meshes; edges stay",
    then=ShockSettings,
)
DENOISE_IMAGE = Command(
    "denoise-image",
    BeltramiSettings,
    "image files",
    "remove noise from images; edges stay",
    then=ImageSettings,
)
COMMANDS = (
    DENOISE_GEOMETRY, DENOISE_COLORS, DENOISE_IMAGE,
    GEOMETRY, COLORS, IMAGE, TEXTURE, DILATE, TEXTURE_MASK,
)  # fmt: skip

ON_GEOMETRY = (GEOMETRY, DENOISE_GEOMETRY)
ON_COLORS = (COLORS, DENOISE_COLORS)
ON_IMAGES = (IMAGE, DENOISE_IMAGE)
"""Commands that differ only in what they do to the same files."""

KINDS = {
    "active": "texels that linear sampling of some face reads",
    "boundary": "active texels that charts cover only in part",
    "face": "the face in which the texel's center lies",
    "chart": "the chart of that face",
    "count": "how many charts read the texel",
}
"""What `TEXTURE_MASK` can draw."""


class Backend(Protocol):
    """What differs between Blender and plain Python."""

    prog: str

    def formats(self, command: Command) -> str:
        """Name the files that a command reads and writes."""

    def add_arguments(self, parser: argparse.ArgumentParser, command: Command) -> None:
        """Add the flags that only this backend has."""

    def sharpen(
        self,
        command: Command,
        source: str,
        target: Path,
        settings: Any,
        options: argparse.Namespace,
        progress: Callable[[float, str], bool],
    ) -> Outcome:
        """Sharpen one file into another; raises ShockError or OSError."""


class FileBackend:
    """Files outside Blender."""

    prog = "shock-filter"

    def formats(self, command: Command) -> str:
        """Name the files that a command reads and writes."""
        images = "PNG, JPEG, TIFF, EXR, BMP, WebP and NumPy (.npy) files"
        meshes = "OBJ, PLY, GLB and glTF files with texture coordinates"
        return {
            **dict.fromkeys(ON_GEOMETRY, "PLY, OBJ, STL, OFF, GLB and glTF files"),
            **dict.fromkeys(ON_COLORS, "PLY, OBJ, GLB and glTF files, which keep their format"),
            **dict.fromkeys(ON_IMAGES, f"{images}; 16 bits stay 16 bits"),
            TEXTURE: f"{images}; 16 bits stay 16 bits; on {meshes}",
            DILATE: f"{images}; 16 bits stay 16 bits; on {meshes}",
            TEXTURE_MASK: f"from {meshes} to {images}; NumPy, TIFF and EXR hold numbers, -1 for"
            " none, all others a picture",
        }[command]

    def add_arguments(self, parser: argparse.ArgumentParser, command: Command) -> None:
        """Add the flags for masks and materials."""
        if command.on_mesh or command is TEXTURE_MASK:
            parser.add_argument(
                "--material",
                metavar="NAME",
                help="only the faces with this material show the texture; all do if left out",
            )
        if command in (DILATE, TEXTURE_MASK):
            return
        metavar = "NAME"
        about = (
            "vertex property of PLY files that says how much is done to each vertex: 0 keeps"
            " it, 1 (or the largest whole number of its type) changes it fully"
        )
        if command in (*ON_IMAGES, TEXTURE):
            metavar = "FILE"
            about = "gray image of the same size: black stays, white changes fully"
        parser.add_argument("--mask", metavar=metavar, help=about)
        parser.add_argument("--invert-mask", action="store_true", help="use one minus the mask")

    def sharpen(
        self,
        command: Command,
        source: str,
        target: Path,
        settings: Any,
        options: argparse.Namespace,
        progress: Callable[[float, str], bool],
    ) -> Outcome:
        """Sharpen one file into another."""
        words: dict[str, Any] = {"overwrite": options.overwrite, "progress": progress}
        if command.on_mesh or command is TEXTURE_MASK:
            words["material"] = options.material
        if command is TEXTURE_MASK:
            from .files.textures import texture_mask_file

            words |= {"size": options.size, "like": options.like}
            return texture_mask_file(source, target, options.kind, **words)
        if command is not DILATE:
            words |= {"mask": options.mask, "invert_mask": options.invert_mask}
        if command.then is not None:
            words["sharpen_time"] = options.then_sharpen
        files = [options.mesh, source, target] if command.on_mesh else [source, target]
        return _file_function(command)(*files, settings, **words)


def _file_function(command: Command) -> Callable[..., Outcome]:
    if command.then is not None:
        from .files import denoising as denoise_files

        functions: dict[Command, Callable[..., Outcome]] = {
            DENOISE_GEOMETRY: denoise_files.denoise_file,
            DENOISE_COLORS: denoise_files.denoise_colors_file,
            DENOISE_IMAGE: denoise_files.denoise_image_file,
        }
        return functions[command]
    if command is IMAGE:
        from .files.images import sharpen_image_file

        return sharpen_image_file
    if command.on_mesh:
        from .files import textures as texture_files

        is_sharpen = command is TEXTURE
        return (
            texture_files.sharpen_texture_file if is_sharpen else texture_files.dilate_texture_file
        )
    from .files import meshes as files

    return files.sharpen_file if command is GEOMETRY else files.sharpen_colors_file


def main(arguments: Sequence[str] | None = None, backend: Backend | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        The words after the program's name; those of ``sys.argv`` if left out.
    backend : Backend, optional
        Who reads, sharpens and writes; :class:`FileBackend` if left out.

    Returns
    -------
    int
        The exit code: 0, 1 or 130. Usage errors raise ``SystemExit(2)``.
    """
    backend = backend or FileBackend()
    parser = build_parser(backend)
    options = parser.parse_args(arguments)
    try:
        kind = options.command.settings
        settings = None if kind is None else _settings(kind, options)
        _check_sharpening(options)
        _check_mask(options)
        pairs = _pairs(options.inputs, options.output)
    except (InvalidSettings, _Usage) as error:
        parser.error(str(error))
    return _run_all(backend, pairs, settings, options)


def build_parser(backend: Backend) -> argparse.ArgumentParser:
    """Make the parser; each field of a settings class becomes a flag."""
    parser = argparse.ArgumentParser(
        prog=backend.prog,
        description="Sharpen meshes, their colors, textures and images by shock filter advection,"
        " and denoise them.",
        epilog=_EPILOG.format(prog=backend.prog),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"Shock Filter {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for command in COMMANDS:
        _add_command(commands, command, backend)
    return parser


def _add_command(commands: Any, command: Command, backend: Backend) -> None:
    parser = commands.add_parser(
        command.name,
        help=command.what,
        description=f"{command.what.capitalize()}: {backend.formats(command)}.",
        allow_abbrev=False,
    )
    parser.set_defaults(command=command)
    if command.on_mesh:
        parser.add_argument("mesh", metavar="MESH", help="mesh file whose surface shows IN")
    if command is TEXTURE_MASK:
        parser.add_argument("inputs", nargs=1, metavar="MESH", help=command.inputs)
    else:
        parser.add_argument(
            "inputs", nargs="+", metavar="IN", help=f"{command.inputs}; * and ** work"
        )
    parser.add_argument(
        "output",
        metavar="OUT",
        help="image file to write, its ending says the format"
        if command is TEXTURE_MASK
        else "file to write, its ending says the format; or folder, if it is one, ends in / or"
        " there are several inputs: files keep their names and formats there; folders are made",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace files that exist")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")
    backend.add_arguments(parser, command)
    if command is TEXTURE_MASK:
        _add_mask_flags(parser)
    if command.then is not None:
        _add_then_sharpen(parser, command.then)
    if command.settings is not None:
        _add_settings(parser, command.settings)


def _add_mask_flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--kind",
        choices=list(KINDS),
        default="active",
        help="; ".join(f"{kind}: {meaning}" for kind, meaning in KINDS.items())
        + " (default active)",
    )
    size = parser.add_mutually_exclusive_group(required=True)
    size.add_argument("--size", type=_size, metavar="WxH", help="width and height in texels")
    size.add_argument("--like", metavar="IMAGE", help="image file of the wanted size")


def _add_then_sharpen(parser: argparse.ArgumentParser, settings: type) -> None:
    _, default, about = describe(settings)["time"]
    parser.add_argument(
        "--then-sharpen",
        nargs="?",
        type=_time,
        const=default,
        metavar="TIME",
        help="sharpen the result for this long; give it after OUT where TIME is left out"
        f" ({default:g} if left out, {about.unit})",
    )


def _time(text: str) -> float:
    try:
        return _number(text)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is no time; give one, or --then-sharpen after OUT"
        ) from None


def _check_sharpening(options: argparse.Namespace) -> None:
    command = options.command
    if command.then is None or options.then_sharpen is None:
        return
    if not math.isfinite(options.then_sharpen):
        raise _Usage("the time of --then-sharpen must be finite; give one such as 4096")
    command.then(time=options.then_sharpen)


def _check_mask(options: argparse.Namespace) -> None:
    if getattr(options, "invert_mask", False) and not options.mask:
        raise _Usage("--invert-mask needs --mask; name the mask that it turns around")


def _size(text: str) -> tuple[int, int]:
    """Height and width."""
    width, height = map(int, text.lower().split("x"))
    if width < 1 or height < 1:
        raise ValueError
    return height, width


_size.__name__ = "size, such as 1024x512"  # argparse says "invalid size, ... value"


def _add_settings(parser: argparse.ArgumentParser, settings: type) -> None:
    main_group = parser.add_argument_group("settings")
    advanced = parser.add_argument_group("advanced settings")
    for name, (kind, default, about) in describe(settings).items():
        (advanced if about.advanced else main_group).add_argument(
            "--" + name.replace("_", "-"),
            dest=name,
            type=str if kind is str else _number,
            choices=list(about.choices) or None,
            metavar=None if about.choices else "N",
            default=default,
            help=_help(default, about).replace("%", "%%"),
        )


def _help(default: Any, about: Setting) -> str:
    parts = [about.description + "."]
    parts += [f"{word}: {meaning}." for word, meaning in about.choices.items()]
    facts = [f"default {default if about.choices else format(default, 'g')}"]
    if not about.choices:
        facts.append(f"{about.minimum:g} to {about.maximum:g}")
    if about.unit:
        facts.append(about.unit)
    return " ".join([*parts, f"({', '.join(facts)})"])


def _number(text: str) -> float:
    # Whether it has to be whole is for the settings to say.
    try:
        return int(text)
    except ValueError:
        return float(text)


_number.__name__ = "number"  # argparse says "invalid number value"


def _settings(kind: type, options: argparse.Namespace) -> Any:
    return kind(**{name: getattr(options, name) for name in describe(kind)})


# ------------------------------------------------------------------------------- inputs and outputs


class _Usage(Exception):
    """The command line asks for something that cannot be meant."""


def _pairs(patterns: list[str], output: str) -> list[tuple[str, Path]]:
    """Each input with the file that it is written to."""
    sources = list(dict.fromkeys(name for pattern in patterns for name in _expand(pattern)))
    if "-" in sources and len(sources) > 1:
        raise _Usage("- (the open file) must be the only input")
    is_folder = os.path.isdir(output) or output.endswith(("/", os.sep))
    if len(sources) > 1 and not is_folder and os.path.exists(output):
        raise _Usage(f"{output} is a file; several inputs need a folder as OUT")
    if len(sources) == 1 and not is_folder:
        return [(sources[0], Path(output))]
    if sources == ["-"]:
        raise _Usage("name the file to write for - (the open file), not a folder")
    taken: dict[Path, str] = {}
    for source in sources:
        target = Path(output, os.path.basename(source))
        if target in taken:
            raise _Usage(f"{taken[target]} and {source} would both be written to {target}")
        taken[target] = source
    return [(source, target) for target, source in taken.items()]


def _expand(pattern: str) -> list[str]:
    # A name that cannot be found stays, to be reported as a failed input.
    if os.path.exists(pattern) or not glob.has_magic(pattern):
        return [pattern]
    return sorted(glob.glob(pattern, recursive=True)) or [pattern]


def _check_target(target: Path, overwrite: bool) -> None:
    if target.is_dir():
        raise ShockError(f"{target} is a folder; name a file.")
    if target.exists() and not overwrite:
        raise ShockError(f"{target} exists already; add --overwrite or choose another output.")


# ----------------------------------------------------------------------------------------- running


def _run_all(
    backend: Backend,
    pairs: list[tuple[str, Path]],
    settings: Any,
    options: argparse.Namespace,
) -> int:
    failed = False
    with _Interrupt() as interrupt:
        for source, target in pairs:
            done = _run_one(backend, source, target, settings, options, interrupt)
            if interrupt.asked:
                return INTERRUPTED
            failed |= not done
    return FAILED if failed else DONE


def _run_one(
    backend: Backend,
    source: str,
    target: Path,
    settings: Any,
    options: argparse.Namespace,
    interrupt: _Interrupt,
) -> bool:
    """Sharpen one file and say so, or why not."""
    bar = _Bar(source, interrupt, shown=sys.stderr.isatty() and not options.quiet)
    start = time.perf_counter()
    try:
        _check_target(target, options.overwrite)
        target.parent.mkdir(parents=True, exist_ok=True)
        outcome = backend.sharpen(options.command, source, target, settings, options, bar)
    except (ShockError, OSError, KeyboardInterrupt) as error:
        bar.clear()
        if interrupt.asked:
            print(f"Interrupted; {target} was not written.", file=sys.stderr)
        else:
            print(f"Failed: {_sentence(source, error)}", file=sys.stderr)
        return False
    except Exception as error:  # unforeseen; the other files are done all the same
        bar.clear()
        traceback.print_exception(error)
        print(f"Failed: {source}: {type(error).__name__}: {error}", file=sys.stderr)
        return False
    bar.clear()
    if not options.quiet:
        _report(source, target, outcome, time.perf_counter() - start)
    return True


def _sentence(source: str, error: BaseException) -> str:
    text = str(error)
    return text if source in text else f"{source}: {text}"


def _report(source: str, target: Path, outcome: Outcome, seconds: float) -> None:
    print(f"{source} -> {target}: {outcome} in {seconds:.1f} s", flush=True)
    for note in outcome.notes:
        print(f"  {note}", flush=True)


class _Interrupt:
    """Ctrl-C asks for an end through the progress callback; the second one forces it."""

    asked = False

    def __enter__(self) -> _Interrupt:
        self._is_main = threading.current_thread() is threading.main_thread()
        if self._is_main:
            self._before = signal.signal(signal.SIGINT, self._ask)
        return self

    def __exit__(self, *_: object) -> None:
        if self._is_main:
            # None: it was set from C, as Blender does.
            signal.signal(signal.SIGINT, self._before or signal.SIG_DFL)

    def _ask(self, _number: int, _frame: FrameType | None) -> None:
        if self.asked:
            raise KeyboardInterrupt
        self.asked = True
        print("\nStopping; press Ctrl-C again if this takes too long.", file=sys.stderr)


class _Bar:
    """A progress callback that draws a bar on the terminal."""

    def __init__(self, name: str, interrupt: _Interrupt, shown: bool) -> None:
        self._name = os.path.basename(name)
        self._interrupt = interrupt
        self._shown = shown

    def __call__(self, fraction: float, message: str) -> bool:
        if self._shown:
            filled = round(20 * fraction)
            bar = "#" * filled + "." * (20 - filled)
            self._draw(f"{self._name} [{bar}] {fraction:4.0%} {message}")
        return not self._interrupt.asked

    def clear(self) -> None:
        """Remove the bar."""
        if self._shown:
            self._draw("")

    def _draw(self, text: str) -> None:
        sys.stderr.write(f"\r\x1b[K{text}")
        sys.stderr.flush()


if __name__ == "__main__":
    sys.exit(main())

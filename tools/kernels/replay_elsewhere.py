# SPDX-License-Identifier: GPL-3.0-or-later
"""Call each kernel of another system's library with what the rehearsal gave numba.

    python tools/kernels/replay_elsewhere.py windows-x64        (needs wine)
    python tools/kernels/replay_elsewhere.py linux-arm64        (needs qemu-aarch64, of qemu-user)

A program in C (replay.c) does it, as there is no Python for these. It prints how many results have
the bits of numba's here, and fails if one differs by more than rounding. Calls whose results are
arrays and calls with views are left out.
"""

from __future__ import annotations

import argparse
import json
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import build_kernels
from records import Call, read
from shock_filter.core.base import compiled

HERE = Path(__file__).resolve().parent
RUNNERS = {"windows-x64": ["wine"], "linux-arm64": ["qemu-aarch64"]}


def parts(value: Any) -> list[Any]:
    """Return a value, or all items of a tuple, at any depth."""
    return [part for item in value for part in parts(item)] if isinstance(value, tuple) else [value]


def write_call(file: BinaryIO, call: Call, symbol: str, result: Any) -> bool:
    """Write a call as replay.c reads it; False if it cannot."""
    if any(isinstance(each, np.ndarray) for each in parts(call.result)):
        return False
    values, after = parts(call.before), parts(call.after)
    given = [each for each in values if isinstance(each, np.ndarray)]
    if not all(each.flags.c_contiguous or each.flags.f_contiguous for each in given):
        return False
    slots: list[tuple[int, int]] = []
    arrays: list[tuple[int, bytes, bytes]] = []
    known: dict[int, int] = {}  # an array may be given twice
    for value, end in zip(values, after, strict=True):
        if isinstance(value, np.ndarray):
            own = [0, 0, value.size, value.itemsize, 0, *value.shape, *value.strides]
            which = known.setdefault(id(value), len(arrays))
            slots += [(which if place == 4 else -1, each) for place, each in enumerate(own)]
            if which == len(arrays):
                size = value.itemsize if value.dtype.kind == "f" else 1
                arrays.append((size, value.tobytes("A"), end.tobytes("A")))
        else:
            packed = struct.pack("@" + compiled._letters(value), 0 if value is None else value)
            slots.append((-1, *struct.unpack("@q", packed)))
    expected = b""
    if result is not None:
        expected = struct.pack("@" + "".join(result), *parts(call.result))

    def write(*numbers: int) -> None:
        file.write(struct.pack(f"<{len(numbers)}q", *numbers))

    write(len(symbol))
    file.write(symbol.encode())
    write(len(slots))
    for slot in slots:
        write(*slot)
    write(len(arrays))
    for size, first, last in arrays:
        write(size, len(first))
        file.write(first + last)
    write(len(expected))
    file.write(expected)
    return True


def write_calls(path: Path, table: dict[str, dict[str, list[Any]]]) -> None:
    """Write all calls of the harvests."""
    written = left_out = 0
    with path.open("wb") as file:
        for harvest in build_kernels.harvest():
            for call in read(harvest).calls:
                types = ",".join(compiled.type_name(each) for each in call.before)
                entry = table.get(call.name, {}).get(types)
                if entry and write_call(file, call, *entry[:2]):
                    written += 1
                else:
                    left_out += 1
    print(f"{written} calls written, {left_out} left out")


def zig(platform: str, *words: str | Path) -> None:
    """Compile and link C."""
    command = [sys.executable, "-m", "ziglang", "cc", "-target", platform, "-O1", *map(str, words)]
    subprocess.run(command, check=True)


def main() -> None:
    """Build, write the calls, and run."""
    parser = argparse.ArgumentParser(description="Compare another system's kernels with numba's.")
    parser.add_argument("platform", choices=RUNNERS)
    platform = parser.parse_args().platform
    build_kernels.build(platform)
    folder = build_kernels.PLACE / platform
    table = json.loads((folder / "kernels.json").read_text(encoding="utf-8"))
    write_calls(folder / "calls.bin", table)
    library = folder / build_kernels.PLATFORMS[platform].library
    if platform == "windows-x64":
        program = folder / "replay.exe"
        zig("x86_64-windows-gnu", HERE / "replay.c", "-o", program)
    else:  # linked with the kernels: a library would need this system's C library
        program, names = folder / "replay", folder / "names.c"
        symbols = [entry[0] for kernel in table.values() for entry in kernel.values()]
        names.write_text(
            "".join(f"int {each}(void *, void *, void *);\n" for each in symbols)
            + "struct { const char *name; int (*call)(void *, void *, void *); } table[] = {\n"
            + "".join(f'{{"{each}", {each}}},\n' for each in symbols)
            + "{0}};\n"
        )
        sources = [HERE / "replay.c", HERE / "runtime.c", names, folder / "kernels.o"]
        zig("aarch64-linux-musl", "-static", "-DTABLE", *sources, "-o", program, "-lm")
    done = subprocess.run([*RUNNERS[platform], program, library, folder / "calls.bin"])
    sys.exit(done.returncode)


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: GPL-3.0-or-later
"""Damages the compiled code of a kernel in all ways, in a process that wrong code could end.

Run as ``python damaged_kernel.py FOLDER``, with ``doubling.py`` in it. Writes a line before each
damage and one after, with what two loads then returned and how often they compiled.
"""

import importlib.util
import json
import pickle
import sys
from pathlib import Path

import numba

folder = Path(sys.argv[1])


def load():
    spec = importlib.util.spec_from_file_location("doubling", folder / "doubling.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.double


def file():
    (found,) = (folder / "__pycache__").glob("*.nb[ic]")
    return found


def replaced(change):
    file().write_bytes(change(file().read_bytes()))


def flipped(place):
    def change(data):
        data = bytearray(data)
        data[int(place * (len(data) - 1))] ^= 4
        return data

    replaced(change)


def from_another_version():
    file().unlink()
    version, numba.__version__ = numba.__version__, "0.1"
    load()(2)
    numba.__version__ = version


def of_another_kernel():
    file().write_bytes(other)


def a_folder():
    name = file()
    name.unlink()
    name.mkdir()


damages = {
    **{
        f"bits flipped at {place}": lambda place=place: flipped(place)
        for place in (0.0, 0.01, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0)
    },
    **{
        f"cut to {share}": lambda share=share: replaced(lambda data: data[: int(share * len(data))])
        for share in (0.0, 0.001, 0.01, 0.5, 0.999)
    },
    "zeros": lambda: replaced(lambda data: bytes(len(data))),
    "longer": lambda: replaced(lambda data: data + b"0"),
    "a foreign pickle": lambda: replaced(lambda data: pickle.dumps(("foreign", 1))),
    "of another version": from_another_version,
    "of another kernel": of_another_kernel,
    "a link to itself": lambda: (name := file(), name.unlink(), name.symlink_to(name)),
    "not readable": lambda: file().chmod(0),
    "in a folder that is not writable": lambda: (flipped(0.5), file().parent.chmod(0o500)),
    "a folder": a_folder,
}

load()(2.5)
other = file().read_bytes()
file().unlink()
load()(2)
for name, damage in damages.items():
    print(json.dumps([name]), flush=True)
    damage()
    seen = []
    for _ in range(2):
        kernel = load()
        seen.append([kernel(2), sum(kernel.stats.cache_misses.values())])
    print(json.dumps([name, *seen]), flush=True)
    file().parent.chmod(0o700)

# SPDX-License-Identifier: GPL-3.0-or-later
"""Command lines on a real scheduler with real workers, which die and come back."""

import asyncio
import http.client
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from collections import Counter
from pathlib import Path

import dask
import numpy as np
import psutil
import pytest
import zarr
from distributed import Client, Security
from distributed.comm import connect
from PIL import Image
from shock_filter import __version__, core
from shock_filter.core import cli
from shock_filter.core.cli import cluster, scheduler
from shock_filter.core.cli.inputs import FileName

HERE = Path(__file__).parent
PRELOAD = str(HERE / "cluster_worker.py")
FEW_TRIES = {"DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1"}  # as each takes a second
OUT = r"\bout\S*"
PATIENCE = 30.0
"""Seconds in which a command without a scheduler must end; alone it takes 4."""


def environment():
    return {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), **FEW_TRIES}


def start(program, *words, without=None):
    """Start one of Dask's programs; it finds the package where this process has it."""
    code = (
        f"import sys; sys.modules[{without!r}] = None\n"
        f"from distributed.cli.dask_{program} import main; main()"
    )
    return subprocess.Popen(
        [sys.executable, "-c", code, *words, "--no-dashboard"],
        env=environment(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def start_scheduler():
    port = free_port()
    process = start("scheduler", "--host", "127.0.0.1", "--port", str(port))
    return process, f"tcp://127.0.0.1:{port}"


def stop(process):
    """End a program; workers notice that the one that started them is gone, and end as well."""
    process.kill()
    process.wait()


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    """A scheduler and two workers of one thread each, which are started again when they die."""
    scheduler, address = start_scheduler()
    folder = str(tmp_path_factory.mktemp("workers"))
    words = ["--nworkers", "2", "--nthreads", "1", "--preload", PRELOAD]
    workers = start("worker", address, *words, "--local-directory", folder)
    try:
        wait_for_workers(address, 2)
        yield address
    finally:
        stop(workers)
        stop(scheduler)


def wait_for_workers(address, count):
    with Client(address, timeout=60) as client:
        client.wait_for_workers(count, timeout=60)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*words):
    return cli.main([str(word) for word in words])


def sharpen(*words):
    return run("sharpen-image", *words, "--time", 4)


def draw(*names, folder="in"):
    """Write small images, all different."""
    Path(folder).mkdir(exist_ok=True)
    for number, name in enumerate(names):
        pixels = np.random.default_rng(number).integers(0, 256, (8, 8, 3), np.uint8)
        Image.fromarray(pixels).save(Path(folder, f"{name}.png"))


def begun(folder="in"):
    """Files that workers began, in order, with their process and its number of threads."""
    path = Path(folder, "begun.txt")
    return [line.split() for line in path.read_text().splitlines()] if path.exists() else []


def names(folder):
    return sorted(path.name for path in Path(folder).iterdir() if path.is_file())


def contents(folder):
    return {path.name: path.read_bytes() for path in Path(folder).iterdir() if path.is_file()}


# ------------------------------------------------------------------------------------- all commands

MESH = """
v 0 0 0 0 0 0
v 1 0 0 0.4 0.5 0.5
v 2 0 0 1 1 1
v 0 1 1 0 0 0
v 1 1 1.2 0.5 0.5 0.6
v 2 1 1 1 1 1
v 0 2 0 0 0 0
v 1 2 0 0.6 0.5 0.5
v 2 2 0 1 1 1
vt 0 0
vt 0.5 0
vt 1 0
vt 0 0.5
vt 0.5 0.5
vt 1 0.5
vt 0 1
vt 0.5 1
vt 1 1
f 1/1 2/2 5/5 4/4
f 2/2 3/3 6/6 5/5
f 4/4 5/5 8/8 7/7
f 5/5 6/6 9/9 8/8
"""

WORDS = {
    "denoise-geometry": "mesh.obj out.obj",
    "denoise-colors": "mesh.obj out.obj",
    "denoise-image": "a.png out.png --mask gray.png",
    "denoise-texture": "mesh.obj a.png out.png --iterations 1",
    "sharpen-geometry": "mesh.obj out.obj",
    "sharpen-colors": "mesh.obj out.obj --time 1",
    "sharpen-image": "a.png out.png --guide b.png --time 4",
    "sharpen-texture": "mesh.obj a.png out.png --guide b.png --time 4",
    "filter-texture": "mesh.obj a.png out.png --gain-map gray.png --gain 2",
    "stitch-textures": "mesh.obj a.png out.png --with b.png",
    "fill-texture": "mesh.obj a.png out.png --mask hole.png",
    "enlarge-texture": "mesh.obj a.png out.png --factor 2",
    "repair-texture": "mesh.obj a.png out.png --mask hole.png",
    "make-tileable": "a.png out.png --mask gray.png",
    "remove-blocks": "a.png out.png",
    "geodesic-distance": "mesh.obj out.npy --painted gray.png --like a.png",
    "surface-streaks": "mesh.obj out.npy --like a.png",
    "surface-pattern": "mesh.obj out.npy --scale-map gray.png --like a.png",
    "curvature-map": "mesh.obj out.npy --like a.png",
    "ambient-occlusion": "mesh.obj out.npy --rays 4 --like a.png",
    "thickness": "mesh.obj out.npy --rays 4 --like a.png",
    "wear": "mesh.obj out.npy --rays 4 --like a.png",
    "visualize-flow": "flow.npy out --frames 2 --background b.png",
    "dilate-texture": "mesh.obj a.png out.png",
    "texture-mask": "mesh.obj out.png --like a.png",
    "repair-model": "model.obj out.obj --sharpen 0",
    "bake-maps": "mesh.obj out.npy --map normals --high mesh.obj --like a.png",
}
"""What each command is given, with all kinds of files that flags name: in the client's folder."""


def test_each_command_runs_on_workers_and_writes_the_same(address, folder):
    """In the order of the table; a new command needs its words above."""
    assert list(WORDS) == [row.command for row in cli.FileBackend.offered]
    draw("a", "b", folder=".")
    Path("mesh.obj").write_text(MESH)
    Path("model.obj").write_text("mtllib m.mtl\nusemtl m\n" + MESH)
    Path("m.mtl").write_text("newmtl m\nmap_Kd a.png\n")
    np.save("flow.npy", np.random.default_rng(0).random((8, 8, 2)))
    gray = Image.open("a.png").convert("L")
    gray.save("gray.png")
    gray.point(lambda value: 255 * (value > 128)).save("hole.png")
    for command, words in WORDS.items():
        made = []
        for place, flags in (("here", []), ("there", ["--cluster", address])):
            made.append(f"{command}/{place}/{next(re.finditer(OUT, words))[0]}")
            assert run(command, *re.sub(OUT, made[-1], words).split(), "--quiet", *flags) == 0
        same = contents if Path(made[0]).is_dir() else Path.read_bytes
        assert same(Path(made[0])) == same(Path(made[1])), command


def test_the_chunks_of_large_pictures_are_the_tasks(address, folder, capsys):
    """Of one with pixels that are wrong, nothing is left; flags name files in this folder."""
    pixels = np.random.default_rng(0).integers(0, 256, (90, 60, 3), np.uint8)
    file = zarr.open_array("in.zarr", mode="w", shape=pixels.shape, chunks=(30, 30, 3), dtype="u1")
    file[...] = pixels
    zarr.save_array("nan.zarr", np.full((8, 8), np.nan, np.float32))
    draw("small", folder=".")
    Image.fromarray(pixels[..., 0]).save("gray.png")
    words = "--time", 4, "--mask", "gray.png", "--cluster", address
    assert run("sharpen-image", "in.zarr", "out.zarr", *words) == 0
    assert "chunks" in capsys.readouterr().out
    settings = core.ImageSettings(time=4.0)
    expected = core.sharpen_image(pixels, settings, mask=pixels[..., 0] / 255.0)
    np.testing.assert_array_equal(zarr.load("out.zarr"), expected)
    assert sharpen("nan.zarr", "small.png", "both/", "--cluster", address) == 1
    assert "NaN" in capsys.readouterr().err
    assert names("both") == ["small.png"] and not Path("both/nan.zarr").exists()


def test_each_flag_that_names_a_file_is_known_as_one():
    """Or workers would look for it in a folder of their own."""
    from test_interface import commands

    flags = [action for parser in commands().values() for action in parser._actions]
    named = [flag for flag in flags if flag.metavar in ("FILE", "IMAGE", "MESH")]
    assert len(named) > 20
    assert all(flag.type is FileName for flag in named if flag.dest != "inputs")


def test_all_files_of_an_input_are_checked_and_written(address, folder, capsys):
    Path("part.obj").write_text(MESH)
    words = ["part.obj", "part.npy", "--size", "8x8", "--rays", "2", "--map", "occlusion"]
    words += ["thickness", "--cluster", address]
    Path("part_thickness.npy").write_text("mine")
    assert run("bake-maps", *words) == 1
    assert "part_thickness.npy exists already; add --overwrite" in capsys.readouterr().err
    assert Path("part_thickness.npy").read_text() == "mine" and not Path("part_ao.npy").exists()
    draw("a", "b")
    words = ["in/*.png", "out/", "--picture", "tiles.png", "--cluster", address]
    assert run("make-tileable", *words) == 0
    assert capsys.readouterr().err == ""
    assert names("out") == ["a.png", "b.png"]
    assert sorted(str(path) for path in Path().glob("*.png")) == [
        "a.png tiles.png",
        "b.png tiles.png",
    ]
    assert run("make-tileable", *words, "--resume") == 0
    assert "Skipped, as they are done already: 2" in capsys.readouterr().out


# ------------------------------------------------------------------------------ files that are bad


def test_damaged_files_among_many_are_tried_once_and_listed_at_the_end(address, folder, capsys):
    draw(*(f"{number:02}" for number in range(60)))
    for number in (0, 9, 25, 41, 59):
        Path(f"in/{number:02}.png").write_bytes(b"damaged")
    assert sharpen("in/*.png", "out/", "--cluster", address) == 1
    assert len(names("out")) == 55
    lines = failures(capsys)
    assert [Path(line.split()[1]).stem for line in lines] == ["00", "09", "25", "41", "59"]
    assert all("cannot be read; is it damaged?" in line for line in lines)
    times = Counter(name for name, *_ in begun())
    assert len(times) == 60
    assert set(times.values()) == {1}
    assert len({process for _, process, _ in begun()}) == 2  # both took part


def test_what_exists_is_not_overwritten(address, folder, capsys):
    draw("a", "b")
    Path("out").mkdir()
    Path("out/a.png").write_text("mine")
    Path("frames").mkdir()
    Path("frames/mine.txt").write_text("mine")
    np.save("flow.npy", np.ones((4, 4, 2)))
    assert sharpen("in/a.png", "in/b.png", "out", "--cluster", address) == 1
    assert run("visualize-flow", "flow.npy", "frames", "--cluster", address) == 1
    exists, not_empty = failures(capsys)
    assert "out/a.png exists already; add --overwrite" in exists
    assert "frames is not empty; add --overwrite" in not_empty
    assert Path("out/a.png").read_text() == "mine"
    assert names("out") == ["a.png", "b.png"]
    assert names("frames") == ["mine.txt"]


# ------------------------------------------------------------------------------- workers that die


def test_files_of_workers_that_die_are_done_by_others(address, folder, capsys):
    """Before the file is filtered, and when it is written but nobody has heard of it."""
    draw("a", "b", "unlucky", "c", "late", "d")
    assert sharpen("in/*.png", "here/") == 0
    for path in Path("in").glob("*.met"):
        path.unlink()
    assert sharpen("in/*.png", "there/", "--cluster", address) == 0
    assert contents("there") == contents("here")
    times = Counter(name for name, *_ in begun())
    assert min(times["unlucky"], times["late"]) >= 2  # more, if the result went with a worker
    processes = {process for _, process, _ in begun()}
    assert len(processes) >= 3  # two that died, and at least one that came for them
    assert {threads for *_, threads in begun()} == {"1"}
    assert "Failed" not in capsys.readouterr().err


def test_a_file_that_ends_each_worker_fails_alone(address, folder, capsys):
    draw("a", "deadly", "z")
    assert sharpen("in/*.png", "out/", "--cluster", address) == 1
    assert names("out") == ["a.png", "z.png"]
    (line,) = failures(capsys)
    assert line.endswith(
        "in/deadly.png: each worker that had it was lost; has it enough memory for this?"
    )


def failures(capsys):
    return [line for line in capsys.readouterr().err.splitlines() if line.startswith("Failed")]


# ------------------------------------------------------------------------------------- no cluster


@pytest.mark.parametrize("listens", [True, False])
def test_no_scheduler_is_said_within_seconds(folder, capsys, monkeypatch, listens):
    draw("a")
    if not listens:
        monkeypatch.setattr(scheduler, "_PATIENCE", 1.5)
    with socket.socket() as mute:
        mute.bind(("127.0.0.1", 0))
        if listens:
            mute.listen()
        address = f"tcp://127.0.0.1:{mute.getsockname()[1]}"
        start = time.monotonic()
        assert sharpen("in/a.png", "out/", "--cluster", address) == 1
        assert time.monotonic() - start < PATIENCE
    assert dask.config.get("scheduler", None) is None  # of the process, for all that comes later
    (line,) = failures(capsys)
    assert line.startswith(f"Failed: There is no Dask scheduler at {address}")
    assert line.endswith("start one with dask scheduler, or use --cluster local.")
    assert not Path("out").exists()


def test_no_dask_is_said(folder, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert sharpen("a.png", "out/", "--cluster", "local") == 1
    assert failures(capsys) == [
        "Failed: --cluster needs Dask; run: pip install 'shock-filter[cluster]'."
    ]


async def connected_with(address, security):
    """Connect as a client does; not by one, which may block when it is collected."""
    comm = await connect(address, timeout=1, **security.get_connection_args("client"))
    await comm.close()


def test_local_workers_are_reached_by_this_run_alone(folder):
    me = psutil.Process()
    others = set(me.children(recursive=True))  # the scheduler of other tests
    with scheduler.connected("local") as client:
        sockets = [
            socket
            for process in {me, *me.children(recursive=True)} - others
            for socket in process.net_connections("inet")
            if socket.status == psutil.CONN_LISTEN
        ]
        assert len(sockets) >= 3  # of the scheduler and two workers, at least
        assert {socket.laddr.ip for socket in sockets} == {"127.0.0.1"}
        where = client.scheduler.address
        assert where.startswith("tls://127.0.0.1:")
        assert all(worker.startswith("tls://") for worker in client.scheduler_info()["workers"])
        asyncio.run(connected_with(where, client.security))
        for address in (where, where.replace("tls:", "tcp:")):
            for security in (Security(), Security.temporary()):
                with pytest.raises((OSError, TypeError, RuntimeError)):
                    asyncio.run(connected_with(address, security))
        for port in {socket.laddr.port for socket in sockets}:
            for page in ("/health", "/metrics", "/info/main/workers.html", "/json/identity.json"):
                try:
                    urllib.request.urlopen(f"http://127.0.0.1:{port}{page}", timeout=1)
                except urllib.error.HTTPError as error:
                    assert error.code == 404
                except (OSError, http.client.HTTPException):
                    continue  # it speaks TLS
                else:
                    pytest.fail(f"{page} can be read")


def test_no_certificates_can_be_made(folder, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "cryptography", None)
    assert sharpen("a.png", "out/", "--cluster", "local") == 1
    assert "pip install 'shock-filter[cluster]'" in capsys.readouterr().err


def test_a_worker_with_another_version_is_refused(address, folder, capsys, monkeypatch):
    monkeypatch.setattr(cluster, "__version__", "9.8.7")
    draw("a")
    assert sharpen("in/a.png", "out/", "--cluster", address) == 1
    (line,) = failures(capsys)
    assert f"cannot be used: it has version {__version__} of Shock Filter, and 9.8.7 asks;" in line
    assert begun() == []


def test_a_scheduler_that_is_gone_is_said(folder, capsys):
    """And before that a worker without the package, and none at all."""
    draw("a")
    scheduler, address = start_scheduler()
    worker = start("worker", address, "--no-nanny", without="shock_filter")
    try:
        wait_for_workers(address, 1)
        assert sharpen("in/a.png", "out/", "--cluster", address) == 1
        (line,) = failures(capsys)
        assert re.search(r"The worker \S+ cannot be used: it cannot load Shock Filter \(", line)
        stop(worker)
        killing = threading.Timer(2.0, scheduler.kill)  # once it waits, also on a slow machine
        killing.start()
        start_time = time.monotonic()
        assert sharpen("in/a.png", "out/", "--cluster", address) == 1
        assert time.monotonic() - start_time < PATIENCE
        killing.join()
    finally:
        stop(worker)
        stop(scheduler)
    err = capsys.readouterr().err
    assert err.startswith("The cluster has no worker; waiting for one.\n")
    assert err.endswith(
        "is gone; 0 of 1 files were written. Start it again, and add --resume to go on.\n"
    )


# ------------------------------------------------------------------------------------- going on


def test_what_an_interrupted_run_left_undone_is_done_and_no_more(address, folder, capsys):
    draw("a", "b", "c", "endless 1", "endless 2", "z")
    with pressing_ctrl_c_when(lambda: sum("endless" in name for name, *_ in begun()) == 2):
        assert sharpen("in/*.png", "out/", "--cluster", address) == 130
    out, err = capsys.readouterr()
    first = contents("out")  # z may have been begun before the others
    assert f"Interrupted; {len(first)} of 6 files were written. Add --resume to go on." in err
    assert out.count(" -> ") == len(first)
    assert not [name for name in first if name.startswith("endless")]
    assert not list(Path("out").glob(".shock-filter-*"))
    for number in (1, 2):
        Path(f"in/endless {number}.png").rename(f"in/y{number}.png")
    Path("in/begun.txt").unlink()
    assert sharpen("in/*.png", "out/", "--cluster", address, "--resume") == 0
    missing = {path.name for path in Path("in").glob("*.png")} - first.keys()
    assert sorted(f"{name}.png" for name, *_ in begun()) == sorted(missing)
    assert capsys.readouterr().out.endswith(f"Skipped, as they are done already: {len(first)}\n")
    assert first.items() <= contents("out").items()
    assert sharpen("in/*.png", "here/") == 0
    assert contents("here") == contents("out")


class pressing_ctrl_c_when:
    """Press it as soon as something is so."""

    def __init__(self, is_so, group=None):
        self._is_so, self._group = is_so, group

    def __enter__(self):
        self._thread = threading.Thread(target=self._wait)
        self._thread.start()

    def _wait(self):
        end = time.monotonic() + 30
        while not self._is_so() and time.monotonic() < end:
            time.sleep(0.02)
        if self._group is None:
            os.kill(os.getpid(), signal.SIGINT)
        else:
            os.killpg(self._group, signal.SIGINT)

    def __exit__(self, *_):
        self._thread.join()


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="has no groups of processes")
def test_ctrl_c_on_a_terminal_reaches_local_workers_too_and_leaves_nothing(folder):
    draw("a", "b", "endless 1", "endless 2", "z")
    words = ["sharpen-image", "in/*.png", "out/", "--time=4", "--cluster", "local", "--quiet"]
    process = subprocess.Popen(
        [sys.executable, "-m", "shock_filter.core.cli", *words],
        env={**environment(), "DASK_DISTRIBUTED__WORKER__PRELOAD": PRELOAD},
        start_new_session=True,
        stderr=subprocess.PIPE,
        text=True,
    )
    cores = len(os.sched_getaffinity(0))
    with pressing_ctrl_c_when(
        lambda: sum("endless" in name for name, *_ in begun()) == min(cores, 2), process.pid
    ):
        _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    written = len(names("out"))
    assert f"Interrupted; {written} of 5 files were written. Add --resume to go on." in err
    assert {path.name for path in Path("out").iterdir() if path.is_dir()} == {".shock-filter"}
    while is_alive(process.pid):  # or this test takes too long
        time.sleep(0.05)


def is_alive(group):
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True

# SPDX-License-Identifier: GPL-3.0-or-later
"""The examples of README and docs are run as they are written, on small generated files."""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from examples import PAGES, ROOT, examples, write_inputs
from shock_filter.core import cli
from shock_filter.core.maps.names import files_of_maps

ALL = examples()
RUN = [example for example in ALL if example.reason is None]
SHELL = [example for example in RUN if example.language == "sh"]
COMMAND = re.compile(
    r"\b(?:(?:sharpen|denoise|dilate|filter|stitch|fill|make|remove|texture|geodesic|surface"
    r"|curvature|ambient|visualize|enlarge|repair|bake)-\w+|thickness|wear)\b"
)
SIMPLE = re.compile(r"(shock-filter [\w./*\" -]+\n)+")
PYTHON = [example for example in RUN if example.language == "python" and not example.in_blender]
BLENDER = [example for example in RUN if example.in_blender]

# The bpy module stands in for the program `blender`.
PROGRAM = """\
#!{python}
import os, runpy, sys
import bpy
import shock_filter
words = sys.argv[1:]
bpy.ops.wm.read_homefile(use_empty=True)
if words[0] == "--command":
    assert words[1] == "shock_filter"
    shock_filter.register()
    from shock_filter.shock_addon.commands import command_line
    code = command_line.run(words[2:], "blender --command shock_filter")
    shock_filter.unregister()
else:
    assert words.pop(0) == "-b"
    if words[0] != "-P":
        bpy.ops.wm.open_mainfile(filepath=words.pop(0))
    sys.argv = ["blender", *words]
    try:
        runpy.run_path(words[1], run_name="__main__")
    except SystemExit as stop:
        code = stop.code
sys.stdout.flush()
sys.stderr.flush()
os._exit(code)  # the bpy module, unlike Blender, may hang when Python takes it down
"""

SAVE_SCENE = """
import os
import bpy
bpy.ops.wm.read_homefile(use_empty=True)
bpy.ops.mesh.primitive_uv_sphere_add()
bpy.ops.wm.save_as_mainfile(filepath=os.path.abspath("scene.blend"))
"""

# What scripts for Blender find: a painted, textured ball, and images.
SCENE = """
import bpy
def scene():
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.mesh.primitive_uv_sphere_add()
    ball = bpy.context.object
    for name in ("Worn edges", "Scanned"):
        group = ball.vertex_groups.new(name=name)
        group.add([v.index for v in ball.data.vertices], 1.0, "REPLACE")
    ball.data.color_attributes.new("Paint", "FLOAT_COLOR", "POINT")
    for name in ("Photo", "Wood", "Dirt"):
        bpy.data.images.new(name, 16, 16).generated_color = (0.5, 0.5, 0.5, 1.0)
    material = bpy.data.materials.new("Wood")
    material.use_nodes = True
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = bpy.data.images["Wood"]
    shader = material.node_tree.nodes["Principled BSDF"]
    material.node_tree.links.new(node.outputs["Color"], shader.inputs["Base Color"])
    ball.data.materials.append(material)
    return {}
import shock_filter
shock_filter.register()
"""

# What the short examples of the Python interface take for granted.
ARRAYS = """
import numpy as np
from shock_filter import core
def scene():
    import trimesh
    ball = trimesh.creation.icosphere(subdivisions=3)
    vertices, faces = np.array(ball.vertices), np.array(ball.faces)
    mesh = core.TriangleMesh(vertices, faces)
    colors = np.tanh(vertices)
    return dict(
        vertices=vertices, faces=faces, mesh=mesh, colors=colors, corner_colors=colors[faces],
        uv=(0.5 + 0.5 * vertices[faces])[:, :, :2], image=np.eye(32)[:, :, None])
"""

RUNNER = """
import json, sys, traceback
results = {}
for name, text in json.load(sys.stdin).items():
    try:
        exec(compile(text, name, "exec"), scene())
        results[name] = ""
    except BaseException:
        results[name] = traceback.format_exc()
if "bpy" in sys.modules:
    shock_filter.unregister()
print()
print(json.dumps(results))
"""


def run_all(prelude, chosen, folder):
    """Run Python examples one after the other in one process; returns their tracebacks."""
    write_inputs(folder)
    texts = {example.name: example.text for example in chosen}
    process = subprocess.run(
        [sys.executable, "-c", prelude + RUNNER],
        input=json.dumps(texts), capture_output=True, text=True, cwd=folder, timeout=200,
    )  # fmt: skip
    assert process.returncode == 0, process.stderr
    return json.loads(process.stdout.splitlines()[-1])


@pytest.fixture(scope="module")
def in_blender(tmp_path_factory):
    return run_all(SCENE, BLENDER, tmp_path_factory.mktemp("blender"))


@pytest.fixture(scope="module")
def in_python(tmp_path_factory):
    return run_all(ARRAYS, PYTHON, tmp_path_factory.mktemp("python"))


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("inputs")
    write_inputs(folder)
    subprocess.run([sys.executable, "-c", SAVE_SCENE], cwd=folder, check=True, timeout=60)
    return folder


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    programs = tmp_path_factory.mktemp("programs")
    blender = programs / "blender"
    blender.write_text(PROGRAM.format(python=sys.executable))
    blender.chmod(0o755)
    path = [str(programs), str(Path(sys.executable).parent), os.environ["PATH"]]
    return {**os.environ, "PATH": os.pathsep.join(path)}


@pytest.mark.parametrize("name", [example.name for example in BLENDER])
def test_scripts_for_blender_run(name, in_blender):
    assert in_blender[name] == ""


@pytest.mark.parametrize("name", [example.name for example in PYTHON])
def test_python_examples_run(name, in_python):
    assert in_python[name] == ""


@pytest.mark.parametrize("example", SHELL, ids=lambda example: example.name)
def test_commands_run_and_write_what_they_name(example, inputs, environment, tmp_path, monkeypatch):
    shutil.copytree(inputs, tmp_path, symlinks=True, dirs_exist_ok=True)
    if SIMPLE.fullmatch(example.text):
        monkeypatch.chdir(tmp_path)
        for line in example.text.splitlines():
            run_here(line)
    else:
        process = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", example.text],
            cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=200,
        )  # fmt: skip
        assert process.returncode == 0, process.stdout + process.stderr
    for line in example.text.splitlines():
        words = COMMAND.split(line)[1].split(" --")[0].split()
        if " || " not in line and "--help" not in line:
            maps = line.partition("--map ")[2].split(" --")[0].split()
            files = files_of_maps(tmp_path / words[-1], maps) if maps else [tmp_path / words[-1]]
            assert all(path.exists() for path in files), f"{line} wrote no {words[-1]}"


def run_here(line):
    """Run shock-filter without a process of its own, which would load all kernels again."""
    try:
        code = cli.main(shlex.split(line)[1:])
    except SystemExit as stop:  # after --help
        code = stop.code
    assert code in (0, None), line


def test_each_example_says_what_it_is():
    languages = {example.language for example in ALL}
    assert languages == {"sh", "bat", "python"}
    assert len(SHELL) + len(PYTHON) + len(BLENDER) == len(RUN) > 20
    for path in PAGES:
        indented = re.search(r"\n\n {4}(?!-|\*|\d)\S.*", outside_of_fences(path))
        assert indented is None, f"{path.name}: put this into a fence: {indented[0]}"


def outside_of_fences(path):
    return re.sub(r"^```.*?^```$", "", path.read_text("utf-8"), flags=re.M | re.S)


def test_few_examples_are_not_run():
    left_out = [example for example in ALL if example.reason is not None]
    assert len(left_out) <= 29
    assert all(len(example.reason) > 10 for example in left_out)


def test_readme_has_the_two_commands_to_begin_with():
    readme = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    for session in ("demo", "test"):
        assert f"python3 -m pip install nox && python3 -m nox -s {session}" in readme

# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line: flags, several inputs, messages, exit codes."""

import io
import math
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image
from shock_filter import core
from shock_filter.core import cli
from shock_filter.core.files.output import Outcome
from shock_filter.core.settings import describe

ROOF = """v 0 0 0
v 1 0 0
v 2 0 0
v 0 1 1
v 1 1 1.2
v 2 1 1
v 0 2 0
v 1 2 0
v 2 2 0
f 1 2 5 4
f 2 3 6 5
f 4 5 8 7
f 5 6 9 8
"""
STILL = ["--time", "0"]


class Recorder:
    """A backend that copies files and remembers what it was asked."""

    prog = "shock-filter"
    offered = cli.COMMANDS

    def __init__(self):
        self.calls = []
        self.commands = []

    def formats(self, command):
        return "any files"

    def add_arguments(self, parser, command):
        pass

    def filter(self, command, source, target, settings, options, progress):
        self.calls.append((source, target, settings))
        self.commands.append(command.command)
        target.write_bytes(Path(source).read_bytes())
        return Outcome(9, 3, ("a note",))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def make(*names):
    for name in names:
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_text(ROOF)


def sharpen(*words, backend=None):
    return cli.main(["sharpen-geometry", *map(str, words)], backend)


def usage_error(capsys, *words):
    with pytest.raises(SystemExit) as stop:
        sharpen(*words, backend=Recorder())
    assert stop.value.code == 2
    return capsys.readouterr().err


# ------------------------------------------------------------------------------------------ flags


@pytest.mark.parametrize(
    "command, settings",
    [
        ("sharpen-geometry", core.GeometrySettings),
        ("sharpen-colors", core.ShockSettings),
        ("sharpen-image", core.ImageSettings),
        ("denoise-geometry", core.BeltramiGeometrySettings),
        ("denoise-colors", core.BeltramiMeshSettings),
        ("denoise-image", core.BeltramiSettings),
    ],
)
def test_flags_are_the_settings_with_their_defaults(folder, command, settings):
    make("a.obj")
    recorder = Recorder()
    assert cli.main([command, "a.obj", "b.obj"], recorder) == 0
    assert recorder.calls == [("a.obj", Path("b.obj"), settings())]
    words, wanted = [], {}
    for name, (kind, default, about) in describe(settings).items():
        if kind is str:
            value = next(word for word in reversed(about.choices) if word != default)
        else:
            value = min(default + (1 if kind is int else 1.25), about.maximum)
            value = value if value != default else default - 0.25
        assert value != default
        words += ["--" + name.replace("_", "-"), str(value)]
        wanted[name] = value
    assert cli.main([command, *words, "a.obj", "c.obj"], recorder) == 0
    assert recorder.calls[1][2] == settings(**wanted)
    assert recorder.commands == [command, command]


@pytest.mark.parametrize(
    "command, settings",
    [
        ("denoise-texture", core.BeltramiTextureSettings),
        ("sharpen-texture", core.TextureSettings),
        ("filter-texture", core.FilterSettings),
        ("stitch-textures", core.StitchSettings),
        ("dilate-texture", core.DilateSettings),
    ],
)
def test_the_mesh_stands_before_its_textures(folder, command, settings):
    make("mesh.obj", "in/a.png", "in/b.png")
    recorder = Recorder()
    assert cli.main([command, "mesh.obj", "in/a.png", "--gutter", "3", "c.png"], recorder) == 0
    assert recorder.calls == [("in/a.png", Path("c.png"), settings(gutter=3))]
    assert cli.main([command, "mesh.obj", "in/*.png", "out/"], recorder) == 0
    assert sorted(os.listdir("out")) == ["a.png", "b.png"]
    with pytest.raises(SystemExit) as stop:
        cli.main([command, "mesh.obj", "in/a.png"], recorder)
    assert stop.value.code == 2


@pytest.mark.parametrize(
    "words, sentence",
    [
        ([], "one of the arguments --size --like is required"),
        (["--size", "64x64", "--like", "a.png"], "not allowed with argument"),
        (["--size", "64"], "invalid size, such as 1024x512 value: '64'"),
        (["--size", "0x4"], "invalid size, such as 1024x512 value: '0x4'"),
        (["--size", "64x64", "--kind", "odd"], "invalid choice: 'odd'"),
    ],
)
def test_masks_of_bad_size_or_kind_are_usage_errors(folder, capsys, words, sentence):
    with pytest.raises(SystemExit) as stop:
        cli.main(["texture-mask", "mesh.obj", "out.png", *words], Recorder())
    assert stop.value.code == 2
    assert sentence in capsys.readouterr().err


def test_flags_may_stand_between_and_time_may_be_endless(folder):
    make("a.obj")
    recorder = Recorder()
    assert sharpen("a.obj", "--time", "inf", "b.obj", backend=recorder) == 0
    assert recorder.calls[0][2].time == math.inf


@pytest.mark.parametrize("command", cli.COMMANDS)
def test_help_says_description_unit_range_and_default(capsys, command):
    with pytest.raises(SystemExit) as stop:
        cli.main([command.command, "--help"])
    assert stop.value.code == 0
    text = " ".join(capsys.readouterr().out.split())
    for name, (_, default, about) in describe(command.settings).items():
        assert "--" + name.replace("_", "-") in text
        assert about.description in text
        for meaning in about.choices.values():
            assert meaning in text
        if not about.choices:
            assert about.unit in text
            form = ".0f" if isinstance(default, int) else "g"
            ends = f"{about.minimum:{form}} to {about.maximum:{form}}"
            assert f"(default {default:g}, {ends}{',' if about.unit else ')'}" in text
    makes = command.kind.is_drawn or command.kind.makes_frames
    unmasked = command.command in ("dilate-texture", "enlarge-texture") or makes
    assert ("--mask" in text) != unmasked
    textures = ["denoise-texture", "sharpen-texture", "filter-texture", "stitch-textures"]
    textures += ["fill-texture", "repair-texture"]
    of_textures = unmasked or command.command in textures
    assert ("--material" in text) == of_textures
    assert ("--gain-map" in text) == (command.command == "filter-texture")
    assert ("--with FILE" in text) == (command.command == "stitch-textures")
    assert ("--size WxH" in text) == makes


def test_help_is_quick_and_loads_no_numerics():
    code = (
        "import sys; from shock_filter.core import cli\n"
        "try: cli.main(['--help'])\n"
        "except SystemExit: pass\n"
        "print({'numpy', 'numba', 'scipy', 'trimesh', 'PIL', 'dask'} & set(sys.modules))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert run.stdout.splitlines()[-1] == "set()", run.stderr
    assert "exit codes" in run.stdout


@pytest.mark.parametrize(
    "words, sentence",
    [
        (["--time", "-1"], "time is -1; give a value from 0 to inf flow time in mean edge lengths"),
        (["--time", "nan"], "time is nan; give a value from 0 to inf"),
        (["--time", "long"], "argument --time: invalid number value: 'long'"),
        (["--smoothing-passes", "1.5"], "smoothing_passes is 1.5; give a whole number"),
        (["--sampling", "blurry"], "invalid choice: 'blurry'"),
        (["--fidelity", "9"], "--fidelity is no flag any more: give screening_radius"),
        (["--fidelity=9"], "--fidelity is no flag any more: give screening_radius"),
        (["--scheme", "fixed"], "unrecognized arguments: --scheme"),
        (["--tim", "3"], "unrecognized arguments: --tim"),
    ],
)
def test_bad_values_are_usage_errors(folder, capsys, words, sentence):
    make("a.obj")
    assert sentence in usage_error(capsys, *words, "a.obj", "b.obj")
    assert not Path("b.obj").exists()


def test_inverting_no_mask_is_a_usage_error(folder, capsys):
    make("a.obj")
    for command in ("sharpen-geometry", "sharpen-colors", "denoise-image"):
        with pytest.raises(SystemExit) as stop:
            cli.main([command, "a.obj", "b.obj", "--invert-mask"])
        assert stop.value.code == 2
        assert "--invert-mask needs --mask" in capsys.readouterr().err
    assert not Path("b.obj").exists()


def test_missing_words_are_usage_errors(capsys):
    assert "OUT" in usage_error(capsys, "a.obj")
    with pytest.raises(SystemExit) as stop:
        cli.main([])
    assert stop.value.code == 2
    with pytest.raises(SystemExit) as stop:
        cli.main(["polish", "a.obj", "b.obj"])
    assert stop.value.code == 2


# ------------------------------------------------------------------------------- inputs and outputs


def test_several_inputs_go_to_a_folder_that_is_made(folder):
    make("in/a.obj", "in/b.obj")
    recorder = Recorder()
    assert sharpen("in/a.obj", "in/b.obj", "out/deep", backend=recorder) == 0
    assert sorted(os.listdir("out/deep")) == ["a.obj", "b.obj"]


@pytest.mark.parametrize("output", ["out/", "ready"])
def test_one_input_goes_to_a_folder(folder, output):
    make("a.obj")
    Path("ready").mkdir()
    assert sharpen("a.obj", output, backend=Recorder()) == 0
    assert Path(output, "a.obj").exists()


def test_patterns_are_expanded(folder):
    make("in/a.obj", "in/b.obj", "in/deep/c.obj", "in/[odd].obj")
    recorder = Recorder()
    assert sharpen("in/?.obj", "in/**/c.obj", "in/[odd].obj", "out", backend=recorder) == 0
    assert sorted(os.listdir("out")) == ["[odd].obj", "a.obj", "b.obj", "c.obj"]


def test_an_input_named_twice_is_done_once(folder):
    make("in/a.obj", "in/b.obj")
    recorder = Recorder()
    assert sharpen("in/a.obj", "in/*.obj", "out", backend=recorder) == 0
    assert [source for source, _, _ in recorder.calls] == ["in/a.obj", os.path.join("in", "b.obj")]


def test_names_that_collide_are_usage_errors(folder, capsys):
    make("in/a.obj", "also/a.obj")
    message = usage_error(capsys, "in/a.obj", "also/a.obj", "out")
    assert "in/a.obj and also/a.obj would both be written to" in message
    assert not Path("out").exists()


def test_several_inputs_into_a_file_are_a_usage_error(folder, capsys):
    make("a.obj", "b.obj", "c.obj")
    assert "several inputs need a folder" in usage_error(capsys, "a.obj", "b.obj", "c.obj")


def test_nothing_is_overwritten_unless_asked(folder, capsys):
    make("a.obj")
    Path("b.obj").write_text("mine")
    for target in ("b.obj", "a.obj", "."):
        assert sharpen("a.obj", target) == 1
        assert "exists already; add --overwrite" in capsys.readouterr().err
    assert Path("b.obj").read_text() == "mine"
    assert Path("a.obj").read_text() == ROOF
    assert sharpen("a.obj", "b.obj", "--overwrite", *STILL) == 0
    assert Path("b.obj").read_text() == ROOF


def test_failures_do_not_stop_the_others(folder, capsys):
    make("in/a.obj", "in/z.obj")
    Path("in/broken.obj").write_text("v 0 0\n")
    assert sharpen("in/a.obj", "in/broken.obj", "in/gone.obj", "in/z.obj", "out", *STILL) == 1
    out, err = capsys.readouterr()
    assert sorted(os.listdir("out")) == ["a.obj", "z.obj"]
    failures = err.splitlines()
    assert len(failures) == 2
    assert failures[0].startswith("Failed: in/broken.obj cannot be read")
    assert failures[1].startswith("Failed: There is no file in/gone.obj")
    assert len(out.splitlines()) == 2


class Unlucky(Recorder):
    """A backend that meets what nobody thought of."""

    def __init__(self, error):
        super().__init__()
        self.error = error

    def filter(self, command, source, target, settings, options, progress):
        if source == "a.obj":
            raise self.error
        return super().filter(command, source, target, settings, options, progress)


def test_an_unforeseen_error_does_not_stop_the_others(folder, capsys):
    make("a.obj", "b.obj")
    assert sharpen("a.obj", "b.obj", "out/", backend=Unlucky(KeyError("x"))) == 1
    assert os.listdir("out") == ["b.obj"]
    err = capsys.readouterr().err
    assert err.startswith("Traceback")
    assert err.endswith("Failed: a.obj: KeyError: 'x'\n")


@pytest.mark.parametrize("words", [("Unable to allocate 40 GiB",), ()])
def test_too_little_memory_is_said_in_a_sentence(folder, capsys, words):
    make("a.obj", "b.obj")
    assert sharpen("a.obj", "b.obj", "out/", backend=Unlucky(MemoryError(*words))) == 1
    assert os.listdir("out") == ["b.obj"]
    reason = " (Unable to allocate 40 GiB)" if words else ""
    said = f"Failed: a.obj needs more memory than there is{reason}; free some.\n"
    assert capsys.readouterr().err == said


def test_a_pattern_without_a_match_fails(folder, capsys):
    assert sharpen("*.obj", "out/") == 1
    assert "*.obj" in capsys.readouterr().err


def tile(*words):
    return cli.main(["make-tileable", *words, "--quiet"])


def draw(*names):
    Path("in").mkdir()
    for number, name in enumerate(names):
        Image.new("RGB", (8, 8), (60 * number, 90, 200)).save(f"in/{name}")


def test_each_input_of_a_pattern_has_a_picture_of_its_own(folder, capsys):
    draw("a.png", "a.bmp", "b.png")
    assert tile("in/*", "out/", "--picture", "tiles.png") == 0
    names = [f"{name} tiles.png" for name in ("a.bmp", "a.png", "b.png")]
    assert sorted(path.name for path in Path().glob("*.png")) == names
    for name in names:
        made = Image.open(Path("out", name.split()[0])).convert("RGB")
        assert Image.open(name).getpixel((0, 0)) == made.getpixel((0, 0))
    assert tile("in/b*", "one/", "--picture", "tiles.png") == 0
    assert Path("tiles.png").exists()


@pytest.mark.parametrize(
    ("inputs", "picture", "reason"),
    [
        ("in/a.png", "in/a.png", "is an input"),
        ("in/a.png", "out/../out/a.png", "is an output"),
        ("in/[ab].png", "out/tiles.png", "is an output"),
        ("in/b.png", "in/a.png", "is read"),
        ("in/[ab].png", "linked/tiles.png", "is the picture of another input"),
    ],
)
def test_pictures_replace_no_other_file_of_the_run(folder, capsys, inputs, picture, reason):
    draw("a.png", "b.png", "b.png tiles.png")
    before = {path: path.read_bytes() for path in Path("in").iterdir()}
    Path("linked").mkdir()
    Path("linked/a.png tiles.png").symlink_to("b.png tiles.png")
    words = [inputs, "out/", "--mask", "in/a.png", "--overwrite", "--picture", picture]
    if picture == "out/tiles.png":
        words.insert(0, "in/b.png tiles.png")
    with pytest.raises(SystemExit) as stop:
        tile(*words)
    assert stop.value.code == 2
    assert f"{reason}, too; name another file with --picture" in capsys.readouterr().err
    assert not Path("out").exists()
    assert before == {path: path.read_bytes() for path in Path("in").iterdir()}


def test_an_output_that_cannot_be_written_fails(folder, capsys):
    make("a.obj")
    Path("file").write_text("")
    for place in ("file", "file/deeper"):
        assert sharpen("a.obj", f"{place}/b.obj") == 1
        said = capsys.readouterr().err
        assert said.startswith(f"Failed: a.obj: Cannot make the folder {place} (")
        assert said.endswith("); choose another output.\n")
    assert sharpen("a.obj", "deep/folder/b.obj", *STILL) == 0


def test_a_folder_that_takes_no_files_is_refused_before_anything_is_computed(folder, monkeypatch):
    make("a.obj")
    monkeypatch.setattr(os, "access", lambda *_, **__: False)
    backend = Recorder()
    assert sharpen("a.obj", "b.obj", backend=backend) == 1
    assert backend.calls == []


# ------------------------------------------------------------------------------- what is printed


def test_one_line_a_file_and_its_notes(folder, capsys):
    make("a.obj")
    assert sharpen("a.obj", "b.obj", backend=Recorder()) == 0
    out, err = capsys.readouterr()
    assert out.splitlines()[0].startswith("a.obj -> b.obj: moved 3 of 9 vertices in ")
    assert out.splitlines()[1] == "  a note"
    assert err == ""


def unread():
    reading, writing = os.pipe()
    os.close(reading)
    return os.fdopen(writing, "w")


def on_a_full_disk():
    return open("/dev/full", "w")


def in_another_encoding():
    return open("log.txt", "w", encoding="cp1252")


@pytest.mark.skipif(sys.platform != "linux", reason="needs /dev/full")
@pytest.mark.parametrize("make_stream", [unread, on_a_full_disk, in_another_encoding])
def test_output_that_cannot_be_printed_stops_no_batch(folder, monkeypatch, make_stream):
    names = [f"日本 {number}.obj" for number in range(3)]
    for name in [*names, "bad.obj"]:
        Path(name).write_text("nothing" if name == "bad.obj" else ROOF)
    stream = make_stream()
    monkeypatch.setattr(sys, "stdout", stream)
    monkeypatch.setattr(sys, "stderr", stream)
    code = sharpen(*names[:1], "bad.obj", *names[1:], "out", *STILL)
    stream.close()  # writes what is left
    assert code == 1  # for the one that is bad
    assert sorted(path.name for path in Path("out").iterdir()) == names
    if make_stream is in_another_encoding:
        assert "\\u65e5\\u672c 2.obj" in Path("log.txt").read_text(encoding="cp1252")


def test_quiet_prints_errors_only(folder, capsys):
    make("a.obj")
    assert sharpen("a.obj", "gone.obj", "out", "--quiet", *STILL) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1


class Terminal(io.StringIO):
    """A standard error that says it is a terminal."""

    def isatty(self):
        return True


def test_bar_on_a_terminal_only(folder, monkeypatch):
    make("a.obj")
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    assert sharpen("a.obj", "b.obj") == 0
    drawn = terminal.getvalue().split("\r\x1b[K")
    assert any("a.obj [##########" in line for line in drawn)
    assert drawn[-1] == ""
    terminal.truncate(0)
    assert sharpen("a.obj", "c.obj", "--quiet") == 0
    assert terminal.getvalue().strip("\0") == ""


# ------------------------------------------------------------------------------------ interruption


class Interrupted(cli.FileBackend):
    """Ctrl-C is pressed at the third report of progress."""

    presses = 1

    def filter(self, command, source, target, settings, options, progress):
        calls = []

        def pressing(fraction, message):
            calls.append(fraction)
            if len(calls) == 3:
                for _ in range(self.presses):
                    signal.raise_signal(signal.SIGINT)
            return progress(fraction, message)

        return super().filter(command, source, target, settings, options, pressing)


class TwiceInterrupted(Interrupted):
    """Ctrl-C is pressed twice."""

    presses = 2


class Stubborn(Recorder):
    """A backend that never asks; Ctrl-C twice ends it with an error of its own, as Blender does."""

    def filter(self, command, source, target, settings, options, progress):
        signal.raise_signal(signal.SIGINT)
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt as error:
            raise core.ShockError("Python: Traceback") from error


class InterruptedWhileWriting(cli.FileBackend):
    """Ctrl-C comes when the file is as good as written."""

    def filter(self, command, source, target, settings, options, progress):
        outcome = super().filter(command, source, target, settings, options, progress)
        signal.raise_signal(signal.SIGINT)
        return outcome


def test_ctrl_c_while_the_output_is_written(folder, capsys):
    make("in/a.obj", "in/b.obj")
    backend = InterruptedWhileWriting()
    assert sharpen("in/a.obj", "a.obj", backend=backend) == 0
    assert Path("a.obj").exists()
    assert "Interrupted" not in capsys.readouterr().err
    assert sharpen("in/a.obj", "in/b.obj", "out", backend=backend) == 130
    assert [path.name for path in Path("out").iterdir()] == ["a.obj"]
    assert "Interrupted; out/b.obj was not written" in capsys.readouterr().err.replace("\\", "/")


@pytest.mark.parametrize("backend", [Interrupted(), TwiceInterrupted(), Stubborn()])
def test_ctrl_c_ends_without_output(folder, capsys, backend):
    make("in/a.obj", "in/b.obj")
    before = signal.getsignal(signal.SIGINT)
    assert sharpen("in/a.obj", "in/b.obj", "out", backend=backend) == 130
    assert os.listdir("out") == []
    lines = capsys.readouterr().err.replace(os.sep, "/").splitlines()
    assert lines[1:] == [
        "Stopping; press Ctrl-C again if this takes too long.",
        "Interrupted; out/a.obj was not written.",
    ]
    assert signal.getsignal(signal.SIGINT) is before


def test_the_installed_command(folder):
    make("a.obj")
    command = Path(sys.executable).with_name("shock-filter")
    run = subprocess.run(
        [command, "sharpen-geometry", "a.obj", "b.obj", *STILL],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert (run.returncode, run.stderr) == (0, "")
    assert run.stdout.startswith("a.obj -> b.obj: moved 0 of 9 vertices")
    assert Path("b.obj").read_text() == ROOF

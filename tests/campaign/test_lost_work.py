"""What could lose work or leave litter: kills, Ctrl-C, full disks, names that cannot be written."""

import dataclasses
import json
import os
import signal
import stat
import subprocess
import sys
import tempfile

import click
import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.figure import Figure
from zoo import interval_problem

import sdhj
from sdhj import cli, plotting
from sdhj import cli as cli_module
from sdhj.table.files import replaced_whole, writable_file

pytestmark = pytest.mark.usefixtures("signals_are_heard")

WRITING = """
import os, runpy, signal, sys, time
sys.argv = [{name!r}, "act"]
from sdhj.table.files import replaced_whole
def act():
    with replaced_whole("a.txt") as temporary:
        temporary.write_text("half")
        print("writing", flush=True)
        time.sleep(300)
"""
AS_A_PROGRAM = "act()\n"
AS_A_COMMAND = """
from sdhj.cli import main
main.command("act")(act)
runpy.run_module("sdhj", run_name="__main__", alter_sys=True)
"""  # `python -m sdhj act`, with a command that is not among its own


def started(code, folder=None):
    """A process that runs code and has come so far as to print a line."""
    command = [sys.executable, "-c", code]
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    if not process.stdout.readline():
        raise RuntimeError(process.communicate()[1])
    return process


def writing(folder, name="sdhj"):
    """A process that has written half a file: the command, or a program of another name."""
    return started(WRITING.format(name=name) + (AS_A_COMMAND if name == "sdhj" else AS_A_PROGRAM), folder)


@pytest.mark.slow
@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_the_command_ends_at_a_signal_with_a_sentence_and_no_litter(tmp_path, number, status):
    process = writing(tmp_path)
    process.send_signal(number)
    _, told = process.communicate(timeout=100)
    assert process.returncode == status
    assert told.count("\n") == 2 and "sdhj was" in told and "Traceback" not in told
    assert os.listdir(tmp_path) == []


@pytest.mark.slow
def test_programs_that_import_it_keep_their_own_signals(tmp_path):
    process = writing(tmp_path, name="robot.py")
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=100)
    assert "KeyboardInterrupt" in told and os.listdir(tmp_path) == []


@pytest.mark.slow
def test_a_package_that_imports_it_keeps_its_own_signals(tmp_path):
    """Also where `python -m` runs it, under whose name the command is known, too."""
    (tmp_path / "robot").mkdir()
    code = "import sdhj, signal\nprint(signal.getsignal(signal.SIGINT) is signal.default_int_handler)\n"
    (tmp_path / "robot" / "__init__.py").write_text(code)
    (tmp_path / "robot" / "__main__.py").touch()
    done = subprocess.run([sys.executable, "-m", "robot"], cwd=tmp_path, capture_output=True, text=True)
    assert done.stdout == "True\n", done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_killed_process_leaves_no_half_written_file_under_its_name(tmp_path, number):
    killed = writing(tmp_path, name="robot.py")
    killed.send_signal(number)
    killed.communicate(timeout=100)
    assert [name.startswith(".sdhj-") for name in os.listdir(tmp_path)] == [True]


@pytest.mark.slow
def test_no_ctrl_c_is_swallowed():
    """Python ignores what is raised while an object is taken away, a KeyboardInterrupt too."""
    swallow = """
class Swallowing:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.1)
def act():
    object = Swallowing()
    del object
    print("went on")
"""
    code = WRITING.format(name="sdhj") + swallow + AS_A_COMMAND
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=100)
    assert (done.returncode, done.stdout) == (130, "")


def test_other_commands_end_at_ctrl_c_with_130_as_well():
    @click.command()
    @cli.plainly
    def command():
        raise KeyboardInterrupt

    done = CliRunner().invoke(command)
    assert done.exit_code == 130 and "interrupted" in done.output


# ---- names


@pytest.mark.parametrize("length", [213, 214, 240, 255])
def test_names_as_long_as_the_system_takes_are_written(tmp_path, length):
    path = tmp_path / ("a" * (length - 4) + ".npz")
    table = sdhj.solve(interval_problem(nodes=9, steps=1), progress=False)
    table.save(writable_file(path))
    assert sdhj.load(path, problem=table.problem).steps == 1 and os.listdir(tmp_path) == [path.name]


@pytest.mark.parametrize("name", ["a" * 256 + ".npz", "a\0b.npz", "x." + "a" * 240])
def test_names_that_cannot_be_written_are_found_before(tmp_path, name):
    with pytest.raises(OSError, match=r"cannot use the name .*: |cannot write in .*name too long"):
        writable_file(tmp_path / name)


def test_names_that_are_not_utf_8_are_written(tmp_path):
    path = tmp_path / os.fsdecode(b"\xff.npz")
    done = CliRunner().invoke(cli.main, ["solve", "--nodes", "7", "--steps", "1", "-o", str(path)])
    assert done.exit_code == 0, done.output
    assert CliRunner().invoke(cli.main, ["info", str(path)]).exit_code == 0


@pytest.mark.parametrize("name", ["a\0b", "a\nb", os.fsdecode(b"\xff"), b"bytes", None])
def test_problem_names_that_no_file_takes_are_found_before(name):
    with pytest.raises(ValueError, match="name must be text"):
        dataclasses.replace(interval_problem(), name=name)


def test_recipes_that_no_file_takes_are_found_before():
    for recipe in ({"a": np.zeros(3)}, {"a": {1, 2}}, {"a": float("nan")}, 7):
        with pytest.raises(ValueError, match="be written as JSON"):
            dataclasses.replace(interval_problem(), recipe=recipe)


# ---- full disks; a limit on the size of files stands for them


def test_a_table_outlives_a_full_disk(tmp_path, files_of_at_most):
    table = sdhj.solve(interval_problem(nodes=9, steps=1), progress=False)
    with files_of_at_most(1000), pytest.raises(OSError, match=r"t\.npz: File too large") as told:
        table.save(tmp_path / "t.npz")
    assert "memory: save it elsewhere" in str(told.value)
    assert table.fraction(start=0, within=1) > 0 and os.listdir(tmp_path) == []
    table.save(tmp_path / "t.npz")
    assert (tmp_path / "t.npz").stat().st_size > 1000


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["png", "pdf", "svg"])
def test_pictures_on_a_full_disk_are_an_error_in_words(tmp_path, monkeypatch, files_of_at_most, kind):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    figure = Figure()
    figure.subplots().plot(range(1000))
    plotting.save(figure, tmp_path / "whole", "x", (kind,))
    assert (tmp_path / "whole" / f"x.{kind}").stat().st_size > 1000
    with (
        files_of_at_most(1000),
        pytest.raises(OSError, match="large; free some space"),
    ):
        plotting.save(figure, tmp_path, "x", (kind,))
    assert os.listdir(tmp_path) == ["whole"]


def solve_to(path):
    return CliRunner().invoke(cli.main, ["solve", "--nodes", "7", "--steps", "1", "-o", str(path)])


@pytest.fixture
def full(tmp_path, monkeypatch):
    """A folder on a disk that fills up while the table is solved."""
    from sdhj.table.table import LookupTable

    (tmp_path / "full").mkdir()
    save = LookupTable.save

    def failing(table, path):
        if "full" in str(path):
            raise OSError(f"cannot write {path}: No space left on device")
        save(table, path)

    monkeypatch.setattr(LookupTable, "save", failing)
    return tmp_path / "full" / "arm.npz"


def test_the_command_keeps_the_table_and_says_where(full, tmp_path, monkeypatch):
    kept = tmp_path / "temporary"
    kept.mkdir()
    monkeypatch.setattr(cli_module, "gettempdir", lambda: str(kept))
    done = solve_to(full)
    (name,) = os.listdir(kept)
    assert done.exit_code == 2 and "space left on device" in done.output
    assert name in done.output
    assert sdhj.load(kept / name).steps == 1


def test_files_reach_the_disk_before_they_take_their_name(tmp_path, monkeypatch):
    """The content first, then the name, then the folder that holds it."""
    done, fsync, replace = [], os.fsync, os.replace

    def synced(file):
        done.append("folder" if stat.S_ISDIR(os.fstat(file).st_mode) else "file")
        fsync(file)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(os, "replace", lambda *paths: (done.append("name"), replace(*paths)))
    with replaced_whole(tmp_path / "a.txt") as temporary:
        temporary.write_text(json.dumps(1))
    assert done == ["file", "name", "folder"]


# ---- what keeps a file from being read is told as what it is


def test_a_file_that_cannot_be_read_is_not_called_damaged(tmp_path, monkeypatch):
    path = tmp_path / "a.npz"
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="device or a pipe"):
        sdhj.load(tmp_path / "pipe")
    path.touch()

    def denied(*arguments, **options):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "open", denied)
    with pytest.raises(PermissionError, match=r"a\.npz: Permission denied"):
        sdhj.load(path)

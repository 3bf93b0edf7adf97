"""The command line: each command on a small grid, and one clear line for everything that is wrong."""

import json
import re
import subprocess
import sys

import pytest
from click.testing import CliRunner
from forging import forged
from toys import torus_problem

import sdhj
from sdhj import cli
from sdhj.cli import WARM_CELLS, main


def run(*arguments):
    return CliRunner().invoke(main, [str(a) for a in arguments])


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    path = tmp_path_factory.mktemp("tables") / "arm.h5"
    result = run("solve", "--nodes", 9, "--steps", 3, "-o", path)
    assert result.exit_code == 0, result.output
    assert re.search(r"\d+\.\d% of C", result.output)
    return path


def test_solve_writes_a_table_that_loads(saved):
    table = sdhj.load(saved)
    assert table.method == "hji" and table.grid.shape == (9,) * 4 and table.steps == 3


def test_cells_go_with_the_certified_method(tmp_path):
    path = tmp_path / "certified.h5"
    options = ["--nodes", 9, "--steps", 1, "-o", path]
    result = run("solve", *options, "--method", "certified", "--cells", "42,42,12,12")
    assert result.exit_code == 0, result.output
    assert sdhj.load(path).details["cells"] == [42, 42, 12, 12]
    for wrong in (["--cells", "42,42,12,12"], ["--method", "certified", "--cells", "many"]):
        refused = run("solve", *options, *wrong)
        assert refused.exit_code == 2 and "cells" in refused.output and "Traceback" not in refused.output


def test_info_tells_what_the_file_holds(saved):
    result = run("info", saved)
    assert result.exit_code == 0
    table = sdhj.load(saved)
    for text in (
        "method hji",
        "9 nodes",
        "25 inputs",
        table.problem.digest,
        f"{table.fraction(start=0, within=3):.4f}",
    ):
        assert text in result.output


def test_simulate_plays_one_run_and_many(saved):
    many = run("simulate", saved, "--runs", 50, "--adversary", "random")
    assert many.exit_code == 0, many.output
    assert "reached" in many.output
    lost = run("simulate", saved, "--start", 3.0, 3.0, 0.0, 0.0)
    assert lost.exit_code == 2 and "Traceback" not in lost.output


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["solve", "--nodes", 3, "-o", "x.h5"], "got 3"),
        (["solve", "--method", "magic", "-o", "x.h5"], "magic"),
        (["solve", "--steps", 0, "-o", "x.h5"], "steps"),
        (["solve", "-o", "/nonexistent/folder/x.h5"], "folder"),
        (["solve", "-o", "."], "folder"),
        (["info", "missing.h5"], "missing.h5"),
        (["simulate", "missing.h5"], "missing.h5"),
        (["solve", "--nodes", "9" * 400, "-o", "x.h5"], "nodes must be a whole number from 1 to 1,000,000, got 999"),
        (["solve", "--steps", "9" * 400, "-o", "x.h5"], "steps must be a whole number from 1 to 1,000,000, got 999"),
        (["verify", "missing.h5", "-o", "x.txt"], "x.txt must end in .png or .pdf or .svg"),
        (["nonsense"], "nonsense"),
    ],
)
def test_what_is_wrong_is_one_line_and_status_2(arguments, named, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = run(*arguments)
    assert result.exit_code == 2
    assert named in result.output and "Traceback" not in result.output
    assert list(tmp_path.iterdir()) == []  # nothing half-written
    (line,) = [line for line in result.output.splitlines() if line.startswith("Error")]
    assert len(line) < 300


def test_options_that_do_not_go_together_are_refused(saved, tmp_path):
    """None of them is dropped without a word."""
    certified, picture = tmp_path / "certified.h5", tmp_path / "x.png"
    problem = sdhj.arm_case_study(nodes=5, steps=1)
    sdhj.solve(problem, sdhj.Certified(cells=WARM_CELLS), progress=False).save(certified)
    cases = {
        "--start simulates one run": ["simulate", saved, "--start", 0.0, 0.0, 0.2, 0.2, "--runs", 10],
        "is itself a certified table": ["verify", certified, "-o", picture],
        "leave out --certified": ["verify", certified, "--certified", certified],
        "--samples applies to certified tables only": ["verify", saved, "--certified", certified, "--samples", 5],
    }
    for named, arguments in cases.items():
        result = run(*arguments)
        assert result.exit_code == 2 and named in result.output, result.output
    assert not picture.exists()


def test_damaged_file_is_one_line(tmp_path):
    path = tmp_path / "broken.h5"
    path.write_bytes(b"\x89HDF\r\n\x1a\n then nothing")
    result = run("info", path)
    assert result.exit_code == 2 and "damaged" in result.output and "Traceback" not in result.output


def test_help_explains_each_command_in_a_line():
    result = run("--help")
    assert result.exit_code == 0
    for command in main.commands:
        (line,) = [line for line in result.output.splitlines() if line.strip().startswith(command + " ")]
        assert len(line.split()) > 4
        assert run(command, "--help").exit_code == 0


def test_an_adversary_that_does_nothing(saved):
    result = run("simulate", saved, "--runs", 20, "--adversary", "none")
    assert result.exit_code == 0 and "none" in result.output


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    path = tmp_path_factory.mktemp("tables") / "own.h5"
    sdhj.solve(torus_problem(nodes=12, steps=2), progress=False).save(path)
    return path


def test_info_of_your_user_problem_needs_no_functions(own):
    result = run("info", own)
    assert result.exit_code == 0, result.output
    table = sdhj.load(own, problem=torus_problem(nodes=12, steps=2))
    told = (
        "method hji",
        "x1: 12 nodes on [-3.14159, 3.14159], periodic",
        "2 steps of 0.2 s, 9 inputs",
        sdhj.__version__,
    )
    for text in (*told, table.problem.digest, json.dumps(dict(table.details), sort_keys=True)):
        assert text in result.output


@pytest.mark.parametrize("command", ["simulate", "verify"])
def test_commands_on_your_user_problem_show_the_lines_of_python(own, command, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    result = run(command, own)
    assert result.exit_code == 2 and "built-in case studies only" in result.output
    lines = [line.strip() for line in result.output.splitlines() if line.startswith("    ")]
    assert len(lines) == 2
    exec("\n".join(lines).replace("10_000", "10"), {"sdhj": sdhj, "problem": torus_problem(nodes=12, steps=2)})
    assert "10 runs" in capsys.readouterr().out


def test_a_header_with_a_hole_is_damage(own, tmp_path):
    path = tmp_path / "own.h5"
    path.write_bytes(own.read_bytes())
    with forged(path) as (told, _):
        del told["grid"]["upper"]
    result = run("info", path)
    assert result.exit_code == 2 and "not a look-up table that can be read" in result.output


@pytest.mark.slow
def test_warmup_covers_every_method(monkeypatch):
    """The tubes of its certified table grow, so that their kernels run too; it is played and verified."""
    verified, verify = [], cli.check
    monkeypatch.setattr(cli, "check", lambda *args, **options: verified.append(verify(*args, **options)))
    result = run("warmup")
    assert result.exit_code == 0, result.output
    for method in ("hji", "projected", "lax", "certified"):
        assert f"warming up {method}" in result.output
    assert len(verified) == 1 and verified[0].ok and all(claim.checked > 0 for claim in verified[0].claims)
    table = sdhj.solve(sdhj.arm_case_study(nodes=9, steps=2), sdhj.Certified(cells=WARM_CELLS), progress=False)
    assert table.fraction(start=0, within=0) < table.fraction(start=0, within=1) < table.fraction(start=0, within=2)


def ran(command, **options):
    return subprocess.run(["bash", "-c", command], capture_output=True, text=True, **options)


def test_a_reader_that_has_seen_enough_ends_it_quietly(saved):
    done = ran(f"{sys.executable} -m sdhj info {saved} | true; exit ${{PIPESTATUS[0]}}")
    assert done.returncode in (0, 1) and done.stderr == ""  # 0 where all was written before the pipe was closed


def test_without_standard_error_it_works_all_the_same(tmp_path):
    """As under pythonw, and for services that close it: Python's sys.stderr is None."""
    path = tmp_path / "table.h5"
    done = ran(f"{sys.executable} -m sdhj solve --nodes 7 --steps 1 -o {path} 2>&-")
    assert done.returncode == 0 and "solved in" in done.stdout
    code = (
        "import sys, sdhj; sys.stderr = None; table = sdhj.load(sys.argv[1]); sdhj.solve(table.problem, method='lax')\n"
        "print(sdhj.monte_carlo(sdhj.Controller(table), runs=5).runs)"
    )
    done = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True)
    assert done.stdout == "5\n", done.stderr


def test_it_is_a_module_that_runs():
    done = ran(f"{sys.executable} -m sdhj --version")
    assert done.stdout.strip().endswith(f"version {sdhj.__version__}"), done.stderr


def test_no_picture_without_matplotlib(tmp_path):
    code = "import sys; sys.modules['matplotlib'] = None; from sdhj.cli import main; main(sys.argv[1:])"
    arguments = [sys.executable, "-c", code, "verify", "missing.h5", "-o", str(tmp_path / "x.png")]
    done = subprocess.run(arguments, capture_output=True, text=True)
    assert done.returncode == 2 and 'pip install "sdhj[plot]"' in done.stderr and "Traceback" not in done.stderr

"""Files are whole or not there, and nothing but a file is replaced by one."""

import os
import subprocess
import sys

import pytest

from sdhj.files import replaced_whole, writable_file, writable_folder


def test_a_file_takes_its_name_when_it_is_whole(tmp_path):
    path = tmp_path / "a.txt"
    with replaced_whole(path) as temporary:
        temporary.write_text("new")
        assert not path.exists() and temporary.suffix == ".txt"
    assert path.read_text() == "new" and os.listdir(tmp_path) == ["a.txt"]


def test_an_error_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(KeyboardInterrupt), replaced_whole(path) as temporary:
        temporary.write_text("half")
        raise KeyboardInterrupt
    assert path.read_text() == "old" and os.listdir(tmp_path) == ["a.txt"]


def test_a_link_stays_a_link_to_the_new_file(tmp_path):
    (tmp_path / "real.txt").write_text("old")
    (tmp_path / "link.txt").symlink_to("real.txt")
    with replaced_whole(tmp_path / "link.txt") as temporary:
        temporary.write_text("new")
    assert (tmp_path / "link.txt").is_symlink() and (tmp_path / "real.txt").read_text() == "new"


@pytest.mark.parametrize("check", [writable_file, lambda path: replaced_whole(path).__enter__()])
def test_what_is_no_file_is_not_replaced(tmp_path, check):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match=r"pipe.*name a file"):
        check(tmp_path / "pipe")
    with pytest.raises(OSError, match="is a folder; name a file"):
        check(tmp_path)
    with pytest.raises(OSError, match=r"cannot write in .*missing.*choose a folder"):
        check(tmp_path / "missing" / "a.txt")


def test_a_folder_is_made_where_it_can_be(tmp_path):
    assert writable_folder(tmp_path / "a" / "b").is_dir()
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match=r"cannot write in .*file.*choose a folder"):
        writable_folder(tmp_path / "file" / "c")


def test_a_full_disk_is_an_error_and_leaves_nothing(tmp_path):
    """A limit on the size of files stands for the disk."""
    code = """
import resource, sdhj
table = sdhj.solve(sdhj.arm_case_study(nodes=7, steps=2), progress=False)
resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000))
try:
    table.save("table.h5")
except OSError as error:
    print(error)
"""
    run = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert "cannot write table.h5" in run.stdout and "free" in run.stdout
    assert os.listdir(tmp_path) == []

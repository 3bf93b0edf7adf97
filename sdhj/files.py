"""Files that are written whole or not at all, and where they may go."""

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def replaced_whole(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A path beside `path` to write to; what stands there takes the name at the end, or is gone after an error.

    Nobody ever sees half a file. The suffix is kept, from which writers tell the format.

    Raises
    ------
    OSError
        Where nothing can be written there, with what to do about it.
    """
    path = _regular(path)
    temporary = path.with_name(f".{path.stem}-{uuid.uuid4().hex}{path.suffix}")
    try:
        temporary.touch()
    except OSError as error:
        raise _unwritable(path.parent, error) from error
    try:
        yield temporary
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def writable_folder(folder: str | os.PathLike[str]) -> Path:
    """The folder, made where it does not exist; checked before long work whose result goes there.

    Raises
    ------
    OSError
        Where it cannot be made or written to, with what to do about it.
    """
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _unwritable(folder, error) from error
    _probe(folder)
    return folder


def writable_file(path: str | os.PathLike[str]) -> Path:
    """The path of a file that can be written; its folder must exist.

    Raises
    ------
    OSError
        Where it cannot be written, with what to do about it.
    """
    path = _regular(path)
    _probe(path.parent)
    return path


def _regular(path: str | os.PathLike[str]) -> Path:
    """The file that a name stands for, links followed; OSError where something else than a file has that name."""
    path = Path(os.path.realpath(path))
    if path.is_dir():
        raise OSError(f"{path} is a folder; name a file")
    if path.exists() and not path.is_file():
        raise OSError(f"{path} is a device or a pipe, which would be replaced; name a file")
    return path


def _probe(folder: Path) -> None:
    probe = folder / f".sdhj-{uuid.uuid4().hex}"
    try:
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise _unwritable(folder, error) from error


def _unwritable(folder: Path, error: OSError) -> OSError:
    return OSError(
        f"cannot write in {folder}: {error.strerror or error}; choose a folder that exists and can be written"
    )

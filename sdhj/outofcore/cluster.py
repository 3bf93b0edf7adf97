"""Slabs as tasks of Dask's distributed scheduler: tasks and yes or no go through it, arrays through the store.

Every worker has to see the store under the same path. A worker that dies leaves nothing half written, and what it had
in hand goes to another.
"""

import importlib
from collections.abc import Iterator
from typing import Any

from sdhj.outofcore.slabs import Plan, Task, work

try:
    distributed: Any = importlib.import_module("distributed")
except ImportError as missing:
    raise ImportError("a client needs Dask: pip install 'sdhj[dask]'") from missing


def shared_out(client: Any, plan: Plan, tasks: list[Task]) -> Iterator[Any]:
    """What `slabs.work` returns of each task, as they are done, in any order."""
    futures = [client.submit(work, plan, task, pure=False) for task in tasks]
    try:
        for future in distributed.as_completed(futures):
            yield future.result()
    except distributed.KilledWorker as error:
        raise RuntimeError(
            f"a slab of {plan.path} has ended one worker after the other, as where it takes more memory than they "
            "have; give them more, and solve with resume=True"
        ) from error
    finally:
        client.cancel([future for future in futures if not future.done()])

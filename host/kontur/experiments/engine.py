# SPDX-License-Identifier: Apache-2.0
"""The engine of sweeps and experiments: many jobs, in processes of this machine or on a dask cluster.

A job is plain values, and its row (a dictionary of JSON's values) depends on them alone. So the rows are the same in
any order and with any number of workers, bit for bit. They are appended to one file as they come. Its first line has a
digest of all that decides them; what was broken off goes on from there.
"""

from __future__ import annotations

import functools
import hashlib
import itertools
import json
import os
import platform
import signal
import threading
import uuid
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from multiprocessing import connection, get_context
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import scipy

from kontur.errors import FileError, KonturError, SimulatorError
from kontur.files import read_bytes, write_atomically

Job = TypeVar("Job")
Result = TypeVar("Result")
Row = dict[str, Any]
Workers = int | str | None
"""Processes of this machine (None: as many as it has cores), or the address of a dask scheduler, tcp://HOST:PORT."""

_PACKAGE = Path(__file__).parents[1]
_CODE = (".py", ".toml", ".json", ".eds")
_ON_CLUSTER = 1000  # jobs that a cluster has at a time: more than it has cores
_CONNECT_S = 10.0
_POLL_S = 0.2
_GOES_ON = "the same command goes on from there"


def carry_out(
    function: Callable[[Job], Row],
    jobs: Sequence[Job],
    files: Iterable[str] = (),
    rows_file: Path | None = None,
    workers: Workers = None,
    progress: Callable[[float], None] = lambda share: None,
) -> list[Row]:
    """The row that `function` makes of each job, in the order of `jobs`.

    `function` is one of a module, which other processes import. `files`: absolute names of the files that it reads,
    besides the package's. Rows that `rows_file` has are not made again, and new ones are appended to it.

    Raises FileError: a file cannot be read or written, or `rows_file` is of other jobs; SimulatorError: a worker was
    killed, or the cluster does not answer; and what `function` raises. What is done then stays in the file.
    """
    hashes = _hashes(files)
    done = {} if rows_file is None else _begun(_head(function, jobs, hashes), rows_file)
    left = [(number, job) for number, job in enumerate(jobs) if number not in done]
    progress(len(done) / len(jobs))
    with closing(results(function, left, hashes, workers)) as coming:
        for number, row in coming:
            line = _line({"run": number} | row)
            if rows_file is not None:
                _append(line, rows_file)
            done |= _row(line)
            progress(len(done) / len(jobs))
    return [done[number] for number in range(len(jobs))]


def results(
    function: Callable[[Job], Result],
    jobs: Sequence[tuple[int, Job]],
    hashes: Mapping[str, str] | None = None,
    workers: Workers = None,
    poll: Callable[[], None] = lambda: None,
) -> Generator[tuple[int, Result], None, None]:
    """Number and result of each job, as they come. `hashes`: digests of the files that `function` reads, by name.
    `poll` is called meanwhile, where processes of this machine work; what it raises ends them."""
    if isinstance(workers, str):
        return _by_cluster(function, jobs, hashes or {}, workers)
    if len(jobs) > 1:
        return _by_processes(function, jobs, workers or _cores(), poll)
    return ((number, function(job)) for number, job in jobs)


# --- the file of rows -------------------------------------------------------------------------------------------------
def _head(function: Callable[[Job], Row], jobs: Sequence[Job], hashes: Mapping[str, str]) -> bytes:
    found = hashlib.sha256(f"{function.__module__}.{function.__qualname__}{_code()}{dict(hashes)}".encode())
    for job in jobs:
        found.update(repr(job).encode())
    return _line({"kontur_sweep": 1, "digest": found.hexdigest(), "runs": len(jobs)})


@functools.cache
def _code() -> str:
    """Digest of this package with its compiled parts, and of what computes for it, as this process began with them."""
    found = hashlib.sha256(f"{np.__version__} {scipy.__version__}".encode())
    for file in sorted(_PACKAGE.rglob("*")):
        inside = file.relative_to(_PACKAGE)
        if inside.parts[0] != "examples" and (file.suffix in _CODE or file.name.startswith("libkontur_")):
            found.update(f"{inside.as_posix()} {hashlib.sha256(file.read_bytes()).hexdigest()}".encode())
    return found.hexdigest()


def _hashes(files: Iterable[str]) -> dict[str, str]:
    return {file: hashlib.sha256(read_bytes(Path(file))).hexdigest() for file in sorted(set(files))}


def _begun(head: bytes, rows_file: Path) -> dict[int, Row]:
    """The rows that `rows_file` has, after a line that was cut off has been removed from it; begins a new file."""
    content = read_bytes(rows_file) if os.path.exists(rows_file) else b""
    whole = content[: content.rfind(b"\n") + 1]
    if not whole:
        if content and not head.startswith(content):
            raise FileError(rows_file, "is no file of a sweep; name another one")
        write_atomically(rows_file, head)
        return {}
    if not whole.startswith(head):
        raise FileError(
            rows_file, "is of another sweep, or of other files or firmware; remove it, or name another output"
        )
    done: dict[int, Row] = {}
    try:
        for line in whole[len(head) :].splitlines():
            done |= _row(line)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise FileError(rows_file, "has a line that is no row of a sweep; remove the file, or name another") from error
    if whole != content:
        write_atomically(rows_file, whole)
    return done


def _append(line: bytes, rows_file: Path) -> None:
    try:
        with rows_file.open("ab") as file:
            file.write(line)
    except OSError as error:
        raise FileError(rows_file, f"cannot be written ({error.strerror}); {_GOES_ON}") from error


def _line(value: Mapping[str, Any]) -> bytes:
    return json.dumps(value).encode() + b"\n"


def _row(line: bytes) -> dict[int, Row]:
    row = json.loads(line)
    return {row.pop("run"): row}


# --- processes of this machine ----------------------------------------------------------------------------------------
def _cores() -> int:
    """The cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _by_processes(
    function: Callable[[Job], Result], jobs: Sequence[tuple[int, Job]], workers: int, poll: Callable[[], None]
) -> Generator[tuple[int, Result], None, None]:
    context, left = get_context("spawn"), iter(jobs)
    count = min(workers, len(jobs))
    ended, end = context.Pipe(duplex=False)
    with ended, end, ProcessPoolExecutor(count, context, _start_worker, (ended,)) as pool:
        waiting: dict[Future[Result], int] = {}

        def submit(some: Iterable[tuple[int, Job]]) -> None:
            waiting.update({pool.submit(function, job): number for number, job in some})

        try:
            with _without_ctrl_c():
                submit(itertools.islice(left, 2 * count))  # which starts the processes
            while waiting:
                poll()
                for future in wait(waiting, _POLL_S, FIRST_COMPLETED).done:
                    yield waiting.pop(future), future.result()
                    submit(itertools.islice(left, 1))
        except BrokenProcessPool as error:
            raise SimulatorError(
                f"a process that computes was killed, perhaps for lack of memory; {_GOES_ON}, and where there is "
                "--workers, it makes them fewer"
            ) from error
        except BaseException:
            end.close()  # the workers leave what they are at
            raise


@contextmanager
def _without_ctrl_c() -> Iterator[None]:
    """Processes that start here do not get the Ctrl-C of the terminal. For this one it waits until the end.

    Blocked is only this thread, of which they are copies; one of NumPy's could still get the signal.
    """
    if not hasattr(signal, "pthread_sigmask") or threading.current_thread() is not threading.main_thread():
        yield
        return
    asked = threading.Event()
    handler = signal.signal(signal.SIGINT, lambda *_: asked.set())
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        signal.signal(signal.SIGINT, handler)
    if asked.is_set():
        raise KeyboardInterrupt


def _start_worker(ended: connection.Connection) -> None:
    """Leave Ctrl-C to the parent, and end when it closes its end of the pipe, as its own end does, too."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def end_with_parent() -> None:
        ended.poll(None)
        os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()


# --- a dask cluster ---------------------------------------------------------------------------------------------------
def _by_cluster(
    function: Callable[[Job], Result], jobs: Sequence[tuple[int, Job]], hashes: Mapping[str, str], address: str
) -> Generator[tuple[int, Result], None, None]:
    try:
        import distributed
    except ImportError as error:
        raise KonturError(
            f"--workers {address} needs dask, which is not installed: pip install 'kontur[sweep]'"
        ) from error
    try:
        client = distributed.Client(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise SimulatorError(
            f"{address}: no dask scheduler answers ({error}); is the address right? `dask scheduler` prints it"
        ) from error
    sweep, left, numbers = uuid.uuid4().hex, iter(jobs), dict[str, int]()

    def submit(count: int) -> list[Any]:
        futures = []
        for number, job in itertools.islice(left, count):
            key = f"kontur-{sweep}-{number}"
            numbers[key] = number
            futures.append(client.submit(_on_worker, function, job, _code(), tuple(hashes.items()), key=key))
        return futures

    with client:
        if not client.scheduler_info()["workers"]:
            raise SimulatorError(f"{address}: the cluster has no worker; start some: dask worker {address}")
        coming = distributed.as_completed(submit(_ON_CLUSTER), with_results=True, loop=client.loop)
        try:
            for future, result in coming:
                if future.cancelled():
                    raise SimulatorError(f"{address}: the cluster is gone; start it again: {_GOES_ON}")
                yield numbers.pop(future.key), result
                coming.update(submit(1))
        except distributed.KilledWorker as error:
            raise SimulatorError(
                f"{address}: a run has ended several workers, perhaps for lack of memory ({error}); {_GOES_ON}"
            ) from error


def _on_worker(function: Callable[[Job], Result], job: Job, code: str, hashes: tuple[tuple[str, str], ...]) -> Result:
    _check_worker(code, hashes)
    return function(job)


@functools.lru_cache(1)
def _check_worker(code: str, hashes: tuple[tuple[str, str], ...]) -> None:
    """Raise SimulatorError or FileError where this worker would not make the same rows."""
    here = platform.node()
    if _code() != code:
        raise SimulatorError(
            f"the dask worker on {here} has another Kontur, NumPy or SciPy; install the same there, and start it again"
        )
    for name, expected in hashes:
        if not os.path.isfile(name) or _hashes([name])[name] != expected:
            raise FileError(name, f"is not this file on the dask worker on {here}; put it where all workers see it")

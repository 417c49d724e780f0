# SPDX-License-Identifier: Apache-2.0
"""Files: written completely or not at all, whatever the target is; read without hanging."""

import os
import stat
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from kontur import files
from kontur.errors import FileError
from kontur.files import atomic_writer, read_bytes, read_text, read_toml, write_atomically

OLD, NEW = b"old", b"new and longer"


def mode_of(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def test_file_is_replaced_and_nothing_is_left_beside_it(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(OLD)
    write_atomically(tmp_path / "a", NEW)
    assert (tmp_path / "a").read_bytes() == NEW
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_old_content_stays_until_the_new_content_is_complete(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(OLD)
    with atomic_writer(tmp_path / "a") as file:
        file.write(NEW)
        file.flush()
        assert (tmp_path / "a").read_bytes() == OLD
    assert (tmp_path / "a").read_bytes() == NEW


@pytest.mark.parametrize("end", [ValueError, KeyboardInterrupt])
def test_old_content_stays_when_the_writer_fails(tmp_path: Path, end: type[BaseException]) -> None:
    def fail() -> None:
        with atomic_writer(tmp_path / "a") as file:
            file.write(NEW)
            raise end

    (tmp_path / "a").write_bytes(OLD)
    with pytest.raises(end):
        fail()
    assert (tmp_path / "a").read_bytes() == OLD
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_content_is_on_the_disk_before_the_name_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[str] = []

    def noted(name: str, real: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any) -> Any:
            calls.append(name)
            return real(*args)

        return call

    for name in ("fsync", "replace"):
        monkeypatch.setattr(os, name, noted(name, getattr(os, name)))
    write_atomically(tmp_path / "a", NEW)
    assert calls == ["fsync", "replace"]


def test_link_stays_a_link_and_its_target_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "target").write_bytes(OLD)
    (tmp_path / "link").symlink_to("there/target")
    write_atomically(tmp_path / "link", NEW)
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "there" / "target").read_bytes() == NEW
    assert [path.name for path in (tmp_path / "there").iterdir()] == ["target"]


def test_link_to_nothing_makes_its_target(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to("target")
    write_atomically(tmp_path / "link", NEW)
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "target").read_bytes() == NEW


def test_link_to_itself_is_one_message(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to("link")
    with pytest.raises(FileError, match="cannot be written"):
        write_atomically(tmp_path / "link", NEW)


def test_planted_link_is_not_followed(tmp_path: Path) -> None:
    """Somebody who may write to the folder cannot make us overwrite another file."""
    (tmp_path / "victim").write_bytes(OLD)
    (tmp_path / "a.part").symlink_to("victim")
    write_atomically(tmp_path / "a", NEW)
    assert (tmp_path / "victim").read_bytes() == OLD
    assert (tmp_path / "a").read_bytes() == NEW


def test_planted_link_with_the_very_name_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("secrets.token_hex", lambda size: "guessed")
    (tmp_path / "victim").write_bytes(OLD)
    (tmp_path / ".kontur-guessed.part").symlink_to("victim")
    with pytest.raises(FileError, match="File exists"):
        write_atomically(tmp_path / "a", NEW)
    assert (tmp_path / "victim").read_bytes() == OLD
    assert (tmp_path / ".kontur-guessed.part").is_symlink()


@pytest.mark.parametrize("mode", [0o600, 0o640, 0o664])
def test_file_that_is_replaced_keeps_its_mode(tmp_path: Path, mode: int) -> None:
    (tmp_path / "a").write_bytes(OLD)
    (tmp_path / "a").chmod(mode)
    write_atomically(tmp_path / "a", NEW)
    assert mode_of(tmp_path / "a") == mode


def test_secret_file_is_never_readable_by_others_meanwhile(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(OLD)
    (tmp_path / "a").chmod(0o600)
    with atomic_writer(tmp_path / "a"):
        assert [mode_of(path) for path in tmp_path.iterdir()] == [0o600, 0o600]


def test_new_file_has_the_mode_of_the_umask(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_atomically(tmp_path / "a", NEW)
    finally:
        os.umask(before)
    assert mode_of(tmp_path / "a") == 0o640


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="needs root, to give a file away")
def test_file_of_another_user_stays_theirs(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(OLD)
    os.chown(tmp_path / "a", 1234, 2345)
    write_atomically(tmp_path / "a", NEW)
    assert ((tmp_path / "a").stat().st_uid, (tmp_path / "a").stat().st_gid) == (1234, 2345)


def test_device_stays_a_device() -> None:
    write_atomically(Path("/dev/null"), NEW)
    assert Path("/dev/null").is_char_device()


def test_device_that_is_full_is_one_message() -> None:
    with pytest.raises(FileError, match="No space left"):
        write_atomically(Path("/dev/full"), NEW)
    assert Path("/dev/full").is_char_device()


def test_pipe_is_written_into(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    got: list[bytes] = []
    reader = threading.Thread(target=lambda: got.append((tmp_path / "pipe").read_bytes()))
    reader.start()
    write_atomically(tmp_path / "pipe", NEW)
    reader.join()
    assert got == [NEW]
    assert (tmp_path / "pipe").is_fifo()


def test_standard_output_is_written_to() -> None:
    code = "from pathlib import Path; from kontur.files import write_atomically; "
    code += f"write_atomically(Path('/dev/stdout'), {NEW!r})"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout == NEW


def test_processes_that_write_the_same_file_do_not_disturb_each_other(tmp_path: Path) -> None:
    with atomic_writer(tmp_path / "a") as first:
        first.write(OLD)
        with atomic_writer(tmp_path / "a") as second:
            second.write(NEW)
        assert (tmp_path / "a").read_bytes() == NEW
    assert (tmp_path / "a").read_bytes() == OLD
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_longest_name_that_the_file_system_allows_is_written(tmp_path: Path) -> None:
    write_atomically(tmp_path / ("a" * 255), NEW)
    assert (tmp_path / ("a" * 255)).read_bytes() == NEW


@pytest.mark.parametrize("name", ["link", "x" * 300 + ".csv", "x" * 300 + "/a.csv", "nowhere/a.csv"])
def test_file_that_cannot_be_written_is_known_before_the_work(tmp_path: Path, name: str) -> None:
    (tmp_path / "link").symlink_to("link")
    with pytest.raises(FileError, match="name another"):
        files.check_folder(tmp_path / name)


def test_pipe_that_somebody_writes_into_is_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    writer = threading.Thread(target=lambda: (tmp_path / "pipe").write_bytes(NEW * 100_000))
    writer.start()
    assert read_bytes(tmp_path / "pipe") == NEW * 100_000
    writer.join()


def test_pipe_that_nobody_writes_into_is_one_message(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "_PIPE_S", 0.01)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(FileError, match=r"brought nothing .* name a regular file"):
        read_bytes(tmp_path / "pipe")


def test_endless_device_is_refused() -> None:
    with pytest.raises(FileError, match="name a regular file"):
        read_bytes(Path("/dev/zero"))


@pytest.mark.parametrize("name", ["", "nothing", "x" * 300])
def test_file_that_cannot_be_read_is_one_message(tmp_path: Path, name: str) -> None:
    with pytest.raises(FileError, match=r"cannot be read .*; is the name right"):
        read_bytes(tmp_path / name)


def test_text_that_is_not_utf_8_is_one_message(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"\xff")
    with pytest.raises(FileError, match="is not a text file"):
        read_text(tmp_path / "a")


@pytest.mark.parametrize("text", ["[" * 100_000, "a = " + "[" * 100_000, "a = " + "1" * 5000, "a = ", "a = {" * 5000])
def test_hostile_toml_is_one_message(tmp_path: Path, text: str) -> None:
    (tmp_path / "a").write_text(text)
    with pytest.raises(FileError, match="is not a TOML file"):
        read_toml(tmp_path / "a")

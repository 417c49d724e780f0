#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Run a command where there is a vcan0: on this kernel if it can, else in User-Mode Linux.

python tests/hil/vcan.py COMMAND...        exit status: the command's, 124: it took too long, 3: no vcan here
python tests/hil/vcan.py --ready           whether nothing is missing for that: exit status 0 or 1

User-Mode Linux is a Linux kernel as a program. It has CAN, needs no rights, and sees this machine's files. Only build/
can be written there. It has one processor.
"""

from __future__ import annotations

import mmap
import os
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BUILD = ROOT / "build" / "hil"
CHANNEL = "vcan0"
TIMEOUT_S = 2400
NO_VCAN, TOOK_TOO_LONG = 3, 124
MEMORY_MB = 768
MODULES = Path("/usr/lib/uml/modules")
# can-bcm: python-can's periodic messages; sch_tbf: a queue that fills
_MODULES = (
    "drivers/net/can/dev/can-dev",
    "net/can/can",
    "net/can/can-raw",
    "net/can/can-bcm",
    "drivers/net/can/vcan",
    "net/sched/sch_tbf",
)
_PATH = f"{os.environ.get('PATH', '/usr/bin:/bin')}:/usr/sbin:/sbin"
_PACKAGES = {"linux.uml": "user-mode-linux", "insmod": "kmod", "ip": "iproute2", "mount": "mount"}


def main(arguments: Sequence[str]) -> int:
    if arguments == ["--ready"]:
        with own_vcan() as there:
            return 0 if there or not missing_packages() else 1
    if not arguments:
        print(__doc__, file=sys.stderr)
        return 2
    with own_vcan() as there:
        if there:
            print(f"vcan: on this machine's own kernel, {CHANNEL}", flush=True)
            return bounded(subprocess.Popen(arguments), "the command")
    if missing := missing_packages():
        print(
            f"vcan: this kernel has no {CHANNEL}, and for User-Mode Linux these Debian packages are missing: "
            f"{' '.join(missing)}\nvcan: sudo apt-get install {' '.join(missing)}\n"
            f"vcan: or, on a kernel with vcan: sudo modprobe vcan && sudo ip link add dev {CHANNEL} type vcan && "
            f"sudo ip link set {CHANNEL} up",
            file=sys.stderr,
        )
        return NO_VCAN
    print(f"vcan: this kernel has none; in User-Mode Linux, kernel's own messages in {BUILD / 'uml.log'}", flush=True)
    return in_user_mode_linux(arguments)


def ip(*words: str) -> bool:
    """Whether `ip link` with these words has worked."""
    program = shutil.which("ip", path=_PATH)
    return program is not None and subprocess.run([program, "link", *words], capture_output=True).returncode == 0


@contextmanager
def own_vcan() -> Iterator[bool]:
    """Whether vcan0 is there, made if this kernel and our rights allow it; what was made is taken away in the end."""
    made = not ip("show", CHANNEL) and (
        ip("add", "dev", CHANNEL, "type", "vcan") or (_modprobe() and ip("add", "dev", CHANNEL, "type", "vcan"))
    )
    try:
        up = ip("show", "up", "dev", CHANNEL) and _is_up()
        yield up or ip("set", CHANNEL, "up")
    finally:
        if made:
            ip("del", CHANNEL)


def _is_up() -> bool:
    flags = Path(f"/sys/class/net/{CHANNEL}/flags")
    return flags.exists() and bool(int(flags.read_text(), 16) & 1)


def _modprobe() -> bool:
    program = shutil.which("modprobe", path=_PATH)
    return program is not None and subprocess.run([program, "vcan"], capture_output=True).returncode == 0


def missing_packages() -> list[str]:
    """What User-Mode Linux needs and is not there."""
    return [package for program, package in _PACKAGES.items() if shutil.which(program, path=_PATH) is None]


def in_user_mode_linux(arguments: Sequence[str]) -> int:
    """The exit status of the command in a guest with vcan0."""
    BUILD.mkdir(parents=True, exist_ok=True)
    status_file = BUILD / "status"
    status_file.unlink(missing_ok=True)
    init = BUILD / "init"
    init.write_text(guest_script(arguments, status_file))
    init.chmod(0o755)
    environment = os.environ | {"TMPDIR": memory_folder(), "HOME": str(BUILD), "LD_PRELOAD": register_shim()}
    command = ["linux.uml", f"mem={MEMORY_MB}M", "rootfstype=hostfs", "rootflags=/", "ro", "quiet", f"init={init}"]
    command += [f"uml_dir={BUILD}/uml/", "con=null", "con0=null,fd:2", "con1=null,fd:1"]
    with open(BUILD / "uml.log", "wb") as log:
        guest = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stderr=log, env=environment | {"PATH": _PATH}, start_new_session=True
        )
        took = bounded(guest, "User-Mode Linux")
    if status_file.exists():
        return int(status_file.read_text())
    if took != TOOK_TOO_LONG:
        end = (BUILD / "uml.log").read_text(errors="replace").splitlines()[-15:]
        print("vcan: User-Mode Linux has ended before its command; it said last:", *end, sep="\n", file=sys.stderr)
    return took or 1


def guest_script(arguments: Sequence[str], status_file: Path) -> str:
    """What the guest runs as its first process."""
    kernel = MODULES / "$(uname -r)" / "kernel"
    kept = {name: value for name, value in os.environ.items() if name in ("CI", "TERM", "LANG", "LC_ALL")}
    kept |= {"PATH": _PATH, "HOME": "/run", "TMPDIR": "/run", "PYTHONDONTWRITEBYTECODE": "1", "MPLCONFIGDIR": "/run"}
    exports = "\n".join(f"export {name}={shlex.quote(value)}" for name, value in kept.items())
    inserts = "\n".join(f"insmod {kernel}/{module}.ko || exit" for module in _MODULES)
    build = shlex.quote(str(ROOT / "build"))
    return f"""#!/bin/sh
exec </dev/null >/dev/tty1 2>&1
{exports}
trap 'echo o >/proc/sysrq-trigger; sleep 60' EXIT
mount -t proc proc /proc && mount -t sysfs sys /sys || exit
mountpoint -q /dev || mount -t devtmpfs dev /dev || exit
mkdir -p /dev/pts /dev/shm && mount -t devpts pts /dev/pts
for folder in /run /tmp /dev/shm; do case {build}/ in $folder/*) ;; *) mount -t tmpfs tmp $folder ;; esac; done
mount -t hostfs none {build} -o {build} || exit
{inserts}
ip link set lo up && ip link add dev {CHANNEL} type vcan && ip link set {CHANNEL} up || exit
cd {shlex.quote(str(Path.cwd()))} || exit
{shlex.join(arguments)}
echo $? >{shlex.quote(str(status_file))}
"""


def memory_folder() -> str:
    """A folder with room for the guest's memory, which the kernel maps from a file there, executable."""
    for folder in (os.environ.get("TMPDIR"), "/dev/shm", "/tmp", str(BUILD)):
        if folder and Path(folder).is_dir() and _holds_memory(folder):
            return folder
    raise SystemExit(f"vcan: no folder has {MEMORY_MB} MB free and may be mapped executable; name one with TMPDIR=...")


def _holds_memory(folder: str) -> bool:
    try:
        if shutil.disk_usage(folder).free < (MEMORY_MB + 64) << 20:
            return False
        with tempfile.TemporaryFile(dir=folder) as file:
            file.truncate(mmap.PAGESIZE)
            mmap.mmap(file.fileno(), mmap.PAGESIZE, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC).close()
    except OSError:
        return False
    return True


def register_shim() -> str:
    """uml_xstate.c, compiled; see there."""
    library = BUILD / "uml_xstate.so"
    source = Path(__file__).with_name("uml_xstate.c")
    compiler = os.environ.get("CC", "gcc")
    flags = ["-std=c11", "-D_GNU_SOURCE", "-O2", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC"]
    subprocess.run([*shlex.split(compiler), *flags, "-o", library, source, "-ldl"], check=True)
    return str(library)


def bounded(process: subprocess.Popen[bytes], what: str) -> int:
    """Exit status of a process that is given TIMEOUT_S, and ends with this one."""
    try:
        return process.wait(TIMEOUT_S)
    except subprocess.TimeoutExpired:
        print(f"vcan: {what} has not ended within {TIMEOUT_S} s and was killed", file=sys.stderr)
        return TOOK_TOO_LONG
    finally:
        if process.poll() is None:
            if os.getpgid(process.pid) == process.pid:
                os.killpg(process.pid, signal.SIGKILL)
            else:
                process.kill()
            process.wait()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

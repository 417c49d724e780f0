# SPDX-License-Identifier: Apache-2.0
"""The inputs that the C fuzzers start from: tests/fuzz/corpus/FUZZER.hex, one input a line, sorted.

`make fuzz` and campaign.py unpack them, since libFuzzer reads a folder with one file an input. New inputs that a run
finds go to build/fuzz/corpus/FUZZER. To take those that reach new code, let libFuzzer choose the smallest set:

    python tests/fuzz/corpus.py unpack can build/fuzz/seeds/can
    mkdir build/fuzz/merged
    build/fuzz-asan/can -merge=1 -max_len=160 build/fuzz/merged build/fuzz/seeds/can build/fuzz/corpus/can
    python tests/fuzz/corpus.py pack can build/fuzz/merged

Usage: corpus.py unpack FUZZER FOLDER      write each input of FUZZER.hex to a file of its own in FOLDER
       corpus.py pack FUZZER FOLDER...     replace FUZZER.hex by all inputs that are in the folders
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterable
from pathlib import Path

CORPUS = Path(__file__).parent / "corpus"


def packed(inputs: Iterable[bytes]) -> str:
    """Text of a packed corpus. The empty input is left out: libFuzzer always tries it."""
    return "".join(f"{line}\n" for line in sorted({data.hex() for data in inputs if data}))


def unpacked(text: str) -> set[bytes]:
    """Inputs in the text of a packed corpus; ValueError where a line is not hexadecimal."""
    return {bytes.fromhex(line) for line in text.splitlines()}


def unpack(fuzzer: str, folder: Path) -> None:
    """Write each input to a file, named by its SHA-1 as libFuzzer names them."""
    folder.mkdir(parents=True, exist_ok=True)
    for data in unpacked((CORPUS / f"{fuzzer}.hex").read_text()):
        (folder / hashlib.sha1(data).hexdigest()).write_bytes(data)


def pack(fuzzer: str, folders: Iterable[Path]) -> None:
    """Replace the packed corpus by what is in the folders; OSError where one cannot be read."""
    inputs = [path.read_bytes() for folder in folders for path in folder.iterdir()]
    (CORPUS / f"{fuzzer}.hex").write_text(packed(inputs))


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["unpack", fuzzer, folder]:
            unpack(fuzzer, Path(folder))
        case ["pack", fuzzer, *folders] if folders:
            pack(fuzzer, map(Path, folders))
        case _:
            sys.exit(__doc__)

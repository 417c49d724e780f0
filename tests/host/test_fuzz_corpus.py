# SPDX-License-Identifier: Apache-2.0
"""The packed corpora of the fuzzers: complete, in their one form, and the same inputs after unpacking and packing."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

FUZZ = Path(__file__).parents[1] / "fuzz"
FUZZERS = sorted(path.stem for path in FUZZ.glob("*.c"))

_spec = importlib.util.spec_from_file_location("corpus", FUZZ / "corpus.py")
assert _spec is not None
assert _spec.loader is not None
corpus = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(corpus)


def test_each_fuzzer_in_c_has_a_packed_corpus():
    assert sorted(path.stem for path in corpus.CORPUS.glob("*.hex")) == FUZZERS


@pytest.mark.parametrize("fuzzer", FUZZERS)
def test_packed_corpus_is_in_its_one_form(fuzzer):
    text = (corpus.CORPUS / f"{fuzzer}.hex").read_text()
    assert corpus.packed(corpus.unpacked(text)) == text


def test_inputs_survive_packing_and_unpacking(tmp_path, monkeypatch):
    monkeypatch.setattr(corpus, "CORPUS", tmp_path)
    inputs = {b"\x00", b"\xff\x80", b"line\n", bytes(160)}
    found = tmp_path / "found"
    found.mkdir()
    for number, data in enumerate([*inputs, b"", b"\x00"]):
        (found / str(number)).write_bytes(data)
    corpus.pack("can", [found])
    corpus.unpack("can", tmp_path / "seeds")
    assert {path.read_bytes() for path in (tmp_path / "seeds").iterdir()} == inputs
    assert len(list((tmp_path / "seeds").iterdir())) == len(inputs)

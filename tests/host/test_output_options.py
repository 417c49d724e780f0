# SPDX-License-Identifier: Apache-2.0
"""-o, --output and --out mean the same in every command: -o is a file, --out a folder."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import click
from click.testing import CliRunner

from kontur.cli import main


def options(command: click.Command, name: str = "") -> Iterator[tuple[str, click.Option]]:
    """All options of the command and of those below it, with the command's name."""
    yield from ((name, one) for one in command.params if isinstance(one, click.Option))
    if isinstance(command, click.Group):
        context = click.Context(command)
        for word in command.list_commands(context):
            below = command.get_command(context, word)
            assert below is not None
            yield from options(below, f"{name} {word}".strip())


def of(word: str) -> dict[str, click.Option]:
    return {name: one for name, one in options(main) if word in one.opts}


def test_o_is_a_file_and_out_a_folder_in_every_command() -> None:
    files, folders = of("-o"), of("--out")
    assert set(files) == {"bode", "design", "identify", "prove", "report", "scope", "sweep", "tune"}
    assert set(folders) == {
        *("commission", "demo", "experiment machines", "experiment paper", "experiment robust"),
    }
    for name, one in files.items():
        assert isinstance(one.type, click.Path)
        assert not one.type.dir_okay, name
        assert "--output" in one.opts or name == "prove"
    for name, one in folders.items():
        assert isinstance(one.type, click.Path)
        assert not one.type.file_okay, name


def test_the_folder_of_an_experiment_is_no_picture(tmp_path: Path) -> None:
    result = CliRunner().invoke(main, ["experiment", "paper", "--out", str(tmp_path / "p.svg")])
    assert result.exit_code == 2
    assert "a picture goes to --picture" in result.output
    assert not list(tmp_path.iterdir())

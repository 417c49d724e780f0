# SPDX-License-Identifier: Apache-2.0
"""Hooks of MkDocs (mkdocs.yml): pages that are not in docs/, and links that lead out of it.

README, CONTRIBUTING and CHANGELOG become pages. The reference of the command line comes from its help, that of Python
from docstrings. A link to a file that the site does not have becomes its name.
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

import kontur
from kontur.cli import main

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files
    from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
_AT_ROOT = {"README.md": "index.md", "CONTRIBUTING.md": "CONTRIBUTING.md", "CHANGELOG.md": "CHANGELOG.md"}
_LINK = re.compile(r"\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^()\s]+)\)")
_TARGET = re.compile(r"^\[([^\]]+)\]: (\S+)\n?", re.MULTILINE)  # of [links] without a target of their own
_DECISIONS = "adr/index.md"


def on_files(files: Files, *, config: MkDocsConfig) -> Files:
    """Add the pages that are not in docs/."""
    from mkdocs.structure.files import File

    made = {page: (ROOT / file).read_text("utf-8") for file, page in _AT_ROOT.items()}
    made |= {"cli.md": cli_page(), "api.md": api_page(), _DECISIONS: decisions_page()}
    for page, text in made.items():
        files.append(File.generated(config, page, content=text))
    return files


def on_page_markdown(markdown: str, *, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Let links lead to pages of the site."""
    return relinked(markdown, page.file.src_uri)


def relinked(markdown: str, page: str) -> str:
    """The text of `page`, a path in the site, with links that hold there."""
    folder = "" if page in _AT_ROOT.values() else posixpath.join("docs", posixpath.dirname(page))

    def link(found: re.Match[str]) -> str:
        text, target = found.groups()
        path, mark, anchor = target.partition("#")
        if re.match(r"[a-z]+:", target) or not path:
            return found[0]
        file = posixpath.normpath(posixpath.join(folder, path))
        there = _AT_ROOT.get(file) or (file.removeprefix("docs/") if file.startswith("docs/") else None)
        there = _DECISIONS if there == "adr" else there
        if there is None:
            return text if file in text else f"{text} (`{file}`)"
        return f"[{text}]({posixpath.relpath(there, posixpath.dirname(page) or '.')}{mark}{anchor})"

    for name, target in _TARGET.findall(markdown):
        markdown = re.sub(rf"\[{re.escape(name)}\](?![(:])", f"[{name}]({target})", markdown)
    return _LINK.sub(link, _TARGET.sub("", markdown))


def cli_page() -> str:
    """The help of all commands."""
    parts = ["# Command line", "What `--help` says. [Commands](commands.md) shows them by purpose."]
    for command, context in _commands(main, click.Context(main, info_name="kontur", max_content_width=100)):
        parts.append(f"## {context.command_path}\n\n```text\n{command.get_help(context).rstrip()}\n```")
    return "\n\n".join(parts) + "\n"


def _commands(command: click.Command, context: click.Context) -> Iterator[tuple[click.Command, click.Context]]:
    yield command, context
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            inner = command.get_command(context, name)
            assert inner is not None
            yield from _commands(inner, click.Context(inner, parent=context, info_name=name, max_content_width=100))


def api_page() -> str:
    """What `import kontur` has, from docstrings."""
    parts = ["# Python", "What `import kontur` has. [Scripts in Python](python.md) shows how it is used."]
    for name, where in sorted(kontur._WHERE.items(), key=lambda one: one[0].lower()):
        module, _, other = where.partition(":")
        parts.append(f"## kontur.{name}\n\n::: {module}.{other or name}")
    return "\n\n".join(parts) + "\n"


def decisions_page() -> str:
    """The list of decisions."""
    lines = ["# Decisions", "", "One page each: context, decision, consequences.", ""]
    for file in sorted((ROOT / "docs/adr").glob("[0-9]*.md")):
        title = file.read_text("utf-8").splitlines()[0].removeprefix("# ")
        lines.append(f"- [{title.replace('. ', ': ', 1)}]({file.name})")
    return "\n".join(lines) + "\n"

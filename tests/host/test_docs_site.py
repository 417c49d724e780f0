# SPDX-License-Identifier: Apache-2.0
"""The documentation as a site: links hold, references are whole, and nothing is loaded from the network."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import click
import docs_site
import pytest

import kontur
from kontur.cli import main

pytest.importorskip("material", reason="no MkDocs; get it by: pip install 'kontur[docs]'")
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built so that a dead link is an error."""
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", folder],
        cwd=ROOT, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return folder


def test_each_page_is_there(site: Path) -> None:
    pages = {page.relative_to(ROOT / "docs").with_suffix("") for page in (ROOT / "docs").rglob("*.md")}
    made = {page.relative_to(site).with_suffix("") for page in site.rglob("*.html")}
    assert pages | {Path(name) for name in ("index", "CONTRIBUTING", "CHANGELOG", "cli", "api", "adr/index")} <= made


def test_site_loads_nothing_from_the_network(site: Path) -> None:
    loaded = re.compile(r'<(?:script|img|iframe)[^>]* src="?(https?:[^" >]+)|<link[^>]*stylesheet[^>]*(https?:[^" >]+)')
    assert [found for page in site.rglob("*.html") for found in loaded.findall(page.read_text("utf-8"))] == []


def test_references_have_every_command_and_every_name(site: Path) -> None:
    cli, api = ((site / name).read_text("utf-8") for name in ("cli.html", "api.html"))
    for name in main.list_commands(click.Context(main)):
        assert f'id="kontur-{name}"' in cli
    assert 'id="kontur-param-set"' in cli
    for name in kontur._WHERE:
        assert f'id="kontur{name.lower()}"' in api
    assert "Run trajectory under controller" in re.sub(r"<[^>]*>", "", api)


@pytest.mark.parametrize(
    ("page", "text", "want"),
    [
        ("index.md", "[a](docs/paths.md#g-code)", "[a](paths.md#g-code)"),
        ("index.md", "[a](docs/adr)", "[a](adr/index.md)"),
        ("index.md", "[a](https://b.org/c)", "[a](https://b.org/c)"),
        ("paths.md", "[a](../README.md)", "[a](index.md)"),
        ("paths.md", "[a](#b)", "[a](#b)"),
        ("paths.md", "[the part](../examples/part.ngc)", "the part (`examples/part.ngc`)"),
        ("paths.md", "[p] and [p]\n\n[p]: ../examples/p.csv\n", "p (`examples/p.csv`) and p (`examples/p.csv`)\n\n"),
        ("adr/0001-core-units.md", "[a](../paths.md)", "[a](../paths.md)"),
        ("adr/0001-core-units.md", "[a](../../CHANGELOG.md)", "[a](../CHANGELOG.md)"),
    ],
)
def test_links_of_the_checkout_become_links_of_the_site(page: str, text: str, want: str) -> None:
    assert docs_site.relinked(text, page) == want


def test_dead_link_ends_the_build(tmp_path: Path) -> None:
    (tmp_path / "docs/adr").mkdir(parents=True)
    (tmp_path / "docs/paths.md").write_text("[gone](nowhere.md)\n")
    (tmp_path / "mkdocs.yml").write_text("site_name: x\nstrict: true\ntheme: material\n")
    done = subprocess.run([sys.executable, "-m", "mkdocs", "build"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode != 0
    assert "nowhere.md" in done.stderr

"""The page of a sweep: its sheet, and a table of what each image measures."""

from __future__ import annotations

from pathlib import Path

from ..compare.difference import Exposure
from ..page.template import data, load_template
from .result import Sweep


def write_page(sweep: Sweep, exposure: Exposure, sheet: Path, path: Path) -> None:
    """Writes one HTML file that needs no other but links to the images."""
    template = load_template(Path(__file__).with_name("sweep.html.j2"))
    content = template.render(sweep=sweep, exposure=exposure, sheet=data("png", sheet.read_bytes()))
    path.write_text(content, encoding="utf-8")

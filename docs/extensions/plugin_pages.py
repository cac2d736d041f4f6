"""Takes what stands elsewhere: the manual pages from the sources of the plugins (between ``/**!`` and ``*/``), and the notebook of the examples."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ROOT / "mitsuba-plugin" / "src"
GENERATED = ROOT / "docs" / "plugins" / "generated"


def write_pages(_app: Any) -> None:
    GENERATED.mkdir(exist_ok=True)
    for source in sorted(SOURCES.glob("sgtd*.cpp")):
        found = re.search(r"/\*\*!\n(.*?)\n\s*\*/", source.read_text(encoding="utf-8"), re.DOTALL)
        if not found:
            raise RuntimeError(f"{source.name} has no manual page")
        text = found[1] + "\n"
        target = GENERATED / f"{source.stem}.rst"
        if not target.is_file() or target.read_text(encoding="utf-8") != text:
            target.write_text(text, encoding="utf-8")
    shutil.copyfile(ROOT / "examples" / "recover_lobe.ipynb", ROOT / "docs" / "tutorials" / "inverse.ipynb")


def setup(app: Any) -> dict[str, bool]:
    app.connect("builder-inited", write_pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

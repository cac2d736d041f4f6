"""The directives of Mitsuba's manual that the plugin pages use: ``pluginparameters`` and ``subfigstart``, ``subfigure``, ``subfigend``."""

from __future__ import annotations

from typing import Any

from docutils import nodes
from docutils.parsers.rst import Directive, directives
from docutils.parsers.rst.directives.images import Figure


class PluginParameters(Directive):
    """A table of name, type, description and flags from a list of lists; a row without flags is filled up."""

    has_content = True
    HEADER, WIDTHS = ("Parameter", "Type", "Description", "Flags"), (20, 14, 56, 10)

    def run(self) -> list[nodes.Node]:
        parsed = nodes.Element()
        self.state.nested_parse(self.content, self.content_offset, parsed)
        lists = [node for node in parsed if isinstance(node, nodes.bullet_list)]
        if len(lists) != 1 or len(parsed) != 1:
            raise self.error("pluginparameters takes one list of lists")
        rows = [[list(cell.children) for cell in row[0]] for row in lists[0]]
        if bad := [row for row in rows if not 3 <= len(row) <= 4]:
            raise self.error(f"a row of pluginparameters has {len(bad[0])} entries instead of 3 or 4")
        group = nodes.tgroup("", *(nodes.colspec(colwidth=width) for width in self.WIDTHS), cols=len(self.WIDTHS))
        header = [[nodes.paragraph("", text)] for text in self.HEADER]
        group += nodes.thead("", self.row(header))
        group += nodes.tbody("", *(self.row(row + [[]] * (4 - len(row))) for row in rows))
        return [nodes.table("", group, classes=["pluginparameters"])]

    @staticmethod
    def row(cells: list[list[nodes.Node]]) -> nodes.row:
        return nodes.row("", *(nodes.entry("", *cell) for cell in cells))


class SubfigStart(Directive):
    """Opens a row of pictures; it ends at ``subfigend``, whose caption stands below."""

    def run(self) -> list[nodes.Node]:
        return [nodes.raw("", '<div class="subfigures">', format="html")]


class Subfigure(Figure):
    """One picture of a row; its caption is an option."""

    option_spec = {**Figure.option_spec, "caption": directives.unchanged}

    def run(self) -> list[nodes.Node]:
        caption = self.options.pop("caption", "")
        found = super().run()
        if caption:
            text, messages = self.state.inline_text(caption, self.lineno)
            found[0] += [nodes.caption(caption, "", *text), *messages]
        return found


class SubfigEnd(Directive):
    """Closes a row of pictures."""

    option_spec = {"label": directives.unchanged}

    def run(self) -> list[nodes.Node]:
        return [nodes.raw("", "</div>", format="html")]


def setup(app: Any) -> dict[str, bool]:
    app.add_directive("pluginparameters", PluginParameters)
    app.add_directive("subfigstart", SubfigStart)
    app.add_directive("subfigure", Subfigure)
    app.add_directive("subfigend", SubfigEnd)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

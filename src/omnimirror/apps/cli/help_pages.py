"""Commands with grouped options, examples and a documentation page; outputs must not overwrite
inputs.
"""

from __future__ import annotations

from typing import Any

import click

from .outputs import refuse_losses


class GroupedOption(click.Option):
    """Option that is listed under the heading of its group."""

    def __init__(self, *declarations: Any, group: str, **attributes: Any) -> None:
        super().__init__(*declarations, **attributes)
        self.group = group


class DocumentedCommand(click.Command):
    """Command with a documentation page and at least one example.

    Parameters
    ----------
    page
        Page in docs/, without ``.md``.
    examples
        Examples as complete command lines.
    """

    def __init__(self, *args: Any, page: str, examples: tuple[str, ...], **attributes: Any) -> None:
        super().__init__(*args, **attributes)
        self.page, self.examples = page, examples

    def invoke(self, ctx: click.Context) -> Any:
        refuse_losses(ctx)
        return super().invoke(ctx)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        groups: dict[str, list[tuple[str, str]]] = {"Options": []}
        for option in self.get_params(ctx):
            record = option.get_help_record(ctx) if isinstance(option, click.Option) else None
            if record is not None:
                groups.setdefault(getattr(option, "group", "Options"), []).append(record)
        if len(groups) == 2 and len(groups["Options"]) <= 2:  # only -o and -h
            groups = {"Options": [record for records in reversed(groups.values()) for record in records]}
        for title, records in groups.items():
            with formatter.section(title):
                formatter.write_dl(records)

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        super().format_epilog(ctx, formatter)
        with formatter.section("Examples" if len(self.examples) > 1 else "Example"):
            for example in self.examples:  # unwrapped, for copying
                formatter.write(f"{'':>{formatter.current_indent}}{example}\n")
        formatter.write(f"\nMore: docs/{self.page}.md\n")

"""What every command has: help with options in groups, examples and a page that tells more; no output on an input."""

from __future__ import annotations

from typing import Any

import click

from .outputs import refuse_losses


class GroupedOption(click.Option):
    """An option that is listed below the heading of its group."""

    def __init__(self, *declarations: Any, group: str, **attributes: Any) -> None:
        super().__init__(*declarations, **attributes)
        self.group = group


class DocumentedCommand(click.Command):
    """A command with a page of the documentation and at least one example.

    Parameters
    ----------
    page
        Of docs/, without ``.md``.
    examples
        Lines as one types them.
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
        if (
            len(groups) == 2 and len(groups["Options"]) <= 2
        ):  # a heading of its own for -o and -h would only tear them off
            groups = {"Options": [record for records in reversed(groups.values()) for record in records]}
        for title, records in groups.items():
            with formatter.section(title):
                formatter.write_dl(records)

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        super().format_epilog(ctx, formatter)
        with formatter.section("Examples" if len(self.examples) > 1 else "Example"):
            for example in self.examples:  # as it is: what is wrapped cannot be copied
                formatter.write(f"{'':>{formatter.current_indent}}{example}\n")
        formatter.write(f"\nMore: docs/{self.page}.md\n")

"""`with_default`: a group of commands whose first one may be left out."""

from __future__ import annotations

from typing import Any

from typer.core import TyperGroup

_HELP = ("--help", "-h")


def with_default(name: str) -> type[TyperGroup]:
    """A class of groups in which words that name no command are arguments of this one.

    So `flexmotion robots ./my_robot` is `flexmotion robots show ./my_robot`, beside `flexmotion robots tune op3`. What
    has the name of a command is that command; a folder of that name is `./NAME`.
    """

    class WithDefault(TyperGroup):
        def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
            """Put the default command before arguments that do not begin with a command, or ask for help."""
            if not args or (args[0] not in self.commands and args[0] not in _HELP):
                args = [name, *args]
            return super().parse_args(ctx, args)

    return WithDefault

"""A script by which bash and zsh complete commands, options and their choices; files otherwise."""

import types
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, Union, get_args, get_origin

from everystate.cli.parsing import options_of
from everystate.presets import PRESETS

_AGENTS = Path(__file__).parents[1] / "agents"
_SCRIPT = """\
{zsh}_everystate() {{
  local command=${{COMP_WORDS[1]}} before=${{COMP_WORDS[COMP_CWORD-1]}} word=${{COMP_WORDS[COMP_CWORD]}} words
  if [ "$COMP_CWORD" = 1 ]; then words="{commands}"
  else case "$command $before" in
{choices}
  *) case "$command $word" in
{options}
    *) words="{names}" ;;
    esac ;;
  esac; fi
  COMPREPLY=($(compgen -W "$words" -- "$word"))
}}
complete -o bashdefault -o default -F _everystate everystate
"""  # noqa: E501


def script(shell: str, kinds: Mapping[str, type]) -> str:
    """The script for bash, or for zsh, which understands it once told to.

    Args:
        shell: bash or zsh.
        kinds: the class of each command's options.
    """
    known = {command: options_of(kind) for command, kind in kinds.items()}
    return _SCRIPT.format(
        zsh="autoload -U +X bashcompinit && bashcompinit\n" if shell == "zsh" else "",
        commands=" ".join(kinds),
        choices="\n".join(
            f'  "{command} {option}") words="{" ".join(chosen)}" ;;'
            for command, options in known.items()
            for option, kind in options.items()
            if (chosen := PRESETS if option == "--preset" else _choices(kind))
        ),
        options="\n".join(
            f'    "{command} -"*) words="{" ".join(options)} --help" ;;'
            for command, options in known.items()
        ),
        names=" ".join(sorted(agent.name for agent in _AGENTS.iterdir())),
    )


def _choices(kind: Any) -> tuple[str, ...]:
    """Of a Literal, or of one that may be left out."""
    if get_origin(kind) in (types.UnionType, Union):
        return tuple(word for part in get_args(kind) for word in _choices(part))
    return get_args(kind) if get_origin(kind) is Literal else ()

"""The completion script, in the shell that it is for."""

import subprocess

import pytest

from everystate import cli
from everystate.cli.commands import COMMANDS, KINDS
from everystate.cli.completion import script
from everystate.presets import PRESETS


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["ev"], {"evaluate"}),
        ([""], set(COMMANDS)),
        (["train", "ca"], {"cartpole"}),
        (["train", "ant", "--preset", ""], set(PRESETS)),
        (["train", "ant", "--not-finite", "r"], {"roll-back"}),
        (["train", "ant", "--track", ""], {"wandb", "trackio"}),
        (["train", "ant", "--batch"], {"--batch-size"}),
        (["train", "ant", "--no-hind"], {"--no-hindsight"}),
        (["demo", "--batch"], {"--batch-size"}),
        (["evaluate", "x", "--j"], {"--json"}),
        (["evaluate", "x", "--ru"], set()),
        (["render", "x", "--no-"], {"--no-plan", "--no-explore"}),
        (["render", "x", "nowhere"], set()),
    ],
)
def test_bash_completes(words: list[str], expected: set[str]) -> None:
    set_up = (
        f'COMP_WORDS=(everystate {" ".join(words[:-1])} "{words[-1]}")\nCOMP_CWORD={len(words)}'
    )
    asked = f'{script("bash", KINDS)}\n{set_up}\n_everystate\nprintf "%s\\n" "${{COMPREPLY[@]}}"'
    shown = subprocess.run(["bash", "-uc", asked], capture_output=True, text=True, check=True)
    assert set(shown.stdout.split()) == expected


def test_zsh_is_told_to_understand_the_same(capsys: pytest.CaptureFixture) -> None:
    assert cli.main(["completion", "zsh"]) == 0
    before, _, rest = capsys.readouterr().out.partition("\n")
    assert before == "autoload -U +X bashcompinit && bashcompinit"
    assert rest == script("bash", KINDS)


def test_every_command_has_its_options() -> None:
    assert set(KINDS) == set(COMMANDS)

"""Buttons and keys that drive a body about, by how fast it goes forward and turns."""

from collections.abc import Mapping
from functools import partial

import viser

from everystate.agent import Agent
from everystate.features import features
from everystate.goals import Goal, Number
from everystate.viewing.world import Do, World

ARROWS = ("↖", "↑", "↗"), ("←", "■", "→"), ("↙", "↓", "↘")
_LABELS = "drive", "W A S D,", "or arrows"
_WAYS = ("forward", "", "back"), ("left", "", "right")
_GOES, _TURNS = "forward_velocity", "turning_rate"
_PACE = {_GOES: 1.0, _TURNS: 0.5}
"""In σ: bodies are seldom twice as fast."""


def can_drive(agent: Agent) -> bool:
    """Whether its body has both velocities."""
    return {_GOES, _TURNS} <= set(agent.feature_names)


def driven(agent: Agent, arrow: str, asked: Goal) -> tuple[str, dict[str, Number]]:
    """What a button asks for, in words and as a goal; to the left is positive.

    What else was asked of a part of a state stays so, as a height, but for what says otherwise.
    """
    row, column = next((r, line.index(arrow)) for r, line in enumerate(ARROWS) if arrow in line)
    known, spread = features(agent.state_names), agent.scale.spread
    others = dict(asked) if isinstance(asked, Mapping) else {}
    for name, ahead in ((_GOES, 1 - row), (_TURNS, 1 - column)):
        others = {n: x for n, x in others.items() if n not in known[name].components}
        others[name] = ahead * _PACE[name] * float(known[name].spread(spread))
    return " ".join(filter(None, (_WAYS[0][row], _WAYS[1][column]))) or "stand still", others


def add_driving(gui: viser.GuiApi, world: World, do: Do) -> None:
    """Puts the buttons on the page, where it now is, and has it hear the keys."""

    def drive(arrow: str) -> None:
        name, goal = driven(world.agent, arrow, world.asked)
        world.send(goal, name)

    for label, line in zip(_LABELS, ARROWS, strict=True):
        group = gui.add_button_group(label, line, hint="goes on until the next; ■ stands still")

        def pressed(_: object, group: viser.GuiButtonGroupHandle = group) -> None:
            do("goal", partial(drive, group.value))

        group.on_click(pressed)
    gui.add_html(_KEYS)


_KEYS = """<img hidden src="data:," onerror="
const keys = {KeyW: 'up', ArrowUp: 'up', KeyS: 'down', ArrowDown: 'down',
              KeyA: 'left', ArrowLeft: 'left', KeyD: 'right', ArrowRight: 'right'};
const held = new Set();
let now = '■';
function press() {
  const ways = new Set([...held].map(code => keys[code]));
  const row = 1 + ways.has('down') - ways.has('up');
  const column = 1 + ways.has('right') - ways.has('left');
  const wanted = ['↖↑↗', '←■→', '↙↓↘'][row][column];
  if (wanted === now) return;
  now = wanted;
  [...document.querySelectorAll('button')].find(b => b.textContent === now)?.click();
}
function hear(event) {
  if (!(event.code in keys)) return;
  const down = event.type === 'keydown';
  // Arrows change numbers and move sliders, and letters are for words.
  const own = event.code.startsWith('Arrow') ? 'input:not([type=checkbox]), [role=slider]'
    : 'input:not([type=checkbox], [inputmode=decimal])';
  const other = event.ctrlKey || event.metaKey || event.altKey || event.target.closest?.(own);
  if (down && other) return;
  if (down) { event.preventDefault(); event.stopImmediatePropagation(); }
  held[down ? 'add' : 'delete'](event.code);
  press();
}
// One that was heard before, as the panel was drawn, goes; and all before what moves the camera.
window.unheard?.abort();
window.unheard = new AbortController();
const way = {capture: true, signal: window.unheard.signal};
for (const type of ['keydown', 'keyup']) window.addEventListener(type, hear, way);
window.addEventListener('blur', event => {
  if (event.target !== window) return;
  held.clear();
  press();
}, way);
">"""
"""Presses the button of the keys that are held, again whenever these change.

Viser tells of keys that go down, not of those that come up. A browser runs no script that is put
on a page later, but does what an image says for when it fails. The keys are taken from the camera.
"""

"""One film of an agent: what `everystate render` does."""

from pathlib import Path

from everystate.agent import load
from everystate.errors import EverystateError
from everystate.goals import Goal
from everystate.viewing import recording, video


def render(
    run: Path | str,
    out: Path | None = None,
    *,
    skill: str | None = None,
    goal: Goal | None = None,
    explore: bool = False,
    steps: int = 250,
    plan: bool | None = None,
    seed: int = 0,
    size: tuple[int, int] = (480, 360),
) -> Path:
    """Films an agent performing a skill, going to a goal, or exploring (also if none is given).

    Args:
        run: run folder, exported agent, or the name of one that comes with everystate.
        out: a file to be made, .mp4, .gif or .png; by default BODY-WHAT.mp4 here.
        skill: name of a skill of its body.
        goal: a state, in the body's units, or a part of one, as `Agent.act` takes it.
        explore: go to goals that the agent proposes.
        steps: control steps of a goal or of exploring.
        plan: act by planning ahead, or by the policy; None: as the agent says.
        seed: of where it starts, the body's noise and planning.
        size: width and height of a frame.

    Raises:
        EverystateError: bad arguments, a file that is there already, or nothing to draw with.
    """
    if (skill is not None) + (goal is not None) + explore > 1:
        raise EverystateError("give one of --skill, --goal and --explore")
    if steps < 1:
        raise EverystateError(f"steps is {steps}: film at least 1")
    if size[0] < 160 or size[1] < 120 or size[0] % 2 or size[1] % 2:
        raise EverystateError(f"size {size[0]} x {size[1]}: both even, and at least 160 x 120")
    agent = load(run)
    env = recording.body_of(agent)
    what = skill or ("goal" if goal is not None else "exploring")
    out = video.check_target(out or Path(f"{env.name}-{what}.mp4"))
    options = {"plan": agent.act_with == "plan" if plan is None else plan, "seed": seed}
    if skill is not None:
        recorded = recording.record_skill(agent, skill, **options)
    elif goal is not None:
        recorded = recording.record_goal(agent, goal, steps=steps, **options)
    else:
        recorded = recording.record_exploration(agent, steps=steps, **options)
    return video.write(recorded, env, out, width=size[0], height=size[1])

"""Named skills: where to send an agent, and when that counts as done. No training knows of them."""

from everystate.errors import EverystateError, suggest
from everystate.skills import ant, cartpole, ramp_pointmass
from everystate.skills.skill import Skill

SKILLS: dict[str, dict[str, Skill]] = {
    "cartpole": cartpole.SKILLS,
    "ramp-pointmass": ramp_pointmass.SKILLS,
    "ant": ant.SKILLS,
}


def skills_of(body: str) -> dict[str, Skill]:
    """All skills of a body.

    Raises:
        EverystateError: it has none.
    """
    if body not in SKILLS:
        raise EverystateError(f"{body} has no named skills; these have: {', '.join(SKILLS)}")
    return SKILLS[body]


def skill(body: str, name: str) -> Skill:
    """A skill by its name.

    Raises:
        EverystateError: the body has no such skill, or none at all.
    """
    known = skills_of(body)
    if name not in known:
        raise EverystateError(f"{body} has no skill {name!r}: {suggest(name, known)}")
    return known[name]

"""Commands that list what there is: `bodies` and `skills`."""

import textwrap

from everystate.cli.options import Bodies, Skills
from everystate.cli.parsing import parse

_ROBOTS = """\
Robots by name, from a folder that MENAGERIE_ROOT names (a checkout of MuJoCo Menagerie) or from an
installed package:"""
_OTHERS = """\
Also the path of any MJCF file, NAME.xml, and MODULE:ID for what a module registers with
Gymnasium: gymnasium:Pendulum-v1. `everystate bodies NAME` describes it. With a run on an
MJCF file or a robot, and with its agent, travel a copy of it and of all files that it names
(meshes, textures, includes), and a hash of the model that it compiles to."""


def bodies(argv: list[str]) -> None:
    """List the bodies, those built in and robots by name, or describe the ones named."""
    options = parse(Bodies, "bodies", argv)
    from everystate import envs
    from everystate.features import features

    how = envs.parse_options(options.body_options)
    for name in options.body or envs.BODIES:
        env = envs.make(name, 1, 0, **how)
        print(envs.describe(env) if options.body else envs.headline(env))
        named = [f"{f.name} ({f.unit})" for f in features(env.state_names).values()]
        if options.body and named:
            print(
                textwrap.fill(
                    f"  goals can also ask for {', '.join(named)}", 78, subsequent_indent="    "
                )
            )
        print()
    if not options.body:
        print(f"{_ROBOTS}\n\n{envs.list_robots()}\n\n{_OTHERS}")


def skills(argv: list[str]) -> None:
    """List the named skills of all bodies that have some, or of the ones named."""
    named = parse(Skills, "skills", argv).body
    from everystate.skills import SKILLS, skills_of

    for body in named or SKILLS:
        known = skills_of(body)
        print(f"{body}:")
        for name, skill in known.items():
            print(f"  {name}: {skill.text}")

"""Commands that show an agent, or hand it on: `report`, `render`, `studio` and `export`."""

from everystate.cli.options import Export, Render, Report, Studio
from everystate.cli.parsing import parse
from everystate.cli.progress import working


def report(argv: list[str]) -> None:
    """Draw the page of a run."""
    options = parse(Report, "report", argv)
    from everystate import agent, evaluation, viewing

    loaded = agent.load(options.run)
    plan = loaded.act_with == "plan" if options.planning is None else options.planning
    viewing.report_folder(options.run, options.out)  # better said now than after the measuring
    with working("measuring") as count:
        result = evaluation.evaluate(
            options.run, plan=plan, episodes=options.episodes, on_step=count
        )
    with working("drawing"):
        page = viewing.report(options.run, result, agent=loaded, out=options.out)
    print(page)


def render(argv: list[str]) -> None:
    """Film an agent."""
    options = parse(Render, "render", argv)
    from everystate import goals, viewing

    goal = None if options.goal is None else goals.read(options.goal)
    with working("filming"):
        path = viewing.render(
            options.run,
            options.out,
            skill=options.skill,
            goal=goal,
            explore=options.explore,
            steps=options.steps,
            plan=options.planning,
            seed=options.seed,
            size=options.size,
        )
    print(path)


def studio(argv: list[str]) -> None:
    """Serve the page of an agent."""
    options = parse(Studio, "studio", argv)
    from everystate.viewing.studio import studio

    where = {"host": options.host, "port": options.port}
    studio(options.run, **where, plan=options.planning, seed=options.seed)


def export(argv: list[str]) -> None:
    """Write the agent of a run to a folder or one file."""
    options = parse(Export, "export", argv)
    from everystate import agent

    print(agent.load(options.run).export(options.out, half=options.half))

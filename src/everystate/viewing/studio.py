"""A page on this machine where one watches an agent and sends it about: `everystate studio`."""

import contextlib
import io
import socket
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import viser

from everystate.agent import load
from everystate.envs import MujocoVectorEnv
from everystate.errors import EverystateError
from everystate.viewing.gate import Gate
from everystate.viewing.panel import Panel
from everystate.viewing.recording import Recording
from everystate.viewing.stage import Stage
from everystate.viewing.video import as_gif
from everystate.viewing.world import World

HOST = "127.0.0.1"
"""This machine alone."""
_PLOT_PERIOD = 0.25  # seconds between updates of the plots
_READ_PERIOD = 5.0  # seconds for which a problem stays to be read
_FOLLOW_PERIOD = 5.0  # seconds between looks for a newer checkpoint of the run


class Studio:
    """A live body and the page that shows it; what is pressed there is done between two steps."""

    def __init__(
        self,
        run: Path | str,
        *,
        host: str = HOST,
        port: int = 8080,
        plan: bool | None = None,
        seed: int = 0,
    ) -> None:
        """Loads the agent, serves the page and begins to live.

        Args:
            run: run folder, also one that is still training, exported agent, or a shipped one.
            host: address to serve the page on; one that other machines can reach asks for a token.
            port: of the page; 0 takes any that is free.
            plan: whether it begins by planning ahead or by the policy; None: as the agent says.
            seed: of where the body starts, its noise, and what surprises it.

        Raises:
            EverystateError: no agent there, a body that cannot be drawn, or an address that
                cannot be had.
        """
        self.run = Path(run)
        self.world = World(load(run), seed, plan=plan)
        env = self.world.env
        if not isinstance(env, MujocoVectorEnv):
            raise EverystateError(f"{env.name} has no model that a browser can draw")
        self.gate = Gate(host)
        port = _free(host, port)
        # Quietly: its banner names it and not us.
        with contextlib.redirect_stdout(io.StringIO()), self.gate.around():
            self._server = viser.ViserServer(host, port, label="Everystate", verbose=False)
        self.address = self.gate.address(self._server.get_port())
        self._commands: dict[str, Callable[[], None]] = {}  # The last of each control.
        self._stage = Stage(self._server, env.body, self._pull)
        self._panel = Panel(self._server.gui, self.world, self._do, self._film, str(run))
        self._control_step = env.control_step or 0.04
        self._stopped = threading.Event()
        self._drawing = threading.Thread()  # of a film; one at a time
        self._newest: Path | None = None  # of the checkpoints that were looked at
        self._live = threading.Thread(target=self._run, name="studio", daemon=True)
        self._live.start()

    def close(self) -> None:
        """Ends the body's life and the page."""
        self._stopped.set()
        self._live.join()  # a first step compiles, and the page must be there when it is done
        with contextlib.redirect_stdout(io.StringIO()):
            self._server.stop()

    def wait(self) -> None:
        """Until it is closed, Ctrl-C, or an error that ends the body's life and is printed."""
        while self._live.is_alive():
            self._live.join(timeout=0.5)

    def _do(self, control: str, action: Callable[[], None]) -> None:
        """Leaves it to the thread in which the body lives: the last that was wanted in a step."""
        self._commands[control] = action

    def _pull(self, part: int, start: np.ndarray, end: np.ndarray) -> None:
        self._do("body", partial(self.world.pull, part, start, end))

    def _film(self, client: viser.ClientHandle) -> None:
        def draw(recorded: Recording) -> None:
            note = client.add_notification("Drawing a film", "of the last seconds", loading=True)
            try:
                client.send_file_download(*as_gif(recorded, self.world.env), save_immediately=True)
            except EverystateError as error:
                client.add_notification("There is no film", str(error), color="red")
            finally:
                note.remove()

        def begin() -> None:  # the body lives on while it is drawn
            if self._drawing.is_alive():
                raise EverystateError("a film is being drawn: take the next one after it")
            recorded = self.world.recording()
            self._drawing = threading.Thread(target=draw, args=(recorded,), daemon=True)
            self._drawing.start()

        self._do("film", begin)

    # --- The life ---

    def _run(self) -> None:
        due = shown = checked = 0.0
        goal = None
        while not self._stopped.is_set():
            began = time.perf_counter()
            try:
                while self._commands:
                    self._commands.popitem()[1]()
                if not self._panel.paused:
                    self.world.step()
                if goal is None or not np.array_equal(goal, self.world.goal):
                    goal = self.world.goal.copy()
                    self._stage.show_goal(goal)
                world = self.world
                self._stage.show(world.state, world.trail, world.ahead, world.heading)
                if began - shown > _PLOT_PERIOD:
                    shown = began
                    self._panel.show()
                if began - checked > _FOLLOW_PERIOD:
                    checked = began
                    self._follow()
            except EverystateError as error:
                self._panel.tell(str(error))
                shown = began + _READ_PERIOD
            # A late step is made up for by the next ones; a very late one is not.
            due = max(due, began - _PLOT_PERIOD) + self._control_step / self._panel.speed
            self._stopped.wait(max(0.0, due - time.perf_counter()))

    def _follow(self) -> None:
        """A run that is still training: takes its newest checkpoint."""
        found = sorted(self.run.glob("checkpoints/[0-9]*"))
        if found and found[-1] != self._newest:
            self._newest = found[-1]
            self.world.follow(load(self.run))
            self._panel.readings.rescale()


def _free(host: str, port: int) -> int:
    """The port, if nobody has it; viser would quietly take another."""
    if not 0 <= port < 2**16:
        raise EverystateError(f"port {port} is none: choose one from 1 to 65535, or 0 for any")
    try:
        family, *_, place = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family) as probe:
            probe.bind(place)
            return probe.getsockname()[1]
    except (OSError, UnicodeError) as error:
        raise EverystateError(
            f"port {port} of {host} cannot be had ({error}): choose another"
        ) from error


def studio(
    run: Path | str,
    *,
    host: str = HOST,
    port: int = 8080,
    plan: bool | None = None,
    seed: int = 0,
) -> None:
    """Serves the page until Ctrl-C; see `Studio`."""
    page = Studio(run, host=host, port=port, plan=plan, seed=seed)
    print(f"{page.address} (Ctrl-C ends it)", flush=True)
    try:
        page.wait()
    finally:
        page.close()

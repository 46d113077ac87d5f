"""What the results of other people's agents say of them."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class PeerConfig:
    """What the results of a peer say of it."""

    body: str
    body_options: tuple[str, ...]
    seed: int
    agent: str
    settings: dict[str, Any]
    """The fields of its `PeerSettings`; empty for one that does not learn."""

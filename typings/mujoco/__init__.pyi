# MuJoCo's compiled part has no stubs: without these files every name of it is an error to pyright.
from typing import Any

def __getattr__(name: str) -> Any: ...

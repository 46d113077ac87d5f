"""Array formulas written once, and taken down as steps that NumPy and ONNX both know."""

from dataclasses import dataclass, field
from typing import Any, final

import numpy as np

from everystate.portable import INPUTS, OUTPUT, Policy, Step


@final
@dataclass(frozen=True)
class Tape:
    """What has been done so far to the inputs."""

    steps: list[Step] = field(default_factory=list)
    constants: dict[str, np.ndarray] = field(default_factory=dict)

    def inputs(self) -> tuple["Traced", ...]:
        """Those of a policy, each float32 [batch, state]."""
        return tuple(Traced(self, name) for name in INPUTS)

    def do(self, operator: str, *inputs: Any) -> "Traced":
        """Takes down one step; inputs that are not traced are constants, numbers float32."""
        names = tuple(x.name if isinstance(x, Traced) else self._constant(x) for x in inputs)
        output = f"step_{len(self.steps)}"
        self.steps.append(Step(operator, names, output))
        return Traced(self, output)

    def ended(
        self, action: "Traced", state_names: tuple[str, ...], action_names: tuple[str, ...]
    ) -> Policy:
        """The policy whose action is the last step."""
        *before, last = self.steps
        assert action.name == last.output
        steps = (*before, last._replace(output=OUTPUT))
        return Policy(state_names, action_names, steps, self.constants)

    def _constant(self, value: Any) -> str:
        array = np.asarray(value)
        array = array if array.dtype == bool else array.astype(np.float32)
        name = f"constant_{len(self.constants)}"
        self.constants[name] = array
        return name


@final
@dataclass(frozen=True)
class Traced:
    """An array that is known only when the tape is run; arithmetic with it is taken down."""

    tape: Tape
    name: str

    __array_ufunc__ = None  # so that an array on the left leaves the arithmetic to this class

    def __add__(self, other: Any) -> "Traced":
        return self.tape.do("Add", self, other)

    def __radd__(self, other: Any) -> "Traced":
        return self.tape.do("Add", other, self)

    def __sub__(self, other: Any) -> "Traced":
        return self.tape.do("Sub", self, other)

    def __rsub__(self, other: Any) -> "Traced":
        return self.tape.do("Sub", other, self)

    def __mul__(self, other: Any) -> "Traced":
        return self.tape.do("Mul", self, other)

    def __rmul__(self, other: Any) -> "Traced":
        return self.tape.do("Mul", other, self)

    def __truediv__(self, other: Any) -> "Traced":
        return self.tape.do("Div", self, other)

    def __rtruediv__(self, other: Any) -> "Traced":
        return self.tape.do("Div", other, self)

    def __matmul__(self, other: Any) -> "Traced":
        return self.tape.do("MatMul", self, other)

    def __ge__(self, other: Any) -> "Traced":
        return self.tape.do("GreaterOrEqual", self, other)

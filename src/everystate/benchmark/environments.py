"""The environments of the benchmark by their Gymnasium ids: a body and a suite of its goals.

The version in an id is that of the suite's two files and of how they are scored: where either
changes, so does the version.
"""

ENVIRONMENTS: dict[str, tuple[str, str]] = {
    "everystate/RampPointmassRest-v1": ("ramp-pointmass", "rest"),
    "everystate/CartpoleRest-v1": ("cartpole", "rest"),
    "everystate/CartpoleMotion-v1": ("cartpole", "motion"),
    "everystate/AntRest-v1": ("ant", "rest"),
    "everystate/AntMotion-v1": ("ant", "motion"),
}
"""Body and suite of each."""

"""What a run that was interrupted and resumed has spent."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Spent:
    """Wall and CPU time (user + system), s."""

    wall_time: float = 0.0
    cpu_time: float = 0.0

    def __add__(self, other: "Spent") -> "Spent":
        return Spent(self.wall_time + other.wall_time, self.cpu_time + other.cpu_time)

"""The paper's analysis cases: which points of the cubes belong to them."""

from dataclasses import dataclass
from typing import Any

from tripod_doe.number_text import level


@dataclass(frozen=True)
class Cases:
    """The paper's analysis cases for one model; it does not print their skews."""

    model: str  # model of the ladder
    # small, large: skews of case 1 and of cases 2 to 4 in degrees
    small: float
    large: float

    @property
    def text(self) -> str:
        """The skews of all cases."""
        text = (f"case {case} ({', '.join(level(skew) for skew in self.skews(case))})" for case in (1, 2, 3, 4))
        return f"{', '.join(text)} deg on trunnions 1, 2, 3; chosen, since the paper does not print them"

    def skews(self, case: int) -> tuple[float, float, float]:
        """Initial skews of a case in degrees: 1 and 2 uneven, 3 equal, 4 as 2 reversed, 0 none."""
        small, large = self.small, self.large
        return {
            0: (0.0, 0.0, 0.0),
            1: (small, -small, small),
            2: (large, -large, large),
            3: (large, large, large),
            4: (-large, large, -large),
        }[case]

    def wanted(self, case: int) -> dict[str, Any]:
        """Parameter values that identify the points of a case."""
        skews = {f"initial_skew_{k}_deg": skew for k, skew in enumerate(self.skews(case), 1)}
        return {"model": self.model} | skews

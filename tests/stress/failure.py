"""What a check finds: failures, each of a kind, and how many statements were checked."""

from collections import Counter
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Failure:
    """Something that must not be: `kind` is the same for all failures of one kind, `detail` is of this one."""

    kind: str
    detail: str


@dataclass
class Findings:
    """What the checks of one log came to: statements by kind that held, failures, and what nobody could check."""

    held: Counter[str] = field(default_factory=Counter)
    failures: list[Failure] = field(default_factory=list)
    unchecked: Counter[str] = field(default_factory=Counter)

    def check(self, what: str, holds: bool, detail: object = "") -> bool:
        """One statement: counted where it holds, a failure of kind `what` where it does not."""
        if holds:
            self.held[what] += 1
        else:
            self.failures.append(Failure(what, str(detail)))
        return bool(holds)

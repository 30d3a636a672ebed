"""Options from a file and from the command line, together: the command line wins."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from teamslam.config import Config


def config_for(
    path: Path | None,
    *,
    method: str | None = None,
    exact: bool = False,
    gap: float | None = None,
    loss: str | None = None,
    loss_scale: float | None = None,
    calibrate: bool | None = None,
    reject: bool = False,
    wrong: float | None = None,
    repair: bool = False,
) -> "Config":
    """The options of a run. InputError for unknown names, and for an option that would be without effect."""
    from teamslam.config import Config, read_config
    from teamslam.errors import InputError
    from teamslam.model import Loss

    config = read_config(path) if path else Config()
    if method is not None:
        rounds = config.join.exact and method == "join"
        config = replace(config, method=method, join=replace(config.join, exact=rounds))
    if calibrate is not None:
        config = replace(config, calibrate=calibrate)
    if exact:
        config = replace(config, join=replace(config.join, exact=True))
    if gap is not None:
        if not config.join.exact:
            raise InputError("--gap needs --exact (or exact = true in the options file)")
        config = replace(config, join=replace(config.join, gap=gap))
    if wrong is not None and not (reject or config.trust.reject):
        raise InputError("--wrong needs --reject (or reject = true in the options file)")
    if reject or wrong is not None or repair:
        trust = config.trust
        wrong = trust.wrong if wrong is None else wrong
        trust = replace(trust, reject=reject or trust.reject, wrong=wrong, repair=repair or trust.repair)
        config = replace(config, trust=trust)
    if loss is not None:
        if loss == "squared" and loss_scale is not None:
            raise InputError("--loss-scale goes with a loss that has a scale; squared has none")
        return replace(config, loss=Loss(loss, 1.0 if loss_scale is None else loss_scale))
    if loss_scale is not None:
        if config.loss is None:
            raise InputError("--loss-scale needs --loss (or a [loss] in the options file)")
        return replace(config, loss=replace(config.loss, scale=loss_scale))
    return config

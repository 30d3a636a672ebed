"""Options from a file and from the command line, together: the command line wins."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from teamslam.config import Config


def asked_of(inputs: tuple[Path, ...], config: Path | None) -> "tuple[Path, Config]":
    """The log that a call names, and the options in its file: a log by itself, or recordings with the team file that
    says what they are. InputError for a call that names no log, or several."""
    from teamslam.config import Config, config_from, read_config
    from teamslam.errors import InputError
    from teamslam.io.bags.team_file import is_team_file, read_team_file

    if config is not None and is_team_file(config):
        options = config_from(read_team_file(config).options, path=config)
        if inputs:
            instead = {"recordings": [str(path.resolve()) for path in inputs]}
            options = replace(options, read={**options.read, **instead})
        return config, options
    if len(inputs) != 1:
        what = "no log" if not inputs else f"{len(inputs)} inputs, and one log makes a map"
        raise InputError(f"{what}; recordings of a team go with --config TEAM.toml, which `teamslam info` proposes")
    (log,) = inputs
    if config is not None:
        return log, read_config(config)
    return log, config_from(read_team_file(log).options, path=log) if is_team_file(log) else Config()


def config_for(
    given: "Path | Config | None",
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

    config = given if isinstance(given, Config) else read_config(given) if given else Config()
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

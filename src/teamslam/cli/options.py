"""Options from a file and from the command line, together: the command line wins."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from teamslam.config import Config
    from teamslam.scale import Workers


def config_for(
    path: Path | None,
    *,
    method: str | None = None,
    exact: bool = False,
    gap: float | None = None,
    loss: str | None = None,
    loss_scale: float | None = None,
) -> "Config":
    """The options of a run. InputError for unknown names, and for a scale or a gap that nothing goes with."""
    from teamslam.config import Config, read_config
    from teamslam.errors import InputError
    from teamslam.model import Loss

    config = read_config(path) if path else Config()
    if method is not None:
        config = replace(config, method=method)
    if exact:
        config = replace(config, join=replace(config.join, exact=True))
    if gap is not None:
        if not config.join.exact:
            raise InputError("--gap needs --exact (or exact = true in the options file)")
        config = replace(config, join=replace(config.join, gap=gap))
    if loss is not None:
        return replace(config, loss=Loss(loss, 1.0 if loss_scale is None else loss_scale))
    if loss_scale is not None:
        if config.loss is None:
            raise InputError("--loss-scale needs --loss (or a [loss] in the options file)")
        return replace(config, loss=replace(config.loss, scale=loss_scale))
    return config


def workers_for(count: int | None, cluster: str | None) -> "Workers | None":
    """The workers that were asked for, None where none were. InputError where both kinds were, and, before any work is
    done or written, where no scheduler answers."""
    from teamslam.errors import InputError
    from teamslam.scale import Cluster, Processes

    if count is not None and cluster is not None:
        raise InputError("give --workers for processes of this machine, or --cluster for those of a cluster, not both")
    if cluster is not None:
        workers = Cluster(cluster)
        workers.open().shutdown()
        return workers
    return None if count is None else Processes(count)

"""`teamslam view`: runs in the browser, in space and over time."""

from pathlib import Path

from teamslam.cli.numbers import MaybeWhole


def view(
    *runs: Path,
    port: MaybeWhole = None,
    host: str = "127.0.0.1",
    browser: bool = True,
) -> int:
    """Look at runs in the browser: ways, truth, ellipsoids, sightings by robot and time, several runs in one space.

    Runs of one log are laid onto the first by one rigid fit of the whole team; what has nothing in common with it
    stands beside it. It ends with Ctrl-C. Needs `pip install teamslam[view]`.

    ```
    teamslam view my-map
    teamslam view joined full                    # two runs of one log, one over the other
    teamslam view my-map --port 9000 --no-browser
    ```

    Exit codes: 0 ended by Ctrl-C or a signal; 2 bad input or usage.

    Parameters
    ----------
    runs
        Folders that `teamslam run` or `teamslam join` wrote.
    port
        The port to listen at, 8080 without it; where it is taken, the next that is free.
    host
        The address to listen at. Only this machine reaches 127.0.0.1; at 0.0.0.0 whoever reaches this machine looks.
    browser
        Open a browser, where there is one.
    """
    import time
    import webbrowser

    from teamslam.cli.console import say
    from teamslam.errors import InputError
    from teamslam.results import read_run, with_residuals
    from teamslam.viewer import Viewer, placed

    if not runs:
        raise InputError("name the runs to look at: folders that `teamslam run` wrote")
    if port is not None and not 1 <= port <= 65535:
        raise InputError(f"--port is a number from 1 to 65535, found {port}")
    records = {str(run): with_residuals(read_run(run), run) for run in runs}
    viewer = Viewer(placed(records), host=host, port=port or 8080)
    try:
        say(f"look at {viewer.address} in a browser; end with Ctrl-C")
        if browser:
            webbrowser.open(viewer.address)
        while True:
            time.sleep(0.05)
            viewer.step(0.05)
    except KeyboardInterrupt:
        return 0
    finally:
        viewer.stop()

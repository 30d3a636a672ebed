"""The command line: one small file a command, each a thin coat on a function that a script can call too."""

from teamslam.cli.app import app, main

__all__ = ["app", "main"]

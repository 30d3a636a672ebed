"""`teamslam paper`."""


def paper() -> int:
    """Later."""
    return 0

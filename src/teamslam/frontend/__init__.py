"""From streams and stamps to poses and rows, wherever they come from."""

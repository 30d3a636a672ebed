"""Films of made-up rooms: what cameras on robots would have recorded, with the truth. Needs OpenCV (extra `tags`).

film(PRESETS["experiment"], seed=7)     the paper's experiment (section 3.2)

boards      rectangles with a picture: tags, posters, the sides of robots
stage       a room, what hangs in it, what drives in it
shutter     when each point of each pixel is exposed
patches     what a point of the image sees of a board
render      what a camera sees
lens        what of its light falls on each pixel
develop     what its sensor makes of it
"""

from teamslam.sim.film.stage import Stage
from teamslam.sim.film.takes import PRESETS, Film, Frame, Options, film

__all__ = ["PRESETS", "Film", "Frame", "Options", "Stage", "film"]

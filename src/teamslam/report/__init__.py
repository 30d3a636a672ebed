"""The page of a run: what is known of it in, one HTML file out that needs nothing else.

It looks at records of arrays and words, and knows neither solvers nor files; `results.page` makes the record of a run.
"""

from teamslam.report.contents import Marks, Page, Part, Rows, Sightings, Table, Way
from teamslam.report.page import html_of
from teamslam.report.thin import evenly, within

__all__ = ["Marks", "Page", "Part", "Rows", "Sightings", "Table", "Way", "evenly", "html_of", "within"]

"""Factor graphs of other programs: g2o, JRL, PyFG."""

"""The paper's tables and figures again, from our own runs of its simulation."""

"""What a misfit looks like: mistakes that people make in logs, each tried on the data itself."""

"""What all readers stand on: text, lines, cells, JSON and MATLAB files with their places; files written whole."""

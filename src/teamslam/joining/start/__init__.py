"""Where a log starts: dead reckoning, its bent ways, and landmarks placed from what was seen of them."""

"""Tags: from corners in images to rows. Camera models, how well a corner is known, and which body carries which tag."""

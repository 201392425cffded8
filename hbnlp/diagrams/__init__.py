"""Everything that is connected: branches, the points where they meet, and what a search finds beside them."""

"""The HTML report: leaderboard, figures, the paper's table and figures, and races against the best-known flights."""

"""Published results as tables and figures of the README and the docs."""

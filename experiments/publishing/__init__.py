"""Published results as tables and pictures in the README and the docs."""

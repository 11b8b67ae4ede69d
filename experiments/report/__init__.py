"""What the report page is made of: `board` the numbers, `charts` the figures, `race` the flights.

`experiments.report.page` puts them together with the HTML, CSS and JavaScript that lie beside them.
"""

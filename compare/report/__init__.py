"""The HTML page of a comparison.

- `page`: collects the contents of the page and fills the template.
- `figures`: plots of measured and simulated curves as inline SVG.
- `plot_style`: colours, style and SVG output of the plots.
- `fill_template`: fills a template of the folder `templates`.
- `templates/`: Jinja templates of all pages, and their style sheet.
"""

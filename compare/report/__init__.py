"""The HTML page of a comparison.

- `page`: collects the contents of the page and fills the template.
- `figures`: plots of measured and simulated curves, and of all deviations.
- `figure_file`: a figure and its files; `plot_style`: colours and style of all figures.
- `methods`: the methods text of a comparison; `methods_text`: its forms, also for other commands.
- `fill_template`: fills a template of the folder `templates`.
- `templates/`: Jinja templates of all pages, and their style sheet.
"""

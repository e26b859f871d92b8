"""Fill the templates of the pages."""

from __future__ import annotations

from typing import Any


def filled(template: str, **values: Any) -> str:
    """Return the filled text of a template.

    Parameters
    ----------
    template : str
        Name of a file of ``compare/report/templates``.
    **values : object
        Values by name; they are escaped in HTML only.

    Returns
    -------
    str
        The text.
    """
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("rigtwin.compare.report", "templates"),
        autoescape=template.endswith(".html"),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(values)

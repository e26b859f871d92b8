"""Twins, deviations and the report: the only room that sees both measurement and simulation.

::

    comparison    a lab compared with its twins, from lab.toml to report.html
    beforehand    what of a lab cannot work, said before any work
    repetitions   measures all repetitions, several at a time
    twin          the simulated counterpart of an experiment, read with the same ruler
    cast          particle, wall and contact for a twin asked for by name
    deviation     repetitions combined; measured beside simulated
    results       CSV, JSON, provenance; all files or none
    report        the page for a person, with figures and wording
"""

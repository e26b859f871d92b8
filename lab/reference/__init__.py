"""Published materials, particles and contacts that a lab can use by name.

- `hlosta2020`: those of Hlosta et al. 2020, from the tables in `tables_hlosta2020/`.
- `bibliography`: papers and books that the models and methods come from, in `references.bib`.
"""

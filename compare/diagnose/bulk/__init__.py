"""The diagnosis of rigs with many particles: pile, packing, drum and hopper.

- `bulk_lab`: the lab's conditions, records and stated values; `read_bulk_json` and `from_bulk_toml` read them
- `observables`: records of both sides as numbers, on one grid
- `axes`: what can be varied in a twin or in its picture, and over which range
- `candidates`: the effects that are tried, by name
- `twin_design`: which twins are run; `response`: what they say along each axis
- `misfit`: baseline and candidates fitted to the measurements; `naming`: the verdict
- `further_experiment`: twins of a further experiment that separates names
- `diagnose_bulk`: all of these in turn; `bulk_page`: the report
"""

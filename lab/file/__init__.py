"""Read lab.toml and model.toml.

- `lab_file`: `read_lab`, the experiments of a lab folder; `new_lab`.
- `schema`: the keys of both files, and the message on what is wrong in which line.
- `lookup`: materials, particles and contacts by name, from the file or the published reference.
- `own_particles`: spheres and clumps that the file describes itself.
- `model_file`: `read_model`, `model_text`: what a twin runs on, with its effects.
- `toml_lines`: the line of every key.
"""

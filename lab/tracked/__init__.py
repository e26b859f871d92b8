"""Read tracked data that other programs exported: tables of positions, angles, surfaces or masses over time.

- `table`: `Table`, a table as a file holds it, and `TableOptions`, what is stated of it
- `text_table`: text of any separator, decimal sign and header into rows of cells
- `columns`: which column is which, and its unit
- `project_files`: Tracker projects, TrackMate XML and Parquet as the same table
- `bodies`: several bodies in one table, broken tracks joined
- `upright`: whether y counts upwards, by the motion itself
- `read`: tracks, profiles and series in SI units, with what was understood (`Understood`)
"""

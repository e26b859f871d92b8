"""The tables of Hlosta et al. 2020 beside what our twins give with the paper's calibrated parameters."""

"""The paper's figures, one module each: `compute` makes a table, which goes to disk, and `plot` draws it from there."""

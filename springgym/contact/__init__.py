"""Contact: its law. Surfaces meet by it at `springgym.forces.node`, bodies in `springgym.forces.pairs`."""

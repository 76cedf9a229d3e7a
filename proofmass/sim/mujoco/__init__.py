"""MuJoCo: `engine` is all that the rest of the package asks for."""

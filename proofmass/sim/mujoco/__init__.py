"""MuJoCo; the rest of the package imports only its module `engine`."""

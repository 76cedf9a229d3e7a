"""Studies of errors against wall time, of orders and error floors; choice of a setting."""

"""Studies of errors against processor time, of orders and error floors; choice of a setting."""

"""What a user wrote: the sidecar as tables, the motion of its drives, and which files hold it."""

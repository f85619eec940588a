"""What is asked, as plain data: problem files, environments and the verifier speak of tasks in these words alone."""

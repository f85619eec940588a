"""The independent verifier: it reads robot and task anew, and proves the chords of a path."""

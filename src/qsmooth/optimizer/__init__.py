"""The optimiser and untangling: Newton's steps vertex by vertex, and on all vertices at once."""

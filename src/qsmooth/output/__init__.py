"""What is shown of meshes and results: tables and figures."""

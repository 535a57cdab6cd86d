"""What a scene is: bodies, surfaces, collisions, materials. NumPy only."""

"""The body: materials, inertia, supports, loads, contact places and its forms."""

"""Contact points, rigid surfaces, and the friction law over a time step."""

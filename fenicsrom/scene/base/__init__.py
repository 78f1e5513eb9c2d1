"""What all tables of a scene share: rules of values, tables of keys, and TOML text."""

"""Writers of files, tables, and the style of all pictures."""

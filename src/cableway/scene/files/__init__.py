"""Task files: schema, reading, saving, presets and the catalogue."""

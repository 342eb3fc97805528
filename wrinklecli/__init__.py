"""Dynamic wrinkles for animated glTF characters, baked."""

# The driver for Godot 4: a node right below the root of an imported scene. Beside it stands driver.gd, with what that needs.
#
# `gltf` is the baked file, from which the extras are read: so export *.glb with the game.
extends "driver.gd"

@export_file("*.glb", "*.gltf") var gltf = ""


func _ready():
	begin(gltf)


func bytes_of(path):
	var file = FileAccess.open(path, FileAccess.READ)
	return null if file == null else file.get_buffer(file.get_length())


func value_of(text):
	return JSON.parse_string(text)
